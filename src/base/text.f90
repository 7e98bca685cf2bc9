! SPDX-License-Identifier: BSD-3-Clause
!> Numbers and names as text, for the sentences of error messages.
module symsde_base_text
   use symsde_base_kinds, only: wp, i8
   implicit none
   private
   public :: to_text, nearest_names, name_length

   integer, parameter :: name_length = 32  !! longest name of a model, a scheme or a parameter

   !> The shortest usual text of a number.
   interface to_text
      module procedure integer_text, long_text, real_text
   end interface to_text

contains

   pure function integer_text(n) result(text)
      integer, intent(in) :: n
      character(:), allocatable :: text

      text = long_text(int(n, i8))
   end function integer_text

   pure function long_text(n) result(text)
      integer(i8), intent(in) :: n
      character(:), allocatable :: text
      character(len=24) :: buffer

      write (buffer, '(i0)') n
      text = trim(buffer)
   end function long_text

   pure function real_text(x) result(text)
      real(wp), intent(in) :: x
      character(:), allocatable :: text
      character(len=32) :: buffer

      write (buffer, '(1pg14.6e3)') x
      text = trim(adjustl(buffer))
   end function real_text

   !> The names of a list, those most like the given one first, joined by commas.
   pure function nearest_names(given, names) result(text)
      character(*), intent(in) :: given     !! what the user wrote
      character(*), intent(in) :: names(:)  !! what is allowed
      character(:), allocatable :: text
      integer :: distance(size(names)), i, best

      do i = 1, size(names)
         distance(i) = edit_distance(trim(given), trim(names(i)))
      end do
      text = ''
      do i = 1, size(names)
         best = minloc(distance, dim=1)
         if (i > 1) text = text//', '
         text = text//trim(names(best))
         distance(best) = huge(0)
      end do
   end function nearest_names

   !> Levenshtein's distance: insertions, deletions and replacements between two words.
   pure integer function edit_distance(a, b) result(distance)
      character(*), intent(in) :: a, b
      integer :: row(0:len(b)), previous, above, i, j

      do j = 0, len(b)
         row(j) = j
      end do
      do i = 1, len(a)
         previous = row(0)
         row(0) = i
         do j = 1, len(b)
            above = row(j)
            row(j) = min(above + 1, row(j - 1) + 1, previous + merge(0, 1, a(i:i) == b(j:j)))
            previous = above
         end do
      end do
      distance = row(len(b))
   end function edit_distance

end module symsde_base_text
