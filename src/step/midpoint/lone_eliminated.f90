! SPDX-License-Identifier: BSD-3-Clause
!> The midpoint rule for a path by itself, where H = p.p/2 + U(q) with noise in position.
!>
!> One degree of freedom by Newton's iteration, the first and the exact one of solve/stagnation; two by the corrections
!> of step/midpoint/equation over one lane; more by the fixed-point iteration of step/midpoint/dense. What takes
!> long is left to step/midpoint/eliminated, and so are stiff steps of more than two.
module symsde_step_midpoint_lone_eliminated
   use symsde_base_kinds, only: wp
   use symsde_model_abstract, only: angle_terms
   use symsde_solve_newton, only: patience
   use symsde_solve_stagnation, only: quadratic, ends_exact, verdict_of
   use symsde_step_lone, only: lone_stepper
   use symsde_step_midpoint_equation, only: solve_pair
   use symsde_solve_fixed_point, only: take_alone, sweep_verdict, most_sweeps, stiff_rate, done
   implicit none
   private
   public :: lone_midpoint

   type, extends(lone_stepper) :: lone_midpoint
      logical :: affine = .false.     !! one solve is all
      logical :: iterates = .false.   !! without matrices
      integer :: max_iter = 0         !! of Newton's iterations
      real(wp), allocatable, dimension(:), private :: base, x, f, still  !! of several unknowns (n)
   contains
      procedure :: take
   end type lone_midpoint

