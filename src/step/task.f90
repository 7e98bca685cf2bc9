! SPDX-License-Identifier: BSD-3-Clause
!> The task of the steppers of a run: a scheme for a model, resolved once for blocks of every width.
!>
!>    correction   of a scheme that is one-sided, lambda = beta^T b e /= 1/2. Without one it solves the equation of
!>                 H + (lambda - 1/2) sum_k H_k,p . H_k,q
!>    scheme       a Galerkin scheme that is a tableau for this model becomes that tableau
!>    follows      whether each stage needs earlier stages alone, by the zeros of a and abar and the traits
!>    flow         whole steps of this scheme by the model itself (step/flow/model_flow)
!>
!> Refused are options of Newton's iteration, corrections that the scheme does not allow, and models that lack what it
!> needs; then damping, a choice of its noise, forces, and whatever steps by two given flows do not serve. The message
!> says what does not fit, and what would.
module symsde_step_task
   use symsde_base_contracts, only: contracts_are_executed
   use symsde_base_damping, only: noise_of_scheme, noise_law2, noise_law3, noise_path, noise_polynomial
   use symsde_base_functionals, only: path_stt_area
   use symsde_base_kinds, only: wp
   use symsde_base_laws, only: law_gaussian
   use symsde_base_status, only: error_type, raise, incompatible, invalid_argument
   use symsde_base_text, only: to_text
   use symsde_base_traits, only: model_traits
   use symsde_model_abstract, only: model_type
   use symsde_scheme_contract, only: require_scheme
   use symsde_scheme_damped, only: damped_refusal, one_rate, unequal_rates, friction_matrix, varying_rates
   use symsde_scheme_dependency, only: is_explicit
   use symsde_scheme_galerkin_tableau, only: find_tableau
   use symsde_scheme_kicks, only: flow_midpoint
   use symsde_scheme_needs, only: find_missing, find_beside, by_parts
   use symsde_scheme_scheme, only: scheme_type, tableau_form, correction_auto, correction_none, correction_mean, &
                                   correction_increments, frame_shift, splitting_form, bracket_terms, frame_none
   use symsde_solve_newton, only: newton_options, check_newton
   use symsde_step_flow_model_flow, only: find_flow
   use symsde_step_hamiltonian_brackets, only: active_brackets
   use symsde_step_open_kick_law, only: can_choose
   use symsde_step_open_linear_noise, only: has_linear_law
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: stepper_options, resolve_task, resolve_correction

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

contains

   !> Resolve the task of the steppers of a run. Errors: those at the head, of which the first is raised.
   subroutine resolve_task(task, model, scheme, options, error)
      type(stepper_task), intent(out), target :: task
      class(model_type), intent(in), target :: model    !! must live as long as the task, like the scheme
      type(scheme_type), intent(in), target :: scheme
      type(stepper_options), intent(in) :: options
      type(error_type), allocatable, intent(inout) :: error

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
      task%newton = options%newton
      task%as_increments = options%as_increments
      task%general = options%general
      call check_damping(task, options%step, error)
      call check_damping_noise(task, error)
      call check_forces(task, error)
      call find_flow(task)
      call check_parts(task, options, error)
   end subroutine resolve_task

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

end module symsde_step_task
