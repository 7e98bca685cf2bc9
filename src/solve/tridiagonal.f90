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
   use symsde_base_kinds, only: wp, i8
   use symsde_base_traits, only: strip_lanes
   use symsde_solve_blocks, only: pivot_floor
   implicit none
   private
   public :: eliminate_down_strip, correct_up_strip, before_first_row, nabove
   public :: eliminate_down_lane, correct_up_lane

   !> What a pair hands to the next one, of its last row: c times the entry right of the diagonal, the inverse of the
   !> pivot, the right-hand side, and whether its lane is trusted (1 or 0); and the largest diagonal entry so far, where
   !> the unknowns are zero yet.
   integer, parameter :: nabove = 5
   real(wp), parameter :: before_first_row(strip_lanes, nabove) = &
                          spread([0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp], 1, strip_lanes)

contains

   !> VEC Rows of right-hand sides x + f and matrices I + c K of a strip, eliminated downwards after the rows
   !> before them, in pairs: with S = (d, b; b, a) what is left of a pair, one division, 1/det S, serves both rows. The
   !> pairs wait for each other, everything else is done meanwhile. m is even, or these are the last rows of all.
   pure subroutine eliminate_down_strip(m, c, starts, x, f, k, above, factor, rhs)
      integer, intent(in) :: m                              !! rows
      real(wp), intent(in) :: c                             !! factor of K
      logical, intent(in) :: starts                         !! the unknowns are zero, and x is not read
      real(wp), intent(in) :: x(strip_lanes, m)             !! unknowns
      real(wp), intent(in) :: f(strip_lanes, m)             !! residual less x
      real(wp), intent(in) :: k(strip_lanes, 0:1, m)        !! K
      real(wp), intent(inout) :: above(strip_lanes, nabove)
      real(wp), intent(out) :: factor(strip_lanes, m)       !! S^{-1} U: what the row after the pair adds to each of it
      real(wp), intent(out) :: rhs(strip_lanes, m)          !! S^{-1} L^{-1} residual
      real(wp), dimension(strip_lanes) :: carried, inverse, r, least, largest
      integer(i8) :: doubtful
      integer :: lane, i

      carried = above(:, 1)
      inverse = above(:, 2)
      r = above(:, 3)
      least = 1
      largest = above(:, 5)
      if (starts) then
         do i = 1, m - 1, 2
            do lane = 1, strip_lanes
               call note_larger(c, k(lane, 0, i), k(lane, 0, i + 1), largest(lane))
               call eliminate_pair(c, f(lane, i), f(lane, i + 1), k(lane, 0, i), k(lane, 1, i), k(lane, 0, i + 1), &
                                   k(lane, 1, i + 1), carried(lane), inverse(lane), r(lane), least(lane), &
                                   factor(lane, i), factor(lane, i + 1), rhs(lane, i), rhs(lane, i + 1))
            end do
         end do
      else
         do i = 1, m - 1, 2
            do lane = 1, strip_lanes
               call eliminate_pair(c, x(lane, i) + f(lane, i), x(lane, i + 1) + f(lane, i + 1), k(lane, 0, i), &
                                   k(lane, 1, i), k(lane, 0, i + 1), k(lane, 1, i + 1), carried(lane), inverse(lane), &
                                   r(lane), least(lane), factor(lane, i), factor(lane, i + 1), rhs(lane, i), &
                                   rhs(lane, i + 1))
            end do
         end do
      end if
      if (modulo(m, 2) == 1) then
         do lane = 1, strip_lanes
            call note_larger(c, k(lane, 0, m), k(lane, 0, m), largest(lane))
            call eliminate_last(c, merge(0.0_wp, x(lane, m), starts) + f(lane, m), k(lane, 0, m), carried(lane), &
                                inverse(lane), r(lane), least(lane), rhs(lane, m))
            factor(lane, m) = 0
         end do
      end if
      doubtful = 0
      do lane = 1, strip_lanes
         doubtful = doubtful + merge(0_i8, 1_i8, least(lane) + 0*inverse(lane) > 0)
      end do
      if (doubtful > 0) call look_closer(strip_lanes, m, c, k, above(:, 1), above(:, 2), above(:, 4))
      above(:, 1) = carried
      above(:, 2) = inverse
      above(:, 3) = r
      above(:, 5) = largest
   end subroutine eliminate_down_strip

   !> The same of one lane, all rows.
   pure subroutine eliminate_down_lane(m, c, x, f, k, factor, rhs, trusted, largest)
      integer, intent(in) :: m
      real(wp), intent(in) :: c, x(m), f(m), k(0:1, m)
      real(wp), intent(out) :: factor(m), rhs(m), trusted, largest
      real(wp) :: carried, inverse, r, least, found(1)
      integer :: i

      carried = before_first_row(1, 1)
      inverse = before_first_row(1, 2)
      r = before_first_row(1, 3)
      least = 1
      largest = before_first_row(1, 5)
      do i = 1, m - 1, 2
         call note_larger(c, k(0, i), k(0, i + 1), largest)
         call eliminate_pair(c, x(i) + f(i), x(i + 1) + f(i + 1), k(0, i), k(1, i), k(0, i + 1), k(1, i + 1), &
                             carried, inverse, r, least, factor(i), factor(i + 1), rhs(i), rhs(i + 1))
      end do
      if (modulo(m, 2) == 1) then
         call note_larger(c, k(0, m), k(0, m), largest)
         call eliminate_last(c, x(m) + f(m), k(0, m), carried, inverse, r, least, rhs(m))
         factor(m) = 0
      end if
      found = before_first_row(1, 4)
      if (.not. least + 0*inverse > 0) &
         call look_closer(1, m, c, k, before_first_row(1:1, 1), before_first_row(1:1, 2), found)
      trusted = found(1)
   end subroutine eliminate_down_lane

   !> Trust in pairs of rows, where some lane has a pivot that is not positive, or no number.
   pure subroutine look_closer(nlane, m, c, k, carried_before, inverse_before, trusted)
      integer, intent(in) :: nlane, m
      real(wp), intent(in) :: c, k(nlane, 0:1, m)
      real(wp), intent(in), dimension(nlane) :: carried_before, inverse_before  !! of the row before
      real(wp), intent(inout) :: trusted(nlane)
      real(wp) :: carried, inverse, entry, next, pivot, scale
      integer :: lane, i

      do lane = 1, nlane
         carried = carried_before(lane)
         inverse = inverse_before(lane)
         do i = 1, m - 1, 2
            entry = 1 + c*k(lane, 0, i)
            next = 1 + c*k(lane, 0, i + 1)
            pivot = entry - carried**2*inverse
            scale = 1/(pivot*next - (c*k(lane, 1, i))**2)
            if (.not. is_trusted(pivot, scale, entry*next)) trusted(lane) = 0
            carried = c*k(lane, 1, i + 1)
            inverse = pivot*scale
         end do
         if (modulo(m, 2) == 0) cycle
         entry = 1 + c*k(lane, 0, m)
         pivot = entry - carried**2*inverse
         if (.not. is_trusted(pivot, 1/pivot, entry)) trusted(lane) = 0
      end do
   end subroutine look_closer

   !> A pair of rows: residuals and entries of K.
   pure subroutine eliminate_pair(c, res1, res2, k1, beside1, k2, beside2, carried, inverse, r, least, &
                                  factor1, factor2, rhs1, rhs2)
      real(wp), intent(in) :: c, res1, res2, k1, beside1, k2, beside2
      real(wp), intent(inout) :: carried, inverse, r
      real(wp), intent(inout) :: least  !! positive while pivots and determinants are, NaN aside: that stays in inverse
      real(wp), intent(out) :: factor1, factor2, rhs1, rhs2
      real(wp) :: entry, next, pivot, beside, scale, y1

      entry = 1 + c*k1
      next = 1 + c*k2
      beside = c*beside1
      pivot = entry - carried**2*inverse
      scale = 1/((entry*next - beside**2) - carried**2*next*inverse)  ! does not wait for the pivot
      least = min(min(pivot, scale), least)
      y1 = res1 - carried*r
      carried = c*beside2
      inverse = pivot*scale
      r = (pivot*res2 - beside*y1)*scale
      rhs1 = (next*y1 - beside*res2)*scale
      rhs2 = r
      factor1 = -beside*scale*carried
      factor2 = inverse*carried
   end subroutine eliminate_pair

   !> The largest diagonal entry, with those of two rows.
   pure subroutine note_larger(c, k1, k2, largest)
      real(wp), intent(in) :: c, k1, k2
      real(wp), intent(inout) :: largest
      real(wp) :: entry

      entry = max(1 + c*k1, 1 + c*k2)
      largest = max(entry, largest)
   end subroutine note_larger

   !> The last row where their number is odd.
   pure subroutine eliminate_last(c, res, k, carried, inverse, r, least, rhs)
      real(wp), intent(in) :: c, res, k, carried, inverse, r
      real(wp), intent(inout) :: least
      real(wp), intent(out) :: rhs
      real(wp) :: entry, pivot

      entry = 1 + c*k
      pivot = entry - carried**2*inverse
      least = min(pivot, least) + 0*pivot
      rhs = (res - carried*r)/pivot
   end subroutine eliminate_last

   !> Whether the pivot and the inverse determinant of a pair are positive, or the determinant within bounds of what it
   !> would be without what is beside the diagonal. False for a NaN.
   pure logical function is_trusted(pivot, scale, plain)
      real(wp), intent(in) :: pivot, scale, plain
      real(wp) :: ratio

      ratio = abs(plain*scale)
      is_trusted = (pivot > 0 .and. scale > 0) .or. (ratio > pivot_floor .and. ratio < 1/pivot_floor)
   end function is_trusted

   !> VEC Solve upwards in a strip, x = x - d in running lanes, with the sizes of correction and unknowns.
   pure subroutine correct_up_strip(n, starts, factor, rhs, last, x, step, size)
      integer, intent(in) :: n                              !! unknowns of a system
      logical, intent(in) :: starts                         !! x = 0 before
      real(wp), intent(in) :: factor(strip_lanes, n), rhs(strip_lanes, n)  !! of eliminate_down_strip
      real(wp), intent(in) :: last(strip_lanes)             !! negative in lanes that rest
      real(wp), intent(inout) :: x(strip_lanes, n)          !! unknowns
      real(wp), intent(out) :: step(strip_lanes), size(strip_lanes)
      real(wp), dimension(strip_lanes) :: d, largest, extent, rests
      real(wp) :: x1, x2
      integer :: lane, i

      d = 0
      largest = 0
      extent = 0
      rests = last
      if (modulo(n, 2) == 1) then
         do lane = 1, strip_lanes
            d(lane) = rhs(lane, n)
            if (starts) x(lane, n) = 0
            x(lane, n) = merge(x(lane, n) - d(lane), x(lane, n), rests(lane) >= 0)
            largest(lane) = abs(d(lane))
            extent(lane) = abs(x(lane, n))
         end do
      end if
      if (starts) then
         do i = n - modulo(n, 2), 2, -2
            do lane = 1, strip_lanes
               call correct_pair(factor(lane, i - 1), factor(lane, i), rhs(lane, i - 1), rhs(lane, i), rests(lane), &
                                 0.0_wp, 0.0_wp, d(lane), x(lane, i - 1), x(lane, i), largest(lane), extent(lane))
            end do
         end do
      else
         do i = n - modulo(n, 2), 2, -2
            do lane = 1, strip_lanes
               x1 = x(lane, i - 1)
               x2 = x(lane, i)
               call correct_pair(factor(lane, i - 1), factor(lane, i), rhs(lane, i - 1), rhs(lane, i), rests(lane), &
                                 x1, x2, d(lane), x(lane, i - 1), x(lane, i), largest(lane), extent(lane))
            end do
         end do
      end if
      do lane = 1, strip_lanes
         step(lane) = largest(lane) + 0*d(lane)  ! a NaN goes on from pair to pair: it is in the last d
         size(lane) = extent(lane)
      end do
   end subroutine correct_up_strip

   !> The same in a lane that runs.
   pure subroutine correct_up_lane(n, factor, rhs, x, step, size)
      integer, intent(in) :: n
      real(wp), intent(in) :: factor(n), rhs(n)
      real(wp), intent(inout) :: x(n)
      real(wp), intent(out) :: step, size
      real(wp) :: d, x1, x2
      integer :: i

      d = 0
      step = 0
      size = 0
      if (modulo(n, 2) == 1) then
         d = rhs(n)
         x(n) = x(n) - d
         step = abs(d)
         size = abs(x(n))
      end if
      do i = n - modulo(n, 2), 2, -2
         x1 = x(i - 1)
         x2 = x(i)
         call correct_pair(factor(i - 1), factor(i), rhs(i - 1), rhs(i), 0.0_wp, x1, x2, d, x(i - 1), x(i), step, size)
      end do
      step = step + 0*d
   end subroutine correct_up_lane

   !> A pair of rows upwards; d is the correction of the row after it, then that of its first row. A NaN is
   !> not among the largest.
   pure subroutine correct_pair(factor1, factor2, rhs1, rhs2, rests, old1, old2, d, x1, x2, largest, extent)
      real(wp), intent(in) :: factor1, factor2, rhs1, rhs2
      real(wp), intent(in) :: rests   !! negative where the lane rests
      real(wp), intent(in) :: old1, old2  !! unknowns
      real(wp), intent(inout) :: d, largest, extent
      real(wp), intent(out) :: x1, x2     !! corrected
      real(wp) :: d1, d2

      d2 = rhs2 - factor2*d
      d1 = rhs1 - factor1*d
      d = d1
      x2 = old2 - merge(d2, 0.0_wp, rests >= 0)
      x1 = old1 - merge(d1, 0.0_wp, rests >= 0)
      largest = max(max(abs(d1), abs(d2)), largest)
      extent = max(max(abs(x1), abs(x2)), extent)
   end subroutine correct_pair

end module symsde_solve_tridiagonal
