! SPDX-License-Identifier: BSD-3-Clause
!> The certificate of a scheme as a C struct and as text. The C function symsde_scheme_certificate must not be
!> compiled where a Fortran module of the same name is in use, so it has a module of its own.
module symsde_capi_certificate
   use, intrinsic :: iso_c_binding, only: c_char, c_double, c_int32_t, c_null_char, c_size_t
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use symsde_base_functionals, only: path_dz, path_areas, path_stt_area, path_magnus
   use symsde_base_kinds, only: wp
   use symsde_capi_text, only: put_chars
   use symsde_scheme_certificate, only: certificate, certificate_text, certificate_type
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: describe_scheme, c_scheme_info, fill_info

   !> struct symsde_scheme_info
   type, bind(c) :: c_scheme_info
      integer(c_size_t) :: struct_size = 0
      integer(c_int32_t) :: form = 0, nstage = 0, degree = 0
      integer(c_int32_t) :: symplectic = 0, symmetric = 0, keeps_quadratic = 0, keeps_bilinear = 0
      integer(c_int32_t) :: structure_evidence = 0
      real(c_double) :: symplecticity_residual = 0, symmetry_residual = 0, quadratic_residual = 0
      real(c_double) :: stratonovich_sum = 0, correction_coefficient = 0
      integer(c_int32_t) :: correction_needed = 0, correction_exists = 0
      real(c_double) :: order(5) = 0
      integer(c_int32_t) :: order_evidence(5) = 0
      integer(c_int32_t) :: order_noise_free = 0
      real(c_double) :: measured_order(5) = 0, measured_half_width(5) = 0, measured_floor(5) = 0
      integer(c_int32_t) :: uses_dz = 0, uses_areas = 0, uses_stt_area = 0, uses_magnus = 0, uses_nested_bracket = 0
      integer(c_int32_t) :: law = 0
      integer(c_int32_t) :: explicit_for = 0, gradients_per_step = 0, unknowns = 0, unknowns_if_separable = 0
      character(kind=c_char) :: name(64) = c_null_char
      character(kind=c_char) :: reference(256) = c_null_char
   end type c_scheme_info

contains

   !> Write the proved, claimed and measured properties of a scheme as readable lines.
   pure subroutine describe_scheme(scheme, text)
      type(scheme_type), intent(in) :: scheme
      character(:), allocatable, intent(out) :: text

      text = certificate_text(certificate(scheme))
   end subroutine describe_scheme

   !> Fill all members but struct_size from the certificate.
   subroutine fill_info(scheme, info)
      type(scheme_type), intent(in) :: scheme
      type(c_scheme_info), intent(inout) :: info
      type(certificate_type) :: c

      c = certificate(scheme)
      info%form = c%form
      info%nstage = c%nstage
      info%degree = c%degree
      info%symplectic = truth(c%symplectic)
      info%symmetric = truth(c%symmetric)
      info%keeps_quadratic = truth(c%keeps_quadratic)
      info%keeps_bilinear = truth(c%keeps_bilinear)
      info%structure_evidence = c%structure
      info%symplecticity_residual = c%symplecticity_residual
      info%symmetry_residual = c%symmetry_residual
      info%quadratic_residual = c%quadratic_residual
      info%stratonovich_sum = c%stratonovich_sum
      info%correction_coefficient = c%correction_coefficient
      info%correction_needed = truth(c%correction_needed)
      info%correction_exists = truth(c%correction_exists)
      call fill_orders(c, info)
      info%uses_dz = truth(c%asks%has(path_dz))
      info%uses_areas = truth(c%asks%has(path_areas))
      info%uses_stt_area = truth(c%asks%has(path_stt_area))
      info%uses_magnus = truth(c%asks%has(path_magnus))
      info%uses_nested_bracket = truth(c%brackets%nested) + truth(c%brackets%crossed)
      info%law = c%law
      info%explicit_for = c%explicit_for
      info%gradients_per_step = c%gradients_per_step
      info%unknowns = c%unknowns
      info%unknowns_if_separable = c%unknowns_if_separable
      call put_chars(c%name, info%name)
      call put_chars(c%reference, info%reference)
   end subroutine fill_info

   !> Fill in orders with their evidence; NaN for an order that was not measured.
   subroutine fill_orders(c, info)
      type(certificate_type), intent(in) :: c
      type(c_scheme_info), intent(inout) :: info
      real(wp) :: none

      none = ieee_value(none, ieee_quiet_nan)
      info%order_noise_free = c%order_noise_free
      info%order = c%order%value
      info%order_evidence = c%order%evidence
      info%measured_order = merge(c%order%measured, none, c%order%problem /= '')
      info%measured_half_width = merge(c%order%half_width, none, c%order%problem /= '')
      info%measured_floor = merge(c%order%floor, none, c%order%problem /= '')
   end subroutine fill_orders

   pure integer(c_int32_t) function truth(given)
      logical, intent(in) :: given

      truth = merge(1_c_int32_t, 0_c_int32_t, given)
   end function truth

end module symsde_capi_certificate
