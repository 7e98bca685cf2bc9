! SPDX-License-Identifier: BSD-3-Clause
!> The end of a fixed-point iteration x <- g(x) of a single path (fixed_point.inc), and its updates of x.
!>
!> The largest change is found in one pass if there are few numbers. If there are many, nbeside independent chains of
!> comparisons run side by side, and their results are compared at the end. The largest of a set does not depend on the
!> order, so the bits are those of a block. Several sweeps may be done before they are judged (judge_ahead).
module symsde_solve_fixed_point_single_path
   use symsde_base_kinds, only: wp, i8
   implicit none
   private
   public :: take_first, take, take_alone, judge_sweep, judge_ahead, sweep_verdict
   public :: most_sweeps, stiff_rate, done, left

   integer, parameter :: nbeside = 8  !! numbers that are compared side by side

   include 'fixed_point.inc'
   include 'one_lane.inc'

   !> x = sign*f with sign = 1 or -1, n numbers. Raise change and extent to the largest change and unknown; change
   !> becomes NaN if some f is not finite. `last` is not read, since callers update running paths alone.
   pure subroutine take(nlane, n, sign, f, last, x, change, extent)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: sign, f(n), last(1)
      real(wp), intent(inout) :: x(n), change(1), extent(1)
      real(wp) :: d, zero, moved, largest
      integer :: beside, i

      ! Whole groups first, then the rest.
      beside = n - modulo(n, nbeside)
      ! Scalars in registers; the arrays of one number are written at the end.
      moved = change(1)
      largest = extent(1)
      ! If the change so far is not finite, `zero` is NaN from the beginning.
      zero = 0*moved
      if (beside > 0) call take_beside(beside, sign, f, x, moved, largest, zero)
      ! Fewer numbers than a vector holds.
      !GCC$ novector
      do i = beside + 1, n
         d = abs(sign*f(i) - x(i))
         x(i) = sign*f(i)
         moved = max(moved, d)
         largest = max(largest, abs(f(i)))
         zero = zero + 0*d
      end do
      change(1) = moved + zero  ! zero is NaN if any change was not finite
      extent(1) = largest
   end subroutine take

   !> x = sign*f of the first sweep, which has no x before it: as if from x = 0.
   pure subroutine take_first(nlane, n, sign, f, x, change)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: sign, f(n)
      real(wp), intent(out) :: x(n)
      real(wp), intent(inout) :: change(1)
      real(wp) :: extent(1)

      x = 0
      extent = 0
      call take(nlane, n, sign, f, [0.0_wp], x, change, extent)
   end subroutine take_first

   !> `take` for nbeside numbers at a time, each place with a maximum of its own: a single maximum would be a chain in
   !> which each number waits for the one before.
   pure subroutine take_beside(n, sign, f, x, change, extent, zero)
      integer, intent(in) :: n   !! a multiple of nbeside
      real(wp), intent(in) :: sign, f(n)
      real(wp), intent(inout) :: x(n), change, extent, zero
      real(wp), dimension(nbeside) :: moved, largest, nothing
      real(wp) :: d
      integer :: before, i

      ! Clear the maxima of the eight chains.
      moved = 0
      largest = 0
      nothing = 0
      !GCC$ novector
      do before = 0, n - nbeside, nbeside
         !GCC$ unroll 1  ! vectors before all
         do i = 1, nbeside
            d = abs(sign*f(before + i) - x(before + i))
            x(before + i) = sign*f(before + i)
            moved(i) = max(moved(i), d)
            largest(i) = max(largest(i), abs(f(before + i)))
            nothing(i) = nothing(i) + 0*d
         end do
      end do
      ! Combine the eight maxima by halves: in a chain each comparison would wait for the comparison before.
      moved(:4) = max(moved(:4), moved(5:))
      largest(:4) = max(largest(:4), largest(5:))
      nothing(:4) = nothing(:4) + nothing(5:)
      moved(:2) = max(moved(:2), moved(3:4))
      largest(:2) = max(largest(:2), largest(3:4))
      change = max(change, max(moved(1), moved(2)))
      extent = max(extent, max(largest(1), largest(2)))
      zero = zero + ((nothing(1) + nothing(2)) + (nothing(3) + nothing(4)))
   end subroutine take_beside

   !> Set x = -f for a few numbers; in the first sweep the old x is zero. A caller whose path is in scalars needs no
   !> arrays of one lane.
   pure subroutine take_alone(n, first, f, x, change, extent)
      integer, intent(in) :: n
      logical, intent(in) :: first   !! first sweep: no x before it
      real(wp), intent(in) :: f(n)
      real(wp), intent(inout) :: x(n), change, extent
      real(wp) :: d(1), e(1)

      ! A first sweep starts from zero, so that its change is |x|.
      if (first) x = 0
      d = change
      e = extent
      call take(1, n, -1.0_wp, f, [0.0_wp], x, d, e)
      change = d(1)
      extent = e(1)
   end subroutine take_alone

   !> Judge sweeps first .. final, which were done before judging: find the sweep that ends the iteration, and how it
   !> ends. Later sweeps are ignored.
   pure subroutine judge_ahead(first, final, too_slow, too_stiff, most, change, extent, last, sweep)
      integer, intent(in) :: first, final, most
      real(wp), intent(in) :: too_slow, too_stiff, change(most), extent(most)
      real(wp), intent(inout) :: last !! in: change of the sweep before `first`; out: last change, or how it ends
      integer, intent(out) :: sweep           !! final + 1 if no sweep ends the iteration

      ! Three comparisons pass most sweeps, which neither end the iteration nor are too slow; `verdict` judges the
      ! rest.
      do sweep = first, final
         associate (d => change(sweep))
            if (d < last .and. d <= too_slow*last .and. d*d > rounding*extent(sweep)*last) then
               last = d
               cycle
            end if
         end associate
         ! `last` is the change of the sweep before.
         last = verdict(sweep, too_slow, too_stiff, change(sweep), extent(sweep), last)
         ! Done, left or given up in this sweep.
         if (last < 0) return
      end do
   end subroutine judge_ahead

   !> `verdict` of fixed_point.inc for other modules, as a separate procedure: the loop above inlines its own.
   pure real(wp) function sweep_verdict(sweep, too_slow, too_stiff, d, extent, last)
      integer, intent(in) :: sweep
      real(wp), intent(in) :: too_slow, too_stiff, d, extent, last

      sweep_verdict = verdict(sweep, too_slow, too_stiff, d, extent, last)
   end function sweep_verdict

end module symsde_solve_fixed_point_single_path
