! SPDX-License-Identifier: BSD-3-Clause
!> The midpoint rule for a chain by itself: Newton's iterations of step/midpoint/tridiagonal in one lane, where its
!> pivots are trusted and its equations are solved soon. What is not is left to step/midpoint/eliminated.
module symsde_step_midpoint_lone_tridiagonal
   use symsde_base_kinds, only: wp
   use symsde_solve_stagnation, only: stopping_test, quadratic, verdict_of
   use symsde_solve_tridiagonal, only: solve_lane
   use symsde_step_lone, only: lone_stepper
   implicit none
   private
   public :: lone_midpoint_rows

   type, extends(lone_stepper) :: lone_midpoint_rows
      type(stopping_test) :: test = quadratic
      integer :: max_iter = 0
      real(wp), allocatable, dimension(:), private :: base, x, f, drift, still, factor, rhs  !! (n)
      real(wp), allocatable, private :: k(:, :)  !! (0:1, 0:n)
   contains
      procedure :: take
   end type lone_midpoint_rows

contains

   !> V, and where that is stiff from there dq, as step/midpoint/eliminated says it.
   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(lone_midpoint_rows), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      real(wp) :: stiff_ratio, unused
      integer :: i, iterations, more

      if (.not. allocated(self%x)) call make_room(self)
      do i = 1, self%n
         self%base(i) = q(i) + 0.5_wp*(h*p(i))
         dp(i) = 0
      end do
      call solve(self, t, h, w, .false., dp, stiff_ratio, iterations, taken)
      if (.not. taken) return
      do i = 1, self%n
         dq(i) = h*(p(i) + 0.5_wp*dp(i))
      end do
      if (stiff_ratio > 1) then
         do i = 1, self%n
            self%base(i) = q(i)
            self%drift(i) = h*p(i)
         end do
         call solve(self, t, h, w, .true., dq, unused, more, taken)
         if (.not. taken) return
         iterations = iterations + more
         do i = 1, self%n
            dp(i) = 2*(dq(i) - self%drift(i))/h
         end do
      end if
      associate (counters => self%counters)
         counters%gradients = counters%gradients + iterations
         counters%hessians = counters%hessians + iterations
         counters%iterations = counters%iterations + iterations
         counters%solves = counters%solves + iterations
      end associate
   end subroutine take

   !> Newton's iteration for x + f(base + c x) = 0, from V = 0 or from a dq.
   subroutine solve(self, t, h, w, for_dq, x, stiff_ratio, iterations, taken)
      class(lone_midpoint_rows), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m)
      logical, intent(in) :: for_dq
      real(wp), intent(inout) :: x(self%n)
      real(wp), intent(out) :: stiff_ratio  !! of the first matrix
      integer, intent(out) :: iterations
      logical, intent(out) :: taken         !! converged soon, its pivots trusted, and finite
      real(wp) :: c, last, trusted, largest, step, size
      integer :: i

      c = merge(0.5_wp, 0.25_wp*h, for_dq)
      last = 0
      iterations = 0
      associate (n => self%n, point => self%x)
         do while (last >= 0)
            taken = iterations < self%max_iter
            if (.not. taken) return
            if (for_dq .or. iterations > 0) then
               do i = 1, n
                  point(i) = self%base(i) + c*x(i)
               end do
            else
               point = self%base
            end if
            call self%model%force_stiffness(1, n, self%m, 1, t + 0.5_wp*h, w, point, self%still, self%f, self%k(0, 1))
            if (for_dq) then
               do i = 1, n
                  self%f(i) = 0.5_wp*h*self%f(i) - self%drift(i)
               end do
            end if
            call solve_lane(n, 0.25_wp*h, self%f, self%k, self%factor, self%rhs, x, trusted, largest, step, size)
            taken = trusted > 0
            if (.not. taken) return
            if (iterations == 0) stiff_ratio = largest - 1
            last = verdict_of(self%test, step, size, last)
            iterations = iterations + 1
         end do
      end associate
      taken = step + size <= huge(h)
   end subroutine solve

   subroutine make_room(self)
      type(lone_midpoint_rows), intent(inout) :: self

      associate (n => self%n)
         allocate (self%base(n), self%x(n), self%f(n), self%drift(n), self%factor(n), self%rhs(n), self%k(0:1, 0:n))
         allocate (self%still(n), source=0.0_wp)
      end associate
   end subroutine make_room

end module symsde_step_midpoint_lone_tridiagonal
