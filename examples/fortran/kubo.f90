! SPDX-License-Identifier: BSD-3-Clause
!> A thousand Kubo oscillators: saved paths, their invariant, and the moments of many more.
!>
!>    gfortran kubo.f90 $(pkg-config --cflags --libs symsde)
program kubo
   use, intrinsic :: iso_fortran_env, only: error_unit
   use symsde
   implicit none

   type(kubo_model) :: model
   type(scheme_type) :: scheme
   type(paths_type) :: run
   type(moments_type) :: averages
   type(error_type), allocatable :: error
   type(run_options) :: options
   real(wp) :: drift

   ! dp = -a q dt - sigma q o dW,  dq = a p dt + sigma p o dW: a rotation with a random angular velocity
   call new_kubo(model, a=1.0_wp, sigma=0.3_wp, error=error)
   call get_scheme(scheme, 'midpoint', error)

   ! 1000 paths of 5000 steps, saved every 50 steps. An error is kept: later calls do nothing, so that
   ! one check at the end serves them all.
   options = run_options(step=0.02_wp, nstep=5000_i8, npath=1000_i8, seed=1_i8, save_every=50_i8)
   call simulate(model, scheme, options, q0=[1.0_wp], p0=[0.0_wp], run=run, error=error)
   call check()

   ! The midpoint rule keeps p^2 + q^2 on every path, whatever the noise.
   drift = maxval(abs(run%q**2 + run%p**2 - 1))
   print '(a, es9.2)', 'largest change of p^2 + q^2 on 1000 paths to t = 100: ', drift

   ! 100 000 paths without saving any: E q(t) = exp(-sigma^2 t/2) cos(a t).
   options%npath = 100000
   options%nstep = 250
   call moments(model, scheme, options, q0=[1.0_wp], p0=[0.0_wp], result=averages, error=error)
   call check()
   associate (last => size(averages%t))
      print '(a, f4.1, a, f8.5, a, f7.5, a, f8.5)', 'E q at t = ', averages%t(last), ': ', averages%mean(1, last), &
         ' +- ', averages%se_mean(1, last), ', exact ', exact(averages%t(last))
      if (abs(averages%mean(1, last) - exact(averages%t(last))) > 5*averages%se_mean(1, last)) &
         error stop 'the mean is not the exact one'
   end associate
   if (drift > 1e-12_wp) error stop 'the invariant has moved'

contains

   pure real(wp) function exact(t)
      real(wp), intent(in) :: t

      exact = exp(-0.045_wp*t)*cos(t)
   end function exact

   subroutine check()
      if (.not. allocated(error)) return
      write (error_unit, '(a)') error%message
      stop 1
   end subroutine check

end program kubo
