! SPDX-License-Identifier: BSD-3-Clause
!> Mean and variance of many values over paths and times, merged on one fixed dyadic tree of paths.
!>
!> A node of level k and index j holds the paths j 2^k .. (j+1) 2^k - 1 that were given. Two siblings merge
!> into their parent by the pairwise update of Chan, Golub and LeVeque; there are no other sums, so the result has the
!> same bits for any number of threads and any size of blocks.
module symsde_ensemble_statistics_path_tree
   use symsde_base_kinds, only: wp, i8
   use symsde_ensemble_statistics_comoments, only: merge_pairs, pair_count
   implicit none
   private
   public :: moment_node, moment_tree, insert_node, final_node, merge_values, dyadic_pieces, reduce_lanes, reduce_levels

   type :: moment_node
      integer :: level = 0                  !! level k
      integer(i8) :: index = 0              !! index j
      real(wp), allocatable :: n(:)         !! paths that are ok up to each time (ntime)
      real(wp), allocatable :: mean(:, :)   !! (nvalue, ntime)
      real(wp), allocatable :: m2(:, :)     !! sums of squared deviations (nvalue, ntime)
      real(wp), allocatable :: pairs(:, :)  !! if wanted, sums of products of every pair (order*pairs, ntime)
   end type moment_node

   integer, parameter :: highest_level = 62  !! an index has no more bits
   integer, parameter :: usual_level = 11    !! level of a block's lanes: 2048 for models in Python

   !> The complete nodes whose siblings have not arrived yet: O(threads log paths) of them.
   type :: moment_tree
      type(moment_node), allocatable :: nodes(:)
      integer :: nnode = 0
   end type moment_tree

