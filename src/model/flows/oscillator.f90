! SPDX-License-Identifier: BSD-3-Clause
!> Whole steps of oscillators whose one-step Hamiltonian is quadratic, separable and has one degree of freedom:
!>
!>    Hhat = (a q^2 + c p^2)/2 + b q + e p,     a = r h + A dW_i,  c = r h + C dW_k,  b = B dW_j,  e = E dW_l
!>
!>    symplectic Euler   p' = p - (a q + b),  q' = q + (c p' + e)                           [WHSB] (89)-(90)
!>    its adjoint        q' = q + (c p + e),  p' = p - (a q' + b)                           [WHSB] (91)-(92)
!>    corrected          with d q p added to Hhat: p' = (p - (a q + b))/(1 + d),  q' = q + (c p' + e) + d q, where
!>                       d = A dW_i C dW_k/2; its adjoint takes (q, p) -> (p, -q), and -d becomes d
!>    Stormer-Verlet     half a kick, a drift, half a kick; the other Lobatto pair takes (q, p) -> (p, -q)
!>    midpoint           dq = (v - c f/2)/(1 + a c/4), dp = -(f + a v/2)/(1 + a c/4), f = a q + b, v = c p + e
!>    Gauss              dq = 2 o (u v - o c f)/(u^2 + o^2 a c), dp = -2 o (u f + o a v)/(u^2 + o^2 a c)
!>    Lobatto            dq = (A v - B c f)/D,                   dp = -(C f + B a v)/D, of three and four stages
!>
!> ([WHSB] (71)-(72) solved.) With Z the matrix of the linear equations, a Gauss scheme adds (N/D - 1) (q, p), where N/D
!> is Pade's quotient for exp(Z), D = u - o Z, N = u + o Z, and Z^2 = -a c: rounding of u and o does not make a rotation
!> less orthogonal. For Lobatto schemes let M = I + x a abar with the matrices a, abar of the tableau, x = a c, and 1 a
!> column of ones: then D = det M, C = D alpha M^-1 1, B = D alpha M^-1 a 1, and A is C with a and abar exchanged, which
!> does not change B for a symplectic scheme.
!>
!> The exact step is dz = (exp(Z) - 1) Z^-1 (v, -f), and a scheme replaces exp(Z) by N/D: (N/D - 1) Z^-1 = 2 o/D needs
!> no inverse of Z, and b and e occur only in f and v. Since det (N/D) = (u^2 + o^2 a c)/(u^2 + o^2 a c), each step is
!> symplectic even with rounded coefficients.
!>
!> Each scheme defines one step of one lane, `take`, for the loops over steps and lanes in oscillator_steps.inc.
module symsde_model_flows_oscillator
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp
   use symsde_base_lanes, only: lane_unit
   use symsde_base_maps, only: step_map, euler_map, euler_adjoint_map, verlet_map, verlet_swapped_map, &
                               midpoint_map, gauss2_map, gauss4_map, lobatto3_map, lobatto4_swapped_map, &
                               gauss2_brackets_map
   use symsde_base_record, only: steps_record
   implicit none
   private
   public :: oscillator_terms, oscillator_flow, oscillator_has_flow, count_oscillator_steps

   !> An oscillator: its angular velocity r, the strengths A, B, C, E of its noises, and the number of the noise for
   !> each strength: 0 if the strength is zero. With H = r (p^2 + q^2)/2, the noises are A q^2/2, B q, C p^2/2 and E p;
   !> one noise may have two terms, as on Kubo's oscillator, (A q^2 + C p^2)/2.
   type :: oscillator_terms
      real(wp) :: rate = 1
      real(wp) :: a = 0, b = 0, c = 0, e = 0
      integer :: noise_a = 0, noise_b = 0, noise_c = 0, noise_e = 0
   end type oscillator_terms

   !> The coefficients of the polynomials u and o in a c, from the first power on: u begins with 1, o with 1/2.
   type :: pade_terms
      real(wp) :: u(2) = 0, o = 0
   end type pade_terms

   ! Pade's numerators of exp(Z), with Z^2 = -x, x = a c:
   !    midpoint   1 + Z/2                                         u = 1,                      o = 1/2
   !    gauss2     1 + Z/2 + Z^2/12                                u = 1 - x/12,               o = 1/2
   !    gauss3     1 + Z/2 + Z^2/10 + Z^3/120                      u = 1 - x/10,               o = 1/2 - x/120
   !    gauss4     1 + Z/2 + 3 Z^2/28 + Z^3/84 + Z^4/1680          u = 1 - 3 x/28 + x^2/1680,  o = 1/2 - x/84
   type(pade_terms), parameter :: &
      pade(midpoint_map:gauss4_map) = [pade_terms(), pade_terms(u=[-1/12.0_wp, 0.0_wp]), &
                                       pade_terms(u=[-1/10.0_wp, 0.0_wp], o=-1/120.0_wp), &
                                       pade_terms(u=[-3/28.0_wp, 1/1680.0_wp], o=-1/84.0_wp)]

   !> The coefficients of A, B, C and D of Lobatto's schemes, from x on: their constants are 1, and 1/2 for B. The
   !> swapped pair has A and C exchanged.
   type :: step_quotients
      real(wp) :: a(3) = 0, b(2) = 0, c(3) = 0, d(2) = 0
   end type step_quotients

   ! A of three and of four stages is one3 and one4, C is other3 and other4, B is both3 and both4, D is below3 and
   ! below4.
   real(wp), parameter :: one3(3) = [-1/8.0_wp, 0.0_wp, 0.0_wp], other3(3) = [-1/8.0_wp, 1/288.0_wp, 0.0_wp], &
                          both3(2) = [-1/48.0_wp, 0.0_wp], below3(2) = [1/24.0_wp, 0.0_wp], &
                          one4(3) = [-2/15.0_wp, 1/300.0_wp, 0.0_wp], &
                          other4(3) = [-2/15.0_wp, 1/300.0_wp, -1/43200.0_wp], &
                          both4(2) = [-1/40.0_wp, 1/3600.0_wp], below4(2) = [1/30.0_wp, 1/1800.0_wp]
   type(step_quotients), parameter :: &
      quotients(lobatto3_map:lobatto4_swapped_map) = [step_quotients(one3, both3, other3, below3), &
                                                      step_quotients(other3, both3, one3, below3), &
                                                      step_quotients(one4, both4, other4, below4), &
                                                      step_quotients(other4, both4, one4, below4)]

contains

   !> Whether this file implements steps by a map for these noises: corrected steps if all noise is in a and c, steps
   !> with brackets if all brackets vanish.
   pure logical function oscillator_has_flow(terms, map) result(has_flow)
      type(oscillator_terms), intent(in) :: terms
      type(step_map), intent(in) :: map

      if (map%corrected) then
         ! With noise in b or e, F_p.F_q/2 has more terms than d q p, which the corrected steps of this file do not
         ! contain.
         has_flow = any(map%equation == [euler_map, euler_adjoint_map]) .and. &
                    terms%noise_b == 0 .and. terms%noise_e == 0
      else if (map%equation == gauss2_brackets_map) then
         has_flow = is_of_one_form(terms)
      else
         has_flow = map%equation >= euler_map .and. map%equation <= lobatto4_swapped_map
      end if
   end function oscillator_has_flow

   !> Whether every H_j is a multiple of p^2 + q^2, so that all brackets vanish.
   pure logical function is_of_one_form(terms)
      type(oscillator_terms), intent(in) :: terms

      is_of_one_form = terms%noise_a == terms%noise_c .and. abs(terms%a - terms%c) <= 0 .and. &
                       terms%noise_b == 0 .and. terms%noise_e == 0
   end function is_of_one_form

   !> Take steps by the contract of model_type%flow, for one degree of freedom. An adjoint scheme is computed as its
   !> partner on the rotated oscillator.
   subroutine oscillator_flow(terms, map, steps, q, p, qn, pn, counters)
      type(oscillator_terms), intent(in) :: terms
      type(step_map), intent(in) :: map
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: q(steps%nlane), p(steps%nlane)
      real(wp), intent(out) :: qn(steps%nlane, steps%nstep/steps%every), pn(steps%nlane, steps%nstep/steps%every)
      type(counters_type), intent(inout) :: counters
      real(wp), contiguous, pointer :: w(:, :, :)
      logical :: additive
      integer :: which

      w => steps%w  ! contiguous, which gfortran 12 does not recognise for a component
      ! If brackets vanish, gauss2 with brackets has the equation of gauss2.
      which = merge(gauss2_map, map%equation, map%equation == gauss2_brackets_map)
      ! Noise number 0 reads the column w(:, 0, :), which holds h, with strength zero: the value does not matter.
      additive = terms%noise_a == 0 .and. terms%noise_c == 0
      ! An adjoint is computed as its partner on the rotated oscillator, with the step -h and with q and p exchanged in
      ! the call.
      associate (t => terms, back => turned(terms), h => terms%rate*steps%h)
         select case (which)
         case (euler_map)
            if (map%corrected) then
               call corrected_steps(t, steps, h, w, q, p, qn, pn)
            else if (additive) then
               call additive_euler(t, steps, h, w, q, p, qn, pn)
            else
               call euler_steps(t, steps, h, w, q, p, qn, pn)
            end if
         case (euler_adjoint_map)
            if (map%corrected) then
               call corrected_steps(back, steps, -h, w, p, q, pn, qn)
            else if (additive) then
               call additive_euler(back, steps, -h, w, p, q, pn, qn)
            else
               call euler_steps(back, steps, -h, w, p, q, pn, qn)
            end if
         case (verlet_map)
            call verlet_steps(t, steps, h, w, q, p, qn, pn)
         case (verlet_swapped_map)
            call verlet_steps(back, steps, -h, w, p, q, pn, qn)
         case (midpoint_map:gauss4_map)
            call gauss_steps(pade(which), t, steps, h, w, q, p, qn, pn)
         case default  ! lobatto3_map to lobatto4_swapped_map: oscillator_has_flow excludes all others
            call lobatto_steps(quotients(which), t, steps, h, w, q, p, qn, pn)
         end select
      end associate
      call count_oscillator_steps(map, steps%nstep*steps%nreal, counters)
   end subroutine oscillator_flow

   !> Count n steps. Implicit maps are counted like implicit steppers, one solve in one iteration; all others by the
   !> gradients of a step: a force and a velocity, and for Stormer-Verlet two forces.
   pure subroutine count_oscillator_steps(map, n, counters)
      type(step_map), intent(in) :: map
      integer, intent(in) :: n
      type(counters_type), intent(inout) :: counters

      if (map%equation >= midpoint_map .or. map%corrected) then
         counters%iterations = counters%iterations + n
         counters%solves = counters%solves + n
      else
         counters%gradients = counters%gradients + n*merge(3, 2, map%equation >= verlet_map)
      end if
   end subroutine count_oscillator_steps

   !> The oscillator with (q, p) -> (p, -q), on which the adjoint's partner takes its steps, with opposite sign of h.
   pure type(oscillator_terms) function turned(t)
      type(oscillator_terms), intent(in) :: t

      ! Exchanging q and p alone is anti-canonical, and changes the sign of Hhat: the sign of the strengths here, the
      ! sign of h in the call.
      turned = oscillator_terms(rate=t%rate, a=-t%c, b=-t%e, c=-t%a, e=-t%b, noise_a=t%noise_c, noise_b=t%noise_e, &
                                noise_c=t%noise_a, noise_e=t%noise_b)
   end function turned

   ! ---- the schemes: one step of one lane each --------------------------
   !
   ! Products with noise follow the products with x and y; the products with x and y are then contracted, wherever a
   ! step is inlined.

   !> VEC Symplectic Euler: the force at x, then the velocity at the new y.
   pure subroutine euler_steps(t, steps, h, w, q, p, qn, pn)
      include 'oscillator_steps.inc'

   contains

      pure subroutine take(wa, wb, wc, we, x, y)
         real(wp), value :: wa, wb, wc, we
         real(wp), intent(inout) :: x, y

         y = y - ((h + t%a*wa)*x + t%b*wb)
         x = x + ((h + t%c*wc)*y + t%e*we)
      end subroutine take

   end subroutine euler_steps

   !> VEC Symplectic Euler for a = c = h: all noise is in b and e.
   pure subroutine additive_euler(t, steps, h, w, q, p, qn, pn)
      include 'oscillator_steps.inc'

   contains

      pure subroutine take(wa, wb, wc, we, x, y)
         real(wp), value :: wa, wb, wc, we  !! A and C are zero: wa and wc are not used
         real(wp), intent(inout) :: x, y

         y = y - (h*x + t%b*wb)
         x = x + (h*y + t%e*we)
      end subroutine take

   end subroutine additive_euler

   !> VEC The corrected step if all noise is in a and c, with d = a c/2 of the noises.
   pure subroutine corrected_steps(t, steps, h, w, q, p, qn, pn)
      include 'oscillator_steps.inc'

   contains

      pure subroutine take(wa, wb, wc, we, x, y)
         real(wp), value :: wa, wb, wc, we  !! B and E are zero: wb and we are not used
         real(wp), intent(inout) :: x, y
         real(wp) :: a, c, d

         a = t%a*wa
         c = t%c*wc
         ! F_p.F_q/2 = (A dW_i q) (C dW_k p)/2 = d q p is a correction from the noises alone: here a and c do not
         ! contain h.
         d = 0.5_wp*(a*c)
         y = (y - (h + a)*x)*(1/(1 + d))
         x = x + ((h + c)*y + d*x)
      end subroutine take

   end subroutine corrected_steps

   !> VEC Stormer-Verlet: half a kick, a drift, half a kick.
   pure subroutine verlet_steps(t, steps, h, w, q, p, qn, pn)
      include 'oscillator_steps.inc'

   contains

      pure subroutine take(wa, wb, wc, we, x, y)
         real(wp), value :: wa, wb, wc, we
         real(wp), intent(inout) :: x, y
         real(wp) :: a

         a = h + t%a*wa
         y = y - 0.5_wp*(a*x + t%b*wb)
         x = x + ((h + t%c*wc)*y + t%e*we)
         y = y - 0.5_wp*(a*x + t%b*wb)
      end subroutine take

   end subroutine verlet_steps

   !> VEC The midpoint rule and Gauss schemes by u and o, from force and velocity at the beginning of a step.
   pure subroutine gauss_steps(numbers, t, steps, h, w, q, p, qn, pn)
      type(pade_terms), intent(in) :: numbers
      include 'oscillator_steps.inc'

   contains

      pure subroutine take(wa, wb, wc, we, x, y)
         real(wp), value :: wa, wb, wc, we
         real(wp), intent(inout) :: x, y
         real(wp) :: a, c, force, velocity, z, u, o, factor

         a = h + t%a*wa
         c = h + t%c*wc
         force = a*x + t%b*wb
         velocity = c*y + t%e*we
         z = a*c
         u = 1 + z*(numbers%u(1) + z*numbers%u(2))
         o = 0.5_wp + z*numbers%o
         ! The one division of a step is by det (u - o Z).
         factor = 2*o/(u*u + z*(o*o))
         x = x + (u*velocity - (o*c)*force)*factor
         y = y - (u*force + (o*a)*velocity)*factor
      end subroutine take

   end subroutine gauss_steps

   !> VEC Lobatto schemes by A, B, C and D, from force and velocity at the beginning of a step, with a single division.
   pure subroutine lobatto_steps(numbers, t, steps, h, w, q, p, qn, pn)
      type(step_quotients), intent(in) :: numbers
      include 'oscillator_steps.inc'

   contains

      pure subroutine take(wa, wb, wc, we, x, y)
         real(wp), value :: wa, wb, wc, we
         real(wp), intent(inout) :: x, y
         real(wp) :: a, c, force, velocity, z, inverse, both, one, other

         a = h + t%a*wa
         c = h + t%c*wc
         force = a*x + t%b*wb
         velocity = c*y + t%e*we
         z = a*c
         inverse = 1/(1 + z*(numbers%d(1) + z*numbers%d(2)))
         both = (0.5_wp + z*(numbers%b(1) + z*numbers%b(2)))*inverse
         one = (1 + z*(numbers%a(1) + z*(numbers%a(2) + z*numbers%a(3))))*inverse
         other = (1 + z*(numbers%c(1) + z*(numbers%c(2) + z*numbers%c(3))))*inverse
         x = x + (one*velocity - (both*c)*force)
         y = y - (other*force + (both*a)*velocity)
      end subroutine take

   end subroutine lobatto_steps

end module symsde_model_flows_oscillator
