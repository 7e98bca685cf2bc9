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
   use symsde_model_abstract, only: model_type
   use symsde_scheme_dependency, only: stages_follow => is_explicit
   use symsde_scheme_scheme, only: scheme_type, tableau_form, correction_none
   use symsde_step_constant_mass, only: new_constant_mass
   use symsde_step_kicks, only: kick, kick_and_drift, kick_again, move
   use symsde_step_lone, only: lone_stepper, few_of
   use symsde_step_lone_explicit, only: lone_explicit, kick_drift, drift_kick, kick_drift_kick
   use symsde_step_one_step_hamiltonian, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: explicit_stepper, explicit_fits, is_explicit

   !> One evaluation: of Hhat_q, of Hhat_p, or of both, at one stage.
   type :: evaluation
      integer :: stage = 0
      logical :: force = .false.     !! Hhat_q is wanted
      logical :: velocity = .false.  !! Hhat_p is wanted
      logical :: q_moves = .false.   !! the point where it is evaluated is not that where the step began
      logical :: p_moves = .false.
   end type evaluation

   type, extends(stepper_type) :: explicit_stepper
      private
      integer :: nstage = 0
      logical :: is_euler = .false.   !! symplectic Euler or its adjoint
      logical :: is_verlet = .false.  !! Stormer-Verlet, where the velocity is h p or h M^-1 p whenever it is asked for
      real(wp), allocatable :: c(:), alpha(:)     !! (nstage)
      real(wp), allocatable :: to_q(:, :)         !! a_ij of stage i in column i (nstage, nstage)
      real(wp), allocatable :: to_p(:, :)         !! -abar_ij of stage i in column i (nstage, nstage)
      real(wp), allocatable :: minus_alpha(:)     !! (nstage)
      type(evaluation), allocatable :: plan(:)
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

      fits = .false.
      if (task%is_plain()) fits = is_explicit(task%model, task%scheme)
   end function explicit_fits

   subroutine make(self, task)
      class(explicit_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      self%name = 'explicit'
      self%takes_one_lane = .true.
      self%explicit = .true.
      associate (scheme => task%scheme, t => task%model%traits, nlane => task%nlane)
         self%nstage = scheme%nstage
         self%c = scheme%c
         self%to_q = transpose(scheme%a)
         self%to_p = -transpose(scheme%abar)
         self%alpha = scheme%alpha
         self%minus_alpha = -scheme%alpha
         call find_plan(scheme, t%separable, self%plan)
         self%is_euler = is_one_stage(self)
         call new_one_step_hamiltonian(self%ham, task%model, nlane, correction_none, 0.0_wp)
         self%is_verlet = is_verlet(self) .and. (self%ham%mass_alone .or. allocated(self%ham%mass))
         allocate (self%hq(nlane, t%ndof, self%nstage), self%hp(nlane, t%ndof, self%nstage))
         allocate (self%qs(nlane, t%ndof), self%ps(nlane, t%ndof))
      end associate
   end subroutine make

   !> Whether this scheme without correction can be executed explicitly on this model.
   logical function is_explicit(model, scheme)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme

      is_explicit = .false.
      if (scheme%form /= tableau_form) return
      if (.not. scheme%noise_coefficients_equal()) return
      is_explicit = stages_follow(scheme, model%traits%separable)
   end function is_explicit

   !> Whether there is one stage of weight one that moves one of q and p before the other is evaluated.
   pure logical function is_one_stage(self)
      type(explicit_stepper), intent(in) :: self

      is_one_stage = .false.
      if (self%nstage /= 1 .or. size(self%plan) /= 2) return
      if (abs(self%alpha(1) - 1) > 0) return
      if (self%plan(1)%force) then
         is_one_stage = abs(self%to_p(1, 1) + 1) <= 0 .and. abs(self%to_q(1, 1)) <= 0
      else
         is_one_stage = abs(self%to_q(1, 1) - 1) <= 0 .and. abs(self%to_p(1, 1)) <= 0
      end if
   end function is_one_stage

   !> Euler and Verlet take paths one by one, too.
   subroutine offer_lone(self, lone)
      class(explicit_stepper), intent(in) :: self
      class(lone_stepper), allocatable, intent(out) :: lone
      type(lone_explicit), allocatable :: made

      if (.not. (self%is_euler .or. is_verlet(self)) .or. .not. self%ham%model%traits%separable) return
      allocate (made)
      made%most = few_of(self%ham%ndof, merge(3, 2, self%ham%ndof > 2))  ! one more takes 1.1 to 1.5
      made%c(:self%nstage) = self%c
      made%mass_alone = self%ham%mass_alone
      if (allocated(self%ham%mass)) then
         allocate (made%mass)
         call new_constant_mass(made%mass, 1, self%ham%ndof, self%ham%nnoise)
      end if
      made%kind = kick_drift_kick
      if (self%is_euler) made%kind = merge(kick_drift, drift_kick, self%plan(1)%force)
      call move_alloc(made, lone)
   end subroutine offer_lone

   !> Whether half a kick, a drift of two halves and half a kick make the step.
   pure logical function is_verlet(self)
      type(explicit_stepper), intent(in) :: self
      real(wp), parameter :: to_q(2, 2) = reshape([0.0_wp, 0.0_wp, 0.5_wp, 0.5_wp], [2, 2])
      real(wp), parameter :: to_p(2, 2) = reshape([-0.5_wp, 0.0_wp, -0.5_wp, 0.0_wp], [2, 2])

      is_verlet = .false.
      if (self%nstage /= 2) return
      is_verlet = all(abs(self%to_q - to_q) <= 0) .and. all(abs(self%to_p - to_p) <= 0) .and. &
                  all(abs(self%alpha - 0.5_wp) <= 0)
   end function is_verlet

   !> The order of evaluations; not allocated where there is none.
   pure subroutine find_plan(scheme, separable, plan)
      type(scheme_type), intent(in) :: scheme
      logical, intent(in) :: separable
      type(evaluation), allocatable, intent(out) :: plan(:)
      type(evaluation) :: next, order(2*scheme%nstage)
      logical :: has_force(scheme%nstage), has_velocity(scheme%nstage), q_ready, p_ready, moved
      integer :: i, n

      has_force = .false.
      has_velocity = .false.
      n = 0
      do
         moved = .false.
         do i = 1, scheme%nstage
            q_ready = all(has_velocity .or. abs(scheme%a(i, :)) <= 0)
            p_ready = all(has_force .or. abs(scheme%abar(i, :)) <= 0)
            next%stage = i
            next%force = q_ready .and. (separable .or. p_ready) .and. .not. has_force(i)
            next%velocity = p_ready .and. (separable .or. q_ready) .and. .not. has_velocity(i)
            if (.not. (next%force .or. next%velocity)) cycle
            next%q_moves = (next%force .or. .not. separable) .and. any(abs(scheme%a(i, :)) > 0)
            next%p_moves = (next%velocity .or. .not. separable) .and. any(abs(scheme%abar(i, :)) > 0)
            has_force(i) = has_force(i) .or. next%force
            has_velocity(i) = has_velocity(i) .or. next%velocity
            n = n + 1
            order(n) = next
            moved = .true.
         end do
         if (.not. moved) exit
      end do
      if (all(has_force) .and. all(has_velocity)) plan = order(:n)
   end subroutine find_plan

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
      do k = 1, size(self%plan)
         i = self%plan(k)%stage
         if (self%plan(k)%q_moves) call add_slopes(n, self%nstage, self%to_q(:, i), self%hp, q, self%qs)
         if (self%plan(k)%p_moves) call add_slopes(n, self%nstage, self%to_p(:, i), self%hq, p, self%ps)
         ! a point that is where the step began is not copied
         associate (ti => step%t + self%c(i)*step%h, q_moves => self%plan(k)%q_moves, p_moves => self%plan(k)%p_moves)
            if (q_moves .and. p_moves) then
               call evaluate(self, self%plan(k), ti, step%w, self%qs, self%ps)
            else if (q_moves) then
               call evaluate(self, self%plan(k), ti, step%w, self%qs, p)
            else if (p_moves) then
               call evaluate(self, self%plan(k), ti, step%w, q, self%ps)
            else
               call evaluate(self, self%plan(k), ti, step%w, q, p)
            end if
         end associate
      end do
      call sum_slopes(n, self%nstage, self%alpha, self%hp, dq)
      call sum_slopes(n, self%nstage, self%minus_alpha, self%hq, dp)
   end subroutine increment

   !> One stage of weight one, force first or velocity first: slopes are increments, no sums are taken.
   subroutine euler(self, t, w, q, p, dq, dp)
      class(explicit_stepper), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer :: n

      n = size(q)
      associate (ti => t + self%c(1)*w(1, 0))
         if (self%plan(1)%force) then
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
      call self%ham%gradient(t + self%c(1)*h, w, q, p, hq=self%hq(:, :, 1))
      if (allocated(self%ham%mass)) then
         call drift_by_mass(self, t, w, q, p, dq, dp)
      else
         call kick_and_drift(n, 0.5_wp, w(1, 0), self%hq, q, p, dp, dq, self%qs)
         self%ham%counters%gradients = self%ham%counters%gradients + self%ham%nreal
      end if
      call self%ham%gradient(t + self%c(2)*h, w, self%qs, p, hq=self%hq(:, :, 1))
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

   !> VEC total = start + sum_j coefficient_j slope_j; slopes with coefficient zero are never read, so those
   !> that have not been evaluated yet do no harm. At least one coefficient is not zero.
   pure subroutine add_slopes(n, nstage, coefficient, slope, start, total)
      integer, intent(in) :: n, nstage
      real(wp), intent(in) :: coefficient(nstage), slope(n, nstage), start(n)
      real(wp), intent(inout) :: total(n)
      integer :: i, j, first

      first = findloc(abs(coefficient) > 0, .true., 1)
      do i = 1, n
         total(i) = start(i) + coefficient(first)*slope(i, first)
      end do
      do j = first + 1, nstage
         if (abs(coefficient(j)) <= 0) cycle
         do i = 1, n
            total(i) = total(i) + coefficient(j)*slope(i, j)
         end do
      end do
   end subroutine add_slopes

   !> VEC total = sum_j coefficient_j slope_j
   pure subroutine sum_slopes(n, nstage, coefficient, slope, total)
      integer, intent(in) :: n, nstage
      real(wp), intent(in) :: coefficient(nstage), slope(n, nstage)
      real(wp), intent(out) :: total(n)
      integer :: i, j

      do i = 1, n
         total(i) = coefficient(1)*slope(i, 1)
      end do
      do j = 2, nstage
         do i = 1, n
            total(i) = total(i) + coefficient(j)*slope(i, j)
         end do
      end do
   end subroutine sum_slopes

end module symsde_step_explicit
