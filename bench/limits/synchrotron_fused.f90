! SPDX-License-Identifier: BSD-3-Clause
!> Limit program: the midpoint rule on the synchrotron, everything of an iteration in one pass.
!>
!> A copy of the library's sine and cosine (their fast path) stands in the pass, and strips of 32
!> lanes iterate by themselves, so that most strips stop before the slowest lane of a block. A lane
!> that has converged is frozen.
module bench_limit_synchrotron_fused
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_noise_normal, only: normal_stream, scaled_normal_steps
   implicit none
   private
   public :: limit_synchrotron_fused

   integer(i4), parameter :: nlane = 256, nstrip = 32

   real(wp), parameter :: two_over_pi = 0.6366197723675814_wp
   ! pi/2 in three parts of 37, 37 and 53 bits
   real(wp), parameter :: half_pi_1 = 1.5707963267923333_wp
   real(wp), parameter :: half_pi_2 = 2.5633441515839558e-12_wp
   real(wp), parameter :: half_pi_3 = 1.0562999066987428e-23_wp
   real(wp), parameter :: to_integer = 1.5_wp*2.0_wp**52  ! x + this - this rounds x to an integer
   ! minimax on |r| <= pi/4, z = r**2, to 2**-58 and 2**-64:
   ! sin(r) = r + r z (s1 + s2 z + ..), cos(r) = 1 - z/2 + z**2 (c1 + c2 z + ..)
   real(wp), parameter :: s1 = -0.16666666666666632_wp, s2 = 0.008333333333322418_wp, &
                          s3 = -0.00019841269829812402_wp, s4 = 2.755731369357982e-06_wp, &
                          s5 = -2.505075838538343e-08_wp, s6 = 1.5896811852068921e-10_wp
   real(wp), parameter :: c1 = 0.0416666666666666_wp, c2 = -0.0013888888888874131_wp, &
                          c3 = 2.4801587289487006e-05_wp, c4 = -2.755731435378607e-07_wp, &
                          c5 = 2.087572347857163e-09_wp, c6 = -1.1359658818861251e-11_wp

contains

   !> nstep (a multiple of 8) steps of npath (a multiple of 256) paths from (1, 0); final states on return.
   subroutine limit_synchrotron_fused(npath, nstep, seed, h, omega, sigma1, sigma2, q, p)
      integer(i8), intent(in) :: npath, nstep, seed
      real(wp), intent(in) :: h, omega, sigma1, sigma2
      real(wp), intent(out) :: q(npath), p(npath)
      real(wp) :: dw(nlane, 0:2, 0:7)
      integer(i8) :: path(nlane), first, step
      integer(i4) :: lane, j

      q = 1
      p = 0
      do first = 0, npath - 1, nlane
         path = [(first + lane, lane=0, nlane - 1)]
         do step = 0, nstep - 1
            j = int(mod(step, 8_i8))
            if (j == 0) then
               call scaled_normal_steps(nlane, normal_stream(seed, 1), path, step/2, 4, 2, dw)
               call scaled_normal_steps(nlane, normal_stream(seed, 2), path, step/2, 4, 2, dw)
            end if
            do lane = 1, nlane, nstrip
               call strip_step(h, omega**2, sigma1*sqrt(h), sigma2*sqrt(h), dw(lane, 1, j), &
                               dw(lane, 2, j), q(first + lane), p(first + lane))
            end do
         end do
      end do
   end subroutine limit_synchrotron_fused

   pure subroutine strip_step(h, omega2, sigma1, sigma2, dw1, dw2, q, p)
      real(wp), intent(in) :: h, omega2, sigma1, sigma2, dw1(nstrip), dw2(nstrip)
      real(wp), intent(inout) :: q(nstrip), p(nstrip)
      real(wp) :: x(nstrip), v(nstrip), last(nstrip), a(nstrip), b(nstrip), sine, cosine, d, next
      integer(i8) :: nrunning
      integer(i4) :: lane

      do lane = 1, nstrip
         a(lane) = omega2*h + sigma2*dw2(lane)
         b(lane) = sigma1*dw1(lane)
         x(lane) = q(lane) + 0.5_wp*h*p(lane)
         v(lane) = 0
         last(lane) = 0
      end do
      nrunning = nstrip
      do while (nrunning > 0)
         nrunning = 0
         do lane = 1, nstrip
            call sincos_near(x(lane) + 0.25_wp*h*v(lane), sine, cosine)
            d = (v(lane) + (a(lane)*sine + b(lane)*cosine))/ &
                (1 + 0.25_wp*h*(a(lane)*cosine - b(lane)*sine))
            next = merge(v(lane) - d, v(lane), last(lane) >= 0)
            v(lane) = next
            next = next_size(abs(d), abs(next), last(lane))
            last(lane) = next
            nrunning = nrunning + runs(next)
         end do
      end do
      do lane = 1, nstrip
         q(lane) = q(lane) + h*(p(lane) + 0.5_wp*v(lane))
         p(lane) = p(lane) + v(lane)
      end do
   end subroutine strip_step

   !> Size of the correction where the lane goes on, negative where it is done: the library's test
   !> of stagnation for exact matrices, without that of failures.
   pure function next_size(d, size, last) result(next)
      real(wp), intent(in) :: d, size, last
      real(wp) :: next, bound

      bound = size*merge(2.0_wp**(-20), 2.0_wp**(-33), d <= 2.0_wp**(-20)*last)
      next = merge(-1.0_wp, d, d <= bound)
      next = merge(next, last, last >= 0)
   end function next_size

   !> 1 for a lane that goes on, else 0, from the sign of its size.
   pure integer(i8) function runs(next)
      real(wp), intent(in) :: next

      runs = 1 - ishft(transfer(next, 0_i8), -63)
   end function runs

   !> The fast path of the library's sine and cosine.
   pure subroutine sincos_near(x, s, c)
      real(wp), intent(in) :: x
      real(wp), intent(out) :: s, c
      real(wp) :: shifted, turns, first, second, r, low, z, a, b, half
      integer(i8) :: q, a_bits, b_bits, swap

      shifted = x*two_over_pi + to_integer
      q = transfer(shifted, 0_i8)                 ! its last bits are those of the integer
      turns = shifted - to_integer
      first = x - turns*half_pi_1
      second = turns*half_pi_2
      r = first - second
      low = ((first - r) - second) - turns*half_pi_3
      z = r*r
      a = r + (r*(z*(s1 + z*(s2 + z*(s3 + z*(s4 + z*(s5 + z*s6)))))) + low)
      half = 0.5_wp*z
      b = 1 - half
      b = b + (((1 - b) - half) + &
               (z*z*(c1 + z*(c2 + z*(c3 + z*(c4 + z*(c5 + z*c6))))) - r*low))
      a_bits = transfer(a, 0_i8)
      b_bits = transfer(b, 0_i8)
      swap = iand(ieor(a_bits, b_bits), -iand(q, 1_i8))
      s = transfer(ieor(ieor(a_bits, swap), sign_bit(q)), 0.0_wp)
      c = transfer(ieor(ieor(b_bits, swap), sign_bit(ieor(q, ishft(q, 1)))), 0.0_wp)
   end subroutine sincos_near

   !> Bit 1 of q at the place of the sign.
   pure function sign_bit(q) result(bits)
      integer(i8), intent(in) :: q
      integer(i8) :: bits

      bits = ishft(iand(q, 2_i8), 62)
   end function sign_bit

end module bench_limit_synchrotron_fused
