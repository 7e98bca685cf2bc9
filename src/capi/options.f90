! SPDX-License-Identifier: BSD-3-Clause
!> struct symsde_options and its conversion; run_options alone defines the defaults.
module symsde_capi_options
   use, intrinsic :: iso_c_binding, only: &
      c_double, c_funptr, c_int, c_int32_t, c_int64_t, c_loc, c_null_funptr, c_null_ptr, c_ptr, &
      c_size_t, c_sizeof
   use symsde_base_status, only: error_type
   use symsde_capi_error, only: init_struct, finish, take_struct
   use symsde_capi_monitor, only: callback_monitor, new_callback_monitor
   use symsde_ensemble_options, only: run_options, check_options
   implicit none
   private
   public :: read_options, take_options, symsde_options_init, symsde_options_check

   !> struct symsde_options
   type, bind(c) :: c_options
      integer(c_size_t) :: struct_size
      real(c_double) :: step
      integer(c_int64_t) :: steps
      integer(c_int64_t) :: paths
      integer(c_int64_t) :: seed  ! unsigned in C: the same 64 bits
      real(c_double) :: t0
      integer(c_int64_t) :: save_every
      integer(c_int64_t) :: first_path
      integer(c_int64_t) :: first_step
      integer(c_int32_t) :: refine
      integer(c_int32_t) :: correction
      real(c_double) :: truncation
      real(c_double) :: truncation_time
      integer(c_int32_t) :: compensated
      integer(c_int32_t) :: general
      integer(c_int32_t) :: max_iter
      integer(c_int32_t) :: fixed_point
      integer(c_int32_t) :: lanes
      integer(c_int32_t) :: threads
      type(c_funptr) :: progress
      type(c_ptr) :: progress_user
      real(c_double) :: area_time
      integer(c_int32_t) :: areas
      integer(c_int64_t) :: common_noise  ! unsigned in C: bit k - 1 for noise k
      integer(c_int64_t) :: noise_paths
      integer(c_int32_t) :: damping_noise
      integer(c_int64_t) :: row_paths
   end type c_options

contains

   !> Default options.
   function symsde_options_init(options) result(status) bind(c, name='symsde_options_init')
      type(c_ptr), intent(in), value :: options
      integer(c_int) :: status
      type(c_options), target :: blank

      blank = from_options(run_options())
      status = init_struct(options, 'options', c_loc(blank), c_sizeof(blank))
   end function symsde_options_init

   !> Refuse options as every run does.
   function symsde_options_check(options, error) result(status) bind(c, name='symsde_options_check')
      type(c_ptr), intent(in), value :: options, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(run_options) :: o

      call read_options(options, o, refusal)
      status = finish(refusal, error)
   end function symsde_options_check

   !> Read and check the caller's options, and the function that receives the progress of a diagnosis.
   subroutine read_options(given, options, error, monitor)
      type(c_ptr), intent(in) :: given          !! symsde_options
      type(run_options), intent(out) :: options
      type(error_type), allocatable, intent(inout) :: error
      type(callback_monitor), intent(out), optional :: monitor

      call take_options(given, options, error, monitor)
      if (.not. allocated(error)) call check_options(options, error)
   end subroutine read_options

   !> Read options for procedures that check them themselves, before they read a size in them.
   subroutine take_options(given, options, error, monitor)
      type(c_ptr), intent(in) :: given          !! symsde_options
      type(run_options), intent(out) :: options
      type(error_type), allocatable, intent(inout) :: error
      type(callback_monitor), intent(out), optional :: monitor
      type(c_options), target :: copy

      copy = from_options(run_options())
      call take_struct(given, 'options', c_loc(copy), c_sizeof(copy), error)
      if (allocated(error)) return
      options = to_options(copy)
      if (present(monitor)) call new_callback_monitor(monitor, copy%progress, copy%progress_user)
   end subroutine take_options

   function from_options(o) result(c)
      type(run_options), intent(in) :: o
      type(c_options) :: c

      c%struct_size = c_sizeof(c)
      c%step = o%step
      c%steps = o%nstep
      c%paths = o%npath
      c%seed = o%seed
      c%t0 = o%t0
      c%save_every = o%save_every
      c%first_path = o%first_path
      c%first_step = o%first_step
      c%refine = o%refine
      c%correction = o%correction
      c%truncation = o%truncation
      c%truncation_time = o%truncation_time
      c%area_time = o%area_time
      c%areas = o%areas
      c%common_noise = 0
      c%noise_paths = o%noise_paths
      c%damping_noise = o%damping_noise
      c%row_paths = o%row_paths
      c%compensated = merge(1, 0, o%compensated)
      c%general = merge(1, 0, o%general)
      c%max_iter = o%max_iter
      c%fixed_point = o%fixed_point
      c%lanes = o%nlane
      c%threads = o%nthread
      c%progress = c_null_funptr
      c%progress_user = c_null_ptr
   end function from_options

   function to_options(c) result(o)
      type(c_options), intent(in) :: c
      type(run_options) :: o
      integer :: k, n

      o%step = c%step
      o%nstep = c%steps
      o%npath = c%paths
      o%seed = c%seed
      o%t0 = c%t0
      o%save_every = c%save_every
      o%first_path = c%first_path
      o%first_step = c%first_step
      o%refine = c%refine
      o%correction = c%correction
      o%truncation = c%truncation
      o%truncation_time = c%truncation_time
      o%area_time = c%area_time
      o%noise_paths = c%noise_paths
      o%damping_noise = c%damping_noise
      o%row_paths = c%row_paths
      o%areas = c%areas
      allocate (o%common_noise(popcnt(c%common_noise)))
      n = 0
      do k = 1, bit_size(c%common_noise)
         if (.not. btest(c%common_noise, k - 1)) cycle
         n = n + 1
         o%common_noise(n) = k
      end do
      o%compensated = c%compensated /= 0
      o%general = c%general /= 0
      o%max_iter = c%max_iter
      o%fixed_point = c%fixed_point
      o%nlane = c%lanes
      o%nthread = c%threads
   end function to_options

end module symsde_capi_options
