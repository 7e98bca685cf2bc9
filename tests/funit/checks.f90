! SPDX-License-Identifier: BSD-3-Clause
!> Comparisons of numbers and texts behind the assertions. The modules made from assertions.f90.in choose ranks and
!> shapes.
module funit_checks
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use, intrinsic :: iso_fortran_env, only: dp => real64, i4 => int32, i8 => int64
   use funit_report, only: note_failure
   implicit none
   private
   public :: check_equal, check_less, check_at_most, conformable_shapes, text_of

   interface check_equal
      module procedure equal_real, equal_integer_real, equal_i4, equal_i8, equal_i4_i8, equal_logical, equal_text
   end interface check_equal
   interface check_less
      module procedure less_real, less_i4, less_i8, less_i4_i8, less_i8_i4
   end interface check_less
   interface check_at_most
      module procedure at_most_real, at_most_i4, at_most_i8, at_most_i4_i8, at_most_i8_i4
   end interface check_at_most
   interface text_of
      module procedure text_real, text_i4, text_i8, text_logical
   end interface text_of

contains

   !> A scalar conforms with any array; two arrays must have the same shape.
   logical function conformable_shapes(expected, found, message)
      integer, intent(in) :: expected(:), found(:)
      character(*), intent(in), optional :: message
      character(len=60) :: text(2)

      conformable_shapes = size(expected) == 0 .or. size(found) == 0
      if (.not. conformable_shapes) conformable_shapes = all(expected == found)
      if (conformable_shapes) return
      write (text(1), '("shape (", *(i0, :, ", "))') expected
      write (text(2), '("shape (", *(i0, :, ", "))') found
      call unequal(trim(text(1))//')', trim(text(2))//')', message)
   end function conformable_shapes

   subroutine unequal(expected, found, message)
      character(*), intent(in) :: expected, found
      character(*), intent(in), optional :: message

      call note_failure('expected '//trim(expected)//', found '//trim(found), message)
   end subroutine unequal

   ! ---- equality --------------------------------------------------------------------------------

   !> |expected - found| <= tolerance; equal infinities are equal, NaN equals nothing.
   impure elemental subroutine equal_real(expected, found, tolerance, message)
      real(dp), intent(in) :: expected, found
      real(dp), intent(in) :: tolerance
      character(*), intent(in), optional :: message

      if (expected == found) return
      if (ieee_is_finite(expected) .and. abs(expected - found) <= tolerance) return
      call unequal(text_of(expected)//' within '//text_of(tolerance), text_of(found)// &
                   ' (difference '//trim(text_of(found - expected))//')', message)
   end subroutine equal_real

   impure elemental subroutine equal_integer_real(expected, found, tolerance, message)
      integer(i4), intent(in) :: expected
      real(dp), intent(in) :: found
      real(dp), intent(in) :: tolerance
      character(*), intent(in), optional :: message

      call equal_real(real(expected, dp), found, tolerance, message)
   end subroutine equal_integer_real

   impure elemental subroutine equal_i4(expected, found, message)
      integer(i4), intent(in) :: expected, found
      character(*), intent(in), optional :: message

      if (expected /= found) call unequal(text_of(expected), text_of(found), message)
   end subroutine equal_i4

   impure elemental subroutine equal_i8(expected, found, message)
      integer(i8), intent(in) :: expected, found
      character(*), intent(in), optional :: message

      if (expected /= found) call unequal(text_of(expected), text_of(found), message)
   end subroutine equal_i8

   impure elemental subroutine equal_i4_i8(expected, found, message)
      integer(i4), intent(in) :: expected
      integer(i8), intent(in) :: found
      character(*), intent(in), optional :: message

      if (expected /= found) call unequal(text_of(expected), text_of(found), message)
   end subroutine equal_i4_i8

   impure elemental subroutine equal_logical(expected, found, message)
      logical, intent(in) :: expected, found
      character(*), intent(in), optional :: message

      if (expected .neqv. found) call unequal(text_of(expected), text_of(found), message)
   end subroutine equal_logical

   !> Blanks at the beginning and at the end do not count.
   impure elemental subroutine equal_text(expected, found, message)
      character(*), intent(in) :: expected, found
      character(*), intent(in), optional :: message

      if (adjustl(expected) /= adjustl(found)) &
         call unequal('"'//trim(adjustl(expected))//'"', '"'//trim(adjustl(found))//'"', message)
   end subroutine equal_text

   ! ---- order; a comparison with NaN is false, so it fails ------------------------------------------

   impure elemental subroutine less_real(a, b, message)
      real(dp), intent(in) :: a, b
      character(*), intent(in), optional :: message

      if (.not. a < b) call note_failure('not '//trim(text_of(a))//' < '//text_of(b), message)
   end subroutine less_real

   impure elemental subroutine less_i8(a, b, message)
      integer(i8), intent(in) :: a, b
      character(*), intent(in), optional :: message

      if (.not. a < b) call note_failure('not '//trim(text_of(a))//' < '//text_of(b), message)
   end subroutine less_i8

   impure elemental subroutine less_i4(a, b, message)
      integer(i4), intent(in) :: a, b
      character(*), intent(in), optional :: message

      call less_i8(int(a, i8), int(b, i8), message)
   end subroutine less_i4

   impure elemental subroutine less_i4_i8(a, b, message)
      integer(i4), intent(in) :: a
      integer(i8), intent(in) :: b
      character(*), intent(in), optional :: message

      call less_i8(int(a, i8), b, message)
   end subroutine less_i4_i8

   impure elemental subroutine less_i8_i4(a, b, message)
      integer(i8), intent(in) :: a
      integer(i4), intent(in) :: b
      character(*), intent(in), optional :: message

      call less_i8(a, int(b, i8), message)
   end subroutine less_i8_i4

   impure elemental subroutine at_most_real(a, b, message)
      real(dp), intent(in) :: a, b
      character(*), intent(in), optional :: message

      if (.not. a <= b) call note_failure('not '//trim(text_of(a))//' <= '//text_of(b), message)
   end subroutine at_most_real

   impure elemental subroutine at_most_i8(a, b, message)
      integer(i8), intent(in) :: a, b
      character(*), intent(in), optional :: message

      if (.not. a <= b) call note_failure('not '//trim(text_of(a))//' <= '//text_of(b), message)
   end subroutine at_most_i8

   impure elemental subroutine at_most_i4(a, b, message)
      integer(i4), intent(in) :: a, b
      character(*), intent(in), optional :: message

      call at_most_i8(int(a, i8), int(b, i8), message)
   end subroutine at_most_i4

   impure elemental subroutine at_most_i4_i8(a, b, message)
      integer(i4), intent(in) :: a
      integer(i8), intent(in) :: b
      character(*), intent(in), optional :: message

      call at_most_i8(int(a, i8), b, message)
   end subroutine at_most_i4_i8

   impure elemental subroutine at_most_i8_i4(a, b, message)
      integer(i8), intent(in) :: a
      integer(i4), intent(in) :: b
      character(*), intent(in), optional :: message

      call at_most_i8(a, int(b, i8), message)
   end subroutine at_most_i8_i4

   ! ---- numbers as text --------------------------------------------------------------------------

   function text_real(x) result(text)
      real(dp), intent(in) :: x
      character(:), allocatable :: text
      character(len=32) :: buffer

      write (buffer, '(es24.16e3)') x
      text = trim(adjustl(buffer))
   end function text_real

   function text_i4(n) result(text)
      integer(i4), intent(in) :: n
      character(:), allocatable :: text

      text = text_i8(int(n, i8))
   end function text_i4

   function text_i8(n) result(text)
      integer(i8), intent(in) :: n
      character(:), allocatable :: text
      character(len=24) :: buffer

      write (buffer, '(i0)') n
      text = trim(buffer)
   end function text_i8

   function text_logical(condition) result(text)
      logical, intent(in) :: condition
      character(:), allocatable :: text

      text = trim(merge('true ', 'false', condition))
   end function text_logical

end module funit_checks
