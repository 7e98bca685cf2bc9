! SPDX-License-Identifier: BSD-3-Clause
!> Sums of n numbers that are neighbours in memory: the lanes of a block, or the degrees of freedom of a path.
module symsde_base_vectors
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: add, subtract, add_times, add_times_each, copy, scale

contains

   !> VEC total = x + y
   pure subroutine add(n, x, y, total)
      integer, intent(in) :: n
      real(wp), intent(in) :: x(n), y(n)
      real(wp), intent(out) :: total(n)
      integer :: i

      do i = 1, n
         total(i) = x(i) + y(i)
      end do
   end subroutine add

   !> VEC total = total - x
   pure subroutine subtract(n, x, total)
      integer, intent(in) :: n
      real(wp), intent(in) :: x(n)
      real(wp), intent(inout) :: total(n)
      integer :: i

      do i = 1, n
         total(i) = total(i) - x(i)
      end do
   end subroutine subtract

   !> VEC total = total + factor x
   pure subroutine add_times(n, factor, x, total)
      integer, intent(in) :: n
      real(wp), intent(in) :: factor, x(n)
      real(wp), intent(inout) :: total(n)
      integer :: i

      do i = 1, n
         total(i) = total(i) + factor*x(i)
      end do
   end subroutine add_times

   !> VEC total = total + factor x, with a factor for each lane and n numbers in it.
   pure subroutine add_times_each(nlane, n, factor, x, total)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: factor(nlane), x(nlane, n)
      real(wp), intent(inout) :: total(nlane, n)
      integer :: lane, i

      if (nlane == 1) then  ! all numbers are neighbours: one loop instead of n
         call add_times(n, factor(1), x, total)
         return
      end if
      do i = 1, n
         do lane = 1, nlane
            total(lane, i) = total(lane, i) + factor(lane)*x(lane, i)
         end do
      end do
   end subroutine add_times_each

   !> y = x, which the compiler turns into a copy of memory. Unless the compiler knows that both have one lane, an
   !> assignment would copy lane by lane.
   pure subroutine copy(n, x, y)
      integer, intent(in) :: n
      real(wp), intent(in) :: x(n)
      real(wp), intent(out) :: y(n)
      integer :: i

      do i = 1, n
         y(i) = x(i)
      end do
   end subroutine copy

   !> VEC total = factor x
   pure subroutine scale(n, factor, x, total)
      integer, intent(in) :: n
      real(wp), intent(in) :: factor, x(n)
      real(wp), intent(out) :: total(n)
      integer :: i

      do i = 1, n
         total(i) = factor*x(i)
      end do
   end subroutine scale

end module symsde_base_vectors
