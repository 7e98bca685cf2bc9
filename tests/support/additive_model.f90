! SPDX-License-Identifier: BSD-3-Clause
!> Additive noise on q and p of a system that is neither separable nor of identity mass.
!>
!>    H = (p^2/2)(1 + c sin q) + p^4/20 - cos q,   H_1 = sigma p,   H_2 = -gamma q
!>
!> Built-in models with additive noise are quadratic, or have noise in p alone.
module additive_model
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: model_traits
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: additive_type, new_additive

   type, extends(model_type) :: additive_type
      real(wp) :: c = 0.4_wp
      real(wp) :: sigma = 0.5_wp, gamma = 0.7_wp
   contains
      procedure :: value => weighted_value
      procedure :: gradient
      procedure :: hessian
   end type additive_type

contains

   subroutine new_additive(self)
      type(additive_type), intent(out) :: self

      self%name = 'additive'
      self%traits = model_traits(ndof=1, nnoise=2, additive=.true., has_value=.true., has_hessian=.true.)
   end subroutine new_additive

   subroutine weighted_value(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(additive_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)

      value = w(:, 0)*(0.5_wp*p(:, 1)**2*(1 + self%c*sin(q(:, 1))) + p(:, 1)**4/20 - cos(q(:, 1))) &
              + self%sigma*w(:, 1)*p(:, 1) - self%gamma*w(:, 2)*q(:, 1)
   end subroutine weighted_value

   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(additive_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)

      if (present(hq)) hq(:, 1) = w(:, 0)*(0.5_wp*self%c*p(:, 1)**2*cos(q(:, 1)) + sin(q(:, 1))) &
                                  - self%gamma*w(:, 2)
      if (present(hp)) hp(:, 1) = w(:, 0)*(p(:, 1)*(1 + self%c*sin(q(:, 1))) + p(:, 1)**3/5) + self%sigma*w(:, 1)
   end subroutine gradient

   subroutine hessian(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      class(additive_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof)
      real(wp), intent(out), optional :: hpp(nlane, ndof, ndof)

      if (present(hqq)) hqq(:, 1, 1) = w(:, 0)*(cos(q(:, 1)) - 0.5_wp*self%c*p(:, 1)**2*sin(q(:, 1)))
      if (present(hqp)) hqp(:, 1, 1) = w(:, 0)*self%c*p(:, 1)*cos(q(:, 1))
      if (present(hpp)) hpp(:, 1, 1) = w(:, 0)*(1 + self%c*sin(q(:, 1)) + 0.6_wp*p(:, 1)**2)
   end subroutine hessian

end module additive_model
