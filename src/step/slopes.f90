! SPDX-License-Identifier: BSD-3-Clause
!> Sums of the slopes of stages. A slope whose coefficient is zero is never read: it may not be known yet.
module symsde_step_slopes
   use symsde_base_kinds, only: wp
   use symsde_base_vectors, only: add_times
   implicit none
   private
   public :: add_slopes, slope_sum, find_sum, add_sum, add_pair, take_slopes

   integer, parameter :: nbeside = 16  !! numbers of a path by itself that are compared side by side

   !> The coefficients that count, times a factor.
   type :: slope_sum
      integer :: m = 0          !! how many there are
      integer :: used(4) = 0    !! slopes of the first four
      real(wp) :: c(4) = 0      !! and their coefficients
   end type slope_sum

contains

   !> What add_slopes adds, found once; of more than four the first four.
   pure subroutine find_sum(nstage, factor, coefficient, sum)
      integer, intent(in) :: nstage
      real(wp), intent(in) :: factor, coefficient(nstage)
      type(slope_sum), intent(out) :: sum
      integer :: j

      do j = 1, nstage
         if (abs(coefficient(j)) <= 0) cycle
         sum%m = sum%m + 1
         if (sum%m > size(sum%c)) cycle
         sum%used(sum%m) = j
         sum%c(sum%m) = factor*coefficient(j)
      end do
   end subroutine find_sum

   !> total = start + factor sum_j coefficient_j slope_j
   pure subroutine add_slopes(n, nstage, factor, coefficient, slope, start, total)
      integer, intent(in) :: n, nstage
      real(wp), intent(in) :: factor, coefficient(nstage), slope(n, nstage), start(n)
      real(wp), intent(out) :: total(n)
      type(slope_sum) :: sum
      integer :: j

      call find_sum(nstage, factor, coefficient, sum)
      call add_sum(n, nstage, sum, slope, start, total)
      if (sum%m <= 3) return
      do j = sum%used(3) + 1, nstage
         if (abs(coefficient(j)) > 0) call add_times(n, factor*coefficient(j), slope(1, j), total)
      end do
   end subroutine add_slopes

   !> The same of up to three slopes that were found before.
   pure subroutine add_sum(n, nstage, sum, slope, start, total)
      integer, intent(in) :: n, nstage
      type(slope_sum), intent(in) :: sum
      real(wp), intent(in) :: slope(n, nstage), start(n)
      real(wp), intent(out) :: total(n)

      associate (c => sum%c, used => sum%used)
         select case (sum%m)
         case (0)
            total = start
         case (1)
            call add_one(n, c(1), slope(1, used(1)), start, total)
         case (2)
            call add_two(n, c(1), slope(1, used(1)), c(2), slope(1, used(2)), start, total)
         case default
            call add_three(n, c(1), slope(1, used(1)), c(2), slope(1, used(2)), c(3), slope(1, used(3)), start, total)
         end select
      end associate
   end subroutine add_sum

   !> The same for both increments of a path of two degrees of freedom, from the slopes of two stages: without a loop.
   pure subroutine add_pair(v, alpha, nrow, row, slope, start, dq, dp)
      integer, intent(in) :: nrow, row
      real(wp), intent(in) :: v(2), alpha(2), start(2)
      real(wp), intent(in) :: slope(nrow, 2, 2)   !! in this row: of each stage
      real(wp), intent(out) :: dq(2), dp(2)

      dq(1) = start(1) + (v(1)*slope(row, 1, 1) + v(2)*slope(row, 1, 2))
      dq(2) = start(2) + (v(1)*slope(row, 2, 1) + v(2)*slope(row, 2, 2))
      dp(1) = 0 + (alpha(1)*slope(row, 1, 1) + alpha(2)*slope(row, 1, 2))
      dp(2) = 0 + (alpha(1)*slope(row, 2, 1) + alpha(2)*slope(row, 2, 2))
   end subroutine add_pair

   !> slope = -f of a path by itself, with the largest change and slope beside those so far; the change is no number
   !> where one of f is not finite.
   pure subroutine take_slopes(n, first, f, slope, change, extent)
      integer, intent(in) :: n
      logical, intent(in) :: first   !! no slope was known
      real(wp), intent(in) :: f(n)
      real(wp), intent(inout) :: slope(n), change, extent
      real(wp) :: d, zero
      integer :: beside, i

      beside = n - modulo(n, nbeside)
      if (first) slope = 0
      zero = 0*change
      if (beside > 0) call take_beside(beside, f, slope, change, extent, zero)
      !GCC$ novector  ! few numbers
      do i = beside + 1, n
         d = abs(f(i) + slope(i))
         slope(i) = -f(i)
         change = max(change, d)
         extent = max(extent, abs(f(i)))
         zero = zero + 0*d
      end do
      change = change + zero  ! NaN stays
   end subroutine take_slopes

   !> VEC The same of nbeside at a time, each of which has its own largest: one for all would wait for itself.
   pure subroutine take_beside(n, f, slope, change, extent, zero)
      integer, intent(in) :: n   !! a multiple of nbeside
      real(wp), intent(in) :: f(n)
      real(wp), intent(inout) :: slope(n), change, extent, zero
      real(wp), dimension(nbeside) :: moved, largest, nothing
      real(wp) :: d
      integer :: done, i

      moved = 0
      largest = 0
      nothing = 0
      !GCC$ novector
      do done = 0, n - nbeside, nbeside
         do i = 1, nbeside
            d = abs(f(done + i) + slope(done + i))
            slope(done + i) = -f(done + i)
            moved(i) = max(moved(i), d)
            largest(i) = max(largest(i), abs(f(done + i)))
            nothing(i) = nothing(i) + 0*d
         end do
      end do
      !GCC$ novector
      do i = 1, nbeside
         change = max(change, moved(i))
         extent = max(extent, largest(i))
         zero = zero + nothing(i)
      end do
   end subroutine take_beside

   !> VEC
   pure subroutine add_one(n, c, x, start, total)
      integer, intent(in) :: n
      real(wp), intent(in) :: c, x(n), start(n)
      real(wp), intent(out) :: total(n)
      integer :: i

      do i = 1, n
         total(i) = start(i) + c*x(i)
      end do
   end subroutine add_one

   !> VEC
   pure subroutine add_two(n, a, x, b, y, start, total)
      integer, intent(in) :: n
      real(wp), intent(in) :: a, b, x(n), y(n), start(n)
      real(wp), intent(out) :: total(n)
      integer :: i

      do i = 1, n
         total(i) = start(i) + (a*x(i) + b*y(i))
      end do
   end subroutine add_two

   !> VEC
   pure subroutine add_three(n, a, x, b, y, c, z, start, total)
      integer, intent(in) :: n
      real(wp), intent(in) :: a, b, c, x(n), y(n), z(n), start(n)
      real(wp), intent(out) :: total(n)
      integer :: i

      do i = 1, n
         total(i) = start(i) + (a*x(i) + b*y(i) + c*z(i))
      end do
   end subroutine add_three

end module symsde_step_slopes
