! SPDX-License-Identifier: BSD-3-Clause
!> When a fixed-point iteration x <- g(x) has ended in a lane (fixed_point.inc), and the passes over the lanes of a
!> block that take x and test.
!>
!> The new x is sign*f of what the caller has computed at the old one, as an equation x + f(x) = 0 gives it with sign
!> = -1. A sweep clears change and extent (nlane), takes the parts of x one after the other, each of which raises
!> both, and judges at the end.
module symsde_solve_fixed_point
   use symsde_base_kinds, only: wp, i8
   implicit none
   private
   public :: take_first, take, judge_sweep
   public :: most_sweeps, stiff_rate, done, left

   include 'fixed_point.inc'
   include 'all_lanes.inc'

   !> VEC x = sign*f of the first sweep, before which x is not known: its change is x itself, which raises the change
   !> of other parts of x. Lanes that rest are written, too.
   pure subroutine take_first(nlane, n, sign, f, x, change)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: sign, f(nlane, n)
      real(wp), intent(out) :: x(nlane, n)
      real(wp), intent(inout) :: change(nlane)
      integer :: i, lane

      do i = 1, n
         do lane = 1, nlane
            x(lane, i) = sign*f(lane, i)
            change(lane) = max(change(lane), abs(f(lane, i))) + 0*(change(lane) + f(lane, i))  ! NaN stays
         end do
      end do
   end subroutine take_first

   !> VEC x = sign*f in running lanes. Raise change and extent to the largest change and unknown. A change is NaN or
   !> infinite where f is: 0*(..) keeps a NaN, which max would drop.
   pure subroutine take(nlane, n, sign, f, last, x, change, extent)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: sign, f(nlane, n), last(nlane)
      real(wp), intent(inout) :: x(nlane, n), change(nlane), extent(nlane)
      real(wp) :: d
      integer :: i, lane

      do i = 1, n
         do lane = 1, nlane
            ! Lanes that rest have their change computed along; nobody judges it.
            d = abs(sign*f(lane, i) - x(lane, i))
            x(lane, i) = merge(sign*f(lane, i), x(lane, i), last(lane) >= 0)
            change(lane) = max(change(lane), d) + 0*(change(lane) + d)
            extent(lane) = max(extent(lane), abs(x(lane, i)))
         end do
      end do
   end subroutine take

end module symsde_solve_fixed_point
