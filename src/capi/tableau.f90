! SPDX-License-Identifier: BSD-3-Clause
!> The coefficients of a scheme across the C interface. This module is separate because the C function has the name of
!> the module in src/scheme/tableau.f90, and gfortran 12 calls the wrong one where a file uses both.
module symsde_capi_tableau
   use, intrinsic :: iso_c_binding, only: c_associated, c_int, c_ptr
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type, raise, missing_operation
   use symsde_capi_arrays, only: view
   use symsde_capi_error, only: finish
   use symsde_capi_scheme, only: find_scheme
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: symsde_scheme_tableau

contains

   !> Write the coefficients of a tableau into the arrays that the caller gave.
   function symsde_scheme_tableau(scheme, c, a, abar, alpha, b, bbar, beta, error) result(status) &
      bind(c, name='symsde_scheme_tableau')
      type(c_ptr), intent(in), value :: scheme, c, a, abar, alpha, b, bbar, beta, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(scheme_type), pointer :: known

      call find_scheme(scheme, known, refusal)
      if (.not. allocated(refusal)) then
         if (has_coefficients(known)) then
            call write_vector(known%c, c)
            call write_rows(known%a, a)
            call write_rows(known%abar, abar)
            call write_vector(known%alpha, alpha)
            call write_rows(known%b, b)
            call write_rows(known%bbar, bbar)
            call write_vector(known%beta, beta)
         else
            call raise(refusal, missing_operation, 'symsde_scheme_tableau', 'scheme '//known%name// &
                       ' is no tableau: Galerkin schemes, and kicks and drifts, have no such coefficients')
         end if
      end if
      status = finish(refusal, error)
   end function symsde_scheme_tableau

   !> Whether all coefficients of a tableau are allocated.
   pure logical function has_coefficients(scheme)
      type(scheme_type), intent(in) :: scheme

      has_coefficients = allocated(scheme%c) .and. allocated(scheme%a) .and. allocated(scheme%abar) .and. &
                         allocated(scheme%alpha) .and. allocated(scheme%b) .and. allocated(scheme%bbar) .and. &
                         allocated(scheme%beta)
   end function has_coefficients

   !> Write numbers into the caller's array, unless it is NULL.
   subroutine write_vector(x, wanted)
      real(wp), intent(in) :: x(:)
      type(c_ptr), intent(in) :: wanted
      real(wp), pointer, contiguous :: array(:)

      if (.not. c_associated(wanted)) return
      call view(wanted, size(x, kind=i8), array)
      array = x
   end subroutine write_vector

   !> Write a matrix into the caller's array, row by row, unless it is NULL.
   subroutine write_rows(matrix, wanted)
      real(wp), intent(in) :: matrix(:, :)
      type(c_ptr), intent(in) :: wanted
      real(wp), pointer, contiguous :: rows(:, :)

      if (.not. c_associated(wanted)) return
      call view(wanted, size(matrix, 1, i8), size(matrix, 2, i8), rows)
      rows = transpose(matrix)
   end subroutine write_rows

end module symsde_capi_tableau
