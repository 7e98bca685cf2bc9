! SPDX-License-Identifier: BSD-3-Clause
!> Lanes: the paths of a block are neighbours in memory, the first array index, padded to a multiple of eight.
!>
!> Padding repeats the last real path. Without it the scalar remainder of a vector loop would round
!> differently from its vector body, and a path would depend on the size of its block.
module symsde_base_lanes
   use symsde_base_kinds, only: wp, i8
   use symsde_base_vectors, only: copy
   implicit none
   private
   public :: lane_unit, default_nlane, padded, lanes_for, lanes_together, is_finite_lane, all_finite, path_of_lane
   public :: slice_lanes, take_where

   integer, parameter :: lane_unit = 8         !! every nlane is a multiple of this
   integer, parameter :: default_nlane = 256   !! lanes of a block of small systems
   integer, parameter :: block_values = 65536  !! real numbers that a block's main arrays may hold
   integer, parameter :: near_values = 1024    !! real numbers of one array in the nearest cache

contains

   !> The smallest multiple of lane_unit that is at least n.
   pure integer function padded(n)
      integer, intent(in) :: n  !! number of real paths

      padded = ((n + lane_unit - 1)/lane_unit)*lane_unit
   end function padded

   !> Default number of lanes: 256, for larger systems 128 or 64, so that an array of one number for each degree of
   !> freedom stays in the nearest cache, and fewer if the block would not stay in the next.
   pure integer function lanes_for(ndof, npath)
      integer, intent(in) :: ndof      !! degrees of freedom
      integer(i8), intent(in) :: npath !! paths of the run
      integer, parameter :: enough = 64  ! with fewer lanes, calls of kernels take a considerable part of a step

      lanes_for = default_nlane
      do while (lanes_for > enough .and. lanes_for > near_values/max(ndof, 1))
         lanes_for = lanes_for/2
      end do
      lanes_for = max(lane_unit, min(lanes_for, block_values/max(ndof*16, 1)/lane_unit*lane_unit))
      if (npath < lanes_for) lanes_for = padded(int(max(npath, 1_i8)))
   end function lanes_for

   !> Lanes to process together, so that an array of width by ndof numbers stays in the nearest cache: whole units that
   !> divide nlane, at least `least` lanes. A single lane is its own group.
   pure integer function lanes_together(nlane, ndof, least) result(width)
      integer, intent(in) :: nlane, ndof, least

      width = nlane
      do while (mod(nlane, width) /= 0 .or. (width*ndof > near_values .and. width > least))
         width = width - lane_unit
      end do
   end function lanes_together

   !> Global path of each lane; lanes past the last real path repeat it.
   pure subroutine path_of_lane(nlane, first, nreal, path)
      integer, intent(in) :: nlane             !! lanes of the block
      integer(i8), intent(in) :: first         !! global index of the first path of the block, from 0
      integer, intent(in) :: nreal             !! real paths of the block, 1..nlane
      integer(i8), intent(out) :: path(nlane)  !! global path of each lane
      integer :: lane

      do lane = 1, nlane
         path(lane) = first + min(lane, nreal) - 1
      end do
   end subroutine path_of_lane

   !> True where x is neither infinite nor NaN; vectorises, unlike ieee_is_finite.
   elemental logical function is_finite_lane(x)
      real(wp), intent(in) :: x

      is_finite_lane = abs(x) <= huge(x)
   end function is_finite_lane

   !> VEC Whether all of n numbers are finite. Counting has no early exit and so vectorises.
   pure logical function all_finite(n, x)
      integer(i8), intent(in) :: n
      real(wp), intent(in) :: x(n)
      integer(i8) :: i, bad

      bad = 0
      do i = 1, n
         bad = bad + merge(0_i8, 1_i8, abs(x(i)) <= huge(1.0_wp))
      end do
      all_finite = bad == 0
   end function all_finite

   !> VEC Copy the lanes before + 1 .. before + wanted of x to y: all lanes, or whole units, for which the loop is
   !> unrolled.
   pure subroutine slice_lanes(nlane, n, before, wanted, x, y)
      integer, intent(in) :: nlane, n, before, wanted
      real(wp), intent(in) :: x(nlane, n)
      real(wp), intent(out) :: y(wanted, n)
      integer :: i, done, lane

      if (wanted == nlane) then  ! all lanes: copy the memory
         call copy(nlane*n, x, y)
         return
      end if
      do i = 1, n
         do done = 0, wanted - lane_unit, lane_unit
            !GCC$ unroll 8
            do lane = done + 1, done + lane_unit
               y(lane, i) = x(before + lane, i)
            end do
         end do
      end do
   end subroutine slice_lanes

   !> y = x in lanes with status 0; in other lanes y stays.
   pure subroutine take_where(nlane, n, status, x, y)
      integer, intent(in) :: nlane, n
      integer(i8), intent(in) :: status(nlane)
      real(wp), intent(in) :: x(nlane, n)
      real(wp), intent(inout) :: y(nlane, n)
      integer :: i

      do i = 1, n
         y(:, i) = merge(x(:, i), y(:, i), status == 0)
      end do
   end subroutine take_where

end module symsde_base_lanes
