! SPDX-License-Identifier: BSD-3-Clause
!> The eliminated midpoint of blocks,
!>
!>    x + f(base + c x) = 0,     for V with c = h/4, f = Hhat_q;   for dq with c = 1/2, f = (h/2) Hhat_q - (h p_n + g),
!>
!> by matrices I + (h/4) K or, for V, by the fixed-point iteration first: the body is dense.inc. The passes over lanes
!> are called from other modules, while the module for a single path includes their source: for a block a call takes
!> little time.
!>
!> Private to its family.
module symsde_step_midpoint_dense
   use symsde_base_kinds, only: wp, i8
   use symsde_base_traits, only: dense
   use symsde_base_vectors, only: add_times
   use symsde_model_abstract, only: model_type
   use symsde_model_kernels, only: angle_terms, differences_alone
   use symsde_solve_newton, only: newton_options, new_newton, start, update, judge, first_scalar, &
                                  update_scalar
   use symsde_step_midpoint_angle, only: find_angle_force
   use symsde_step_midpoint_equation, only: midpoint_equation, midpoint_part, position, correct_pair, weigh_force
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   use symsde_solve_fixed_point, only: take_first, take, judge_sweep, most_sweeps, stiff_rate, swept => done
   implicit none
   private
   public :: dense_midpoint, find_force_stiffness

   include 'dense.inc'
   include '../../solve/all_lanes.inc'

end module symsde_step_midpoint_dense
