! SPDX-License-Identifier: BSD-3-Clause
!> The handle of a prepared run: create, advance, resume, reset, view its state, delete.
module symsde_capi_run
   use, intrinsic :: iso_c_binding, only: &
      c_associated, c_double, c_f_pointer, c_int, c_int32_t, c_int64_t, c_loc, c_null_ptr, c_ptr, c_size_t, c_sizeof
   use symsde_base_kinds, only: i8
   use symsde_base_memory, only: require_reserve
   use symsde_base_status, only: error_type, raise, null_handle, out_of_memory
   use symsde_capi_error, only: finish, require, init_struct, take_struct, give_struct
   use symsde_capi_input, only: run_input, read_input, read_drive
   use symsde_capi_model, only: copy_model, find_model
   use symsde_capi_options, only: take_options
   use symsde_capi_paths, only: read_saved
   use symsde_capi_report, only: check_report, give_report, end_run
   use symsde_capi_scheme, only: find_scheme
   use symsde_ensemble_monitor, only: tell_warnings
   use symsde_ensemble_options, only: run_options
   use symsde_ensemble_run_prepared, only: prepared_run, prepare
   use symsde_ensemble_observe_recorder, only: path_recorder
   use symsde_ensemble_run_report, only: run_report
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: symsde_state_init, symsde_run_new, symsde_run_advance, symsde_run_resume, symsde_run_reset
   public :: symsde_run_state, symsde_run_report, symsde_run_delete

   integer(i8), parameter :: tag_of_run = int(z'72756E', i8)  !! 'run'; cleared when the handle is deleted

   !> The object behind a symsde_run.
   type :: run_handle
      integer(i8) :: tag = tag_of_run
      class(model_type), allocatable :: model   !! copy of the model, to which the run points
      type(prepared_run) :: run
   end type run_handle

   !> struct symsde_state
   type, bind(c) :: c_state
      integer(c_size_t) :: struct_size = 0
      type(c_ptr) :: q = c_null_ptr, p = c_null_ptr
      type(c_ptr) :: q_low = c_null_ptr, p_low = c_null_ptr
      type(c_ptr) :: status = c_null_ptr
      type(c_ptr) :: failed_step = c_null_ptr
      integer(c_int64_t) :: paths = 0
      integer(c_int32_t) :: ndof = 0, nnoise = 0
      integer(c_int64_t) :: next_step = 0
      real(c_double) :: t = 0
   end type c_state

