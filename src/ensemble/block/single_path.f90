! SPDX-License-Identifier: BSD-3-Clause
!> The stepper of a single path: one lane, without padding. Whether paths run one by one depends on their number and on
!> the stepper, which knows up to how many paths it beats a block. So the stepper is made first and then asked.
module symsde_ensemble_block_single_path
   use symsde_base_kinds, only: i8
   use symsde_base_lanes, only: lane_unit
   use symsde_base_status, only: error_type
   use symsde_model_abstract, only: model_type
   use symsde_step_factory, only: make_stepper
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: new_single_path

contains

   !> Make a stepper as the factory does for one lane. It is not allocated if blocks are faster for npath paths.
   subroutine new_single_path(stepper, task, model, npath, error)
      class(stepper_type), allocatable, intent(out) :: stepper
      type(stepper_task), intent(in) :: task
      class(model_type), intent(in), target :: model   !! the task's model, or a view of it
      integer(i8), intent(in) :: npath
      type(error_type), allocatable, intent(inout) :: error
      integer :: most

      call make_stepper(stepper, task, model, 1, error)
      if (allocated(error)) return
      ! The only lane is a real path.
      stepper%ham%nreal = 1
      most = stepper%most_single
      ! A user's function takes whole blocks from half a vector on, unless it was derived from formulas: these have
      ! kernels for a single path.
      if (model%traits%any_lanes .and. .not. model%passed%is_kept()) most = min(most, lane_unit/2)
      if (npath > most) deallocate (stepper)
   end subroutine new_single_path

end module symsde_ensemble_block_single_path
