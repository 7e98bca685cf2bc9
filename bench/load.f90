! SPDX-License-Identifier: BSD-3-Clause
!> A steady run of about a second, whose speed is compared between threads and processes.
!>
!> bench_load SCENE [THREADS [PERCENT]]: SCENE is synchrotron or kubo, both by midpoint; the work is the same for each
!> thread, PERCENT of the usual. Line: load SCENE THREADS, path-steps per second of the clock, ns of processor time per
!> path-step, and the part of the time that the threads ran.
program bench_load
   use symsde_base_kinds, only: wp, i8
   use symsde_ensemble_run_simulate, only: paths_type
   use bench_support, only: seconds, scene_type, new_scene, run_paths, integer_argument
   implicit none
   type(scene_type) :: scene
   type(paths_type) :: run
   character(len=16) :: name
   integer(i8) :: npath, nstep
   integer :: nthread
   real(wp) :: start, processor_start, wall, processor

   call get_command_argument(1, name)
   nthread = int(integer_argument(2, 1_i8))
   npath = 20480*nthread
   if (name == 'synchrotron') then
      nstep = 40*integer_argument(3, 100_i8)
      call new_scene(scene, 'synchrotron', ['omega'], [2.0_wp], 'midpoint', 0.02_wp)
   else
      nstep = 160*integer_argument(3, 100_i8)
      call new_scene(scene, 'kubo', ['a    ', 'sigma'], [1.0_wp, 0.3_wp], 'midpoint', 0.02_wp)
   end if
   scene%options%nthread = nthread
   start = seconds()
   call cpu_time(processor_start)
   call run_paths(scene, npath, nstep, 0_i8, run)
   wall = seconds() - start
   call cpu_time(processor)
   processor = processor - processor_start
   associate (count => real(npath, wp)*real(nstep, wp))
      print '(a, 1x, a, 1x, i0, 3(1x, es12.5))', 'load', trim(name), run%report%nthread, count/wall, &
         1e9_wp*processor/count, run%report%seconds_run/wall
   end associate
end program bench_load
