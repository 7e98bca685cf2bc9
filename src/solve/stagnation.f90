! SPDX-License-Identifier: BSD-3-Clause
!> When Newton's iteration has stagnated in a lane, and the passes over lanes that correct and test.
!>
!> A lane is done when its next correction would vanish in rounding. With d_k the size of its k-th correction
!> and |x| that of its unknowns,
!>
!>    linear       d_k <= eps |x|/4, or d_k r <= eps |x|/4 with the rate r = d_k/d_{k-1} seen (two classes of it),
!>                 or d_k is not smaller than the one before (the first has none) and within 2^-33 |x|. It assumes
!>                 nothing of the matrix: differences, or a Hessian without third derivatives, converge at a rate
!>                 that stays.
!>    quadratic    d_k <= 2^-33 |x| at a rate r <= 1/8, or d_k <= 2^-20 |x| at a rate r <= 2^-20, or d_k <= eps |x|/4.
!>                 For steppers whose matrix is the derivative of their residual to rounding, so that
!>                 d_{k+1} = C d_k^2 (from far away the rate is 2/3 and such, and says so). In the first case
!>                 d_{k+1} <= C |x| 2^-66 |x|, and C |x| is of the order of one at most where the iteration
!>                 converges from x = 0. In the second C = d_k/d_{k-1}^2 and d_{k+1} = r^2 d_k <= 2^-60 |x|.
!>                 Should d_k be that small by accident although c = C d_{k-1} is not, c 2^-40 |x| remains at
!>                 most, in one step of 2^20 c, without a preferred sign: sqrt(c/5) 2^-50 |x| in the mean square.
!>
!>    seen         as quadratic, but for a rate r <= 2^-13 in its first case: d_{k+1} = r^2 d_k <= 2^-59 |x| whatever C
!>                 is. For equations whose |x| says little of C, such as two unknowns far from the origin.
!>
!> Bounds looser than these make invariants drift linearly.
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

   !> A correction not larger than `level` times the unknowns ends a lane, and so does one larger by at_slow
   !> (at_fast) that is the part `slow` (`fast`) of the one before or less, and one within `stagnation` that
   !> is not smaller than the one before.
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
   !> Affine systems, after one solve.
   type(stopping_test), parameter :: done_at_once = stopping_test(level=huge(1.0_wp), at_slow=1, at_fast=1, &
                                                                  stagnation=huge(1.0_wp))
   !> Fixed-point runs, which end after their number of iterations.
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
