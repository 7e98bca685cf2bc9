! SPDX-License-Identifier: BSD-3-Clause
!> symsde_compute_moments: the run that keeps statistics only.
module symsde_capi_moments
   use, intrinsic :: iso_c_binding, only: &
      c_associated, c_funptr, c_int, c_int32_t, c_int64_t, c_loc, c_null_funptr, c_null_ptr, &
      c_ptr, c_size_t, c_sizeof
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type, raise, invalid_argument
   use symsde_base_text, only: to_text
   use symsde_capi_arrays, only: view
   use symsde_capi_error, only: require, init_struct, require_function, check_sizes, take_struct, give_struct
   use symsde_capi_input, only: run_input, read_input, begin_at
   use symsde_capi_model, only: use_model
   use symsde_capi_observer, only: read_observers, give_observed
   use symsde_capi_observables, only: callback_observables, new_callback_observables
   use symsde_capi_options, only: read_options
   use symsde_capi_paths, only: read_paths
   use symsde_capi_report, only: check_report, end_run
   use symsde_capi_scheme, only: find_scheme
   use symsde_ensemble_block_initial_state, only: initial_state
   use symsde_ensemble_observe_moment_collector, only: max_failed_listed
   use symsde_ensemble_observe_recorder, only: path_recorder
   use symsde_ensemble_options, only: run_options, saved_count
   use symsde_ensemble_run_simulate, only: moments_type, collect_moments
   use symsde_ensemble_observe_streaming, only: observer_request
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: symsde_moments_init, symsde_compute_moments

   integer, parameter :: most_observables = 100000, most_lanes = 1000000

   !> struct symsde_moments
   type, bind(c) :: c_moments
      integer(c_size_t) :: struct_size = 0
      type(c_ptr) :: t = c_null_ptr
      type(c_ptr) :: n_ok = c_null_ptr
      type(c_ptr) :: mean = c_null_ptr, variance = c_null_ptr, se_mean = c_null_ptr
      integer(c_int32_t) :: nobservable = 0
      type(c_funptr) :: observables = c_null_funptr
      type(c_ptr) :: observables_user = c_null_ptr
      integer(c_int64_t) :: nfailed_listed = 0
      integer(c_int64_t) :: failed(max_failed_listed) = -1
      integer(c_int32_t) :: failed_status(max_failed_listed) = 0
      integer(c_int64_t) :: failed_step(max_failed_listed) = -1
      type(c_ptr) :: m2 = c_null_ptr
      integer(c_int32_t) :: observables_lanes = 0, nobserver = 0
      type(c_ptr) :: observers = c_null_ptr
      type(c_ptr) :: paths = c_null_ptr
   end type c_moments

