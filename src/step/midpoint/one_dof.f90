! SPDX-License-Identifier: BSD-3-Clause
!> The implicit midpoint rule for any model of one degree of freedom, for blocks of paths: the body is one_dof.inc.
!>
!>    F = Hhat_p(Q,P),   G = -Hhat_q(Q,P),   Q = q_n + F/2,   P = p_n + G/2,   dq = F,   dp = G
!>
!> One call of the model evaluates all lanes, including lanes that are done.
module symsde_step_midpoint_one_dof
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_model_kernels, only: angle_terms
   use symsde_scheme_scheme, only: correction_none
   use symsde_solve_newton, only: newton_type, new_newton, start, judge
   use symsde_solve_stagnation, only: seen, restart_lanes
   use symsde_step_midpoint_angle, only: find_angle_velocity, find_angle_point
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: midpoint_one_dof_stepper, midpoint_one_dof_fits

   include 'one_dof.inc'
   include '../../solve/all_lanes.inc'

   !> Whether this stepper executes the task: the plain midpoint rule of one degree of freedom.
   logical function midpoint_one_dof_fits(task) result(fits)
      type(stepper_task), intent(in) :: task

      fits = task%is_plain() .and. task%scheme%is_midpoint() .and. task%model%traits%ndof == 1
   end function midpoint_one_dof_fits

end module symsde_step_midpoint_one_dof
