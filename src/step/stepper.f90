! SPDX-License-Identifier: BSD-3-Clause
!> The abstract stepper: it finds the increment of q and p over one step, for a block of paths.
!>
!> Increments, not new states, so that one place adds them (with or without compensation), checks that
!> they are finite and freezes failed paths. A stepper owns its workspace: every thread has its own.
module symsde_step_stepper
   use symsde_base_counters, only: counters_type, add_counters
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_step_one_step_hamiltonian, only: one_step_hamiltonian
   implicit none
   private
   public :: stepper_type

   type, abstract :: stepper_type
      character(:), allocatable :: name      !! which stepper this is, for the run report
      logical :: explicit = .false.          !! no solver is called
      type(one_step_hamiltonian) :: ham
   contains
      procedure(increment_interface), deferred :: increment
      procedure :: tally
   end type stepper_type

   abstract interface
      !> One step from (q, p). Lanes with a status are frozen: their increments are not used.
      subroutine increment_interface(self, step, q, p, dq, dp, status)
         import :: stepper_type, step_record, wp, i8
         class(stepper_type), intent(inout) :: self
         type(step_record), intent(in) :: step                           !! what drives it
         real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof)
         real(wp), intent(in) :: p(self%ham%nlane, self%ham%ndof)
         real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof)      !! q_{n+1} - q_n
         real(wp), intent(out) :: dp(self%ham%nlane, self%ham%ndof)      !! p_{n+1} - p_n
         integer(i8), intent(inout) :: status(self%ham%nlane)            !! 0, or a code that freezes the lane
      end subroutine increment_interface
   end interface

contains

   !> Add what was counted. Nothing is decided by it.
   subroutine tally(self, total)
      class(stepper_type), intent(in) :: self
      type(counters_type), intent(inout) :: total

      call add_counters(total, self%ham%counters)
   end subroutine tally

end module symsde_step_stepper
