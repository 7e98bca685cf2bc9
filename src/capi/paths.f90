! SPDX-License-Identifier: BSD-3-Clause
!> symsde_simulate: the run that saves paths directly into the caller's arrays.
module symsde_capi_paths
   use, intrinsic :: iso_c_binding, only: &
      c_associated, c_f_pointer, c_int, c_loc, c_null_ptr, c_ptr, c_size_t, c_sizeof
   use symsde_base_kinds, only: wp, i8
   use symsde_base_memory, only: require_reserve
   use symsde_base_status, only: error_type, raise, out_of_memory
   use symsde_base_text, only: to_text
   use symsde_capi_arrays, only: view
   use symsde_capi_error, only: finish, require, check_sizes, take_struct
   use symsde_capi_input, only: run_input, read_input
   use symsde_capi_model, only: use_model
   use symsde_capi_options, only: read_options
   use symsde_capi_report, only: check_report, end_run
   use symsde_capi_scheme, only: find_scheme
   use symsde_ensemble_block_initial_state, only: initial_state
   use symsde_ensemble_run_driver, only: run_ensemble
   use symsde_ensemble_options, only: run_options, check_options
   use symsde_ensemble_observe_recorder, only: path_recorder
   use symsde_ensemble_run_report, only: run_report
   use symsde_ensemble_run_simulate, only: fill_times
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: symsde_paths_init, symsde_simulate, symsde_saved_times, read_saved

   !> struct symsde_paths
   type, bind(c) :: c_paths
      integer(c_size_t) :: struct_size
      type(c_ptr) :: t
      type(c_ptr) :: q, p
      type(c_ptr) :: status
      type(c_ptr) :: failed_step
      type(c_ptr) :: last_q, last_p
      type(c_ptr) :: q_low, p_low
   end type c_paths

   !> Arrays that the recorder writes although the caller does not want them.
   type :: scratch_type
      real(wp), allocatable :: last_q(:, :), last_p(:, :), q_low(:, :), p_low(:, :)  !! (npath, ndof)
   end type scratch_type

