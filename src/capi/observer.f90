! SPDX-License-Identifier: BSD-3-Clause
!> struct symsde_observer: a statistic besides the moments of a run, how its parts merge, and its answer.
module symsde_capi_observer
   use, intrinsic :: iso_c_binding, only: &
      c_associated, c_f_pointer, c_int, c_int32_t, c_int64_t, c_loc, c_null_ptr, c_ptr, c_size_t, c_sizeof, c_double
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: error_type, raise, invalid_argument
   use symsde_base_text, only: to_text
   use symsde_capi_arrays, only: view
   use symsde_capi_error, only: finish, require, init_struct, check_sizes, take_struct
   use symsde_capi_model, only: use_model
   use symsde_capi_options, only: read_options
   use symsde_ensemble_observe_observed, only: merge_observed, observed_answer
   use symsde_ensemble_observe_observers, only: new_observed, new_observed_run
   use symsde_ensemble_options, only: run_options
   use symsde_ensemble_observe_streaming, only: observer_request, observed_run, observed_type
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: symsde_observer_init, symsde_observer_sizes, symsde_observer_merge, symsde_observer_answer
   public :: read_observers, give_observed

   integer, parameter :: most_observers = 1000, most_values = 100000, most_groups = 10000000

   !> struct symsde_observer
   type, bind(c) :: c_observer
      integer(c_size_t) :: struct_size = 0
      integer(c_int32_t) :: kind = 0, nvalue = 0
      type(c_ptr) :: values = c_null_ptr
      real(c_double) :: low = 0, high = 0
      integer(c_int32_t) :: bins = 0, nshare = 0
      type(c_ptr) :: shares = c_null_ptr
      integer(c_int64_t) :: npath = 0
      type(c_ptr) :: paths = c_null_ptr
      integer(c_int32_t) :: absorbs = 0, bridges = 1
      type(c_ptr) :: counts = c_null_ptr
      type(c_ptr) :: sums = c_null_ptr
      integer(c_int64_t) :: ngroup = 0
      type(c_ptr) :: labels = c_null_ptr
   end type c_observer

