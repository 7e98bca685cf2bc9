! SPDX-License-Identifier: BSD-3-Clause
!> The flow of H between kicks by the implicit midpoint rule, which large forces do not limit: by whatever stepper
!> takes a midpoint step of the model, with noises of weight zero.
!>
!> Private to its family.
module symsde_step_splitting_midpoint_drift
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_status, only: error_type
   use symsde_scheme_catalogue, only: get_scheme
   use symsde_scheme_scheme, only: scheme_type
   use symsde_step_implicit_general, only: general_stepper
   use symsde_step_midpoint_eliminated, only: midpoint_stepper, midpoint_fits
   use symsde_step_midpoint_eliminated_single_path, only: midpoint_single_path => midpoint_stepper
   use symsde_step_midpoint_full, only: midpoint_full_stepper, midpoint_full_fits
   use symsde_step_midpoint_full_single_path, only: midpoint_full_single_path => midpoint_full_stepper
   use symsde_step_midpoint_one_dof, only: midpoint_one_dof_stepper, midpoint_one_dof_fits
   use symsde_step_midpoint_one_dof_single_path, only: midpoint_one_dof_single_path => midpoint_one_dof_stepper
   use symsde_step_implicit_rescue, only: rescue_type, new_rescue
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: midpoint_flow, new_midpoint_flow

   type :: midpoint_flow
      private
      class(stepper_type), allocatable, public :: stepper  !! that takes the midpoint steps
      type(scheme_type), allocatable :: midpoint
      type(rescue_type) :: rescue                          !! of lanes that it fails in
      real(wp), allocatable :: w(:, :)                     !! tau and no noise (nlane, 0:nnoise)
      real(wp), allocatable, dimension(:, :) :: x, y, dx, dy  !! (nlane, ndof)
      integer(i8), allocatable :: failed(:)                !! 1 where a lane had failed before, else -1 (nlane)
   contains
      procedure :: move
      procedure :: tally
   end type midpoint_flow

contains

   !> Midpoint steps of the model and the lanes of a task.
   subroutine new_midpoint_flow(self, whole)
      type(midpoint_flow), intent(out), target :: self
      type(stepper_task), intent(in) :: whole  !! of the scheme that kicks
      type(stepper_task) :: task
      type(error_type), allocatable :: error

      task = whole
      allocate (self%midpoint)
      call get_scheme(self%midpoint, 'midpoint', error)
      task%scheme => self%midpoint
      if (whole%general) then
         allocate (general_stepper :: self%stepper)
      else if (midpoint_fits(task)) then
         if (task%nlane == 1) allocate (midpoint_single_path :: self%stepper)
         if (task%nlane > 1) allocate (midpoint_stepper :: self%stepper)
      else if (midpoint_one_dof_fits(task)) then
         if (task%nlane == 1) allocate (midpoint_one_dof_single_path :: self%stepper)
         if (task%nlane > 1) allocate (midpoint_one_dof_stepper :: self%stepper)
      else if (midpoint_full_fits(task)) then
         if (task%nlane == 1) allocate (midpoint_full_single_path :: self%stepper)
         if (task%nlane > 1) allocate (midpoint_full_stepper :: self%stepper)
      else
         allocate (general_stepper :: self%stepper)
      end if
      call self%stepper%make(task)
      call new_rescue(self%rescue, task, self%stepper)
      associate (nlane => task%nlane, n => task%model%traits%ndof, m => task%model%traits%nnoise)
         allocate (self%w(nlane, 0:m), source=0.0_wp)
         allocate (self%x(nlane, n), self%y(nlane, n), self%dx(nlane, n), self%dy(nlane, n), self%failed(nlane))
      end associate
   end subroutine new_midpoint_flow

   !> Move (q + dq, p + dp) over the time tau from the time t on.
   subroutine move(self, t, tau, q, p, dq, dp, status)
      class(midpoint_flow), intent(inout), target :: self
      real(wp), intent(in) :: t, tau
      real(wp), intent(in), dimension(self%stepper%ham%nlane, self%stepper%ham%ndof) :: q, p
      real(wp), intent(inout), dimension(self%stepper%ham%nlane, self%stepper%ham%ndof) :: dq, dp
      integer(i8), intent(inout) :: status(self%stepper%ham%nlane)
      type(step_record) :: step

      self%w(:, 0) = tau
      self%x = q + dq
      self%y = p + dp
      self%failed = merge(-1_i8, 1_i8, status == 0)
      step%t = t
      step%h = tau
      step%w(1:, 0:) => self%w
      call self%stepper%increment(step, self%x, self%y, self%dx, self%dy, status)
      if (any(status /= 0 .and. self%failed < 0)) &
         call self%rescue%attempt(size(status), step, self%x, self%y, self%failed, self%dx, self%dy, status)
      dq = dq + self%dx
      dp = dp + self%dy
   end subroutine move

   !> Add what was counted.
   subroutine tally(self, total)
      class(midpoint_flow), intent(in) :: self
      type(counters_type), intent(inout) :: total

      call self%stepper%tally(total)
      call self%rescue%tally(total)
   end subroutine tally

end module symsde_step_splitting_midpoint_drift
