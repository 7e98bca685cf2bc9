! SPDX-License-Identifier: BSD-3-Clause
!> The choice of a stepper: an ordered list of steppers that decide themselves whether they fit.
!>
!> A run resolves its task once (step/task). Then blocks of every width are made from the task (`make_stepper`): the
!> first stepper of the list that fits is taken, or one for damped models (`offer_damped`). A stepper that fits omits
!> work that the traits of the model prove to be unnecessary; the general steppers at the end of the list, called
!> oracles, omit nothing, and a task may demand one of them.
!>
!> The choice depends on the traits of the model and on the form, frame and coefficients of the scheme. For one lane the
!> instance of a body for a single path is allocated, if there is one.
module symsde_step_factory
   use symsde_base_damping, only: damping_type
   use symsde_base_status, only: error_type, raise, incompatible
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type, frame_shift, frame_mean_path, frame_rotation, ito_form, galerkin_form, &
                                   splitting_form
   use symsde_step_open_braked, only: braked_stepper
   use symsde_step_open_damped, only: damped_stepper, damped_fits
   use symsde_step_open_rubbed, only: rubbed_stepper
   use symsde_step_midpoint_mean_path, only: mean_path_stepper
   use symsde_step_midpoint_mean_force, only: mean_force_stepper, mean_force_fits
   use symsde_step_midpoint_mean_force_single_path, only: mean_force_single_path => mean_force_stepper
   use symsde_step_explicit_angle_steps_single_path, only: explicit_angle_stepper => explicit_stepper, angle_steps_fit
   use symsde_step_explicit_damped, only: damped_explicit_stepper
   use symsde_step_explicit_tableau, only: explicit_stepper, explicit_fits, decays_here
   use symsde_step_explicit_tableau_single_path, only: explicit_single_path => explicit_stepper
   use symsde_step_oracle_galerkin, only: galerkin_stepper
   use symsde_step_oracle_general, only: general_stepper
   use symsde_step_midpoint_eliminated, only: midpoint_stepper, midpoint_fits
   use symsde_step_midpoint_eliminated_single_path, only: midpoint_single_path => midpoint_stepper
   use symsde_step_midpoint_full, only: midpoint_full_stepper, midpoint_full_fits
   use symsde_step_midpoint_full_single_path, only: midpoint_full_single_path => midpoint_full_stepper
   use symsde_step_midpoint_one_dof, only: midpoint_one_dof_stepper, midpoint_one_dof_fits
   use symsde_step_midpoint_one_dof_single_path, only: midpoint_one_dof_single_path => midpoint_one_dof_stepper
   use symsde_step_one_sided_euler_pair, only: euler_pair_stepper, euler_pair_fits
   use symsde_step_splitting_stepper, only: splitting_stepper
   use symsde_step_splitting_stepper_single_path, only: splitting_single_path => splitting_stepper
   use symsde_step_stages_forced, only: forced_stages_stepper, forced_stages_fit
   use symsde_step_stages_stepper, only: stages_stepper, stages_fits
   use symsde_step_stages_stepper_single_path, only: stages_single_path => stages_stepper
   use symsde_step_one_dof_stepper, only: one_dof_stepper, one_dof_fits
   use symsde_step_one_dof_stepper_single_path, only: one_dof_single_path => one_dof_stepper
   use symsde_step_stepper, only: stepper_type, stepper_task
   use symsde_step_explicit_verlet_dz, only: verlet_dz_stepper
   use symsde_step_flow_model_flow, only: model_flow_stepper
   use symsde_step_task, only: stepper_options, resolve_task
   implicit none
   private
   public :: stepper_options, new_stepper, make_stepper

   !> The order in which steppers are tried: special ones first, oracles last. Several may fit a task. The midpoint rule
   !> with eliminated momenta comes before that of one degree of freedom, then that of all unknowns, then the general
   !> tableau.
   enum, bind(c)
      enumerator :: model_flow = 1, verlet_dz, mean_path, explicit, mean_force, midpoint, midpoint_one_dof
      enumerator :: midpoint_full, euler_pair, one_dof, stages, forced_stages
      enumerator :: first_oracle, general = first_oracle, euler_maruyama, galerkin, splitting, last_stepper = splitting
   end enum

   !> Steppers for models with forces: they take all derivatives from the one-step Hamiltonian, which adds the forces,
   !> and do not assume that these derivatives are symmetric.
   integer, parameter :: with_forces(*) = [verlet_dz, explicit, midpoint_full, euler_pair, forced_stages, general, &
                                           euler_maruyama, galerkin, splitting]

