! SPDX-License-Identifier: BSD-3-Clause
!> Many small dense linear systems, one per lane, solved side by side without pivoting.
!>
!> Newton's matrix is I + O(sqrt(h)), so pivots stay near one and exchanges of rows, which are slow on vector units, are
!> not needed. Each lane is monitored instead: `smallest` is
!>
!> min over k of min(|u_kk|, |a_kk|) / max(|u_kk|, |a_kk|)        (0 if this is NaN)
!>
!> with u_kk the pivot and a_kk the diagonal it came from. It is small where a pivot cancels or
!> where an earlier small pivot made this one grow, and a scaling of rows or columns (stiff momenta
!> beside slow positions) does not change it. Callers solve lanes with a small value with exchanges of rows.
!> A NaN or infinity in a lane shows as smallest = 0 or as a solution that is not finite.
!>
!> A lane's result depends on its own numbers only, combined in an order that does not depend on nlane. The
!> factorization itself is the body elimination.inc.
module symsde_solve_elimination
   use symsde_base_kinds, only: wp
   use symsde_solve_elimination_single_path, only: solve_scalar
   implicit none
   private
   public :: strip_lanes, solve_lanes, solve_strip, factor_lanes, back_substitute_lanes
   public :: pivot_ratio, solve_scalar

   integer, parameter :: cached = 2304      !! numbers of the matrices of a strip of small systems
   integer, parameter :: narrow_strip = 32  !! lanes of a strip of larger systems

