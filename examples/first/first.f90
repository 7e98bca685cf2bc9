! SPDX-License-Identifier: BSD-3-Clause
!> First run in Fortran: means of 10 000 Kubo oscillators, and one path.
!>
!>    gfortran first.f90 $(pkg-config --cflags --libs symsde) -o first && ./first
program first
   use symsde
   implicit none

   type(kubo_model) :: model
   type(scheme_type) :: scheme
   type(run_options) :: options
   type(moments_type) :: mean
   type(paths_type) :: run
   type(error_type), allocatable :: error
   real(wp) :: t
   integer :: last

   ! dp = -a q dt - sigma q o dW, dq = a p dt + sigma p o dW: a rotation with a random angular velocity
   call new_kubo(model, a=1.0_wp, sigma=0.3_wp, error=error)
   call get_scheme(scheme, 'midpoint', error)
   options = run_options(step=0.02_wp, nstep=500_i8, save_every=50_i8, npath=10000_i8, seed=1_i8)
   call moments(model, scheme, options, q0=[1.0_wp], p0=[0.0_wp], result=mean, error=error)

   options%npath = 100  ! save the first 100 of these paths: run%q is (path, dof, time)
   call simulate(model, scheme, options, q0=[1.0_wp], p0=[0.0_wp], run=run, error=error)

   ! After an error the later calls do nothing, so one check at the end is enough.
   if (allocated(error)) then
      print '(a)', error%message
      stop 1
   end if

   last = size(mean%t)
   t = mean%t(last)
   print '(a, f11.8, a, f10.8, a, f4.1, a, f11.8)', 'E q = ', mean%mean(1, last), ' +- ', mean%se_mean(1, last), &
      ' at t = ', t, ', exact ', exp(-0.045_wp*t)*cos(t)
   print '(a, f11.8, a, f11.8)', 'path 0 ends at q = ', run%q(1, 1, last), ', p = ', run%p(1, 1, last)
   if (maxval(abs(run%q**2 + run%p**2 - 1)) < 1e-12_wp) then
      print '(a)', 'p^2 + q^2 is kept to 1e-12 on every path'
   else
      print '(a)', 'p^2 + q^2 has moved'
   end if
end program first
