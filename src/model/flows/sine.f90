! SPDX-License-Identifier: BSD-3-Clause
!>    p_1/2 = p - Hhat_q(q)/2,   q' = q + Hhat_p(p_1/2),   p' = p_1/2 - Hhat_q(q')/2
!>
!> Whole steps of Stormer-Verlet for one degree of freedom whose force contains the sine and the cosine of its angle:
!>
!>    Hhat_q = a sin q + b cos q + c q,  Hhat_p = e p
!>    a = r h + A dW_i,  b = B dW_j,  c = C dW_k,  e = h + E dW_l
!>
!> The synchrotron is of this kind, with r = omega^2, H_1 = B sin q, H_2 = -A cos q; so is the pendulum, with r = 1 and
!> one noise H_1 = C q^2/2 + E p^2/2, C = E.
!>
!> If the model is damped, momenta decay during the drift, and the drift is shorter by the factor `reach` (base/record).
!>
!> A step is half a kick, a drift and half a kick. The angle after a step is the angle before the next one: sine and
!> cosine, most of the work, are computed once per step. A single path is lane 1; in blocks a tile of lanes at a time
!> takes its steps.
module symsde_model_flows_sine
   use symsde_base_counters, only: counters_type
   use symsde_base_damping, only: decay_less_one
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: steps_record
   use symsde_base_sincos, only: sincos_lanes, sincos_one, sincos_tile
   implicit none
   private
   public :: sine_terms, sine_flow

   !> The rate r, the strengths A, B, C, E of the noises, and the number of the noise for each strength: 0 if the
   !> strength is zero.
   type :: sine_terms
      real(wp) :: rate = 1
      real(wp) :: a = 0, b = 0, c = 0, e = 0
      integer :: noise_a = 0, noise_b = 0, noise_c = 0, noise_e = 0
   end type sine_terms

   !> The lanes of a tile: state (x, y), sine and cosine of x, and halves of the weights a, b, c of the step.
   type :: tile_state
      real(wp), dimension(sincos_tile) :: x, y, sine, cosine, a, b, c
      real(wp) :: reach = 1, loss = 0   !! the part of p that drifts, and what is added to p after it
   end type tile_state

contains

   !> Take steps by the contract of model_type%flow, for one degree of freedom. A step counts as three gradients, as in
   !> the explicit stepper.
   subroutine sine_flow(terms, steps, q, p, qn, pn, counters)
      type(sine_terms), intent(in) :: terms
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: q(steps%nlane), p(steps%nlane)
      real(wp), intent(out) :: qn(steps%nlane, steps%nstep/steps%every), pn(steps%nlane, steps%nstep/steps%every)
      type(counters_type), intent(inout) :: counters
      real(wp), contiguous, pointer :: w(:, :, :)
      integer :: first

      w => steps%w  ! contiguous, which gfortran 12 does not recognise for a component
      if (steps%nreal == 1) then
         call verlet_alone(terms, steps, w, q(1), p(1), qn, pn)
      else
         do first = 1, steps%nlane, sincos_tile
            call verlet(terms, steps, first, min(sincos_tile, steps%nlane - first + 1), w, q(first), p(first), qn, pn)
         end do
      end if
      ! Count two forces and a velocity, although the sine of the second force is used again for the first force of the
      ! next step.
      counters%gradients = counters%gradients + 3*steps%nstep*steps%nreal
   end subroutine sine_flow

   !> Take all steps of n lanes from `first` on, each in three passes: up to the new angle, its sine and cosine, and the
   !> second kick. The passes are separate because sine and cosine are computed for many angles at once.
   subroutine verlet(terms, steps, first, n, w, q, p, qn, pn)
      type(sine_terms), intent(in) :: terms
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: first, n
      real(wp), intent(in) :: w(steps%nlane, 0:steps%nnoise, steps%nstep), q(n), p(n)
      real(wp), intent(inout) :: qn(steps%nlane, steps%nstep/steps%every), pn(steps%nlane, steps%nstep/steps%every)
      type(tile_state) :: s
      real(wp) :: rate
      integer :: step, out

      rate = terms%rate*steps%h
      s%loss = decay_less_one(steps%decays%z)
      s%reach = 1 + 0.5_wp*s%loss
      ! Compute the sine and the cosine of the first angle before the steps: each step leaves those of its last angle.
      s%x(:n) = q
      s%y(:n) = p
      call sincos_lanes(n, s%x, s%sine, s%cosine)
      do out = 1, steps%nstep/steps%every
         do step = (out - 1)*steps%every + 1, out*steps%every
            call to_the_angle(n, terms, rate, steps%h, w(first, terms%noise_a, step), w(first, terms%noise_b, step), &
                              w(first, terms%noise_c, step), w(first, terms%noise_e, step), s)
            call sincos_lanes(n, s%x, s%sine, s%cosine)
            call from_the_angle(n, s)
         end do
         qn(first:first + n - 1, out) = s%x(:n)
         pn(first:first + n - 1, out) = s%y(:n)
      end do
   end subroutine verlet

   !> Take all steps of lane 1, with numbers in registers: a, b and c are halves here, as in a tile.
   subroutine verlet_alone(terms, steps, w, q, p, qn, pn)
      type(sine_terms), intent(in) :: terms
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: w(steps%nlane, 0:steps%nnoise, steps%nstep), q, p
      real(wp), intent(inout) :: qn(steps%nlane, steps%nstep/steps%every), pn(steps%nlane, steps%nstep/steps%every)
      real(wp) :: x, y, sine, cosine, a, b, c, rate, h, reach, loss
      integer :: step, out

      loss = decay_less_one(steps%decays%z)
      reach = 1 + 0.5_wp*loss
      rate = terms%rate*steps%h
      h = steps%h
      x = q
      y = p
      sine = sincos_one(x, cosine)
      do out = 1, steps%nstep/steps%every
         do step = (out - 1)*steps%every + 1, out*steps%every
            call find_weights(terms, rate, w(1, terms%noise_a, step), w(1, terms%noise_b, step), &
                              w(1, terms%noise_c, step), a, b, c)
            call kick(a, b, c, sine, cosine, x, y)
            ! The drift's weight e is h, without the rate, plus the noise.
            call drift(h, reach, loss, terms%e*w(1, terms%noise_e, step), x, y)
            sine = sincos_one(x, cosine)
            call kick(a, b, c, sine, cosine, x, y)
         end do
         qn(1, out) = x
         pn(1, out) = y
      end do
   end subroutine verlet_alone

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC The first part of a step: its weights, half a kick, and the drift to the next angle.
   pure subroutine to_the_angle(n, terms, rate, h, wa, wb, wc, we, s)
      integer, intent(in) :: n
      type(sine_terms), intent(in) :: terms
      real(wp), intent(in) :: rate, h  !! rate of the terms times h, rounded once for all lanes; h
      real(wp), intent(in), dimension(n) :: wa, wb, wc, we
      type(tile_state), intent(inout) :: s
      integer :: i

      do i = 1, n
         call find_weights(terms, rate, wa(i), wb(i), wc(i), s%a(i), s%b(i), s%c(i))
         call kick(s%a(i), s%b(i), s%c(i), s%sine(i), s%cosine(i), s%x(i), s%y(i))
         call drift(h, s%reach, s%loss, terms%e*we(i), s%x(i), s%y(i))
      end do
   end subroutine to_the_angle

   !> VEC The last part of a step: half a kick at the new angle.
   pure subroutine from_the_angle(n, s)
      integer, intent(in) :: n
      type(tile_state), intent(inout) :: s
      integer :: i

      do i = 1, n
         call kick(s%a(i), s%b(i), s%c(i), s%sine(i), s%cosine(i), s%x(i), s%y(i))
      end do
   end subroutine from_the_angle

   !> Compute the halves of the weights a, b, c for each of the two kicks.
   pure subroutine find_weights(terms, rate, wa, wb, wc, a, b, c)
      type(sine_terms), intent(in) :: terms
      real(wp), intent(in) :: rate, wa, wb, wc
      real(wp), intent(out) :: a, b, c

      ! Halving is exact: each kick subtracts these halves times sin q, cos q and q.
      a = 0.5_wp*(rate + terms%a*wa)
      b = 0.5_wp*(terms%b*wb)
      c = 0.5_wp*(terms%c*wc)
   end subroutine find_weights

   !> The drift. In a closed system reach is one and loss is zero, which changes no bit.
   pure subroutine drift(h, reach, loss, noise, x, y)
      real(wp), intent(in) :: h, reach, loss, noise
      real(wp), intent(inout) :: x, y

      x = x + ((h + noise)*reach)*y
      y = y + loss*y
   end subroutine drift

   !> Half a kick. The sums of two kicks at the same angle are independent.
   pure subroutine kick(a, b, c, sine, cosine, x, y)
      real(wp), intent(in) :: a, b, c, sine, cosine, x
      real(wp), intent(inout) :: y

      ! A step ends and the next begins at the same angle, with the same sine and cosine: the sum of the second kick is
      ! computed while the sum of the first kick is still being added to y.
      y = y - (c*x + b*cosine + a*sine)
   end subroutine kick

end module symsde_model_flows_sine
