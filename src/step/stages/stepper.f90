! SPDX-License-Identifier: BSD-3-Clause
!> Implicit schemes of several stages for blocks, by stepper.inc:
!>
!>    Q_i = q_n + sum_j a_ij Hhat_p(Q_j, P_j)        P_i = p_n - sum_j abar_ij Hhat_q(Q_j, P_j)
!>
!> A block is taken through the step part by part: all slopes of a part are found and added before the next part begins.
!> A part has so few lanes that the arrays of its iteration, (width, ndof) for every stage, stay in cache. The bits of a
!> lane do not depend on its part: its numbers of sweeps and its corrections depend on the lane alone.
module symsde_step_stages_stepper
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
   use symsde_step_midpoint_eliminated, only: midpoint_stepper, new_midpoint_stepper, by_products
   use symsde_step_midpoint_full, only: midpoint_full_stepper, new_midpoint_full_stepper
   use symsde_step_stages_equations, only: stage_equations, new_stage_equations, iterate_group, solved, untried
   use symsde_step_stages_groups, only: stage_group
   use symsde_step_stages_newton, only: stage_newton, new_stage_newton
   use symsde_step_stages_tridiagonal, only: tridiagonal_stages, new_tridiagonal_stages, fits_tridiagonal_stages, &
                                             solves_at_once
   use symsde_step_stepper, only: stepper_type, stepper_task, few_of, most_single
   implicit none
   private
   public :: stages_stepper, stages_fits, fits_stages

   include 'stepper.inc'

   ! ---- procedures that differ between a block and a path by itself --------------------------------

   !> Number of lanes of a part, not of the block.
   pure integer function lanes(self)
      class(stages_stepper), intent(in) :: self

      lanes = self%width
   end function lanes

   !> One step of the block, part by part, each from its own (q_n, p_n) to its own increments; the counts of the parts
   !> are collected at the end.
   subroutine increment(self, step, q, p, dq, dp, status)
      class(stages_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      integer :: first, last

      do first = 1, self%ham%nlane, self%width
         ! There is one set of equations and solvers, which every part uses again.
         last = first + self%width - 1
         call self%ham%narrow(first, self%width)
         call take_part(self, first, step, q, p, self%dq, self%dp, status(first:last))
         call self%ham%widen()
         dq(first:last, :) = self%dq
         dp(first:last, :) = self%dp
      end do
      call add_counters(self%ham%counters, self%equations%ham%counters)
      self%equations%ham%counters = counters_type()
   end subroutine increment

end module symsde_step_stages_stepper
