! SPDX-License-Identifier: BSD-3-Clause
!> Outputs of a user's functions: memory for unwanted outputs, and NaN in outputs that a function does not write.
!>
!> Private to its family.
module symsde_model_user_outputs
   use, intrinsic :: iso_c_binding, only: c_intptr_t, c_loc
   use symsde_base_kinds, only: wp, i8, unwritten_bits
   implicit none
   private
   public :: little, find_room, keep, spoil

   integer, parameter :: line = 8              !! numbers of a cache line, where columns begin
   integer, parameter :: little = 512 + line   !! numbers on the stack; the first few are skipped, up to the first line

contains

   !> Memory for n numbers that are discarded: on the caller's stack if they are few; null if memory does not suffice.
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

   !> Copy an output if it is wanted.
   pure subroutine keep(n, x, y)
      integer, intent(in) :: n
      real(wp), intent(in) :: x(n)
      real(wp), intent(inout), optional :: y(n)

      if (present(y)) y = x
   end subroutine keep

   !> Fill outputs of n numbers each with NaN; absent outputs stay absent. Done before a call, so that unwritten outputs
   !> show, unless a program derived the functions, and after a failed call.
   pure subroutine spoil(n, x, y, z)
      integer, intent(in) :: n
      real(wp), intent(out), dimension(n), optional :: x, y, z

      if (present(x)) call fill(n, unwritten_bits, x)
      if (present(y)) call fill(n, unwritten_bits, y)
      if (present(z)) call fill(n, unwritten_bits, z)
   end subroutine spoil

   !> Write these bits into n numbers. Few numbers are written one by one, since they are read one by one, for which
   !> vectors would be slower.
   pure subroutine fill(n, bits, x)
      integer, intent(in) :: n
      integer(i8), intent(in) :: bits
      real(wp), intent(out) :: x(n)
      integer :: i

      if (n > line) then
         x = transfer(bits, 1.0_wp)
      else
         !GCC$ novector
         do i = 1, n
            x(i) = transfer(bits, 1.0_wp)
         end do
      end if
   end subroutine fill

end module symsde_model_user_outputs
