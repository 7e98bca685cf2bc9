! SPDX-License-Identifier: BSD-3-Clause
!> The midpoint rule on the Kubo oscillator, fused: a Cayley rotation by theta = a h + sigma dW.
!>
!>    dq = theta (p - theta q/2)/(1 + theta^2/4),  dp = -theta (q + theta p/2)/(1 + theta^2/4)
!>
!> [WHSB] (71)-(72) solved for the new state. The plainer midpoint_single passes gradient and Hessian
!> through memory; this kernel takes half its time (bench/). Agrees with it to a few ulps.
module symsde_step_midpoint_kubo
   use symsde_base_kinds, only: wp, i8
   use symsde_model_kubo, only: kubo_model
   use symsde_scheme_scheme, only: correction_none
   use symsde_step_one_step_hamiltonian, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type
   implicit none
   private
   public :: midpoint_kubo_stepper, new_midpoint_kubo_stepper

   type, extends(stepper_type) :: midpoint_kubo_stepper
      private
      real(wp) :: a = 0, sigma = 0
   contains
      procedure :: increment
   end type midpoint_kubo_stepper

contains

   !> A midpoint stepper for blocks of nlane lanes of Kubo oscillators.
   subroutine new_midpoint_kubo_stepper(self, model, nlane)
      type(midpoint_kubo_stepper), intent(out) :: self
      class(kubo_model), intent(in), target :: model
      integer, intent(in) :: nlane

      self%name = 'midpoint, fused for kubo'
      self%a = model%a
      self%sigma = model%sigma
      call new_one_step_hamiltonian(self%ham, model, nlane, correction_none, 0.0_wp)
   end subroutine new_midpoint_kubo_stepper

   subroutine increment(self, t, w, q, p, dq, dp, status)
      class(midpoint_kubo_stepper), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)

      call cayley(self%ham%nlane, self%a*w(1, 0), self%sigma, w(1, 1), q, p, dq, dp)
      associate (c => self%ham%counters)
         c%iterations = c%iterations + self%ham%nreal
         c%solves = c%solves + self%ham%nreal
      end associate
   end subroutine increment

   !> VEC theta = turn + sigma dw, turn = a h
   pure subroutine cayley(nlane, turn, sigma, dw, q, p, dq, dp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: turn, sigma, dw(nlane), q(nlane), p(nlane)
      real(wp), intent(out) :: dq(nlane), dp(nlane)
      real(wp) :: theta, half, factor
      integer :: lane

      do lane = 1, nlane
         theta = turn + sigma*dw(lane)
         half = 0.5_wp*theta
         factor = theta/(1 + half*half)
         dq(lane) = factor*(p(lane) - half*q(lane))
         dp(lane) = -factor*(q(lane) + half*p(lane))
      end do
   end subroutine cayley

end module symsde_step_midpoint_kubo
