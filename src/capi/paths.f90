! SPDX-License-Identifier: BSD-3-Clause
!> symsde_simulate: the run that saves paths directly into the caller's arrays.
module symsde_capi_paths
   use, intrinsic :: iso_c_binding, only: &
      c_associated, c_int, c_loc, c_null_ptr, c_ptr, c_size_t, c_sizeof
   use symsde_base_kinds, only: wp, i8
   use symsde_base_memory, only: require_reserve
   use symsde_base_status, only: error_type
   use symsde_capi_arrays, only: view
   use symsde_capi_error, only: finish, require, init_struct, check_sizes, take_struct
   use symsde_capi_input, only: run_input, read_input, begin_at
   use symsde_capi_model, only: use_model
   use symsde_capi_options, only: read_options
   use symsde_capi_report, only: check_report, end_run
   use symsde_capi_scheme, only: find_scheme
   use symsde_ensemble_block_initial_state, only: initial_state
   use symsde_ensemble_run_driver, only: run_ensemble
   use symsde_ensemble_options, only: run_options, saved_count
   use symsde_ensemble_observe_recorder, only: path_recorder
   use symsde_ensemble_run_report, only: run_report
   use symsde_ensemble_run_simulate, only: fill_times
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: symsde_paths_init, symsde_simulate, symsde_saved_times, read_saved, read_paths

   !> struct symsde_paths
   type, bind(c) :: c_paths
      integer(c_size_t) :: struct_size = 0
      type(c_ptr) :: t = c_null_ptr
      type(c_ptr) :: q = c_null_ptr, p = c_null_ptr
      type(c_ptr) :: status = c_null_ptr
      type(c_ptr) :: failed_step = c_null_ptr
      type(c_ptr) :: last_q = c_null_ptr, last_p = c_null_ptr
      type(c_ptr) :: q_low = c_null_ptr, p_low = c_null_ptr
   end type c_paths

