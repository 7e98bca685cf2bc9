! SPDX-License-Identifier: BSD-3-Clause
!> The probe of third derivatives: they are second differences of the gradient.
module symsde_model_probe_third
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, false_trait
   use symsde_base_text, only: to_text
   use symsde_model_probe_points, only: probe_points, nlane, npoint, generic
   implicit none
   private
   public :: probe_third

   real(wp), parameter :: matching = 1.0e-3_wp   !! relative mismatch
   real(wp), parameter :: vanishing = 1.0e-5_wp  !! of what belongs to rounding, relative to the gradients
   real(wp), parameter :: step = epsilon(1.0_wp)**0.25_wp  !! of a second difference

contains

   !> Compare S'''[a,b] with [g(x+e(a+b)) + g(x-e(a+b)) - g(x+e(a-b)) - g(x-e(a-b))]/(4 e^2), g the gradient of the
   !> sum S that is probed. Points where a gradient is not finite are passed over.
   subroutine probe_third(points, error)
      type(probe_points), intent(in) :: points
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable, dimension(:, :) :: bq, bp, uq, up, dq, dp
      real(wp) :: e(nlane), largest(nlane)
      integer :: i

      if (allocated(error)) return
      allocate (bq, bp, uq, up, dq, dp, mold=points%zero)
      do i = 1, points%ndof
         bq(:, i) = generic(i, 3)
         bp(:, i) = generic(i, 8)
      end do
      do i = 1, nlane
         e(i) = step*max(1.0_wp, maxval(abs(points%q(i, :))), maxval(abs(points%p(i, :))))
      end do
      call second_difference(points, e, bq, bp, dq, dp, largest)
      associate (x => points)
         call x%model%third_derivative(nlane, x%ndof, x%nnoise, x%t, x%w, x%q, x%p, x%vq, x%vp, bq, bp, uq, up)
      end associate
      call judge(points, largest, 'q', uq, dq, error)
      call judge(points, largest, 'p', up, dp, error)
   end subroutine probe_third

   !> The second difference of the gradient along the direction of the probe and (bq, bp), and the largest component of
   !> the gradients in it.
   subroutine second_difference(points, e, bq, bp, dq, dp, largest)
      type(probe_points), intent(in) :: points
      real(wp), intent(in) :: e(nlane), bq(nlane, points%ndof), bp(nlane, points%ndof)
      real(wp), intent(out) :: dq(nlane, points%ndof), dp(nlane, points%ndof), largest(nlane)
      real(wp), allocatable, dimension(:, :) :: xq, xp, gq, gp
      integer :: i, s, r

      allocate (xq, xp, gq, gp, mold=points%zero)
      dq = 0
      dp = 0
      largest = 0
      do s = -1, 1, 2
         do r = -1, 1, 2
            do i = 1, points%ndof
               xq(:, i) = points%q(:, i) + r*e*(points%vq(:, i) + s*bq(:, i))
               xp(:, i) = points%p(:, i) + r*e*(points%vp(:, i) + s*bp(:, i))
            end do
            call points%model%gradient(nlane, points%ndof, points%nnoise, points%t, points%w, xq, xp, gq, gp)
            do i = 1, points%ndof
               dq(:, i) = dq(:, i) + s*gq(:, i)/(4*e**2)
               dp(:, i) = dp(:, i) + s*gp(:, i)/(4*e**2)
               largest = largest + (abs(gq(:, i)) + abs(gp(:, i)))
            end do
         end do
      end do
   end subroutine second_difference

   subroutine judge(points, largest, letter, found, wanted, error)
      type(probe_points), intent(in) :: points
      real(wp), intent(in) :: largest(nlane)
      character, intent(in) :: letter
      real(wp), intent(in) :: found(nlane, points%ndof), wanted(nlane, points%ndof)
      type(error_type), allocatable, intent(inout) :: error
      real(wp) :: allowed
      integer :: lane, i

      do lane = 1, npoint
         allowed = matching*maxval(abs(wanted(lane, :))) + vanishing*largest(lane)
         if (.not. allowed <= huge(allowed)) cycle
         do i = 1, points%ndof
            if (allocated(error) .or. abs(found(lane, i) - wanted(lane, i)) <= allowed) cycle
            call raise(error, false_trait, 'probe_model', "model '"//points%model%name//"' offers "// &
                       'third_derivative, but by it the third derivative of '//points%sum_name// &
                       ' along two vectors and '//letter//'_'//to_text(i)//' is '// &
                       to_text(found(lane, i))//' and by differences of the gradient '// &
                       to_text(wanted(lane, i))//' at '//points%place(lane, i, i)//'; correct it, or do not offer it')
         end do
      end do
   end subroutine judge

end module symsde_model_probe_third
