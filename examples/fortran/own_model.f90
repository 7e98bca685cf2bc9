! SPDX-License-Identifier: BSD-3-Clause
!> Your own model in Fortran: extend model_type and give the gradient.
!>
!>    H = p^2/2 - cos q,   H_1 = sigma sin q   (a pendulum that is shaken sideways)
!>
!> Models are called from several threads at once, so compile with -frecursive (or -fopenmp):
!>
!>    gfortran -frecursive own_model.f90 $(pkg-config --cflags --libs symsde) -o own_model && ./own_model
module shaken_pendulum
   use symsde
   implicit none
   private
   public :: shaken_model

   type, extends(model_type) :: shaken_model
      real(wp) :: sigma = 0.3_wp
   contains
      procedure :: gradient
      procedure :: hessian
   end type shaken_model

contains

   !> Gradient of w_0 H + w_1 H_1, lane by lane. An output that is absent is not needed.
   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(shaken_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp) :: sine(nlane), cosine(nlane)

      if (present(hq)) then
         call sincos_lanes(nlane, q(:, 1), sine, cosine)
         hq(:, 1) = w(:, 0)*sine + w(:, 1)*self%sigma*cosine
      end if
      if (present(hp)) hp(:, 1) = w(:, 0)*p(:, 1)
   end subroutine gradient

   !> Second derivatives. They are optional: without them they are approximated by differences of gradients.
   subroutine hessian(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      class(shaken_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof), hpp(nlane, ndof, ndof)
      real(wp) :: sine(nlane), cosine(nlane)

      if (present(hqq)) then
         call sincos_lanes(nlane, q(:, 1), sine, cosine)
         hqq(:, 1, 1) = w(:, 0)*cosine - w(:, 1)*self%sigma*sine
      end if
      if (present(hqp)) hqp = 0
      if (present(hpp)) hpp(:, 1, 1) = w(:, 0)
   end subroutine hessian

end module shaken_pendulum

program own_model
   use symsde
   use shaken_pendulum, only: shaken_model
   implicit none

   type(shaken_model) :: model
   type(scheme_type) :: scheme
   type(moments_type) :: averages
   type(error_type), allocatable :: error
   integer :: last

   ! Traits decide which work the scheme may skip. A false trait is refused by name.
   model%name = 'pendulum'
   model%traits = model_traits(ndof=1, nnoise=1, separable=.true., position_noise=.true., identity_mass=.true., &
                               has_hessian=.true.)
   call get_scheme(scheme, 'midpoint', error)
   call moments(model, scheme, run_options(step=0.05_wp, nstep=200_i8, npath=20000_i8, seed=3_i8, save_every=200_i8), &
                q0=[1.0_wp], p0=[0.0_wp], result=averages, error=error)
   if (allocated(error)) then
      print '(a)', error%message
      stop 1
   end if
   last = size(averages%t)
   print '(a, f9.6, a, f8.6, a, f4.1)', 'E q = ', averages%mean(1, last), ' +- ', averages%se_mean(1, last), &
      ' at t = ', averages%t(last)
   print '(4a)', 'stepper: ', averages%report%stepper, '; left out: ', averages%report%left_out
end program own_model
