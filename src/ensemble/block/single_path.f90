! SPDX-License-Identifier: BSD-3-Clause
!> A path by itself, taken by a scalar twin of its stepper, with the stepper of blocks for the steps that the twin
!> leaves.
!>
!> Twins do the usual case alone. A step that is not usual (stiff, not converging soon, not finite) is taken by a block
!> of eight lanes that all have this path, whose bits are the same. Every step is tried by the twin first, whatever the
!> steps before it were: nothing is carried from one to the next.
module symsde_ensemble_block_single_path
   use symsde_base_counters, only: counters_type, add_counters
   use symsde_base_functionals, only: functional_set
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lane_unit
   use symsde_base_record, only: step_record, steps_record, step_store, new_step_store
   use symsde_base_status, only: error_type, stopped
   use symsde_step_block_state, only: lane_state, passed_states
   use symsde_step_factory, only: make_stepper
   use symsde_step_scalar_path, only: scalar_path
   use symsde_step_stepper, only: stepper_type, stepper_task, advance_by_increments
   implicit none
   private
   public :: new_single_path

   type, extends(stepper_type) :: single_path_stepper
      private
      type(stepper_task) :: task
      class(scalar_path), allocatable :: twin
      class(stepper_type), allocatable :: block    !! made for the first step that the twin leaves
      type(step_store) :: store                    !! that step, for all lanes
      real(wp), allocatable, dimension(:, :) :: q, p, dq_block, dp_block   !! of it (lane_unit, ndof)
   contains
      procedure :: make
      procedure :: advance
      procedure :: increment
      procedure :: tally
   end type single_path_stepper

contains

   !> The stepper of one lane for a task: as the factory makes it, or around the twin that this one offers. Not
   !> allocated where a path by itself has no way that pays for npath of them.
   subroutine new_single_path(stepper, task, npath, error)
      class(stepper_type), allocatable, intent(out) :: stepper
      type(stepper_task), intent(in) :: task
      integer(i8), intent(in) :: npath
      type(error_type), allocatable, intent(inout) :: error
      class(scalar_path), allocatable :: twin
      type(single_path_stepper), allocatable :: made

      call make_stepper(stepper, task, task%model, 1, error)
      if (allocated(error)) return
      stepper%ham%nreal = 1
      call stepper%offer_scalar_path(twin)
      if (allocated(twin)) then
         allocate (made)
         made%name = stepper%name
         made%explicit = stepper%explicit
         made%one_solve = stepper%one_solve
         if (allocated(stepper%left_out)) made%left_out = stepper%left_out
         made%most_single = twin%most
         made%ham = stepper%ham
         made%task = task
         call twin%lead(task%model)
         call move_alloc(twin, made%twin)
         deallocate (stepper)
         call move_alloc(made, stepper)
      end if
      if (npath > stepper%most_single) deallocate (stepper)
   end subroutine new_single_path

   !> Nothing: new_single_path has made it.
   subroutine make(self, task)
      class(single_path_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task
   end subroutine make

   !> What steps have in common is prepared once for all.
   subroutine advance(self, steps, state, passed, ntaken, failed)
      class(single_path_stepper), intent(inout) :: self
      type(steps_record), intent(inout) :: steps
      type(lane_state), intent(inout) :: state
      type(passed_states), intent(inout) :: passed
      integer, intent(out) :: ntaken
      logical, intent(out) :: failed

      self%twin%now = 0
      call self%twin%foresee(steps)
      call advance_by_increments(self, steps, state, passed, ntaken, failed)
   end subroutine advance

   !> One step by the twin, or by the block.
   subroutine increment(self, step, q, p, dq, dp, status)
      class(single_path_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      type(counters_type) :: before
      logical :: taken

      self%twin%now = self%twin%now + 1
      if (self%twin%wants_record) self%twin%step = step
      if (.not. self%twin%takes_all) before = self%twin%counters
      call self%twin%take(step%t, step%h, step%w, q, p, dq, dp, taken)
      if (taken) return
      self%twin%counters = before
      call step_of_block(self, step, q, p, dq, dp, status(1))
   end subroutine increment

   !> One step by a block of eight lanes, which all have this path; the first one is real.
   subroutine step_of_block(self, step, q, p, dq, dp, status)
      type(single_path_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%ndof), p(self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%ndof), dp(self%ham%ndof)
      integer(i8), intent(inout) :: status
      type(step_record) :: alike
      integer(i8) :: statuses(lane_unit)
      integer :: f

      if (.not. allocated(self%block)) call make_block(self, step)
      associate (n => self%ham%ndof, store => self%store)
         store%h = step%h
         store%w(:, :, 0) = spread(step%w(1, :), 1, lane_unit)
         do f = 1, size(step%of)
            if (associated(step%of(f)%x)) store%of(f)%x(:, :, 0) = spread(step%of(f)%x(1, :), 1, lane_unit)
         end do
         call store%show(0, step%t, alike)
         self%q = spread(q, 1, lane_unit)
         self%p = spread(p, 1, lane_unit)
         statuses = stopped
         statuses(1) = status
         call self%block%increment(alike, self%q, self%p, self%dq_block, self%dp_block, statuses)
         dq = self%dq_block(1, :)
         dp = self%dp_block(1, :)
         status = statuses(1)
      end associate
   end subroutine step_of_block

   subroutine make_block(self, step)
      type(single_path_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      type(functional_set) :: asked
      type(error_type), allocatable :: error
      integer :: f

      call make_stepper(self%block, self%task, self%task%model, lane_unit, error)  ! it was made for one lane before
      self%block%ham%nreal = 1
      do f = 1, size(step%of)
         asked%has(f) = associated(step%of(f)%x)
      end do
      call new_step_store(self%store, lane_unit, self%ham%nnoise, 2, step%h, asked)
      associate (n => self%ham%ndof)
         allocate (self%dq_block(lane_unit, n), self%dp_block(lane_unit, n))
      end associate
   end subroutine make_block

   !> What the twin and the block counted.
   subroutine tally(self, total)
      class(single_path_stepper), intent(in) :: self
      type(counters_type), intent(inout) :: total

      call add_counters(total, self%twin%counters)
      if (allocated(self%block)) call self%block%tally(total)
   end subroutine tally

end module symsde_ensemble_block_single_path
