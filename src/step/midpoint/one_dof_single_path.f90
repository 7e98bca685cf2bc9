! SPDX-License-Identifier: BSD-3-Clause
!> The implicit midpoint rule for any model of one degree of freedom and a single path: one_dof.inc with one lane.
!>
!>    F = Hhat_p(Q,P),   G = -Hhat_q(Q,P),   Q = q_n + F/2,   P = p_n + G/2,   dq = F,   dp = G
!>
!> The Hamiltonian of one angle is asked for its terms once a step (step/midpoint/angle), with the weights h, dW and
!> the time of the middle. An iteration then takes one sine and one cosine and calls no model. Any other model is
!> asked as for a block, by calls for one lane.
module symsde_step_midpoint_one_dof_single_path
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_model_abstract, only: angle_terms
   use symsde_scheme_scheme, only: correction_none
   use symsde_solve_damping, only: start_damping
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

   !> Hhat_p of separable Hamiltonians, the first guess of F. With terms of an angle it is e p; the terms are asked
   !> for here and serve the whole step, whose iterations find them in self%terms.
   subroutine find_velocity(self, tm, w, q, p, hp)
      type(midpoint_one_dof_stepper), intent(inout) :: self
      real(wp), intent(in) :: tm, w(1, 0:self%ham%nnoise), q(1, 1), p(1, 1)
      real(wp), intent(out) :: hp(1, 1)
      real(wp) :: unused

      if (self%ham%model%traits%has_angle_terms) then
         call self%ham%model%angle(self%ham%nnoise, tm, w, self%terms)
         call find_angle_velocity(self%terms, p(1, 1), hp(1, 1), unused)
         self%ham%counters%gradients = self%ham%counters%gradients + 1
      else
         call self%ham%velocity(tm, w, q, p, hp)
      end if
   end subroutine find_velocity

   !> Gradient and Hessian at (q, p), by the terms of an angle, which are asked for once a step. The Hessian is zero for
   !> a fixed-point iteration, as the mixed derivative of a separable model is.
   subroutine evaluate(self, tm, w, q, p, first)
      type(midpoint_one_dof_stepper), intent(inout) :: self
      real(wp), intent(in) :: tm, w(1, 0:self%ham%nnoise), q(1, 1), p(1, 1)
      logical, intent(in) :: first  !! of this step

      ! The order of the questions: a given number of fixed-point iterations needs the gradient alone, as in a block;
      ! then an angle; then separable models, whose Hhat_qp stays zero; then all others.
      if (self%newton%options%fixed_point > 0) then
         call self%ham%gradient(tm, w, q, p, self%hq, self%hp)
         self%hqq = 0
         self%hpp = 0
      else if (self%separable .and. self%ham%model%traits%has_angle_terms) then
         ! In a step that began with the velocity the terms are there already. Gradients and Hessians are counted as
         ! they are where the model is asked for them.
         if (first) call self%ham%model%angle(self%ham%nnoise, tm, w, self%terms)
         self%ham%counters%gradients = self%ham%counters%gradients + 1
         self%ham%counters%hessians = self%ham%counters%hessians + 1
         call find_angle_point(self%terms, q(1, 1), p(1, 1), self%hq(1, 1), self%hp(1, 1), self%hqq(1, 1, 1), &
                               self%hpp(1, 1, 1))
      else if (self%separable) then
         call self%ham%gradient_hessian(tm, w, q, p, self%hq, self%hp, hqq=self%hqq, hpp=self%hpp)
      else
         call self%ham%gradient_hessian(tm, w, q, p, self%hq, self%hp, self%hqq, self%hqp, self%hpp)
      end if
   end subroutine evaluate

end module symsde_step_midpoint_one_dof_single_path
