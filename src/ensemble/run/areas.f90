! SPDX-License-Identifier: BSD-3-Clause
!> How the areas of a run are drawn, chosen by user and model, and whether the counters of the generator suffice.
!>
!> Private to its family.
module symsde_ensemble_run_areas
   use symsde_base_area_rule, only: area_rule, areas_in_law, most_paired
   use symsde_base_functionals, only: functional_set, path_areas
   use symsde_base_kinds, only: wp, i8
   use symsde_base_laws, only: law_gaussian
   use symsde_base_status, only: error_type, raise, incompatible, too_large
   use symsde_base_text, only: to_text
   use symsde_ensemble_options, only: run_options
   use symsde_model_abstract, only: model_type
   use symsde_model_probe_area_time, only: derive_area_time
   use symsde_model_probe_one_path, only: one_path
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: choose_areas, check_area_counters

contains

   !> Choose how areas are drawn, and refuse (incompatible) a choice that the scheme cannot use. The time scale for
   !> halving steps is the user's; if none is given and the scheme needs areas, it is derived from the model.
   subroutine choose_areas(model, scheme, options, asked, areas, error)
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      type(functional_set), intent(in) :: asked
      type(area_rule), intent(out) :: areas
      type(error_type), allocatable, intent(inout) :: error

      areas = area_rule(options%areas, options%area_time)
      if (areas%kind == areas_in_law) then
         if (.not. scheme%asks%has(path_areas)) then
            call raise(error, incompatible, 'run_ensemble', 'areas in law are asked for, and scheme '//scheme%name// &
                       ' draws none: leave the choice of areas out, or take a scheme with areas, such as '// &
                       'midpoint_areas')
         else if (scheme%law /= law_gaussian) then
            call raise(error, incompatible, 'run_ensemble', 'areas in law are asked for, and scheme '//scheme%name// &
                       ' has areas of two values: leave the choice of areas out, or take a scheme with Gaussian '// &
                       'increments, such as midpoint_areas')
         end if
      else if (scheme%law /= law_gaussian) then
         areas%time = 0  ! two-valued areas need no halving of steps
      else if (asked%has(path_areas) .and. .not. areas%time > 0) then
         call derive_area_time(model, options%t0, areas%time, error)
         if (model%traits%npath > 1) call require_equal_areas(model, options, areas, error)
      end if
   end subroutine choose_areas

   !> Refuse (incompatible) a model whose parameters go by path if its paths halve their steps differently often: none
   !> would have the areas that it has alone.
   subroutine require_equal_areas(model, options, areas, error)
      class(model_type), intent(in), target :: model
      type(run_options), intent(in) :: options
      type(area_rule), intent(in) :: areas      !! of the first path
      type(error_type), allocatable, intent(inout) :: error
      type(one_path) :: path
      type(area_rule) :: here
      integer(i8) :: place
      real(wp) :: h

      if (allocated(error)) return
      h = options%step/2.0_wp**max(0, options%refine)
      here = areas
      call path%begin(model)
      do place = 1, path%count - 1
         call path%look_at(place, 1)
         call derive_area_time(path%model, options%t0, here%time, error)
         if (allocated(error)) exit
         if (here%levels(h) == areas%levels(h)) cycle
         call raise(error, incompatible, 'run_ensemble', 'parameters of model '//model%name//' go by path, and '// &
                    'with them the time scale of the areas, '//to_text(areas%time)//' for the first values and '// &
                    to_text(here%time)//' for value '//to_text(place + 1)//': give one for all paths (area_time), '// &
                    'where a larger one costs work alone, or areas in law, or a run for each value')
         exit
      end do
      call path%finish()
   end subroutine require_equal_areas

   !> Refuse (too_large) areas that need more numbers than the counters distinguish. A row is a sub-increment; the rows
   !> of the run, up to its last step, are numbered, and counters hold 2^47 numbers. Areas in law also count pairs of
   !> noises.
   subroutine check_area_counters(nnoise, law, options, areas, error)
      integer, intent(in) :: nnoise
      integer, intent(in) :: law       !! law of the increments
      type(run_options), intent(in) :: options
      type(area_rule), intent(in) :: areas
      type(error_type), allocatable, intent(inout) :: error
      real(wp) :: rows

      rows = real(options%first_step + options%nstep, wp)*2.0_wp**max(0, options%refine)* &
             2.0_wp**areas%levels(options%step/2.0_wp**max(0, options%refine))
      if (rows > 2.0_wp**47) then
         call raise(error, too_large, 'run_ensemble', 'the areas of '//to_text(options%nstep)//' steps need '// &
                    to_text(rows)//' sub-increments, beyond 2^47, the range of the step counter: give fewer or '// &
                    'longer steps')
      else if ((areas%kind == areas_in_law .or. law /= law_gaussian) .and. nnoise > most_paired) then
         call raise(error, too_large, 'run_ensemble', 'areas that are drawn by themselves count pairs of '// &
                    'noises, and those of '//to_text(nnoise)//' noises exceed the range of their counter: '// &
                    'give at most '//to_text(most_paired)//' noises, or a scheme whose areas follow the path')
      end if
   end subroutine check_area_counters

end module symsde_ensemble_run_areas
