! SPDX-License-Identifier: BSD-3-Clause
!> Implicit schemes of several stages (above all Gauss 2) for one degree of freedom,
!>
!>    Q_i = q_n + sum_j a_ij Hhat_p(P_j,Q_j),      dq = sum_i alpha_i Hhat_p(P_i,Q_i),
!>    P_i = p_n - sum_j abar_ij Hhat_q(P_j,Q_j),   dp = -sum_i alpha_i Hhat_q(P_i,Q_i),
!>
!> where Hhat may contain brackets. Newton's iteration finds all slopes together (step/one_dof/newton), in few passes
!> over the block. Results agree with the general stepper to a few ulps (tests/verification/test_beyond_one_maps.pf,
!> test_stages.pf).
!>
!> Lanes need different numbers of corrections, above all with brackets, whose second derivatives are not all known. As
!> soon as few lanes are running they are gathered into a small block and finished there, with the same bits. In the
!> large block every further iteration would compute all other lanes for nothing.
!>
!> Order of a step: the first guess of all lanes, iterations of the whole block while more than few_lanes lanes are
!> running, iterations of the small block, and at the end the weighted sums of the slopes of all lanes.
module symsde_step_one_dof_stepper
   use symsde_base_counters, only: counters_type, add_counters
   use symsde_base_damping, only: damping_type
   use symsde_base_functionals, only: functional_set, nfunctional, path_dz, path_areas
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record, step_store, new_step_store
   use symsde_base_status, only: not_converged
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type, correction_none
   use symsde_solve_newton, only: newton_options
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian, new_one_step_hamiltonian
   use symsde_step_one_dof_newton, only: one_dof_newton, new_one_dof_newton, resume
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: one_dof_stepper, one_dof_fits

   integer, parameter :: few_lanes = 64   !! lanes of the small block

   !> The small block: Hamiltonian and iteration for few_lanes lanes, and copies of the gathered lanes' noise.
   type :: last_lanes
      type(one_step_hamiltonian) :: ham
      type(one_dof_newton) :: solver
      type(step_store) :: store
      integer :: n = 0, lanes(few_lanes) = 0          !! number of gathered lanes, and their indices in the block
      integer(i8) :: status(few_lanes) = 0
      real(wp), dimension(few_lanes) :: q = 0, p = 0
   end type last_lanes

   type, extends(stepper_type) :: one_dof_stepper
      private
      type(one_dof_newton) :: solver
      class(last_lanes), allocatable :: few        !! allocated for larger blocks
   contains
      procedure :: make
      procedure :: increment
   end type one_dof_stepper

