! SPDX-License-Identifier: BSD-3-Clause
!> The midpoint rule around the mean of the path, for any H with additive noise: strong order 3/2.
!>
!> With x = z + B (W - W_n), where B_k is the constant field of H_k, z has no noise but a Hamiltonian that depends on
!> time. A midpoint step of z needs the mean of its gradient over the step. So the path is replaced by its mean, the
!> shift B dZ/h, and its spread around the mean by a second difference of H:
!>
!>    z' = z + h J^{-1} grad H*((z + z')/2 + B dZ/h),   H* = H + (|h|/12) sum_k B_k^T Hess H B_k,
!>    x_{n+1} = z' + B dW
!>
!> with |h|/12 half of the mean square of W - W_n - dZ/h. This is the midpoint rule for H* between two constant shifts:
!> symplectic for every h, dW, dZ. Order of computation: x + B dZ/h, the step of H* from there, which gives its
!> increments, and B dW added to these.
!>
!> If B changes in time it is evaluated at the middle of the step, B dW becomes B dW + c, c = -(B_{n+1} - B_n) (dZ/h -
!> dW/2), and B dZ/h, the mean of the shift, becomes B dZ/h + c/2: equal parts of c before and after the middle make the
!> step symmetric.
!>
!> The second difference of H that replaces B^T Hess H B is a Hamiltonian itself (step/hamiltonian/brackets). For noise
!> in position and H = p.p/2 + U(q) it is constant: the step is then that of step/midpoint/eliminated, which eliminates
!> momenta. Otherwise the step is that of step/midpoint/full, with the bracket in its Hamiltonian.
module symsde_step_midpoint_mean_path
   use symsde_base_counters, only: counters_type, add_counters
   use symsde_base_functionals, only: path_dz
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_model_probe_noise_time, only: noise_changes_in_time
   use symsde_scheme_scheme, only: bracket_terms, correction_none
   use symsde_step_midpoint_eliminated, only: midpoint_stepper, midpoint_serves
   use symsde_step_midpoint_eliminated_single_path, only: eliminated_single_path => midpoint_stepper
   use symsde_step_midpoint_full, only: midpoint_full_stepper, new_midpoint_full_stepper
   use symsde_step_midpoint_full_single_path, only: full_single_path => midpoint_full_stepper, &
                                                    new_full_single_path => new_midpoint_full_stepper
   use symsde_step_hamiltonian_brackets, only: active_brackets
   use symsde_step_hamiltonian_noise_shift, only: noise_shift, new_noise_shift
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_implicit_rescue, only: rescue_type, new_rescue
   use symsde_step_stepper, only: stepper_type, stepper_task, few_of
   implicit none
   private
   public :: mean_path_stepper

   !> The stepper: shifts along the fields of the noise, and an inner midpoint stepper of H*.
   type, extends(stepper_type) :: mean_path_stepper
      private
      type(noise_shift) :: shift                     !! shifts B dW and B dZ
      logical :: time_dependent = .false.            !! whether B changes in time
      real(wp), allocatable :: drift(:, :)           !! weights h, 0 (nlane, 0:nnoise)
      class(stepper_type), allocatable :: inner      !! stepper of h H*, without noise
      type(rescue_type) :: rescue                    !! rescue of the inner stepper's failed lanes
      real(wp), allocatable :: qs(:, :), ps(:, :)    !! x + B dZ/h + c/2, the mean of the path (nlane, ndof)
   contains
      procedure :: make
      procedure :: increment
      procedure :: tally
   end type mean_path_stepper

