! SPDX-License-Identifier: BSD-3-Clause
!> Mild steps: the slopes of a group of stages by fixed-point iteration, without any matrix.
!>
!> A sweep goes from stage to stage and uses every new slope at once. Where the momenta are eliminated it
!> contracts errors by about (h omega)^2 times a diagonal entry of B (gauss2: 1/24), so that a few sweeps do.
!> In the first one a slope that is not known yet is replaced by the last one that is.
!> When a lane is done, left or given up is told by solve/fixed_point.
!>
!> Private to its family.
module symsde_step_stages_fixed_point
   use symsde_base_kinds, only: wp, i8
   use symsde_solve_fixed_point, only: take_first, take, judge_sweep, most_sweeps, done, left
   use symsde_step_stages_equations, only: stage_equations
   use symsde_step_stages_groups, only: stage_group
   implicit none
   private
   public :: iterate_group, solved, slow, stiff, untried

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

end module symsde_step_stages_fixed_point
