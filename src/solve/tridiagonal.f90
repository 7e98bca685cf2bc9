! SPDX-License-Identifier: BSD-3-Clause
!> Newton corrections from symmetric tridiagonal matrices I + c K, one a lane, without pivoting.
!>
!> Row i of K is stored as its diagonal entry k(lane, 0, i) and the one right of it k(lane, 1, i). The
!> elimination downwards overwrites k(:, 1, :) by the factors and f by the right-hand sides; upwards the
!> solution is found row by row and used at once. A lane is trusted while every pivot stays within
!> pivot_floor of the diagonal entry it came from, either way; a NaN is not trusted.
!>
!> Two forms of both: over all lanes row by row, and over a strip of lanes whose number the compiler knows. In
!> a strip a row's lanes stay in registers until the next row has read them, and K need not be kept: it is
!> eliminated a few rows at a time, as it comes. That takes three quarters of the time for 64 lanes, three
!> fifths for 16.
module symsde_solve_tridiagonal
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: strip_lanes
   use symsde_solve_blocks, only: pivot_floor
   implicit none
   private
   public :: eliminate_down_lanes, correct_up_lanes, eliminate_down_strip, correct_up_strip

contains

   !> Right-hand sides x + f and matrices I + c K, eliminated from the first row to the last.
   !> About 12 operations and one division a row and lane; 48 bytes in, 24 out.
   subroutine eliminate_down_lanes(nlane, n, c, x, f, k, carried, trusted)
      integer, intent(in) :: nlane                 !! lanes
      integer, intent(in) :: n                     !! unknowns of a system
      real(wp), intent(in) :: c                    !! factor of K
      real(wp), intent(in) :: x(nlane, n)          !! unknowns
      real(wp), intent(inout) :: f(nlane, n)       !! in: residual less x; out: D^{-1} L^{-1} residual
      real(wp), intent(inout) :: k(nlane, 0:1, n)  !! in: K; out: upper band of D^{-1} U in k(:, 1, :)
      real(wp), intent(out) :: carried(nlane)      !! work: entry left of the diagonal
      real(wp), intent(out) :: trusted(nlane)      !! 1, or 0 where a pivot is not trusted
      integer :: i

      call first_row(nlane, c, x, k(1, 0, 1), k(1, 1, 1), f, carried, trusted)
      do i = 2, n
         call next_row(nlane, c, x(1, i), f(1, i - 1), k(1, 1, i - 1), k(1, 0, i), k(1, 1, i), f(1, i), &
                       carried, trusted)
      end do
   end subroutine eliminate_down_lanes

   !> Solve upwards, x = x - d in running lanes, and y = base + c x for the next residual; with the sizes
   !> of correction and unknowns. About 9 operations a row and lane; 56 bytes in, 32 out.
   subroutine correct_up_lanes(nlane, n, c, k, last, base, d, x, y, step, size)
      integer, intent(in) :: nlane              !! lanes
      integer, intent(in) :: n                  !! unknowns of a system
      real(wp), intent(in) :: c
      real(wp), intent(in) :: k(nlane, 0:1, n)  !! factors of eliminate_down_lanes
      real(wp), intent(in) :: last(nlane)       !! negative in lanes that rest
      real(wp), intent(in) :: base(nlane, n)
      real(wp), intent(inout) :: d(nlane, n)    !! in: f of eliminate_down_lanes; out: corrections
      real(wp), intent(inout) :: x(nlane, n)    !! unknowns
      real(wp), intent(out) :: y(nlane, n)
      real(wp), intent(out) :: step(nlane), size(nlane)
      integer :: i

      call last_row(nlane, c, last, base(1, n), d(1, n), x(1, n), y(1, n), step, size)
      do i = n - 1, 1, -1
         call row_above(nlane, c, k(1, 1, i), d(1, i + 1), last, base(1, i), d(1, i), x(1, i), y(1, i), &
                        step, size)
      end do
   end subroutine correct_up_lanes

   !> VEC Rows of right-hand sides x + f and matrices I + c K of a strip, eliminated downwards after the m rows
   !> before them, of which `above` tells: c times their last entry right of the diagonal, its pivot's inverse,
   !> its right-hand side, and trusted. Before the first row: 0, 0, 0, 1. The pivots wait for each other,
   !> d_i = a_i - b_i^2/d_{i-1}: one product and one division a row, everything else is done meanwhile.
   pure subroutine eliminate_down_strip(m, c, x, f, k, above, factor, rhs)
      integer, intent(in) :: m                              !! rows
      real(wp), intent(in) :: c                             !! factor of K
      real(wp), intent(in) :: x(strip_lanes, m)             !! unknowns
      real(wp), intent(in) :: f(strip_lanes, m)             !! residual less x
      real(wp), intent(in) :: k(strip_lanes, 0:1, m)        !! K
      real(wp), intent(inout) :: above(strip_lanes, 4)
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

   ! ---- kernels: one row; distinct arguments cannot overlap ----------------------------------------

   !> VEC
   pure subroutine first_row(nlane, c, x, diagonal, upper, f, carried, trusted)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: c, x(nlane), diagonal(nlane)
      real(wp), intent(inout) :: upper(nlane), f(nlane)
      real(wp), intent(out) :: carried(nlane), trusted(nlane)
      real(wp) :: inverse
      integer :: lane

      do lane = 1, nlane
         inverse = 1/(1 + c*diagonal(lane))
         trusted(lane) = merge(1.0_wp, 0.0_wp, abs(inverse) > 0 .and. abs(inverse) <= huge(inverse))
         carried(lane) = c*upper(lane)
         upper(lane) = carried(lane)*inverse
         f(lane) = (x(lane) + f(lane))*inverse
      end do
   end subroutine first_row

   !> VEC
   pure subroutine next_row(nlane, c, x, f_above, upper_above, diagonal, upper, f, carried, trusted)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: c, x(nlane), f_above(nlane), upper_above(nlane), diagonal(nlane)
      real(wp), intent(inout) :: upper(nlane), f(nlane), carried(nlane), trusted(nlane)
      real(wp) :: inverse, ratio, entry
      integer :: lane

      do lane = 1, nlane
         entry = 1 + c*diagonal(lane)
         inverse = 1/(entry - carried(lane)*upper_above(lane))
         ratio = abs(entry*inverse)
         trusted(lane) = merge(trusted(lane), 0.0_wp, ratio > pivot_floor .and. ratio < 1/pivot_floor)
         f(lane) = (x(lane) + f(lane) - carried(lane)*f_above(lane))*inverse
         carried(lane) = c*upper(lane)
         upper(lane) = carried(lane)*inverse
      end do
   end subroutine next_row

   !> VEC
   pure subroutine last_row(nlane, c, last, base, d, x, y, step, size)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: c, last(nlane), base(nlane), d(nlane)
      real(wp), intent(inout) :: x(nlane)
      real(wp), intent(out) :: y(nlane), step(nlane), size(nlane)
      integer :: lane

      do lane = 1, nlane
         x(lane) = merge(x(lane) - d(lane), x(lane), last(lane) >= 0)
         y(lane) = base(lane) + c*x(lane)
         step(lane) = abs(d(lane))
         size(lane) = abs(x(lane))
      end do
   end subroutine last_row

   !> VEC
   pure subroutine row_above(nlane, c, upper, d_below, last, base, d, x, y, step, size)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: c, upper(nlane), d_below(nlane), last(nlane), base(nlane)
      real(wp), intent(inout) :: d(nlane), x(nlane), step(nlane), size(nlane)
      real(wp), intent(out) :: y(nlane)
      real(wp) :: s, new
      integer :: lane

      do lane = 1, nlane
         s = d(lane) - upper(lane)*d_below(lane)
         new = merge(x(lane) - s, x(lane), last(lane) >= 0)
         d(lane) = s
         x(lane) = new
         y(lane) = base(lane) + c*new
         ! 0*s keeps a NaN, which the comparison would drop
         step(lane) = merge(abs(s), step(lane), abs(s) > step(lane)) + 0*s
         size(lane) = merge(abs(new), size(lane), abs(new) > size(lane))
      end do
   end subroutine row_above

end module symsde_solve_tridiagonal
