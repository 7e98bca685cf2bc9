! SPDX-License-Identifier: BSD-3-Clause
!> Assertions on logical values, NaN and finite numbers. As in pFUnit, logical values are scalars or vectors, numbers
!> scalars.
module funit_truth
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_is_nan
   use, intrinsic :: iso_fortran_env, only: dp => real64
   use funit_checks, only: text_of
   use funit_report, only: note_failure
   implicit none
   private
   public :: assertTrue, assertFalse, assertIsNaN, assertIsFinite

   interface assertTrue
      module procedure true_scalar, true_vector
   end interface assertTrue
   interface assertFalse
      module procedure false_scalar, false_vector
   end interface assertFalse

contains

   subroutine true_scalar(condition, message)
      logical, intent(in) :: condition
      character(*), intent(in), optional :: message

      if (.not. condition) call note_failure('expected true, found false', message)
   end subroutine true_scalar

   subroutine true_vector(condition, message)
      logical, intent(in) :: condition(:)
      character(*), intent(in), optional :: message

      call true_scalar(all(condition), message)
   end subroutine true_vector

   subroutine false_scalar(condition, message)
      logical, intent(in) :: condition
      character(*), intent(in), optional :: message

      if (condition) call note_failure('expected false, found true', message)
   end subroutine false_scalar

   subroutine false_vector(condition, message)
      logical, intent(in) :: condition(:)
      character(*), intent(in), optional :: message

      call false_scalar(any(condition), message)
   end subroutine false_vector

   subroutine assertIsNaN(x, message)
      real(dp), intent(in) :: x
      character(*), intent(in), optional :: message

      if (.not. ieee_is_nan(x)) call note_failure('expected NaN, found '//text_of(x), message)
   end subroutine assertIsNaN

   subroutine assertIsFinite(x, message)
      real(dp), intent(in) :: x
      character(*), intent(in), optional :: message

      if (.not. ieee_is_finite(x)) call note_failure('expected a finite number, found '//text_of(x), message)
   end subroutine assertIsFinite

end module funit_truth
