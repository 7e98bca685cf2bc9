! SPDX-License-Identifier: BSD-3-Clause
!> Newton corrections from symmetric tridiagonal matrices I + c K, one a lane, without pivoting.
!>
!> Row i of K is stored as its diagonal entry k(lane, 0, i) and the one right of it k(lane, 1, i). The
!> elimination downwards overwrites k(:, 1, :) by the factors and f by the right-hand sides; upwards the
!> solution is found row by row and used at once. A lane is trusted while every pivot stays within
!> pivot_floor of the diagonal entry it came from, either way; a NaN is not trusted.
module symsde_solve_tridiagonal
   use symsde_base_kinds, only: wp
   use symsde_solve_blocks, only: pivot_floor
   implicit none
   private
   public :: eliminate_down_lanes, correct_up_lanes

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