contains

   !> An observer with no kind and no values; bridges are on.
   function symsde_observer_init(observer) result(status) bind(c, name='symsde_observer_init')
      type(c_ptr), intent(in), value :: observer
      integer(c_int) :: status
      type(c_observer), target :: blank

      status = init_struct(observer, 'observer', c_loc(blank), c_sizeof(blank))
   end function symsde_observer_init

   !> How many integers and numbers an observer keeps in a run, and how many numbers its answer has.
   function symsde_observer_sizes(model, options, nobservable, observer, sizes, error) result(status) &
      bind(c, name='symsde_observer_sizes')
      type(c_ptr), intent(in), value :: model, options
      integer(c_int), intent(in), value :: nobservable
      type(c_ptr), intent(in), value :: observer
      type(c_ptr), intent(in), value :: sizes, error   !! [3]
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(observed_type) :: kept
      integer(i8) :: answers
      integer(i8), pointer, contiguous :: to(:)

      call require(sizes, 'sizes', refusal)
      call find_kept(model, options, nobservable, observer, kept, answers, refusal)
      if (.not. allocated(refusal)) then
         call view(sizes, 3_i8, to)
         to(1) = size(kept%counts, kind=i8)
         to(2) = size(kept%sums, kind=i8)
         to(3) = answers
      end if
      status = finish(refusal, error)
   end function symsde_observer_sizes

   !> Merge the results of two siblings into the left one.
   function symsde_observer_merge(model, options, nobservable, left, right, error) result(status) &
      bind(c, name='symsde_observer_merge')
      type(c_ptr), intent(in), value :: model, options
      integer(c_int), intent(in), value :: nobservable
      type(c_ptr), intent(in), value :: left, right, error   !! symsde_observer, of one request
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(observed_type) :: mine, other
      integer(i8) :: answers

      call find_kept(model, options, nobservable, left, mine, answers, refusal)
      call take_kept(left, mine, refusal)
      call find_kept(model, options, nobservable, right, other, answers, refusal)
      call take_kept(right, other, refusal)
      if (.not. allocated(refusal)) call merge_observed(mine, other, refusal)
      if (.not. allocated(refusal)) call give_kept(mine, left)
      status = finish(refusal, error)
   end function symsde_observer_merge

   !> Compute the answer of an observer and its standard errors from kept results.
   function symsde_observer_answer(model, options, nobservable, observer, values, errors, error) result(status) &
      bind(c, name='symsde_observer_answer')
      type(c_ptr), intent(in), value :: model, options
      integer(c_int), intent(in), value :: nobservable
      type(c_ptr), intent(in), value :: observer
      type(c_ptr), intent(in), value :: values, errors, error   !! [answers]
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(observed_type) :: kept
      real(wp), allocatable :: found(:), deviation(:)
      real(wp), pointer, contiguous :: to(:)
      integer(i8) :: answers

      call require(values, 'values', refusal)
      call require(errors, 'errors', refusal)
      call find_kept(model, options, nobservable, observer, kept, answers, refusal)
      call take_kept(observer, kept, refusal)
      if (.not. allocated(refusal)) call observed_answer(kept, found, deviation, refusal)
      if (.not. allocated(refusal)) then
         call view(values, answers, to)
         to = found
         call view(errors, answers, to)
         to = deviation
      end if
      status = finish(refusal, error)
   end function symsde_observer_answer

   !> Allocate empty results of an observer for a run with these options.
   subroutine find_kept(model, options, nobservable, observer, kept, answers, error)
      type(c_ptr), intent(in) :: model, options, observer
      integer(c_int), intent(in) :: nobservable
      type(observed_type), intent(out) :: kept
      integer(i8), intent(out) :: answers
      type(error_type), allocatable, intent(inout) :: error
      class(model_type), pointer :: m
      class(model_type), allocatable, target :: own
      type(run_options) :: o
      type(observer_request) :: request
      type(observed_run) :: run

      call use_model(model, own, m, error)
      call read_options(options, o, error)
      call read_observer(observer, request, error)
      if (allocated(error)) return
      call new_observed_run(run, m, o, 8, nobservable)
      call new_observed(kept, answers, request, run, error)
   end subroutine find_kept

   !> Copy the caller's arrays into kept results.
   subroutine take_kept(given, kept, error)
      type(c_ptr), intent(in) :: given
      type(observed_type), intent(inout) :: kept
      type(error_type), allocatable, intent(inout) :: error
      type(c_observer), target :: copy
      integer(i8), pointer, contiguous :: counts(:)
      real(wp), pointer, contiguous :: sums(:)

      if (allocated(error)) return
      call take_struct(given, 'observer', c_loc(copy), c_sizeof(copy), error)
      if (size(kept%counts) > 0) call require(copy%counts, 'counts', error)
      if (size(kept%sums) > 0) call require(copy%sums, 'sums', error)
      if (allocated(error)) return
      call view(copy%counts, size(kept%counts, kind=i8), counts)
      call view(copy%sums, size(kept%sums, kind=i8), sums)
      kept%counts = counts
      kept%sums = sums
   end subroutine take_kept

   !> Copy kept results into the caller's arrays that are not NULL.
   subroutine give_kept(kept, given)
      type(observed_type), intent(in) :: kept
      type(c_ptr), intent(in) :: given
      type(error_type), allocatable :: ignored
      type(c_observer), target :: copy
      integer(i8), pointer, contiguous :: counts(:)
      real(wp), pointer, contiguous :: sums(:)

      call take_struct(given, 'observer', c_loc(copy), c_sizeof(copy), ignored)
      if (c_associated(copy%counts)) then
         call view(copy%counts, size(kept%counts, kind=i8), counts)
         counts = kept%counts
      end if
      if (c_associated(copy%sums)) then
         call view(copy%sums, size(kept%sums, kind=i8), sums)
         sums = kept%sums
      end if
   end subroutine give_kept

   !> Read the caller's list of observers, given by their addresses.
   subroutine read_observers(given, n, npath, requests, error)
      type(c_ptr), intent(in) :: given          !! [n]
      integer, intent(in) :: n
      integer(i8), intent(in) :: npath          !! paths of the run, as labels of groups have
      type(observer_request), allocatable, intent(out) :: requests(:)
      type(error_type), allocatable, intent(inout) :: error
      type(c_ptr), pointer :: observers(:)
      integer :: i, extent(1)

      if (n < 0 .or. n > most_observers) &
         call raise(error, invalid_argument, 'symsde_compute_moments', 'nobserver = '//to_text(n)// &
                    ' is out of range: give 0 to '//to_text(most_observers))
      if (n > 0) call require(given, 'observers', error)
      if (allocated(error)) return
      allocate (requests(n))
      extent = n
      if (n > 0) call c_f_pointer(given, observers, extent)
      do i = 1, n
         call read_observer(observers(i), requests(i), error, npath)
      end do
   end subroutine read_observers

   !> Write the results of a run into the arrays of a list of observers.
   subroutine give_observed(observed, given)
      type(observed_type), intent(in) :: observed(:)
      type(c_ptr), intent(in) :: given
      type(c_ptr), pointer :: observers(:)
      integer :: i, extent(1)

      if (size(observed) == 0) return
      extent = size(observed)
      call c_f_pointer(given, observers, extent)
      do i = 1, size(observed)
         call give_kept(observed(i), observers(i))
      end do
   end subroutine give_observed

   !> Read an observer; labels of groups only of a run, whose number of paths is given.
   subroutine read_observer(given, request, error, npath)
      type(c_ptr), intent(in) :: given
      type(observer_request), intent(out) :: request
      type(error_type), allocatable, intent(inout) :: error
      integer(i8), intent(in), optional :: npath
      type(c_observer), target :: copy
      integer(i4), pointer, contiguous :: values(:)
      real(wp), pointer, contiguous :: shares(:)
      integer(i8), pointer, contiguous :: paths(:)

      call take_struct(given, 'observer', c_loc(copy), c_sizeof(copy), error)
      call check_sizes(int(copy%nvalue, i8), int(copy%nshare, i8), copy%npath, 'an observer', error)
      if (copy%ngroup < 0 .or. copy%ngroup > most_groups) &
         call raise(error, invalid_argument, 'read_observer', 'ngroup = '//to_text(copy%ngroup)// &
                    ' of an observer is out of range: give 0 to '//to_text(most_groups))
      if (copy%ngroup > 0 .and. present(npath)) call require(copy%labels, 'labels of an observer', error)
      if (copy%nvalue > most_values .or. copy%nshare > most_values) &
         call raise(error, invalid_argument, 'read_observer', 'an observer has nvalue = '//to_text(copy%nvalue)// &
                    ', nshare = '//to_text(copy%nshare)//': give '//to_text(most_values)//' of each at most')
      if (copy%nvalue > 0) call require(copy%values, 'values of an observer', error)
      if (copy%nshare > 0) call require(copy%shares, 'shares of an observer', error)
      if (copy%npath > 0) call require(copy%paths, 'paths of an observer', error)
      if (allocated(error)) return
      request%kind = copy%kind
      request%low = copy%low
      request%high = copy%high
      request%bins = copy%bins
      request%absorbs = copy%absorbs /= 0
      request%bridges = copy%bridges /= 0
      request%ngroup = int(copy%ngroup)
      if (copy%ngroup > 0 .and. present(npath)) call view(copy%labels, npath, request%labels)
      call view(copy%values, int(copy%nvalue, i8), values)
      request%values = values + 1  ! numbered from 0 in C
      if (copy%nshare > 0) then
         call view(copy%shares, int(copy%nshare, i8), shares)
         request%shares = shares
      end if
      if (copy%npath > 0) then
         call view(copy%paths, copy%npath, paths)
         request%paths = paths
      end if
   end subroutine read_observer

end module symsde_capi_observer
