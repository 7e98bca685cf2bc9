! SPDX-License-Identifier: BSD-3-Clause
!> Paths that leave an interval, low < x < high: how many until each saved time, through which end, and in which state.
!>
!> The value x is a coordinate, a momentum, the energy or an observable, checked after every step. A path whose x is NaN
!> fails, since it is neither inside nor outside. Between two steps a path may leave and come back. If noise acts on a
!> coordinate q_i, x moves like a Brownian bridge between its values x_0 and x_1, with variance s^2 per unit time, s^2 =
!> sum_k (dH_k/dp_i)^2 (for momenta sum_k (dH_k/dq_i)^2). The bridge has passed an end a with probability exp(-2 (a -
!> x_0)(a - x_1)/(s^2 h)), and a random number decides (Gobet, Stoch. Proc. Appl. 87, 2000, 167): the number of the
!> path, or of path 0 if all noises that act on x are common to all paths, since all paths then have the same bridge. So
!> times are right to first order in h instead of sqrt(h). Without noise on x there is no such correction. Discrete
!> increments are not those of a Brownian path, so there is no bridge.
!>
!> counts: (below, above, still inside) at each saved time, where below and above count the paths lost since the
!> previous saved time; then the number of paths lost between two steps, -1 without bridges; then path and absolute step
!> of the lost paths with the lowest indices, -1 if there are fewer. Numbers of single paths: time, q and p of these
!> paths. The table has one row, over all lost paths: time, q, p. Answers are the shares lost below and above until each
!> saved time, of all paths, with binomial errors.
module symsde_ensemble_observe_passage
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan, ieee_is_nan
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lane_paths, only: narrow, widen
   use symsde_base_lanes, only: padded
   use symsde_base_laws, only: law_gaussian, law_text
   use symsde_base_status, only: error_type, raise, invalid_argument, incompatible, nonfinite, absorbed
   use symsde_base_text, only: to_text
   use symsde_ensemble_observe_bridges, only: bridge_chances, deciding_numbers
   use symsde_ensemble_observe_streaming, only: streaming_observer, observer_request, observed_run
   use symsde_step_block_state, only: lane_state
   implicit none
   private
   public :: passage_observer, new_passage_observer

   integer, parameter :: most_listed = 1000, most_numbers = 100000
   integer, parameter :: below = 1, above = 2

   type, extends(streaming_observer) :: passage_observer
      integer :: nlist = 0                          !! number of lost paths that are listed
      logical :: bridges = .false.                  !! whether noise acts on the value
      logical :: shares = .false.                   !! whether a noise common to all paths may act on the value
      integer(i8), allocatable :: side(:), step(:)  !! end by which a lane left, or 0; step of leaving (nlane)
      real(wp), allocatable :: left(:, :)           !! time, q and p when it left (nlane, 1 + 2 ndof)
      integer :: nlook = 0 !! number of lanes still inside, which are adjacent in the arrays below
      integer, allocatable :: lanes(:)              !! numbers of the lanes still inside; the last is repeated (nlane)
      integer :: nseen = 0                          !! lanes with a status when the lanes inside were last counted
      real(wp), allocatable :: x(:), before(:)      !! value after the step, and before it (nlane)
      real(wp), allocatable :: rate(:)              !! s^2 before the step (nlane)
      integer(i8), allocatable :: by(:)             !! 0, or the end by which the lane leaves in this step (nlane)
      integer(i8), allocatable :: path(:)           !! path whose number decides for a lane (nlane)
      integer(i8), allocatable :: words(:)          !! output of the random generator (4 nlane)
      real(wp), allocatable :: chance(:), u(:)      !! probabilities of leaving (nlane below, nlane above); uniforms
      real(wp), allocatable :: q(:), p(:), w(:), hq(:), hp(:), own(:)  !! arguments and results of one call
   contains
      procedure :: open_block
      procedure :: is_coordinate
      procedure :: looks_at_all
      procedure :: take
      procedure :: watches_steps
      procedure :: watch
      procedure :: close_block
      procedure :: clear
      procedure :: join
      procedure :: nanswer
      procedure :: answer
   end type passage_observer

