! SPDX-License-Identifier: BSD-3-Clause
!> Text across the C interface: strings in, strings out into the caller's buffer.
module symsde_capi_text
   use, intrinsic :: iso_c_binding, only: c_char, c_f_pointer, c_associated, c_null_char, c_ptr, c_size_t
   use symsde_base_status, only: error_type, raise, invalid_argument
   use symsde_base_text, only: to_text
   implicit none
   private
   public :: read_text, put_text, put_chars, lines

   integer, parameter :: longest = 4096  !! characters after which a string is no valid name

contains

   !> The text of a C string. Refuses NULL and strings without an end (invalid_argument).
   subroutine read_text(string, what, text, error)
      type(c_ptr), intent(in) :: string
      character(*), intent(in) :: what                   !! name of the argument
      character(:), allocatable, intent(out) :: text
      type(error_type), allocatable, intent(inout) :: error
      character(kind=c_char), pointer :: chars(:)
      integer :: n, extent(1)

      text = ''
      if (.not. c_associated(string)) then
         call raise(error, invalid_argument, 'read_text', what//' is NULL: give a string that ends with 0')
         return
      end if
      extent(1) = longest
      call c_f_pointer(string, chars, extent)
      do n = 1, longest
         if (chars(n) == c_null_char) exit
         text = text//chars(n)
      end do
      if (n > longest) &
         call raise(error, invalid_argument, 'read_text', what//' has no end within '//to_text(longest)// &
                    ' characters: give a string that ends with 0')
   end subroutine read_text

   !> Copy as much of text as the caller's buffer holds, null-terminated, and return the size of the whole.
   subroutine put_text(text, buffer, size, needed)
      character(*), intent(in) :: text
      type(c_ptr), intent(in) :: buffer            !! size bytes; NULL = only the size is wanted
      integer(c_size_t), intent(in) :: size
      type(c_ptr), intent(in) :: needed            !! bytes of the whole text with its terminator; NULL = not wanted
      character(kind=c_char), pointer :: chars(:)
      integer(c_size_t), pointer :: total
      integer(c_size_t) :: extent(1)

      if (c_associated(needed)) then
         call c_f_pointer(needed, total)
         total = len(text, c_size_t) + 1
      end if
      if (.not. c_associated(buffer) .or. size == 0) return
      ! a size_t above the largest integer reads as negative: the buffer holds any text
      extent(1) = len(text, c_size_t) + 1
      if (size > 0) extent(1) = min(extent(1), size)
      call c_f_pointer(buffer, chars, extent)
      call put_chars(text, chars)
   end subroutine put_text

   !> Copy as much of text as an array of characters holds, null-terminated.
   pure subroutine put_chars(text, chars)
      character(*), intent(in) :: text
      character(kind=c_char), intent(out) :: chars(:)
      integer :: i

      chars = c_null_char
      do i = 1, min(len(text), size(chars) - 1)
         chars(i) = text(i:i)
      end do
   end subroutine put_chars

   !> Join names, one per line.
   pure function lines(names) result(text)
      character(*), intent(in) :: names(:)
      character(len=sum(len_trim(names)) + size(names)) :: text
      integer :: i, last

      last = 0
      do i = 1, size(names)
         text(last + 1:) = trim(names(i))//new_line('a')
         last = last + len_trim(names(i)) + 1
      end do
   end function lines

end module symsde_capi_text
