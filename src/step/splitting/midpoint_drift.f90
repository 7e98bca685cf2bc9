! SPDX-License-Identifier: BSD-3-Clause
!> The flow of H between kicks by the implicit midpoint rule, which remains stable for large forces: from (x, y), over
!> the time tau from the time t on,
!>
!>    X = x + tau H_p(X_m, Y_m),   Y = y - tau H_q(X_m, Y_m),   (X_m, Y_m) = ((x + X)/2, (y + Y)/2)   at t + tau/2
!>
!> In a damped model y decays before this step and after it, each time over tau/2. The step is then one of the closed
!> system, and the flow approximates that of H with damping to the second order, as kicks need it.
!>
!> This is a midpoint step of the model, with h = tau and all dW_k = 0, by one of the steppers for such steps; lanes
!> that it cannot solve are rescued like those of any other step. The kicks then contain the noises only.
module symsde_step_splitting_midpoint_drift
   use symsde_base_counters, only: counters_type
   use symsde_base_damping, only: damping_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_status, only: error_type
   use symsde_scheme_catalogue, only: get_scheme
   use symsde_scheme_scheme, only: scheme_type
   use symsde_step_oracle_general, only: general_stepper
   use symsde_step_midpoint_eliminated, only: midpoint_stepper, midpoint_fits
   use symsde_step_midpoint_eliminated_single_path, only: midpoint_single_path => midpoint_stepper
   use symsde_step_midpoint_full, only: midpoint_full_stepper, midpoint_full_fits
   use symsde_step_midpoint_full_single_path, only: midpoint_full_single_path => midpoint_full_stepper
   use symsde_step_midpoint_one_dof, only: midpoint_one_dof_stepper, midpoint_one_dof_fits
   use symsde_step_midpoint_one_dof_single_path, only: midpoint_one_dof_single_path => midpoint_one_dof_stepper
   use symsde_step_implicit_rescue, only: rescue_type, new_rescue
   use symsde_step_splitting_drift, only: drift_flow, new_drift_flow
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: midpoint_flow, new_midpoint_flow

   !> The stepper of these midpoint steps, its rescue, its weights, and the state of the path between two kicks.
   type :: midpoint_flow
      private
      class(stepper_type), allocatable, public :: stepper  !! stepper of the midpoint steps
      type(scheme_type), allocatable :: midpoint
      type(rescue_type) :: rescue                          !! rescue of lanes in which the stepper fails
      type(drift_flow) :: around                           !! decays before and after the step of each leg
      real(wp), allocatable :: w(:, :)                     !! weights: tau for H, zero for noises (nlane, 0:nnoise)
      real(wp), allocatable, public, dimension(:, :) :: x, y, dx, dy  !! state before the step, increments (nlane, ndof)
      integer(i8), allocatable :: failed(:)                !! 1 if a lane had failed before, else -1 (nlane)
   contains
      procedure :: move
      procedure :: tally
   end type midpoint_flow

contains

   !> Make midpoint steps for the model and the lanes of a task with a scheme of kicks: the same task with the scheme
   !> midpoint and without damping. The first stepper that fits is chosen: with momenta eliminated, of one degree of
   !> freedom, of all unknown q and p, else the general one; each of the first three has an instance with one lane.
   subroutine new_midpoint_flow(self, whole)
      type(midpoint_flow), intent(out), target :: self
      type(stepper_task), intent(in) :: whole  !! the task with the scheme of kicks
      type(stepper_task) :: task
      type(error_type), allocatable :: error
      real(wp), allocatable :: half(:)   ! half of each part of a step between kicks

      task = whole
      task%damping = damping_type()
      if (whole%damping%acts()) then
         half = 0.5_wp*([whole%scheme%kicks%c, 1.0_wp] - [0.0_wp, whole%scheme%kicks%c])
         call new_drift_flow(self%around, size(half), whole%nlane, whole%model%traits%ndof, damping=whole%damping, &
                             part=half)
      end if
      allocate (self%midpoint)
      call get_scheme(self%midpoint, 'midpoint', error)
      task%scheme => self%midpoint
      ! A run with the general stepper also uses it for the midpoint steps.
      if (whole%general) then
         allocate (general_stepper :: self%stepper)
      else if (midpoint_fits(task)) then
         if (task%nlane == 1) allocate (midpoint_single_path :: self%stepper)
         if (task%nlane > 1) allocate (midpoint_stepper :: self%stepper)
      else if (midpoint_one_dof_fits(task)) then
         if (task%nlane == 1) allocate (midpoint_one_dof_single_path :: self%stepper)
         if (task%nlane > 1) allocate (midpoint_one_dof_stepper :: self%stepper)
      else if (midpoint_full_fits(task)) then
         if (task%nlane == 1) allocate (midpoint_full_single_path :: self%stepper)
         if (task%nlane > 1) allocate (midpoint_full_stepper :: self%stepper)
      else
         allocate (general_stepper :: self%stepper)
      end if
      call self%stepper%make(task)
      call new_rescue(self%rescue, task, self%stepper)
      associate (nlane => task%nlane, n => task%model%traits%ndof, m => task%model%traits%nnoise)
         allocate (self%w(nlane, 0:m), source=0.0_wp)
         allocate (self%x(nlane, n), self%y(nlane, n), self%dx(nlane, n), self%dy(nlane, n), self%failed(nlane))
      end associate
   end subroutine new_midpoint_flow

   !> Move (q + dq, p + dp) over the time tau from the time t on. Lanes that had a status before are not rescued;
   !> `failed` marks them.
   subroutine move(self, leg, t, h, tau, q, p, dq, dp, status)
      class(midpoint_flow), intent(inout), target :: self
      integer, intent(in) :: leg               !! number of the leg in the step of length h
      real(wp), intent(in) :: t, h, tau
      real(wp), intent(in), dimension(self%stepper%ham%nlane, self%stepper%ham%ndof) :: q, p
      real(wp), intent(inout), dimension(self%stepper%ham%nlane, self%stepper%ham%ndof) :: dq, dp
      integer(i8), intent(inout) :: status(self%stepper%ham%nlane)
      type(step_record) :: step

      if (allocated(self%around%friction)) call self%around%friction%look(self%stepper%ham, t, q)
      if (self%around%decays_at_kicks) &
         call self%around%decay_at(leg, h, size(q, 1), size(q, 2), p, dp)
      ! The weights of the noises keep their initial value zero, since noises act in the kicks.
      self%w(:, 0) = tau
      self%x = q + dq
      self%y = p + dp
      ! The rescue skips lanes in which `failed` >= 0.
      self%failed = merge(-1_i8, 1_i8, status == 0)
      ! An independent step of the model, whose middle is at t + tau/2.
      step%t = t
      step%h = tau
      step%w(1:, 0:) => self%w
      call self%stepper%increment(step, self%x, self%y, self%dx, self%dy, status)
      ! In lanes that fail now, dx and dy come from the rescue, if it succeeds.
      if (any(status /= 0 .and. self%failed < 0)) &
         call self%rescue%attempt(size(status), step, self%x, self%y, self%failed, self%dx, self%dy, status)
      dq = dq + self%dx
      dp = dp + self%dy
      if (self%around%decays_at_kicks) &
         call self%around%decay_at(leg, h, size(q, 1), size(q, 2), p, dp)
   end subroutine move

   !> Add the counts of the midpoint steps and their rescue.
   subroutine tally(self, total)
      class(midpoint_flow), intent(in) :: self
      type(counters_type), intent(inout) :: total

      call self%stepper%tally(total)
      call self%rescue%tally(total)
   end subroutine tally

end module symsde_step_splitting_midpoint_drift
