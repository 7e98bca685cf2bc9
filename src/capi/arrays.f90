! SPDX-License-Identifier: BSD-3-Clause
!> View the caller's arrays as Fortran arrays, first index fastest, without a copy.
module symsde_capi_arrays
   use, intrinsic :: iso_c_binding, only: c_f_pointer, c_ptr
   use symsde_base_kinds, only: wp, i4, i8
   implicit none
   private
   public :: view

   !> array => the numbers at an address, of the given extents.
   interface view
      module procedure view_vector, view_matrix, view_cube, view_codes, view_indices
   end interface view

contains

   subroutine view_vector(given, n, array)
      type(c_ptr), intent(in) :: given
      integer(i8), intent(in) :: n
      real(wp), pointer, contiguous, intent(out) :: array(:)
      integer(i8) :: extent(1)

      extent(1) = n
      call c_f_pointer(given, array, extent)
   end subroutine view_vector

   subroutine view_matrix(given, n1, n2, array)
      type(c_ptr), intent(in) :: given
      integer(i8), intent(in) :: n1, n2
      real(wp), pointer, contiguous, intent(out) :: array(:, :)
      integer(i8) :: extent(2)

      extent(1) = n1
      extent(2) = n2
      call c_f_pointer(given, array, extent)
   end subroutine view_matrix

   subroutine view_cube(given, n1, n2, n3, array)
      type(c_ptr), intent(in) :: given
      integer(i8), intent(in) :: n1, n2, n3
      real(wp), pointer, contiguous, intent(out) :: array(:, :, :)
      integer(i8) :: extent(3)

      extent(1) = n1
      extent(2) = n2
      extent(3) = n3
      call c_f_pointer(given, array, extent)
   end subroutine view_cube

   subroutine view_codes(given, n, array)
      type(c_ptr), intent(in) :: given
      integer(i8), intent(in) :: n
      integer(i4), pointer, contiguous, intent(out) :: array(:)
      integer(i8) :: extent(1)

      extent(1) = n
      call c_f_pointer(given, array, extent)
   end subroutine view_codes

   subroutine view_indices(given, n, array)
      type(c_ptr), intent(in) :: given
      integer(i8), intent(in) :: n
      integer(i8), pointer, contiguous, intent(out) :: array(:)
      integer(i8) :: extent(1)

      extent(1) = n
      call c_f_pointer(given, array, extent)
   end subroutine view_indices

end module symsde_capi_arrays
