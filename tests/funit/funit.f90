! SPDX-License-Identifier: BSD-3-Clause
!> Stands in for pFUnit's module funit: the assertions that the suites use, and the report.
!>
!> The first failed assertion of a test ends it. Assertions are elemental, so they take every rank; a
!> specific procedure for ranks one and two compares the shapes, which an elemental one cannot see.
module funit
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_is_nan
   use, intrinsic :: iso_fortran_env, only: dp => real64, i4 => int32, i8 => int64, output_unit
   implicit none
   private
   public :: assertEqual, assertTrue, assertFalse, assertIsNaN, assertIsFinite
   public :: assertLessThan, assertLessThanOrEqual, assertGreaterThan, assertGreaterThanOrEqual
   public :: funit_begin, funit_failed, funit_end, funit_finish

   integer :: npassed = 0, nfailed = 0
   character(:), allocatable :: running  ! name of the test that runs
   character(:), allocatable :: failure  ! text of its first failed assertion
   logical :: located = .false.          ! file and line of the failure are printed

   interface assertEqual
      module procedure equal_real, equal_i4, equal_i8, equal_text, equal_logical
      module procedure equal_real_1, equal_real_2, equal_i4_1, equal_i4_2, equal_i8_1, equal_i8_2
      module procedure equal_logical_1, equal_logical_2
   end interface assertEqual
   interface assertLessThan
      module procedure less_real, less_i4, less_i8
   end interface assertLessThan
   interface assertLessThanOrEqual
      module procedure at_most_real, at_most_i4, at_most_i8
   end interface assertLessThanOrEqual
   interface assertGreaterThan
      module procedure greater_real, greater_i4, greater_i8
   end interface assertGreaterThan
   interface assertGreaterThanOrEqual
      module procedure at_least_real, at_least_i4, at_least_i8
   end interface assertGreaterThanOrEqual
   interface text_of
      module procedure text_real, text_i4, text_i8, text_logical
   end interface text_of

