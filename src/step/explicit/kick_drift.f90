! SPDX-License-Identifier: BSD-3-Clause
!> Kicks and drifts of symplectic Euler and Stormer-Verlet over n numbers: those of a path by itself, or of a block.
!>
!> Their coefficients are one and one half, which multiply without rounding: all ways to carry them out have the same
!> bits.
!>
!> Private to its family.
module symsde_step_explicit_kick_drift
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: kick, kick_and_drift, kick_and_drift_each, kick_again, move

contains

   !> VEC The share c of a kick.
   pure subroutine kick(n, c, force, p, dp, moved)
      integer, intent(in) :: n
      real(wp), intent(in) :: c, force(n), p(n)
      real(wp), intent(out) :: dp(n), moved(n)
      integer :: i

      do i = 1, n
         dp(i) = -c*force(i)
         moved(i) = p(i) - c*force(i)
      end do
   end subroutine kick

   !> VEC The same, and a drift by h times the momentum after it, in two halves.
   pure subroutine kick_and_drift(n, c, h, force, q, p, dp, dq, x)
      integer, intent(in) :: n
      real(wp), intent(in) :: c, h, force(n), q(n), p(n)
      real(wp), intent(out) :: dp(n), dq(n), x(n)
      integer :: i

      do i = 1, n
         call one(c, h, force(i), q(i), p(i), dp(i), dq(i), x(i))
      end do
   end subroutine kick_and_drift

   !> VEC The same of a path whose numbers have a drift of their own: h times `each`.
   pure subroutine kick_and_drift_each(n, c, h, each, force, q, p, dp, dq, x)
      integer, intent(in) :: n
      real(wp), intent(in) :: c, h, each(n), force(n), q(n), p(n)
      real(wp), intent(out) :: dp(n), dq(n), x(n)
      integer :: i

      do i = 1, n
         call one(c, h*each(i), force(i), q(i), p(i), dp(i), dq(i), x(i))
      end do
   end subroutine kick_and_drift_each

   pure subroutine one(c, h, force, q, p, dp, dq, x)
      real(wp), intent(in) :: c, h, force, q, p
      real(wp), intent(out) :: dp, dq, x

      dp = -c*force
      dq = h*(p - c*force)
      x = q + 0.5_wp*dq
      x = x + 0.5_wp*dq
   end subroutine one

   !> VEC The other half.
   pure subroutine kick_again(n, force, dp)
      integer, intent(in) :: n
      real(wp), intent(in) :: force(n)
      real(wp), intent(inout) :: dp(n)
      integer :: i

      do i = 1, n
         dp(i) = dp(i) - 0.5_wp*force(i)
      end do
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

end module symsde_step_explicit_kick_drift
