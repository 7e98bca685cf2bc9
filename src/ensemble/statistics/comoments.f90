! SPDX-License-Identifier: BSD-3-Clause
!> Sums over paths of products of deviations, for every pair of values, merged on the dyadic tree.
!>
!> Let u and v be the deviations of two values from their means over a node. A pair holds sum u v; at order four also
!> sum u^2 v, sum u v^2 and sum u^2 v^2, which give the error of a covariance. Two siblings merge by moving both to the
!> common mean, u -> u + a, v -> v + b, and adding (Pebay, Sandia report SAND2008-6212). Compiled without contraction,
!> like the means: loops over lanes and over pairs must give the same bits.
module symsde_ensemble_statistics_comoments
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: pair_count, pair_place, reduce_pair, merge_pairs

   integer, parameter :: mean_u = 1, mean_v = 2, uu = 3, vv = 4, uv = 5, uuv = 6, uvv = 7, uuvv = 8 !! numbers of a pair

contains

   !> Number of pairs of n values, each value paired with itself and with those after it.
   pure integer function pair_count(n)
      integer, intent(in) :: n

      pair_count = n*(n + 1)/2
   end function pair_count

   !> Place of the pair (i, j), i <= j, in the order (1,1), (1,2), (2,2), (1,3) ..
   pure integer function pair_place(i, j)
      integer, intent(in) :: i, j

      pair_place = j*(j - 1)/2 + i
   end function pair_place

   !> Sums of a pair over the 2^level lanes of a piece, by halving the piece repeatedly.
   pure subroutine reduce_pair(level, x, y, counts, sums)
      integer, intent(in) :: level
      real(wp), intent(in) :: x(2**level), y(2**level)  !! values in each lane; any number in lanes that do not count
      logical, intent(in) :: counts(2**level)           !! whether a lane counts
      real(wp), intent(out) :: sums(:)                  !! sums of uv; or of uv, uuv, uvv, uuvv
      real(wp), dimension(2**level) :: n, n_left, n_right
      real(wp), dimension(2**level, 8) :: a, left, right
      integer :: half

      n = merge(1.0_wp, 0.0_wp, counts)
      a(:, mean_u) = merge(x, 0.0_wp, counts)
      a(:, mean_v) = merge(y, 0.0_wp, counts)
      a(:, uu:) = 0
      half = 2**level/2
      do while (half > 0)
         left(:half, :) = a(1:2*half:2, :)
         right(:half, :) = a(2:2*half:2, :)
         n_left(:half) = n(1:2*half:2)
         n_right(:half) = n(2:2*half:2)
         call join(2**level, half, n_left, n_right, left, right)
         a(:half, :) = left(:half, :)
         n(:half) = n_left(:half) + n_right(:half)
         half = half/2
      end do
      sums = a(1, uv:uv + size(sums) - 1)
   end subroutine reduce_pair

   !> Merge the pairs of two siblings with na and nb paths; the result replaces the first.
   pure subroutine merge_pairs(nvalue, order, na, mean_a, pairs_a, nb, mean_b, pairs_b)
      integer, intent(in) :: nvalue, order                  !! order: numbers per pair, 1 or 4
      real(wp), intent(in) :: na, nb
      real(wp), intent(in) :: mean_a(nvalue), mean_b(nvalue)
      real(wp), intent(inout) :: pairs_a(order, nvalue*(nvalue + 1)/2)
      real(wp), intent(in) :: pairs_b(order, nvalue*(nvalue + 1)/2)
      real(wp) :: left(nvalue, 8), right(nvalue, 8), n_left(nvalue), n_right(nvalue), own_a(nvalue), own_b(nvalue)
      integer :: i, j, k

      n_left = na
      n_right = nb
      do j = 1, nvalue
         own_a(j) = pairs_a(1, pair_place(j, j))
         own_b(j) = pairs_b(1, pair_place(j, j))
      end do
      left = 0
      right = 0
      do j = 1, nvalue
         do i = 1, j
            k = pair_place(i, j)
            left(i, mean_u) = mean_a(i)
            left(i, mean_v) = mean_a(j)
            left(i, uu) = own_a(i)
            left(i, vv) = own_a(j)
            right(i, mean_u) = mean_b(i)
            right(i, mean_v) = mean_b(j)
            right(i, uu) = own_b(i)
            right(i, vv) = own_b(j)
            left(i, uv:uv + order - 1) = pairs_a(:, k)
            right(i, uv:uv + order - 1) = pairs_b(:, k)
         end do
         call join(nvalue, j, n_left, n_right, left, right)
         do i = 1, j
            pairs_a(:, pair_place(i, j)) = left(i, uv:uv + order - 1)
         end do
      end do
   end subroutine merge_pairs

   !> Merge n pairs of siblings; each result replaces the left sibling.
   pure subroutine join(room, n, n_left, n_right, left, right)
      integer, intent(in) :: room, n
      real(wp), intent(in) :: n_left(n), n_right(n)
      real(wp), intent(inout) :: left(room, 8), right(room, 8)  !! right is changed too
      real(wp) :: share, du, dv
      integer :: i

      do i = 1, n
         share = n_right(i)/max(n_left(i) + n_right(i), 1.0_wp)
         du = right(i, mean_u) - left(i, mean_u)
         dv = right(i, mean_v) - left(i, mean_v)
         left(i, mean_u) = left(i, mean_u) + du*share
         left(i, mean_v) = left(i, mean_v) + dv*share
         call move(n_left(i), -(du*share), -(dv*share), left(i, uu), left(i, vv), left(i, uv), left(i, uuv), &
                   left(i, uvv), left(i, uuvv))
         call move(n_right(i), du*(1 - share), dv*(1 - share), right(i, uu), right(i, vv), right(i, uv), &
                   right(i, uuv), right(i, uvv), right(i, uuvv))
         left(i, uu) = left(i, uu) + right(i, uu)
         left(i, vv) = left(i, vv) + right(i, vv)
         left(i, uv) = left(i, uv) + right(i, uv)
         left(i, uuv) = left(i, uuv) + right(i, uuv)
         left(i, uvv) = left(i, uvv) + right(i, uvv)
         left(i, uuvv) = left(i, uuvv) + right(i, uuvv)
      end do
   end subroutine join

   !> Turn sums over n paths of products of u and v into sums of products of u + a and v + b, given sum u = sum v = 0.
   pure subroutine move(n, a, b, s_uu, s_vv, s_uv, s_uuv, s_uvv, s_uuvv)
      real(wp), intent(in) :: n, a, b
      real(wp), intent(inout) :: s_uu, s_vv, s_uv, s_uuv, s_uvv, s_uuvv

      s_uuvv = s_uuvv + 2*(b*s_uuv + a*s_uvv) + (b**2*s_uu + a**2*s_vv + 4*a*b*s_uv) + n*(a*b)**2
      s_uuv = s_uuv + (b*s_uu + 2*a*s_uv) + n*a**2*b
      s_uvv = s_uvv + (a*s_vv + 2*b*s_uv) + n*a*b**2
      s_uv = s_uv + n*(a*b)  ! for a value paired with itself these three must be equal
      s_uu = s_uu + n*(a*a)
      s_vv = s_vv + n*(b*b)
   end subroutine move

end module symsde_ensemble_statistics_comoments
