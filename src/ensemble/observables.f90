! SPDX-License-Identifier: BSD-3-Clause
!> The abstract observable: values of a user's own, computed lane by lane from (q, p).
module symsde_ensemble_observables
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: observables_type

   type, abstract :: observables_type
      integer :: nvalue = 0      !! how many values
      integer :: most_lanes = 0  !! > 0: not of t, they are asked for so many lanes of several saved times
   contains
      procedure(evaluate_interface), deferred :: evaluate
      procedure :: failure_code => never_failed
   end type observables_type

   abstract interface
      !> All values at one time, or at the first of several; every lane from its own numbers alone.
      subroutine evaluate_interface(self, nlane, ndof, t, q, p, values)
         import :: observables_type, wp
         class(observables_type), intent(in) :: self
         integer, intent(in) :: nlane, ndof
         real(wp), intent(in) :: t, q(nlane, ndof), p(nlane, ndof)
         real(wp), intent(out) :: values(nlane, self%nvalue)
      end subroutine evaluate_interface
   end interface

contains

   !> Nonzero after a user callback has refused, which aborts the run: its own return code.
   integer function never_failed(self) result(code)
      class(observables_type), intent(in) :: self

      code = 0
   end function never_failed

end module symsde_ensemble_observables
