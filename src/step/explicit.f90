! SPDX-License-Identifier: BSD-3-Clause
!> Explicit execution of a tableau whose stages follow one after the other for this model.
!>
!> Q_i waits for the Hhat_p of the stages with a_ij /= 0, P_i for the Hhat_q of those with abar_ij /= 0.
!> With separable Hamiltonians Hhat_q needs Q alone and Hhat_p needs P alone; then the uncorrected Euler
!> pair [WHSB] (89)-(92) and Stormer-Verlet are explicit. The order of evaluation is found once, at
!> set-up; no solver is called.
module symsde_step_explicit
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_scheme_scheme, only: scheme_type, correction_none
   use symsde_step_constant_mass, only: new_constant_mass
   use symsde_step_explicit_plan, only: explicit_plan, evaluation, new_explicit_plan, add_slopes, sum_slopes
   use symsde_step_kicks, only: kick, kick_and_drift, kick_again, move
   use symsde_step_lone, only: lone_stepper, few_of
   use symsde_step_lone_explicit, only: lone_explicit, kick_drift, drift_kick, kick_drift_kick
   use symsde_step_lone_planned, only: lone_planned, narrow, most_stages
   use symsde_step_one_step_hamiltonian, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: explicit_stepper, explicit_fits

   type, extends(stepper_type) :: explicit_stepper
      private
      logical :: is_euler = .false.   !! symplectic Euler or its adjoint
      logical :: is_verlet = .false.  !! Stormer-Verlet, where the velocity is h p or h M^-1 p whenever it is asked for
      type(explicit_plan) :: plan
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
      self%takes_one_lane = .true.
      self%explicit = .true.
      associate (scheme => task%scheme, t => task%model%traits, nlane => task%nlane)
         call new_explicit_plan(self%plan, scheme, t%separable)
         self%is_euler = is_one_stage(self)
         call new_one_step_hamiltonian(self%ham, task%model, nlane, correction_none, 0.0_wp)
         self%is_verlet = is_verlet(self) .and. (self%ham%mass_alone .or. allocated(self%ham%mass))
         allocate (self%hq(nlane, t%ndof, self%plan%nstage), self%hp(nlane, t%ndof, self%plan%nstage))
         allocate (self%qs(nlane, t%ndof), self%ps(nlane, t%ndof))
      end associate
   end subroutine make

   !> Whether there is one stage of weight one that moves one of q and p before the other is evaluated.
   pure logical function is_one_stage(self)
      type(explicit_stepper), intent(in) :: self

      is_one_stage = .false.
      if (self%plan%nstage /= 1 .or. size(self%plan%order) /= 2) return
      if (abs(self%plan%alpha(1) - 1) > 0) return
      if (self%plan%order(1)%force) then
         is_one_stage = abs(self%plan%to_p(1, 1) + 1) <= 0 .and. abs(self%plan%to_q(1, 1)) <= 0
      else
         is_one_stage = abs(self%plan%to_q(1, 1) - 1) <= 0 .and. abs(self%plan%to_p(1, 1)) <= 0
      end if
   end function is_one_stage

   !> What takes paths one by one: Euler and Verlet in few passes, others with few degrees of freedom by the plan.
   subroutine offer_lone(self, lone)
      class(explicit_stepper), intent(in) :: self
      class(lone_stepper), allocatable, intent(out) :: lone
      type(lone_explicit), allocatable :: made
      type(lone_planned), allocatable :: planned

      if (.not. (self%is_euler .or. is_verlet(self)) .or. .not. self%ham%model%traits%separable) then
         if (self%ham%ndof > narrow .or. self%plan%nstage > most_stages .or. allocated(self%ham%mass)) return
         allocate (planned)
         planned%plan = self%plan
         planned%mass_alone = self%ham%mass_alone
         call move_alloc(planned, lone)
         return
      end if
      allocate (made)
      made%most = few_of(self%ham%ndof, merge(3, 2, self%ham%ndof > 2), 6)  ! one more takes 1.1 to 1.5
      made%c(:self%plan%nstage) = self%plan%c
      made%mass_alone = self%ham%mass_alone
      if (allocated(self%ham%mass)) then
         allocate (made%mass)
         call new_constant_mass(made%mass, 1, self%ham%ndof, self%ham%nnoise)
      end if
      made%kind = kick_drift_kick
      if (self%is_euler) made%kind = merge(kick_drift, drift_kick, self%plan%order(1)%force)
      call move_alloc(made, lone)
   end subroutine offer_lone

   !> Whether half a kick, a drift of two halves and half a kick make the step.
   pure logical function is_verlet(self)
      type(explicit_stepper), intent(in) :: self
      real(wp), parameter :: to_q(2, 2) = reshape([0.0_wp, 0.0_wp, 0.5_wp, 0.5_wp], [2, 2])
      real(wp), parameter :: to_p(2, 2) = reshape([-0.5_wp, 0.0_wp, -0.5_wp, 0.0_wp], [2, 2])

      is_verlet = .false.
      if (self%plan%nstage /= 2) return
      is_verlet = all(abs(self%plan%to_q - to_q) <= 0) .and. all(abs(self%plan%to_p - to_p) <= 0) .and. &
                  all(abs(self%plan%alpha - 0.5_wp) <= 0)
   end function is_verlet

   subroutine increment(self, step, q, p, dq, dp, status)
      class(explicit_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      integer :: n, i, k

      n = size(q)
      if (self%is_euler) then
         call euler(self, step%t, step%w, q, p, dq, dp)
         return
      end if
      if (self%is_verlet) then
         call verlet(self, step%t, step%h, step%w, q, p, dq, dp)
         return
      end if
      associate (plan => self%plan)
         do k = 1, size(plan%order)
            i = plan%order(k)%stage
            ! a point that is where the step began is not copied
            associate (what => plan%order(k), ti => step%t + plan%c(i)*step%h)
               if (what%q_moves) call add_slopes(n, plan%nstage, plan%to_q(:, i), self%hp, q, self%qs)
               if (what%p_moves) call add_slopes(n, plan%nstage, plan%to_p(:, i), self%hq, p, self%ps)
               if (what%q_moves .and. what%p_moves) then
                  call evaluate(self, what, ti, step%w, self%qs, self%ps)
               else if (what%q_moves) then
                  call evaluate(self, what, ti, step%w, self%qs, p)
               else if (what%p_moves) then
                  call evaluate(self, what, ti, step%w, q, self%ps)
               else
                  call evaluate(self, what, ti, step%w, q, p)
               end if
            end associate
         end do
         call sum_slopes(n, plan%nstage, plan%alpha, self%hp, dq)
         call sum_slopes(n, plan%nstage, plan%minus_alpha, self%hq, dp)
      end associate
   end subroutine increment

   !> One stage of weight one, force first or velocity first: slopes are increments, no sums are taken.
   subroutine euler(self, t, w, q, p, dq, dp)
      class(explicit_stepper), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer :: n

      n = size(q)
      associate (ti => t + self%plan%c(1)*w(1, 0))
         if (self%plan%order(1)%force) then
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

end module symsde_step_explicit
