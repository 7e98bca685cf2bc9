! SPDX-License-Identifier: BSD-3-Clause
!> Models of exact flows of two parts of H: made of these alone, or beside a gradient.
module symsde_capi_parts
   use, intrinsic :: iso_c_binding, only: c_funptr, c_int, c_loc, c_ptr, c_sizeof
   use symsde_base_status, only: error_type
   use symsde_base_traits, only: model_traits
   use symsde_capi_error, only: finish, take_struct
   use symsde_capi_joint, only: find_callback_model
   use symsde_capi_model, only: begin_handle, new_handle
   use symsde_capi_text, only: read_text
   use symsde_capi_traits, only: c_traits, from_traits, to_traits
   use symsde_model_abstract, only: model_type
   use symsde_model_user_callback, only: callback_model, new_parts_model
   implicit none
   private
   public :: symsde_model_new_parts, symsde_model_set_parts

contains

   !> Create a model from the exact flows of two parts of H, with values or without.
   function symsde_model_new_parts(name, traits, drift, kick, value, user, model, error) result(status) &
      bind(c, name='symsde_model_new_parts')
      type(c_ptr), intent(in), value :: name, traits, user, model, error
      type(c_funptr), intent(in), value :: drift, kick, value
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      character(:), allocatable :: text
      type(c_traits), target :: given
      class(model_type), allocatable :: made

      call begin_handle(model, 'model', refusal)
      call read_text(name, 'name', text, refusal)
      given = from_traits(model_traits())
      call take_struct(traits, 'traits', c_loc(given), c_sizeof(given), refusal)
      if (.not. allocated(refusal)) then
         allocate (callback_model :: made)
         select type (made)
         type is (callback_model)
            call new_parts_model(made, text, to_traits(given), drift, kick, value, user, refusal)
         end select
      end if
      call new_handle(made, model, refusal)
      status = finish(refusal, error)
   end function symsde_model_new_parts

   !> Give a model of symsde_model_new the exact flows of two parts of its H; NULL for both removes them. Refuses
   !> built-in models (incompatible), and one function without the other (missing_operation).
   function symsde_model_set_parts(model, drift, kick, error) result(status) bind(c, name='symsde_model_set_parts')
      type(c_ptr), intent(in), value :: model, error
      type(c_funptr), intent(in), value :: drift, kick
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(callback_model), pointer :: known

      call find_callback_model(model, known, 'symsde_model_set_parts', refusal)
      if (.not. allocated(refusal)) call known%set_parts(drift, kick, refusal)
      status = finish(refusal, error)
   end function symsde_model_set_parts

end module symsde_capi_parts
