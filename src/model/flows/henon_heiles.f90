! SPDX-License-Identifier: BSD-3-Clause
!>    H = (p.p + q.q)/2 + alpha (q_1^2 q_2 - q_2^3/3),   H_k = sigma_k q_k   (k = 1, 2)
!>
!> Whole steps of this system: drifts, and kicks at nodes c_i of the step, each with a part b_i of the potential and of
!> the noises. The schemes are Stormer-Verlet, the Euler pair, the other Lobatto pair of two stages, and schemes of
!> kicks from scheme/splitting, which for additive noise have no further parts: the force-gradient potential c h^2/2
!> sum_k H_k,q.H_k,q of scheme/kicks is constant because H_k,q is constant. Kick i and the drifts are
!>
!> dp_1 = -b_i (h (q_1 + 2 alpha q_1 q_2) + sigma1 W_1),  dp_2 = -b_i (h (q_2 + alpha (q_1^2 - q_2^2)) + sigma2 W_2),
!>    W_k = dW_k + (gamma_i/b_i) a_k,  a_k = dZ_k/h - dW_k/2,   dq = tau p
!>
!> or, if a scheme rotates, the exact flow of (p.p + q.q)/2 instead of a drift, and kicks without their linear part.
!> Every step is drift, kick, drift, kick, drift; parts that a scheme lacks have duration zero or part zero.
!>
!> The gamma_i obey gamma_1 + gamma_2 = 0 and gamma_1 c_1 + gamma_2 c_2 = -1 (scheme/kicks): so the kicks at the nodes
!> c_i together reproduce dZ. With Verlet's nodes 0 and 1 that is gamma = (1, -1), with Gauss's nodes (1 -+ 1/sqrt 3)/2
!> it is gamma = (sqrt 3, -sqrt 3). Kicks by dW alone have gamma = 0.
!>
!> If the model is damped, momenta decay in every drift, dq = p (1 - exp(-gamma tau))/gamma and p <- exp(-gamma tau) p,
!> and kicks by dZ use the parts of dW and of dZ/h - dW/2 that follow from the exact law of damped free motion
!> (base/record).
!>
!> A few lanes at a time take all of their steps; a single path does so in registers.
module symsde_model_flows_henon_heiles
   use symsde_base_counters, only: counters_type
   use symsde_base_damping, only: decay_less_one
   use symsde_base_functionals, only: path_dz
   use symsde_base_kinds, only: wp
   use symsde_base_maps, only: step_map, euler_map, euler_adjoint_map, verlet_map, verlet_swapped_map, &
                               drift_kick_drift_map, kick_drift_kick_map, two_kicks_map, two_kicks_rotation_map
   use symsde_base_record, only: steps_record
   use symsde_base_sincos, only: sine_of
   implicit none
   private
   public :: henon_heiles_terms, henon_heiles_flow, henon_heiles_has_flow

   integer, parameter :: tile = 64  !! lanes that take all of their steps together
   integer, parameter :: group = 4  !! steps of a group that stays in registers

   !> The strengths of the cubic force and of both noises.
   type :: henon_heiles_terms
      real(wp) :: alpha = 0, sigma1 = 0, sigma2 = 0
   end type henon_heiles_terms

   !> The two kicks and three drifts of a scheme. A kick or drift that the scheme lacks is zero.
   type :: kick_plan
      real(wp) :: drift(3) = 0    !! durations before, between and after the kicks, as parts of h
      integer :: nvelocity = 0    !! number of drifts that count as gradients, as in tableaux
      real(wp) :: part(2) = 0     !! b_i, part of potential and noises in each kick
      real(wp) :: shape(2) = 0    !! gamma_i/b_i, part of dZ/h - dW/2 in each kick
      real(wp) :: linear = 1      !! factor of the linear force in the kicks
      logical :: rotates = .false.  !! whether drifts are rotations, which include the linear force
      ! henon_heiles_flow fills the remaining components once for all steps of a call: they depend on h and on the
      ! system.
      real(wp) :: h = 0
      type(henon_heiles_terms) :: of = henon_heiles_terms()
      real(wp) :: tau(3) = 0      !! times of the drifts, or (1 - exp(-gamma tau))/gamma
      real(wp) :: half(2) = 0.5_wp !! part of dW subtracted from dZ/h in a; smaller if damping needs a larger part of dW
      logical :: decays = .false.
      real(wp) :: loss(3) = 0     !! change of a momentum in each drift, relative to it
      logical :: acts(3) = .false.  !! drifts that do anything
      ! A rotation by the angle tau_i is stored as cos tau_i - 1 and sin tau_i.
      real(wp) :: cosine_less_one(3) = 0, sine(3) = 0
   end type kick_plan

