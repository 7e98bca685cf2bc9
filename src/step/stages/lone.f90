! SPDX-License-Identifier: BSD-3-Clause
!> Implicit stages for a path by itself: the fixed-point iteration of step/stages/fixed_point, with the equations of
!> step/stages/equations. A group that does not converge by it goes to step/stages/lone_newton, or is left to
!> step/stages/stepper.
!>
!> Slopes stand here as Hhat_q, which is -G, and C. Sums hold all of them: what is not known yet is zero, and what does
!> not count has the coefficient zero.
module symsde_step_stages_lone
   use symsde_base_kinds, only: wp
   use symsde_base_sincos, only: sincos_one
   use symsde_model_abstract, only: model_type, angle_terms
   use symsde_step_hamiltonian_mass, only: constant_mass
   use symsde_step_lone, only: lone_stepper
   use symsde_step_stages_lone_newton, only: lone_stage_newton
   use symsde_step_hamiltonian_noise_shift, only: noise_shift
   use symsde_step_stages_slope_sums, only: weigh_slopes
   use symsde_solve_fixed_point, only: take_alone, sweep_verdict, judge_ahead, most_sweeps, stiff_rate, done
   use symsde_step_stages_groups, only: stage_plan, stage_group
   implicit none
   private
   public :: lone_stages

   integer, parameter :: most_ahead = 24  !! sweeps of a group: enough for stiff_rate
   integer, parameter :: most_stiff = 4   !! paths whose stiff steps are taken one by one: five take as long as a block
   integer, parameter :: most_few = 4     !! stages that are taken in numbers alone, as sweeps of a model want them

   !> A group that is iterated.
   type :: group_slot
      real(wp) :: too_slow = stiff_rate  !! contraction from which it is left
      integer :: i1 = 1, i2 = 1          !! its stages
      logical :: explicit = .false.
      integer :: nsweep = 1              !! how many the last step took: asked for at once
      type(lone_stage_newton), allocatable :: newton  !! of stiff steps, if not left to others
   end type group_slot

   !> What one or two degrees of freedom have in numbers: the coefficients below, base and times, and Hhat_q of all
   !> stages after sweep by sweep of one group after the other.
   type :: few_numbers
      real(wp), dimension(most_few) :: c = 0, r = 0, v = 0, alpha = 0, times = 0
      real(wp) :: b(most_few, most_few, 2) = 0, base(most_few, 2) = 0, f(most_few, 2, 0:most_ahead*most_few) = 0
      type(angle_terms) :: terms(most_few)
   end type few_numbers

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
      type(few_numbers), allocatable, private :: few
      real(wp), allocatable, dimension(:), private :: x, y, start, velocity, zero, shifted  !! (n)
   contains
      procedure :: take
      procedure :: in_numbers
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
         if (self%in_numbers(self%model)) allocate (self%few)
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
         if (.not. allocated(self%few)) return
         associate (few => self%few, s => plan%nstage)
            few%c(:s) = plan%c
            few%r(:s) = self%r
            few%v(:s) = self%v
            few%alpha(:s) = self%alpha
            few%b(:s, :s, :) = self%b
         end associate
      end associate
   end subroutine find_coefficients

   !> Whether a path is taken in numbers: of an angle, or by sweeps of the model.
   pure logical function in_numbers(self, model)
      class(lone_stages), intent(in) :: self
      class(model_type), intent(in) :: model

      associate (s => self%plan%nstage, t => model%traits)
         in_numbers = (t%has_angle_terms .or. (t%ndof <= 2 .and. s >= 2)) .and. s <= most_few .and. &
                      self%eliminated .and. .not. allocated(self%mass)
      end associate
   end function in_numbers

   !> The step where positions move with these momenta.
   subroutine take_plain(self, t, h, w, q, p, dq, dp, taken)
      type(lone_stages), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      real(wp) :: verdict
      integer :: k, sweeps, total, evaluations

      if (allocated(self%few)) then
         call take_few(self, self%few, self%plan%nstage, self%n, t, h, w, q, p, dq, dp, taken)
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
            call iterate(self, plan%group(k), self%slot(k)%too_slow, t, w, q, p, sweeps, verdict)
            evaluations = evaluations + sweeps*plan%group(k)%nmember
            total = total + sweeps
            taken = abs(verdict - done) <= 0
            if (.not. taken) call solve_group(self, plan%group(k), self%slot(k), h, w, q, p, taken)
            if (.not. taken) return
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

   !> The slopes of a group that sweeps have not found.
   subroutine solve_group(self, group, slot, h, w, q, p, found)
      type(lone_stages), intent(inout) :: self
      type(stage_group), intent(in) :: group
      type(group_slot), intent(inout) :: slot
      real(wp), intent(in) :: h, w(0:self%m), q(self%n), p(self%n)
      logical, intent(out) :: found
      integer :: i, iterations

      found = allocated(slot%newton) .and. self%npath <= most_stiff
      if (.not. found) return
      associate (n => self%n, first => slot%i1, final => slot%i2)
         self%f(:, first:final) = 0
         do i = first, final
            call weigh_slopes(n, self%plan%nstage, i, self%b(1, i, 2), self%f, self%base(1, i), self%was(1, i, 1))
         end do
         call slot%newton%solve(self%model, group, n, self%m, h, self%times(first), w, q, p, self%was(1, first, 1), &
                                self%f(1, first), iterations)
      end associate
      found = iterations > 0
      associate (c => self%counters, s => group%nmember)
         c%gradients = c%gradients + iterations*s
         if (.not. allocated(group%inverse)) c%gradients = c%gradients + s
         c%hessians = c%hessians + iterations*s
         c%iterations = c%iterations + iterations
         c%solves = c%solves + iterations
      end associate
   end subroutine solve_group

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

   !> One or two degrees of freedom in numbers.
   subroutine take_few(self, few, s, n, t, h, w, q, p, dq, dp, taken)
      type(lone_stages), intent(inout) :: self
      type(few_numbers), intent(inout) :: few
      integer, intent(in) :: s, n
      real(wp), intent(in) :: t, h, w(0:self%m), q(n), p(n)
      real(wp), intent(out) :: dq(n), dp(n)
      logical, intent(out) :: taken
      real(wp) :: moved, kicked, verdict
      integer :: i, k, g, sweep, sweeps, evaluations, total

      do i = 1, s
         few%times(i) = t + few%c(i)*h
      end do
      do k = 1, n
         !GCC$ novector  ! few numbers
         do i = 1, s
            few%base(i, k) = q(k) + few%r(i)*p(k)
         end do
      end do
      sweeps = 0
      total = 0
      evaluations = 0
      do g = 1, size(self%slot)
         associate (slot => self%slot(g))
            call ask(self, few, s, slot, w, p, sweeps, sweep, verdict)
            evaluations = evaluations + sweep*(slot%i2 - slot%i1 + 1)
            total = total + sweep
            if (verdict < done) then
               call solve_few(self, few, g, h, w, q, p, sweeps, taken)
               sweep = 1
            else
               taken = verdict < 0
            end if
            if (.not. taken) return
            sweeps = sweeps + sweep
         end associate
      end do
      do k = 1, n
         moved = (self%all*p(k))  ! in parentheses: not contracted with what follows
         kicked = 0
         !GCC$ novector  ! sums in order, contracted as in lanes
         do i = 1, s
            moved = moved + few%v(i)*few%f(i, k, sweeps)
            kicked = kicked + few%alpha(i)*few%f(i, k, sweeps)
         end do
         dq(k) = moved
         dp(k) = kicked
      end do
      self%counters%gradients = self%counters%gradients + evaluations
      self%counters%iterations = self%counters%iterations + total
   end subroutine take_few

   !> The slopes of a group that sweeps have not found, in the place of its first sweep.
   subroutine solve_few(self, few, g, h, w, q, p, before, found)
      type(lone_stages), intent(inout) :: self
      type(few_numbers), intent(inout) :: few
      integer, intent(in) :: g       !! the group
      real(wp), intent(in) :: h, w(0:self%m), q(self%n), p(self%n)
      integer, intent(in) :: before  !! sweeps of other groups
      logical, intent(out) :: found

      integer :: i, k

      associate (n => self%n, s => self%plan%nstage)
         do i = 1, s
            self%times(i) = few%times(i)
            do k = 1, n
               self%base(k, i) = few%base(i, k)
               self%f(k, i) = few%f(i, k, before)
            end do
         end do
         call solve_group(self, self%plan%group(g), self%slot(g), h, w, q, p, found)
         do i = 1, s
            do k = 1, n
               few%f(i, k, before + 1) = self%f(k, i)
            end do
         end do
      end associate
   end subroutine solve_few

   !> The slopes of a group: where sweeps cost little, as many as the step before took, which mostly is enough, then one
   !> by one.
   subroutine ask(self, few, s, slot, w, p, before, sweep, last)
      type(lone_stages), intent(in) :: self
      type(few_numbers), intent(inout) :: few
      integer, intent(in) :: s
      type(group_slot), intent(inout) :: slot
      real(wp), intent(in) :: w(0:self%m), p(self%n)
      integer, intent(in) :: before  !! sweeps of other groups
      integer, intent(out) :: sweep  !! that ended it
      real(wp), intent(out) :: last  !! done, or given up; not negative where it took too long
      real(wp) :: change(most_ahead), extent(most_ahead)
      logical :: angles
      integer :: first, i

      angles = self%model%traits%has_angle_terms
      if (angles) then
         do i = slot%i1, slot%i2
            call self%find_terms(few%times(i), w, few%terms(i))
         end do
      else if (.not. self%model%traits%has_lone_sweeps) then
         slot%nsweep = 1
      end if
      last = 0
      first = 1
      do while (last >= 0 .and. slot%nsweep <= most_ahead)
         if (angles) then
            call swing(slot%i1, slot%i2, first, slot%nsweep, few%terms, few%base, few%b, few%f(1, 1, before), change, &
                       extent)
         else
            call self%model%sweeps(self%m, s, slot%i1, slot%i2, first, slot%nsweep, few%times, w, p, few%base, &
                                   few%b, most_ahead, few%f(1, 1, before), change, extent)
         end if
         call judge_ahead(first, slot%nsweep, slot%too_slow, self%too_stiff, most_ahead, change, extent, last, sweep)
         first = slot%nsweep + 1
         if (last >= 0 .and. slot%explicit) then
            sweep = 1
            last = done
         else if (last >= 0) then
            slot%nsweep = first
         end if
      end do
      slot%nsweep = min(sweep, most_ahead)
   end subroutine ask

   !> Sweeps where all is an angle, as those of a model. Sums are those of most_few stages, where what is not there is
   !> zero: how gcc contracts a loop must not depend on their number.
   subroutine swing(i1, i2, first, last, terms, base, b, f, change, extent)
      integer, value :: i1, i2, first, last
      type(angle_terms), intent(in) :: terms(most_few)
      real(wp), intent(in) :: base(most_few), b(most_few, most_few, 2)
      real(wp), intent(inout) :: f(most_few, 2, 0:most_ahead)
      real(wp), intent(inout), dimension(most_ahead) :: change, extent
      real(wp) :: x, sine, cosine, force, moved, size, now(most_few)
      integer :: i, k, m, at

      now = f(:, 1, first - 1)
      do k = first, last
         at = min(k, 2)
         moved = 0
         size = 0
         !GCC$ unroll 4
         do i = 1, most_few
            if (i >= i1 .and. i <= i2) then
               x = base(i)
               !GCC$ unroll 4
               !GCC$ novector  ! sums in order, contracted as in lanes
               do m = i - 1, i + most_few - 2
                  x = x + b(modulo(m, most_few) + 1, i, at)*now(modulo(m, most_few) + 1)
               end do
               sine = sincos_one(x, cosine)
               force = terms(i)%a*sine + (terms(i)%b*cosine + (terms(i)%c*x + terms(i)%d))  ! as force_at of step/lone
               moved = max(moved, abs(force - now(i)))
               size = max(size, abs(force))
               now(i) = force
            end if
            f(i, 1, k) = now(i)
         end do
         change(k) = moved
         extent(k) = size
      end do
   end subroutine swing

   !> The slopes of a group by gradients of the model.
   subroutine iterate(self, group, too_slow, t, w, q, p, sweep, last)
      type(lone_stages), intent(inout) :: self
      type(stage_group), intent(in) :: group
      real(wp), intent(in) :: too_slow, t, w(0:self%m), q(self%n), p(self%n)
      integer, intent(out) :: sweep
      real(wp), intent(out) :: last  !! done, or else
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
            call take_alone(n*group%nmember, sweep == 1, f(1, first), self%was(1, first, 1), change, extent)
            if (.not. self%eliminated) &
               call take_alone(n*group%nmember, sweep == 1, c(1, first), self%was(1, first, 2), change, extent)
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

end module symsde_step_stages_lone
