! SPDX-License-Identifier: BSD-3-Clause
!> The end of a fixed-point iteration x <- g(x) in a lane (fixed_point.inc), and passes over the lanes of a block that
!> update x and test it.
!>
!> The new x is sign*f, with f computed by the caller at the old x; sign = -1 for an equation x + f(x) = 0. A sweep
!> clears change and extent (nlane), then updates x part by part, each of which raises change and extent, and calls
!> judge_sweep at the end.
module symsde_solve_fixed_point
   use symsde_base_kinds, only: wp, i8
   implicit none
   private
   public :: take_first, take, judge_sweep
   public :: most_sweeps, stiff_rate, done, left

   include 'fixed_point.inc'
   include 'all_lanes.inc'

   !> VEC x = sign*f in the first sweep, which has no earlier x: the change is x itself, and is raised to the largest
   !> over all parts of x. Lanes that are done are written, too.
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
   !> infinite if f is: 0*(..) keeps a NaN, which max would drop.
   pure subroutine take(nlane, n, sign, f, last, x, change, extent)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: sign, f(nlane, n), last(nlane)
      real(wp), intent(inout) :: x(nlane, n), change(nlane), extent(nlane)
      real(wp) :: d
      integer :: i, lane

      do i = 1, n
         do lane = 1, nlane
            ! Lanes that are done get a change, too, which is ignored.
            d = abs(sign*f(lane, i) - x(lane, i))
            x(lane, i) = merge(sign*f(lane, i), x(lane, i), last(lane) >= 0)
            change(lane) = max(change(lane), d) + 0*(change(lane) + d)
            extent(lane) = max(extent(lane), abs(x(lane, i)))
         end do
      end do
   end subroutine take

end module symsde_solve_fixed_point
