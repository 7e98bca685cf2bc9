! SPDX-License-Identifier: BSD-3-Clause
!> Up to how many paths of a run are taken through their steps one by one.
!>
!> A block is padded to whole vectors of eight lanes, and its passes tell lanes that are done from others. A run of few
!> paths pays for both and uses little of either. So every path of such a run is a block of one lane, by the instance of
!> the stepper's body with one lane, which has the same bits. A stepper says up to how many paths that is faster
!> (most_single of step/stepper), and most_single here bounds what it may say.
module symsde_step_few_paths
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

end module symsde_step_few_paths