contains

   !> Insert a node; as long as its sibling is in the tree, merge both into their parent.
   subroutine insert_node(tree, node)
      type(moment_tree), intent(inout) :: tree
      type(moment_node), intent(inout) :: node  !! moved into the tree: empty afterwards
      integer :: i

      i = 1
      do while (i <= tree%nnode)
         if (tree%nodes(i)%level == node%level .and. tree%nodes(i)%index == ieor(node%index, 1_i8)) then
            call merge_siblings(node, tree%nodes(i))
            if (i < tree%nnode) call move_node(tree%nodes(tree%nnode), tree%nodes(i))  ! never a node onto itself
            tree%nnode = tree%nnode - 1
            i = 1
         else
            i = i + 1
         end if
      end do
      call make_room(tree)
      tree%nnode = tree%nnode + 1
      call move_node(node, tree%nodes(tree%nnode))
   end subroutine insert_node

   !> Compute the root: a node without a sibling becomes its parent unchanged. The tree is empty afterwards.
   subroutine final_node(tree, root)
      type(moment_tree), intent(inout) :: tree
      type(moment_node), intent(out) :: root
      type(moment_node) :: node
      integer :: lowest

      do while (tree%nnode > 1)
         lowest = minloc(tree%nodes(:tree%nnode)%level, dim=1)
         if (tree%nodes(lowest)%level > highest_level) exit  ! no sibling exists at this level
         call move_node(tree%nodes(lowest), node)
         if (lowest < tree%nnode) call move_node(tree%nodes(tree%nnode), tree%nodes(lowest))
         tree%nnode = tree%nnode - 1
         node%level = node%level + 1
         node%index = node%index/2
         call insert_node(tree, node)
      end do
      if (tree%nnode >= 1) call move_node(tree%nodes(1), root)
      tree%nnode = 0
   end subroutine final_node

   !> Replace node by the parent of node and sibling; the left of the two is always the first argument of the merge.
   subroutine merge_siblings(node, sibling)
      type(moment_node), intent(inout) :: node
      type(moment_node), intent(inout) :: sibling  !! empty afterwards
      type(moment_node) :: left
      integer :: it, nvalue

      if (node%index > sibling%index) then
         call move_node(sibling, left)
         call move_node(node, sibling)
         call move_node(left, node)
      end if
      nvalue = size(node%mean, 1)
      do it = 1, size(node%n)
         if (allocated(node%pairs)) &
            call merge_pairs(nvalue, size(node%pairs, 1)/pair_count(nvalue), node%n(it), node%mean(:, it), &
                             node%pairs(:, it), sibling%n(it), sibling%mean(:, it), sibling%pairs(:, it))
         call merge_values(nvalue, node%n(it), node%mean(:, it), node%m2(:, it), &
                           sibling%n(it), sibling%mean(:, it), sibling%m2(:, it))
         node%n(it) = node%n(it) + sibling%n(it)
      end do
      node%level = node%level + 1
      node%index = node%index/2
   end subroutine merge_siblings

   !> Chan, Golub, LeVeque: d = mean_b - mean_a, mean = mean_a + d n_b/n, m2 = m2_a + m2_b + d^2 n_a n_b/n.
   pure subroutine merge_values(nvalue, na, mean_a, m2_a, nb, mean_b, m2_b)
      integer, intent(in) :: nvalue
      real(wp), intent(in) :: na, nb
      real(wp), intent(inout) :: mean_a(nvalue), m2_a(nvalue)  !! in: moments of a; out: moments of a and b together
      real(wp), intent(in) :: mean_b(nvalue), m2_b(nvalue)
      real(wp) :: share, d
      integer :: i

      share = nb/max(na + nb, 1.0_wp)
      do i = 1, nvalue
         d = mean_b(i) - mean_a(i)
         mean_a(i) = mean_a(i) + d*share
         m2_a(i) = m2_a(i) + m2_b(i) + d**2*(na*share)
      end do
   end subroutine merge_values

   subroutine move_node(from, to)
      type(moment_node), intent(inout) :: from, to

      to%level = from%level
      to%index = from%index
      call move_alloc(from%n, to%n)
      call move_alloc(from%mean, to%mean)
      call move_alloc(from%m2, to%m2)
      call move_alloc(from%pairs, to%pairs)
   end subroutine move_node

   subroutine make_room(tree)
      type(moment_tree), intent(inout) :: tree
      type(moment_node), allocatable :: more(:)
      integer :: i

      if (.not. allocated(tree%nodes)) allocate (tree%nodes(4))  ! groups of paths have a tree each
      if (tree%nnode < size(tree%nodes)) return
      allocate (more(2*size(tree%nodes)))
      do i = 1, tree%nnode
         call move_node(tree%nodes(i), more(i))
      end do
      call move_alloc(more, tree%nodes)
   end subroutine make_room

   !> The largest dyadic pieces that the paths first .. first+n-1 consist of, from left to right.
   pure subroutine dyadic_pieces(first, n, npiece, offset, level)
      integer(i8), intent(in) :: first   !! global index of the first path
      integer, intent(in) :: n
      integer, intent(out) :: npiece
      integer, intent(out) :: offset(64) !! distance of each piece from the first path
      integer, intent(out) :: level(64)  !! each piece holds 2^level paths
      integer :: at, k

      npiece = 0
      at = 0
      do while (at < n)
         k = min(trailz(first + at), bit_size(n) - 1 - leadz(n - at))  ! aligned, and no longer than what is left
         npiece = npiece + 1
         offset(npiece) = at
         level(npiece) = k
         at = at + 2**k
      end do
   end subroutine dyadic_pieces

   !> Moments of one value over the 2^level lanes of a piece, by halving the piece repeatedly.
   pure subroutine reduce_lanes(level, x, counts, n, mean, m2)
      integer, intent(in) :: level
      real(wp), intent(in) :: x(2**level)        !! the value in each lane; any number in lanes that do not count
      logical, intent(in) :: counts(2**level)    !! whether a lane counts
      real(wp), intent(out) :: n, mean, m2

      if (level <= usual_level .and. all(counts)) then
         call reduce_full(level, x, mean, m2)
         n = 2**level
      else
         call reduce_some(level, x, counts, n, mean, m2)
      end if
   end subroutine reduce_lanes

   !> Moments of a piece in which some lanes may not count.
   pure subroutine reduce_some(level, x, counts, n, mean, m2)
      integer, intent(in) :: level
      real(wp), intent(in) :: x(2**level)
      logical, intent(in) :: counts(2**level)
      real(wp), intent(out) :: n, mean, m2
      real(wp) :: na(2**level), ma(2**level), sa(2**level), share, d
      integer :: i, half, width

      do i = 1, 2**level
         na(i) = merge(1.0_wp, 0.0_wp, counts(i))
         ma(i) = merge(x(i), 0.0_wp, counts(i))
         sa(i) = 0
      end do
      width = 2**level
      do while (width > 1)
         half = width/2
         do i = 1, half
            share = na(2*i)/max(na(2*i - 1) + na(2*i), 1.0_wp)
            d = ma(2*i) - ma(2*i - 1)
            sa(i) = sa(2*i - 1) + sa(2*i) + d**2*(na(2*i - 1)*share)
            ma(i) = ma(2*i - 1) + d*share
            na(i) = na(2*i - 1) + na(2*i)
         end do
         width = half
      end do
      n = na(1)
      mean = ma(1)
      m2 = sa(1)
   end subroutine reduce_some

   !> Moments of a piece in which every lane counts: siblings have equal size and share is 1/2, so that the bits equal
   !> those of reduce_some. The work arrays have a fixed size and are on the stack: allocating them would take longer
   !> than the sums.
   pure subroutine reduce_full(level, x, mean, m2)
      integer, intent(in) :: level               !! at most usual_level
      real(wp), intent(in) :: x(2**level)
      real(wp), intent(out) :: mean, m2
      real(wp), dimension(2**usual_level) :: ma, sa

      mean = x(1)
      m2 = 0
      if (level == 0) return
      call reduce_levels(level, level, x, ma, sa)
      mean = ma(2**level - 1)
      m2 = sa(2**level - 1)
   end subroutine reduce_full

   !> Moments of one value in all nodes of levels 1 to top of a piece in which every lane counts, one level after the
   !> other, with the bits of reduce_lanes.
   pure subroutine reduce_levels(level, top, x, mean, m2)
      integer, intent(in) :: level, top              !! level of the piece, and of its highest nodes wanted
      real(wp), intent(in) :: x(2**level)
      real(wp), intent(inout) :: mean(2**level), m2(2**level)
      real(wp) :: weight
      integer :: k, from, to

      if (top == 0) return
      call halve_lanes(2**(level - 1), x, mean, m2)
      from = 1
      weight = 1
      do k = 2, top
         to = from + 2**(level - k + 1)
         call halve(2**(level - k), weight, mean(from:), m2(from:), mean(to:), m2(to:))
         from = to
         weight = 2*weight
      end do
   end subroutine reduce_levels

   !> VEC Merge neighbouring lanes.
   pure subroutine halve_lanes(half, x, mb, sb)
      integer, intent(in) :: half
      real(wp), intent(in) :: x(2*half)
      real(wp), intent(inout) :: mb(half), sb(half)
      real(wp) :: d
      integer :: i

      do i = 1, half
         d = x(2*i) - x(2*i - 1)
         mb(i) = x(2*i - 1) + d*0.5_wp
         sb(i) = d**2*0.5_wp
      end do
   end subroutine halve_lanes

   !> VEC Merge siblings of 2*weight lanes: means from ma into mb, sums from sa into sb.
   pure subroutine halve(half, weight, ma, sa, mb, sb)
      integer, intent(in) :: half
      real(wp), intent(in) :: weight, ma(2*half), sa(2*half)
      real(wp), intent(inout) :: mb(half), sb(half)
      real(wp) :: d
      integer :: i

      do i = 1, half
         d = ma(2*i) - ma(2*i - 1)
         mb(i) = ma(2*i - 1) + d*0.5_wp
         sb(i) = sa(2*i - 1) + sa(2*i) + d**2*weight
      end do
   end subroutine halve

end module symsde_ensemble_statistics_path_tree
