! SPDX-License-Identifier: BSD-3-Clause
!> Whether work is to be left that may take long within one step, as the sums of a million draws do.
module symsde_base_interrupt
   implicit none
   private
   public :: interrupt_type

   !> Whoever works looks at it now and then, and where it is wanted returns at once: nothing of the result may be used.
   type, abstract :: interrupt_type
      logical :: wanted = .false.
   contains
      procedure(look_interface), deferred :: look
   end type interrupt_type

   abstract interface
      !> See whether it is wanted.
      subroutine look_interface(self)
         import :: interrupt_type
         class(interrupt_type), intent(inout) :: self
      end subroutine look_interface
   end interface

end module symsde_base_interrupt
