! SPDX-License-Identifier: BSD-3-Clause
!> The contract of diagnoses, checked after their refusals of wrong arguments.
!>
!> Required: increments and functionals of steps have a row for each point or path, and are finite, since they become
!> weights of a model. Promised: paths that were found are finite; all other paths have a nonzero status.
module symsde_diagnose_contract
   use symsde_base_contracts, only: require, require_finite, require_finite_lanes, require_statuses
   use symsde_base_kinds, only: wp, i4, i8
   implicit none
   private
   public :: require_given, require_increments, require_paths

contains

   !> Check the requirements of a diagnosis of single steps.
   subroutine require_given(npoint, nnoise, dw, dz, areas)
      integer, intent(in) :: npoint, nnoise
      real(wp), intent(in) :: dw(:, :)
      real(wp), pointer, intent(in) :: dz(:, :), areas(:, :)   !! may be null

      call require_columns(nnoise, dw)
      if (associated(dz)) call require_columns(nnoise, dz)
      if (associated(areas)) call require_columns(nnoise*(nnoise - 1)/2, areas)

   contains

      subroutine require_columns(ncolumn, x)
         integer, intent(in) :: ncolumn
         real(wp), intent(in) :: x(:, :)
         character(*), parameter :: place = 'diagnose, symplecticity'

         call require(size(x, 1) == npoint .and. size(x, 2) == ncolumn, place, &
                      'increments and functionals have a row for each point, and a column for each noise or pair')
         call require_finite(size(x), x, place, 'increments and functionals')
      end subroutine require_columns

   end subroutine require_given

   !> Check the requirements of a diagnosis of given paths.
   subroutine require_increments(dw, place)
      real(wp), intent(in) :: dw(:, :, :)   !! (npath, nnoise, steps)
      character(*), intent(in) :: place     !! source area and procedure

      call require_finite(size(dw), dw, place, 'increments')
   end subroutine require_increments

   !> Check the promises about paths between given ends.
   subroutine require_paths(status, q, p)
      integer(i4), intent(in) :: status(:)
      real(wp), intent(in) :: q(:, :, :), p(:, :, :)   !! (npath, ndof, ntime)
      character(*), parameter :: place = 'diagnose, boundary value'

      call require_statuses(size(status), int(status, i8), place)
      call require_finite_lanes(size(status), size(q, 2)*size(q, 3), int(status, i8), q, place, 'positions')
      call require_finite_lanes(size(status), size(p, 2)*size(p, 3), int(status, i8), p, place, 'momenta')
   end subroutine require_paths

end module symsde_diagnose_contract
