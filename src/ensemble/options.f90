! SPDX-License-Identifier: BSD-3-Clause
!> The options of a run, with their defaults, and the check of every option.
module symsde_ensemble_options
   use symsde_base_area_rule, only: areas_by_path, areas_in_law
   use symsde_base_damping, only: noise_of_scheme, noise_polynomial
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lane_unit
   use symsde_base_status, only: error_type, raise, invalid_argument, incompatible, too_large
   use symsde_base_text, only: to_text
   use symsde_noise_brownian, only: max_refine
   use symsde_solve_newton, only: newton_options, check_newton
   use symsde_step_factory, only: stepper_options
   implicit none
   private
   public :: run_options, noise_path, check_options, saved_count, steppers_of, time_rounding, latest_time, max_nlane

   integer, parameter :: max_nlane = 4096            !! most lanes of a block
   integer(i8), parameter :: max_index = 2_i8**47    !! bound of paths and of fine steps: 48-bit counters
   type(stepper_options), parameter :: stepper = stepper_options()  !! defaults of steppers and solvers

   !> Everything is dimensionless except the step and times, which are in the model's unit of time.
   type :: run_options
      real(wp) :: step = 0                  !! h, may be negative, never zero [time]
      integer(i8) :: nstep = 0              !! steps, a multiple of save_every
      integer(i8) :: npath = 1              !! paths
      integer(i8) :: seed = 0               !! all 64 bits are the key of the generator
      real(wp) :: t0 = 0                    !! time of step 0 [time]
      integer(i8) :: save_every = 1         !! steps between saved points
      integer :: refine = 0                 !! l > 0: a step is the sum of 2^l draws; l < 0: Brownian bridge
      integer(i8) :: first_path = 0         !! global index of the first path
      integer(i8) :: noise_paths = 0        !! n > 0: path first + i has the noise of path first + mod(i, n)
      integer(i8) :: row_paths = 1          !! n: path first + i has row i/n of parameters that differ by path
      integer(i8) :: first_step = 0         !! index n of the first step, at t0 + n h; chooses its noise
      integer :: correction = stepper%correction
      real(wp) :: truncation = 0            !! order l of truncated increments, 0 = none
      real(wp) :: truncation_time = 0       !! time scale tau of the truncation [time]
      integer :: areas = areas_by_path      !! how areas are drawn: a parameter of base/area_rule
      real(wp) :: area_time = 0             !! time scale of areas, 0 = derived from the model [time]
      integer, allocatable :: common_noise(:) !! noises k that all paths share: W_k of path 0 (not allocated = none)
      integer :: damping_noise = stepper%damping_noise  !! noise of damped kicks, see base/damping: noise_path, ..
      logical :: compensated = .false.      !! compensated summation of the state
      logical :: general = stepper%general  !! use the oracle of the scheme
      integer :: max_iter = stepper%newton%max_iter        !! most Newton iterations a step
      integer :: fixed_point = stepper%newton%fixed_point  !! n > 0: n fixed-point iterations instead of Newton
      integer :: nlane = 0                  !! lanes of a block, a multiple of 8; 0 = chosen; never changes a result
      integer :: nthread = 0                !! threads; 0 = SYMSDE_NUM_THREADS, else OpenMP's default
   end type run_options

