! SPDX-License-Identifier: BSD-3-Clause
!> The energy-drift-preserving scheme for a single path: mean_force.inc with one lane. Its unknown is X = Psi - p_n of
!> Psi = p_n + g - (h/2) int_0^1 V'(q_n + s h Psi) ds, as in a block, and its bits are those of a block.
!>
!> Two degrees of freedom take 1.15 to 1.2 times as long as earlier code with scalars written out by hand, chains of
!> eight and more 1.0 to 1.1 times: the force of each node takes two calls, and is added up in memory. Sweeps and
!> matrices are those of step/midpoint/dense_single_path.
module symsde_step_midpoint_mean_force_single_path
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_traits, only: dense
   use symsde_scheme_scheme, only: correction_none
   use symsde_step_midpoint_dense_single_path, only: dense_midpoint, find_force_stiffness
   use symsde_step_midpoint_equation, only: midpoint_equation, position
   use symsde_step_hamiltonian_noise_shift, only: noise_shift, new_noise_shift
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian, new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task, few_of
   implicit none
   private
   public :: mean_force_stepper

   include 'mean_force.inc'
   include '../../solve/one_lane.inc'

end module symsde_step_midpoint_mean_force_single_path
