! SPDX-License-Identifier: BSD-3-Clause
!>    H = p^2/2 - cos q,   H_1 = sigma (p^2 + q^2)/2
!>    dp = -sin q dt - sigma q o dW,   dq = p dt + sigma p o dW
!>
!> A pendulum with one multiplicative noise: H_{1,p} H_{1,q} = sigma^2 p q does not vanish, so one-sided schemes need
!> their correction here. {H_1,H} = sigma p (q - sin q) does not vanish either, so that no part of a scheme's error
!> vanishes, unlike on Kubo's oscillator. Time is in units of 1/(frequency of small oscillations). q is not reduced
!> modulo 2 pi, since H_1 is not periodic.
module symsde_model_catalogue_pendulum
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_maps, only: step_map, euler_map, euler_adjoint_map, verlet_map
   use symsde_base_record, only: steps_record
   use symsde_base_sincos, only: sincos_lanes, sincos_tile, sincos_where_weighted
   use symsde_base_status, only: error_type
   use symsde_base_text, only: name_length
   use symsde_base_traits, only: model_traits
   use symsde_model_kernels, only: angle_terms
   use symsde_model_parameters, only: require_finite, is_zero
   use symsde_model_flows_pendulum, only: pendulum_euler_flow
   use symsde_model_separable, only: separable_model
   use symsde_model_flows_sine, only: sine_terms, sine_flow
   implicit none
   private
   public :: pendulum_model, new_pendulum, pendulum_names, pendulum_defaults

   !   sigma [1/time^(1/2)], where time is in units of 1/(frequency of small oscillations)
   character(*), parameter :: pendulum_names(1) = [character(len=name_length) :: 'sigma']
   real(wp), parameter :: pendulum_defaults(1) = [0.5_wp]

   type, extends(separable_model) :: pendulum_model
      private
      real(wp) :: sigma = 0    !! intensity of the noise [1/sqrt(time)]
      integer(i8) :: none = 0  !! zero bits for `rounded`
   contains
      procedure :: value => weighted_value
      procedure :: evaluate
      procedure :: third_derivative
      procedure :: angle
      procedure :: has_flow
      procedure :: flow
   end type pendulum_model

