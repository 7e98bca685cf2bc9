! SPDX-License-Identifier: BSD-3-Clause
!> Gradient and Hessian of a user's model in one function of C.
module symsde_capi_joint
   use, intrinsic :: iso_c_binding, only: c_funptr, c_int, c_ptr
   use symsde_base_status, only: error_type, raise, incompatible
   use symsde_capi_error, only: finish
   use symsde_capi_model, only: find_model
   use symsde_model_abstract, only: model_type
   use symsde_model_callback, only: callback_model
   implicit none
   private
   public :: symsde_model_set_gradient_hessian

contains

   !> Give a model of symsde_model_new one more function; NULL takes it back. Refuses built-in models
   !> (incompatible).
   function symsde_model_set_gradient_hessian(model, gradient_hessian, error) result(status) &
      bind(c, name='symsde_model_set_gradient_hessian')
      type(c_ptr), intent(in), value :: model, error
      type(c_funptr), intent(in), value :: gradient_hessian
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: known

      call find_model(model, known, refusal)
      if (.not. allocated(refusal)) then
         select type (known)
         type is (callback_model)
            call known%set_gradient_hessian(gradient_hessian)
         class default
            call raise(refusal, incompatible, 'symsde_model_set_gradient_hessian', "model '"//known%name// &
                       "' is built in and has all it needs: give functions to models of symsde_model_new")
         end select
      end if
      status = finish(refusal, error)
   end function symsde_model_set_gradient_hessian

end module symsde_capi_joint
