! SPDX-License-Identifier: BSD-3-Clause
!> The observer that keeps moments only: memory grows with the saved times, and with the logarithm of the number of
!> paths.
!>
!> Values, in this order: q_1 .. q_n, p_1 .. p_n, the energy H(q,p) if the model has values, and the user's observables.
!> Moments at time t are over the paths that are ok up to t. Streaming observers get the same values; if one of them
!> watches every step, this observer is shown the state after every step, and every `every`-th of these states is at a
!> saved time. A recorder beside it gets the states at saved times, and the last ones.
module symsde_ensemble_observe_moment_collector
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_lanes, only: padded
   use symsde_base_status, only: absorbed, error_type
   use symsde_base_text, only: append_line
   use symsde_ensemble_observe_observables, only: observables_type
   use symsde_ensemble_observe_observer, only: observer_type
   use symsde_ensemble_observe_observer_list, only: observer_list, new_observer_list
   use symsde_ensemble_observe_observer_plan, only: observer_plan
   use symsde_ensemble_observe_recorder, only: path_recorder
   use symsde_ensemble_statistics_path_tree, only: moment_node, moment_tree, insert_node, dyadic_pieces, reduce_lanes
   use symsde_model_abstract, only: model_type
   use symsde_step_block_state, only: lane_state
   implicit none
   private
   public :: moment_collector, new_moment_collector, moment_store, max_failed_listed

   integer, parameter :: max_failed_listed = 1000

   !> Data that all threads share: the tree, and the failed paths with the lowest indices.
   type :: moment_store
      type(moment_tree) :: tree
      integer(i8) :: nfailed = 0
      integer :: nlisted = 0
      integer(i8) :: failed(max_failed_listed) = -1       !! global indices, ascending
      integer(i4) :: status(max_failed_listed) = 0
      integer(i8) :: failed_step(max_failed_listed) = -1
   end type moment_store

   !> States that wait for the user's observables, which are called for many states at once, since a Python call costs
   !> microseconds.
   type :: waiting_states
      integer :: nplace = 1                       !! saved times that fit
      integer :: n = 0                            !! saved times that wait
      integer :: it = 0                           !! saved time of the first waiting state
      real(wp) :: t = 0                           !! time of this state [time]
      real(wp), allocatable :: own(:, :, :)       !! q, p and the energy (nlane, nplace, own values)
      logical, allocatable :: counts(:, :)        !! (nlane, nplace)
   end type waiting_states

   type, extends(observer_type) :: moment_collector
      private
      class(model_type), pointer :: model => null()
      class(observables_type), pointer :: observables => null()
      type(moment_store), pointer :: store => null()
      integer, public :: nvalue = 0                 !! number of all values, number of values without the user's
      integer :: nown = 0
      type(observer_plan), pointer :: plan => null() !! plan of the streaming observers
      type(observer_list) :: list                   !! streaming observers of this thread
      integer(i8) :: every = 1                      !! steps shown between saved times
      type(path_recorder) :: recorder               !! saves paths, or their last states, if it has arrays
      type(waiting_states) :: waiting
      integer :: ntime = 0, nreal = 0, npiece = 0
      integer :: offset(64) = 0, level(64) = 0
      integer(i8) :: first = 0
      type(moment_node), allocatable :: pieces(:)
      real(wp), allocatable :: values(:, :), w(:, :)  !! (nlane, own values), (nlane, 0:nnoise)
   contains
      procedure :: begin_block
      procedure :: observe
      procedure :: may_retire
      procedure :: add_warnings
      procedure :: skip
      procedure :: end_block
      procedure :: gather
      procedure :: failure_code
      procedure :: probe
      procedure :: numbers
      procedure :: see
   end type moment_collector

