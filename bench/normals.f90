! SPDX-License-Identifier: BSD-3-Clause
!> The generator of the library alone, in blocks of 256 lanes.
module bench_normals
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_noise_normal, only: normal_stream, scaled_normal_steps
   implicit none
   private
   public :: draw_normals

   integer(i4), parameter :: nlane = 256

contains

   !> ncall blocks of eight normals a lane; the last block on return.
   subroutine draw_normals(ncall, normals) bind(c)
      integer(i8), intent(in), value :: ncall
      real(wp), intent(inout) :: normals(nlane, 0:1, 0:7)
      integer(i8) :: path(nlane), call
      integer(i4) :: lane

      path = [(int(lane, i8), lane=0, nlane - 1)]
      do call = 1, ncall
         call scaled_normal_steps(nlane, normal_stream(1_i8, 1), path, 4*call, 4, 1, normals)
      end do
   end subroutine draw_normals

end module bench_normals
