! SPDX-License-Identifier: BSD-3-Clause
!> Which linearised step belongs to a task, and which tasks have none, with the reason.
module symsde_step_linear_choice
   use symsde_base_kinds, only: wp
   use symsde_base_damping, only: damping_type
   use symsde_base_status, only: error_type, raise, incompatible, missing_operation, wrong_shape
   use symsde_base_text, only: to_text
   use symsde_base_traits, only: model_traits
   use symsde_model_abstract, only: model_type
   use symsde_scheme_catalogue, only: get_scheme
   use symsde_scheme_kicks, only: flow_midpoint
   use symsde_scheme_scheme, only: correction_none, frame_none, ito_form, galerkin_form, scheme_type
   use symsde_step_linear_eliminated, only: eliminated_step, eliminated_fits, new_eliminated_step
   use symsde_step_linear_kicks, only: kicks_step, new_kicks_step, steps_by_kicks, why_no_kicks
   use symsde_step_linear_kick_drift, only: kick_drift_step, kick_drift_fits, new_kick_drift
   use symsde_step_linear_linear_step, only: linear_step
   use symsde_step_linear_tableau, only: tableau_step, new_tableau_step
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: require_linear, new_linear_step

   integer, parameter :: most_unknowns = 256   !! limit of unknowns of a dense system of an implicit step

