! SPDX-License-Identifier: BSD-3-Clause
!> A stiff spring, a soft spring, and a noise on each momentum; the map of a step is linear.
!>
!>    H = (p.p + omega^2 q_1^2 + (q_2 - q_1)^2)/2,   H_k = -sigma q_k        E H = H_0 + sigma^2 t
module stiff_model
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: model_traits
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: stiff_type, new_stiff

   type, extends(model_type) :: stiff_type
      real(wp) :: omega = 0
      real(wp) :: sigma = 0.5_wp
   contains
      procedure :: value => weighted_value
      procedure :: gradient
   end type stiff_type

contains

   subroutine new_stiff(self, omega)
      type(stiff_type), intent(out) :: self
      real(wp), intent(in) :: omega

      self%name = 'stiff'
      self%omega = omega
      self%traits = model_traits(ndof=2, nnoise=2, separable=.true., additive=.true., position_noise=.true., &
                                 quadratic=.true., identity_mass=.true., has_value=.true., rotation=[omega, 0.0_wp])
   end subroutine new_stiff

   subroutine weighted_value(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(stiff_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)

      value = w(:, 0)*(p(:, 1)**2 + p(:, 2)**2 + (self%omega*q(:, 1))**2 + (q(:, 2) - q(:, 1))**2)/2 &
              - self%sigma*(w(:, 1)*q(:, 1) + w(:, 2)*q(:, 2))
   end subroutine weighted_value

   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(stiff_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      integer :: i

      if (present(hq)) then
         hq(:, 1) = w(:, 0)*(self%omega**2*q(:, 1) + q(:, 1) - q(:, 2)) - self%sigma*w(:, 1)
         hq(:, 2) = w(:, 0)*(q(:, 2) - q(:, 1)) - self%sigma*w(:, 2)
      end if
      if (present(hp)) then
         do i = 1, 2
            hp(:, i) = w(:, 0)*p(:, i)
         end do
      end if
   end subroutine gradient

end module stiff_model
