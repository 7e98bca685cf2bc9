! SPDX-License-Identifier: BSD-3-Clause
!> Whole steps on the Henon-Heiles system: of Stormer-Verlet, half a kick, a drift and half a kick, and of the Euler
!> pair, a kick and a drift in one order or the other.
!>
!>    dp_1 = -(h (q_1 + 2 alpha q_1 q_2) + sigma1 dW_1),  dp_2 = -(h (q_2 + alpha (q_1^2 - q_2^2)) + sigma2 dW_2),
!>    dq = h p
!>
!> Every scheme is taken as a kick, a drift and a kick, of which the Euler pair leave out one: its part is zero.
!> A group of steps keeps the states of the lanes in registers; a path that is alone goes through all of its steps.
module symsde_model_henon_heiles_flow
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: steps_record
   implicit none
   private
   public :: henon_heiles_flow, henon_heiles_has_flow

   integer, parameter :: group = 4  !! steps of one pass over the lanes

contains

   !> Whether these steps are offered here.
   pure logical function henon_heiles_has_flow(scheme) result(has_flow)
      character(*), intent(in) :: scheme
      real(wp) :: before, after

      call find_parts(scheme, before, after)
      has_flow = before + after > 0
   end function henon_heiles_has_flow

   !> The parts of the kick before and after the drift; zeros for schemes that are not known.
   pure subroutine find_parts(scheme, before, after)
      character(*), intent(in) :: scheme
      real(wp), intent(out) :: before, after

      before = 0
      if (scheme == 'symplectic_euler') before = 1
      if (scheme == 'stormer_verlet') before = 0.5_wp
      after = 0
      if (scheme == 'symplectic_euler_adjoint') after = 1
      if (scheme == 'stormer_verlet') after = 0.5_wp
   end subroutine find_parts

   !> The contract of model_type%flow.
   subroutine henon_heiles_flow(scheme, alpha, sigma1, sigma2, steps, q, p, qn, pn, counters)
      character(*), intent(in) :: scheme
      real(wp), intent(in) :: alpha, sigma1, sigma2
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: q(steps%nlane, 2), p(steps%nlane, 2)
      real(wp), intent(out) :: qn(steps%nlane, 2, steps%nstep/steps%every), pn(steps%nlane, 2, steps%nstep/steps%every)
      type(counters_type), intent(inout) :: counters
      real(wp), contiguous, pointer :: w(:, :, :)
      real(wp) :: before, after
      integer :: out, first, n

      call find_parts(scheme, before, after)
      w => steps%w  ! contiguous, as gfortran 12 does not see of a component
      if (steps%nreal == 1) then
         call pass_alone(steps%nlane, steps%nstep, steps%every, steps%h, before, after, alpha, sigma1, sigma2, w, q, &
                         p, qn, pn)
      else
         do out = 1, steps%nstep/steps%every
            if (out == 1) then
               qn(:, :, out) = q
               pn(:, :, out) = p
            else
               qn(:, :, out) = qn(:, :, out - 1)
               pn(:, :, out) = pn(:, :, out - 1)
            end if
            first = (out - 1)*steps%every + 1
            do while (first <= out*steps%every)
               n = merge(group, 1, out*steps%every - first + 1 >= group)
               call pass(steps%nlane, n, steps%h, before, after, alpha, sigma1, sigma2, &
                         w(:, :, first:first + n - 1), qn(:, 1, out), qn(:, 2, out), pn(:, 1, out), pn(:, 2, out))
               first = first + n
            end do
         end do
      end if
      counters%gradients = counters%gradients + merge(2, 3, before*after <= 0)*steps%nstep*steps%nreal
   end subroutine henon_heiles_flow

   !> Steps of lane 1 alone: each waits for the one before it.
   pure subroutine pass_alone(nlane, nstep, every, h, before, after, alpha, sigma1, sigma2, w, q, p, qn, pn)
      integer, intent(in) :: nlane, nstep, every
      real(wp), intent(in) :: h, before, after, alpha, sigma1, sigma2, w(nlane, 0:2, nstep), q(nlane, 2), p(nlane, 2)
      real(wp), intent(inout) :: qn(nlane, 2, nstep/every), pn(nlane, 2, nstep/every)
      real(wp) :: x1, x2, y1, y2
      integer :: step, out

      x1 = q(1, 1)
      x2 = q(1, 2)
      y1 = p(1, 1)
      y2 = p(1, 2)
      do out = 1, nstep/every
         !GCC$ novector
         do step = (out - 1)*every + 1, out*every
            call take(h, before, after, alpha, sigma1*w(1, 1, step), sigma2*w(1, 2, step), x1, x2, y1, y2)
         end do
         qn(1, 1, out) = x1
         qn(1, 2, out) = x2
         pn(1, 1, out) = y1
         pn(1, 2, out) = y2
      end do
   end subroutine pass_alone

   !> VEC Steps in place: one or a group.
   pure subroutine pass(nlane, nstep, h, before, after, alpha, sigma1, sigma2, w, q1, q2, p1, p2)
      integer, intent(in) :: nlane, nstep
      real(wp), intent(in) :: h, before, after, alpha, sigma1, sigma2, w(nlane, 0:2, nstep)
      real(wp), intent(inout), dimension(nlane) :: q1, q2, p1, p2
      real(wp) :: x1, x2, y1, y2
      integer :: lane, step

      if (nstep == group) then
         do lane = 1, nlane
            x1 = q1(lane)
            x2 = q2(lane)
            y1 = p1(lane)
            y2 = p2(lane)
            !GCC$ unroll 4
            do step = 1, group
               call take(h, before, after, alpha, sigma1*w(lane, 1, step), sigma2*w(lane, 2, step), x1, x2, y1, y2)
            end do
            q1(lane) = x1
            q2(lane) = x2
            p1(lane) = y1
            p2(lane) = y2
         end do
      else
         do lane = 1, nlane
            x1 = q1(lane)
            x2 = q2(lane)
            y1 = p1(lane)
            y2 = p2(lane)
            call take(h, before, after, alpha, sigma1*w(lane, 1, 1), sigma2*w(lane, 2, 1), x1, x2, y1, y2)
            q1(lane) = x1
            q2(lane) = x2
            p1(lane) = y1
            p2(lane) = y2
         end do
      end if
   end subroutine pass

   pure subroutine take(h, before, after, alpha, force1, force2, x1, x2, y1, y2)
      real(wp), intent(in) :: h, before, after, alpha, force1, force2
      real(wp), intent(inout) :: x1, x2, y1, y2

      call kick(h, before, alpha, force1, force2, x1, x2, y1, y2)
      x1 = x1 + h*y1
      x2 = x2 + h*y2
      call kick(h, after, alpha, force1, force2, x1, x2, y1, y2)
   end subroutine take

   pure subroutine kick(h, part, alpha, force1, force2, x1, x2, y1, y2)
      real(wp), intent(in) :: h, part, alpha, force1, force2, x1, x2
      real(wp), intent(inout) :: y1, y2

      y1 = y1 - part*(h*(x1 + 2*alpha*x1*x2) + force1)
      y2 = y2 - part*(h*(x2 + alpha*(x1*x1 - x2*x2)) + force2)
   end subroutine kick

end module symsde_model_henon_heiles_flow
