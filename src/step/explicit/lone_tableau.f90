! SPDX-License-Identifier: BSD-3-Clause
!> Explicit steps for a path by itself: symplectic Euler, its adjoint, Stormer-Verlet and the other Lobatto pair of two
!> stages, where H_j = T_j(p) + U_j(q); Heun and Euler-Maruyama for any H_j; other tableaux by their plan.
!>
!> The sums are those of step/explicit/tableau and step/explicit/euler_maruyama: of the coefficients one and one half,
!> which multiply without rounding.
module symsde_step_explicit_lone_tableau
   use symsde_base_kinds, only: wp
   use symsde_step_hamiltonian_mass, only: constant_mass
   use symsde_step_explicit_evaluation_order, only: evaluation_order, evaluation, add_slopes, to_q, to_p
   use symsde_step_explicit_kick_drift, only: kick, kick_and_drift, kick_and_drift_each, kick_again, move
   use symsde_step_lone, only: lone_stepper
   implicit none
   private
   public :: lone_explicit, kick_drift, drift_kick, kick_drift_kick, drift_kick_drift, one_slope, two_slopes, by_plan

   enum, bind(c)
      enumerator :: kick_drift = 1, drift_kick = 2, kick_drift_kick = 3, drift_kick_drift = 4
      enumerator :: one_slope = 5, two_slopes = 6  !! Euler-Maruyama, Heun
      enumerator :: by_plan = 7                    !! any
   end enum

   type, extends(lone_stepper) :: lone_explicit
      integer :: kind = kick_drift
      integer :: ngradient = 0       !! evaluations of a step
      logical :: shares = .false.    !! both stages of drift_kick_drift have one force
      real(wp) :: c(2) = 0           !! nodes of one or two stages
      type(evaluation_order) :: plan    !! of any number of them
      type(constant_mass), allocatable :: mass  !! the velocity is h M^-1 p
      logical, private :: by_numbers = .false.  !! which M^-1 is
      real(wp), allocatable, dimension(:), private :: x, first, second, force  !! (n)
      real(wp), allocatable, dimension(:, :) :: f, v  !! slopes of the plan, Hhat_q and Hhat_p (n, nstage)
   contains
      procedure :: take
   end type lone_explicit

