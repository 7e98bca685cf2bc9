! SPDX-License-Identifier: BSD-3-Clause
!> A path by itself, taken by the stepper of blocks with a single lane: for steppers without a way of their own.
!>
!> A pass over one lane costs a fraction of that over eight, increments are added in one loop, and nothing tells lanes
!> apart. A step in which the lane fails is left to the block.
module symsde_step_block_one_lane
   use symsde_base_counters, only: counters_type, add_counters
   use symsde_base_kinds, only: wp, i8
   use symsde_step_lone, only: lone_stepper
   use symsde_step_stepper, only: stepper_type
   implicit none
   private
   public :: lone_lane, new_lone_lane

   type, extends(lone_stepper) :: lone_lane
      private
      class(stepper_type), allocatable :: stepper  !! of one lane
      type(counters_type) :: counted               !! by it, and collected before
   contains
      procedure :: collect
      procedure :: take
   end type lone_lane

contains

   subroutine new_lone_lane(self, stepper)
      type(lone_lane), intent(out) :: self
      class(stepper_type), allocatable, intent(inout) :: stepper  !! taken over

      call move_alloc(stepper, self%stepper)
      self%most = self%stepper%most_single
      self%stepper%ham%nreal = 1
      self%wants_record = .true.
   end subroutine new_lone_lane

   subroutine collect(self)
      class(lone_lane), intent(inout) :: self
      type(counters_type) :: total

      call self%stepper%tally(total)
      call add_counters(self%counters, total)
      call add_counters(self%counters, self%counted, -1)
      self%counted = total
   end subroutine collect

   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(lone_lane), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      integer(i8) :: status(1)

      self%step%t = t
      status = 0
      call self%stepper%increment(self%step, q, p, dq, dp, status)
      taken = status(1) == 0
   end subroutine take

end module symsde_step_block_one_lane
