! SPDX-License-Identifier: BSD-3-Clause
!> Explicit execution of a tableau whose stages follow one after the other for this model.
!>
!> Q_i waits for the Hhat_p of the stages with a_ij /= 0, P_i for the Hhat_q of those with abar_ij /= 0.
!> With separable Hamiltonians Hhat_q needs Q alone and Hhat_p needs P alone; then the uncorrected Euler
!> pair [WHSB] (89)-(92) and Stormer-Verlet are explicit. The order of evaluation is found once, at
!> set-up; no solver is called.
module symsde_step_explicit_tableau
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_traits, only: model_traits
   use symsde_scheme_scheme, only: scheme_type, correction_none
   use symsde_step_hamiltonian_mass, only: new_constant_mass
   use symsde_step_explicit_evaluation_order, only: evaluation_order, evaluation, new_explicit_plan, add_slopes, to_q, &
                                                    to_p
   use symsde_step_explicit_kick_drift, only: kick, kick_and_drift, kick_again, move
   use symsde_step_lone, only: lone_stepper
   use symsde_step_explicit_lone_tableau, only: lone_explicit, kick_drift, drift_kick, kick_drift_kick, &
                                                drift_kick_drift, two_slopes, by_plan
   use symsde_step_explicit_lone_swing, only: new_lone_explicit
   use symsde_step_implicit_euler_pair, only: is_euler_pair
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: explicit_stepper, explicit_fits

   type, extends(stepper_type) :: explicit_stepper
      private
      integer :: kind = by_plan       !! of lone steps
      logical :: is_verlet = .false.  !! Stormer-Verlet, where the velocity is h p or h M^-1 p whenever it is asked for
      type(evaluation_order) :: plan
      real(wp), allocatable :: hq(:, :, :), hp(:, :, :)  !! of each stage (nlane, ndof, nstage)
      real(wp), allocatable :: qs(:, :), ps(:, :)        !! one stage (nlane, ndof)
   contains
      procedure :: make
      procedure :: increment
      procedure :: offer_lone
   end type explicit_stepper

