! SPDX-License-Identifier: BSD-3-Clause
!> violate AREA: breaks the contract of this area of src once, and `violate options` the contract of ensemble in another
!> way. `violate none` breaks no contract.
!>
!> Where contracts are executed, the program ends with the sentence of the broken contract. Elsewhere the program runs
!> to its end, because the broken inputs are harmless: a NaN in one lane, a status that no caller reads.
!>
!> `violate executed` says whether contracts are executed in this build.
program violate
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use symsde_base_contracts, only: contracts_are_executed
   use symsde_base_counters, only: counters_type
   use symsde_base_functionals, only: functional_set
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_request, step_store, steps_record, new_step_store
   use symsde_base_status, only: error_type
   use symsde_diagnose_symplecticity, only: symplecticity_defect
   use symsde_ensemble_block_runner, only: block_runner, new_block_runner
   use symsde_ensemble_observe_recorder, only: path_recorder
   use symsde_ensemble_options, only: run_options
   use symsde_ensemble_run_driver, only: ensemble_type, new_ensemble
   use symsde_model_catalogue_kubo, only: kubo_model, new_kubo
   use symsde_noise_brownian, only: brownian_noise, new_brownian_noise
   use symsde_scheme_catalogue, only: get_scheme
   use symsde_scheme_composition, only: composed_scheme
   use symsde_scheme_scheme, only: scheme_type
   use symsde_solve_blocks, only: block_solver, new_block_solver
   use symsde_step_block_state, only: lane_state, passed_states, new_lane_state
   use symsde_step_factory, only: stepper_options, new_stepper
   use symsde_step_stepper, only: stepper_type
   implicit none
   integer, parameter :: nlane = 8
   character(len=16) :: area

   call get_command_argument(1, area)
   if (area == 'executed') then
      print '(l1)', contracts_are_executed
      stop
   end if
   call noise(area == 'noise')
   call model(area == 'model')
   call scheme(area == 'scheme')
   call solve(area == 'solve')
   call step(area == 'step')
   call ensemble(area == 'ensemble')
   call options(area == 'options')
   call diagnose(area == 'diagnose')
   print '(a)', 'came to its end'

