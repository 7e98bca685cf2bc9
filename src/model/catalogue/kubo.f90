! SPDX-License-Identifier: BSD-3-Clause
!>    H = a (p^2 + q^2)/2,   H_1 = sigma (p^2 + q^2)/2
!>    dp = -a q dt - sigma q o dW,   dq = a p dt + sigma p o dW
!>
!> The Kubo oscillator [WHSB] (35)-(37): a rotation with a random angular velocity. With theta = a t + sigma W(t) the
!> solution is
!>
!>    q = q_0 cos theta + p_0 sin theta,   p = p_0 cos theta - q_0 sin theta
!>
!> so that p^2 + q^2 is constant on every path; means rotate by a t and shrink by exp(-sigma^2 t/2). The flows commute,
!> {H,H_1} = 0: a scheme of even order r without noise has strong order r/2 here (scheme/properties). One-sided schemes
!> need a correction, since H_1,p H_1,q = sigma^2 p q. q and p have the same unit, the square root of an action.
!>
!> The paper derives the midpoint rule (71)-(72) for this model from the discrete Lagrangian (61)-(62). Units: a is
!> [1/time] and sigma [1/sqrt(time)], so that a h and sigma dW are angles.
module symsde_model_catalogue_kubo
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_maps, only: step_map, midpoint_map
   use symsde_base_record, only: steps_record
   use symsde_base_status, only: error_type
   use symsde_base_text, only: name_length
   use symsde_base_traits, only: model_traits
   use symsde_model_kernels, only: angle_terms
   use symsde_model_flows_kubo, only: kubo_flow
   use symsde_model_catalogue_oscillator, only: oscillator_model
   use symsde_model_flows_damped_oscillator, only: damped_oscillator_flow
   use symsde_model_flows_oscillator, only: oscillator_terms, oscillator_flow
   use symsde_model_parameters, only: require_finite, is_zero
   implicit none
   private
   public :: kubo_model, new_kubo, kubo_names, kubo_defaults

   character(*), parameter :: kubo_names(2) = [character(len=name_length) :: 'a', 'sigma']
   real(wp), parameter :: kubo_defaults(2) = [1.0_wp, 0.3_wp]

   type, extends(oscillator_model) :: kubo_model
      real(wp) :: a = 0        !! angular velocity [1/time]
      real(wp) :: sigma = 0    !! noise of the angular velocity [1/sqrt(time)]
   contains
      procedure :: value => weighted_value
      procedure :: evaluate
      procedure :: flow
      procedure :: angle
   end type kubo_model

contains

   !> Make a Kubo oscillator. Refuses parameters that are not finite (invalid_argument).
   subroutine new_kubo(self, a, sigma, error)
      type(kubo_model), intent(out) :: self
      real(wp), intent(in) :: a      !! angular velocity [1/time]
      real(wp), intent(in) :: sigma  !! intensity of the noise [1/sqrt(time)]
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) return
      call require_finite('new_kubo', 'a', a, error)
      call require_finite('new_kubo', 'sigma', sigma, error)
      if (allocated(error)) return
      self%a = a
      self%sigma = sigma
      self%name = 'kubo'
      ! In the terms of model/flows/oscillator r = a and A = C = sigma; both belong to noise 1.
      self%terms = oscillator_terms(rate=a, a=sigma, noise_a=1, c=sigma, noise_c=1)
      ! H alone has the frequency |a|; grad H_1 = sigma (q, p) has the Lipschitz constant |sigma|. With a = 1 the
      ! mass is one.
      self%traits = model_traits( &
                    ndof=1, nnoise=1, separable=.true., quadratic=.true., &
                    additive=is_zero(sigma), position_noise=is_zero(sigma), &
                    identity_mass=is_zero(a - 1), &
                    has_value=.true., has_hessian=.true., has_hessian_vector=.true., &
                    autonomous=.true., &
                    max_frequency=abs(a), noise_lipschitz=abs(sigma))
      self%offers%linear = .true.
      ! If sigma = 0, noise 1 is silent.
      allocate (self%traits%silent(1), source=is_zero(sigma))
   end subroutine new_kubo

   !> Value of sum_j w_j H_j.
   subroutine weighted_value(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(kubo_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)

      !   S = theta (p^2 + q^2)/2,   theta = a w_0 + sigma w_1
      value = (self%a*w(:, 0) + self%sigma*w(:, 1))*(p(:, 1)**2 + q(:, 1)**2)/2
   end subroutine weighted_value

   !> Compute the gradient and the diagonal Hessian blocks of sum_j w_j H_j that are present.
   subroutine evaluate(self, nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hpp)
      class(kubo_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hpp(nlane, ndof, ndof)
      real(wp) :: a, sigma

      a = self%a
      sigma = self%sigma
      !   grad S = theta (q, p),   Hess S = theta I
      if (present(hq)) hq(:, 1) = (a*w(:, 0) + sigma*w(:, 1))*q(:, 1)
      if (present(hp)) hp(:, 1) = (a*w(:, 0) + sigma*w(:, 1))*p(:, 1)
      if (present(hqq)) hqq(:, 1, 1) = a*w(:, 0) + sigma*w(:, 1)
      if (present(hpp)) hpp(:, 1, 1) = a*w(:, 0) + sigma*w(:, 1)
   end subroutine evaluate

   !> The terms for one path, see model_type. The angular velocity multiplies w_0 here, while oscillator_model assumes
   !> the rate one.
   subroutine angle(self, nnoise, t, w, terms)
      class(kubo_model), intent(in) :: self
      integer, intent(in) :: nnoise
      real(wp), intent(in) :: t, w(0:nnoise)
      type(angle_terms), intent(out) :: terms

      ! S = c q^2/2 + e p^2/2 with c = e = theta.
      terms%c = self%a*w(0) + self%sigma*w(1)
      terms%e = terms%c
   end subroutine angle

   !> Whole steps, see model_type.
   subroutine flow(self, map, steps, ndof, q, p, qn, pn, status, counters)
      class(kubo_model), intent(in) :: self
      type(step_map), intent(in) :: map
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: ndof
      real(wp), intent(in) :: q(steps%nlane, ndof), p(steps%nlane, ndof)
      real(wp), intent(out) :: qn(steps%nlane, ndof, steps%nstep/steps%every)
      real(wp), intent(out) :: pn(steps%nlane, ndof, steps%nstep/steps%every)
      integer(i8), intent(inout) :: status(steps%nlane)
      type(counters_type), intent(inout) :: counters

      ! The midpoint rule has a flow of its own, in which no step waits for a division; other maps use the flows of
      ! oscillators.
      if (map%damped) then
         call damped_oscillator_flow(self%terms, map, steps, q, p, qn, pn, counters)
      else if (map%equation == midpoint_map) then
         call kubo_flow(self%a, self%sigma, steps, q, p, qn, pn, counters)
      else
         call oscillator_flow(self%terms, map, steps, q, p, qn, pn, counters)
      end if
   end subroutine flow

end module symsde_model_catalogue_kubo
