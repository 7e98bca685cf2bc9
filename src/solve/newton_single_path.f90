! SPDX-License-Identifier: BSD-3-Clause
!> An update of Newton's iteration, solve/newton, for a single path: A d = r, x <- x - d, and the test, with the bits
!> of a lane of a block.
!>
!> The matrix is eliminated in place. If its pivots are not trusted it is lost, so the same iteration is repeated at the
!> same x by solve/newton, which keeps the matrix for exchanges of rows: a copy in every iteration would take a tenth of
!> the time of a step.
module symsde_solve_newton_single_path
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_solve_blocks, only: pivot_floor, max_lane_unknowns
   use symsde_solve_elimination_single_path, only: solve_scalar
   use symsde_solve_shortening, only: start_shortening
   use symsde_solve_newton, only: newton_type, mark, stop_lanes
   use symsde_solve_stagnation, only: stopping_test, done, failed
   implicit none
   private
   public :: start, update, judge, correct_lanes, restart_lanes

contains

   !> Solve for the correction, subtract it from x, and test; if pivots are not trusted, only note that this
   !> iteration must be repeated. Damping, and small and large systems, are left to solve/newton.
   subroutine update(self, x, status, counters)
      class(newton_type), intent(inout) :: self
      real(wp), intent(inout) :: x(self%n)
      integer(i8), intent(inout) :: status(1)
      type(counters_type), intent(inout) :: counters
      real(wp) :: smallest

      ! Cases for solve/newton: a repeated iteration, fewer unknowns than elimination handles, bands, too many unknowns,
      ! and shortened corrections.
      if (self%keeps_matrix .or. self%n < 3 .or. self%n > max_lane_unknowns .or. .not. allocated(self%a) .or. &
          self%options%shortens) then
         self%keeps_matrix = .false.
         call self%update(x, status, counters)
         return
      end if
      ! r becomes the correction d.
      call solve_scalar(self%n, self%a, self%r, smallest)
      ! Only the matrix and r have changed, and the caller forms both again: x, counts and `last` are as before.
      self%keeps_matrix = .not. (smallest > pivot_floor .and. is_finite(self%n, self%r))
      if (self%keeps_matrix) return
      call correct(self%n, self%r, x, self%step(1), self%size(1))
      call judge(self, status, counters)
   end subroutine update

   include 'one_lane.inc'
   include 'newton.inc'
   include 'stagnation.inc'
   include 'correction.inc'

   !> Whether all n numbers are finite: zero times an infinity or a NaN is NaN, and a sum with a NaN is NaN.
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

   !> Subtract the finite correction from x, and find the largest entries of both: `step` and `size` of the lane.
   pure subroutine correct(n, d, x, step, size)
      integer, intent(in) :: n
      real(wp), intent(in) :: d(n)
      real(wp), intent(inout) :: x(n)
      real(wp), intent(out) :: step, size
      integer :: i

      ! The largest correction and the largest unknown grow from zero, since both are finite here.
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
