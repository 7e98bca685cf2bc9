! SPDX-License-Identifier: BSD-3-Clause
!> The observers of a run before threads copy them: their requests, the stores that all threads share, and their results
!> when all threads are done. Requests are kept in place of observers, since gfortran 12 cannot copy a list of
!> polymorphic ones.
!>
!> Each group of paths of a request has a store of its own. Means of groups have trees instead.
module symsde_ensemble_observe_observer_plan
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type, raise, invalid_argument
   use symsde_base_text, only: to_text
   use symsde_ensemble_observe_observers, only: new_observer, clear_observed, ngroup, of_group_means
   use symsde_ensemble_observe_streaming, only: streaming_observer, observer_request, observed_type, observer_store, &
                                                observed_run
   use symsde_ensemble_statistics_group_trees, only: group_trees, new_group_trees
   use symsde_ensemble_statistics_path_tree, only: moment_node, final_node
   implicit none
   private
   public :: observer_plan, new_observer_plan

   type :: observer_plan
      type(observer_request), allocatable :: requests(:)
      type(observed_run) :: run
      logical :: watches_steps = .false.               !! whether some observer sees every step
      type(observer_store), allocatable :: stores(:)   !! data shared by the threads, of each group of each request
      integer, allocatable :: before(:)                !! stores of the requests before (nrequest)
      type(group_trees), allocatable :: trees(:)       !! in their place for means of groups (nrequest)
      logical, allocatable :: tables_only(:)           !! whether blocks leave nothing in the observer (nrequest)
   contains
      procedure :: numbers => numbers_of_all
      procedure :: deliver
   end type observer_plan

contains

   !> Make the observers of a run, one for each request, to find out whether all requests are valid.
   subroutine new_observer_plan(self, requests, run, error)
      type(observer_plan), intent(out) :: self
      type(observer_request), intent(in) :: requests(:)
      type(observed_run), intent(in) :: run
      type(error_type), allocatable, intent(inout) :: error
      class(streaming_observer), allocatable :: observer
      integer(i8) :: given
      integer :: i, n

      self%run = run
      allocate (self%requests(size(requests)), self%before(size(requests)), self%tables_only(size(requests)))
      allocate (self%trees(size(requests)))
      n = 0
      do i = 1, size(requests)
         self%requests(i) = requests(i)
         self%before(i) = n
         call new_observer(observer, requests(i), run, error)
         if (allocated(error)) return
         if (requests(i)%ngroup > 0) then
            given = 0
            if (associated(requests(i)%labels)) given = size(requests(i)%labels, kind=i8)
            if (given /= run%npath) then
               call raise(error, invalid_argument, 'new_observer_plan', 'an observer of groups has labels of '// &
                          to_text(given)//' paths: give '//to_text(run%npath)//', those of the run')
               return
            end if
         end if
         self%watches_steps = self%watches_steps .or. observer%watches_steps()
         self%tables_only(i) = observer%ncount + observer%nsingle == 0
         if (of_group_means(requests(i))) then
            call new_group_trees(self%trees(i), requests(i)%ngroup, observer%ncolumn, observer%nrow)
         else
            n = n + ngroup(requests(i))
         end if
      end do
      allocate (self%stores(n))
   end subroutine new_observer_plan

   !> Numbers of eight bytes that all observers together hold at most.
   real(wp) function numbers_of_all(self, npath, nthread) result(numbers)
      class(observer_plan), intent(in) :: self
      integer(i8), intent(in) :: npath
      integer, intent(in) :: nthread
      class(streaming_observer), allocatable :: observer
      type(error_type), allocatable :: refusal  ! stays unallocated: the plan has accepted the requests
      integer :: i

      numbers = 0
      do i = 1, size(self%requests)
         call new_observer(observer, self%requests(i), self%run, refusal)
         if (of_group_means(self%requests(i))) then
            numbers = numbers + numbers_of_groups(self%requests(i)%ngroup, real(observer%nsum(), wp))
         else
            numbers = numbers + ngroup(self%requests(i))*observer%numbers(npath, nthread)
         end if
      end do

   contains

      !> Tables of means of groups: those of a block of each thread, and a tree of each group.
      pure real(wp) function numbers_of_groups(n, table)
         integer, intent(in) :: n
         real(wp), intent(in) :: table   !! numbers of one
         real(wp) :: waiting

         waiting = min(real(npath, wp), real(n, wp)*exponent(real(npath, wp)))
         numbers_of_groups = table*(waiting + n + nthread*min(n, self%run%nlane))
      end function numbers_of_groups

   end function numbers_of_all

   !> Deliver the results of all observers when all threads are done; the stores are empty afterwards.
   subroutine deliver(self, observed)
      class(observer_plan), intent(inout) :: self
      type(observed_type), allocatable, intent(out) :: observed(:)
      class(streaming_observer), allocatable :: observer
      type(error_type), allocatable :: refusal  ! stays unallocated: the plan has accepted the requests
      type(moment_node) :: table
      integer(i8) :: m, n
      integer :: i, k

      allocate (observed(size(self%requests)))
      do i = 1, size(observed)
         call new_observer(observer, self%requests(i), self%run, refusal)
         call clear_observed(observed(i), observer)
         m = observer%ncount
         n = observer%nsum()
         if (of_group_means(self%requests(i))) then
            do k = 1, self%requests(i)%ngroup
               call self%trees(i)%finish(k, observed(i)%sums((k - 1)*n + 1:k*n))
            end do
            cycle
         end if
         do k = 1, ngroup(self%requests(i))
            associate (store => self%stores(self%before(i) + k))
               if (.not. self%tables_only(i) .and. .not. allocated(store%counts)) cycle
               call final_node(store%tree, table)
               if (allocated(store%counts)) then
                  observed(i)%counts((k - 1)*m + 1:k*m) = store%counts
                  call observer%to_sums(store%singles, table, observed(i)%sums((k - 1)*n + 1:k*n))
               else
                  call observer%to_sums([real(wp) ::], table, observed(i)%sums((k - 1)*n + 1:k*n))
               end if
            end associate
         end do
      end do
   end subroutine deliver

end module symsde_ensemble_observe_observer_plan
