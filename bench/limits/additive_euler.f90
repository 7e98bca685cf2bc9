! SPDX-License-Identifier: BSD-3-Clause
!> Limit program: symplectic Euler (89)-(90) on the oscillator with two additive noises.
!>
!> Generator and arithmetic of the library, both steps of a pair in one pass over the lanes.
module bench_limit_additive_euler
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_noise_normal, only: normal_pairs
   implicit none
   private
   public :: limit_additive_euler

   integer(i4), parameter :: nlane = 256

contains

   !> nstep (even) steps of npath (a multiple of 256) paths from (1, 0); final states on return.
   subroutine limit_additive_euler(npath, nstep, seed, h, sigma, gamma, q, p)
      integer(i8), intent(in) :: npath, nstep, seed
      real(wp), intent(in) :: h, sigma, gamma
      real(wp), intent(out) :: q(npath), p(npath)
      real(wp) :: even(nlane, 2), odd(nlane, 2)
      integer(i8) :: path(nlane), first, pair
      integer(i4) :: lane

      q = 1
      p = 0
      do first = 0, npath - 1, nlane
         path = [(first + lane, lane=0, nlane - 1)]
         do pair = 0, nstep/2 - 1
            call normal_pairs(nlane, seed, path, pair, 1, 0, 0, even(:, 1), odd(:, 1))
            call normal_pairs(nlane, seed, path, pair, 2, 0, 0, even(:, 2), odd(:, 2))
            call two_steps(h, sigma*sqrt(h), gamma*sqrt(h), even, odd, q(first + 1), p(first + 1))
         end do
      end do
   end subroutine limit_additive_euler

   pure subroutine two_steps(h, sigma, gamma, even, odd, q, p)
      real(wp), intent(in) :: h, sigma, gamma, even(nlane, 2), odd(nlane, 2)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      real(wp) :: x, y
      integer(i4) :: lane

      do lane = 1, nlane
         x = q(lane)
         y = p(lane)
         y = y - (h*x - gamma*even(lane, 2))
         x = x + (h*y + sigma*even(lane, 1))
         y = y - (h*x - gamma*odd(lane, 2))
         x = x + (h*y + sigma*odd(lane, 1))
         q(lane) = x
         p(lane) = y
      end do
   end subroutine two_steps

end module bench_limit_additive_euler
