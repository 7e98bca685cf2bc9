! SPDX-License-Identifier: BSD-3-Clause
!> Force and stiffness of a whole block of lanes from the rows of a chain, strip by strip.
module symsde_model_chain_rows
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: strip_lanes
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: block_from_rows

contains

   !> What force_stiffness gives with b = 1, of a model that offers chain_rows. The last strip repeats its last lane.
   subroutine block_from_rows(model, nlane, ndof, nnoise, t, w, q, hq, hqq)
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof)
      real(wp), intent(out) :: hq(nlane, ndof), hqq(nlane, 0:1, ndof)
      real(wp), allocatable :: ws(:, :), qs(:, :), f(:, :), k(:, :, :)  !! of a strip
      integer :: before, lane, from, n

      allocate (ws(strip_lanes, 0:nnoise), qs(strip_lanes, 0:ndof + 1), f(strip_lanes, ndof), &
                k(strip_lanes, 0:1, ndof))
      qs(:, 0) = 0
      qs(:, ndof + 1) = 0
      do before = 0, nlane - 1, strip_lanes
         n = min(strip_lanes, nlane - before)
         do lane = 1, strip_lanes
            from = before + min(lane, n)
            ws(lane, :) = w(from, :)
            qs(lane, 1:ndof) = q(from, :)
         end do
         call model%chain_rows(ndof, nnoise, 1, ndof, t, ws, qs, f, k)
         hq(before + 1:before + n, :) = f(:n, :)
         hqq(before + 1:before + n, :, :) = k(:n, :, :)
      end do
   end subroutine block_from_rows

end module symsde_model_chain_rows
