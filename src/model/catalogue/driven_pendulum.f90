! SPDX-License-Identifier: BSD-3-Clause
!>    H = p^2/2 - omega^2 (1 + epsilon cos nu t) cos q
!>    H_1 = -sigma1 s(t) q,   H_2 = -sigma2 s(t) cos q,   s(t) = 1 + alpha sin nu t
!>    dp = -omega^2 (1 + epsilon cos nu t) sin q dt + s(t) (sigma1 dW_1 - sigma2 sin q dW_2),   dq = p dt
!>
!> A pendulum with a driven point of suspension and noises whose strength oscillates: everything but p^2/2 depends on
!> time. Modulated traps and synchrotrons with a modulated voltage have this form. H_1 is a random torque (additive),
!> H_2 moves the point of suspension. Small oscillations follow Mathieu's equation; nu = 2 omega is its main resonance.
!> Noises in position commute at all times. Schemes differ here in the times at which they evaluate forces: at the times
!> of their stages, or at one time of the step.
!>
!> Units: q has none, p, omega and nu are [1/time], H is [1/time^2], and sigma1 and sigma2 are [1/time^(3/2)];
!> epsilon and alpha have none.
module symsde_model_catalogue_driven_pendulum
   use symsde_base_kinds, only: wp
   use symsde_base_sincos, only: sincos_lanes, sincos_one, sincos_tile
   use symsde_base_status, only: error_type
   use symsde_base_text, only: name_length
   use symsde_base_traits, only: model_traits
   use symsde_model_kernels, only: angle_terms
   use symsde_model_parameters, only: require_finite, is_zero
   use symsde_model_separable, only: separable_model
   implicit none
   private
   public :: driven_pendulum_model, new_driven_pendulum, driven_pendulum_names, driven_pendulum_defaults

   ! By default nu = 2 omega, the main resonance: oscillations grow until they are large.
   character(*), parameter :: driven_pendulum_names(6) = &
                              [character(len=name_length) :: 'omega', 'epsilon', 'nu', 'sigma1', 'sigma2', 'alpha']
   real(wp), parameter :: driven_pendulum_defaults(6) = [1.0_wp, 0.3_wp, 2.0_wp, 0.2_wp, 0.1_wp, 0.5_wp]

   type, extends(separable_model) :: driven_pendulum_model
      private
      real(wp) :: omega2 = 0    !! square of the frequency [1/time^2]
      real(wp) :: epsilon = 0   !! depth of the drive [1]
      real(wp) :: nu = 0        !! angular frequency of the drive and of the noises' strength [1/time]
      real(wp) :: sigma1 = 0    !! noise of the torque [1/time^(3/2)]
      real(wp) :: sigma2 = 0    !! noise of the point of suspension [1/time^(3/2)]
      real(wp) :: alpha = 0     !! depth of the oscillation of the noises' strength [1]
   contains
      procedure :: value => weighted_value
      procedure :: evaluate
      procedure :: angle
      procedure, private :: combine
   end type driven_pendulum_model

