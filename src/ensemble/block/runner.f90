! SPDX-License-Identifier: BSD-3-Clause
!> One block of paths from its initial state to its last step: the time loop. A block of one lane is a single path.
!>
!>    begin:     load the states of the paths, show them to the observer
!>    run_chunk: until the chunk is over
!>                  draw         increments and functionals of the next steps, unless drawn ahead
!>                  plan_states  how many steps are taken at once, and which states are saved
!>                  take_steps   the stepper takes these steps, up to the first in which a lane fails (`advance`); then
!>                    show_states  the saved states are shown to the observer, which may retire lanes
!>                    settle       failed lanes are rescued, or their failure is recorded
!>    finish:    account for saved times that were not reached, count the steps
!>
!> Steps are counted from the beginning of the run, of which this block may be a part, and t_n = t0 + n h is computed
!> from the count. The loop is divided into chunks of a length chosen by the caller, who may stop the run between
!> chunks. Results do not depend on the chunks: several steps are taken at once, but a lane that fails or is retired
!> meanwhile ends where it would end step by step. No clock is read here.
module symsde_ensemble_block_runner
   use symsde_base_contracts, only: contracts_are_executed
   use symsde_base_counters, only: counters_type, add_counters
   use symsde_base_functionals, only: functional_set
   use symsde_base_interrupt, only: interrupt_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lane_paths, only: lane_paths
   use symsde_base_lanes, only: path_of_lane
   use symsde_base_record, only: steps_record
   use symsde_base_status, only: stopped
   use symsde_ensemble_block_ahead, only: states_ahead, most_shown
   use symsde_ensemble_block_growth, only: growth_type
   use symsde_ensemble_block_noise_buffer, only: noise_buffer, new_noise_buffer
   use symsde_ensemble_block_initial_state, only: initial_state
   use symsde_ensemble_contract, only: require_block, require_shown, require_finished
   use symsde_ensemble_observe_observer, only: observer_type
   use symsde_ensemble_options, only: run_options, noise_path
   use symsde_model_abstract, only: model_type
   use symsde_model_views_real_lanes, only: real_lanes_model
   use symsde_noise_source, only: noise_type
   use symsde_step_implicit_rescue, only: rescue_type
   use symsde_step_block_state, only: lane_state, new_lane_state, passed_states
   use symsde_step_stepper, only: stepper_type
   use symsde_step_flow_model_flow, only: model_flow_stepper
   implicit none
   private
   public :: block_runner, new_block_runner

   !> All data of one thread. Threads share read-only data alone.
   type :: block_runner
      type(run_options) :: options
      class(stepper_type), allocatable :: stepper
      type(rescue_type) :: rescue          !! solves steps that the stepper cannot solve
      class(observer_type), allocatable :: observer
      type(real_lanes_model), pointer :: real_lanes => null()  !! model without padding, if allowed; owned
      class(model_type), pointer :: by_path => null() !! view of the model for these paths, if it differs by path; owned
      type(lane_paths), pointer :: paths => null()     !! the paths of the lanes; owned, only together with by_path
      type(lane_state) :: state
      integer :: nreal = 0
      integer(i8), allocatable :: path(:)  !! global index of every lane (nlane)
      integer(i8) :: step = 0              !! absolute number of the next step
      type(noise_buffer) :: drawn           !! increments and functionals that drive the steps
      integer(i8), private :: begun = 0    !! absolute number of the block's first step
      integer(i8) :: chunk = 1             !! steps of a chunk, set by the caller
      type(counters_type) :: counters      !! steps and normals counted
      type(steps_record) :: steps          !! the steps taken at once
      type(passed_states) :: passed        !! saved states among them; not allocated if states are taken one by one
      type(growth_type) :: growth          !! the largest values so far, to find paths that grow without bound
      integer :: enough = 0                              !! number of lanes with a status that ends a chunk
      type(block_runner), pointer :: narrower => null()  !! list of runners of narrower blocks, owned by this one
      integer, allocatable :: origin(:)                  !! lanes in the wide block of a narrower runner's lanes (nlane)
   contains
      procedure :: equip
      procedure :: begin
      procedure :: begin_with
      procedure :: pass_over
      procedure :: run_chunk
      procedure :: finish
      procedure :: is_done
      procedure :: tally
      final :: release
   end type block_runner

   integer, parameter :: most_retaken = 32  !! most lanes of a block that repeats several steps when a lane is retired

