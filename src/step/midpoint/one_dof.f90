! SPDX-License-Identifier: BSD-3-Clause
!> The implicit midpoint rule for any model of one degree of freedom, for blocks of paths: the body is one_dof.inc.
!>
!>    F = Hhat_p(Q,P),   G = -Hhat_q(Q,P),   Q = q_n + F/2,   P = p_n + G/2,   dq = F,   dp = G
!>
!> Here is how the model of a block is asked, by one call for all lanes: once for Hhat_p(p_n), where that is the first
!> guess of F, and in every iteration for the gradient and the second derivatives of Hhat at (Q, P), of which the body
!> makes the correction of both unknowns. Lanes that are done are asked for along with the others.
module symsde_step_midpoint_one_dof
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_model_abstract, only: angle_terms
   use symsde_scheme_scheme, only: correction_none
   use symsde_solve_newton, only: newton_type, new_newton, start, judge
   use symsde_solve_stagnation, only: seen, restart_lanes
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

   !> Hhat_p (nlane, 1) of separable Hamiltonians, which does not depend on q: the first guess of F. The force is not
   !> asked for, so this costs nothing where H = p.p/2 + U(q) and noise is in position.
   subroutine find_velocity(self, tm, w, q, p, hp)
      type(midpoint_one_dof_stepper), intent(inout) :: self
      real(wp), intent(in) :: tm, w(self%ham%nlane, 0:self%ham%nnoise), q(self%ham%nlane, 1), p(self%ham%nlane, 1)
      real(wp), intent(out) :: hp(self%ham%nlane, 1)

      call self%ham%velocity(tm, w, q, p, hp)
   end subroutine find_velocity

   !> Gradient and Hessian at (q, p), into the arrays of the stepper. The Hessian is set to zero for a fixed-point
   !> iteration, whose step is then Newton's with the matrix I, and Hhat_qp stays zero for a separable model. A block
   !> keeps nothing from one iteration to the next, so it does not matter which one is the first.
   subroutine evaluate(self, tm, w, q, p, first)
      type(midpoint_one_dof_stepper), intent(inout) :: self
      real(wp), intent(in) :: tm, w(self%ham%nlane, 0:self%ham%nnoise), q(self%ham%nlane, 1), p(self%ham%nlane, 1)
      logical, intent(in) :: first  !! of this step

      if (self%newton%options%fixed_point > 0) then
         call self%ham%gradient(tm, w, q, p, self%hq, self%hp)
         self%hqq = 0
         self%hpp = 0
      else if (self%separable) then
         call self%ham%gradient_hessian(tm, w, q, p, self%hq, self%hp, hqq=self%hqq, hpp=self%hpp)
      else
         call self%ham%gradient_hessian(tm, w, q, p, self%hq, self%hp, self%hqq, self%hqp, self%hpp)
      end if
   end subroutine evaluate

end module symsde_step_midpoint_one_dof
