! SPDX-License-Identifier: BSD-3-Clause
!> A flag to stop work that may take long within one step, such as the sum of a million draws.
module symsde_base_interrupt
   implicit none
   private
   public :: interrupt_type

   !> Long work calls after_part regularly, and returns at once if `wanted` is set; its results are then invalid.
   type, abstract :: interrupt_type
      logical :: wanted = .false.
      integer, private :: nunseen = 0  !! parts of work since the last look
   contains
      procedure, non_overridable :: after_part
      procedure(look_interface), deferred :: look
   end type interrupt_type

   integer, parameter :: until_look = 64

   abstract interface
      !> Set `wanted` if the work shall stop.
      subroutine look_interface(self)
         import :: interrupt_type
         class(interrupt_type), intent(inout) :: self
      end subroutine look_interface
   end interface

contains

   !> Called after each part of the work. Since a look may take as long as a part, look only after every so many parts.
   subroutine after_part(self)
      class(interrupt_type), intent(inout) :: self

      self%nunseen = self%nunseen + 1
      if (self%nunseen < until_look) return
      self%nunseen = 0
      call self%look()
   end subroutine after_part

end module symsde_base_interrupt
