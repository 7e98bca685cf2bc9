! SPDX-License-Identifier: BSD-3-Clause
!> The states after a step of the midpoint rule, from V = p_{n+1} - p_n, while the lanes taken together are in cache:
!>
!>    q_{n+1} = q_n + h (p_n + V/2),   p_{n+1} = p_n + V
!>
!> Bits are the same as where increments are stored and then added to the states, with dq = h (p_n + V/2) rounded first.
!> Therefore this file is compiled without contraction: no product is fused with the sum. Contracted sums would be as
!> accurate, but a run that moves states would have other bits than one that uses increments.
!>
!> Arguments are lanes before+1 .. before+together of states of nlane lanes; V and status have the lanes of the strip
!> only.
!>
!> Private to its family.
module symsde_step_midpoint_update
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lane_unit
   implicit none
   private
   public :: add_in_place, add_decayed_in_place

contains

   !> VEC q = q + h (p + V/2) and p = p + V in lanes without a status; other lanes keep their state.
   pure subroutine add_in_place(nlane, n, before, together, h, v, status, q, p)
      integer, intent(in) :: nlane, n, before, together
      real(wp), intent(in) :: h, v(together, n)
      integer(i8), intent(in) :: status(together)
      real(wp), intent(inout) :: q(nlane, n), p(nlane, n)
      real(wp) :: x, y
      integer :: i, done, lane

      do i = 1, n
         do done = 0, together - lane_unit, lane_unit
            !GCC$ unroll 8
            do lane = done + 1, done + lane_unit
               x = q(before + lane, i) + h*(p(before + lane, i) + 0.5_wp*v(lane, i))
               y = p(before + lane, i) + v(lane, i)
               q(before + lane, i) = merge(x, q(before + lane, i), status(lane) == 0)
               p(before + lane, i) = merge(y, p(before + lane, i), status(lane) == 0)
            end do
         end do
      end do
   end subroutine add_in_place

   !> VEC The states of a damped model: q = q + h (begin p + V/2) and p = p + (finish V + loss p), with the factors of
   !> each degree of freedom.
   pure subroutine add_decayed_in_place(nlane, n, before, together, h, begin, loss, finish, v, status, q, p)
      integer, intent(in) :: nlane, n, before, together
      real(wp), intent(in) :: h, begin(1, n), loss(n), finish(1, n), v(together, n)
      integer(i8), intent(in) :: status(together)
      real(wp), intent(inout) :: q(nlane, n), p(nlane, n)
      real(wp) :: x, y
      integer :: i, done, lane

      do i = 1, n
         do done = 0, together - lane_unit, lane_unit
            !GCC$ unroll 8
            do lane = done + 1, done + lane_unit
               x = q(before + lane, i) + h*(begin(1, i)*p(before + lane, i) + 0.5_wp*v(lane, i))
               y = p(before + lane, i) + (finish(1, i)*v(lane, i) + loss(i)*p(before + lane, i))
               q(before + lane, i) = merge(x, q(before + lane, i), status(lane) == 0)
               p(before + lane, i) = merge(y, p(before + lane, i), status(lane) == 0)
            end do
         end do
      end do
   end subroutine add_decayed_in_place

end module symsde_step_midpoint_update
