! SPDX-License-Identifier: BSD-3-Clause
!> Implicit stages of one degree of freedom for a path by itself: the first guess and the iterations of
!> step/one_dof/newton where the Hamiltonians are separable, or one solve where they are quadratic.
module symsde_step_one_dof_scalar_newton
   use symsde_base_kinds, only: wp
   use symsde_model_abstract, only: angle_terms
   use symsde_solve_blocks, only: pivot_floor
   use symsde_solve_elimination, only: solve_scalar
   use symsde_solve_stagnation, only: verdict_of, gives_up, quadratic
   use symsde_step_scalar_path, only: scalar_path
   use symsde_step_one_dof_two_stages, only: find_points, add_stages, correct_alone, solve_lanes
   implicit none
   private
   public :: scalar_newton, most_stages, correct

   integer, parameter :: most_stages = 4

   type, extends(scalar_path) :: scalar_newton
      integer :: s = 2
      real(wp), dimension(most_stages) :: c = 0, alpha = 0
      real(wp), dimension(most_stages, most_stages) :: a = 0, abar = 0
      integer :: max_iter = 0
      logical :: affine = .false.  !! one solve is all
   contains
      procedure :: set
      procedure :: take
   end type scalar_newton

contains

   !> Coefficients of up to most_stages.
   subroutine set(self, a, abar, alpha, c)
      class(scalar_newton), intent(inout) :: self
      real(wp), intent(in) :: a(:, :), abar(:, :), alpha(:), c(:)

      self%s = size(alpha)
      self%c(:self%s) = c
      self%alpha(:self%s) = alpha
      self%a(:self%s, :self%s) = a
      self%abar(:self%s, :self%s) = abar
   end subroutine set

   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(scalar_newton), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      type(angle_terms) :: terms, terms2
      real(wp) :: a(2, 2), abar(2, 2), x(4), last, before, step, size, qs(2), ps(2), t1, t2
      real(wp) :: hq1, hq2, hp1, hp2, hqq1, hqq2, hpp1, hpp2
      integer :: iteration
      logical :: flies

      if (self%affine) then
         call solve_once(self, t, h, w, q, p, dq, dp, taken)
         return
      else if (self%s == 3) then
         call iterate(self, 3, t, h, w, q(1), p(1), dq(1), dp(1), taken)
         return
      else if (self%s == 4) then
         call iterate(self, 4, t, h, w, q(1), p(1), dq(1), dp(1), taken)
         return
      end if
      a = self%a(:2, :2)
      abar = self%abar(:2, :2)
      t1 = t + self%c(1)*h
      t2 = t + self%c(2)*h
      call self%find_terms(t1, w, terms)
      call self%find_terms(t2, w, terms2)
      call begin(self, 2, t1, h, w, terms, q(1), p(1), x, flies)
      call find_points(a, abar, q(1), p(1), x, qs, ps)
      last = 0
      iteration = 0
      do while (last >= 0)
         taken = iteration < self%max_iter
         if (.not. taken) return
         iteration = iteration + 1
         hq1 = self%force_at(terms, t1, w, qs(1), ps(1), hqq1, hp1, hpp1)
         hq2 = self%force_at(terms2, t2, w, qs(2), ps(2), hqq2, hp2, hpp2)
         call correct_alone(a, abar, hq1, hq2, hp1, hp2, hqq1, hqq2, hpp1, hpp2, q(1), p(1), x, qs, ps, step, size, &
                            taken)
         if (.not. taken) return
         before = last
         last = verdict_of(quadratic, step, size, before)
         if (flies .and. iteration == 2) then
            call land(2, before, size, hqq1, hpp1, last, x)
            call find_points(a, abar, q(1), p(1), x, qs, ps)
         end if
      end do
      call add_stages(1, self%alpha(:2), x, dq, dp)
      associate (c => self%counters)
         c%gradients = c%gradients + merge(1, 0, flies) + 2*iteration
         c%hessians = c%hessians + 2*iteration
         c%iterations = c%iterations + iteration
         c%solves = c%solves + iteration
      end associate
   end subroutine take

   !> Three or four stages, with the operations of step/one_dof/newton on a lane. What does not count is added as
   !> zero: every number of stages has loops of its own length.
   subroutine iterate(self, s, t, h, w, q, p, dq, dp, taken)
      type(scalar_newton), intent(inout) :: self
      integer, value :: s
      real(wp), intent(in) :: t, h, w(0:self%m), q, p
      real(wp), intent(out) :: dq, dp
      logical, intent(out) :: taken
      type(angle_terms) :: terms(most_stages)
      real(wp) :: x(2*most_stages), d(2*most_stages), last, before, step, size
      real(wp), dimension(most_stages) :: hq, hp, hqq, hpp
      integer :: iteration, i
      logical :: flies

      do i = 1, s
         call self%find_terms(t + self%c(i)*h, w, terms(i))
      end do
      call begin(self, s, t + self%c(1)*h, h, w, terms(1), q, p, x, flies)
      last = 0
      iteration = 0
      do while (last >= 0)
         taken = iteration < self%max_iter
         if (.not. taken) return
         iteration = iteration + 1
         do i = 1, s
            hq(i) = self%force_at(terms(i), t + self%c(i)*h, w, weighed(s, self%a(i, :), x, q), &
                                  weighed(s, self%abar(i, :), x(s + 1:), p), hqq(i), hp(i), hpp(i))
         end do
         call find_correction(s, self%a, self%abar, hq, hp, hqq, hpp, x, d, taken)
         if (.not. taken) return
         call correct(2*s, d, x, step, size, taken)
         if (.not. taken) return
         before = last
         last = verdict_of(quadratic, step, size, before)
         if (flies .and. iteration == 2) call land(s, before, size, hqq(1), hpp(1), last, x)
      end do
      dq = weighed(s, self%alpha, x, 0.0_wp)
      dp = weighed(s, self%alpha, x(s + 1:), 0.0_wp)
      associate (c => self%counters)
         c%gradients = c%gradients + merge(1, 0, flies) + s*iteration
         c%hessians = c%hessians + s*iteration
         c%iterations = c%iterations + iteration
         c%solves = c%solves + iteration
      end associate
   end subroutine iterate

   !> The first guess of step/one_dof/newton.
   subroutine begin(self, s, t, h, w, terms, q, p, x, flies)
      type(scalar_newton), intent(in) :: self
      integer, value :: s
      real(wp), intent(in) :: t, h, w(0:self%m), q, p  !! t is that of the first stage
      type(angle_terms), intent(in) :: terms           !! of that time
      real(wp), intent(out) :: x(2*s)
      logical, intent(out) :: flies

      x = 0
      flies = self%model%traits%is_slow(h)
      if (flies) x(:s) = self%velocity_at(terms, t, w, q, p)
   end subroutine begin

   !> From zero where the velocity has led too far.
   pure subroutine land(s, before, size, hqq, hpp, last, x)
      integer, value :: s
      real(wp), intent(in) :: before, size, hqq, hpp
      real(wp), intent(inout) :: last, x(2*s)

      if (.not. gives_up(before, last, size, hqq, hpp)) return
      x = 0
      last = 0
   end subroutine land

   !> add_slopes of one number.
   pure real(wp) function weighed(s, c, x, start)
      integer, value :: s
      real(wp), intent(in) :: c(s), x(s), start
      integer :: i

      weighed = start
      !GCC$ novector  ! sums in order
      do i = 1, s
         weighed = weighed + c(i)*x(i)
      end do
   end function weighed

   !> Newton's correction of the slopes; not where pivots are not trusted.
   pure subroutine find_correction(s, a, abar, hq, hp, hqq, hpp, x, d, trusted)
      integer, value :: s
      real(wp), intent(in) :: a(most_stages, most_stages), abar(most_stages, most_stages)
      real(wp), intent(in), dimension(most_stages) :: hq, hp, hqq, hpp
      real(wp), intent(in) :: x(2*most_stages)
      real(wp), intent(out) :: d(2*most_stages)
      logical, intent(out) :: trusted
      real(wp) :: m(most_stages*most_stages), g(most_stages), total, smallest  ! of their first s rows and columns
      integer :: i, j, k

      m = 0
      do i = 1, s
         m(i + s*(i - 1)) = 1
         d(i) = x(i) - hp(i)
      end do
      do i = 1, s
         total = 0
         !GCC$ novector  ! sums in order, contracted as in lanes
         do k = 1, s
            total = total - a(i, k)*d(k)
         end do
         g(i) = x(s + i) + hq(i) + hqq(i)*total
         do j = 1, s
            total = 0
            !GCC$ novector
            do k = 1, s
               total = total + a(i, k)*abar(k, j)*hpp(k)
            end do
            m(i + s*(j - 1)) = m(i + s*(j - 1)) + hqq(i)*total
         end do
      end do
      call solve_scalar(s, m, g, smallest)
      trusted = smallest > pivot_floor
      do j = 1, s
         do i = 1, s
            d(i) = d(i) + abar(i, j)*hpp(i)*g(j)
         end do
         d(s + j) = g(j)
      end do
   end subroutine find_correction

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

   !> From slopes of zero, where all stages are where the step begins.
   subroutine solve_once(self, t, h, w, q, p, dq, dp, taken)
      type(scalar_newton), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(1), p(1)
      real(wp), intent(out) :: dq(1), dp(1)
      logical, intent(out) :: taken
      real(wp) :: a(2, 2), abar(2, 2), x(2*most_stages), d(2*most_stages), step, size
      real(wp), dimension(1, most_stages) :: hq, hp, hqq, hqp, hpp
      integer :: i

      do i = 1, self%s
         call self%model%gradient_hessian(1, 1, self%m, t + self%c(i)*h, w, q, p, hq(:, i), hp(:, i), hqq(:, i), &
                                          hqp(:, i), hpp(:, i))
      end do
      x = 0
      taken = .true.
      if (self%s == 2) then
         a = self%a(:2, :2)
         abar = self%abar(:2, :2)
         call solve_lanes(1, a, abar, hq(:, 1), hq(:, 2), hp(:, 1), hp(:, 2), hqq(:, 1), hqq(:, 2), &
                          hqp(:, 1), hqp(:, 2), hpp(:, 1), hpp(:, 2), x, d)
      else
         call solve_whole(self%s, self%a, self%abar, hq, hp, hqq, hqp, hpp, d, taken)
      end if
      if (taken) call correct(2*self%s, d, x, step, size, taken)
      if (.not. taken) return
      if (self%s == 2) then
         call add_stages(1, self%alpha(:2), x, dq, dp)
      else
         dq = weighed(self%s, self%alpha, x, 0.0_wp)
         dp = weighed(self%s, self%alpha, x(self%s + 1:), 0.0_wp)
      end if
      associate (c => self%counters)
         c%gradients = c%gradients + self%s
         c%hessians = c%hessians + self%s
         c%iterations = c%iterations + 1
         c%solves = c%solves + 1
      end associate
   end subroutine solve_once

   !> Newton's correction from slopes of zero by the whole matrix; not where pivots are not trusted.
   pure subroutine solve_whole(s, a, abar, hq, hp, hqq, hqp, hpp, d, trusted)
      integer, intent(in) :: s
      real(wp), intent(in) :: a(most_stages, most_stages), abar(most_stages, most_stages)
      real(wp), intent(in), dimension(most_stages) :: hq, hp, hqq, hqp, hpp
      real(wp), intent(out) :: d(2*s)
      logical, intent(out) :: trusted
      real(wp) :: m(2*s, 2*s), smallest
      integer :: i, k

      m = 0
      do i = 1, 2*s
         m(i, i) = 1
      end do
      do k = 1, s
         do i = 1, s
            m(i, k) = m(i, k) - a(i, k)*hqp(i)
            m(i, s + k) = -(abar(i, k)*hpp(i))
            m(s + i, k) = a(i, k)*hqq(i)
            m(s + i, s + k) = m(s + i, s + k) + abar(i, k)*hqp(i)
         end do
         d(k) = 0 - hp(k)
         d(s + k) = 0 + hq(k)
      end do
      call solve_scalar(2*s, m, d, smallest)
      trusted = smallest > pivot_floor
   end subroutine solve_whole

end module symsde_step_one_dof_scalar_newton
