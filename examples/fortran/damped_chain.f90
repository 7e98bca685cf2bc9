! SPDX-License-Identifier: BSD-3-Clause
!> Heat along a chain between two baths: the FPU chain of eight masses, whose first one feels kT = 3/2 and whose last
!> one kT = 1/2. The heat that enters, gamma (kT_1 - <p_1^2>), is the heat that leaves.
!>
!>    gfortran damped_chain.f90 $(pkg-config --cflags --libs symsde)
program damped_chain
   use, intrinsic :: iso_fortran_env, only: error_unit
   use symsde
   implicit none

   integer, parameter :: n = 8
   class(model_type), allocatable :: chain
   type(thermostat_model) :: model
   type(scheme_type) :: scheme
   type(moments_type) :: at_rest
   character(*), parameter :: names(2) = [character(5) :: 'n', 'sigma']   ! of parameters
   type(run_options) :: options
   type(error_type), allocatable :: error
   real(wp) :: gamma(n), beta(n), start(n), kinetic(n), hot, cold, room

   ! Friction and noise at the ends alone: rates [1/time] and 1/kT of each mass.
   gamma = 0
   gamma(1) = 1
   gamma(n) = 1
   beta = 1
   beta(1) = 1/1.5_wp
   beta(n) = 1/0.5_wp
   call get_model(chain, 'fpu_chain', names, [real(wp) :: n, 0], error)
   call new_thermostat(model, chain, gamma, beta, error)
   call get_scheme(scheme, 'chin4a', error)
   call check()

   options = run_options(step=0.2_wp, nstep=1500_i8, npath=20000_i8, seed=1_i8, save_every=1500_i8)
   start = 0
   call moments(model, scheme, options, q0=start, p0=start, result=at_rest, error=error)
   call check()

   associate (last => size(at_rest%t))
      kinetic = at_rest%variance(n + 1:2*n, last) + at_rest%mean(n + 1:2*n, last)**2
   end associate
   hot = 1.5_wp - kinetic(1)
   cold = kinetic(n) - 0.5_wp
   print '(a, 8f6.2)', 'kinetic temperatures:', kinetic
   print '(a, f7.4, a, f7.4)', 'heat in', hot, ', heat out', cold
   ! Five standard errors of the variances of normal momenta; 1 in 2 million such programs would stop here.
   room = 5*sqrt(2*(kinetic(1)**2 + kinetic(n)**2)/options%npath)
   if (abs(hot - cold) > room) error stop 'more heat enters than leaves, or less'
   if (min(hot, cold) < 0.1_wp) error stop 'the chain conducts no heat'

contains

   subroutine check()
      if (.not. allocated(error)) return
      write (error_unit, '(a)') error%message
      stop 1
   end subroutine check

end program damped_chain