contains

   !> Offer stepper number i of the list for a task: the first one that fits is taken. An oracle executes its schemes
   !> for every model that they allow, by their unmodified equations; all other steppers are tested against it. Only a
   !> stepper that fits is allocated, since allocating all would take noticeable time in short runs.
   !>
   !> For one lane the instance for a single path is allocated, if the body has one. The condition in each case:
   !>
   !> model_flow           the model has its own steps of this scheme
   !> verlet_dz, mean_path the frame of the scheme: nothing else executes it
   !> explicit             for the traits of the model every stage needs only earlier stages
   !> mean_force           the tableau of averaged forces, and noise in the momenta
   !> midpoint ..          the midpoint rule, without momenta, of one degree of freedom, of all unknowns
   !> euler_pair           the Euler pair if it is implicit
   !> one_dof, stages      several implicit stages: of one degree of freedom, or with eliminated momenta
   !> forced_stages        implicit stages of many unknowns under forces
   subroutine offer(i, task, stepper)
      integer, intent(in) :: i   !! model_flow .. last_stepper
      type(stepper_task), intent(in) :: task
      class(stepper_type), allocatable, intent(inout) :: stepper  !! not allocated; still so if it does not fit

      ! The number of a stepper; negative for a single path.
      select case (merge(-i, i, task%nlane == 1))
      case (model_flow, -model_flow); if (allocated(task%flow)) allocate (model_flow_stepper :: stepper)
      case (verlet_dz, -verlet_dz); if (task%scheme%frame == frame_shift) allocate (verlet_dz_stepper :: stepper)
      case (mean_path, -mean_path); if (task%scheme%frame == frame_mean_path) allocate (mean_path_stepper :: stepper)
      case (explicit, -explicit); if (explicit_fits(task)) call offer_explicit(task, stepper)
      case (mean_force); if (mean_force_fits(task)) allocate (mean_force_stepper :: stepper)
      case (-mean_force); if (mean_force_fits(task)) allocate (mean_force_single_path :: stepper)
      case (midpoint); if (midpoint_fits(task)) allocate (midpoint_stepper :: stepper)
      case (-midpoint); if (midpoint_fits(task)) allocate (midpoint_single_path :: stepper)
      case (midpoint_one_dof); if (midpoint_one_dof_fits(task)) allocate (midpoint_one_dof_stepper :: stepper)
      case (-midpoint_one_dof); if (midpoint_one_dof_fits(task)) allocate (midpoint_one_dof_single_path :: stepper)
      case (midpoint_full); if (midpoint_full_fits(task)) allocate (midpoint_full_stepper :: stepper)
      case (-midpoint_full); if (midpoint_full_fits(task)) allocate (midpoint_full_single_path :: stepper)
      case (euler_pair, -euler_pair); if (euler_pair_fits(task)) allocate (euler_pair_stepper :: stepper)
      case (one_dof); if (one_dof_fits(task)) allocate (one_dof_stepper :: stepper)
      case (-one_dof); if (one_dof_fits(task)) allocate (one_dof_single_path :: stepper)
      case (stages); if (stages_fits(task)) allocate (stages_stepper :: stepper)
      case (-stages); if (stages_fits(task)) allocate (stages_single_path :: stepper)
      case (forced_stages, -forced_stages); if (forced_stages_fit(task)) allocate (forced_stages_stepper :: stepper)
         ! The oracles follow, which test only the form of the scheme.
      case (general, -general); if (task%is_tableau()) allocate (general_stepper :: stepper)
      case (euler_maruyama, -euler_maruyama); if (task%scheme%form == ito_form) call offer_explicit(task, stepper)
      case (galerkin, -galerkin); if (task%scheme%form == galerkin_form) allocate (galerkin_stepper :: stepper)
      case default  ! splitting
         if (task%scheme%form == splitting_form .or. task%scheme%frame == frame_rotation) then
            if (task%nlane == 1) allocate (splitting_single_path :: stepper)
            if (task%nlane > 1) allocate (splitting_stepper :: stepper)
         end if
      end select
   end subroutine offer

   !> Explicit steps: of a single path with the sine and cosine terms of an angle, of any other single path, or of a
   !> block. angle_steps_fit tests for one lane itself.
   subroutine offer_explicit(task, stepper)
      type(stepper_task), intent(in) :: task
      class(stepper_type), allocatable, intent(inout) :: stepper

      if (angle_steps_fit(task)) then
         allocate (explicit_angle_stepper :: stepper)
      else if (task%nlane == 1) then
         allocate (explicit_single_path :: stepper)
      else
         allocate (explicit_stepper :: stepper)
      end if
   end subroutine offer_explicit

   !> Make a stepper for blocks of nlane lanes and resolve its task: for callers that make only one stepper.
   subroutine new_stepper(stepper, model, scheme, options, nlane, error)
      class(stepper_type), allocatable, intent(out) :: stepper
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in), target :: scheme
      type(stepper_options), intent(in) :: options
      integer, intent(in) :: nlane
      type(error_type), allocatable, intent(inout) :: error
      type(stepper_task), target :: task

      ! The task lives only during this call; the stepper copies what it needs.
      call resolve_task(task, model, scheme, options, error)
      if (.not. allocated(error)) call make_stepper(stepper, task, model, nlane, error)
   end subroutine new_stepper

   !> Choose and make a stepper for blocks of nlane lanes: the first of the list that fits the task. The model is a
   !> separate argument, since blocks may use a view of it that hides their padding.
   recursive subroutine make_stepper(stepper, wanted, model, nlane, error)
      class(stepper_type), allocatable, intent(out) :: stepper
      type(stepper_task), intent(in) :: wanted
      class(model_type), intent(in), target :: model
      integer, intent(in) :: nlane
      type(error_type), allocatable, intent(inout) :: error
      type(stepper_task) :: task
      integer :: i, first

      ! A copy: threads make steppers from the same task at the same time, each with its own lanes and view.
      task = wanted
      task%model => model
      task%nlane = nlane
      if (task%damping%acts()) call offer_damped(task, stepper, error)
      if (allocated(error)) return
      ! If an oracle is demanded, the list begins with the oracles. For damped models `midpoint`, `one_dof` and `stages`
      ! implement decays among the special steppers.
      first = merge(first_oracle, model_flow, task%general)
      if (task%damping%acts() .and. .not. task%general) first = merge(midpoint, one_dof, task%scheme%is_midpoint())
      do i = first, last_stepper
         if (allocated(stepper)) exit
         if (associated(model%forces) .and. all(i /= with_forces)) cycle
         ! forced stages with bands sweep a whole block at once
         if (i == midpoint_full .and. model%traits%reach() >= 0 .and. forced_stages_fit(task)) cycle
         call offer(i, task, stepper)
      end do
      if (allocated(stepper)) then
         call stepper%make(task)
      else
         call raise(error, incompatible, 'new_stepper', 'the option general does not go with scheme '// &
                    task%scheme%name//': its only stepper is made for the models that it allows, and there is no '// &
                    'general one to compare with; leave the option out')
      end if
   end subroutine make_stepper

   !> Offer the stepper of a damped model that is not in the list: whole steps that decay by themselves, steps of the
   !> closed system between two decays, or decays in explicit stages. The general stepper has decays by rates itself.
   recursive subroutine offer_damped(task, stepper, error)
      type(stepper_task), intent(in) :: task
      class(stepper_type), allocatable, intent(inout) :: stepper  !! not allocated; still so if none fits
      type(error_type), allocatable, intent(inout) :: error
      logical :: flow_decays

      if (task%general .and. allocated(task%damping%rate)) return
      flow_decays = allocated(task%flow)
      if (flow_decays) flow_decays = task%flow%damped
      if (task%scheme%frame == frame_shift .and. .not. task%general) then
         allocate (verlet_dz_stepper :: stepper)
      else if (flow_decays) then
         allocate (model_flow_stepper :: stepper)
      else if (damped_fits(task) .and. .not. (decays_in_midpoint(task) .or. decays_in_tableau(task))) then
         call offer_between_decays(task, stepper, error)
      else if (explicit_fits(task)) then
         if (decays_here(task%scheme, task%model%traits)) then
            call offer_explicit(task, stepper)
         else
            allocate (damped_explicit_stepper :: stepper)
         end if
      end if
   end subroutine offer_damped

   !> Whether the midpoint rule without momenta makes the step: decays are rates, no force acts, and the model has no
   !> whole steps.
   logical function decays_in_midpoint(task)
      type(stepper_task), intent(in) :: task

      decays_in_midpoint = allocated(task%damping%rate) .and. .not. allocated(task%flow) .and. &
                           .not. associated(task%model%forces)
      if (decays_in_midpoint) decays_in_midpoint = midpoint_fits(task)
   end function decays_in_midpoint

   !> Whether the explicit stepper has the decays of a scheme of one stage.
   logical function decays_in_tableau(task)
      type(stepper_task), intent(in) :: task

      decays_in_tableau = allocated(task%damping%rate) .and. .not. allocated(task%flow)
      if (decays_in_tableau) decays_in_tableau = explicit_fits(task)
      if (decays_in_tableau) decays_in_tableau = decays_here(task%scheme, task%model%traits)
   end function decays_in_tableau

   !> A stepper of the closed system between decays of the momenta.
   recursive subroutine offer_between_decays(task, stepper, error)
      type(stepper_task), intent(in) :: task
      class(stepper_type), allocatable, intent(inout) :: stepper
      type(error_type), allocatable, intent(inout) :: error
      class(damped_stepper), allocatable :: damped
      type(stepper_task) :: closed

      closed = task
      closed%damping = damping_type()
      if (allocated(task%damping%friction)) then
         allocate (rubbed_stepper :: damped)
      else if (.not. task%damping%is_constant()) then
         allocate (braked_stepper :: damped)
      else
         allocate (damped)
      end if
      call make_stepper(damped%inner, closed, task%model, task%nlane, error)
      call move_alloc(damped, stepper)
   end subroutine offer_between_decays

end module symsde_step_factory
