! SPDX-License-Identifier: BSD-3-Clause
!> The report of the stand-in for pFUnit: the running test, whether it has failed, and the closing line.
!>
!> The first failed assertion of a test ends it.
module funit_report
   use, intrinsic :: iso_fortran_env, only: output_unit
   implicit none
   private
   public :: funit_begin, funit_failed, funit_end, funit_finish, note_failure

   integer :: npassed = 0, nfailed = 0
   character(:), allocatable :: running  ! name of the test that runs
   character(:), allocatable :: failure  ! text of its first failed assertion
   logical :: located = .false.          ! whether file and line of the failure are printed already

contains

   subroutine funit_begin(name)
      character(*), intent(in) :: name

      running = name
      if (allocated(failure)) deallocate (failure)
      located = .false.
   end subroutine funit_begin

   !> Whether the running test has failed. The first call that gives file and line prints them.
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

   !> Print the last line of the report. The exit code is 1 if a test failed or none ran.
   subroutine funit_finish()
      write (output_unit, '(i0, " passed, ", i0, " failed")') npassed, nfailed
      flush (output_unit)
      if (nfailed > 0 .or. npassed == 0) stop 1, quiet=.true.
      stop 0, quiet=.true.
   end subroutine funit_finish

   !> Keep the text of a failed assertion. Callers compare first, so that passing assertions format no text.
   subroutine note_failure(what, message)
      character(*), intent(in) :: what
      character(*), intent(in), optional :: message

      if (allocated(failure)) return
      failure = what
      if (present(message)) failure = trim(message)//': '//what
   end subroutine note_failure

end module funit_report
