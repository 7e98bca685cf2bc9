! SPDX-License-Identifier: BSD-3-Clause
!>    X_k = (H_k,p, -H_k,q),    X_kl = [X_k,X_l],    X_jkl = [X_j,X_kl] = DX_kl X_j - DX_j X_kl
!>    rho = sum |X_jkl|^2/sum |X_kl|^2  [1/time],    tau = 6/rho,    n = tau/(12 |h|) leaves a step
!>
!> The time scale of a model's areas. It determines how finely a step must be halved, so that the error of an area does
!> not exceed the terms that the scheme leaves out anyway.
!>
!> X_k is the Hamiltonian vector field of noise k, X_kl = [X_k,X_l] a bracket of two, and X_jkl = [X_j,X_kl]. A step
!> of midpoint_areas leaves out terms of size h^(3/2) |X_jkl|, and an area assembled from n leaves has an error of about
!> h |X_kl|/sqrt(12 n). The two errors are balanced by
!>
!>    n = tau/(12 |h|),   tau = 6/rho,   rho = sum |X_jkl|^2/sum |X_kl|^2  [1/time]
!>
!> The sums are over noises and over eight fixed points of order one, not over states of a run, whose increments must
!> not depend on its initial state. rho has the right unit of 1/time. If all X_jkl vanish, the drift replaces X_j, with
!> rho = |X_0kl|/|X_kl|.
module symsde_model_probe_area_time
   use symsde_base_kinds, only: wp
   use symsde_base_lanes, only: lane_unit
   use symsde_base_sincos, only: sine_of
   use symsde_base_status, only: error_type, raise, incompatible
   use symsde_model_abstract, only: model_type
   use symsde_model_algebra, only: algebra_work, new_algebra_work, bracket_gradient
   implicit none
   private
   public :: derive_area_time

   real(wp), parameter :: reach = 1e-4_wp      !! displacement in a difference
   real(wp), parameter :: vanishing = 1e-5_wp  !! relative size below which a nested field counts as rounding

   !> The eight fixed points at which fields are compared, one per lane, and arrays for the fields.
   type :: point_set
      class(model_type), pointer :: model => null()
      real(wp) :: t = 0
      integer :: n = 0, m = 0
      real(wp), allocatable :: x(:, :)         !! q, then p (lane_unit, 2 ndof)
      type(algebra_work) :: work
   end type point_set

