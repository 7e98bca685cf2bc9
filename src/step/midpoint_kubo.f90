! SPDX-License-Identifier: BSD-3-Clause
!> The midpoint rule on the Kubo oscillator, fused: a Cayley rotation by theta = a h + sigma dW.
!>
!>    dq = theta (p - theta q/2)/(1 + theta^2/4),  dp = -theta (q + theta p/2)/(1 + theta^2/4)
!>
!> [WHSB] (71)-(72) solved for the new state. The plainer midpoint_single passes gradient and Hessian through
!> memory and the state once a step; agrees with it to a few ulps (tests/verification/test_steppers.pf).
module symsde_step_midpoint_kubo
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_model_kubo, only: kubo_model
   use symsde_scheme_scheme, only: correction_none
   use symsde_step_fused, only: fused_stepper_type, group
   use symsde_step_one_step_hamiltonian, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: midpoint_kubo_stepper, new_midpoint_kubo_stepper

   type, extends(fused_stepper_type) :: midpoint_kubo_stepper
      private
      real(wp) :: a = 0, sigma = 0
   contains
      procedure :: fits
      procedure :: make
      procedure :: increment
      procedure :: pass
      procedure :: count_steps
   end type midpoint_kubo_stepper

contains

   logical function fits(self, task)
      class(midpoint_kubo_stepper), intent(in) :: self
      type(stepper_task), intent(in) :: task

      fits = .false.
      select type (model => task%model)
      type is (kubo_model)
         fits = task%is_plain() .and. task%scheme%is_midpoint() .and. task%newton%fixed_point == 0
      end select
   end function fits

   subroutine make(self, task)
      class(midpoint_kubo_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      select type (model => task%model)
      type is (kubo_model)
         call new_midpoint_kubo_stepper(self, model, task%nlane)
      end select
      self%one_solve = .true.
   end subroutine make

   !> A midpoint stepper for blocks of nlane lanes of Kubo oscillators.
   subroutine new_midpoint_kubo_stepper(self, model, nlane)
      type(midpoint_kubo_stepper), intent(out) :: self
      class(kubo_model), intent(in), target :: model
      integer, intent(in) :: nlane

      self%name = 'midpoint, fused for kubo'
      self%takes_all_alone = .true.
      self%a = model%a
      self%sigma = model%sigma
      call new_one_step_hamiltonian(self%ham, model, nlane, correction_none, 0.0_wp)
   end subroutine new_midpoint_kubo_stepper

   subroutine increment(self, step, q, p, dq, dp, status)
      class(midpoint_kubo_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)

      call turn_by_increment(self%ham%nlane, self%a*step%h, self%sigma, step%w(:, 1), q, p, dq, dp)
      call self%count_steps(1)
   end subroutine increment

   subroutine pass(self, nstep, w, q, p, qn, pn)
      class(midpoint_kubo_stepper), intent(inout) :: self
      integer, intent(in) :: nstep
      real(wp), intent(in) :: w(self%ham%nlane, 0:self%ham%nnoise, nstep)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: qn(self%ham%nlane, self%ham%ndof), pn(self%ham%nlane, self%ham%ndof)

      associate (nlane => self%ham%nlane, turn => self%a*w(1, 0, 1))
         if (nstep > 1 .and. self%ham%nreal == 1) then
            call turn_one_lane(nlane, nstep, turn, self%sigma, w, q, p, qn, pn)
         else if (nstep == group) then
            call turn_group(nlane, turn, self%sigma, w, q, p, qn, pn)
         else
            call turn_once(nlane, turn, self%sigma, w(1, 1, 1), q, p, qn, pn)
         end if
      end associate
   end subroutine pass

   !> One solve a step and path.
   subroutine count_steps(self, nstep)
      class(midpoint_kubo_stepper), intent(inout) :: self
      integer, intent(in) :: nstep

      associate (c => self%ham%counters)
         c%iterations = c%iterations + nstep*self%ham%nreal
         c%solves = c%solves + nstep*self%ham%nreal
      end associate
   end subroutine count_steps

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC theta = turn + sigma dw, turn = a h
   pure subroutine turn_by_increment(nlane, turn, sigma, dw, q, p, dq, dp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: turn, sigma, dw(nlane), q(nlane), p(nlane)
      real(wp), intent(out) :: dq(nlane), dp(nlane)
      real(wp) :: half, factor
      integer :: lane

      do lane = 1, nlane
         call find_factor(turn + sigma*dw(lane), half, factor)
         dq(lane) = factor*(p(lane) - half*q(lane))
         dp(lane) = -factor*(q(lane) + half*p(lane))
      end do
   end subroutine turn_by_increment

   !> VEC One step.
   pure subroutine turn_once(nlane, turn, sigma, dw, q, p, qn, pn)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: turn, sigma, dw(nlane), q(nlane), p(nlane)
      real(wp), intent(out) :: qn(nlane), pn(nlane)
      real(wp) :: half, factor, x, y
      integer :: lane

      do lane = 1, nlane
         x = q(lane)
         y = p(lane)
         call find_factor(turn + sigma*dw(lane), half, factor)
         call cayley(half, factor, x, y)
         qn(lane) = x
         pn(lane) = y
      end do
   end subroutine turn_once

   !> VEC A group of steps.
   pure subroutine turn_group(nlane, turn, sigma, w, q, p, qn, pn)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: turn, sigma, w(nlane, 0:1, group), q(nlane), p(nlane)
      real(wp), intent(out) :: qn(nlane), pn(nlane)
      real(wp) :: half, factor, x, y
      integer :: lane, step

      do lane = 1, nlane
         x = q(lane)
         y = p(lane)
         !GCC$ unroll 8
         do step = 1, group
            call find_factor(turn + sigma*w(lane, 1, step), half, factor)
            call cayley(half, factor, x, y)
         end do
         qn(lane) = x
         pn(lane) = y
      end do
   end subroutine turn_group

   !> Steps of the one path of a block: angles and factors of all steps at once, then the path alone.
   pure subroutine turn_one_lane(nlane, nstep, turn, sigma, w, q, p, qn, pn)
      integer, intent(in) :: nlane, nstep
      real(wp), intent(in) :: turn, sigma, w(nlane, 0:1, nstep), q(nlane), p(nlane)
      real(wp), intent(out) :: qn(nlane), pn(nlane)
      real(wp) :: half(nstep), factor(nstep), x, y
      integer :: step

      do step = 1, nstep
         call find_factor(turn + sigma*w(1, 1, step), half(step), factor(step))
      end do
      x = q(1)
      y = p(1)
      do step = 1, nstep
         call cayley(half(step), factor(step), x, y)
      end do
      qn = x
      pn = y
   end subroutine turn_one_lane

   !> theta/2 and theta/(1 + theta^2/4)
   pure subroutine find_factor(theta, half, factor)
      real(wp), intent(in) :: theta
      real(wp), intent(out) :: half, factor

      half = 0.5_wp*theta
      factor = theta/(1 + half*half)
   end subroutine find_factor

   !> The Cayley rotation in place.
   pure subroutine cayley(half, factor, q, p)
      real(wp), intent(in) :: half, factor
      real(wp), intent(inout) :: q, p
      real(wp) :: dq, dp

      dq = factor*(p - half*q)
      dp = -factor*(q + half*p)
      q = q + dq
      p = p + dp
   end subroutine cayley

end module symsde_step_midpoint_kubo
