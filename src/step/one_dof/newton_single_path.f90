! SPDX-License-Identifier: BSD-3-Clause
!> Newton's iteration for the slopes of all stages of one degree of freedom and a single path: newton.inc with one lane.
!>
!> What differs from a block is who is asked: an angle's sine and cosine terms are found once a step for every stage, so
!> that the iteration calls no model; angles with brackets go through step/hamiltonian/brackets_angle_single_path;
!> systems are eliminated as numbers. All of these have a block's bits.
!>
!> Private to its family.
module symsde_step_one_dof_newton_single_path
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_model_abstract, only: angle_terms
   use symsde_scheme_scheme, only: scheme_type
   use symsde_solve_blocks, only: block_solver, new_block_solver, pivot_floor
   use symsde_solve_elimination_single_path, only: solve_scalar
   use symsde_solve_damping, only: start_damping
   use symsde_solve_newton, only: newton_type, newton_options, new_newton, mark, stop_lanes
   use symsde_solve_stagnation, only: stopping_test, done, failed
   use symsde_step_hamiltonian_brackets_angle_single_path, only: evaluate_angle
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   use symsde_step_hamiltonian_brackets_one_dof, only: single_brackets, new_single_brackets, q_, p_, qq, qp, pp, nplace
   use symsde_step_midpoint_angle, only: find_angle_velocity, find_angle_point
   implicit none
   private
   public :: one_dof_newton, new_one_dof_newton

   include 'newton.inc'
   include 'two_stages.inc'
   include '../../solve/newton.inc'
   include '../../solve/stagnation.inc'
   include '../../solve/correction.inc'
   include '../../solve/one_lane.inc'

   !> The terms of an angle in every stage, and qs = Hhat_p(q_n, p_n) at the time of the first stage, where it is the
   !> first guess. Of an angle it is e p, with the terms of that stage.
   subroutine find_velocity(self, ham, step, q, p)
      type(one_dof_newton), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(1), p(1)
      real(wp), pointer, contiguous :: w(:, :)  ! a name that gfortran 12 knows to be contiguous
      real(wp) :: unused
      integer :: i

      w => step%w
      if (.not. allocated(self%terms)) then  ! no angle: the model is asked
         if (self%from_velocity) call ham%velocity(step%t + self%c(1)*step%h, w, q, p, self%qs)
         return
      end if
      ! The terms depend on h, dW and the time of a stage, not on (q, p): all iterations of the step use these.
      do i = 1, self%s
         call ham%model%angle(ham%nnoise, step%t + self%c(i)*step%h, w, self%terms(i))
      end do
      if (.not. self%from_velocity) return
      ! A gradient is counted, as a block counts the one that it asks the model for.
      call find_angle_velocity(self%terms(1), p(1), self%qs(1), unused)
      ham%counters%gradients = ham%counters%gradients + 1
   end subroutine find_velocity

   !> Gradient and Hessian of stage i; for i = 0 in the middle of the step, in the place of the first stage. An angle's
   !> terms are there where its Hamiltonian is separable and no brackets are added, and then i = 0 does not occur.
   subroutine evaluate(self, ham, i, step, q, p)
      type(one_dof_newton), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      integer, intent(in) :: i
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(1), p(1)

      integer :: asked

      asked = 1
      ! Three ways to the same numbers: a separable angle by its terms; an angle with brackets, whose kernel works on
      ! numbers in registers; any other model by a call for one lane, which counts by itself.
      if (allocated(self%terms)) then
         associate (h => self%h(1, :, i))
            call find_angle_point(self%terms(i), q(1), p(1), h(q_), h(p_), h(qq), h(pp))
         end associate
      else if (self%bracketed_angle) then
         associate (b => self%brackets)
            call evaluate_angle(b%kinetic, ham%modified, i, step, b%c, b%rate, q, p, self%h(:, :, max(i, 1)))
            asked = b%asked
         end associate
      else
         call ask_model(self, ham, i, step, q, p)
         return
      end if
      ham%counters%gradients = ham%counters%gradients + asked
      ham%counters%hessians = ham%counters%hessians + asked
   end subroutine evaluate

   !> total = start + sum_j c_j x_j from j = first on, the sum of slopes of step/stages/slope_sums for one path.
   !> Products with the coefficient zero are added, too: they change nothing, and a test of each would cost more.
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
   !> right-hand side, then the solution. Where its pivots are not trusted, or a solution is not finite, the system is
   !> made once more and solved as in a block, by LAPACK if need be.
   subroutine solve_systems(self, first, status, counters)
      type(one_dof_newton), intent(inout) :: self
      integer, intent(in) :: first  !! column of d with which the right-hand side begins
      integer(i8), intent(inout) :: status(1)
      type(counters_type), intent(inout) :: counters
      real(wp) :: smallest, zero
      integer :: i, n

      ! n = s where the F are eliminated, else 2 s.
      n = size(self%matrix, 2)
      ! `smallest` tells how small the pivots have become, as in solve/elimination.
      call solve_scalar(n, self%matrix, self%d(:, first:), smallest)
      ! The solution is looked at, too: it may not be finite though the pivots are trusted.
      zero = 0
      !GCC$ novector  ! few numbers
      do i = first, first + n - 1
         zero = zero + 0*self%d(1, i)  ! NaN where one is not finite
      end do
      if (smallest > pivot_floor .and. abs(zero) <= 0) return
      ! Elimination has overwritten the matrix, and solutions the right-hand sides: both are formed once more from
      ! slopes and derivatives, which are still there.
      call linearise_all(self)
      call solve_by_lanes(self, self%d(:, first:), status, counters)
   end subroutine solve_systems

end module symsde_step_one_dof_newton_single_path
