! SPDX-License-Identifier: BSD-3-Clause
!> Moments of two parts of an ensemble together, on the same dyadic tree as within one run.
!>
!> A part is the paths j 2^k .. (j+1) 2^k - 1, k >= 8, of which the last one may lack some at its end. Two siblings
!> (j even, and j + 1) become their parent; merged so up to the root, the parts of any division give the bits of
!> the whole run.
module symsde_ensemble_statistics_merge
   use symsde_base_kinds, only: wp, i8
   use symsde_ensemble_statistics_path_tree, only: moment_node, moment_tree, insert_node, final_node
   implicit none
   private
   public :: merge_moments

contains

   !> The left part becomes both. By the tree itself, not by its formula: a second copy of that could round otherwise.
   subroutine merge_moments(n_ok, mean, m2, n_ok_right, mean_right, m2_right)
      integer(i8), intent(inout) :: n_ok(:)                     !! paths that count (ntime)
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
      do it = 1, size(n_ok)  ! moments of no path are shown as NaN, but are zeros in the tree
         if (n_ok(it) > 0) cycle
         node%mean(:, it) = 0
         node%m2(:, it) = 0
      end do
   end subroutine make_node

end module symsde_ensemble_statistics_merge
