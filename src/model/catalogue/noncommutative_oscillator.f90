! SPDX-License-Identifier: BSD-3-Clause
!>    H = (p^2 + q^2)/2,   H_1 = s1 p^2/2,   H_2 = s2 q^2/2,        {H_1,H_2} = -s1 s2 p q
!>    dp = -q dt - s2 q o dW_2,   dq = p dt + s1 p o dW_1
!>
!> An oscillator with two noises that do not commute: random kinetic energy and random potential energy.
!>
!> With increments alone no scheme has a strong order above 1/2 here (docs/method/setting.md).
!>
!> The one-sided schemes are consistent here without correction, since H_k,p.H_k,q = 0 for both noises, and the
!> midpoint rule with areas has strong order 1. s1 and s2 are [1/sqrt(time)]; the unit of time is 1/(angular frequency).
module symsde_model_catalogue_noncommutative_oscillator
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type
   use symsde_base_text, only: name_length
   use symsde_base_traits, only: model_traits
   use symsde_model_catalogue_oscillator, only: oscillator_model
   use symsde_model_flows_oscillator, only: oscillator_terms
   use symsde_model_parameters, only: require_finite, is_zero
   implicit none
   private
   public :: noncommutative_oscillator_model, new_noncommutative_oscillator
   public :: noncommutative_oscillator_names, noncommutative_oscillator_defaults

   character(*), parameter :: noncommutative_oscillator_names(2) = &
                              [character(len=name_length) :: 's1', 's2']
   real(wp), parameter :: noncommutative_oscillator_defaults(2) = [0.5_wp, 0.5_wp]

   type, extends(oscillator_model) :: noncommutative_oscillator_model
      private
      real(wp) :: s1 = 0    !! noise of the kinetic energy
      real(wp) :: s2 = 0    !! noise of the potential energy
   contains
      procedure :: value => weighted_value
      procedure :: evaluate
   end type noncommutative_oscillator_model

contains

   !> Make a non-commutative oscillator. Refuses parameters that are not finite (invalid_argument).
   subroutine new_noncommutative_oscillator(self, s1, s2, error)
      type(noncommutative_oscillator_model), intent(out) :: self
      real(wp), intent(in) :: s1  !! noise of the kinetic energy [1/sqrt(time)]
      real(wp), intent(in) :: s2  !! noise of the potential energy [1/sqrt(time)]
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) return
      call require_finite('new_noncommutative_oscillator', 's1', s1, error)
      call require_finite('new_noncommutative_oscillator', 's2', s2, error)
      if (allocated(error)) return
      self%s1 = s1
      self%s2 = s2
      self%name = 'noncommutative_oscillator'
      ! a = h + s2 dW_2 and c = h + s1 dW_1 in model/flows/oscillator.
      self%terms = oscillator_terms(a=s2, noise_a=2, c=s1, noise_c=1)
      ! The Lipschitz constants of s1 p and s2 q are |s1| and |s2|. H has mass one; H_1 = s1 p^2/2 makes the mass
      ! of Hhat random.
      self%traits = model_traits( &
                    ndof=1, nnoise=2, separable=.true., quadratic=.true., &
                    additive=is_zero(s1) .and. is_zero(s2), position_noise=is_zero(s1), &
                    identity_mass=.true., &
                    has_value=.true., has_hessian=.true., has_hessian_vector=.true., &
                    autonomous=.true., &
                    max_frequency=1.0_wp, noise_lipschitz=abs(s1) + abs(s2))
      self%offers%linear = .true.
      ! With s1 = 0 the remaining noise is in position, with s2 = 0 in momentum; a single noise commutes with itself.
      allocate (self%traits%silent(2))
      self%traits%silent(1) = is_zero(s1)
      self%traits%silent(2) = is_zero(s2)
   end subroutine new_noncommutative_oscillator

   !> Value of sum_j w_j H_j.
   subroutine weighted_value(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(noncommutative_oscillator_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)

      ! S = (w_0 + s1 w_1) p^2/2 + (w_0 + s2 w_2) q^2/2:  the equations are linear, so that moments are matrix
      ! exponentials
      value = (w(:, 0) + self%s1*w(:, 1))*p(:, 1)**2/2 + (w(:, 0) + self%s2*w(:, 2))*q(:, 1)**2/2
   end subroutine weighted_value

   !> Compute the gradient and the diagonal Hessian blocks of sum_j w_j H_j that are present.
   subroutine evaluate(self, nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hpp)
      class(noncommutative_oscillator_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hpp(nlane, ndof, ndof)
      real(wp) :: s1, s2

      s1 = self%s1
      s2 = self%s2
      !   S_q = (w_0 + s2 w_2) q,   S_p = (w_0 + s1 w_1) p
      if (present(hq)) hq(:, 1) = (w(:, 0) + s2*w(:, 2))*q(:, 1)
      if (present(hp)) hp(:, 1) = (w(:, 0) + s1*w(:, 1))*p(:, 1)
      !   S_qq = w_0 + s2 w_2,   S_pp = w_0 + s1 w_1
      if (present(hqq)) hqq(:, 1, 1) = w(:, 0) + s2*w(:, 2)
      if (present(hpp)) hpp(:, 1, 1) = w(:, 0) + s1*w(:, 1)
   end subroutine evaluate

end module symsde_model_catalogue_noncommutative_oscillator
