! SPDX-License-Identifier: BSD-3-Clause
!> LU factors P A = L U of one banded matrix with row exchanges, computed in parts so that a caller may stop a long
!> solve between parts; solutions by these factors; and an estimate of the matrix's condition. A(i,j) is
!> band(kl+ku+1+i-j, j); the first kl rows of `band` are room for entries that row exchanges add. A row of the matrix
!> runs through `band` from the lower left to the upper right: one column right is one row up.
module symsde_solve_banded_pivoting
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: banded_factors, new_banded_factors, factor_columns, substitute, reciprocal_condition

   !> The progress of a factorization. The numbers themselves are the caller's `band`, which it passes in each call.
   type :: banded_factors
      integer :: n = 0                  !! unknowns
      integer :: kl = 0, ku = 0         !! diagonals below and above the main one
      integer :: done = 0               !! number of columns factored
      integer :: reach = 0              !! last column filled by the exchanges so far
      logical :: is_singular = .false.  !! a column has no pivot, and factoring has stopped there
      real(wp) :: norm = 0              !! largest column sum of the matrix
      integer, allocatable :: pivot(:)  !! row exchanged with row j (n)
   end type banded_factors

contains

   !> Begin with a matrix whose uppermost kl rows are zero; keep its largest column sum for an estimate of its
   !> condition. The norm is not finite if any number is not.
   subroutine new_banded_factors(self, n, kl, ku, band)
      type(banded_factors), intent(out) :: self
      integer, intent(in) :: n, kl, ku
      real(wp), intent(in) :: band(2*kl + ku + 1, n)
      real(wp) :: column
      integer :: j

      self%n = n
      self%kl = kl
      self%ku = ku
      allocate (self%pivot(n), source=0)
      do j = 1, n
         column = sum(abs(band(kl + 1:, j)))
         self%norm = larger(self%norm, column)
      end do
   end subroutine new_banded_factors

   !> Factor the next columns, of about `work` multiplications; all are factored when done = n. In column j: find the
   !> largest entry on and below the diagonal, exchange its row with row j, divide the entries below by the pivot, and
   !> subtract multiples of column j from all columns that row j reaches.
   subroutine factor_columns(self, band, work)
      type(banded_factors), intent(inout) :: self
      real(wp), intent(inout) :: band(2*self%kl + self%ku + 1, self%n)
      real(wp), intent(in) :: work
      integer :: j, k, row, last, below, at

      ! A column takes kl + 1 rows of up to kl + ku + 1 multiplications each.
      last = self%n
      associate (column => real(self%kl + 1, wp)*(self%kl + self%ku + 1))
         if (work < column*(self%n - self%done)) last = self%done + max(1, int(work/column))
      end associate
      associate (middle => self%kl + self%ku + 1, reach => self%reach)
         do j = self%done + 1, last
            below = min(self%kl, self%n - j)
            ! The pivot is the largest entry of column j on and below the diagonal, `at` rows down.
            at = maxloc(abs(band(middle:middle + below, j)), dim=1) - 1
            self%pivot(j) = j + at
            self%is_singular = .not. abs(band(middle + at, j)) > 0
            if (self%is_singular) return
            ! An exchanged row has entries right of the band of row j.
            reach = max(reach, min(j + self%ku + at, self%n))
            if (at > 0) call exchange_rows(self, j, at, band)
            ! l_ij = u_ij/u_jj below the pivot, in place.
            band(middle + 1:middle + below, j) = band(middle + 1:middle + below, j)/band(middle, j)
            do k = j + 1, merge(reach, j, below > 0)
               ! u_jk, the entry of row j in column k. If it is zero, column k stays unchanged.
               row = middle + j - k
               if (abs(band(row, k)) > 0) &
                  call subtract(below, band(row, k), band(middle + 1, j), band(row + 1, k))
            end do
            self%done = j
         end do
      end associate
   end subroutine factor_columns

   !> Exchange rows j and j + at, from column j to the last column that exchanges have filled. Multipliers left of
   !> column j stay in place: substitution, too, alternates exchanges and subtractions.
   pure subroutine exchange_rows(self, j, at, band)
      type(banded_factors), intent(in) :: self
      integer, intent(in) :: j, at
      real(wp), intent(inout) :: band(2*self%kl + self%ku + 1, self%n)
      real(wp) :: x
      integer :: k, row

      do k = j, self%reach
         row = self%kl + self%ku + 1 + j - k
         ! Entry (j, k) and entry (j + at, k), `at` rows below it in the same column.
         x = band(row, k)
         band(row, k) = band(row + at, k)
         band(row + at, k) = x
      end do
   end subroutine exchange_rows

   !> Solve A x = b: for each column of L exchange rows and subtract multiples of x_j, then solve U x = y column by
   !> column.
   pure subroutine substitute(self, band, x)
      type(banded_factors), intent(in) :: self
      real(wp), intent(in) :: band(2*self%kl + self%ku + 1, self%n)  !! factors
      real(wp), intent(inout) :: x(self%n)                           !! in: right-hand side; out: solution
      integer :: j, below, above

      associate (middle => self%kl + self%ku + 1)
         do j = 1, self%n - 1
            below = min(self%kl, self%n - j)
            if (self%pivot(j) /= j) call exchange(x(j), x(self%pivot(j)))
            if (below > 0) call subtract(below, x(j), band(middle + 1, j), x(j + 1))
         end do
         do j = self%n, 1, -1
            above = min(self%kl + self%ku, j - 1)
            x(j) = x(j)/band(middle, j)
            call subtract(above, x(j), band(middle - above, j), x(j - above))
         end do
      end associate
   end subroutine substitute

   !> Solve A^T x = b: U^T y = b, then the multiples of L and the exchanges, from the last to the first.
   pure subroutine substitute_transposed(self, band, x)
      type(banded_factors), intent(in) :: self
      real(wp), intent(in) :: band(2*self%kl + self%ku + 1, self%n)  !! factors
      real(wp), intent(inout) :: x(self%n)                           !! in: right-hand side; out: solution
      integer :: j, below, above

      associate (middle => self%kl + self%ku + 1)
         do j = 1, self%n
            above = min(self%kl + self%ku, j - 1)
            x(j) = (x(j) - dot_product(band(middle - above:middle - 1, j), x(j - above:j - 1)))/band(middle, j)
         end do
         do j = self%n - 1, 1, -1
            below = min(self%kl, self%n - j)
            x(j) = x(j) - dot_product(band(middle + 1:middle + below, j), x(j + 1:j + below))
            if (self%pivot(j) /= j) call exchange(x(j), x(self%pivot(j)))
         end do
      end associate
   end subroutine substitute_transposed

   !> Exchange two numbers.
   elemental subroutine exchange(x, y)
      real(wp), intent(inout) :: x, y
      real(wp) :: kept

      kept = x
      x = y
      y = kept
   end subroutine exchange

   !> 1/(|A| |A^-1|) in the 1-norm; |A^-1| is found by Hager's ascent, which is rarely wrong by a factor of three: a
   !> maximum of the convex |A^-1 x| over |x| = 1 lies at a unit vector, and the gradient A^-T sign(A^-1 x) gives the
   !> next one. A vector of alternating signs guards against matrices for which the ascent stops early.
   pure real(wp) function reciprocal_condition(self, band) result(rcond)
      type(banded_factors), intent(in) :: self
      real(wp), intent(in) :: band(2*self%kl + self%ku + 1, self%n)  !! factors
      integer, parameter :: most = 5
      real(wp) :: x(self%n), rise(self%n), norm
      integer :: i, at, before

      norm = 0
      before = 0
      x = 1/real(self%n, wp)
      do i = 1, most
         call substitute(self, band, x)
         norm = larger(norm, sum(abs(x)))
         rise = sign(1.0_wp, x)
         call substitute_transposed(self, band, rise)
         at = maxloc(abs(rise), dim=1)
         if (at == before) exit
         x = 0
         x(at) = 1
         before = at
      end do
      do i = 1, self%n
         x(i) = (-1)**(i + 1)*(1 + (i - 1)/max(1.0_wp, self%n - 1.0_wp))
      end do
      call substitute(self, band, x)
      norm = larger(norm, 2*sum(abs(x))/(3*self%n))
      rcond = 1/(self%norm*norm)
   end function reciprocal_condition

   !> The larger of two numbers; NaN or infinite if either is, since max may ignore NaN.
   elemental real(wp) function larger(x, y)
      real(wp), intent(in) :: x, y

      larger = max(x, y) + 0*(x + y)
   end function larger

   !> y = y - factor x: in column k, below row j, subtract u_jk times the multipliers.
   pure subroutine subtract(n, factor, x, y)
      integer, intent(in) :: n
      real(wp), intent(in) :: factor, x(n)
      real(wp), intent(inout) :: y(n)
      integer :: i

      do i = 1, n
         y(i) = y(i) - factor*x(i)
      end do
   end subroutine subtract

end module symsde_solve_banded_pivoting
