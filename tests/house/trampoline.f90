! SPDX-License-Identifier: BSD-3-Clause
!> A pointer to an internal procedure, which makes the stack executable: check_stack.py must find it.
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
