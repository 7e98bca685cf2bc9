! SPDX-License-Identifier: BSD-3-Clause
!>    H = (p.p + q.q)/2 + alpha (q_1^2 q_2 - q_2^3/3),   H_1 = sigma1 q_1,   H_2 = sigma2 q_2
!>    dp_1 = -(q_1 + 2 alpha q_1 q_2) dt - sigma1 dW_1,             dq_1 = p_1 dt
!>    dp_2 = -(q_2 + alpha (q_1^2 - q_2^2)) dt - sigma2 dW_2,       dq_2 = p_2 dt
!>
!> The Henon-Heiles system with an additive noise on each momentum; two degrees of freedom. The potential is unbounded
!> below: beyond three saddles, at distance 1/alpha with energy 1/(6 alpha^2), paths escape and then overflow. As long
!> as no path does, E H = H_0 + (sigma1^2 + sigma2^2) t/2. The unit of time is 1/(frequency of small oscillations).
!>
!> Units: alpha is [1/length], and sigma1 and sigma2 are [1/sqrt(time)] in units of length and of the frequency.
module symsde_model_catalogue_henon_heiles
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_maps, only: step_map
   use symsde_base_record, only: steps_record
   use symsde_base_status, only: error_type
   use symsde_base_text, only: name_length
   use symsde_base_traits, only: model_traits
   use symsde_model_flows_henon_heiles, only: henon_heiles_terms, henon_heiles_flow, henon_heiles_has_flow
   use symsde_model_parameters, only: require_finite, is_zero
   use symsde_model_separable, only: separable_model
   implicit none
   private
   public :: henon_heiles_model, new_henon_heiles, henon_heiles_names, henon_heiles_defaults

   ! The saddles have the energy 1/6 with alpha = 1, and the noises add 1/100 to the mean energy per unit of time.
   character(*), parameter :: henon_heiles_names(3) = &
                              [character(len=name_length) :: 'alpha', 'sigma1', 'sigma2']
   real(wp), parameter :: henon_heiles_defaults(3) = [1.0_wp, 0.1_wp, 0.1_wp]

   type, extends(separable_model) :: henon_heiles_model
      private
      real(wp) :: alpha = 0     !! strength of the cubic term
      real(wp) :: sigma1 = 0    !! noise of p_1
      real(wp) :: sigma2 = 0    !! noise of p_2
   contains
      procedure :: value => weighted_value
      procedure :: gradient
      procedure :: evaluate
      procedure :: sweeps
      procedure :: pair
      procedure :: has_flow
      procedure :: flow
   end type henon_heiles_model

