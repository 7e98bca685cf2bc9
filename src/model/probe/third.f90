! SPDX-License-Identifier: BSD-3-Clause
!>    S'''[a,b] ~ [g(x+e(a+b)) + g(x-e(a+b)) - g(x+e(a-b)) - g(x-e(a-b))]/(4 e^2),     g = grad S,   x = (q, p)
!>
!> The probe of third derivatives: they must agree with second differences of the gradient. A second difference takes
!> four gradients. One difference is tried first, and two more if it disagrees: at most twelve gradients in addition to
!> one call of third_derivative.
module symsde_model_probe_third
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, false_trait
   use symsde_base_text, only: to_text
   use symsde_model_probe_points, only: probe_points, nlane, npoint, generic
   implicit none
   private
   public :: probe_third

   real(wp), parameter :: matching = 1.0e-3_wp   !! relative mismatch
   real(wp), parameter :: vanishing = 1.0e-5_wp  !! mismatch that counts as rounding, relative to the gradients
   real(wp), parameter :: step = epsilon(1.0_wp)**0.25_wp  !! step of a second difference at a state of size one
   integer, parameter :: nstep = 3  !! differences: one with a step in proportion to the state, two with short ones

contains

   !> Compare S'''[a,b] with the second difference of the gradient g of the probed sum S, where a is the direction of
   !> the probe. A step in proportion to the state suits powers. Far from the origin such a step spans whole periods of
   !> a sine: if it refutes a component, two steps of (eps |x|)^(1/4), which suit lengths of one, are tried too. Points
   !> where a gradient is not finite are skipped.
   subroutine probe_third(points, error)
      type(probe_points), intent(in) :: points
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable :: bq(:, :), bp(:, :), uq(:, :), up(:, :), dq(:, :, :), dp(:, :, :)
      real(wp) :: far(nlane), short(nlane), shorter(nlane), largest(nlane, nstep), state
      integer :: i, n

      if (allocated(error)) return
      n = points%ndof
      ! b is a second direction without zeros: a and b together reach every entry of the tensor.
      allocate (bq, bp, uq, up, mold=points%zero)
      allocate (dq(nlane, n, nstep), dp(nlane, n, nstep))
      do i = 1, n
         bq(:, i) = generic(i, 3)
         bp(:, i) = generic(i, 8)
      end do
      do i = 1, nlane
         ! eps^(1/4) balances the truncation error of a second difference, e^2, with the rounding error, eps/e^2.
         state = max(1.0_wp, maxval(abs(points%q(i, :))), maxval(abs(points%p(i, :))))
         !   e = eps^(1/4) |x|,   (eps |x|)^(1/4),   and half of the second
         far(i) = step*state
         short(i) = step*state**0.25_wp
         shorter(i) = short(i)/2
      end do
      associate (x => points)
         call x%model%third_derivative(nlane, n, x%nnoise, x%t, x%w, x%q, x%p, x%vq, x%vp, bq, bp, uq, up)
      end associate
      call second_difference(points, far, bq, bp, dq(:, :, 1), dp(:, :, 1), largest(:, 1))
      ! Most models end here, after four gradients.
      if (fits(uq, dq, largest, 1) .and. fits(up, dp, largest, 1)) return
      call second_difference(points, short, bq, bp, dq(:, :, 2), dp(:, :, 2), largest(:, 2))
      call second_difference(points, shorter, bq, bp, dq(:, :, 3), dp(:, :, 3), largest(:, 3))
      ! A component is refused only if all three differences refute it and the two short steps agree with each other.
      call judge(points, largest, 'q', uq, dq, error)
      call judge(points, largest, 'p', up, dp, error)
   end subroutine probe_third

   !> The second difference of the gradient along two directions, the direction of the probe and (bq, bp), with a
   !> separate step e in every lane. `largest` sums the sizes of all gradients in it, since rounding is proportional to
   !> these.
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
      !   x + r e (a + s b),   r, s = -1, 1
      do s = -1, 1, 2
         do r = -1, 1, 2
            do i = 1, points%ndof
               xq(:, i) = points%q(:, i) + r*e*(points%vq(:, i) + s*bq(:, i))
               xp(:, i) = points%p(:, i) + r*e*(points%vp(:, i) + s*bp(:, i))
            end do
            call points%model%gradient(nlane, points%ndof, points%nnoise, points%t, points%w, xq, xp, gq, gp)
            do i = 1, points%ndof
               ! s = 1 is a + b, s = -1 is a - b, which has the opposite sign; r is the sign of e.
               dq(:, i) = dq(:, i) + s*gq(:, i)/(4*e**2)
               dp(:, i) = dp(:, i) + s*gp(:, i)/(4*e**2)
               ! The sum is over components too: it bounds the rounding of any of them.
               largest = largest + (abs(gq(:, i)) + abs(gp(:, i)))
            end do
         end do
      end do
   end subroutine second_difference

   !> Refuse a component that all differences refute, if those with short steps agree.
   subroutine judge(points, largest, letter, found, wanted, error)
      type(probe_points), intent(in) :: points
      real(wp), intent(in) :: largest(nlane, nstep)
      character, intent(in) :: letter
      real(wp), intent(in) :: found(nlane, points%ndof), wanted(nlane, points%ndof, nstep)
      type(error_type), allocatable, intent(inout) :: error
      real(wp) :: allowed(npoint, nstep)
      integer :: lane, i

      call find_allowed(wanted, largest, nstep, allowed)
      do i = 1, points%ndof
         if (allocated(error)) return
         ! A component is refused only if all three differences refute it.
         lane = refuted(found(:, i), wanted(:, i, :), allowed, nstep)
         if (lane == 0) cycle
         call raise(error, false_trait, 'probe_model', "model '"//points%model%name//"' offers "// &
                    'third_derivative, but by it the third derivative of '//points%sum_name// &
                    ' along two vectors and '//letter//'_'//to_text(i)//' is '// &
                    to_text(found(lane, i))//' and by differences of the gradient '// &
                    to_text(wanted(lane, i, 2))//' at '//points%place(lane, i, i)//'; correct it, or do not offer it')
      end do
   end subroutine judge

   !> Whether no component is refuted by the first m differences.
   logical function fits(found, wanted, largest, m)
      real(wp), intent(in) :: found(:, :), wanted(:, :, :), largest(:, :)
      integer, intent(in) :: m  !! number of differences computed so far
      real(wp) :: allowed(npoint, m)
      integer :: i

      call find_allowed(wanted, largest, m, allowed)
      fits = .true.
      do i = 1, size(found, 2)
         fits = fits .and. refuted(found(:, i), wanted(:, i, :), allowed, m) == 0
      end do
   end function fits

   !> The largest allowed mismatch, by point and difference: a part of the largest component, and the error from
   !> rounding of the gradients.
   pure subroutine find_allowed(wanted, largest, m, allowed)
      real(wp), intent(in) :: wanted(:, :, :), largest(:, :)
      integer, intent(in) :: m
      real(wp), intent(out) :: allowed(npoint, m)
      integer :: lane, s

      do s = 1, m
         do lane = 1, npoint
            ! 1e-3 of the largest component + 1e-5 of the gradients that were subtracted
            ! Rounding is about eps/e^2 = 1e-8 of the gradients at a state of size one.
            allowed(lane, s) = matching*maxval(abs(wanted(lane, :, s))) + vanishing*largest(lane, s)
         end do
      end do
   end subroutine find_allowed

   !> The first point where each of the first m differences refutes a component, 0 = none. With all three differences,
   !> the two short steps must agree there; points where a number is not finite are skipped.
   pure integer function refuted(found, wanted, allowed, m) result(lane)
      integer, intent(in) :: m
      real(wp), intent(in) :: found(:), wanted(:, :), allowed(npoint, m)

      do lane = 1, npoint
         ! A gradient that is not finite makes `allowed` not finite.
         if (.not. all(allowed(lane, :) <= huge(allowed))) cycle
         ! One difference that agrees is enough: a badly chosen step refutes correct derivatives.
         if (any(abs(found(lane) - wanted(lane, :m)) <= allowed(lane, :))) cycle
         if (m == nstep) then
            if (.not. abs(wanted(lane, 2) - wanted(lane, 3)) <= maxval(allowed(lane, 2:))) cycle
         end if
         return
      end do
      lane = 0
   end function refuted

end module symsde_model_probe_third
