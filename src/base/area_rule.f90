! SPDX-License-Identifier: BSD-3-Clause
!> How the areas of a step are drawn.
!>
!> areas_by_path   the step is halved 2^n >= tau/(12 |h|) times: the unresolved part of the areas of the path falls
!>                 with h as strong order 1 needs. A run can be halved (refine < 0)
!> areas_in_law    the finest interval is not halved: its areas are computed from dW and H, plus a random rest with the
!>                 mean and covariances that the areas have given dW and H. Order 1 in law at a bounded cost
!>
!> areas_in_law uses no time scale, and steps cannot be halved, since the rest belongs to no path.
module symsde_base_area_rule
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: area_rule

   enum, bind(c)
      enumerator :: areas_by_path = 0
      enumerator :: areas_in_law = 1
   end enum
   public :: areas_by_path, areas_in_law

   integer, parameter, public :: max_area_levels = 20  !! 2^20 sub-increments of a step
   integer, parameter, public :: most_paired = 1448    !! noises whose pairs fit the 20 bits of their counter

   type :: area_rule
      integer :: kind = areas_by_path
      real(wp) :: time = 0   !! tau, the time scale of areas_by_path [time]
   contains
      procedure :: levels
   end type area_rule

contains

   !> n, the number of halvings of an interval whose areas are needed.
   pure integer function levels(self, h)
      class(area_rule), intent(in) :: self
      real(wp), intent(in) :: h   !! length, either sign [time]
      real(wp) :: parts

      levels = 0
      if (self%kind == areas_in_law) return
      parts = self%time/(12*abs(h))*(1 - 1e-6_wp)  ! rounding in tau must not double the parts
      do while (2.0_wp**levels < parts .and. levels < max_area_levels)
         levels = levels + 1
      end do
   end function levels

end module symsde_base_area_rule
