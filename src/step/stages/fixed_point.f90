! SPDX-License-Identifier: BSD-3-Clause
!> Mild steps: the slopes of a group of stages by fixed-point iteration, without any matrix.
!>
!> A sweep goes from stage to stage and uses every new slope at once. Where the momenta are eliminated it
!> contracts errors by about (h omega)^2 times a diagonal entry of B (gauss2: 1/24), so that a few sweeps do.
!> In the first one a slope that is not known yet is replaced by the last one that is.
!>
!> With d_k the largest change of a slope in sweep k, |G| the largest slope, and r = max(d_k/d_{k-1}, 2^-13)
!> the contraction, a lane is
!>
!>    done       where the next change would vanish, d_k r <= eps |G|/4, or d_k is not smaller than d_{k-1} and
!>               within 2^-33 |G|, rounding
!>    left       where d_k/d_{k-1} > too_slow and d_k > 2^-20 |G|: the caller has a faster way to go on with what it has
!>    given up   where d_k/d_{k-1} > too_stiff beyond rounding, or where something is not finite: the caller
!>               has another way
!>
!> by its own numbers alone.
module symsde_step_stages_fixed_point
   use symsde_base_kinds, only: wp, i8
   use symsde_step_stages_equations, only: stage_equations
   use symsde_step_stages_groups, only: stage_group
   implicit none
   private
   public :: iterate_group, solved, slow, stiff, untried, stiff_rate
   public :: take_first, take, judge_sweep, judge_ahead, sweep_verdict, most_sweeps, done  ! for others with this test

   real(wp), parameter :: stiff_rate = 0.2_wp  !! contraction from which Newton's iteration by matrices is cheaper
   integer, parameter :: most_sweeps = 160   !! enough for a contraction of 0.8 and rounding
   real(wp), parameter :: rounding = 0.25_wp*epsilon(1.0_wp)  !! of the next change, in units of the largest slope
   real(wp), parameter :: done = -1, left = -2, given_up = -3  !! values of `last` beside the size of the last change

   integer(i8), parameter :: solved = 0, slow = 1, stiff = 2  !! what becomes of a lane
   integer(i8), parameter :: untried = 3                       !! for callers that do not iterate

contains

   !> Iterate in lanes whose outcome is `solved`, until each is solved, or left with what it has (slow), or given up
   !> (stiff).
   subroutine iterate_group(self, group, too_slow, too_stiff, outcome)
      type(stage_equations), intent(inout) :: self
      type(stage_group), intent(in) :: group
      real(wp), intent(in) :: too_slow     !! contraction from which a lane is left to a faster iteration
      real(wp), intent(in) :: too_stiff    !! contraction from which a lane is given up, at most 0.8
      integer(i8), intent(inout) :: outcome(self%ham%nlane)
      integer :: nrunning, sweep, m

      associate (nlane => self%ham%nlane, counters => self%ham%counters, last => self%last, change => self%change, &
                 extent => self%extent)
         last = merge(0.0_wp, done, outcome == solved)
         nrunning = count(last >= 0)
         do sweep = 1, most_sweeps
            if (nrunning == 0) exit
            change = 0
            extent = 0
            do m = 1, group%nmember
               associate (i => group%stage(m), plan => self%plan)
                  if (sweep == 1) then
                     call self%place(i, plan%first_b(:, i), plan%first_a(:, i), plan%first_abar(:, i))
                  else
                     call self%place(i, plan%b(:, i), plan%a(:, i), plan%abar(:, i))
                  end if
               end associate
               call self%evaluate(group%stage(m))
               call take_slopes(self, group%stage(m), sweep == 1, last, change, extent)
            end do
            counters%iterations = counters%iterations + nrunning
            if (group%explicit) return
            call judge_sweep(nlane, sweep, too_slow, too_stiff, change, extent, last, nrunning)
         end do
         where (outcome == solved .and. abs(last - left) <= 0) outcome = slow
         where (outcome == solved .and. (last >= 0 .or. last < left)) outcome = stiff
      end associate
   end subroutine iterate_group

   !> The new slopes of stage i in running lanes.
   subroutine take_slopes(self, i, first, last, change, extent)
      type(stage_equations), intent(inout) :: self
      integer, intent(in) :: i
      logical, intent(in) :: first
      real(wp), intent(in) :: last(self%ham%nlane)
      real(wp), intent(inout), dimension(self%ham%nlane) :: change, extent

      associate (nlane => self%ham%nlane, n => self%ham%ndof)
         if (first) then
            call take_first(nlane, n, -1.0_wp, self%hq, self%g(:, :, i), change)
            if (.not. self%eliminated) call take_first(nlane, n, 1.0_wp, self%hp, self%c(:, :, i), change)
         else
            call take(nlane, n, -1.0_wp, self%hq, last, self%g(:, :, i), change, extent)
            if (.not. self%eliminated) &
               call take(nlane, n, 1.0_wp, self%hp, last, self%c(:, :, i), change, extent)
         end if
      end associate
   end subroutine take_slopes

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC slope = sign*f; the change of the first sweep is the slope.
   pure subroutine take_first(nlane, n, sign, f, slope, change)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: sign, f(nlane, n)
      real(wp), intent(out) :: slope(nlane, n)
      real(wp), intent(inout) :: change(nlane)
      integer :: i, lane

      do i = 1, n
         do lane = 1, nlane
            slope(lane, i) = sign*f(lane, i)
            change(lane) = max(change(lane), abs(f(lane, i))) + 0*(change(lane) + f(lane, i))  ! NaN stays
         end do
      end do
   end subroutine take_first

   !> VEC slope = sign*f in running lanes, with the largest change and slope; not finite where f is not.
   pure subroutine take(nlane, n, sign, f, last, slope, change, extent)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: sign, f(nlane, n), last(nlane)
      real(wp), intent(inout) :: slope(nlane, n), change(nlane), extent(nlane)
      real(wp) :: d
      integer :: i, lane

      do i = 1, n
         do lane = 1, nlane
            d = abs(sign*f(lane, i) - slope(lane, i))
            slope(lane, i) = merge(sign*f(lane, i), slope(lane, i), last(lane) >= 0)
            change(lane) = max(change(lane), d) + 0*(change(lane) + d)
            extent(lane) = max(extent(lane), abs(slope(lane, i)))
         end do
      end do
   end subroutine take

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
      real(wp), intent(in) :: d, extent   !! largest change and slope of this sweep
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

end module symsde_step_stages_fixed_point