contains

   !> Whether this stepper executes the task.
   logical function explicit_fits(task) result(fits)
      type(stepper_task), intent(in) :: task

      fits = task%follows
      if (fits) fits = task%is_plain()
   end function explicit_fits

   subroutine make(self, task)
      class(explicit_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      self%name = 'explicit'
      self%most_single = 2
      self%explicit = .true.
      associate (scheme => task%scheme, t => task%model%traits, nlane => task%nlane)
         call new_one_step_hamiltonian(self%ham, task%model, nlane, correction_none, 0.0_wp)
         self%kind = kind_of(scheme, t, allocated(self%ham%mass))
         associate (by_mass => self%ham%mass_alone .or. allocated(self%ham%mass), planned => self%kind == by_plan)
            self%is_verlet = self%kind == kick_drift_kick .and. by_mass
            call new_explicit_plan(self%plan, scheme, t%separable, &
                                   (planned .or. self%kind == drift_kick_drift) .and. t%autonomous, &
                                   planned .and. (t%autonomous .or. by_mass))
         end associate
         allocate (self%hq(nlane, t%ndof, self%plan%nstage), self%hp(nlane, t%ndof, self%plan%nstage))
         allocate (self%qs(nlane, t%ndof), self%ps(nlane, t%ndof))
      end associate
   end subroutine make

   !> What takes paths one by one: Euler, Verlet and the like in few passes.
   subroutine offer_lone(self, lone)
      class(explicit_stepper), intent(in) :: self
      class(lone_stepper), allocatable, intent(out) :: lone
      class(lone_explicit), allocatable :: made

      call new_lone_explicit(made, self%kind, self%ham%model%traits, self%plan)
      if (self%is_verlet) made%ngradient = made%ngradient - 1  ! it asks for its velocity once
      made%mass_alone = self%ham%mass_alone
      if (allocated(self%ham%mass)) then
         allocate (made%mass)
         call new_constant_mass(made%mass, 1, self%ham%ndof, self%ham%nnoise)
      end if
      call move_alloc(made, lone)
   end subroutine offer_lone

   !> Which kind of lone steps these are.
   pure integer function kind_of(scheme, traits, has_mass) result(kind)
      type(scheme_type), intent(in) :: scheme
      type(model_traits), intent(in) :: traits
      logical, intent(in) :: has_mass  !! a constant one, not known to be the identity
      real(wp), parameter :: rows(2, 2) = reshape([0.0_wp, 0.5_wp, 0.0_wp, 0.5_wp], [2, 2]), &
                             columns(2, 2) = reshape([0.5_wp, 0.5_wp, 0.0_wp, 0.0_wp], [2, 2]), &
                             heun(2, 2) = reshape([0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp], [2, 2])

      kind = by_plan
      if (is_euler_pair(scheme)) then
         kind = merge(kick_drift, drift_kick, scheme%abar(1, 1) > 0.5_wp)  ! explicit, so separable
      else if (has_halves(scheme, heun, heun)) then
         if (.not. has_mass) kind = two_slopes
      else if (traits%separable .and. has_halves(scheme, rows, columns)) then
         if (abs(scheme%c(1) - scheme%c(2)) > 0) kind = kick_drift_kick  ! else stages share the velocity
      else if (traits%separable .and. has_halves(scheme, columns, rows)) then
         if (.not. has_mass) kind = drift_kick_drift
      end if
   end function kind_of

   !> Whether a tableau of two equal weights has these coefficients of Hhat_p, and these of Hhat_q.
   pure logical function has_halves(scheme, a, abar)
      type(scheme_type), intent(in) :: scheme
      real(wp), intent(in) :: a(2, 2), abar(2, 2)

      has_halves = .false.
      if (scheme%nstage /= 2) return
      has_halves = all(abs(scheme%a - a) <= 0) .and. all(abs(scheme%abar - abar) <= 0) .and. &
                   all(abs(scheme%alpha - 0.5_wp) <= 0)
   end function has_halves

   subroutine increment(self, step, q, p, dq, dp, status)
      class(explicit_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)

      if (self%kind == kick_drift .or. self%kind == drift_kick) then
         call euler(self, step%t, step%w, q, p, dq, dp)
      else if (self%is_verlet) then
         call verlet(self, step%t, step%h, step%w, q, p, dq, dp)
      else
         call follow(self, self%plan, step%t, step%h, step%w, q, p, dq, dp)
      end if
   end subroutine increment

   !> The evaluations of the plan. A point that is where the step began is not copied.
   subroutine follow(self, plan, t, h, w, q, p, dq, dp)
      class(explicit_stepper), intent(inout), target :: self
      type(evaluation_order), intent(in) :: plan
      real(wp), intent(in) :: t, h, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in), target :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      real(wp), pointer, contiguous :: x(:, :), y(:, :)
      integer :: n, i, k

      n = size(q)
      do k = 1, size(plan%order)
         i = plan%order(k)%stage
         associate (what => plan%order(k), ti => t + plan%c(i)*h)
            x => q
            y => p
            if (what%q_moves) x => self%qs
            if (what%p_moves) y => self%ps
            if (what%q_moves) call add_slopes(n, plan, to_q, i, self%hp, self%qs, q)
            if (what%p_moves) call add_slopes(n, plan, to_p, i, self%hq, self%ps, p)
            call evaluate(self, what, ti, w, x, y)
         end associate
      end do
      call add_slopes(n, plan, to_q, 0, self%hp, dq)
      call add_slopes(n, plan, to_p, 0, self%hq, dp)
   end subroutine follow

   !> One stage of weight one, force first or velocity first: slopes are increments, no sums are taken.
   subroutine euler(self, t, w, q, p, dq, dp)
      class(explicit_stepper), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer :: n

      n = size(q)
      associate (ti => t + self%plan%c(1)*w(1, 0))
         if (self%kind == kick_drift) then
            call self%ham%gradient(ti, w, q, p, hq=self%hq(:, :, 1))
            call kick(n, 1.0_wp, self%hq, p, dp, self%ps)
            call self%ham%gradient(ti, w, q, self%ps, hp=dq)
         else
            call self%ham%gradient(ti, w, q, p, hp=dq)
            self%qs = q + dq
            call self%ham%gradient(ti, w, self%qs, p, hq=self%hq(:, :, 1))
            dp = -self%hq(:, :, 1)
         end if
      end associate
   end subroutine euler

   !> Half a kick, a drift and half a kick: few passes over the block.
   subroutine verlet(self, t, h, w, q, p, dq, dp)
      class(explicit_stepper), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer :: n

      n = size(q)
      call self%ham%gradient(t + self%plan%c(1)*h, w, q, p, hq=self%hq(:, :, 1))
      if (allocated(self%ham%mass)) then
         call drift_by_mass(self, t, w, q, p, dq, dp)
      else
         call kick_and_drift(n, 0.5_wp, w(1, 0), self%hq, q, p, dp, dq, self%qs)
         self%ham%counters%gradients = self%ham%counters%gradients + self%ham%nreal
      end if
      call self%ham%gradient(t + self%plan%c(2)*h, w, self%qs, p, hq=self%hq(:, :, 1))
      call kick_again(n, self%hq, dp)
   end subroutine verlet

   !> Half a kick and a drift with a constant mass, whose velocity is found once for both halves.
   subroutine drift_by_mass(self, t, w, q, p, dq, dp)
      class(explicit_stepper), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)

      call kick(size(q), 0.5_wp, self%hq, p, dp, self%ps)
      call self%ham%gradient(t, w, q, self%ps, hp=self%hp(:, :, 1))
      call move(size(q), q, self%hp, self%hp, self%qs, dq)
   end subroutine drift_by_mass

   !> One evaluation of the plan at (q, p).
   subroutine evaluate(self, what, t, w, q, p)
      class(explicit_stepper), intent(inout) :: self
      type(evaluation), intent(in) :: what
      real(wp), intent(in) :: t, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)

      associate (i => what%stage)
         if (what%force .and. what%velocity) then
            call self%ham%gradient(t, w, q, p, self%hq(:, :, i), self%hp(:, :, i))
         else if (what%force) then
            call self%ham%gradient(t, w, q, p, hq=self%hq(:, :, i))
         else
            call self%ham%gradient(t, w, q, p, hp=self%hp(:, :, i))
         end if
      end associate
   end subroutine evaluate

end module symsde_step_explicit_tableau
