! SPDX-License-Identifier: BSD-3-Clause
!> A monitor that calls a C function.
module symsde_capi_monitor
   use, intrinsic :: iso_c_binding, only: &
      c_associated, c_char, c_f_procpointer, c_funptr, c_int, c_int64_t, c_null_ptr, c_ptr
   use symsde_base_kinds, only: i8
   use symsde_capi_text, only: put_chars
   use symsde_ensemble_monitor, only: monitor_type
   implicit none
   private
   public :: callback_monitor, new_callback_monitor

   type, extends(monitor_type) :: callback_monitor
      private
      procedure(progress_callback), pointer, nopass :: on_progress => null()
      type(c_ptr) :: user = c_null_ptr
      procedure(warn_callback), pointer, nopass :: on_warnings => null()
      type(c_ptr) :: warn_user = c_null_ptr
   contains
      procedure :: wants_stop => ask_callback
      procedure :: refuses => warn_by_callback
      procedure :: set_warn
   end type callback_monitor

   abstract interface
      !> Called with the work done and the total; nonzero stops.
      function progress_callback(done, total, user) bind(c) result(stop_now)
         import :: c_int, c_int64_t, c_ptr
         integer(c_int64_t), value :: done, total
         type(c_ptr), value :: user
         integer(c_int) :: stop_now
      end function progress_callback

      !> Called with warnings before the first step; nonzero refuses the run.
      function warn_callback(warnings, user) bind(c) result(refuse)
         import :: c_char, c_int, c_ptr
         character(kind=c_char), intent(in) :: warnings(*)   !! null-terminated
         type(c_ptr), value :: user
         integer(c_int) :: refuse
      end function warn_callback
   end interface

contains

   !> Set the caller's function; a null pointer means none.
   subroutine new_callback_monitor(self, progress, user)
      type(callback_monitor), intent(out) :: self
      type(c_funptr), intent(in) :: progress   !! symsde_progress, or c_null_funptr
      type(c_ptr), intent(in) :: user          !! passed to the function unchanged

      if (c_associated(progress)) call c_f_procpointer(progress, self%on_progress)
      self%user = user
   end subroutine new_callback_monitor

   !> Call the caller's function, if there is one.
   logical function ask_callback(self, done, total) result(wants_stop)
      class(callback_monitor), intent(inout) :: self
      integer(i8), intent(in) :: done, total

      wants_stop = .false.
      if (associated(self%on_progress)) wants_stop = self%on_progress(done, total, self%user) /= 0
   end function ask_callback

   !> Set the caller's function for warnings; a null pointer means none.
   subroutine set_warn(self, warn, user)
      class(callback_monitor), intent(inout) :: self
      type(c_funptr), intent(in) :: warn   !! symsde_warn, or c_null_funptr
      type(c_ptr), intent(in) :: user      !! passed to the function unchanged

      if (c_associated(warn)) call c_f_procpointer(warn, self%on_warnings)
      self%warn_user = user
   end subroutine set_warn

   !> Call the caller's function for warnings, if there is one.
   logical function warn_by_callback(self, warnings) result(refuses)
      class(callback_monitor), intent(inout) :: self
      character(*), intent(in) :: warnings
      character(kind=c_char) :: chars(len(warnings) + 1)

      refuses = .false.
      if (.not. associated(self%on_warnings)) return
      call put_chars(warnings, chars)
      refuses = self%on_warnings(chars, self%warn_user) /= 0
   end function warn_by_callback

end module symsde_capi_monitor
