! SPDX-License-Identifier: BSD-3-Clause
!> A nonlinear oscillator with a quadratic invariant: I = (p^2+q^2)/2, H = I + I^2/2, H_1 = sigma I.
!>
!> Each step needs Newton's iteration, and the midpoint rule keeps I exactly: any drift of I is an error of the solver.
module nonlinear_kubo
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: model_traits
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: nonlinear_kubo_type, new_nonlinear_kubo

   type, extends(model_type) :: nonlinear_kubo_type
      real(wp) :: sigma = 0.5_wp
   contains
      procedure :: gradient
      procedure :: hessian
   end type nonlinear_kubo_type

contains

   subroutine new_nonlinear_kubo(self, sigma)
      type(nonlinear_kubo_type), intent(out) :: self
      real(wp), intent(in) :: sigma

      self%name = 'nonlinear_kubo'
      self%sigma = sigma
      self%traits = model_traits(ndof=1, nnoise=1, has_hessian=.true.)
   end subroutine new_nonlinear_kubo

   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(nonlinear_kubo_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp) :: slope(nlane)

      slope = w(:, 0)*(1 + (p(:, 1)**2 + q(:, 1)**2)/2) + self%sigma*w(:, 1)
      if (present(hq)) hq(:, 1) = slope*q(:, 1)
      if (present(hp)) hp(:, 1) = slope*p(:, 1)
   end subroutine gradient

   subroutine hessian(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      class(nonlinear_kubo_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof)
      real(wp), intent(out), optional :: hpp(nlane, ndof, ndof)
      real(wp) :: slope(nlane)

      slope = w(:, 0)*(1 + (p(:, 1)**2 + q(:, 1)**2)/2) + self%sigma*w(:, 1)
      if (present(hqq)) hqq(:, 1, 1) = slope + w(:, 0)*q(:, 1)**2
      if (present(hqp)) hqp(:, 1, 1) = w(:, 0)*q(:, 1)*p(:, 1)
      if (present(hpp)) hpp(:, 1, 1) = slope + w(:, 0)*p(:, 1)**2
   end subroutine hessian

end module nonlinear_kubo
