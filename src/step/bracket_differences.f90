! SPDX-License-Identifier: BSD-3-Clause
!> The passes over lanes that put the differences of the nested bracket together (step/single_brackets).
module symsde_step_bracket_differences
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: add_second_difference, add_differences, add_transposed

contains

   !> VEC Additive noise: c [H(x+bv) + H(x-bv) - 2H(x)], whose gradients are the columns 1 and 2 of (gq, gp), and
   !> (eq, ep).
   pure subroutine add_second_difference(nlane, c, eq, ep, gq, gp, hq, hp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: c, eq(nlane), ep(nlane), gq(nlane, 6), gp(nlane, 6)
      real(wp), intent(inout), dimension(nlane) :: hq, hp
      integer :: lane

      do lane = 1, nlane
         hq(lane) = hq(lane) + c*((gq(lane, 1) + gq(lane, 2)) - 2*eq(lane))
         hp(lane) = hp(lane) + c*((gp(lane, 1) + gp(lane, 2)) - 2*ep(lane))
      end do
   end subroutine add_second_difference

   !> VEC The same, and what the points share by the fields: that of H_k, by its Hessian (qq, qp, pp), and that of H, to
   !> which (yq, yp) is added; with c2 times the mixed difference of H_k at x -+ a u - b v and x -+ a u + b v, whose
   !> gradients are the columns 3 and 4, 5 and 6.
   pure subroutine add_differences(nlane, a, b, c, c2, eq, ep, gq, gp, qq, qp, pp, hq, hp, yq, yp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: a, b, c, c2, eq(nlane), ep(nlane), gq(nlane, 6), gp(nlane, 6)
      real(wp), intent(in), dimension(nlane) :: qq, qp, pp
      real(wp), intent(inout), dimension(nlane) :: hq, hp, yq, yp
      real(wp) :: rq, rp, before, behind
      integer :: lane

      do lane = 1, nlane
         before = gq(lane, 4) - gq(lane, 3)
         behind = gq(lane, 6) - gq(lane, 5)
         rq = b*(c*(gq(lane, 2) - gq(lane, 1)) - c2*(before + behind))
         hq(lane) = hq(lane) + (c*((gq(lane, 1) + gq(lane, 2)) - 2*eq(lane)) - c2*(behind - before))
         yq(lane) = yq(lane) - a*c2*((gq(lane, 5) - gq(lane, 3)) + (gq(lane, 6) - gq(lane, 4)))
         before = gp(lane, 4) - gp(lane, 3)
         behind = gp(lane, 6) - gp(lane, 5)
         rp = b*(c*(gp(lane, 2) - gp(lane, 1)) - c2*(before + behind))
         hp(lane) = hp(lane) + (c*((gp(lane, 1) + gp(lane, 2)) - 2*ep(lane)) - c2*(behind - before))
         yp(lane) = yp(lane) - a*c2*((gp(lane, 5) - gp(lane, 3)) + (gp(lane, 6) - gp(lane, 4)))
         hq(lane) = hq(lane) + (qp(lane)*rq - qq(lane)*rp)
         hp(lane) = hp(lane) + (pp(lane)*rq - qp(lane)*rp)
      end do
   end subroutine add_differences

   !> VEC Add (D field)^T r = Hessian (-r_p, r_q).
   pure subroutine add_transposed(nlane, qq, qp, pp, rq, rp, hq, hp)
      integer, intent(in) :: nlane
      real(wp), intent(in), dimension(nlane) :: qq, qp, pp, rq, rp
      real(wp), intent(inout), dimension(nlane) :: hq, hp
      integer :: lane

      do lane = 1, nlane
         hq(lane) = hq(lane) + (qp(lane)*rq(lane) - qq(lane)*rp(lane))
         hp(lane) = hp(lane) + (pp(lane)*rq(lane) - qp(lane)*rp(lane))
      end do
   end subroutine add_transposed

end module symsde_step_bracket_differences
