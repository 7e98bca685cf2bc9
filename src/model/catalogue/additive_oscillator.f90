! SPDX-License-Identifier: BSD-3-Clause
!>    H = (p^2 + q^2)/2,   H_1 = sigma p,   H_2 = -gamma q
!>    dp = -q dt + gamma dW_2,   dq = p dt + sigma dW_1
!>
!> The oscillator with two additive noises [WHSB] (84)-(86). E(p^2 + q^2) = p_0^2 + q_0^2 + (sigma^2 + gamma^2) t.
!> {H_1,H_2} = sigma gamma is a constant, whose field vanishes: the noises commute. By default sigma = 0, gamma = 1, the
!> data of figure 4.2 of [WHSB], with a single noise. Time is in units of 1/(angular frequency).
!>
!> The paper derives the Euler pair (89)-(92) for this model from the discrete Lagrangian (88). sigma and gamma have the
!> unit of q over sqrt(time).
module symsde_model_catalogue_additive_oscillator
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type
   use symsde_base_text, only: name_length
   use symsde_base_traits, only: model_traits
   use symsde_model_catalogue_oscillator, only: oscillator_model
   use symsde_model_flows_oscillator, only: oscillator_terms
   use symsde_model_parameters, only: require_finite, is_zero
   implicit none
   private
   public :: additive_oscillator_model, new_additive_oscillator
   public :: additive_oscillator_names, additive_oscillator_defaults

   character(*), parameter :: additive_oscillator_names(2) = &
                              [character(len=name_length) :: 'sigma', 'gamma']
   real(wp), parameter :: additive_oscillator_defaults(2) = [0.0_wp, 1.0_wp]

   type, extends(oscillator_model) :: additive_oscillator_model
      real(wp) :: sigma = 0    !! noise of the position
      real(wp) :: gamma = 0    !! noise of the momentum
   contains
      procedure :: value => weighted_value
      procedure :: evaluate
   end type additive_oscillator_model

contains

   !> Make an oscillator with additive noises. Refuses parameters that are not finite (invalid_argument).
   subroutine new_additive_oscillator(self, sigma, gamma, error)
      type(additive_oscillator_model), intent(out) :: self
      real(wp), intent(in) :: sigma  !! noise of the position [1/sqrt(time)]
      real(wp), intent(in) :: gamma  !! noise of the momentum [1/sqrt(time)]
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) return
      call require_finite('new_additive_oscillator', 'sigma', sigma, error)
      call require_finite('new_additive_oscillator', 'gamma', gamma, error)
      if (allocated(error)) return
      self%sigma = sigma
      self%gamma = gamma
      self%name = 'additive_oscillator'
      ! b = -gamma dW_2 and e = sigma dW_1 in model/flows/oscillator.
      self%terms = oscillator_terms(b=-gamma, noise_b=2, e=sigma, noise_e=1)
      ! Noise that moves positions (sigma is not zero) is additive but no noise in position: schemes of kicks refuse it.
      self%traits = model_traits( &
                    ndof=1, nnoise=2, separable=.true., quadratic=.true., additive=.true., &
                    position_noise=is_zero(sigma), identity_mass=.true., max_frequency=1.0_wp, &
                    has_value=.true., has_hessian=.true., has_hessian_vector=.true., &
                    autonomous=.true.)
      self%offers%linear = .true.
      ! An exact rotation of the linear part is only for schemes with noise in position.
      if (is_zero(sigma)) self%traits%rotation = [1.0_wp]
      ! A noise of strength zero is not drawn; the increments of the other noise do not change.
      allocate (self%traits%silent(2))
      self%traits%silent(1) = is_zero(sigma)
      self%traits%silent(2) = is_zero(gamma)
   end subroutine new_additive_oscillator

   !> Value of sum_j w_j H_j.
   subroutine weighted_value(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(additive_oscillator_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)

      !   S = w_0 (p^2 + q^2)/2 + sigma w_1 p - gamma w_2 q
      value = w(:, 0)*(p(:, 1)**2 + q(:, 1)**2)/2 + self%sigma*w(:, 1)*p(:, 1) &
              - self%gamma*w(:, 2)*q(:, 1)
   end subroutine weighted_value

   !> Compute the gradient and the diagonal Hessian blocks of sum_j w_j H_j that are present.
   subroutine evaluate(self, nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hpp)
      class(additive_oscillator_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hpp(nlane, ndof, ndof)
      real(wp) :: sigma, gamma

      sigma = self%sigma
      gamma = self%gamma
      !   S_q = w_0 q - gamma w_2,   S_p = w_0 p + sigma w_1
      if (present(hq)) hq(:, 1) = w(:, 0)*q(:, 1) - gamma*w(:, 2)
      if (present(hp)) hp(:, 1) = w(:, 0)*p(:, 1) + sigma*w(:, 1)
      !   S_qq = S_pp = w_0
      if (present(hqq)) hqq(:, 1, 1) = w(:, 0)
      if (present(hpp)) hpp(:, 1, 1) = w(:, 0)
   end subroutine evaluate

end module symsde_model_catalogue_additive_oscillator
