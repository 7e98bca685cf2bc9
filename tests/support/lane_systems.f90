! SPDX-License-Identifier: BSD-3-Clause
!> Linear systems for every lane of a block, each of which can be made by itself.
module lane_systems
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: make_systems

contains

   !> The identity plus numbers of at most `size`; the numbers of a lane depend on the lane and n alone.
   subroutine make_systems(nlane, n, size, a, x)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: size
      real(wp), intent(out) :: a(nlane, n, n), x(nlane, n)
      integer :: lane, i, j

      do lane = 1, nlane
         do j = 1, n
            do i = 1, n
               a(lane, i, j) = size*sin(1.0_wp + 7.1_wp*i + 3.3_wp*j*j + 0.37_wp*lane*i)
            end do
            a(lane, j, j) = a(lane, j, j) + 1
            x(lane, j) = cos(0.9_wp*j + 0.11_wp*lane)
         end do
      end do
   end subroutine make_systems

end module lane_systems
