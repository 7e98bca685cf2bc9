! SPDX-License-Identifier: BSD-3-Clause
!> The linear system A x = b of a single path: the elimination A = L U of elimination.inc with one lane,
!>
!>    l_ik = u_ik/u_kk,   u_ij <- u_ij - l_ik u_kj   (i, j > k),   x = U^{-1} L^{-1} b
!>
!> In a block the innermost loop is over lanes. Here it goes down a column, over the remaining rows, and vectors pay
!> from `few` rows on. There are no strips, and the factors replace the matrix.
module symsde_solve_elimination_single_path
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: solve_scalar

   integer, parameter :: few = 8  !! numbers from which vectors pay

contains

   include 'one_lane.inc'
   include 'elimination.inc'

   !> Solve one system, with the bits of the same system in a lane of many. The caller checks `smallest`, the pivot
   !> monitor of solve/elimination, and the solution.
   pure subroutine solve_scalar(n, a, x, smallest)
      integer, intent(in) :: n            !! unknowns, from 3 on: fewer have a closed form
      real(wp), intent(inout) :: a(n, n)  !! in: the matrix; out: factors
      real(wp), intent(inout) :: x(n)     !! in: right-hand side; out: solution
      real(wp), intent(out) :: smallest   !! pivot monitor

      ! With three and four unknowns as constants, the compiler unrolls the loops.
      if (n == 3) then
         call solve_known(3, a, x, smallest)
      else if (n == 4) then
         call solve_known(4, a, x, smallest)
      else
         call solve_known(n, a, x, smallest)
      end if
   end subroutine solve_scalar

   !> solve_scalar with n by value, so that a constant argument stays constant after inlining.
   pure subroutine solve_known(n, a, x, smallest)
      integer, value :: n
      real(wp), intent(inout) :: a(n, n), x(n)
      real(wp), intent(out) :: smallest
      real(wp) :: monitor(1)

      call factor_lanes(1, n, a, monitor)
      call back_substitute_lanes(1, n, a, x)
      smallest = monitor(1)
   end subroutine solve_known

   !> target = target - factor column, m numbers below the pivot. Few numbers are faster without vectors, and the bits
   !> are the same.
   pure subroutine subtract_multiple(nlane, m, factor, column, target)
      integer, intent(in) :: nlane, m
      real(wp), intent(in) :: factor(lanes(nlane)), column(m)
      real(wp), intent(inout) :: target(m)
      integer :: i

      if (m < few) then
         !GCC$ novector
         do i = 1, m
            target(i) = target(i) - column(i)*factor(1)
         end do
      else
         do i = 1, m
            target(i) = target(i) - column(i)*factor(1)
         end do
      end if
   end subroutine subtract_multiple

end module symsde_solve_elimination_single_path
