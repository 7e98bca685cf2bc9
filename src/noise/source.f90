! SPDX-License-Identifier: BSD-3-Clause
!> The abstract noise source: it answers which increments drive these paths in this step.
!>
!> The answer is written into the weights of the one-step Hamiltonian: w(:,0) is the step size and
!> belongs to the caller, w(:,k) = dW_k is filled here. Steps come in pairs 2j, 2j+1, because one call of
!> the generator makes the normals of both; a source fills the weights of the two steps at once.
module symsde_noise_source
   use symsde_base_kinds, only: wp, i8
   implicit none
   private
   public :: noise_type, clip_lanes

   type, abstract :: noise_type
      integer :: nnoise = 0                  !! m, number of noises
      logical, allocatable :: silent(:)      !! noises for which nothing is drawn: dW_k = 0 (nnoise)
      real(wp) :: bound = huge(1.0_wp)       !! truncation: |dW_k| <= bound [sqrt(time)]
   contains
      procedure(fill_interface), deferred :: fill
   end type noise_type

   abstract interface
      !> Increments of the steps 2*pair and 2*pair+1 of the given paths.
      subroutine fill_interface(self, nlane, path, pair, w, drawn)
         import :: noise_type, wp, i8
         class(noise_type), intent(in) :: self
         integer, intent(in) :: nlane
         integer(i8), intent(in) :: path(nlane)  !! global path of each lane
         integer(i8), intent(in) :: pair         !! pair of steps, counted from step 0
         real(wp), intent(inout) :: w(nlane, 0:self%nnoise, 0:1) !! w(:,k,0), w(:,k,1) = dW_k of the two steps
         integer(i8), intent(inout) :: drawn     !! normals drawn for one path, added to
      end subroutine fill_interface
   end interface

contains

   !> Clip increments to [-bound, bound]; applied to the summed increment of the level in use.
   pure subroutine clip_lanes(n, bound, dw)
      integer, intent(in) :: n
      real(wp), intent(in) :: bound
      real(wp), intent(inout) :: dw(n)
      integer :: i

      do i = 1, n
         dw(i) = min(max(dw(i), -bound), bound)
      end do
   end subroutine clip_lanes

end module symsde_noise_source
