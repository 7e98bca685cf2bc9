! SPDX-License-Identifier: BSD-3-Clause
!>    H = p^2/2 - omega^2 cos q,   H_1 = sigma1 sin q,   H_2 = -sigma2 cos q
!>    dp = -omega^2 sin q dt - sigma1 cos q dW_1 - sigma2 sin q dW_2,   dq = p dt
!>
!> Synchrotron oscillations of particles in storage rings [WHSB] (73)-(75): q is the phase of a particle, sigma1 noise
!> of the phase and sigma2 of the amplitude of the field. Noises in position commute, {H_1,H_2} = 0, the Ito and
!> Stratonovich equations are the same, and no scheme needs a correction. dE H/dt = E(sigma1^2 cos^2 q + sigma2^2 sin^2
!> q)/2, so that E H = H_0 + sigma^2 t/2 exactly if both strengths are sigma. Defaults are the data of figure 4.1 of
!> [WHSB].
!>
!> The paper derives the midpoint rule (82)-(83) for this model. Units: q has none, p and omega are [1/time], H is
!> [1/time^2], and sigma1 and sigma2 are [1/time^(3/2)], so that sigma dW is [1/time] like p.
module symsde_model_catalogue_synchrotron
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_maps, only: step_map, verlet_map
   use symsde_base_record, only: steps_record
   use symsde_base_sincos, only: sincos_lanes, sincos_tile
   use symsde_base_status, only: error_type
   use symsde_base_text, only: name_length
   use symsde_base_traits, only: model_traits
   use symsde_model_kernels, only: angle_terms
   use symsde_model_parameters, only: require_finite, is_zero
   use symsde_model_separable, only: separable_model
   use symsde_model_flows_sine, only: sine_terms, sine_flow
   implicit none
   private
   public :: synchrotron_model, new_synchrotron, synchrotron_names, synchrotron_defaults

   !   omega [1/time],  sigma1 and sigma2 [1/time^(3/2)], as q has no unit and p = dq/dt
   character(*), parameter :: synchrotron_names(3) = &
                              [character(len=name_length) :: 'omega', 'sigma1', 'sigma2']
   real(wp), parameter :: synchrotron_defaults(3) = [2.0_wp, 0.2_wp, 0.1_wp]

   type, extends(separable_model) :: synchrotron_model
      private
      real(wp) :: omega2 = 0    !! square of the frequency [1/time^2]
      real(wp) :: sigma1 = 0    !! noise with cos q [1/time^(3/2)]
      real(wp) :: sigma2 = 0    !! noise with sin q [1/time^(3/2)]
   contains
      procedure :: value => weighted_value
      procedure :: evaluate
      procedure :: angle
      procedure :: has_flow
      procedure :: flow
   end type synchrotron_model

