! SPDX-License-Identifier: BSD-3-Clause
!> Implicit schemes of several stages for one degree of freedom and a single path: those of step/one_dof/stepper.
!>
!> The step is the same: Newton's iteration for the slopes F_i and G_i (newton.inc), then dq = sum_i alpha_i F_i and dp
!> = sum_i alpha_i G_i. The small block of step/one_dof/stepper is not needed, since one lane waits for no others.
!> step/one_dof/stepper also defines which tasks fit.
module symsde_step_one_dof_stepper_single_path
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_scheme_scheme, only: correction_none
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_one_dof_newton_single_path, only: one_dof_newton, new_one_dof_newton
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: one_dof_stepper

   type, extends(stepper_type) :: one_dof_stepper
      private
      type(one_dof_newton) :: solver
   contains
      procedure :: make
      procedure :: increment
   end type one_dof_stepper

contains

   !> most_single is the number of paths that run faster one by one than as a block. With more paths, single paths take
   !> up to 1.3 of the time of a block, or 1.0 to 1.2 with brackets.
   subroutine make(self, task)
      class(one_dof_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      self%name = 'stages, one degree of freedom'
      call new_one_step_hamiltonian(self%ham, task%model, task%nlane, correction_none, 0.0_wp, task%scheme%brackets)
      call new_one_dof_newton(self%solver, self%ham, task%scheme, task%newton, task%damping)
      ! one_solve reports linear equations; the stopping test ends their iteration after one solve.
      self%one_solve = self%solver%newton%affine
      self%most_single = 2
      ! Without Hessian or with brackets the bound is two paths. Otherwise, if the equations are separable or
      ! linear, it is three for two stages, which are solved in closed form, and four for more.
      if (.not. task%model%traits%has_hessian .or. allocated(self%ham%modified)) return
      if (self%solver%separable .or. self%one_solve) self%most_single = merge(3, 4, task%scheme%nstage == 2)
   end subroutine make

   !> Newton's iteration from its first guess until its corrections stagnate, then the weighted sums of the slopes. A
   !> path with a status is not iterated: its increments come from the first guess and are not used.
   subroutine increment(self, step, q, p, dq, dp, status)
      class(one_dof_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)

      call self%solver%begin(self%ham, step, q, p, status)
      do while (self%solver%newton%running)
         call self%solver%iterate(self%ham, step, q, p, status)
      end do
      call self%solver%add_up(p, dq, dp)
   end subroutine increment

end module symsde_step_one_dof_stepper_single_path