contains

   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(lone_midpoint), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      integer :: i

      if (self%n == 1) then
         call solve_one(self, t + 0.5_wp*h, h, w, q(1), p(1), dp(1), taken)
         if (.not. taken) then
            call solve_one_slowly(self, t + 0.5_wp*h, h, w, q(1), p(1), dq(1), dp(1), taken)
            return
         end if
      else if (.not. self%iterates) then
         call solve_two(self, t + 0.5_wp*h, h, w, q, p, dq, dp, taken)
         return
      else
         call solve_several(self, t + 0.5_wp*h, h, w, q, p, dp, taken)
      end if
      !GCC$ novector  ! few numbers
      do i = 1, self%n
         dq(i) = h*(p(i) + 0.5_wp*dp(i))
      end do
   end subroutine take

   !> V + f(base + (h/4) V) = 0 by Newton's iteration from V = 0, where it is mild and short.
   subroutine solve_one(self, t, h, w, q, p, v, taken)
      type(lone_midpoint), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q, p
      real(wp), intent(out) :: v
      logical, intent(out) :: taken
      type(angle_terms) :: terms
      real(wp) :: base, f, slope, g, d, last, bend
      logical :: ends
      integer :: iteration

      g = 0.25_wp*h
      base = q + 0.5_wp*(h*p)
      call self%find_terms(t, w, terms)
      f = self%force_at(terms, t, w, base, 0.0_wp, slope)
      bend = g*slope
      v = -f/(1 + bend)
      taken = 1 - bend >= 0 .and. abs(v) <= huge(v)
      if (.not. taken) return
      ends = self%affine .or. abs(v) <= 0
      last = abs(v)
      iteration = 1
      do while (.not. ends)
         taken = iteration < min(self%max_iter, patience - 1)
         if (.not. taken) return
         iteration = iteration + 1
         f = self%force_at(terms, t, w, base + g*v, 0.0_wp, slope)
         d = (v + f)/(1 + g*slope)
         v = v - d
         taken = abs(v) <= huge(v)
         if (.not. taken) return
         ends = ends_exact(abs(d), abs(v), last)
         last = abs(d)
      end do
      call count_up(self, iteration)
   end subroutine solve_one

   !> However long it takes, and where it is stiff from there with dq as the unknown, as step/midpoint/eliminated says
   !> it.
   subroutine solve_one_slowly(self, t, h, w, q, p, dq, v, taken)
      type(lone_midpoint), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q, p
      real(wp), intent(out) :: dq, v
      logical, intent(out) :: taken
      real(wp) :: slope, unused, drift
      integer :: iterations, more

      v = 0
      call iterate_one(self, t, h, w, 0.25_wp*h, q + 0.5_wp*(h*p), 1.0_wp, 0.0_wp, v, slope, iterations, taken)
      if (.not. taken) return
      dq = h*(p + 0.5_wp*v)
      if (h*slope > 4) then
         drift = h*p
         call iterate_one(self, t, h, w, 0.5_wp, q, 0.5_wp*h, drift, dq, unused, more, taken)
         if (.not. taken) return
         iterations = iterations + more
         v = 2*(dq - drift)/h
      end if
      call count_up(self, iterations)
   end subroutine solve_one_slowly

   !> x + f(base + c x) = 0, f = weight Hhat_q - drift, by Newton's iteration.
   subroutine iterate_one(self, t, h, w, c, base, weight, drift, x, first_slope, iterations, taken)
      type(lone_midpoint), intent(in) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), c, base, weight, drift
      real(wp), intent(inout) :: x
      real(wp), intent(out) :: first_slope  !! Hhat_qq
      integer, intent(out) :: iterations
      logical, intent(out) :: taken
      type(angle_terms) :: terms
      real(wp) :: f, slope, d, last

      call self%find_terms(t, w, terms)
      last = 0
      do iterations = 1, self%max_iter
         f = weight*self%force_at(terms, t, w, base + c*x, 0.0_wp, slope) - drift
         if (iterations == 1) first_slope = slope
         d = (x + f)/(1 + 0.25_wp*h*slope)
         x = x - d
         taken = abs(x) <= huge(x)
         if (.not. taken) return
         if (self%affine .or. has_ended(iterations, abs(d), abs(x), last)) return
         last = abs(d)
      end do
      taken = .false.
   end subroutine iterate_one

   !> Whether one unknown has converged, as solve/newton tests it.
   pure logical function has_ended(iteration, d, size, last)
      integer, intent(in) :: iteration
      real(wp), intent(in) :: d, size, last  !! sizes of this correction, of the unknown and of the correction before

      if (iteration <= patience) then
         has_ended = ends_exact(d, size, last)
      else
         has_ended = verdict_of(quadratic, d, size, last) < 0
      end if
   end function has_ended

   !> Newton's iterations, each with a gradient, a Hessian and a solve.
   subroutine count_up(self, iterations)
      type(lone_midpoint), intent(inout) :: self
      integer, intent(in) :: iterations

      associate (c => self%counters)
         c%gradients = c%gradients + iterations
         c%hessians = c%hessians + iterations
         c%iterations = c%iterations + iterations
         c%solves = c%solves + iterations
      end associate
   end subroutine count_up

   !> The same for two unknowns.
   subroutine solve_two(self, t, h, w, q, p, dq, v, taken)
      type(lone_midpoint), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(2), p(2)
      real(wp), intent(out) :: dq(2), v(2)
      logical, intent(out) :: taken
      real(wp) :: base(2), drift(2), slope(2), unused(2), g
      integer :: iteration, more, i

      !GCC$ novector
      do i = 1, self%n  ! not 2: that would be vectors, which wait for both of their parts
         base(i) = q(i) + 0.5_wp*(h*p(i))
      end do
      g = 0.25_wp*h
      v = 0
      call solve_pair(self%model, self%m, self%max_iter, self%affine, t, h, w, base, v, slope, iteration)
      taken = iteration > 0
      if (.not. taken) return
      !GCC$ novector
      do i = 1, self%n
         dq(i) = h*(p(i) + 0.5_wp*v(i))
      end do
      if (g*slope(1) > 1 .or. g*slope(2) > 1) then
         drift = h*p
         call solve_pair(self%model, self%m, self%max_iter, self%affine, t, h, w, q, dq, unused, more, drift)
         taken = more > 0
         if (.not. taken) return
         iteration = iteration + more
         v = 2*(dq - drift)/h
      end if
      call count_up(self, iteration)
   end subroutine solve_two

   !> V = -f(base + (h/4) V), again and again.
   subroutine solve_several(self, t, h, w, q, p, v, taken)
      type(lone_midpoint), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: v(self%n)
      logical, intent(out) :: taken
      real(wp) :: c, change, extent, last
      integer :: i, sweep

      if (.not. allocated(self%x)) then
         allocate (self%base(self%n), self%x(self%n), self%f(self%n))
         allocate (self%still(self%n), source=0.0_wp)
      end if
      c = 0.25_wp*h
      last = 0
      sweep = 0
      v = 0
      associate (n => self%n, base => self%base, x => self%x, f => self%f)
         do i = 1, n
            base(i) = q(i) + 0.5_wp*(h*p(i))
            x(i) = base(i)
         end do
         do while (last >= 0 .and. sweep < most_sweeps)
            sweep = sweep + 1
            call self%model%gradient(1, n, self%m, t, w, x, self%still, hq=f)
            change = 0
            extent = 0
            call take_alone(n, .false., f, v, change, extent)
            do i = 1, n
               x(i) = base(i) + c*v(i)  ! for the next sweep
            end do
            last = sweep_verdict(sweep, stiff_rate, stiff_rate, change, extent, last)
         end do
      end associate
      taken = abs(last - done) <= 0
      if (.not. taken) return
      self%counters%gradients = self%counters%gradients + sweep
      self%counters%iterations = self%counters%iterations + sweep
   end subroutine solve_several

end module symsde_step_midpoint_lone_eliminated
