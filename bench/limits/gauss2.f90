! SPDX-License-Identifier: BSD-3-Clause
!> Limit program: the Gauss scheme of two stages on the synchrotron, four unknowns a lane.
!>
!> Unknowns are the slopes (F_1, G_1, F_2, G_2). Their equations F_i = h P_i, G_i = -Hhat_q(Q_i),
!> Q_i = q + sum a_ij F_j, P_i = p + sum a_ij G_j are eliminated in registers: F is linear in G, so
!> the four by four matrix [I, -h A; D A, I] reduces to I + h D A^2 of two. Sine and cosine by the
!> library, all the rest of an iteration in one pass over 256 lanes.
module bench_limit_gauss2
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_sincos, only: sincos_lanes
   use symsde_noise_normal, only: normal_stream, scaled_normal_steps
   implicit none
   private
   public :: limit_gauss2

   integer(i4), parameter :: nlane = 256
   real(wp), parameter :: root3 = sqrt(3.0_wp)
   real(wp), parameter :: a11 = 0.25_wp, a12 = 0.25_wp - root3/6, a21 = 0.25_wp + root3/6
   ! the square of A
   real(wp), parameter :: b11 = a11*a11 + a12*a21, b12 = 2*a11*a12, b21 = 2*a11*a21

contains

   !> nstep (a multiple of 8) steps of npath (a multiple of 256) paths from (1, 0); final states on return.
   subroutine limit_gauss2(npath, nstep, seed, h, omega, sigma1, sigma2, q, p)
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
            call one_step(h, omega**2, sigma1*sqrt(h), sigma2*sqrt(h), dw(:, 1, j), dw(:, 2, j), &
                          q(first + 1), p(first + 1))
         end do
      end do
   end subroutine limit_gauss2

   subroutine one_step(h, omega2, sigma1, sigma2, dw1, dw2, q, p)
      real(wp), intent(in) :: h, omega2, sigma1, sigma2, dw1(nlane), dw2(nlane)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      real(wp) :: x(nlane, 2), g(nlane, 2), last(nlane), sine(nlane, 2), cosine(nlane, 2)
      integer(i8) :: nrunning
      integer(i4) :: lane

      do lane = 1, nlane
         x(lane, 1) = q(lane) + (a11 + a12)*h*p(lane)
         x(lane, 2) = q(lane) + (a21 + a11)*h*p(lane)
         g(lane, 1) = 0
         g(lane, 2) = 0
         last(lane) = huge(1.0_wp)
      end do
      nrunning = nlane
      do while (nrunning > 0)
         call sincos_lanes(2*nlane, x, sine, cosine)
         call iterate(h, omega2, sigma1, sigma2, dw1, dw2, q, p, sine, cosine, x, g, last, nrunning)
      end do
      do lane = 1, nlane
         q(lane) = q(lane) + h*(p(lane) + 0.5_wp*((a11 + a21)*g(lane, 1) + (a12 + a11)*g(lane, 2)))
         p(lane) = p(lane) + 0.5_wp*(g(lane, 1) + g(lane, 2))
      end do
   end subroutine one_step

   pure subroutine iterate(h, omega2, sigma1, sigma2, dw1, dw2, q, p, &
                           sine, cosine, x, g, last, nrunning)
      real(wp), intent(in) :: h, omega2, sigma1, sigma2, dw1(nlane), dw2(nlane), q(nlane), p(nlane)
      real(wp), intent(in) :: sine(nlane, 2), cosine(nlane, 2)
      real(wp), intent(inout) :: x(nlane, 2), g(nlane, 2), last(nlane)
      integer(i8), intent(out) :: nrunning
      real(wp) :: a, b, k1, k2, r1, r2, m11, m12, m21, m22, inverse, d1, d2, next
      integer(i4) :: lane

      nrunning = 0
      do lane = 1, nlane
         a = omega2*h + sigma2*dw2(lane)
         b = sigma1*dw1(lane)
         r1 = g(lane, 1) + (a*sine(lane, 1) + b*cosine(lane, 1))
         r2 = g(lane, 2) + (a*sine(lane, 2) + b*cosine(lane, 2))
         k1 = h*(a*cosine(lane, 1) - b*sine(lane, 1))
         k2 = h*(a*cosine(lane, 2) - b*sine(lane, 2))
         m11 = 1 + k1*b11
         m12 = k1*b12
         m21 = k2*b21
         m22 = 1 + k2*b11
         inverse = 1/(m11*m22 - m12*m21)
         d1 = (m22*r1 - m12*r2)*inverse
         d2 = (m11*r2 - m21*r1)*inverse
         g(lane, 1) = merge(g(lane, 1) - d1, g(lane, 1), last(lane) >= 0)
         g(lane, 2) = merge(g(lane, 2) - d2, g(lane, 2), last(lane) >= 0)
         x(lane, 1) = q(lane) + h*((a11 + a12)*p(lane) + (b11*g(lane, 1) + b12*g(lane, 2)))
         x(lane, 2) = q(lane) + h*((a21 + a11)*p(lane) + (b21*g(lane, 1) + b11*g(lane, 2)))
         next = next_size(max(abs(d1), abs(d2)), max(abs(g(lane, 1)), abs(g(lane, 2))), last(lane))
         last(lane) = next
         nrunning = nrunning + runs(next)
      end do
   end subroutine iterate

   !> Size of the correction where the lane goes on, negative where it is done: the library's test
   !> of stagnation, without that of failures.
   pure function next_size(d, size, last) result(next)
      real(wp), intent(in) :: d, size, last
      real(wp), parameter :: rounding = 0.25_wp*epsilon(1.0_wp)
      real(wp) :: next, bound

      bound = merge(2.0_wp**13, 1.0_wp, d <= 2.0_wp**(-13)*last)
      bound = rounding*size*merge(2.0_wp**26, bound, d <= 2.0_wp**(-26)*last)
      bound = merge(1e-10_wp*size, bound, d >= last)
      next = merge(-1.0_wp, d, d <= bound)
      next = merge(next, last, last >= 0)
   end function next_size

   !> 1 for a lane that goes on, else 0, from the sign of its size.
   pure integer(i8) function runs(next)
      real(wp), intent(in) :: next

      runs = 1 - ishft(transfer(next, 0_i8), -63)
   end function runs

end module bench_limit_gauss2
