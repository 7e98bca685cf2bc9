! SPDX-License-Identifier: BSD-3-Clause
!> The end of Newton's iteration in a lane, and passes over lanes that correct and test.
!>
!> A lane is done when its next correction would vanish in rounding. With d_k the size of its k-th correction and |x|
!> the size of its unknowns,
!>
!>    linear       d_k <= eps |x|/4, or d_k r <= eps |x|/4 with the rate r = d_k/d_{k-1} (in two classes), or d_k is
!>                 not smaller than d_{k-1} and within 2^-33 |x|. This test assumes nothing of the matrix: with
!>                 differences, or a Hessian without third derivatives, the rate of convergence stays constant.
!>
!>    quadratic    d_k <= 2^-33 |x| at a rate r <= 1/8, or d_k <= 2^-20 |x| at a rate r <= 2^-20, or d_k <= eps |x|/4.
!>                 For steppers whose matrix is the derivative of their residual to rounding, so that
!>                 d_{k+1} = C d_k^2 (far away the rate is about 2/3). In the first case
!>                 d_{k+1} <= C |x| 2^-66 |x|, and C |x| is at most of order one if the iteration converges from x = 0.
!>                 In the second C = d_k/d_{k-1}^2 and d_{k+1} = r^2 d_k <= 2^-60 |x|. If d_k is that small by accident
!>                 although c = C d_{k-1} is not, an error of at most c 2^-40 |x| remains, in one of 2^20 c steps, with
!>                 random sign: sqrt(c/5) 2^-50 |x| in the mean square.
!>
!>    seen         as quadratic, but for a rate r <= 2^-13 in its first case: d_{k+1} = r^2 d_k <= 2^-59 |x| whatever C
!>                 is. For equations whose |x| does not bound C, such as two unknowns far from the origin.
!>
!> Looser bounds make invariants drift linearly.
module symsde_solve_stagnation
   use symsde_base_kinds, only: wp, i8
   implicit none
   private
   public :: stopping_test, linear, quadratic, seen, done_at_once, never_done, done, failed
   public :: correct_first, correct_exact, fail_nonfinite, correct_scalar, iterate_scalar
   public :: correct_lanes, test_lanes, restart_lanes

   real(wp), parameter :: done = -1      !! value of `last` for a lane that has converged
   real(wp), parameter :: failed = -2    !! value of `last` for a lane that has failed
   real(wp), parameter :: near = 2.0_wp**(-33)

   !> A lane is done if its correction is at most `level` |x|; or at most at_slow `level` |x| and at most `slow` times
   !> the correction before; or at most at_fast `level` |x| and at most `fast` times the correction before; or at most
   !> `stagnation` |x| and not smaller than the correction before.
   type :: stopping_test
      real(wp) :: level = 0.25_wp*epsilon(1.0_wp)
      real(wp) :: slow = 2.0_wp**(-13), at_slow = 2.0_wp**13
      real(wp) :: fast = 2.0_wp**(-26), at_fast = 2.0_wp**26
      real(wp) :: stagnation = near
   end type stopping_test

   type(stopping_test), parameter :: linear = stopping_test()
   type(stopping_test), parameter :: quadratic = stopping_test(slow=2.0_wp**(-3), at_slow=2.0_wp**21, &
                                                               fast=2.0_wp**(-20), at_fast=2.0_wp**34)
   type(stopping_test), parameter :: seen = stopping_test(at_slow=2.0_wp**21, fast=2.0_wp**(-20), at_fast=2.0_wp**34)
   !> Affine systems are done after one solve.
   type(stopping_test), parameter :: done_at_once = stopping_test(level=huge(1.0_wp), at_slow=1, at_fast=1, &
                                                                  stagnation=huge(1.0_wp))
   !> Fixed-point runs end after their number of iterations.
   type(stopping_test), parameter :: never_done = stopping_test(level=-1, at_slow=1, at_fast=1, stagnation=-1)

contains

   include 'all_lanes.inc'
   include 'stagnation.inc'
   include 'correction.inc'
   include 'stagnation_scalar.inc'

   !> VEC One unknown, one fixed-point iteration: x = -s f in running lanes.
   pure subroutine iterate_scalar(nlane, s, f, last, x, step, size)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: s, f(nlane), last(nlane)
      real(wp), intent(inout) :: x(nlane)
      real(wp), intent(out) :: step(nlane), size(nlane)
      integer :: lane

      do lane = 1, nlane
         step(lane) = abs(x(lane) + s*f(lane))
         x(lane) = merge(-s*f(lane), x(lane), last(lane) >= 0)
         size(lane) = abs(x(lane))
      end do
   end subroutine iterate_scalar

end module symsde_solve_stagnation