contains

   !> A struct with no arrays.
   function symsde_paths_init(paths) result(status) bind(c, name='symsde_paths_init')
      type(c_ptr), intent(in), value :: paths
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(c_paths), pointer :: filled

      call require(paths, 'paths', refusal)
      if (.not. allocated(refusal)) then
         call c_f_pointer(paths, filled)
         filled = blank_paths()
      end if
      status = finish(refusal, c_null_ptr)
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
      type(scratch_type), target :: scratch
      type(run_report) :: outcome
      integer :: code

      call use_model(model, own, m, refusal)
      call find_scheme(scheme, s, refusal)
      call read_options(options, o, refusal)
      call check_report(report, refusal)
      if (.not. allocated(refusal)) call read_input(input, m%traits%ndof, o%npath, from, refusal)
      if (.not. allocated(refusal)) call read_paths(paths, m%traits%ndof, o, recorder, scratch, refusal)
      start%q => from%q0
      start%p => from%p0
      start%q_low => from%q0_low
      start%p_low => from%p0_low
      if (.not. allocated(refusal)) &
         call run_ensemble(m, s, o, start, recorder, from%monitor, outcome, refusal, from%dw)
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
      call check_options(o, refusal)
      call require(t, 't', refusal)
      if (.not. allocated(refusal)) call put_times(t, o)
      status = finish(refusal, error)
   end function symsde_saved_times

   !> Make a recorder on the caller's arrays, and fill in the saved times if the caller wants them.
   subroutine read_paths(given, ndof, options, recorder, scratch, error)
      type(c_ptr), intent(in) :: given                       !! symsde_paths
      integer, intent(in) :: ndof
      type(run_options), intent(in) :: options
      type(path_recorder), intent(out) :: recorder
      type(scratch_type), intent(inout), target :: scratch   !! must live as long as the recorder
      type(error_type), allocatable, intent(inout) :: error
      type(c_paths), target :: copy
      integer(i8) :: n, npath

      n = ndof
      npath = options%npath
      call take_paths(given, ndof, options, recorder, copy, error)
      call require(copy%status, 'status', error)
      call require(copy%failed_step, 'failed_step', error)
      if (allocated(error)) return
      recorder%first_path = options%first_path
      call view(copy%status, npath, recorder%status)
      call view(copy%failed_step, npath, recorder%failed_step)
      call choose(copy%last_q, .true., npath, n, scratch%last_q, recorder%last_q, error)
      call choose(copy%last_p, .true., npath, n, scratch%last_p, recorder%last_p, error)
      call choose(copy%q_low, options%compensated, npath, n, scratch%q_low, recorder%q_low, error)
      call choose(copy%p_low, options%compensated, npath, n, scratch%p_low, recorder%p_low, error)
   end subroutine read_paths

   !> Make a recorder for saved states only: a prepared run has its own arrays for the final state.
   subroutine read_saved(given, ndof, options, recorder, error)
      type(c_ptr), intent(in) :: given                       !! symsde_paths
      integer, intent(in) :: ndof
      type(run_options), intent(in) :: options
      type(path_recorder), intent(out) :: recorder
      type(error_type), allocatable, intent(inout) :: error
      type(c_paths), target :: copy

      call check_options(options, error)
      call take_paths(given, ndof, options, recorder, copy, error)
   end subroutine read_saved

   !> Read the caller's struct, point the recorder to its arrays of saved states, and fill in the saved times if the
   !> caller wants them.
   subroutine take_paths(given, ndof, options, recorder, copy, error)
      type(c_ptr), intent(in) :: given                       !! symsde_paths
      integer, intent(in) :: ndof
      type(run_options), intent(in) :: options
      type(path_recorder), intent(inout) :: recorder
      type(c_paths), intent(out), target :: copy
      type(error_type), allocatable, intent(inout) :: error
      integer(i8) :: n, ntime

      copy = blank_paths()
      if (allocated(error)) return
      n = ndof
      ntime = options%nstep/options%save_every + 1
      call take_struct(given, 'paths', c_loc(copy), c_sizeof(copy), error)
      call check_sizes(ntime, n, options%npath, 'q', error)
      call require(copy%q, 'q', error)
      call require(copy%p, 'p', error)
      if (allocated(error)) return
      call view(copy%q, options%npath, n, ntime, recorder%q)
      call view(copy%p, options%npath, n, ntime, recorder%p)
      if (c_associated(copy%t)) call put_times(copy%t, options)
   end subroutine take_paths

   !> Take the caller's array; or, if the recorder needs it and the caller gave none, scratch of the same size.
   subroutine choose(given, needed, npath, ndof, scratch, array, error)
      type(c_ptr), intent(in) :: given
      logical, intent(in) :: needed
      integer(i8), intent(in) :: npath, ndof
      real(wp), allocatable, intent(inout), target :: scratch(:, :)
      real(wp), pointer, contiguous, intent(out) :: array(:, :)   !! (npath, ndof)
      type(error_type), allocatable, intent(inout) :: error
      integer :: info

      nullify (array)
      if (c_associated(given)) then
         call view(given, npath, ndof, array)
         array = 0
      else if (needed) then
         allocate (scratch(npath, ndof), stat=info)
         if (info == 0) then
            array => scratch
         else
            call raise(error, out_of_memory, 'symsde_simulate', 'no memory for the last state of '// &
                       to_text(npath)//' paths: give fewer paths, or use symsde_compute_moments')
         end if
      end if
   end subroutine choose

   subroutine put_times(given, options)
      type(c_ptr), intent(in) :: given       !! one number for each saved point
      type(run_options), intent(in) :: options
      real(wp), pointer, contiguous :: t(:)
      integer(i8) :: ntime

      ntime = options%nstep/options%save_every + 1
      call view(given, ntime, t)
      call fill_times(options, ntime, t)
   end subroutine put_times

   function blank_paths() result(paths)
      type(c_paths) :: paths

      paths%struct_size = c_sizeof(paths)
      paths%t = c_null_ptr
      paths%q = c_null_ptr
      paths%p = c_null_ptr
      paths%status = c_null_ptr
      paths%failed_step = c_null_ptr
      paths%last_q = c_null_ptr
      paths%last_p = c_null_ptr
      paths%q_low = c_null_ptr
      paths%p_low = c_null_ptr
   end function blank_paths

end module symsde_capi_paths
