! SPDX-License-Identifier: BSD-3-Clause
!> The observers of a thread, which deliver to the stores of the plan.
!>
!> Means of groups look at all groups of a block at once. Other observers of groups are made when a block first holds a
!> path of the group; where a block leaves nothing in them, they look at other groups in other blocks.
module symsde_ensemble_observe_observer_list
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: error_type
   use symsde_ensemble_observe_group_means, only: group_means, new_group_means
   use symsde_ensemble_observe_observer_plan, only: observer_plan
   use symsde_ensemble_observe_observers, only: new_observer, of_group_means
   use symsde_ensemble_observe_streaming, only: streaming_observer
   use symsde_model_abstract, only: model_type
   use symsde_step_block_state, only: lane_state
   implicit none
   private
   public :: observer_list, new_observer_list

   type :: observer_slot
      class(streaming_observer), allocatable :: observer
   end type observer_slot

   type :: observer_list
      type(observer_plan), pointer :: plan => null()
      class(model_type), pointer :: model => null()
      type(observer_slot), allocatable :: slots(:)     !! as the stores of the plan
      type(group_means), allocatable :: means(:)       !! means of groups
      integer :: nactive = 0
      integer, allocatable :: active(:)                !! slots that look at paths of the block (nactive)
   contains
      procedure :: is_empty
      procedure :: begin_block
      procedure :: take
      procedure :: watch
      procedure :: end_block
      procedure :: gather
   end type observer_list

contains

   !> The observers of one thread, which deliver to the stores of the plan.
   subroutine new_observer_list(self, plan, model)
      type(observer_list), intent(out) :: self
      type(observer_plan), intent(in), target :: plan
      class(model_type), intent(in), target, optional :: model  !! used in place of the plan's model
      integer :: i, n

      self%plan => plan
      if (present(model)) self%model => model
      allocate (self%slots(size(plan%stores)), self%active(size(plan%stores)))
      allocate (self%means(count(of_group_means(plan%requests))))
      n = 0
      do i = 1, size(plan%requests)
         if (plan%requests(i)%ngroup == 0) call fill_slot(self, i, plan%before(i) + 1)
         if (.not. of_group_means(plan%requests(i))) cycle
         n = n + 1
         call new_group_means(self%means(n), plan%requests(i), plan%run%first_path, plan%trees(i))
      end do
   end subroutine new_observer_list

   !> Make the observer of a request in a slot.
   subroutine fill_slot(self, irequest, slot)
      type(observer_list), intent(inout) :: self
      integer, intent(in) :: irequest, slot
      type(error_type), allocatable :: refusal  ! stays unallocated: the plan has accepted the requests

      call new_observer(self%slots(slot)%observer, self%plan%requests(irequest), self%plan%run, refusal)
      self%slots(slot)%observer%store => self%plan%stores(slot)
      if (associated(self%model)) self%slots(slot)%observer%run%model => self%model
   end subroutine fill_slot

   pure logical function is_empty(self)
      class(observer_list), intent(in) :: self

      is_empty = .true.
      if (allocated(self%slots)) is_empty = size(self%slots) + size(self%means) == 0
   end function is_empty

   subroutine begin_block(self, first, nreal, nlane)
      class(observer_list), intent(inout) :: self
      integer(i8), intent(in) :: first
      integer, intent(in) :: nreal, nlane
      integer :: i

      if (self%is_empty()) return
      do i = 1, size(self%means)
         call self%means(i)%begin_block(first, nreal, nlane)
      end do
      self%nactive = 0
      do i = 1, size(self%plan%requests)
         if (of_group_means(self%plan%requests(i))) cycle
         if (self%plan%requests(i)%ngroup > 0) then
            call begin_groups(self, i, first, nreal, nlane)
         else
            self%nactive = self%nactive + 1
            self%active(self%nactive) = self%plan%before(i) + 1
            call self%slots(self%active(self%nactive))%observer%begin_block(first, nreal, nlane)
         end if
      end do
   end subroutine begin_block

   !> Begin a block with the observers of the groups that it holds.
   subroutine begin_groups(self, irequest, first, nreal, nlane)
      class(observer_list), intent(inout) :: self
      integer, intent(in) :: irequest, nreal, nlane
      integer(i8), intent(in) :: first
      integer(i4) :: labels(nlane)
      integer :: lane, slot, nhere, store
      integer(i8) :: at

      at = first - self%plan%run%first_path
      labels = -1
      nhere = 0
      associate (request => self%plan%requests(irequest))
         labels(:nreal) = request%labels(at + 1:at + nreal)
         do lane = 1, nreal
            if (labels(lane) < 0 .or. labels(lane) >= request%ngroup) cycle
            nhere = nhere + 1
            store = self%plan%before(irequest) + labels(lane) + 1
            slot = store
            if (self%plan%tables_only(irequest)) slot = self%plan%before(irequest) + nhere
            if (.not. allocated(self%slots(slot)%observer)) call fill_slot(self, irequest, slot)
            self%nactive = self%nactive + 1
            self%active(self%nactive) = slot
            associate (observer => self%slots(slot)%observer)
               observer%store => self%plan%stores(store)
               observer%mine = labels == labels(lane)
               where (observer%mine) labels = -1
               call observer%begin_block(first, nreal, nlane)
            end associate
         end do
      end associate
   end subroutine begin_groups

   subroutine take(self, it, t, values, counts)
      class(observer_list), intent(inout) :: self
      integer, intent(in) :: it
      real(wp), intent(in) :: t
      real(wp), intent(in), contiguous :: values(:, :)
      logical, intent(in), contiguous :: counts(:)
      integer :: i

      if (self%is_empty()) return
      do i = 1, size(self%means)
         call self%means(i)%take(it, values, counts)
      end do
      do i = 1, self%nactive
         associate (observer => self%slots(self%active(i))%observer)
            if (allocated(observer%mine)) then
               call observer%take(it, t, values, counts .and. observer%mine)
            else
               call observer%take(it, t, values, counts)
            end if
         end associate
      end do
   end subroutine take

   subroutine watch(self, istep, t, state)
      class(observer_list), intent(inout) :: self
      integer(i8), intent(in) :: istep
      real(wp), intent(in) :: t
      type(lane_state), intent(inout) :: state
      integer :: i

      if (self%is_empty()) return
      do i = 1, self%nactive
         call self%slots(self%active(i))%observer%watch(istep, t, state)
      end do
   end subroutine watch

   !> Called by one thread at a time.
   subroutine end_block(self, state)
      class(observer_list), intent(inout) :: self
      type(lane_state), intent(in) :: state
      integer :: i

      if (self%is_empty()) return
      do i = 1, size(self%means)
         call self%means(i)%end_block()
      end do
      do i = 1, self%nactive
         call self%slots(self%active(i))%observer%close_block(state)
         call self%slots(self%active(i))%observer%end_block()
      end do
   end subroutine end_block

   !> Called by one thread at a time.
   subroutine gather(self)
      class(observer_list), intent(inout) :: self
      integer :: i

      if (self%is_empty()) return
      do i = 1, size(self%slots)
         if (allocated(self%slots(i)%observer)) call self%slots(i)%observer%gather()
      end do
   end subroutine gather

end module symsde_ensemble_observe_observer_list
