! SPDX-License-Identifier: BSD-3-Clause
!> Implicit schemes of several stages for a single path, by stepper.inc with one lane, which is one part:
!>
!>    Q_i = q_n + sum_j a_ij Hhat_p(Q_j, P_j)        P_i = p_n - sum_j abar_ij Hhat_q(Q_j, P_j)
!>
!> If sweeps are cheap, many are taken at once (sweeps_ahead); a step that these sweeps do not finish is started again
!> by the body. Both have the bits of a lane of a block, and both find slopes group after group.
module symsde_step_stages_stepper_single_path
   use symsde_base_damping, only: damping_type
   use symsde_base_counters, only: counters_type, add_counters
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lane_unit, lanes_together, take_where
   use symsde_base_memory, only: memory_for
   use symsde_base_record, only: step_record
   use symsde_base_status, only: not_converged
   use symsde_base_traits, only: strip_lanes
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type, tableau_form, correction_none
   use symsde_solve_fixed_point, only: stiff_rate
   use symsde_solve_newton, only: newton_options
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_oracle_general, only: general_stepper, new_general_stepper
   use symsde_step_implicit_newton_krylov, only: does_without_matrices
   use symsde_step_midpoint_eliminated_single_path, only: midpoint_stepper, new_midpoint_stepper, by_products
   use symsde_step_midpoint_full, only: midpoint_full_stepper, new_midpoint_full_stepper
   use symsde_step_stages_equations_single_path, only: stage_equations, new_stage_equations, iterate_group, solved, &
                                                       untried
   use symsde_step_stages_groups, only: stage_group
   use symsde_step_stages_newton_single_path, only: stage_newton, new_stage_newton
   use symsde_step_stages_tridiagonal_single_path, only: tridiagonal_stages, new_tridiagonal_stages, &
                                                         fits_tridiagonal_stages, solves_at_once
   use symsde_step_stepper, only: stepper_type, stepper_task, few_of, most_single
   implicit none
   private
   public :: stages_stepper, stages_fits, fits_stages

   ! The body. This module defines `lanes` and `increment` below.
   include 'stepper.inc'

   ! ---- procedures that differ between a path by itself and a block --------------------------------

   !> One lane, which the compiler knows.
   pure integer function lanes(self)
      class(stages_stepper), intent(in) :: self

      lanes = 1
   end function lanes

   !> One step: by sweeps ahead if they exist and finish the step, else by the body, from the same (q_n, p_n).
   subroutine increment(self, step, q, p, dq, dp, status)
      class(stages_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)

      logical :: taken

      ! Sweeps ahead exist at most where momenta are eliminated, M is the identity, and Hhat_p is h p alone (C = 0 in
      ! step/stages/equations).
      if (allocated(self%equations%ahead)) then
         ! Nothing is counted if these sweeps do not finish the step.
         call self%equations%ahead%take(self%ham, self%equations%shift, step, too_stiff_for(self), q, p, dq, &
                                        dp, taken)
         if (taken) return
      end if
      ! `tally` adds up the counters of the equations, not every step.
      call take_part(self, 1, step, q, p, dq, dp, status)
   end subroutine increment

end module symsde_step_stages_stepper_single_path