contains

   !> Make a Henon-Heiles system. Refuses parameters that are not finite (invalid_argument).
   subroutine new_henon_heiles(self, alpha, sigma1, sigma2, error)
      type(henon_heiles_model), intent(out) :: self
      real(wp), intent(in) :: alpha   !! strength of the cubic term [1/length]
      real(wp), intent(in) :: sigma1  !! noise of p_1 [1/sqrt(time)]
      real(wp), intent(in) :: sigma2  !! noise of p_2 [1/sqrt(time)]
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) return
      call require_finite('new_henon_heiles', 'alpha', alpha, error)
      call require_finite('new_henon_heiles', 'sigma1', sigma1, error)
      call require_finite('new_henon_heiles', 'sigma2', sigma2, error)
      if (allocated(error)) return
      self%alpha = alpha
      self%sigma1 = sigma1
      self%sigma2 = sigma2
      self%name = 'henon_heiles'
      ! Both frequencies of the linear part are one, for schemes that rotate; the frequencies of H itself are unbounded.
      self%traits = model_traits( &
                    ndof=2, nnoise=2, separable=.true., additive=.true., position_noise=.true., autonomous=.true., &
                    quadratic=is_zero(alpha), identity_mass=.true., rotation=[1.0_wp, 1.0_wp], &
                    has_value=.true., has_hessian=.true., has_hessian_vector=.true.)
      self%offers%pair = .true.
      self%offers%sweeps = .true.
      ! A noise of strength zero is not drawn.
      allocate (self%traits%silent(2))
      self%traits%silent(1) = is_zero(sigma1)
      self%traits%silent(2) = is_zero(sigma2)
   end subroutine new_henon_heiles

   !> Value of sum_j w_j H_j.
   subroutine weighted_value(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(henon_heiles_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)

      !   S = w_0 H + sigma1 w_1 q_1 + sigma2 w_2 q_2
      value = w(:, 0)*((p(:, 1)**2 + p(:, 2)**2 + q(:, 1)**2 + q(:, 2)**2)/2 &
                       + self%alpha*(q(:, 1)**2*q(:, 2) - q(:, 2)**3/3)) &
              + self%sigma1*w(:, 1)*q(:, 1) + self%sigma2*w(:, 2)*q(:, 2)
   end subroutine weighted_value

   !> Gradient of sum_j w_j H_j, without calling `evaluate`: single paths mostly need only the gradient.
   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(henon_heiles_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)

      !   S_q1 = w_0 (q_1 + 2 alpha q_1 q_2) + sigma1 w_1,   S_q2 = w_0 (q_2 + alpha (q_1^2 - q_2^2)) + sigma2 w_2
      if (present(hq) .and. nlane == 1) then
         call force_of_one(self%alpha, self%sigma1, self%sigma2, w(1, 0), w(1, 1), w(1, 2), q(1, 1), q(1, 2), &
                           hq(1, 1), hq(1, 2))
      else if (present(hq)) then
         call force(nlane, self%alpha, self%sigma1, self%sigma2, w, q, hq)
      end if
      if (present(hp)) then
         hp(:, 1) = w(:, 0)*p(:, 1)
         hp(:, 2) = w(:, 0)*p(:, 2)
      end if
   end subroutine gradient

   !> Compute the gradient and the diagonal Hessian blocks of sum_j w_j H_j that are present.
   subroutine evaluate(self, nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hpp)
      class(henon_heiles_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hpp(nlane, ndof, ndof)

      call self%gradient(nlane, ndof, nnoise, t, w, q, p, hq, hp)
      !   S_qq = w_0 (1 + 2 alpha q_2, 2 alpha q_1; 2 alpha q_1, 1 - 2 alpha q_2),   S_pp = w_0 I
      if (present(hqq)) call stiffness(nlane, self%alpha, w, q, hqq)
      if (present(hpp)) then
         ! Masses are one: S_pp = w_0 I.
         hpp(:, 1, 1) = w(:, 0)
         hpp(:, 2, 1) = 0
         hpp(:, 1, 2) = 0
         hpp(:, 2, 2) = w(:, 0)
      end if
   end subroutine evaluate

   !> VEC Gradient in q.
   !> hq(:, 1) = w_0 (q_1 + 2 alpha q_1 q_2) + sigma1 w_1,   hq(:, 2) = w_0 (q_2 + alpha (q_1^2 - q_2^2)) + sigma2 w_2
   pure subroutine force(nlane, alpha, sigma1, sigma2, w, q, hq)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: alpha, sigma1, sigma2, w(nlane, 0:2), q(nlane, 2)
      real(wp), intent(out) :: hq(nlane, 2)
      integer :: lane

      do lane = 1, nlane
         call force_of_one(alpha, sigma1, sigma2, w(lane, 0), w(lane, 1), w(lane, 2), q(lane, 1), q(lane, 2), &
                           hq(lane, 1), hq(lane, 2))
      end do
   end subroutine force

   !> VEC Hessian in q. Noise is linear in q and does not contribute; the matrix is symmetric and stored in full.
   pure subroutine stiffness(nlane, alpha, w, q, hqq)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: alpha, w(nlane), q(nlane, 2)
      real(wp), intent(out) :: hqq(nlane, 2, 2)
      integer :: lane

      do lane = 1, nlane
         call stiffness_of_one(alpha, w(lane), q(lane, 1), q(lane, 2), hqq(lane, 1, 1), hqq(lane, 2, 1), &
                               hqq(lane, 2, 2))
         hqq(lane, 1, 2) = hqq(lane, 2, 1)
      end do
   end subroutine stiffness

   !> The Hessian in q of one lane.
   !> S_qq = w_0 (1 + 2 alpha q_2, 2 alpha q_1; 2 alpha q_1, 1 - 2 alpha q_2), as k11, k21 = k12 and k22
   pure subroutine stiffness_of_one(alpha, w, q1, q2, k11, k21, k22)
      real(wp), intent(in) :: alpha, w, q1, q2
      real(wp), intent(out) :: k11, k21, k22

      ! The trace is 2 w_0 whatever q is, as alpha (q_1^2 q_2 - q_2^3/3) is a harmonic function.
      k11 = w*(1 + 2*alpha*q2)
      k21 = w*2*alpha*q1
      k22 = w*(1 - 2*alpha*q2)
   end subroutine stiffness_of_one

   !> The gradient in q of one lane. For a single path only three operations depend on each other. Products with q come
   !> first in each sum, so that the compiler contracts the same products wherever it inlines this function.
   pure subroutine force_of_one(alpha, sigma1, sigma2, w, w1, w2, q1, q2, hq1, hq2)
      real(wp), intent(in) :: alpha, sigma1, sigma2, w, w1, w2, q1, q2
      real(wp), intent(out) :: hq1, hq2

      ! The sum with the noise does not depend on the product of the positions: both are computed at once and added
      ! last.
      hq1 = (w*q1 + sigma1*w1) + (2*alpha*w)*q1*q2
      hq2 = (w*q2 + sigma2*w2) + (alpha*w)*(q1**2 - q2**2)
   end subroutine force_of_one

   !> Sweeps over stages of one path, see model_type: base(i, :) is Q_i without forces, b(j, i, :) the coefficient of
   !> the force of stage j in Q_i, f(:, :, k) the forces after sweep k; f(:, :, first - 1) is given. For every number of
   !> stages there are loops of constant length.
   subroutine sweeps(self, nnoise, nstage, i1, i2, first, last, t, w, p, base, b, most, f, change, extent)
      class(henon_heiles_model), intent(in) :: self
      integer, intent(in) :: nnoise, nstage, i1, i2, first, last, most
      real(wp), intent(in) :: t(nstage), w(0:nnoise), p(self%traits%ndof), base(4, 2), b(4, 4, 2)
      real(wp), intent(inout) :: f(4, 2, 0:most)
      real(wp), intent(inout), dimension(most) :: change, extent

      associate (alpha => self%alpha, s1 => self%sigma1, s2 => self%sigma2)
         ! With constants the compiler knows the length of the loops and unrolls them.
         select case (nstage)
         case (2)
            call sweep_stages(2, alpha, s1, s2, w(0), w(1), w(2), i1, i2, first, last, base, b, most, f, change, extent)
         case (3)
            call sweep_stages(3, alpha, s1, s2, w(0), w(1), w(2), i1, i2, first, last, base, b, most, f, change, extent)
         case default
            call sweep_stages(4, alpha, s1, s2, w(0), w(1), w(2), i1, i2, first, last, base, b, most, f, change, extent)
         end select
      end associate
   end subroutine sweeps

   !> The sweeps for s stages. The numbers of a stage are not adjacent in memory, since gcc would build vectors from
   !> adjacent numbers and take them apart again.
   pure subroutine sweep_stages(s, alpha, sigma1, sigma2, h, w1, w2, i1, i2, first, last, base, b, most, f, change, &
                                extent)
      integer, value :: s, i1, i2, first, last
      real(wp), value :: alpha, sigma1, sigma2, h, w1, w2
      integer, intent(in) :: most
      real(wp), intent(in) :: base(4, 2), b(4, 4, 2)
      real(wp), intent(inout) :: f(4, 2, 0:most)
      real(wp), intent(inout), dimension(most) :: change, extent
      real(wp) :: f1(4), f2(4), x1, x2, new1, new2, moved, size
      integer :: i, j, k, m, at

      do i = 1, s
         ! The forces of all stages are kept in registers, one array for each degree of freedom.
         f1(i) = f(i, 1, first - 1)
         f2(i) = f(i, 2, first - 1)
      end do
      do k = first, last
         ! Q_i = base_i + sum_j b_ji f_j;   f_i = S_q(Q_i),   i = i1 .. i2, each with the newest forces of all other
         ! stages
         ! The first sweep has coefficients b(:, :, 1); all later sweeps share b(:, :, 2).
         at = min(k, 2)
         moved = 0
         size = 0
         !GCC$ unroll 4
         !GCC$ novector
         do i = 1, s
            ! Stages outside i1 .. i2 keep their forces, which are known or have no effect.
            if (i >= i1 .and. i <= i2) then
               x1 = base(i, 1)
               x2 = base(i, 2)
               ! The sum begins with the stage itself and ends with the newest force, which is the force of the stage
               ! before: so few operations lie between one force and the next.
               !GCC$ unroll 4
               !GCC$ novector
               do m = i, i + s - 1
                  ! The order of stages is cyclic: i, i + 1, .., i - 1.
                  j = merge(m - s, m, m > s)
                  x1 = x1 + b(j, i, at)*f1(j)
                  x2 = x2 + b(j, i, at)*f2(j)
               end do
               call force_of_one(alpha, sigma1, sigma2, h, w1, w2, x1, x2, new1, new2)
               ! The caller judges the largest change and the largest force.
               moved = max(moved, max(abs(new1 - f1(i)), abs(new2 - f2(i))))
               size = max(size, max(abs(new1), abs(new2)))
               f1(i) = new1
               f2(i) = new2
            end if
            f(i, 1, k) = f1(i)
            f(i, 2, k) = f2(i)
         end do
         change(k) = moved
         extent(k) = size
      end do
   end subroutine sweep_stages

   !> Force and stiffness of one path, see model_type. The operations are those of a block, so that a single path
   !> has the same bits.
   subroutine pair(self, nnoise, t, w, q1, q2, f1, f2, k11, k21, k12, k22)
      class(henon_heiles_model), intent(in) :: self
      integer, intent(in) :: nnoise
      real(wp), intent(in) :: t, w(0:nnoise)
      real(wp), value :: q1, q2
      real(wp), intent(out) :: f1, f2, k11, k21, k12, k22

      call force_of_one(self%alpha, self%sigma1, self%sigma2, w(0), w(1), w(2), q1, q2, f1, f2)
      call stiffness_of_one(self%alpha, w(0), q1, q2, k11, k21, k22)
      k12 = k21
   end subroutine pair

   !> Whether `flow` can take steps by this map.
   pure logical function has_flow(self, map)
      class(henon_heiles_model), intent(in) :: self
      type(step_map), intent(in) :: map

      has_flow = henon_heiles_has_flow(map)
   end function has_flow

   !> Whole steps, see model_type.
   subroutine flow(self, map, steps, ndof, q, p, qn, pn, status, counters)
      class(henon_heiles_model), intent(in) :: self
      type(step_map), intent(in) :: map
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: ndof
      real(wp), intent(in) :: q(steps%nlane, ndof), p(steps%nlane, ndof)
      real(wp), intent(out) :: qn(steps%nlane, ndof, steps%nstep/steps%every)
      real(wp), intent(out) :: pn(steps%nlane, ndof, steps%nstep/steps%every)
      integer(i8), intent(inout) :: status(steps%nlane)
      type(counters_type), intent(inout) :: counters

      ! Escaping paths overflow to states that are not finite: status is not set here, and the library detects them.
      call henon_heiles_flow(map, henon_heiles_terms(self%alpha, self%sigma1, self%sigma2), steps, q, p, qn, pn, &
                             counters)
   end subroutine flow

end module symsde_model_catalogue_henon_heiles
