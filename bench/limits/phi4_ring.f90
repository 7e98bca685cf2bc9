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
   public :: limit_phi4_verlet, limit_phi4_gauss

   integer(i4), parameter :: nlane = 8, ahead = 8       !! lanes of a strip, steps drawn at once
   integer(i4), parameter :: wide = 64                  !! lanes of the generator
   integer(i4), parameter :: purpose(2) = [0_i4, 3_i4]  !! of dW, and of dZ/h - dW/2
   real(wp), parameter :: root = sqrt(3.0_wp), node = 0.5_wp*(1 - 1/root)

contains

   !> nstep (a multiple of 8) steps of npath (a multiple of 64) paths of n sites from (q0, 0) by Verlet.
   subroutine limit_phi4_verlet(npath, nstep, n, seed, h, parameters, q0, q, p) bind(c)
      integer(i8), intent(in), value :: npath, nstep, seed
      integer(i4), intent(in), value :: n
      real(wp), intent(in), value :: h
      real(wp), intent(in) :: parameters(1), q0(n)  !! sigma
      real(wp), intent(out) :: q(nlane, n, npath/nlane), p(nlane, n, npath/nlane)  !! strip by strip

      call take_steps(.false., npath, nstep, n, seed, h, parameters(1), q0, q, p)
   end subroutine limit_phi4_verlet

   !> The same by kicks at Gauss' nodes.
   subroutine limit_phi4_gauss(npath, nstep, n, seed, h, parameters, q0, q, p) bind(c)
      integer(i8), intent(in), value :: npath, nstep, seed
      integer(i4), intent(in), value :: n
      real(wp), intent(in), value :: h
      real(wp), intent(in) :: parameters(1), q0(n)
      real(wp), intent(out) :: q(nlane, n, npath/nlane), p(nlane, n, npath/nlane)

      call take_steps(.true., npath, nstep, n, seed, h, parameters(1), q0, q, p)
   end subroutine limit_phi4_gauss

   subroutine take_steps(kicks, npath, nstep, n, seed, h, sigma, q0, q, p)
      logical, intent(in) :: kicks  !! at Gauss' nodes, instead of Verlet
      integer(i8), intent(in) :: npath, nstep, seed
      integer(i4), intent(in) :: n
      real(wp), intent(in) :: h, sigma, q0(n)
      real(wp), intent(out) :: q(nlane, n, npath/nlane), p(nlane, n, npath/nlane)
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
               if (kicks) &
                  call scaled_normal_column(wide, normal_stream(seed, i, 0, purpose(2), sqrt(h/12)), path, step/2, &
                                            ahead/2, n, a(1, i, 1))
            end do
            do strip = 1, wide/nlane
               associate (at => first/nlane + strip, before => (strip - 1)*nlane)
                  if (kicks) call gauss(n, before, h, sigma, w, a, q(1, 1, at), p(1, 1, at))
                  if (.not. kicks) call verlet(n, before, h, sigma, w, q(1, 1, at), p(1, 1, at))
               end associate
            end do
         end do
      end do
   end subroutine take_steps

   !> The steps of a strip with kicks at Gauss' nodes.
   subroutine gauss(n, before, h, sigma, w, a, q, p)
      integer(i4), intent(in) :: n, before  !! sites; lanes of the generator before those of the strip
      real(wp), intent(in) :: h, sigma, w(wide, n, ahead), a(wide, n, ahead)
      real(wp), intent(inout) :: q(nlane, n), p(nlane, n)
      integer(i4) :: j

      call glide(nlane*n, node*h, p, q)
      do j = 1, ahead
         call kick(n, before, 0.5_wp*h, sigma, 0.5_wp, root, w(1, 1, j), a(1, 1, j), (1 - 2*node)*h, q, p)
         call kick(n, before, 0.5_wp*h, sigma, 0.5_wp, -root, w(1, 1, j), a(1, 1, j), &
                   merge(2, 1, j < ahead)*node*h, q, p)
      end do
   end subroutine gauss

   !> The steps of a strip by Verlet: half a kick, drifts with both halves of the kicks at their ends, and half a kick.
   subroutine verlet(n, before, h, sigma, w, q, p)
      integer(i4), intent(in) :: n, before
      real(wp), intent(in) :: h, sigma, w(wide, n, ahead)
      real(wp), intent(inout) :: q(nlane, n), p(nlane, n)
      integer(i4) :: j

      call kick(n, before, 0.5_wp*h, sigma, 0.5_wp, 0.0_wp, w(1, 1, 1), w(1, 1, 1), h, q, p)
      do j = 2, ahead
         call kick(n, before, h, sigma, 0.5_wp, 0.5_wp, w(1, 1, j - 1), w(1, 1, j), h, q, p)
      end do
      call kick(n, before, 0.5_wp*h, sigma, 0.5_wp, 0.0_wp, w(1, 1, ahead), w(1, 1, ahead), 0.0_wp, q, p)
   end subroutine verlet

   !> VEC p <- p - (b U_q + sum_k (beta w_k + gamma a_k) H_k,q), then q <- q + tau p, in one pass over the sites.
   pure subroutine kick(n, start, b, sigma, beta, gamma, w, a, tau, q, p)
      integer(i4), intent(in) :: n, start
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
         y = beta*w(start + 1:start + nlane, i) + gamma*a(start + 1:start + nlane, i)
         y = p(:, i) - (b*(x*(1 + x*x) + before - after) + 2*sigma*x*y)
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
