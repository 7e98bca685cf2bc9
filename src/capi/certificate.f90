! SPDX-License-Identifier: BSD-3-Clause
!> The certificate of a scheme as text. It stands alone because the C function symsde_scheme_certificate
!> must not be compiled where a Fortran module of that very name is in use.
module symsde_capi_certificate
   use symsde_scheme_certificate, only: certificate, certificate_text
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: describe_scheme

contains

   !> What is proved about a scheme, as readable lines.
   pure subroutine describe_scheme(scheme, text)
      type(scheme_type), intent(in) :: scheme
      character(:), allocatable, intent(out) :: text

      text = certificate_text(certificate(scheme))
   end subroutine describe_scheme

end module symsde_capi_certificate
