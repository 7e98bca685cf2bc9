! SPDX-License-Identifier: BSD-3-Clause
!> Tangent maps of whole paths, and Lyapunov exponents: tangent vectors are taken through the exact derivative of every
!> step.
!>
!>    dz_N/dz_0 = F_z(z_{N-1}) .. F_z(z_0),        dz_N/dtheta,        lambda_i = (1/T) sum log R_ii,  v = Q R
!>
!> A long run is cut into pieces, of which each thread keeps the steps of its block; every step is taken once.
module symsde_diagnose_sweep_tangent
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: error_type, stopped
   use symsde_diagnose_sweep_gradient, only: resolve_linear, steps_at_once
   use symsde_diagnose_sweep_sweeper, only: sweep_plan, sweep_observer, end_if_stopped
   use symsde_ensemble_block_initial_state, only: initial_state
   use symsde_ensemble_monitor, only: monitor_type, tell_warnings
   use symsde_ensemble_options, only: run_options
   use symsde_ensemble_run_driver, only: ensemble_type, new_ensemble
   use symsde_ensemble_run_report, only: run_report
   use symsde_model_abstract, only: model_type
   use symsde_noise_given, only: given_increments
   use symsde_scheme_scheme, only: scheme_type
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: path_tangent

contains

   !> Take tangent vectors from the beginning of each path to its end. The last columns of v belong to the parameters,
   !> as many as the wide model has (step/linear/linear_step). With turn > 0 vectors are made orthonormal every `turn`
   !> steps and at the end, and logs has the sums of log R_ii. Errors: as path_gradient.
   subroutine path_tangent(model, wide, scheme, options, from, theta, turn, v, logs, last_q, last_p, status, &
                           failed_step, report, error, dw, monitor)
      class(model_type), intent(in), target :: model, wide
      type(scheme_type), intent(in), target :: scheme
      type(run_options), intent(in) :: options
      type(initial_state), intent(in) :: from
      real(wp), intent(in), target :: theta(:, :)               !! parameters (npath or 1, nparameter)
      integer(i8), intent(in) :: turn                           !! steps between orthonormalisations; 0 for tangent maps
      real(wp), intent(inout), target :: v(:, :, :)             !! dq, then dp (npath, 2 ndof, nvector)
      real(wp), intent(out), target :: logs(:, :)               !! (npath, nvector)
      real(wp), intent(out), target :: last_q(:, :), last_p(:, :)  !! last state (npath, ndof)
      integer(i4), intent(out), target, contiguous :: status(:)             !! 0 = ok (npath)
      integer(i8), intent(out), target, contiguous :: failed_step(:)        !! (npath)
      type(run_report), intent(out) :: report
      type(error_type), allocatable, intent(inout) :: error
      type(given_increments), intent(in) :: dw
      class(monitor_type), intent(inout), optional, target :: monitor
      class(monitor_type), pointer :: teller
      type(monitor_type), target :: none
      type(stepper_task), target :: task
      type(sweep_plan), target :: plan
      type(sweep_observer) :: observer
      type(ensemble_type), target :: ensemble
      type(initial_state) :: start
      type(run_options) :: each
      integer(i8) :: most, begun, many
      integer :: nrate
      logical :: by_position

      call resolve_linear(task, model, wide, scheme, options, from, theta, nrate, by_position, error)
      if (allocated(error)) return
      logs = 0
      status = 0
      failed_step = -1
      teller => none
      if (present(monitor)) teller => monitor
      plan = sweep_plan(task=task, model=model, wide=wide, nrate=nrate, by_position=by_position, &
                        asked=scheme%asks%needed_for(model%traits), t0=options%t0, h=options%step, &
                        first_path=options%first_path, origin=options%first_step, &
                        total=options%nstep, theta=theta, v=v, turn=turn, logs=logs, last_q=last_q, last_p=last_p, &
                        status=status, failed_step=failed_step)
      observer%plan => plan
      most = steps_at_once(options, plan)
      many = 2_i8**max(0, options%refine)   ! rows of increments of a step
      each = options
      each%save_every = 1
      each%nstep = min(most, options%nstep)
      plan%nstep = int(each%nstep)
      call new_ensemble(ensemble, model, scheme, each, from%q, from%p, observer, error, dw%rows(0_i8, each%nstep*many))
      if (.not. allocated(error)) call tell_warnings(teller, ensemble%report%warnings, error)
      start = from
      start%status => status
      start%failed_step => failed_step
      begun = 0
      do
         if (allocated(error)) return
         plan%first = options%first_step + begun
         plan%nstep = int(min(most, options%nstep - begun))
         ensemble%options%first_step = plan%first
         ensemble%options%nstep = plan%nstep
         call ensemble%drive(start, observer, error, dw%rows(begun*many, (begun + plan%nstep)*many), teller)
         begun = begun + plan%nstep
         if (begun >= options%nstep) exit
         call end_if_stopped(plan, options%first_step + begun, ensemble%report%nstopped)
         if (any(status == stopped)) exit
         start%q => last_q
         start%p => last_p
      end do
      report = ensemble%report
   end subroutine path_tangent

end module symsde_diagnose_sweep_tangent
