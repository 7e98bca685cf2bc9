! SPDX-License-Identifier: BSD-3-Clause
!> A model without any helpful trait: mixed derivatives without symmetry, multiplicative noise, nothing separable.
!>
!>    H   = sum_i (p_i^2 + q_i^2)/2 + c (q_i p_j + q_i^2 p_j^2/2),   j = min(i+1, n)
!>    H_1 = s sum_i q_i p_j,   H_2 = s sum_i (p_i^2 + q_i^2)/2
!>
!> The built-in models have no mixed derivatives, so they cannot show that a matrix has its blocks transposed.
module coupled_model
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: model_traits
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: coupled_type, new_coupled

   type, extends(model_type) :: coupled_type
      real(wp) :: c = 0.3_wp   !! coupling of the drift
      real(wp) :: s = 0.2_wp   !! intensity of the noises
   contains
      procedure :: value => weighted_value
      procedure :: gradient
      procedure :: hessian
      procedure :: hessian_banded
   end type coupled_type

contains

   !> n degrees of freedom; the Hessian is banded, with bandwidth one.
   subroutine new_coupled(self, n)
      type(coupled_type), intent(out) :: self
      integer, intent(in) :: n

      self%name = 'coupled'
      self%traits = model_traits(ndof=n, nnoise=2, bandwidth=min(1, n - 1), has_value=.true., has_hessian=.true.)
   end subroutine new_coupled

   subroutine weighted_value(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(coupled_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)
      integer :: i, j

      value = 0
      do i = 1, ndof
         j = min(i + 1, ndof)
         value = value + (w(:, 0) + self%s*w(:, 2))*(p(:, i)**2 + q(:, i)**2)/2 &
                 + (self%c*w(:, 0) + self%s*w(:, 1))*q(:, i)*p(:, j) &
                 + self%c*w(:, 0)*(q(:, i)*p(:, j))**2/2
      end do
   end subroutine weighted_value

   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(coupled_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      integer :: i, j

      do i = 1, ndof
         if (present(hq)) hq(:, i) = (w(:, 0) + self%s*w(:, 2))*q(:, i)
         if (present(hp)) hp(:, i) = (w(:, 0) + self%s*w(:, 2))*p(:, i)
      end do
      do i = 1, ndof
         j = min(i + 1, ndof)
         if (present(hq)) hq(:, i) = hq(:, i) + (self%c*w(:, 0) + self%s*w(:, 1))*p(:, j) &
                                     + self%c*w(:, 0)*q(:, i)*p(:, j)**2
         if (present(hp)) hp(:, j) = hp(:, j) + (self%c*w(:, 0) + self%s*w(:, 1))*q(:, i) &
                                     + self%c*w(:, 0)*q(:, i)**2*p(:, j)
      end do
   end subroutine gradient

   subroutine hessian(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      class(coupled_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof)
      real(wp), intent(out), optional :: hpp(nlane, ndof, ndof)
      integer :: i, j

      if (present(hqq)) hqq = 0
      if (present(hqp)) hqp = 0
      if (present(hpp)) hpp = 0
      do i = 1, ndof
         if (present(hqq)) hqq(:, i, i) = w(:, 0) + self%s*w(:, 2)
         if (present(hpp)) hpp(:, i, i) = w(:, 0) + self%s*w(:, 2)
      end do
      do i = 1, ndof
         j = min(i + 1, ndof)
         if (present(hqq)) hqq(:, i, i) = hqq(:, i, i) + self%c*w(:, 0)*p(:, j)**2
         if (present(hqp)) hqp(:, i, j) = self%c*w(:, 0)*(1 + 2*q(:, i)*p(:, j)) + self%s*w(:, 1)
         if (present(hpp)) hpp(:, j, j) = hpp(:, j, j) + self%c*w(:, 0)*q(:, i)**2
      end do
   end subroutine hessian

   subroutine hessian_banded(self, nlane, ndof, nnoise, b, t, w, q, p, hqq, hqp, hpp)
      class(coupled_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise, b
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, -b:b, ndof), hqp(nlane, -b:b, ndof)
      real(wp), intent(out), optional :: hpp(nlane, -b:b, ndof)
      real(wp), allocatable :: dense(:, :, :, :)
      integer :: i, d

      allocate (dense(nlane, ndof, ndof, 3))
      call self%hessian(nlane, ndof, nnoise, t, w, q, p, dense(:, :, :, 1), dense(:, :, :, 2), &
                        dense(:, :, :, 3))
      if (present(hqq)) hqq = 0
      if (present(hqp)) hqp = 0
      if (present(hpp)) hpp = 0
      do i = 1, ndof
         do d = max(-b, 1 - i), min(b, ndof - i)
            if (present(hqq)) hqq(:, d, i) = dense(:, i, i + d, 1)
            if (present(hqp)) hqp(:, d, i) = dense(:, i, i + d, 2)
            if (present(hpp)) hpp(:, d, i) = dense(:, i, i + d, 3)
         end do
      end do
   end subroutine hessian_banded

end module coupled_model
