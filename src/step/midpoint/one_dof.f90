! SPDX-License-Identifier: BSD-3-Clause
!> Implicit midpoint for any model of one degree of freedom: two unknowns in closed form, few passes.
!>
!>    F = Hhat_p(Q,P),  G = -Hhat_q(Q,P),  Q = q_n + F/2,  P = p_n + G/2,  (dq,dp) = (F,G)   [WHSB] (71)-(72)
!>
!> With a = Hhat_qq/2, b = Hhat_qp/2, c = Hhat_pp/2 the Newton matrix is [1-b, -c; a, 1+b], of determinant
!> 1 - b^2 + a c. Where Hhat_qp = 0 it begins with F = Hhat_p(p), G = 0: only the force is left to move Q, by one order
!> more in the step; from zero where h is long for a known frequency, or the second correction says that this was too
!> far. Quadratic Hamiltonians need one solve and no test. Agrees with the general stepper to a few ulps
!> (tests/verification/test_steppers.pf).
module symsde_step_midpoint_one_dof
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_model_abstract, only: angle_terms
   use symsde_scheme_scheme, only: correction_none
   use symsde_solve_newton, only: newton_type, new_newton
   use symsde_solve_stagnation, only: seen, verdict_of, restart_lanes, gives_up
   use symsde_step_lone, only: lone_stepper
   use symsde_step_midpoint_equation, only: position
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: midpoint_one_dof_stepper, midpoint_one_dof_fits

   type, extends(stepper_type) :: midpoint_one_dof_stepper
      private
      type(newton_type) :: newton
      logical :: separable = .false.
      logical :: flies = .false.                   !! Newton's iteration begins with the velocity
      real(wp), allocatable :: qs(:, :), ps(:, :)  !! (Q, P) (nlane, 1)
      real(wp), allocatable :: first(:)            !! size of the first correction (nlane)
      real(wp), allocatable :: hq(:, :), hp(:, :)  !! (nlane, 1)
      real(wp), allocatable :: hqq(:, :, :), hqp(:, :, :), hpp(:, :, :)  !! (nlane, 1, 1)
   contains
      procedure :: make
      procedure :: increment
      procedure :: offer_lone
   end type midpoint_one_dof_stepper

   !> The same iteration for a path by itself, where the Hamiltonians are separable.
   type, extends(lone_stepper) :: lone_midpoint_one_dof
      private
      integer :: max_iter = 0
      real(wp) :: mixed = 0  !! Hhat_qp: not a constant, or products with it would not be contracted as in lanes
   contains
      procedure :: take
   end type lone_midpoint_one_dof

