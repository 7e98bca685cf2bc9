! SPDX-License-Identifier: BSD-3-Clause
!> One system A x = b with exchanges of rows, dense or banded, and whether there is a solution.
!>
!>    nonfinite   a number of A or b is infinite or NaN, before anything is solved
!>    singular    a pivot is zero, the condition number too large if requested, or the solution not finite
!>    status_ok   x is the solution
!>
!> All but large dense systems are solved by eliminations of the library (solve/pivoting, solve/banded_pivoting): their
!> bits do not depend on the installed LAPACK. LAPACK solves dense systems of more than `most_eliminated` unknowns, for
!> which some implementations are faster. Its solution is used if it satisfies the system; otherwise the library's own
!> elimination decides, so that the status of a system does not depend on LAPACK either.
!>
!> If a system fails, x is undefined in the procedures for one system, and unchanged in those for a lane of a block.
module symsde_solve_one_system
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_lanes, only: all_finite
   use symsde_base_status, only: status_ok, singular, nonfinite
   use symsde_solve_banded_pivoting, only: &
      banded_factors, new_banded_factors, factor_columns, substitute, reciprocal_condition
   use symsde_solve_lapack, only: solve_by_lapack, lapack_is_usable
   use symsde_solve_pivoting, only: eliminate_pivoting
   implicit none
   private
   public :: solve_dense, solve_dense_alone, solve_lane, solve_banded, solve_banded_lane, solve_factored
   public :: lapack_takes, most_eliminated

   !> Dense systems of up to this size are eliminated by the library, larger ones by LAPACK. On AVX2 elimination takes
   !> 0.6 of OpenBLAS's time at 40 unknowns, 0.95 at 128, 1.0 at 160, 1.2 at 256, and a third of netlib's time at any
   !> size.
   integer, parameter :: most_eliminated = 160

   !> Allowed residual as a fraction of |A| |x|. LAPACK's rounding is about 1e-14 of |A| |x|; a wrong solution has a
   !> residual of its size.
   real(wp), parameter :: most_missed = 1.0e-8_wp

