! SPDX-License-Identifier: BSD-3-Clause
!> struct symsde_input: state, increments and callbacks of a run.
module symsde_capi_input
   use, intrinsic :: iso_c_binding, only: &
      c_associated, c_funptr, c_int, c_int64_t, c_loc, &
      c_null_funptr, c_null_ptr, c_ptr, c_size_t, c_sizeof
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type, raise, invalid_argument, too_large
   use symsde_base_text, only: to_text
   use symsde_capi_arrays, only: view
   use symsde_capi_error, only: require, init_struct, check_sizes, take_struct
   use symsde_capi_monitor, only: callback_monitor, new_callback_monitor
   use symsde_ensemble_block_initial_state, only: initial_state
   use symsde_noise_given, only: given_increments
   implicit none
   private
   public :: run_input, read_input, begin_at, read_drive, symsde_input_init

   !> struct symsde_input
   type, bind(c) :: c_input
      integer(c_size_t) :: struct_size = 0
      type(c_ptr) :: q0 = c_null_ptr, p0 = c_null_ptr
      integer(c_int64_t) :: q0_paths = 1, p0_paths = 1
      type(c_ptr) :: increments = c_null_ptr
      integer(c_int64_t) :: increment_rows = 0, increment_noises = 0, increment_paths = 1
      type(c_ptr) :: q0_low = c_null_ptr, p0_low = c_null_ptr
      type(c_funptr) :: progress = c_null_funptr
      type(c_ptr) :: progress_user = c_null_ptr
      type(c_funptr) :: warn = c_null_funptr
      type(c_ptr) :: warn_user = c_null_ptr
      type(c_ptr) :: increment_strides = c_null_ptr
   end type c_input

   !> The caller's arrays, path index first. An array that the caller left out is not associated, so that it counts as
   !> absent when passed as an optional argument.
   type :: run_input
      real(wp), pointer, contiguous :: q0(:, :) => null(), p0(:, :) => null()          !! (npath or 1, ndof)
      type(given_increments) :: dw                                                     !! (npath or 1, nnoise, rows)
      real(wp), pointer, contiguous :: q0_low(:, :) => null(), p0_low(:, :) => null()  !! (npath, ndof)
      type(callback_monitor) :: monitor
   end type run_input

contains

   !> An input with no state, no increments and no callback.
   function symsde_input_init(input) result(status) bind(c, name='symsde_input_init')
      type(c_ptr), intent(in), value :: input
      integer(c_int) :: status
      type(c_input), target :: blank

      status = init_struct(input, 'input', c_loc(blank), c_sizeof(blank))
   end function symsde_input_init

   !> View the arrays of the caller as Fortran arrays; the run itself checks their shapes.
   subroutine read_input(given, ndof, npath, input, error)
      type(c_ptr), intent(in) :: given     !! symsde_input
      integer, intent(in) :: ndof
      integer(i8), intent(in) :: npath
      type(run_input), intent(out) :: input
      type(error_type), allocatable, intent(inout) :: error
      type(c_input), target :: copy
      integer(i8) :: n

      if (allocated(error)) return
      n = ndof
      call take_struct(given, 'input', c_loc(copy), c_sizeof(copy), error)
      call require(copy%q0, 'q0', error)
      call require(copy%p0, 'p0', error)
      call check_sizes(n, copy%q0_paths, 1_i8, 'q0', error)
      call check_sizes(n, copy%p0_paths, 1_i8, 'p0', error)
      if (allocated(error)) return
      call view(copy%q0, copy%q0_paths, n, input%q0)
      call view(copy%p0, copy%p0_paths, n, input%p0)
      if (c_associated(copy%q0_low)) call view(copy%q0_low, npath, n, input%q0_low)
      if (c_associated(copy%p0_low)) call view(copy%p0_low, npath, n, input%p0_low)
      call view_drive(copy, input, error)
   end subroutine read_input

   !> Let a run begin at the caller's arrays.
   subroutine begin_at(start, input)
      type(initial_state), intent(out) :: start
      type(run_input), intent(in) :: input

      start%q => input%q0
      start%p => input%p0
      start%q_low => input%q0_low
      start%p_low => input%p0_low
   end subroutine begin_at

   !> Read all of an input but the state: the increments, and the function that receives progress.
   subroutine read_drive(given, input, error)
      type(c_ptr), intent(in) :: given     !! symsde_input, or NULL
      type(run_input), intent(out) :: input
      type(error_type), allocatable, intent(inout) :: error
      type(c_input), target :: copy

      if (c_associated(given)) call take_struct(given, 'input', c_loc(copy), c_sizeof(copy), error)
      if (.not. allocated(error)) call view_drive(copy, input, error)
   end subroutine read_drive

   subroutine view_drive(copy, input, error)
      type(c_input), intent(in) :: copy
      type(run_input), intent(inout) :: input
      type(error_type), allocatable, intent(inout) :: error

      call new_callback_monitor(input%monitor, copy%progress, copy%progress_user)
      call input%monitor%set_warn(copy%warn, copy%warn_user)
      if (.not. c_associated(copy%increments)) return
      call check_sizes(copy%increment_rows, copy%increment_noises, copy%increment_paths, 'increments', error)
      if (allocated(error)) return
      associate (extent => input%dw%extent)
         extent(1) = copy%increment_paths
         extent(2) = copy%increment_noises
         extent(3) = copy%increment_rows
         call take_strides(copy%increment_strides, extent, input%dw%stride, error)
         if (allocated(error)) return
         call view(copy%increments, merge(1 + sum((extent - 1)*input%dw%stride), 0_i8, all(extent > 0)), input%dw%x)
      end associate
   end subroutine view_drive

   !> The strides of paths, noises and rows: as the caller gives them, [row, noise, path], else those of an array in
   !> order. Errors: invalid_argument.
   subroutine take_strides(given, extent, stride, error)
      type(c_ptr), intent(in) :: given
      integer(i8), intent(in) :: extent(3)
      integer(i8), intent(out) :: stride(3)
      type(error_type), allocatable, intent(inout) :: error
      integer(i8), pointer, contiguous :: strides(:)

      stride(1) = 1
      stride(2) = extent(1)
      stride(3) = extent(1)*extent(2)
      if (.not. c_associated(given)) return
      call view(given, 3_i8, strides)
      stride = strides(3:1:-1)
      if (any(stride < 0)) then
         call raise(error, invalid_argument, 'symsde_input', 'increment_strides = ['//to_text(strides(1))//', '// &
                    to_text(strides(2))//', '//to_text(strides(3))//'] holds a negative number: give the numbers '// &
                    'between rows, noises and paths, 0 or more')
      else if (any(real(extent - 1, wp)*stride > 2.0_wp**60)) then
         call raise(error, too_large, 'symsde_input', 'increment_strides = ['//to_text(strides(1))//', '// &
                    to_text(strides(2))//', '//to_text(strides(3))//'] reach beyond any memory: give the numbers '// &
                    'between rows, noises and paths')
      end if
   end subroutine take_strides

end module symsde_capi_input
