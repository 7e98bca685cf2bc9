! SPDX-License-Identifier: BSD-3-Clause
!> Kicks and drifts of symplectic Euler and Stormer-Verlet over n numbers: those of a path by itself, or of a block.
!>
!> Their coefficients are one and one half, which multiply without rounding: all ways to carry them out have the same
!> bits.
module symsde_step_kicks
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: kick_and_drift, kick_again, move

   integer, parameter :: few = 4  !! numbers that are too few for vectors

contains

   !> VEC The share c of a kick, and a drift by h times the momentum after it, in two halves. What is few is not worth
   !> vectors.
   pure subroutine kick_and_drift(n, c, h, force, q, p, dp, dq, x)
      integer, intent(in) :: n
      real(wp), intent(in) :: c, h, force(n), q(n), p(n)
      real(wp), intent(out) :: dp(n), dq(n), x(n)
      integer :: i

      if (n <= few) then
         !GCC$ novector
         do i = 1, n
            call one(dp(i), dq(i), x(i), force(i), q(i), p(i))
         end do
      else
         do i = 1, n
            call one(dp(i), dq(i), x(i), force(i), q(i), p(i))
         end do
      end if

   contains

      pure subroutine one(kick, drift, place, f, at, momentum)
         real(wp), intent(out) :: kick, drift, place
         real(wp), intent(in) :: f, at, momentum

         kick = -c*f
         drift = h*(momentum - c*f)
         place = at + 0.5_wp*drift
         place = place + 0.5_wp*drift
      end subroutine one

   end subroutine kick_and_drift

   !> VEC The other half.
   pure subroutine kick_again(n, force, dp)
      integer, intent(in) :: n
      real(wp), intent(in) :: force(n)
      real(wp), intent(inout) :: dp(n)
      integer :: i

      if (n <= few) then
         !GCC$ novector
         do i = 1, n
            dp(i) = dp(i) - 0.5_wp*force(i)
         end do
      else
         do i = 1, n
            dp(i) = dp(i) - 0.5_wp*force(i)
         end do
      end if
   end subroutine kick_again

   !> VEC The drift of two halves.
   pure subroutine move(n, q, first, second, x, dq)
      integer, intent(in) :: n
      real(wp), intent(in) :: q(n), first(n), second(n)
      real(wp), intent(out) :: x(n), dq(n)
      integer :: i

      do i = 1, n
         x(i) = q(i) + 0.5_wp*first(i)
         x(i) = x(i) + 0.5_wp*second(i)
         dq(i) = 0.5_wp*first(i) + 0.5_wp*second(i)
      end do
   end subroutine move

end module symsde_step_kicks