contains

   !> Make a driven pendulum. Refuses parameters that are not finite, or an omega whose square overflows
   !> (invalid_argument).
   subroutine new_driven_pendulum(self, omega, epsilon, nu, sigma1, sigma2, alpha, error)
      type(driven_pendulum_model), intent(out) :: self
      real(wp), intent(in) :: omega    !! frequency of small oscillations without drive [1/time]
      real(wp), intent(in) :: epsilon  !! depth of the drive [1]
      real(wp), intent(in) :: nu       !! angular frequency of the drive and of the noises' strength [1/time]
      real(wp), intent(in) :: sigma1   !! noise of the torque [1/time^(3/2)]
      real(wp), intent(in) :: sigma2   !! noise of the point of suspension [1/time^(3/2)]
      real(wp), intent(in) :: alpha    !! depth of the oscillation of the noises' strength [1]
      type(error_type), allocatable, intent(inout) :: error
      real(wp) :: strength

      if (allocated(error)) return
      call require_finite('new_driven_pendulum', 'omega', omega, error)
      call require_finite('new_driven_pendulum', 'epsilon', epsilon, error)
      call require_finite('new_driven_pendulum', 'nu', nu, error)
      call require_finite('new_driven_pendulum', 'sigma1', sigma1, error)
      call require_finite('new_driven_pendulum', 'sigma2', sigma2, error)
      call require_finite('new_driven_pendulum', 'alpha', alpha, error)
      call require_finite('new_driven_pendulum', 'omega**2', omega**2, error)
      if (allocated(error)) return
      self%omega2 = omega**2
      self%epsilon = epsilon
      self%nu = nu
      self%sigma1 = sigma1
      self%sigma2 = sigma2
      self%alpha = alpha
      self%name = 'driven_pendulum'
      ! Lipschitz constants: zero for the torque, at most sigma2 (1 + |alpha|) for sigma2 s(t) sin q. The frequency
      ! of H is at most omega sqrt(1 + |epsilon|).
      strength = abs(sigma2)*(1 + abs(alpha))
      self%traits = model_traits( &
                    ndof=1, nnoise=2, separable=.true., position_noise=.true., additive=is_zero(sigma2), &
                    identity_mass=.true., has_value=.true., has_hessian=.true., has_hessian_vector=.true., &
                    max_frequency=abs(omega)*sqrt(1 + abs(epsilon)), noise_lipschitz=strength)
      self%offers%angle = .true.
      allocate (self%traits%silent(2))
      self%traits%silent(1) = is_zero(sigma1)
      self%traits%silent(2) = is_zero(sigma2)
      ! Rotations use the linear part without drive; kicks contain the drive.
      allocate (self%traits%rotation(1), source=abs(omega))
   end subroutine new_driven_pendulum

   !> Value of sum_j w_j H_j.
   subroutine weighted_value(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(driven_pendulum_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)
      real(wp), dimension(nlane) :: sine, cosine, torque, pull

      call sincos_lanes(nlane, q(:, 1), sine, cosine)
      !   S = w_0 p^2/2 - pull cos q - torque q
      call self%combine(nlane, t, w(:, 0), w(:, 1), w(:, 2), torque, pull)
      value = w(:, 0)*p(:, 1)**2/2 - pull*cosine - torque*q(:, 1)
   end subroutine weighted_value

   !> Compute the gradient and the diagonal Hessian blocks of sum_j w_j H_j that are present.
   subroutine evaluate(self, nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hpp)
      class(driven_pendulum_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hpp(nlane, ndof, ndof)
      real(wp), dimension(sincos_tile) :: sine, cosine, torque, pull
      integer :: first, last, n

      !   S_q = pull sin q - torque,   S_qq = pull cos q,   S_p = w_0 p,   S_pp = w_0
      if (present(hq) .or. present(hqq)) then
         ! A tile's torque and pull stay in the cache together with its sines.
         do first = 1, nlane, sincos_tile
            n = min(sincos_tile, nlane - first + 1)
            last = first + n - 1
            call sincos_lanes(n, q(first, 1), sine, cosine)
            call self%combine(n, t, w(first, 0), w(first, 1), w(first, 2), torque, pull)
            if (present(hq)) hq(first:last, 1) = pull(:n)*sine(:n) - torque(:n)
            if (present(hqq)) hqq(first:last, 1, 1) = pull(:n)*cosine(:n)
         end do
      end if
      if (present(hp)) hp(:, 1) = w(:, 0)*p(:, 1)
      if (present(hpp)) hpp(:, 1, 1) = w(:, 0)
   end subroutine evaluate

   !> The terms for one path, see model_type.
   subroutine angle(self, nnoise, t, w, terms)
      class(driven_pendulum_model), intent(in) :: self
      integer, intent(in) :: nnoise
      real(wp), intent(in) :: t, w(0:nnoise)
      type(angle_terms), intent(out) :: terms
      real(wp), dimension(1) :: torque, pull

      call self%combine(1, t, w(0:0), w(1:1), w(2:2), torque, pull)
      !   S = e p^2/2 - a cos q + d q
      terms%a = pull(1)
      terms%d = -torque(1)
      terms%e = w(0)
   end subroutine angle

   !> The sum is w_0 p^2/2 - pull cos q - torque q. The time t belongs to a stage, t_n + c_i h.
   subroutine combine(self, nlane, t, w0, w1, w2, torque, pull)
      class(driven_pendulum_model), intent(in) :: self
      integer, intent(in) :: nlane
      real(wp), intent(in) :: t
      real(wp), intent(in), dimension(nlane) :: w0, w1, w2
      real(wp), intent(out) :: torque(nlane), pull(nlane)
      real(wp) :: sine, cosine, frequency2, strength

      ! Time is the same for all lanes: factors that depend on it are computed once.
      ! pull = omega^2 (1 + epsilon cos nu t) w_0 + sigma2 s(t) w_2,   torque = sigma1 s(t) w_1
      sine = sincos_one(self%nu*t, cosine)
      frequency2 = self%omega2*(1 + self%epsilon*cosine)
      strength = 1 + self%alpha*sine
      torque = self%sigma1*strength*w1
      pull = frequency2*w0 + self%sigma2*strength*w2
   end subroutine combine

end module symsde_model_catalogue_driven_pendulum
