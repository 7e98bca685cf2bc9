! SPDX-License-Identifier: BSD-3-Clause
!> What the library must not do, planted so that check_stack.py is seen to find it.
module trampoline
   implicit none
   private
   public :: planted

   interface
      subroutine call_back(callback)
         interface
            subroutine callback()
            end subroutine callback
         end interface
      end subroutine call_back
   end interface

contains

   subroutine planted(n)
      integer, intent(inout) :: n

      call call_back(inner)
   contains
      subroutine inner()
         n = n + 1
      end subroutine inner
   end subroutine planted

end module trampoline
