! SPDX-License-Identifier: BSD-3-Clause
!> An update of Newton's iteration, solve/newton, for a single path: A d = r, x <- x - d, and the test.
!>
!> The matrix is eliminated where it stands. Where its pivots are not trusted it is lost, so the same iteration is asked
!> for once more, at the same x, and done by solve/newton, which keeps a matrix for LAPACK: a copy in every iteration
!> takes a tenth of the time of a step.
module symsde_solve_newton_single_path
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_solve_blocks, only: pivot_floor, max_lane_unknowns
   use symsde_solve_elimination_single_path, only: solve_scalar
   use symsde_solve_newton, only: newton_type, patience
   use symsde_solve_stagnation, only: stopping_test, done, failed
   implicit none
   private
   public :: update, judge, first_scalar, update_scalar

contains

   subroutine update(self, x, status, counters)
      class(newton_type), intent(inout) :: self
      real(wp), intent(inout) :: x(self%n)
      integer(i8), intent(inout) :: status(1)
      type(counters_type), intent(inout) :: counters
      real(wp) :: smallest

      if (self%keeps_matrix .or. self%n < 3 .or. self%n > max_lane_unknowns .or. .not. allocated(self%a) .or. &
          self%options%damped) then
         self%keeps_matrix = .false.
         call self%update(x, status, counters)
         return
      end if
      call solve_scalar(self%n, self%a, self%r, smallest)
      self%keeps_matrix = .not. (smallest > pivot_floor .and. is_finite(self%n, self%r))
      if (self%keeps_matrix) return
      call correct(self%n, self%r, x, self%step(1), self%size(1))
      call judge(self, status, counters)
   end subroutine update

   !> The test, by the sizes of correction and unknowns.
   subroutine judge(self, status, counters)
      class(newton_type), intent(inout) :: self
      integer(i8), intent(inout) :: status(1)
      type(counters_type), intent(inout) :: counters
      logical :: failures
      integer :: nrunning

      call test_lanes(1, self%test, self%step, self%size, self%last, nrunning, failures)
      call conclude(self, nrunning, failures, status, counters)
   end subroutine judge

   !> Count the iteration; what is rare is concluded as for blocks.
   subroutine conclude(self, nrunning, failures, status, counters)
      class(newton_type), intent(inout) :: self
      integer, intent(in) :: nrunning
      logical, intent(in) :: failures
      integer(i8), intent(inout) :: status(1)
      type(counters_type), intent(inout) :: counters

      if (failures .or. self%options%fixed_point > 0 .or. self%iteration + 1 >= self%options%max_iter) then
         call self%conclude(nrunning, failures, status, counters)
         return
      end if
      self%iteration = self%iteration + 1
      counters%iterations = counters%iterations + self%nrunning
      counters%solves = counters%solves + self%nrunning
      self%nrunning = nrunning
      self%running = nrunning > 0
   end subroutine conclude

   !> As solve/newton begins a step with one unknown.
   subroutine first_scalar(self, g, base, x, point, stiff, status, counters)
      class(newton_type), intent(inout) :: self
      real(wp), intent(in) :: g, base(1)
      real(wp), intent(out) :: x(1), point(1)
      logical, intent(out) :: stiff
      integer(i8), intent(inout) :: status(1)
      type(counters_type), intent(inout) :: counters
      integer :: nrunning
      logical :: failures

      call correct_first(1, self%test%stagnation, g, self%r, self%a, base, status, x, point, self%last, nrunning, &
                         failures, stiff)
      self%iteration = 0
      self%nrunning = 1
      if (failures) then
         self%nrunning = count(status == 0)
         call fail_nonfinite(1, x, status, self%last, nrunning)
      end if
      call conclude(self, nrunning, failures, status, counters)
   end subroutine first_scalar

   !> As solve/newton goes on with it.
   subroutine update_scalar(self, sign, slope, x, status, counters)
      class(newton_type), intent(inout) :: self
      real(wp), intent(in) :: sign, slope
      real(wp), intent(inout) :: x(1)
      integer(i8), intent(inout) :: status(1)
      type(counters_type), intent(inout) :: counters
      integer :: nrunning
      logical :: failures

      if (self%options%fixed_point > 0) then
         call self%update_scalar(sign, slope, x, status, counters)
         return
      else if (self%exact .and. self%iteration < patience) then
         call correct_exact(1, self%test, sign, slope, self%r, self%a, self%last, x, nrunning, failures)
         if (failures) call fail_nonfinite(1, x, status, self%last, nrunning)
      else
         call correct_scalar(1, self%test, sign, slope, self%r, self%a, self%last, x, nrunning, failures)
      end if
      call conclude(self, nrunning, failures, status, counters)
   end subroutine update_scalar

   pure integer function lanes(nlane)
      integer, intent(in) :: nlane

      lanes = 1
   end function lanes

   include 'stagnation.inc'

   include 'stagnation_scalar.inc'

   pure logical function is_finite(n, x)
      integer, intent(in) :: n
      real(wp), intent(in) :: x(n)
      real(wp) :: zero
      integer :: i

      zero = 0
      !GCC$ novector  ! few numbers
      do i = 1, n
         zero = zero + 0*x(i)
      end do
      is_finite = abs(zero) <= 0
   end function is_finite

   !> x less the correction, which is finite, with the size of both.
   pure subroutine correct(n, d, x, step, size)
      integer, intent(in) :: n
      real(wp), intent(in) :: d(n)
      real(wp), intent(inout) :: x(n)
      real(wp), intent(out) :: step, size
      integer :: i

      step = 0
      size = 0
      !GCC$ novector  ! few numbers
      do i = 1, n
         x(i) = x(i) - d(i)
         step = max(step, abs(d(i)))
         size = max(size, abs(x(i)))
      end do
   end subroutine correct

end module symsde_solve_newton_single_path
