! SPDX-License-Identifier: BSD-3-Clause
!> Whole steps of the corrected Euler pair on the pendulum of model/catalogue/pendulum:
!>
!>    Hhat = h (p^2/2 - cos q) + g (p^2 + q^2)/2 +- d q p,     g = sigma dW,  d = g^2/2
!>
!>    symplectic Euler   p' = (p - (h sin q + g q))/(1 + d),  q' = q + ((h + g) p' + d q)   [WHSB] (89)-(90)
!>    its adjoint        q' = (q + (h + g) p)/(1 + d),  p' = p - (h sin q' + g q') + d p    [WHSB] (91)-(92)
!>
!> The first has +d q p = F_p.F_q/2 with F = dW H_1 = g (p^2 + q^2)/2, the second has -d q p: without this correction
!> both schemes converge to solutions of a different equation than Stratonovich's.
!>
!> If the model is damped, momenta lose a part before the step and a part after it (base/record); in a closed system
!> both parts are zero, and adding them changes no bit.
!>
!> The implicit unknown, p' of the first and q' of the second, occurs linearly: no iteration is needed. A single path is
!> lane 1; in blocks a tile of lanes at a time takes its steps.
module symsde_model_flows_pendulum
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: steps_record
   use symsde_base_sincos, only: sincos_lanes, sincos_one, sincos_tile
   implicit none
   private
   public :: pendulum_euler_flow

contains

   !> Take steps by the contract of model_type%flow: from (q, p) to the states after every steps%every-th step, in qn
   !> and pn. A step counts as one solve.
   subroutine pendulum_euler_flow(adjoint, sigma, steps, q, p, qn, pn, counters)
      logical, intent(in) :: adjoint
      real(wp), intent(in) :: sigma
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: q(steps%nlane), p(steps%nlane)
      real(wp), intent(out) :: qn(steps%nlane, steps%nstep/steps%every), pn(steps%nlane, steps%nstep/steps%every)
      type(counters_type), intent(inout) :: counters
      real(wp), contiguous, pointer :: w(:, :, :)
      integer :: first

      w => steps%w  ! contiguous, which gfortran 12 does not recognise for a component
      associate (s => steps, n => steps%nstep*steps%nreal)
         ! A lane has the same operations alone and in a block, so results do not depend on the branch.
         if (s%nreal == 1) then
            call step_alone(adjoint, sigma, s, w, q(1), p(1), qn, pn)
         else
            do first = 1, s%nlane, sincos_tile
               call step_lanes(adjoint, sigma, s, first, w, q(first), p(first), qn, pn)
            end do
         end if
         ! Padding lanes take steps too, but are not counted.
         counters%iterations = counters%iterations + n
         counters%solves = counters%solves + n
      end associate
   end subroutine pendulum_euler_flow

   !> Take all steps of a tile of lanes from `first` on: first sine and cosine of all its angles, then the rest of the
   !> step. The cosine comes with the sine and is not used, since there is no iteration that needs a slope.
   subroutine step_lanes(adjoint, sigma, steps, first, w, q, p, qn, pn)
      logical, intent(in) :: adjoint
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: first
      real(wp), intent(in) :: sigma, w(steps%nlane, 0:1, steps%nstep)
      real(wp), intent(in), dimension(min(sincos_tile, steps%nlane - first + 1)) :: q, p
      real(wp), intent(inout) :: qn(steps%nlane, steps%nstep/steps%every), pn(steps%nlane, steps%nstep/steps%every)
      real(wp), dimension(sincos_tile) :: x, y, sine, cosine
      integer :: step, out, n

      n = size(q)
      ! The state of the tile stays in (x, y) through all steps; requested states are copied.
      x(:n) = q
      y(:n) = p
      do out = 1, steps%nstep/steps%every
         do step = (out - 1)*steps%every + 1, out*steps%every
            if (adjoint) then
               ! Symplectic Euler uses the sine at the old angle, its adjoint the sine at the new one; this determines
               ! the order of the calls.
               call solve_for_angles(n, sigma, steps%h, steps%decays%before, w(first, 1, step), y, x)
               call sincos_lanes(n, x, sine, cosine)
               call move_momenta(n, sigma, steps%h, steps%decays%after, w(first, 1, step), x, sine, y)
            else
               call sincos_lanes(n, x, sine, cosine)
               call solve_and_drift(n, sigma, steps, w(first, 1, step), sine, x, y)
            end if
         end do
         qn(first:first + n - 1, out) = x(:n)
         pn(first:first + n - 1, out) = y(:n)
      end do
   end subroutine step_lanes

   !> Take all steps of lane 1, with numbers in registers and the same operations as for a lane of a tile.
   subroutine step_alone(adjoint, sigma, steps, w, q, p, qn, pn)
      logical, intent(in) :: adjoint
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: sigma, w(steps%nlane, 0:1, steps%nstep), q, p
      real(wp), intent(inout) :: qn(steps%nlane, steps%nstep/steps%every), pn(steps%nlane, steps%nstep/steps%every)
      real(wp) :: x, y, cosine, h, before, after
      integer :: step, out

      h = steps%h
      before = steps%decays%before
      after = steps%decays%after
      x = q
      y = p
      do out = 1, steps%nstep/steps%every
         do step = (out - 1)*steps%every + 1, out*steps%every
            if (adjoint) then
               call solve_for_angle(h, before, sigma*w(1, 1, step), y, x)
               call move_momentum(h, after, sigma*w(1, 1, step), x, sincos_one(x, cosine), y)
            else
               call euler(h, before, after, sigma*w(1, 1, step), sincos_one(x, cosine), x, y)
            end if
         end do
         qn(1, out) = x
         pn(1, out) = y
      end do
   end subroutine step_alone

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC One step of symplectic Euler for n lanes, given the sines of the old angles: p' first, then q' from p'.
   pure subroutine solve_and_drift(n, sigma, steps, dw, sine, x, y)
      integer, intent(in) :: n
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: sigma, dw(n), sine(n)
      real(wp), intent(inout) :: x(n), y(n)
      real(wp) :: h, before, after
      integer :: i

      h = steps%h
      before = steps%decays%before
      after = steps%decays%after
      do i = 1, n
         call euler(h, before, after, sigma*dw(i), sine(i), x(i), y(i))
      end do
   end subroutine solve_and_drift

   !> VEC The first half of a step of the adjoint for n lanes: x is q, then q', and y is the old p. The caller computes
   !> the sine of q' between the halves.
   pure subroutine solve_for_angles(n, sigma, h, before, dw, y, x)
      integer, intent(in) :: n
      real(wp), intent(in) :: sigma, h, before, dw(n)
      real(wp), intent(inout) :: y(n), x(n)
      integer :: i

      do i = 1, n
         call solve_for_angle(h, before, sigma*dw(i), y(i), x(i))
      end do
   end subroutine solve_for_angles

   !> VEC The second half of a step of the adjoint for n lanes: p' from the sine of q'.
   !>   p' = p - (h sin q' + g q') + d p
   pure subroutine move_momenta(n, sigma, h, after, dw, x, sine, y)
      integer, intent(in) :: n
      real(wp), intent(in) :: sigma, h, after, dw(n), x(n), sine(n)
      real(wp), intent(inout) :: y(n)
      integer :: i

      do i = 1, n
         call move_momentum(h, after, sigma*dw(i), x(i), sine(i), y(i))
      end do
   end subroutine move_momenta

   !> One step of symplectic Euler by the equations in the header, with g = sigma dW: y is p, then p', and x is q, then
   !> q'. There is one division per step.
   pure subroutine euler(h, before, after, g, sine, x, y)
      real(wp), intent(in) :: h, before, after, g, sine
      real(wp), intent(inout) :: x, y
      real(wp) :: d

      ! d q p has the derivative d p' in q, hence the division by 1 + d; its derivative in p is d q.
      d = 0.5_wp*(g*g)
      y = y + before*y
      y = ((y - g*x) - h*sine)*(1/(1 + d))
      x = x + ((h + g)*y + d*x)
      y = y + after*y
   end subroutine euler

   !> q' = (q + (h + g) p)/(1 + d) of the adjoint.
   pure subroutine solve_for_angle(h, before, g, y, x)
      real(wp), intent(in) :: h, before, g
      real(wp), intent(inout) :: y, x

      ! -d q p adds -d q' to q', hence the division by 1 + d.
      y = y + before*y
      x = (x + (h + g)*y)*(1/(1 + 0.5_wp*(g*g)))
   end subroutine solve_for_angle

   !> p' = p - (h sin q' + g q') + d p of the adjoint.
   pure subroutine move_momentum(h, after, g, x, sine, y)
      real(wp), intent(in) :: h, after, g, x, sine
      real(wp), intent(inout) :: y

      ! -d q p adds +d p, at the old p, to p'.
      y = ((y + 0.5_wp*(g*g)*y) - g*x) - h*sine
      y = y + after*y
   end subroutine move_momentum

end module symsde_model_flows_pendulum
