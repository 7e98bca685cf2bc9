! SPDX-License-Identifier: BSD-3-Clause
!> Implicit stages for a path by itself, where the momenta are eliminated and the step is mild: the fixed-point
!> iteration of step/stage_iteration, with the sums of step/stage_equations. A group that does not converge by it
!> is left to step/stages.
module symsde_step_lone_stages
   use symsde_base_kinds, only: wp
   use symsde_model_abstract, only: angle_terms
   use symsde_step_constant_mass, only: constant_mass
   use symsde_step_lone, only: lone_stepper
   use symsde_step_noise_shift, only: noise_shift
   use symsde_step_slopes, only: add_slopes, slope_sum, find_sum, add_sum, add_pair, take_slopes
   use symsde_step_stage_iteration, only: sweep_verdict, judge_ahead, most_sweeps, stiff_rate, done
   use symsde_step_stage_plan, only: stage_plan, stage_group
   implicit none
   private
   public :: lone_stages

   integer, parameter :: most_ahead = 12  !! sweeps of a step that are asked of the model
   integer, parameter :: most_swung = 4   !! stages of an angle, in numbers alone

   !> Two stages and two degrees of freedom: the model takes the sweeps.
   type :: stage_pair
      integer :: nsweep = 3                   !! how many the last step took: asked for at once
      real(wp) :: r(2) = 0, c_first = 0, c(2, 2) = 0  !! what its stages are put together from
      real(wp) :: all = 0, v(2) = 0           !! and its increments: weights of p and of slopes in dq
      real(wp) :: slope(most_ahead, 2, 2) = 0
   end type stage_pair

   !> Stages of an angle: what they and the increments are put together from.
   type :: angle_stages
      real(wp) :: r(most_swung) = 0, all = 0  !! weights of p in the stages and in dq
      type(slope_sum) :: dq, dp
   end type angle_stages

   type, extends(lone_stepper) :: lone_stages
      type(stage_plan) :: plan
      real(wp), allocatable :: too_slow(:)    !! contraction from which a group is left (ngroup)
      real(wp) :: too_stiff = stiff_rate      !! contraction from which the step is
      type(constant_mass), allocatable :: mass  !! where it is not the identity
      real(wp), allocatable, dimension(:), private :: velocity, moved, nothing  !! M^-1 p; weighed slopes; zero (n)
      type(noise_shift), allocatable :: shift   !! of p_n, where brackets are added; of one lane
      real(wp), allocatable, private :: shifted(:)           !! p_n (n)
      type(slope_sum), allocatable, private :: sums(:, :)    !! of the first sweep, and of the others (nstage, 2)
      real(wp), private :: h = 0                             !! for which the sums are
      real(wp), allocatable, private :: base(:, :), g(:, :)  !! what Q_i has without slopes; slopes (n, nstage)
      real(wp), allocatable, dimension(:), private :: x, f, start  !! (n)
      type(stage_pair), allocatable, private :: pair               !! where the step is one of these
      type(angle_stages), allocatable, private :: angle            !! where the step is one of these
   contains
      procedure :: take
      procedure :: is_pair
   end type lone_stages

