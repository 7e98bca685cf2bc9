! SPDX-License-Identifier: BSD-3-Clause
!> The step of a tableau for a model whose rates of damping are functions gamma_i(q, t): a stepper that contains another
!> stepper, like step/open/damped, with decays at fixed positions (step/open/varying):
!>
!>    p* = exp(-G(q_n)) p_n,   (q_{n+1}, p**) = step of the closed system from (q_n, p*)
!>    p_{n+1} = exp(-G(q_{n+1})) p**
!>
!> where G is the integral of gamma over the times before the node c of a scheme with one stage, and over those behind
!> it; tableaux of several stages have half of the step before and half behind. Flows that are composed have strong
!> order 1, as the tableaux themselves. Without noise a symmetric step has order two.
module symsde_step_open_braked
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_step_open_damped, only: damped_stepper
   use symsde_step_open_varying, only: varying_decay, new_varying_decay
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: braked_stepper

   type, extends(damped_stepper) :: braked_stepper
      private
      type(varying_decay) :: decay
      real(wp), allocatable :: moved(:, :)    !! dp* (nlane, ndof)
   contains
      procedure :: make
      procedure :: increment
   end type braked_stepper

contains

   !> A damped stepper, and its own decays.
   subroutine make(self, task)
      class(braked_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      call self%damped_stepper%make(task)
      call new_varying_decay(self%decay, task%damping, self%ham%nlane, self%ham%ndof)
      allocate (self%moved, mold=self%start)
   end subroutine make

   !> The inner step between two decays.
   subroutine increment(self, step, q, p, dq, dp, status)
      class(braked_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)

      associate (n => self%ham%ndof, nlane => self%ham%nlane, c => self%node, h => step%h)
         dp = 0
         if (c > 0) call self%decay%decay(self%ham, step%t, c*h, nlane, n, q, p, dp)
         self%start = p + dp
         self%inner%ham%nreal = self%ham%nreal
         call self%inner%increment(step, q, self%start, dq, self%moved, status)
         dp = dp + self%moved
         self%start = q + dq
         if (c < 1) call self%decay%decay(self%ham, step%t + c*h, (1 - c)*h, nlane, n, self%start, p, dp)
      end associate
   end subroutine increment

end module symsde_step_open_braked
