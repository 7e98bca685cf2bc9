! SPDX-License-Identifier: BSD-3-Clause
!> Checks of parameters that the constructors of models share.
module symsde_model_parameters
   use symsde_base_kinds, only: wp
   use symsde_base_lanes, only: is_finite_lane
   use symsde_base_status, only: error_type, raise, invalid_argument
   use symsde_base_text, only: to_text
   implicit none
   private
   public :: require_finite, is_zero

contains

   !> Refuse a parameter that is NaN or infinite (invalid_argument).
   subroutine require_finite(place, name, x, error)
      character(*), intent(in) :: place  !! the constructor that asks
      character(*), intent(in) :: name   !! name of the parameter
      real(wp), intent(in) :: x          !! its value
      type(error_type), allocatable, intent(inout) :: error

      if (is_finite_lane(x)) return
      call raise(error, invalid_argument, place, 'parameter '//name//' is '//to_text(x)// &
                 '; give a finite number of moderate size')
   end subroutine require_finite

   !> Whether a parameter switches its term off: exactly zero, of either sign.
   elemental logical function is_zero(x)
      real(wp), intent(in) :: x

      is_zero = abs(x) <= 0
   end function is_zero

end module symsde_model_parameters
