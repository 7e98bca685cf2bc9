! SPDX-License-Identifier: BSD-3-Clause
!> LU factors P A = L U of one banded matrix with row exchanges, made in parts: between them a host may stop a long
!> solve. They are stored as LAPACK's dgbtrf stores them, so that LAPACK solves with them and estimates their
!> condition.
!>
!> A(i,j) stands at band(kl+ku+1+i-j, j); the kl rows above are for what the row exchanges fill in. A row of the
!> matrix runs through `band` from the lower left to the upper right: one column further on is one row further up.
module symsde_solve_banded_pivoting
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: banded_factors, new_banded_factors, factor_columns

   !> How far the factorization has come. The numbers themselves are the caller's `band`, which it hands over in each
   !> call.
   type :: banded_factors
      integer :: n = 0                  !! unknowns
      integer :: kl = 0, ku = 0         !! diagonals below and above the main one
      integer :: done = 0               !! columns that are factored
      integer :: reach = 0              !! last column that the exchanges so far have filled
      logical :: is_singular = .false.  !! a column without a pivot: nothing more is factored
      real(wp) :: norm = 0              !! of the matrix: its largest column sum
      integer, allocatable :: pivot(:)  !! row exchanged with row j (n)
   end type banded_factors

contains

   !> Begin with a matrix whose uppermost kl rows are zero: its largest column sum is kept for an estimate of its
   !> condition. The norm is not finite where a number is not.
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
         self%norm = max(self%norm, column) + 0*(self%norm + column)  ! max may pass over NaN
      end do
   end subroutine new_banded_factors

   !> Factor the next columns, as many as take about `work` multiplications; all is done when done = n. Column j
   !> finds the largest entry on and below its diagonal, exchanges its row with row j, divides by the pivot what is
   !> below it, and subtracts multiples of that from all columns that row j reaches.
   subroutine factor_columns(self, band, work)
      type(banded_factors), intent(inout) :: self
      real(wp), intent(inout) :: band(2*self%kl + self%ku + 1, self%n)
      real(wp), intent(in) :: work
      integer :: j, k, row, last, below, at

      ! So many columns take about `work` multiplications, each kl + 1 rows of up to kl + ku + 1 entries.
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
            ! A row from below brings its entries right of the band of row j.
            reach = max(reach, min(j + self%ku + at, self%n))
            if (at > 0) call exchange_rows(self, j, at, band)
            ! l_ij = u_ij/u_jj below the pivot, in place.
            band(middle + 1:middle + below, j) = band(middle + 1:middle + below, j)/band(middle, j)
            do k = j + 1, merge(reach, j, below > 0)
               ! u_jk, the entry of row j in column k. Where it is zero nothing is subtracted.
               row = middle + j - k
               if (abs(band(row, k)) > 0) &
                  call subtract(below, band(row, k), band(middle + 1, j), band(row + 1, k))
            end do
            self%done = j
         end do
      end associate
   end subroutine factor_columns

   !> Exchange rows j and j + at, from column j to the last one that exchanges have filled. Multipliers left of column
   !> j stay where they are, as LAPACK wants them.
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

   !> y = y - factor x, the entries of column k below row j less u_jk times the multipliers.
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