contains

   !> Whether LAPACK solves dense systems of n unknowns.
   logical function lapack_takes(n)
      integer, intent(in) :: n

      lapack_takes = .false.
      if (n > most_eliminated) lapack_takes = lapack_is_usable()
   end function lapack_takes

   !> Solve a x = b with row exchanges, n^3/3 multiplications.
   subroutine solve_dense(n, a, x, info)
      integer, intent(in) :: n              !! unknowns
      real(wp), intent(inout) :: a(n, n)    !! matrix, destroyed
      real(wp), intent(inout) :: x(n)       !! in: right-hand side; out: solution, if info is ok
      integer(i4), intent(out) :: info      !! status_ok, singular or nonfinite
      real(wp), allocatable :: factors(:, :), solution(:)

      if (lapack_takes(n) .and. is_sound(n, a, x)) then
         factors = a
         solution = x
         call solve_by_lapack(n, factors, solution)
         if (satisfies(n, a, x, solution)) then
            x = solution
            info = status_ok
            return
         end if
      end if
      call solve_dense_alone(n, a, x, info)
   end subroutine solve_dense

   !> Solve without LAPACK, whatever the size.
   subroutine solve_dense_alone(n, a, x, info)
      integer, intent(in) :: n              !! unknowns
      real(wp), intent(inout) :: a(n, n)    !! matrix, destroyed
      real(wp), intent(inout) :: x(n)       !! in: right-hand side; out: solution, if info is ok
      integer(i4), intent(out) :: info      !! status_ok, singular or nonfinite
      logical :: is_singular

      info = nonfinite
      if (.not. is_sound(n, a, x)) return
      info = singular
      call eliminate_pivoting(n, a, x, is_singular)
      if (is_singular) return
      if (all_finite(int(n, i8), x)) info = status_ok
   end subroutine solve_dense_alone

   !> Whether all numbers of a system are finite.
   pure logical function is_sound(n, a, b)
      integer, intent(in) :: n
      real(wp), intent(in) :: a(n, n), b(n)

      is_sound = all_finite(size(a, kind=i8), a) .and. all_finite(size(b, kind=i8), b)
   end function is_sound

   !> Whether |b - A x| is rounding compared with |A| |x| + |b|, by largest entries; false if the residual overflows.
   pure logical function satisfies(n, a, b, x)
      integer, intent(in) :: n
      real(wp), intent(in) :: a(n, n), b(n), x(n)
      real(wp) :: residual(n), scale(n)
      integer :: j

      residual = b
      scale = abs(b)
      do j = 1, n
         residual = residual - a(:, j)*x(j)
         scale = scale + abs(a(:, j)*x(j))
      end do
      satisfies = all_finite(int(n, i8), x) .and. all_finite(int(n, i8), residual) .and. &
                  maxval(abs(residual)) <= most_missed*maxval(scale)
   end function satisfies

   !> Solve one lane of a block of dense systems. Its numbers are nlane apart in memory, so matrix and right-hand side
   !> are copied; the matrix of the block is kept for callers that form residuals.
   subroutine solve_lane(nlane, n, lane, a, x, info)
      integer, intent(in) :: nlane            !! lanes of the block
      integer, intent(in) :: n                !! unknowns of a system
      integer, intent(in) :: lane             !! the lane to solve
      real(wp), intent(in) :: a(nlane, n, n)  !! matrices, kept
      real(wp), intent(inout) :: x(nlane, n)  !! x(lane,:): right-hand side, then solution if ok
      integer(i4), intent(out) :: info        !! status_ok, singular or nonfinite
      real(wp), allocatable :: matrix(:, :), vector(:)

      ! Allocated in each call, since calls are rare: most blocks have no such lane.
      allocate (matrix(n, n), vector(n))
      matrix(:, :) = a(lane, :, :)
      vector(:) = x(lane, :)
      call solve_dense(n, matrix, vector, info)
      ! A lane that fails keeps its right-hand side.
      if (info == status_ok) x(lane, :) = vector
   end subroutine solve_lane

   !> Solve one lane of a block of banded systems, ab(lane, d, i) = A(i, i+d), copied into the storage of LAPACK.
   subroutine solve_banded_lane(nlane, n, kl, ku, lane, ab, x, info)
      integer, intent(in) :: nlane                  !! lanes of the block
      integer, intent(in) :: n                      !! unknowns of a system
      integer, intent(in) :: kl                     !! diagonals below the main one
      integer, intent(in) :: ku                     !! diagonals above the main one
      integer, intent(in) :: lane                   !! the lane to solve
      real(wp), intent(in) :: ab(nlane, -kl:ku, n)  !! matrices, kept
      real(wp), intent(inout) :: x(nlane, n)        !! x(lane,:): right-hand side, then solution if ok
      integer(i4), intent(out) :: info              !! status_ok, singular or nonfinite
      real(wp), allocatable :: band(:, :), vector(:)
      integer :: d, i

      allocate (band(2*kl + ku + 1, n), source=0.0_wp)
      do i = 1, n
         ! A(i, i+d) goes to row kl+ku+1-d of column i+d; the kl rows above stay zero, as room for exchanges.
         do d = max(-kl, 1 - i), min(ku, n - i)
            band(kl + ku + 1 - d, i + d) = ab(lane, d, i)
         end do
      end do
      vector = x(lane, :)
      call solve_banded(n, kl, ku, band, vector, info)
      ! A lane that fails keeps its right-hand side.
      if (info == status_ok) x(lane, :) = vector
   end subroutine solve_banded_lane

   !> Solve one banded system, A(i,j) at band(kl+ku+1+i-j, j); the kl rows above are zero. All columns are factored in
   !> one part.
   subroutine solve_banded(n, kl, ku, band, x, info)
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
      ! A zero pivot is recorded in `factors`, and reported as singular below.
      call factor_columns(factors, band, huge(1.0_wp))
      call solve_factored(factors, band, x, info)
   end subroutine solve_banded

   !> Solve one banded system from factors, which may have been made in parts. With rcond, a system whose condition
   !> number exceeds 1/(4 eps) is singular too: its solution would have no correct digit.
   subroutine solve_factored(factors, band, x, info, rcond)
      type(banded_factors), intent(in) :: factors           !! made by solve/banded_pivoting
      real(wp), intent(in) :: band(2*factors%kl + factors%ku + 1, factors%n)   !! the factors' numbers
      real(wp), intent(inout) :: x(factors%n)               !! in: right-hand side; out: solution, if ok
      integer(i4), intent(out) :: info                      !! status_ok, singular or nonfinite
      real(wp), intent(out), optional :: rcond              !! 1/(|A| |A^-1|), estimated, in the 1-norm

      ! The condition reported if nothing is solved.
      if (present(rcond)) rcond = 0
      info = nonfinite
      if (.not. all_finite(int(factors%n, i8), x)) return
      info = singular
      if (factors%is_singular) return
      if (present(rcond)) then
         rcond = reciprocal_condition(factors, band)
         ! A NaN is no estimate, and counts as singular.
         if (.not. rcond > 4*epsilon(1.0_wp)) return
      end if
      call substitute(factors, band, x)
      if (all_finite(int(factors%n, i8), x)) info = status_ok
   end subroutine solve_factored

end module symsde_solve_one_system
