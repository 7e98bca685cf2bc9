! SPDX-License-Identifier: BSD-3-Clause
!> Derivatives of a Hamiltonian of an angle from its terms (angle_terms of model/abstract). Where there is but one term
!> in q they have the bits of those that a model gives.
module symsde_step_angle_derivatives
   use symsde_base_kinds, only: wp
   use symsde_model_abstract, only: angle_terms
   implicit none
   private
   public :: angle_derivatives

contains

   !> The first three in q, from sine and cosine of q.
   pure subroutine angle_derivatives(terms, q, sine, cosine, u1, u2, u3)
      type(angle_terms), intent(in) :: terms
      real(wp), intent(in) :: q, sine, cosine
      real(wp), intent(out) :: u1, u2, u3

      u1 = terms%a*sine + (terms%b*cosine + (terms%c*q + terms%d))
      u2 = terms%a*cosine + (terms%c - terms%b*sine)
      u3 = -(terms%a*sine + terms%b*cosine)
   end subroutine angle_derivatives

end module symsde_step_angle_derivatives
