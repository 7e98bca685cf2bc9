! SPDX-License-Identifier: BSD-3-Clause
!> Midpoint around the mean of the path, for any H with additive noise: strong order 3/2.
!>
!> With x = z + B (W - W_n), B_k the constant field of H_k, z has no noise but a time_dependent Hamiltonian, and
!>
!>    z' = z + h J^{-1} grad H*((z + z')/2 + B dZ/h),   H* = H + (|h|/12) sum_k B_k^T Hess H B_k,
!>    x_{n+1} = z' + B dW
!>
!> that is the midpoint rule for H* between two constant shifts: symplectic for every h, dW, dZ. Where B changes
!> in time it is taken at the middle of the step, and B dW becomes B dW - (B_{n+1} - B_n) (dZ/h - dW/2). The second
!> difference of H that stands for B^T Hess H B is a Hamiltonian itself (step/modified_hamiltonian).
module symsde_step_averaged_shift
   use symsde_base_counters, only: counters_type, add_counters
   use symsde_base_functionals, only: path_dz
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_scheme_scheme, only: bracket_terms, correction_none, frame_mean_path
   use symsde_model_noise_time, only: noise_changes_in_time
   use symsde_step_midpoint_full, only: midpoint_full_stepper, new_midpoint_full_stepper
   use symsde_step_one_step_hamiltonian, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: averaged_shift_stepper, averaged_shift_fits

   type, extends(stepper_type) :: averaged_shift_stepper
      private
      logical :: time_dependent = .false.                      !! B changes in time
      type(midpoint_full_stepper) :: inner             !! under h H*, without noise
      real(wp), allocatable :: v(:, :), drift(:, :)    !! weights 0, b_k and h, 0 (nlane, 0:nnoise)
      real(wp), allocatable :: qs(:, :), ps(:, :), hq(:, :), hp(:, :)  !! (nlane, ndof)
   contains
      procedure :: make
      procedure :: increment
      procedure :: tally
   end type averaged_shift_stepper

contains

   !> Whether this stepper executes the task.
   logical function averaged_shift_fits(task) result(fits)
      type(stepper_task), intent(in) :: task

      fits = task%scheme%frame == frame_mean_path
   end function averaged_shift_fits

   subroutine make(self, task)
      class(averaged_shift_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      self%name = 'midpoint, averaged shift'
      self%takes_one_lane = .true.
      self%time_dependent = noise_changes_in_time(task%model)
      associate (n => task%model%traits%ndof, m => task%model%traits%nnoise, nlane => task%nlane)
         call new_one_step_hamiltonian(self%ham, task%model, nlane, correction_none, 0.0_wp)
         call new_midpoint_full_stepper(self%inner, task%model, nlane, task%newton, &
                                        brackets=bracket_terms(nested=.true.))
         allocate (self%v(nlane, 0:m), self%drift(nlane, 0:m), source=0.0_wp)
         allocate (self%qs(nlane, n), self%ps(nlane, n), self%hq(nlane, n), self%hp(nlane, n))
      end associate
   end subroutine make

   subroutine increment(self, step, q, p, dq, dp, status)
      class(averaged_shift_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      real(wp) :: h, tm

      h = step%h
      tm = step%t + 0.5_wp*h
      self%qs = q
      self%ps = p
      self%v = 0
      if (associated(step%of(path_dz)%x)) self%v(:, 1:) = step%of(path_dz)%x/h
      call add_shift(self, tm, self%qs, self%ps)
      call drift_midpoint(self, step, dq, dp, status)
      self%v(:, 1:) = step%w(:, 1:)
      call add_shift(self, tm, dq, dp)
      if (.not. (self%time_dependent .and. associated(step%of(path_dz)%x))) return
      self%v(:, 1:) = 0.5_wp*step%w(:, 1:) - step%of(path_dz)%x/h
      call add_shift(self, step%t + h, dq, dp)
      self%v = -self%v
      call add_shift(self, step%t, dq, dp)
   end subroutine increment

   !> The step of H* from (qs, ps), without noise.
   subroutine drift_midpoint(self, step, dq, dp, status)
      type(averaged_shift_stepper), intent(inout), target :: self
      type(step_record), intent(in) :: step
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      type(step_record) :: drift

      drift = step
      self%drift(:, 0) = step%h
      drift%w(1:, 0:) => self%drift
      self%inner%ham%nreal = self%ham%nreal
      call self%inner%increment(drift, self%qs, self%ps, dq, dp, status)
   end subroutine drift_midpoint

   !> What this stepper and the one within have counted.
   subroutine tally(self, total)
      class(averaged_shift_stepper), intent(in) :: self
      type(counters_type), intent(inout) :: total

      call add_counters(total, self%ham%counters)
      call self%inner%tally(total)
   end subroutine tally

   !> (xq, xp) + sum_k v_k B_k, read off at that very point: the fields of additive noise are constant.
   subroutine add_shift(self, t, xq, xp)
      type(averaged_shift_stepper), intent(inout) :: self
      real(wp), intent(in) :: t
      real(wp), intent(inout) :: xq(self%ham%nlane, self%ham%ndof), xp(self%ham%nlane, self%ham%ndof)

      if (self%ham%nnoise == 0) return
      call self%ham%gradient(t, self%v, xq, xp, self%hq, self%hp)
      xq = xq + self%hp
      xp = xp - self%hq
   end subroutine add_shift

end module symsde_step_averaged_shift