contains

   !> Largest number of lost paths listed with their states.
   pure integer function most_lost(ndof)
      integer, intent(in) :: ndof

      most_lost = max(1, min(most_listed, most_numbers/(1 + 2*ndof)))
   end function most_lost

   subroutine new_passage_observer(self, request, run, error)
      type(passage_observer), intent(out) :: self
      type(observer_request), intent(in) :: request
      type(observed_run), intent(in) :: run
      type(error_type), allocatable, intent(inout) :: error
      integer :: n

      n = run%ndof
      self%shares = any(run%common)
      self%nlist = most_lost(n)
      self%ncount = 3_i8*run%ntime + 1 + 2*self%nlist
      self%nsingle = int(1 + 2*n, i8)*self%nlist
      self%nrow = 1
      self%ncolumn = 1 + 2*n
      associate (value => request%values(1))
         self%bridges = request%bridges .and. value <= 2*n .and. run%nnoise > 0 .and. &
                        .not. (value <= n .and. run%position_noise)
         if (.not. request%low < request%high) then
            call raise(error, invalid_argument, 'new_passage_observer', 'nothing lies between '// &
                       to_text(request%low)//' and '//to_text(request%high)//': give low < high, one of which may '// &
                       'be infinite')
         else if (self%bridges .and. .not. run%has_gradient) then
            call raise(error, incompatible, 'new_passage_observer', 'the model gives flows of two parts of H '// &
                       '(drift, kick) and no gradient, which tells how strong the noise is between two steps: give '// &
                       'it a gradient, or ask for no bridges; then passages are seen at the ends of steps')
         else if (self%bridges .and. run%law /= law_gaussian) then
            call raise(error, incompatible, 'new_passage_observer', 'the '//law_text(run%law)//' increments of '// &
                       'this scheme do not follow a Brownian path, so no Brownian bridge exists between its steps: '// &
                       'give a scheme with Gaussian increments, or ask for no bridges; then passages are seen at '// &
                       'the ends of steps')
         end if
      end associate
   end subroutine new_passage_observer

   pure logical function watches_steps(self)
      class(passage_observer), intent(in) :: self

      watches_steps = .true.
   end function watches_steps

   subroutine open_block(self)
      class(passage_observer), intent(inout) :: self
      integer :: lane

      associate (n => padded(self%run%nlane))  ! the model is called with whole vectors
         if (.not. allocated(self%side)) call new_workspace(self, self%run%nlane, n)
         self%side = 0
         self%rate = 0
         self%nlook = self%nreal
         self%lanes = [(min(lane, self%nreal), lane=1, n)]
         if (allocated(self%mine)) then
            self%nlook = count(self%mine(:self%nreal))
            self%lanes(:self%nlook) = pack([(lane, lane=1, self%nreal)], self%mine(:self%nreal))
            self%lanes(self%nlook + 1:) = self%lanes(self%nlook)
         end if
         self%path = self%first + self%lanes - 1
         self%nseen = -1
      end associate
   end subroutine open_block

   !> Allocate the results of a block, and work for n lanes that are inside.
   subroutine new_workspace(self, nlane, n)
      class(passage_observer), intent(inout) :: self
      integer, intent(in) :: nlane, n

      allocate (self%side(nlane), self%step(nlane), self%left(nlane, self%ncolumn))
      allocate (self%lanes(n), self%x(n), self%before(n), self%rate(n), self%path(n), self%by(n))
      if (self%is_coordinate() .and. .not. self%bridges) return
      allocate (self%q(n*self%run%ndof), self%p(n*self%run%ndof), self%w(n*(self%run%nnoise + 1)))
      if (self%bridges) allocate (self%hq(n*self%run%ndof), self%hp(n*self%run%ndof), self%words(4*n), &
                                  self%chance(2*n), self%u(n))
      if (associated(self%run%observables)) allocate (self%own(n*self%run%observables%nvalue))
   end subroutine new_workspace

   !> Whether all lanes of the block are inside, so that whole arrays can be used.
   pure logical function looks_at_all(self)
      class(passage_observer), intent(in) :: self

      looks_at_all = self%nlook == self%nreal .and. self%run%nlane > 1
   end function looks_at_all

   !> Whether the value is a coordinate or a momentum.
   pure logical function is_coordinate(self)
      class(passage_observer), intent(in) :: self

      is_coordinate = self%request%values(1) <= 2*self%run%ndof
   end function is_coordinate

   !> Nothing to do at saved times: the observer watches steps.
   subroutine take(self, it, t, values, counts)
      class(passage_observer), intent(inout) :: self
      integer, intent(in) :: it
      real(wp), intent(in) :: t
      real(wp), intent(in), contiguous :: values(:, :)
      logical, intent(in), contiguous :: counts(:)
   end subroutine take

   !> Find the lanes that have left; called after every step.
   subroutine watch(self, istep, t, state)
      class(passage_observer), intent(inout) :: self
      integer(i8), intent(in) :: istep
      real(wp), intent(in) :: t
      type(lane_state), intent(inout) :: state
      integer(i8) :: at
      integer :: nleave

      if (state%nfailed /= self%nseen) call look_away_from(self, state%status /= 0)
      self%before(:self%nlook) = self%x(:self%nlook)
      call value_of(self, t, state)
      nleave = count_outside(self%nlook, self%x, self%request%low, self%request%high)
      if (self%bridges .or. nleave > 0) self%by = 0
      if (self%bridges .and. istep > 0) call cross_bridges(self, istep, nleave)
      if (nleave > 0) call see_off(self, istep, t, state)
      self%nseen = state%nfailed
      if (mod(istep, self%run%save_every) == 0) then
         at = 3*(istep/self%run%save_every + 1)
         self%counts(at) = self%counts(at) + self%nlook
      end if
      if (self%bridges .and. self%nlook > 0) call noise_on_value(self, t, state)
   end subroutine watch

   !> VEC How many of n values are outside or NaN.
   pure integer function count_outside(n, x, low, high)
      integer, intent(in) :: n
      real(wp), intent(in) :: x(n), low, high
      integer(i8) :: inside
      integer :: i

      inside = 0
      do i = 1, n
         inside = inside + merge(1_i8, 0_i8, x(i) > low .and. x(i) < high)
      end do
      count_outside = n - int(inside)
   end function count_outside

   !> Stop watching the lanes that have left or whose values are NaN, and keep their results.
   subroutine see_off(self, istep, t, state)
      class(passage_observer), intent(inout) :: self
      integer(i8), intent(in) :: istep
      real(wp), intent(in) :: t
      type(lane_state), intent(inout) :: state
      logical :: unknown(state%nlane), gone(state%nlane)
      integer :: i

      unknown = .false.
      gone = .false.
      do i = 1, self%nlook
         if (ieee_is_nan(self%x(i))) unknown(self%lanes(i)) = .true.
         if (self%x(i) <= self%request%low) self%by(i) = below
         if (self%x(i) >= self%request%high) self%by(i) = above
         if (self%by(i) == 0) cycle
         call note(self, istep, t, self%lanes(i), self%by(i), state)
         gone(self%lanes(i)) = .true.
      end do
      if (any(unknown)) call state%retire(unknown, int(nonfinite, i8), self%run%first_step + istep)
      if (self%request%absorbs .and. any(gone)) &
         call state%retire(gone, int(absorbed, i8), self%run%first_step + istep)
      call look_away_from(self, unknown .or. gone)
   end subroutine see_off

   !> Record the step, the end and the state with which a lane leaves.
   subroutine note(self, istep, t, lane, side, state)
      class(passage_observer), intent(inout) :: self
      integer(i8), intent(in) :: istep, side
      real(wp), intent(in) :: t
      integer, intent(in) :: lane
      type(lane_state), intent(in) :: state
      integer :: it

      it = int((istep + self%run%save_every - 1)/self%run%save_every)
      self%side(lane) = side
      self%step(lane) = self%run%first_step + istep
      self%left(lane, :) = [t, state%q(lane, :), state%p(lane, :)]
      self%counts(3*it + side) = self%counts(3*it + side) + 1
   end subroutine note

   !> Move the data of the remaining lanes together; padding repeats the last lane.
   subroutine look_away_from(self, leaves)
      class(passage_observer), intent(inout) :: self
      logical, intent(in) :: leaves(:)     !! (nlane)
      integer :: i, n

      n = 0
      do i = 1, self%nlook
         if (leaves(self%lanes(i))) cycle
         n = n + 1
         self%lanes(n) = self%lanes(i)
         self%x(n) = self%x(i)
         self%rate(n) = self%rate(i)
         self%path(n) = self%path(i)
      end do
      self%nlook = n
      if (n > 0) self%lanes(n + 1:) = self%lanes(n)
   end subroutine look_away_from

   !> The watched value in all lanes that are still watched.
   subroutine value_of(self, t, state)
      class(passage_observer), intent(inout) :: self
      real(wp), intent(in) :: t
      type(lane_state), intent(in) :: state
      integer :: n

      associate (i => self%request%values(1), nlane => state%nlane, ndof => state%ndof)
         if (i <= ndof) then
            call take_lanes(nlane, self%nlook, 1, self%lanes, self%looks_at_all(), state%q(:, i), self%x)
         else if (i <= 2*ndof) then
            call take_lanes(nlane, self%nlook, 1, self%lanes, self%looks_at_all(), state%p(:, i - ndof), self%x)
         else
            n = padded(self%nlook)
            if (n == 0) return
            call take_lanes(nlane, n, ndof, self%lanes, self%looks_at_all(), state%q, self%q)
            call take_lanes(nlane, n, ndof, self%lanes, self%looks_at_all(), state%p, self%p)
            call evaluate(self, t, n)
         end if
      end associate
   end subroutine value_of

   !> Energy or observable of n lanes.
   subroutine evaluate(self, t, n)
      class(passage_observer), intent(inout) :: self
      real(wp), intent(in) :: t
      integer, intent(in) :: n
      integer :: at

      associate (ndof => self%run%ndof, m => self%run%nnoise)
         at = self%request%values(1) - 2*ndof - merge(1, 0, self%run%has_value)
         if (at == 0) then
            self%w = 0
            self%w(:n) = 1
            call narrow(self%run%model%paths, self%lanes(:n))
            call self%run%model%value(n, ndof, m, t, self%w, self%q, self%p, self%x)
            call widen(self%run%model%paths)
         else
            call self%run%observables%evaluate(n, ndof, t, self%q, self%p, self%own)
            self%x(:n) = self%own((at - 1)*n + 1:at*n)
         end if
      end associate
   end subroutine evaluate

   !> Gather some lanes into x.
   pure subroutine take_lanes(nlane, n, ncolumn, lanes, in_place, x, taken)
      integer, intent(in) :: nlane, n, ncolumn, lanes(n)
      logical, intent(in) :: in_place                  !! the lanes are the first n
      real(wp), intent(in) :: x(nlane, ncolumn)
      real(wp), intent(out) :: taken(n, ncolumn)
      integer :: i, j

      do j = 1, ncolumn
         if (in_place) then
            taken(:, j) = x(:n, j)
         else
            do i = 1, n
               taken(i, j) = x(lanes(i), j)
            end do
         end if
      end do
   end subroutine take_lanes

   !> Find lanes that are inside before and after the step, and were outside in between.
   subroutine cross_bridges(self, istep, nleave)
      class(passage_observer), intent(inout) :: self
      integer(i8), intent(in) :: istep
      integer, intent(inout) :: nleave     !! lanes that leave in this step
      integer :: i, n

      n = self%nlook
      call bridge_chances(n, self%request%low, self%request%high, abs(self%run%step), self%rate, self%before, self%x, &
                          self%chance)
      if (.not. any(self%chance(:2*n) > 0)) return
      call deciding_numbers(n, self%run%seed, self%path, self%run%first_step + istep - 1, self%request%values(1), &
                            self%words, self%u)
      do i = 1, n
         if (self%u(i) >= self%chance(i) + self%chance(n + i)) cycle
         self%by(i) = merge(below, above, self%u(i) < self%chance(i))
         nleave = nleave + 1
         self%counts(3*self%run%ntime + 1) = self%counts(3*self%run%ntime + 1) + 1
      end do
   end subroutine cross_bridges

   !> s^2 at the state where the next step begins; and the path whose number decides, if paths share noises.
   subroutine noise_on_value(self, t, state)
      class(passage_observer), intent(inout) :: self
      real(wp), intent(in) :: t
      type(lane_state), intent(in) :: state
      integer :: k, n, at

      n = padded(self%nlook)
      associate (ndof => state%ndof, m => self%run%nnoise, i => self%request%values(1))
         call take_lanes(state%nlane, n, ndof, self%lanes, self%looks_at_all(), state%q, self%q)
         call take_lanes(state%nlane, n, ndof, self%lanes, self%looks_at_all(), state%p, self%p)
         self%rate = 0
         if (self%shares) self%path = 0
         self%w = 0
         call narrow(self%run%model%paths, self%lanes(:n))
         do k = 1, m
            self%w(k*n + 1:(k + 1)*n) = 1
            call self%run%model%gradient(n, ndof, m, t, self%w, self%q, self%p, self%hq, self%hp)
            self%w(k*n + 1:(k + 1)*n) = 0
            at = mod(i - 1, ndof)*n
            if (i <= ndof) then
               call add_noise(self, k, n, self%hp(at + 1:at + n))
            else
               call add_noise(self, k, n, self%hq(at + 1:at + n))
            end if
         end do
         call widen(self%run%model%paths)
      end associate
   end subroutine noise_on_value

   !> Add the contribution of noise k to s^2. If the noise is not common to all paths, the path's own number decides.
   subroutine add_noise(self, k, n, slope)
      type(passage_observer), intent(inout) :: self
      integer, intent(in) :: k, n
      real(wp), intent(in) :: slope(n)

      self%rate(:n) = self%rate(:n) + slope**2
      if (.not. self%shares .or. self%run%common(k)) return
      where (abs(slope) > 0) self%path(:n) = self%first + self%lanes(:n) - 1
   end subroutine add_noise

   !> Enter the paths of the block that have left into the list and the table.
   subroutine close_block(self, state)
      class(passage_observer), intent(inout) :: self
      type(lane_state), intent(in) :: state
      logical :: gone(state%nlane)
      integer :: lane

      gone = self%side > 0
      if (.not. any(gone)) return
      do lane = 1, self%nreal
         if (gone(lane)) call list(self, self%counts, self%singles, self%first + lane - 1, self%step(lane), &
                                   self%left(lane, :))
      end do
      call self%row(1, self%left, gone)
   end subroutine close_block

   subroutine clear(self, counts, singles)
      class(passage_observer), intent(in) :: self
      integer(i8), intent(out) :: counts(:)
      real(wp), intent(out) :: singles(:)
      integer :: at

      at = 3*self%run%ntime + 1
      counts(:at - 1) = 0
      counts(at) = merge(0, -1, self%bridges)
      counts(at + 1:) = -1
      singles = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine clear

   subroutine join(self, counts, singles, more_counts, more_singles)
      class(passage_observer), intent(in) :: self
      integer(i8), intent(inout) :: counts(:)
      real(wp), intent(inout) :: singles(:)
      integer(i8), intent(in) :: more_counts(:)
      real(wp), intent(in) :: more_singles(:)
      integer :: at, i

      at = 3*self%run%ntime + merge(1, 0, self%bridges)
      counts(:at) = counts(:at) + more_counts(:at)
      at = 3*self%run%ntime + 1
      do i = 1, self%nlist
         if (more_counts(at + i) < 0) exit
         call list(self, counts, singles, more_counts(at + i), more_counts(at + self%nlist + i), &
                   more_singles((i - 1)*self%ncolumn + 1:i*self%ncolumn))
      end do
   end subroutine join

   !> Keep the lost paths with the lowest indices, in order, whichever thread found them first.
   subroutine list(self, counts, singles, path, step, left)
      class(passage_observer), intent(in) :: self
      integer(i8), intent(inout) :: counts(:)
      real(wp), intent(inout) :: singles(:)
      integer(i8), intent(in) :: path, step
      real(wp), intent(in) :: left(:)
      integer :: at, i, n, zero, behind, middle

      n = self%ncolumn
      zero = 3*self%run%ntime + 1
      at = 1  ! the place after lower paths, or the first free one
      behind = self%nlist + 1
      do while (at < behind)
         middle = (at + behind)/2
         if (counts(zero + middle) >= 0 .and. counts(zero + middle) < path) then
            at = middle + 1
         else
            behind = middle
         end if
      end do
      if (at > self%nlist) return
      do i = self%nlist - 1, at, -1
         if (counts(zero + i) < 0) cycle
         counts(zero + i + 1) = counts(zero + i)
         counts(zero + self%nlist + i + 1) = counts(zero + self%nlist + i)
         singles(i*n + 1:(i + 1)*n) = singles((i - 1)*n + 1:i*n)
      end do
      counts(zero + at) = path
      counts(zero + self%nlist + at) = step
      singles((at - 1)*n + 1:at*n) = left
   end subroutine list

   integer(i8) function nanswer(self)
      class(passage_observer), intent(in) :: self

      nanswer = 2_i8*self%run%ntime
   end function nanswer

   subroutine answer(self, counts, sums, values, errors)
      class(passage_observer), intent(in) :: self
      integer(i8), intent(in) :: counts(:)
      real(wp), intent(in) :: sums(:)
      real(wp), intent(out) :: values(:), errors(:)
      real(wp) :: all_paths
      integer(i8) :: lost(2)
      integer :: it

      values = ieee_value(1.0_wp, ieee_quiet_nan)
      errors = values
      all_paths = real(sum(counts(1:3)), wp)
      if (all_paths < 0.5_wp) return
      lost = 0
      do it = 1, self%run%ntime
         lost = lost + counts(3*it - 2:3*it - 1)
         associate (share => values(2*it - 1:2*it))
            share = real(lost, wp)/all_paths
            errors(2*it - 1:2*it) = sqrt(share*(1 - share)/all_paths)
         end associate
      end do
   end subroutine answer

end module symsde_ensemble_observe_passage
