! SPDX-License-Identifier: BSD-3-Clause
!> The abstract noise source: it gives the increments for these paths in these steps, and the functionals of the same
!> paths (base/functionals) that the scheme asked for.
!>
!> The source writes into a store of steps: w(:,0) is the step size and stays as it is, w(:,k) = dW_k. Its numbers are a
!> function of path and step alone, so that a run can begin at any step, and threads need no communication.
module symsde_noise_source
   use symsde_base_area_rule, only: area_rule
   use symsde_base_functionals, only: functional_set
   use symsde_base_interrupt, only: interrupt_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_request, step_store
   implicit none
   private
   public :: noise_type

   !> The common part of all sources. A run fills it in before the first step, and nothing changes it afterwards.
   type, abstract :: noise_type
      integer :: nnoise = 0                  !! m, number of noises
      logical, allocatable :: silent(:)      !! noises for which nothing is drawn: dW_k = 0 (nnoise)
      logical, allocatable :: common(:)      !! noises that all paths share: their draws are those of path 0 (nnoise)
      real(wp) :: bound = huge(1.0_wp)       !! truncation: |dW_k| <= bound [sqrt(time)]
      type(functional_set) :: asked          !! functionals to give beside the increments
      type(area_rule) :: areas               !! how areas are drawn
   contains
      procedure(fill_interface), deferred :: fill
   end type noise_type

   abstract interface
      !> Increments and functionals of the requested steps, from step 0 of the store on. Steps that the source does not
      !> have are left as they are; after a wanted interrupt any step may be.
      subroutine fill_interface(self, request, store, drawn, interrupt)
         import :: noise_type, step_request, step_store, i8, interrupt_type
         class(noise_type), intent(in) :: self
         type(step_request), intent(in) :: request
         type(step_store), intent(inout) :: store   !! a store with room for the requested steps
         integer(i8), intent(out) :: drawn          !! normals drawn for one path
         class(interrupt_type), intent(inout), target, optional :: interrupt
      end subroutine fill_interface
   end interface

end module symsde_noise_source
