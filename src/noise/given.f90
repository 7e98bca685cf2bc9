! SPDX-License-Identifier: BSD-3-Clause
!> Increments that a user gives, in any order of memory, and how lanes take them: the number of path i, column k and
!> row n is
!>
!>    x(1 + (i - 1) s_1 + (k - 1) s_2 + (n - 1) s_3),   s: strides, none of them negative
!>
!> Nothing is copied before a block needs it. The lanes of a block are neighbours in what they take, and often far apart
!> in x: then eight lanes at a time read their rows one after the other, each along its own memory.
module symsde_noise_given
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: all_finite
   use symsde_base_vectors, only: copy
   implicit none
   private
   public :: given_increments, increments_of

   integer, parameter :: near = 4096  !! numbers that are taken before they are checked: 32 kB

   type :: given_increments
      real(wp), pointer, contiguous :: x(:) => null()   !! the user's memory; null: no increments are given
      integer(i8) :: extent(3) = 0                      !! npath or 1, columns, rows
      integer(i8) :: stride(3) = 0                      !! between neighbours in these
   contains
      procedure :: exist
      procedure, private :: place
      procedure :: rows
      procedure :: in_order
      procedure :: are_finite
      procedure :: first_not_finite
      procedure :: take
   end type given_increments

contains

   !> An array (npath or 1, columns, rows) as it lies in memory. It must live as long as the increments.
   function increments_of(dw) result(given)
      real(wp), intent(in), target, contiguous :: dw(:, :, :)
      type(given_increments) :: given

      given%x(1:size(dw, kind=i8)) => dw
      given%extent = shape(dw, i8)
      given%stride(1) = 1
      given%stride(2) = given%extent(1)
      given%stride(3) = given%extent(1)*given%extent(2)
   end function increments_of

   !> Whether there are any.
   pure logical function exist(self)
      class(given_increments), intent(in) :: self

      exist = associated(self%x)
   end function exist

   !> Where the number of path i, column k and row n is in memory.
   pure integer(i8) function place(self, i, k, n)
      class(given_increments), intent(in) :: self
      integer(i8), intent(in) :: i, k, n

      place = 1 + (i - 1)*self%stride(1) + (k - 1)*self%stride(2) + (n - 1)*self%stride(3)
   end function place

   !> The rows a + 1 .. b; of no increments, none.
   function rows(self, a, b) result(part)
      class(given_increments), intent(in) :: self
      integer(i8), intent(in) :: a, b
      type(given_increments) :: part

      if (.not. self%exist()) return
      part = given_increments(self%x(min(a*self%stride(3), size(self%x, kind=i8)) + 1:), self%extent, self%stride)
      part%extent(3) = b - a
   end function rows

   !> Copy the increments to an array.
   subroutine in_order(self, dw)
      class(given_increments), intent(in) :: self
      real(wp), allocatable, intent(out) :: dw(:, :, :)   !! (npath or 1, columns, rows)
      integer(i8) :: i, k, n

      allocate (dw(self%extent(1), self%extent(2), self%extent(3)))
      do n = 1, self%extent(3)
         do k = 1, self%extent(2)
            do i = 1, self%extent(1)
               dw(i, k, n) = self%x(self%place(i, k, n))
            end do
         end do
      end do
   end subroutine in_order

   !> Whether all numbers are finite, read along memory.
   logical function are_finite(self)
      class(given_increments), intent(in) :: self
      real(wp), pointer, contiguous :: x(:)
      integer(i8) :: i, k, extent(3)
      integer :: inner, middle, outer

      x => self%x  ! contiguous, which gfortran 12 does not recognise for a component
      extent = merge(min(self%extent, 1_i8), self%extent, self%stride == 0)  ! repeated numbers are read once
      inner = max(1, minloc(self%stride, 1, extent > 1))
      middle = modulo(inner, 3) + 1
      outer = modulo(middle, 3) + 1
      are_finite = .true.
      do i = 0, extent(outer) - 1
         do k = 0, extent(middle) - 1
            associate (a => 1 + i*self%stride(outer) + k*self%stride(middle), s => self%stride(inner), &
                       n => extent(inner))
               if (s == 1 .or. n <= 1) then
                  are_finite = are_finite .and. all_finite(n, x(a:))
               else
                  are_finite = are_finite .and. all(abs(x(a:a + (n - 1)*s:s)) <= huge(1.0_wp))
               end if
            end associate
         end do
      end do
   end function are_finite

   !> Path, column and row of a number that is not finite: the first of the first path that has one.
   pure function first_not_finite(self) result(at)
      class(given_increments), intent(in) :: self
      integer(i8) :: at(3), i, k, n

      at = 0
      do i = 1, self%extent(1)
         do n = 1, self%extent(3)
            do k = 1, self%extent(2)
               if (abs(self%x(self%place(i, k, n))) <= huge(1.0_wp)) cycle
               at(1) = i
               at(2) = k
               at(3) = n
               return
            end do
         end do
      end do
   end function first_not_finite

   !> Copy columns column .. column+n-1 of nrow rows from `row` on to dw (nlane, n, nrow), behind `lead` columns that
   !> are left alone and finite. path: that of each lane, counted from 1.
   subroutine take(self, nlane, path, column, n, row, nrow, lead, dw, finite)
      class(given_increments), intent(in) :: self
      integer, intent(in) :: nlane, column, n, nrow
      integer(i8), intent(in) :: path(nlane), row
      integer, intent(in) :: lead                  !! columns before those that are written
      real(wp), intent(inout) :: dw(nlane, 1 - lead:n, nrow)
      logical, intent(inout) :: finite             !! false on return if a number is not; else it stays
      real(wp), pointer, contiguous :: x(:)
      integer(i8) :: from(nlane)
      integer :: i, many, lane, group
      logical :: adjacent

      x => self%x
      from = 1 + (path - 1)*self%stride(1) + (column - 1)*self%stride(2)
      adjacent = all(from(2:) - from(:nlane - 1) == 1)
      group = merge(nlane, 8, adjacent)
      many = max(1, near/(group*(n + lead)))
      do lane = 1, nlane, group
         do i = 1, nrow, many
            associate (before => (row + i - 2)*self%stride(3), rows => min(many, nrow - i + 1))
               if (adjacent) then
                  call take_adjacent(nlane, lead, n, rows, self%stride, x(before + from(1):), dw(1, 1 - lead, i), &
                                     finite)
               else
                  call take_eight(nlane, lead, n, rows, self%stride, from(lane), x(before + 1:), &
                                  dw(lane, 1 - lead, i), finite)
               end if
            end associate
         end do
      end do
   end subroutine take

   !> Lanes that are neighbours in memory. Of one lane alone, columns that are, unless there are few.
   pure subroutine take_adjacent(nlane, lead, n, nrow, s, x, dw, finite)
      integer, intent(in) :: nlane, lead, n, nrow
      integer(i8), intent(in) :: s(3)
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(inout) :: dw(nlane, 1 - lead:n, nrow)
      logical, intent(inout) :: finite
      integer :: i, k

      if (nlane == 1 .and. n < 8) then
         do k = 1, n
            do i = 1, nrow
               dw(1, k, i) = x((i - 1)*s(3) + (k - 1)*s(2) + 1)
            end do
         end do
      else if (nlane == 1 .and. s(2) == 1) then
         do i = 1, nrow
            call copy(n, x((i - 1)*s(3) + 1:), dw(1, 1, i))
         end do
      else
         do i = 1, nrow
            do k = 1, n
               call copy(nlane, x((i - 1)*s(3) + (k - 1)*s(2) + 1:), dw(1, k, i))
            end do
         end do
      end if
      finite = finite .and. all_finite(int(nlane, i8)*(n + lead)*nrow, dw)
   end subroutine take_adjacent

   !> Eight lanes that begin at these places: written out, they make a vector of eight loads.
   pure subroutine take_eight(nlane, lead, n, nrow, s, from, x, dw, finite)
      integer, intent(in) :: nlane, lead, n, nrow
      integer(i8), intent(in) :: s(3), from(8)
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(inout) :: dw(nlane, 1 - lead:n, nrow)
      logical, intent(inout) :: finite
      integer(i8) :: at, bad(8)
      integer :: i, k

      associate (a => from(1), b => from(2), c => from(3), d => from(4), &
                 e => from(5), f => from(6), g => from(7), h => from(8))
         do i = 1, nrow
            do k = 1, n
               at = (i - 1)*s(3) + (k - 1)*s(2)
               dw(1, k, i) = x(a + at)
               dw(2, k, i) = x(b + at)
               dw(3, k, i) = x(c + at)
               dw(4, k, i) = x(d + at)
               dw(5, k, i) = x(e + at)
               dw(6, k, i) = x(f + at)
               dw(7, k, i) = x(g + at)
               dw(8, k, i) = x(h + at)
            end do
         end do
      end associate
      bad = 0
      do i = 1, nrow
         do k = 1, n
            bad = bad + merge(0_i8, 1_i8, abs(dw(:8, k, i)) <= huge(1.0_wp))
         end do
      end do
      finite = finite .and. all(bad == 0)
   end subroutine take_eight

end module symsde_noise_given
