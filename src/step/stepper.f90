! SPDX-License-Identifier: BSD-3-Clause
!> The abstract stepper: it computes the increment of q and p over one step, for a block of paths.
!>
!>    (dq, dp) from (q_n, p_n) and Hhat = h H + sum_k dW_k H_k + ..,     q_{n+1} = q_n + dq,   p_{n+1} = p_n + dp
!>
!> A run needs only "these steps of this state" (`advance`): by default a loop over increments, which are added, with or
!> without compensation, checked, and rejected for failed paths in step/block/state. A stepper computes increments
!> instead of states, since compensated sums need all digits of dq, which rounding of q_{n+1} would lose.
!>
!> Three kinds of steppers do more. A stepper that takes lanes in small groups may add their increments itself while
!> these are in cache (`moves`); another may compute data for many steps before the first of them (`prefetch`); a model
!> with whole steps has its own `advance`. A run calls the steps of a block of a thousand paths and those of a single
!> path, which is a block of one lane, in the same way. A stepper owns its work arrays: every thread has its own
!> stepper.
!>
!> A block is padded to whole vectors of eight lanes, and its passes distinguish lanes that are done from others. For a
!> run of few paths both are costs with little gain, so every path of such a run is a block of one lane. Each stepper
!> sets the number of paths up to which that is faster, at most most_single.
!>
!> A stepper describes itself: which tasks it fits (a function beside its type, called before it exists, unless a form
!> or frame decides it), how it is made for a task, and what it omits. The factory has the list of steppers.
module symsde_step_stepper
   use symsde_base_contracts, only: contracts_are_executed
   use symsde_base_damping, only: damping_type, noise_of_scheme
   use symsde_base_counters, only: counters_type, add_counters
   use symsde_base_kinds, only: wp, i8
   use symsde_base_maps, only: step_map
   use symsde_base_record, only: step_record, steps_record
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type, bracket_terms, tableau_form, correction_none, frame_none
   use symsde_solve_newton, only: newton_options
   use symsde_step_block_state, only: lane_state, passed_states
   use symsde_step_contract, only: require_steps, require_taken
   use symsde_step_hamiltonian_brackets, only: active_brackets
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   implicit none
   private
   public :: stepper_type, stepper_task, most_single, few_of

   integer, parameter :: most_single = 12         !! paths of a run up to which any stepper may take them one by one
   integer, parameter :: wide = 32                !! degrees of freedom above which a system is wide

   !> The task of a stepper. All but the number of lanes is determined once for a run (`resolve_task` of step/factory).
   !> `scheme` is executed: it points to the caller's scheme, or to `tableau` if that scheme is a tableau for this
   !> model.
   type :: stepper_task
      class(model_type), pointer :: model => null()
      type(scheme_type), pointer :: scheme => null()
      type(scheme_type), allocatable :: tableau
      logical :: follows = .false.             !! whether a stage needs only earlier stages for this model
      type(damping_type) :: damping            !! damping of momenta: none inside of a damped stepper
      integer :: damping_noise = noise_of_scheme  !! noise of kicks between drifts that decay, see base/damping
      integer :: correction = correction_none  !! resolved: never correction_auto
      type(step_map), allocatable :: flow      !! whole steps of the model; not allocated if there are none
      integer :: nlane = 0                     !! number of lanes of a block
      logical :: general = .false.             !! whether the oracle is demanded, for all parts of the step
      type(newton_options) :: newton
      logical :: as_increments = .false.       !! whether increments are needed to all of their digits, not states
   contains
      procedure :: is_tableau
      procedure :: has_brackets
      procedure :: is_plain
      procedure :: drifts_by_part
   end type stepper_task

   !> `make` sets the first components, which runs and their reports read; with `record` and the last increments a
   !> rescue tries the failed lanes of the last step again.
   type, abstract :: stepper_type
      character(:), allocatable :: name      !! name of the stepper, for the run report
      logical :: explicit = .false.          !! whether no solver is called
      logical :: one_solve = .false.         !! whether the equations are linear for this model: no iteration
      logical :: moves = .false.             !! whether it overrides `move`
      integer :: most_single = 0             !! up to this number of paths, one-lane steppers with the bits of blocks
                                             !! are faster; 0: there is no such stepper
      character(:), allocatable :: left_out    !! further work omitted from a step, for the run report
      type(one_step_hamiltonian) :: ham
      type(step_record) :: record                      !! the last attempted step of a run
      real(wp), allocatable :: last_dq(:, :), last_dp(:, :) !! its increments, allocated in the first step (nlane, ndof)
   contains
      procedure(make_interface), deferred :: make
      procedure(increment_interface), deferred :: increment
      procedure :: advance
      procedure :: prefetch
      procedure :: move
      procedure :: make_room
      procedure :: tally
   end type stepper_type

   abstract interface
      !> Prepare the stepper for a task that it fits: its name, its Hamiltonian for the lanes of the task, and its
      !> arrays.
      subroutine make_interface(self, task)
         import :: stepper_type, stepper_task
         class(stepper_type), intent(inout) :: self
         type(stepper_task), intent(in) :: task
      end subroutine make_interface

      !> One step from (q, p). Lanes with a status are frozen: their increments are not used.
      subroutine increment_interface(self, step, q, p, dq, dp, status)
         import :: stepper_type, step_record, wp, i8
         class(stepper_type), intent(inout) :: self
         type(step_record), intent(in) :: step                           !! increments and functionals of the step
         real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof)
         real(wp), intent(in) :: p(self%ham%nlane, self%ham%ndof)
         real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof)      !! q_{n+1} - q_n
         real(wp), intent(out) :: dp(self%ham%nlane, self%ham%ndof)      !! p_{n+1} - p_n
         integer(i8), intent(inout) :: status(self%ham%nlane)            !! 0, or a code that freezes the lane
      end subroutine increment_interface
   end interface

