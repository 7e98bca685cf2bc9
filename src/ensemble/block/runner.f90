! SPDX-License-Identifier: BSD-3-Clause
!> One block of paths from its initial state to its last step: the time loop.
!>
!> The loop is cut into chunks of as many steps as the caller likes, between which it may stop the run. Nothing that is
!> computed, shown or counted depends on where: steps are taken several at once, but a lane that fails or is retired on
!> the way ends where it would end if they were taken one by one. No clock is read here.
module symsde_ensemble_block_runner
   use symsde_base_counters, only: counters_type, add_counters
   use symsde_base_functionals, only: functional_set
   use symsde_base_interrupt, only: interrupt_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: path_of_lane
   use symsde_base_record, only: step_record, steps_record
   use symsde_base_status, only: stopped
   use symsde_ensemble_block_prefetch, only: states_ahead, most_shown
   use symsde_ensemble_block_noise_buffer, only: noise_buffer, new_noise_buffer
   use symsde_ensemble_block_few, only: few_paths
   use symsde_ensemble_block_initial_state, only: initial_state
   use symsde_ensemble_observe_observer, only: observer_type
   use symsde_ensemble_options, only: run_options
   use symsde_model_abstract, only: model_type
   use symsde_model_user_real_lanes, only: real_lanes_model
   use symsde_noise_source, only: noise_type
   use symsde_step_lone, only: lone_stepper
   use symsde_step_implicit_rescue, only: rescue_type
   use symsde_step_block_state, only: lane_state, new_lane_state
   use symsde_step_stepper, only: stepper_type
   use symsde_step_flow_model_flow, only: model_flow_stepper
   implicit none
   private
   public :: block_runner, new_block_runner

   !> All that one thread needs: nothing in it is shared with other threads except read-only data.
   type :: block_runner
      type(run_options) :: options
      class(stepper_type), allocatable :: stepper
      type(rescue_type) :: rescue          !! for paths that the stepper cannot solve
      class(observer_type), allocatable :: observer
      type(step_record) :: record          !! the step that is taken, where the model does not take it as a whole
      type(real_lanes_model), pointer :: real_lanes => null()  !! the model without padding, where it allows; owned
      type(lane_state) :: state
      integer :: nreal = 0
      integer(i8) :: step = 0              !! absolute step that comes next
      type(noise_buffer) :: drawn           !! what drives the steps
      integer(i8), private :: begun = 0    !! the one that the block began with
      integer(i8) :: chunk = 1             !! steps of a chunk, for the caller to choose
      type(counters_type) :: counters      !! steps and normals
      real(wp), allocatable :: dq(:, :), dp(:, :)  !! increments of a step, made for the first one (nlane, ndof)
      logical :: whole = .false.                   !! the model takes steps as a whole, several at once
      type(few_paths) :: few                       !! takes the paths of a block of few one by one, if it has a stepper
      logical :: alone = .false.                   !! this block is one of few
      type(steps_record) :: steps                  !! those
      real(wp), allocatable :: qn(:, :, :), pn(:, :, :)  !! these states, of more paths than one (nlane, ndof, ..)
      integer(i8), allocatable :: status(:)              !! of their lanes (nlane)
      integer :: enough = 0                              !! lanes with a status that end a chunk
      type(block_runner), pointer :: narrower => null()  !! a list of others, for the paths that are left; owned
      integer, allocatable :: origin(:)                  !! where one of these has its lanes from (nlane)
   contains
      procedure :: equip
      procedure :: set_lone
      procedure :: begin
      procedure :: begin_with
      procedure :: pass_over
      procedure :: run_chunk
      procedure :: finish
      procedure :: is_done
      procedure :: tally
      final :: release
   end type block_runner

   integer, parameter :: most_retaken = 32  !! lanes of a block: where one is retired, several steps are taken again

