! SPDX-License-Identifier: BSD-3-Clause
!> The midpoint rule for a chain by itself: Newton's iteration of step/midpoint_by_rows in one lane, where that is mild,
!> its pivots are trusted and its equations are solved soon. What is not is left to step/midpoint.
module symsde_step_lone_midpoint_rows
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
      real(wp), allocatable, dimension(:), private :: base, x, f, still, factor, rhs  !! (n)
      real(wp), allocatable, private :: k(:, :)  !! (0:1, 0:n)
   contains
      procedure :: take
   end type lone_midpoint_rows

contains

   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(lone_midpoint_rows), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      real(wp) :: c, last, trusted, largest, step, size
      integer :: i, iteration

      if (.not. allocated(self%x)) call make_room(self)
      c = 0.25_wp*h
      last = 0
      iteration = 0
      associate (n => self%n, base => self%base, x => self%x)
         do i = 1, n
            base(i) = q(i) + 0.5_wp*(h*p(i))
            x(i) = base(i)
            dp(i) = 0
         end do
         do while (last >= 0)
            taken = iteration < self%max_iter
            if (.not. taken) return
            if (iteration > 0) then
               do i = 1, n
                  x(i) = base(i) + c*dp(i)
               end do
            end if
            call self%model%force_stiffness(1, n, self%m, 1, t + 0.5_wp*h, w, x, self%still, self%f, &
                                            self%k(0, 1))
            call solve_lane(n, c, self%f, self%k, self%factor, self%rhs, dp, trusted, largest, step, size)
            taken = trusted > 0 .and. (iteration > 0 .or. largest - 1 <= 1)
            if (.not. taken) return
            last = verdict_of(self%test, step, size, last)
            iteration = iteration + 1
         end do
         taken = step + size <= huge(h)
         if (.not. taken) return
         do i = 1, n
            dq(i) = h*(p(i) + 0.5_wp*dp(i))
         end do
      end associate
      associate (counters => self%counters)
         counters%gradients = counters%gradients + iteration
         counters%hessians = counters%hessians + iteration
         counters%iterations = counters%iterations + iteration
         counters%solves = counters%solves + iteration
      end associate
   end subroutine take

   subroutine make_room(self)
      type(lone_midpoint_rows), intent(inout) :: self

      associate (n => self%n)
         allocate (self%base(n), self%x(n), self%f(n), self%factor(n), self%rhs(n), self%k(0:1, 0:n))
         allocate (self%still(n), source=0.0_wp)
      end associate
   end subroutine make_room

end module symsde_step_lone_midpoint_rows
