! SPDX-License-Identifier: BSD-3-Clause
!> The states after a step of the midpoint rule, from V = p_{n+1} - p_n, while lanes that went together are in cache:
!>
!>    q_{n+1} = q_n + h (p_n + V/2),   p_{n+1} = p_n + V
!>
!> They have the bits of states to which increments are added from memory, dq = h (p_n + V/2) rounded first. So this
!> file is compiled without contraction: no product is fused with the sum. Contracted sums would be as good, but a
!> run would have other bits where states are moved than where increments are asked for.
!>
!> Both procedures take lanes before+1 .. before+together of states of nlane lanes; V and status are those
!> of the strip alone.
!>
!> Private to its family.
module symsde_step_midpoint_update
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lane_unit
   use symsde_base_status, only: nonfinite
   implicit none
   private
   public :: find_bad_sums, add_in_place

contains

   !> Give a lane the status nonfinite where q + dq or p + dp is not finite, dp = V and dq = h (p + V/2). It is
   !> called only where the sizes of state and V leave room for an overflow, which is rare.
   pure subroutine find_bad_sums(nlane, n, before, together, h, q, p, v, status)
      integer, intent(in) :: nlane, n, before, together
      real(wp), intent(in) :: h, q(nlane, n), p(nlane, n), v(together, n)
      integer(i8), intent(inout) :: status(together)
      real(wp) :: x, y, zero(lane_unit)
      integer :: i, done, lane

      do done = 0, together - lane_unit, lane_unit
         zero = 0
         do i = 1, n
            !GCC$ unroll 8
            do lane = 1, lane_unit
               x = q(before + done + lane, i) + h*(p(before + done + lane, i) + 0.5_wp*v(done + lane, i))
               y = p(before + done + lane, i) + v(done + lane, i)
               zero(lane) = zero(lane) + (0*x + 0*y)  ! NaN where one is not finite
            end do
         end do
         do lane = 1, lane_unit
            if (.not. abs(zero(lane)) <= 0 .and. status(done + lane) == 0) status(done + lane) = nonfinite
         end do
      end do
   end subroutine find_bad_sums

   !> VEC q = q + h (p + V/2) and p = p + V in lanes without a status; the others keep their state.
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

end module symsde_step_midpoint_update