contains

   subroutine stop_at(error)
      type(error_type), allocatable, intent(in) :: error

      if (.not. allocated(error)) return
      print '(a)', error%message
      error stop 3
   end subroutine stop_at

   !> NaN if the contract is to be broken, else x.
   real(wp) function spoiled(broken, x)
      logical, intent(in) :: broken
      real(wp), intent(in) :: x

      spoiled = x
      if (broken) spoiled = ieee_value(x, ieee_quiet_nan)
   end function spoiled

   subroutine oscillator(of, stepper)
      type(kubo_model), intent(out), target :: of
      class(stepper_type), allocatable, intent(out) :: stepper
      type(scheme_type) :: midpoint
      type(error_type), allocatable :: error

      call new_kubo(of, 1.0_wp, 0.3_wp, error)
      call get_scheme(midpoint, 'midpoint', error)
      call stop_at(error)
      call new_stepper(stepper, of, midpoint, stepper_options(general=.true.), nlane, error)
      call stop_at(error)
   end subroutine oscillator

   !> Broken: the padding lane has path 7 instead of repeating the last real path.
   subroutine noise(broken)
      logical, intent(in) :: broken
      type(brownian_noise) :: source
      type(step_request) :: request
      type(step_store) :: store
      type(functional_set) :: nothing
      type(error_type), allocatable :: error
      integer(i8) :: drawn

      call new_brownian_noise(source, 1, 1_i8, 0.1_wp, 0, [.false.], error)
      call stop_at(error)
      call new_step_store(store, nlane, 1, 2, 0.1_wp, nothing)
      request%nlane = nlane
      request%nreal = 5
      request%path = [0_i8, 1_i8, 2_i8, 3_i8, 4_i8, 4_i8, 4_i8, merge(7_i8, 4_i8, broken)]
      call source%fill(request, store, drawn)
   end subroutine noise

   !> Broken: a weight is NaN.
   subroutine model(broken)
      logical, intent(in) :: broken
      type(kubo_model), target :: kubo
      class(stepper_type), allocatable :: stepper
      real(wp) :: w(nlane, 0:1), q(nlane, 1), p(nlane, 1), hq(nlane, 1), hp(nlane, 1)

      call oscillator(kubo, stepper)
      w = 0.1_wp
      w(3, 1) = spoiled(broken, 0.1_wp)
      q = 1
      p = 0
      call stepper%ham%gradient(0.0_wp, w, q, p, hq, hp)
   end subroutine model

   !> Broken: a node of a composition's part is NaN.
   subroutine scheme(broken)
      logical, intent(in) :: broken
      type(scheme_type) :: parts(2), whole
      type(error_type), allocatable :: error

      call get_scheme(parts(1), 'midpoint', error)
      call get_scheme(parts(2), 'gauss2', error)
      call stop_at(error)
      parts(2)%c(1) = spoiled(broken, parts(2)%c(1))
      call composed_scheme(whole, parts, [0.5_wp, 0.5_wp], 'both', error)
      call stop_at(error)
   end subroutine scheme

   !> Broken: a lane has a status that no path can have.
   subroutine solve(broken)
      logical, intent(in) :: broken
      type(block_solver) :: solver
      real(wp) :: a(nlane, 3, 3), x(nlane, 3)
      integer(i8) :: status(nlane)
      integer :: i

      call new_block_solver(solver, nlane, 3, -1, -1)
      a = 0
      do i = 1, 3
         a(:, i, i) = 2
      end do
      x = 1
      status = 0
      if (broken) status(2) = 99
      call solver%solve(a, x, status == 0, status)
   end subroutine solve

   !> Broken: the state of a lane that has not failed is NaN.
   subroutine step(broken)
      logical, intent(in) :: broken
      type(kubo_model), target :: kubo
      class(stepper_type), allocatable :: stepper
      type(step_store), target :: store
      type(functional_set) :: nothing
      type(steps_record) :: steps
      type(lane_state) :: state
      type(passed_states) :: passed
      integer :: ntaken
      logical :: failed

      call oscillator(kubo, stepper)
      call new_step_store(store, nlane, 1, 2, 0.1_wp, nothing)
      call store%show_several(0, 2, 0.0_wp, steps)
      steps%nreal = nlane
      steps%every = 2
      call new_lane_state(state, nlane, 1, .false.)
      state%q = 1
      state%p = 0
      state%q(4, 1) = spoiled(broken, 1.0_wp)
      allocate (passed%q(nlane, 1, 0), passed%p(nlane, 1, 0))
      call stepper%advance(steps, state, passed, ntaken, failed)
   end subroutine step

   !> Broken: a block is given more real paths than it has lanes.
   subroutine ensemble(broken)
      logical, intent(in) :: broken
      type(kubo_model), target :: kubo
      class(stepper_type), allocatable :: stepper
      type(block_runner) :: runner
      type(functional_set) :: nothing
      integer(i8) :: path(nlane)
      integer :: i

      call oscillator(kubo, stepper)
      call new_block_runner(runner, run_options(step=0.1_wp, nstep=2_i8, npath=8_i8), nlane, stepper, nothing)
      path = [(int(i, i8), i=0, nlane - 1)]
      call runner%begin_with(0_i8, merge(nlane + 1, nlane, broken), path)
   end subroutine ensemble

   !> Broken: an ensemble is made with options that no procedure for users has checked. Areas are not drawn here.
   subroutine options(broken)
      logical, intent(in) :: broken
      type(kubo_model), target :: kubo
      class(stepper_type), allocatable :: unused
      type(scheme_type), target :: midpoint
      type(ensemble_type), target :: made
      type(error_type), allocatable :: error
      real(wp), parameter :: one(1, 1) = 1

      call oscillator(kubo, unused)
      call get_scheme(midpoint, 'midpoint', error)
      call new_ensemble(made, kubo, midpoint, run_options(step=0.1_wp, area_time=merge(-1.0_wp, 0.0_wp, broken)), &
                        one, one, path_recorder(), error)
      call stop_at(error)
   end subroutine options

   !> Broken: dZ is NaN, though the scheme does not use dZ.
   subroutine diagnose(broken)
      logical, intent(in) :: broken
      type(kubo_model), target :: kubo
      type(scheme_type) :: midpoint
      type(error_type), allocatable :: error
      real(wp) :: x(1, 1), defect(1)

      x = 0.1_wp
      call new_kubo(kubo, 1.0_wp, 0.3_wp, error)
      call get_scheme(midpoint, 'midpoint', error)
      call symplecticity_defect(kubo, midpoint, run_options(step=0.1_wp, nstep=1_i8), x, x, x, defect, error, &
                                dz=x*spoiled(broken, 1.0_wp))
      call stop_at(error)
      if (.not. abs(defect(1)) < 1e-10_wp) error stop 4
   end subroutine diagnose

end program violate
