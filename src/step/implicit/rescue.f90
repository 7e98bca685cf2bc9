! SPDX-License-Identifier: BSD-3-Clause
!> The rescue of a path whose implicit equations Newton's iteration could not solve from zero increments.
!>
!> The attempts, the same for every scheme in tableau form, bounded and counted:
!>
!>    1. Newton from zero increments        the stepper itself
!>    2. Newton, shortened corrections      here, on the general stepper's equations
!>    3. continuation in the increments     (h, dW) scaled by k/16, k = 1..16, each from the last solution
!>    4. the path fails, with the status of rung 1
!>
!> The step is never divided, since that would be another scheme and another noise. The general stepper solves the same
!> equations as every special stepper, so a root that it finds is a root of the scheme's equations.
!>
!> A correction is shortened until the residual decreases (solve/shortening). Continuation solves the
!> equations of the weights (k/16) (h, dW), at the nodes of the whole step. Newton begins from zero for k = 1, where
!> the slopes are small; each solution times k/(k-1) is the next starting point, since slopes are roughly proportional
!> to the weights. Only the equations of k = 16 are those of the step and determine its result.
!>
!> Failed lanes are gathered into small blocks of eight, since they are few and the general stepper has a dense matrix
!> for each lane. For the same reason systems of more than max_unknowns are not rescued. Nor are schemes that add
!> brackets, whose increments of brackets are not scaled by a fraction of (h, dW).
module symsde_step_implicit_rescue
   use symsde_base_counters, only: counters_type, add_counters
   use symsde_base_damping, only: damping_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lane_unit
   use symsde_base_record, only: step_record
   use symsde_base_status, only: not_converged, singular, nonfinite
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type, tableau_form
   use symsde_solve_newton, only: newton_options
   use symsde_step_oracle_general, only: general_stepper, new_general_stepper
   use symsde_step_block_state, only: lane_state
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: rescue_type, new_rescue

   integer, parameter :: parts = 16           !! parts of the continuation
   integer, parameter :: max_unknowns = 512   !! most unknowns of a lane, since matrices are dense here

   !> The rescue of one stepper, with the model and the scheme (or its tableau) of the task. Its own stepper and
   !> arrays are made when the first lane needs them.
   type :: rescue_type
      private
      logical, public :: available = .false.  !! whether scheme and size of the system allow a rescue
      class(model_type), pointer :: model => null()
      type(scheme_type), pointer :: scheme => null()
      integer :: correction = 0
      integer :: max_iter = 0
      type(damping_type) :: damping
      class(general_stepper), allocatable :: stepper !! made when the first path needs it
      real(wp), allocatable :: w(:, :), q(:, :), p(:, :), dq(:, :), dp(:, :)  !! data of eight lanes
      real(wp), allocatable :: part(:, :)     !! a fraction of the weights w
      type(counters_type) :: counters         !! counts of the work, and of rescued path-steps
   contains
      procedure :: settle
      procedure :: attempt
      procedure :: tally
   end type rescue_type

