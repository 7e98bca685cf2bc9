! SPDX-License-Identifier: BSD-3-Clause
!> Means of values in groups of paths: all groups that a block holds, in one pass over its lanes.
!>
!> The lanes of a group are cut into nodes of the dyadic tree, once for a block. At a saved time the values of nodes are
!> those of the halvings of the whole block, which all groups share, if every lane counts; otherwise each node halves
!> its own lanes. The nodes of a group in a piece of the block merge into its part, which goes to the tree of the group
!> when the block ends: the bits are those of the group alone.
module symsde_ensemble_observe_group_means
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_ensemble_observe_streaming, only: observer_request
   use symsde_ensemble_options, only: max_nlane
   use symsde_ensemble_statistics_group_trees, only: group_trees, merge_tables, meeting_level
   use symsde_ensemble_statistics_path_tree, only: dyadic_pieces, reduce_lanes, reduce_levels
   implicit none
   private
   public :: group_means, new_group_means

   integer, parameter :: deepest = 2 + bit_size(max_nlane) - leadz(max_nlane)  !! nodes of a part that wait for others

   !> A node of the tree all of whose lanes are in one group.
   type :: lane_node
      integer :: lane = 0          !! first lane
      integer :: level = 0         !! it holds 2^level lanes
      integer :: meets = 0         !! level at which it meets the node before of the same part
      integer :: place = 0         !! place among the halvings of the block, 0 = a lane
      integer :: next = 0          !! next node of the part, 0 = none
   end type lane_node

   !> The lanes of a group in a piece of the block.
   type :: group_part
      integer :: group = 0         !! counted from 1
      integer :: piece = 0
      integer :: first = 0, last = 0  !! nodes
   end type group_part

   type :: group_means
      type(observer_request) :: request
      integer :: ncolumn = 0, nrow = 0
      integer(i8) :: first_path = 0                  !! of the run
      type(group_trees), pointer :: trees => null()  !! shared by the threads
      integer :: npiece = 0, offset(64) = 0, level(64) = 0
      integer(i8) :: first = 0                       !! first path of the block
      integer :: npart = 0, nnode = 0
      integer :: top = 0                             !! highest level of a node
      logical :: taken = .false.                     !! whether the block has shown values
      integer, allocatable :: part_of(:)             !! last part of each group in this block, 0 = none (ngroup)
      type(group_part), allocatable :: parts(:)      !! (npart)
      type(lane_node), allocatable :: nodes(:)       !! (nnode)
      real(wp), allocatable :: tables(:, :, :)       !! (1 + 2 ncolumn, nrow, npart)
      real(wp), allocatable :: mean(:, :), m2(:, :)  !! halvings of the block (nlane, ncolumn)
      real(wp), allocatable :: stack(:, :)           !! n, means and sums of squares that wait (1 + 2 ncolumn, deepest)
   contains
      procedure :: begin_block
      procedure :: take
      procedure :: end_block
   end type group_means

