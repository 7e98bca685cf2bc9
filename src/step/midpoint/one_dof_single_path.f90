! SPDX-License-Identifier: BSD-3-Clause
!> The implicit midpoint rule for any model of one degree of freedom and a single path: one_dof.inc with one lane.
!>
!>    F = Hhat_p(Q,P),   G = -Hhat_q(Q,P),   Q = q_n + F/2,   P = p_n + G/2,   dq = F,   dp = G
!>
!> For the Hamiltonian of an angle the terms are evaluated once per step (step/midpoint/angle), with the weights h, dW
!> and the time of the middle. An iteration then takes one sine and one cosine and no call of the model. Any other model
!> is called as for a block, for one lane.
module symsde_step_midpoint_one_dof_single_path
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_model_kernels, only: angle_terms
   use symsde_scheme_scheme, only: correction_none
   use symsde_solve_shortening, only: start_shortening
   use symsde_solve_newton, only: newton_type, new_newton, mark, stop_lanes
   use symsde_solve_stagnation, only: stopping_test, seen, done, failed, restart_lanes
   use symsde_step_midpoint_angle, only: find_angle_velocity, find_angle_point
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: midpoint_one_dof_stepper

   include 'one_dof.inc'
   include '../../solve/newton.inc'
   include '../../solve/stagnation.inc'
   include '../../solve/one_lane.inc'

end module symsde_step_midpoint_one_dof_single_path
