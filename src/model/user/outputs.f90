! SPDX-License-Identifier: BSD-3-Clause
!> Outputs of a user's functions: room for those that nobody wants, and NaN in those of a function that failed.
!>
!> Private to its family.
module symsde_model_user_outputs
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use, intrinsic :: iso_c_binding, only: c_intptr_t, c_loc
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: little, find_room, keep, spoil

   integer, parameter :: line = 8              !! numbers of a line of the cache, where columns begin
   integer, parameter :: little = 512 + line   !! numbers on the stack, with what is left out before the first line

contains

   !> Room for n numbers that nobody wants: on the caller's stack if they are few; null where memory does not suffice.
   subroutine find_room(n, few, more, room)
      integer, intent(in) :: n
      real(wp), intent(in), target :: few(little)
      real(wp), allocatable, intent(inout), target :: more(:)
      real(wp), pointer, contiguous, intent(out) :: room(:)
      integer(c_intptr_t) :: before
      integer :: info

      if (n <= little - line) then
         before = modulo(-transfer(c_loc(few), before), int(8*line, c_intptr_t))/8
         room => few(before + 1:)
         return
      end if
      nullify (room)
      allocate (more(n), stat=info)
      if (info == 0) room => more
   end subroutine find_room

   !> An output where it is wanted.
   pure subroutine keep(n, x, y)
      integer, intent(in) :: n
      real(wp), intent(in) :: x(n)
      real(wp), intent(inout), optional :: y(n)

      if (present(y)) y = x
   end subroutine keep

   !> An output of a function that failed; absent outputs stay absent.
   pure subroutine spoil(nlane, n, x)
      integer, intent(in) :: nlane, n
      real(wp), intent(out), optional :: x(nlane, n)

      if (present(x)) x = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine spoil

end module symsde_model_user_outputs