contains

   !> Make the inner stepper of H* and the shifts around it. For a single path the inner stepper has one lane. The
   !> rescue solves the inner equations: the tableau without dZ would be another scheme.
   subroutine make(self, task)
      class(mean_path_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task
      type(midpoint_full_stepper), allocatable :: full
      type(full_single_path), allocatable :: single
      type(bracket_terms) :: brackets

      self%name = 'midpoint, averaged shift'
      ! The second difference of H is omitted if the traits of the model make it constant.
      brackets = active_brackets(bracket_terms(nested=.true.), task%model%traits)
      if (midpoint_serves(task%model, task%newton) .and. .not. brackets%are_added()) then
         self%left_out = 'half of the unknowns: identity mass'
         if (task%nlane == 1) allocate (eliminated_single_path :: self%inner)
         if (task%nlane > 1) allocate (midpoint_stepper :: self%inner)
         call self%inner%make(task)
      else if (task%nlane == 1) then
         allocate (single)
         call new_full_single_path(single, task%model, 1, task%newton, brackets=brackets)
         call move_alloc(single, self%inner)
      else
         allocate (full)
         call new_midpoint_full_stepper(full, task%model, task%nlane, task%newton, brackets=brackets)
         call move_alloc(full, self%inner)
      end if
      ! Paths are taken one by one up to the limit of the inner stepper, and up to the number of paths for which this
      ! was measured to be faster, shifts included.
      self%most_single = min(self%inner%most_single, few_of(task%model%traits%ndof, 3, 6)) ! four: 1.1 of a block's time
      call new_rescue(self%rescue, task, self%inner)
      call new_one_step_hamiltonian(self%ham, task%model, task%nlane, correction_none, 0.0_wp)
      call new_noise_shift(self%shift, task%model, task%nlane)
      self%time_dependent = noise_changes_in_time(task%model)
      associate (nlane => task%nlane, n => task%model%traits%ndof)
         allocate (self%qs(nlane, n), self%ps(nlane, n))
         allocate (self%drift(nlane, 0:task%model%traits%nnoise), source=0.0_wp)
      end associate
   end subroutine make

   !> dq and dp: shift the state to the mean of the path, take the step of H*, add the shift of the whole step to the
   !> increments. B is evaluated at the middle of the step; weigh(a, b) makes weights a dW + b dZ/h.
   subroutine increment(self, step, q, p, dq, dp, status)
      class(mean_path_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)

      ! The mean of the path: x + B dZ/h + c/2.
      self%qs = q
      self%ps = p
      call self%shift%weigh(0.0_wp, 1.0_wp, step)
      call self%shift%add(self%ham, step%t + 0.5_wp*step%h, 1.0_wp, self%qs, self%ps)
      call add_change(self, step, 0.5_wp, self%qs, self%ps)
      call drift_midpoint(self, step, dq, dp, status)
      ! Add the shift of the whole step, B dW + c, to the increments of z.
      call self%shift%weigh(1.0_wp, 0.0_wp, step)
      call self%shift%add(self%ham, step%t + 0.5_wp*step%h, 1.0_wp, dq, dp)
      call add_change(self, step, 1.0_wp, dq, dp)
   end subroutine increment

   !> The step of H* from (qs, ps), with weights (h, 0, .., 0). Lanes that fail are rescued with the same weights
   !> and state; `failed` >= 0 excludes lanes that had failed before.
   subroutine drift_midpoint(self, step, dq, dp, status)
      type(mean_path_stepper), intent(inout), target :: self
      type(step_record), intent(in) :: step
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      type(step_record) :: drift
      integer(i8) :: failed(self%ham%nlane)

      drift = step
      ! The rescue tries only lanes with failed < 0, which have no status yet.
      failed = merge(-1_i8, 1_i8, status == 0)
      self%drift(:, 0) = step%h
      drift%w(1:, 0:) => self%drift
      self%inner%ham%nreal = self%ham%nreal
      call self%inner%increment(drift, self%qs, self%ps, dq, dp, status)
      if (any(status /= 0 .and. failed < 0)) &
         call self%rescue%attempt(self%ham%nlane, drift, self%qs, self%ps, failed, dq, dp, status)
   end subroutine drift_midpoint

   !> Add a part of c = -(B_{n+1} - B_n) (dZ/h - dW/2) to (q, p), if B changes in time: the shift with weights dW/2 -
   !> dZ/h and B at the end of the step, minus the shift with B at its beginning.
   subroutine add_change(self, step, share, q, p)
      type(mean_path_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: share
      real(wp), intent(inout), dimension(self%ham%nlane, self%ham%ndof) :: q, p

      if (.not. (self%time_dependent .and. associated(step%of(path_dz)%x))) return
      call self%shift%weigh(0.5_wp, -1.0_wp, step)
      call self%shift%add(self%ham, step%t + step%h, share, q, p)
      call self%shift%add(self%ham, step%t, -share, q, p)
   end subroutine add_change

   !> Add the counters of this stepper and of its inner stepper.
   subroutine tally(self, total)
      class(mean_path_stepper), intent(in) :: self
      type(counters_type), intent(inout) :: total

      call add_counters(total, self%ham%counters)
      call self%inner%tally(total)
      call self%rescue%tally(total)
   end subroutine tally

end module symsde_step_midpoint_mean_path
