! SPDX-License-Identifier: BSD-3-Clause
!> Newton corrections from symmetric tridiagonal matrices I + c K, one per lane, without pivoting.
!>
!> Row i of K is its diagonal entry k(lane, 0, i) and the one right of it, k(lane, 1, i). Rows are eliminated from
!> both ends (a twisted factorization): the upper ones downwards, the lower ones upwards, in pairs. Let b be the entry
!> of I + c K that couples the two rows of a pair, u the entry that couples the pair to the row before it in its front,
!> v the entry that couples it to the row ahead, and z and w numbers from the pair before. With a = 1 + c K_11 - u^2 w
!> and e = 1 + c K_22, the pair is reduced to
!>
!>    S = ( a  b )      S^{-1} = ( e  -b ) / (a e - b^2)      y = (r_1 - u z, r_2)
!>        ( b  e )               (-b   a )
!>
!> and it passes on v, the second entry of S^{-1} y as z, and (S^{-1})_22 as w. With d the correction of the row ahead,
!> the corrections of the pair are
!>
!>    (d_1, d_2) = S^{-1} y - S^{-1} (0, v) d
!>
!> so S^{-1} y is kept as `rhs`, and S^{-1} (0, v) as `factor`. The first entry of S^{-1} (0, v) is negative for
!> positive b and v; `factor` holds this entry with the sign reversed. Two unknowns remain where the two fronts meet;
!> from there the solution is found pair by pair outwards and applied: x <- x - d.
!>
!> A lane is trusted while its pivots are positive, since elimination of a positive definite matrix is stable whatever
!> their sizes, or while they are within a factor pivot_floor of the entries they came from. A NaN is not trusted, nor
!> are entries whose products overflow.
!>
!> Each pair of a front needs the pair before, but the two fronts are independent: a single lane alternates between
!> them, in half the time. The lanes of a strip, whose number the compiler knows, are eliminated together: a row's lanes
!> stay in registers until the next row has read them, and K is eliminated a few rows at a time, as it is computed. Row
!> by row over all lanes of a block takes a third more time for 64 lanes, two thirds for 16.
!>
!> A strip is solved in these steps: its upper rows in parts (eliminate_down_strip), its lower rows in parts
!> (eliminate_up_strip), each part beginning with the `front` that the one before has left; the two rows in the middle
!> (meet_strip); and all others from there outwards (correct_strip). For a single lane solve_lane does all of it.
module symsde_solve_tridiagonal
   use symsde_base_kinds, only: wp, i8
   use symsde_base_traits, only: strip_lanes
   use symsde_solve_blocks, only: pivot_floor
   implicit none
   private
   public :: upper_rows, eliminate_down_strip, eliminate_up_strip, meet_strip, correct_strip, before_first_row, nfront
   public :: solve_lane

   !> Numbers that a pair passes to the next pair of its front: for its row nearer to that pair, c times the entry that
   !> couples the two, the inverse of the pivot, and the right-hand side; whether the lane is trusted (1 or 0); and the
   !> largest diagonal entry so far.
   integer, parameter :: nfront = 5
   !> Entries up to which the product of three does not overflow.
   real(wp), parameter :: largest_entry = 1e100_wp
   real(wp), parameter :: before_first_row(strip_lanes, nfront) = &
                          spread([0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp], 1, strip_lanes)

