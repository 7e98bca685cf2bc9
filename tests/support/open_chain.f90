! SPDX-License-Identifier: BSD-3-Clause
!> A chain that writes NaN into the entry right of its last diagonal entry, which models may leave undefined.
module open_chain
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type
   use symsde_base_traits, only: strip_lanes
   use symsde_model_catalogue_fpu_chain, only: fpu_chain_model, new_fpu_chain
   implicit none
   private
   public :: open_chain_type, new_open_chain

   type, extends(fpu_chain_model) :: open_chain_type
      logical :: loose = .false.  !! no springs: the masses move freely
   contains
      procedure :: chain_rows
   end type open_chain_type

contains

   !> The chain of the catalogue with n masses.
   subroutine new_open_chain(self, n, beta, sigma)
      type(open_chain_type), intent(out) :: self
      integer, intent(in) :: n
      real(wp), intent(in) :: beta, sigma
      type(error_type), allocatable :: error

      call new_fpu_chain(self%fpu_chain_model, n, beta, sigma, error)
      if (allocated(error)) error stop 'new_open_chain: refused'
   end subroutine new_open_chain

   subroutine chain_rows(self, ndof, nnoise, first, last, t, w, q, hq, hqq)
      class(open_chain_type), intent(in) :: self
      integer, intent(in) :: ndof, nnoise, first, last
      real(wp), intent(in) :: t, w(strip_lanes, 0:nnoise), q(strip_lanes, first - 1:last + 1)
      real(wp), intent(out) :: hq(strip_lanes, first:last), hqq(strip_lanes, 0:1, first:last)

      call self%fpu_chain_model%chain_rows(ndof, nnoise, first, last, t, w, q, hq, hqq)
      if (self%loose) then
         hq = 0
         hqq = 0
      end if
      if (last == ndof) hqq(:, 1, ndof) = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine chain_rows

end module open_chain
