! SPDX-License-Identifier: BSD-3-Clause
!> The contract of schemes (scheme/scheme): promises of constructors, and requirements of compositions and steppers on
!> the schemes that they get.
!>
!> Nodes and weights have an entry for each stage, matrices a row and a column; all are finite, and weights sum to one.
!> Nodes may lie outside of the step: compositions go back in time.
module symsde_scheme_contract
   use symsde_base_contracts, only: require, require_finite
   use symsde_base_kinds, only: wp
   use symsde_scheme_scheme, only: scheme_type, tableau_form, galerkin_form, splitting_form
   implicit none
   private
   public :: require_scheme

   real(wp), parameter :: tolerance = 1e-12_wp  !! tolerance for sums of rounded weights

contains

   subroutine require_scheme(scheme, place)
      type(scheme_type), intent(in) :: scheme
      character(*), intent(in) :: place   !! area and procedure

      call require(scheme%form >= tableau_form .and. scheme%form <= splitting_form, place, &
                   'the form of a scheme is known')
      call require(scheme%nstage >= 1 .and. allocated(scheme%name), place, 'a scheme has stages and a name')
      call require_vector(scheme%c)
      call require_weights(scheme%alpha)
      call require_weights(scheme%beta)
      if (scheme%has_tableau()) then
         call require_matrix(scheme%a, scheme%nstage)
         call require_matrix(scheme%abar, scheme%nstage)
         call require_matrix(scheme%b, scheme%nstage)
         call require_matrix(scheme%bbar, scheme%nstage)
      else if (scheme%form == galerkin_form) then
         call require_matrix(scheme%basis, scheme%degree + 1)
         call require_matrix(scheme%slope, scheme%degree + 1)
      end if

   contains

      subroutine require_vector(x)
         real(wp), intent(in) :: x(:)

         call require(size(x) == scheme%nstage, place, 'nodes and weights have an entry for each stage')
         call require_finite(size(x), x, place, 'nodes and weights')
      end subroutine require_vector

      subroutine require_weights(x)
         real(wp), intent(in) :: x(:)

         call require_vector(x)
         call require(abs(sum(x) - 1) <= tolerance, place, 'weights sum to one')
      end subroutine require_weights

      subroutine require_matrix(x, ncolumn)
         real(wp), intent(in) :: x(:, :)
         integer, intent(in) :: ncolumn

         call require(size(x, 1) == scheme%nstage .and. size(x, 2) == ncolumn, place, &
                      'matrices have a row for each stage, and a column for each stage or control point')
         call require_finite(size(x), x, place, 'coefficients')
      end subroutine require_matrix

   end subroutine require_scheme

end module symsde_scheme_contract
