! SPDX-License-Identifier: BSD-3-Clause
!> How time grows: bench_growth AXIS [REPEATS]; AXIS is paths, steps, ndof, setup (by ndof), dense
!> (by ndof), matrices (the same by the general stepper), noises, saved, or threads.
!>
!> Lines: growth AXIS X and seconds of a run (median, least, largest).
program bench_growth
   use symsde_base_kinds, only: wp, i8
   use symsde_ensemble_run_report, only: run_report
   use symsde_ensemble_run_simulate, only: paths_type
   use bench_noisy_oscillator, only: noisy_oscillator_model, new_noisy_oscillator
   use mean_field_model, only: mean_field_type, new_mean_field
   use bench_support, only: seconds, median, scene_type, new_scene, run_paths, run_moments, &
                            integer_argument
   implicit none
   character(len=16) :: axis
   integer(i8) :: repeats
   integer :: i

   call get_command_argument(1, axis)
   repeats = integer_argument(2, 5_i8)
   select case (axis)
   case ('paths')
      call grow([(10_i8**i, i=0, 6)])
   case ('steps')
      call grow([(10_i8**i, i=2, 7)])
   case ('ndof', 'setup')
      call grow([(4_i8**i, i=0, 6)])
   case ('dense')
      call grow([(4_i8**i, i=2, 6)])
   case ('matrices')
      call grow([(2_i8**i, i=3, 7)])
   case ('noises')
      call grow([(2_i8**i, i=0, 6)])
   case ('saved')
      call grow([(10_i8**i, i=0, 4)])
   case ('threads')
      call grow([1_i8, 2_i8])
   case default
      print '(a)', 'give one of paths, steps, ndof, setup, dense, matrices, noises, saved, threads'
      error stop 2
   end select

contains

   !> Time runs along the axis.
   subroutine grow(points)
      integer(i8), intent(in) :: points(:)
      real(wp) :: times(repeats)
      integer(i8) :: repeat
      integer :: k

      do k = 1, size(points)
         do repeat = 1, repeats
            call run_point(points(k), times(repeat))
         end do
         print '(a, 1x, a, 1x, i0, 3(1x, es12.5))', 'growth', trim(axis), points(k), &
            median(times), minval(times), maxval(times)
      end do
   end subroutine grow

   !> One run at a point of the axis, everything else fixed.
   subroutine run_point(x, time)
      integer(i8), intent(in) :: x
      real(wp), intent(out) :: time
      type(scene_type) :: scene
      type(paths_type) :: run
      type(run_report) :: report
      integer(i8) :: nstep
      real(wp) :: start

      call choose(x, scene)
      start = seconds()
      select case (axis)
      case ('paths')
         call run_moments(scene, x, 100_i8, 0_i8, report)
      case ('steps')
         call run_moments(scene, 8_i8, x, 0_i8, report)
      case ('ndof', 'setup')
         nstep = max(20_i8, 2000_i8/x)
         call run_paths(scene, 64_i8, nstep, 0_i8, run)
      case ('dense', 'matrices')
         nstep = merge(20_i8, 4_i8, axis == 'dense')
         call run_paths(scene, 64_i8, nstep, 0_i8, run)
      case ('noises')
         call run_paths(scene, 1024_i8, 500_i8, 0_i8, run)
      case ('saved')
         call run_paths(scene, 256_i8, 20000_i8, 20000_i8/x, run)
      case default  ! threads
         call run_paths(scene, 20480_i8, 500_i8, 0_i8, run)
      end select
      time = seconds() - start
      if (axis == 'dense' .or. axis == 'matrices') time = run%report%seconds_run/(64*real(nstep, wp))
      if (axis == 'ndof') time = run%report%seconds_run*20/real(nstep, wp)  ! of 20 steps
      if (axis == 'setup') time = run%report%seconds_setup
   end subroutine run_point

   !> The scene of a point: Kubo midpoint, chains of x sites, x rotators in their mean field, oscillators with x noises.
   subroutine choose(x, scene)
      integer(i8), intent(in) :: x
      type(scene_type), intent(out) :: scene
      type(noisy_oscillator_model) :: model
      type(mean_field_type) :: rotators
      real(wp), parameter :: h = 0.02_wp
      real(wp) :: angle
      integer :: k

      select case (axis)
      case ('ndof', 'setup')
         call new_scene(scene, 'fpu_chain', ['n    ', 'beta ', 'sigma'], &
                        [real(x, wp), 1.0_wp, 0.1_wp], 'midpoint', h)
         angle = acos(-1.0_wp)/real(x + 1, wp)
         scene%q0 = [(sin(k*angle), k=1, int(x))]
      case ('dense', 'matrices')
         call new_scene(scene, 'kubo', ['a    '], [1.0_wp], 'midpoint', 0.1_wp)
         deallocate (scene%model)
         call new_mean_field(rotators, int(x), 0.0_wp, 1.0_wp)
         allocate (scene%model, source=rotators)
         scene%options%general = axis == 'matrices'
         scene%q0 = [(sin(0.7_wp*k), k=1, int(x))]
         scene%p0 = [(cos(1.3_wp*k), k=1, int(x))]
      case ('noises')
         call new_scene(scene, 'kubo', ['a    '], [1.0_wp], 'stormer_verlet', h)
         deallocate (scene%model)
         call new_noisy_oscillator(model, int(x))
         allocate (scene%model, source=model)
      case default
         call new_scene(scene, 'kubo', ['a    ', 'sigma'], [1.0_wp, 0.3_wp], 'midpoint', h)
         if (axis == 'threads') scene%options%nthread = int(x)
      end select
   end subroutine choose

end program bench_growth