contains

   !> How many of n >= 2 rows are eliminated downwards: an even number near n/2.
   pure integer function upper_rows(n)
      integer, intent(in) :: n

      upper_rows = 2*((n + 2)/4)
   end function upper_rows

   !> VEC Eliminate rows of a strip downwards in pairs, with right-hand sides x + f and matrices I + c K, after the rows
   !> before them: with S = (a, b; b, e) the reduced pair, one division, 1/det S, serves both rows. Each pair needs the
   !> one before; all other work is independent of it.
   pure subroutine eliminate_down_strip(m, c, x, f, k, front, factor, rhs)
      integer, intent(in) :: m                              !! rows, an even number
      real(wp), intent(in) :: c                             !! factor of K
      real(wp), intent(in) :: x(strip_lanes, m)             !! unknowns
      real(wp), intent(in) :: f(strip_lanes, m)             !! residual less x
      real(wp), intent(in) :: k(strip_lanes, 0:1, 0:m)      !! K; row 0 is not read
      real(wp), intent(inout) :: front(strip_lanes, nfront)
      real(wp), intent(out) :: factor(strip_lanes, m)       !! S^{-1} U: factors of the row ahead of a pair
      real(wp), intent(out) :: rhs(strip_lanes, m)          !! S^{-1} L^{-1} residual
      real(wp), dimension(strip_lanes) :: carried, inverse, r, largest
      integer(i8) :: signs(strip_lanes)
      integer :: lane, i

      ! u, w and z of the pair before these rows, in copies that stay in registers.
      carried = front(:, 1)
      inverse = front(:, 2)
      r = front(:, 3)
      signs = 0
      largest = front(:, 5)
      do i = 1, m - 1, 2
         do lane = 1, strip_lanes
            call note_larger(c, k(lane, 0, i), k(lane, 0, i + 1), largest(lane))
            call eliminate_pair(c, x(lane, i) + f(lane, i), x(lane, i + 1) + f(lane, i + 1), k(lane, 0, i), &
                                k(lane, 1, i), k(lane, 0, i + 1), k(lane, 1, i + 1), carried(lane), inverse(lane), &
                                r(lane), signs(lane), factor(lane, i), factor(lane, i + 1), rhs(lane, i), &
                                rhs(lane, i + 1))
         end do
      end do
      call leave(m, c, 1, k, carried, inverse, r, signs, largest, front)
   end subroutine eliminate_down_strip

   !> VEC Eliminate rows of a strip upwards in pairs, after the rows below them, as eliminate_down_strip does downwards.
   !> m is even unless these are the last rows of all; the last row then has an empty partner.
   pure subroutine eliminate_up_strip(m, c, x, f, k, front, factor, rhs)
      integer, intent(in) :: m
      real(wp), intent(in) :: c
      real(wp), intent(in) :: x(strip_lanes, m), f(strip_lanes, m)
      real(wp), intent(in) :: k(strip_lanes, 0:1, 0:m)      !! row 0 couples the first row to the row ahead
      real(wp), intent(inout) :: front(strip_lanes, nfront)
      real(wp), intent(out) :: factor(strip_lanes, m), rhs(strip_lanes, m)
      real(wp), dimension(strip_lanes) :: carried, inverse, r, largest
      integer(i8) :: signs(strip_lanes)
      real(wp) :: unused(2)
      integer :: lane, i

      carried = front(:, 1)
      inverse = front(:, 2)
      r = front(:, 3)
      signs = 0
      largest = front(:, 5)
      ! An odd last row of the chain is the second of a pair whose first row has the matrix 1 and the right-hand side 0.
      if (modulo(m, 2) == 1) then
         do lane = 1, strip_lanes
            call note_larger(c, k(lane, 0, m), k(lane, 0, m), largest(lane))
            call eliminate_pair(c, 0.0_wp, x(lane, m) + f(lane, m), 0.0_wp, 0.0_wp, k(lane, 0, m), &
                                k(lane, 1, m - 1), carried(lane), inverse(lane), r(lane), signs(lane), unused(1), &
                                factor(lane, m), unused(2), rhs(lane, m))
         end do
      end if
      ! Eliminate from the last pair upwards. Row i is the first of its pair here, and k(.., 1, i - 2) couples the pair
      ! to the row ahead.
      do i = m - modulo(m, 2), 2, -2
         do lane = 1, strip_lanes
            call note_larger(c, k(lane, 0, i), k(lane, 0, i - 1), largest(lane))
            call eliminate_pair(c, x(lane, i) + f(lane, i), x(lane, i - 1) + f(lane, i - 1), k(lane, 0, i), &
                                k(lane, 1, i - 1), k(lane, 0, i - 1), k(lane, 1, i - 2), carried(lane), inverse(lane), &
                                r(lane), signs(lane), factor(lane, i), factor(lane, i - 1), rhs(lane, i), &
                                rhs(lane, i - 1))
         end do
      end do
      call leave(m, c, -1, k, carried, inverse, r, signs, largest, front)
   end subroutine eliminate_up_strip

   !> Put the numbers for the next rows of a front into `front`. Only if some lane has had a negative pivot or
   !> determinant, as a sign bit shows, the rows are read again to decide on trust.
   pure subroutine leave(m, c, way, k, carried, inverse, r, signs, largest, front)
      integer, intent(in) :: m, way
      real(wp), intent(in) :: c, k(strip_lanes, 0:1, 0:m)
      real(wp), dimension(strip_lanes), intent(in) :: carried, inverse, r, largest
      integer(i8), intent(in) :: signs(strip_lanes)
      real(wp), intent(inout) :: front(strip_lanes, nfront)

      ! `front` still holds the data before these rows, which the check of trust needs.
      if (any(signs < 0)) call look_closer(strip_lanes, m, c, way, k, front(:, 1), front(:, 2), front(:, 4))
      front(:, 1) = carried
      front(:, 2) = inverse
      front(:, 3) = r
      front(:, 5) = largest
   end subroutine leave

   !> VEC Corrections of the two rows where the fronts meet, upper and lower, and which lanes are trusted.
   pure subroutine meet_strip(upper, lower, meeting, trusted)
      real(wp), dimension(strip_lanes, nfront), intent(in) :: upper, lower
      real(wp), intent(out) :: meeting(strip_lanes, 2), trusted(strip_lanes)
      real(wp) :: found
      integer :: lane

      do lane = 1, strip_lanes
         call meet(upper(lane, 1), upper(lane, 2), lower(lane, 2), upper(lane, 3), lower(lane, 3), meeting(lane, 1), &
                   meeting(lane, 2), found)
         ! A lane is trusted if both fronts are and their meeting is.
         trusted(lane) = min(found, min(upper(lane, 4), lower(lane, 4)))
         trusted(lane) = merge(trusted(lane), 0.0_wp, max(upper(lane, 5), lower(lane, 5)) <= largest_entry)
      end do
   end subroutine meet_strip

   !> VEC Solve a strip outwards from where the fronts meet, x = x - d in running lanes, with the sizes of correction
   !> and unknowns.
   pure subroutine correct_strip(n, meeting, factor, rhs, last, x, step, size)
      integer, intent(in) :: n                              !! unknowns of a system
      real(wp), intent(in) :: meeting(strip_lanes, 2)       !! corrections from meet_strip
      real(wp), intent(in) :: factor(strip_lanes, n), rhs(strip_lanes, n)  !! of the rows of both fronts
      real(wp), intent(in) :: last(strip_lanes)             !! negative in lanes that are done or failed
      real(wp), intent(inout) :: x(strip_lanes, n)          !! unknowns
      real(wp), intent(out) :: step(strip_lanes), size(strip_lanes)
      real(wp), dimension(strip_lanes) :: d, largest, extent, rests
      real(wp) :: x1, x2, unused
      integer :: lane, i

      largest = 0
      extent = 0
      rests = last
      ! Rows of the lower front, from h+1 downwards; d is the correction of row h.
      d = meeting(:, 1)
      do i = upper_rows(n) + 1, n - 1, 2
         do lane = 1, strip_lanes
            x1 = x(lane, i + 1)
            x2 = x(lane, i)
            call correct_pair(factor(lane, i + 1), factor(lane, i), rhs(lane, i + 1), rhs(lane, i), rests(lane), &
                              x1, x2, d(lane), x(lane, i + 1), x(lane, i), largest(lane), extent(lane))
         end do
      end do
      if (modulo(n, 2) == 1) then
         do lane = 1, strip_lanes
            x2 = x(lane, n)
            call correct_pair(0.0_wp, factor(lane, n), 0.0_wp, rhs(lane, n), rests(lane), 0.0_wp, x2, d(lane), unused, &
                              x(lane, n), largest(lane), extent(lane))
         end do
      end if
      ! Rows of the upper front, from h upwards; d is the correction of row h+1.
      d = meeting(:, 2)
      do i = upper_rows(n), 2, -2
         do lane = 1, strip_lanes
            x1 = x(lane, i - 1)
            x2 = x(lane, i)
            call correct_pair(factor(lane, i - 1), factor(lane, i), rhs(lane, i - 1), rhs(lane, i), rests(lane), &
                              x1, x2, d(lane), x(lane, i - 1), x(lane, i), largest(lane), extent(lane))
         end do
      end do
      do lane = 1, strip_lanes
         step(lane) = largest(lane) + 0*meeting(lane, 1)  ! a NaN spreads from pair to pair to where fronts meet
         size(lane) = extent(lane)
      end do
   end subroutine correct_strip

   !> Eliminate, solve and correct all rows of one running lane, alternating between the pairs of both fronts.
   pure subroutine solve_lane(n, c, f, k, factor, rhs, x, trusted, largest, step, size)
      integer, intent(in) :: n
      real(wp), intent(in) :: c, f(n), k(0:1, 0:n)  !! row 0 is not read
      real(wp), intent(out) :: factor(n), rhs(n)    !! work
      real(wp), intent(inout) :: x(n)
      real(wp), intent(out) :: trusted, largest, step, size
      real(wp) :: carried, inverse, r, carried2, inverse2, r2, d1, d2, found(1), unused(2)
      integer(i8) :: signs
      integer :: h, odd, i, pair

      ! h rows belong to the upper front, n - h to the lower one.
      h = upper_rows(n)
      odd = modulo(n, 2)
      carried = 0
      inverse = 0
      r = 0
      carried2 = 0
      inverse2 = 0
      r2 = 0
      signs = 0
      largest = 0
      ! The largest diagonal entry of I + c K shows whether products can overflow.
      do i = 1, n
         largest = max(1 + c*k(0, i), largest)
      end do
      ! An odd last row begins the lower front, as a pair whose first row is empty.
      if (odd == 1) call eliminate_pair(c, 0.0_wp, x(n) + f(n), 0.0_wp, 0.0_wp, k(0, n), k(1, n - 1), carried2, &
                                        inverse2, r2, signs, unused(1), factor(n), unused(2), rhs(n))
      do pair = 1, h/2
         ! A pair of the upper front, rows i and i + 1, then a pair of the lower, rows i and i - 1: the two are
         ! independent.
         i = 2*pair - 1
         call eliminate_pair(c, x(i) + f(i), x(i + 1) + f(i + 1), k(0, i), k(1, i), k(0, i + 1), k(1, i + 1), &
                             carried, inverse, r, signs, factor(i), factor(i + 1), rhs(i), rhs(i + 1))
         i = n - odd - i + 1
         if (i == h) cycle  ! the upper front may have one pair more
         call eliminate_pair(c, x(i) + f(i), x(i - 1) + f(i - 1), k(0, i), k(1, i - 1), k(0, i - 1), k(1, i - 2), &
                             carried2, inverse2, r2, signs, factor(i), factor(i - 1), rhs(i), rhs(i - 1))
      end do
      call meet(carried, inverse, inverse2, r, r2, d1, d2, trusted)
      if (signs < 0) then
         found = trusted
         call look_closer(1, h, c, 1, k, [0.0_wp], [0.0_wp], found)
         call look_closer(1, n - h, c, -1, k(0, h), [0.0_wp], [0.0_wp], found)
         trusted = found(1)
      end if
      ! Products of three such entries would overflow, and a NaN is not below the bound.
      if (.not. largest <= largest_entry) trusted = 0
      call correct_lane(n, h, d1, d2, factor, rhs, x, step, size)
   end subroutine solve_lane

   !> Outwards from the corrections of rows h and h + 1; the corrections of all rows replace rhs.
   pure subroutine correct_lane(n, h, d1, d2, factor, rhs, x, step, size)
      integer, intent(in) :: n, h
      real(wp), intent(in) :: d1, d2, factor(n)
      real(wp), intent(inout) :: rhs(n), x(n)
      real(wp), intent(out) :: step, size
      real(wp) :: up, down
      integer :: i, pair

      up = d2
      down = d1
      ! A pair of the upper front and one of the lower in turn, each beginning with the row nearer to the middle.
      do pair = 1, h/2
         i = h + 2 - 2*pair
         rhs(i) = rhs(i) - factor(i)*up
         rhs(i - 1) = rhs(i - 1) + factor(i - 1)*up
         up = rhs(i - 1)
         i = h - 1 + 2*pair
         if (i >= n) cycle
         rhs(i) = rhs(i) - factor(i)*down
         rhs(i + 1) = rhs(i + 1) + factor(i + 1)*down
         down = rhs(i + 1)
      end do
      if (modulo(n, 2) == 1) rhs(n) = rhs(n) - factor(n)*down
      step = 0
      size = 0
      ! rhs holds the corrections d of all rows.
      do i = 1, n
         x(i) = x(i) - rhs(i)
         step = max(abs(rhs(i)), step)
         size = max(abs(x(i)), size)
      end do
      step = step + 0*d1  ! keeps a NaN
   end subroutine correct_lane

   !> Withdraw trust from lanes in which a pair of rows fails the test, if some lane has a pivot that is not positive.
   !> Pivots are computed again from K, since the pass over the rows has not kept them.
   pure subroutine look_closer(nlane, m, c, way, k, carried_before, inverse_before, trusted)
      integer, intent(in) :: nlane, m, way
      real(wp), intent(in) :: c, k(nlane, 0:1, 0:m)
      real(wp), intent(in), dimension(nlane) :: carried_before, inverse_before  !! numbers of the row before
      real(wp), intent(inout) :: trusted(nlane)
      real(wp) :: carried, inverse, entry, next, pivot, scale
      integer :: lane, i, beside, odd

      odd = modulo(m, 2)
      do lane = 1, nlane
         carried = carried_before(lane)
         inverse = inverse_before(lane)
         ! The odd last row is alone in its pair: its pivot is its own entry.
         if (odd == 1) then
            inverse = 1/(1 + c*k(lane, 0, m))
            carried = c*k(lane, 1, m - 1)
         end if
         do i = merge(1, m - odd, way > 0), merge(m - 1, 2, way > 0), 2*way
            beside = min(i, i + way)
            entry = 1 + c*k(lane, 0, i)
            next = 1 + c*k(lane, 0, i + way)
            pivot = entry - carried**2*inverse
            scale = 1/(pivot*next - (c*k(lane, 1, beside))**2)
            if (.not. is_trusted(pivot, scale, entry*next)) trusted(lane) = 0
            if (max(abs(entry), abs(next), abs(c*k(lane, 1, beside))) > largest_entry) trusted(lane) = 0
            carried = c*k(lane, 1, beside + way)
            inverse = pivot*scale
         end do
      end do
   end subroutine look_closer

   !> Eliminate a pair of rows, by the equations at the head of this file: residuals r_1, r_2 and entries of K: beside1
   !> couples the two rows, beside2 the second row and the row ahead. carried, inverse and r are u, w and z of the pair
   !> before, then those of this pair. The determinant is expanded, so that it does not wait for the pivot a.
   pure subroutine eliminate_pair(c, res1, res2, k1, beside1, k2, beside2, carried, inverse, r, signs, &
                                  factor1, factor2, rhs1, rhs2)
      real(wp), intent(in) :: c, res1, res2, k1, beside1, k2, beside2
      real(wp), intent(inout) :: carried, inverse, r
      integer(i8), intent(inout) :: signs  !! negative once a pivot or a determinant was
      real(wp), intent(out) :: factor1, factor2, rhs1, rhs2
      real(wp) :: entry, next, pivot, beside, scale, y1

      ! Here a is `pivot`, e is `next`, b is `beside` and a e - b^2 is the determinant, 1/scale.
      entry = 1 + c*k1
      next = 1 + c*k2
      beside = c*beside1
      pivot = entry - carried**2*inverse
      scale = 1/((entry*next - (beside*beside)) - carried**2*next*inverse)  ! does not wait for the pivot
      signs = ior(ior(transfer(pivot, signs), transfer(scale, signs)), signs)
      ! y = (r_1 - u z, r_2), as at the head of this file.
      y1 = res1 - carried*r
      carried = c*beside2
      inverse = pivot*scale
      r = (pivot*res2 - (beside*y1))*scale
      ! S^{-1} y, and S^{-1} (0, v) with the sign of its first entry reversed.
      rhs1 = (next*y1 - (beside*res2))*scale
      rhs2 = r
      factor1 = beside*scale*carried
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

   !> Corrections of the two rows where the fronts meet, h and h+1, coupled by carried = v: d_1 = r_1 - w_1 v d_2 and
   !> d_2 = r_2 - w_2 v d_1, two equations with the determinant 1 - w_1 w_2 v^2; and whether they are trusted.
   !> inverse1 is w_1.
   pure subroutine meet(carried, inverse1, inverse2, r1, r2, d1, d2, trusted)
      real(wp), intent(in) :: carried, inverse1, inverse2, r1, r2
      real(wp), intent(out) :: d1, d2, trusted
      real(wp) :: factor1, factor2, det, scale

      factor1 = inverse1*carried
      factor2 = inverse2*carried
      det = 1 - factor1*factor2
      scale = 1/det
      d1 = (r1 - factor1*r2)*scale
      d2 = (r2 - factor2*r1)*scale
      trusted = merge(1.0_wp, 0.0_wp, det > 0)
      if (-det > pivot_floor .and. -det < 1/pivot_floor) trusted = 1
   end subroutine meet

   !> Whether the pivot and the inverse determinant of a pair are positive, or the ratio of the determinant to
   !> `plain`, its value without off-diagonal entries, is within bounds. False for a NaN.
   pure logical function is_trusted(pivot, scale, plain)
      real(wp), intent(in) :: pivot, scale, plain
      real(wp) :: ratio

      ratio = abs(plain*scale)
      is_trusted = (pivot > 0 .and. scale > 0) .or. (ratio > pivot_floor .and. ratio < 1/pivot_floor)
   end function is_trusted

   !> Corrections of a pair of rows, the second nearer to where the fronts meet; d is the correction of the row before
   !> the second, then that of the first. A NaN does not count among the largest.
   pure subroutine correct_pair(factor1, factor2, rhs1, rhs2, rests, old1, old2, d, x1, x2, largest, extent)
      real(wp), intent(in) :: factor1, factor2, rhs1, rhs2
      real(wp), intent(in) :: rests   !! negative if the lane is done or failed
      real(wp), intent(in) :: old1, old2  !! unknowns
      real(wp), intent(inout) :: d, largest, extent
      real(wp), intent(out) :: x1, x2     !! corrected
      real(wp) :: d1, d2

      d2 = rhs2 - factor2*d
      d1 = rhs1 + factor1*d
      d = d1
      ! Lanes that are done or failed are corrected by zero.
      x2 = old2 - merge(d2, 0.0_wp, rests >= 0)
      x1 = old1 - merge(d1, 0.0_wp, rests >= 0)
      largest = max(max(abs(d1), abs(d2)), largest)
      extent = max(max(abs(x1), abs(x2)), extent)
   end subroutine correct_pair

end module symsde_solve_tridiagonal
