! SPDX-License-Identifier: BSD-3-Clause
!> The library's sine and cosine for functions of the user in C.
module symsde_capi_sincos
   use, intrinsic :: iso_c_binding, only: c_associated, c_int, c_ptr
   use symsde_base_kinds, only: wp, i8
   use symsde_base_sincos, only: sincos_lanes
   use symsde_base_status, only: status_ok, invalid_argument
   use symsde_capi_arrays, only: view
   implicit none
   private
   public :: symsde_sincos

contains

   !> Compute sine[n], cosine[n] of x[n]. Innermost loops call this function, and have no use for a message: only the
   !> status reports NULL and a negative n.
   function symsde_sincos(n, x, sine, cosine) result(status) bind(c, name='symsde_sincos')
      integer(c_int), intent(in), value :: n
      type(c_ptr), intent(in), value :: x, sine, cosine
      integer(c_int) :: status
      real(wp), pointer, contiguous :: angles(:), s(:), c(:)

      status = invalid_argument
      if (n < 0) return
      if (.not. (c_associated(x) .and. c_associated(sine) .and. c_associated(cosine))) return
      call view(x, int(n, i8), angles)
      call view(sine, int(n, i8), s)
      call view(cosine, int(n, i8), c)
      call sincos_lanes(n, angles, s, c)
      status = status_ok
   end function symsde_sincos

end module symsde_capi_sincos
