! SPDX-License-Identifier: BSD-3-Clause
!> A function with a result of deferred length, whose length gfortran stores statically: check_static.py must find it.
module deferred
   implicit none
   private
   public :: sentence

contains

   pure function word(n) result(text)
      integer, intent(in) :: n
      character(:), allocatable :: text

      text = repeat('x', n)
   end function word

   subroutine sentence(n, text)
      integer, intent(in) :: n
      character(:), allocatable, intent(out) :: text

      text = 'the word is '//word(n)
   end subroutine sentence

end module deferred
