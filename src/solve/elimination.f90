! SPDX-License-Identifier: BSD-3-Clause
!> Many small dense linear systems, one per lane, solved side by side without pivoting.
!>
!> Newton's matrix is I + O(sqrt(h)), so pivots stay near one and an exchange of rows, which no
!> vector unit does well, is not needed. Each lane is watched instead: `smallest` is
!>
!>     min over k of min(|u_kk|, |a_kk|) / max(|u_kk|, |a_kk|)        (0 if that is no number)
!>
!> with u_kk the pivot and a_kk the diagonal it came from. It is small where a pivot cancels or
!> where an earlier small pivot made this one grow, and a scaling of rows or columns (stiff momenta
!> beside slow positions) does not change it. Callers hand lanes with a small value to LAPACK.
!> A NaN or infinity in a lane shows as smallest = 0 or as a solution that is not finite.
!>
!> A lane's result is made of its own numbers only, in an order that nlane does not change; nlane
!> is a multiple of eight wherever equal bits in blocks of different sizes are wanted.
module symsde_solve_elimination
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: strip_lanes, solve_lanes, solve_strip, factor_lanes, back_substitute_lanes
   public :: pivot_ratio, solve_lone

   integer, parameter :: cached = 2304      !! numbers of the matrices of a strip of small systems
   integer, parameter :: narrow_strip = 32  !! lanes of a strip of larger systems
   integer, parameter :: few = 8            !! numbers of one system from which vectors pay

