! SPDX-License-Identifier: BSD-3-Clause
!> An explicit tableau for a path by itself with few degrees of freedom: the plan of step/explicit, number by number.
module symsde_step_lone_planned
   use symsde_base_kinds, only: wp
   use symsde_base_sincos, only: sincos_one
   use symsde_model_abstract, only: angle_terms
   use symsde_step_explicit_plan, only: explicit_plan, evaluation
   use symsde_step_lone, only: lone_stepper
   implicit none
   private
   public :: lone_planned, narrow, most_stages

   integer, parameter :: narrow = 4, most_stages = 8  !! degrees of freedom and stages, no more

   type, extends(lone_stepper) :: lone_planned
      type(explicit_plan) :: plan
   contains
      procedure :: take
   end type lone_planned

contains

   !> Each product is added to what was there.
   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(lone_planned), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      real(wp), dimension(narrow, most_stages) :: f, v
      real(wp), dimension(narrow) :: x, y
      type(angle_terms) :: terms
      real(wp) :: ti, a, b
      integer :: i, j, k, l, n, stage

      taken = .true.
      n = self%n
      stage = 0
      self%counters%gradients = self%counters%gradients + size(self%plan%order)
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
   end subroutine take

   !> Hhat_q of an angle.
   subroutine find_force(terms, x, f)
      type(angle_terms), intent(in) :: terms
      real(wp), intent(in) :: x
      real(wp), intent(out) :: f
      real(wp) :: sine, cosine

      sine = sincos_one(x, cosine)
      f = terms%a*sine + (terms%b*cosine + (terms%c*x + terms%d))
   end subroutine find_force

   !> One evaluation of the plan at (x, y).
   subroutine evaluate(self, what, t, w, x, y, force, velocity)
      type(lone_planned), intent(inout) :: self
      type(evaluation), intent(in) :: what
      real(wp), intent(in) :: t, w(0:self%m), x(self%n), y(self%n)
      real(wp), intent(inout) :: force(self%n), velocity(self%n)  !! those that are wanted

      associate (n => self%n, m => self%m)
         if (what%force .and. what%velocity) then
            call self%model%gradient(1, n, m, t, w, x, y, hq=force, hp=velocity)
         else if (what%force) then
            call self%model%gradient(1, n, m, t, w, x, y, hq=force)
         else if (self%mass_alone) then
            velocity = w(0)*y
         else
            call self%model%gradient(1, n, m, t, w, x, y, hp=velocity)
         end if
      end associate
   end subroutine evaluate

end module symsde_step_lone_planned
