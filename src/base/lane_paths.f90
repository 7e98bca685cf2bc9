! SPDX-License-Identifier: BSD-3-Clause
!> Which paths the lanes are that a model is asked for, at any moment of a run.
!>
!> A model answers for lanes. One that is different from path to path, as one whose parameters go by path, must know
!> which path a lane is. So every runner of a block has a list of its own (`begin`), which its view of the model reads
!> (`find`). Whoever asks the model for other lanes than those of the block says which these are before (`narrow`), and
!> afterwards that they are over (`widen`): a part of the lanes, or some of them gathered. A part may be narrowed again.
!> Lanes behind the last one repeat it, so that a path by itself may be asked for in several lanes without a word.
!> Nothing is done for models that are the same for all paths: they have no list.
module symsde_base_lane_paths
   use symsde_base_kinds, only: i8
   implicit none
   private
   public :: lane_paths, narrow, widen

   integer, parameter :: most_deep = 4  !! parts of parts: of stages, a strip of it, one lane of that, and one to spare

   type :: path_list
      integer(i8), allocatable :: path(:)
   end type path_list

   !> The lists of one runner: number 0 is that of the block, the last one that of the lanes which are asked for now.
   type :: lane_paths
      private
      integer :: depth = 0
      type(path_list) :: lists(0:most_deep)
   contains
      procedure :: begin
      procedure :: find
   end type lane_paths

   interface narrow  !! without effect where `paths` is null, as is `widen`
      module procedure :: narrow_to_part, narrow_to_lanes
   end interface narrow

contains

   !> The lanes of a block that begins are these paths.
   subroutine begin(self, path)
      class(lane_paths), intent(inout) :: self
      integer(i8), intent(in) :: path(:)  !! global index of every lane

      self%depth = 0
      self%lists(0)%path = path
   end subroutine begin

   !> The paths of the first nlane lanes that are asked for now; lanes behind the last one repeat it. Before a block
   !> has begun, as where steppers are made, all of them are path 0.
   subroutine find(self, nlane, path)
      class(lane_paths), intent(in) :: self
      integer, intent(in) :: nlane
      integer(i8), intent(out) :: path(nlane)
      integer :: lane

      path = 0
      associate (now => self%lists(self%depth))
         if (.not. allocated(now%path)) return
         do lane = 1, nlane
            path(lane) = now%path(min(lane, size(now%path)))
         end do
      end associate
   end subroutine find

   !> From here on n lanes are asked for, of those before the lanes from `first` on; lanes behind the last repeat it.
   subroutine narrow_to_part(paths, first, n)
      type(lane_paths), pointer, intent(in) :: paths
      integer, intent(in) :: first, n
      integer :: lane, lanes(n)

      if (.not. associated(paths)) return
      do lane = 1, n
         lanes(lane) = first + lane - 1
      end do
      call narrow_to_lanes(paths, lanes)
   end subroutine narrow_to_part

   !> From here on these lanes are asked for, of those before.
   subroutine narrow_to_lanes(paths, lanes)
      type(lane_paths), pointer, intent(in) :: paths
      integer, intent(in) :: lanes(:)
      integer :: i

      if (.not. associated(paths)) return
      associate (depth => paths%depth, lists => paths%lists)
         depth = depth + 1
         if (allocated(lists(depth)%path)) deallocate (lists(depth)%path)
         if (.not. allocated(lists(depth - 1)%path)) return  ! no block has begun
         allocate (lists(depth)%path(size(lanes)))
         do i = 1, size(lanes)
            lists(depth)%path(i) = lists(depth - 1)%path(min(lanes(i), size(lists(depth - 1)%path)))
         end do
      end associate
   end subroutine narrow_to_lanes

   !> The lanes of the last `narrow` are over: those before it are asked for again.
   subroutine widen(paths)
      type(lane_paths), pointer, intent(in) :: paths

      if (associated(paths)) paths%depth = paths%depth - 1
   end subroutine widen

end module symsde_base_lane_paths