contains

   !> A collector for ntime saved times that delivers its nodes to store. If the observers of `plan` watch steps, it
   !> gets every step, and every `every`-th step is a saved time.
   subroutine new_moment_collector(self, model, nlane, ntime, store, observables, plan, every, recorder)
      type(moment_collector), intent(out) :: self
      class(model_type), intent(in), target :: model
      integer, intent(in) :: nlane
      integer, intent(in) :: ntime
      type(moment_store), intent(in), target :: store
      class(observables_type), intent(in), target, optional :: observables
      type(observer_plan), intent(in), target, optional :: plan
      integer(i8), intent(in), optional :: every
      type(path_recorder), intent(in), optional :: recorder

      self%model => model
      self%store => store
      self%ntime = ntime
      self%nvalue = 2*model%traits%ndof
      if (model%traits%has_value) self%nvalue = self%nvalue + 1
      self%nown = self%nvalue
      nullify (self%observables)
      if (present(observables)) then
         self%observables => observables
         self%nvalue = self%nvalue + observables%nvalue
      end if
      call make_room(self, nlane)
      if (present(recorder)) self%recorder = recorder
      nullify (self%plan)
      if (.not. present(plan)) return
      self%plan => plan
      if (plan%watches_steps) self%every = every
   end subroutine new_moment_collector

   !> Use this view of the model for energies and for passages.
   subroutine see(self, model)
      class(moment_collector), intent(inout) :: self
      class(model_type), intent(in), target :: model

      self%model => model
   end subroutine see

   !> Allocate arrays for blocks of nlane lanes.
   subroutine make_room(self, nlane)
      class(moment_collector), intent(inout) :: self
      integer, intent(in) :: nlane

      if (allocated(self%values)) deallocate (self%values, self%w)
      allocate (self%values(nlane, self%nown), self%w(nlane, 0:self%model%traits%nnoise))
      self%w = 0
      self%w(:, 0) = 1
      if (.not. associated(self%observables)) return
      self%waiting%nplace = max(1, min(self%observables%most_lanes/nlane, self%ntime))
   end subroutine make_room

   subroutine begin_block(self, first, nreal, nlane)
      class(moment_collector), intent(inout) :: self
      integer(i8), intent(in) :: first
      integer, intent(in) :: nreal, nlane

      self%first = first
      self%nreal = nreal
      if (size(self%values, 1) /= nlane) call make_room(self, nlane)
      call dyadic_pieces(first, nreal, self%npiece, self%offset, self%level)
      if (allocated(self%pieces)) deallocate (self%pieces)
      call self%recorder%begin_block(first, nreal, nlane)
      if (associated(self%plan)) then
         if (.not. allocated(self%list%slots)) call new_observer_list(self%list, self%plan, self%model)
         call self%list%begin_block(first, nreal, nlane)
      end if
   end subroutine begin_block

   !> Allocate the pieces of a block that has begun; a block left out by a stop needs none.
   subroutine new_pieces(self)
      class(moment_collector), intent(inout) :: self
      integer :: i

      allocate (self%pieces(self%npiece))
      do i = 1, self%npiece
         self%pieces(i)%level = self%level(i)
         self%pieces(i)%index = (self%first + self%offset(i))/2_i8**self%level(i)
         allocate (self%pieces(i)%n(self%ntime), source=0.0_wp)
         allocate (self%pieces(i)%mean(self%nvalue, self%ntime), source=0.0_wp)
         allocate (self%pieces(i)%m2(self%nvalue, self%ntime), source=0.0_wp)
      end do
   end subroutine new_pieces

   subroutine observe(self, isave, t, state)
      class(moment_collector), intent(inout) :: self
      integer(i8), intent(in) :: isave
      real(wp), intent(in) :: t
      type(lane_state), intent(inout) :: state
      logical :: counts(state%nlane)
      integer :: it

      call self%list%watch(isave, t, state)
      if (mod(isave, self%every) /= 0) return
      call self%recorder%observe(isave/self%every, t, state)
      if (.not. allocated(self%pieces)) call new_pieces(self)
      it = int(isave/self%every) + 1
      call evaluate(self, t, state)
      counts = state%status == 0
      if (associated(self%observables)) then
         if (self%observables%nvalue > 0) then
            call let_wait(self%waiting, it, t, self%values, counts)
            if (self%waiting%n == self%waiting%nplace .or. it == self%ntime) &
               call ask_observables(self, state%nlane, state%ndof)
            return
         end if
      end if
      call take(self, it, t, self%values, counts)
   end subroutine observe

   !> Warn that paths absorbed by a passage no longer count in other statistics.
   subroutine add_warnings(self, text)
      class(moment_collector), intent(in) :: self
      character(:), allocatable, intent(inout) :: text
      integer :: i

      if (.not. associated(self%plan)) return
      do i = 1, size(self%plan%requests)
         if (.not. self%plan%requests(i)%absorbs) cycle
         call append_line(text, 'a passage absorbs: moments and all other observers are, at each time, over the '// &
                          'paths that have not left until then')
         return
      end do
   end subroutine add_warnings

   logical function may_retire(self)
      class(moment_collector), intent(in) :: self

      may_retire = .false.
      if (associated(self%plan)) may_retire = self%plan%watches_steps
   end function may_retire

   !> Take all values of the lanes at a saved time.
   subroutine take(self, it, t, values, counts)
      class(moment_collector), intent(inout) :: self
      integer, intent(in) :: it
      real(wp), intent(in) :: t
      real(wp), intent(in), contiguous :: values(:, :)   !! (nlane, nvalue)
      logical, intent(in), contiguous :: counts(:)       !! (nlane)

      call reduce(self, it, values, counts)
      call self%list%take(it, t, values, counts)
   end subroutine take

   !> Skip the remaining times: evaluate observables at the states that still wait.
   subroutine skip(self, isave)
      class(moment_collector), intent(inout) :: self
      integer(i8), intent(in) :: isave

      call self%recorder%skip((isave + self%every - 1)/self%every)
      if (self%waiting%n > 0) &
         call ask_observables(self, size(self%waiting%own, 1), self%model%traits%ndof)
   end subroutine skip

   !> Compute the moments of all values over the lanes of each piece.
   subroutine reduce(self, it, values, counts)
      class(moment_collector), intent(inout) :: self
      integer, intent(in) :: it
      real(wp), intent(in), contiguous :: values(:, :)   !! (nlane, nvalue)
      logical, intent(in), contiguous :: counts(:)       !! (nlane)
      integer :: i, j, a, b

      do i = 1, self%npiece
         a = self%offset(i) + 1
         b = self%offset(i) + 2**self%level(i)
         associate (node => self%pieces(i))
            do j = 1, self%nvalue
               call reduce_lanes(self%level(i), values(a:b, j), counts(a:b), &
                                 node%n(it), node%mean(j, it), node%m2(j, it))
            end do
         end associate
      end do
   end subroutine reduce

   !> Compute q, p and energy of every lane.
   subroutine evaluate(self, t, state)
      class(moment_collector), intent(inout) :: self
      real(wp), intent(in) :: t
      type(lane_state), intent(in) :: state
      integer :: n

      n = state%ndof
      self%values(:, 1:n) = state%q
      self%values(:, n + 1:2*n) = state%p
      if (self%model%traits%has_value) &
         call self%model%value(state%nlane, n, self%model%traits%nnoise, t, self%w, state%q, state%p, &
                               self%values(:, 2*n + 1))
   end subroutine evaluate

   !> Keep a state until the user's observables are called.
   subroutine let_wait(self, it, t, own, counts)
      type(waiting_states), intent(inout) :: self
      integer, intent(in) :: it
      real(wp), intent(in) :: t
      real(wp), intent(in) :: own(:, :)         !! q, p and the energy (nlane, own values)
      logical, intent(in) :: counts(:)

      if (.not. allocated(self%own)) &
         allocate (self%own(size(own, 1), self%nplace, size(own, 2)), self%counts(size(own, 1), self%nplace))
      if (self%n == 0) then
         self%it = it
         self%t = t
      end if
      self%n = self%n + 1
      self%own(:, self%n, :) = own
      self%counts(:, self%n) = counts
   end subroutine let_wait

   !> Call the user's observables for all waiting states, as neighbouring lanes in whole vectors, padded by the last.
   !> Never under a lock: a function may run the library itself.
   subroutine ask_observables(self, nlane, ndof)
      class(moment_collector), intent(inout) :: self
      integer, intent(in) :: nlane, ndof
      real(wp) :: values(nlane, padded(self%waiting%n*nlane)/nlane, self%observables%nvalue)
      real(wp), allocatable :: q(:, :, :), p(:, :, :), of_time(:, :)
      integer :: i, n, whole

      n = self%waiting%n
      whole = size(values, 2)
      allocate (of_time(nlane, self%nvalue), q(nlane, whole, ndof), p(nlane, whole, ndof))
      associate (w => self%waiting, nown => self%nown)
         do i = 1, whole
            q(:, i, :) = w%own(:, min(i, n), 1:ndof)
            p(:, i, :) = w%own(:, min(i, n), ndof + 1:2*ndof)
         end do
         call self%observables%evaluate(nlane*whole, ndof, w%t, q, p, values)
         do i = 1, n
            of_time(:, :nown) = w%own(:, i, :)
            of_time(:, nown + 1:) = values(:, i, :)
            call take(self, w%it + i - 1, w%t, of_time, w%counts(:, i))
         end do
         w%n = 0
      end associate
   end subroutine ask_observables

   subroutine end_block(self, state)
      class(moment_collector), intent(inout) :: self
      type(lane_state), intent(in) :: state
      integer :: i, lane

      if (.not. allocated(self%pieces)) self%npiece = 0
      do i = 1, self%npiece
         call insert_node(self%store%tree, self%pieces(i))
      end do
      call self%list%end_block(state)
      if (associated(self%recorder%status)) call self%recorder%end_block(state)
      do lane = 1, self%nreal
         if (state%status(lane) == 0 .or. state%status(lane) == absorbed) cycle
         call list_failure(self%store, self%first + lane - 1, int(state%status(lane), i4), state%failed_step(lane))
      end do
   end subroutine end_block

   subroutine gather(self)
      class(moment_collector), intent(inout) :: self

      call self%list%gather()
   end subroutine gather

   !> Numbers of eight bytes held at most: nodes over all saved times for the pieces of each thread's block, one node of
   !> each level that waits for its sibling in the tree, and the root.
   real(wp) function numbers(self, npath, nthread)
      class(moment_collector), intent(in) :: self
      integer(i8), intent(in) :: npath
      integer, intent(in) :: nthread
      real(wp) :: node
      integer :: pieces, waiting

      node = real(self%ntime, wp)*(2*self%nvalue + 1)
      pieces = 1
      if (mod(npath, 256_i8) /= 0 .or. mod(256, size(self%values, 1)) /= 0) &
         pieces = 2*exponent(real(size(self%values, 1), wp))
      pieces = int(min(int(pieces, i8), npath))
      waiting = int(min(int(exponent(real(npath, wp)), i8), npath))
      numbers = node*(real(nthread, wp)*pieces + waiting + 2) + nthread*real(size(self%values), wp)
      if (associated(self%plan)) numbers = numbers + self%plan%numbers(npath, nthread)
      if (associated(self%observables)) &
         numbers = numbers + nthread*real(size(self%values, 1), wp)*self%waiting%nplace* &
                   (4*self%model%traits%ndof + 3*self%observables%nvalue + 1)
   end function numbers

   !> The return code of the user's observables that failed.
   integer function failure_code(self) result(code)
      class(moment_collector), intent(in) :: self

      code = 0
      if (associated(self%observables)) code = self%observables%failure_code()
   end function failure_code

   !> Keep the failed paths with the lowest indices, in order, whichever thread found them first.
   subroutine list_failure(store, path, status, failed_step)
      type(moment_store), intent(inout) :: store
      integer(i8), intent(in) :: path, failed_step
      integer(i4), intent(in) :: status
      integer :: at

      store%nfailed = store%nfailed + 1
      at = store%nlisted + 1
      do while (at > 1)
         if (store%failed(at - 1) < path) exit
         if (at <= max_failed_listed) then
            store%failed(at) = store%failed(at - 1)
            store%status(at) = store%status(at - 1)
            store%failed_step(at) = store%failed_step(at - 1)
         end if
         at = at - 1
      end do
      if (at > max_failed_listed) return
      store%failed(at) = path
      store%status(at) = status
      store%failed_step(at) = failed_step
      store%nlisted = min(store%nlisted + 1, max_failed_listed)
   end subroutine list_failure

   !> Refuse user's observables that mix paths.
   subroutine probe(self, t, q0, p0, error)
      class(moment_collector), intent(in) :: self
      real(wp), intent(in) :: t, q0(:), p0(:)
      type(error_type), allocatable, intent(inout) :: error

      if (associated(self%observables)) call self%observables%probe(t, q0, p0, error)
   end subroutine probe

end module symsde_ensemble_observe_moment_collector
