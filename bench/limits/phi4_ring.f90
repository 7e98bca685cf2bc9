! SPDX-License-Identifier: BSD-3-Clause
!> Limit program: Verlet and kicks at Gauss' nodes on a ring of phi^4, explicit, a vector of paths at a time.
!>
!> H = sum_i p_i^2/2 + q_i^2/2 + q_i^4/4 + (q_{i+1} - q_i)^2/2 with the noise sigma q_i^2 at each site. The states of a
!> strip of eight paths, one vector register a site, and the increments of its next eight steps stay in the nearest
!> cache. A kick and the drift after it are one pass over the sites; two kicks of Verlet at one place are one pass, too.
module bench_limit_phi4_ring
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_noise_normal, only: normal_stream, scaled_normal_column
   implicit none
   private
   public :: limit_phi4_ring

   integer(i4), parameter :: nlane = 8, ahead = 8       !! lanes of a strip, steps drawn at once
   integer(i4), parameter :: wide = 64                  !! lanes of the generator
   integer(i4), parameter :: purpose(2) = [0_i4, 3_i4]  !! of dW, and of dZ/h - dW/2
   real(wp), parameter :: root = sqrt(3.0_wp), node = 0.5_wp*(1 - 1/root)

contains

   !> nstep (a multiple of 8) steps of npath (a multiple of 64) paths of n sites from (q0, 0); kicks = 0: Verlet, 1: two
   !> kicks at Gauss' nodes.
   subroutine limit_phi4_ring(kicks, npath, nstep, n, seed, h, sigma, q0, q, p) bind(c)
      integer(i8), intent(in), value :: npath, nstep, seed
      integer(i4), intent(in), value :: kicks, n
      real(wp), intent(in), value :: h, sigma
      real(wp), intent(in) :: q0(n)
      real(wp), intent(out) :: q(nlane, n, npath/nlane), p(nlane, n, npath/nlane)  !! strip by strip
      real(wp), allocatable :: w(:, :, :), a(:, :, :)
      integer(i8) :: path(wide), first, step
      integer(i4) :: lane, i, strip

      allocate (w(wide, n, ahead), a(wide, n, ahead))
      do first = 0, npath - 1, wide
         do lane = 1, wide
            path(lane) = first + lane - 1
         end do
         do strip = 1, wide/nlane
            q(:, :, first/nlane + strip) = spread(q0, 1, nlane)
            p(:, :, first/nlane + strip) = 0
         end do
         do step = 0, nstep - 1, ahead
            do i = 1, n
               call scaled_normal_column(wide, normal_stream(seed, i, 0, purpose(1), sqrt(h)), path, step/2, ahead/2, &
                                         n, w(1, i, 1))
               if (kicks > 0) &
                  call scaled_normal_column(wide, normal_stream(seed, i, 0, purpose(2), sqrt(h/12)), path, step/2, &
                                            ahead/2, n, a(1, i, 1))
            end do
            do strip = 1, wide/nlane
               associate (at => first/nlane + strip, lane => (strip - 1)*nlane + 1)
                  if (kicks > 0) call gauss(n, h, sigma, w(lane, 1, 1), a(lane, 1, 1), q(1, 1, at), p(1, 1, at))
                  if (kicks == 0) call verlet(n, h, sigma, w(lane, 1, 1), q(1, 1, at), p(1, 1, at))
               end associate
            end do
         end do
      end do
   end subroutine limit_phi4_ring

   !> The steps of a strip with kicks at Gauss' nodes.
   subroutine gauss(n, h, sigma, w, a, q, p)
      integer(i4), intent(in) :: n
      real(wp), intent(in) :: h, sigma, w(wide, n, *), a(wide, n, *)
      real(wp), intent(inout) :: q(nlane, n), p(nlane, n)
      integer(i4) :: j

      call glide(nlane*n, node*h, p, q)
      do j = 1, ahead
         call kick(n, 0.5_wp*h, sigma, 0.5_wp, root, w(1, 1, j), a(1, 1, j), (1 - 2*node)*h, q, p)
         call kick(n, 0.5_wp*h, sigma, 0.5_wp, -root, w(1, 1, j), a(1, 1, j), merge(2, 1, j < ahead)*node*h, q, p)
      end do
   end subroutine gauss

   !> The steps of a strip by Verlet: half a kick, drifts with both halves of the kicks at their ends, and half a kick.
   subroutine verlet(n, h, sigma, w, q, p)
      integer(i4), intent(in) :: n
      real(wp), intent(in) :: h, sigma, w(wide, n, *)
      real(wp), intent(inout) :: q(nlane, n), p(nlane, n)
      integer(i4) :: j

      call kick(n, 0.5_wp*h, sigma, 0.5_wp, 0.0_wp, w(1, 1, 1), w(1, 1, 1), h, q, p)
      do j = 2, ahead
         call kick(n, h, sigma, 0.5_wp, 0.5_wp, w(1, 1, j - 1), w(1, 1, j), h, q, p)
      end do
      call kick(n, 0.5_wp*h, sigma, 0.5_wp, 0.0_wp, w(1, 1, ahead), w(1, 1, ahead), 0.0_wp, q, p)
   end subroutine verlet

   !> VEC p <- p - (b U_q + sum_k (beta w_k + gamma a_k) H_k,q), then q <- q + tau p, in one pass over the sites.
   pure subroutine kick(n, b, sigma, beta, gamma, w, a, tau, q, p)
      integer(i4), intent(in) :: n
      real(wp), intent(in) :: b, sigma, beta, gamma, tau, w(wide, n), a(wide, n)
      real(wp), intent(inout) :: q(nlane, n), p(nlane, n)
      real(wp), dimension(nlane) :: first, x, next, before, after, y
      integer(i4) :: i

      first = q(:, 1)
      x = first
      before = x - q(:, n)
      do i = 1, n
         next = first
         if (i < n) next = q(:, i + 1)
         after = next - x
         y = p(:, i) - (b*(x*(1 + x*x) + before - after) + 2*sigma*x*(beta*w(:nlane, i) + gamma*a(:nlane, i)))
         p(:, i) = y
         q(:, i) = x + tau*y
         before = after
         x = next
      end do
   end subroutine kick

   subroutine glide(n, tau, p, q)
      integer(i4), intent(in) :: n
      real(wp), intent(in) :: tau, p(n)
      real(wp), intent(inout) :: q(n)

      q = q + tau*p
   end subroutine glide

end module bench_limit_phi4_ring
