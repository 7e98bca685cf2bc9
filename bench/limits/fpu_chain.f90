! SPDX-License-Identifier: BSD-3-Clause
!> Limit program: the midpoint rule on the Fermi-Pasta-Ulam chain, tridiagonal Newton across lanes.
!>
!> Newton in V = dp, (I + h/4 Hhat_qq) d = V + Hhat_q: force, stiffness and the forward sweep of
!> the elimination run in one pass over the sites, back substitution and correction in another.
!> The lanes of a strip iterate together; a lane that has converged is frozen.
module bench_limit_fpu_chain
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_noise_normal, only: normal_stream, scaled_normal_steps
   implicit none
   private
   public :: limit_fpu_chain

   integer(i4), parameter :: nlane = 32

contains

   !> nstep (a multiple of 8) steps of npath (a multiple of 32) paths of n sites from (q0, 0).
   subroutine limit_fpu_chain(npath, nstep, n, seed, h, parameters, q0, q, p) bind(c)
      integer(i8), intent(in), value :: npath, nstep, seed
      integer(i4), intent(in), value :: n
      real(wp), intent(in), value :: h
      real(wp), intent(in) :: parameters(2), q0(n)  !! beta, sigma
      real(wp), intent(out) :: q(nlane, n, npath/nlane), p(nlane, n, npath/nlane)  !! block by block
      real(wp), allocatable :: dw(:, :, :)
      integer(i8) :: path(nlane), block, step
      integer(i4) :: lane, i

      allocate (dw(nlane, 0:n, 0:7))
      do block = 1, npath/nlane
         do lane = 1, nlane
            path(lane) = (block - 1)*nlane + lane - 1
         end do
         q(:, :, block) = spread(q0, 1, nlane)
         p(:, :, block) = 0
         do step = 0, nstep - 1
            if (mod(step, 8_i8) == 0) then
               do i = 1, n
                  call scaled_normal_steps(nlane, normal_stream(seed, i), path, step/2, 4, n, dw)
               end do
            end if
            call one_step(n, h, parameters(1), parameters(2)*sqrt(h), dw(:, 1:, mod(step, 8_i8)), &
                          q(:, :, block), p(:, :, block))
         end do
      end do
   end subroutine limit_fpu_chain

   subroutine one_step(n, h, beta, sigma, dw, q, p)
      integer(i4), intent(in) :: n
      real(wp), intent(in) :: h, beta, sigma, dw(nlane, n)
      real(wp), intent(inout) :: q(nlane, n), p(nlane, n)
      real(wp) :: x(nlane, n), v(nlane, n), upper(nlane, n), rhs(nlane, n)
      real(wp) :: last(nlane), step(nlane), size(nlane)
      integer(i8) :: nrunning
      integer(i4) :: lane, i

      do i = 1, n
         do lane = 1, nlane
            x(lane, i) = q(lane, i) + 0.5_wp*h*p(lane, i)
            v(lane, i) = 0
         end do
      end do
      last = 0
      nrunning = nlane
      do while (nrunning > 0)
         call forward(n, h, beta, sigma, dw, x, v, upper, rhs)
         call backward(n, h, upper, rhs, last, x, v, step, size)
         nrunning = 0
         do lane = 1, nlane
            last(lane) = next_size(step(lane), size(lane), last(lane))
            nrunning = nrunning + runs(last(lane))
         end do
      end do
      do i = 1, n
         do lane = 1, nlane
            q(lane, i) = q(lane, i) + h*(p(lane, i) + 0.5_wp*v(lane, i))
            p(lane, i) = p(lane, i) + v(lane, i)
         end do
      end do
   end subroutine one_step

   !> Rows of the residual and the matrix, and their elimination downwards. x is the midpoint of the positions.
   pure subroutine forward(n, h, beta, sigma, dw, x, v, upper, rhs)
      integer(i4), intent(in) :: n
      real(wp), intent(in) :: h, beta, sigma, dw(nlane, n), x(nlane, n), v(nlane, n)
      real(wp), intent(out) :: upper(nlane, n), rhs(nlane, n)
      real(wp) :: force(nlane), stiff(nlane), next(nlane), r, new_force, new_stiff, inverse, carried
      integer(i4) :: lane, i

      do lane = 1, nlane
         force(lane) = h*(x(lane, 1) + beta*x(lane, 1)**3)
         stiff(lane) = 0.25_wp*h*h*(1 + 3*beta*x(lane, 1)**2)
      end do
      do i = 1, n
         next = 0
         if (i < n) next = x(:, i + 1)
         do lane = 1, nlane
            r = next(lane) - x(lane, i)
            new_force = h*(r + beta*r**3)
            new_stiff = 0.25_wp*h*h*(1 + 3*beta*r**2)
            carried = merge(upper(lane, max(i - 1, 1)), 0.0_wp, i > 1)
            inverse = 1/(1 + stiff(lane)*(1 - carried) + new_stiff)
            upper(lane, i) = new_stiff*inverse
            carried = merge(rhs(lane, max(i - 1, 1)), 0.0_wp, i > 1)
            rhs(lane, i) = (v(lane, i) + (force(lane) - new_force) - sigma*dw(lane, i) &
                            + stiff(lane)*carried)*inverse
            force(lane) = new_force
            stiff(lane) = new_stiff
         end do
      end do
   end subroutine forward

   !> Back substitution, and correction of the running lanes; gives the sizes of corrections and unknowns.
   pure subroutine backward(n, h, upper, rhs, last, x, v, step, size)
      integer(i4), intent(in) :: n
      real(wp), intent(in) :: h, upper(nlane, n), rhs(nlane, n), last(nlane)
      real(wp), intent(inout) :: x(nlane, n), v(nlane, n)
      real(wp), intent(out) :: step(nlane), size(nlane)
      real(wp) :: d(nlane), new
      integer(i4) :: lane, i

      d = 0
      step = 0
      size = 0
      do i = n, 1, -1
         do lane = 1, nlane
            d(lane) = rhs(lane, i) + merge(upper(lane, i)*d(lane), 0.0_wp, i < n)
            new = merge(v(lane, i) - d(lane), v(lane, i), last(lane) >= 0)
            x(lane, i) = x(lane, i) + 0.25_wp*h*(new - v(lane, i))
            v(lane, i) = new
            step(lane) = max(step(lane), abs(d(lane)))
            size(lane) = max(size(lane), abs(new))
         end do
      end do
   end subroutine backward

   !> Size of the correction for a lane that continues, negative for a lane that is done: the library's quadratic
   !> convergence test, without its test for failures.
   pure function next_size(d, size, last) result(next)
      real(wp), intent(in) :: d, size, last
      real(wp) :: next

      next = merge(-1.0_wp, d, d <= size*merge(2.0_wp**(-20), 2.0_wp**(-33), d <= 2.0_wp**(-20)*last))
      next = merge(next, last, last >= 0)
   end function next_size

   !> 1 for a lane that continues, else 0, from the sign of its size.
   pure integer(i8) function runs(next)
      real(wp), intent(in) :: next

      runs = 1 - ishft(transfer(next, 0_i8), -63)
   end function runs

end module bench_limit_fpu_chain
