! SPDX-License-Identifier: BSD-3-Clause
!> Gradients of E f(path) by the exact discrete adjoint of every step.
!>
!> The covectors u = df/dq, c = df/dp at the saved times are carried back by the transposed maps of the steps
!> (step/linear): at the beginning of a path they are the derivatives of f by q0 and p0, beside the derivatives by
!> parameters.
!>
!> A run whose steps fit into `room` for each thread is taken forward once, and back. A longer one is cut into pieces:
!> it is taken forward once with the states between pieces kept; then, from the last piece to the first, each piece is
!> taken forward again, with the same bits, and back.
module symsde_diagnose_sweep_gradient
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_lanes, only: padded, lane_unit
   use symsde_base_memory, only: require_memory
   use symsde_base_status, only: error_type, raise, wrong_shape, incompatible, callback_failed, stopped
   use symsde_base_text, only: to_text
   use symsde_diagnose_sweep_sweeper, only: sweep_plan, sweep_observer, numbers_of_step, rest, end_if_stopped
   use symsde_diagnose_sweep_path_function, only: path_function
   use symsde_diagnose_sweep_probe_wide, only: probe_wide
   use symsde_ensemble_block_initial_state, only: initial_state
   use symsde_ensemble_monitor, only: monitor_type, tell_warnings
   use symsde_ensemble_observe_observer, only: observer_type
   use symsde_ensemble_observe_recorder, only: path_recorder
   use symsde_ensemble_options, only: run_options, check_options, steppers_of
   use symsde_ensemble_run_driver, only: ensemble_type, new_ensemble, run_ensemble, choose_nlane
   use symsde_ensemble_run_report, only: run_report
   use symsde_model_abstract, only: model_type
   use symsde_noise_given, only: given_increments
   use symsde_scheme_scheme, only: scheme_type
   use symsde_step_task, only: resolve_task
   use symsde_step_linear_choice, only: require_linear, new_linear_step
   use symsde_step_linear_linear_step, only: linear_step
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: path_gradient, steps_at_once, resolve_linear

   character(*), parameter :: place = 'path_gradient'
   real(wp), parameter :: room = 7e6_wp/8   !! numbers that a thread may keep of the steps of its block

   !> A run that is cut into pieces.
   type :: long_run
      type(run_options) :: options
      class(model_type), pointer :: model => null()
      type(scheme_type), pointer :: scheme => null()
      class(path_function), pointer :: f => null()
      class(monitor_type), pointer :: monitor => null()
      type(sweep_plan), pointer :: plan => null()
      type(given_increments) :: dw            !! or none
      integer(i8), allocatable :: ends(:)                     !! number of steps before each piece, and of all pieces
      class(ensemble_type), allocatable :: ensemble           !! makes the steps of every piece
   contains
      procedure :: forward
      procedure :: backward
      procedure :: drive
      procedure :: has_ended
      procedure :: rows
   end type long_run

