! SPDX-License-Identifier: BSD-3-Clause
!> When a fixed-point iteration x <- g(x) has ended in a lane, and the passes over lanes that take x and test.
!>
!> With d_k the largest change of an unknown in sweep k, |x| the largest unknown, and r = max(d_k/d_{k-1}, 2^-13)
!> the contraction, a lane is
!>
!>    done       where the next change would vanish, d_k r <= eps |x|/4, or d_k is not smaller than d_{k-1} and
!>               within 2^-33 |x|, rounding
!>    left       where d_k/d_{k-1} > too_slow and d_k > 2^-20 |x|: the caller has a faster way to go on with what it has
!>    given up   where d_k/d_{k-1} > too_stiff beyond rounding, or where something is not finite: the caller
!>               has another way
!>
!> by its own numbers alone.
module symsde_solve_fixed_point
   use symsde_base_kinds, only: wp, i8
   implicit none
   private
   public :: take_first, take, take_alone, judge_sweep, judge_ahead, sweep_verdict
   public :: most_sweeps, stiff_rate, done, left

   real(wp), parameter :: stiff_rate = 0.2_wp  !! contraction from which Newton's iteration by matrices is cheaper
   integer, parameter :: most_sweeps = 160     !! enough for a contraction of 0.8 and rounding
   integer, parameter :: nbeside = 8           !! numbers of a path by itself that are compared side by side
   real(wp), parameter :: rounding = 0.25_wp*epsilon(1.0_wp)  !! of the next change, in units of the largest unknown
   real(wp), parameter :: done = -1, left = -2, given_up = -3  !! values of `last` beside the size of the last change

