! SPDX-License-Identifier: BSD-3-Clause
!>    g = sum_k (Hess H_k) H_k,q,     and, of one degree of freedom,   s = (S', S'', C', C'', C''', g')
!>
!> The probe of products of all noises at one pass: they must be the sums of products that gradients and Hessians of
!> single noises give, and S' .. C'' weighted sums of derivatives of single Hamiltonians. C''' and g' are compared with
!> differences of C'' and g over a step e to either side, at points where both sides agree and e has digits.
module symsde_model_probe_squares
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, false_trait
   use symsde_base_text, only: to_text
   use symsde_model_abstract, only: default_step
   use symsde_model_kernels, only: kernel_model
   use symsde_model_probe_points, only: probe_points, nlane, npoint, generic, too_far
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
      real(wp) :: largest(nlane)
      integer :: j, n

      if (allocated(error)) return
      n = points%ndof
      allocate (w(nlane, 0:points%nnoise), source=0.0_wp)
      allocate (hq, hp, uq, up, found, mold=points%zero)
      allocate (g, most, source=points%zero)
      do j = 1, points%nnoise
         w(:, j) = 1
         call points%model%gradient(nlane, n, points%nnoise, points%t, w, points%q, points%p, hq, hp)
         call points%model%hessian_vector(nlane, n, points%nnoise, points%t, w, points%q, points%p, hq, points%zero, &
                                          uq, up)
         g = g + uq
         most = most + abs(uq)
         w(:, j) = 0
      end do
      call fast%squares(nlane, n, points%nnoise, points%t, points%q, found)
      largest = 0
      do j = 1, n
         largest = max(largest, most(:, j))
      end do
      do j = 1, n
         call compare(points, 'component '//to_text(j)//' (counted from 1) of g', g(:, j), found(:, j), largest, error)
      end do
      if (n == 1) call probe_sums(points, fast, g(:, 1), largest, error)
   end subroutine probe_squares

   !> Compare the derivatives of sums with irregular weights, and g beside them.
   subroutine probe_sums(points, fast, g, largest, error)
      type(probe_points), intent(in) :: points
      class(kernel_model), intent(in) :: fast
      real(wp), intent(in) :: g(nlane), largest(nlane)  !! g of single noises, and its size
      type(error_type), allocatable, intent(inout) :: error
      character(*), parameter :: names(6) = [character(4) :: "S'", "S''", "C'", "C''", "C'''", "g'"]
      real(wp), dimension(nlane, 0:points%nnoise) :: one, w, c
      real(wp), dimension(nlane, 1) :: hq, hp, uq, up, x, found
      real(wp), dimension(nlane, 6) :: s, wanted, most, aside, slope
      real(wp), dimension(nlane) :: e, flat, squared
      integer :: i, j, side

      one = 0
      wanted = 0
      most = 0
      x = 1
      do j = 0, points%nnoise
         w(:, j) = generic(j + 1, 1)
         c(:, j) = merge(0.0_wp, generic(j + 1, 4), j == 0)
         one(:, j) = 1
         call points%model%gradient(nlane, 1, points%nnoise, points%t, one, points%q, points%p, hq, hp)
         call points%model%hessian_vector(nlane, 1, points%nnoise, points%t, one, points%q, points%p, x, points%zero, &
                                          uq, up)
         one(:, j) = 0
         call add(1, w(:, j), hq(:, 1))
         call add(2, w(:, j), uq(:, 1))
         call add(3, c(:, j), hq(:, 1))
         call add(4, c(:, j), uq(:, 1))
      end do
      call fast%squares(nlane, 1, points%nnoise, points%t, points%q, found, w, c, s)
      call compare(points, 'g beside sums', g, found(:, 1), largest, error)
      ! Products by differences are compared with slopes, too.
      do i = 1, 4
         flat = most(:, i)
         if (modulo(i, 2) == 0) flat = flat + most(:, i - 1)
         call compare(points, trim(names(i)), wanted(:, i), s(:, i), flat, error)
      end do
      e = default_step*max(1.0_wp, abs(points%q(:, 1)))
      do side = -1, 1, 2
         x(:, 1) = points%q(:, 1) + side*e
         call fast%squares(nlane, 1, points%nnoise, points%t, x, hq, w, c, aside)
         slope(:, side + 2) = (aside(:, 4) - s(:, 4))/(side*e)
         slope(:, side + 3) = (hq(:, 1) - found(:, 1))/(side*e)
      end do
      ! Terms H_k,qq^2 + H_k,qqq H_k,q of g' may cancel where those of g vanish: at 0 sin(q) and cos(q) have g' = 1 - 1.
      squared = most(:, 4)**2 + abs(s(:, 5))*most(:, 3)
      do i = 5, 6
         associate (before => slope(:, i - 4), behind => slope(:, i - 2))
            flat = merge(most(:, 4), largest, i == 5)
            ! The condition is written so that NaN gives no verdict. Sides that agree beside s alone say nothing of it.
            where (abs(before - behind) <= matching*max(abs(before), flat) .and. abs(points%q(:, 1)) <= too_far)
               flat = abs(s(:, i)) + flat + merge(0.0_wp, squared, i == 5)
            else where
               flat = huge(flat)
            end where
            wanted(:, i) = (before + behind)/2
            call compare(points, trim(names(i)), wanted(:, i), s(:, i), flat, error)
         end associate
      end do

   contains

      !> Add weight times x to the wanted s(:, i).
      subroutine add(i, weight, x)
         integer, intent(in) :: i
         real(wp), intent(in) :: weight(nlane), x(nlane)

         wanted(:, i) = wanted(:, i) + weight*x
         most(:, i) = most(:, i) + abs(weight*x)
      end subroutine add

   end subroutine probe_sums

   !> Refuse (false_trait) the first value at a point whose error exceeds a part of the size of its terms.
   subroutine compare(points, what, wanted, given, size_of, error)
      type(probe_points), intent(in) :: points
      character(*), intent(in) :: what
      real(wp), intent(in), dimension(nlane) :: wanted, given, size_of
      type(error_type), allocatable, intent(inout) :: error
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

end module symsde_model_probe_squares
