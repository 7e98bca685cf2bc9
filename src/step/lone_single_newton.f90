! SPDX-License-Identifier: BSD-3-Clause
!> Two implicit stages of one degree of freedom for a path by itself: the first guess and the iterations of
!> step/single_newton where the Hamiltonians are separable, or its one solve where they are quadratic, by its passes
!> over one lane.
module symsde_step_lone_two_stages
   use symsde_base_kinds, only: wp
   use symsde_model_abstract, only: angle_terms
   use symsde_solve_stagnation, only: verdict_of, quadratic
   use symsde_step_lone, only: lone_stepper
   use symsde_step_two_stage_slopes, only: stage_point, add_stages, solve_separable, solve_lanes
   implicit none
   private
   public :: lone_two_stages

   type, extends(lone_stepper) :: lone_two_stages
      real(wp) :: a(2, 2) = 0, abar(2, 2) = 0, alpha(2) = 0, c(2) = 0
      integer :: max_iter = 0
      logical :: affine = .false.  !! one solve is all
   contains
      procedure :: take
   end type lone_two_stages

contains

   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(lone_two_stages), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      type(angle_terms) :: terms, terms2
      real(wp) :: x(4), d(4), last, step, size, qs(1), ps(1), t1, t2
      real(wp), dimension(1) :: hq1, hq2, hp1, hp2, hqq1, hqq2, hpp1, hpp2
      integer :: iteration

      if (self%affine) then
         call solve_once(self, t, h, w, q, p, dq, dp, taken)
         return
      end if
      associate (a => self%a, abar => self%abar)
         x = 0
         call self%find_terms(t + 0.5_wp*h, w, terms)
         hq1 = self%force_at(terms, t + 0.5_wp*h, w, q(1), p(1), hqq1(1), hp1(1), hpp1(1))
         call solve_separable(1, a, abar, hq1, hq1, hp1, hp1, hqq1, hqq1, hpp1, hpp1, x, d)
         call correct(4*self%n, d, x, step, size, taken)
         t1 = t + self%c(1)*h
         t2 = t + self%c(2)*h
         call self%find_terms(t1, w, terms)
         call self%find_terms(t2, w, terms2)
         last = 0
         iteration = 0
         do while (last >= 0)
            taken = iteration < self%max_iter
            if (.not. taken) return
            iteration = iteration + 1
            call stage_point(1, 1, a, abar, q, p, x, qs, ps)
            hq1 = self%force_at(terms, t1, w, qs(1), ps(1), hqq1(1), hp1(1), hpp1(1))
            call stage_point(1, 2, a, abar, q, p, x, qs, ps)
            hq2 = self%force_at(terms2, t2, w, qs(1), ps(1), hqq2(1), hp2(1), hpp2(1))
            call solve_separable(1, a, abar, hq1, hq2, hp1, hp2, hqq1, hqq2, hpp1, hpp2, x, d)
            call correct(4*self%n, d, x, step, size, taken)
            if (.not. taken) return
            last = verdict_of(quadratic, step, size, last)
         end do
         call add_stages(1, self%alpha, x, dq, dp)
      end associate
      associate (c => self%counters)
         c%gradients = c%gradients + 1 + 2*iteration
         c%hessians = c%hessians + 1 + 2*iteration
         c%iterations = c%iterations + iteration
         c%solves = c%solves + iteration
      end associate
   end subroutine take

   !> x = x - d and the sizes of both; sound says that x is finite. Number by number, as d has just been stored: a
   !> vector of them would wait for the stores.
   pure subroutine correct(n, d, x, step, size, sound)
      integer, intent(in) :: n
      real(wp), intent(in) :: d(n)
      real(wp), intent(inout) :: x(n)
      real(wp), intent(out) :: step, size
      logical, intent(out) :: sound
      real(wp) :: total
      integer :: i

      step = 0
      size = 0
      total = 0
      !GCC$ novector
      do i = 1, n
         x(i) = x(i) - d(i)
         step = max(step, abs(d(i)))
         size = max(size, abs(x(i)))
         total = total + x(i)
      end do
      sound = abs(total) <= huge(total)
   end subroutine correct

   !> From slopes of zero, where both stages are where the step begins.
   subroutine solve_once(self, t, h, w, q, p, dq, dp, taken)
      type(lone_two_stages), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(1), p(1)
      real(wp), intent(out) :: dq(1), dp(1)
      logical, intent(out) :: taken
      real(wp) :: x(4), d(4), step, size
      real(wp), dimension(1, 2) :: hq, hp, hqq, hqp, hpp
      integer :: i

      do i = 1, 2
         call self%model%gradient_hessian(1, 1, self%m, t + self%c(i)*h, w, q, p, hq(:, i), hp(:, i), hqq(:, i), &
                                          hqp(:, i), hpp(:, i))
      end do
      x = 0
      call solve_lanes(1, self%a, self%abar, hq(:, 1), hq(:, 2), hp(:, 1), hp(:, 2), hqq(:, 1), hqq(:, 2), &
                       hqp(:, 1), hqp(:, 2), hpp(:, 1), hpp(:, 2), x, d)
      call correct(4*self%n, d, x, step, size, taken)
      if (.not. taken) return
      call add_stages(1, self%alpha, x, dq, dp)
      associate (c => self%counters)
         c%gradients = c%gradients + 2
         c%hessians = c%hessians + 2
         c%iterations = c%iterations + 1
         c%solves = c%solves + 1
      end associate
   end subroutine solve_once

end module symsde_step_lone_two_stages
