! SPDX-License-Identifier: BSD-3-Clause
!> The midpoint rule for a path by itself, where H = p.p/2 + U(q) with noise in position.
!>
!> One degree of freedom by Newton's iteration, the first and the exact one of solve/stagnation; two by the corrections
!> of step/midpoint_equation over one lane; more by the fixed-point iteration of step/midpoint_by_matrix. What is stiff
!> or takes long is left to step/midpoint.
module symsde_step_lone_midpoint
   use symsde_base_kinds, only: wp
   use symsde_model_abstract, only: angle_terms
   use symsde_solve_stagnation, only: ends_exact
   use symsde_step_lone, only: lone_stepper
   use symsde_step_midpoint_equation, only: solve_pair
   use symsde_step_slopes, only: take_slopes
   use symsde_step_stage_iteration, only: sweep_verdict, most_sweeps, stiff_rate, done
   implicit none
   private
   public :: lone_midpoint

   type, extends(lone_stepper) :: lone_midpoint
      logical :: affine = .false.     !! one solve is all
      logical :: iterates = .false.   !! without matrices
      integer :: patience = 7         !! iterations of one unknown, or of two
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
      else if (.not. self%iterates) then
         call solve_two(self, t + 0.5_wp*h, h, w, q, p, dp, taken)
      else
         call solve_several(self, t + 0.5_wp*h, h, w, q, p, dp, taken)
      end if
      !GCC$ novector  ! few numbers
      do i = 1, self%n
         dq(i) = h*(p(i) + 0.5_wp*dp(i))
      end do
   end subroutine take

   !> V + f(base + (h/4) V) = 0 by Newton's iteration from V = 0.
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
         taken = iteration < self%patience
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
      associate (c => self%counters)
         c%gradients = c%gradients + iteration
         c%hessians = c%hessians + iteration
         c%iterations = c%iterations + iteration
         c%solves = c%solves + iteration
      end associate
   end subroutine solve_one

   !> The same for two unknowns.
   subroutine solve_two(self, t, h, w, q, p, v, taken)
      type(lone_midpoint), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(2), p(2)
      real(wp), intent(out) :: v(2)
      logical, intent(out) :: taken
      real(wp) :: base(2), slope(2), g
      integer :: iteration, i

      !GCC$ novector  ! few numbers
      do i = 1, 2
         base(i) = q(i) + 0.5_wp*(h*p(i))
      end do
      g = 0.25_wp*h
      call solve_pair(self%model, self%m, self%patience, self%affine, t, g, w, base, v, slope, iteration)
      taken = iteration > 0 .and. g*slope(1) <= 1 .and. g*slope(2) <= 1  ! mild
      if (.not. taken) return
      associate (c => self%counters)
         c%gradients = c%gradients + iteration
         c%hessians = c%hessians + iteration
         c%iterations = c%iterations + iteration
         c%solves = c%solves + iteration
      end associate
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
            call take_slopes(n, .false., f, v, change, extent)
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

end module symsde_step_lone_midpoint
