! SPDX-License-Identifier: BSD-3-Clause
!> Sums of the slopes F_j of stages,
!>
!> total = start + sum_j c_j F_j          cyclically from a stage j = `first` on
!>
!> A block never reads a slope whose coefficient is zero, since it may be unknown.
!>
!> Products are added one after the other to the start of the sum. So a compiler that contracts has no choice, and a
!> product with the coefficient zero changes nothing: a single path adds all products, and has the same bits.
!>
!> The sum of stage i begins with F_i, its own slope of the sweep before, and continues with i+1, .., s, 1, .., i-1. So
!> the slope that has just been computed, of the stage before, comes last: a single path has finished all other
!> additions by then.
!>
!> Up to three slopes are added in one pass over the n numbers (n = nlane ndof), which are read and written once;
!> further slopes take a pass each.
module symsde_step_stages_slope_sums
   use symsde_base_kinds, only: wp
   use symsde_base_vectors, only: add_times
   implicit none
   private
   public :: add_slopes, weigh_slopes, place_two

   integer, parameter :: few = 4      !! fewest numbers of a path that are added as vectors
   integer, parameter :: at_once = 3  !! most slopes that are added in one pass

contains

   !> total = start + sum_j c_j slope_j, cyclically from slope `first` on, for a block. First find up to three slopes
   !> with nonzero coefficients and add them in one pass; further slopes take separate passes.
   pure subroutine add_slopes(n, nstage, first, c, slope, start, total)
      integer, intent(in) :: n, nstage, first
      real(wp), intent(in) :: c(nstage), slope(n, nstage), start(n)
      real(wp), intent(out) :: total(n)
      integer :: used(at_once), m, k, j

      m = 0
      ! j runs first, .., nstage, 1, .., first - 1. The loop stops at the fourth nonzero coefficient, with m = 4.
      used = first
      do k = first, first + nstage - 1
         j = merge(k - nstage, k, k > nstage)
         if (abs(c(j)) <= 0) cycle
         m = m + 1
         if (m > at_once) exit
         used(m) = j
      end do
      associate (i => used(1), j => used(2), l => used(3))
         select case (m)
         case (0)
            total = start
         case (1)
            call add_one(n, c(i), slope(1, i), start, total)
         case (2)
            call add_two(n, c(i), slope(1, i), c(j), slope(1, j), start, total)
         case default
            call add_three(n, c(i), slope(1, i), c(j), slope(1, j), c(l), slope(1, l), start, total)
         end select
      end associate
      if (m <= at_once) return
      do k = k, first + nstage - 1
         j = merge(k - nstage, k, k > nstage)
         if (abs(c(j)) > 0) call add_times(n, c(j), slope(1, j), total)
      end do
   end subroutine add_slopes

   !> total = start + sum_j c_j slope_j for a single path, whose slopes are all finite: slopes with the coefficient zero
   !> are added too, without testing. Up to three numbers are added without vectors.
   pure subroutine weigh_slopes(n, nstage, first, c, slope, start, total)
      integer, intent(in) :: n, nstage, first
      real(wp), intent(in) :: c(nstage), slope(n, nstage), start(n)
      real(wp), intent(out) :: total(n)
      integer :: i, j, k, m

      i = first
      j = merge(1, i + 1, i == nstage)
      k = merge(1, j + 1, j == nstage)
      if (n < few) then
         !GCC$ novector  ! few numbers
         do m = 1, n
            total(m) = start(m) + c(i)*slope(m, i)
            if (nstage > 1) total(m) = total(m) + c(j)*slope(m, j)
            if (nstage > 2) total(m) = total(m) + c(k)*slope(m, k)
         end do
      else if (nstage == 1) then
         call add_one(n, c(i), slope(1, i), start, total)
      else if (nstage == 2) then
         call add_two(n, c(i), slope(1, i), c(j), slope(1, j), start, total)
      else
         call add_three(n, c(i), slope(1, i), c(j), slope(1, j), c(k), slope(1, k), start, total)
      end if
      do m = at_once + 1, nstage
         ! Further slopes, cyclically from the fourth on.
         k = merge(1, k + 1, k == nstage)
         call add_times(n, c(k), slope(1, k), total)
      end do
   end subroutine weigh_slopes

   !> VEC One of two stages i, of which j is the other, at one pass if all slopes are known: x = start + b_i F_i +
   !> b_j F_j + a_i C_i + a_j C_j and y = p + d_i F_i + d_j F_j, with the order of additions of single sums.
   pure subroutine place_two(n, j, b, a, d, f, c, start, p, x, y)
      integer, intent(in) :: n, j
      real(wp), intent(in), dimension(2) :: b, a, d
      real(wp), intent(in), dimension(n, 2) :: f, c
      real(wp), intent(in), dimension(n) :: start, p
      real(wp), intent(out), dimension(n) :: x, y
      integer :: i, k

      i = 3 - j
      do k = 1, n
         x(k) = start(k) + b(i)*f(k, i) + b(j)*f(k, j) + a(i)*c(k, i) + a(j)*c(k, j)
         y(k) = p(k) + d(i)*f(k, i) + d(j)*f(k, j)
      end do
   end subroutine place_two

   !> VEC total = start + c x: one slope, or the only one with a nonzero coefficient.
   pure subroutine add_one(n, c, x, start, total)
      integer, intent(in) :: n
      real(wp), intent(in) :: c, x(n), start(n)
      real(wp), intent(out) :: total(n)
      integer :: i

      do i = 1, n
         total(i) = start(i) + c*x(i)
      end do
   end subroutine add_one

   !> VEC total = start + a x + b y, from left to right.
   pure subroutine add_two(n, a, x, b, y, start, total)
      integer, intent(in) :: n
      real(wp), intent(in) :: a, b, x(n), y(n), start(n)
      real(wp), intent(out) :: total(n)
      integer :: i

      do i = 1, n
         total(i) = start(i) + a*x(i) + b*y(i)
      end do
   end subroutine add_two

   !> VEC total = start + a x + b y + c z, from left to right.
   pure subroutine add_three(n, a, x, b, y, c, z, start, total)
      integer, intent(in) :: n
      real(wp), intent(in) :: a, b, c, x(n), y(n), z(n), start(n)
      real(wp), intent(out) :: total(n)
      integer :: i

      do i = 1, n
         total(i) = start(i) + a*x(i) + b*y(i) + c*z(i)
      end do
   end subroutine add_three

end module symsde_step_stages_slope_sums
