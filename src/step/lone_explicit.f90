! SPDX-License-Identifier: BSD-3-Clause
!> Explicit tableaux for a path by itself: by the plan of step/explicit, and with several degrees of freedom symplectic
!> Euler, its adjoint and Stormer-Verlet of H_j = T_j(p) + U_j(q) in fewer passes.
!>
!> The sums are those of step/explicit; of the coefficients one and one half, which multiply without rounding, in any
!> order.
module symsde_step_lone_explicit
   use symsde_base_kinds, only: wp
   use symsde_base_sincos, only: sincos_one
   use symsde_model_abstract, only: angle_terms
   use symsde_step_constant_mass, only: constant_mass
   use symsde_step_explicit_plan, only: explicit_plan, evaluation, add_slopes, sum_slopes
   use symsde_step_kicks, only: kick, kick_and_drift, kick_and_drift_each, kick_again, move
   use symsde_step_lone, only: lone_stepper, narrow
   implicit none
   private
   public :: lone_explicit, as_planned, kick_drift, drift_kick, kick_drift_kick

   enum, bind(c)
      enumerator :: as_planned = 0, kick_drift = 1, drift_kick = 2, kick_drift_kick = 3
   end enum

   integer, parameter :: most_stages = 8  !! that go number by number

   type, extends(lone_stepper) :: lone_explicit
      integer :: kind = as_planned
      type(explicit_plan) :: plan
      integer :: ngradient = 0       !! what a step counts
      type(constant_mass), allocatable :: mass  !! the velocity is h M^-1 p
      logical, private :: by_numbers = .false.  !! which M^-1 is
      real(wp), allocatable, dimension(:), private :: x, first, second, force  !! (n)
      real(wp), allocatable, dimension(:, :), private :: f, v  !! slopes of each stage (n, nstage)
   contains
      procedure :: take
   end type lone_explicit

