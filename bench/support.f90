! SPDX-License-Identifier: BSD-3-Clause
!> What the benchmark programs share: the clock, medians, and runs of the library by name.
module bench_support
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type
   use symsde_ensemble_options, only: run_options
   use symsde_ensemble_run_report, only: run_report
   use symsde_ensemble_run_simulate, only: paths_type, moments_type, simulate, moments
   use symsde_model_abstract, only: model_type
   use symsde_model_catalogue_by_name, only: get_model
   use symsde_scheme_catalogue, only: get_scheme
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: seconds, processor_seconds, median, scene_type, new_scene, run_paths, run_moments, integer_argument
   public :: stop_on, print_times

   !> A model, a scheme and an initial state for all paths.
   type :: scene_type
      class(model_type), allocatable :: model
      type(scheme_type) :: scheme
      type(run_options) :: options
      real(wp), allocatable :: q0(:), p0(:)
   end type scene_type

contains

   real(wp) function seconds()
      integer(i8) :: ticks, rate

      call system_clock(ticks, rate)
      seconds = real(ticks, wp)/real(rate, wp)
   end function seconds

   !> Processor time of this process: what else runs on the machine disturbs it little.
   real(wp) function processor_seconds()
      call cpu_time(processor_seconds)
   end function processor_seconds

   pure real(wp) function median(x)
      real(wp), intent(in) :: x(:)
      real(wp) :: sorted(size(x)), least
      integer :: i, at

      sorted = x
      do i = 1, size(x) - 1
         at = i - 1 + minloc(sorted(i:), 1)
         least = sorted(at)
         sorted(at) = sorted(i)
         sorted(i) = least
      end do
      median = 0.5_wp*(sorted((size(x) + 1)/2) + sorted(size(x)/2 + 1))
   end function median

   !> One line: word, name, median, least, largest.
   subroutine print_times(word, name, times)
      character(*), intent(in) :: word, name
      real(wp), intent(in) :: times(:)

      print '(a, 1x, a, 3(1x, es12.5))', word, name, median(times), minval(times), maxval(times)
   end subroutine print_times

   !> A built-in model under a scheme, from q = 1, p = 0, on one thread, saved at its end only.
   subroutine new_scene(scene, model, keys, values, scheme, step)
      type(scene_type), intent(out) :: scene
      character(*), intent(in) :: model, keys(:), scheme
      real(wp), intent(in) :: values(:), step
      type(error_type), allocatable :: error

      call get_model(scene%model, model, keys, values, error)
      call get_scheme(scene%scheme, scheme, error)
      call stop_on(error)
      scene%options%step = step
      scene%options%seed = 1
      scene%options%nthread = 1
      allocate (scene%q0(scene%model%traits%ndof), source=1.0_wp)
      allocate (scene%p0(scene%model%traits%ndof), source=0.0_wp)
   end subroutine new_scene

   !> Integrate and save paths every save_every steps (0: the end only).
   subroutine run_paths(scene, npath, nstep, save_every, run)
      type(scene_type), intent(inout) :: scene
      integer(i8), intent(in) :: npath, nstep, save_every
      type(paths_type), intent(out) :: run
      type(error_type), allocatable :: error

      call set_sizes(scene%options, npath, nstep, save_every)
      call simulate(scene%model, scene%scheme, scene%options, scene%q0, scene%p0, run, error)
      call stop_on(error)
   end subroutine run_paths

   !> Integrate and keep moments every save_every steps (0: the end only).
   subroutine run_moments(scene, npath, nstep, save_every, report)
      type(scene_type), intent(inout) :: scene
      integer(i8), intent(in) :: npath, nstep, save_every
      type(run_report), intent(out) :: report
      type(moments_type) :: result
      type(error_type), allocatable :: error

      call set_sizes(scene%options, npath, nstep, save_every)
      call moments(scene%model, scene%scheme, scene%options, scene%q0, scene%p0, result, error)
      call stop_on(error)
      report = result%report
   end subroutine run_moments

   pure subroutine set_sizes(options, npath, nstep, save_every)
      type(run_options), intent(inout) :: options
      integer(i8), intent(in) :: npath, nstep, save_every

      options%npath = npath
      options%nstep = nstep
      options%save_every = merge(max(nstep, 1_i8), save_every, save_every == 0)
   end subroutine set_sizes

   subroutine stop_on(error)
      type(error_type), allocatable, intent(in) :: error

      if (.not. allocated(error)) return
      print '(a)', error%message
      error stop 1
   end subroutine stop_on

   !> Argument number i of the command, or its default.
   integer(i8) function integer_argument(i, default)
      integer, intent(in) :: i
      integer(i8), intent(in) :: default
      character(len=32) :: text
      integer :: info

      integer_argument = default
      call get_command_argument(i, text, status=info)
      if (info /= 0 .or. len_trim(text) == 0) return
      read (text, *, iostat=info) integer_argument
      if (info == 0) return
      print '(a)', trim(text)//' is not an integer'
      error stop 2
   end function integer_argument

end module bench_support
