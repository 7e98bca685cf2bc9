! SPDX-License-Identifier: BSD-3-Clause
!> Newton corrections from symmetric tridiagonal matrices I + c K, one a lane, without pivoting.
!>
!> Row i of K is its diagonal entry k(lane, 0, i) and the one right of it, k(lane, 1, i). Downwards the rows
!> become factors and right-hand sides; upwards the solution is found row by row and used at once. A lane is
!> trusted while every pivot stays within pivot_floor of the diagonal entry it came from, either way; a NaN
!> is not trusted.
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
   public :: eliminate_down_strip, correct_up_strip, largest_diagonal, before_first_row, nabove

   !> What a row hands to the next one: c times its entry right of the diagonal, the inverse of its pivot, its
   !> right-hand side, and whether its lane is trusted (1 or 0).
   integer, parameter :: nabove = 4
   real(wp), parameter :: before_first_row(strip_lanes, nabove) = &
                          spread([0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], 1, strip_lanes)

contains

   !> VEC Rows of right-hand sides x + f and matrices I + c K of a strip, eliminated downwards after the rows
   !> before them. The pivots wait for each other, d_i = a_i - b_i^2/d_{i-1}: one product and one division a
   !> row, everything else is done meanwhile.
   pure subroutine eliminate_down_strip(m, c, x, f, k, above, factor, rhs)
      integer, intent(in) :: m                              !! rows
      real(wp), intent(in) :: c                             !! factor of K
      real(wp), intent(in) :: x(strip_lanes, m)             !! unknowns
      real(wp), intent(in) :: f(strip_lanes, m)             !! residual less x
      real(wp), intent(in) :: k(strip_lanes, 0:1, m)              !! K
      real(wp), intent(inout) :: above(strip_lanes, nabove)
      real(wp), intent(out) :: factor(strip_lanes, m)       !! upper band of D^{-1} U
      real(wp), intent(out) :: rhs(strip_lanes, m)          !! D^{-1} L^{-1} residual
      real(wp), dimension(strip_lanes) :: carried, inverse, r, trusted
      real(wp) :: entry, ratio
      integer :: lane, i

      carried = above(:, 1)
      inverse = above(:, 2)
      r = above(:, 3)
      trusted = above(:, 4)
      do i = 1, m
         do lane = 1, strip_lanes
            entry = 1 + c*k(lane, 0, i)
            inverse(lane) = 1/(entry - carried(lane)**2*inverse(lane))
            ratio = abs(entry*inverse(lane))
            trusted(lane) = merge(trusted(lane), 0.0_wp, ratio > pivot_floor .and. ratio < 1/pivot_floor)
            r(lane) = (x(lane, i) + f(lane, i) - carried(lane)*r(lane))*inverse(lane)
            carried(lane) = c*k(lane, 1, i)
            factor(lane, i) = carried(lane)*inverse(lane)
            rhs(lane, i) = r(lane)
         end do
      end do
      above(:, 1) = carried
      above(:, 2) = inverse
      above(:, 3) = r
      above(:, 4) = trusted
   end subroutine eliminate_down_strip

   !> VEC Solve upwards in a strip, x = x - d in running lanes, with the sizes of correction and unknowns.
   pure subroutine correct_up_strip(n, factor, rhs, last, x, step, size)
      integer, intent(in) :: n                              !! unknowns of a system
      real(wp), intent(in) :: factor(strip_lanes, n), rhs(strip_lanes, n)  !! of eliminate_down_strip
      real(wp), intent(in) :: last(strip_lanes)             !! negative in lanes that rest
      real(wp), intent(inout) :: x(strip_lanes, n)          !! unknowns
      real(wp), intent(out) :: step(strip_lanes), size(strip_lanes)
      real(wp), dimension(strip_lanes) :: d, largest, extent, rests
      real(wp) :: new
      integer :: lane, i

      d = 0
      largest = 0
      extent = 0
      rests = last
      do i = n, 1, -1
         do lane = 1, strip_lanes
            d(lane) = rhs(lane, i) - factor(lane, i)*d(lane)
            new = merge(x(lane, i) - d(lane), x(lane, i), rests(lane) >= 0)
            x(lane, i) = new
            ! a NaN goes on from row to row in d, and this comparison takes it
            largest(lane) = merge(largest(lane), abs(d(lane)), abs(d(lane)) <= largest(lane))
            extent(lane) = merge(extent(lane), abs(new), abs(new) <= extent(lane))
         end do
      end do
      step = largest
      size = extent
   end subroutine correct_up_strip

   !> The largest diagonal entry of c K in some rows of a strip, or what it was where that is larger.
   pure subroutine largest_diagonal(m, c, k, largest)
      integer, intent(in) :: m
      real(wp), intent(in) :: c
      real(wp), intent(in) :: k(strip_lanes, 0:1, m)
      real(wp), intent(inout) :: largest(strip_lanes)
      integer :: lane, i

      do i = 1, m
         !GCC$ unroll 16
         do lane = 1, strip_lanes
            largest(lane) = merge(c*k(lane, 0, i), largest(lane), c*k(lane, 0, i) > largest(lane))
         end do
      end do
   end subroutine largest_diagonal

end module symsde_solve_tridiagonal
