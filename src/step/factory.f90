! SPDX-License-Identifier: BSD-3-Clause
!> The one place where a stepper is chosen: scheme data and model traits in, the cheapest valid stepper out.
module symsde_step_factory
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, incompatible, invalid_argument
   use symsde_base_text, only: to_text
   use symsde_model_abstract, only: model_type
   use symsde_model_kubo, only: kubo_model
   use symsde_scheme_scheme, only: scheme_type, bracket_terms, galerkin_form, ito_form, &
                                   correction_auto, correction_none, correction_mean, correction_increments, &
                                   special_none, special_verlet_dz, special_averaged_shift, &
                                   special_drift_preserving, special_exact_rotation
   use symsde_solve_newton, only: newton_options, check_newton
   use symsde_step_averaged_shift, only: averaged_shift_stepper, new_averaged_shift_stepper
   use symsde_step_drift_preserving, only: drift_preserving_stepper, new_drift_preserving_stepper
   use symsde_step_exact_rotation, only: exact_rotation_stepper, new_exact_rotation_stepper
   use symsde_step_euler_maruyama, only: euler_maruyama_stepper, new_euler_maruyama_stepper
   use symsde_step_euler_oscillator, only: euler_oscillator_stepper, new_euler_oscillator_stepper, fits_euler_oscillator
   use symsde_step_explicit, only: explicit_stepper, new_explicit_stepper, is_explicit
   use symsde_step_galerkin, only: galerkin_stepper, new_galerkin_stepper
   use symsde_step_modified_hamiltonian, only: active_brackets
   use symsde_step_general, only: general_stepper, new_general_stepper
   use symsde_step_midpoint, only: midpoint_stepper, new_midpoint_stepper, fits_midpoint_stepper
   use symsde_step_midpoint_kubo, only: midpoint_kubo_stepper, new_midpoint_kubo_stepper
   use symsde_step_midpoint_single, only: midpoint_single_stepper, new_midpoint_single_stepper
   use symsde_step_midpoint_full, only: midpoint_full_stepper, new_midpoint_full_stepper
   use symsde_step_one_sided, only: one_sided_stepper, new_one_sided_stepper, is_one_sided
   use symsde_step_stages, only: stages_stepper, new_stages_stepper, fits_stages
   use symsde_step_stepper, only: stepper_type
   use symsde_step_two_stage_single, only: two_stage_single_stepper, new_two_stage_single_stepper, &
                                           fits_two_stage_single
   use symsde_step_verlet_dz, only: verlet_dz_stepper, new_verlet_dz_stepper
   implicit none
   private
   public :: stepper_options, new_stepper, resolve_correction

   type :: stepper_options
      integer :: correction = correction_auto
      logical :: general = .false.   !! use the general stepper, the oracle, whatever the traits allow
      type(newton_options) :: newton
   end type stepper_options

