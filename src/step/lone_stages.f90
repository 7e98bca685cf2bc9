! SPDX-License-Identifier: BSD-3-Clause
!> Implicit stages for a path by itself where the step is mild: the fixed-point iteration of step/stage_iteration, with
!> the equations of step/stage_equations. A group that does not converge by it is left to step/stages.
!>
!> Slopes stand here as Hhat_q, which is -G, and C. Sums hold all of them: what is not known yet is zero, and what does
!> not count has the coefficient zero.
module symsde_step_lone_stages
   use symsde_base_kinds, only: wp
   use symsde_base_sincos, only: sincos_one
   use symsde_model_abstract, only: model_type, angle_terms
   use symsde_step_constant_mass, only: constant_mass
   use symsde_step_lone, only: lone_stepper
   use symsde_step_noise_shift, only: noise_shift
   use symsde_step_slopes, only: weigh_slopes, take_slopes
   use symsde_step_stage_iteration, only: sweep_verdict, judge_ahead, most_sweeps, stiff_rate, done
   use symsde_step_stage_plan, only: stage_plan, stage_group
   implicit none
   private
   public :: lone_stages

   integer, parameter :: most_ahead = 12  !! sweeps of a step that are asked of the model
   integer, parameter :: most_few = 4     !! stages that are taken in numbers alone

   !> A group that is iterated.
   type :: group_slot
      real(wp) :: too_slow = stiff_rate  !! contraction from which it is left
      integer :: nsweep = 1              !! how many the last step took: asked of the model at once
   end type group_slot

   type, extends(lone_stepper) :: lone_stages
      type(stage_plan) :: plan
      logical :: eliminated = .true.          !! the momenta are
      logical :: moves_with_p = .true.        !! kappa is h, not zero
      type(group_slot), allocatable :: slot(:)
      real(wp) :: too_stiff = stiff_rate      !! contraction from which the step is left
      type(constant_mass), allocatable :: mass  !! where it is not the identity
      type(noise_shift), allocatable :: shift   !! of p_n, where brackets are added; of one lane
      real(wp), private :: h = 0, kappa = 0     !! of the coefficients
      !> Coefficients of p and of Hhat_q in dq and dp; of p in stages; of Hhat_q and C in stages, in the first sweep and
      !> in others (nstage, nstage, 2).
      real(wp), private :: all = 0
      real(wp), allocatable, private :: v(:), alpha(:), r(:), b(:, :, :), a(:, :, :), abar(:, :, :)
      real(wp), allocatable, private :: base(:, :), times(:)  !! what Q_i has without slopes (n, nstage); when it is
      real(wp), allocatable, private :: f(:, :), c(:, :)      !! Hhat_q and C of the stages (n, nstage)
      real(wp), allocatable, private :: was(:, :, :)          !! -1 times these before a sweep (n, nstage, 2)
      real(wp), allocatable, private :: ahead(:, :, :)        !! Hhat_q after sweeps of the model (nstage, n, ..)
      real(wp), allocatable, dimension(:), private :: x, y, start, velocity, zero, shifted  !! (n)
   contains
      procedure :: take
      procedure :: asks
   end type lone_stages