contains

   !> Make a synchrotron. Refuses parameters that are not finite, or an omega whose square overflows (invalid_argument).
   subroutine new_synchrotron(self, omega, sigma1, sigma2, error)
      type(synchrotron_model), intent(out) :: self
      real(wp), intent(in) :: omega   !! frequency of small oscillations [1/time]
      real(wp), intent(in) :: sigma1  !! noise with the force cos q [1/time^(3/2)]
      real(wp), intent(in) :: sigma2  !! noise with the force sin q [1/time^(3/2)]
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) return
      call require_finite('new_synchrotron', 'omega', omega, error)
      call require_finite('new_synchrotron', 'sigma1', sigma1, error)
      call require_finite('new_synchrotron', 'sigma2', sigma2, error)
      call require_finite('new_synchrotron', 'omega**2', omega**2, error)
      if (allocated(error)) return
      ! H depends on omega only by its square, which was checked above for overflow.
      self%omega2 = omega**2
      self%sigma1 = sigma1
      self%sigma2 = sigma2
      self%name = 'synchrotron'
      ! Positions change by h p alone, and sin q and cos q have slopes of at most one: hence these bounds.
      self%traits = model_traits( &
                    ndof=1, nnoise=2, separable=.true., position_noise=.true., &
                    additive=is_zero(sigma1) .and. is_zero(sigma2), identity_mass=.true., &
                    has_value=.true., has_hessian=.true., has_hessian_vector=.true., &
                    autonomous=.true., &
                    max_frequency=abs(omega), noise_lipschitz=abs(sigma1) + abs(sigma2))
      self%offers%angle = .true.
      allocate (self%traits%silent(2))
      ! The linear part of H is omega^2 q^2/2: small oscillations have the frequency omega.
      allocate (self%traits%rotation(1), source=abs(omega))
      ! With one strength zero the model has one noise; its draws do not depend on the other noise, so paths do not
      ! change.
      self%traits%silent(1) = is_zero(sigma1)
      self%traits%silent(2) = is_zero(sigma2)
   end subroutine new_synchrotron

   !> Value of sum_j w_j H_j.
   subroutine weighted_value(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(synchrotron_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)
      real(wp) :: sine(nlane), cosine(nlane)

      call sincos_lanes(nlane, q(:, 1), sine, cosine)
      !   S = w_0 p^2/2 + b sin q - a cos q,   a = omega^2 w_0 + sigma2 w_2,   b = sigma1 w_1
      value = w(:, 0)*p(:, 1)**2/2 + self%sigma1*w(:, 1)*sine &
              - (self%omega2*w(:, 0) + self%sigma2*w(:, 2))*cosine
   end subroutine weighted_value

   !> Compute the gradient and the diagonal Hessian blocks of sum_j w_j H_j that are present.
   subroutine evaluate(self, nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hpp)
      class(synchrotron_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hpp(nlane, ndof, ndof)

      !   S_q = a sin q + b cos q,   S_qq = a cos q - b sin q,   S_p = w_0 p,   S_pp = w_0
      if (present(hq) .and. present(hqq)) then
         call sincos_lanes(nlane, q, hq, hqq)  ! sine and cosine are stored in the output arrays
         call force_and_slope(nlane, self%omega2, self%sigma1, self%sigma2, w, hq, hqq)
      else if (present(hq)) then
         call force_alone(self, nlane, w, q, hq)
      else if (present(hqq)) then
         call slope_alone(self, nlane, w, q, hqq)
      end if
      !   T = w_0 p^2/2
      if (present(hp)) hp(:, 1) = w(:, 0)*p(:, 1)
      if (present(hpp)) hpp(:, 1, 1) = w(:, 0)
   end subroutine evaluate

   !> The terms for one path, see model_type.
   subroutine angle(self, nnoise, t, w, terms)
      class(synchrotron_model), intent(in) :: self
      integer, intent(in) :: nnoise
      real(wp), intent(in) :: t, w(0:nnoise)
      type(angle_terms), intent(out) :: terms

      !   S = e p^2/2 - a cos q + b sin q
      terms%a = self%omega2*w(0) + self%sigma2*w(2)
      terms%b = self%sigma1*w(1)
      terms%e = w(0)
   end subroutine angle

   !> Gradient in q without Hessian, for explicit schemes: cosines are stored for one tile, never for a block.
   subroutine force_alone(self, nlane, w, q, hq)
      class(synchrotron_model), intent(in) :: self
      integer, intent(in) :: nlane
      real(wp), intent(in) :: w(nlane, 0:2), q(nlane)
      real(wp), intent(out) :: hq(nlane)
      real(wp) :: cosine(sincos_tile)
      integer :: first, n

      ! Sine and cosine are computed one tile at a time; the sine is stored in hq.
      do first = 1, nlane, sincos_tile
         n = min(sincos_tile, nlane - first + 1)
         ! hq holds the sine until `force` replaces it by the force.
         call sincos_lanes(n, q(first), hq(first), cosine)
         ! The weights of H_j in this tile begin at w(first, j).
         call force(n, self%omega2, self%sigma1, self%sigma2, w(first, 0), w(first, 1), w(first, 2), cosine, hq(first))
      end do
   end subroutine force_alone

   !> Hessian in q without gradient. Few callers need it, such as Hessian-vector products; the force is computed and
   !> discarded.
   subroutine slope_alone(self, nlane, w, q, hqq)
      class(synchrotron_model), intent(in) :: self
      integer, intent(in) :: nlane
      real(wp), intent(in) :: w(nlane, 0:2), q(nlane)
      real(wp), intent(out) :: hqq(nlane)
      real(wp) :: sine(nlane)

      ! `sine` becomes the force, which is not used.
      call sincos_lanes(nlane, q, sine, hqq)
      call force_and_slope(nlane, self%omega2, self%sigma1, self%sigma2, w, sine, hqq)
   end subroutine slope_alone

   !> Whether `flow` can take steps by this map. Among the maps with whole steps only Stormer-Verlet needs no solver
   !> here.
   pure logical function has_flow(self, map)
      class(synchrotron_model), intent(in) :: self
      type(step_map), intent(in) :: map

      has_flow = map%equation == verlet_map
   end function has_flow

   !> Whole steps, see model_type.
   subroutine flow(self, map, steps, ndof, q, p, qn, pn, status, counters)
      class(synchrotron_model), intent(in) :: self
      type(step_map), intent(in) :: map
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: ndof
      real(wp), intent(in) :: q(steps%nlane, ndof), p(steps%nlane, ndof)
      real(wp), intent(out) :: qn(steps%nlane, ndof, steps%nstep/steps%every)
      real(wp), intent(out) :: pn(steps%nlane, ndof, steps%nstep/steps%every)
      integer(i8), intent(inout) :: status(steps%nlane)
      type(counters_type), intent(inout) :: counters

      ! In model/flows/sine r = omega^2, A = sigma2 with dW_2 and B = sigma1 with dW_1.
      call sine_flow(sine_terms(rate=self%omega2, a=self%sigma2, b=self%sigma1, noise_a=2, noise_b=1), &
                     steps, q, p, qn, pn, counters)
   end subroutine flow

   ! ---- kernels ----------------------------------------------------------------------------------

   !> hq = (omega^2 w_0 + sigma2 w_2) sin q + sigma1 w_1 cos q; hq is sin q on entry.
   pure subroutine force(nlane, omega2, sigma1, sigma2, w0, w1, w2, cosine, hq)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: omega2, sigma1, sigma2
      real(wp), intent(in), dimension(nlane) :: w0, w1, w2, cosine
      real(wp), intent(inout) :: hq(nlane)
      real(wp) :: a, b
      integer :: lane

      do lane = 1, nlane
         !   a = omega^2 w_0 + sigma2 w_2,   b = sigma1 w_1,   hq = a sin q + b cos q
         a = omega2*w0(lane) + sigma2*w2(lane)
         b = sigma1*w1(lane)
         hq(lane) = a*hq(lane) + b*cosine(lane)
      end do
   end subroutine force

   !> hq as in `force`, and hqq = (omega^2 w_0 + sigma2 w_2) cos q - sigma1 w_1 sin q, in one pass, for Newton's
   !> iteration; on entry hq is sin q and hqq is cos q.
   pure subroutine force_and_slope(nlane, omega2, sigma1, sigma2, w, hq, hqq)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: omega2, sigma1, sigma2, w(nlane, 0:2)
      real(wp), intent(inout) :: hq(nlane), hqq(nlane)
      real(wp) :: a, b, sine, cosine
      integer :: lane

      do lane = 1, nlane
         a = omega2*w(lane, 0) + sigma2*w(lane, 2)
         b = sigma1*w(lane, 1)
         sine = hq(lane)
         ! Read sine and cosine before the results overwrite them.
         cosine = hqq(lane)
         hq(lane) = a*sine + b*cosine
         hqq(lane) = a*cosine - b*sine
      end do
   end subroutine force_and_slope

end module symsde_model_catalogue_synchrotron