contains

   !> Make a pendulum. Refuses a parameter that is not finite (invalid_argument).
   subroutine new_pendulum(self, sigma, error)
      type(pendulum_model), intent(out) :: self
      real(wp), intent(in) :: sigma  !! intensity of the noise [1/sqrt(time)]
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) return
      call require_finite('new_pendulum', 'sigma', sigma, error)
      if (allocated(error)) return
      self%sigma = sigma
      self%name = 'pendulum'
      ! grad H_1 = sigma (q, p) has the Lipschitz constant |sigma|; the slope of sin q is at most one.
      self%traits = model_traits( &
                    ndof=1, nnoise=1, separable=.true., additive=is_zero(sigma), &
                    position_noise=is_zero(sigma), identity_mass=.true., &
                    has_value=.true., has_hessian=.true., has_hessian_vector=.true., &
                    has_third_derivative=.true., autonomous=.true., &
                    max_frequency=1.0_wp, noise_lipschitz=abs(sigma))
      self%offers%angle = .true.
      ! Without noise the model counts as additive with noise in position, so that every scheme is allowed.
      allocate (self%traits%silent(1), source=is_zero(sigma))
   end subroutine new_pendulum

   !> Value of sum_j w_j H_j.
   subroutine weighted_value(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(pendulum_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)
      real(wp) :: sine(nlane), cosine(nlane)

      !   S = w_0 (p^2/2 - cos q) + sigma w_1 (p^2 + q^2)/2
      call sincos_lanes(nlane, q(:, 1), sine, cosine)
      value = w(:, 0)*(p(:, 1)**2/2 - cosine) + self%sigma*w(:, 1)*(p(:, 1)**2 + q(:, 1)**2)/2
   end subroutine weighted_value

   !> Compute the gradient and the diagonal Hessian blocks of sum_j w_j H_j that are present.
   subroutine evaluate(self, nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hpp)
      class(pendulum_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hpp(nlane, ndof, ndof)
      real(wp) :: sine(sincos_tile), cosine(sincos_tile), sigma
      integer(i8) :: none
      integer :: first, last, n

      !   S_q = w_0 sin q + sigma w_1 q,       S_p  = (w_0 + sigma w_1) p
      !   S_qq = w_0 cos q + sigma w_1,        S_pp = w_0 + sigma w_1
      sigma = self%sigma
      ! The compiler cannot know that the component `none` is zero, and so keeps the operation on bits below.
      none = self%none
      if (present(hq) .or. present(hqq)) then
         do first = 1, nlane, sincos_tile
            n = min(sincos_tile, nlane - first + 1)
            last = first + n - 1
            call sincos_where_weighted(n, w(first, 0), q(first, 1), sine, cosine)
            if (present(hq)) hq(first:last, 1) = w(first:last, 0)*sine(:n) &
                                                 + rounded(sigma*w(first:last, 1)*q(first:last, 1), none)
            if (present(hqq)) hqq(first:last, 1, 1) = w(first:last, 0)*cosine(:n) &
                                                      + rounded(sigma*w(first:last, 1), none)
         end do
      end if
      ! T = (w_0 + sigma w_1) p^2/2 needs no sine and is not computed by tiles.
      if (present(hp)) hp(:, 1) = (w(:, 0) + rounded(sigma*w(:, 1), none))*p(:, 1)
      if (present(hpp)) hpp(:, 1, 1) = w(:, 0) + rounded(sigma*w(:, 1), none)
   end subroutine evaluate

   !> Round a product before it is added. The compiler may contract a sum of two products with either product, and would
   !> choose differently in lanes and in the terms of a single path; it ignores parentheses when it makes vectors. A
   !> product that passes through an integer operation is never contracted.
   elemental real(wp) function rounded(product, none)
      real(wp), intent(in) :: product
      integer(i8), intent(in) :: none  !! 0, which the compiler must not know

      ! `ior` with zero changes no bit of the product.
      rounded = transfer(ior(transfer(product, 0_i8), none), 0.0_wp)
   end function rounded

   !> The terms for one path, see model_type.
   subroutine angle(self, nnoise, t, w, terms)
      class(pendulum_model), intent(in) :: self
      integer, intent(in) :: nnoise
      real(wp), intent(in) :: t, w(0:nnoise)
      type(angle_terms), intent(out) :: terms

      !   S = e p^2/2 - a cos q + c q^2/2,   a = w_0,  c = sigma w_1,  e = w_0 + sigma w_1
      terms%a = w(0)
      terms%b = -0.0_wp  ! negative zeros, so that adding them preserves signs
      terms%c = rounded(self%sigma*w(1), self%none)
      terms%d = -0.0_wp
      terms%e = w(0) + terms%c
   end subroutine angle

   !> The gradient of a^T S'' b, S = sum_j w_j H_j: -w_0 sin q a_q b_q in q alone.
   subroutine third_derivative(self, nlane, ndof, nnoise, t, w, q, p, aq, ap, bq, bp, uq, up)
      class(pendulum_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: aq(nlane, ndof), ap(nlane, ndof), bq(nlane, ndof), bp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      real(wp) :: sine(sincos_tile), cosine(sincos_tile)
      integer :: first, last, n

      do first = 1, nlane, sincos_tile
         n = min(sincos_tile, nlane - first + 1)
         last = first + n - 1
         call sincos_where_weighted(n, w(first, 0), q(first, 1), sine, cosine)
         !   d/dq (w_0 cos q a_q b_q) = -w_0 sin q a_q b_q
         uq(first:last, 1) = -w(first:last, 0)*sine(:n)*(aq(first:last, 1)*bq(first:last, 1))
      end do
      ! No Hamiltonian has third derivatives in p, or mixed ones: H_1 is quadratic.
      up = 0
   end subroutine third_derivative

   !> Whether `flow` can take steps by this map.
   pure logical function has_flow(self, map)
      class(pendulum_model), intent(in) :: self
      type(step_map), intent(in) :: map

      has_flow = map%equation == verlet_map
      if (map%corrected) has_flow = any(map%equation == [euler_map, euler_adjoint_map])
   end function has_flow

   !> Whole steps, see model_type.
   subroutine flow(self, map, steps, ndof, q, p, qn, pn, status, counters)
      class(pendulum_model), intent(in) :: self
      type(step_map), intent(in) :: map
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: ndof
      real(wp), intent(in) :: q(steps%nlane, ndof), p(steps%nlane, ndof)
      real(wp), intent(out) :: qn(steps%nlane, ndof, steps%nstep/steps%every)
      real(wp), intent(out) :: pn(steps%nlane, ndof, steps%nstep/steps%every)
      integer(i8), intent(inout) :: status(steps%nlane)
      type(counters_type), intent(inout) :: counters

      ! The corrected Euler pair needs no iteration, as H_1 is quadratic; Stormer-Verlet needs no correction.
      if (map%corrected) then
         call pendulum_euler_flow(map%equation == euler_adjoint_map, self%sigma, steps, q, p, qn, pn, counters)
      else
         !   kick by sin q h + sigma dW q,   drift by (h + sigma dW) p
         call sine_flow(sine_terms(c=self%sigma, e=self%sigma, noise_c=1, noise_e=1), &
                        steps, q, p, qn, pn, counters)
      end if
   end subroutine flow

end module symsde_model_catalogue_pendulum
