! SPDX-License-Identifier: BSD-3-Clause
!> Rates of damping that are a C function (symsde_damping in symsde.h).
!>
!> Outputs are NaN before every call, so lanes that are left unwritten fail. A nonzero return ends the run, as a return
!> of any function of a model does.
module symsde_model_user_callback_rates
   use, intrinsic :: iso_c_binding, only: c_f_procpointer, c_funptr, c_null_ptr, c_ptr
   use symsde_base_kinds, only: wp
   use symsde_base_rates, only: rate_type
   use symsde_model_user_callback_functions, only: damping_callback
   use symsde_model_user_outputs, only: spoil
   implicit none
   private
   public :: callback_rates

   type, extends(rate_type) :: callback_rates
      private
      procedure(damping_callback), pointer, nopass :: on_rates => null()
      type(c_ptr) :: user = c_null_ptr   !! passed to the function unchanged
   contains
      procedure :: set
      procedure :: find
   end type callback_rates

contains

   !> Let a function give the rates.
   subroutine set(self, rates, one, of_position, of_time, user)
      class(callback_rates), intent(inout) :: self
      type(c_funptr), intent(in) :: rates                      !! a damping_callback
      logical, intent(in) :: one, of_position, of_time         !! see rate_type
      type(c_ptr), intent(in) :: user

      call c_f_procpointer(rates, self%on_rates)
      self%one = one
      self%of_position = of_position
      self%of_time = of_time
      self%user = user
   end subroutine set

   !> The rates at (q, t).
   subroutine find(self, nlane, ndof, nrate, t, q, rate, code)
      class(callback_rates), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nrate
      real(wp), intent(in) :: t, q(nlane, ndof)
      real(wp), intent(out) :: rate(nlane, nrate)
      integer, intent(out) :: code

      call spoil(nlane*nrate, rate)
      code = self%on_rates(nlane, ndof, nrate, t, q, rate, self%user)
   end subroutine find

end module symsde_model_user_callback_rates