contains

   !> Whether this file implements steps by a map.
   pure logical function henon_heiles_has_flow(map) result(has_flow)
      type(step_map), intent(in) :: map
      type(kick_plan) :: plan

      call find_plan(map%equation, plan)
      has_flow = any(plan%part > 0) .and. .not. (map%corrected .or. (map%damped .and. plan%rotates))
   end function henon_heiles_has_flow

   !> Find the drifts and kicks of a map; for an unknown map all are zero.
   pure subroutine find_plan(equation, plan)
      integer, intent(in) :: equation
      type(kick_plan), intent(out) :: plan
      real(wp), parameter :: gauss = 0.5_wp*(1 - sqrt(1/3.0_wp))

      select case (equation)
         ! Each plan gives the drifts as fractions of h and the kicks as parts of the potential, in the order drift,
         ! kick, drift, kick, drift.
      case (euler_map)
         plan = kick_plan(drift=[0, 1, 0], part=[1, 0], nvelocity=1)
      case (euler_adjoint_map)
         plan = kick_plan(drift=[0, 1, 0], part=[0, 1], nvelocity=1)
      case (verlet_map)
         plan = kick_plan(drift=[0, 1, 0], part=[0.5_wp, 0.5_wp], nvelocity=1)
      case (verlet_swapped_map, drift_kick_drift_map)
         plan = kick_plan(drift=[0.5_wp, 0.5_wp, 0.0_wp], part=[1, 0])
         ! The two maps are equal here, but are counted as the general steppers count them: velocities of a tableau are
         ! gradients, and drifts of a splitting are not.
         if (equation == verlet_swapped_map) plan%nvelocity = 2
      case (kick_drift_kick_map)
         plan = kick_plan(drift=[0, 1, 0], part=[0.5_wp, 0.5_wp], shape=[2, -2])
      case (two_kicks_map, two_kicks_rotation_map)
         plan = kick_plan(drift=[gauss, 1 - 2*gauss, gauss], part=[0.5_wp, 0.5_wp], &
                          shape=sqrt(12.0_wp)*[1, -1], &
                          rotates=equation == two_kicks_rotation_map)
         ! The rotation is the flow of the quadratic part of H: a kick consists of the cubic force and the noise.
         if (plan%rotates) plan%linear = 0
      case default
         plan = kick_plan()
      end select
   end subroutine find_plan

   !> Take steps by the contract of model_type%flow, for two degrees of freedom. If no dZ is drawn, its weight
   !> gamma_i/b_i is zero or all noises are silent, so that any numbers may be used for dZ.
   subroutine henon_heiles_flow(map, terms, steps, q, p, qn, pn, counters)
      type(step_map), intent(in) :: map
      type(henon_heiles_terms), intent(in) :: terms
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: q(steps%nlane, 2), p(steps%nlane, 2)
      real(wp), intent(out) :: qn(steps%nlane, 2, steps%nstep/steps%every), pn(steps%nlane, 2, steps%nstep/steps%every)
      type(counters_type), intent(inout) :: counters
      real(wp), contiguous, pointer :: w(:, :, :), dz(:, :, :)
      type(kick_plan) :: plan
      integer :: first

      call find_plan(map%equation, plan)
      ! Complete the plan with all numbers that depend on h alone, so that no step computes them again.
      plan%h = steps%h
      plan%of = terms
      plan%tau = plan%drift*steps%h
      ! cos - 1 without cancellation.
      plan%cosine_less_one = -2*sine_of(0.5_wp*plan%tau)**2
      plan%sine = sine_of(plan%tau)
      if (map%damped) call let_decay(plan, map%equation, steps)
      plan%acts = plan%drift > 0 .or. abs(plan%loss) > 0
      w => steps%w  ! contiguous, which gfortran 12 does not recognise for a component
      dz => w  ! a placeholder if dZ has no weight, or all noises are silent
      if (any(abs(plan%shape) > 0) .and. associated(steps%of(path_dz)%x)) dz => steps%of(path_dz)%x
      if (steps%nreal == 1) then
         call pass_alone(plan, steps, w, dz, q, p, qn, pn)
      else
         do first = 1, steps%nlane, tile
            call pass(plan, steps, first, w, dz, q, p, qn, pn)
         end do
      end if
      ! Each kick evaluates one force; padding lanes, past nreal, are not counted.
      counters%gradients = counters%gradients + (plan%nvelocity + count(plan%part > 0))*steps%nstep*steps%nreal
   end subroutine henon_heiles_flow

   !> Set the decays of a damped model. A kick has beta/part dW + shape a = dW + shape (dZ/h - half dW).
   pure subroutine let_decay(plan, equation, steps)
      type(kick_plan), intent(inout) :: plan
      integer, intent(in) :: equation
      type(steps_record), intent(in) :: steps

      plan%decays = .true.
      associate (d => steps%decays)
         select case (equation)
         case (euler_map)
            plan%loss(2) = d%after
         case (euler_adjoint_map)
            ! the drift by momenta that have decayed
            plan%tau(2) = plan%tau(2)*(1 + d%before)
            plan%loss(2) = d%before
         case (verlet_map)
            plan%tau(2) = plan%tau(2)*(1 + 0.5_wp*decay_less_one(d%z))
            plan%loss(2) = decay_less_one(d%z)
         case (verlet_swapped_map)
            plan%part(1) = 1 + 0.5_wp*decay_less_one(d%z)
            plan%loss(1) = decay_less_one(d%z)
         case default
            where (plan%drift > 0) plan%tau = -steps%h*decay_less_one(plan%drift*d%z)/d%z
            plan%loss = decay_less_one(plan%drift*d%z)
            plan%shape = d%gamma(:2)/plan%part
            plan%half = 0.5_wp - (d%beta(:2)/plan%part - 1)/plan%shape
         end select
      end associate
   end subroutine let_decay

   !> Take the steps of lane 1 alone: each waits for the step before it, and all numbers stay in registers. w is h,
   !> dW_1, dW_2 and dz is dZ_1, dZ_2 of each step; qn and pn are the requested states.
   pure subroutine pass_alone(plan, steps, w, dz, q, p, qn, pn)
      type(kick_plan), intent(in) :: plan
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: w(steps%nlane, 0:2, steps%nstep), dz(steps%nlane, 2, steps%nstep)
      real(wp), intent(in) :: q(steps%nlane, 2), p(steps%nlane, 2)
      real(wp), intent(inout), dimension(steps%nlane, 2, steps%nstep/steps%every) :: qn, pn
      real(wp) :: x1, x2, y1, y2, u1, u2, rate
      integer :: i, step, out

      rate = 1/plan%h
      ! (x1, x2) is q and (y1, y2) is p.
      x1 = q(1, 1)
      x2 = q(1, 2)
      y1 = p(1, 1)
      y2 = p(1, 2)
      do out = 1, steps%nstep/steps%every
         do step = (out - 1)*steps%every + 1, out*steps%every
            ! The loop is unrolled, so that i is a constant in each of its three passes.
            !GCC$ unroll 3
            do i = 1, 3
               if (plan%rotates) then
                  call rotate(plan%cosine_less_one(i), plan%sine(i), x1, y1)
                  call rotate(plan%cosine_less_one(i), plan%sine(i), x2, y2)
               else if (plan%acts(i)) then
                  x1 = x1 + plan%tau(i)*y1
                  x2 = x2 + plan%tau(i)*y2
                  if (plan%decays) then
                     y1 = y1 + plan%loss(i)*y1
                     y2 = y2 + plan%loss(i)*y2
                  end if
               end if
               ! Two kicks lie between three drifts.
               if (i == 3) cycle
               if (.not. plan%part(i) > 0) cycle
               u1 = weight(plan%shape(i), plan%half(i), rate, w(1, 1, step), dz(1, 1, step))
               u2 = weight(plan%shape(i), plan%half(i), rate, w(1, 2, step), dz(1, 2, step))
               call kick(plan, plan%part(i), u1, u2, x1, x2, y1, y2)
            end do
         end do
         qn(1, 1, out) = x1
         qn(1, 2, out) = x2
         pn(1, 1, out) = y1
         pn(1, 2, out) = y2
      end do
   end subroutine pass_alone

   !> Take all steps of a tile of lanes from `first` on. Steps with two kicks by dW around one drift are taken several
   !> at a time; all other steps drift by drift and kick by kick through the tile.
   pure subroutine pass(plan, steps, first, w, dz, q, p, qn, pn)
      type(kick_plan), intent(in) :: plan
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: first
      real(wp), intent(in) :: w(steps%nlane, 0:2, steps%nstep), dz(steps%nlane, 2, steps%nstep)
      real(wp), intent(in) :: q(steps%nlane, 2), p(steps%nlane, 2)
      real(wp), intent(inout), dimension(steps%nlane, 2, steps%nstep/steps%every) :: qn, pn
      real(wp), dimension(tile, 2) :: x, y
      integer :: i, n, step, out, several
      logical :: plain  ! two kicks by dW, and one drift between them

      ! Only the plan of Stormer-Verlet is plain: it needs no dZ, and so only dW of several steps at once.
      plain = all(plan%part > 0) .and. .not. (any(plan%acts([1, 3])) .or. any(abs(plan%shape) > 0))
      n = min(tile, steps%nlane - first + 1)
      associate (last => first + n - 1, every => steps%every)
         x(:n, :) = q(first:last, :)
         y(:n, :) = p(first:last, :)
         do out = 1, steps%nstep/every
            step = (out - 1)*every
            ! While a group of steps fits before the next requested state, the lanes take a group; then single steps.
            do while (plain .and. step < out*every)
               several = merge(group, 1, out*every - step >= group)
               call kick_drift_kick_lanes(several, plan, first - 1, n, w(:, :, step + 1:step + several), x, y)
               step = step + several
            end do
            ! If the plan is plain no step is left for this loop; otherwise the loop takes all steps.
            do step = step + 1, out*every
               do i = 1, 3
                  if (plan%acts(i)) call drift_lanes(i, plan, n, x, y)
                  if (i == 3) cycle
                  if (plan%part(i) > 0) &
                     call kick_lanes(i, plan, steps%nlane, n, w(first, 1, step), dz(first, 1, step), x, y)
               end do
            end do
            qn(first:last, :, out) = x(:n, :)
            pn(first:last, :, out) = y(:n, :)
         end do
      end associate
   end subroutine pass

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC Kick, drift and kick of n lanes: one step, or a group of steps in registers.
   pure subroutine kick_drift_kick_lanes(nstep, plan, before_first, n, w, x, y)
      integer, intent(in) :: nstep, before_first, n    !! lanes before the first of the n lanes
      type(kick_plan), intent(in) :: plan
      real(wp), intent(in), contiguous :: w(:, 0:, :)  !! (nlane, 0:2, nstep)
      real(wp), intent(inout), dimension(tile, 2) :: x, y
      integer :: lane, step

      ! The compiler knows the length of a group: it unrolls the inner loop, and x and y stay in registers.
      if (nstep == group) then
         do lane = 1, n
            !GCC$ unroll 4
            do step = 1, group
               call kick_drift_kick(plan, w(before_first + lane, 1, step), w(before_first + lane, 2, step), &
                                    x(lane, 1), x(lane, 2), y(lane, 1), y(lane, 2))
            end do
         end do
      else
         do lane = 1, n
            call kick_drift_kick(plan, w(before_first + lane, 1, 1), w(before_first + lane, 2, 1), x(lane, 1), &
                                 x(lane, 2), y(lane, 1), y(lane, 2))
         end do
      end if
   end subroutine kick_drift_kick_lanes

   !> VEC The i-th drift of n lanes: q + tau_i p, or the rotation by tau_i in each plane (q_k, p_k).
   pure subroutine drift_lanes(i, plan, n, x, y)
      integer, intent(in) :: i, n
      type(kick_plan), intent(in) :: plan
      real(wp), intent(inout), dimension(tile, 2) :: x, y
      integer :: lane, k

      do k = 1, 2
         if (plan%rotates) then
            do lane = 1, n
               call rotate(plan%cosine_less_one(i), plan%sine(i), x(lane, k), y(lane, k))
            end do
         else if (plan%decays) then
            do lane = 1, n
               x(lane, k) = x(lane, k) + plan%tau(i)*y(lane, k)
               y(lane, k) = y(lane, k) + plan%loss(i)*y(lane, k)
            end do
         else
            do lane = 1, n
               x(lane, k) = x(lane, k) + plan%tau(i)*y(lane, k)
            end do
         end if
      end do
   end subroutine drift_lanes

   !> VEC The i-th kick of n lanes, whose weights are part of an array of nlane lanes: first one noise, then the other.
   pure subroutine kick_lanes(i, plan, nlane, n, w, dz, x, y)
      integer, intent(in) :: i, nlane, n
      type(kick_plan), intent(in) :: plan
      real(wp), intent(in) :: w(nlane + n), dz(nlane + n), x(tile, 2)
      real(wp), intent(inout) :: y(tile, 2)
      real(wp) :: shape, half, rate
      integer :: lane

      ! w holds dW_1 of all nlane lanes, then dW_2; this tile begins at its first element. The same holds for dz.
      shape = plan%shape(i)
      half = plan%half(i)
      rate = 1/plan%h
      do lane = 1, n
         call kick(plan, plan%part(i), weight(shape, half, rate, w(lane), dz(lane)), &
                   weight(shape, half, rate, w(nlane + lane), dz(nlane + lane)), x(lane, 1), x(lane, 2), y(lane, 1), &
                   y(lane, 2))
      end do
   end subroutine kick_lanes

   !> The weight W_k of a kick divided by its part: dW + (gamma/b) (dZ/h - dW/2). In a sum of two products the compiler
   !> may contract either one; parentheses around the second product allow only the first to be contracted, in this
   !> function and in those below: so a single path has the bits that it has in a block.
   pure real(wp) function weight(shape, half, rate, w, dz)
      real(wp), intent(in) :: shape, half, rate, w, dz

      weight = w + shape*(rate*dz - (half*w))
   end function weight

   !> One step of two kicks with a drift between them, of one lane: Stormer-Verlet, whose kicks each have half of h and
   !> of both dW, and use no dZ.
   pure subroutine kick_drift_kick(plan, w1, w2, x1, x2, y1, y2)
      type(kick_plan), intent(in) :: plan   !! a plan with the full linear force
      real(wp), intent(in) :: w1, w2
      real(wp), intent(inout) :: x1, x2, y1, y2

      call kick(plan, plan%part(1), w1, w2, x1, x2, y1, y2)
      x1 = x1 + plan%tau(2)*y1
      x2 = x2 + plan%tau(2)*y2
      ! In a closed system plan%loss is zero, and y1 and y2 do not change.
      y1 = y1 + plan%loss(2)*y1
      y2 = y2 + plan%loss(2)*y2
      call kick(plan, plan%part(2), w1, w2, x1, x2, y1, y2)
   end subroutine kick_drift_kick

   !> The exact flow of (p^2 + q^2)/2 for one degree of freedom, as increments: x + (cos - 1) x + sin y, and
   !> correspondingly for y.
   pure subroutine rotate(cosine_less_one, sine, x, y)
      real(wp), intent(in) :: cosine_less_one, sine
      real(wp), intent(inout) :: x, y
      real(wp) :: moved

      ! Increments are added, rather than the state multiplied by cos tau and sin tau, so that rounding errors are small
      ! with tau.
      moved = x + (cosine_less_one*x + (sine*y))
      y = y + (cosine_less_one*y - (sine*x))
      x = moved
   end subroutine rotate

   !> The kick of one lane, by the equations in the header; u1 and u2 are W_1 and W_2.
   pure subroutine kick(plan, part, u1, u2, x1, x2, y1, y2)
      type(kick_plan), intent(in) :: plan
      real(wp), intent(in) :: part, u1, u2, x1, x2
      real(wp), intent(inout) :: y1, y2

      ! linear is 1, or 0 if a rotation includes the linear force; merge leaves out x2 in the second force.
      associate (h => plan%h, linear => plan%linear, alpha => plan%of%alpha)
         y1 = y1 - part*(h*(x1*(linear + 2*alpha*x2)) + (plan%of%sigma1*u1))
         y2 = y2 - part*(h*(merge(x2, 0.0_wp, linear > 0) + alpha*(x1*x1 - (x2*x2))) + (plan%of%sigma2*u2))
      end associate
   end subroutine kick

end module symsde_model_flows_henon_heiles
