! SPDX-License-Identifier: BSD-3-Clause
!> Merge the moments of two parts of an ensemble, on the same dyadic tree as within one run, and find their errors.
!>
!> A part holds the paths j 2^k .. (j+1) 2^k - 1, k >= 8; the last part may lack paths at its end. Two siblings (j even,
!> and j + 1) merge into their parent; merging up to the root gives the bits of the whole run, however it was divided.
module symsde_ensemble_statistics_merge
   use symsde_base_kinds, only: wp, i8
   use symsde_ensemble_statistics_path_tree, only: moment_node, moment_tree, insert_node, final_node
   implicit none
   private
   public :: merge_moments, moment_errors

contains

   !> Merge two siblings into the left one. Call the tree itself rather than copy its formula: a second copy could round
   !> differently.
   subroutine merge_moments(n_ok, mean, m2, n_ok_right, mean_right, m2_right)
      integer(i8), intent(inout) :: n_ok(:)                     !! paths that are ok up to each time (ntime)
      real(wp), intent(inout) :: mean(:, :), m2(:, :)           !! (nvalue, ntime)
      integer(i8), intent(in) :: n_ok_right(:)
      real(wp), intent(in) :: mean_right(:, :), m2_right(:, :)
      type(moment_tree) :: tree
      type(moment_node) :: node

      call make_node(0_i8, n_ok, mean, m2, node)
      call insert_node(tree, node)
      call make_node(1_i8, n_ok_right, mean_right, m2_right, node)
      call insert_node(tree, node)
      call final_node(tree, node)
      n_ok = int(node%n, i8)
      mean = node%mean
      m2 = node%m2
   end subroutine merge_moments

   !> Find variances and standard errors of means from counts and sums of squared deviations. They are NaN for fewer
   !> than two paths, and so become means of no path.
   subroutine moment_errors(n_ok, mean, m2, variance, se_mean)
      use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
      integer(i8), intent(in) :: n_ok(:)                               !! paths that count (ntime)
      real(wp), intent(inout) :: mean(:, :)                            !! (nvalue, ntime)
      real(wp), intent(in) :: m2(:, :)                                 !! sums of squared deviations (nvalue, ntime)
      real(wp), intent(out) :: variance(:, :), se_mean(:, :)           !! (nvalue, ntime)
      real(wp) :: nan
      integer :: it

      nan = ieee_value(nan, ieee_quiet_nan)
      do it = 1, size(n_ok)
         if (n_ok(it) < 1) mean(:, it) = nan
         if (n_ok(it) < 2) then
            variance(:, it) = nan
            se_mean(:, it) = nan
         else
            variance(:, it) = m2(:, it)/real(n_ok(it) - 1, wp)
            se_mean(:, it) = sqrt(variance(:, it)/real(n_ok(it), wp))
         end if
      end do
   end subroutine moment_errors

   subroutine make_node(index, n_ok, mean, m2, node)
      integer(i8), intent(in) :: index
      integer(i8), intent(in) :: n_ok(:)
      real(wp), intent(in) :: mean(:, :), m2(:, :)
      type(moment_node), intent(inout) :: node
      integer :: it

      node%level = 0
      node%index = index
      node%n = real(n_ok, wp)
      node%mean = mean
      node%m2 = m2
      do it = 1, size(n_ok)  ! moments of no path are NaN in results, but zero in the tree
         if (n_ok(it) > 0) cycle
         node%mean(:, it) = 0
         node%m2(:, it) = 0
      end do
   end subroutine make_node

end module symsde_ensemble_statistics_merge
