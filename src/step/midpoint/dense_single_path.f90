! SPDX-License-Identifier: BSD-3-Clause
!> The eliminated midpoint of a single path by matrices or by fixed-point iterations: dense.inc with one lane. The
!> kernels and the Newton iteration come by `include`, not by `use`, since the compiler inlines procedures of the same
!> module in its loops, and an iteration of two unknowns takes only as long as a few calls. Private to its family.
module symsde_step_midpoint_dense_single_path
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_traits, only: dense
   use symsde_base_vectors, only: add_times
   use symsde_model_abstract, only: model_type
   use symsde_model_kernels, only: angle_terms, differences_alone
   use symsde_solve_shortening, only: start_shortening
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
   public :: dense_midpoint, find_force_stiffness

   include 'dense.inc'
   include 'equation.inc'
   include '../../solve/newton.inc'
   include '../../solve/newton_scalar.inc'
   include '../../solve/stagnation.inc'
   include '../../solve/stagnation_scalar.inc'
   include '../../solve/one_lane.inc'

end module symsde_step_midpoint_dense_single_path