contains

   !> The options of a run that its steppers need.
   pure type(stepper_options) function steppers_of(options) result(choice)
      type(run_options), intent(in) :: options

      choice%correction = options%correction
      choice%damping_noise = options%damping_noise
      choice%general = options%general
      choice%newton%max_iter = options%max_iter
      choice%newton%fixed_point = options%fixed_point
      choice%as_increments = options%compensated
      choice%step = options%step
   end function steppers_of

   !> The number of saved times of a run, the beginning included.
   pure integer(i8) function saved_count(options)
      type(run_options), intent(in) :: options   !! checked

      saved_count = options%nstep/options%save_every + 1
   end function saved_count

   !> The index of the path whose noise drives a path.
   elemental integer(i8) function noise_path(o, path)
      type(run_options), intent(in) :: o
      integer(i8), intent(in) :: path  !! global index

      noise_path = path
      if (o%noise_paths > 0) noise_path = o%first_path + modulo(path - o%first_path, o%noise_paths)
   end function noise_path

   !> Largest rounding of t0 + n h as a fraction of a step: of n h, and of the sum.
   pure real(wp) function time_rounding(o)
      type(run_options), intent(in) :: o

      time_rounding = spacing(abs(o%t0/o%step) + (real(o%first_step, wp) + real(o%nstep, wp)))
   end function time_rounding

   !> The time of a run that is farthest from 0 [time].
   pure real(wp) function latest_time(o)
      type(run_options), intent(in) :: o

      latest_time = o%t0 + (real(o%first_step, wp) + real(o%nstep, wp))*o%step
      if (abs(o%t0) > abs(latest_time)) latest_time = o%t0
   end function latest_time

   !> Refuse options that cannot be run: the message names the value and the allowed values. Every procedure that users
   !> call calls this once, before it reads a size in its options. Procedures below take options that were checked
   !> (ensemble/contract).
   subroutine check_options(o, error)
      type(run_options), intent(in) :: o
      type(error_type), allocatable, intent(inout) :: error

      if (.not. abs(o%step) <= huge(o%step) .or. .not. abs(o%step) > 0) then
         call refuse('step = '//to_text(o%step)//' is not a step size: give a finite number that is not zero')
      else if (.not. abs(o%t0) <= huge(o%t0)) then
         call refuse('t0 = '//to_text(o%t0)//' is not a time: give a finite number')
      else if (o%nstep < 0) then
         call refuse('steps = '//to_text(o%nstep)//' is negative: give 0 or more steps')
      else if (o%npath < 1) then
         call refuse('paths = '//to_text(o%npath)//' is not a number of paths: give at least 1')
      else if (o%save_every < 1) then
         call refuse('save_every = '//to_text(o%save_every)//' is not a number of steps: give at least 1')
      else if (mod(o%nstep, o%save_every) /= 0) then
         call refuse('steps = '//to_text(o%nstep)//' is not a multiple of save_every = '// &
                     to_text(o%save_every)//': the last saved point would be missed; change one of the two')
      else if (o%noise_paths < 0) then
         call refuse('noise_paths = '//to_text(o%noise_paths)//' is not a number of paths: give 1 or more, or 0 '// &
                     'for noise of its own for each path')
      else if (o%row_paths < 1) then
         call refuse('row_paths = '//to_text(o%row_paths)//' is not a number of paths with the same parameters: '// &
                     'give 1 or more')
      else if (o%first_path < 0 .or. o%first_step < 0) then
         call refuse('first_path = '//to_text(o%first_path)//', first_step = '//to_text(o%first_step)// &
                     ': both count from 0, give 0 or more for each')
      else if (o%first_path > max_index - o%npath) then
         call raise(error, too_large, 'check_options', 'first_path + paths exceeds 2^47 = '// &
                    to_text(max_index)//', the range of the path counter: give fewer paths')
      else if (o%first_step > max_index - o%nstep .or. &
               (real(o%first_step, wp) + real(o%nstep, wp))*2.0_wp**max(0, o%refine) > real(max_index, wp)) then
         call raise(error, too_large, 'check_options', '(first_step + steps)*2^refine exceeds 2^47 = '// &
                    to_text(max_index)//', the range of the step counter: give fewer steps or levels')
      else if (o%refine < -max_refine .or. o%refine > max_refine) then
         call refuse('refine = '//to_text(o%refine)//' is out of range: give -'//to_text(max_refine)//' to '// &
                     to_text(max_refine)//', each level doubles the number of draws')
      else if (.not. abs(latest_time(o)) <= huge(o%t0)) then
         call refuse('t0 + (first_step + steps)*step is not a time: give fewer or smaller steps')
      else if (.not. time_rounding(o) <= 0.5_wp) then
         call refuse('step = '//to_text(o%step)//' is lost in times near '//to_text(latest_time(o))//', where '// &
                     'numbers are '//to_text(spacing(latest_time(o)))//' apart: give a longer step, or a t0 near 0')
      else if (o%nlane < 0 .or. mod(o%nlane, lane_unit) /= 0 .or. o%nlane > max_nlane) then
         call refuse('block size '//to_text(o%nlane)//' is not allowed: give a multiple of 8 up to '// &
                     to_text(max_nlane)//', or 0 to have it chosen (it never changes a result)')
      else if (.not. (o%area_time >= 0 .and. o%area_time <= huge(o%area_time))) then
         call refuse('area_time = '//to_text(o%area_time)//' is not a time scale: give a positive time, or 0 to '// &
                     'have it derived from the model')
      else if (o%areas /= areas_by_path .and. o%areas /= areas_in_law) then
         call refuse('areas = '//to_text(o%areas)//' is no way to draw areas: give 0 (by the path) or 1 (in law)')
      else if (o%areas == areas_in_law .and. o%area_time > 0) then
         call raise(error, incompatible, 'check_options', 'area_time = '//to_text(o%area_time)//' says how finely '// &
                    'areas follow the path, and areas in law follow none: give one of the two')
      else if (o%areas == areas_in_law .and. o%refine < 0) then
         call raise(error, incompatible, 'check_options', 'refine = '//to_text(o%refine)//' halves the path of '// &
                    'longer steps, and areas in law belong to no path that could be halved: give refine >= 0, or '// &
                    'areas by the path')
      else if (o%damping_noise < noise_of_scheme .or. o%damping_noise > noise_polynomial) then
         call refuse('damping_noise = '//to_text(o%damping_noise)//' is no noise of damped kicks: give 0 (its '// &
                     'law), 1 (law2), 2 (law3), 3 (that of the path) or 4 (polynomial weights)')
      else if (o%nthread < 0 .or. o%nthread > 1024) then
         call refuse('threads = '//to_text(o%nthread)//' is out of range: give 1 to 1024, or 0 for the default')
      else
         call check_newton(newton_options(max_iter=o%max_iter, fixed_point=o%fixed_point), error)
      end if

   contains

      subroutine refuse(message)
         character(*), intent(in) :: message

         call raise(error, invalid_argument, 'check_options', message)
      end subroutine refuse

   end subroutine check_options

end module symsde_ensemble_options
