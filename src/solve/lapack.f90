! SPDX-License-Identifier: BSD-3-Clause
!> The only file that calls LAPACK: one system A x = b with row exchanges, P A = L U, and the threads of the BLAS.
!>
!> LAPACK's info alone does not tell failure: a NaN in the matrix gives info = 0 and NaN, a nearly singular matrix
!> info = 0 and infinities. Data and solution are therefore looked at here:
!>
!>    nonfinite   a number of A or b is infinite or NaN, before anything is solved
!>    singular    a pivot is zero, the condition number too large where it is asked for, or the solution not finite
!>    status_ok   x is the solution
!>
!> A system that fails leaves x undefined in the procedures for one system, and as it was in those for a lane of a
!> block. Banded matrices are factored in solve/banded_pivoting and not by LAPACK, so that a long factorization may be
!> stopped half-way.
module symsde_solve_lapack
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: status_ok, singular, nonfinite
   use symsde_solve_banded_pivoting, only: banded_factors, new_banded_factors, factor_columns
   implicit none
   private
   public :: solve_dense_lapack, solve_dense_many_lapack, solve_lane_lapack
   public :: solve_banded_lapack, solve_banded_lane_lapack, solve_factored_lapack
   public :: blas_single_thread, blas_restore_threads

   interface
      !> LAPACK: LU factors of a general matrix with exchanges of rows; info > 0 where a pivot is zero.
      subroutine dgetrf(m, n, a, lda, ipiv, info)
         import :: wp
         integer, intent(in) :: m, n, lda
         real(wp), intent(inout) :: a(lda, *)
         integer, intent(out) :: ipiv(*)
         integer, intent(out) :: info
      end subroutine dgetrf

      !> LAPACK: solve with the factors of dgetrf, nrhs right-hand sides at once; trans = 'N' for A itself.
      subroutine dgetrs(trans, n, nrhs, a, lda, ipiv, b, ldb, info)
         import :: wp
         character, intent(in) :: trans
         integer, intent(in) :: n, nrhs, lda, ldb
         real(wp), intent(in) :: a(lda, *)
         integer, intent(in) :: ipiv(*)
         real(wp), intent(inout) :: b(ldb, *)
         integer, intent(out) :: info
      end subroutine dgetrs

      !> LAPACK: solve with LU factors of a banded matrix, stored as at the head of solve/banded_pivoting.
      subroutine dgbtrs(trans, n, kl, ku, nrhs, ab, ldab, ipiv, b, ldb, info)
         import :: wp
         character, intent(in) :: trans
         integer, intent(in) :: n, kl, ku, nrhs, ldab, ldb
         real(wp), intent(in) :: ab(ldab, *)
         integer, intent(in) :: ipiv(*)
         real(wp), intent(inout) :: b(ldb, *)
         integer, intent(out) :: info
      end subroutine dgbtrs

      !> LAPACK: estimate of the reciprocal condition number from LU factors of a banded matrix; anorm is the norm of
      !> the matrix before it was factored.
      subroutine dgbcon(norm, n, kl, ku, ab, ldab, ipiv, anorm, rcond, work, iwork, info)
         import :: wp
         character, intent(in) :: norm
         integer, intent(in) :: n, kl, ku, ldab
         real(wp), intent(in) :: ab(ldab, *)
         integer, intent(in) :: ipiv(*)
         real(wp), intent(in) :: anorm
         real(wp), intent(out) :: rcond
         real(wp), intent(out) :: work(*)
         integer, intent(out) :: iwork(*)
         integer, intent(out) :: info
      end subroutine dgbcon

      !> blas_threads.c: the BLAS has one thread from now on.
      subroutine take_threads() bind(c, name='blas_threads_take')
      end subroutine take_threads

      !> blas_threads.c: undo one call of take_threads.
      subroutine give_back_threads() bind(c, name='blas_threads_give_back')
      end subroutine give_back_threads
   end interface

