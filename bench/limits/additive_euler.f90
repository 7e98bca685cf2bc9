! SPDX-License-Identifier: BSD-3-Clause
!> Limit program: symplectic Euler (89)-(90) on the oscillator with two additive noises.
!>
!> Generator and arithmetic of the library, eight steps in one pass over the lanes.
module bench_limit_additive_euler
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_noise_normal, only: normal_stream, scaled_normal_steps
   implicit none
   private
   public :: limit_additive_euler

   integer(i4), parameter :: nlane = 256

contains

   !> nstep (a multiple of 8) steps of npath (a multiple of 256) paths from (1, 0); final states on return.
   subroutine limit_additive_euler(npath, nstep, seed, h, sigma, gamma, q, p)
      integer(i8), intent(in) :: npath, nstep, seed
      real(wp), intent(in) :: h, sigma, gamma
      real(wp), intent(out) :: q(npath), p(npath)
      real(wp) :: noise(nlane, 0:2, 8)
      integer(i8) :: path(nlane), first, step
      integer(i4) :: lane

      q = 1
      p = 0
      do first = 0, npath - 1, nlane
         path = [(first + lane, lane=0, nlane - 1)]
         do step = 0, nstep - 1, 8
            call scaled_normal_steps(nlane, normal_stream(seed, 1, scale=sigma*sqrt(h)), path, step/2, 4, 2, noise)
            call scaled_normal_steps(nlane, normal_stream(seed, 2, scale=gamma*sqrt(h)), path, step/2, 4, 2, noise)
            call eight_steps(h, noise, q(first + 1), p(first + 1))
         end do
      end do
   end subroutine limit_additive_euler

   pure subroutine eight_steps(h, noise, q, p)
      real(wp), intent(in) :: h, noise(nlane, 0:2, 8)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      real(wp) :: x, y
      integer(i4) :: lane, step

      do lane = 1, nlane
         x = q(lane)
         y = p(lane)
         !GCC$ unroll 8
         do step = 1, 8
            y = y - (h*x - noise(lane, 2, step))
            x = x + (h*y + noise(lane, 1, step))
         end do
         q(lane) = x
         p(lane) = y
      end do
   end subroutine eight_steps

end module bench_limit_additive_euler
