! SPDX-License-Identifier: BSD-3-Clause
!> The abstract stepper: it finds the increment of q and p over one step, for a block of paths.
!>
!>    (dq, dp) from (q_n, p_n) and Hhat = h H + sum_k dW_k H_k + ..,     q_{n+1} = q_n + dq,   p_{n+1} = p_n + dp
!>
!> A run asks for one thing, "these steps of this state" (`advance`): by default a loop over increments, which are
!> added, with or without compensation, checked, and refused for failed paths in step/block/state. Increments and not
!> states are what a stepper finds, since compensated sums need all digits of dq, which q_{n+1} would round away.
!>
!> Three kinds of steppers do more. One that takes lanes in small groups may add their increments itself while these
!> are in cache (`moves`); one may find what many steps need before the first of them (`prefetch`); a model that takes
!> whole steps has an `advance` of its own. A run asks in the same way for the steps of a block of a thousand paths and
!> for those of a path by itself, which is a block of one lane. A stepper owns its workspace: every thread has its own.
!>
!> A block is padded to whole vectors of eight lanes, and its passes tell lanes that are done from others. A run of few
!> paths pays for both and uses little of either: every path of such a run is a block of one lane. A stepper says up to
!> how many paths that is faster, at most most_single.
!>
!> A stepper describes itself: which tasks it fits (a function beside its type, asked before there is one, where a form
!> or frame of its own does not say it), how it is made for one, and what it leaves out. The factory keeps them in
!> order.
module symsde_step_stepper
   use symsde_base_contracts, only: contracts_are_executed
   use symsde_base_damping, only: damping_type
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

   integer, parameter :: most_single = 12         !! paths of a run that any stepper takes one by one
   integer, parameter :: wide = 32                !! degrees of freedom of a wide system

   !> What a stepper is wanted for. All but the lanes is found once for a run (`resolve_task` of step/factory). `scheme`
   !> is executed: it points to the scheme that was asked for, or to `tableau` where that scheme is one for this model.
   type :: stepper_task
      class(model_type), pointer :: model => null()
      type(scheme_type), pointer :: scheme => null()
      type(scheme_type), allocatable :: tableau
      logical :: follows = .false.             !! for this model a stage needs stages before it alone
      type(damping_type) :: damping            !! of momenta: none for a stepper inside of a damped one
      integer :: correction = correction_none  !! resolved: never correction_auto
      type(step_map), allocatable :: flow      !! whole steps of the model; not allocated: it has none
      integer :: nlane = 0                     !! lanes of a block
      logical :: general = .false.             !! the oracle is wanted, of all parts of the step
      type(newton_options) :: newton
      logical :: as_increments = .false.       !! increments are wanted to their own last place, not states
   contains
      procedure :: is_tableau
      procedure :: has_brackets
      procedure :: is_plain
   end type stepper_task

   !> The first components are set by `make` and read by runs and their reports; `record` and the last increments let a
   !> rescue try the failed lanes of the last step again.
   type, abstract :: stepper_type
      character(:), allocatable :: name      !! which stepper this is, for the run report
      logical :: explicit = .false.          !! no solver is called
      logical :: one_solve = .false.         !! its equations are linear for this model: no iteration
      logical :: moves = .false.             !! it has a `move` of its own
      integer :: most_single = 0             !! paths that go faster one by one, by a stepper of one lane with the bits
                                             !! of a lane of many; 0: there is none
      character(:), allocatable :: left_out    !! what else it leaves out of a step, for the run report
      type(one_step_hamiltonian) :: ham
      type(step_record) :: record                      !! the last step of a run that was tried
      real(wp), allocatable :: last_dq(:, :), last_dp(:, :)  !! its increments, made for the first one (nlane, ndof)
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
      !> Make it ready for a task that it fits: its name, its Hamiltonian for the lanes of the task, and its room.
      subroutine make_interface(self, task)
         import :: stepper_type, stepper_task
         class(stepper_type), intent(inout) :: self
         type(stepper_task), intent(in) :: task
      end subroutine make_interface

      !> One step from (q, p). Lanes with a status are frozen: their increments are not used.
      subroutine increment_interface(self, step, q, p, dq, dp, status)
         import :: stepper_type, step_record, wp, i8
         class(stepper_type), intent(inout) :: self
         type(step_record), intent(in) :: step                           !! what drives it
         real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof)
         real(wp), intent(in) :: p(self%ham%nlane, self%ham%ndof)
         real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof)      !! q_{n+1} - q_n
         real(wp), intent(out) :: dp(self%ham%nlane, self%ham%ndof)      !! p_{n+1} - p_n
         integer(i8), intent(inout) :: status(self%ham%nlane)            !! 0, or a code that freezes the lane
      end subroutine increment_interface
   end interface

contains

   !> Steps that follow each other, from the state of a block, which is moved. Where several states are wanted, one
   !> after every steps%every steps, they are put down in passed, the last one, too. The step in which a lane fails is
   !> the last one that is taken: then the lane is where it was, with a status, and others have gone on. Who asked sees
   !> to it that the lane is rescued, or its failure recorded.
   subroutine advance(self, steps, state, passed, ntaken, failed)
      class(stepper_type), intent(inout) :: self
      type(steps_record), intent(inout) :: steps
      type(lane_state), intent(inout) :: state
      type(passed_states), intent(inout) :: passed
      integer, intent(out) :: ntaken    !! steps, with that in which a lane failed
      logical, intent(out) :: failed    !! one has
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

   !> Find what these steps need before the first of them, for all at once; by default nothing. `advance` then asks for
   !> the increments of these steps alone, in order. Steppers inside of others, rescues and diagnoses ask for increments
   !> only, and nothing is found ahead for them.
   subroutine prefetch(self, steps)
      class(stepper_type), intent(inout), target :: self
      type(steps_record), intent(in) :: steps
   end subroutine prefetch

   !> Room for the increments of a step, made by the first one: a stepper that moves states itself, or is never used,
   !> has none before.
   subroutine make_room(self)
      class(stepper_type), intent(inout) :: self

      if (allocated(self%last_dq)) return
      allocate (self%last_dq(self%ham%nlane, self%ham%ndof), self%last_dp(self%ham%nlane, self%ham%ndof))
   end subroutine make_room

   !> One step of the states themselves, with the bits of the sums of q, p and the increments. Lanes that fail, by a
   !> state that is not finite, too, get a status; what has one stays where it is.
   subroutine move(self, step, q, p, status)
      class(stepper_type), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(inout) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
   end subroutine move

   !> Paths up to which those of a block are faster one by one: as many as were measured for narrow systems, and more
   !> of wide ones, where a block takes its passes through memory.
   pure integer function few_of(n, narrow, broad)
      integer, intent(in) :: n              !! degrees of freedom
      integer, intent(in) :: narrow, broad  !! paths of a narrow system, of a wide one

      few_of = merge(broad, narrow, n >= wide)
   end function few_of

   !> Whether the scheme's tableau makes the step, with nothing around it.
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

   !> Whether the tableau makes the step of h H + sum_k dW_k H_k as it stands: neither brackets nor correction.
   pure logical function is_plain(self)
      class(stepper_task), intent(in) :: self

      is_plain = self%is_tableau() .and. self%correction == correction_none .and. .not. self%has_brackets()
   end function is_plain

   !> Add what was counted to the report of a run. Steppers that hold others add theirs; nothing is decided by counters.
   subroutine tally(self, total)
      class(stepper_type), intent(in) :: self
      type(counters_type), intent(inout) :: total

      call add_counters(total, self%ham%counters)
   end subroutine tally

end module symsde_step_stepper
