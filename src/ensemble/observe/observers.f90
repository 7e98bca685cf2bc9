! SPDX-License-Identifier: BSD-3-Clause
!> The streaming observers of a run: their kinds, how an observer is made from a request, and the list of all observers.
module symsde_ensemble_observe_observers
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: error_type, raise, invalid_argument, too_large
   use symsde_base_text, only: to_text
   use symsde_ensemble_observe_autocorrelation, only: autocorrelation_observer, new_autocorrelation_observer
   use symsde_ensemble_observe_covariance, only: covariance_observer, new_covariance_observer
   use symsde_ensemble_observe_extremes, only: extremes_observer, new_extremes_observer
   use symsde_ensemble_observe_group_means, only: group_means, new_group_means
   use symsde_ensemble_observe_histogram, only: histogram_observer, new_histogram_observer
   use symsde_ensemble_observe_mean_values, only: mean_values_observer, new_mean_values_observer
   use symsde_ensemble_observe_passage, only: passage_observer, new_passage_observer
   use symsde_ensemble_observe_paths, only: paths_observer, new_paths_observer
   use symsde_ensemble_options, only: run_options, saved_count
   use symsde_ensemble_statistics_group_trees, only: group_trees, new_group_trees
   use symsde_ensemble_statistics_path_tree, only: moment_node, final_node
   use symsde_ensemble_observe_streaming, only: streaming_observer, observer_request, observed_type, observer_store, &
                                                observed_run
   use symsde_model_abstract, only: model_type
   use symsde_step_block_state, only: lane_state
   implicit none
   private
   public :: observe_histogram, observe_quantiles, observe_covariance, observe_autocorrelation, observe_extremes, &
             observe_passage, observe_paths, observe_means
   public :: observer_plan, new_observer_plan, observer_list, new_observer_list, new_observer, &
             new_observed_run, new_observed, ngroup, of_group_means

   integer, parameter :: observe_histogram = 1       !! histogram of one value, bins of one width
   integer, parameter :: observe_quantiles = 2       !! quantiles of one value, bins of one relative width
   integer, parameter :: observe_covariance = 3      !! covariances of some values
   integer, parameter :: observe_autocorrelation = 4 !! autocorrelation of one value along time
   integer, parameter :: observe_extremes = 5        !! extremes of one value until each saved time
   integer, parameter :: observe_passage = 6         !! passages out of an interval
   integer, parameter :: observe_paths = 7           !! some values of chosen paths
   integer, parameter :: observe_means = 8           !! means of some values
   integer, parameter :: one_value(5) = [observe_histogram, observe_quantiles, observe_autocorrelation, &
                                         observe_extremes, observe_passage]

   !> The observers of a run before threads copy them: gfortran 12 cannot copy a list of polymorphic observers.
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

   type :: observer_slot
      class(streaming_observer), allocatable :: observer
   end type observer_slot

   !> The observers of a thread. Means of groups look at all groups of a block at once. Other observers of groups are
   !> made when a block first holds a path of the group; where a block leaves nothing in them, they look at other groups
   !> in other blocks.
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

   !> Data of a run that observers need. nvalue counts q, p, the energy if the model has one, and observables.
   subroutine new_observed_run(run, model, options, nlane, nobservable)
      type(observed_run), intent(out) :: run
      class(model_type), intent(in), target :: model
      type(run_options), intent(in) :: options
      integer, intent(in) :: nlane, nobservable
      integer :: k

      run%ndof = model%traits%ndof
      run%nvalue = 2*run%ndof + merge(1, 0, model%traits%has_value) + nobservable
      run%nlane = nlane
      run%ntime = int(saved_count(options))
      run%first_path = options%first_path
      run%npath = options%npath
      run%first_step = options%first_step
      run%save_every = options%save_every
      run%seed = options%seed
      run%step = options%step
      run%nnoise = model%traits%nnoise
      allocate (run%common(run%nnoise), source=.false.)
      if (allocated(options%common_noise)) run%common = [(any(options%common_noise == k), k=1, run%nnoise)]
      run%position_noise = model%traits%position_noise
      run%has_value = model%traits%has_value
      run%has_gradient = model%traits%has_gradient
      run%model => model
   end subroutine new_observed_run

   !> An observer from its request.
   subroutine new_observer(observer, request, run, error)
      class(streaming_observer), allocatable, intent(out) :: observer
      type(observer_request), intent(in) :: request
      type(observed_run), intent(in) :: run
      type(error_type), allocatable, intent(inout) :: error

      call check_request(request, run, error)
      if (allocated(error)) return
      select case (request%kind)
      case (observe_histogram, observe_quantiles)
         allocate (histogram_observer :: observer)
      case (observe_covariance)
         allocate (covariance_observer :: observer)
      case (observe_autocorrelation)
         allocate (autocorrelation_observer :: observer)
      case (observe_extremes)
         allocate (extremes_observer :: observer)
      case (observe_passage)
         allocate (passage_observer :: observer)
      case (observe_means)
         allocate (mean_values_observer :: observer)
      case default
         allocate (paths_observer :: observer)
      end select
      select type (observer)
      type is (histogram_observer)
         call new_histogram_observer(observer, request, run%ntime, request%kind == observe_quantiles, error)
      type is (covariance_observer)
         call new_covariance_observer(observer, request, run%ntime)
      type is (autocorrelation_observer)
         call new_autocorrelation_observer(observer, request, run%ntime, error)
      type is (extremes_observer)
         call new_extremes_observer(observer, run%ntime)
      type is (mean_values_observer)
         call new_mean_values_observer(observer, request, run%ntime)
      type is (passage_observer)
         call new_passage_observer(observer, request, run, error)
      type is (paths_observer)
         call new_paths_observer(observer, request, run, error)
      end select
      observer%request = request
      observer%run = run
      if (ngroup(request)*(real(observer%ncount, wp) + real(observer%nsum(), wp)) > 2.0_wp**31) &
         call raise(error, too_large, 'new_observer', 'an observer would keep '//to_text(observer%ncount)// &
                    ' integers and '//to_text(observer%nsum())//' numbers for each of '// &
                    to_text(ngroup(request))//' groups: save less often (save_every), or ask for fewer bins, '// &
                    'values, paths or groups')
   end subroutine new_observer

   !> Whether a request asks for means of groups.
   elemental logical function of_group_means(request)
      type(observer_request), intent(in) :: request

      of_group_means = request%kind == observe_means .and. request%ngroup > 0
   end function of_group_means

   !> Number of statistics that a request asks for.
   pure integer function ngroup(request)
      type(observer_request), intent(in) :: request

      ngroup = max(1, request%ngroup)
   end function ngroup

   !> Refuse unknown kinds, and values that the run does not have.
   subroutine check_request(request, run, error)
      type(observer_request), intent(in) :: request
      type(observed_run), intent(in) :: run
      type(error_type), allocatable, intent(inout) :: error
      integer :: n

      n = 0
      if (allocated(request%values)) n = size(request%values)
      if (request%kind < observe_histogram .or. request%kind > observe_means) then
         call refuse('kind '//to_text(request%kind)//' of an observer does not exist: give 1 to '// &
                     to_text(observe_means))
      else if (n == 0 .or. (n > 1 .and. any(request%kind == one_value))) then
         call refuse('an observer of kind '//to_text(request%kind)//' is given '//to_text(n)//' values: give '// &
                     trim(merge('one         ', 'at least one', any(request%kind == one_value))))
      else if (any(request%values < 1 .or. request%values > run%nvalue)) then
         call refuse('an observer looks at values '//to_text(minval(request%values))//' to '// &
                     to_text(maxval(request%values))//', and there are '//to_text(run%nvalue)// &
                     ' (q, p, the energy where there is one, observables): give numbers of these')
      else if (allocated(request%shares)) then
         if (.not. all(request%shares >= 0 .and. request%shares <= 1)) &
            call refuse('shares of quantiles from '//to_text(minval(request%shares))//' to '// &
                        to_text(maxval(request%shares))//': give numbers between 0 and 1')
      end if

   contains

      subroutine refuse(message)
         character(*), intent(in) :: message

         call raise(error, invalid_argument, 'new_observer', message)
      end subroutine refuse

   end subroutine check_request

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

   !> Allocate the results of a request, and return the number of values in its answer.
   subroutine new_observed(observed, nanswer, request, run, error)
      type(observed_type), intent(out) :: observed
      integer(i8), intent(out) :: nanswer
      type(observer_request), intent(in) :: request
      type(observed_run), intent(in) :: run
      type(error_type), allocatable, intent(inout) :: error
      class(streaming_observer), allocatable :: observer

      nanswer = 0
      call new_observer(observer, request, run, error)
      if (allocated(error)) return
      nanswer = ngroup(request)*observer%nanswer()
      call clear_observed(observed, observer)
   end subroutine new_observed

   !> Results of an observer that has seen no path.
   subroutine clear_observed(observed, observer)
      type(observed_type), intent(out) :: observed
      class(streaming_observer), intent(in) :: observer

      integer(i8) :: m, n
      integer :: k

      observed%request = observer%request
      observed%of = observer%run
      m = observer%ncount
      n = observer%nsum()
      allocate (observed%counts(ngroup(observed%request)*m), observed%sums(ngroup(observed%request)*n))
      observed%sums = 0
      do k = 0, ngroup(observed%request) - 1
         call observer%clear(observed%counts(k*m + 1:(k + 1)*m), observed%sums(k*n + 1:k*n + observer%nsingle))
      end do
      nullify (observed%request%labels)
      nullify (observed%of%model, observed%of%observables)  ! results may outlive the model and the observables
   end subroutine clear_observed

end module symsde_ensemble_observe_observers
