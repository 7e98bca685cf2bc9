! SPDX-License-Identifier: BSD-3-Clause
!> The contract of steppers, checked at the beginning and the end of `advance` (step/stepper).
!>
!> Required: the statuses of a block are codes of base/status and all are counted; the state is finite in lanes without
!> a status; steps have the lanes of the block and finite weights, padding repeats the weights of the last path, and
!> there are as many groups of steps as requested states. Padding has a status, so its state does not change. Promised:
!> the same, except that lanes which failed in the last step have a status that is not counted yet; if there are no such
!> lanes, all steps have been taken.
module symsde_step_contract
   use symsde_base_contracts, only: require, require_finite, require_finite_lanes, require_padded, require_statuses
   use symsde_base_record, only: steps_record
   use symsde_step_block_state, only: lane_state, passed_states
   implicit none
   private
   public :: require_steps, require_taken, require_state

contains

   !> Check the requirements of `advance`.
   subroutine require_steps(steps, state)
      type(steps_record), intent(in) :: steps
      type(lane_state), intent(in) :: state
      character(*), parameter :: place = 'step, advance'

      call require_state(state, place)
      call require(count(state%status /= 0) == state%nfailed, place, 'lanes with a status are counted')
      call require(steps%nlane == state%nlane .and. steps%nreal >= 1 .and. steps%nreal <= steps%nlane, place, &
                   'steps have the lanes of the block, of which some are real')
      call require(steps%every >= 1 .and. steps%nstep >= steps%every .and. mod(steps%nstep, steps%every) == 0, place, &
                   'steps come in groups of equal length')
      call require(all(shape(steps%w) == [steps%nlane, steps%nnoise + 1, steps%nstep]), place, &
                   'weights have a row for each lane, and columns for h and noises in each step')
      call require_finite(size(steps%w), steps%w, place, 'weights')
      call require_padded(steps%nlane, steps%nreal, size(steps%w, 2)*size(steps%w, 3), steps%w, place, 'weights')
   end subroutine require_steps

   !> Check the promises of `advance`.
   subroutine require_taken(steps, state, passed, ntaken, failed)
      type(steps_record), intent(in) :: steps
      type(lane_state), intent(in) :: state
      type(passed_states), intent(in) :: passed
      integer, intent(in) :: ntaken
      logical, intent(in) :: failed
      character(*), parameter :: place = 'step, advance'

      call require_state(state, place)
      call require(failed .eqv. count(state%status /= 0) > state%nfailed, place, &
                   'a failed step has lanes that were not counted, and no other step has')
      call require(ntaken >= 1 .and. ntaken <= steps%nstep .and. (failed .or. ntaken == steps%nstep), place, &
                   'all steps are taken, or those up to the one that failed')
      call require(passed%n >= 0 .and. passed%n <= ntaken/steps%every, place, &
                   'states on the way are those that were reached')
   end subroutine require_taken

   !> Check the conditions on a block between steps.
   subroutine require_state(state, place)
      type(lane_state), intent(in) :: state
      character(*), intent(in) :: place   !! source area and procedure

      call require_statuses(state%nlane, state%status, place)
      call require(all(state%status /= 0 .or. state%failed_step < 0), place, &
                   'a lane without a status has no failed step')
      call require_finite_lanes(state%nlane, state%ndof, state%status, state%q, place, 'positions')
      call require_finite_lanes(state%nlane, state%ndof, state%status, state%p, place, 'momenta')
   end subroutine require_state

end module symsde_step_contract
