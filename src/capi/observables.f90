! SPDX-License-Identifier: BSD-3-Clause
!> Observables computed by a C function for whole blocks.
module symsde_capi_observables
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_procpointer, c_funptr, c_int, c_null_ptr, c_ptr
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use symsde_base_kinds, only: wp, i4
   use symsde_ensemble_observe_observables, only: observables_type
   implicit none
   private
   public :: callback_observables, new_callback_observables

   !> All threads share the object as intent(in); the record of failure is therefore a pointer.
   type, extends(observables_type) :: callback_observables
      private
      procedure(observables_callback), pointer, nopass :: on_observables => null()
      type(c_ptr) :: user = c_null_ptr
      integer(i4), pointer :: failure => null()  !! first nonzero return
   contains
      procedure :: evaluate
      procedure :: failure_code
      final :: release
   end type callback_observables

   abstract interface
      !> All values of a block at one time; nonzero aborts the run.
      function observables_callback(nlane, ndof, t, q, p, values, user) bind(c) result(code)
         import :: c_int, c_double, c_ptr
         integer(c_int), value :: nlane, ndof
         real(c_double), value :: t
         real(c_double), intent(in) :: q(nlane, ndof), p(nlane, ndof)
         real(c_double), intent(out) :: values(*)   !! (nlane, nvalue)
         type(c_ptr), value :: user
         integer(c_int) :: code
      end function observables_callback
   end interface

contains

   !> Make observables from a C function, or without one.
   subroutine new_callback_observables(self, nvalue, observables, user, most_lanes)
      type(callback_observables), intent(inout) :: self
      integer, intent(in) :: nvalue
      type(c_funptr), intent(in) :: observables   !! an observables_callback; not needed for nvalue = 0
      type(c_ptr), intent(in) :: user
      integer, intent(in) :: most_lanes           !! lanes of several saved times in one call; 0 = one time per call

      self%nvalue = nvalue
      self%most_lanes = most_lanes
      self%user = user
      if (nvalue > 0 .and. c_associated(observables)) call c_f_procpointer(observables, self%on_observables)
      allocate (self%failure, source=0_i4)
   end subroutine new_callback_observables

   !> Call the function until it has failed once; after a failure all values are NaN.
   subroutine evaluate(self, nlane, ndof, t, q, p, values)
      class(callback_observables), intent(in) :: self
      integer, intent(in) :: nlane, ndof
      real(wp), intent(in) :: t, q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: values(nlane, self%nvalue)
      integer(c_int) :: code

      if (self%nvalue == 0) return
      ! Values that the function does not write are NaN.
      values = ieee_value(1.0_wp, ieee_quiet_nan)
      if (self%failure_code() == 0) then
         code = self%on_observables(nlane, ndof, t, q, p, values, self%user)
         if (code == 0) return
         !$omp atomic write
         self%failure = code
      end if
      values = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine evaluate

   !> The nonzero code that the function returned when it failed; 0 = it has not failed.
   integer function failure_code(self) result(code)
      class(callback_observables), intent(in) :: self

      code = 0
      if (.not. associated(self%failure)) return
      !$omp atomic read
      code = self%failure
   end function failure_code

   subroutine release(self)
      type(callback_observables), intent(inout) :: self

      if (associated(self%failure)) deallocate (self%failure)
   end subroutine release

end module symsde_capi_observables
