! SPDX-License-Identifier: BSD-3-Clause
!>    g = sum_k (Hess H_k) H_k,q,     k = sum_k H_k,qq^2   of one degree of freedom
!>
!> The probe of products of all noises at one pass: they must be the sums of products that gradients and Hessians of
!> single noises give.
module symsde_model_probe_squares
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, false_trait
   use symsde_base_text, only: to_text
   use symsde_model_kernels, only: kernel_model
   use symsde_model_probe_points, only: probe_points, nlane, npoint
   implicit none
   private
   public :: probe_squares

   real(wp), parameter :: matching = 1.0e-4_wp   !! mismatch relative to the sum of sizes: products may be differences

contains

   !> Compare the products of all noises with those of single noises. Points where these are not finite are skipped.
   subroutine probe_squares(points, fast, error)
      type(probe_points), intent(in) :: points
      class(kernel_model), intent(in) :: fast  !! the model of the points
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable, dimension(:, :) :: w, hq, hp, uq, up, g, found, most
      real(wp) :: k(nlane), stiff(nlane), largest(nlane)
      integer :: j, n

      if (allocated(error)) return
      n = points%ndof
      allocate (w(nlane, 0:points%nnoise), source=0.0_wp)
      allocate (hq, hp, uq, up, found, mold=points%zero)
      allocate (g, most, source=points%zero)
      stiff = 0
      do j = 1, points%nnoise
         w(:, j) = 1
         call points%model%gradient(nlane, n, points%nnoise, points%t, w, points%q, points%p, hq, hp)
         call points%model%hessian_vector(nlane, n, points%nnoise, points%t, w, points%q, points%p, hq, points%zero, &
                                          uq, up)
         g = g + uq
         most = most + abs(uq)
         ! Of one degree of freedom the product with the vector one is the second derivative.
         if (n == 1) then
            hq = 1
            call points%model%hessian_vector(nlane, n, points%nnoise, points%t, w, points%q, points%p, hq, &
                                             points%zero, uq, up)
            stiff = stiff + uq(:, 1)**2
         end if
         w(:, j) = 0
      end do
      call fast%squares(nlane, n, points%nnoise, points%t, points%q, found, k)
      largest = 0
      do j = 1, n
         largest = max(largest, most(:, j))
      end do
      do j = 1, n
         call compare('component '//to_text(j)//' (counted from 1) of g', g(:, j), found(:, j), largest)
      end do
      if (n == 1) call compare('k', stiff, k, stiff)

   contains

      !> Refuse (false_trait) the first value at a point whose error exceeds a part of the size of its terms.
      subroutine compare(what, wanted, given, size_of)
         character(*), intent(in) :: what
         real(wp), intent(in), dimension(nlane) :: wanted, given, size_of
         integer :: lane

         if (allocated(error)) return
         do lane = 1, npoint
            if (.not. size_of(lane) <= huge(1.0_wp)) cycle
            ! The comparison is also false for NaN.
            if (abs(given(lane) - wanted(lane)) <= matching*size_of(lane)) cycle
            call raise(error, false_trait, 'probe_model', "model '"//points%model%name//"' gives squares of its "// &
                       'noises of which '//what//' is '//to_text(given(lane))//', where gradients and Hessians of '// &
                       'single noises say '//to_text(wanted(lane))//': correct one of the two')
            return
         end do
      end subroutine compare

   end subroutine probe_squares

end module symsde_model_probe_squares
