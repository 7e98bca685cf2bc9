! SPDX-License-Identifier: BSD-3-Clause
!>    identity_mass   H_p(q,p) = p;       constant_mass   H_p(q_a, p_a + p_b) = H_p(q_a, p_a) + H_p(q_b, p_b)
!>    diagonal_mass   H_p_i(p_a) p_b_i = H_p_i(p_b) p_a_i
!>
!> The probe of declarations about the kinetic energy: H_p = p, or H_p = M^-1 p with a constant M, or a diagonal one.
!>
!> Private to its family.
module symsde_model_probe_mass
   use symsde_base_kinds, only: wp
   use symsde_base_text, only: to_text
   use symsde_base_traits, only: model_traits
   use symsde_model_probe_points, only: probe_points, nlane, npoint, finding, worst, no_verdict
   implicit none
   private
   public :: compare_mass, compare_quadratic, compare_turns

   real(wp), parameter :: later = 0.37_wp  !! a second time, at which a constant mass must be the same

contains

   !> Find a point and a component where H_p of H_0 differs from the declaration; H_0 must be the probed sum. bad%lane =
   !> 0 if there is none; else `entry` should vanish, and x is its value.
   !>
   !> identity_mass is compared with p itself. For constant_mass no matrix is known, but M^-1 p is a function of p
   !> alone, and additive: H_p(q_a, p_a + p_b) = H_p(q_a, p_a) + H_p(q_b, p_b) at any two points and times. The first
   !> point is b, every other point is a.
   subroutine compare_mass(points, traits, tolerance, trait, bad, entry, x)
      type(probe_points), intent(in) :: points
      type(model_traits), intent(in) :: traits        !! the declaration
      real(wp), intent(in) :: tolerance               !! part of the gradient that counts as rounding
      character(:), allocatable, intent(out) :: trait !! the judged trait
      type(finding), intent(out) :: bad
      character(:), allocatable, intent(out) :: entry
      real(wp), intent(out) :: x
      real(wp), allocatable :: hq(:, :), hp(:, :), zero(:, :), velocity(:, :)
      real(wp) :: scale(nlane)

      call points%gradient(hq, hp, scale)
      allocate (zero, source=points%zero)
      x = 0
      if (traits%identity_mass) then
         trait = 'identity_mass'
         hp = hp - points%p
         call worst(zero, hp, scale, tolerance, bad)
         entry = 'dH_0/dp_'//to_text(bad%i)//' - p_'//to_text(bad%i)
      else
         trait = 'constant_mass'
         velocity = hp
         call subtract_sum(points, hp, scale)
         call worst(zero, hp, scale, tolerance, bad)
         entry = 'dH_0/dp_'//to_text(bad%i)//' at the sum of two momenta (and a later time) minus its values at these'
         if (bad%lane == 0 .and. traits%diagonal_mass) then
            trait = 'diagonal_mass'
            call compare_ratios(points, velocity, hp, scale)
            call worst(zero, hp, scale, tolerance, bad)
            entry = 'dH_0/dp_'//to_text(bad%i)//' at one momentum times p_'//to_text(bad%i)//' of another minus '// &
                    'the same with both exchanged'
         end if
      end if
      if (bad%lane > 0) x = hp(bad%lane, bad%i)
   end subroutine compare_mass

   !> Find a point and a component where H_p of H_0 differs from S_pq q + S_pp p of the declared quadratic part; H_0 is
   !> the probed sum, now and at a later time. bad%lane = 0 if there is none; else x is the difference.
   subroutine compare_quadratic(points, tolerance, bad, x)
      type(probe_points), intent(in) :: points
      real(wp), intent(in) :: tolerance               !! part of the gradient that counts as rounding
      type(finding), intent(out) :: bad
      real(wp), intent(out) :: x
      real(wp) :: hq(nlane, points%ndof), hp(nlane, points%ndof), zero(nlane, points%ndof), scale(nlane)
      integer :: i, j, pass

      zero = points%zero
      x = 0
      associate (n => points%ndof, s => points%model%traits%quadratic_part)
         do pass = 0, 1
            call points%model%gradient(nlane, n, points%nnoise, points%t + pass*later, points%w, points%q, points%p, &
                                       hq, hp)
            scale = maxval(abs(hp), dim=2) + 0*sum(hp, dim=2)
            do i = 1, n
               do j = 1, n
                  hp(:, i) = hp(:, i) - s(n + i, j)*points%q(:, j) - s(n + i, n + j)*points%p(:, j)
                  scale = max(scale, abs(s(n + i, j)*points%q(:, j)), abs(s(n + i, n + j)*points%p(:, j)))
               end do
            end do
            call worst(zero, hp, scale, tolerance, bad)
            if (bad%lane > 0) then
               x = hp(bad%lane, bad%i)
               return
            end if
         end do
      end associate
   end subroutine compare_quadratic

   !> Find a point and a plane where {(q_i^2 + p_i^2)/2, S} = q_i S_p - p_i S_q does not vanish for the probed sum S,
   !> less the declared quadratic part if `parted`. bad%lane = 0 if there is none; else x is the bracket.
   subroutine compare_turns(points, parted, tolerance, bad, x)
      type(probe_points), intent(in) :: points
      logical, intent(in) :: parted
      real(wp), intent(in) :: tolerance               !! part of the gradient that counts as rounding
      type(finding), intent(out) :: bad
      real(wp), intent(out) :: x
      real(wp), dimension(nlane, points%ndof) :: hq, hp, bracket, zero
      real(wp) :: scale(nlane), state(nlane)
      integer :: i, j

      zero = points%zero
      x = 0
      associate (n => points%ndof, s => points%model%traits%quadratic_part, q => points%q, p => points%p)
         call points%model%gradient(nlane, n, points%nnoise, points%t, points%w, q, p, hq, hp)
         scale = maxval(abs(hq), dim=2) + maxval(abs(hp), dim=2) + 0*(sum(hq, dim=2) + sum(hp, dim=2))
         state = maxval(abs(q), dim=2) + maxval(abs(p), dim=2)
         do j = 1, merge(n, 0, parted)
            do i = 1, n
               hq(:, i) = hq(:, i) - s(i, j)*q(:, j) - s(i, n + j)*p(:, j)
               hp(:, i) = hp(:, i) - s(n + i, j)*q(:, j) - s(n + i, n + j)*p(:, j)
            end do
         end do
         if (parted) scale = max(scale, maxval(abs(s))*state)
         bracket = q*hp - p*hq
         call worst(bracket, zero, scale*state, tolerance, bad)
         if (bad%lane > 0) x = bracket(bad%lane, bad%i)
      end associate
   end subroutine compare_turns

   !> Compare velocities with those of the first point, component by component: v_i(p_a) p_1,i - v_i(p_1) p_a,i. The
   !> scale is the sum of both products, each with the largest components.
   subroutine compare_ratios(points, v, difference, scale)
      type(probe_points), intent(in) :: points
      real(wp), intent(in) :: v(nlane, points%ndof)
      real(wp), intent(out) :: difference(nlane, points%ndof), scale(nlane)
      integer :: lane

      do lane = 1, nlane
         difference(lane, :) = v(lane, :)*points%p(1, :) - v(1, :)*points%p(lane, :)
         scale(lane) = maxval(abs(v(lane, :)))*maxval(abs(points%p(1, :))) &
                       + maxval(abs(v(1, :)))*maxval(abs(points%p(lane, :))) + 0*sum(difference(lane, :))
      end do
   end subroutine compare_ratios

   !> Replace hp, the H_p at the points, by H_p(q_a, p_a + p_1) - H_p(q_a, p_a) - H_p(q_1, p_1), which vanishes for
   !> a constant mass. The first point and the lanes that repeat the last point are not compared: their scale is
   !> no_verdict. In all other lanes the scale is the largest of the three terms, and not finite if one of them is not.
   subroutine subtract_sum(points, hp, scale)
      type(probe_points), intent(in) :: points
      real(wp), intent(inout) :: hp(nlane, points%ndof), scale(nlane)
      real(wp), allocatable :: sum_p(:, :), hq(:, :), found(:, :)
      real(wp) :: first(points%ndof)
      integer :: lane

      allocate (sum_p, found, hq, mold=points%zero)
      first = hp(1, :)
      do lane = 1, nlane
         sum_p(lane, :) = points%p(lane, :) + points%p(1, :)
      end do
      associate (n => points%ndof, m => points%nnoise)
         call points%model%gradient(nlane, n, m, points%t + later, points%w, points%q, sum_p, hq, found)
      end associate
      do lane = 1, nlane
         scale(lane) = max(scale(lane), scale(1), maxval(abs(found(lane, :)))) + 0*(scale(lane) + scale(1))
         hp(lane, :) = found(lane, :) - hp(lane, :) - first
      end do
      scale(1) = no_verdict
      scale(npoint + 1:) = no_verdict
   end subroutine subtract_sum

end module symsde_model_probe_mass
