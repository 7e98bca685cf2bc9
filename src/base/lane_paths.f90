! SPDX-License-Identifier: BSD-3-Clause
!> Which paths the lanes of a model's call are, at any moment of a run.
!>
!> A model is called with lanes. A model that differs from path to path, for instance in its parameters, must know the
!> path of each lane. So every runner of a block has a list of paths (`begin`), which its view of the model reads
!> (`find`). A caller that passes other lanes than those of the block, a part of them or some gathered ones, names them
!> before the calls (`narrow`), and ends this afterwards (`widen`). A part may be narrowed again. Lanes beyond the last
!> one repeat it, so that a single path may fill several lanes without `narrow`. Models that are the same for all paths
!> have no list.
module symsde_base_lane_paths
   use symsde_base_kinds, only: wp, i8
   implicit none
   private
   public :: lane_paths, most_deep, narrow, widen

   integer, parameter :: most_deep = 4  !! nested parts: stages, a strip of them, one lane of it, and one to spare

   type :: path_list
      integer(i8), allocatable :: path(:)
      integer(i8) :: number = 0           !! number of this list, used for no earlier list; 0 = no list yet
   end type path_list

   !> The lists of one runner: list 0 has the lanes of the block, the last list the lanes of the next call.
   type :: lane_paths
      private
      integer :: depth = 0
      integer(i8) :: first = 0            !! first path of the run
      integer(i8) :: each = 1             !! neighbouring paths with the same place
      logical, public :: moves_zeros = .false.  !! whether parameters that are zero are small instead: for probes of
                                                !! what formulas hold, whatever the values are
      integer(i8) :: last_number = 0
      type(path_list) :: lists(0:most_deep)
   contains
      procedure :: begin
      procedure :: find
      procedure :: find_places
      procedure :: which
   end type lane_paths

   interface narrow  !! no effect if `paths` is null, as for `widen`
      module procedure :: narrow_to_part, narrow_to_lanes
   end interface narrow

contains

   !> Begin a block whose lanes are these paths.
   subroutine begin(self, path, first, each)
      class(lane_paths), intent(inout) :: self
      integer(i8), intent(in) :: path(:)  !! global index of every lane
      integer(i8), intent(in) :: first    !! global index of the run's first path
      integer(i8), intent(in) :: each     !! neighbouring paths with the same place

      self%depth = 0
      self%first = first
      self%each = each
      self%lists(0)%path = path
      call give_number(self)
   end subroutine begin

   !> Give a new number to the current list.
   subroutine give_number(self)
      type(lane_paths), intent(inout) :: self

      self%last_number = self%last_number + 1
      self%lists(self%depth)%number = self%last_number
   end subroutine give_number

   !> Index and number of the current list. Results made for a list of the same number need not be made again. The
   !> number is 0 before a block has begun.
   subroutine which(self, depth, number)
      class(lane_paths), intent(in) :: self
      integer, intent(out) :: depth
      integer(i8), intent(out) :: number

      depth = self%depth
      number = self%lists(depth)%number
   end subroutine which

   !> The places in the run, from 0 on, of the first nlane lanes of the current list (see find), counted in paths that
   !> share one. Quotients of indices below 2^47 are not rounded up to the next integer, and need no integer division.
   subroutine find_places(self, nlane, place)
      class(lane_paths), intent(in) :: self
      integer, intent(in) :: nlane
      integer(i8), intent(out) :: place(nlane)

      place = 0
      if (self%lists(self%depth)%number == 0) return
      call self%find(nlane, place)
      place = place - self%first
      if (self%each > 1) place = int(real(place, wp)/real(self%each, wp), i8)
   end subroutine find_places

   !> The paths of the first nlane lanes of a call; lanes beyond the last one repeat it. Before a block has begun, as
   !> when steppers are made, all lanes are path 0.
   subroutine find(self, nlane, path)
      class(lane_paths), intent(in) :: self
      integer, intent(in) :: nlane
      integer(i8), intent(out) :: path(nlane)
      integer :: n

      path = 0
      associate (now => self%lists(self%depth))
         if (.not. allocated(now%path)) return
         n = min(nlane, size(now%path))
         path(:n) = now%path(:n)
         path(n + 1:) = now%path(size(now%path))
      end associate
   end subroutine find

   !> Later calls of the model have only n of the current lanes, from `first` on; lanes beyond the last one repeat it.
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

   !> Later calls of the model have only these lanes of the current list.
   subroutine narrow_to_lanes(paths, lanes)
      type(lane_paths), pointer, intent(in) :: paths
      integer, intent(in) :: lanes(:)
      integer :: i

      if (.not. associated(paths)) return
      associate (depth => paths%depth, lists => paths%lists)
         depth = depth + 1
         if (allocated(lists(depth)%path)) deallocate (lists(depth)%path)
         lists(depth)%number = 0
         if (.not. allocated(lists(depth - 1)%path)) return  ! no block has been made yet
         call give_number(paths)
         allocate (lists(depth)%path(size(lanes)))
         do i = 1, size(lanes)
            lists(depth)%path(i) = lists(depth - 1)%path(min(lanes(i), size(lists(depth - 1)%path)))
         end do
      end associate
   end subroutine narrow_to_lanes

   !> End the last `narrow`: calls have the lanes from before it again.
   subroutine widen(paths)
      type(lane_paths), pointer, intent(in) :: paths

      if (associated(paths)) paths%depth = paths%depth - 1
   end subroutine widen

end module symsde_base_lane_paths
