! SPDX-License-Identifier: BSD-3-Clause
!>    Hess S v ~ (g(x + e v) - g(x - e v))/(2 e),   g = grad S,   S = H, H_k or a sum
!>
!> Values and second derivatives that a model offers beside its gradient must agree with differences of gradients at the
!> points of the probe.
!>
!> Private to its family.
module symsde_model_probe_derivatives
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, false_trait
   use symsde_base_text, only: to_text
   use symsde_base_traits, only: model_traits
   use symsde_model_probe_points, only: probe_points, nlane, npoint, finding, worst
   use symsde_model_probe_third, only: probe_third
   implicit none
   private
   public :: probe_derivatives, probe_derivatives_of_all, largest_dense

   character(*), parameter :: here = 'probe_model'
   real(wp), parameter :: vanishing = 1.0e-6_wp  !! entries below this part of the largest count as zero
   real(wp), parameter :: matching = 1.0e-4_wp   !! relative mismatch of derivatives
   integer, parameter :: largest_dense = 64      !! ndof up to which dense blocks are probed
   integer, parameter :: dense_alone = 16 !! ndof up to which they are probed for each H_k; above it for H and one sum

   !> Kinds of the model's second derivatives that are compared with differences.
   integer, parameter :: by_product = 1, by_blocks = 2, by_bands = 3, by_joint = 4

