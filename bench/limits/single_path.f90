! SPDX-License-Identifier: BSD-3-Clause
!> Limit program: one path of the midpoint rule on the Kubo oscillator, as a plain scalar loop.
!>
!> What a single path is compared with: normals by the ziggurat of 128 layers (Marsaglia and Tsang;
!> Doornik's version) from the shift-register generator (13, 7, 17), state and tables in registers and
!> cache. Other numbers than the library's, of the same law.
module bench_limit_single_path
   use symsde_base_kinds, only: wp, i8
   implicit none
   private
   public :: limit_single_path, zig_type, new_zig, zig_normal

   integer, parameter :: nlayer = 128
   real(wp), parameter :: edge = 3.442619855899_wp, area = 9.91256303526217e-3_wp

   type :: zig_type
      integer(i8) :: state = 88172645463325252_i8
      real(wp) :: x(0:nlayer) = 0, ratio(0:nlayer - 1) = 0
   end type zig_type

contains

   !> nstep steps from (1, 0); the final state on return.
   subroutine limit_single_path(nstep, h, a, sigma, q, p)
      integer(i8), intent(in) :: nstep
      real(wp), intent(in) :: h, a, sigma
      real(wp), intent(out) :: q, p
      type(zig_type) :: zig
      real(wp) :: noise, theta, half, factor, dq, normal
      integer(i8) :: step

      call new_zig(zig)
      noise = sigma*sqrt(h)
      q = 1
      p = 0
      do step = 1, nstep
         call zig_normal(zig, normal)
         theta = a*h + noise*normal
         half = 0.5_wp*theta
         factor = theta/(1 + half*half)
         dq = factor*(p - half*q)
         p = p - factor*(q + half*p)
         q = q + dq
      end do
   end subroutine limit_single_path

   !> Tables of the layers.
   subroutine new_zig(self)
      type(zig_type), intent(out) :: self
      real(wp) :: f
      integer :: i

      f = exp(-0.5_wp*edge**2)
      self%x(0) = area/f
      self%x(1) = edge
      do i = 2, nlayer - 1
         self%x(i) = sqrt(-2*log(area/self%x(i - 1) + f))
         f = exp(-0.5_wp*self%x(i)**2)
      end do
      self%x(nlayer) = 0
      self%ratio = self%x(1:)/self%x(:nlayer - 1)
   end subroutine new_zig

   !> One standard normal.
   subroutine zig_normal(self, normal)
      type(zig_type), intent(inout) :: self
      real(wp), intent(out) :: normal
      real(wp) :: u, v, f0, f1
      integer :: i

      do
         call next_word(self%state)
         i = int(iand(self%state, int(nlayer - 1, i8)))
         u = real(shifta(self%state, 11), wp)*2.0_wp**(-52)
         normal = u*self%x(i)
         if (abs(u) < self%ratio(i)) return
         if (i == 0) then
            call tail(self, u < 0, normal)
            return
         end if
         f0 = exp(-0.5_wp*(self%x(i)**2 - normal**2))
         f1 = exp(-0.5_wp*(self%x(i + 1)**2 - normal**2))
         call uniform(self, v)
         if (f1 + v*(f0 - f1) < 1) return
      end do
   end subroutine zig_normal

   subroutine tail(self, negative, normal)
      type(zig_type), intent(inout) :: self
      logical, intent(in) :: negative
      real(wp), intent(out) :: normal
      real(wp) :: u, x, y

      do
         call uniform(self, u)
         x = log(u)/edge
         call uniform(self, u)
         y = log(u)
         if (-2*y >= x*x) exit
      end do
      normal = merge(x - edge, edge - x, negative)
   end subroutine tail

   subroutine uniform(self, u)
      type(zig_type), intent(inout) :: self
      real(wp), intent(out) :: u

      call next_word(self%state)
      u = (real(ishft(self%state, -11), wp) + 0.5_wp)*2.0_wp**(-53)
   end subroutine uniform

   pure subroutine next_word(state)
      integer(i8), intent(inout) :: state

      state = ieor(state, ishft(state, 13))
      state = ieor(state, ishft(state, -7))
      state = ieor(state, ishft(state, 17))
   end subroutine next_word

end module bench_limit_single_path