contains

   include 'all_lanes.inc'
   include 'elimination.inc'

   !> VEC target(:,i) = target(:,i) - factor column(:,i), u_ij <- u_ij - l_ik u_kj for all i below the pivot. A separate
   !> procedure because distinct arguments cannot overlap: as parts of one array they would cost a test before every
   !> loop.
   pure subroutine subtract_multiple(nlane, m, factor, column, target)
      integer, intent(in) :: nlane                 !! lanes
      integer, intent(in) :: m                     !! entries of the column
      real(wp), intent(in) :: factor(nlane)        !! a factor for each lane
      real(wp), intent(in) :: column(nlane, m)     !! column to subtract
      real(wp), intent(inout) :: target(nlane, m)  !! column to change
      integer :: i, lane

      do i = 1, m
         do lane = 1, nlane
            target(lane, i) = target(lane, i) - column(lane, i)*factor(lane)
         end do
      end do
   end subroutine subtract_multiple

   !> Lanes to eliminate together: as many as keep the matrices in the first-level cache, but enough for loops over
   !> lanes to pay. Results do not depend on the width of a strip: each lane is eliminated by its own numbers.
   pure integer function strip_lanes(nlane, entries)
      integer, intent(in) :: nlane    !! lanes of the block
      integer, intent(in) :: entries  !! numbers of a lane's matrix

      strip_lanes = max(narrow_strip, cached/entries/narrow_strip*narrow_strip)
      strip_lanes = min(strip_lanes, nlane)
   end function strip_lanes

   !> Solve a(lane,:,:) x(lane,:) = x(lane,:) in every lane: one and two unknowns in closed form, more by strips.
   !> For callers without a block_solver; each call allocates a strip.
   subroutine solve_lanes(nlane, n, a, x, smallest)
      integer, intent(in) :: nlane                !! lanes of the block
      integer, intent(in) :: n                    !! unknowns of a system
      real(wp), intent(in) :: a(nlane, n, n)      !! matrices, kept
      real(wp), intent(inout) :: x(nlane, n)      !! in: right-hand sides; out: solutions
      real(wp), intent(out) :: smallest(nlane)    !! pivot monitor, 0 to 1
      real(wp), allocatable :: strip(:, :, :), part(:, :)
      integer :: first, widest

      select case (n)
      case (1)
         call solve_one_unknown(nlane, a, x, smallest)
      case (2)
         call solve_two_unknowns(nlane, a(:, 1, 1), a(:, 2, 1), a(:, 1, 2), a(:, 2, 2), &
                                 x(:, 1), x(:, 2), smallest)
      case default
         ! Strips of equal width, but for the last one.
         widest = strip_lanes(nlane, n*n)
         allocate (strip(widest, n, n), part(widest, n))
         do first = 1, nlane, widest
            call solve_strip(nlane, n, first, min(widest, nlane - first + 1), a, x, &
                             smallest, strip, part)
         end do
      end select
   end subroutine solve_lanes

   !> Solve lanes first .. first+width-1 in a compact copy, which stays in cache. a itself is kept, for exchanges of
   !> rows and for residuals.
   subroutine solve_strip(nlane, n, first, width, a, x, smallest, strip, part)
      integer, intent(in) :: nlane                    !! lanes of the block
      integer, intent(in) :: n                        !! unknowns of a system
      integer, intent(in) :: first                    !! first lane of the strip
      integer, intent(in) :: width                    !! lanes of the strip
      real(wp), intent(in) :: a(nlane, n, n)          !! matrices, kept
      real(wp), intent(inout) :: x(nlane, n)          !! in: right-hand sides; out: solutions
      real(wp), intent(inout) :: smallest(nlane)      !! pivot monitor, set for the strip
      real(wp), intent(inout) :: strip(width, n, n)   !! work
      real(wp), intent(inout) :: part(width, n)       !! work
      integer :: last, i, j

      last = first + width - 1
      ! Copy the lanes of the strip side by side.
      do j = 1, n
         do i = 1, n
            strip(:, i, j) = a(first:last, i, j)
         end do
         part(:, j) = x(first:last, j)
      end do
      ! The copies become factors and solutions; a stays unchanged.
      call factor_lanes(width, n, strip, smallest(first:last))
      call back_substitute_lanes(width, n, strip, part)
      do j = 1, n
         x(first:last, j) = part(:, j)
      end do
   end subroutine solve_strip

   !> One unknown: x = b/a. The monitor is one or zero: there is no other entry to compare the pivot with.
   subroutine solve_one_unknown(nlane, a, x, smallest)
      integer, intent(in) :: nlane              !! lanes of the block
      real(wp), intent(in) :: a(nlane)          !! coefficients
      real(wp), intent(inout) :: x(nlane)       !! in: right-hand sides; out: solutions
      real(wp), intent(out) :: smallest(nlane)  !! 1, or 0 where a is zero or not finite
      integer :: lane

      do lane = 1, nlane
         ! Division by zero gives infinity or NaN, which callers notice.
         x(lane) = x(lane)/a(lane)
         smallest(lane) = merge(1.0_wp, 0.0_wp, abs(a(lane)) > 0 .and. abs(a(lane)) <= huge(1.0_wp))
      end do
   end subroutine solve_one_unknown

   !> VEC Two unknowns: elimination written out. Near the identity its rounding error is three quarters of the error
   !> of Cramer's rule (0.43 against 0.56 eps, root mean square).
   subroutine solve_two_unknowns(nlane, a11, a21, a12, a22, x1, x2, smallest)
      integer, intent(in) :: nlane                            !! lanes of the block
      real(wp), intent(in), dimension(nlane) :: a11, a21      !! first columns
      real(wp), intent(in), dimension(nlane) :: a12, a22      !! second columns
      real(wp), intent(inout), dimension(nlane) :: x1, x2     !! right-hand sides, then solutions
      real(wp), intent(out) :: smallest(nlane)                !! pivot monitor
      real(wp) :: inverse, multiplier, pivot, ratio, low, high
      integer :: lane

      do lane = 1, nlane
         ! (a11, a12; a21, a22) becomes (a11, a12; 0, pivot); x2 is found from the second row, x1 from the first.
         inverse = 1/a11(lane)
         multiplier = a21(lane)*inverse
         pivot = a22(lane) - multiplier*a12(lane)
         x2(lane) = (x2(lane) - multiplier*x1(lane))/pivot
         x1(lane) = (x1(lane) - a12(lane)*x2(lane))*inverse
         ! The monitor is pivot_ratio, written out. The first pivot is the diagonal entry itself, with ratio one if
         ! it is finite.
         low = merge(abs(pivot), abs(a22(lane)), abs(pivot) <= abs(a22(lane)))
         high = merge(abs(a22(lane)), abs(pivot), abs(pivot) <= abs(a22(lane)))
         ratio = low/high
         ratio = merge(ratio, 0.0_wp, ratio >= 0)
         smallest(lane) = merge(ratio, 0.0_wp, abs(a11(lane)) <= huge(1.0_wp))
      end do
   end subroutine solve_two_unknowns

end module symsde_solve_elimination