contains

   !> Lanes to eliminate together: as many as keep the matrices in the first-level cache, but not
   !> so few that the loops over them stop paying. Lanes do not feel the width of their strip.
   pure integer function strip_lanes(nlane, entries)
      integer, intent(in) :: nlane    !! lanes of the block
      integer, intent(in) :: entries  !! numbers of a lane's matrix

      strip_lanes = max(narrow_strip, cached/entries/narrow_strip*narrow_strip)
      strip_lanes = min(strip_lanes, nlane)
   end function strip_lanes

   !> Solve a(lane,:,:) x(lane,:) = x(lane,:) in every lane; one and two unknowns in closed form.
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
         widest = strip_lanes(nlane, n*n)
         allocate (strip(widest, n, n), part(widest, n))
         do first = 1, nlane, widest
            call solve_strip(nlane, n, first, min(widest, nlane - first + 1), a, x, &
                             smallest, strip, part)
         end do
      end select
   end subroutine solve_lanes

   !> Solve the lanes first .. first+width-1 in a compact copy, which stays in cache and keeps a.
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
      do j = 1, n
         do i = 1, n
            strip(:, i, j) = a(first:last, i, j)
         end do
         part(:, j) = x(first:last, j)
      end do
      call factor_lanes(width, n, strip, smallest(first:last))
      call back_substitute_lanes(width, n, strip, part)
      do j = 1, n
         x(first:last, j) = part(:, j)
      end do
   end subroutine solve_strip

   !> One system by itself, by the operations of solve_strip in their order.
   pure subroutine solve_lone(n, a, x, smallest)
      integer, intent(in) :: n              !! unknowns, from 3 on
      real(wp), intent(inout) :: a(n, n)    !! in: the matrix; out: factors
      real(wp), intent(inout) :: x(n)       !! in: right-hand side; out: solution
      real(wp), intent(out) :: smallest     !! pivot monitor
      real(wp) :: diagonal(n), origin, reached, ratio
      integer :: i, j, k

      do k = 1, n
         diagonal(k) = abs(a(k, k))
      end do
      smallest = 1
      do k = 1, n
         origin = diagonal(k)
         reached = abs(a(k, k))
         ratio = merge(reached, origin, reached <= origin)/(merge(origin, reached, reached <= origin) + tiny(ratio))
         smallest = merge(smallest, merge(ratio, 0.0_wp, ratio >= 0), smallest <= ratio)
         a(k, k) = 1/(a(k, k) + merge(1.0_wp, 0.0_wp, reached <= 0))
         if (k == n) exit
         !GCC$ novector
         do i = k + 1, n
            a(i, k) = a(i, k)*a(k, k)
         end do
         call subtract_column(n - k, x(k), a(k + 1, k), x(k + 1))
         do j = k + 1, n
            call subtract_column(n - k, a(k, j), a(k + 1, k), a(k + 1, j))
         end do
      end do
      do k = n, 2, -1
         x(k) = x(k)*a(k, k)
         call subtract_column(k - 1, x(k), a(1, k), x)
      end do
      x(1) = x(1)*a(1, 1)
   end subroutine solve_lone

   !> target = target - factor column. Few numbers are faster without vectors.
   pure subroutine subtract_column(m, factor, column, target)
      integer, intent(in) :: m
      real(wp), intent(in) :: factor, column(m)
      real(wp), intent(inout) :: target(m)
      integer :: i

      if (m < few) then
         !GCC$ novector
         do i = 1, m
            target(i) = target(i) - column(i)*factor
         end do
      else
         do i = 1, m
            target(i) = target(i) - column(i)*factor
         end do
      end if
   end subroutine subtract_column

   !> One unknown: x = b/a.
   subroutine solve_one_unknown(nlane, a, x, smallest)
      integer, intent(in) :: nlane              !! lanes of the block
      real(wp), intent(in) :: a(nlane)          !! coefficients
      real(wp), intent(inout) :: x(nlane)       !! in: right-hand sides; out: solutions
      real(wp), intent(out) :: smallest(nlane)  !! 1, or 0 where a is zero or not finite
      integer :: lane

      do lane = 1, nlane
         x(lane) = x(lane)/a(lane)
         smallest(lane) = merge(1.0_wp, 0.0_wp, abs(a(lane)) > 0 .and. abs(a(lane)) <= huge(1.0_wp))
      end do
   end subroutine solve_one_unknown

   !> VEC Two unknowns: elimination written out. Near the identity its rounding error is three quarters
   !> of that of Cramer's rule (0.43 against 0.56 eps, root mean square).
   subroutine solve_two_unknowns(nlane, a11, a21, a12, a22, x1, x2, smallest)
      integer, intent(in) :: nlane                            !! lanes of the block
      real(wp), intent(in), dimension(nlane) :: a11, a21      !! first columns
      real(wp), intent(in), dimension(nlane) :: a12, a22      !! second columns
      real(wp), intent(inout), dimension(nlane) :: x1, x2     !! right-hand sides, then solutions
      real(wp), intent(out) :: smallest(nlane)                !! pivot monitor
      real(wp) :: inverse, multiplier, pivot, ratio, low, high
      integer :: lane

      do lane = 1, nlane
         inverse = 1/a11(lane)
         multiplier = a21(lane)*inverse
         pivot = a22(lane) - multiplier*a12(lane)
         x2(lane) = (x2(lane) - multiplier*x1(lane))/pivot
         x1(lane) = (x1(lane) - a12(lane)*x2(lane))*inverse
         low = merge(abs(pivot), abs(a22(lane)), abs(pivot) <= abs(a22(lane)))
         high = merge(abs(a22(lane)), abs(pivot), abs(pivot) <= abs(a22(lane)))
         ratio = low/high
         ratio = merge(ratio, 0.0_wp, ratio >= 0)
         smallest(lane) = merge(ratio, 0.0_wp, abs(a11(lane)) <= huge(1.0_wp))
      end do
   end subroutine solve_two_unknowns

   !> Factor every lane in place: a = L U, L below the diagonal with unit diagonal, U on and above
   !> it, the diagonal holding 1/u_kk. About n^3/3 multiplications and subtractions a lane.
   subroutine factor_lanes(nlane, n, a, smallest)
      integer, intent(in) :: nlane               !! lanes
      integer, intent(in) :: n                   !! unknowns of a system
      real(wp), intent(inout) :: a(nlane, n, n)  !! in: matrices; out: factors
      real(wp), intent(out) :: smallest(nlane)   !! pivot monitor, 0 to 1
      real(wp) :: diagonal(nlane, n)
      integer :: j, k

      do k = 1, n
         diagonal(:, k) = a(:, k, k)
      end do
      smallest = 1
      do k = 1, n
         call pivot_ratio(nlane, diagonal(:, k), a(:, k, k), smallest)
         if (k == n) exit
         call scale_column(nlane, n - k, a(1, k, k), a(1, k + 1, k))
         do j = k + 1, n
            call subtract_multiple(nlane, n - k, a(1, k, j), a(1, k + 1, k), a(1, k + 1, j))
         end do
      end do
   end subroutine factor_lanes

   !> Solve with the factors of factor_lanes.
   subroutine back_substitute_lanes(nlane, n, a, x)
      integer, intent(in) :: nlane            !! lanes
      integer, intent(in) :: n                !! unknowns of a system
      real(wp), intent(in) :: a(nlane, n, n)  !! factors
      real(wp), intent(inout) :: x(nlane, n)  !! in: right-hand sides; out: solutions
      integer :: k

      do k = 1, n - 1
         call subtract_multiple(nlane, n - k, x(1, k), a(1, k + 1, k), x(1, k + 1))
      end do
      do k = n, 2, -1
         x(:, k) = x(:, k)*a(:, k, k)
         call subtract_multiple(nlane, k - 1, x(1, k), a(1, 1, k), x(1, 1))
      end do
      x(:, 1) = x(:, 1)*a(:, 1, 1)
   end subroutine back_substitute_lanes

   !> VEC Lower `smallest` by one pivot's ratio to the diagonal it came from; leave 1/pivot.
   subroutine pivot_ratio(nlane, diagonal, pivot, smallest)
      integer, intent(in) :: nlane                !! lanes
      real(wp), intent(in) :: diagonal(nlane)     !! diagonal entry of the matrix
      real(wp), intent(inout) :: pivot(nlane)     !! in: pivot; out: its inverse
      real(wp), intent(inout) :: smallest(nlane)  !! pivot monitor
      real(wp) :: ratio, low, high, origin, reached, missing
      integer :: lane

      ! min and max could drop a NaN; these comparisons hand it on to the ratio. A pivot of zero has the ratio zero
      ! and no inverse: a host that traps divisions by zero does not hear of lanes that LAPACK will solve. Divisors are
      ! sums that never vanish: between two divisors to choose from, the compiler may divide by both and choose then.
      do lane = 1, nlane
         origin = abs(diagonal(lane))
         reached = abs(pivot(lane))
         low = merge(reached, origin, reached <= origin)
         high = merge(origin, reached, reached <= origin)
         ratio = low/(high + tiny(high))
         ratio = merge(ratio, 0.0_wp, ratio >= 0)
         smallest(lane) = merge(ratio, smallest(lane), ratio < smallest(lane))
         missing = merge(1.0_wp, 0.0_wp, reached <= 0)
         pivot(lane) = 1/(pivot(lane) + missing)
      end do
   end subroutine pivot_ratio

   !> VEC column(:,i) = column(:,i) factor
   subroutine scale_column(nlane, m, factor, column)
      integer, intent(in) :: nlane                 !! lanes
      integer, intent(in) :: m                     !! entries of the column
      real(wp), intent(in) :: factor(nlane)        !! a factor for each lane
      real(wp), intent(inout) :: column(nlane, m)  !! column to scale
      integer :: i, lane

      do i = 1, m
         do lane = 1, nlane
            column(lane, i) = column(lane, i)*factor(lane)
         end do
      end do
   end subroutine scale_column

   !> VEC target(:,i) = target(:,i) - factor column(:,i). A procedure of its own because distinct
   !> arguments cannot overlap: as parts of one array they cost a test before every loop.
   subroutine subtract_multiple(nlane, m, factor, column, target)
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

end module symsde_solve_elimination