contains

   !> A struct with no arrays.
   function symsde_paths_init(paths) result(status) bind(c, name='symsde_paths_init')
      type(c_ptr), intent(in), value :: paths
      integer(c_int) :: status
      type(c_paths), target :: blank

      status = init_struct(paths, 'paths', c_loc(blank), c_sizeof(blank))
   end function symsde_paths_init

   !> Integrate all paths and save them every save_every steps.
   function symsde_simulate(model, scheme, options, input, paths, report, error) result(status) &
      bind(c, name='symsde_simulate')
      type(c_ptr), intent(in), value :: model, scheme, options, input, paths, report, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: m
      class(model_type), allocatable, target :: own
      type(scheme_type), pointer :: s
      type(run_options) :: o
      type(run_input) :: from
      type(initial_state) :: start
      type(path_recorder) :: recorder
      type(run_report) :: outcome
      integer :: code

      call use_model(model, own, m, refusal)
      call find_scheme(scheme, s, refusal)
      call read_options(options, o, refusal)
      call check_report(report, refusal)
      if (.not. allocated(refusal)) call read_input(input, m%traits%ndof, o%npath, from, refusal)
      if (.not. allocated(refusal)) call read_paths(paths, m%traits%ndof, o, recorder, refusal)
      call begin_at(start, from)
      if (.not. allocated(refusal)) &
         call run_ensemble(m, s, o, start, recorder, outcome, refusal, from%dw, from%monitor)
      code = 0
      if (associated(m)) code = m%failure_code()
      status = end_run(refusal, code, outcome, report, error)
   end function symsde_simulate

   !> Times of the saved points of a run with these options.
   function symsde_saved_times(options, t, error) result(status) bind(c, name='symsde_saved_times')
      type(c_ptr), intent(in), value :: options, t, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(run_options) :: o

      call require_reserve('a call', 'symsde_saved_times', refusal)
      call read_options(options, o, refusal)
      call require(t, 't', refusal)
      if (.not. allocated(refusal)) call put_times(t, o)
      status = finish(refusal, error)
   end function symsde_saved_times

   !> Make a recorder on the caller's arrays, and fill in the saved times if the caller wants them. Where there are
   !> moments, too, saved states and failed steps may be left out.
   subroutine read_paths(given, ndof, options, recorder, error, beside)
      type(c_ptr), intent(in) :: given                       !! symsde_paths
      integer, intent(in) :: ndof
      type(run_options), intent(in) :: options
      type(path_recorder), intent(out) :: recorder
      type(error_type), allocatable, intent(inout) :: error
      logical, intent(in), optional :: beside                !! present if these may be left out
      type(c_paths), target :: copy
      integer(i8) :: n, npath

      n = ndof
      npath = options%npath
      call take_paths(given, ndof, options, recorder, copy, error, beside)
      call require(copy%status, 'status', error)
      if (.not. present(beside)) call require(copy%failed_step, 'failed_step', error)
      if (allocated(error)) return
      recorder%first_path = options%first_path
      call view(copy%status, npath, recorder%status)
      if (c_associated(copy%failed_step)) call view(copy%failed_step, npath, recorder%failed_step)
      call view_wanted(copy%last_q, npath, n, recorder%last_q)
      call view_wanted(copy%last_p, npath, n, recorder%last_p)
      call view_wanted(copy%q_low, npath, n, recorder%q_low)
      call view_wanted(copy%p_low, npath, n, recorder%p_low)
   end subroutine read_paths

   !> Make a recorder for saved states only: a prepared run has its own arrays for the final state.
   subroutine read_saved(given, ndof, options, recorder, error)
      type(c_ptr), intent(in) :: given                       !! symsde_paths
      integer, intent(in) :: ndof
      type(run_options), intent(in) :: options
      type(path_recorder), intent(out) :: recorder
      type(error_type), allocatable, intent(inout) :: error
      type(c_paths), target :: copy

      call take_paths(given, ndof, options, recorder, copy, error)
   end subroutine read_saved

   !> Read the caller's struct, point the recorder to its arrays of saved states, and fill in the saved times if the
   !> caller wants them.
   subroutine take_paths(given, ndof, options, recorder, copy, error, beside)
      type(c_ptr), intent(in) :: given                       !! symsde_paths
      integer, intent(in) :: ndof
      type(run_options), intent(in) :: options
      type(path_recorder), intent(inout) :: recorder
      type(c_paths), intent(out), target :: copy
      type(error_type), allocatable, intent(inout) :: error
      logical, intent(in), optional :: beside
      integer(i8) :: n, ntime

      if (allocated(error)) return
      n = ndof
      ntime = saved_count(options)
      call take_struct(given, 'paths', c_loc(copy), c_sizeof(copy), error)
      call check_sizes(ntime, n, options%npath, 'q', error)
      if (c_associated(copy%t) .and. .not. allocated(error)) call put_times(copy%t, options)
      if (present(beside) .and. .not. (c_associated(copy%q) .or. c_associated(copy%p))) return
      call require(copy%q, 'q', error)
      call require(copy%p, 'p', error)
      if (allocated(error)) return
      call view(copy%q, options%npath, n, ntime, recorder%q)
      call view(copy%p, options%npath, n, ntime, recorder%p)
   end subroutine take_paths

   !> View an array that the caller may want, and begin with zeros; null if not.
   subroutine view_wanted(given, npath, ndof, array)
      type(c_ptr), intent(in) :: given
      integer(i8), intent(in) :: npath, ndof
      real(wp), pointer, contiguous, intent(out) :: array(:, :)   !! (npath, ndof)

      nullify (array)
      if (.not. c_associated(given)) return
      call view(given, npath, ndof, array)
      array = 0
   end subroutine view_wanted

   subroutine put_times(given, options)
      type(c_ptr), intent(in) :: given       !! one number for each saved point
      type(run_options), intent(in) :: options
      real(wp), pointer, contiguous :: t(:)
      integer(i8) :: ntime

      ntime = saved_count(options)
      call view(given, ntime, t)
      call fill_times(options, ntime, t)
   end subroutine put_times

end module symsde_capi_paths
