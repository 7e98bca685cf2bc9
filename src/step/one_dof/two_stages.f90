! SPDX-License-Identifier: BSD-3-Clause
!> The passes of two implicit stages with one degree of freedom: points, Newton's corrections of the slopes F_1, F_2,
!> G_1, G_2 of step/one_dof/newton, and increments.
!>
!> Newton's matrix of four rows is inverted by its minors of two, which needs no pivots; for separable
!> Hamiltonians the F are eliminated first, and two rows remain.
!>
!> Private to its family.
module symsde_step_one_dof_two_stages
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: stage_point, find_points, add_stages, correct_separable, correct_alone, solve_lanes

contains

   !> VEC (Q_i, P_i) from the slopes.
   pure subroutine stage_point(nlane, i, a, abar, q, p, x, qs, ps)
      integer, intent(in) :: nlane, i
      real(wp), intent(in) :: a(2, 2), abar(2, 2), q(nlane), p(nlane), x(nlane, 4)
      real(wp), intent(out) :: qs(nlane), ps(nlane)
      integer :: lane

      do lane = 1, nlane
         qs(lane) = q(lane) + (a(i, 1)*x(lane, 1) + a(i, 2)*x(lane, 2))
         ps(lane) = p(lane) + (abar(i, 1)*x(lane, 3) + abar(i, 2)*x(lane, 4))
      end do
   end subroutine stage_point

   !> VEC Increments, as add_slopes of step/stages/slope_sums makes them.
   pure subroutine add_stages(nlane, alpha, x, dq, dp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: alpha(2), x(nlane, 4)
      real(wp), intent(out) :: dq(nlane), dp(nlane)
      integer :: lane

      do lane = 1, nlane
         dq(lane) = 0 + alpha(1)*x(lane, 1) + alpha(2)*x(lane, 2)
         dp(lane) = 0 + alpha(1)*x(lane, 3) + alpha(2)*x(lane, 4)
      end do
   end subroutine add_stages

   !> VEC Newton's correction of the slopes where Hhat_qp = 0: x = x - d in running lanes, with the size of correction
   !> and unknowns in each, as by correct_lanes of solve/stagnation. The correction is not stored.
   pure subroutine correct_separable(nlane, a, abar, hq1, hq2, hp1, hp2, hqq1, hqq2, hpp1, hpp2, last, x, step, size)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: a(2, 2), abar(2, 2)
      real(wp), intent(in), dimension(nlane) :: hq1, hq2, hp1, hp2, hqq1, hqq2, hpp1, hpp2, last
      real(wp), intent(inout) :: x(nlane, 4)
      real(wp), intent(out) :: step(nlane), size(nlane)
      real(wp) :: d1, d2, d3, d4, x1, x2, x3, x4
      integer :: lane

      do lane = 1, nlane
         x1 = x(lane, 1)
         x2 = x(lane, 2)
         x3 = x(lane, 3)
         x4 = x(lane, 4)
         call eliminate_velocities(a, abar, hq1(lane), hq2(lane), hp1(lane), hp2(lane), hqq1(lane), hqq2(lane), &
                                   hpp1(lane), hpp2(lane), x1, x2, x3, x4, d1, d2, d3, d4)
         x1 = merge(x1 - d1, x1, last(lane) >= 0)
         x2 = merge(x2 - d2, x2, last(lane) >= 0)
         x3 = merge(x3 - d3, x3, last(lane) >= 0)
         x4 = merge(x4 - d4, x4, last(lane) >= 0)
         ! 0*d keeps a NaN, which max would drop
         step(lane) = max(max(abs(d1), abs(d2)), max(abs(d3), abs(d4))) + (0*d1 + 0*d2 + 0*d3 + 0*d4)
         size(lane) = max(max(abs(x1), abs(x2)), max(abs(x3), abs(x4)))
         x(lane, 1) = x1
         x(lane, 2) = x2
         x(lane, 3) = x3
         x(lane, 4) = x4
      end do
   end subroutine correct_separable

   !> The same of a path by itself, and the points of the stages to go on from: numbers that come in registers.
   subroutine correct_alone(a, abar, hq1, hq2, hp1, hp2, hqq1, hqq2, hpp1, hpp2, q, p, x, qs, ps, step, size, sound)
      real(wp), intent(in) :: a(2, 2), abar(2, 2), q, p
      real(wp), value :: hq1, hq2, hp1, hp2, hqq1, hqq2, hpp1, hpp2
      real(wp), intent(inout) :: x(4)
      real(wp), intent(out) :: qs(2), ps(2), step, size
      logical, intent(out) :: sound
      real(wp) :: d1, d2, d3, d4

      call eliminate_velocities(a, abar, hq1, hq2, hp1, hp2, hqq1, hqq2, hpp1, hpp2, x(1), x(2), x(3), x(4), &
                                d1, d2, d3, d4)
      x(1) = x(1) - d1
      x(2) = x(2) - d2
      x(3) = x(3) - d3
      x(4) = x(4) - d4
      call find_points(a, abar, q, p, x, qs, ps)
      step = max(max(abs(d1), abs(d2)), max(abs(d3), abs(d4)))
      size = max(max(abs(x(1)), abs(x(2))), max(abs(x(3)), abs(x(4))))
      sound = abs((x(1) + x(2)) + (x(3) + x(4))) <= huge(step)
   end subroutine correct_alone

   !> (Q_i, P_i) of both stages of a path by itself.
   pure subroutine find_points(a, abar, q, p, x, qs, ps)
      real(wp), intent(in) :: a(2, 2), abar(2, 2), q, p, x(4)
      real(wp), intent(out) :: qs(2), ps(2)
      integer :: i

      !GCC$ novector
      do i = 1, 2
         qs(i) = q + (a(i, 1)*x(1) + a(i, 2)*x(2))
         ps(i) = p + (abar(i, 1)*x(3) + abar(i, 2)*x(4))
      end do
   end subroutine find_points

   !> The correction of one lane where Hhat_qp = 0:
   !>    (I + diag(Hqq) a diag(Hpp) abar) dG = r_G - diag(Hqq) a r_F,   dF = r_F + diag(Hpp) abar dG
   pure subroutine eliminate_velocities(a, abar, hq1, hq2, hp1, hp2, hqq1, hqq2, hpp1, hpp2, x1, x2, x3, x4, &
                                        d1, d2, d3, d4)
      real(wp), intent(in) :: a(2, 2), abar(2, 2), hq1, hq2, hp1, hp2, hqq1, hqq2, hpp1, hpp2, x1, x2, x3, x4
      real(wp), intent(out) :: d1, d2, d3, d4
      real(wp) :: e11, e12, e21, e22, m11, m12, m21, m22, r1, r2, s1, s2, inverse

      e11 = a(1, 1)*hpp1
      e12 = a(1, 2)*hpp2
      e21 = a(2, 1)*hpp1
      e22 = a(2, 2)*hpp2
      m11 = 1 + hqq1*(e11*abar(1, 1) + e12*abar(2, 1))
      m12 = hqq1*(e11*abar(1, 2) + e12*abar(2, 2))
      m21 = hqq2*(e21*abar(1, 1) + e22*abar(2, 1))
      m22 = 1 + hqq2*(e21*abar(1, 2) + e22*abar(2, 2))
      r1 = x1 - hp1
      r2 = x2 - hp2
      s1 = x3 + hq1 - hqq1*(a(1, 1)*r1 + a(1, 2)*r2)
      s2 = x4 + hq2 - hqq2*(a(2, 1)*r1 + a(2, 2)*r2)
      inverse = 1/(m11*m22 - m12*m21)
      d3 = (m22*s1 - m12*s2)*inverse
      d4 = (m11*s2 - m21*s1)*inverse
      d1 = r1 + hpp1*(abar(1, 1)*d3 + abar(1, 2)*d4)
      d2 = r2 + hpp2*(abar(2, 1)*d3 + abar(2, 2)*d4)
   end subroutine eliminate_velocities

   !> VEC Newton's correction d of the slopes.
   pure subroutine solve_lanes(nlane, a, abar, hq1, hq2, hp1, hp2, hqq1, hqq2, hqp1, hqp2, hpp1, hpp2, x, d)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: a(2, 2), abar(2, 2)
      real(wp), intent(in), dimension(nlane) :: hq1, hq2, hp1, hp2, hqq1, hqq2, hqp1, hqp2, hpp1, hpp2
      real(wp), intent(in) :: x(nlane, 4)
      real(wp), intent(out) :: d(nlane, 4)
      real(wp) :: m11, m12, m13, m14, m21, m22, m23, m24, m31, m32, m33, m34, m41, m42, m43, m44
      real(wp) :: s12, s13, s14, s23, s24, s34, c12, c13, c14, c23, c24, c34, inverse
      real(wp) :: r1, r2, r3, r4
      integer :: lane

      do lane = 1, nlane
         m11 = 1 - a(1, 1)*hqp1(lane)
         m12 = -a(1, 2)*hqp1(lane)
         m13 = -abar(1, 1)*hpp1(lane)
         m14 = -abar(1, 2)*hpp1(lane)
         m21 = -a(2, 1)*hqp2(lane)
         m22 = 1 - a(2, 2)*hqp2(lane)
         m23 = -abar(2, 1)*hpp2(lane)
         m24 = -abar(2, 2)*hpp2(lane)
         m31 = a(1, 1)*hqq1(lane)
         m32 = a(1, 2)*hqq1(lane)
         m33 = 1 + abar(1, 1)*hqp1(lane)
         m34 = abar(1, 2)*hqp1(lane)
         m41 = a(2, 1)*hqq2(lane)
         m42 = a(2, 2)*hqq2(lane)
         m43 = abar(2, 1)*hqp2(lane)
         m44 = 1 + abar(2, 2)*hqp2(lane)
         r1 = x(lane, 1) - hp1(lane)
         r2 = x(lane, 2) - hp2(lane)
         r3 = x(lane, 3) + hq1(lane)
         r4 = x(lane, 4) + hq2(lane)
         ! minors of the first two rows and of the last two
         s12 = m11*m22 - m21*m12
         s13 = m11*m23 - m21*m13
         s14 = m11*m24 - m21*m14
         s23 = m12*m23 - m22*m13
         s24 = m12*m24 - m22*m14
         s34 = m13*m24 - m23*m14
         c12 = m31*m42 - m41*m32
         c13 = m31*m43 - m41*m33
         c14 = m31*m44 - m41*m34
         c23 = m32*m43 - m42*m33
         c24 = m32*m44 - m42*m34
         c34 = m33*m44 - m43*m34
         inverse = 1/(s12*c34 - s13*c24 + s14*c23 + s23*c14 - s24*c13 + s34*c12)
         d(lane, 1) = ((m22*c34 - m23*c24 + m24*c23)*r1 - (m12*c34 - m13*c24 + m14*c23)*r2 &
                       + (m42*s34 - m43*s24 + m44*s23)*r3 - (m32*s34 - m33*s24 + m34*s23)*r4)*inverse
         d(lane, 2) = (-(m21*c34 - m23*c14 + m24*c13)*r1 + (m11*c34 - m13*c14 + m14*c13)*r2 &
                       - (m41*s34 - m43*s14 + m44*s13)*r3 + (m31*s34 - m33*s14 + m34*s13)*r4)*inverse
         d(lane, 3) = ((m21*c24 - m22*c14 + m24*c12)*r1 - (m11*c24 - m12*c14 + m14*c12)*r2 &
                       + (m41*s24 - m42*s14 + m44*s12)*r3 - (m31*s24 - m32*s14 + m34*s12)*r4)*inverse
         d(lane, 4) = (-(m21*c23 - m22*c13 + m23*c12)*r1 + (m11*c23 - m12*c13 + m13*c12)*r2 &
                       - (m41*s23 - m42*s13 + m43*s12)*r3 + (m31*s23 - m32*s13 + m33*s12)*r4)*inverse
      end do
   end subroutine solve_lanes

end module symsde_step_one_dof_two_stages