contains

   !> Whether the scheme kicks between flows of a quadratic part of H, which the model declares.
   pure logical function drifts_by_part(self)
      class(stepper_task), intent(in) :: self

      drifts_by_part = self%scheme%needs%quadratic_will_do .and. allocated(self%model%traits%quadratic_part)
   end function drifts_by_part

   !> Take successive steps from the state of a block, which is advanced. If several states are requested, one after
   !> every steps%every steps, they are stored in passed, including the last one. The step in which a lane fails is the
   !> last one taken: then the lane has its old state, and a status, while all other lanes have advanced. The caller has
   !> the lane rescued, or its failure recorded.
   subroutine advance(self, steps, state, passed, ntaken, failed)
      class(stepper_type), intent(inout) :: self
      type(steps_record), intent(inout) :: steps
      type(lane_state), intent(inout) :: state
      type(passed_states), intent(inout) :: passed
      integer, intent(out) :: ntaken    !! number of steps, including one in which a lane failed
      logical, intent(out) :: failed    !! whether a lane failed
      integer :: left

      if (contracts_are_executed) call require_steps(steps, state)
      call self%make_room()
      call self%prefetch(steps)
      passed%n = 0
      left = steps%every
      do ntaken = 1, steps%nstep
         call steps%show(ntaken, self%record)
         if (self%moves .and. .not. allocated(state%q_low)) then
            call self%move(self%record, state%q, state%p, state%status)
            failed = state%has_new_failures()
         else
            call self%increment(self%record, state%q, state%p, self%last_dq, self%last_dp, state%status)
            call state%advance(self%last_dq, self%last_dp, failed)
         end if
         if (contracts_are_executed .and. failed) call require_taken(steps, state, passed, ntaken, failed)
         if (failed) return
         left = left - 1
         if (left > 0) cycle
         left = steps%every
         if (steps%nstep > steps%every) call passed%put(state)
      end do
      ntaken = steps%nstep
      if (contracts_are_executed) call require_taken(steps, state, passed, ntaken, failed)
   end subroutine advance

   !> Compute data that these steps need before the first of them, for all at once; by default nothing. `advance` then
   !> takes exactly these steps, in order. Steppers inside of others, rescues and diagnoses only compute increments,
   !> without prefetching.
   subroutine prefetch(self, steps)
      class(stepper_type), intent(inout), target :: self
      type(steps_record), intent(in) :: steps
   end subroutine prefetch

   !> Allocate the increments of a step, in the first step: a stepper that moves states itself, or is never used, does
   !> not need them.
   subroutine make_room(self)
      class(stepper_type), intent(inout) :: self

      if (allocated(self%last_dq)) return
      allocate (self%last_dq(self%ham%nlane, self%ham%ndof), self%last_dp(self%ham%nlane, self%ham%ndof))
   end subroutine make_room

   !> One step of the states themselves, with the bits of the sums of q, p and the increments. Lanes that fail, also by
   !> a state that is not finite, get a status; lanes with a status keep their state.
   subroutine move(self, step, q, p, status)
      class(stepper_type), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(inout) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
   end subroutine move

   !> Number of paths up to which the paths of a block are faster one by one: the number measured for narrow systems,
   !> and a larger one for wide systems, where passes of a block go through memory.
   pure integer function few_of(n, narrow, broad)
      integer, intent(in) :: n              !! degrees of freedom
      integer, intent(in) :: narrow, broad  !! numbers of paths for narrow and for wide systems

      few_of = merge(broad, narrow, n >= wide)
   end function few_of

   !> Whether the scheme's tableau alone makes the step, without a frame.
   pure logical function is_tableau(self)
      class(stepper_task), intent(in) :: self

      is_tableau = self%scheme%form == tableau_form .and. self%scheme%frame == frame_none
   end function is_tableau

   !> Whether brackets are added to the Hamiltonian of a step of this model.
   pure logical function has_brackets(self)
      class(stepper_task), intent(in) :: self
      type(bracket_terms) :: active

      active = active_brackets(self%scheme%brackets, self%model%traits)
      has_brackets = active%are_added()
   end function has_brackets

   !> Whether the tableau makes the step of h H + sum_k dW_k H_k alone, with neither brackets nor correction.
   pure logical function is_plain(self)
      class(stepper_task), intent(in) :: self

      is_plain = self%is_tableau() .and. self%correction == correction_none .and. .not. self%has_brackets()
   end function is_plain

   !> Add the counts to the report of a run. Steppers that contain others add theirs; counters affect no decision.
   subroutine tally(self, total)
      class(stepper_type), intent(in) :: self
      type(counters_type), intent(inout) :: total

      call add_counters(total, self%ham%counters)
   end subroutine tally

end module symsde_step_stepper
