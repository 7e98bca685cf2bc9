! SPDX-License-Identifier: BSD-3-Clause
!> A loop that gfortran turns into calls of the vector math library: check_static.py must find it.
module vector_sine
   use, intrinsic :: iso_fortran_env, only: real64
   implicit none
   private
   public :: sines

contains

   pure subroutine sines(n, x, s)
      integer, intent(in) :: n
      real(real64), intent(in) :: x(n)
      real(real64), intent(out) :: s(n)

      s = sin(x)
   end subroutine sines

end module vector_sine