contains

   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(lone_stages), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken

      if (.not. allocated(self%f)) call make_room(self)
      if (abs(h - self%h) > 0) call find_coefficients(self, h)
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

      associate (n => self%n, s => self%plan%nstage)
         allocate (self%r(s), self%v(s), self%alpha(s), self%times(s))
         allocate (self%b(s, s, 2), self%a(s, s, 2), self%abar(s, s, 2))
         allocate (self%f(n, s), self%c(n, s), self%was(n, s, 2), self%base(n, s))
         allocate (self%x(n), self%y(n), self%start(n), self%velocity(n), self%shifted(n))
         allocate (self%zero(n), source=0.0_wp)
         if (self%asks(self%model)) allocate (self%ahead(s, n, 0:most_ahead*s))
      end associate
   end subroutine make_room

   subroutine find_coefficients(self, h)
      type(lone_stages), intent(inout) :: self
      real(wp), intent(in) :: h

      self%h = h
      self%kappa = merge(h, 0.0_wp, self%moves_with_p)
      associate (plan => self%plan, kappa => self%kappa)
         self%all = kappa*sum(plan%alpha)
         self%r = kappa*plan%r
         self%v = -kappa*plan%v
         self%alpha = -plan%alpha
         self%b(:, :, 1) = -kappa*plan%first_b
         self%b(:, :, 2) = -kappa*plan%b
         self%a(:, :, 1) = plan%first_a
         self%a(:, :, 2) = plan%a
         self%abar(:, :, 1) = -plan%first_abar
         self%abar(:, :, 2) = -plan%abar
      end associate
   end subroutine find_coefficients

   !> Whether the model takes the sweeps of two degrees of freedom.
   pure logical function asks(self, model)
      class(lone_stages), intent(in) :: self
      class(model_type), intent(in) :: model

      asks = model%traits%has_lone_pair .and. self%eliminated .and. .not. allocated(self%mass) .and. &
             self%plan%nstage >= 2 .and. self%plan%nstage <= most_few
   end function asks

   !> The step where positions move with these momenta.
   subroutine take_plain(self, t, h, w, q, p, dq, dp, taken)
      type(lone_stages), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      integer :: k, sweeps, total, evaluations

      if (allocated(self%ahead)) then
         call take_pair(self, self%plan%nstage, t, h, w, q, p, self%r, self%b, self%v, self%alpha, self%base, &
                        self%ahead, dq, dp, taken)
         return
      end if
      total = 0
      evaluations = 0
      associate (plan => self%plan, n => self%n, s => self%plan%nstage)
         if (allocated(self%mass)) then
            call self%mass%look(self%model, 1, t, q)
            call self%mass%velocity(self%model, 1, t, q, p, self%velocity)
            call begin(n, s, self%r, self%all, q, self%velocity, t, h, plan%c, self%base, self%start, self%f, &
                       self%times)
         else
            call begin(n, s, self%r, self%all, q, p, t, h, plan%c, self%base, self%start, self%f, self%times)
         end if
         if (.not. self%eliminated) self%c = 0
         do k = 1, plan%ngroup
            call find_slopes(self, plan%group(k), self%slot(k), t, w, q, p, sweeps, taken)
            if (.not. taken) return
            evaluations = evaluations + sweeps*plan%group(k)%nmember
            total = total + sweeps
         end do
         if (allocated(self%mass)) then
            call weigh_slopes(n, s, 1, self%v, self%f, self%zero, self%y)
            call self%mass%add(self%model, 1, t, q, self%y, self%start, dq)
            evaluations = evaluations*(1 + self%mass%asked) + 2*self%mass%asked
         else if (self%eliminated) then
            call weigh_slopes(n, s, 1, self%v, self%f, self%start, dq)
         else
            call weigh_slopes(n, s, 1, self%v, self%f, self%start, self%y)
            call weigh_slopes(n, s, 1, plan%alpha, self%c, self%y, dq)
         end if
         call weigh_slopes(n, s, 1, self%alpha, self%f, self%zero, dp)
      end associate
      self%counters%gradients = self%counters%gradients + evaluations
      self%counters%iterations = self%counters%iterations + total
   end subroutine take_plain

   !> What stages and increments begin with, no slope, and when the stages are.
   pure subroutine begin(n, s, r, all, q, velocity, t, h, c, base, start, f, times)
      integer, intent(in) :: n, s
      real(wp), intent(in) :: r(s), all, q(n), velocity(n), t, h, c(s)
      real(wp), intent(out) :: base(n, s), start(n), f(n, s), times(s)
      integer :: i

      do i = 1, s
         base(:, i) = q + r(i)*velocity
         times(i) = t + c(i)*h
      end do
      start = all*velocity
      f = 0
   end subroutine begin

   !> The slopes of a group.
   subroutine find_slopes(self, group, slot, t, w, q, p, sweeps, found)
      type(lone_stages), intent(inout) :: self
      type(stage_group), intent(in) :: group
      type(group_slot), intent(inout) :: slot
      real(wp), intent(in) :: t, w(0:self%m), q(self%n), p(self%n)
      integer, intent(out) :: sweeps
      logical, intent(out) :: found
      real(wp) :: last

      associate (s => self%plan%nstage)
         if (self%model%traits%has_angle_terms .and. s <= most_few) then
            call swing(self, s, group, slot%too_slow, self%times, w, self%base, self%b, self%f, sweeps, last)
         else
            call iterate(self, group, slot%too_slow, t, w, q, p, sweeps, last)
         end if
      end associate
      found = abs(last - done) <= 0
   end subroutine find_slopes

   !> Two degrees of freedom by sweeps of the model.
   subroutine take_pair(self, s, t, h, w, q, p, r, b, v, alpha, base, f, dq, dp, taken)
      type(lone_stages), intent(inout) :: self
      integer, intent(in) :: s
      real(wp), intent(in) :: t, h, w(0:self%m), q(2), p(2)
      real(wp), intent(in) :: r(s), b(s, s, 2), v(s), alpha(s)
      real(wp), intent(inout) :: base(s, 2), f(s, 2, 0:most_ahead*s)  !! f: after sweep by sweep, of all groups
      real(wp), intent(out) :: dq(2), dp(2)
      logical, intent(out) :: taken
      real(wp) :: times(most_few)
      integer :: i, k, sweep, sweeps, evaluations

      do i = 1, s
         base(i, 1) = q(1) + r(i)*p(1)
         base(i, 2) = q(2) + r(i)*p(2)
         f(i, 1, 0) = 0
         f(i, 2, 0) = 0
         times(i) = t + self%plan%c(i)*h
      end do
      sweeps = 0
      evaluations = 0
      do k = 1, self%plan%ngroup
         associate (group => self%plan%group(k))
            call ask_model(self, s, group, self%slot(k), w, times, base, b, f(1, 1, sweeps), sweep, taken)
            if (.not. taken) return
            sweeps = sweeps + sweep
            evaluations = evaluations + sweep*group%nmember
         end associate
      end do
      dq(1) = (self%all*p(1))  ! in parentheses: not contracted with what follows
      dq(2) = (self%all*p(2))
      dp = 0
      !GCC$ novector  ! sums in order, contracted as in lanes
      do i = 1, s
         dq(1) = dq(1) + v(i)*f(i, 1, sweeps)
         dq(2) = dq(2) + v(i)*f(i, 2, sweeps)
         dp(1) = dp(1) + alpha(i)*f(i, 1, sweeps)
         dp(2) = dp(2) + alpha(i)*f(i, 2, sweeps)
      end do
      self%counters%gradients = self%counters%gradients + evaluations
      self%counters%iterations = self%counters%iterations + sweeps
   end subroutine take_pair

   !> The slopes of a group: as many sweeps as the step before took, which mostly is enough, then one by one.
   subroutine ask_model(self, s, group, slot, w, times, base, b, f, sweep, found)
      type(lone_stages), intent(in) :: self
      integer, intent(in) :: s
      type(stage_group), intent(in) :: group
      type(group_slot), intent(inout) :: slot
      real(wp), intent(in) :: w(0:self%m), times(s), base(s, 2), b(s, s, 2)
      real(wp), intent(inout) :: f(s, 2, 0:most_ahead)
      integer, intent(out) :: sweep  !! that ended it
      logical, intent(out) :: found
      real(wp) :: last, change(most_ahead), extent(most_ahead)
      integer :: first

      last = 0
      first = 1
      do while (last >= 0 .and. slot%nsweep <= most_ahead)
         call self%model%sweeps(self%m, s, group%stage(1), group%stage(group%nmember), first, slot%nsweep, times, w, &
                                base, b, most_ahead, f, change, extent)
         call judge_ahead(first, slot%nsweep, slot%too_slow, self%too_stiff, most_ahead, change, extent, last, sweep)
         first = slot%nsweep + 1
         if (last >= 0 .and. group%explicit) then
            sweep = 1
            last = done
         else if (last >= 0) then
            slot%nsweep = first
         end if
      end do
      slot%nsweep = min(sweep, most_ahead)
      found = abs(last - done) <= 0
   end subroutine ask_model

   !> Where all is an angle, in numbers.
   subroutine swing(self, s, group, too_slow, t, w, base, b, f, sweep, last)
      type(lone_stages), intent(in) :: self
      integer, intent(in) :: s
      type(stage_group), intent(in) :: group
      real(wp), intent(in) :: too_slow, t(s), w(0:self%m), base(s), b(s, s, 2)
      real(wp), intent(inout) :: f(s)
      integer, intent(out) :: sweep
      real(wp), intent(out) :: last
      type(angle_terms) :: terms(most_few)
      real(wp) :: x, sine, cosine, force, change, extent
      integer :: i, j, k

      do k = 1, group%nmember
         i = group%stage(k)
         call self%find_terms(t(i), w, terms(i))
      end do
      last = 0
      sweep = 0
      do while (last >= 0 .and. sweep < most_sweeps)
         sweep = sweep + 1
         change = 0
         extent = 0
         do k = 1, group%nmember
            i = group%stage(k)
            x = base(i)
            !GCC$ novector  ! sums in order, contracted as in lanes
            do j = i, s
               x = x + b(j, i, min(sweep, 2))*f(j)
            end do
            !GCC$ novector
            do j = 1, i - 1
               x = x + b(j, i, min(sweep, 2))*f(j)
            end do
            sine = sincos_one(x, cosine)
            force = terms(i)%a*sine + (terms(i)%b*cosine + (terms(i)%c*x + terms(i)%d))  ! as force_at of step/lone
            change = max(change, abs(force - f(i))) + 0*(change + force)  ! NaN stays
            extent = max(extent, abs(force))
            f(i) = force
         end do
         last = sweep_verdict(sweep, too_slow, self%too_stiff, change, extent, last)
         if (group%explicit) last = done
      end do
   end subroutine swing

   !> By gradients of the model.
   subroutine iterate(self, group, too_slow, t, w, q, p, sweep, last)
      type(lone_stages), intent(inout) :: self
      type(stage_group), intent(in) :: group
      real(wp), intent(in) :: too_slow, t, w(0:self%m), q(self%n), p(self%n)
      integer, intent(out) :: sweep
      real(wp), intent(out) :: last
      real(wp) :: change, extent
      integer :: i

      last = 0
      sweep = 0
      associate (n => self%n, s => self%plan%nstage, f => self%f, c => self%c, first => group%stage(1), &
                 final => group%stage(group%nmember))
         do while (last >= 0 .and. sweep < most_sweeps)
            sweep = sweep + 1
            if (self%eliminated .and. .not. allocated(self%mass)) then
               call sweep_positions(self%model, n, s, self%m, first, final, self%times, w, p, &
                                    self%b(1, 1, min(sweep, 2)), self%base, self%x, f)
            else
               do i = first, final
                  call place(self, i, min(sweep, 2), t, q, p)
                  call evaluate(self, i, w, p)
               end do
            end if
            change = 0
            extent = 0
            call take_slopes(n*group%nmember, sweep == 1, f(1, first), self%was(1, first, 1), change, extent)
            if (.not. self%eliminated) &
               call take_slopes(n*group%nmember, sweep == 1, c(1, first), self%was(1, first, 2), change, extent)
            last = sweep_verdict(sweep, too_slow, self%too_stiff, change, extent, last)
            if (group%explicit) last = done
         end do
      end associate
   end subroutine iterate

   !> A sweep where momenta are eliminated by an identity mass.
   subroutine sweep_positions(model, n, s, m, first, final, times, w, p, b, base, x, f)
      class(model_type), intent(in) :: model
      integer, intent(in) :: n, s, m, first, final
      real(wp), intent(in) :: times(s), w(0:m), p(n), b(s, s), base(n, s)
      real(wp), intent(inout) :: x(n), f(n, s)
      integer :: i

      do i = first, final
         call weigh_slopes(n, s, i, b(1, i), f, base(1, i), x)
         call model%gradient(1, n, m, times(i), w, x, p, hq=f(1, i))
      end do
   end subroutine sweep_positions

   !> Hhat_q, and C, at the point of stage i.
   subroutine evaluate(self, i, w, p)
      type(lone_stages), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: w(0:self%m), p(self%n)

      associate (n => self%n, t => self%times(i), f => self%f(:, i), c => self%c(:, i))
         if (self%eliminated) then
            call self%model%gradient(1, n, self%m, t, w, self%x, p, hq=f)
         else
            call self%model%gradient(1, n, self%m, t, w, self%x, self%y, hq=f, hp=c)
            c = c - self%kappa*self%y
         end if
      end associate
   end subroutine evaluate

   !> (Q_i, P_i) in x and y; where momenta are eliminated by a mass, Q_i in x.
   subroutine place(self, i, sweep, t, q, p)
      type(lone_stages), intent(inout) :: self
      integer, intent(in) :: i, sweep  !! the stage; 1: the first sweep, 2: another one
      real(wp), intent(in) :: t, q(self%n), p(self%n)

      associate (n => self%n, s => self%plan%nstage, x => self%x, y => self%y)
         if (allocated(self%mass)) then
            call weigh_slopes(n, s, i, self%b(:, i, sweep), self%f, self%zero, y)
            call self%mass%add(self%model, 1, t, q, y, self%base(:, i), x)
         else
            call weigh_slopes(n, s, i, self%b(:, i, sweep), self%f, self%base(:, i), y)
            call weigh_slopes(n, s, i, self%a(:, i, sweep), self%c, y, x)
            call weigh_slopes(n, s, i, self%abar(:, i, sweep), self%f, p, y)
         end if
      end associate
   end subroutine place

end module symsde_step_lone_stages
