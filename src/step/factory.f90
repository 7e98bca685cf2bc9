! SPDX-License-Identifier: BSD-3-Clause
!> The choice of a stepper: an ordered list of steppers that decide themselves whether they fit.
!>
!> A run resolves its task once (`resolve_task`): this decides on the correction of one-sided schemes, checks what the
!> scheme needs from the model, and replaces a Galerkin scheme by a tableau if both are the same for the model. Then
!> blocks of every width are made from the task (`make_stepper`): the first stepper of the list that fits is taken. A
!> stepper that fits omits work that the traits of the model prove to be unnecessary; the general steppers at the end of
!> the list, called oracles, omit nothing, and a task may demand one of them.
!>
!> The choice depends on the traits of the model and on the form, frame and coefficients of the scheme. For one lane the
!> instance of a body for a single path is allocated, if there is one.
module symsde_step_factory
   use symsde_base_contracts, only: contracts_are_executed
   use symsde_base_damping, only: damping_type, noise_of_scheme, noise_law2, noise_law3, noise_path, &
                                  noise_polynomial
   use symsde_base_functionals, only: path_stt_area
   use symsde_base_kinds, only: wp
   use symsde_base_laws, only: law_gaussian
   use symsde_base_status, only: error_type, raise, incompatible, invalid_argument
   use symsde_base_text, only: to_text
   use symsde_model_abstract, only: model_type
   use symsde_scheme_contract, only: require_scheme
   use symsde_scheme_damped, only: damped_refusal, one_rate, unequal_rates, friction_matrix, varying_rates
   use symsde_scheme_dependency, only: is_explicit
   use symsde_scheme_galerkin_tableau, only: find_tableau
   use symsde_scheme_kicks, only: flow_midpoint
   use symsde_base_traits, only: model_traits
   use symsde_scheme_needs, only: find_missing, find_beside, by_parts
   use symsde_scheme_scheme, only: scheme_type, tableau_form, correction_auto, correction_none, correction_mean, &
                                   correction_increments, frame_shift, frame_mean_path, frame_rotation, ito_form, &
                                   galerkin_form, splitting_form, bracket_terms, frame_none
   use symsde_solve_newton, only: newton_options, check_newton
   use symsde_step_open_kick_law, only: can_choose
   use symsde_step_open_braked, only: braked_stepper
   use symsde_step_open_damped, only: damped_stepper, damped_fits
   use symsde_step_open_linear_noise, only: has_linear_law
   use symsde_step_open_rubbed, only: rubbed_stepper
   use symsde_step_hamiltonian_brackets, only: active_brackets
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
   use symsde_step_flow_model_flow, only: model_flow_stepper, find_flow
   implicit none
   private
   public :: stepper_options, new_stepper, resolve_task, make_stepper, resolve_correction

   !> Wishes of a caller, besides scheme and model. `general` starts the list at the oracles, `as_increments` excludes
   !> steppers that compute only states.
   type :: stepper_options
      integer :: correction = correction_auto
      integer :: damping_noise = noise_of_scheme  !! of kicks between drifts that decay, by base/damping
      logical :: general = .false.   !! use the oracle of the scheme, whatever the traits allow
      type(newton_options) :: newton = newton_options()
      logical :: as_increments = .false.  !! for compensated sums: exclude states, whose last digit is coarser
      real(wp) :: step = 0           !! step with its sign [time], 0 where none is known
   end type stepper_options

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

   !> Resolve the task of steppers for a model, once for blocks of every width. Refuses wrong numbers of iterations,
   !> corrections that the scheme does not allow, and models that lack what the scheme needs; the message gives the
   !> reason. `follows` is true if a stage needs only earlier stages, by the zeros of a and abar and the traits.
   subroutine resolve_task(task, model, scheme, options, error)
      type(stepper_task), intent(out), target :: task
      class(model_type), intent(in), target :: model    !! must live as long as the task, like the scheme
      type(scheme_type), intent(in), target :: scheme
      type(stepper_options), intent(in) :: options
      type(error_type), allocatable, intent(inout) :: error

      ! Check options first, then the correction against the scheme, then the model against the scheme: the message
      ! names the first that fails.
      call check_newton(options%newton, error)
      if (allocated(error)) return
      call resolve_correction(task%correction, model, scheme, options%correction, error)
      if (allocated(error)) return
      call check_needs(model, scheme, error)
      if (allocated(error)) return
      if (contracts_are_executed) call require_scheme(scheme, 'step, task')
      task%model => model
      task%damping = model%damping
      task%damping_noise = options%damping_noise
      task%scheme => scheme
      ! a Galerkin scheme that is a tableau for this model is executed as a tableau, but by its own oracle if general is
      ! true
      if (.not. associated(model%forces)) call find_tableau(scheme, model%traits, task%tableau)
      if (allocated(task%tableau) .and. .not. options%general) task%scheme => task%tableau
      if (task%scheme%form == tableau_form) &
         task%follows = task%scheme%noise_coefficients_equal() .and. is_explicit(task%scheme, model%traits%splits())
      ! Options that steppers read from the task.
      task%newton = options%newton
      task%as_increments = options%as_increments
      task%general = options%general
      call check_damping(task, options%step, error)
      call check_damping_noise(task, error)
      call check_forces(task, error)
      call find_flow(task)
      call check_parts(task, options, error)
   end subroutine resolve_task

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
      if (task%damping%acts() .and. .not. (task%general .and. allocated(task%damping%rate))) then
         if (task%scheme%frame == frame_shift .and. .not. task%general) then
            allocate (verlet_dz_stepper :: stepper)
            call stepper%make(task)
            return
         else if (flow_is_damped(task)) then
            allocate (model_flow_stepper :: stepper)
            call stepper%make(task)
            return
         else if (damped_fits(task) .and. .not. (decays_in_midpoint(task) .or. decays_in_tableau(task))) then
            call make_damped(stepper, task, error)
            return
         else if (explicit_fits(task)) then
            if (decays_here(task%scheme, task%model%traits)) then
               call offer_explicit(task, stepper)
            else
               allocate (damped_explicit_stepper :: stepper)
            end if
            call stepper%make(task)
            return
         end if
      end if
      ! The first stepper that fits is made; if an oracle is demanded, the list begins with the oracles. For damped
      ! models `midpoint`, `one_dof` and `stages` implement decays among the special steppers.
      first = merge(first_oracle, model_flow, task%general)
      if (task%damping%acts() .and. .not. task%general) first = merge(midpoint, one_dof, task%scheme%is_midpoint())
      do i = first, last_stepper
         if (associated(model%forces) .and. all(i /= with_forces)) cycle
         ! forced stages with bands sweep a whole block at once
         if (i == midpoint_full .and. model%traits%reach() >= 0 .and. forced_stages_fit(task)) cycle
         call offer(i, task, stepper)
         if (.not. allocated(stepper)) cycle
         call stepper%make(task)
         return
      end do
      call raise(error, incompatible, 'new_stepper', 'the option general does not go with scheme '//task%scheme%name// &
                 ': its only stepper is made for the models that it allows, and there is no general one to '// &
                 'compare with; leave the option out')
   end subroutine make_stepper

   !> Whether the model takes whole steps that decay by themselves.
   pure logical function flow_is_damped(task)
      type(stepper_task), intent(in) :: task

      flow_is_damped = allocated(task%flow)
      if (flow_is_damped) flow_is_damped = task%flow%damped
   end function flow_is_damped

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

   !> Make a stepper of the closed system between decays of the momenta.
   recursive subroutine make_damped(stepper, task, error)
      class(stepper_type), allocatable, intent(out) :: stepper
      type(stepper_task), intent(in) :: task
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
      if (allocated(error)) return
      call damped%make(task)
      call move_alloc(damped, stepper)
   end subroutine make_damped

   !> Refuse schemes that do not implement damping (scheme/damped), or not over a step of this length.
   subroutine check_damping(task, step, error)
      type(stepper_task), intent(in) :: task
      real(wp), intent(in) :: step
      type(error_type), allocatable, intent(inout) :: error
      character(:), allocatable :: why
      integer :: kind

      if (.not. task%damping%acts()) return
      kind = merge(one_rate, unequal_rates, task%damping%is_scalar())
      if (allocated(task%damping%friction)) kind = friction_matrix
      if (.not. task%damping%is_constant()) kind = varying_rates
      call damped_refusal(task%scheme, kind, active_brackets(task%scheme%brackets, task%model%traits), &
                          task%correction /= correction_none, why)
      if (allocated(why)) then
         call raise(error, incompatible, 'check_damping', 'model '//task%model%name//' is damped, and scheme '// &
                    task%scheme%name//' '//why//': use midpoint, gauss2 or gauss_dkdkd, or a model without damping')
      else if (task%model%traits%kicks_of_actions .and. task%scheme%needs%phases_will_do .and. &
               .not. task%scheme%needs%actions_will_do) then
         call raise(error, incompatible, 'check_damping', 'model '//task%model%name//' is damped, and scheme '// &
                    task%scheme%name//' adds products of noises of phases, which are bonds of its quadratic part '// &
                    '(split), and of decays of momenta are none: use gauss_dkdkd, of strong order 3/2, or a model '// &
                    'without damping')
      else if (kind == varying_rates .and. task%drifts_by_part()) then
         call raise(error, incompatible, 'check_damping', 'model '//task%model%name//' has rates of damping that '// &
                    'are functions, and drifts of scheme '//task%scheme%name//' are flows of its quadratic part '// &
                    '(split), which decay by numbers: give rates as numbers, or use midpoint')
      else if (kind == friction_matrix .and. .not. task%model%traits%has_constant_mass()) then
         call raise(error, incompatible, 'check_damping', 'model '//task%model%name//' does not declare H = '// &
                    'p.M^-1 p/2 + U(q) with a constant M (identity_mass, constant_mass), and a matrix of '// &
                    'friction acts on velocities M^-1 p: give rates of the momenta')
      else if (task%scheme%kicks%rational) then
         if (any(task%damping%rate*step <= -2)) &
            call raise(error, incompatible, 'check_damping', 'gamma h = '// &
                       to_text(minval(task%damping%rate*step))//' by step = '//to_text(step)//', and scheme '// &
                       task%scheme%name//' multiplies momenta by (1 - x)/(1 + x), x = gamma h/2, which has a pole '// &
                       'at gamma h = -2: give a shorter step, or word:BAOAB')
      end if
   end subroutine check_damping

   !> Refuse a choice of the noise of damped free motion where kicks have no such choice. The law that the scheme has
   !> anyway is no other choice, and has the bits of none.
   subroutine check_damping_noise(task, error)
      type(stepper_task), intent(inout) :: task
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error) .or. task%damping_noise == noise_of_scheme) return
      if (.not. task%damping%acts()) then
         call refuse('model '//task%model%name//' is not damped')
      else if (.not. has_linear_law(task%scheme, task%model%traits, task%damping, noise_of_scheme)) then
         if (.not. task%damping%is_scalar()) then
            call refuse('model '//task%model%name//' has no single rate of damping, so that kicks keep the weights '// &
                        'of the closed system unless noises are constant in position and time, for all paths alike')
         else if (task%drifts_by_part() .and. task%damping_noise /= noise_polynomial) then
            call refuse('drifts of model '//task%model%name//' are flows of its quadratic part (split), so that '// &
                        'kicks keep the weights of the closed system unless noises are constant in position and '// &
                        'time, for all paths alike')
         else if (.not. can_choose(task%scheme)) then
            call refuse('scheme '//task%scheme%name//' has no kicks between free drifts that follow dZ')
         end if
      else if (task%damping_noise == noise_path) then
         call refuse('the noise along the path merges for kicks between free drifts with one rate alone')
      end if
      if (task%damping_noise == merge(noise_law3, noise_law2, task%scheme%asks%has(path_stt_area))) &
         task%damping_noise = noise_of_scheme

   contains

      subroutine refuse(why)
         character(*), intent(in) :: why

         call raise(error, incompatible, 'check_damping_noise', 'a noise of damped free motion is chosen, and '//why// &
                    ': leave damping_noise out, or take one rate and a scheme of kicks, such as gauss_dkdkd')
      end subroutine refuse

   end subroutine check_damping_noise

   !> Refuse schemes that do not execute forces. Brackets are those of Hamiltonians, and a force is none: with forces
   !> f_k not even the fields of noises have Hamiltonian brackets.
   subroutine check_forces(task, error)
      type(stepper_task), intent(in) :: task
      type(error_type), allocatable, intent(inout) :: error
      type(bracket_terms) :: active

      if (allocated(error) .or. .not. associated(task%model%forces)) return
      active = active_brackets(task%scheme%brackets, task%model%traits)
      if (task%scheme%law /= law_gaussian) then
         call refuse('draws increments for means alone, whose order nobody has found for forces')
      else if (active%single .or. active%nested) then
         call refuse('adds brackets of Hamiltonians, and a force has none')
      else if (task%model%traits%forces%noise .and. task%scheme%brackets%areas) then
         call refuse('adds brackets of noises by their areas, and those of noise forces are no Hamiltonians')
      else if (task%scheme%frame /= frame_none .and. task%scheme%frame /= frame_shift) then
         call refuse('is made of flows of Hamiltonians, of which a force is none')
      else if (task%scheme%frame == frame_shift .and. task%model%traits%forces%noise) then
         call refuse('shifts positions by additive noises, which forces f_k are not')
      else if (task%model%traits%kicks_of_actions .and. task%scheme%form == splitting_form) then
         call refuse('kicks by functions of the actions (q_i^2 + p_i^2)/2, which do not commute with a force')
      else if (kicks_alone(task%scheme) .and. .not. task%model%traits%forces%drift_in_position) then
         call refuse('kicks momenta at given positions, and its kicks are exact for forces F(q,t) without p '// &
                     '(declare position_force where that is so)')
      end if

   contains

      subroutine refuse(why)
         character(*), intent(in) :: why

         call raise(error, incompatible, 'check_forces', 'forces act on model '//task%model%name//', and scheme '// &
                    task%scheme%name//' '//why//': use midpoint, gauss2 or stormer_verlet, or a model without forces')
      end subroutine refuse

   end subroutine check_forces

   !> Whether all of F acts by kicks, which needs a force of positions. Kicks of noises without products go with
   !> midpoint steps, in which F may depend on p.
   pure logical function kicks_alone(scheme)
      type(scheme_type), intent(in) :: scheme

      kicks_alone = scheme%frame == frame_shift
      if (scheme%form == splitting_form) &
         kicks_alone = scheme%kicks%flow /= flow_midpoint .or. scheme%needs%constant_mass
   end function kicks_alone

   !> Refuse a model that lacks what the scheme needs, and name a scheme that needs less.
   subroutine check_needs(model, scheme, error)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme
      type(error_type), allocatable, intent(inout) :: error
      character(:), allocatable :: missing, instead, beside

      ! `missing` lists the missing traits in the words of the message.
      call find_missing(scheme, model%traits, missing)
      if (.not. allocated(missing)) return
      if (.not. model%traits%has_gradient) then
         call find_beside(scheme, model%traits, beside)
         instead = 'use gauss_dkdkd, or verlet_dkd_weak2 for means,'
         ! These refuse forces and damped models.
         if (model%traits%forces%act()) instead = 'leave the forces out,'
         if (model%damping%acts()) instead = 'leave the damping out and use gauss_dkdkd,'
         call raise(error, incompatible, 'new_stepper', 'scheme '//scheme%name//' needs '//missing//'; '//instead// &
                    ' or give model '//model%name//' '//beside)
         return
      end if
      instead = scheme%needs%instead
      if (model%traits%kicks_of_actions .or. (allocated(model%traits%quadratic_part) .and. &
                                              model%traits%position_noise)) instead = 'gauss_dkdkd, or midpoint'
      ! Schemes of brackets and of kicks refuse such models.
      if (model%traits%forces%act() .or. model%damping%acts()) instead = 'midpoint'
      call raise(error, incompatible, 'new_stepper', 'scheme '//scheme%name//' needs '//missing//'; model '// &
                 model%name//' does not declare it: use '//instead)
   end subroutine check_needs

   !> Refuse tasks that steps made of two given flows do not serve, unless other steppers do by what the model declares
   !> beside the flows.
   subroutine check_parts(task, options, error)
      type(stepper_task), intent(in) :: task
      type(stepper_options), intent(in) :: options
      type(error_type), allocatable, intent(inout) :: error
      type(model_traits) :: others
      character(:), allocatable :: missing, why, beside

      if (allocated(error) .or. .not. by_parts(task%scheme, task%model%traits)) return
      others = task%model%traits
      others%has_parts = .false.
      call find_missing(task%scheme, others, missing)
      if (.not. allocated(missing)) return
      if (task%damping%acts()) then
         call find_beside(task%scheme, others, beside)
         why = 'is damped, and its flows drift and kick are those of a closed system: leave the damping out, or '// &
               'give it '//beside
      else if (options%general) then
         why = 'gives the flows drift and kick, of which the general stepper knows nothing: leave the option '// &
               'general out'
      else if (options%as_increments) then
         why = 'gives the flows drift and kick, which tell states and no increments: leave compensated sums out'
      else if (allocated(task%flow)) then
         return
      else
         why = 'gives the flows drift and kick, whose steps iterate nothing: leave the number of iterations out'
      end if
      call raise(error, incompatible, 'new_stepper', 'scheme '//task%scheme%name//': model '//task%model%name//' '//why)
   end subroutine check_parts

   !> Decide which correction is active: auto means the increments form, or none if it vanishes. A scheme needs a
   !> correction if its coefficient 1/2 - lambda is not zero. A vanishing correction is never computed, even if
   !> requested.
   !>
   !> Without correction such a scheme solves a different equation, that of H + (lambda - 1/2) sum_k H_{k,p}.H_{k,q}.
   !> Requesting no correction is allowed, and the run reports it; requesting one for a scheme that needs none is
   !> refused.
   subroutine resolve_correction(correction, model, scheme, wanted, error)
      integer, intent(out) :: correction
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme
      integer, intent(in) :: wanted
      type(error_type), allocatable, intent(inout) :: error
      logical :: one_sided

      correction = correction_none
      ! +-1/2 for the Euler pair; a coefficient that is zero to rounding has been made zero.
      one_sided = abs(scheme%correction_coefficient()) > 0
      select case (wanted)
      case (correction_none)
      case (correction_auto)
         if (.not. one_sided .or. model%traits%correction_vanishes()) return
         if (scheme%symplectic) then  ! the increments form has the higher strong order if noises commute
            correction = correction_increments
         else
            call raise(error, incompatible, 'resolve_correction', 'scheme '//scheme%name//' is not consistent '// &
                       'with the Stratonovich equation of model '//model%name//' and, not being symplectic, has '// &
                       'no correction: use heun or euler_maruyama, or correction "none" to run it all the same')
         end if
      case (correction_mean, correction_increments)
         if (.not. one_sided) then
            call raise(error, incompatible, 'resolve_correction', 'scheme '//scheme%name//' is consistent '// &
                       'with the Stratonovich equation as it stands and takes no correction: use '// &
                       'correction "auto" or "none", or a one-sided scheme such as symplectic_euler')
         else if (.not. model%traits%correction_vanishes()) then
            correction = wanted
         end if
      case default
         call raise(error, invalid_argument, 'resolve_correction', 'unknown correction '//to_text(wanted)// &
                    ': the corrections are auto, none, mean and increments')
      end select
   end subroutine resolve_correction

end module symsde_step_factory