contains

   !> VEC x = sign*f; the change of the first sweep is x.
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

   !> VEC x = sign*f in running lanes, with the largest change and unknown; not finite where f is not.
   pure subroutine take(nlane, n, sign, f, last, x, change, extent)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: sign, f(nlane, n), last(nlane)
      real(wp), intent(inout) :: x(nlane, n), change(nlane), extent(nlane)
      real(wp) :: d
      integer :: i, lane

      do i = 1, n
         do lane = 1, nlane
            d = abs(sign*f(lane, i) - x(lane, i))
            x(lane, i) = merge(sign*f(lane, i), x(lane, i), last(lane) >= 0)
            change(lane) = max(change(lane), d) + 0*(change(lane) + d)
            extent(lane) = max(extent(lane), abs(x(lane, i)))
         end do
      end do
   end subroutine take

   !> x = -f of a path by itself, with the largest change and unknown beside those so far; the change is no number
   !> where one of f is not finite.
   pure subroutine take_alone(n, first, f, x, change, extent)
      integer, intent(in) :: n
      logical, intent(in) :: first   !! nothing was known
      real(wp), intent(in) :: f(n)
      real(wp), intent(inout) :: x(n), change, extent
      real(wp) :: d, zero
      integer :: beside, i

      beside = n - modulo(n, nbeside)
      if (first) x = 0
      zero = 0*change
      if (beside > 0) call take_beside(beside, f, x, change, extent, zero)
      !GCC$ novector  ! few numbers
      do i = beside + 1, n
         d = abs(f(i) + x(i))
         x(i) = -f(i)
         change = max(change, d)
         extent = max(extent, abs(f(i)))
         zero = zero + 0*d
      end do
      change = change + zero  ! NaN stays
   end subroutine take_alone

   !> The same of nbeside at a time, each of which has its own largest: one for all would wait for itself.
   pure subroutine take_beside(n, f, x, change, extent, zero)
      integer, intent(in) :: n   !! a multiple of nbeside
      real(wp), intent(in) :: f(n)
      real(wp), intent(inout) :: x(n), change, extent, zero
      real(wp), dimension(nbeside) :: moved, largest, nothing
      real(wp) :: d
      integer :: done, i

      moved = 0
      largest = 0
      nothing = 0
      !GCC$ novector
      do done = 0, n - nbeside, nbeside
         !GCC$ unroll 1  ! vectors before all
         do i = 1, nbeside
            d = abs(f(done + i) + x(done + i))
            x(done + i) = -f(done + i)
            moved(i) = max(moved(i), d)
            largest(i) = max(largest(i), abs(f(done + i)))
            nothing(i) = nothing(i) + 0*d
         end do
      end do
      !GCC$ novector
      do i = 1, nbeside
         change = max(change, moved(i))
         extent = max(extent, largest(i))
         zero = zero + nothing(i)
      end do
   end subroutine take_beside

   !> VEC Which lanes are done, and which are given up.
   pure subroutine judge_sweep(nlane, sweep, too_slow, too_stiff, change, extent, last, nrunning)
      integer, intent(in) :: nlane, sweep
      real(wp), intent(in) :: too_slow, too_stiff
      real(wp), intent(in) :: change(nlane), extent(nlane)
      real(wp), intent(inout) :: last(nlane)
      integer, intent(out) :: nrunning
      real(wp) :: next
      integer(i8) :: running
      integer :: lane

      running = 0
      do lane = 1, nlane
         next = verdict(sweep, too_slow, too_stiff, change(lane), extent(lane), last(lane))
         last(lane) = merge(next, last(lane), last(lane) >= 0)
         running = running + merge(1_i8, 0_i8, last(lane) >= 0)
      end do
      nrunning = int(running)
   end subroutine judge_sweep

   !> What becomes of a lane that was running: the size of its last change, or done, or left, or given up.
   pure real(wp) function verdict(sweep, too_slow, too_stiff, d, extent, last) result(next)
      integer, intent(in) :: sweep
      real(wp), intent(in) :: too_slow, too_stiff
      real(wp), intent(in) :: d, extent   !! largest change and unknown of this sweep
      real(wp), intent(in) :: last        !! change of the sweep before
      real(wp), parameter :: slow = 2.0_wp**(-13), near = 2.0_wp**(-33)
      real(wp), parameter :: far = 2.0_wp**(-20)
      logical :: ends

      if (sweep == 1) then
         next = merge(d, done, d > 0)
      else
         ends = d*d <= rounding*extent*last .and. d*slow <= rounding*extent  ! d r, without the division
         ends = ends .or. (d >= last .and. d <= near*extent)
         next = merge(d, left, d <= max(too_slow*last, far*extent))
         next = merge(next, given_up, d <= max(too_stiff*last, near*extent))
         next = merge(done, next, ends)
      end if
      next = merge(next, given_up, d <= huge(d))
   end function verdict

   !> The same for sweeps first .. final that a path by itself took ahead: which of them ends it, and how. What is
   !> behind that sweep is not looked at.
   pure subroutine judge_ahead(first, final, too_slow, too_stiff, most, change, extent, last, sweep)
      integer, intent(in) :: first, final, most
      real(wp), intent(in) :: too_slow, too_stiff, change(most), extent(most)
      real(wp), intent(inout) :: last         !! as of the sweep before the first one
      integer, intent(out) :: sweep           !! behind the final one where none ends it

      do sweep = first, final
         associate (d => change(sweep))
            if (d < last .and. d <= too_slow*last .and. d*d > rounding*extent(sweep)*last) then  ! most go on so
               last = d
               cycle
            end if
         end associate
         last = verdict(sweep, too_slow, too_stiff, change(sweep), extent(sweep), last)
         if (last < 0) return
      end do
   end subroutine judge_ahead

   !> The same for other modules: what they see is not inlined in the loop above.
   pure real(wp) function sweep_verdict(sweep, too_slow, too_stiff, d, extent, last)
      integer, intent(in) :: sweep
      real(wp), intent(in) :: too_slow, too_stiff, d, extent, last

      sweep_verdict = verdict(sweep, too_slow, too_stiff, d, extent, last)
   end function sweep_verdict

end module symsde_solve_fixed_point
