! SPDX-License-Identifier: BSD-3-Clause
!> A program outside the project: it uses the installed module files and library alone.
program consumer
   use symsde, only: wp, i8, error_type, kubo_model, new_kubo, scheme_type, get_scheme
   use symsde, only: run_options, paths_type, simulate
   implicit none
   type(kubo_model) :: model
   type(scheme_type) :: scheme
   type(paths_type) :: run
   type(error_type), allocatable :: error

   call new_kubo(model, a=1.0_wp, sigma=0.3_wp, error=error)
   call get_scheme(scheme, 'midpoint', error)
   call simulate(model, scheme, run_options(step=0.02_wp, nstep=100_i8, npath=8_i8, seed=1_i8), &
                 q0=[1.0_wp], p0=[0.0_wp], run=run, error=error)
   if (allocated(error)) then
      print '(a)', error%message
      stop 1
   end if
   ! The midpoint scheme keeps p^2 + q^2 of the Kubo oscillator.
   if (any(abs(run%q**2 + run%p**2 - 1) > 1e-12_wp)) stop 1
   print '(a)', 'Fortran: p^2 + q^2 is kept'
end program consumer
