! SPDX-License-Identifier: BSD-3-Clause
!> Limit program: one path of the midpoint rule on the synchrotron, as a plain scalar loop.
!>
!> Newton's iteration in v = dp with the intrinsic sine and cosine, and the normals of limits/single_path.
module bench_limit_single_path_synchrotron
   use symsde_base_kinds, only: wp, i8
   use bench_limit_single_path, only: zig_type, new_zig, zig_normal
   implicit none
   private
   public :: limit_single_path_synchrotron

contains

   !> nstep steps from (1, 0); the final state on return.
   subroutine limit_single_path_synchrotron(nstep, h, omega, sigma1, sigma2, q, p)
      integer(i8), intent(in) :: nstep
      real(wp), intent(in) :: h, omega, sigma1, sigma2
      real(wp), intent(out) :: q, p
      type(zig_type) :: zig
      real(wp) :: normal1, normal2, v
      integer(i8) :: step

      call new_zig(zig)
      q = 1
      p = 0
      do step = 1, nstep
         call zig_normal(zig, normal1)
         call zig_normal(zig, normal2)
         call solve(h, omega**2*h + sigma2*sqrt(h)*normal2, sigma1*sqrt(h)*normal1, q + 0.5_wp*h*p, v)
         q = q + h*(p + 0.5_wp*v)
         p = p + v
      end do
   end subroutine limit_single_path_synchrotron

   !> v + a sin x + b cos x = 0 at x = middle + h v/4. Newton converges quadratically: after a correction of 1e-9
   !> rounding is all that is left.
   subroutine solve(h, a, b, middle, v)
      real(wp), intent(in) :: h, a, b, middle
      real(wp), intent(out) :: v
      real(wp) :: sine, cosine, d
      integer :: iteration

      v = 0
      do iteration = 1, 50
         sine = sin(middle + 0.25_wp*h*v)
         cosine = cos(middle + 0.25_wp*h*v)
         d = (v + a*sine + b*cosine)/(1 + 0.25_wp*h*(a*cosine - b*sine))
         v = v - d
         if (abs(d) <= 1e-9_wp*abs(v)) return
      end do
   end subroutine solve

end module bench_limit_single_path_synchrotron
