! SPDX-License-Identifier: BSD-3-Clause
!>    hq(i) = S_q(i),    hqq(0,i) = S_qq(i,i),    hqq(1,i) = S_qq(i,i+1)
!>
!> The probe of the rows of a chain, which contain force and stiffness mass by mass: the force must be the gradient, and
!> the stiffness its derivative.
module symsde_model_probe_rows
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, false_trait
   use symsde_base_text, only: to_text
   use symsde_model_chain_rows, only: block_from_rows
   use symsde_model_kernels, only: kernel_model
   use symsde_model_probe_points, only: probe_points, nlane
   implicit none
   private
   public :: probe_rows

   real(wp), parameter :: vanishing = 1.0e-6_wp  !! differences below this part of the gradient count as rounding
   real(wp), parameter :: matching = 1.0e-4_wp   !! relative mismatch of second derivatives

contains

   !> Compare the force and the stiffness of all rows with the gradient and with the bands, which the model computes by
   !> other functions. Points where these are not finite are skipped.
   subroutine probe_rows(points, rows, error)
      type(probe_points), intent(in) :: points
      class(kernel_model), intent(in) :: rows  !! the model of the points
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable :: gq(:, :), gp(:, :), bands(:, :, :), hq(:, :), hqq(:, :, :)
      real(wp) :: scale(nlane)
      integer :: n

      if (allocated(error)) return
      n = points%ndof
      allocate (hq(nlane, n), hqq(nlane, 0:1, n), bands(nlane, -1:1, n))
      ! The reference comes from the functions of whole systems, the judged values from the rows.
      call points%gradient(gq, gp, scale)
      call points%model%hessian_banded(nlane, n, points%nnoise, 1, points%t, points%w, points%q, points%p, hqq=bands)
      call block_from_rows(rows, nlane, n, points%nnoise, points%t, points%w, points%q, hq, hqq)
      ! The entry beyond the last mass has no meaning in rows or bands.
      hqq(:, 1, n) = 0
      bands(:, 1, n) = 0
      ! Forces are compared to six digits, and the stiffness to four, since bands may be differences.
      call compare('force', gq, hq, vanishing)
      call compare('diagonal of the stiffness', bands(:, 0, :), hqq(:, 0, :), matching)
      call compare('stiffness beside the diagonal', bands(:, 1, :), hqq(:, 1, :), matching)

   contains

      !> Refuse (false_trait) the first entry whose error exceeds a part of the largest entry of its lane.
      subroutine compare(what, wanted, found, tolerance)
         character(*), intent(in) :: what
         real(wp), intent(in) :: wanted(:, :), found(:, :), tolerance  !! (nlane, ndof)
         real(wp) :: largest
         integer :: lane, i

         do lane = 1, nlane
            ! Entries are compared with the largest entry of their lane: small ones may be rounding of larger terms.
            largest = maxval(abs(wanted(lane, :)))
            ! The comparison is also false for NaN.
            if (.not. all(abs(wanted(lane, :)) <= huge(largest))) cycle
            do i = 1, n
               ! A row that is not finite is refused here, since the gradient at this point is finite.
               if (abs(found(lane, i) - wanted(lane, i)) <= tolerance*largest) cycle
               call raise(error, false_trait, 'probe_model', "model '"//points%model%name//"' gives rows whose "// &
                          what//' is '//to_text(found(lane, i))//' in row '//to_text(i)//' (counted from 1), where '// &
                          'its gradient says '//to_text(wanted(lane, i))//': correct one of the two')
               return
            end do
         end do
      end subroutine compare

   end subroutine probe_rows

end module symsde_model_probe_rows
