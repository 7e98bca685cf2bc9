! SPDX-License-Identifier: BSD-3-Clause
!> Newton's iteration for implicit stages of a single path, by newton.inc with one lane. solve/newton_single_path solves
!> small dense systems in place, overwriting the matrix. A system whose pivots are not trusted is formed again, and
!> solved with exchanges of rows.
!>
!> Private to its family.
module symsde_step_stages_newton_single_path
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: take_where
   use symsde_base_traits, only: model_traits, dense
   use symsde_solve_newton, only: newton_type, newton_options, new_newton
   use symsde_solve_newton_single_path, only: update
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   use symsde_step_implicit_newton_krylov, only: newton_krylov, new_newton_krylov, pays_by_products
   use symsde_step_stages_equations_single_path, only: stage_equations
   use symsde_step_stages_groups, only: stage_group
   implicit none
   private
   public :: stage_newton, new_stage_newton

   include 'newton.inc'

   !> One lane: a constant, which the compiler folds into the bounds of loops.
   pure integer function lanes(equations)
      type(stage_equations), intent(in) :: equations

      lanes = 1
   end function lanes

   !> Hhat_q (n) and the Hessian Hhat_qq at (t, q), dense (n, n) or its upper bands (0:band, n). Two degrees of freedom
   !> are evaluated as scalars. The stiffness of a chain is evaluated in two equal lanes: with one lane its model may
   !> round like its rows, and not like the lanes of a block.
   subroutine ask_model(ham, band, t, w, q, p, hq, k)
      type(one_step_hamiltonian), intent(in) :: ham
      integer, intent(in) :: band
      real(wp), intent(in) :: t, w(0:ham%nnoise), q(ham%ndof), p(ham%ndof)
      real(wp), intent(out) :: hq(ham%ndof)
      real(wp), intent(out) :: k(ham%ndof*merge(ham%ndof, band + 1, band == dense))
      real(wp), allocatable :: stiffness(:, :), force(:, :)

      associate (n => ham%ndof)
         if (band /= dense) then
            allocate (force(2, n), stiffness(2, (band + 1)*n))
            call ham%bare_force_stiffness(2, band, t, spread(w, 1, 2), spread(q, 1, 2), spread(p, 1, 2), force, &
                                          stiffness)
            ! Both lanes have the same numbers; the first is used.
            hq = force(1, :)
            k(:(band + 1)*n) = stiffness(1, :)
         else if (n == 2) then
            ! Six numbers, without array arguments.
            call ham%bare_pair(t, w, q(1), q(2), hq(1), hq(2), k(1), k(2), k(3), k(4))
         else
            ! Evaluate any other dense Hessian for one lane.
            call ham%bare_gradient_hessian(1, t, w, q, p, hq=hq, hqq=k)
         end if
      end associate
   end subroutine ask_model

end module symsde_step_stages_newton_single_path