contains

   !> Make a runner around a stepper, with room for the functionals `asked`; `equip` it before it runs. A single
   !> path, and a model that takes whole steps, keep several saved states and show them at once. Other blocks step
   !> to the next saved point and show the state itself. Room for states is bounded by memory (states_ahead) and by
   !> the saved points of the run.
   subroutine new_block_runner(self, options, nlane, stepper, asked)
      type(block_runner), intent(out) :: self
      type(run_options), intent(in) :: options
      integer, intent(in) :: nlane
      class(stepper_type), allocatable, intent(inout) :: stepper  !! moved into the runner
      type(functional_set), intent(in) :: asked                   !! functionals of the path, beside its increments
      integer :: nout
      logical :: several  ! whether several states are taken at once

      self%options = options
      call move_alloc(stepper, self%stepper)
      several = nlane == 1
      select type (stepper => self%stepper)
      class is (model_flow_stepper)
         several = .true.
      end select
      associate (n => self%stepper%ham%ndof)
         call new_noise_buffer(self%drawn, nlane, self%stepper%ham%nnoise, options%nstep, options%step, asked)
         call new_lane_state(self%state, nlane, n, options%compensated)
         nout = int(min(int(states_ahead(nlane, n), i8), max(1_i8, options%nstep/options%save_every)))
         ! Without room for states, the state of the block itself is shown.
         if (.not. several) nout = 0
         allocate (self%passed%q(nlane, n, nout), self%passed%p(nlane, n, nout))
      end associate
      self%steps%t0 = options%t0
   end subroutine new_block_runner

   !> Give the runner the options, observer and noise of one drive. The options may differ from those of
   !> new_block_runner in steps and saves alone. The observer is copied, since it keeps the sums of this thread; all
   !> threads read one source of noise.
   subroutine equip(self, options, observer, noise)
      class(block_runner), intent(inout) :: self
      type(run_options), intent(in) :: options
      class(observer_type), intent(in) :: observer           !! copied
      class(noise_type), intent(in), target :: noise

      ! Steps and saved points may differ between the drives of a prepared run; the stepper is kept.
      self%options = options
      self%drawn%noise => noise
      if (allocated(self%observer)) deallocate (self%observer)
      allocate (self%observer, source=observer)
      if (associated(self%by_path)) call self%observer%see(self%by_path)
   end subroutine equip

   !> Load the state of paths first .. first+nreal-1, and show it to the observer, unless a stopped run is resumed.
   subroutine begin(self, first, nreal, start)
      class(block_runner), intent(inout) :: self
      integer(i8), intent(in) :: first        !! global index
      integer, intent(in) :: nreal
      type(initial_state), intent(in) :: start

      call take_state(self, first, nreal, start)
      ! Growth is not checked when a stopped drive is resumed, whose blocks continue from different steps.
      call self%growth%begin(self%options%first_step, merge(0_i8, self%options%nstep, start%resumed), self%state)
      call self%observer%begin_block(first, nreal, self%state%nlane)
      if (contracts_are_executed) call require_shown(self%state)
      ! The initial state is saved state 0; a resumed block has shown it before.
      if (self%step == self%options%first_step) &
         call self%observer%observe(0_i8, time_of(self, self%step), self%state)
   end subroutine begin

   !> Load the initial state of a block; lanes beyond its last path repeat that path. A resumed block sets the next step
   !> itself.
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
      ! The number of steps taken is counted from here.
      self%begun = self%step
   end subroutine take_state

   !> Begin a block of these paths, the first nreal of them real, with step number `step` next; the caller loads their
   !> state. Noise, steps, Hamiltonian and the view of the model get the number of real lanes; noise, and a model that
   !> differs by path, get the paths of all lanes.
   subroutine begin_with(self, step, nreal, path)
      class(block_runner), intent(inout) :: self
      integer(i8), intent(in) :: step, path(self%state%nlane)
      integer, intent(in) :: nreal
      integer(i8) :: of_noise(self%state%nlane)  ! path whose noise drives each lane

      if (contracts_are_executed) call require_block(self%state%nlane, nreal, path, step)
      self%nreal = nreal
      self%path = path
      self%step = step
      ! Padding repeats the last path, noise included.
      of_noise = noise_path(self%options, path)
      call self%drawn%begin(nreal, of_noise)
      self%steps%nreal = nreal
      self%stepper%ham%nreal = nreal
      if (associated(self%real_lanes)) self%real_lanes%nreal = nreal
      if (associated(self%paths)) call self%paths%begin(path, self%options%first_path, self%options%row_paths)
      self%enough = self%state%nlane
   end subroutine begin_with

   !> Take steps until the chunk or the run is over, enough lanes of the block have a status (a narrower block may then
   !> take the others), or the interrupt is set, which is checked if the draws of a step take long.
   subroutine run_chunk(self, interrupt)
      class(block_runner), intent(inout) :: self
      class(interrupt_type), intent(inout), optional :: interrupt
      integer(i8) :: last
      integer :: nout, every

      ! The chunk ends here at the latest; no group of steps reaches beyond its end.
      last = min(self%step + self%chunk, self%options%first_step + self%options%nstep)
      do while (self%step < last .and. self%state%nfailed < self%enough)
         call self%drawn%draw(self%step, self%options%first_step + self%options%nstep, interrupt)
         ! An interrupted draw is discarded: the block stays where it is.
         if (present(interrupt)) then
            if (interrupt%wanted) return
         end if
         call plan_states(self, last - self%step, nout, every)
         call take_steps(self, nout, every)
         if (self%step == self%growth%look) call self%growth%note(self%state)
      end do
   end subroutine run_chunk

   !> Steps from here to the next saved point, 1 .. save_every; save_every at a saved point itself.
   pure integer(i8) function steps_to_save(self)
      type(block_runner), intent(in) :: self

      steps_to_save = self%options%save_every - mod(self%step - self%options%first_step, self%options%save_every)
   end function steps_to_save

   !> Plan the steps to take at once: nout groups of `every` steps, all drawn already. They end at the next saved point;
   !> or begin at a saved point and end at a later one, as far as there is room. If an observer may retire lanes of a
   !> wide block, they end at the next saved point: a retired lane would force the whole block to repeat its later
   !> steps.
   subroutine plan_states(self, left, nout, every)
      type(block_runner), intent(in) :: self
      integer(i8), intent(in) :: left       !! steps that may be taken
      integer, intent(out) :: nout, every   !! number of states, and steps to each
      integer(i8) :: most, ahead
      integer :: room

      ! No more steps at once than are drawn, nor than are left of the chunk.
      most = min(left, self%drawn%left(self%step))
      if (self%step < self%growth%look) most = min(most, self%growth%look - self%step)
      ahead = steps_to_save(self)
      room = size(self%passed%q, 3)
      if (self%state%nlane > most_retaken .and. self%observer%may_retire()) room = 1
      ! At a saved point with at least one whole interval to go, take as many whole intervals as fit.
      nout = 1
      if (ahead == self%options%save_every .and. ahead <= most) nout = max(1, int(min(most/ahead, int(room, i8))))
      every = int(min(ahead, most))
   end subroutine plan_states

   !> Take steps to nout states, `every` steps apart. If nout > 1, each is a saved point; a single state need not be.
   !> The steps end with the first in which a lane fails; the failure is settled here.
   !>
   !> The order matters. Saved states before a failure are shown first and without it, as if steps had been taken
   !> one by one. If the observer retires a lane at a saved state, later steps are discarded: their counts
   !> are subtracted, and the steps up to that state are repeated. Otherwise the failure is settled, and the point
   !> reached is shown if it is a saved one.
   subroutine take_steps(self, nout, every)
      type(block_runner), intent(inout) :: self
      integer, intent(in) :: nout, every
      type(lane_state) :: from, reached
      type(counters_type) :: before, after
      integer(i8) :: step
      integer :: ntaken, nshown, nfailed
      logical :: failed, retires

      step = self%step
      retires = .false.
      ! Keep the state before these steps only if an observer may retire a lane during them.
      if (nout > 1) retires = self%observer%may_retire()
      if (retires) then
         from = self%state
         call self%stepper%tally(before)
      end if
      ! The stepper takes the steps one after another by default, or at once if the model has whole steps. ntaken
      ! includes the step in which a lane failed.
      call self%drawn%show(step, nout*every, time_of(self, step), self%steps)
      self%steps%every = every
      call self%stepper%advance(self%steps, self%state, self%passed, ntaken, failed)
      if (self%observer%keeps_steps()) call self%observer%keep_steps(self%steps, ntaken)
      ! Show the saved states as if the last, failing step had not been tried.
      if (nout > 1) then
         if (failed) call set_back(self%state, reached)
         ! Number of lanes with a status before the observer sees the states.
         nfailed = self%state%nfailed
         call show_states(self, every, nshown)
         ! A lane was retired before the last step: subtract the counts of these steps, and repeat the steps up to the
         ! state where it was retired.
         if (retires .and. self%state%nfailed > nfailed .and. (failed .or. nshown < nout)) then
            call self%stepper%tally(after)
            call add_counters(self%counters, after, -1)
            call add_counters(self%counters, before)
            call take_again(self, from, step, nshown, every)
            return
         end if
         if (failed) self%state = reached
      end if
      self%step = step + ntaken
      ! The rescue gets the failed step, and arrays for the increments by which it moves lanes that it saves.
      if (failed) call self%rescue%settle(self%step - 1, self%stepper%record, self%state, self%stepper%last_dq, &
                                          self%stepper%last_dp)
      ! Several saved states have been shown above; still to show is a single state at a saved point, or a failed step's
      ! end there.
      if ((nout == 1 .or. failed) .and. steps_to_save(self) == self%options%save_every) call save_point(self)
   end subroutine take_steps

   !> A step failed after others: move its outcome to `reached`, and give `state` back the statuses before it. A
   !> lane that failed in this step has a status and no failed step yet.
   subroutine set_back(state, reached)
      type(lane_state), intent(inout) :: state
      type(lane_state), intent(out) :: reached

      reached = state
      ! A lane with a status and no recorded step failed in the present step.
      where (state%failed_step < 0) state%status = 0
   end subroutine set_back

   !> Show the saved states to the observer, one after another, until it retires a lane. The first is `every` steps
   !> after the beginning of these steps.
   subroutine show_states(self, every, nshown)
      type(block_runner), intent(inout) :: self
      integer, intent(in) :: every
      integer, intent(out) :: nshown   !! states shown: to the first with a retired lane, else all
      real(wp) :: times(most_shown)
      integer :: k

      nshown = self%passed%n
      if (nshown == 0) return
      do k = 1, nshown
         times(k) = time_of(self, self%step + k*int(every, i8))
      end do
      associate (first => (self%step + every - self%options%first_step)/self%options%save_every)
         call self%observer%observe_several(first, nshown, times, self%state%nlane, self%passed%q, self%passed%p, &
                                            self%state)
      end associate
   end subroutine show_states

   !> Repeat the steps to the nshown states that were shown, after a lane was retired at the last of them: for the
   !> counters, and for the low parts, which saved states lack. The states themselves are right: the observer was shown
   !> the last one in self%state, and has retired the lane there.
   subroutine take_again(self, from, step, nshown, every)
      type(block_runner), intent(inout) :: self
      type(lane_state), intent(inout) :: from   !! state before these steps
      integer(i8), intent(in) :: step           !! number of the first step
      integer, intent(in) :: nshown, every
      integer :: ntaken
      logical :: failed

      call self%drawn%show(step, nshown*every, time_of(self, step), self%steps)
      self%steps%every = every
      call self%stepper%advance(self%steps, from, self%passed, ntaken, failed)
      self%step = step + ntaken
      ! Low parts after these steps, which the saved states lack.
      if (.not. allocated(from%q_low)) return
      self%state%q_low = from%q_low
      self%state%p_low = from%p_low
   end subroutine take_again

   !> Count the steps that each path has taken, and the normals of the pairs of steps that it began. Steps after a
   !> path's end and draws ahead do not count, so the numbers do not depend on how paths share blocks.
   subroutine count_steps(self)
      type(block_runner), intent(inout) :: self
      integer :: lane, nwhole

      ! Paths that are ok have taken all steps; other paths are counted one by one, up to their last step.
      nwhole = count(self%state%status(:self%nreal) == 0)
      call add_steps(self, nwhole, self%step)
      if (nwhole == self%nreal) return
      do lane = 1, self%nreal
         if (self%state%status(lane) /= 0) call add_steps(self, 1, self%state%failed_step(lane))
      end do
   end subroutine count_steps

   !> Count the steps of n paths from the block's first step up to, but without, step `next`. Normals are drawn for
   !> pairs of steps 2 j, 2 j + 1, of which the first and the last may be half used.
   subroutine add_steps(self, n, next)
      type(block_runner), intent(inout) :: self
      integer, intent(in) :: n
      integer(i8), intent(in) :: next

      ! A path that ended before the block began has taken no steps here.
      if (next <= self%begun) return
      self%counters%steps = self%counters%steps + n*(next - self%begun)
      self%counters%normals = self%counters%normals + &
                              n*self%drawn%normals_of_pair*((next - 1)/2 - self%begun/2 + 1)
   end subroutine add_steps

   !> True if the last step is taken or no lane is ok.
   pure logical function is_done(self)
      class(block_runner), intent(in) :: self

      is_done = self%step >= self%options%first_step + self%options%nstep .or. &
                self%state%nfailed == self%state%nlane
   end function is_done

   !> Pass over a block that a stopped run does not reach: its paths are stopped at their first state and counted
   !> nowhere.
   subroutine pass_over(self, first, nreal, start)
      class(block_runner), intent(inout) :: self
      integer(i8), intent(in) :: first        !! global index
      integer, intent(in) :: nreal
      type(initial_state), intent(in) :: start

      call take_state(self, first, nreal, start)
      call stop_paths(self)
      call self%observer%begin_block(first, nreal, self%state%nlane)
      call self%observer%skip(0_i8)
   end subroutine pass_over

   !> Give paths that are ok the status `stopped`, and the number of their next step.
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
      if (contracts_are_executed) &
         call require_finished(self%state, self%nreal, self%step, self%options%first_step + self%options%nstep)
      call count_steps(self)
   end subroutine finish

   !> Add to `total` the counters of this block, of its stepper and rescue, and of the runners of narrower blocks.
   recursive subroutine tally(self, total)
      class(block_runner), intent(in) :: self
      type(counters_type), intent(inout) :: total

      call add_counters(total, self%counters)
      call self%stepper%tally(total)
      call self%rescue%tally(total)
      if (associated(self%narrower)) call self%narrower%tally(total)
   end subroutine tally

   !> Free the views of the model, and the narrower runners, each of which frees the next of the list.
   impure elemental recursive subroutine release(self)
      type(block_runner), intent(inout) :: self

      if (associated(self%real_lanes)) deallocate (self%real_lanes)
      if (associated(self%by_path)) deallocate (self%by_path)
      if (associated(self%paths)) deallocate (self%paths)
      if (associated(self%narrower)) deallocate (self%narrower)
   end subroutine release

   !> Show the state of the block to the observer, as saved state number (step - first step)/save_every.
   subroutine save_point(self)
      type(block_runner), intent(inout) :: self

      if (contracts_are_executed) call require_shown(self%state)
      call self%observer%observe((self%step - self%options%first_step)/self%options%save_every, &
                                 time_of(self, self%step), self%state)
   end subroutine save_point

   !> t_n = t0 + n h, never accumulated: a resumed run has the times of an uninterrupted one.
   pure real(wp) function time_of(self, step)
      type(block_runner), intent(in) :: self
      integer(i8), intent(in) :: step

      time_of = self%options%t0 + real(step, wp)*self%options%step
   end function time_of

end module symsde_ensemble_block_runner