contains

   !> Values of f for each path, and their derivatives by q0, p0 and parameters. The wide model has the parameters as
   !> further positions (step/linear/linear_step); without parameters it may be the model itself. Means over paths are
   !> the gradient of E f. Errors: those of run_ensemble, and models or schemes without exact derivatives.
   subroutine path_gradient(model, wide, scheme, options, from, theta, f, value, u, c, status, failed_step, report, &
                            error, dw, monitor)
      class(model_type), intent(in), target :: model, wide
      type(scheme_type), intent(in), target :: scheme
      type(run_options), intent(in) :: options
      type(initial_state), intent(in) :: from
      real(wp), intent(in), target :: theta(:, :)               !! parameters (npath or 1, nparameter)
      class(path_function), intent(in), target :: f
      real(wp), intent(out), target :: value(:)                 !! f (npath)
      real(wp), intent(out), target :: u(:, :)                  !! df/dq0, then df/dtheta (npath, ndof + nparameter)
      real(wp), intent(out), target :: c(:, :)                  !! df/dp0 (npath, ndof)
      integer(i4), intent(out), target, contiguous :: status(:)             !! 0 = ok (npath)
      integer(i8), intent(out), target, contiguous :: failed_step(:)        !! (npath)
      type(run_report), intent(out) :: report
      type(error_type), allocatable, intent(inout) :: error
      type(given_increments), intent(in) :: dw
      class(monitor_type), intent(inout), optional, target :: monitor
      type(stepper_task), target :: task
      type(sweep_plan), target :: plan
      type(sweep_observer) :: observer
      type(monitor_type), target :: none
      type(long_run), target :: run
      integer :: most, nrate
      logical :: by_position

      call resolve_linear(task, model, wide, scheme, options, from, theta, nrate, by_position, error)
      if (allocated(error)) return
      value = 0
      u = 0
      c = 0
      status = 0
      failed_step = -1
      plan = sweep_plan(task=task, model=model, wide=wide, nrate=nrate, by_position=by_position, &
                        asked=scheme%asks%needed_for(model%traits), t0=options%t0, h=options%step, &
                        first_path=options%first_path, origin=options%first_step, &
                        first=options%first_step, every=options%save_every, theta=theta, u=u, c=c, value=value, &
                        status=status, failed_step=failed_step)
      observer%plan => plan
      run%options = options
      run%options%save_every = 1
      call narrow_blocks(run%options, plan)
      most = steps_at_once(run%options, plan)
      if (options%nstep <= most) then
         plan%nstep = int(options%nstep)
         plan%f => f
         call run_ensemble(model, scheme, run%options, from, observer, report, error, dw, monitor)
         return
      end if
      run%model => model
      run%scheme => scheme
      run%f => f
      run%plan => plan
      run%monitor => none
      if (present(monitor)) run%monitor => monitor
      run%dw = dw
      call cut(options%nstep, options%save_every, most, run%ends)
      call in_pieces(run, from, observer, report, error)
   end subroutine path_gradient

   !> Choose narrower blocks if the steps of a run stay near the processor then, or if all steps fit into memory then: a
   !> second way forward would take longer. Lanes change no bit.
   subroutine narrow_blocks(options, plan)
      type(run_options), intent(inout) :: options
      type(sweep_plan), intent(in) :: plan
      integer, parameter :: handy = 128  !! lanes below which blocks take longer than memory that is further away
      integer, parameter :: least = 64   !! lanes below which blocks take longer than a second way forward
      real(wp), parameter :: near = 2.5e5_wp   !! numbers of a block that stay near
      type(run_options) :: narrower

      if (options%nlane /= 0) return
      options%nlane = choose_nlane(options, plan%model)
      do while (options%nlane >= 2*handy .and. real(options%nstep, wp)*options%nlane*numbers_of_step(plan) > near)
         options%nlane = padded(options%nlane/2)
      end do
      narrower = options
      do while (narrower%nlane >= 2*least .and. options%nstep > steps_at_once(narrower, plan))
         narrower%nlane = padded(narrower%nlane/2)
      end do
      if (options%nstep <= steps_at_once(narrower, plan)) options%nlane = narrower%nlane
   end subroutine narrow_blocks

   !> Number of steps of its block that a thread keeps.
   pure integer function steps_at_once(options, plan)
      type(run_options), intent(in) :: options
      type(sweep_plan), intent(in) :: plan

      steps_at_once = int(room/(real(padded(choose_nlane(options, plan%model)), wp)*numbers_of_step(plan)))
      steps_at_once = max(rest, steps_at_once)
   end function steps_at_once

   !> Resolve the task of a run. Refused are models and schemes without exact derivatives, wide models that are not the
   !> model, compensated sums, and a wrong number of parameters or of their rows.
   subroutine resolve_linear(task, model, wide, scheme, options, from, theta, nrate, by_position, error)
      type(stepper_task), intent(out) :: task
      class(model_type), intent(in), target :: model, wide
      type(scheme_type), intent(in), target :: scheme
      type(run_options), intent(in) :: options
      type(initial_state), intent(in) :: from
      real(wp), intent(in) :: theta(:, :)   !! parameters (npath or 1, nparameter)
      integer, intent(out) :: nrate         !! rates of damping that derivatives are by: none, or all
      logical, intent(out) :: by_position   !! steps are linearised without the momenta of the path
      type(error_type), allocatable, intent(inout) :: error
      class(linear_step), allocatable :: step

      nrate = 0
      by_position = .false.
      if (allocated(error)) return
      call check_options(options, error)
      if (allocated(error)) return
      call resolve_task(task, model, scheme, steppers_of(options), error)
      if (size(theta, 2) == wide%traits%ndof) nrate = model%traits%ndof
      call require_linear(task, wide, nrate, options%step, error)
      if (allocated(error)) return
      call new_linear_step(step, task, model, wide, nrate, options%step, lane_unit)
      by_position = step%by_position
      if (size(theta, 1) > 0 .and. size(theta, 2) == wide%traits%ndof - model%traits%ndof + nrate) then
         call probe_wide(model, wide, options%t0, from%q(1, :), from%p(1, :), &
                         theta(1, :wide%traits%ndof - model%traits%ndof), error)
         call step%check(theta(1, :), options%t0, options%step, error)
      end if
      if (allocated(error)) return
      associate (needed => wide%traits%ndof - model%traits%ndof + nrate)
         if (options%compensated) then
            call raise(error, incompatible, place, 'compensated sums have the derivatives of plain ones: leave '// &
                       'compensated out')
         else if (size(theta, 2) /= needed .or. .not. any(size(theta, 1, i8) == [1_i8, options%npath])) then
            call raise(error, wrong_shape, place, 'there are '//to_text(size(theta, 2))//' parameters for '// &
                       to_text(size(theta, 1))//' paths; needed are '//to_text(needed)//', and '// &
                       to_text(model%traits%ndof)//' more for derivatives by rates of damping, for one or '// &
                       to_text(options%npath)//' paths')
         end if
      end associate
   end subroutine resolve_linear

   !> Take all pieces forward, then each piece back, the last one first.
   subroutine in_pieces(run, from, observer, report, error)
      type(long_run), intent(inout), target :: run
      type(initial_state), intent(in) :: from
      type(sweep_observer), intent(in) :: observer
      type(run_report), intent(out) :: report
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable, target, dimension(:, :, :) :: ends_q, ends_p  !! states before pieces (npath, ndof, :)
      real(wp), allocatable, target, dimension(:, :, :) :: fq, fp          !! df/dq, df/dp (npath, ndof, 0:nsave)
      integer(i8) :: nsave
      integer :: npiece

      npiece = size(run%ends) - 1
      associate (npath => run%options%npath, n => run%model%traits%ndof, plan => run%plan)
         nsave = run%options%nstep/plan%every
         call require_memory(real(npath, wp)*n*(2.0_wp*npiece + 6.0_wp*(nsave + 1)), 'states of '//to_text(npath)// &
                             ' paths between pieces and at saved times', 'give fewer paths at once', place, error)
         if (allocated(error)) return
         allocate (ends_q(npath, n, npiece + 1), ends_p(npath, n, npiece + 1))
         allocate (fq(npath, n, 0:nsave), fp(npath, n, 0:nsave))
         plan%fq => fq
         plan%fp => fp
         run%options%nstep = maxval(run%ends(2:) - run%ends(:npiece))
         plan%nstep = int(run%options%nstep)
         allocate (run%ensemble)
         call new_ensemble(run%ensemble, run%model, run%scheme, run%options, from%q, from%p, observer, error, &
                           run%rows(0_i8, run%options%nstep))
         if (.not. allocated(error)) call tell_warnings(run%monitor, run%ensemble%report%warnings, error)
      end associate
      if (allocated(error)) return
      call repeat_rows(from%q, ends_q(:, :, 1))
      call repeat_rows(from%p, ends_p(:, :, 1))
      call run%forward(ends_q, ends_p, fq, fp, error)
      call run%backward(ends_q, ends_p, observer, error)
      if (allocated(error)) return
      report = run%ensemble%report
      if (run%f%failure_code() /= 0) report%status = callback_failed
   end subroutine in_pieces

   !> Take all pieces forward: states between them, values of f and its derivatives.
   subroutine forward(self, ends_q, ends_p, fq, fp, error)
      class(long_run), intent(inout), target :: self
      real(wp), intent(inout), target, contiguous :: ends_q(:, :, :), ends_p(:, :, :)   !! (npath, ndof, npiece + 1)
      real(wp), intent(out) :: fq(:, :, 0:), fp(:, :, 0:)                               !! (npath, ndof, 0:nsave)
      type(error_type), allocatable, intent(inout) :: error
      type(path_recorder) :: recorder
      real(wp), allocatable, dimension(:, :, :) :: q, p            !! states at saved times
      real(wp), allocatable, target, dimension(:, :, :) :: x, y    !! states of one piece
      real(wp), allocatable :: t(:), ftheta(:, :)
      integer(i8) :: k, at, each
      integer :: i, n, npath

      npath = size(ends_q, 1)
      n = size(ends_q, 2)
      allocate (q(npath, n, 0:ubound(fq, 3)), p(npath, n, 0:ubound(fq, 3)), t(0:ubound(fq, 3)))
      q(:, :, 0) = ends_q(:, :, 1)
      p(:, :, 0) = ends_p(:, :, 1)
      associate (plan => self%plan, ends => self%ends)
         recorder%first_path = plan%first_path
         recorder%status => plan%status
         recorder%failed_step => plan%failed_step
         do i = 1, size(ends) - 1
            each = min(plan%every, ends(i + 1) - ends(i))
            allocate (x(npath, n, 0:(ends(i + 1) - ends(i))/each), y(npath, n, 0:(ends(i + 1) - ends(i))/each))
            recorder%q(1:, 1:, 1:) => x  ! counted from 1
            recorder%p(1:, 1:, 1:) => y
            recorder%last_q => ends_q(:, :, i + 1)
            recorder%last_p => ends_p(:, :, i + 1)
            call self%drive(i, each, ends_q(:, :, i), ends_p(:, :, i), recorder, error)
            if (self%has_ended(error)) return
            do k = 1, size(x, 3) - 1
               at = ends(i) + k*each
               if (mod(at, plan%every) /= 0) cycle
               q(:, :, at/plan%every) = x(:, :, k)
               p(:, :, at/plan%every) = y(:, :, k)
            end do
            deallocate (x, y)
         end do
         do k = 0, ubound(fq, 3)
            t(k) = plan%t0 + real(plan%origin + k*plan%every, wp)*plan%h
         end do
         allocate (ftheta(npath, size(plan%theta, 2)))
         call self%f%find(plan%first_path, npath, n, size(t), size(ftheta, 2), t, q, p, plan%value, fq, fp, ftheta)
         plan%u(:, n + 1:) = ftheta
      end associate
   end subroutine forward

   !> Take covectors back over all pieces, each of which is taken forward again.
   subroutine backward(self, ends_q, ends_p, observer, error)
      class(long_run), intent(inout), target :: self
      real(wp), intent(in), target, contiguous :: ends_q(:, :, :), ends_p(:, :, :)   !! (npath, ndof, npiece + 1)
      type(sweep_observer), intent(in) :: observer
      type(error_type), allocatable, intent(inout) :: error
      integer :: i

      do i = size(self%ends) - 1, 1, -1
         if (self%has_ended(error)) return
         self%plan%first = self%plan%origin + self%ends(i)
         self%plan%nstep = int(self%ends(i + 1) - self%ends(i))
         call self%drive(i, 1_i8, ends_q(:, :, i), ends_p(:, :, i), observer, error)
      end do
   end subroutine backward

   !> Whether no further piece follows: after an error, a stop, or a failure of f.
   logical function has_ended(self, error)
      class(long_run), intent(in) :: self
      type(error_type), allocatable, intent(in) :: error

      has_ended = allocated(error) .or. self%f%failure_code() /= 0 .or. any(self%plan%status == stopped)
   end function has_ended

   !> Take the steps of piece i from the states before it.
   subroutine drive(self, i, each, q, p, observer, error)
      class(long_run), intent(inout), target :: self
      integer, intent(in) :: i
      integer(i8), intent(in) :: each                    !! steps between shown states
      real(wp), intent(in), target :: q(:, :), p(:, :)   !! (npath, ndof)
      class(observer_type), intent(in) :: observer
      type(error_type), allocatable, intent(inout) :: error
      type(initial_state) :: start

      start%q => q
      start%p => p
      start%status => self%plan%status
      start%failed_step => self%plan%failed_step
      associate (ensemble => self%ensemble)
         ensemble%options%first_step = self%plan%origin + self%ends(i)
         ensemble%options%nstep = self%ends(i + 1) - self%ends(i)
         ensemble%options%save_every = each
         call ensemble%drive(start, observer, error, self%rows(self%ends(i), self%ends(i + 1)), self%monitor)
         call end_if_stopped(self%plan, self%plan%origin + self%ends(i + 1), ensemble%report%nstopped)
      end associate
   end subroutine drive

   !> The prescribed increments of steps a + 1 .. b, or none.
   function rows(self, a, b)
      class(long_run), intent(in) :: self
      integer(i8), intent(in) :: a, b
      type(given_increments) :: rows
      integer(i8) :: many

      many = 2_i8**max(0, self%options%refine)   ! rows of a step
      rows = self%dw%rows(a*many, b*many)
   end function rows

   !> Cut nstep steps into pieces of at most `most`, which end at saved times or lie between two.
   subroutine cut(nstep, every, most, ends)
      integer(i8), intent(in) :: nstep, every
      integer, intent(in) :: most
      integer(i8), allocatable, intent(out) :: ends(:)   !! 0, the ends of all pieces but the last, nstep
      integer(i8) :: length, k

      ends = [0_i8]
      if (every <= most) then
         length = most/every*every
         do k = length, nstep - 1, length
            ends = [ends, k]
         end do
         ends = [ends, nstep]
      else
         length = most/rest*rest   ! a multiple of the steps between rests of a sweep
         do k = 1, nstep
            if (mod(mod(k, every), length) == 0) ends = [ends, k]
         end do
      end if
   end subroutine cut

   !> Repeat one row for all paths, or copy all rows.
   pure subroutine repeat_rows(x, all_rows)
      real(wp), intent(in) :: x(:, :)          !! (npath or 1, ndof)
      real(wp), intent(out) :: all_rows(:, :)  !! (npath, ndof)
      integer :: i

      do i = 1, size(x, 2)
         if (size(x, 1) == 1) then
            all_rows(:, i) = x(1, i)
         else
            all_rows(:, i) = x(:, i)
         end if
      end do
   end subroutine repeat_rows

end module symsde_diagnose_sweep_gradient
