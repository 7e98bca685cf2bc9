! SPDX-License-Identifier: BSD-3-Clause
!> Decide which probes a run makes. Models of the catalogue are not probed, since the tests probe them, unless forces of
!> a user act on them. Every run probes a user's model; but a model derived from formulas is not probed again after it
!> has passed. A probe that decides nothing, because the model is not finite at the state or fails there, does not count
!> as passed.
!>
!> Private to its family.
module symsde_ensemble_run_probes
   use symsde_base_kinds, only: wp, i8
   use symsde_base_probe_record, only: probe_number
   use symsde_base_status, only: error_type
   use symsde_model_abstract, only: model_type
   use symsde_model_catalogue_by_name, only: is_built_in
   use symsde_model_probe_traits, only: probe_model
   use symsde_scheme_scheme, only: scheme_type
   use symsde_step_factory, only: stepper_options, new_stepper
   use symsde_step_flow_model_flow, only: model_flow_stepper
   use symsde_step_flow_probe, only: probe_flow, probe_lanes
   use symsde_step_stepper, only: stepper_type
   implicit none
   private
   public :: probe_declared, probe_whole_steps

   integer, parameter :: most_dense = 32  !! degrees of freedom up to which whole steps are compared with the oracle's

contains

   !> Probe the traits and derivatives of a model around the state of one path.
   subroutine probe_declared(model, t, q0, p0, error)
      class(model_type), intent(in), target :: model
      real(wp), intent(in) :: t, q0(:), p0(:)
      type(error_type), allocatable, intent(inout) :: error
      integer(i8) :: number
      logical :: decided

      if (allocated(error) .or. (is_built_in(model) .and. .not. model%calls_users())) return
      number = probe_number('declared', model%traits, t, q0, p0, 0.0_wp)
      if (model%passed%knows(number)) return
      call probe_model(model, t, q0, p0, error, decided)
      if (decided .and. .not. allocated(error)) call model%passed%enter(number)
   end subroutine probe_declared

   !> Probe the whole steps that a model defines, if the stepper takes them, near the state of one path.
   subroutine probe_whole_steps(stepper, model, scheme, t, h, q0, p0, error)
      class(stepper_type), intent(in) :: stepper
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      real(wp), intent(in) :: t, h, q0(:), p0(:)
      type(error_type), allocatable, intent(inout) :: error
      class(stepper_type), allocatable :: whole, oracle
      type(error_type), allocatable :: refusal
      integer(i8) :: number
      integer :: correction
      logical :: decided, large

      if (allocated(error) .or. is_built_in(model)) return
      select type (stepper)
      type is (model_flow_stepper)
         correction = stepper%correction
      class default
         return
      end select
      number = probe_number(stepper%name, model%traits, t, q0, p0, h)
      if (model%passed%knows(number)) return
      ! Make steppers for the lanes of the probe. If the comparison stepper is refused, nothing is compared.
      call new_stepper(whole, model, scheme, stepper_options(correction=correction), probe_lanes, refusal)
      if (allocated(refusal)) return
      ! The general one solves dense equations, whose cost grows as the cube of their size.
      large = model%traits%ndof > most_dense
      call new_stepper(oracle, model, scheme, stepper_options(correction=correction, general=.not. large, &
                                                              as_increments=large), probe_lanes, refusal)
      decided = .false.
      select type (whole)
      type is (model_flow_stepper)
         call probe_flow(whole, oracle, model, scheme, t, h, q0, p0, error, decided)
      end select
      if (decided .and. .not. allocated(error)) call model%passed%enter(number)
   end subroutine probe_whole_steps

end module symsde_ensemble_run_probes
