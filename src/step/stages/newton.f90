! SPDX-License-Identifier: BSD-3-Clause
!> Newton's iteration for implicit stages in a few lanes of a block, by newton.inc. One call evaluates gradient and
!> Hessian of all lanes; lanes that are done are not corrected.
!>
!> Private to its family.
module symsde_step_stages_newton
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: take_where
   use symsde_base_traits, only: model_traits, dense
   use symsde_solve_newton, only: newton_type, newton_options, new_newton, update
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   use symsde_step_implicit_newton_krylov, only: newton_krylov, new_newton_krylov, pays_by_products
   use symsde_step_stages_equations, only: stage_equations
   use symsde_step_stages_groups, only: stage_group
   implicit none
   private
   public :: stage_newton, new_stage_newton

   include 'newton.inc'

   !> Number of lanes of a part of the block.
   pure integer function lanes(equations)
      type(stage_equations), intent(in) :: equations

      lanes = equations%ham%nlane
   end function lanes

   !> Hhat_q and the Hessian Hhat_qq at (t, q), dense (nlane, n, n) or its upper bands (nlane, 0:band, n), by one call
   !> of the model for all lanes. p is irrelevant, since momenta are eliminated.
   subroutine ask_model(ham, band, t, w, q, p, hq, k)
      type(one_step_hamiltonian), intent(in) :: ham
      integer, intent(in) :: band
      real(wp), intent(in) :: t, w(ham%nlane, 0:ham%nnoise), q(ham%nlane, ham%ndof), p(ham%nlane, ham%ndof)
      real(wp), intent(out) :: hq(ham%nlane, ham%ndof)
      real(wp), intent(out) :: k(ham%nlane*ham%ndof*merge(ham%ndof, band + 1, band == dense))

      ! K is requested in the form of the matrix: n^2 entries, or the diagonal and the bands above it.
      if (band == dense) then
         call ham%bare_gradient_hessian(ham%nlane, t, w, q, p, hq=hq, hqq=k)
      else
         call ham%bare_force_stiffness(ham%nlane, band, t, w, q, p, hq, k)
      end if
   end subroutine ask_model

end module symsde_step_stages_newton
