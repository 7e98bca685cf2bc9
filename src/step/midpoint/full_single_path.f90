! SPDX-License-Identifier: BSD-3-Clause
!> The implicit midpoint rule for any model and a single path, by full.inc with one lane:
!>
!>    F = Hhat_p(Q, P),   G = -Hhat_q(Q, P),   Q = q_n + F/2,   P = p_n + G/2,   dq = F,   dp = G
!>
!> A path has the bits that it has in a block. Its sweeps read weights and state in place: a block copies those of the
!> few lanes taken together, so that they stay in cache, but a single path needs no copies.
module symsde_step_midpoint_full_single_path
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lane_unit, lanes_together
   use symsde_base_record, only: step_record
   use symsde_base_traits, only: model_traits, dense
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: bracket_terms, correction_none
   use symsde_solve_fixed_point_single_path, only: take, judge_sweep, most_sweeps, stiff_rate, done
   use symsde_solve_newton, only: newton_type, newton_options, new_newton
   use symsde_solve_newton_single_path, only: update
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian, new_one_step_hamiltonian
   use symsde_step_implicit_newton_krylov, only: newton_krylov, new_newton_krylov, &
                                                 does_without_matrices, iterates_first
   use symsde_step_stepper, only: stepper_type, stepper_task, few_of
   implicit none
   private
   public :: midpoint_full_stepper, new_midpoint_full_stepper

   include 'full.inc'
   include '../../solve/one_lane.inc'

   !> Increments of a path whose sweeps contract, with self%left = -1; else self%left = 0, and Newton's iteration
   !> starts again.
   subroutine sweep_all(self, ham, t, w, q, p, dq, dp, status)
      type(fixed_point_sweeps), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      real(wp), intent(in) :: t, w(1, 0:ham%nnoise)
      real(wp), intent(in), dimension(1, ham%ndof) :: q, p
      real(wp), intent(out), dimension(1, ham%ndof) :: dq, dp
      integer(i8), intent(in) :: status(1)

      call sweep_lanes(self, ham, t, w, q, p, 1, status)
      ! Columns 1 .. n of g hold G, columns n + 1 .. 2 n hold -F.
      dq = -self%g(:, ham%ndof + 1:)
      dp = self%g(:, :ham%ndof)
      ! A path that had a status before is not solved by Newton either.
      self%left = merge(0_i8, -1_i8, status == 0 .and. .not. abs(self%last - done) <= 0)
   end subroutine sweep_all

end module symsde_step_midpoint_full_single_path
