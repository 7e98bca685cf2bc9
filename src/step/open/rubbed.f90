! SPDX-License-Identifier: BSD-3-Clause
!> The step of a tableau for a model with a matrix of friction: a stepper that contains another stepper, like
!> step/open/damped, but with matrices as decays (step/open/friction), A = Gamma M^-1:
!>
!>    p* = exp(-c h A) p_n,   (q_{n+1}, p**) = step of the closed system from (q_n, p*)
!>    p_{n+1} = exp(-(1 - c) h A) p**
!>
!> with the node c of a scheme of one stage, and c = 1/2 for several stages: then without noise the order is two at
!> most, and the strong order 1 stays.
!>
!> In increments, with p** = p* + dp* and E(t) = exp(-t A) - 1:
!>
!>    dp = E(h) p_n + dp* + E((1 - c) h) dp*
module symsde_step_open_rubbed
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_step_open_damped, only: damped_stepper
   use symsde_step_open_friction, only: friction_flow, new_friction_flow
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: rubbed_stepper

   enum, bind(c)
      enumerator :: before = 1, after = 2, whole = 3   ! legs of duration c h, (1 - c) h, h
   end enum

   type, extends(damped_stepper) :: rubbed_stepper
      private
      type(friction_flow) :: friction
      real(wp), allocatable :: moved(:, :)    !! dp* (nlane, ndof)
   contains
      procedure :: make
      procedure :: increment
   end type rubbed_stepper

contains

   !> A damped stepper, and its own decays.
   subroutine make(self, task)
      class(rubbed_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      call self%damped_stepper%make(task)
      call new_friction_flow(self%friction, task%damping, int(whole))
      allocate (self%moved, mold=self%start)
   end subroutine make

   !> The inner step between two decays.
   subroutine increment(self, step, q, p, dq, dp, status)
      class(rubbed_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)

      associate (n => self%ham%ndof, nlane => self%ham%nlane, c => self%node, h => step%h, friction => self%friction)
         call friction%look(self%ham, step%t, q)
         self%start = p
         call friction%decay(int(before), c*h, nlane, n, p, self%start)
         self%inner%ham%nreal = self%ham%nreal
         call self%inner%increment(step, q, self%start, dq, self%moved, status)
         dp = self%moved
         call friction%decay(int(after), (1 - c)*h, nlane, n, self%moved, dp)
         call friction%decay(int(whole), h, nlane, n, p, dp)
      end associate
   end subroutine increment

end module symsde_step_open_rubbed
