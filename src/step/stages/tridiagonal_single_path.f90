! SPDX-License-Identifier: BSD-3-Clause
!> Newton's iteration for stages of a chain, for a single path, by tridiagonal.inc. The path takes a strip in which one
!> lane is running, and all others are skipped.
!>
!> Private to its family.
module symsde_step_stages_tridiagonal_single_path
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: take_where
   use symsde_base_status, only: singular
   use symsde_base_traits, only: model_traits, strip_lanes
   use symsde_model_abstract, only: model_type
   use symsde_model_kernels, only: has_exact_stiffness
   use symsde_solve_block_tridiagonal, only: eliminate_down_blocks, correct_up_blocks, site_above, new_site_above
   use symsde_solve_newton, only: newton_type, newton_options, new_newton
   use symsde_solve_tridiagonal, only: upper_rows, eliminate_down_strip, eliminate_up_strip, meet_strip, &
                                       correct_strip, before_first_row, nfront
   use symsde_step_stages_equations_single_path, only: stage_equations, slow, stiff
   use symsde_step_stages_groups, only: stage_group
   implicit none
   private
   public :: tridiagonal_stages, new_tridiagonal_stages, fits_tridiagonal_stages, solves_at_once

   include 'tridiagonal.inc'
end module symsde_step_stages_tridiagonal_single_path
