! SPDX-License-Identifier: BSD-3-Clause
!> What scenes leave out, by the library's counters: a table and a verdict for each claim.
!>
!> Lines: counters NAME MODEL SCHEME STEPPER-in-quotes and, per path-step, normals, gradients,
!> Hessians, iterations, solves; then ok or FAILED. Ends with status 1 if any has failed.
program bench_counters
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_ensemble_run_simulate, only: paths_type
   use bench_support, only: scene_type, new_scene, run_paths
   implicit none
   logical :: good

   good = .true.
   call check('explicit_calls_no_solver', 'additive_oscillator', [character(6) ::], [real(wp) ::], &
              'symplectic_euler')
   call check('explicit_calls_no_solver', 'additive_oscillator', [character(6) ::], [real(wp) ::], &
              'symplectic_euler_adjoint')
   call check('explicit_calls_no_solver', 'synchrotron', [character(6) ::], [real(wp) ::], &
              'symplectic_euler')
   call check('explicit_calls_no_solver', 'synchrotron', [character(6) ::], [real(wp) ::], &
              'stormer_verlet')
   call check('explicit_calls_no_solver', 'fpu_chain', [character(6) ::], [real(wp) ::], &
              'stormer_verlet')
   call check('explicit_calls_no_solver', 'kubo', [character(6) ::], [real(wp) ::], 'heun')
   call check('Ito_drift_calls_no_solver', 'kubo', [character(6) ::], [real(wp) ::], &
              'euler_maruyama')
   call check('sigma_zero_draws_nothing', 'kubo', ['sigma '], [0.0_wp], 'midpoint')
   call check('sigma_zero_draws_nothing', 'linear_oscillator', ['sigma '], [0.0_wp], 'midpoint')
   call check('sigma_zero_draws_nothing', 'synchrotron', ['sigma1', 'sigma2'], [0.0_wp, 0.0_wp], &
              'midpoint')
   call check('sigma_zero_draws_nothing', 'pendulum', ['sigma '], [0.0_wp], 'symplectic_euler')
   call check('sigma_zero_draws_nothing', 'fpu_chain', ['sigma '], [0.0_wp], 'midpoint')
   call check('one_noise_silent_draws_one', 'synchrotron', ['sigma1'], [0.0_wp], 'midpoint')
   call check('linear_iterates_once', 'kubo', [character(6) ::], [real(wp) ::], 'midpoint')
   call check('linear_iterates_once', 'linear_oscillator', [character(6) ::], [real(wp) ::], &
              'midpoint')
   call check('linear_iterates_once', 'additive_oscillator', [character(6) ::], [real(wp) ::], &
              'gauss2')
   call check('linear_iterates_once', 'fpu_chain', ['beta  '], [0.0_wp], 'midpoint')
   if (.not. good) error stop 1

contains

   !> Run 264 paths (a full block and a padded one) for 10 steps and hold the counters to the claim.
   subroutine check(claim, model, keys, values, scheme)
      character(*), intent(in) :: claim, model, keys(:), scheme
      real(wp), intent(in) :: values(:)
      integer(i8), parameter :: npath = 260, nstep = 10
      type(scene_type) :: scene
      type(paths_type) :: run
      real(wp) :: unit
      logical :: holds

      call new_scene(scene, model, keys, values, scheme, 0.02_wp)
      scene%q0 = 0.1_wp
      call run_paths(scene, npath, nstep, 0_i8, run)
      associate (c => run%report%counters)
         holds = c%steps == npath*nstep
         select case (claim)
         case ('explicit_calls_no_solver')
            holds = holds .and. c%iterations == 0 .and. c%solves == 0 .and. c%hessians == 0
         case ('Ito_drift_calls_no_solver')  ! a Hessian of the noise, applied to its gradient
            holds = holds .and. c%iterations == 0 .and. c%solves == 0 .and. c%hessians == c%steps
         case ('sigma_zero_draws_nothing')
            holds = holds .and. c%normals == 0
         case ('one_noise_silent_draws_one')
            holds = holds .and. c%normals == c%steps
         case default  ! linear_iterates_once
            holds = holds .and. c%iterations == c%steps .and. c%solves == c%steps
         end select
         unit = 1.0_wp/real(npath*nstep, wp)
         print '(4(a, 1x), 5(f0.2, 1x), a)', 'counters', claim, model, scheme, &
            c%normals*unit, c%gradients*unit, c%hessians*unit, c%iterations*unit, c%solves*unit, &
            merge('ok    ', 'FAILED', holds)
      end associate
      good = good .and. holds
   end subroutine check

end program bench_counters
