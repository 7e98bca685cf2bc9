! SPDX-License-Identifier: BSD-3-Clause
!> The error of the C interface, and the checks that every function makes of its pointers and structs.
module symsde_capi_error
   use, intrinsic :: iso_c_binding, only: &
      c_associated, c_char, c_f_pointer, c_funptr, c_int, c_int32_t, c_null_ptr, c_ptr, c_size_t
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type, raise, status_ok, invalid_argument, too_large, wrong_shape
   use symsde_base_text, only: to_text
   use symsde_capi_text, only: put_chars
   implicit none
   private
   public :: finish, require, require_function, check_sizes, init_struct, take_struct, give_struct

   integer, parameter :: message_size = 1024

   !> struct symsde_error
   type, bind(c) :: c_error
      integer(c_int32_t) :: code
      character(kind=c_char) :: message(message_size)
   end type c_error

   interface
      !> The C library's copy of n bytes.
      function memcpy(to, from, n) result(copied) bind(c, name='memcpy')
         import :: c_ptr, c_size_t
         type(c_ptr), intent(in), value :: to, from
         integer(c_size_t), intent(in), value :: n
         type(c_ptr) :: copied
      end function memcpy
   end interface

contains

   !> Return the status of a call, and write it into the caller's error too, with a sentence: of the refusal, else of
   !> the outcome, else empty.
   function finish(refusal, error, outcome, sentence) result(status)
      type(error_type), allocatable, intent(in) :: refusal
      type(c_ptr), intent(in) :: error                  !! symsde_error, may be NULL
      integer, intent(in), optional :: outcome          !! status if nothing was refused, default ok
      character(*), intent(in), optional :: sentence    !! sentence about the outcome
      integer(c_int) :: status
      type(c_error), pointer :: filled

      status = status_ok
      if (present(outcome)) status = outcome
      if (allocated(refusal)) status = refusal%code
      if (.not. c_associated(error)) return
      call c_f_pointer(error, filled)
      filled%code = status
      if (allocated(refusal)) then
         call put_chars(refusal%message, filled%message)
      else if (present(sentence)) then
         call put_chars(sentence, filled%message)
      else
         call put_chars('', filled%message)
      end if
   end function finish

   !> Refuse a NULL pointer where one is needed.
   subroutine require(pointer, what, error)
      type(c_ptr), intent(in) :: pointer
      character(*), intent(in) :: what   !! name of the argument
      type(error_type), allocatable, intent(inout) :: error

      if (.not. c_associated(pointer)) &
         call raise(error, invalid_argument, 'require', what//' is NULL: give its address')
   end subroutine require

   !> Refuse a NULL function where one is needed. (In one generic with `require`, gfortran 12 would not tell c_ptr from
   !> c_funptr.)
   subroutine require_function(pointer, what, error)
      type(c_funptr), intent(in) :: pointer
      character(*), intent(in) :: what   !! name of the argument
      type(error_type), allocatable, intent(inout) :: error

      if (.not. c_associated(pointer)) call require(c_null_ptr, what, error)
   end subroutine require_function

   !> Check the sizes of a caller's array: none negative, and its bytes must fit into 62 bits.
   subroutine check_sizes(n1, n2, n3, what, error)
      integer(i8), intent(in) :: n1, n2, n3
      character(*), intent(in) :: what   !! name of the array
      type(error_type), allocatable, intent(inout) :: error
      character(:), allocatable :: text

      if (allocated(error)) return
      if (min(n1, n2, n3) >= 0 .and. real(n1, wp)*real(n2, wp)*real(n3, wp) <= 2.0_wp**59) return
      text = to_text(n1)//' x '//to_text(n2)//' x '//to_text(n3)
      if (min(n1, n2, n3) < 0) then
         call raise(error, wrong_shape, 'check_sizes', what//' has the sizes '//text// &
                    ': none of them may be negative')
      else
         call raise(error, too_large, 'check_sizes', what//' has '//text// &
                    ' numbers, more than can be addressed: give fewer paths, or save less often')
      end if
   end subroutine check_sizes

   !> Fill the caller's struct with the defaults and its size; the status to return.
   function init_struct(given, what, blank, room) result(status)
      type(c_ptr), intent(in) :: given           !! the caller's struct; its first member is struct_size
      character(*), intent(in) :: what           !! name of the argument
      type(c_ptr), intent(in) :: blank           !! this library's struct with its defaults
      integer(c_size_t), intent(in) :: room      !! size of this library's struct
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      integer(c_size_t), pointer :: struct_size
      type(c_ptr) :: ignored

      call require(given, what, refusal)
      if (.not. allocated(refusal)) then
         ignored = memcpy(given, blank, room)
         call c_f_pointer(given, struct_size)
         struct_size = room
      end if
      status = finish(refusal, c_null_ptr)
   end function init_struct

   !> Copy the caller's struct over a copy that holds the defaults: members beyond the caller's struct_size keep the
   !> defaults. Refuses NULL, a struct_size that was never set, and one larger than this library's.
   subroutine take_struct(given, what, copy, room, error)
      type(c_ptr), intent(in) :: given           !! the caller's struct; its first member is struct_size
      character(*), intent(in) :: what           !! name of the struct
      type(c_ptr), intent(in) :: copy            !! this library's struct
      integer(c_size_t), intent(in) :: room      !! size of this library's struct
      type(error_type), allocatable, intent(inout) :: error
      integer(c_size_t), pointer :: struct_size
      type(c_ptr) :: ignored

      call require(given, what, error)
      if (allocated(error)) return
      call c_f_pointer(given, struct_size)
      if (struct_size == 0) then
         call raise(error, invalid_argument, 'take_struct', 'struct_size of '//what// &
                    ' is 0: call symsde_'//what//'_init first')
      else if (struct_size < 8 .or. struct_size > room) then
         call raise(error, invalid_argument, 'take_struct', 'struct_size of '//what//' is '// &
                    to_text(int(struct_size, i8))//', this library knows '//to_text(int(room, i8))// &
                    ' bytes: call symsde_'//what//'_init first, and use the header of this library')
      else
         ignored = memcpy(copy, given, struct_size)
      end if
   end subroutine take_struct

   !> Copy this library's struct into the caller's, up to the caller's struct_size.
   subroutine give_struct(copy, given)
      type(c_ptr), intent(in) :: copy    !! this library's struct
      type(c_ptr), intent(in) :: given   !! the caller's struct, accepted by take_struct before; may be NULL
      integer(c_size_t), pointer :: struct_size
      type(c_ptr) :: ignored

      if (.not. c_associated(given)) return
      call c_f_pointer(given, struct_size)
      ignored = memcpy(given, copy, struct_size)
   end subroutine give_struct

end module symsde_capi_error
