! SPDX-License-Identifier: BSD-3-Clause
!> Drifts and kicks of a single path, alternately, by stepper.inc with one lane.
!>
!> The weights w_ik, v and D_kl of all steps of a call are computed at once, as if each step were a lane of a block, so
!> that they fill vectors. Then they are transposed, so that the weights of one step are contiguous. Steps whose weights
!> are computed one step at a time take a fifth to a half more time if noises have products. With one degree of freedom,
!> sine and cosine of an angle are computed once per kick, for all Hamiltonians.
!>
!> A single increment computes its own weights: `now` counts the steps of a call, and the weights of a step beyond the
!> prefetched ones are computed when it is taken.
module symsde_step_splitting_stepper_single_path
   use symsde_base_counters, only: counters_type, add_counters
   use symsde_base_functionals, only: functional_set
   use symsde_base_kinds, only: wp, i8
   use symsde_base_matrices, only: add_matrix => add_product
   use symsde_base_record, only: step_record, steps_record, step_store, new_step_store
   use symsde_base_sincos, only: sincos_one
   use symsde_base_vectors, only: add, subtract, add_times, copy, scale
   use symsde_model_kernels, only: angle_terms
   use symsde_scheme_kicks, only: flow_free, flow_rotation, flow_midpoint
   use symsde_scheme_scheme, only: correction_none
   use symsde_step_splitting_bond_turns, only: bond_turns, new_bond_turns
   use symsde_step_splitting_drift, only: drift_flow, new_drift_flow
   use symsde_step_splitting_coefficients, only: kick_weights, new_kick_weights, add_product
   use symsde_step_splitting_midpoint_drift, only: midpoint_flow, new_midpoint_flow
   use symsde_step_splitting_turns, only: action_turns, new_action_turns
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_open_linear_noise, only: linear_noise, new_linear_noise
   use symsde_step_stepper, only: stepper_type, stepper_task, few_of
   implicit none
   private
   public :: splitting_stepper

   !> Weights of the next steps.
   type :: ahead_type
      type(kick_weights), allocatable :: weights  !! weights of the next steps, a lane for each
      type(step_store) :: store                   !! increments and functionals of these steps, as one step
      real(wp), allocatable :: w(:, :, :, :)      !! the same weights, sorted by step (1, 0:nnoise, nkick, step)
      real(wp), allocatable :: v(:, :, :), d(:, :, :)  !! V and D, sorted likewise, for products (1, .., step)
   end type ahead_type

   include 'stepper.inc'
   include 'derivatives.inc'
   include 'products.inc'

   ! ---- procedures that differ between a path by itself and a block --------------------------------

   !> One lane: a constant, which the compiler folds into the bounds of loops.
   pure integer function lanes(self)
      type(splitting_stepper), intent(in) :: self

      lanes = 1
   end function lanes

   !> Compute the weights of all steps of a call: increments and functionals of step i are copied to lane i of a store,
   !> and one step of many lanes is weighed. Weights do not depend on the times of the steps.
   subroutine prefetch(self, steps)
      class(splitting_stepper), intent(inout), target :: self
      type(steps_record), intent(in) :: steps
      type(step_record) :: record
      integer :: i, k, f

      ! The first call determines how many steps a call has at most.
      if (.not. allocated(self%ahead%weights)) call make_ahead(self, self%ahead, steps)
      associate (n => steps%nstep, ahead => self%ahead, weights => self%ahead%weights)
         ! Lane i is step i, for the increments and for every functional that drives the steps.
         do k = 1, steps%nnoise
            ahead%store%w(:n, k, 0) = steps%w(1, k, :)
         end do
         do f = 1, size(steps%of)
            if (.not. associated(steps%of(f)%x)) cycle
            do k = 1, size(steps%of(f)%x, 2)
               ahead%store%of(f)%x(:n, k, 0) = steps%of(f)%x(1, k, :)
            end do
         end do
         ! The store shows its lanes as one step, at an arbitrary time.
         call ahead%store%show(0, 0.0_wp, record)
         call weights%weigh(n, record)
         ! From (step, noise, kick) to (1, noise, kick, step).
         do i = 1, size(ahead%w, 3)
            do k = 0, steps%nnoise
               ahead%w(1, k, i, :n) = weights%w(:n, k, i)
            end do
         end do
         ! From here on `increment` counts `now`; the pointers show all prefetched steps.
         self%nahead = n
         self%now = 0
         self%w(1:, 0:, 1:, 1:) => self%ahead%w
         self%v(1:, 0:, 1:) => self%ahead%v
         if (allocated(ahead%d)) self%d => self%ahead%d
         ! Kicks without products use neither V nor D.
         if (.not. any(weights%has_products)) return
         ! V and D of step i contiguously, as a kick reads them.
         ahead%v(1, :, :n) = transpose(weights%v(:n, :))
         if (allocated(weights%d)) ahead%d(1, :, :n) = transpose(weights%d(:n, :))
      end associate
   end subroutine prefetch

   !> Allocate for as many steps as a call may have (steps%most), at the first call, which shows the functionals that
   !> drive the steps.
   subroutine make_ahead(self, ahead, steps)
      type(splitting_stepper), intent(in) :: self
      type(ahead_type), intent(inout) :: ahead
      type(steps_record), intent(in) :: steps
      type(functional_set) :: asked
      integer :: f

      do f = 1, size(steps%of)
         asked%has(f) = associated(steps%of(f)%x)
      end do
      associate (kicks => self%weights%kicks, m => steps%nnoise)
         ! One step of the store with as many lanes as there are steps; a store needs at least two steps.
         call new_step_store(ahead%store, steps%most, m, 2, steps%h, asked)
         ! Weights with as many lanes as a call has steps.
         allocate (ahead%weights)
         call new_kick_weights(ahead%weights, self%weights%closed, self%ham%model%traits, self%weights%damping, &
                               self%weights%damping_noise, steps%most)
         allocate (ahead%w(1, 0:m, size(kicks%c), steps%most), ahead%v(1, 0:m, steps%most))
         if (allocated(self%weights%d)) allocate (ahead%d(1, size(self%weights%d, 2), steps%most))
      end associate
   end subroutine make_ahead

end module symsde_step_splitting_stepper_single_path
