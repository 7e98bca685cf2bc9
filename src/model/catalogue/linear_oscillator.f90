! SPDX-License-Identifier: BSD-3-Clause
!>    H = (p^2 + q^2)/2,   H_1 = -sigma q
!>    dp = -q dt + sigma dW,   dq = p dt
!>
!> The linear stochastic oscillator [WHSB] (20)-(21). E(p^2 + q^2) = p_0^2 + q_0^2 + sigma^2 t grows linearly, which is
!> (24) of [WHSB] for p_0 = 0, q_0 = 1; the energy H is half of p^2 + q^2. The noise is additive and in position: every
!> scheme has its order for additive noise, and no scheme needs a correction. Time is in units of 1/(angular frequency).
module symsde_model_catalogue_linear_oscillator
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type
   use symsde_base_text, only: name_length
   use symsde_base_traits, only: model_traits
   use symsde_model_catalogue_oscillator, only: oscillator_model
   use symsde_model_flows_oscillator, only: oscillator_terms
   use symsde_model_parameters, only: require_finite, is_zero
   implicit none
   private
   public :: linear_oscillator_model, new_linear_oscillator
   public :: linear_oscillator_names, linear_oscillator_defaults

   character(*), parameter :: linear_oscillator_names(1) = [character(len=name_length) :: 'sigma']
   real(wp), parameter :: linear_oscillator_defaults(1) = [1.0_wp]

   type, extends(oscillator_model) :: linear_oscillator_model
      real(wp) :: sigma = 0    !! intensity of the force [1/sqrt(time)]
   contains
      procedure :: value => weighted_value
      procedure :: evaluate
   end type linear_oscillator_model

contains

   !> Make a linear oscillator. Refuses a parameter that is not finite (invalid_argument).
   subroutine new_linear_oscillator(self, sigma, error)
      type(linear_oscillator_model), intent(out) :: self
      real(wp), intent(in) :: sigma  !! intensity of the random force [1/sqrt(time)]
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) return
      call require_finite('new_linear_oscillator', 'sigma', sigma, error)
      if (allocated(error)) return
      self%sigma = sigma
      self%name = 'linear_oscillator'
      ! b = -sigma dW is the constant force of the flows of model/flows/oscillator.
      self%terms = oscillator_terms(b=-sigma, noise_b=1)
      ! H is quadratic, with frequency one: if a scheme rotates exactly, its kicks contain only the noise.
      self%traits = model_traits( &
                    ndof=1, nnoise=1, separable=.true., quadratic=.true., additive=.true., &
                    position_noise=.true., identity_mass=.true., &
                    has_value=.true., has_hessian=.true., has_hessian_vector=.true., &
                    autonomous=.true., &
                    max_frequency=1.0_wp, rotation=[1.0_wp])
      self%offers%linear = .true.
      allocate (self%traits%silent(1), source=is_zero(sigma))
   end subroutine new_linear_oscillator

   !> Value of sum_j w_j H_j.
   subroutine weighted_value(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(linear_oscillator_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)

      !   S = w_0 (p^2 + q^2)/2 - sigma w_1 q
      value = w(:, 0)*(p(:, 1)**2 + q(:, 1)**2)/2 - self%sigma*w(:, 1)*q(:, 1)
   end subroutine weighted_value

   !> Compute the gradient and the diagonal Hessian blocks of sum_j w_j H_j that are present.
   subroutine evaluate(self, nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hpp)
      class(linear_oscillator_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hpp(nlane, ndof, ndof)
      real(wp) :: sigma

      sigma = self%sigma
      !   S_q = w_0 q - sigma w_1,   S_p = w_0 p;   the noise has no second derivatives
      if (present(hq)) hq(:, 1) = w(:, 0)*q(:, 1) - sigma*w(:, 1)
      if (present(hp)) hp(:, 1) = w(:, 0)*p(:, 1)
      !   S_qq = S_pp = w_0
      if (present(hqq)) hqq(:, 1, 1) = w(:, 0)
      if (present(hpp)) hpp(:, 1, 1) = w(:, 0)
   end subroutine evaluate

end module symsde_model_catalogue_linear_oscillator
