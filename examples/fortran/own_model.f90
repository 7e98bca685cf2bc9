! SPDX-License-Identifier: BSD-3-Clause
!> Your own model in Fortran: extend model_type and give the gradient.
!>
!>    H = p^2/2 + q^4/4,   H_1 = -sigma q   (a quartic oscillator driven by additive noise)
!>
!> Models are called from several threads at once, so compile with -frecursive (or -fopenmp):
!>
!>    gfortran -frecursive own_model.f90 $(pkg-config --cflags --libs symsde)
module quartic
   use symsde
   implicit none
   private
   public :: quartic_model

   type, extends(model_type) :: quartic_model
      real(wp) :: sigma = 0.5_wp
   contains
      procedure :: gradient
      procedure :: value => energy
   end type quartic_model

contains

   !> Gradient of w_0 H + w_1 H_1, lane by lane. An output that is absent is not needed.
   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(quartic_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)

      if (present(hq)) hq(:, 1) = w(:, 0)*q(:, 1)**3 - w(:, 1)*self%sigma
      if (present(hp)) hp(:, 1) = w(:, 0)*p(:, 1)
   end subroutine gradient

   !> Value of w_0 H + w_1 H_1. It is optional: with it runs average the energy.
   subroutine energy(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(quartic_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)

      value = w(:, 0)*(p(:, 1)**2/2 + q(:, 1)**4/4) - w(:, 1)*self%sigma*q(:, 1)
   end subroutine energy

end module quartic

program own_model
   use symsde
   use quartic, only: quartic_model
   implicit none

   type(quartic_model) :: model
   type(scheme_type) :: scheme
   type(moments_type) :: averages
   type(error_type), allocatable :: error
   real(wp) :: exact
   integer :: last

   ! Traits decide which work the scheme may skip. A false trait is refused by name.
   model%name = 'quartic'
   model%traits = model_traits(ndof=1, nnoise=1, separable=.true., additive=.true., position_noise=.true., &
                               identity_mass=.true., has_value=.true.)
   call get_scheme(scheme, 'midpoint', error)
   call moments(model, scheme, run_options(step=0.05_wp, nstep=200_i8, npath=20000_i8, seed=7_i8, save_every=200_i8), &
                q0=[1.0_wp], p0=[0.0_wp], result=averages, error=error)
   if (allocated(error)) then
      print '(a)', error%message
      error stop 1
   end if

   ! Additive noise on p heats the oscillator: E H(t) = H(0) + sigma^2 t/2.
   last = size(averages%t)
   exact = 0.25_wp + 0.125_wp*averages%t(last)
   print '(a, f8.4, a, f6.4, a, f8.4)', 'E H at t = 10: ', averages%mean(3, last), ' +- ', averages%se_mean(3, last), &
      ', exact ', exact
   print '(2a)', 'stepper: ', averages%report%stepper
   if (abs(averages%mean(3, last) - exact) > 5*averages%se_mean(3, last)) error stop 'the mean is not the exact one'
end program own_model