contains

   ! ---- the report ------------------------------------------------------------------------------

   subroutine funit_begin(name)
      character(*), intent(in) :: name

      running = name
      if (allocated(failure)) deallocate (failure)
      located = .false.
   end subroutine funit_begin

   !> Whether the running test has failed; where file and line are given, the first to ask reports them.
   logical function funit_failed(file, line)
      character(*), intent(in), optional :: file
      integer, intent(in), optional :: line

      funit_failed = allocated(failure)
      if (.not. funit_failed .or. located .or. .not. present(file)) return
      write (output_unit, '(a, ":", i0, ": ", a, ": ", a)') file, line, running, failure
      located = .true.
   end function funit_failed

   subroutine funit_end()
      if (funit_failed()) then
         if (.not. located) write (output_unit, '(a, ": ", a)') running, failure
         nfailed = nfailed + 1
      else
         write (output_unit, '("ok   ", a)') running
         npassed = npassed + 1
      end if
      flush (output_unit)
   end subroutine funit_end

   !> Last line of the report; the exit code is 1 on a failure and where no test ran.
   subroutine funit_finish()
      write (output_unit, '(i0, " passed, ", i0, " failed")') npassed, nfailed
      flush (output_unit)
      if (nfailed > 0 .or. npassed == 0) stop 1, quiet=.true.
      stop 0, quiet=.true.
   end subroutine funit_finish

   !> Note a failed assertion. Callers check first, so that nothing is formatted where all is well.
   subroutine fail(what, message)
      character(*), intent(in) :: what
      character(*), intent(in), optional :: message

      if (allocated(failure)) return
      failure = what
      if (present(message)) failure = trim(message)//': '//what
   end subroutine fail

   subroutine unequal(expected, found, message)
      character(*), intent(in) :: expected, found
      character(*), intent(in), optional :: message

      call fail('expected '//trim(expected)//', found '//trim(found), message)
   end subroutine unequal

   logical function same_shape(expected, found, message)
      integer, intent(in) :: expected(:), found(:)
      character(*), intent(in), optional :: message
      character(len=60) :: text(2)

      same_shape = all(expected == found)
      if (same_shape) return
      write (text(1), '("shape (", *(i0, :, ", "))') expected
      write (text(2), '("shape (", *(i0, :, ", "))') found
      call unequal(trim(text(1))//')', trim(text(2))//')', message)
   end function same_shape

   ! ---- equality --------------------------------------------------------------------------------

   !> |expected - found| <= tolerance; equal infinities are equal, NaN equals nothing.
   impure elemental subroutine equal_real(expected, found, message, tolerance)
      real(dp), intent(in) :: expected, found
      character(*), intent(in), optional :: message
      real(dp), intent(in), optional :: tolerance
      real(dp) :: allowed

      allowed = 0
      if (present(tolerance)) allowed = tolerance
      if (expected == found) return
      if (ieee_is_finite(expected) .and. abs(expected - found) <= allowed) return
      call unequal(text_of(expected)//' within '//text_of(allowed), text_of(found)// &
                   ' (difference '//trim(text_of(found - expected))//')', message)
   end subroutine equal_real

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

   impure elemental subroutine equal_logical(expected, found, message)
      logical, intent(in) :: expected, found
      character(*), intent(in), optional :: message

      if (expected .neqv. found) call unequal(text_of(expected), text_of(found), message)
   end subroutine equal_logical

   !> Blanks at the end do not count, as everywhere in Fortran.
   impure elemental subroutine equal_text(expected, found, message)
      character(*), intent(in) :: expected, found
      character(*), intent(in), optional :: message

      if (expected /= found) call unequal('"'//trim(expected)//'"', '"'//trim(found)//'"', message)
   end subroutine equal_text

   subroutine equal_real_1(expected, found, message, tolerance)
      real(dp), intent(in) :: expected(:), found(:)
      character(*), intent(in), optional :: message
      real(dp), intent(in), optional :: tolerance

      if (same_shape(shape(expected), shape(found), message)) &
         call equal_real(expected, found, message, tolerance)
   end subroutine equal_real_1

   subroutine equal_real_2(expected, found, message, tolerance)
      real(dp), intent(in) :: expected(:, :), found(:, :)
      character(*), intent(in), optional :: message
      real(dp), intent(in), optional :: tolerance

      if (same_shape(shape(expected), shape(found), message)) &
         call equal_real(expected, found, message, tolerance)
   end subroutine equal_real_2

   subroutine equal_i4_1(expected, found, message)
      integer(i4), intent(in) :: expected(:), found(:)
      character(*), intent(in), optional :: message

      if (same_shape(shape(expected), shape(found), message)) call equal_i4(expected, found, message)
   end subroutine equal_i4_1

   subroutine equal_i4_2(expected, found, message)
      integer(i4), intent(in) :: expected(:, :), found(:, :)
      character(*), intent(in), optional :: message

      if (same_shape(shape(expected), shape(found), message)) call equal_i4(expected, found, message)
   end subroutine equal_i4_2

   subroutine equal_i8_1(expected, found, message)
      integer(i8), intent(in) :: expected(:), found(:)
      character(*), intent(in), optional :: message

      if (same_shape(shape(expected), shape(found), message)) call equal_i8(expected, found, message)
   end subroutine equal_i8_1

   subroutine equal_i8_2(expected, found, message)
      integer(i8), intent(in) :: expected(:, :), found(:, :)
      character(*), intent(in), optional :: message

      if (same_shape(shape(expected), shape(found), message)) call equal_i8(expected, found, message)
   end subroutine equal_i8_2

   subroutine equal_logical_1(expected, found, message)
      logical, intent(in) :: expected(:), found(:)
      character(*), intent(in), optional :: message

      if (same_shape(shape(expected), shape(found), message)) &
         call equal_logical(expected, found, message)
   end subroutine equal_logical_1

   subroutine equal_logical_2(expected, found, message)
      logical, intent(in) :: expected(:, :), found(:, :)
      character(*), intent(in), optional :: message

      if (same_shape(shape(expected), shape(found), message)) &
         call equal_logical(expected, found, message)
   end subroutine equal_logical_2

   ! ---- order; a comparison with NaN is false, so it fails ------------------------------------------

   impure elemental subroutine less_real(a, b, message)
      real(dp), intent(in) :: a, b
      character(*), intent(in), optional :: message

      if (.not. a < b) call fail('not '//trim(text_of(a))//' < '//text_of(b), message)
   end subroutine less_real

   impure elemental subroutine less_i4(a, b, message)
      integer(i4), intent(in) :: a, b
      character(*), intent(in), optional :: message

      if (.not. a < b) call fail('not '//trim(text_of(a))//' < '//text_of(b), message)
   end subroutine less_i4

   impure elemental subroutine less_i8(a, b, message)
      integer(i8), intent(in) :: a, b
      character(*), intent(in), optional :: message

      if (.not. a < b) call fail('not '//trim(text_of(a))//' < '//text_of(b), message)
   end subroutine less_i8

   impure elemental subroutine at_most_real(a, b, message)
      real(dp), intent(in) :: a, b
      character(*), intent(in), optional :: message

      if (.not. a <= b) call fail('not '//trim(text_of(a))//' <= '//text_of(b), message)
   end subroutine at_most_real

   impure elemental subroutine at_most_i4(a, b, message)
      integer(i4), intent(in) :: a, b
      character(*), intent(in), optional :: message

      if (.not. a <= b) call fail('not '//trim(text_of(a))//' <= '//text_of(b), message)
   end subroutine at_most_i4

   impure elemental subroutine at_most_i8(a, b, message)
      integer(i8), intent(in) :: a, b
      character(*), intent(in), optional :: message

      if (.not. a <= b) call fail('not '//trim(text_of(a))//' <= '//text_of(b), message)
   end subroutine at_most_i8

   impure elemental subroutine greater_real(a, b, message)
      real(dp), intent(in) :: a, b
      character(*), intent(in), optional :: message

      call less_real(b, a, message)
   end subroutine greater_real

   impure elemental subroutine greater_i4(a, b, message)
      integer(i4), intent(in) :: a, b
      character(*), intent(in), optional :: message

      call less_i4(b, a, message)
   end subroutine greater_i4

   impure elemental subroutine greater_i8(a, b, message)
      integer(i8), intent(in) :: a, b
      character(*), intent(in), optional :: message

      call less_i8(b, a, message)
   end subroutine greater_i8

   impure elemental subroutine at_least_real(a, b, message)
      real(dp), intent(in) :: a, b
      character(*), intent(in), optional :: message

      call at_most_real(b, a, message)
   end subroutine at_least_real

   impure elemental subroutine at_least_i4(a, b, message)
      integer(i4), intent(in) :: a, b
      character(*), intent(in), optional :: message

      call at_most_i4(b, a, message)
   end subroutine at_least_i4

   impure elemental subroutine at_least_i8(a, b, message)
      integer(i8), intent(in) :: a, b
      character(*), intent(in), optional :: message

      call at_most_i8(b, a, message)
   end subroutine at_least_i8

   ! ---- truth and kinds of numbers ---------------------------------------------------------------

   impure elemental subroutine assertTrue(condition, message)
      logical, intent(in) :: condition
      character(*), intent(in), optional :: message

      if (.not. condition) call fail('expected true, found false', message)
   end subroutine assertTrue

   impure elemental subroutine assertFalse(condition, message)
      logical, intent(in) :: condition
      character(*), intent(in), optional :: message

      if (condition) call fail('expected false, found true', message)
   end subroutine assertFalse

   impure elemental subroutine assertIsNaN(x, message)
      real(dp), intent(in) :: x
      character(*), intent(in), optional :: message

      if (.not. ieee_is_nan(x)) call fail('expected NaN, found '//text_of(x), message)
   end subroutine assertIsNaN

   impure elemental subroutine assertIsFinite(x, message)
      real(dp), intent(in) :: x
      character(*), intent(in), optional :: message

      if (.not. ieee_is_finite(x)) call fail('expected a finite number, found '//text_of(x), message)
   end subroutine assertIsFinite

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

      text = merge('true ', 'false', condition)
   end function text_logical

end module funit
