! SPDX-License-Identifier: BSD-3-Clause
!> Force and slope of a single path whose Hamiltonian is that of an angle, from its terms:
!>
!>    Hhat_q = a sin q + (b cos q + (c q + d)),   Hhat_qq = a cos q + (c - b sin q),   Hhat_p = e p,   Hhat_pp = e
!>
!> with `terms` = (a, b, c, d, e), which depend on h, t and dW but not on (q, p): a step evaluates them once, and every
!> iteration takes one sine and one cosine.
!>
!> This is a separate module because the compiler would otherwise contract these products with sums of the callers, and
!> a single path would have other bits than a path of a block, whose numbers come from memory.
module symsde_step_midpoint_angle
   use symsde_base_kinds, only: wp
   use symsde_base_sincos, only: sincos_one
   use symsde_model_kernels, only: angle_terms
   implicit none
   private
   public :: find_angle_force, find_angle_velocity, find_angle_point

contains

   !> Hhat_q and Hhat_qq at the angle q.
   subroutine find_angle_force(terms, q, hq, hqq)
      type(angle_terms), intent(in) :: terms
      real(wp), intent(in) :: q
      real(wp), intent(out) :: hq, hqq
      real(wp) :: sine, cosine

      sine = sincos_one(q, cosine)
      hq = terms%a*sine + (terms%b*cosine + (terms%c*q + terms%d))
      hqq = terms%a*cosine + (terms%c - terms%b*sine)
   end subroutine find_angle_force

   !> Hhat_p and Hhat_pp at the momentum p.
   pure subroutine find_angle_velocity(terms, p, hp, hpp)
      type(angle_terms), intent(in) :: terms
      real(wp), intent(in) :: p
      real(wp), intent(out) :: hp, hpp

      hp = terms%e*p
      hpp = terms%e
   end subroutine find_angle_velocity

   !> All four functions at the point (q, p), by one call.
   subroutine find_angle_point(terms, q, p, hq, hp, hqq, hpp)
      type(angle_terms), intent(in) :: terms
      real(wp), intent(in) :: q, p
      real(wp), intent(out) :: hq, hp, hqq, hpp

      call find_angle_force(terms, q, hq, hqq)
      call find_angle_velocity(terms, p, hp, hpp)
   end subroutine find_angle_point

end module symsde_step_midpoint_angle
