! SPDX-License-Identifier: BSD-3-Clause
!> The laws of increments that a scheme may require of a noise source.
!>
!> The names are here, in base, because both schemes and sources use them.
module symsde_base_laws
   implicit none
   private
   public :: law_gaussian, law_three_point, law_two_point, law_text

   enum, bind(c)
      enumerator :: law_gaussian = 0     !! dW ~ N(0, h)
      enumerator :: law_three_point = 1  !! dW = +-sqrt(3h) with probability 1/6 each, else 0
      enumerator :: law_two_point = 2    !! dW = +-sqrt(h) with probability 1/2 each
   end enum

contains

   pure character(len=16) function padded_text(law)
      integer, intent(in) :: law

      select case (law)
      case (law_three_point); padded_text = 'three-point'
      case (law_two_point); padded_text = 'two-point'
      case default; padded_text = 'Gaussian'
      end select
   end function padded_text

   !> A law in words.
   pure function law_text(law) result(text)
      integer, intent(in) :: law  !! one of the three laws
      character(len=len_trim(padded_text(law))) :: text

      text = padded_text(law)
   end function law_text

end module symsde_base_laws
