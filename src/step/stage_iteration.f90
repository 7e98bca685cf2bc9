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
!>    given up   where d_k/d_{k-1} > steepest beyond rounding, or where something is not finite: the caller
!>               has another way
!>
!> by its own numbers alone.
module symsde_step_stage_iteration
   use symsde_base_kinds, only: wp, i8
   use symsde_step_stage_equations, only: stage_equations
   use symsde_step_stage_plan, only: stage_group
   implicit none
   private
   public :: iterate_group

   real(wp), parameter :: steepest = 0.2_wp   !! contraction from which Newton's iteration is cheaper
   integer, parameter :: most_sweeps = 60     !! enough for 0.2 and rounding
   real(wp), parameter :: done = -1, given_up = -2   !! values of `last` beside the size of the last change

contains

   !> Iterate in lanes whose fate is 0, until each is done or, with fate 1, given up.
   subroutine iterate_group(self, group, fate)
      type(stage_equations), intent(inout) :: self
      type(stage_group), intent(in) :: group
      integer(i8), intent(inout) :: fate(self%ham%nlane)
      real(wp), dimension(self%ham%nlane) :: last, change, extent
      integer :: nrunning, sweep, m

      last = merge(0.0_wp, given_up, fate == 0)
      nrunning = count(last >= 0)
      associate (nlane => self%ham%nlane, counters => self%ham%counters)
         do sweep = 1, most_sweeps
            if (nrunning == 0) exit
            change = 0
            extent = 0
            do m = 1, group%nmember
               call place_stage(self, group, m, sweep == 1)
               call self%evaluate(group%stage(m))
               call take_slopes(self, group%stage(m), sweep == 1, last, change, extent)
            end do
            counters%iterations = counters%iterations + nrunning
            if (group%explicit) return
            call judge_sweep(nlane, sweep, change, extent, last, nrunning)
         end do
         fate = merge(1_i8, fate, fate == 0 .and. (last >= 0 .or. last < -1.5_wp))
      end associate
   end subroutine iterate_group

   !> The point of member m; in the first sweep with what is known.
   subroutine place_stage(self, group, m, first)
      type(stage_equations), intent(inout) :: self
      type(stage_group), intent(in) :: group
      integer, intent(in) :: m
      logical, intent(in) :: first
      real(wp), dimension(self%plan%nstage) :: b, a, abar

      associate (i => group%stage(m), plan => self%plan)
         b = plan%b(:, i)
         a = plan%a(:, i)
         abar = plan%abar(:, i)
         if (first) then
            call move_to_known(group%stage, m, b)
            call move_to_known(group%stage, m, a)
            call move_to_known(group%stage, m, abar)
         end if
         call self%place(i, b, a, abar)
      end associate
   end subroutine place_stage

   !> Add the coefficients of members m and later to the one of member m-1.
   pure subroutine move_to_known(stage, m, coefficient)
      integer, intent(in) :: stage(:), m
      real(wp), intent(inout) :: coefficient(:)
      integer :: k

      do k = m, size(stage)
         if (m > 1) coefficient(stage(m - 1)) = coefficient(stage(m - 1)) + coefficient(stage(k))
         coefficient(stage(k)) = 0
      end do
   end subroutine move_to_known

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
   pure subroutine judge_sweep(nlane, sweep, change, extent, last, nrunning)
      integer, intent(in) :: nlane, sweep
      real(wp), intent(in) :: change(nlane), extent(nlane)
      real(wp), intent(inout) :: last(nlane)
      integer, intent(out) :: nrunning
      real(wp), parameter :: slow = 2.0_wp**(-13), rounding = 0.25_wp*epsilon(1.0_wp), near = 2.0_wp**(-33)
      real(wp) :: d, next
      logical :: ends
      integer(i8) :: running
      integer :: lane

      running = 0
      do lane = 1, nlane
         d = change(lane)
         if (sweep == 1) then
            next = merge(d, done, d > 0)
         else
            ends = d*max(d/last(lane), slow) <= rounding*extent(lane)
            ends = ends .or. (d >= last(lane) .and. d <= near*extent(lane))
            next = merge(d, given_up, d <= max(steepest*last(lane), near*extent(lane)))
            next = merge(done, next, ends)
         end if
         next = merge(next, given_up, d <= huge(d))
         last(lane) = merge(next, last(lane), last(lane) >= 0)
         running = running + merge(1_i8, 0_i8, last(lane) >= 0)
      end do
      nrunning = int(running)
   end subroutine judge_sweep

end module symsde_step_stage_iteration
