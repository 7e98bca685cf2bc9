! SPDX-License-Identifier: BSD-3-Clause
!> Limit program: the midpoint rule on the Kubo oscillator, fused by hand.
!>
!> The library's generator and arithmetic without its machinery: no status, no checks, no observers.
!> Both steps of a pair run in one pass over the lanes, the state in registers between them.
module bench_limit_kubo
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_noise_normal, only: normal_pairs
   implicit none
   private
   public :: limit_kubo

   integer(i4), parameter :: nlane = 256

contains

   !> nstep (even) steps of npath (a multiple of 256) paths from (1, 0); final states on return.
   subroutine limit_kubo(npath, nstep, seed, h, a, sigma, q, p)
      integer(i8), intent(in) :: npath, nstep, seed
      real(wp), intent(in) :: h, a, sigma
      real(wp), intent(out) :: q(npath), p(npath)
      real(wp) :: even(nlane), odd(nlane), noise
      integer(i8) :: path(nlane), first, pair
      integer(i4) :: lane

      noise = sigma*sqrt(h)
      q = 1
      p = 0
      do first = 0, npath - 1, nlane
         path = [(first + lane, lane=0, nlane - 1)]
         do pair = 0, nstep/2 - 1
            call normal_pairs(nlane, seed, path, pair, 1, 0, 0, even, odd)
            call two_steps(a*h, noise, even, odd, q(first + 1), p(first + 1))
         end do
      end do
   end subroutine limit_kubo

   pure subroutine two_steps(drift, noise, even, odd, q, p)
      real(wp), intent(in) :: drift, noise, even(nlane), odd(nlane)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      real(wp) :: x, y
      integer(i4) :: lane

      do lane = 1, nlane
         x = q(lane)
         y = p(lane)
         call rotate(drift + noise*even(lane), x, y)
         call rotate(drift + noise*odd(lane), x, y)
         q(lane) = x
         p(lane) = y
      end do
   end subroutine two_steps

   !> The Cayley rotation by theta, [WHSB] (71)-(72) solved for the new state.
   pure subroutine rotate(theta, q, p)
      real(wp), intent(in) :: theta
      real(wp), intent(inout) :: q, p
      real(wp) :: half, factor, dq, dp

      half = 0.5_wp*theta
      factor = theta/(1 + half*half)
      dq = factor*(p - half*q)
      dp = -factor*(q + half*p)
      q = q + dq
      p = p + dp
   end subroutine rotate

end module bench_limit_kubo
