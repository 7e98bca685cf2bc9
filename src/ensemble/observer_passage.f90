! SPDX-License-Identifier: BSD-3-Clause
!> Paths that leave an interval, low < x < high: how many until when, through which end, and in what state.
!>
!> The value x is a coordinate, a momentum, the energy or an observable, looked at after every step. A path of which it
!> is not a number fails there: it is neither inside nor outside. Between two steps a path may
!> leave and come back. Where noise acts on a coordinate, x moves like a Brownian bridge between its values x_0 and
!> x_1, whose variance grows by s^2 = sum_k (dH_k/dp_i)^2 in unit time (for momenta dH_k/dq_i), and it has passed a
!> with probability exp(-2 (a - x_0)(a - x_1)/(s^2 h)); one number of the generator decides (Gobet, Stoch. Proc. Appl.
!> 87, 2000, 167). So the times are right to first order in h instead of sqrt(h). Where no noise acts on x there is no
!> such correction.
!>
!> counts: (below, above, still there) at each saved time, losses in the interval that ends there; then the losses
!> between two steps, -1 where there is no bridge; then path and absolute step of the lost paths with the lowest
!> indices, -1 where there are fewer. Numbers of single paths: time, q and p of these. The table has one row, over all
!> lost paths: time, q, p. Answers are the shares lost below and above until each saved time, of all paths, with
!> binomial errors.
module symsde_ensemble_observer_passage
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan, ieee_is_nan
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: error_type, raise, invalid_argument, nonfinite, absorbed
   use symsde_base_text, only: to_text
   use symsde_ensemble_streaming, only: streaming_observer, observer_request, observed_run
   use symsde_noise_philox, only: philox_lanes
   use symsde_step_state, only: lane_state
   implicit none
   private
   public :: passage_observer, new_passage_observer, most_lost

   integer(i4), parameter :: purpose_passage = 9  !! counter word of the numbers that decide
   integer, parameter :: most_listed = 1000, most_numbers = 100000
   integer, parameter :: below = 1, above = 2

   type, extends(streaming_observer) :: passage_observer
      integer :: nlist = 0                          !! lost paths that are listed
      logical :: bridges = .false.                  !! noise acts on the value
      integer(i8), allocatable :: side(:), step(:)  !! of each lane: 0 or the end that it left by; when (nlane)
      logical, allocatable :: outside(:)            !! lanes that are not looked at, or no longer (nlane)
      real(wp), allocatable :: left(:, :)           !! time, q and p when it left (nlane, 1 + 2 ndof)
      real(wp), allocatable :: x(:), rate(:)        !! value before the step, and s^2 there (nlane)
   contains
      procedure :: open_block
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

   !> Lost paths that are listed with their states, at most.
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
         end if
      end associate
   end subroutine new_passage_observer

   pure logical function watches_steps(self)
      class(passage_observer), intent(in) :: self

      watches_steps = .true.
   end function watches_steps

   subroutine open_block(self)
      class(passage_observer), intent(inout) :: self

      associate (n => self%run%nlane)
         if (.not. allocated(self%side)) &
            allocate (self%side(n), self%step(n), self%outside(n), self%left(n, self%ncolumn), self%x(n), self%rate(n))
      end associate
      self%side = 0
      self%outside = .false.
      self%rate = 0
   end subroutine open_block

   !> Steps tell it all: values of saved times may come later.
   subroutine take(self, it, t, values, counts)
      class(passage_observer), intent(inout) :: self
      integer, intent(in) :: it
      real(wp), intent(in) :: t
      real(wp), intent(in), contiguous :: values(:, :)
      logical, intent(in), contiguous :: counts(:)
   end subroutine take

   !> After every step: who has left.
   subroutine watch(self, istep, t, state)
      class(passage_observer), intent(inout) :: self
      integer(i8), intent(in) :: istep
      real(wp), intent(in) :: t
      type(lane_state), intent(inout) :: state
      real(wp) :: x(state%nlane)
      integer(i8) :: side(state%nlane), at
      integer :: bridged

      call value_of(self, t, state, x)
      call refuse_nan(self, istep, x, state)
      side = merge(below, 0, x <= self%request%low) + merge(above, 0, x >= self%request%high)
      bridged = 0
      if (self%bridges .and. istep > 0) call cross_bridges(self, istep, state, x, side, bridged)
      self%outside = self%outside .or. state%status /= 0
      call note(self, istep, t, state, side)
      if (self%bridges) self%counts(3*self%run%ntime + 1) = self%counts(3*self%run%ntime + 1) + bridged
      if (self%request%absorbs .and. any(side > 0 .and. .not. self%outside)) &
         call state%retire(side > 0 .and. .not. self%outside, int(absorbed, i8), self%run%first_step + istep)
      self%outside = self%outside .or. side > 0
      if (mod(istep, self%run%save_every) == 0) then
         at = 3*(istep/self%run%save_every + 1)
         self%counts(at) = self%counts(at) + count(.not. self%outside)
      end if
      self%x = x
      if (self%bridges .and. .not. all(self%outside)) call noise_on_value(self, t, state)
   end subroutine watch

   !> Paths that are looked at and whose value is not a number.
   subroutine refuse_nan(self, istep, x, state)
      class(passage_observer), intent(in) :: self
      integer(i8), intent(in) :: istep
      real(wp), intent(in) :: x(:)
      type(lane_state), intent(inout) :: state
      logical :: unknown(state%nlane)

      unknown = ieee_is_nan(x) .and. .not. self%outside .and. state%status == 0
      if (any(unknown)) call state%retire(unknown, int(nonfinite, i8), self%run%first_step + istep)
   end subroutine refuse_nan

   !> Keep what is known of the lanes that leave now.
   subroutine note(self, istep, t, state, side)
      class(passage_observer), intent(inout) :: self
      integer(i8), intent(in) :: istep, side(:)
      real(wp), intent(in) :: t
      type(lane_state), intent(in) :: state
      integer :: lane, it

      if (.not. any(side > 0)) return
      it = int((istep + self%run%save_every - 1)/self%run%save_every)
      do lane = 1, self%nreal
         if (side(lane) == 0 .or. self%outside(lane)) cycle
         self%side(lane) = side(lane)
         self%step(lane) = self%run%first_step + istep
         self%left(lane, :) = [t, state%q(lane, :), state%p(lane, :)]
         self%counts(3*it + side(lane)) = self%counts(3*it + side(lane)) + 1
      end do
   end subroutine note

   !> The value that is watched, in all lanes.
   subroutine value_of(self, t, state, x)
      class(passage_observer), intent(in) :: self
      real(wp), intent(in) :: t
      type(lane_state), intent(in) :: state
      real(wp), intent(out) :: x(state%nlane)
      real(wp), allocatable :: w(:, :), own(:, :)

      associate (n => state%ndof, i => self%request%values(1), model => self%run%model)
         if (i <= n) then
            x = state%q(:, i)
         else if (i <= 2*n) then
            x = state%p(:, i - n)
         else if (self%run%has_value .and. i == 2*n + 1) then
            allocate (w(state%nlane, 0:model%traits%nnoise), source=0.0_wp)
            w(:, 0) = 1
            call model%value(state%nlane, n, model%traits%nnoise, t, w, state%q, state%p, x)
         else
            allocate (own(state%nlane, self%run%observables%nvalue))
            call self%run%observables%evaluate(state%nlane, n, t, state%q, state%p, own)
            x = own(:, i - 2*n - merge(1, 0, self%run%has_value))
         end if
      end associate
   end subroutine value_of

   !> Lanes that are inside after the step as before, and were outside between.
   subroutine cross_bridges(self, istep, state, x, side, bridged)
      class(passage_observer), intent(in) :: self
      integer(i8), intent(in) :: istep
      type(lane_state), intent(in) :: state
      real(wp), intent(in) :: x(:)
      integer(i8), intent(inout) :: side(:)
      integer, intent(out) :: bridged
      real(wp) :: low(state%nlane), high(state%nlane), u, spread
      integer(i8) :: path(state%nlane), words(state%nlane, 4)
      integer :: lane

      low = 0
      high = 0
      bridged = 0
      do lane = 1, self%nreal
         if (side(lane) > 0 .or. self%outside(lane) .or. state%status(lane) /= 0) cycle
         spread = self%rate(lane)*abs(self%run%step)
         if (.not. spread > 0) cycle
         low(lane) = passed(self%x(lane) - self%request%low, x(lane) - self%request%low, spread)
         high(lane) = passed(self%request%high - self%x(lane), self%request%high - x(lane), spread)
      end do
      if (.not. any(low + high > 0)) return
      path = [(self%first + lane, lane=0, state%nlane - 1)]
      call philox_lanes(state%nlane, self%run%seed, path, self%run%first_step + istep - 1, &
                        int(self%request%values(1), i4), 0_i4, purpose_passage, words)
      do lane = 1, self%nreal
         u = (real(words(lane, 1), wp)*2.0_wp**32 + real(words(lane, 2), wp) + 0.5_wp)*2.0_wp**(-64)
         if (u >= low(lane) + high(lane)) cycle
         side(lane) = merge(below, above, u < low(lane))
         bridged = bridged + 1
      end do
   end subroutine cross_bridges

   !> Probability that a bridge between two points at distances a, b > 0 of an end has passed it; 0 below 1e-20.
   pure real(wp) function passed(a, b, spread)
      real(wp), intent(in) :: a, b, spread   !! spread: s^2 h

      passed = 0
      if (2*a*b < 46*spread) passed = exp(-2*a*b/spread)
   end function passed

   !> s^2 at the state where the next step begins.
   subroutine noise_on_value(self, t, state)
      class(passage_observer), intent(inout) :: self
      real(wp), intent(in) :: t
      type(lane_state), intent(in) :: state
      real(wp) :: w(state%nlane, 0:self%run%model%traits%nnoise)
      real(wp) :: hq(state%nlane, state%ndof), hp(state%nlane, state%ndof)
      integer :: k

      self%rate = 0
      w = 0
      associate (n => state%ndof, i => self%request%values(1), model => self%run%model)
         do k = 1, model%traits%nnoise
            w(:, k) = 1
            call model%gradient(state%nlane, n, model%traits%nnoise, t, w, state%q, state%p, hq, hp)
            w(:, k) = 0
            if (i <= n) then
               self%rate = self%rate + hp(:, i)**2
            else
               self%rate = self%rate + hq(:, i - n)**2
            end if
         end do
      end associate
   end subroutine noise_on_value

   !> The paths of the block that have left, into the list and the table.
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
      integer :: at, i, n, zero

      n = self%ncolumn
      zero = 3*self%run%ntime + 1
      do at = self%nlist, 1, -1  ! the first place behind lower paths
         if (counts(zero + at) >= 0 .and. counts(zero + at) < path) exit
      end do
      at = at + 1
      if (at > self%nlist) return
      do i = self%nlist - 1, at, -1
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

end module symsde_ensemble_observer_passage
