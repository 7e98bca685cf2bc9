! SPDX-License-Identifier: BSD-3-Clause
!> A loop of one's own around single steps: oscillators in random stiffness that bounce off a wall at q = 0.
!>
!>    gfortran host_loop.f90 $(pkg-config --cflags --libs symsde)
program host_loop
   use, intrinsic :: iso_fortran_env, only: error_unit
   use symsde
   implicit none

   type(kubo_model), target :: model      ! the run points to it
   type(scheme_type) :: scheme
   type(prepared_run) :: run
   type(error_type), allocatable :: error
   real(wp), parameter :: q0(1, 1) = 1.0_wp, p0(1, 1) = 0.0_wp   ! one row for all paths
   real(wp) :: drift
   integer :: step, bounces

   call new_kubo(model, a=1.0_wp, sigma=0.3_wp, error=error)
   call get_scheme(scheme, 'midpoint', error)
   call prepare(run, model, scheme, run_options(step=0.01_wp, npath=1000_i8, seed=1_i8), q0, p0, error)

   ! run%q and run%p are the state, (path, degree of freedom): between steps it is ours.
   bounces = 0
   do step = 1, 2000
      call run%advance(1_i8, error)
      if (allocated(error)) exit
      bounces = bounces + count(run%q < 0)
      where (run%q < 0)
         run%q = -run%q
         run%p = -run%p
      end where
   end do
   if (allocated(error)) then
      write (error_unit, '(a)') error%message
      stop 1
   end if

   drift = maxval(abs(run%q**2 + run%p**2 - 1))
   print '(f6.2, a, f5.1, a, f5.2, a)', bounces/1000.0_wp, ' bounces a path until t = ', run%time(), ',', &
      20/acos(-1.0_wp), ' without noise'
   print '(a, es9.2)', 'largest change of p^2 + q^2: ', drift  ! the mirror keeps it, and so does the midpoint rule
   if (drift > 1e-11_wp) error stop 'the invariant has moved'

end program host_loop
