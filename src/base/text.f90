! SPDX-License-Identifier: BSD-3-Clause
!> Numbers and names as text, for the sentences of error messages.
!>
!> The length of every result is an expression of the arguments. No function of the library returns text of
!> deferred length: gfortran 12 keeps the length of such a result in static storage, where threads race for it.
!> Longer sentences are written by subroutines into an allocatable argument. Functions that give lengths come before the
!> functions that use them, since gfortran warns of an implicit interface otherwise.
module symsde_base_text
   use symsde_base_kinds, only: wp, i8
   implicit none
   private
   public :: to_text, counted, nearest_name, nearest_names, name_length, append_line

   integer, parameter :: name_length = 32  !! longest name of a model, a scheme or a parameter

   !> The usual short text of a number.
   interface to_text
      module procedure integer_text, long_text, real_text
   end interface to_text

contains

   !> Digit by digit: an internal write takes as long as thirty numbers this way, and probes of models name all their
   !> noises.
   pure character(len=24) function padded_long(n)
      integer(i8), intent(in) :: n
      character(len=24) :: digits
      integer(i8) :: rest
      integer :: first

      rest = merge(n, -n, n < 0)  ! negative, since there is one more negative number
      digits = ''
      do first = len(digits), 1, -1
         digits(first:first) = achar(iachar('0') - int(mod(rest, 10_i8)))
         rest = rest/10
         if (rest == 0) exit
      end do
      padded_long = digits(first:)
      if (n < 0) padded_long = '-'//digits(first:)
   end function padded_long

   pure integer function long_length(n)
      integer(i8), intent(in) :: n

      long_length = len_trim(padded_long(n))
   end function long_length

   !> Write at most seven digits, as people do: 0.25 and 5.551115e-17, not 0.250000 and 5.551115E-017.
   pure character(len=24) function padded_real(x)
      real(wp), intent(in) :: x
      character(len=24) :: power
      integer :: at, last, n

      write (padded_real, '(1pg14.6e3)') x
      padded_real = adjustl(padded_real)
      if (index(padded_real, '.') == 0) return  ! NaN or infinity
      power = ''
      at = index(padded_real, 'E')
      if (at > 0) then
         read (padded_real(at + 1:), *) n
         power = 'e'//trim(padded_long(int(n, i8)))
         padded_real(at:) = ''
      end if
      last = verify(padded_real, '0 ', back=.true.)
      if (padded_real(last:last) == '.') last = last - 1
      padded_real(last + 1:) = power
   end function padded_real

   pure integer function real_length(x)
      real(wp), intent(in) :: x

      real_length = len_trim(padded_real(x))
   end function real_length

   !> '1 path', '2 paths': a number (as text) and a noun, with an s in the plural.
   pure function counted(number, noun) result(text)
      character(*), intent(in) :: number, noun
      character(len=len(number) + 1 + len(noun) + merge(0, 1, number == '1')) :: text

      text = number//' '//noun//'s'  ! cut to the length of the result
   end function counted

   pure function integer_text(n) result(text)
      integer, intent(in) :: n
      character(len=long_length(int(n, i8))) :: text

      text = long_text(int(n, i8))
   end function integer_text

   pure function long_text(n) result(text)
      integer(i8), intent(in) :: n
      character(len=long_length(n)) :: text

      text = padded_long(n)
   end function long_text

   pure function real_text(x) result(text)
      real(wp), intent(in) :: x
      character(len=real_length(x)) :: text

      text = padded_real(x)
   end function real_text

   !> The name in a list that is nearest to the given one; of equally near names the first.
   pure function nearest_name(given, names) result(name)
      character(*), intent(in) :: given     !! the user's text
      character(*), intent(in) :: names(:)  !! input of the user
      character(len=len(names)) :: name
      integer :: distance(size(names)), i

      do i = 1, size(names)
         distance(i) = edit_distance(trim(given), trim(names(i)))
      end do
      name = names(minloc(distance, dim=1))
   end function nearest_name

   !> The names of a list, nearest to the given one first, joined by commas.
   pure function nearest_names(given, names) result(text)
      character(*), intent(in) :: given     !! what the user wrote
      character(*), intent(in) :: names(:)  !! allowed names, at least one
      character(len=sum(len_trim(names)) + 2*(size(names) - 1)) :: text
      integer :: distance(size(names)), i, best, last

      do i = 1, size(names)
         distance(i) = edit_distance(trim(given), trim(names(i)))
      end do
      last = 0
      do i = 1, size(names)
         best = minloc(distance, dim=1)
         text(last + 1:) = trim(names(best))//','
         last = last + len_trim(names(best)) + 2
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

   !> Add a sentence to a text, on a line of its own.
   pure subroutine append_line(text, sentence)
      character(:), allocatable, intent(inout) :: text
      character(*), intent(in) :: sentence

      if (len(text) > 0) text = text//new_line('a')
      text = text//sentence
   end subroutine append_line

end module symsde_base_text