contains

   !> Solve a x = b with row exchanges, one right-hand side.
   subroutine solve_dense_lapack(n, a, x, info)
      integer, intent(in) :: n              !! unknowns
      real(wp), intent(inout) :: a(n, n)    !! matrix, destroyed
      real(wp), intent(inout) :: x(n)       !! in: right-hand side; out: solution, if info is ok
      integer(i4), intent(out) :: info      !! status_ok, singular or nonfinite

      call solve_dense_many_lapack(n, 1, a, x, info)
   end subroutine solve_dense_lapack

   !> Solve a x = b with row exchanges for nrhs right-hand sides, n^3/3 multiplications for the factors and n^2 for
   !> each side.
   subroutine solve_dense_many_lapack(n, nrhs, a, b, info)
      integer, intent(in) :: n                !! unknowns
      integer, intent(in) :: nrhs             !! right-hand sides
      real(wp), intent(inout) :: a(n, n)      !! matrix, destroyed
      real(wp), intent(inout) :: b(n, nrhs)   !! in: right-hand sides; out: solutions, if info is ok
      integer(i4), intent(out) :: info        !! status_ok, singular or nonfinite
      integer :: pivot(n), lapack_info

      ! Each way out leaves the status that fits: not finite before the data are seen to be, singular until the
      ! solution is.
      info = nonfinite
      if (.not. (all_finite(size(a, kind=i8), a) .and. all_finite(size(b, kind=i8), b))) return
      info = singular
      ! P A = L U; a pivot that is zero shows in lapack_info.
      call dgetrf(n, n, a, n, pivot, lapack_info)
      if (lapack_info /= 0) return
      call dgetrs('N', n, nrhs, a, n, pivot, b, n, lapack_info)
      if (all_finite(size(b, kind=i8), b)) info = status_ok
   end subroutine solve_dense_many_lapack

   !> Solve one lane of a block of dense systems. Its numbers lie nlane apart, so matrix and right-hand side are
   !> copied; the matrix of the block is kept for whoever forms residuals with it.
   subroutine solve_lane_lapack(nlane, n, lane, a, x, info)
      integer, intent(in) :: nlane            !! lanes of the block
      integer, intent(in) :: n                !! unknowns of a system
      integer, intent(in) :: lane             !! the lane to solve
      real(wp), intent(in) :: a(nlane, n, n)  !! matrices, kept
      real(wp), intent(inout) :: x(nlane, n)  !! x(lane,:): right-hand side, then solution if ok
      integer(i4), intent(out) :: info        !! status_ok, singular or nonfinite
      real(wp), allocatable :: matrix(:, :), vector(:)

      ! Room of this call alone: few lanes come here, and mostly none.
      allocate (matrix(n, n), vector(n))
      matrix(:, :) = a(lane, :, :)
      vector(:) = x(lane, :)
      call solve_dense_lapack(n, matrix, vector, info)
      ! A lane that fails keeps its right-hand side.
      if (info == status_ok) x(lane, :) = vector
   end subroutine solve_lane_lapack

   !> Solve one lane of a block of banded systems, ab(lane, d, i) = A(i, i+d), copied into the storage of LAPACK.
   subroutine solve_banded_lane_lapack(nlane, n, kl, ku, lane, ab, x, info)
      integer, intent(in) :: nlane                  !! lanes of the block
      integer, intent(in) :: n                      !! unknowns of a system
      integer, intent(in) :: kl                     !! diagonals below the main one
      integer, intent(in) :: ku                     !! diagonals above the main one
      integer, intent(in) :: lane                   !! the lane to solve
      real(wp), intent(in) :: ab(nlane, -kl:ku, n)  !! matrices, kept
      real(wp), intent(inout) :: x(nlane, n)        !! x(lane,:): in, and solution if info is ok
      integer(i4), intent(out) :: info              !! status_ok, singular or nonfinite
      real(wp), allocatable :: band(:, :), vector(:)
      integer :: d, i

      allocate (band(2*kl + ku + 1, n), source=0.0_wp)
      do i = 1, n
         ! A(i, i+d) goes to row kl+ku+1-d of column i+d; the kl rows above stay zero for what exchanges fill in.
         do d = max(-kl, 1 - i), min(ku, n - i)
            band(kl + ku + 1 - d, i + d) = ab(lane, d, i)
         end do
      end do
      vector = x(lane, :)
      call solve_banded_lapack(n, kl, ku, band, vector, info)
      ! A lane that fails keeps its right-hand side.
      if (info == status_ok) x(lane, :) = vector
   end subroutine solve_banded_lane_lapack

   !> Solve one banded system, A(i,j) at band(kl+ku+1+i-j, j); the kl rows above are zero. All columns are factored at
   !> once: the work of a part is not bounded.
   subroutine solve_banded_lapack(n, kl, ku, band, x, info)
      integer, intent(in) :: n                              !! unknowns
      integer, intent(in) :: kl                             !! diagonals below the main one
      integer, intent(in) :: ku                             !! diagonals above the main one
      real(wp), intent(inout) :: band(2*kl + ku + 1, n)     !! matrix, destroyed
      real(wp), intent(inout) :: x(n)                       !! in: right-hand side; out: solution, if ok
      integer(i4), intent(out) :: info                      !! status_ok, singular or nonfinite
      type(banded_factors) :: factors

      info = nonfinite
      if (.not. all_finite(size(band, kind=i8), band)) return
      call new_banded_factors(factors, n, kl, ku, band)
      ! A pivot that is zero is noted in `factors`, and told as singular below.
      call factor_columns(factors, band, huge(1.0_wp))
      call solve_factored_lapack(factors, band, x, info)
   end subroutine solve_banded_lapack

   !> Solve one banded system from factors, which may have been made in parts. With rcond, a system whose condition
   !> number exceeds 1/(4 eps) is singular too: its solution would have no correct digit.
   subroutine solve_factored_lapack(factors, band, x, info, rcond)
      type(banded_factors), intent(in) :: factors           !! of solve/banded_pivoting
      real(wp), intent(in) :: band(2*factors%kl + factors%ku + 1, factors%n)   !! their numbers
      real(wp), intent(inout) :: x(factors%n)               !! in: right-hand side; out: solution, if ok
      integer(i4), intent(out) :: info                      !! status_ok, singular or nonfinite
      real(wp), intent(out), optional :: rcond              !! 1/(|A| |A^-1|), estimated, in the 1-norm
      real(wp), allocatable :: work(:)
      integer, allocatable :: iwork(:)
      integer :: lapack_info

      ! What is known of the condition where nothing can be solved.
      if (present(rcond)) rcond = 0
      info = nonfinite
      if (.not. all_finite(int(factors%n, i8), x)) return
      info = singular
      if (factors%is_singular) return
      associate (n => factors%n, kl => factors%kl, ku => factors%ku)
         if (present(rcond)) then
            allocate (work(3*n), iwork(n))
            call dgbcon('1', n, kl, ku, band, 2*kl + ku + 1, factors%pivot, factors%norm, rcond, work, iwork, &
                        lapack_info)
            ! A NaN is no estimate, and counts as singular.
            if (.not. rcond > 4*epsilon(1.0_wp)) return
         end if
         call dgbtrs('N', n, kl, ku, 1, band, 2*kl + ku + 1, factors%pivot, x, n, lapack_info)
         if (all_finite(int(n, i8), x)) info = status_ok
      end associate
   end subroutine solve_factored_lapack

   !> True where no number of x is infinite or NaN. Counting has no early exit and so vectorises; n may exceed 2^31 in
   !> a large matrix.
   pure logical function all_finite(n, x)
      integer(i8), intent(in) :: n  !! numbers to look at; more than 2^31 in a large matrix
      real(wp), intent(in) :: x(n)  !! the numbers
      integer(i8) :: i, bad

      ! No number is skipped, so the loop does the same for all.
      bad = 0
      do i = 1, n
         bad = bad + merge(0_i8, 1_i8, abs(x(i)) <= huge(1.0_wp))
      end do
      all_finite = bad == 0
   end function all_finite

   !> Set a threaded BLAS to one thread: many small systems are solved on threads of our own, and threads within each
   !> solve slow that down many times over. Call blas_restore_threads once for each call. Where the BLAS in use has no
   !> such switch nothing is done.
   subroutine blas_single_thread()
      call take_threads()
   end subroutine blas_single_thread

   !> Give the BLAS its threads back, once its last user is done: calls are counted, since those of several host threads
   !> overlap.
   subroutine blas_restore_threads()
      call give_back_threads()
   end subroutine blas_restore_threads

end module symsde_solve_lapack