contains

   !> Test the derivatives offered besides the gradient. At this point the bands are known to contain all entries.
   subroutine probe_derivatives(points, traits, k, error)
      type(probe_points), intent(in) :: points
      type(model_traits), intent(in) :: traits
      integer, intent(in) :: k  !! number of the sum; 0 is H
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) return
      if (traits%has_value) call probe_value(points, error)
      if (traits%has_hessian_vector) call probe_second(points, by_product, error)
      call probe_dense(points, merge(largest_dense, dense_alone, k == 0), error)
      if (traits%bandwidth >= 0) call probe_second(points, by_bands, error)
      if (traits%has_third_derivative) call probe_third(points, error)
   end subroutine probe_derivatives

   !> Test the Hessian in dense blocks for the sum of all Hamiltonians, where there are too many for each of them.
   subroutine probe_derivatives_of_all(points, error)
      type(probe_points), intent(in) :: points
      type(error_type), allocatable, intent(inout) :: error

      if (points%ndof > dense_alone) call probe_dense(points, largest_dense, error)
   end subroutine probe_derivatives_of_all

   !> If has_value is declared, the rate at which values change along a direction must be the gradient times the
   !> direction.
   subroutine probe_value(points, error)
      type(probe_points), intent(in) :: points
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable :: hq(:, :), hp(:, :)
      real(wp), dimension(nlane) :: slope, apart, exact, scale, values
      integer :: lane

      call points%gradient(hq, hp, scale)
      exact = sum(hq*points%vq, dim=2) + sum(hp*points%vp, dim=2)
      scale = sum(abs(hq*points%vq), dim=2) + sum(abs(hp*points%vp), dim=2)
      call points%slope_of_values(slope, apart, values)
      scale = scale + vanishing*values  ! error of a difference from rounding of large values
      where (.not. apart <= 1.0e-5_wp*scale) slope = exact  ! no verdict if the two steps disagree
      do lane = 1, npoint
         if (.not. abs(slope(lane) - exact(lane)) > matching*scale(lane)) cycle
         call raise(error, false_trait, here, 'model '''//points%model%name// &
                    ''' declares has_value, but along one direction '//points%sum_name// &
                    ' changes at the rate '//to_text(slope(lane))//' by its values and '//to_text(exact(lane))// &
                    ' by its gradient, at '//points%place(lane, 1, 1)//'; correct one of them, or offer no value')
         return
      end do
   end subroutine probe_value

   !> Test the Hessian in dense blocks, alone and together with the gradient, up to the given largest ndof.
   subroutine probe_dense(points, largest, error)
      type(probe_points), intent(in) :: points
      integer, intent(in) :: largest
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error) .or. .not. points%model%traits%has_hessian .or. points%ndof > largest) return
      call probe_second(points, by_blocks, error)
      if (.not. allocated(error)) call probe_joint(points, error)
   end subroutine probe_dense

   !> In gradient_hessian the gradient must be that of `gradient`, and the Hessian must agree with differences of
   !> gradients.
   subroutine probe_joint(points, error)
      type(probe_points), intent(in) :: points
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable :: hq(:, :), hp(:, :), gq(:, :), gp(:, :)
      real(wp), allocatable :: hqq(:, :, :), hqp(:, :, :), hpp(:, :, :)
      real(wp) :: scale(nlane)
      type(finding) :: bad

      call probe_second(points, by_joint, error)
      if (allocated(error)) return
      call points%gradient(hq, hp, scale)
      allocate (gq, gp, mold=points%zero)
      associate (n => points%ndof, x => points)
         allocate (hqq(nlane, n, n), hqp(nlane, n, n), hpp(nlane, n, n))
         call x%model%gradient_hessian(nlane, n, x%nnoise, x%t, x%w, x%q, x%p, gq, gp, hqq, hqp, hpp)
      end associate
      hqq(:, :, 1) = gq - hq
      hpp(:, :, 1) = gp - hp
      call worst(hqq(:, :, 1), hpp(:, :, 1), scale, vanishing, bad)
      if (bad%lane == 0) return
      if (bad%half == 2) hq = hp
      if (bad%half == 2) gq = gp
      call raise(error, false_trait, here, 'model '''//points%model%name//''' offers gradient_hessian, but d'// &
                 points%sum_name//merge('/dq_', '/dp_', bad%half == 1)//to_text(bad%i)//' is '// &
                 to_text(gq(bad%lane, bad%i))//' by it and '//to_text(hq(bad%lane, bad%i))// &
                 ' by the gradient at '//points%place(bad%lane, bad%i, bad%i)// &
                 '; correct one of them, or do not offer it')
   end subroutine probe_joint

   !> All offered second derivatives (hessian_vector, hessian, hessian_banded, gradient_hessian) must agree with
   !> differences of the gradient: products with a direction in q and with one in p are compared.
   subroutine probe_second(points, which, error)
      type(probe_points), intent(in) :: points
      integer, intent(in) :: which  !! by_product, by_blocks, by_bands or by_joint
      type(error_type), allocatable, intent(inout) :: error
      character(*), parameter :: names(4) = ['has_hessian_vector', 'has_hessian       ', &
                                             'hessian_banded    ', 'gradient_hessian  ']
      real(wp), allocatable, dimension(:, :) :: vq, vp, uq, up, aq, ap, eq, ep
      real(wp) :: scale(nlane)
      type(finding) :: bad
      integer :: half, pass

      do half = 1, 2
         if (allocated(error)) return
         vq = merge(points%vq, points%zero, half == 1)
         vp = merge(points%vp, points%zero, half == 2)
         call offered_product(points, which, vq, vp, aq, ap)
         do pass = 1, 2
            call points%product(vq, vp, uq, up, scale, pass == 2)
            eq = aq - uq
            ep = ap - up
            call worst(eq, ep, scale, matching, bad)
            if (bad%lane == 0) exit
         end do
         if (bad%lane == 0) cycle
         if (bad%half == 2) uq = up
         if (bad%half == 2) aq = ap
         call raise(error, false_trait, here, 'model '''//points%model%name//''' offers '//trim(names(which))// &
                    ', but by it '//points%entry_name(bad, finding(1, half, 0))//' times a vector is '// &
                    to_text(aq(bad%lane, bad%i))//' and by differences of the gradient '// &
                    to_text(uq(bad%lane, bad%i))//' at '//points%place(bad%lane, bad%i, bad%i)// &
                    '; correct it, or do not offer it')
      end do
   end subroutine probe_second

   !> The Hessian times (vq, vp) by one of the model's operations.
   subroutine offered_product(points, which, vq, vp, uq, up)
      type(probe_points), intent(in) :: points
      integer, intent(in) :: which
      real(wp), intent(in) :: vq(nlane, points%ndof), vp(nlane, points%ndof)
      real(wp), allocatable, intent(out) :: uq(:, :), up(:, :)
      real(wp), allocatable :: hqq(:, :, :), hqp(:, :, :), hpp(:, :, :)
      integer :: b, i, j, d

      allocate (uq, up, mold=points%zero)
      associate (n => points%ndof, m => points%nnoise, x => points)
         if (which == by_product) then
            call x%model%hessian_vector(nlane, n, m, x%t, x%w, x%q, x%p, vq, vp, uq, up)
            return
         end if
         b = merge(x%model%traits%bandwidth, n - 1, which == by_bands)
         if (which == by_bands) then
            allocate (hqq(nlane, -b:b, n), hqp(nlane, -b:b, n), hpp(nlane, -b:b, n))
            call x%model%hessian_banded(nlane, n, m, b, x%t, x%w, x%q, x%p, hqq, hqp, hpp)
         else
            allocate (hqq(nlane, n, n), hqp(nlane, n, n), hpp(nlane, n, n))
            if (which == by_blocks) call x%model%hessian(nlane, n, m, x%t, x%w, x%q, x%p, hqq, hqp, hpp)
            if (which == by_joint) &  ! uq and up receive the gradient first
               call x%model%gradient_hessian(nlane, n, m, x%t, x%w, x%q, x%p, uq, up, hqq, hqp, hpp)
         end if
         uq = 0
         up = 0
         do j = 1, n
            do i = max(1, j - b), min(n, j + b)
               if (which == by_bands) then
                  d = j - i
                  uq(:, i) = uq(:, i) + hqq(:, d, i)*vq(:, j) + hqp(:, d, i)*vp(:, j)
                  up(:, i) = up(:, i) + hpp(:, d, i)*vp(:, j)
                  up(:, j) = up(:, j) + hqp(:, d, i)*vq(:, i)
               else
                  uq(:, i) = uq(:, i) + hqq(:, i, j)*vq(:, j) + hqp(:, i, j)*vp(:, j)
                  up(:, i) = up(:, i) + hpp(:, i, j)*vp(:, j)
                  up(:, j) = up(:, j) + hqp(:, i, j)*vq(:, i)
               end if
            end do
         end do
      end associate
   end subroutine offered_product

end module symsde_model_probe_derivatives