contains

   !> Means of the groups of a request; their tables go to the trees.
   subroutine new_group_means(self, request, first_path, trees)
      type(group_means), intent(out) :: self
      type(observer_request), intent(in) :: request
      integer(i8), intent(in) :: first_path   !! of the run
      type(group_trees), intent(in), target :: trees

      self%request = request
      self%first_path = first_path
      self%trees => trees
      self%ncolumn = trees%ncolumn
      self%nrow = trees%nrow
      allocate (self%part_of(request%ngroup), source=0)
      allocate (self%parts(0), self%nodes(0), self%tables(1 + 2*self%ncolumn, self%nrow, 0))
      allocate (self%stack(1 + 2*self%ncolumn, deepest))
   end subroutine new_group_means

   !> Find the nodes and parts of a block of nreal paths from global path `first` on.
   subroutine begin_block(self, first, nreal, nlane)
      class(group_means), intent(inout) :: self
      integer(i8), intent(in) :: first
      integer, intent(in) :: nreal, nlane
      integer(i8) :: at
      integer :: a, b, i

      if (size(self%nodes) < nlane) then
         deallocate (self%nodes, self%parts)
         allocate (self%nodes(nlane), self%parts(nlane))
         if (allocated(self%mean)) deallocate (self%mean, self%m2)
      end if
      call dyadic_pieces(first, nreal, self%npiece, self%offset, self%level)
      self%first = first
      self%npart = 0
      self%nnode = 0
      self%top = 0
      self%taken = .false.
      at = first - self%first_path
      associate (labels => self%request%labels)
         b = 0
         do while (b < nreal)
            a = b + 1
            b = a
            do while (b < nreal)
               if (labels(at + b + 1) /= labels(at + a)) exit
               b = b + 1
            end do
            if (labels(at + a) >= 0 .and. labels(at + a) < self%request%ngroup) call add_run(self, labels(at + a), a, b)
         end do
      end associate
      do i = 1, self%npart
         self%part_of(self%parts(i)%group) = 0
      end do
   end subroutine begin_block

   !> Cut neighbouring lanes of a group into nodes.
   subroutine add_run(self, label, a, b)
      type(group_means), intent(inout) :: self
      integer(i4), intent(in) :: label
      integer, intent(in) :: a, b    !! first and last lane
      integer :: offset(64), level(64)
      integer :: i, n, group, part, piece

      group = label + 1
      piece = 1
      call dyadic_pieces(self%first + a - 1, b - a + 1, n, offset, level)
      do i = 1, n
         do while (a - 1 + offset(i) >= self%offset(piece) + 2**self%level(piece))
            piece = piece + 1
         end do
         part = self%part_of(group)
         if (part > 0) then
            if (self%parts(part)%piece /= piece) part = 0
         end if
         self%nnode = self%nnode + 1
         associate (node => self%nodes(self%nnode))
            node%lane = a + offset(i)
            node%level = level(i)
            node%meets = 0
            node%next = 0
            ! In front of level k stand the 2^l - 2^(l + 1 - k) nodes of levels 1 to k - 1, in a piece of level l.
            node%place = 0
            if (level(i) > 0) node%place = 2**self%level(1) - 2**(self%level(1) + 1 - level(i)) + &
                                           (node%lane - 1)/2**level(i) + 1
            self%top = max(self%top, level(i))
            if (part == 0) then
               self%npart = self%npart + 1
               part = self%npart
               self%part_of(group) = part
               self%parts(part) = group_part(group, piece, self%nnode, self%nnode)
            else
               associate (before => self%nodes(self%parts(part)%last))
                  before%next = self%nnode
                  node%meets = meeting_level(self%first + before%lane - 1, self%first + node%lane - 1)
               end associate
               self%parts(part)%last = self%nnode
            end if
         end associate
      end do
   end subroutine add_run

   !> Take the values of the lanes at saved time number it.
   subroutine take(self, it, values, counts)
      class(group_means), intent(inout) :: self
      integer, intent(in) :: it
      real(wp), intent(in), contiguous :: values(:, :)  !! (nlane, nvalue)
      logical, intent(in), contiguous :: counts(:)      !! (nlane)
      logical :: shared
      integer :: i, j, n

      if (self%npart == 0) return
      if (.not. self%taken) call clear_tables(self)
      shared = self%npiece == 1
      n = 2**self%level(1)
      if (shared) shared = all(counts(:n))
      if (shared) then
         if (.not. allocated(self%mean)) allocate (self%mean(size(self%nodes), self%ncolumn), &
                                                   self%m2(size(self%nodes), self%ncolumn))
         do j = 1, self%ncolumn
            call reduce_levels(self%level(1), self%top, values(:n, self%request%values(j)), self%mean(:, j), &
                               self%m2(:, j))
         end do
      end if
      do i = 1, self%npart
         call merge_nodes(self, self%parts(i)%first, shared, size(counts), size(values, 2), values, counts, &
                          self%tables(:, it, i))
      end do
   end subroutine take

   !> Merge the nodes of a part: neighbours whose common node is the smallest first.
   subroutine merge_nodes(self, first, shared, nlane, nvalue, values, counts, row)
      type(group_means), intent(inout) :: self
      integer, intent(in) :: first           !! first node of the part
      logical, intent(in) :: shared          !! whether the halvings of the block have the values
      integer, intent(in) :: nlane, nvalue
      real(wp), intent(in) :: values(nlane, nvalue)
      logical, intent(in) :: counts(nlane)
      real(wp), intent(out) :: row(1 + 2*self%ncolumn)
      integer :: meets(deepest)
      integer :: i, j, m, top

      top = 0
      m = self%ncolumn
      i = first
      do while (i > 0)
         associate (node => self%nodes(i), stack => self%stack)
            do while (top > 1)
               if (meets(top) > node%meets) exit
               call merge_tables(m, 1, stack(:, top - 1), stack(:, top))
               top = top - 1
            end do
            top = top + 1
            meets(top) = node%meets
            stack(1, top) = 2**node%level
            do j = 1, m
               if (shared .and. node%place > 0) then
                  stack(1 + j, top) = self%mean(node%place, j)
                  stack(1 + m + j, top) = self%m2(node%place, j)
               else
                  call reduce_lanes(node%level, values(node%lane, self%request%values(j)), counts(node%lane), &
                                    stack(1, top), stack(1 + j, top), stack(1 + m + j, top))
               end if
            end do
            i = node%next
         end associate
      end do
      do while (top > 1)
         call merge_tables(m, 1, self%stack(:, top - 1), self%stack(:, top))
         top = top - 1
      end do
      row = self%stack(:, 1)
   end subroutine merge_nodes

   !> Room for the parts of a block that has begun; a block left out by a stop needs none.
   subroutine clear_tables(self)
      type(group_means), intent(inout) :: self

      if (size(self%tables, 3) < self%npart) then
         deallocate (self%tables)
         allocate (self%tables(1 + 2*self%ncolumn, self%nrow, self%npart))
      end if
      self%tables(:, :, :self%npart) = 0
      self%taken = .true.
   end subroutine clear_tables

   !> Deliver the parts of a block. Called by one thread at a time.
   subroutine end_block(self)
      class(group_means), intent(inout) :: self
      integer :: i

      if (.not. self%taken) return
      do i = 1, self%npart
         associate (part => self%parts(i), level => self%level(self%parts(i)%piece))
            call self%trees%insert(part%group, level, (self%first + self%offset(part%piece))/2_i8**level, &
                                   self%tables(:, :, i))
         end associate
      end do
   end subroutine end_block

end module symsde_ensemble_observe_group_means
