! SPDX-License-Identifier: BSD-3-Clause
!>    drift by x h   q' = q + x h M^-1 p
!>    kick i         p' = p - (b_i h U_q + sum_k (beta_i dW_k + gamma_i a_k + eta_i K_k) H_k,q)
!>
!> Splitting schemes by name: drifts and kicks for H = p.M^-1 p/2 + U(t,q) with noise in position, explicit and
!> symplectic (scheme/kicks defines the coefficients and the added potentials, docs/method/explicit.md derives them).
!>
!>    gauss_dkdkd            kicks at Gauss' two nodes: c = 0, two forces and no other gradient
!>    verlet_kdk             kicks at both ends
!>    chin4a                 the forward flow 4A of Chin, of order four, with K beside dZ
!>    .._strong2             the same with the second Magnus term of the noise sampled
!>    gauss_dkdkd_rotation   drifts are the exact flow of a linear part that the model declares
!>    verlet_kdk_midpoint    the noise alone at both ends, a step of the implicit midpoint rule for H between
!>    gauss_dkdkd_midpoint   the noise alone at Gauss' nodes, midpoint steps between, for any H
!>    verlet_dkd_weak2       one kick by a three-point dW alone: for expectations
module symsde_scheme_splitting
   use symsde_base_functionals, only: functionals, path_dz, path_stt_area, path_magnus
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, invalid_argument
   use symsde_base_laws, only: law_three_point
   use symsde_scheme_kicks, only: kicks_type, new_kicks, mean_coefficient, moment_residual, flow_free, flow_rotation, &
                                  flow_midpoint
   use symsde_scheme_orders, only: set_order, evidence_claimed, evidence_derived, additive_noise, commutative_noise, &
                                   weak_order
   use symsde_scheme_scheme, only: scheme_type, model_needs, splitting_form
   implicit none
   private
   public :: splitting_scheme, complete

   real(wp), parameter :: tolerance = 1e-13_wp  !! tolerance of the moment conditions

