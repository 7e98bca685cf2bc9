! SPDX-License-Identifier: BSD-3-Clause
!> Limit program: the midpoint rule on the synchrotron, Newton in V = dp to stagnation.
!>
!> Each iteration calls the library's sine and cosine, and does all other work in one pass over 256 lanes; a lane that
!> has converged is frozen.
module bench_limit_synchrotron
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_sincos, only: sincos_lanes
   use symsde_noise_normal, only: normal_stream, scaled_normal_steps
   implicit none
   private
   public :: limit_synchrotron

   integer(i4), parameter :: nlane = 256

contains

   !> nstep (a multiple of 8) steps of npath (a multiple of 256) paths from (q0, 0); final states on return.
   subroutine limit_synchrotron(npath, nstep, n, seed, h, parameters, q0, q, p) bind(c)
      integer(i8), intent(in), value :: npath, nstep, seed
      integer(i4), intent(in), value :: n
      real(wp), intent(in), value :: h
      real(wp), intent(in) :: parameters(3), q0(n)  !! omega, sigma1, sigma2
      real(wp), intent(out) :: q(npath), p(npath)
      real(wp) :: dw(nlane, 0:2, 0:7)
      integer(i8) :: path(nlane), first, step
      integer(i4) :: lane, j

      q = q0(1)
      p = 0
      do first = 0, npath - 1, nlane
         do lane = 1, nlane
            path(lane) = first + lane - 1
         end do
         do step = 0, nstep - 1
            j = int(mod(step, 8_i8))
            if (j == 0) then
               call scaled_normal_steps(nlane, normal_stream(seed, 1), path, step/2, 4, 2, dw)
               call scaled_normal_steps(nlane, normal_stream(seed, 2), path, step/2, 4, 2, dw)
            end if
            call one_step(h, parameters(1)**2, parameters(2)*sqrt(h), parameters(3)*sqrt(h), dw(:, 1, j), dw(:, 2, j), &
                          q(first + 1), p(first + 1))
         end do
      end do
   end subroutine limit_synchrotron

   subroutine one_step(h, omega2, sigma1, sigma2, dw1, dw2, q, p)
      real(wp), intent(in) :: h, omega2, sigma1, sigma2, dw1(nlane), dw2(nlane)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      real(wp) :: x(nlane), v(nlane), last(nlane), sine(nlane), cosine(nlane)
      integer(i8) :: nrunning
      integer(i4) :: lane

      do lane = 1, nlane
         x(lane) = q(lane) + 0.5_wp*h*p(lane)
      end do
      call sincos_lanes(nlane, x, sine, cosine)
      call first(h, omega2, sigma1, sigma2, dw1, dw2, sine, cosine, x, v, last, nrunning)
      do while (nrunning > 0)
         call sincos_lanes(nlane, x, sine, cosine)
         call iterate(h, omega2, sigma1, sigma2, dw1, dw2, q, p, sine, cosine, x, v, last, nrunning)
      end do
      do lane = 1, nlane
         q(lane) = q(lane) + h*(p(lane) + 0.5_wp*v(lane))
         p(lane) = p(lane) + v(lane)
      end do
   end subroutine one_step

   !> The first iteration, from v = 0.
   pure subroutine first(h, omega2, sigma1, sigma2, dw1, dw2, sine, cosine, x, v, last, nrunning)
      real(wp), intent(in) :: h, omega2, sigma1, sigma2, dw1(nlane), dw2(nlane)
      real(wp), intent(in) :: sine(nlane), cosine(nlane)
      real(wp), intent(inout) :: x(nlane)
      real(wp), intent(out) :: v(nlane), last(nlane)
      integer(i8), intent(out) :: nrunning
      real(wp) :: a, b, next
      integer(i4) :: lane

      nrunning = 0
      do lane = 1, nlane
         a = omega2*h + sigma2*dw2(lane)
         b = sigma1*dw1(lane)
         next = -(a*sine(lane) + b*cosine(lane))/(1 + 0.25_wp*h*(a*cosine(lane) - b*sine(lane)))
         v(lane) = next
         x(lane) = x(lane) + 0.25_wp*h*next
         next = merge(-1.0_wp, abs(next), abs(next) <= 0)
         last(lane) = next
         nrunning = nrunning + runs(next)
      end do
   end subroutine first

   pure subroutine iterate(h, omega2, sigma1, sigma2, dw1, dw2, q, p, &
                           sine, cosine, x, v, last, nrunning)
      real(wp), intent(in) :: h, omega2, sigma1, sigma2, dw1(nlane), dw2(nlane), q(nlane), p(nlane)
      real(wp), intent(in) :: sine(nlane), cosine(nlane)
      real(wp), intent(inout) :: x(nlane), v(nlane), last(nlane)
      integer(i8), intent(out) :: nrunning
      real(wp) :: a, b, d, next
      integer(i4) :: lane

      nrunning = 0
      do lane = 1, nlane
         a = omega2*h + sigma2*dw2(lane)
         b = sigma1*dw1(lane)
         d = (v(lane) + (a*sine(lane) + b*cosine(lane)))/ &
             (1 + 0.25_wp*h*(a*cosine(lane) - b*sine(lane)))
         next = merge(v(lane) - d, v(lane), last(lane) >= 0)
         v(lane) = next
         x(lane) = q(lane) + 0.5_wp*h*p(lane) + 0.25_wp*h*next
         next = next_size(abs(d), abs(next), last(lane))
         last(lane) = next
         nrunning = nrunning + runs(next)
      end do
   end subroutine iterate

   !> Size of the correction for a lane that continues, negative for a lane that is done: the library's test of
   !> stagnation for exact matrices, without its test for failures.
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

end module bench_limit_synchrotron
