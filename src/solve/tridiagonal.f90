! SPDX-License-Identifier: BSD-3-Clause
!> Newton corrections from symmetric tridiagonal matrices I + c K, one a lane, without pivoting.
!>
!> Row i of K is its diagonal entry k(lane, 0, i) and the one right of it, k(lane, 1, i). Downwards pairs of rows
!> become factors and right-hand sides; upwards the solution is found pair by pair and used at once. A lane is trusted
!> while its pivots are positive, for elimination of a positive definite matrix is stable whatever their sizes, or
!> else within pivot_floor of the entries they came from, either way; a NaN is not trusted.
!>
!> A strip of lanes whose number the compiler knows goes through together: a row's lanes stay in registers
!> until the next row has read them, and K need not be kept: it is eliminated a few rows at a time, as it
!> comes. Row by row over all lanes of a block takes a third more time for 64 lanes, two thirds for 16.
module symsde_solve_tridiagonal
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: strip_lanes
   use symsde_solve_blocks, only: pivot_floor
   implicit none
   private
   public :: eliminate_down_strip, correct_up_strip, before_first_row, nabove

   !> What a pair hands to the next one, of its last row: c times the entry right of the diagonal, the inverse of the
   !> pivot, the right-hand side, and whether its lane is trusted (1 or 0); and the largest diagonal entry so far.
   integer, parameter :: nabove = 5
   real(wp), parameter :: before_first_row(strip_lanes, nabove) = &
                          spread([0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp], 1, strip_lanes)

contains

   !> VEC Rows of right-hand sides x + f and matrices I + c K of a strip, eliminated downwards after the rows
   !> before them, in pairs: with S = (d, b; b, a) what is left of a pair, one division, 1/det S, serves both rows. The
   !> pairs wait for each other, everything else is done meanwhile. m is even, or these are the last rows of all.
   pure subroutine eliminate_down_strip(m, c, x, f, k, above, factor, rhs)
      integer, intent(in) :: m                              !! rows
      real(wp), intent(in) :: c                             !! factor of K
      real(wp), intent(in) :: x(strip_lanes, m)             !! unknowns
      real(wp), intent(in) :: f(strip_lanes, m)             !! residual less x
      real(wp), intent(in) :: k(strip_lanes, 0:1, m)        !! K
      real(wp), intent(inout) :: above(strip_lanes, nabove)
      real(wp), intent(out) :: factor(strip_lanes, m)       !! S^{-1} U: what the row after the pair adds to each of it
      real(wp), intent(out) :: rhs(strip_lanes, m)          !! S^{-1} L^{-1} residual
      real(wp), dimension(strip_lanes) :: carried, inverse, r, trusted, largest
      real(wp) :: entry, next, pivot, beside, scale, y1, y2
      integer :: lane, i

      carried = above(:, 1)
      inverse = above(:, 2)
      r = above(:, 3)
      trusted = above(:, 4)
      largest = above(:, 5)
      do i = 1, m - 1, 2
         do lane = 1, strip_lanes
            entry = 1 + c*k(lane, 0, i)
            next = 1 + c*k(lane, 0, i + 1)
            beside = c*k(lane, 1, i)
            pivot = entry - carried(lane)**2*inverse(lane)
            scale = 1/(pivot*next - beside**2)
            trusted(lane) = merge(trusted(lane), 0.0_wp, is_trusted(pivot, scale, entry*next))
            entry = merge(entry, next, entry > next)
            largest(lane) = merge(entry, largest(lane), entry > largest(lane))
            y1 = x(lane, i) + f(lane, i) - carried(lane)*r(lane)
            y2 = x(lane, i + 1) + f(lane, i + 1)
            carried(lane) = c*k(lane, 1, i + 1)
            inverse(lane) = pivot*scale
            r(lane) = (pivot*y2 - beside*y1)*scale
            rhs(lane, i) = (next*y1 - beside*y2)*scale
            rhs(lane, i + 1) = r(lane)
            factor(lane, i) = -beside*scale*carried(lane)
            factor(lane, i + 1) = inverse(lane)*carried(lane)
         end do
      end do
      if (modulo(m, 2) == 1) then
         do lane = 1, strip_lanes
            entry = 1 + c*k(lane, 0, m)
            pivot = entry - carried(lane)**2*inverse(lane)
            trusted(lane) = merge(trusted(lane), 0.0_wp, is_trusted(pivot, 1/pivot, entry))
            largest(lane) = merge(entry, largest(lane), entry > largest(lane))
            factor(lane, m) = 0
            rhs(lane, m) = (x(lane, m) + f(lane, m) - carried(lane)*r(lane))/pivot
         end do
      end if
      above(:, 1) = carried
      above(:, 2) = inverse
      above(:, 3) = r
      above(:, 4) = trusted
      above(:, 5) = largest
   end subroutine eliminate_down_strip

   !> Whether the pivot and the inverse determinant of a pair are positive, or the determinant within bounds of what it
   !> would be without what is beside the diagonal. False for a NaN.
   pure logical function is_trusted(pivot, scale, plain)
      real(wp), intent(in) :: pivot, scale, plain
      real(wp) :: ratio

      ratio = abs(plain*scale)
      is_trusted = (pivot > 0 .and. scale > 0) .or. (ratio > pivot_floor .and. ratio < 1/pivot_floor)
   end function is_trusted

   !> VEC Solve upwards in a strip, x = x - d in running lanes, with the sizes of correction and unknowns.
   pure subroutine correct_up_strip(n, factor, rhs, last, x, step, size)
      integer, intent(in) :: n                              !! unknowns of a system
      real(wp), intent(in) :: factor(strip_lanes, n), rhs(strip_lanes, n)  !! of eliminate_down_strip
      real(wp), intent(in) :: last(strip_lanes)             !! negative in lanes that rest
      real(wp), intent(inout) :: x(strip_lanes, n)          !! unknowns
      real(wp), intent(out) :: step(strip_lanes), size(strip_lanes)
      real(wp), dimension(strip_lanes) :: d, largest, extent, rests
      real(wp) :: d1, d2, new1, new2
      integer :: lane, i

      d = 0
      largest = 0
      extent = 0
      rests = last
      if (modulo(n, 2) == 1) then
         do lane = 1, strip_lanes
            d(lane) = rhs(lane, n)
            x(lane, n) = merge(x(lane, n) - d(lane), x(lane, n), rests(lane) >= 0)
            largest(lane) = abs(d(lane))
            extent(lane) = abs(x(lane, n))
         end do
      end if
      do i = n - modulo(n, 2), 2, -2
         do lane = 1, strip_lanes
            d2 = rhs(lane, i) - factor(lane, i)*d(lane)
            d1 = rhs(lane, i - 1) - factor(lane, i - 1)*d(lane)
            d(lane) = d1
            new2 = merge(x(lane, i) - d2, x(lane, i), rests(lane) >= 0)
            new1 = merge(x(lane, i - 1) - d1, x(lane, i - 1), rests(lane) >= 0)
            x(lane, i) = new2
            x(lane, i - 1) = new1
            d1 = merge(abs(d2), abs(d1), abs(d2) >= abs(d1))
            new1 = merge(abs(new2), abs(new1), abs(new2) >= abs(new1))
            ! a NaN is in both rows of a pair and goes on from pair to pair; these comparisons take it
            largest(lane) = merge(largest(lane), d1, d1 <= largest(lane))
            extent(lane) = merge(extent(lane), new1, new1 <= extent(lane))
         end do
      end do
      step = largest
      size = extent
   end subroutine correct_up_strip

end module symsde_solve_tridiagonal
