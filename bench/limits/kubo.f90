! SPDX-License-Identifier: BSD-3-Clause
!> Limit program: the midpoint rule on the Kubo oscillator, fused by hand.
!>
!> The library's generator and arithmetic without its machinery: no status, no checks, no observers.
!> Eight steps run in one pass over the lanes, the state in registers between them.
module bench_limit_kubo
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_noise_normal, only: normal_stream, scaled_normal_steps
   implicit none
   private
   public :: limit_kubo

   integer(i4), parameter :: nlane = 256

contains

   !> nstep (a multiple of 8) steps of npath (a multiple of 256) paths from (q0, 0); final states on return.
   subroutine limit_kubo(npath, nstep, n, seed, h, parameters, q0, q, p) bind(c)
      integer(i8), intent(in), value :: npath, nstep, seed
      integer(i4), intent(in), value :: n
      real(wp), intent(in), value :: h
      real(wp), intent(in) :: parameters(2), q0(n)  !! a, sigma
      real(wp), intent(out) :: q(npath), p(npath)
      real(wp) :: noise(nlane, 0:1, 8)
      integer(i8) :: path(nlane), first, step
      integer(i4) :: lane

      q = q0(1)
      p = 0
      do first = 0, npath - 1, nlane
         do lane = 1, nlane
            path(lane) = first + lane - 1
         end do
         do step = 0, nstep - 1, 8
            call scaled_normal_steps(nlane, normal_stream(seed, 1, scale=parameters(2)*sqrt(h)), path, step/2, 4, 1, &
                                     noise)
            call eight_steps(parameters(1)*h, noise, q(first + 1), p(first + 1))
         end do
      end do
   end subroutine limit_kubo

   pure subroutine eight_steps(drift, noise, q, p)
      real(wp), intent(in) :: drift, noise(nlane, 0:1, 8)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      real(wp) :: x, y
      integer(i4) :: lane, step

      do lane = 1, nlane
         x = q(lane)
         y = p(lane)
         !GCC$ unroll 8
         do step = 1, 8
            call rotate(drift + noise(lane, 1, step), x, y)
         end do
         q(lane) = x
         p(lane) = y
      end do
   end subroutine eight_steps

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