contains

   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(lone_explicit), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      integer :: i

      taken = .true.
      self%counters%gradients = self%counters%gradients + self%ngradient
      if (allocated(self%mass)) then
         call self%mass%look(self%model, 1, t, q)
         self%by_numbers = self%mass%diagonal
      end if
      if (self%kind == as_planned .and. self%n <= narrow .and. self%plan%nstage <= most_stages) then
         call take_narrow(self, t, h, w, q, p, dq, dp)
         return
      end if
      if (.not. allocated(self%x)) &
         allocate (self%x(self%n), self%first(self%n), self%second(self%n), self%force(self%n))
      associate (n => self%n, t1 => t + self%plan%c(1)*h, x => self%x, force => self%force)
         select case (self%kind)
         case (as_planned)
            call take_several(self, t, h, w, q, p, dq, dp)
         case (kick_drift)
            call self%model%gradient(1, n, self%m, t1, w, q, p, hq=force)
            if (self%mass_alone) then
               call kick_and_drift(n, 1.0_wp, w(0), force, q, p, dp, dq, x)
            else if (self%by_numbers) then
               call kick_and_drift_each(n, 1.0_wp, w(0), self%mass%inverse, force, q, p, dp, dq, x)
            else
               call kick(n, 1.0_wp, force, p, dp, x)
               call self%model%gradient(1, n, self%m, t1, w, q, x, hp=dq)
            end if
         case (drift_kick)
            if (self%by_numbers) then
               call self%mass%drift(1, w(0:0), p, dq)
            else if (.not. self%mass_alone) then
               call self%model%gradient(1, n, self%m, t1, w, q, p, hp=dq)
            end if
            !GCC$ novector  ! few numbers, mostly
            do i = 1, n
               if (self%mass_alone) dq(i) = w(0)*p(i)
               x(i) = q(i) + dq(i)
            end do
            call self%model%gradient(1, n, self%m, t1, w, x, p, hq=force)
            do i = 1, n
               dp(i) = -force(i)
            end do
         case default
            call verlet(self, t, h, w, q, p, dq, dp)
         end select
      end associate
   end subroutine take

   !> The plan of step/explicit for few numbers: each product is added to what was there.
   subroutine take_narrow(self, t, h, w, q, p, dq, dp)
      type(lone_explicit), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      real(wp), dimension(narrow, most_stages) :: f, v
      real(wp), dimension(narrow) :: x, y
      type(angle_terms) :: terms
      real(wp) :: ti, a, b
      integer :: i, j, k, l, n, stage

      n = self%n
      stage = 0
      associate (plan => self%plan)
         do k = 1, size(plan%order)
            i = plan%order(k)%stage
            ti = t + plan%c(i)*h
            associate (what => plan%order(k))
               !GCC$ novector
               do l = 1, n
                  a = q(l)
                  b = p(l)
                  !GCC$ novector
                  do j = 1, plan%nstage
                     if (what%q_moves .and. abs(plan%to_q(j, i)) > 0) a = a + plan%to_q(j, i)*v(l, j)
                     if (what%p_moves .and. abs(plan%to_p(j, i)) > 0) b = b + plan%to_p(j, i)*f(l, j)
                  end do
                  x(l) = a
                  y(l) = b
               end do
               if (self%model%traits%has_angle_terms) then
                  if (i /= stage) call self%find_terms(ti, w, terms)
                  stage = i
                  if (what%force) call find_force(terms, x(1), f(1, i))
                  if (what%velocity) v(1, i) = terms%e*y(1)
               else
                  call evaluate(self, what, ti, w, x, y, f(1, i), v(1, i))
               end if
            end associate
         end do
         !GCC$ novector
         do l = 1, n
            a = (plan%alpha(1)*v(l, 1))
            b = (plan%minus_alpha(1)*f(l, 1))
            !GCC$ novector
            do j = 2, plan%nstage
               a = a + plan%alpha(j)*v(l, j)
               b = b + plan%minus_alpha(j)*f(l, j)
            end do
            dq(l) = a
            dp(l) = b
         end do
      end associate
   end subroutine take_narrow

   !> Hhat_q of an angle.
   subroutine find_force(terms, x, f)
      type(angle_terms), intent(in) :: terms
      real(wp), intent(in) :: x
      real(wp), intent(out) :: f
      real(wp) :: sine, cosine

      sine = sincos_one(x, cosine)
      f = terms%a*sine + (terms%b*cosine + (terms%c*x + terms%d))
   end subroutine find_force

   !> The plan for several.
   subroutine take_several(self, t, h, w, q, p, dq, dp)
      type(lone_explicit), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      integer :: i, k

      if (.not. allocated(self%f)) allocate (self%f(self%n, self%plan%nstage), self%v(self%n, self%plan%nstage))
      associate (plan => self%plan, n => self%n, s => self%plan%nstage, x => self%x, y => self%first, f => self%f, &
                 v => self%v)
         do k = 1, size(plan%order)
            i = plan%order(k)%stage
            x = q
            y = p
            if (plan%order(k)%q_moves) call add_slopes(n, s, plan%to_q(:, i), v, q, x)
            if (plan%order(k)%p_moves) call add_slopes(n, s, plan%to_p(:, i), f, p, y)
            call evaluate(self, plan%order(k), t + plan%c(i)*h, w, x, y, f(1, i), v(1, i))
         end do
         call sum_slopes(n, s, plan%alpha, v, dq)
         call sum_slopes(n, s, plan%minus_alpha, f, dp)
      end associate
   end subroutine take_several

   !> One evaluation of the plan at (x, y).
   subroutine evaluate(self, what, t, w, x, y, force, velocity)
      type(lone_explicit), intent(inout) :: self
      type(evaluation), intent(in) :: what
      real(wp), intent(in) :: t, w(0:self%m), x(self%n), y(self%n)
      real(wp), intent(inout) :: force(self%n), velocity(self%n)  !! those that are wanted

      associate (n => self%n, m => self%m)
         if (what%force .and. what%velocity) then
            call self%model%gradient(1, n, m, t, w, x, y, hq=force, hp=velocity)
         else if (what%force) then
            call self%model%gradient(1, n, m, t, w, x, y, hq=force)
         else if (self%by_numbers) then
            call self%mass%drift(1, w(0:0), y, velocity)
         else if (self%mass_alone) then
            velocity = w(0)*y
         else
            call self%model%gradient(1, n, m, t, w, x, y, hp=velocity)
         end if
      end associate
   end subroutine evaluate

   !> Both stages have the same momentum. Where time matters to the velocity, they differ in it; a constant mass says
   !> that it does not.
   subroutine verlet(self, t, h, w, q, p, dq, dp)
      type(lone_explicit), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      real(wp) :: t1, t2

      t1 = t + self%plan%c(1)*h
      t2 = t + self%plan%c(2)*h
      associate (n => self%n, m => self%m, x => self%x, first => self%first, second => self%second, force => self%force)
         call self%model%gradient(1, n, m, t1, w, q, p, hq=force)
         if (self%mass_alone) then
            call kick_and_drift(n, 0.5_wp, w(0), force, q, p, dp, dq, x)
         else if (self%by_numbers) then
            call kick_and_drift_each(n, 0.5_wp, w(0), self%mass%inverse, force, q, p, dp, dq, x)
         else
            call kick(n, 0.5_wp, force, p, dp, x)
            call self%model%gradient(1, n, m, t1, w, q, x, hp=first)
            if (allocated(self%mass)) then
               call move(n, q, first, first, x, dq)
            else
               call self%model%gradient(1, n, m, t2, w, q, x, hp=second)
               call move(n, q, first, second, x, dq)
            end if
         end if
         call self%model%gradient(1, n, m, t2, w, x, p, hq=force)
         call kick_again(n, force, dp)
      end associate
   end subroutine verlet

end module symsde_step_lone_explicit
