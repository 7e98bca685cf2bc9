! SPDX-License-Identifier: BSD-3-Clause
!> The midpoint rule for a path by itself, for any model: q and p are both unknown.
!>
!> Newton's iteration of step/midpoint/full over one lane, where its matrix is dense and its pivots are trusted; before
!> it, where step/midpoint/full begins so, the fixed-point iteration of step/stages/fixed_point. What neither solves is
!> left to the stepper of blocks.
module symsde_step_midpoint_lone_full
   use symsde_base_kinds, only: wp
   use symsde_solve_blocks, only: pivot_floor
   use symsde_solve_elimination, only: solve_lone
   use symsde_solve_stagnation, only: stopping_test, quadratic, verdict_of
   use symsde_step_lone, only: lone_stepper
   use symsde_solve_fixed_point, only: take_alone, sweep_verdict, most_sweeps, stiff_rate, done
   implicit none
   private
   public :: lone_midpoint_full

   type, extends(lone_stepper) :: lone_midpoint_full
      logical :: iterates = .false.           !! first, without matrices
      logical :: solves = .false.             !! by matrices
      type(stopping_test) :: test = quadratic !! of Newton's iteration
      integer :: max_iter = 0
      real(wp), allocatable, dimension(:), private :: x, y, f  !! (Q, P) and the gradient there (n), (n), (2 n)
      real(wp), allocatable, private :: slope(:)  !! Newton's unknowns F_1, G_1, F_2, ..; of sweeps G, then -F (2 n)
      real(wp), allocatable, dimension(:, :), private :: hqq, hqp, hpp, a  !! Hessian (n, n) and matrix (2 n, 2 n)
   contains
      procedure :: take
   end type lone_midpoint_full

contains

   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(lone_midpoint_full), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      integer :: sweeps

      if (.not. allocated(self%x)) call make_room(self)
      sweeps = 0
      taken = .false.
      if (self%iterates) call iterate(self, t + 0.5_wp*h, w, q, p, dq, dp, sweeps, taken)
      if (.not. taken .and. self%solves) call solve(self, t + 0.5_wp*h, w, q, p, dq, dp, taken)
      if (.not. taken) return
      self%counters%gradients = self%counters%gradients + sweeps
      self%counters%iterations = self%counters%iterations + sweeps
   end subroutine take

   subroutine make_room(self)
      type(lone_midpoint_full), intent(inout) :: self

      associate (n => self%n)
         allocate (self%x(n), self%y(n), self%f(2*n), self%slope(2*n))
         if (self%solves) allocate (self%hqq(n, n), self%hqp(n, n), self%hpp(n, n), self%a(2*n, 2*n))
      end associate
   end subroutine make_room

   !> Q = q + Hhat_p(Q,P)/2 and P = p - Hhat_q(Q,P)/2, again and again.
   subroutine iterate(self, t, w, q, p, dq, dp, sweep, taken)
      type(lone_midpoint_full), intent(inout) :: self
      real(wp), intent(in) :: t, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      integer, intent(out) :: sweep
      logical, intent(out) :: taken
      real(wp) :: change, extent, last
      integer :: i

      last = 0
      sweep = 0
      associate (n => self%n, x => self%x, y => self%y, f => self%f, slope => self%slope)
         x = q
         y = p
         do while (last >= 0 .and. sweep < most_sweeps)
            sweep = sweep + 1
            call self%model%gradient(1, n, self%m, t, w, x, y, hq=f(:n), hp=f(n + 1:))
            change = 0
            extent = 0
            call take_alone(2*n, sweep == 1, f, slope, change, extent)
            !GCC$ novector  ! few numbers
            do i = 1, n
               x(i) = q(i) - 0.5_wp*slope(n + i)
               y(i) = p(i) + 0.5_wp*slope(i)
            end do
            last = sweep_verdict(sweep, stiff_rate, stiff_rate, change, extent, last)
         end do
         dq = -slope(n + 1:)
         dp = slope(:n)
      end associate
      taken = abs(last - done) <= 0
   end subroutine iterate

   !> Newton's iteration from no increments.
   subroutine solve(self, t, w, q, p, dq, dp, taken)
      type(lone_midpoint_full), intent(inout) :: self
      real(wp), intent(in) :: t, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      real(wp) :: last, step, size, smallest
      integer :: iteration, i

      last = 0
      iteration = 0
      dq = 0
      dp = 0
      associate (n => self%n, x => self%x, y => self%y, f => self%f, r => self%slope)
         do while (last >= 0)
            taken = iteration < self%max_iter
            if (.not. taken) return
            iteration = iteration + 1
            !GCC$ novector  ! few numbers
            do i = 1, n
               x(i) = q(i) + 0.5_wp*dq(i)
               y(i) = p(i) + 0.5_wp*dp(i)
            end do
            call self%model%gradient_hessian(1, n, self%m, t, w, x, y, f(:n), f(n + 1:), self%hqq, self%hqp, self%hpp)
            call find_matrix(n, self%hqq, self%hqp, self%hpp, self%a)
            !GCC$ novector
            do i = 1, n
               r(2*i - 1) = dq(i) - f(n + i)
               r(2*i) = dp(i) + f(i)
            end do
            call solve_lone(2*n, self%a, r, smallest)
            taken = smallest > pivot_floor
            if (.not. taken) return
            call correct(n, r, dq, dp, step, size)
            taken = step + size <= huge(t)
            if (.not. taken) return
            last = verdict_of(self%test, step, size, last)
         end do
      end associate
      associate (c => self%counters)
         c%gradients = c%gradients + iteration
         c%hessians = c%hessians + iteration
         c%iterations = c%iterations + iteration
         c%solves = c%solves + iteration
      end associate
   end subroutine solve

   ! ---- kernels ----------------------------------------------------------------------------------

   !> I + (-Hhat_pq, -Hhat_pp; Hhat_qq, Hhat_qp)/2, unknowns degree by degree.
   pure subroutine find_matrix(n, hqq, hqp, hpp, a)
      integer, intent(in) :: n
      real(wp), intent(in), dimension(n, n) :: hqq, hqp, hpp
      real(wp), intent(out) :: a(2, n, 2, n)
      integer :: i, j

      do j = 1, n
         !GCC$ novector
         do i = 1, n
            a(1, i, 1, j) = -0.5_wp*hqp(j, i)
            a(1, i, 2, j) = -0.5_wp*hpp(i, j)
            a(2, i, 1, j) = 0.5_wp*hqq(i, j)
            a(2, i, 2, j) = 0.5_wp*hqp(i, j)
         end do
         a(1, j, 1, j) = 1 + a(1, j, 1, j)
         a(2, j, 2, j) = 1 + a(2, j, 2, j)
      end do
   end subroutine find_matrix

   !> The increments less the correction, with the size of both.
   pure subroutine correct(n, r, dq, dp, step, size)
      integer, intent(in) :: n
      real(wp), intent(in) :: r(2, n)
      real(wp), intent(inout) :: dq(n), dp(n)
      real(wp), intent(out) :: step, size
      real(wp) :: zero
      integer :: i

      step = 0
      size = 0
      zero = 0
      !GCC$ novector
      do i = 1, n
         dq(i) = dq(i) - r(1, i)
         dp(i) = dp(i) - r(2, i)
         step = max(step, abs(r(1, i)), abs(r(2, i)))
         size = max(size, abs(dq(i)), abs(dp(i)))
         zero = zero + (0*r(1, i) + 0*r(2, i))
      end do
      step = step + zero  ! NaN stays
   end subroutine correct

end module symsde_step_midpoint_lone_full
