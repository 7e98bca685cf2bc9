! SPDX-License-Identifier: BSD-3-Clause
!> The eliminated midpoint of a single path by matrices or by fixed-point iterations: dense.inc with one lane.
!>
!> The kernels and the Newton iteration come by `include`, not by `use`: what a module sees of its own is inlined in
!> its loops, and an iteration of two unknowns takes as long as a handful of calls.
!>
!> Private to its family.
module symsde_step_midpoint_dense_single_path
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_traits, only: dense
   use symsde_base_vectors, only: add_times
   use symsde_model_abstract, only: model_type, angle_terms
   use symsde_solve_damping, only: start_damping
   use symsde_solve_newton, only: newton_type, newton_options, new_newton, patience, mark, stop_lanes
   use symsde_solve_newton_single_path, only: update
   use symsde_solve_stagnation, only: stopping_test, iterate_scalar, done, failed
   use symsde_step_midpoint_angle, only: find_angle_force
   use symsde_step_midpoint_equation, only: midpoint_equation, midpoint_part
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   use symsde_solve_fixed_point_single_path, only: take_first, take, judge_sweep, most_sweeps, &
                                                   stiff_rate, swept => done
   implicit none
   private
   public :: dense_midpoint, new_dense_midpoint, solve_contracting, solve_by_matrices, find_force_stiffness

   include 'dense.inc'
   include 'equation.inc'
   include '../../solve/newton.inc'
   include '../../solve/newton_scalar.inc'
   include '../../solve/stagnation.inc'
   include '../../solve/stagnation_scalar.inc'
   include '../../solve/one_lane.inc'

   !> Hhat_q (n) and Hhat_qq (n, n) at q, with momenta zero, on which they do not depend. Two unknowns are asked for
   !> as numbers, without arrays. A Hamiltonian of one angle is asked once a step, at its first iteration, for the
   !> terms of which force and stiffness are made; these do not depend on q, so later iterations take a sine and a
   !> cosine alone.
   subroutine find_force_stiffness(self, model, eq, w, q, hq, hqq)
      class(dense_midpoint), intent(inout) :: self
      class(model_type), intent(in) :: model
      type(midpoint_equation), intent(in) :: eq
      real(wp), intent(in) :: w(0:eq%m), q(eq%n)
      real(wp), intent(out) :: hq(eq%n), hqq(eq%n, eq%n)

      ! Two unknowns have a procedure that takes and returns numbers, with the bits of the general one.
      if (eq%n == 2) then
         call model%pair(eq%m, eq%t, w, q(1), q(2), hq(1), hq(2), hqq(1, 1), hqq(2, 1), hqq(1, 2), hqq(2, 2))
      else if (model%traits%has_angle_terms) then
         ! The terms serve the equation of V and, in a noncontracting step, that of dq: h, dW and the time are the
         ! same in both.
         if (self%newton%iteration == 0 .and. .not. eq%for_dq) call model%angle(eq%m, eq%t, w, self%terms)
         call find_angle_force(self%terms, q(1), hq(1), hqq(1, 1))
      else
         call model%gradient_hessian(1, eq%n, eq%m, eq%t, w, q, eq%still, hq=hq, hqq=hqq)
      end if
   end subroutine find_force_stiffness

end module symsde_step_midpoint_dense_single_path
