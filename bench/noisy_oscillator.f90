! SPDX-License-Identifier: BSD-3-Clause
!> A model of the benchmarks only: an oscillator with any number of additive noises on its momentum.
!>
!>    H = (p^2 + q^2)/2,   H_k = -0.1 q
module bench_noisy_oscillator
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: model_traits
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: noisy_oscillator_model, new_noisy_oscillator

   type, extends(model_type) :: noisy_oscillator_model
   contains
      procedure :: gradient
   end type noisy_oscillator_model

contains

   !> An oscillator with nnoise noises.
   subroutine new_noisy_oscillator(self, nnoise)
      type(noisy_oscillator_model), intent(out) :: self
      integer, intent(in) :: nnoise

      self%name = 'noisy_oscillator'
      self%traits = model_traits(ndof=1, nnoise=nnoise, separable=.true., quadratic=.true., &
                                 additive=.true., position_noise=.true., identity_mass=.true.)
      allocate (self%traits%silent(nnoise), source=.false.)
   end subroutine new_noisy_oscillator

   !> Gradient of sum_j w_j H_j.
   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(noisy_oscillator_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      integer :: k

      if (present(hq)) then
         hq(:, 1) = w(:, 0)*q(:, 1)
         do k = 1, nnoise
            hq(:, 1) = hq(:, 1) - 0.1_wp*w(:, k)
         end do
      end if
      if (present(hp)) hp(:, 1) = w(:, 0)*p(:, 1)
   end subroutine gradient

end module bench_noisy_oscillator
