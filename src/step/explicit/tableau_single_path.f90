! SPDX-License-Identifier: BSD-3-Clause
!> Explicit steps of a single path: tableau.inc with one lane, for models that give gradients. lanes(self) is the
!> constant 1, which gfortran folds into the bounds of the body: loops over lanes vanish, and no pass is padded to a
!> whole vector. The bits are the bits of a lane of a block.
module symsde_step_explicit_tableau_single_path
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_traits, only: model_traits
   use symsde_base_vectors, only: scale
   use symsde_scheme_decays, only: tableau_decays, new_decays
   use symsde_scheme_scheme, only: scheme_type, correction_none, ito_form
   use symsde_step_explicit_evaluation_order, only: evaluation_order, new_explicit_plan, add_slopes, to_q, &
                                                    to_p
   use symsde_step_explicit_tableau, only: room_type
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task, few_of
   implicit none
   private
   public :: explicit_stepper

   ! The body, and its calls of the model by gradients.
   include 'tableau.inc'
   include 'tableau_decays.inc'
   include 'tableau_gradients.inc'

   !> One path, which the compiler knows.
   pure integer function lanes(self)
      type(explicit_stepper), intent(in) :: self

      lanes = 1
   end function lanes

end module symsde_step_explicit_tableau_single_path