contains

   !> An empty state.
   function symsde_state_init(state) result(status) bind(c, name='symsde_state_init')
      type(c_ptr), intent(in), value :: state
      integer(c_int) :: status
      type(c_state), target :: blank

      status = init_struct(state, 'state', c_loc(blank), c_sizeof(blank))
   end function symsde_state_init

   !> Prepare a run. It owns copies of model and scheme, which may be deleted afterwards.
   function symsde_run_new(model, scheme, options, input, run, error) result(status) bind(c, name='symsde_run_new')
      type(c_ptr), intent(in), value :: model, scheme, options, input, run, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: m
      type(scheme_type), pointer :: s
      type(run_options) :: o
      type(run_input) :: from
      type(run_handle), pointer :: holder
      type(run_report) :: known
      type(c_ptr), pointer :: made
      integer :: info

      holder => null()
      made => null()
      call require(run, 'run', refusal)
      call require_reserve('a prepared run', 'symsde_run_new', refusal)
      if (.not. allocated(refusal)) then
         call c_f_pointer(run, made)
         made = c_null_ptr
      end if
      call find_model(model, m, refusal)
      call find_scheme(scheme, s, refusal)
      call take_options(options, o, refusal)
      if (.not. allocated(refusal)) call read_input(input, m%traits%ndof, o%npath, from, refusal)
      if (.not. allocated(refusal)) then
         allocate (holder, stat=info)
         if (info /= 0) call raise(refusal, out_of_memory, 'symsde_run_new', 'no memory for a prepared run')
      end if
      if (.not. allocated(refusal)) then
         call copy_model(m, holder%model)
         call prepare(holder%run, holder%model, s, o, from%q0, from%p0, refusal, from%q0_low, from%p0_low)
         if (.not. allocated(refusal)) then
            call holder%run%get_report(known)
            call tell_warnings(from%monitor, known%warnings, refusal)
         end if
         if (allocated(refusal)) then
            deallocate (holder)
         else
            made = c_loc(holder)
         end if
      end if
      status = finish(refusal, error)
   end function symsde_run_new

   !> Take `steps` more steps; save every save_every steps if paths are given.
   function symsde_run_advance(run, steps, save_every, input, paths, error) result(status) &
      bind(c, name='symsde_run_advance')
      type(c_ptr), intent(in), value :: run, input, paths, error
      integer(c_int64_t), intent(in), value :: steps, save_every
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(run_handle), pointer :: holder
      type(run_input) :: drive

      call find_run(run, holder, refusal)
      call read_drive(input, drive, refusal)
      if (.not. allocated(refusal)) call holder%run%begin_steps(steps, save_every, refusal)
      call record(holder, paths, drive, refusal)
      status = end_advance(holder, refusal, error)
   end function symsde_run_advance

   !> Take the remaining steps of an advance that was stopped.
   function symsde_run_resume(run, input, paths, error) result(status) bind(c, name='symsde_run_resume')
      type(c_ptr), intent(in), value :: run, input, paths, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(run_handle), pointer :: holder
      type(run_input) :: drive

      call find_run(run, holder, refusal)
      call read_drive(input, drive, refusal)
      if (.not. allocated(refusal)) call holder%run%begin_rest(refusal)
      call record(holder, paths, drive, refusal)
      status = end_advance(holder, refusal, error)
   end function symsde_run_resume

   !> Begin again with a new state, seed, first path and first step.
   function symsde_run_reset(run, input, seed, first_path, first_step, error) result(status) &
      bind(c, name='symsde_run_reset')
      type(c_ptr), intent(in), value :: run, input, error
      integer(c_int64_t), intent(in), value :: seed   ! unsigned in C: the same 64 bits
      integer(c_int64_t), intent(in), value :: first_path, first_step
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(run_handle), pointer :: holder
      type(run_input) :: from
      type(run_options) :: o

      call find_run(run, holder, refusal)
      if (.not. allocated(refusal)) then
         o = holder%run%options()
         call read_input(input, holder%model%traits%ndof, o%npath, from, refusal)
      end if
      if (.not. allocated(refusal)) &
         call holder%run%reset(from%q0, from%p0, refusal, from%q0_low, from%p0_low, first_step, seed, first_path)
      status = finish(refusal, error)
   end function symsde_run_reset

   !> Addresses of the state of the paths; they stay the same until the run is deleted.
   function symsde_run_state(run, state, error) result(status) bind(c, name='symsde_run_state')
      type(c_ptr), intent(in), value :: run, state, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(run_handle), pointer :: holder
      type(c_state), target :: copy
      integer(c_size_t) :: struct_size

      call find_run(run, holder, refusal)
      call take_struct(state, 'state', c_loc(copy), c_sizeof(copy), refusal)
      if (.not. allocated(refusal)) then
         struct_size = copy%struct_size
         call show_state(holder, copy)
         copy%struct_size = struct_size
         call give_struct(c_loc(copy), state)
      end if
      status = finish(refusal, error)
   end function symsde_run_state

   !> Report counters and seconds of all calls until now.
   function symsde_run_report(run, report, error) result(status) bind(c, name='symsde_run_report')
      type(c_ptr), intent(in), value :: run, report, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(run_handle), pointer :: holder
      type(run_report) :: outcome

      call find_run(run, holder, refusal)
      call require(report, 'report', refusal)
      call check_report(report, refusal)
      if (.not. allocated(refusal)) then
         call holder%run%get_report(outcome)
         call give_report(outcome, report)
      end if
      status = finish(refusal, error)
   end function symsde_run_report

   !> Delete a run and set its handle to NULL; NULL is accepted.
   function symsde_run_delete(run) result(status) bind(c, name='symsde_run_delete')
      type(c_ptr), intent(in), value :: run
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(c_ptr), pointer :: handle
      type(run_handle), pointer :: holder

      if (c_associated(run)) then
         call c_f_pointer(run, handle)
         if (c_associated(handle)) then
            call find_run(handle, holder, refusal)
            if (.not. allocated(refusal)) then
               holder%tag = 0
               deallocate (holder)
               handle = c_null_ptr
            end if
         end if
      end if
      status = finish(refusal, c_null_ptr)
   end function symsde_run_delete

   !> The run of a handle; refuses NULL, deleted and foreign handles (null_handle).
   subroutine find_run(handle, holder, error)
      type(c_ptr), intent(in) :: handle
      type(run_handle), pointer, intent(out) :: holder
      type(error_type), allocatable, intent(inout) :: error

      nullify (holder)
      if (allocated(error)) return
      if (c_associated(handle)) then
         call c_f_pointer(handle, holder)
         if (holder%tag == tag_of_run) return
         nullify (holder)
      end if
      call raise(error, null_handle, 'find_run', 'run is NULL, deleted or not a prepared run: make one with '// &
                 'symsde_run_new')
   end subroutine find_run

   !> Take the steps of a call that was begun, and save where the caller gave arrays.
   subroutine record(holder, paths, drive, error)
      type(run_handle), pointer, intent(in) :: holder
      type(c_ptr), intent(in) :: paths                 !! symsde_paths, may be NULL
      type(run_input), intent(inout) :: drive
      type(error_type), allocatable, intent(inout) :: error
      type(path_recorder) :: recorder

      if (allocated(error)) return
      if (c_associated(paths)) &
         call read_saved(paths, holder%model%traits%ndof, holder%run%options(), recorder, error)
      call holder%run%record(recorder, error, drive%dw, drive%monitor)
   end subroutine record

   !> The status of an advance. The caller reads the report with symsde_run_report.
   function end_advance(holder, refusal, error) result(status)
      type(run_handle), pointer, intent(in) :: holder
      type(error_type), allocatable, intent(in) :: refusal
      type(c_ptr), intent(in) :: error   !! symsde_error, may be NULL
      integer(c_int) :: status
      type(run_report) :: outcome

      if (allocated(refusal)) then
         status = finish(refusal, error)
      else
         call holder%run%get_report(outcome)
         status = end_run(refusal, holder%model%failure_code(), outcome, c_null_ptr, error)
      end if
   end function end_advance

   !> Fill all members but struct_size.
   subroutine show_state(holder, state)
      type(run_handle), intent(in), pointer :: holder
      type(c_state), intent(inout) :: state
      type(prepared_run), pointer :: run

      run => holder%run
      state%q = c_loc(run%q)
      state%p = c_loc(run%p)
      if (allocated(run%q_low)) then
         state%q_low = c_loc(run%q_low)
         state%p_low = c_loc(run%p_low)
      end if
      state%status = c_loc(run%status)
      state%failed_step = c_loc(run%failed_step)
      state%paths = size(run%q, 1, i8)
      state%ndof = size(run%q, 2)
      state%nnoise = holder%model%traits%nnoise
      state%next_step = run%next_step()
      state%t = run%time()
   end subroutine show_state

end module symsde_capi_run