contains

   !> A struct with no arrays, no observables and no failed paths.
   function symsde_moments_init(moments) result(status) bind(c, name='symsde_moments_init')
      type(c_ptr), intent(in), value :: moments
      integer(c_int) :: status
      type(c_moments), target :: blank

      status = init_struct(moments, 'moments', c_loc(blank), c_sizeof(blank))
   end function symsde_moments_init

   !> Integrate all paths and keep their moments at every saved time.
   function symsde_compute_moments(model, scheme, options, input, moments, report, error) result(status) &
      bind(c, name='symsde_compute_moments')
      type(c_ptr), intent(in), value :: model, scheme, options, input, moments, report, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: m
      class(model_type), allocatable, target :: own
      type(scheme_type), pointer :: s
      type(run_options) :: o
      type(run_input) :: from
      type(initial_state) :: start
      type(c_moments), target :: copy
      type(callback_observables), target :: observables
      type(moments_type) :: result
      type(observer_request), allocatable :: observers(:)
      type(path_recorder) :: recorder
      integer :: code

      call use_model(model, own, m, refusal)
      call find_scheme(scheme, s, refusal)
      call read_options(options, o, refusal)
      call check_report(report, refusal)
      if (.not. allocated(refusal)) call read_input(input, m%traits%ndof, o%npath, from, refusal)
      if (.not. allocated(refusal)) call read_moments(moments, m, o, copy, refusal)
      if (.not. allocated(refusal)) call read_observers(copy%observers, copy%nobserver, o%npath, &
                                                        observers, refusal)
      if (.not. allocated(refusal)) then
         if (c_associated(copy%paths)) call read_paths(copy%paths, m%traits%ndof, o, recorder, refusal, .true.)
      end if
      if (.not. allocated(refusal)) then
         call new_callback_observables(observables, copy%nobservable, copy%observables, copy%observables_user, &
                                       copy%observables_lanes)
         call begin_at(start, from)
         call collect_moments(m, s, o, start, result, refusal, observers, observables, from%dw, from%monitor, recorder)
      end if
      if (.not. allocated(refusal)) then
         call give_observed(result%observed, copy%observers)
         call give_moments(result, copy, moments)
      end if
      code = observables%failure_code()
      if (associated(m) .and. code == 0) code = m%failure_code()
      status = end_run(refusal, code, result%report, report, error)
   end function symsde_compute_moments

   !> Read the caller's struct: check that its arrays are given, and the function of the observables if there are any.
   subroutine read_moments(given, model, options, copy, error)
      type(c_ptr), intent(in) :: given          !! symsde_moments
      class(model_type), intent(in) :: model
      type(run_options), intent(in) :: options
      type(c_moments), intent(out), target :: copy
      type(error_type), allocatable, intent(inout) :: error
      integer(i8) :: nvalue

      call take_struct(given, 'moments', c_loc(copy), c_sizeof(copy), error)
      if (copy%nobservable < 0 .or. copy%nobservable > most_observables) &
         call raise(error, invalid_argument, 'symsde_compute_moments', 'nobservable = '// &
                    to_text(copy%nobservable)//' is out of range: give 0 to '//to_text(most_observables))
      if (copy%observables_lanes < 0 .or. copy%observables_lanes > most_lanes) &
         call raise(error, invalid_argument, 'symsde_compute_moments', 'observables_lanes = '// &
                    to_text(copy%observables_lanes)//' is out of range: give 0 to '//to_text(most_lanes))
      if (copy%nobservable > 0) call require_function(copy%observables, 'observables', error)
      nvalue = 2*model%traits%ndof + merge(1, 0, model%traits%has_value) + copy%nobservable
      call check_sizes(saved_count(options), nvalue, 1_i8, 'mean', error)
      call require(copy%t, 't', error)
      call require(copy%n_ok, 'n_ok', error)
      call require(copy%mean, 'mean', error)
      call require(copy%variance, 'variance', error)
      call require(copy%se_mean, 'se_mean', error)
   end subroutine read_moments

   !> Copy moments into the caller's arrays and the failed paths into the caller's struct.
   subroutine give_moments(result, copy, given)
      type(moments_type), intent(in) :: result
      type(c_moments), intent(inout), target :: copy
      type(c_ptr), intent(in) :: given
      integer(i8), pointer, contiguous :: n_ok(:)
      real(wp), pointer, contiguous :: t(:)
      integer(i8) :: ntime
      integer :: n

      ntime = size(result%t)
      call view(copy%t, ntime, t)
      t = result%t
      call put_rows(copy%mean, result%mean)
      call put_rows(copy%variance, result%variance)
      call put_rows(copy%se_mean, result%se_mean)
      if (c_associated(copy%m2)) call put_rows(copy%m2, result%m2)
      call view(copy%n_ok, ntime, n_ok)
      n_ok = result%n_ok
      n = size(result%failed)
      copy%nfailed_listed = n
      copy%failed(:n) = result%failed
      copy%failed_status(:n) = result%failed_status
      copy%failed_step(:n) = result%failed_step
      call give_struct(c_loc(copy), given)
   end subroutine give_moments

   subroutine put_rows(given, x)
      type(c_ptr), intent(in) :: given     !! [ntime][nvalue]
      real(wp), intent(in) :: x(:, :)      !! (nvalue, ntime)
      real(wp), pointer, contiguous :: to(:, :)

      call view(given, size(x, 1, i8), size(x, 2, i8), to)
      to = x
   end subroutine put_rows

end module symsde_capi_moments
