! SPDX-License-Identifier: BSD-3-Clause
!> Explicit steps of a block of paths,
!>
!>    Q_i = q_n + sum_j a_ij Hhat_p(Q_j, P_j),   P_i = p_n - sum_j abar_ij Hhat_q(Q_j, P_j),   stage after stage:
!>
!> the equations are in tableau.inc, and the calls of the model in tableau_gradients.inc. Arrays are (nlane, ndof), so
!> that a kernel over all their numbers is one loop, vectorised for any ndof.
module symsde_step_explicit_tableau
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_traits, only: model_traits
   use symsde_base_vectors, only: scale
   use symsde_scheme_decays, only: tableau_decays, new_decays
   use symsde_scheme_scheme, only: scheme_type, correction_none, ito_form
   use symsde_step_explicit_evaluation_order, only: evaluation_order, new_explicit_plan, add_slopes, to_q, &
                                                    to_p
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task, few_of
   implicit none
   private
   public :: explicit_stepper, explicit_fits, decays_here, room_type

   !> The slopes f and v of a stage, and a point (x, y) = (Q_i, P_i).
   type :: room_type
      real(wp), allocatable, dimension(:, :) :: f, v, x, y  !! (nlane, ndof)
   contains
      procedure :: make => make_room
   end type room_type

   include 'tableau.inc'
   include 'tableau_decays.inc'
   include 'tableau_gradients.inc'

   !> Allocate the slopes of a stage and one point, for blocks of nlane lanes.
   subroutine make_room(self, nlane, ndof)
      class(room_type), intent(inout) :: self
      integer, intent(in) :: nlane, ndof

      allocate (self%f(nlane, ndof), self%v(nlane, ndof), self%x(nlane, ndof), self%y(nlane, ndof))
   end subroutine make_room

   !> Whether an explicit stepper executes the task: for this model a stage needs only earlier stages, and Hhat has no
   !> brackets or correction, which may couple q and p even if the model is separable.
   logical function explicit_fits(task) result(fits)
      type(stepper_task), intent(in) :: task

      fits = task%follows
      if (fits) fits = task%is_plain()
   end function explicit_fits

   !> Number of paths of the block, for the bounds of arrays.
   pure integer function lanes(self)
      type(explicit_stepper), intent(in) :: self

      lanes = self%ham%nlane
   end function lanes

end module symsde_step_explicit_tableau
