! SPDX-License-Identifier: BSD-3-Clause
!> Peak memory of one moments-only run: bench_memory PATHS [STEPS [SAVE_EVERY]].
!>
!> Line: memory PATHS STEPS and the peak resident memory of this process in kB (Linux), with the
!> time of the run in seconds.
program bench_memory
   use symsde_base_kinds, only: wp, i8
   use symsde_ensemble_run_report, only: run_report
   use bench_support, only: seconds, scene_type, new_scene, run_moments, integer_argument
   implicit none
   type(scene_type) :: scene
   type(run_report) :: report
   integer(i8) :: npath, nstep, save_every
   real(wp) :: start

   npath = integer_argument(1, 10000_i8)
   nstep = integer_argument(2, 100_i8)
   save_every = integer_argument(3, 10_i8)
   call new_scene(scene, 'kubo', ['a    ', 'sigma'], [1.0_wp, 0.3_wp], 'midpoint', 0.02_wp)
   scene%options%nthread = 2
   start = seconds()
   call run_moments(scene, npath, nstep, save_every, report)
   print '(a, 3(1x, i0), 1x, f0.3)', 'memory', npath, nstep, peak(), seconds() - start

contains

   !> VmHWM of /proc/self/status [kB], -1 where there is none.
   integer(i8) function peak()
      character(len=128) :: line
      integer :: unit, info

      peak = -1
      open (newunit=unit, file='/proc/self/status', status='old', action='read', iostat=info)
      if (info /= 0) return
      do
         read (unit, '(a)', iostat=info) line
         if (info /= 0) exit
         if (line(:6) /= 'VmHWM:') cycle
         read (line(7:index(line, 'kB') - 1), *) peak
         exit
      end do
      close (unit)
   end function peak

end program bench_memory
