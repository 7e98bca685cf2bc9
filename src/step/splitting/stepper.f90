! SPDX-License-Identifier: BSD-3-Clause
!> Drifts and kicks of a block of paths: alternately x <- x + tau_i M^-1 y and y <- y - f_i, by the equations of
!> stepper.inc.
!>
!> Weights are computed step by step, since the lanes of a block fill vectors in any case. Every force and every
!> derivative is evaluated by one call of the model for all lanes. Kicks never change a status; midpoint steps between
!> kicks may.
module symsde_step_splitting_stepper
   use symsde_base_counters, only: counters_type, add_counters
   use symsde_base_kinds, only: wp, i8
   use symsde_base_matrices, only: add_matrix => add_product
   use symsde_base_record, only: step_record, steps_record
   use symsde_base_sincos, only: sincos_one
   use symsde_base_vectors, only: add, subtract, add_times, copy, scale
   use symsde_model_kernels, only: angle_terms
   use symsde_scheme_kicks, only: flow_free, flow_rotation, flow_midpoint
   use symsde_scheme_scheme, only: correction_none
   use symsde_step_splitting_bond_turns, only: bond_turns, new_bond_turns
   use symsde_step_splitting_drift, only: drift_flow, new_drift_flow
   use symsde_step_splitting_coefficients, only: kick_weights, new_kick_weights, add_product
   use symsde_step_splitting_midpoint_drift, only: midpoint_flow, new_midpoint_flow
   use symsde_step_splitting_turns, only: action_turns, new_action_turns
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_open_linear_noise, only: linear_noise, new_linear_noise
   use symsde_step_stepper, only: stepper_type, stepper_task, few_of
   implicit none
   private
   public :: splitting_stepper

   !> Results that a stepper computes before the steps of a call. A block has none: its lanes fill vectors in every
   !> step.
   type :: ahead_type
   end type ahead_type

   include 'stepper.inc'
   include 'derivatives.inc'
   include 'products.inc'

   !> Number of lanes of the block.
   pure integer function lanes(self)
      type(splitting_stepper), intent(in) :: self

      lanes = self%ham%nlane
   end function lanes

   !> Compute weights ahead: a block does nothing here, since its lanes are weighed together in each step.
   subroutine prefetch(self, steps)
      class(splitting_stepper), intent(inout), target :: self
      type(steps_record), intent(in) :: steps
   end subroutine prefetch

end module symsde_step_splitting_stepper
