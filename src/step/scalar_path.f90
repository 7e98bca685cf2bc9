! SPDX-License-Identifier: BSD-3-Clause
!> Paths that are taken through their steps one by one.
!>
!> A block of few paths pays for full vectors, and for passes over them that tell lanes apart. So every path of such a
!> run is a block of one lane, by an instance of the stepper's body with one lane, which has the same bits. A stepper
!> says up to how many paths that is faster.
module symsde_step_scalar_path
   implicit none
   private
   public :: most_single, few_of

   integer, parameter :: most_single = 12         !! paths of a run that any stepper takes one by one
   integer, parameter :: wide = 32                !! degrees of freedom of a wide system

contains

   !> Paths up to which those of a block are faster one by one: as many as were measured for narrow systems, and more
   !> of wide ones, where a block takes its passes through memory.
   pure integer function few_of(n, narrow, broad)
      integer, intent(in) :: n              !! degrees of freedom
      integer, intent(in) :: narrow, broad  !! paths of a narrow system, of a wide one

      few_of = merge(broad, narrow, n >= wide)
   end function few_of

end module symsde_step_scalar_path