contains

   !> Get a splitting scheme by name; known is false if no splitting scheme has this name.
   subroutine splitting_scheme(scheme, name, known, error)
      type(scheme_type), intent(out) :: scheme
      character(*), intent(in) :: name
      logical, intent(out) :: known
      type(error_type), allocatable, intent(inout) :: error
      type(kicks_type) :: kicks
      real(wp), parameter :: third = 1/3.0_wp, sixth = 1/6.0_wp, half(2) = 0.5_wp
      real(wp), parameter :: ends(2) = [0.0_wp, 1.0_wp]
      real(wp) :: x
      integer :: flow

      known = .true.
      flow = flow_free
      if (index(name, '_rotation') > 0) flow = flow_rotation
      if (index(name, '_midpoint') > 0) flow = flow_midpoint
      ! x is the smaller node of Gauss, (1 - 1/sqrt 3)/2.
      x = 0.5_wp*(1 - sqrt(third))
      select case (name)
      case ('gauss_dkdkd', 'gauss_dkdkd_strong2', 'gauss_dkdkd_rotation', 'gauss_dkdkd_midpoint')
         ! gamma = (sqrt 3, -sqrt 3) from gamma_1 + gamma_2 = 0 and gamma_1 x + gamma_2 (1 - x) = -1. These nodes have
         ! sum_{i<j} (c_j - c_i) (beta_i beta_j + gamma_i gamma_j/12) = (1/4 - 1/4)/sqrt 3 = 0: no product of
         ! gradients is needed.
         call new_kicks(kicks, [x, 1 - x], half, sqrt(3.0_wp)*[1, -1], flow=flow)
         scheme%reference = 'kicks at Gauss'' nodes; docs/method/explicit.md'
      case ('verlet_kdk', 'verlet_kdk_strong2', 'verlet_kdk_midpoint')
         ! With kicks at both ends the sum is 1/4 - 1/12 = 1/6: the potential with c = 1/6 is added.
         call new_kicks(kicks, ends, half, [1.0_wp, -1.0_wp], flow=flow)
         scheme%reference = 'velocity Verlet with dZ; docs/method/explicit.md'
      case ('chin4a', 'chin4a_strong2')
         ! Simpson's weights with kappa = -1/72 have order four without noise; eta satisfies sum_i eta_i c_i^2 = 2, the
         ! factor of K in int s^2 dW = dW/3 - a + 2 K.
         call new_kicks(kicks, [0.0_wp, 0.5_wp, 1.0_wp], [sixth, 2*third, sixth], [1.0_wp, 0.0_wp, -1.0_wp], &
                        eta=[4.0_wp, -8.0_wp, 4.0_wp], kappa=[0.0_wp, -1/72.0_wp, 0.0_wp], zeta=-12.0_wp, &
                        share=[0.0_wp, 1.0_wp, 0.0_wp])
         scheme%reference = 'forward flow 4A (Chin 1997) with dZ and K; docs/method/explicit.md'
      case ('verlet_dkd_weak2')
         ! A single kick has c = 0.
         call new_kicks(kicks, [0.5_wp], [1.0_wp])
         scheme%reference = 'position Verlet with three-point dW; docs/method/weak.md'
      case default
         known = .false.
         return
      end select
      kicks%samples = index(name, '_strong2') > 0
      ! This check finds a misprint among the coefficients above when the scheme is requested.
      if (moment_residual(kicks, 1) > tolerance) then
         call raise(error, invalid_argument, 'splitting_scheme', 'the kicks of '//name//' miss the moments of '// &
                    'the noise: their weights must sum to 1 and have the mean 1/2, those of a sum to 0 with mean -1')
         return
      end if
      call complete(scheme, name, kicks)
      call set_orders(scheme, kicks)
   end subroutine splitting_scheme

   !> Set the properties that follow from the coefficients.
   subroutine complete(scheme, name, kicks)
      type(scheme_type), intent(inout) :: scheme
      character(*), intent(in) :: name
      type(kicks_type), intent(in) :: kicks

      scheme%name = name
      scheme%form = splitting_form
      scheme%nstage = size(kicks%c)
      scheme%c = kicks%c
      scheme%alpha = kicks%beta
      scheme%beta = kicks%beta
      scheme%kicks = kicks
      ! Drifts are kicked by gradients of potentials alone: noise must be in position. The mass is needed for velocities
      ! M^-1 p and products H_k,q.M^-1 H_l,q; midpoint steps without products use the model's gradient instead.
      scheme%needs = model_needs(position_noise=.true., identity_mass=kicks%flow == flow_rotation, &
                                 constant_mass=kicks%flow /= flow_midpoint .or. has_products(kicks), &
                                 rotation=kicks%flow == flow_rotation, &
                                 quadratic_will_do=kicks%flow == flow_free, &
                                 instead='gauss2_strong32 for strong order 3/2, or midpoint')
      if (kicks%is_word() .or. kicks%rational) scheme%needs%quadratic_will_do = .false.
      scheme%needs%actions_will_do = scheme%needs%quadratic_will_do .and. .not. has_products(kicks)
      scheme%needs%parts_will_do = scheme%needs%actions_will_do
      ! Products of noises of phases are bonds of the quadratic part; squares of V, with what H leaves, are not.
      scheme%needs%phases_will_do = scheme%needs%quadratic_will_do .and. all(abs(kicks%kappa) <= 0)
      if (kicks%is_word()) scheme%needs%instead = 'midpoint'  ! schemes with brackets refuse damped models
      if (kicks%flow == flow_midpoint .and. has_products(kicks)) scheme%needs%instead = 'gauss_dkdkd_midpoint'
      if (kicks%uses_dz()) scheme%asks = functionals([path_dz])
      scheme%asks%has(path_stt_area) = kicks%uses_k()
      scheme%asks%has(path_magnus) = kicks%samples
      ! Drifts, kicks and rotations are exact flows, and the midpoint rule is symplectic: their composition is
      ! symplectic.
      scheme%symplectic = .true.
      scheme%symmetric = is_palindrome(kicks)
   end subroutine complete

   !> Whether some kick multiplies gradients, which needs the mass.
   pure logical function has_products(kicks)
      type(kicks_type), intent(in) :: kicks

      has_products = kicks%samples .or. any(abs(kicks%kappa) > 0) .or. abs(mean_coefficient(kicks)) > 0
   end function has_products

   !> Set orders. They hold for noise in position and constant mass (with midpoint steps and no products beside
   !> them, for any H); other models are refused. Strong orders follow from the moment conditions that the kicks
   !> satisfy, since the mean of the second Magnus term is subtracted by construction. Kicks by dW alone have a weak
   !> order.
   pure subroutine set_orders(scheme, kicks)
      type(scheme_type), intent(inout) :: scheme
      type(kicks_type), intent(in) :: kicks
      logical :: forward

      forward = any(abs(kicks%kappa) > 0)  ! a flow of order four
      scheme%order_noise_free = merge(4, 2, forward)
      if (.not. kicks%uses_dz()) then
         scheme%law = law_three_point
         call set_order(scheme%order(weak_order), 2.0_wp, evidence_derived)
         return
      end if
      call set_order(scheme%order(additive_noise), merge(3.0_wp, 2.0_wp, moment_residual(kicks, 2) < tolerance), &
                     evidence_derived)
      call set_order(scheme%order(commutative_noise), merge(2.0_wp, 1.5_wp, kicks%samples), evidence_derived)
      call set_order(scheme%order(weak_order), merge(3.0_wp, 2.0_wp, forward), evidence_claimed)
   end subroutine set_orders

   !> Whether the same kicks in reverse order have the same coefficients. Reversal changes the sign of a_k, but not of
   !> K_k.
   pure logical function is_palindrome(kicks)
      type(kicks_type), intent(in) :: kicks
      integer :: n

      n = size(kicks%c)
      is_palindrome = maxval(abs([kicks%c + kicks%c(n:1:-1) - 1, kicks%b - kicks%b(n:1:-1), &
                                  kicks%beta - kicks%beta(n:1:-1), kicks%gamma + kicks%gamma(n:1:-1), &
                                  kicks%eta - kicks%eta(n:1:-1), kicks%kappa - kicks%kappa(n:1:-1), &
                                  kicks%share - kicks%share(n:1:-1)])) < tolerance
      if (is_palindrome .and. kicks%is_word()) &
         is_palindrome = maxval(abs(kicks%decay - kicks%decay(n:1:-1))) < tolerance
   end function is_palindrome

end module symsde_scheme_splitting
