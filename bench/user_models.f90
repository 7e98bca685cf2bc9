! SPDX-License-Identifier: BSD-3-Clause
!> Two models of the catalogue as a user writes them in Fortran, with the public module alone.
!>
!> The synchrotron twice: by sincos_lanes, which gradient and Hessian share, and by the intrinsics. Of these, sine and
!> cosine of one argument in one statement become a scalar call of sincos for each lane; in statements of their own
!> gfortran -O3 takes the vector versions of the C library, without -ffast-math.
module bench_user_models
   use symsde, only: wp, model_type, sincos_lanes
   implicit none
   private
   public :: user_oscillator, user_synchrotron, plain_synchrotron

   !> H = (p^2 + q^2)/2, H_1 = -sigma q
   type, extends(model_type) :: user_oscillator
      real(wp) :: sigma = 1
   contains
      procedure :: gradient => oscillator_gradient
      procedure :: hessian => oscillator_hessian
   end type user_oscillator

   !> H = p^2/2 - omega^2 cos q, H_1 = sigma1 sin q, H_2 = -sigma2 cos q
   type, extends(model_type) :: user_synchrotron
      real(wp) :: omega = 2, sigma1 = 0.2_wp, sigma2 = 0.1_wp
   contains
      procedure :: gradient => synchrotron_gradient
      procedure :: hessian => synchrotron_hessian
      procedure :: gradient_hessian => synchrotron_both
   end type user_synchrotron

   !> The same without help of the library.
   type, extends(model_type) :: plain_synchrotron
      real(wp) :: omega = 2, sigma1 = 0.2_wp, sigma2 = 0.1_wp
   contains
      procedure :: gradient => plain_gradient
      procedure :: hessian => plain_hessian
   end type plain_synchrotron

contains

   subroutine oscillator_gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(user_oscillator), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)

      if (present(hq)) hq(:, 1) = w(:, 0)*q(:, 1) - self%sigma*w(:, 1)
      if (present(hp)) hp(:, 1) = w(:, 0)*p(:, 1)
   end subroutine oscillator_gradient

   subroutine oscillator_hessian(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      class(user_oscillator), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof), hpp(nlane, ndof, ndof)

      if (present(hqq)) hqq(:, 1, 1) = w(:, 0)
      if (present(hqp)) hqp = 0
      if (present(hpp)) hpp(:, 1, 1) = w(:, 0)
   end subroutine oscillator_hessian

   subroutine synchrotron_gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(user_synchrotron), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp) :: sine(nlane), cosine(nlane)

      if (present(hq)) then
         call sincos_lanes(nlane, q(:, 1), sine, cosine)
         hq(:, 1) = (self%omega**2*w(:, 0) + self%sigma2*w(:, 2))*sine + self%sigma1*w(:, 1)*cosine
      end if
      if (present(hp)) hp(:, 1) = w(:, 0)*p(:, 1)
   end subroutine synchrotron_gradient

   subroutine synchrotron_hessian(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      class(user_synchrotron), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof), hpp(nlane, ndof, ndof)
      real(wp) :: sine(nlane), cosine(nlane)

      if (present(hqq)) then
         call sincos_lanes(nlane, q(:, 1), sine, cosine)
         hqq(:, 1, 1) = (self%omega**2*w(:, 0) + self%sigma2*w(:, 2))*cosine - self%sigma1*w(:, 1)*sine
      end if
      if (present(hqp)) hqp = 0
      if (present(hpp)) hpp(:, 1, 1) = w(:, 0)
   end subroutine synchrotron_hessian

   !> One loop where both are wanted: the usual call, made in every iteration of an implicit scheme.
   subroutine synchrotron_both(self, nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hqp, hpp)
      class(user_synchrotron), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof), hpp(nlane, ndof, ndof)
      real(wp) :: sine(nlane), cosine(nlane), a, b
      integer :: i

      if (.not. (present(hq) .and. present(hqq))) then
         call self%gradient(nlane, ndof, nnoise, t, w, q, p, hq, hp)
         call self%hessian(nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
         return
      end if
      call sincos_lanes(nlane, q(:, 1), sine, cosine)
      do i = 1, nlane
         a = self%omega**2*w(i, 0) + self%sigma2*w(i, 2)
         b = self%sigma1*w(i, 1)
         hq(i, 1) = a*sine(i) + b*cosine(i)
         hqq(i, 1, 1) = a*cosine(i) - b*sine(i)
      end do
      if (present(hp)) hp(:, 1) = w(:, 0)*p(:, 1)
      if (present(hqp)) hqp = 0
      if (present(hpp)) hpp(:, 1, 1) = w(:, 0)
   end subroutine synchrotron_both

   subroutine plain_gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(plain_synchrotron), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)

      if (present(hq)) then
         hq(:, 1) = (self%omega**2*w(:, 0) + self%sigma2*w(:, 2))*sin(q(:, 1))
         hq(:, 1) = hq(:, 1) + self%sigma1*w(:, 1)*cos(q(:, 1))
      end if
      if (present(hp)) hp(:, 1) = w(:, 0)*p(:, 1)
   end subroutine plain_gradient

   subroutine plain_hessian(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      class(plain_synchrotron), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof), hpp(nlane, ndof, ndof)

      if (present(hqq)) then
         hqq(:, 1, 1) = (self%omega**2*w(:, 0) + self%sigma2*w(:, 2))*cos(q(:, 1))
         hqq(:, 1, 1) = hqq(:, 1, 1) - self%sigma1*w(:, 1)*sin(q(:, 1))
      end if
      if (present(hqp)) hqp = 0
      if (present(hpp)) hpp(:, 1, 1) = w(:, 0)
   end subroutine plain_hessian

end module bench_user_models
