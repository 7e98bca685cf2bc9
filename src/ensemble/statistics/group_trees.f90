! SPDX-License-Identifier: BSD-3-Clause
!> Moments of groups of paths: a tree for each group, as of symsde_ensemble_statistics_path_tree, in one pool of tables.
!>
!> A table has a row for each time: n, means and sums of squared deviations of the paths of a node that are in the
!> group. A group's nodes whose siblings have not arrived yet are a list from right to left. Nodes of a group never
!> overlap, so a sibling is a neighbour in the list; blocks arrive nearly in order, so a new node is near its head.
module symsde_ensemble_statistics_group_trees
   use symsde_base_kinds, only: wp, i8
   use symsde_ensemble_statistics_path_tree, only: merge_values
   implicit none
   private
   public :: group_trees, new_group_trees, merge_tables, meeting_level

   type :: pool_node
      integer :: level = 0          !! the node holds the paths index 2^level .. (index + 1) 2^level - 1
      integer(i8) :: index = 0
      integer :: left = 0, right = 0  !! neighbours in the list of the group, 0 = none; left of a free place: the next
   end type pool_node

   type :: group_trees
      integer :: ncolumn = 0, nrow = 0
      integer, allocatable :: last(:)         !! rightmost node of each group, 0 = none (ngroup)
      type(pool_node), allocatable :: nodes(:)
      real(wp), allocatable :: tables(:, :, :) !! (1 + 2 ncolumn, nrow, node)
      integer :: free = 0                     !! first free place, 0 = none
   contains
      procedure :: insert
      procedure :: finish
   end type group_trees

contains

   !> Trees without nodes.
   subroutine new_group_trees(self, ngroup, ncolumn, nrow)
      type(group_trees), intent(out) :: self
      integer, intent(in) :: ngroup, ncolumn, nrow

      self%ncolumn = ncolumn
      self%nrow = nrow
      allocate (self%last(ngroup), source=0)
      allocate (self%nodes(0), self%tables(1 + 2*ncolumn, nrow, 0))
   end subroutine new_group_trees

   !> Insert a node into the tree of a group; as long as its sibling is there, merge both into their parent.
   subroutine insert(self, group, level, index, table)
      class(group_trees), intent(inout) :: self
      integer, intent(in) :: group, level
      integer(i8), intent(in) :: index
      real(wp), intent(in) :: table(1 + 2*self%ncolumn, self%nrow)
      integer :: left, right, here

      right = 0
      left = self%last(group)
      do while (left > 0)
         if (self%nodes(left)%index*2_i8**self%nodes(left)%level < index*2_i8**level) exit
         right = left
         left = self%nodes(left)%left
      end do
      call take_place(self, here)
      self%nodes(here) = pool_node(level, index)
      self%tables(:, :, here) = table
      call link(self, group, left, here)
      call link(self, group, here, right)
      do
         associate (node => self%nodes(here))
            if (mod(node%index, 2_i8) == 0) then
               left = here
               right = node%right
            else
               left = node%left
               right = here
            end if
         end associate
         if (min(left, right) == 0) return
         associate (a => self%nodes(left), b => self%nodes(right))
            if (a%level /= b%level .or. a%index /= ieor(b%index, 1_i8)) return
            a%level = a%level + 1
            a%index = a%index/2
         end associate
         call merge_tables(self%ncolumn, self%nrow, self%tables(:, :, left), self%tables(:, :, right))
         here = left
         call link(self, group, here, self%nodes(right)%right)
         call give_back(self, right)
      end do
   end subroutine insert

   !> The table of a group, of all its nodes; zero without any. The tree of the group is empty afterwards.
   subroutine finish(self, group, table)
      class(group_trees), intent(inout) :: self
      integer, intent(in) :: group
      real(wp), intent(out) :: table(1 + 2*self%ncolumn, self%nrow)
      integer :: stack(64), meets(64)  ! nodes from right to left, and the level at which each meets the one before
      integer :: here, next, top, join

      top = 0
      here = self%last(group)
      do while (here > 0)
         next = self%nodes(here)%left
         join = 0
         if (self%nodes(here)%right > 0) join = meeting_level(first_of(self, here), &
                                                              first_of(self, self%nodes(here)%right))
         do while (top > 1)
            if (meets(top) > join) exit
            call merge_top()
         end do
         top = top + 1
         stack(top) = here
         meets(top) = join
         here = next
      end do
      do while (top > 1)
         call merge_top()
      end do
      table = 0
      if (top == 0) return
      table = self%tables(:, :, stack(1))
      call give_back(self, stack(1))
      self%last(group) = 0

   contains

      !> Merge the last two of the stack; the one on the right is freed when its neighbours need it no more.
      subroutine merge_top()
         call merge_tables(self%ncolumn, self%nrow, self%tables(:, :, stack(top)), self%tables(:, :, stack(top - 1)))
         call give_back(self, stack(top - 1))
         stack(top - 1) = stack(top)
         top = top - 1
      end subroutine merge_top

   end subroutine finish

   !> Merge the tables of two nodes into that of the left one.
   pure subroutine merge_tables(ncolumn, nrow, left, right)
      integer, intent(in) :: ncolumn, nrow
      real(wp), intent(inout) :: left(1 + 2*ncolumn, nrow)
      real(wp), intent(in) :: right(1 + 2*ncolumn, nrow)
      integer :: i, n

      n = ncolumn
      do i = 1, nrow
         call merge_values(n, left(1, i), left(2:n + 1, i), left(n + 2:, i), right(1, i), right(2:n + 1, i), &
                           right(n + 2:, i))
         left(1, i) = left(1, i) + right(1, i)
      end do
   end subroutine merge_tables

   !> Level of the smallest node that holds two paths.
   elemental integer function meeting_level(a, b)
      integer(i8), intent(in) :: a, b   !! global indices

      meeting_level = int(bit_size(a) - leadz(ieor(a, b)))
   end function meeting_level

   pure integer(i8) function first_of(self, place)
      type(group_trees), intent(in) :: self
      integer, intent(in) :: place

      first_of = self%nodes(place)%index*2_i8**self%nodes(place)%level
   end function first_of

   !> Make two nodes of a group neighbours; 0 = no node.
   pure subroutine link(self, group, left, right)
      type(group_trees), intent(inout) :: self
      integer, intent(in) :: group, left, right

      if (left > 0) self%nodes(left)%right = right
      if (right > 0) then
         self%nodes(right)%left = left
      else
         self%last(group) = left
      end if
   end subroutine link

   !> A free place of the pool, which doubles when it is full.
   subroutine take_place(self, place)
      type(group_trees), intent(inout) :: self
      integer, intent(out) :: place
      type(pool_node), allocatable :: more(:)
      real(wp), allocatable :: tables(:, :, :)
      integer :: i, n

      if (self%free == 0) then
         n = size(self%nodes)
         allocate (more(max(size(self%last) + 4, 2*n)))
         allocate (tables(size(self%tables, 1), size(self%tables, 2), size(more)))
         more(:n) = self%nodes
         tables(:, :, :n) = self%tables
         do i = n + 1, size(more)
            more(i)%left = merge(i + 1, 0, i < size(more))
         end do
         self%free = n + 1
         call move_alloc(more, self%nodes)
         call move_alloc(tables, self%tables)
      end if
      place = self%free
      self%free = self%nodes(place)%left
   end subroutine take_place

   subroutine give_back(self, place)
      type(group_trees), intent(inout) :: self
      integer, intent(in) :: place

      self%nodes(place)%left = self%free
      self%free = place
   end subroutine give_back

end module symsde_ensemble_statistics_group_trees
