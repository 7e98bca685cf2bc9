! SPDX-License-Identifier: BSD-3-Clause
!> Newton's iteration for the slopes of all stages of one degree of freedom and a single path: newton.inc with one lane.
!>
!> Differences from a block: an angle's sine and cosine terms are computed once per step for every stage, so that the
!> iteration does not call the model; angles with brackets use step/one_dof/brackets_angle_single_path; systems are
!> eliminated as scalars. All of these have a block's bits.
!>
!> Private to its family.
module symsde_step_one_dof_newton_single_path
   use symsde_base_counters, only: counters_type
   use symsde_base_damping, only: damping_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_model_kernels, only: angle_terms
   use symsde_scheme_decays, only: tableau_decays, new_decays
   use symsde_scheme_scheme, only: scheme_type
   use symsde_solve_blocks, only: block_solver, new_block_solver, pivot_floor
   use symsde_solve_elimination_single_path, only: solve_scalar
   use symsde_solve_shortening, only: start_shortening
   use symsde_solve_newton, only: newton_type, newton_options, new_newton, mark, stop_lanes
   use symsde_solve_stagnation, only: stopping_test, done, failed
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   use symsde_step_midpoint_angle, only: find_angle_velocity, find_angle_point
   use symsde_step_one_dof_brackets, only: single_brackets, new_single_brackets, q_, p_, qq, qp, pp, nplace
   use symsde_step_one_dof_brackets_angle_single_path, only: evaluate_angle
   implicit none
   private
   public :: one_dof_newton, new_one_dof_newton

   include 'newton.inc'
   include 'two_stages.inc'
   include '../../solve/newton.inc'
   include '../../solve/stagnation.inc'
   include '../../solve/correction.inc'
   include '../../solve/one_lane.inc'

   !> total = start + sum_j c_j x_j from j = first on: step/stages/slope_sums for one path. Products with a zero
   !> coefficient are added too: they change nothing, and testing for zero would take longer.
   pure subroutine sum_slopes(nlane, s, first, c, x, start, total)
      integer, intent(in) :: nlane, s, first
      real(wp), intent(in) :: c(s), x(s), start(1)
      real(wp), intent(out) :: total(1)
      integer :: j

      total = start
      !GCC$ novector  ! sums in order
      do j = first, s
         total = total + c(j)*x(j)
      end do
   end subroutine sum_slopes

   !> Solve the system by elimination, which overwrites the matrix: n numbers of d from column `first` on are the
   !> right-hand side, then the solution. If its pivots are not trusted, or a solution is not finite, the system is
   !> formed again and solved as in a block, with exchanges of rows if necessary.
   subroutine solve_systems(self, first, status, counters)
      type(one_dof_newton), intent(inout) :: self
      integer, intent(in) :: first  !! column of d where the right-hand side begins
      integer(i8), intent(inout) :: status(1)
      type(counters_type), intent(inout) :: counters
      real(wp) :: smallest, zero
      integer :: i, n

      ! n = s unknowns if the F are eliminated, else 2 s.
      n = size(self%matrix, 2)
      ! `smallest` measures how small the pivots have become, as in solve/elimination.
      call solve_scalar(n, self%matrix, self%d(:, first:), smallest)
      ! Check the solution too: it may be infinite or NaN even if pivots are trusted.
      zero = 0
      !GCC$ novector  ! few numbers
      do i = first, first + n - 1
         zero = zero + 0*self%d(1, i)  ! NaN if an entry is not finite
      end do
      if (smallest > pivot_floor .and. abs(zero) <= 0) return
      ! Elimination has overwritten the matrix, and solutions the right-hand sides: both are formed again from slopes
      ! and derivatives, which are unchanged.
      call linearise_all(self)
      call solve_by_lanes(self, first, status, counters)
   end subroutine solve_systems

end module symsde_step_one_dof_newton_single_path