contains

   !> Whether this stepper executes the task: drift and noise share coefficients, one degree of freedom, solved by
   !> Newton; two stages, or more stages of a separable or quadratic model whose momenta step/stages/stepper does not
   !> eliminate.
   logical function one_dof_fits(task) result(fits)
      type(stepper_task), intent(in) :: task

      ! Stages of drift and noise with different coefficients would need separate slopes, and corrections of one-sided
      ! schemes belong to a single stage: both are left to other steppers.
      fits = .false.
      if (.not. task%is_tableau() .or. task%correction /= correction_none .or. task%scheme%nstage < 2) return
      associate (t => task%model%traits)
         fits = t%ndof == 1 .and. task%newton%is_free() .and. .not. (task%damping%acts() .and. task%has_brackets())
         if (fits) fits = task%scheme%noise_coefficients_equal()
         if (fits .and. task%scheme%nstage > 2) &
            fits = (t%separable .or. t%one_solve(.false.)) .and. .not. (t%eliminates_momenta() .or. task%has_brackets())
      end associate
   end function one_dof_fits

   !> Linear equations take one solve in every lane, and a block of few lanes is already small: neither needs `few`.
   subroutine make(self, task)
      class(one_dof_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      self%name = 'stages, one degree of freedom'
      call new_one_step_hamiltonian(self%ham, task%model, task%nlane, correction_none, 0.0_wp, task%scheme%brackets)
      call new_one_dof_newton(self%solver, self%ham, task%scheme, task%newton, task%damping)
      self%one_solve = self%solver%newton%affine
      if (self%one_solve .or. task%nlane <= few_lanes) return
      allocate (self%few)
      call new_last_lanes(self%few, task%model, task%scheme, task%newton, task%damping)
   end subroutine make

   !> Make the small block for the same model, scheme and options. Its store has arrays for the functionals that the
   !> active brackets read, dZ and areas, and for two steps, the fewest that a store can have; only the first is used.
   subroutine new_last_lanes(self, model, scheme, options, damping)
      type(last_lanes), intent(inout) :: self
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      type(newton_options), intent(in) :: options
      type(damping_type), intent(in) :: damping
      type(functional_set) :: asked

      call new_one_step_hamiltonian(self%ham, model, few_lanes, correction_none, 0.0_wp, scheme%brackets)
      call new_one_dof_newton(self%solver, self%ham, scheme, options, damping)
      ! Without brackets only (h, dW) drives a step, and the store needs no functionals.
      if (allocated(self%ham%modified)) then
         asked%has(path_dz) = self%ham%modified%active%single
         asked%has(path_areas) = self%ham%modified%active%areas
      end if
      call new_step_store(self%store, few_lanes, model%traits%nnoise, 2, 0.0_wp, asked)
   end subroutine new_last_lanes

   !> Newton's iteration from its first guess until no lane runs, at last in the small block, then the weighted sums
   !> of the slopes. The number of running lanes decides when to gather; results of a lane do not depend on it.
   subroutine increment(self, step, q, p, dq, dp, status)
      class(one_dof_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      type(step_record) :: gathered

      associate (solver => self%solver)
         call solver%begin(self%ham, step, q, p, status)
         do while (solver%newton%running)
            if (allocated(self%few) .and. solver%newton%nrunning <= few_lanes) exit
            call solver%iterate(self%ham, step, q, p, status)
         end do
         if (solver%newton%running) then
            call gather(self%few, self%ham, solver, step, q, p, status, gathered)
            do while (self%few%solver%newton%running)
               call self%few%solver%iterate(self%few%ham, gathered, self%few%q, self%few%p, self%few%status)
            end do
            call scatter(self%few, self%ham, solver, status)
         end if
         call solver%add_up(p, dq, dp)
      end associate
   end subroutine increment

   !> Copy the running lanes into the small block: their states, increments and functionals, slopes and statuses. Lanes
   !> that fill it up repeat its last one and are skipped.
   subroutine gather(self, ham, solver, step, q, p, status, gathered)
      type(last_lanes), intent(inout), target :: self
      type(one_step_hamiltonian), intent(in) :: ham
      type(one_dof_newton), intent(in) :: solver
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(ham%nlane), p(ham%nlane)
      integer(i8), intent(in) :: status(ham%nlane)
      type(step_record), intent(out) :: gathered  !! the step of the gathered lanes
      integer :: i, f

      ! Running lanes have the size of their last correction in `last`, which is negative in all other lanes.
      self%n = 0
      do i = 1, ham%nlane
         if (.not. solver%newton%last(i) >= 0) cycle
         self%n = self%n + 1
         self%lanes(self%n) = i
      end do
      associate (n => self%n, lanes => self%lanes)
         ! At least one lane is running, so there is a last one to repeat.
         lanes(n + 1:) = lanes(n)
         call self%ham%narrow(lanes)
         self%q = q(lanes)
         self%p = p(lanes)
         self%store%h = step%h
         self%store%w(:, :, 0) = step%w(lanes, :)
         do f = 1, nfunctional  ! the store has arrays only for functionals that brackets read
            if (allocated(self%store%of(f)%x)) self%store%of(f)%x(:, :, 0) = step%of(f)%x(lanes, :)
         end do
         call self%store%show(0, step%t, gathered)
         ! A lane with a nonzero status is skipped; this status is never visible, as only the first n are copied back.
         self%status = not_converged  ! lanes that fill up the block are skipped
         self%status(:n) = status(lanes(:n))
         self%ham%nreal = count(lanes(:n) <= ham%nreal)  ! padding of the block is not counted
         ! The step is rebuilt for the gathered lanes, at the same time t_n. Their iteration continues with its count
         ! and its sizes of corrections, so that the bounds and tests of Newton's iteration do not start again.
         call resume(self%solver, self%ham, solver, lanes, gathered, self%status)
      end associate
   end subroutine gather

   !> Copy slopes and statuses of the gathered lanes back to the block, and add the counters.
   subroutine scatter(self, ham, solver, status)
      type(last_lanes), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(one_dof_newton), intent(inout) :: solver
      integer(i8), intent(inout) :: status(ham%nlane)

      associate (n => self%n, lanes => self%lanes)
         solver%x(lanes(:n), :) = self%solver%x(:n, :)
         status(lanes(:n)) = self%status(:n)
      end associate
      call self%ham%widen()
      call add_counters(ham%counters, self%ham%counters)
      self%ham%counters = counters_type()
   end subroutine scatter

end module symsde_step_one_dof_stepper
