! SPDX-License-Identifier: BSD-3-Clause
!> The contracts of ensembles: between the procedures that users call and ensembles, between blocks
!> (ensemble/block/runner) and their callers and observers, and of the loop over blocks.
!>
!> Required: options were checked (ensemble/options); a block has 1 to nlane real paths, and padding repeats the last.
!> Promised to observers: the state of every lane without a status is finite, and lanes with a status are counted.
!> Promised at the end: each path has reached the last step, or has a status and a step in which it ended; all blocks
!> were run, and paths that ended early are counted once.
module symsde_ensemble_contract
   use symsde_base_contracts, only: require
   use symsde_base_kinds, only: i8
   use symsde_base_status, only: error_type
   use symsde_ensemble_options, only: run_options, check_options
   use symsde_step_block_state, only: lane_state
   use symsde_step_contract, only: require_state
   implicit none
   private
   public :: require_options, require_block, require_shown, require_finished, require_counts

contains

   !> Requirements when an ensemble is made or driven.
   subroutine require_options(options, place)
      type(run_options), intent(in) :: options
      character(*), intent(in) :: place
      type(error_type), allocatable :: refusal

      call check_options(options, refusal)
      call require(.not. allocated(refusal), place, 'options were checked where a user gave them')
   end subroutine require_options

   !> Requirements when a block begins.
   pure subroutine require_block(nlane, nreal, path, step)
      integer, intent(in) :: nlane, nreal
      integer(i8), intent(in) :: path(nlane), step
      character(*), parameter :: place = 'ensemble, begin'

      call require(nreal >= 1 .and. nreal <= nlane, place, 'real paths are 1 to nlane')
      call require(all(path(min(nreal, nlane):) == path(nreal)), place, 'padding repeats the last real path')
      call require(all(path >= 0) .and. step >= 0, place, 'paths and steps are counted from 0')
   end subroutine require_block

   !> Promises to an observer.
   subroutine require_shown(state)
      type(lane_state), intent(in) :: state
      character(*), parameter :: place = 'ensemble, observe'

      call require_state(state, place)
      call require(count(state%status /= 0) == state%nfailed, place, 'lanes with a status are counted')
   end subroutine require_shown

   !> Promises to callers when a block has ended, for its first nreal lanes.
   subroutine require_finished(state, nreal, step, last)
      type(lane_state), intent(in) :: state
      integer, intent(in) :: nreal
      integer(i8), intent(in) :: step, last   !! next step; the step at which the run ends
      character(*), parameter :: place = 'ensemble, finish'

      call require_state(state, place)
      call require(all(state%status(:nreal) /= 0) .or. step == last, place, &
                   'paths without a status are at the last step')
      call require(all(state%status(:nreal) == 0 .or. state%failed_step(:nreal) >= 0), place, &
                   'paths with a status have a step in which they ended')
      call require(all(state%status(nreal + 1:) /= 0), place, 'padding has a status')
   end subroutine require_finished

   !> Contract of a run that has ended: every block was taken once, and no path ended twice.
   pure subroutine require_counts(nblock, nfinished, npath, nended)
      integer(i8), intent(in) :: nblock, nfinished, npath
      integer(i8), intent(in) :: nended   !! paths that failed or were stopped
      character(*), parameter :: place = 'ensemble, run'

      call require(nfinished == nblock, place, 'every block is taken once')
      call require(nended >= 0 .and. nended <= npath, place, 'no path ends twice')
   end subroutine require_counts

end module symsde_ensemble_contract
