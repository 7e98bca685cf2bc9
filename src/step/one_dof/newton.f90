! SPDX-License-Identifier: BSD-3-Clause
!> Newton's iteration for the slopes of all stages of one degree of freedom, in a block of lanes, by newton.inc. One
!> call evaluates the model or its brackets for all lanes at one stage, and one call of the block's solver solves all
!> systems. Lanes that are done are computed too but not changed.
!>
!> Private to its family.
module symsde_step_one_dof_newton
   use symsde_base_counters, only: counters_type
   use symsde_base_damping, only: damping_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_model_kernels, only: angle_terms
   use symsde_scheme_decays, only: tableau_decays, new_decays
   use symsde_scheme_scheme, only: scheme_type
   use symsde_solve_blocks, only: block_solver, new_block_solver
   use symsde_solve_newton, only: newton_type, newton_options, new_newton, start, judge
   use symsde_solve_stagnation, only: correct_lanes, restart_lanes
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   use symsde_step_midpoint_angle, only: find_angle_velocity, find_angle_point
   use symsde_step_one_dof_brackets, only: single_brackets, new_single_brackets, q_, p_, qq, qp, pp, nplace
   use symsde_step_one_dof_brackets_angle_single_path, only: evaluate_angle
   use symsde_step_stages_slope_sums, only: sum_slopes => add_slopes
   implicit none
   private
   public :: one_dof_newton, new_one_dof_newton, resume

   interface solve_systems  !! all lanes of a block together
      module procedure :: solve_by_lanes
   end interface solve_systems

   include 'newton.inc'
   include 'two_stages.inc'
   include '../../solve/all_lanes.inc'

   !> Continue the iteration of another block: lane l takes the slopes and the size of the last correction from lane
   !> places(l) of that block. Lanes with a status are skipped. `step` is the step of the gathered lanes. A lane
   !> computes the same numbers in the same order as in the large block, so it has the same bits.
   subroutine resume(self, ham, from, places, step, status)
      type(one_dof_newton), intent(inout) :: self
      type(one_step_hamiltonian), intent(in) :: ham
      type(one_dof_newton), intent(in) :: from
      integer, intent(in) :: places(self%nlane)
      type(step_record), intent(in) :: step
      integer(i8), intent(inout) :: status(self%nlane)

      ! Only slopes are carried over; points and derivatives are computed again in every iteration.
      self%x = from%x(places, :)
      call set_decays(self, step%h)
      call start(self%newton, status)
      ! Brackets keep data of each lane during a step: compute these data for the gathered lanes.
      if (allocated(self%brackets)) call self%brackets%begin(ham%modified, step, self%c)
      ! continue with the last corrections and the number of the iteration
      self%newton%last = merge(from%newton%last(places), self%newton%last, status == 0)
      self%newton%iteration = from%newton%iteration
      self%first = from%first(places)
      self%from_velocity = from%from_velocity
   end subroutine resume

end module symsde_step_one_dof_newton