contains

   !> Compute tau from the fields at the fixed points. It is zero if the noises commute at all of them: areas then have
   !> no effect, and no step is halved for them. Errors: incompatible if fields are not finite, or if no nested bracket
   !> exceeds rounding.
   subroutine derive_area_time(model, t, tau, error)
      class(model_type), intent(in), target :: model
      real(wp), intent(in) :: t                         !! start of the run [time]
      real(wp), intent(out) :: tau                      !! time scale of the areas [time]
      type(error_type), allocatable, intent(inout) :: error
      type(point_set) :: points
      real(wp) :: single, by_noise, by_drift, noise_scale, drift_scale
      integer :: j, k, l, i

      points%model => model
      points%t = t
      points%n = model%traits%ndof
      points%m = model%traits%nnoise
      allocate (points%x(lane_unit, 2*points%n))
      do i = 1, 2*points%n
         points%x(:, i) = [(sine_of(1.3_wp*i + 0.7_wp*l + 0.2_wp*i*l), l=1, lane_unit)]
      end do
      call new_algebra_work(points%work, lane_unit, points%n, points%m)
      single = 0
      by_noise = 0
      by_drift = 0
      noise_scale = 0
      drift_scale = 0
      ! X_kl = -X_lk, so pairs k < l suffice. The drift's field, j = 0, is summed separately, since rho depends on it
      ! with another power.
      do l = 2, points%m
         do k = 1, l - 1
            !   single = sum |X_kl|^2,   by_noise = sum |X_jkl|^2,   by_drift = sum |X_0kl|^2
            single = single + square_of_bracket(points, k, l)
            by_drift = by_drift + square_of_nested(points, 0, k, l, drift_scale)
            do j = 1, points%m
               by_noise = by_noise + square_of_nested(points, j, k, l, noise_scale)
            end do
         end do
      end do
      tau = 0
      ! A sum that is not finite passes this test, and is refused below.
      if (.not. single > 0 .and. single <= huge(single)) return
      ! Squares are compared, so the relative size is squared too.
      if (by_noise > vanishing**2*noise_scale .and. by_noise <= huge(tau)) then
         tau = 6*single/by_noise
      else if (by_drift > vanishing**2*drift_scale .and. by_drift <= huge(tau)) then
         tau = 6*sqrt(single/by_drift)
      end if
      if (tau > 0 .and. tau <= huge(tau)) return
      call raise(error, incompatible, 'derive_area_time', 'the time scale of the areas of model '//model%name// &
                 ' cannot be derived from its Hamiltonians: give it (area_time), about the time in which its '// &
                 'noises turn each other''s fields around')
   end subroutine derive_area_time

   !> The sum over the points of |X_kl|^2.
   real(wp) function square_of_bracket(points, k, l)
      type(point_set), intent(inout) :: points
      integer, intent(in) :: k, l
      real(wp) :: v(lane_unit, 2*points%n)

      call field_of_bracket(points, points%x, k, l, v)
      square_of_bracket = sum(v**2)
   end function square_of_bracket

   !> The sum over the points of |X_jkl|^2, with X_jkl = DX_kl X_j - DX_j X_kl by central differences along X_j and
   !> X_kl.
   !>
   !> `scale` increases by the squares that the sum is compared with: those of the two terms, and of |X_kl| |X_j|, the
   !> size of the terms at points of order one. Without |X_kl| |X_j|, two terms that are both rounding would be compared
   !> with rounding.
   real(wp) function square_of_nested(points, j, k, l, scale)
      type(point_set), intent(inout) :: points
      integer, intent(in) :: j, k, l
      real(wp), intent(inout) :: scale
      real(wp), dimension(lane_unit, 2*points%n) :: single, bracket, a, b, fore, back
      real(wp) :: e(lane_unit)
      integer :: i

      call field_of_one(points, points%x, j, single)
      call field_of_bracket(points, points%x, k, l, bracket)
      scale = scale + sum(sum(single**2, dim=2)*sum(bracket**2, dim=2))
      !   a = DX_kl X_j ~ (X_kl(x + e X_j) - X_kl(x - e X_j))/(2 e)
      e = step_along(points%n, single)
      do i = 1, 2*points%n
         fore(:, i) = points%x(:, i) + e*single(:, i)
         back(:, i) = points%x(:, i) - e*single(:, i)
      end do
      call field_of_bracket(points, fore, k, l, a)
      call field_of_bracket(points, back, k, l, b)
      do i = 1, 2*points%n
         a(:, i) = (a(:, i) - b(:, i))/(2*e)
      end do
      !   b = DX_j X_kl ~ (X_j(x + e X_kl) - X_j(x - e X_kl))/(2 e)
      e = step_along(points%n, bracket)
      do i = 1, 2*points%n
         fore(:, i) = points%x(:, i) + e*bracket(:, i)
         back(:, i) = points%x(:, i) - e*bracket(:, i)
      end do
      call field_of_one(points, fore, j, single)
      call field_of_one(points, back, j, b)
      do i = 1, 2*points%n
         b(:, i) = (single(:, i) - b(:, i))/(2*e)
      end do
      scale = scale + sum(a**2) + sum(b**2)
      square_of_nested = sum((a - b)**2)
   end function square_of_nested

   !> The length e of a difference along v, in each lane: |e v| = reach. For v = 0 the result does not depend on e, and
   !> e is one.
   pure function step_along(n, v) result(e)
      integer, intent(in) :: n
      real(wp), intent(in) :: v(lane_unit, 2*n)
      real(wp) :: e(lane_unit)

      e = sqrt(sum(v**2, dim=2))
      where (e > 0)
         e = reach/e
      else where
         e = 1
      end where
   end function step_along

   !> The field X_j = (H_j,p, -H_j,q) at x. The gradient is written directly into the two halves of v; the sign of H_j,q
   !> in the second half is then changed.
   subroutine field_of_one(points, x, j, v)
      type(point_set), intent(in) :: points
      integer, intent(in) :: j
      real(wp), intent(in) :: x(lane_unit, 2*points%n)
      real(wp), intent(out) :: v(lane_unit, 2*points%n)
      real(wp) :: w(lane_unit, 0:points%m)

      w = 0
      w(:, j) = 1
      associate (n => points%n)
         call points%model%gradient(lane_unit, n, points%m, points%t, w, x(:, :n), x(:, n + 1:), v(:, n + 1:), v(:, :n))
         v(:, n + 1:) = -v(:, n + 1:)
      end associate
   end subroutine field_of_one

   !> The field of the bracket {H_k,H_l}, which is X_kl up to a sign that squares ignore.
   subroutine field_of_bracket(points, x, k, l, v)
      type(point_set), intent(inout) :: points
      integer, intent(in) :: k, l
      real(wp), intent(in) :: x(lane_unit, 2*points%n)
      real(wp), intent(out) :: v(lane_unit, 2*points%n)
      real(wp), dimension(lane_unit, 0:points%m) :: wk, wl

      wk = 0
      wk(:, k) = 1
      wl = 0
      wl(:, l) = 1
      associate (n => points%n)
         call bracket_gradient(points%work, points%model, points%t, wk, wl, x(:, :n), x(:, n + 1:), v(:, n + 1:), &
                               v(:, :n))
         v(:, n + 1:) = -v(:, n + 1:)
      end associate
   end subroutine field_of_bracket

end module symsde_model_probe_area_time