contains

   !> A runner around a stepper, with room for what sources of noise will be asked for; to be equipped before it runs.
   subroutine new_block_runner(self, options, nlane, stepper, asked, brings)
      type(block_runner), intent(out) :: self
      type(run_options), intent(in) :: options
      integer, intent(in) :: nlane
      class(stepper_type), allocatable, intent(inout) :: stepper  !! taken over
      type(functional_set), intent(in) :: asked                   !! of the path, beside its increments
      logical, intent(in) :: brings                               !! its steps are brought one by one, if at all

      self%options = options
      call move_alloc(stepper, self%stepper)
      associate (n => self%stepper%ham%ndof, nout => states_ahead(nlane, self%stepper%ham%ndof))
         call new_noise_buffer(self%drawn, nlane, self%stepper%ham%nnoise, options%nstep, options%step, asked, brings)
         call new_lane_state(self%state, nlane, n, options%compensated)
         select type (stepper => self%stepper)
         class is (model_flow_stepper)
            self%whole = .true.
            self%steps%max_iter = stepper%max_iter
            allocate (self%qn(nlane, n, nout), self%pn(nlane, n, nout), self%status(nlane))
         end select
      end associate
   end subroutine new_block_runner

   !> What takes the paths of a block of few one by one.
   subroutine set_lone(self, lone, model)
      class(block_runner), intent(inout) :: self
      class(lone_stepper), allocatable, intent(inout) :: lone  !! taken over; none: the model takes whole steps
      class(model_type), intent(in), target :: model

      call self%few%equip(lone, model, self%state%ndof, self%drawn%store, self%options)
   end subroutine set_lone

   !> What one drive of the runner needs; all but steps and saves in the options is as when the runner was made.
   subroutine equip(self, options, observer, noise)
      class(block_runner), intent(inout) :: self
      type(run_options), intent(in) :: options
      class(observer_type), intent(in) :: observer           !! copied
      class(noise_type), intent(in), target :: noise

      self%options = options
      self%drawn%noise => noise
      if (allocated(self%observer)) deallocate (self%observer)
      allocate (self%observer, source=observer)
   end subroutine equip

   !> Load the state of paths first .. first+nreal-1, and show it, unless a stopped run goes on from there.
   subroutine begin(self, first, nreal, start)
      class(block_runner), intent(inout) :: self
      integer(i8), intent(in) :: first        !! global index
      integer, intent(in) :: nreal
      type(initial_state), intent(in) :: start

      call take_state(self, first, nreal, start)
      call self%observer%begin_block(first, nreal)
      if (self%step == self%options%first_step) &
         call self%observer%observe(0_i8, time_of(self, self%step), self%state)
   end subroutine begin

   !> The initial state of a block; lanes past the last path repeat it.
   subroutine take_state(self, first, nreal, start)
      type(block_runner), intent(inout) :: self
      integer(i8), intent(in) :: first
      integer, intent(in) :: nreal
      type(initial_state), intent(in) :: start
      integer(i8) :: path(self%state%nlane)

      call path_of_lane(self%state%nlane, first, nreal, path)
      call self%begin_with(self%options%first_step, nreal, path)
      call start%give(first - self%options%first_path, nreal, self%options%first_step + self%options%nstep, self%step, &
                      self%state)
      self%begun = self%step
      self%alone = self%few%takes(nreal)
      if (allocated(self%few%stepper)) call self%few%stepper%note_rest(.true.)
   end subroutine take_state

   !> A block of these paths, the first nreal of them real, whose step number `step` comes next; without their state.
   subroutine begin_with(self, step, nreal, path)
      class(block_runner), intent(inout) :: self
      integer(i8), intent(in) :: step, path(self%state%nlane)
      integer, intent(in) :: nreal

      self%nreal = nreal
      self%step = step
      call self%drawn%begin(nreal, path)
      self%alone = .false.
      self%stepper%ham%nreal = nreal
      if (associated(self%real_lanes)) self%real_lanes%nreal = nreal
      self%enough = self%state%nlane
   end subroutine begin_with

   !> Steps until the chunk or the run is over, enough paths of the block have failed, or the interrupt is wanted, which
   !> is looked at where the draws of a step take long.
   subroutine run_chunk(self, interrupt)
      class(block_runner), intent(inout) :: self
      class(interrupt_type), intent(inout), optional :: interrupt
      integer(i8) :: last
      integer :: nout, every
      logical :: alone, taken

      last = min(self%step + self%chunk, self%options%first_step + self%options%nstep)
      do while (self%step < last .and. self%state%nfailed < self%enough)
         call self%drawn%draw(self%step, self%options%first_step + self%options%nstep, self%few, self%alone, interrupt)
         if (present(interrupt)) then
            if (interrupt%wanted) return
         end if
         alone = self%alone .and. .not. self%whole
         if (alone) call self%few%stepper%is_rested(alone)
         taken = self%whole
         if (self%whole) then
            call plan_states(self, last - self%step, nout, every)
            call take_whole(self, nout, every)
         else if (alone) then
            call lone_steps(self, last - self%step, taken)
         end if
         if (.not. taken) call one_step(self)
      end do
   end subroutine run_chunk

   !> Steps from here to the next saved point; save_every at a saved point.
   pure integer(i8) function steps_to_save(self)
      type(block_runner), intent(in) :: self

      steps_to_save = self%options%save_every - mod(self%step - self%options%first_step, self%options%save_every)
   end function steps_to_save

   !> One step of the block.
   subroutine one_step(self)
      type(block_runner), intent(inout) :: self
      logical :: refused

      call show_step(self)
      associate (s => self%state)
         if (self%stepper%moves .and. .not. self%options%compensated) then
            call self%stepper%move(self%record, s%q, s%p, s%status)
            if (s%has_new_failures()) call settle_lanes(self, (s%status), (s%q), (s%p))
         else
            call self%stepper%increment(self%record, s%q, s%p, self%dq, self%dp, s%status)
            call s%advance(self%step, self%dq, self%dp, refused)
            if (refused) call self%rescue%settle(self%step, self%record, s, self%dq, self%dp)
         end if
      end associate
      self%step = self%step + 1
      if (steps_to_save(self) == self%options%save_every) call save_point(self)
   end subroutine one_step

   !> Which steps are taken at once: of those that were drawn, up to the next saved point, or from saved to saved point.
   subroutine plan_states(self, left, nout, every)
      type(block_runner), intent(in) :: self
      integer(i8), intent(in) :: left       !! steps that may be taken
      integer, intent(out) :: nout, every   !! states that are asked for, and the steps to each
      integer(i8) :: most, ahead
      integer :: room

      most = min(left, self%drawn%left(self%step))
      ahead = steps_to_save(self)
      room = self%few%nout
      if (.not. self%alone) then
         room = size(self%qn, 3)
         if (self%state%nlane > most_retaken .and. self%observer%may_retire()) room = 1
      end if
      nout = 1
      if (ahead == self%options%save_every .and. ahead <= most) nout = int(min(most/ahead, int(room, i8)))
      every = int(min(ahead, most))
   end subroutine plan_states

   !> Steps of few paths, one path at a time; none where the next one is not usual.
   subroutine lone_steps(self, left, taken)
      type(block_runner), intent(inout) :: self
      integer(i8), intent(in) :: left  !! steps that may be taken
      logical, intent(out) :: taken
      type(lane_state) :: from
      type(counters_type) :: before
      integer(i8) :: step
      integer :: nout, every, nshown

      call plan_states(self, left, nout, every)
      step = self%step
      before = self%few%stepper%counters
      if (nout > 1 .and. self%observer%may_retire()) from = self%state
      call self%few%walk(self%drawn%ahead(step), self%nreal, self%options%t0, step, self%state, nout, every)
      taken = nout > 0
      if (.not. taken) then
         call self%state%repeat_last(self%nreal)
         return
      end if
      call show_states(self, nout, every, self%nreal, self%few%qn, self%few%pn, nshown)
      if (nshown == nout) return
      self%few%stepper%counters = before
      call self%few%walk(self%drawn%ahead(step), self%nreal, self%options%t0, step, from, nshown, every)
      if (allocated(from%q_low)) then
         self%state%q_low = from%q_low
         self%state%p_low = from%p_low
      end if
   end subroutine lone_steps

   !> nout states, each after `every` more steps; all of these are saved points, or one that may be none. Where a
   !> lane fails the steps are taken again one by one, to say in which.
   recursive subroutine take_whole(self, nout, every)
      type(block_runner), intent(inout) :: self
      integer, intent(in) :: nout, every
      type(lane_state) :: from
      type(counters_type) :: before
      integer(i8) :: step
      logical :: taken
      integer :: i, nshown

      step = self%step
      before = self%stepper%ham%counters
      if (nout > 1 .and. self%observer%may_retire()) from = self%state
      call flow_from(self, self%state, step, nout, every, taken)
      if (taken) then
         if (self%alone) then
            call show_states(self, nout, every, 1, self%few%qn, self%few%pn, nshown)
         else
            call show_states(self, nout, every, self%state%nlane, self%qn, self%pn, nshown)
         end if
         if (nshown == nout) return
         self%stepper%ham%counters = before
         call flow_from(self, from, step, nshown, every, taken)
      else if (nout*every == 1) then
         call settle_lanes(self, self%status, self%qn(:, :, 1), self%pn(:, :, 1))
         self%step = self%step + 1
         if (steps_to_save(self) == self%options%save_every) call save_point(self)
      else
         self%stepper%ham%counters = before  ! no step counts twice, however many went together
         do i = 1, nout*every
            if (self%state%nfailed >= self%enough) exit
            call take_whole(self, 1, 1)
         end do
      end if
   end subroutine take_whole

   !> States of whole steps from a state before the one of this number, into self%qn and self%pn, or those of few; taken
   !> says that no lane fails on the way.
   subroutine flow_from(self, state, step, nout, every, taken)
      type(block_runner), intent(inout) :: self
      type(lane_state), intent(inout) :: state
      integer(i8), intent(in) :: step
      integer, intent(in) :: nout, every
      logical, intent(out) :: taken

      self%status = state%status
      select type (stepper => self%stepper)
      class is (model_flow_stepper)
         if (self%alone) then
            call self%few%flow(stepper, self%drawn%ahead(step), time_of(self, step), nout, every, state, self%qn, &
                               self%pn, self%status, taken)
         else
            call self%drawn%store%show_several(self%drawn%ahead(step), nout*every, time_of(self, step), self%steps)
            self%steps%every = every
            self%steps%nreal = self%nreal
            call stepper%flow(self%steps, state%q, state%p, self%qn, self%pn, self%status)
            call state%judge(self%nreal, nout, self%status, self%qn, self%pn, taken)
         end if
      end select
   end subroutine flow_from

   !> The states that were taken, to the observer where they are saved points, as far as it retires no lane: that one
   !> took no further step, and those which are shown again are taken again, for the counters.
   subroutine show_states(self, nout, every, nlane, qn, pn, nshown)
      type(block_runner), intent(inout) :: self
      integer, intent(in) :: nout, every, nlane   !! nlane: nreal of few paths
      real(wp), intent(in), dimension(nlane, self%state%ndof, nout) :: qn, pn
      integer, intent(out) :: nshown              !! up to the first after which a lane is retired, else all
      real(wp) :: times(most_shown)
      integer(i8) :: first
      integer :: k

      nshown = nout
      first = self%step + every
      self%step = self%step + nout*every
      if (steps_to_save(self) == self%options%save_every) then
         do k = 1, nout
            times(k) = time_of(self, first + (k - 1)*int(every, i8))
         end do
         call self%observer%observe_several((first - self%options%first_step)/self%options%save_every, nshown, &
                                            times, nlane, qn, pn, self%state)
         self%step = self%step - (nout - nshown)*every
      else
         call self%state%take_first(nlane, qn(1, 1, nout), pn(1, 1, nout))
      end if
   end subroutine show_states

   !> One step in which a lane failed: it is rescued where that is possible, or gets its status and step.
   subroutine settle_lanes(self, status, q, p)
      type(block_runner), intent(inout) :: self
      integer(i8), intent(in) :: status(self%state%nlane)  !! as the step left it
      real(wp), dimension(self%state%nlane, self%state%ndof), intent(in) :: q, p  !! after it
      real(wp), dimension(self%state%nlane, self%state%ndof) :: qn, pn
      integer :: lane

      qn = q
      pn = p
      associate (s => self%state)
         s%status = status
         call show_step(self)
         call self%rescue%attempt(s%nlane, self%record, s%q, s%p, s%failed_step, self%dq, self%dp, s%status)
         do lane = 1, s%nlane
            if (status(lane) == 0 .or. s%status(lane) /= 0) cycle
            qn(lane, :) = s%q(lane, :) + self%dq(lane, :)
            pn(lane, :) = s%p(lane, :) + self%dp(lane, :)
         end do
         call s%settle(self%step, qn, pn)
      end associate
   end subroutine settle_lanes

   !> What the next step of the block is given, and room for its increments.
   subroutine show_step(self)
      type(block_runner), intent(inout) :: self

      call self%drawn%show(self%step, time_of(self, self%step), self%few, self%alone, self%record)
      if (.not. allocated(self%dq)) &
         allocate (self%dq(self%state%nlane, self%state%ndof), self%dp(self%state%nlane, self%state%ndof))
   end subroutine show_step

   !> The steps that each path has taken, and the normals of the pairs that they began: not what the block did for paths
   !> that were gone, or drew ahead.
   pure subroutine count_steps(self)
      type(block_runner), intent(inout) :: self
      integer :: lane, nwhole

      nwhole = count(self%state%status(:self%nreal) == 0)
      call add_steps(self, nwhole, self%step)
      if (nwhole == self%nreal) return
      do lane = 1, self%nreal
         if (self%state%status(lane) /= 0) call add_steps(self, 1, self%state%failed_step(lane))
      end do
   end subroutine count_steps

   !> Those of n paths from where the block began to the step that comes next.
   pure subroutine add_steps(self, n, next)
      type(block_runner), intent(inout) :: self
      integer, intent(in) :: n
      integer(i8), intent(in) :: next

      if (next <= self%begun) return
      self%counters%steps = self%counters%steps + n*(next - self%begun)
      self%counters%normals = self%counters%normals + &
                              n*self%drawn%normals_of_pair*((next - 1)/2 - self%begun/2 + 1)
   end subroutine add_steps

   !> Whether nothing is left to do.
   pure logical function is_done(self)
      class(block_runner), intent(in) :: self

      is_done = self%step >= self%options%first_step + self%options%nstep .or. &
                self%state%nfailed == self%state%nlane
   end function is_done

   !> A block that the run has no time for: its paths are stopped at their first state and counted nowhere.
   subroutine pass_over(self, first, nreal, start)
      class(block_runner), intent(inout) :: self
      integer(i8), intent(in) :: first        !! global index
      integer, intent(in) :: nreal
      type(initial_state), intent(in) :: start

      call take_state(self, first, nreal, start)
      call stop_paths(self)
      call self%observer%begin_block(first, nreal)
      call self%observer%skip(0_i8)
   end subroutine pass_over

   subroutine stop_paths(self)
      type(block_runner), intent(inout) :: self

      where (self%state%status == 0)
         self%state%status = stopped
         self%state%failed_step = self%step
      end where
   end subroutine stop_paths

   !> Account for saved times that were not reached, because all paths failed or the run was stopped.
   subroutine finish(self)
      class(block_runner), intent(inout) :: self
      integer(i8) :: reached

      if (self%step < self%options%first_step + self%options%nstep) then
         call stop_paths(self)
         reached = (self%step - self%options%first_step)/self%options%save_every
         if (reached < self%options%nstep/self%options%save_every) call self%observer%skip(reached + 1)
      end if
      call count_steps(self)
   end subroutine finish

   !> Add what was counted, by this block, its stepper and its rescue.
   recursive subroutine tally(self, total)
      class(block_runner), intent(in) :: self
      type(counters_type), intent(inout) :: total

      call add_counters(total, self%counters)
      if (allocated(self%few%stepper)) call add_counters(total, self%few%stepper%counters)
      call self%stepper%tally(total)
      call self%rescue%tally(total)
      if (associated(self%narrower)) call self%narrower%tally(total)
   end subroutine tally

   !> Give back the view of the model, and the narrower runners.
   impure elemental recursive subroutine release(self)
      type(block_runner), intent(inout) :: self

      if (associated(self%real_lanes)) deallocate (self%real_lanes)
      if (associated(self%narrower)) deallocate (self%narrower)
   end subroutine release

   subroutine save_point(self)
      type(block_runner), intent(inout) :: self

      call self%observer%observe((self%step - self%options%first_step)/self%options%save_every, &
                                 time_of(self, self%step), self%state)
   end subroutine save_point

   !> t_n = t0 + n h, never accumulated.
   pure real(wp) function time_of(self, step)
      type(block_runner), intent(in) :: self
      integer(i8), intent(in) :: step

      time_of = self%options%t0 + real(step, wp)*self%options%step
   end function time_of

end module symsde_ensemble_block_runner