contains

   !> Refuse tasks and models whose steps cannot be linearised exactly.
   subroutine require_linear(task, wide, nrate, h, error)
      type(stepper_task), intent(in) :: task
      class(model_type), intent(in) :: wide    !! model with the parameters as further positions
      integer, intent(in) :: nrate             !! rates of damping that derivatives are by: none, or all
      real(wp), intent(in) :: h                !! step
      type(error_type), allocatable, intent(inout) :: error
      character(*), parameter :: place = 'linear_step', numbers = 'give rates of the momenta as numbers'
      character(:), allocatable :: why_not   !! of splitting schemes

      if (allocated(error)) return
      call why_no_kicks(task, wide, why_not)
      associate (t => task%model%traits, scheme => task%scheme)
         if (wide%traits%ndof < t%ndof .or. wide%traits%nnoise /= t%nnoise) then
            call raise(error, wrong_shape, place, 'the model with parameters as positions has '// &
                       to_text(wide%traits%ndof)//' degrees of freedom and '//to_text(wide%traits%nnoise)// &
                       ' noises; give at least '//to_text(t%ndof)//', and '//to_text(t%nnoise)//' noises')
         else if (.not. wide%traits%has_gradient) then
            call raise(error, missing_operation, place, 'model '//wide%name//' gives flows of two parts of H '// &
                       '(drift, kick) alone, and the derivative of a step is made of Hessians: give gradient, and '// &
                       'hessian or hessian_vector, beside the flows, or formulas')
         else if (.not. (wide%traits%has_hessian .or. wide%traits%has_hessian_vector)) then
            call raise(error, missing_operation, place, 'model '//wide%name//' has no Hessian and no products with '// &
                       'it, and the derivative of a step is made of them: give hessian or hessian_vector, or formulas')
         else if (wide%traits%npath > 0) then
            call raise(error, incompatible, place, 'parameters of model '//wide%name//' differ from path to path, '// &
                       'and the derivative of a step has one row of them: give them as further positions of the '// &
                       'wide model, with a row of parameters for each path')
         else if (is_silent(t, wide%traits)) then
            call refuse('a noise of model '//task%model%name//' is zero and not drawn, and a parameter changes it; '// &
                        'give the parameter a small value')
         else if (wide%traits%forces%act() .and. steps_by_kicks(task)) then
            call refuse('forces act between the drifts of scheme '//scheme%name)
         else if (wide%traits%forces%act() .and. .not. wide%traits%forces%has_derivative) then
            call refuse('forces of model '//task%model%name//' have no derivatives: give force_derivative, or formulas')
         else if (.not. task%damping%is_constant()) then
            call refuse('rates of damping of model '//task%model%name//' are functions', numbers)
         else if (allocated(task%damping%friction)) then
            call refuse('model '//task%model%name//' is damped by a matrix of friction', numbers)
         else if (nrate > 0 .and. steps_by_kicks(task)) then
            call refuse('scheme '//scheme%name//' has drifts that decay')
         else if (task%newton%fixed_point > 0) then
            call refuse('a given number of iterations does not solve the equations that are differentiated')
         else if (scheme%frame /= frame_none .and. .not. steps_by_kicks(task)) then
            call refuse('scheme '//scheme%name//' has a frame of dZ around its tableau')
         else if (len(why_not) > 0) then
            call refuse('scheme '//scheme%name//' '//why_not)
         else if (scheme%form == ito_form) then
            call refuse('scheme '//scheme%name//' steps the Ito form, whose drift holds second derivatives')
         else if (scheme%form == galerkin_form) then
            call refuse('scheme '//scheme%name//' has more nodes than degrees and is no tableau for this model')
         else if (task%has_brackets()) then
            call refuse('scheme '//scheme%name//' adds brackets, whose Hessians hold fourth derivatives')
         else if (task%correction /= correction_none) then
            call refuse('scheme '//scheme%name//' adds a correction, whose Hessian holds third derivatives')
         else if (unknowns_of(task, wide, nrate, h) > most_unknowns) then
            call refuse('an implicit step of '//to_text(unknowns_of(task, wide, nrate, h))// &
                        ' unknowns is solved by dense matrices, of at most '//to_text(most_unknowns))
         end if
      end associate

   contains

      subroutine refuse(why, instead)
         character(*), intent(in) :: why
         character(*), intent(in), optional :: instead   !! what to do, if other schemes are refused, too
         character(:), allocatable :: remedy

         remedy = 'use midpoint, gauss2 or stormer_verlet'
         if (present(instead)) remedy = instead
         call raise(error, incompatible, place, 'no exact derivative of the steps is known: '//why//'; '//remedy)
      end subroutine refuse

   end subroutine require_linear

   !> Unknowns of the linear system of a step.
   recursive integer function unknowns_of(task, wide, nrate, h) result(n)
      type(stepper_task), intent(in) :: task
      class(model_type), intent(in) :: wide
      integer, intent(in) :: nrate
      real(wp), intent(in) :: h
      type(scheme_type), target :: scheme
      type(stepper_task) :: midpoint

      n = 0
      if (steps_by_kicks(task)) then
         if (task%scheme%kicks%flow /= flow_midpoint) return
         call find_midpoint(task, scheme, midpoint)
         n = unknowns_of(midpoint, wide, nrate, h)
         return
      end if
      if (kick_drift_fits(task, wide) .and. nrate == 0) return
      n = task%model%traits%ndof*task%scheme%nstage
      if (.not. eliminated_fits(task, wide, h)) n = 2*n
   end function unknowns_of

   !> The task of midpoint steps between the kicks of a task; scheme: the midpoint rule, to which it points.
   subroutine find_midpoint(task, scheme, midpoint)
      type(stepper_task), intent(in) :: task
      type(scheme_type), intent(out), target :: scheme
      type(stepper_task), intent(out) :: midpoint
      type(error_type), allocatable :: error

      call get_scheme(scheme, 'midpoint', error)
      midpoint = task
      midpoint%scheme => scheme
      midpoint%damping = damping_type()
      midpoint%correction = correction_none
   end subroutine find_midpoint

   !> Whether a noise of the path is not drawn that the wide model has.
   pure logical function is_silent(narrow, wide)
      type(model_traits), intent(in) :: narrow, wide

      is_silent = .false.
      if (.not. allocated(narrow%silent)) return
      is_silent = any(narrow%silent)
      if (allocated(wide%silent)) is_silent = any(narrow%silent .and. .not. wide%silent)
   end function is_silent

   !> The linearised step of a task that require_linear has accepted, for blocks of nlane lanes.
   recursive subroutine new_linear_step(step, task, model, wide, nrate, h, nlane)
      class(linear_step), allocatable, intent(out) :: step
      type(stepper_task), intent(in) :: task
      class(model_type), intent(in), target :: model   !! the path's model, or a view that knows the lanes' paths
      class(model_type), intent(in), target :: wide
      integer, intent(in) :: nrate                     !! rates of damping that derivatives are by: none, or all
      real(wp), intent(in) :: h                        !! step
      integer, intent(in) :: nlane                     !! a multiple of 8
      type(kick_drift_step), allocatable :: kicks
      type(tableau_step), allocatable :: tableau
      type(eliminated_step), allocatable :: eliminated
      type(kicks_step), allocatable :: splitting
      type(scheme_type), target :: scheme
      type(stepper_task) :: midpoint
      class(linear_step), allocatable :: inner

      if (kick_drift_fits(task, wide) .and. nrate == 0) then
         allocate (kicks)
         call new_kick_drift(kicks, task, wide, nlane)
         call move_alloc(kicks, step)
      else if (steps_by_kicks(task)) then
         allocate (splitting)
         if (task%scheme%kicks%flow == flow_midpoint) then
            call find_midpoint(task, scheme, midpoint)
            call new_linear_step(inner, midpoint, model, wide, nrate, h, nlane)
            call new_kicks_step(splitting, task, model, wide, nlane, inner)
         else
            call new_kicks_step(splitting, task, model, wide, nlane)
         end if
         call move_alloc(splitting, step)
      else if (eliminated_fits(task, wide, h)) then
         allocate (eliminated)
         call new_eliminated_step(eliminated, task, model, wide, h, nlane)
         call move_alloc(eliminated, step)
      else
         allocate (tableau)
         call new_tableau_step(tableau, task, model, wide, nlane)
         call move_alloc(tableau, step)
      end if
      step%ham%exact_products = .true.
      step%nrow = step%nwide + nrate
      step%by_position = step%by_position .and. nrate == 0
   end subroutine new_linear_step

end module symsde_step_linear_choice
