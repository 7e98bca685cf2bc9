! SPDX-License-Identifier: BSD-3-Clause
!>    H = a (p^2 + q^2)/2,   H_1 = sigma (p^2 + q^2)/2,   Hhat = h H + dW H_1 = theta (p^2 + q^2)/2
!>
!> Whole steps of the midpoint rule on the Kubo oscillator: Cayley rotations by theta = a h + sigma dW. The rule,
!>
!>    dq = theta (p + dp/2),  dp = -theta (q + dq/2)
!>
!> is linear in (dq, dp) and has the solution
!>
!>    dq = theta (p - theta q/2)/(1 + theta^2/4),  dp = -theta (q + theta p/2)/(1 + theta^2/4)
!>
!> which is [WHSB] (71)-(72) solved for the new state. It is a rotation by 2 arctan(theta/2): q^2 + p^2 is conserved up
!> to rounding, and no theta makes the equations singular. A block takes a group of steps in one pass over its lanes.
!> For a single path theta/2 and theta/(1 + theta^2/4) are computed for many steps in advance: a step then waits only
!> for the rotation of the step before, and for no division.
module symsde_model_flows_kubo
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: steps_record
   implicit none
   private
   public :: kubo_flow

   integer, parameter :: group = 8  !! steps of one pass over the lanes

contains

   !> Take steps by the contract of model_type%flow, for the midpoint rule.
   subroutine kubo_flow(a, sigma, steps, q, p, qn, pn, counters)
      real(wp), intent(in) :: a, sigma
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: q(steps%nlane), p(steps%nlane)
      real(wp), intent(out) :: qn(steps%nlane, steps%nstep/steps%every), pn(steps%nlane, steps%nstep/steps%every)
      type(counters_type), intent(inout) :: counters
      real(wp), contiguous, pointer :: w(:, :, :)

      w => steps%w  ! contiguous, which gfortran 12 does not recognise for a component
      ! w(:, 0, :) holds h and is not read: a h is the same in all steps and is computed once.
      associate (s => steps, n => steps%nstep*steps%nreal)
         if (s%nreal == 1) then
            call turn_one_lane(s, a*s%h, sigma, w, q(1), p(1), qn, pn)
         else
            call turn_lanes(s, a*s%h, sigma, w, q, p, qn, pn)
         end if
         ! The stepper that this flow replaces would solve one linear system in each step, hence both counts.
         counters%iterations = counters%iterations + n
         counters%solves = counters%solves + n
      end associate
   end subroutine kubo_flow

   !> Take the steps of a block, in groups as long as enough steps remain before the next requested state. The state is
   !> advanced in the place of that result.
   pure subroutine turn_lanes(steps, turn, sigma, w, q, p, qn, pn)
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: turn, sigma, w(steps%nlane, 0:1, steps%nstep), q(steps%nlane), p(steps%nlane)
      real(wp), intent(out) :: qn(steps%nlane, steps%nstep/steps%every), pn(steps%nlane, steps%nstep/steps%every)
      integer :: out, first, last, step

      associate (every => steps%every)
         do out = 1, steps%nstep/every
            ! Copy the state, q or the result before, to the place of the next result, and advance it there.
            qn(:, out) = q
            pn(:, out) = p
            if (out > 1) qn(:, out) = qn(:, out - 1)
            if (out > 1) pn(:, out) = pn(:, out - 1)
            first = (out - 1)*every + 1
            last = out*every
            do step = first, last - group + 1, group
               call turn_group(steps%nlane, turn, sigma, w(1, 0, step), qn(1, out), pn(1, out))
            end do
            ! The remaining steps are fewer than a group, and are taken one by one.
            do step = last - mod(every, group) + 1, last
               call turn_once(steps%nlane, turn, sigma, w(1, 1, step), qn(1, out), pn(1, out))
            end do
         end do
      end associate
   end subroutine turn_lanes

   !> VEC One step of every lane.
   pure subroutine turn_once(nlane, turn, sigma, dw, q, p)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: turn, sigma, dw(nlane)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      real(wp) :: half, factor, x, y
      integer :: lane

      do lane = 1, nlane
         x = q(lane)
         y = p(lane)
         !   theta = a h + sigma dW
         call find_factor(turn + sigma*dw(lane), half, factor)
         call cayley(half, factor, x, y)
         q(lane) = x
         p(lane) = y
      end do
   end subroutine turn_once

   !> VEC A group of steps of every lane; its state stays in registers.
   pure subroutine turn_group(nlane, turn, sigma, w, q, p)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: turn, sigma, w(nlane, 0:1, group)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      real(wp) :: half, factor, x, y
      integer :: lane, step

      do lane = 1, nlane
         x = q(lane)
         y = p(lane)
         ! The steps of a lane wait for each other, while neighbouring lanes are computed in parallel. Compared with
         ! turn_once, (q, p) is read and written once in eight steps.
         !GCC$ unroll 8
         do step = 1, group
            call find_factor(turn + sigma*w(lane, 1, step), half, factor)
            call cayley(half, factor, x, y)
         end do
         q(lane) = x
         p(lane) = y
      end do
   end subroutine turn_group

   !> Take the steps of a single path: first factors of up to `chunk` steps, then the rotations, up to each requested
   !> state.
   pure subroutine turn_one_lane(steps, turn, sigma, w, q, p, qn, pn)
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: turn, sigma, w(steps%nlane, 0:1, steps%nstep), q, p
      real(wp), intent(inout) :: qn(steps%nlane, steps%nstep/steps%every), pn(steps%nlane, steps%nstep/steps%every)
      integer, parameter :: chunk = 128
      real(wp) :: half(chunk), factor(chunk), x, y
      integer :: step, i, n, first, out, left

      x = q
      y = p
      out = 0
      left = steps%every
      ! A chunk of 128 pairs of factors stays in the first cache.
      do first = 0, steps%nstep - 1, chunk
         n = min(chunk, steps%nstep - first)
         do step = 1, n
            call find_factor(turn + sigma*w(1, 1, first + step), half(step), factor(step))
         end do
         ! A chunk may end between two requested states: `left` counts the steps that remain up to the next one, across
         ! chunks.
         i = 0
         do while (i < n)
            do step = i + 1, min(n, i + left)
               call cayley(half(step), factor(step), x, y)
            end do
            step = min(left, n - i)
            i = i + step
            left = left - step
            if (left > 0) cycle
            out = out + 1
            left = steps%every
            qn(1, out) = x
            pn(1, out) = y
         end do
      end do
   end subroutine turn_one_lane

   !> Compute theta/2 and theta/(1 + theta^2/4), the factors of dq and dp.
   pure subroutine find_factor(theta, half, factor)
      real(wp), intent(in) :: theta
      real(wp), intent(out) :: half, factor

      ! The only division of a step, which does not depend on the state.
      half = 0.5_wp*theta
      factor = theta/(1 + half*half)
   end subroutine find_factor

   !> Rotate (q, p) by Cayley's map, in place.
   pure subroutine cayley(half, factor, q, p)
      real(wp), intent(in) :: half, factor
      real(wp), intent(inout) :: q, p
      real(wp) :: dq, dp

      ! Both increments are computed from the old state before either is added.
      dq = factor*(p - half*q)
      dp = -factor*(q + half*p)
      q = q + dq
      p = p + dp
   end subroutine cayley

end module symsde_model_flows_kubo
