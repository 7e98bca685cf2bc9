! SPDX-License-Identifier: BSD-3-Clause
!> The program of `fpm test`: known answers of a library built with other flags than CMake's. The unit tests need CMake.
program known
   use symsde, only: error_type, get_scheme, i8, kubo_model, library_version, moments, moments_type, new_kubo
   use symsde, only: paths_type, run_options, scheme_type, simulate, wp
   use symsde_noise_philox, only: philox_words
   implicit none
   type(kubo_model) :: model
   type(scheme_type) :: scheme
   type(paths_type) :: run
   type(moments_type) :: mean
   type(error_type), allocatable :: error
   integer(i8), parameter :: answer(4) = [ &
                             int(z'6627E8D5', i8), int(z'E169C58D', i8), int(z'BC57AC4C', i8), int(z'9B00DBD8', i8)]
   integer(i8) :: words(4)
   real(wp) :: exact

   call philox_words([0_i8, 0_i8, 0_i8, 0_i8], [0_i8, 0_i8], words)
   call require(all(words == answer), 'Philox4x32-10 of zeros, as Random123 has it')

   call new_kubo(model, a=1.0_wp, sigma=0.3_wp, error=error)
   call get_scheme(scheme, 'midpoint', error)
   call simulate(model, scheme, run_options(step=0.02_wp, nstep=500_i8, npath=1000_i8, seed=1_i8, save_every=500_i8), &
                 q0=[1.0_wp], p0=[0.0_wp], run=run, error=error)
   if (allocated(error)) call require(.false., error%message)
   call require(all(abs(run%q**2 + run%p**2 - 1) < 1e-12_wp), 'midpoint keeps p^2 + q^2')

   call moments(model, scheme, run_options(step=0.02_wp, nstep=500_i8, npath=20000_i8, seed=1_i8, save_every=500_i8), &
                q0=[1.0_wp], p0=[0.0_wp], result=mean, error=error)
   if (allocated(error)) call require(.false., error%message)
   ! E q(t) = exp(-sigma^2 t/2) cos(a t); five standard errors of 20000 paths, and 2e-3 for the error of the step
   exact = exp(-0.045_wp*10)*cos(10.0_wp)
   call require(abs(mean%mean(1, 2) - exact) < 5*0.7_wp/sqrt(20000.0_wp) + 2e-3_wp, 'the mean of q at t = 10')
   print '(2a)', 'all as known, symsde ', library_version

contains

   subroutine require(holds, what)
      logical, intent(in) :: holds
      character(*), intent(in) :: what

      if (holds) return
      print '(2a)', 'wrong: ', what
      stop 1
   end subroutine require

end program known
