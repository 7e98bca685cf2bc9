! SPDX-License-Identifier: BSD-3-Clause
!> Many banded linear systems, one per lane, solved side by side without pivoting: A = L U, x = U^{-1} L^{-1} b,
!>
!>    l_ik = u_ik/u_kk,   u_ij <- u_ij - l_ik u_kj   (k < i <= k + kl, k < j <= k + ku)
!>
!> Row i of a lane's matrix A is stored by diagonals: ab(lane, d, i) = A(i, i+d), -kl <= d <= ku.
!> Entries that would lie outside the matrix are never read. The pivot monitor `smallest` is defined in
!> solve/elimination. Cost: n kl (ku + 1) multiplications and subtractions a lane.
!>
!> Rows are not exchanged, so the factors fit into the bands: L replaces the eliminated entries, U the rest. The
!> diagonal of U holds 1/u_kk, so that rows are multiplied instead of divided.
module symsde_solve_banded
   use symsde_base_kinds, only: wp
   use symsde_solve_elimination, only: pivot_ratio
   implicit none
   private
   public :: factor_banded_lanes, back_substitute_banded_lanes, solve_banded_strip

contains

   !> Factor every lane in place: A = L U, L with unit diagonal in d < 0, U in d >= 0, the diagonal
   !> holding 1/u_kk.
   subroutine factor_banded_lanes(nlane, n, kl, ku, ab, smallest)
      integer, intent(in) :: nlane                     !! lanes
      integer, intent(in) :: n                         !! unknowns of a system
      integer, intent(in) :: kl                        !! diagonals below the main one, >= 0
      integer, intent(in) :: ku                        !! diagonals above the main one, >= 0
      real(wp), intent(inout) :: ab(nlane, -kl:ku, n)  !! in: matrices; out: factors
      real(wp), intent(out) :: smallest(nlane)         !! pivot monitor, 0 to 1
      real(wp) :: diagonal(nlane, 0:kl)
      integer :: i, k, m

      ! Elimination at pivot k first changes row k+kl, so the diagonals of kl+1 rows are enough.
      do i = 1, min(kl, n)
         ! The entry of row i in the matrix, for the pivot monitor.
         diagonal(:, mod(i, kl + 1)) = ab(:, 0, i)
      end do
      smallest = 1
      do k = 1, n
         if (k + kl <= n) diagonal(:, mod(k + kl, kl + 1)) = ab(:, 0, k + kl)
         call pivot_ratio(nlane, diagonal(:, mod(k, kl + 1)), ab(:, 0, k), smallest)
         ! Row k has m entries right of its pivot; in row i the same columns begin at diagonal k - i.
         m = min(ku, n - k)
         do i = k + 1, min(k + kl, n)
            call eliminate_row(nlane, m, ab(1, 0, k), ab(1, k - i, i))
         end do
      end do
   end subroutine factor_banded_lanes

   !> Solve A x = b with the factors of factor_banded_lanes, x (nlane, n) in place: y_i = b_i - sum_j l_ij y_j
   !> downwards, then x_i = (y_i - sum_j u_ij x_j)/u_ii upwards, each sum over the bands alone.
   subroutine back_substitute_banded_lanes(nlane, n, kl, ku, ab, x)
      integer, intent(in) :: nlane                  !! lanes
      integer, intent(in) :: n                      !! unknowns of a system
      integer, intent(in) :: kl                     !! diagonals below the main one
      integer, intent(in) :: ku                     !! diagonals above the main one
      real(wp), intent(in) :: ab(nlane, -kl:ku, n)  !! factors
      real(wp), intent(inout) :: x(nlane, n)        !! in: right-hand sides; out: solutions
      integer :: i, m

      ! L y = b, L with a unit diagonal, row by row.
      do i = 2, n
         m = min(kl, i - 1)
         if (m > 0) call subtract_products(nlane, m, ab(1, -m, i), x(1, i - m), x(1, i))
      end do
      ! U x = y, from the last row up; the diagonal holds 1/u_ii.
      do i = n, 1, -1
         m = min(ku, n - i)
         if (m > 0) call subtract_products(nlane, m, ab(1, 1, i), x(1, i + 1), x(1, i))
         x(:, i) = x(:, i)*ab(:, 0, i)
      end do
   end subroutine back_substitute_banded_lanes

   !> Solve lanes first .. first+width-1 in a compact copy, which stays in cache. ab itself is kept, for exchanges of
   !> rows and for residuals.
   subroutine solve_banded_strip(nlane, n, kl, ku, first, width, ab, x, smallest, strip, part)
      integer, intent(in) :: nlane                          !! lanes of the block
      integer, intent(in) :: n                              !! unknowns of a system
      integer, intent(in) :: kl                             !! diagonals below the main one
      integer, intent(in) :: ku                             !! diagonals above the main one
      integer, intent(in) :: first                          !! first lane of the strip
      integer, intent(in) :: width                          !! lanes of the strip
      real(wp), intent(in) :: ab(nlane, -kl:ku, n)          !! matrices, kept
      real(wp), intent(inout) :: x(nlane, n)                !! right-hand sides, then solutions
      real(wp), intent(inout) :: smallest(nlane)            !! pivot monitor, set for the strip
      real(wp), intent(inout) :: strip(width, -kl:ku, n)    !! work
      real(wp), intent(inout) :: part(width, n)             !! work
      integer :: last, d, i

      last = first + width - 1
      ! Only entries inside the matrix are copied; the corners of the strip stay undefined.
      do i = 1, n
         do d = max(-kl, 1 - i), min(ku, n - i)
            strip(:, d, i) = ab(first:last, d, i)
         end do
         part(:, i) = x(first:last, i)
      end do
      ! The copies become factors and solutions; ab stays unchanged.
      call factor_banded_lanes(width, n, kl, ku, strip, smallest(first:last))
      call back_substitute_banded_lanes(width, n, kl, ku, strip, part)
      do i = 1, n
         x(first:last, i) = part(:, i)
      end do
   end subroutine solve_banded_strip

   !> VEC Subtract a multiple of the pivot's row so that the row's first entry vanishes; the multiplier l_ik replaces
   !> this entry. Both rows begin with the column of the pivot. Two arguments that do not overlap keep the loops free of
   !> overlap tests.
   subroutine eliminate_row(nlane, m, pivot_row, row)
      integer, intent(in) :: nlane                     !! lanes
      integer, intent(in) :: m                         !! entries right of the pivot
      real(wp), intent(in) :: pivot_row(nlane, 0:m)    !! 1/pivot and the entries right of it
      real(wp), intent(inout) :: row(nlane, 0:m)       !! entries of the row to be changed
      integer :: j, lane

      do lane = 1, nlane
         ! l_ik = u_ik/u_kk, by the inverse.
         row(lane, 0) = row(lane, 0)*pivot_row(lane, 0)
      end do
      do j = 1, m
         do lane = 1, nlane
            row(lane, j) = row(lane, j) - row(lane, 0)*pivot_row(lane, j)
         end do
      end do
   end subroutine eliminate_row

   !> VEC y = y - sum over j of row(:,j) x(:,j), one product after the other in the order of j.
   subroutine subtract_products(nlane, m, row, x, y)
      integer, intent(in) :: nlane             !! lanes
      integer, intent(in) :: m                 !! entries of the row
      real(wp), intent(in) :: row(nlane, m)    !! entries of the matrix
      real(wp), intent(in) :: x(nlane, m)      !! the unknowns of these entries
      real(wp), intent(inout) :: y(nlane)      !! row's right-hand side
      integer :: j, lane

      do j = 1, m
         do lane = 1, nlane
            y(lane) = y(lane) - row(lane, j)*x(lane, j)
         end do
      end do
   end subroutine subtract_products

end module symsde_solve_banded
