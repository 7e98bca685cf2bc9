! SPDX-License-Identifier: BSD-3-Clause
!> The contract of models (model/abstract).
!>
!> Promised after construction: the sizes in the traits are consistent. Required at every call: lanes, degrees of
!> freedom and noises are those of the traits; time and weights are finite. States need not be finite: lanes that have
!> failed, or whose iteration diverges, are computed too, and a model must accept any numbers in them. A view of real
!> lanes (model/views/real_lanes) gets the number of real lanes, and repeats the last real lane in its outputs.
module symsde_model_contract
   use symsde_base_contracts, only: require, require_finite
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: model_traits, dense
   implicit none
   private
   public :: require_traits, require_question, require_real_lanes

contains

   !> Check the promises about traits.
   pure subroutine require_traits(traits)
      type(model_traits), intent(in) :: traits
      character(*), parameter :: place = 'model, traits'

      call require(traits%ndof >= 1 .and. traits%nnoise >= 0, place, &
                   'there is a degree of freedom, and noises are counted')
      if (allocated(traits%silent)) &
         call require(size(traits%silent) == traits%nnoise, place, 'silent has one entry for each noise')
      if (traits%touches%are_given()) &
         call require(size(traits%touches%from) == traits%nnoise + 1, place, 'each noise has its degrees of freedom')
      if (allocated(traits%rotation)) &
         call require(size(traits%rotation) == traits%ndof, place, 'rotation has one entry for each degree of freedom')
      call require(traits%bandwidth >= dense, place, 'the bandwidth is that of a matrix, or dense')
      call require(traits%max_frequency >= 0 .and. traits%noise_lipschitz >= 0, place, &
                   'declared bounds are not negative')
   end subroutine require_traits

   !> Check the requirements of a call.
   pure subroutine require_question(traits, nlane, ndof, nnoise, t, w)
      type(model_traits), intent(in) :: traits
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise)
      character(*), parameter :: place = 'model, question'

      call require(nlane >= 1 .and. ndof == traits%ndof .and. nnoise == traits%nnoise, place, &
                   'lanes, degrees of freedom and noises are those of the model')
      call require(abs(t) <= huge(t), place, 'times are finite')
      call require_finite(size(w), w, place, 'weights')
   end subroutine require_question

   !> Check the number of real lanes in a view, if there is padding.
   pure subroutine require_real_lanes(nlane, nreal)
      integer, intent(in) :: nlane, nreal

      call require(nreal >= 1 .and. nreal <= nlane/2, 'model, real lanes', &
                   'one lane at least is real, and half of the lanes at most')
   end subroutine require_real_lanes

end module symsde_model_contract