contains

   !> Choose and construct. Refuses combinations that do not fit, with the reason.
   subroutine new_stepper(stepper, model, scheme, options, nlane, error)
      class(stepper_type), allocatable, intent(out) :: stepper
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      type(stepper_options), intent(in) :: options
      integer, intent(in) :: nlane
      type(error_type), allocatable, intent(inout) :: error
      type(bracket_terms) :: active
      integer :: correction

      active = active_brackets(scheme%brackets, model%traits)
      call check_newton(options%newton, error)
      if (allocated(error)) return
      call resolve_correction(correction, model, scheme, options%correction, error)
      if (allocated(error)) return
      if (scheme%special /= special_none) then
         call check_special(model, scheme, error)
         if (allocated(error)) return
         call allocate_special(stepper, scheme, options)
      else if (scheme%form == ito_form) then
         allocate (euler_maruyama_stepper :: stepper)
      else if (scheme%form == galerkin_form) then
         call check_galerkin(model, scheme, error)
         if (allocated(error)) return
         allocate (galerkin_stepper :: stepper)
      else if (options%general) then
         allocate (general_stepper :: stepper)
      else if (active%are_added()) then
         call allocate_expanded(stepper, model, scheme, options)
      else if (correction == correction_none .and. fits_euler_oscillator(model, scheme)) then
         allocate (euler_oscillator_stepper :: stepper)
      else if (correction == correction_none .and. is_explicit(model, scheme)) then
         allocate (explicit_stepper :: stepper)
      else if (is_midpoint(scheme)) then
         call allocate_midpoint(stepper, model, options)
      else if (is_one_sided(scheme)) then
         allocate (one_sided_stepper :: stepper)
      else if (correction == correction_none .and. fits_two_stage_single(model, scheme, options%newton)) then
         allocate (two_stage_single_stepper :: stepper)
      else if (correction == correction_none .and. fits_stages(model, scheme, options%newton)) then
         allocate (stages_stepper :: stepper)
      else
         allocate (general_stepper :: stepper)
      end if
      call construct(stepper, model, scheme, correction, options, nlane)
   end subroutine new_stepper

   !> Steppers for additive or position noise alone. The general one executes drift_preserving.
   subroutine allocate_special(stepper, scheme, options)
      class(stepper_type), allocatable, intent(out) :: stepper
      type(scheme_type), intent(in) :: scheme
      type(stepper_options), intent(in) :: options

      if (scheme%special == special_verlet_dz) then
         allocate (verlet_dz_stepper :: stepper)
      else if (scheme%special == special_averaged_shift) then
         allocate (averaged_shift_stepper :: stepper)
      else if (scheme%special == special_exact_rotation) then
         allocate (exact_rotation_stepper :: stepper)
      else if (options%general) then
         allocate (general_stepper :: stepper)
      else
         allocate (drift_preserving_stepper :: stepper)
      end if
   end subroutine allocate_special

   !> Steppers that add the brackets of schemes beyond order one.
   subroutine allocate_expanded(stepper, model, scheme, options)
      class(stepper_type), allocatable, intent(out) :: stepper
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme
      type(stepper_options), intent(in) :: options

      if (fits_two_stage_single(model, scheme, options%newton)) then
         allocate (two_stage_single_stepper :: stepper)
      else if (fits_stages(model, scheme, options%newton)) then
         allocate (stages_stepper :: stepper)
      else
         allocate (general_stepper :: stepper)
      end if
   end subroutine allocate_expanded

   !> The midpoint rule, from the most to the least special: fused, momenta eliminated, closed form, full.
   subroutine allocate_midpoint(stepper, model, options)
      class(stepper_type), allocatable, intent(out) :: stepper
      class(model_type), intent(in) :: model
      type(stepper_options), intent(in) :: options

      select type (model)
      type is (kubo_model)
         if (options%newton%fixed_point == 0) allocate (midpoint_kubo_stepper :: stepper)
      end select
      if (allocated(stepper)) return
      if (fits_midpoint_stepper(model)) then
         allocate (midpoint_stepper :: stepper)
      else if (model%traits%ndof == 1) then
         allocate (midpoint_single_stepper :: stepper)
      else
         allocate (midpoint_full_stepper :: stepper)
      end if
   end subroutine allocate_midpoint

   !> Construct the stepper of the chosen type.
   subroutine construct(stepper, model, scheme, correction, options, nlane)
      class(stepper_type), intent(inout) :: stepper
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      integer, intent(in) :: correction, nlane
      type(stepper_options), intent(in) :: options

      select type (stepper)
      type is (verlet_dz_stepper)
         call new_verlet_dz_stepper(stepper, model, nlane)
      type is (exact_rotation_stepper)
         call new_exact_rotation_stepper(stepper, model, nlane)
      type is (averaged_shift_stepper)
         call new_averaged_shift_stepper(stepper, model, nlane, options%newton)
      type is (drift_preserving_stepper)
         call new_drift_preserving_stepper(stepper, model, scheme, nlane, options%newton)
      type is (euler_maruyama_stepper)
         call new_euler_maruyama_stepper(stepper, model, nlane)
      type is (euler_oscillator_stepper)
         call new_euler_oscillator_stepper(stepper, model, scheme, nlane)
      type is (explicit_stepper)
         call new_explicit_stepper(stepper, model, scheme, nlane)
      type is (midpoint_stepper)
         call new_midpoint_stepper(stepper, model, nlane, options%newton)
      type is (galerkin_stepper)
         call new_galerkin_stepper(stepper, model, scheme, nlane, options%newton)
      type is (midpoint_kubo_stepper)
         select type (model)
         type is (kubo_model)
            call new_midpoint_kubo_stepper(stepper, model, nlane)
         end select
      type is (midpoint_single_stepper)
         call new_midpoint_single_stepper(stepper, model, nlane, options%newton)
      type is (midpoint_full_stepper)
         call new_midpoint_full_stepper(stepper, model, nlane, options%newton)
      type is (one_sided_stepper)
         call new_one_sided_stepper(stepper, model, scheme, correction, nlane, options%newton)
      type is (two_stage_single_stepper)
         call new_two_stage_single_stepper(stepper, model, scheme, nlane, options%newton)
      type is (stages_stepper)
         call new_stages_stepper(stepper, model, scheme, nlane, options%newton)
      type is (general_stepper)
         call new_general_stepper(stepper, model, scheme, correction, nlane, options%newton)
      end select
   end subroutine construct

   !> Which correction is active: auto means the increments form, or none where it vanishes.
   subroutine resolve_correction(correction, model, scheme, wanted, error)
      integer, intent(out) :: correction
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme
      integer, intent(in) :: wanted
      type(error_type), allocatable, intent(inout) :: error
      logical :: one_sided

      correction = correction_none
      one_sided = abs(scheme%correction_coefficient()) > 0
      select case (wanted)
      case (correction_none)
      case (correction_auto)
         if (.not. one_sided .or. model%traits%correction_vanishes()) return
         if (scheme%symplectic) then
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

   !> More nodes than degrees leave the momenta to be found from the velocities: that needs H_pp regular
   !> and no noise in it, or the equations become singular by chance.
   subroutine check_galerkin(model, scheme, error)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme
      type(error_type), allocatable, intent(inout) :: error

      associate (t => model%traits)
         if (t%position_noise .or. t%nnoise == 0) return
         if (t%additive .and. scheme%noise_coefficients_equal()) return
      end associate
      call raise(error, incompatible, 'new_stepper', 'scheme '//scheme%name//' has more nodes than degrees and '// &
                 'needs noises in position (or additive ones, if drift and noise share their weights); model '// &
                 model%name//' declares neither: use a scheme with as many nodes as its degree, such as '// &
                 'midpoint or gauss2')
   end subroutine check_galerkin

   !> The schemes for additive noise use that its fields are constant; two of them that it kicks p alone.
   subroutine check_special(model, scheme, error)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme
      type(error_type), allocatable, intent(inout) :: error
      character(:), allocatable :: wanted

      associate (t => model%traits)
         if (scheme%special == special_exact_rotation) then
            call check_rotation(model, scheme, error)
            return
         else if (.not. (t%additive .or. t%nnoise == 0)) then
            wanted = 'additive noise (trait additive)'
         else if (scheme%special == special_averaged_shift) then
            return
         else if (.not. (t%position_noise .or. t%nnoise == 0)) then
            wanted = 'noise in p alone (trait position_noise)'
         else if (.not. t%identity_mass) then
            wanted = 'H = p.p/2 + U(q) (trait identity_mass)'
         else
            return
         end if
      end associate
      call raise(error, incompatible, 'new_stepper', 'scheme '//scheme%name//' needs '//wanted//'; model '// &
                 model%name//' does not declare it: use gauss2_strong32 for strong order 3/2, or midpoint')
   end subroutine check_special

   !> Kicks that do not move q, around the flow of a linear part that is declared.
   subroutine check_rotation(model, scheme, error)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme
      type(error_type), allocatable, intent(inout) :: error
      character(:), allocatable :: wanted

      associate (t => model%traits)
         if (.not. (t%position_noise .or. t%nnoise == 0)) then
            wanted = 'noise in p alone (trait position_noise)'
         else if (.not. t%identity_mass) then
            wanted = 'H = p.p/2 + U(q) (trait identity_mass)'
         else if (.not. allocated(t%rotation)) then
            wanted = 'the frequencies of the linear part of H (trait rotation)'
         else
            return
         end if
      end associate
      call raise(error, incompatible, 'new_stepper', 'scheme '//scheme%name//' needs '//wanted//'; model '// &
                 model%name//' does not declare it: use stormer_verlet, or midpoint where it is stiff')
   end subroutine check_rotation

   !> One stage at the middle of both q and p, drift and noise alike.
   pure logical function is_midpoint(scheme)
      type(scheme_type), intent(in) :: scheme

      is_midpoint = .false.
      if (scheme%nstage /= 1) return
      if (.not. scheme%noise_coefficients_equal()) return
      is_midpoint = abs(scheme%a(1, 1) - 0.5_wp) <= 0 .and. abs(scheme%abar(1, 1) - 0.5_wp) <= 0
   end function is_midpoint

end module symsde_step_factory