contains

   !> Whether this stepper executes the task.
   logical function midpoint_one_dof_fits(task) result(fits)
      type(stepper_task), intent(in) :: task

      fits = task%is_plain() .and. task%scheme%is_midpoint() .and. task%model%traits%ndof == 1
   end function midpoint_one_dof_fits

   subroutine make(self, task)
      class(midpoint_one_dof_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      self%name = 'midpoint, one degree of freedom'
      self%most_single = 2
      associate (t => task%model%traits, options => task%newton, nlane => task%nlane)
         self%separable = t%separable
         call new_one_step_hamiltonian(self%ham, task%model, nlane, correction_none, 0.0_wp)
         call new_newton(self%newton, nlane, 2, options, t%one_solve(.false.), -1, -1)
         self%one_solve = self%newton%affine
         self%flies = self%separable .and. options%is_free() .and. .not. self%one_solve
         if (t%has_hessian .and. options%is_free() .and. .not. self%one_solve) self%newton%test = seen
         allocate (self%first(nlane), self%qs(nlane, 1), self%ps(nlane, 1), self%hq(nlane, 1), self%hp(nlane, 1))
         allocate (self%hqq(nlane, 1, 1), self%hpp(nlane, 1, 1))
         allocate (self%hqp(nlane, 1, 1), source=0.0_wp)
      end associate
   end subroutine make

   subroutine increment(self, step, q, p, dq, dp, status)
      class(midpoint_one_dof_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      real(wp) :: tm
      logical :: flies

      tm = step%t + 0.5_wp*step%h
      if (self%newton%affine) then
         call evaluate(self, tm, step%w, q, p)
         call solve_affine(self%ham%nlane, self%hq, self%hp, self%hqq, self%hqp, self%hpp, dq, dp)
         associate (c => self%ham%counters)
            c%iterations = c%iterations + self%ham%nreal
            c%solves = c%solves + self%ham%nreal
         end associate
         return
      end if
      dq = 0
      dp = 0
      flies = self%flies .and. self%ham%model%traits%is_slow(step%h)
      if (flies) call self%ham%velocity(tm, step%w, q, p, dq)
      call self%newton%start(status)
      do while (self%newton%running)
         call position(self%ham%nlane, 0.5_wp, q, dq, self%qs)
         call position(self%ham%nlane, 0.5_wp, p, dp, self%ps)
         call evaluate(self, tm, step%w, self%qs, self%ps)
         call correct_pair(self%ham%nlane, self%hq, self%hp, self%hqq, self%hqp, self%hpp, self%newton%last, dq, dp, &
                           self%newton%step, self%newton%size)
         if (flies .and. self%newton%iteration == 1) self%first = self%newton%last
         call self%newton%judge(status, self%ham%counters)
         if (flies .and. self%newton%running .and. self%newton%iteration == 2) &
            call restart(self%ham%nlane, self%first, self%newton%size, self%hqq, self%hpp, self%newton%last, dq, dp)
      end do
   end subroutine increment

   !> From zero where the velocity has led too far.
   pure subroutine restart(nlane, first, size, hqq, hpp, last, dq, dp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: first(nlane), size(nlane), hqq(nlane), hpp(nlane)
      real(wp), intent(inout) :: last(nlane), dq(nlane), dp(nlane)
      real(wp) :: x(nlane, 2)

      x(:, 1) = dq
      x(:, 2) = dp
      call restart_lanes(nlane, 2, first, size, hqq, hpp, last, x)
      dq = x(:, 1)
      dp = x(:, 2)
   end subroutine restart

   !> Paths one by one, where two derivatives of each Hamiltonian are there and one solve does not do.
   subroutine offer_lone(self, lone)
      class(midpoint_one_dof_stepper), intent(in) :: self
      class(lone_stepper), allocatable, intent(out) :: lone
      type(lone_midpoint_one_dof), allocatable :: made

      associate (newton => self%newton)
         if (.not. (self%flies .and. self%ham%model%traits%has_hessian)) return
         allocate (made)
         made%mass_alone = self%ham%mass_alone
         made%max_iter = newton%options%max_iter
         call move_alloc(made, lone)
      end associate
   end subroutine offer_lone

   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(lone_midpoint_one_dof), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      type(angle_terms) :: terms
      real(wp) :: tm, x, y, hq, hp, hqq, hpp, a, b, c, f, g, inverse, last, step, before
      integer :: iteration
      logical :: flies

      flies = self%model%traits%is_slow(h)
      tm = t + 0.5_wp*h
      call self%find_terms(tm, w, terms)
      x = 0
      if (flies) x = self%velocity_at(terms, tm, w, q(1), p(1))
      y = 0
      b = 0.5_wp*self%mixed
      last = 0
      iteration = 0
      do while (last >= 0)
         taken = iteration < self%max_iter
         if (.not. taken) return
         iteration = iteration + 1
         hq = self%force_at(terms, tm, w, q(1) + 0.5_wp*x, p(1) + 0.5_wp*y, hqq, hp, hpp)
         a = 0.5_wp*hqq
         c = 0.5_wp*hpp
         f = x - hp
         g = y + hq
         inverse = 1/(1 - b*b + a*c)
         hp = ((1 + b)*f + c*g)*inverse
         hq = ((1 - b)*g - a*f)*inverse
         x = x - hp
         y = y - hq
         step = max(abs(hp), abs(hq))
         taken = step + abs(x + y) <= huge(h)
         if (.not. taken) return
         before = last
         last = verdict_of(seen, step, max(abs(x), abs(y)), before)
         if (.not. flies .or. iteration /= 2) cycle
         if (gives_up(before, last, max(abs(x), abs(y)), hqq, hpp)) then
            x = 0
            y = 0
            last = 0
         end if
      end do
      dq = x
      dp = y
      associate (n => self%counters)
         n%gradients = n%gradients + merge(1, 0, flies) + iteration
         n%hessians = n%hessians + iteration
         n%iterations = n%iterations + iteration
         n%solves = n%solves + iteration
      end associate
   end subroutine take

   !> Gradient and Hessian at (q, p): zero for a fixed-point iteration, as the mixed derivative of a separable model is.
   subroutine evaluate(self, tm, w, q, p)
      type(midpoint_one_dof_stepper), intent(inout) :: self
      real(wp), intent(in) :: tm, w(self%ham%nlane, 0:self%ham%nnoise), q(self%ham%nlane, 1), p(self%ham%nlane, 1)

      if (self%newton%options%fixed_point > 0) then
         call self%ham%gradient(tm, w, q, p, self%hq, self%hp)
         self%hqq = 0
         self%hpp = 0
      else if (self%separable) then
         call self%ham%gradient_hessian(tm, w, q, p, self%hq, self%hp, hqq=self%hqq, hpp=self%hpp)
      else
         call self%ham%gradient_hessian(tm, w, q, p, self%hq, self%hp, self%hqq, self%hqp, self%hpp)
      end if
   end subroutine evaluate

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC (F,G) = [1-b, -c; a, 1+b]^{-1} (Hhat_p, -Hhat_q), exact for a quadratic Hamiltonian.
   pure subroutine solve_affine(nlane, hq, hp, hqq, hqp, hpp, dq, dp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: hq(nlane), hp(nlane), hqq(nlane), hqp(nlane), hpp(nlane)
      real(wp), intent(out) :: dq(nlane), dp(nlane)
      real(wp) :: a, b, c, inverse
      integer :: lane

      do lane = 1, nlane
         a = 0.5_wp*hqq(lane)
         b = 0.5_wp*hqp(lane)
         c = 0.5_wp*hpp(lane)
         inverse = 1/(1 - b*b + a*c)
         dq(lane) = ((1 + b)*hp(lane) - c*hq(lane))*inverse
         dp(lane) = -((1 - b)*hq(lane) + a*hp(lane))*inverse
      end do
   end subroutine solve_affine

   !> VEC Newton's correction of (F,G) in running lanes, with its size and that of the unknowns.
   pure subroutine correct_pair(nlane, hq, hp, hqq, hqp, hpp, last, dq, dp, step, size)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: hq(nlane), hp(nlane), hqq(nlane), hqp(nlane), hpp(nlane), last(nlane)
      real(wp), intent(inout) :: dq(nlane), dp(nlane)
      real(wp), intent(out) :: step(nlane), size(nlane)
      real(wp) :: a, b, c, f, g, inverse, df, dg
      integer :: lane

      do lane = 1, nlane
         a = 0.5_wp*hqq(lane)
         b = 0.5_wp*hqp(lane)
         c = 0.5_wp*hpp(lane)
         f = dq(lane) - hp(lane)
         g = dp(lane) + hq(lane)
         inverse = 1/(1 - b*b + a*c)
         df = ((1 + b)*f + c*g)*inverse
         dg = ((1 - b)*g - a*f)*inverse
         dq(lane) = merge(dq(lane) - df, dq(lane), last(lane) >= 0)
         dp(lane) = merge(dp(lane) - dg, dp(lane), last(lane) >= 0)
         step(lane) = max(abs(df), abs(dg)) + 0*df
         size(lane) = max(abs(dq(lane)), abs(dp(lane)))
      end do
   end subroutine correct_pair

end module symsde_step_midpoint_one_dof
