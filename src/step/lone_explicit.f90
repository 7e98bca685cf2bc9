! SPDX-License-Identifier: BSD-3-Clause
!> Symplectic Euler, its adjoint and Stormer-Verlet for a path by itself, where H_j = T_j(p) + U_j(q).
!>
!> The sums are those of step/explicit: of the coefficients one and one half, which multiply without rounding.
module symsde_step_lone_explicit
   use symsde_base_kinds, only: wp
   use symsde_model_abstract, only: angle_terms
   use symsde_step_constant_mass, only: constant_mass
   use symsde_step_kicks, only: kick, kick_and_drift, kick_and_drift_each, kick_again, move
   use symsde_step_lone, only: lone_stepper
   implicit none
   private
   public :: lone_explicit, kick_drift, drift_kick, kick_drift_kick

   enum, bind(c)
      enumerator :: kick_drift = 1, drift_kick = 2, kick_drift_kick = 3
   end enum

   type, extends(lone_stepper) :: lone_explicit
      integer :: kind = kick_drift
      real(wp) :: c(2) = 0           !! nodes of the stages
      type(constant_mass), allocatable :: mass  !! the velocity is h M^-1 p
      real(wp), allocatable, dimension(:), private :: x, first, second, force  !! (n)
   contains
      procedure :: take
   end type lone_explicit

contains

   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(lone_explicit), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      logical :: by_numbers  ! which M^-1 is
      integer :: i

      taken = .true.
      if (self%model%traits%has_angle_terms) then
         call swing(self, t, h, w, q(1), p(1), dq(1), dp(1))
         return
      end if
      if (.not. allocated(self%x)) &
         allocate (self%x(self%n), self%first(self%n), self%second(self%n), self%force(self%n))
      by_numbers = .false.
      if (allocated(self%mass)) then
         call self%mass%look(self%model, 1, t, q)
         by_numbers = self%mass%diagonal
      end if
      associate (n => self%n, c => self%counters, t1 => t + self%c(1)*h, x => self%x, force => self%force)
         select case (self%kind)
         case (kick_drift)
            call self%model%gradient(1, n, self%m, t1, w, q, p, hq=force)
            if (self%mass_alone) then
               call kick_and_drift(n, 1.0_wp, w(0), force, q, p, dp, dq, x)
            else if (by_numbers) then
               call kick_and_drift_each(n, 1.0_wp, w(0), self%mass%inverse, force, q, p, dp, dq, x)
            else
               call kick(n, 1.0_wp, force, p, dp, x)
               call self%model%gradient(1, n, self%m, t1, w, q, x, hp=dq)
            end if
            c%gradients = c%gradients + 2
         case (drift_kick)
            if (by_numbers) then
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
            c%gradients = c%gradients + 2
         case default
            call verlet(self, t, h, w, by_numbers, q, p, dq, dp)
         end select
      end associate
   end subroutine take

   !> The same for an angle.
   subroutine swing(self, t, h, w, q, p, dq, dp)
      class(lone_explicit), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q, p
      real(wp), intent(out) :: dq, dp
      type(angle_terms) :: terms
      real(wp) :: t1, t2, f, slope, x, y, first, second

      t1 = t + self%c(1)*h
      call self%find_terms(t1, w, terms)
      if (self%kind == drift_kick) then
         dq = terms%e*p
         dp = -self%force_at(terms, t1, w, q + dq, p, slope)
      else
         f = self%force_at(terms, t1, w, q, p, slope)
         if (self%kind == kick_drift) then
            dp = -f
            dq = terms%e*(p - f)
         else
            y = p - 0.5_wp*f
            first = terms%e*y
            t2 = t + self%c(2)*h
            call self%find_terms(t2, w, terms)
            second = terms%e*y
            x = q + 0.5_wp*first
            x = x + 0.5_wp*second
            dq = 0.5_wp*first + 0.5_wp*second
            dp = -0.5_wp*f
            dp = dp - 0.5_wp*self%force_at(terms, t2, w, x, y, slope)
         end if
      end if
      self%counters%gradients = self%counters%gradients + merge(merge(3, 4, self%mass_alone), 2, &
                                                                self%kind == kick_drift_kick)
   end subroutine swing

   !> Both stages have the same momentum. Where time matters to the velocity, they differ in it; a constant mass says
   !> that it does not.
   subroutine verlet(self, t, h, w, by_numbers, q, p, dq, dp)
      type(lone_explicit), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      logical, intent(in) :: by_numbers
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      real(wp) :: t1, t2

      t1 = t + self%c(1)*h
      t2 = t + self%c(2)*h
      associate (n => self%n, m => self%m, x => self%x, first => self%first, second => self%second, force => self%force)
         call self%model%gradient(1, n, m, t1, w, q, p, hq=force)
         if (self%mass_alone) then
            call kick_and_drift(n, 0.5_wp, w(0), force, q, p, dp, dq, x)
         else if (by_numbers) then
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
         self%counters%gradients = self%counters%gradients + merge(3, 4, self%mass_alone .or. allocated(self%mass))
      end associate
   end subroutine verlet

end module symsde_step_lone_explicit
