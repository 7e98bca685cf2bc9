! SPDX-License-Identifier: BSD-3-Clause
!> Advice for models of users that declare nothing of their Hamiltonians: which traits their gradient does not refute
!> around the initial state, and what a step would leave out if they were declared.
!>
!> Private to its family.
module symsde_ensemble_run_undeclared
   use symsde_base_kinds, only: wp, i8
   use symsde_base_text, only: add_line => append_line, to_text
   use symsde_base_traits, only: model_traits, dense
   use symsde_model_abstract, only: model_type
   use symsde_model_catalogue_by_name, only: is_built_in
   use symsde_model_probe_traits, only: find_traits
   use symsde_scheme_dependency, only: is_explicit
   use symsde_scheme_scheme, only: correction_none
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: warn_of_undeclared

   integer(i8), parameter :: worth_a_probe = 1000  !! steps of blocks: the probe takes as many gradients as some tens

contains

   !> Add a sentence to the warnings, if declared traits would save work in the steps of this task. Short runs get no
   !> advice, which would cost as much as they do.
   subroutine warn_of_undeclared(text, model, task, explicit, nstep, t, q0, p0)
      character(:), allocatable, intent(inout) :: text
      class(model_type), intent(in) :: model
      type(stepper_task), intent(in) :: task
      logical, intent(in) :: explicit            !! whether the step calls no solver as it is
      integer(i8), intent(in) :: nstep           !! steps of all blocks; 0: any number follows
      real(wp), intent(in) :: t, q0(:), p0(:)    !! time, and state of one path (ndof)
      type(model_traits) :: found
      character(:), allocatable :: saved, names
      logical :: decided

      if (nstep > 0 .and. nstep < worth_a_probe) return
      if (explicit .and. task%correction == correction_none) return
      if (is_built_in(model) .or. model%passed%is_kept() .or. says_something(model%traits)) return
      call find_traits(model, t, q0, p0, found, decided)
      if (.not. decided) return
      saved = ''
      if (.not. explicit) then
         if (would_be_explicit(task, found)) then
            call list(saved, 'all equations, since the step is explicit')
         else
            if (found%eliminates_momenta()) call list(saved, 'the momenta among the unknowns')
            if (found%one_solve(found%bandwidth >= 0)) call list(saved, 'all iterations but one')
            if (found%bandwidth >= 0) call list(saved, 'entries of matrices outside of their bands')
         end if
      end if
      if (task%correction /= correction_none .and. found%correction_vanishes()) call list(saved, 'the correction')
      if (len(saved) == 0) return
      names = ''
      if (found%separable) call list(names, 'separable')
      if (found%quadratic) call list(names, 'quadratic')
      if (found%identity_mass) call list(names, 'identity_mass')
      if (found%constant_mass) call list(names, 'constant_mass')
      if (found%diagonal_mass) call list(names, 'diagonal_mass')
      if (found%additive) call list(names, 'additive')
      if (found%position_noise) call list(names, 'position_noise')
      if (found%bandwidth >= 0) call list(names, 'bandwidth '//to_text(found%bandwidth))
      call add_line(text, 'model '//model%name//' declares no traits, and at three points around the initial state '// &
                    'these hold: '//names//'. Steps of '//task%scheme%name//' then leave out '//saved//'. A probe '// &
                    'proves none of them: declare which are true, or take them as probed')
   end subroutine warn_of_undeclared

   !> Whether a model declares anything of its Hamiltonians.
   pure logical function says_something(traits)
      type(model_traits), intent(in) :: traits

      says_something = traits%separable .or. traits%additive .or. traits%position_noise .or. traits%quadratic .or. &
                       traits%has_constant_mass() .or. traits%bandwidth /= dense .or. traits%touches%are_given() .or. &
                       allocated(traits%silent) .or. allocated(traits%quadratic_part)
   end function says_something

   !> Whether the scheme would need no solver for these traits.
   pure logical function would_be_explicit(task, traits)
      type(stepper_task), intent(in) :: task
      type(model_traits), intent(in) :: traits

      would_be_explicit = (task%correction == correction_none .or. traits%correction_vanishes()) .and. &
                          task%scheme%noise_coefficients_equal() .and. is_explicit(task%scheme, traits%splits())
   end function would_be_explicit

   !> Add a member to a list with commas.
   pure subroutine list(text, member)
      character(:), allocatable, intent(inout) :: text
      character(*), intent(in) :: member

      if (len(text) > 0) text = text//', '
      text = text//member
   end subroutine list

end module symsde_ensemble_run_undeclared
