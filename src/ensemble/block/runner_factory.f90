! SPDX-License-Identifier: BSD-3-Clause
!> How block runners of any width are made for a run. The task, the options and the requested functionals are the same
!> for all threads and are only read. Every thread has a runner of its own, and makes runners of narrower blocks when it
!> first needs them.
!>
!> A runner is made of four things: views of the model, one that knows its paths, if the model differs by path
!> (for_paths), and one that hides padding, if the model is a user's (real_lanes); a stepper for this width, which sees
!> the model through the views; the block's state and noise buffer (new_block_runner); and a rescue for its failed
!> lanes.
module symsde_ensemble_block_runner_factory
   use symsde_base_functionals, only: functional_set
   use symsde_base_lane_paths, only: lane_paths
   use symsde_base_status, only: error_type
   use symsde_ensemble_block_runner, only: block_runner, new_block_runner
   use symsde_ensemble_options, only: run_options
   use symsde_model_abstract, only: model_type
   use symsde_model_views_real_lanes, only: real_lanes_model, new_real_lanes, fits_real_lanes
   use symsde_scheme_scheme, only: frame_none
   use symsde_ensemble_block_single_path, only: new_single_path
   use symsde_step_factory, only: make_stepper
   use symsde_step_implicit_rescue, only: new_rescue
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: runner_factory

   !> The inputs of all runners of a run. step/factory resolves the task once.
   type :: runner_factory
      type(stepper_task) :: task        !! task of the steppers, for any number of lanes
      type(run_options) :: options
      type(functional_set) :: asked     !! functionals of the path, beside its increments
      logical :: narrows = .false.      !! whether there is memory for narrower blocks, too
   contains
      procedure :: new_runner
   end type runner_factory

contains

   !> A runner for blocks of nlane lanes: a stepper that sees the model without padding where that is possible, and a
   !> rescue for the paths that it cannot solve.
   subroutine new_runner(self, runner, nlane, has_padding, error, single)
      class(runner_factory), intent(in), target :: self   !! must live as long as the runner
      type(block_runner), intent(out) :: runner
      integer, intent(in) :: nlane
      logical, intent(in) :: has_padding        !! whether some block has padding
      type(error_type), allocatable, intent(inout) :: error
      class(stepper_type), allocatable, intent(inout), optional :: single  !! stepper of one lane, if allocated; moved
      class(stepper_type), allocatable :: stepper
      type(real_lanes_model), pointer :: view
      class(model_type), pointer :: by_path, seen
      type(lane_paths), pointer :: paths

      allocate (paths)
      call self%task%model%for_paths(paths, by_path)
      if (associated(by_path)) then
         call look_at_real_lanes(by_path, has_padding, view, seen)
      else
         deallocate (paths)
         call look_at_real_lanes(self%task%model, has_padding, view, seen)
         ! The driver makes a stepper of one lane to ask how many paths run one by one; if given, use it. It sees the
         ! model itself.
         if (present(single)) call move_alloc(single, stepper)
      end if
      if (nlane > 1) then
         call make_stepper(stepper, self%task, seen, nlane, error)
      else if (.not. allocated(stepper)) then
         call new_single_path(stepper, self%task, seen, self%options%npath, error)
      end if
      ! If the runner cannot be made, nobody owns the views.
      if (allocated(error)) then
         if (associated(view)) deallocate (view)
         if (associated(by_path)) deallocate (by_path, paths)
         return
      end if
      ! The stepper is moved into the runner, which owns it from here on.
      call new_block_runner(runner, self%options, nlane, stepper, self%asked)
      runner%real_lanes => view
      runner%by_path => by_path
      if (associated(by_path)) runner%paths => paths
      if (self%task%scheme%frame == frame_none) &  ! a frame's stepper rescues the steps inside it
         call new_rescue(runner%rescue, self%task, runner%stepper)
   end subroutine new_runner

   !> The model as a stepper sees it: padding is hidden from a user's functions that accept any number of lanes.
   !> Functions that need all lanes, and models of the library, get the padding.
   subroutine look_at_real_lanes(model, has_padding, view, seen)
      class(model_type), intent(in), target :: model
      logical, intent(in) :: has_padding
      type(real_lanes_model), pointer, intent(out) :: view  !! a view to be owned by the runner, or null
      class(model_type), pointer, intent(out) :: seen

      ! The model itself, unless a view is needed.
      nullify (view)
      seen => model
      ! Without padding the view has nothing to hide.
      if (.not. has_padding) return
      if (.not. fits_real_lanes(model)) return
      allocate (view)
      call new_real_lanes(view, model)
      seen => view
   end subroutine look_at_real_lanes

end module symsde_ensemble_block_runner_factory
