! SPDX-License-Identifier: BSD-3-Clause
!> The one list of status codes with their texts, and the error that set-up procedures return.
!>
!> Codes below zero are misuse (nothing was computed); codes above zero are numerical outcomes.
!> include/symsde.h repeats the numbers; a test compares the two lists.
module symsde_base_status
   use symsde_base_kinds, only: i4
   implicit none
   private
   public :: error_type, raise, status_text
   public :: status_ok, invalid_argument, incompatible, unknown_name, wrong_shape, too_large
   public :: false_trait, null_handle, out_of_memory, missing_operation
   public :: not_converged, singular, nonfinite, callback_failed, stopped, paths_failed, absorbed

   integer(i4), parameter :: status_ok = 0
   ! misuse: the call was refused
   integer(i4), parameter :: invalid_argument = -1
   integer(i4), parameter :: incompatible = -2       !! scheme, model and options do not fit together
   integer(i4), parameter :: unknown_name = -3
   integer(i4), parameter :: wrong_shape = -4
   integer(i4), parameter :: too_large = -5          !! a size too large to be counted, addressed or held
   integer(i4), parameter :: false_trait = -6        !! a declared trait or Hessian is refuted by a probe
   integer(i4), parameter :: null_handle = -7
   integer(i4), parameter :: out_of_memory = -8
   integer(i4), parameter :: missing_operation = -9  !! the model does not offer the requested operation
   ! numerical outcomes: 1 to 5 and 7 are also the status of a path
   integer(i4), parameter :: not_converged = 1
   integer(i4), parameter :: singular = 2
   integer(i4), parameter :: nonfinite = 3
   integer(i4), parameter :: callback_failed = 4
   integer(i4), parameter :: stopped = 5
   integer(i4), parameter :: paths_failed = 6        !! the run is complete, some of its paths are not ok
   integer(i4), parameter :: absorbed = 7            !! the path has left the region of an absorbing observer

   !> The error of a set-up. Procedures return it as allocatable: allocated means failed.
   type :: error_type
      integer(i4) :: code = status_ok          !! a code of this module
      character(:), allocatable :: place       !! the procedure that refused
      character(:), allocatable :: message     !! the value given, the values allowed, the remedy
   end type error_type

contains

   !> Raise an error; an error raised earlier is kept, so that the first cause is reported.
   subroutine raise(error, code, place, message)
      type(error_type), allocatable, intent(inout) :: error
      integer(i4), intent(in) :: code           !! a code of this module
      character(*), intent(in) :: place         !! name of the procedure that refuses
      character(*), intent(in) :: message       !! a sentence: given, allowed, what to do

      if (allocated(error)) return
      allocate (error)
      error%code = code
      error%place = place
      error%message = message
   end subroutine raise

   pure character(len=64) function padded_text(code) result(text)
      integer(i4), intent(in) :: code

      select case (code)
      case (status_ok); text = 'ok'
      case (invalid_argument); text = 'invalid argument'
      case (incompatible); text = 'scheme, model and options do not fit together'
      case (unknown_name); text = 'unknown name'
      case (wrong_shape); text = 'array of the wrong shape'
      case (too_large); text = 'sizes too large'
      case (false_trait); text = 'a declared trait or Hessian is false'
      case (null_handle); text = 'null or deleted handle'
      case (out_of_memory); text = 'out of memory'
      case (missing_operation); text = 'the model does not offer a needed operation'
      case (not_converged); text = 'implicit equations not solved'
      case (singular); text = 'singular linear system'
      case (nonfinite); text = 'not a finite number'
      case (callback_failed); text = 'a user callback reported failure'
      case (stopped); text = 'stopped on request'
      case (paths_failed); text = 'some paths failed'
      case (absorbed); text = 'left the region that an observer watches'
      case default; text = 'unknown status code'
      end select
   end function padded_text

   !> The text of a status code.
   pure function status_text(code) result(text)
      integer(i4), intent(in) :: code
      character(len=len_trim(padded_text(code))) :: text

      text = padded_text(code)
   end function status_text

end module symsde_base_status