contains

   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(lone_explicit), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken

      taken = .true.
      self%counters%gradients = self%counters%gradients + self%ngradient
      if (.not. allocated(self%x)) &
         allocate (self%x(self%n), self%first(self%n), self%second(self%n), self%force(self%n), &
                   self%f(self%n, self%plan%nstage), self%v(self%n, self%plan%nstage))
      if (allocated(self%mass)) then
         call self%mass%look(self%model, 1, t, q)
         self%by_numbers = self%mass%diagonal
      end if
      associate (n => self%n, t1 => t + self%c(1)*h, t2 => t + self%c(2)*h)
         select case (self%kind)
         case (kick_drift, drift_kick)
            call euler(self, n, t1, w, q, p, self%x, self%force, dq, dp)
         case (kick_drift_kick)
            call verlet(self, t, h, w, q, p, dq, dp)
         case (drift_kick_drift)
            call swapped(self, n, t1, t2, w, q, p, self%x, self%first, self%second, self%force, dq, dp)
         case (by_plan)
            call follow(self, self%plan, n, t, h, w, q, p, self%x, self%first, self%f, self%v, dq, dp)
         case default
            call slopes(self, n, t1, t2, w, q, p, self%x, self%first, self%second, self%force, dq, dp)
         end select
      end associate
   end subroutine take

   !> Symplectic Euler and its adjoint.
   subroutine euler(self, n, t, w, q, p, x, force, dq, dp)
      type(lone_explicit), intent(inout) :: self
      integer, intent(in) :: n
      real(wp), intent(in) :: t, w(0:self%m), q(n), p(n)
      real(wp), intent(inout) :: x(n), force(n)  !! room
      real(wp), intent(out) :: dq(n), dp(n)
      integer :: i

      if (self%kind == kick_drift) then
         call self%model%gradient(1, n, self%m, t, w, q, p, hq=force)
         if (self%mass_alone) then
            call kick_and_drift(n, 1.0_wp, w(0), force, q, p, dp, dq, x)
         else if (self%by_numbers) then
            call kick_and_drift_each(n, 1.0_wp, w(0), self%mass%inverse, force, q, p, dp, dq, x)
         else
            call kick(n, 1.0_wp, force, p, dp, x)
            call self%model%gradient(1, n, self%m, t, w, q, x, hp=dq)
         end if
         return
      end if
      call find_velocity(self, n, t, w, q, p, dq)
      !GCC$ novector  ! few numbers, mostly
      do i = 1, n
         x(i) = q(i) + dq(i)
      end do
      call self%model%gradient(1, n, self%m, t, w, x, p, hq=force)
      do i = 1, n
         dp(i) = -force(i)
      end do
   end subroutine euler

   !> Hhat_p.
   subroutine find_velocity(self, n, t, w, q, p, v)
      type(lone_explicit), intent(inout) :: self
      integer, intent(in) :: n
      real(wp), intent(in) :: t, w(0:self%m), q(n), p(n)
      real(wp), intent(out) :: v(n)
      integer :: i

      if (self%mass_alone) then
         !GCC$ novector
         do i = 1, n
            v(i) = w(0)*p(i)
         end do
      else if (allocated(self%mass)) then
         call self%mass%drift(self%model, 1, t, w, q, p, v)
      else
         call self%model%gradient(1, n, self%m, t, w, q, p, hp=v)
      end if
   end subroutine find_velocity

   !> Both stages have the same momentum. Where time matters to the velocity, they differ in it; a constant mass says
   !> that it does not.
   subroutine verlet(self, t, h, w, q, p, dq, dp)
      type(lone_explicit), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      real(wp) :: t1, t2

      t1 = t + self%c(1)*h
      t2 = t + self%c(2)*h
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

   !> Both stages have the same position, between two drifts, and share the force unless time matters to it.
   subroutine swapped(self, n, t1, t2, w, q, p, x, first, second, force, dq, dp)
      type(lone_explicit), intent(inout) :: self
      integer, intent(in) :: n
      real(wp), intent(in) :: t1, t2, w(0:self%m), q(n), p(n)
      real(wp), intent(inout), dimension(n) :: x, first, second, force  !! room
      real(wp), intent(out) :: dq(n), dp(n)
      integer :: i

      call find_velocity(self, n, t1, w, q, p, first)
      do i = 1, n
         x(i) = q(i) + 0.5_wp*first(i)
      end do
      call self%model%gradient(1, n, self%m, t1, w, x, p, hq=force)
      if (self%shares) then
         call kick(n, 1.0_wp, force, p, dp, x)
      else
         call self%model%gradient(1, n, self%m, t2, w, x, p, hq=second)
         do i = 1, n
            x(i) = p(i) - 0.5_wp*force(i)
            x(i) = x(i) - 0.5_wp*second(i)
            dp(i) = -0.5_wp*force(i) - 0.5_wp*second(i)
         end do
      end if
      call find_velocity(self, n, t2, w, q, x, second)
      do i = 1, n
         dq(i) = 0.5_wp*first(i) + 0.5_wp*second(i)
      end do
   end subroutine swapped

   !> One slope, or the mean of two.
   subroutine slopes(self, n, t1, t2, w, q, p, x, y, first, force, dq, dp)
      type(lone_explicit), intent(inout) :: self
      integer, intent(in) :: n
      real(wp), intent(in) :: t1, t2, w(0:self%m), q(n), p(n)
      real(wp), intent(inout), dimension(n) :: x, y, first, force  !! room
      real(wp), intent(out) :: dq(n), dp(n)
      integer :: i

      if (self%kind == one_slope) then
         call self%model%gradient(1, n, self%m, t1, w, q, p, hq=force, hp=dq)
         do i = 1, n
            dp(i) = 0.0_wp - force(i)
         end do
         return
      end if
      call self%model%gradient(1, n, self%m, t1, w, q, p, hq=force, hp=first)
      do i = 1, n
         x(i) = q(i) + first(i)
         y(i) = p(i) - force(i)
      end do
      call self%model%gradient(1, n, self%m, t2, w, x, y, hq=dp, hp=dq)
      do i = 1, n
         dq(i) = 0.5_wp*first(i) + 0.5_wp*dq(i)
         dp(i) = -0.5_wp*force(i) - 0.5_wp*dp(i)
      end do
   end subroutine slopes

   !> The evaluations of a plan, as step/explicit/tableau takes them.
   subroutine follow(self, plan, n, t, h, w, q, p, moved_q, moved_p, f, v, dq, dp)
      type(lone_explicit), intent(inout) :: self
      type(evaluation_order), intent(in) :: plan
      integer, intent(in) :: n
      real(wp), intent(in) :: t, h, w(0:self%m)
      real(wp), intent(in), target :: q(n), p(n)
      real(wp), intent(inout), target :: moved_q(n), moved_p(n)
      real(wp), intent(inout) :: f(n, plan%nstage), v(n, plan%nstage)  !! room
      real(wp), intent(out) :: dq(n), dp(n)
      real(wp), pointer, contiguous :: x(:), y(:)
      integer :: i, k

      do k = 1, size(plan%order)
         i = plan%order(k)%stage
         associate (what => plan%order(k), ti => t + plan%c(i)*h)
            x => q
            y => p
            if (what%q_moves) x => moved_q
            if (what%p_moves) y => moved_p
            if (what%q_moves) call add_slopes(n, plan, to_q, i, v, moved_q, q)
            if (what%p_moves) call add_slopes(n, plan, to_p, i, f, moved_p, p)
            call evaluate(self, what, n, ti, w, x, y, f(1, i), v(1, i))
         end associate
      end do
      call add_slopes(n, plan, to_q, 0, v, dq)
      call add_slopes(n, plan, to_p, 0, f, dp)
   end subroutine follow

   !> What is wanted of Hhat_q and Hhat_p.
   subroutine evaluate(self, what, n, t, w, q, p, hq, hp)
      type(lone_explicit), intent(inout) :: self
      type(evaluation), intent(in) :: what
      integer, intent(in) :: n
      real(wp), intent(in) :: t, w(0:self%m), q(n), p(n)
      real(wp), intent(inout) :: hq(n), hp(n)

      if (what%force .and. what%velocity) then
         call self%model%gradient(1, n, self%m, t, w, q, p, hq, hp)
      else if (what%force) then
         call self%model%gradient(1, n, self%m, t, w, q, p, hq=hq)
      else
         call find_velocity(self, n, t, w, q, p, hp)
      end if
   end subroutine evaluate

end module symsde_step_explicit_lone_tableau