contains

   !> Prepare for runs of this stepper; large arrays are allocated when needed. There is no rescue for steps without
   !> equations, given numbers of iterations, brackets, and large systems.
   subroutine new_rescue(self, task, stepper)
      type(rescue_type), intent(out) :: self
      type(stepper_task), intent(in), target :: task   !! must live as long as the rescue object
      class(stepper_type), intent(in) :: stepper       !! the stepper of rung 1

      self%scheme => task%scheme
      ! A Galerkin scheme that is a tableau for this model is rescued as that tableau.
      if (allocated(task%tableau)) self%scheme => task%tableau
      if (self%scheme%form /= tableau_form .or. task%newton%fixed_point > 0) return
      if (stepper%explicit) return              ! there are no equations to solve
      if (task%damping%acts() .and. .not. allocated(task%damping%rate)) return  ! steps stand between decays
      if (allocated(stepper%ham%modified)) return  ! brackets have additional increments
      ! Two slopes of n numbers for each stage, and twice as many if noise has its own coefficients.
      if (4*task%model%traits%ndof*self%scheme%nstage > max_unknowns) return
      self%available = .true.
      self%model => stepper%ham%model  ! the model, or its view, that the stepper uses
      self%correction = stepper%ham%correction
      self%max_iter = task%newton%max_iter
      self%damping = task%damping
   end subroutine new_rescue

   !> Complete a step in which a lane failed, after all other lanes have been advanced: the lane is rescued from its old
   !> (q, p) if possible, and otherwise recorded as failed in this step.
   subroutine settle(self, n, step, state, dq, dp)
      class(rescue_type), intent(inout) :: self
      integer(i8), intent(in) :: n                   !! absolute step
      type(step_record), intent(in) :: step
      type(lane_state), intent(inout) :: state
      real(wp), intent(inout) :: dq(:, :), dp(:, :)  !! work arrays for increments (nlane, ndof)
      integer(i8) :: status(state%nlane)

      if (self%available) then
         ! From the statuses of rung 1 take_rescued knows which lanes were rescued.
         status = state%status
         call self%attempt(state%nlane, step, state%q, state%p, state%failed_step, dq, dp, state%status)
         call state%take_rescued(status, dq, dp)
      end if
      call state%record(n)
   end subroutine settle

   !> Try the lanes that failed in this step, eight at a time; rescued lanes get their increments and status ok.
   !> Only lanes whose equations Newton could not solve are tried: not converged, singular or not finite.
   subroutine attempt(self, nlane, step, q, p, failed_step, dq, dp, status)
      class(rescue_type), intent(inout) :: self
      integer, intent(in) :: nlane
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(:, :), p(:, :)
      integer(i8), intent(in) :: failed_step(nlane)  !! >= 0: the lane had failed in an earlier step
      real(wp), intent(inout) :: dq(:, :), dp(:, :)
      integer(i8), intent(inout) :: status(nlane)
      integer, allocatable :: lanes(:)
      integer :: lane, first, n

      if (.not. self%available) return
      if (.not. allocated(self%stepper)) call make_stepper(self)
      ! Padding and paths that failed before have a failed step; all other statuses do not come from a solver.
      lanes = pack([(lane, lane=1, nlane)], failed_step < 0 .and. &
                   (status == not_converged .or. status == singular .or. status == nonfinite))
      do first = 1, size(lanes), lane_unit
         n = min(lane_unit, size(lanes) - first + 1)
         call rescue_lanes(self, n, lanes(first:first + n - 1), step, q, p, dq, dp, status)
      end do
   end subroutine attempt

   !> Make the general stepper of the scheme for eight lanes, with damping, and allocate their states and increments.
   subroutine make_stepper(self)
      type(rescue_type), intent(inout) :: self
      integer :: n, m

      n = self%model%traits%ndof
      m = self%model%traits%nnoise
      allocate (self%stepper)
      call new_general_stepper(self%stepper, self%model, self%scheme, self%correction, lane_unit, &
                               newton_options(max_iter=self%max_iter, shortens=.true.), self%damping)
      allocate (self%w(lane_unit, 0:m), self%part(lane_unit, 0:m))
      allocate (self%q(lane_unit, n), self%p(lane_unit, n))
      allocate (self%dq(lane_unit, n), self%dp(lane_unit, n))
   end subroutine make_stepper

   !> Rungs 2 and 3 for up to eight lanes, gathered from the block. Copies of the last lane fill up the eight; they have
   !> a status from the beginning, so that they are not solved.
   subroutine rescue_lanes(self, n, lanes, step, q, p, dq, dp, status)
      type(rescue_type), intent(inout), target :: self
      integer, intent(in) :: n, lanes(n)
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(:, :), p(:, :)
      real(wp), intent(inout) :: dq(:, :), dp(:, :)
      integer(i8), intent(inout) :: status(:)
      type(step_record) :: few
      integer(i8) :: lane_status(lane_unit)
      integer :: i, saved

      do i = 1, lane_unit
         self%w(i, :) = step%w(lanes(min(i, n)), :)
         self%q(i, :) = q(lanes(min(i, n)), :)
         self%p(i, :) = p(lanes(min(i, n)), :)
      end do
      ! The step for the gathered lanes, as a block of eight.
      few%t = step%t
      few%h = step%h
      few%w(1:, 0:) => self%w
      self%stepper%ham%nreal = n
      call self%stepper%ham%narrow([(lanes(min(i, n)), i=1, lane_unit)])
      ! Copies get a status; the lanes to be rescued have none.
      lane_status = nonfinite
      lane_status(:n) = 0
      ! Rung 2: start from zero slopes, with shortened corrections.
      call self%stepper%increment(few, self%q, self%p, self%dq, self%dp, lane_status)
      call keep(self, n, lanes, lane_status, dq, dp, status, saved)
      self%counters%damped = self%counters%damped + saved
      ! Rung 3 for the lanes that these have not solved.
      if (any(lane_status(:n) /= 0)) then
         call continue_increments(self, n, few, lane_status)
         call keep(self, n, lanes, lane_status, dq, dp, status, saved)
         self%counters%continued = self%counters%continued + saved
      end if
      call self%stepper%ham%widen()
   end subroutine rescue_lanes

   !> Rung 3: scale (h, dW) by k/16, k = 1..16, starting from the slopes found for k-1. Lanes that rung 2 solved are
   !> skipped, and so is a lane after the first k at which it fails. dq and dp are sums of the slopes of k = 16.
   subroutine continue_increments(self, n, step, lane_status)
      type(rescue_type), intent(inout), target :: self
      integer, intent(in) :: n    !! number of lanes used
      type(step_record), intent(in) :: step
      integer(i8), intent(inout) :: lane_status(lane_unit)
      type(step_record) :: fraction
      integer :: k

      ! Times and nodes of the whole step, with scaled weights.
      fraction = step
      fraction%w(1:, 0:) => self%part
      lane_status(:n) = merge(0_i8, int(nonfinite, i8), lane_status(:n) /= 0)  ! try again only failed lanes
      self%stepper%x = 0
      do k = 1, parts
         ! Slopes are proportional to the weights up to higher orders: the guess for k is scaled by k/(k-1).
         if (k > 1) self%stepper%x = self%stepper%x*(real(k, wp)/(k - 1))
         self%part = self%w*(real(k, wp)/parts)
         call self%stepper%solve_stages(fraction, self%q, self%p, lane_status)
      end do
      call self%stepper%add_up(self%p, self%dq, self%dp)
   end subroutine continue_increments

   !> Add the counters. A lane that fails here has failed in the step before the rescue: it counts as one failure.
   subroutine tally(self, total)
      class(rescue_type), intent(in) :: self
      type(counters_type), intent(inout) :: total
      type(counters_type) :: own

      call add_counters(total, self%counters)
      if (.not. allocated(self%stepper)) return
      own = self%stepper%ham%counters
      ! All other counts of the general stepper are work of this run.
      own%failures = 0
      call add_counters(total, own)
   end subroutine tally

   !> Copy the increments of lanes whose lane_status is ok to the block, with status 0; `saved` is their number. Other
   !> lanes keep the status of rung 1: a run reports the outcome of the scheme's own solver.
   subroutine keep(self, n, lanes, lane_status, dq, dp, status, saved)
      type(rescue_type), intent(in) :: self
      integer, intent(in) :: n, lanes(n)
      integer(i8), intent(in) :: lane_status(lane_unit)
      real(wp), intent(inout) :: dq(:, :), dp(:, :)
      integer(i8), intent(inout) :: status(:)
      integer, intent(out) :: saved
      integer :: i

      saved = 0
      do i = 1, n
         if (lane_status(i) /= 0) cycle
         dq(lanes(i), :) = self%dq(i, :)
         dp(lanes(i), :) = self%dp(i, :)
         status(lanes(i)) = 0
         saved = saved + 1
      end do
   end subroutine keep

end module symsde_step_implicit_rescue