contains

   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(lone_stages), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken

      if (.not. allocated(self%g)) call make_room(self)
      if (abs(h - self%h) > 0) call find_sums(self, h)
      if (.not. allocated(self%shift)) then
         call take_plain(self, t, h, w, q, p, dq, dp, taken)
         return
      end if
      self%x = q
      self%shifted = p
      call self%shift%weigh(-0.5_wp, 1.0_wp, self%step)
      call self%shift%add(self%model, t, 1.0_wp, self%x, self%shifted)
      call take_plain(self, t, h, w, q, self%shifted, dq, dp, taken)
      if (taken) self%counters%gradients = self%counters%gradients + self%shift%asked
      self%shift%asked = 0
   end subroutine take

   subroutine make_room(self)
      type(lone_stages), intent(inout) :: self

      allocate (self%g(self%n, self%plan%nstage), self%base(self%n, self%plan%nstage))
      allocate (self%x(self%n), self%f(self%n), self%start(self%n), self%shifted(self%n))
      allocate (self%sums(self%plan%nstage, 2))
      if (.not. allocated(self%mass)) return
      allocate (self%velocity(self%n), self%moved(self%n))
      allocate (self%nothing(self%n), source=0.0_wp)
   end subroutine make_room

   !> The step where positions move with these momenta.
   subroutine take_plain(self, t, h, w, q, p, dq, dp, taken)
      type(lone_stages), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      integer :: k, sweeps, evaluations

      if (allocated(self%pair)) then
         call take_pair(self, self%pair, t, h, w, q, p, dq, dp, taken)
         return
      else if (allocated(self%angle)) then
         call swing(self, self%angle, t, h, w, q(1), p(1), dq(1), dp(1), taken)
         return
      end if
      sweeps = 0
      evaluations = 0
      taken = .true.
      associate (plan => self%plan, n => self%n, s => self%plan%nstage, start => self%start)
         if (allocated(self%mass)) then
            call self%mass%look(self%model, 1, t, q)
            call self%mass%velocity(self%model, 1, t, q, p, self%velocity)
            call find_bases(self, h, q, self%velocity)
         else
            call find_bases(self, h, q, p)
         end if
         do k = 1, plan%ngroup
            call iterate(self, plan%group(k), self%too_slow(k), t, h, w, q, p, sweeps, evaluations, taken)
            if (.not. taken) return
         end do
         if (allocated(self%mass)) then
            start = h*sum(plan%alpha)*self%velocity
            call add_slopes(n, s, h, plan%v, self%g, self%nothing, self%moved)
            call self%mass%add(self%model, 1, t, q, self%moved, start, dq)
            evaluations = evaluations + 2*self%mass%asked
         else
            start = h*sum(plan%alpha)*p
            call add_slopes(n, s, h, plan%v, self%g, start, dq)
         end if
         start = 0
         call add_slopes(n, s, 1.0_wp, plan%alpha, self%g, start, dp)
      end associate
      self%counters%gradients = self%counters%gradients + evaluations
      self%counters%iterations = self%counters%iterations + sweeps
   end subroutine take_plain

   !> What the stages have without slopes.
   subroutine find_bases(self, h, q, velocity)
      type(lone_stages), intent(inout) :: self
      real(wp), intent(in) :: h, q(self%n), velocity(self%n)
      integer :: i

      do i = 1, self%plan%nstage
         call add_slopes(self%n, 1, h, self%plan%r(i:i), velocity, q, self%base(:, i))
      end do
   end subroutine find_bases

   !> What the places of the stages are put together from.
   subroutine find_sums(self, h)
      type(lone_stages), intent(inout) :: self
      real(wp), intent(in) :: h
      integer :: i

      self%h = h
      associate (plan => self%plan, s => self%plan%nstage)
         do i = 1, s
            call find_sum(s, h, plan%first_b(:, i), self%sums(i, 1))
            call find_sum(s, h, plan%b(:, i), self%sums(i, 2))
         end do
         if (self%model%traits%has_angle_terms .and. s <= most_swung) then
            self%angle = angle_stages(all=h*sum(plan%alpha))
            self%angle%r(:s) = h*plan%r
            call find_sum(s, h, plan%v, self%angle%dq)
            call find_sum(s, 1.0_wp, plan%alpha, self%angle%dp)
         end if
         if (.not. self%is_pair(self%n)) return
         self%pair = stage_pair(r=h*plan%r, c_first=self%sums(2, 1)%c(1), all=h*sum(plan%alpha), v=h*plan%v)
         self%pair%c(:, 1) = self%sums(1, 2)%c(:2)
         self%pair%c(:, 2) = self%sums(2, 2)%c(:2)
      end associate
   end subroutine find_sums

   !> Whether the model takes the sweeps: two stages that wait for each other, each for both, the second one at once.
   pure logical function is_pair(self, n)
      class(lone_stages), intent(in) :: self
      integer, intent(in) :: n  !! degrees of freedom

      is_pair = n == 2 .and. self%plan%nstage == 2 .and. self%plan%ngroup == 1 .and. .not. allocated(self%mass)
      if (.not. is_pair) return
      associate (plan => self%plan)
         is_pair = all(count(abs(plan%first_b) > 0, 1) == [0, 1]) .and. all(count(abs(plan%b) > 0, 1) == 2)
      end associate
   end function is_pair

   !> A step of two stages by sweeps of the model: as many as the step before took, which mostly is enough, then one by
   !> one.
   subroutine take_pair(self, pair, t, h, w, q, p, dq, dp, taken)
      class(lone_stages), intent(inout) :: self
      type(stage_pair), intent(inout) :: pair
      real(wp), intent(in) :: t, h, w(0:self%m), q(2), p(2)
      real(wp), intent(out) :: dq(2), dp(2)
      logical, intent(out) :: taken
      real(wp) :: last, times(2), start(2)
      integer :: first, sweep

      times(1) = t + self%plan%c(1)*h
      times(2) = t + self%plan%c(2)*h
      start(1) = pair%all*p(1)
      start(2) = pair%all*p(2)
      last = 0
      first = 1
      do while (last >= 0 .and. pair%nsweep <= most_ahead)
         call self%model%sweeps(self%m, first, pair%nsweep, times, w, q, p, pair%r, pair%c_first, pair%c, most_ahead, &
                                pair%slope)
         call judge_ahead(first, pair%nsweep, self%too_slow(1), stiff_rate, most_ahead, pair%slope, last, sweep)
         first = pair%nsweep + 1
         if (last >= 0) pair%nsweep = first
      end do
      pair%nsweep = min(sweep, most_ahead)
      taken = abs(last - done) <= 0
      if (.not. taken) return
      call add_pair(pair%v, self%plan%alpha, most_ahead, sweep, pair%slope, start, dq, dp)
      self%counters%gradients = self%counters%gradients + 2*sweep
      self%counters%iterations = self%counters%iterations + sweep
   end subroutine take_pair

   !> A step of an angle, without passes over one number.
   subroutine swing(self, angle, t, h, w, q, p, dq, dp, taken)
      type(lone_stages), intent(inout) :: self
      type(angle_stages), intent(in) :: angle
      real(wp), intent(in) :: t, h, w(0:self%m), q, p
      real(wp), intent(out) :: dq, dp
      logical, intent(out) :: taken
      type(angle_terms) :: terms(most_swung)
      real(wp) :: g(most_swung), f, slope, change, extent, last
      integer :: i, j, k, sweep, sweeps, evaluations

      do i = 1, self%plan%nstage
         call self%find_terms(t + self%plan%c(i)*h, w, terms(i))
      end do
      g = 0  ! the first sweep of a group finds all of a slope as its change
      sweeps = 0
      evaluations = 0
      do k = 1, self%plan%ngroup
         associate (group => self%plan%group(k))
            last = 0
            sweep = 0
            do while (last >= 0 .and. sweep < most_sweeps)
               sweep = sweep + 1
               change = 0
               extent = 0
               do j = 1, group%nmember
                  i = group%stage(j)
                  f = self%force_at(terms(i), t, w, weighed(self%sums(i, min(sweep, 2)), g, q + angle%r(i)*p), p, slope)
                  change = max(change, abs(f + g(i))) + 0*(change + f)  ! NaN stays
                  extent = max(extent, abs(f))
                  g(i) = -f
               end do
               if (group%explicit) exit
               last = sweep_verdict(sweep, self%too_slow(k), self%too_stiff, change, extent, last)
            end do
            sweeps = sweeps + sweep
            evaluations = evaluations + sweep*group%nmember
            taken = abs(last - done) <= 0 .or. group%explicit
         end associate
         if (.not. taken) return
      end do
      dq = weighed(angle%dq, g, angle%all*p)
      dp = weighed(angle%dp, g, 0.0_wp)
      self%counters%gradients = self%counters%gradients + evaluations
      self%counters%iterations = self%counters%iterations + sweeps
   end subroutine swing

   !> add_sum of one number.
   pure real(wp) function weighed(sum, g, start)
      type(slope_sum), intent(in) :: sum
      real(wp), intent(in) :: g(most_swung), start

      associate (c => sum%c, i => sum%used)
         select case (sum%m)
         case (0)
            weighed = start
         case (1)
            weighed = start + c(1)*g(i(1))
         case (2)
            weighed = start + (c(1)*g(i(1)) + c(2)*g(i(2)))
         case default
            weighed = start + (c(1)*g(i(1)) + c(2)*g(i(2)) + c(3)*g(i(3)))
            if (sum%m > 3) weighed = weighed + c(4)*g(i(4))
         end select
      end associate
   end function weighed

   !> The slopes of a group.
   subroutine iterate(self, group, too_slow, t, h, w, q, p, sweeps, evaluations, taken)
      type(lone_stages), intent(inout) :: self
      type(stage_group), intent(in) :: group
      real(wp), intent(in) :: too_slow, t, h, w(0:self%m), q(self%n), p(self%n)
      integer, intent(inout) :: sweeps, evaluations
      logical, intent(out) :: taken
      real(wp) :: change, extent, last
      integer :: sweep, k, i

      last = 0
      sweep = 0
      do while (last >= 0 .and. sweep < most_sweeps)
         sweep = sweep + 1
         change = 0
         extent = 0
         do k = 1, group%nmember
            i = group%stage(k)
            associate (plan => self%plan, n => self%n, x => self%x, f => self%f)
               if (allocated(self%mass)) then
                  call weigh(self, i, sweep, h, self%nothing, self%moved)
                  call self%mass%add(self%model, 1, t, q, self%moved, self%base(1, i), x)
               else
                  call weigh(self, i, sweep, h, self%base(1, i), x)
               end if
               call self%model%gradient(1, n, self%m, t + plan%c(i)*h, w, x, p, hq=f)
               call take_slopes(n, sweep == 1, f, self%g(:, i), change, extent)
            end associate
         end do
         if (group%explicit) exit
         last = sweep_verdict(sweep, too_slow, self%too_stiff, change, extent, last)
      end do
      sweeps = sweeps + sweep
      evaluations = evaluations + sweep*group%nmember
      if (allocated(self%mass)) evaluations = evaluations + sweep*group%nmember*self%mass%asked
      taken = abs(last - done) <= 0 .or. group%explicit
   end subroutine iterate

   !> start + h sum_k b_k G_k of stage i in this sweep.
   subroutine weigh(self, i, sweep, h, start, total)
      type(lone_stages), intent(in) :: self
      integer, intent(in) :: i, sweep
      real(wp), intent(in) :: h, start(self%n)
      real(wp), intent(out) :: total(self%n)

      associate (plan => self%plan, n => self%n, sum => self%sums(i, min(sweep, 2)))
         if (sum%m <= 3) then
            call add_sum(n, plan%nstage, sum, self%g, start, total)
         else if (sweep == 1) then
            call add_slopes(n, plan%nstage, h, plan%first_b(1, i), self%g, start, total)
         else
            call add_slopes(n, plan%nstage, h, plan%b(1, i), self%g, start, total)
         end if
      end associate
   end subroutine weigh

end module symsde_step_lone_stages
