! SPDX-License-Identifier: BSD-3-Clause
!> The implicit midpoint rule for any model, with q and p both unknown, for blocks of paths: F = Hhat_p(Q, P), G =
!> -Hhat_q(Q, P). The equations and their solution are in the body, full.inc.
!>
!> This file defines how the sweeps of a block run through its lanes: a few lanes at a time take all of their sweeps, in
!> arrays that stay in cache. A part of the block is done when its own lanes are, and does not wait for others. Newton's
!> iteration takes the whole block.
module symsde_step_midpoint_full
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lane_unit, lanes_together
   use symsde_base_record, only: step_record
   use symsde_base_traits, only: model_traits, dense
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: bracket_terms, correction_none
   use symsde_solve_fixed_point, only: take, judge_sweep, most_sweeps, stiff_rate, done
   use symsde_solve_newton, only: newton_type, newton_options, new_newton, update
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian, new_one_step_hamiltonian
   use symsde_step_implicit_newton_krylov, only: newton_krylov, new_newton_krylov, &
                                                 does_without_matrices, iterates_first
   use symsde_step_stepper, only: stepper_type, stepper_task, few_of
   implicit none
   private
   public :: midpoint_full_stepper, midpoint_full_fits, new_midpoint_full_stepper

   include 'full.inc'
   include '../../solve/all_lanes.inc'

   !> Whether this stepper executes the task: the midpoint rule if step/midpoint/eliminated and step/stages/stepper do
   !> not eliminate momenta. Shortened corrections and given numbers of iterations are executed for all models.
   logical function midpoint_full_fits(task) result(fits)
      type(stepper_task), intent(in) :: task

      fits = task%is_plain() .and. task%scheme%is_midpoint()
      associate (t => task%model%traits)
         ! Without shortened corrections and given numbers of iterations, a model whose momenta can be eliminated has
         ! faster steppers.
         if (task%newton%is_free()) &
            fits = fits .and. .not. (t%eliminates_momenta() .or. (t%ndof > 1 .and. t%divides_by_mass() .and. &
                                                                  .not. t%forces%act()))
      end associate
   end function midpoint_full_fits

   !> dq and dp of lanes without a status whose sweeps contract, part by part. self%left = 0 in lanes that were given
   !> up, else -1. The number of real paths in each part is passed to the counters.
   subroutine sweep_all(self, ham, t, w, q, p, dq, dp, status)
      type(fixed_point_sweeps), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      real(wp), intent(in) :: t, w(ham%nlane, 0:ham%nnoise)
      real(wp), intent(in), dimension(ham%nlane, ham%ndof) :: q, p
      real(wp), intent(out), dimension(ham%nlane, ham%ndof) :: dq, dp
      integer(i8), intent(in) :: status(ham%nlane)
      integer :: before

      do before = 0, ham%nlane - self%width, self%width
         associate (last => before + self%width, width => self%width, n => ham%ndof)
            ! Copy weights and states of these lanes, so that all sweeps read them from cache.
            self%w = w(before + 1:last, :)
            self%q = q(before + 1:last, :)
            self%p = p(before + 1:last, :)
            call ham%narrow(before + 1, width)
            call sweep_lanes(self, ham, t, self%w, self%q, self%p, max(0, min(width, ham%nreal - before)), &
                             status(before + 1:last))
            call ham%widen()
            ! Columns of g hold G, then -F.
            dq(before + 1:last, :) = -self%g(:, n + 1:)
            dp(before + 1:last, :) = self%g(:, :n)
            self%left(before + 1:last) = merge(0_i8, -1_i8, status(before + 1:last) == 0 .and. &
                                               .not. abs(self%last - done) <= 0)
         end associate
      end do
   end subroutine sweep_all

end module symsde_step_midpoint_full
