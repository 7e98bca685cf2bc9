! SPDX-License-Identifier: BSD-3-Clause
!> Implicit schemes of several stages, for H = p.p/2 + U(q) and noise in position or additive.
!>
!> The momenta are eliminated (step/stage_plan), the slopes found group by group: by fixed-point iteration
!> in the lanes where the step is mild (step/stage_iteration), by Newton's iteration in the others
!> (step/stage_newton). Both find the root that the general stepper finds. Lanes are taken through the whole
!> step in parts that stay in cache.
module symsde_step_stages
   use symsde_base_counters, only: counters_type, add_counters
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lane_unit
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type, tableau_form, correction_none
   use symsde_solve_newton, only: newton_options
   use symsde_step_one_step_hamiltonian, only: new_one_step_hamiltonian
   use symsde_step_stage_equations, only: stage_equations, new_stage_equations
   use symsde_step_stage_iteration, only: iterate_group
   use symsde_step_stage_newton, only: stage_newton, new_stage_newton
   use symsde_step_stepper, only: stepper_type
   implicit none
   private
   public :: stages_stepper, new_stages_stepper, fits_stages

   integer, parameter :: cached_values = 2048  !! of one array of a part

   type, extends(stepper_type) :: stages_stepper
      private
      integer :: width = 0                              !! lanes of a part
      type(newton_options) :: options
      type(stage_equations) :: equations                !! of the part in hand
      type(stage_newton), allocatable :: newton(:)      !! of each group, made when the first lane needs it
      logical, allocatable :: made(:)
      real(wp), allocatable :: dq(:, :), dp(:, :)       !! of the part (width, ndof)
   contains
      procedure :: increment
   end type stages_stepper

contains

   !> Whether this stepper serves a model, scheme and options.
   pure logical function fits_stages(model, scheme, options)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme
      type(newton_options), intent(in) :: options

      fits_stages = .false.
      if (scheme%form /= tableau_form .or. options%fixed_point > 0 .or. options%damped) return
      if (.not. (scheme%noise_coefficients_equal() .or. model%traits%nnoise == 0)) return
      associate (t => model%traits)
         fits_stages = t%identity_mass .and. (t%position_noise .or. t%additive .or. t%nnoise == 0)
      end associate
   end function fits_stages

   !> A stepper for blocks of nlane lanes; requires fits_stages and no correction.
   subroutine new_stages_stepper(self, model, scheme, nlane, options)
      type(stages_stepper), intent(out) :: self
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      integer, intent(in) :: nlane
      type(newton_options), intent(in) :: options

      self%name = 'stages, momenta eliminated'
      self%options = options
      call new_one_step_hamiltonian(self%ham, model, nlane, correction_none, 0.0_wp)
      self%width = nlane
      do while (mod(nlane, self%width) /= 0 .or. &
                (self%width*model%traits%ndof > cached_values .and. self%width > lane_unit))
         self%width = self%width - lane_unit
      end do
      call new_stage_equations(self%equations, model, scheme, self%width)
      allocate (self%newton(self%equations%plan%ngroup))
      allocate (self%made(self%equations%plan%ngroup), source=.false.)
      allocate (self%dq(self%width, model%traits%ndof), self%dp(self%width, model%traits%ndof))
   end subroutine new_stages_stepper

   subroutine increment(self, t, w, q, p, dq, dp, status)
      class(stages_stepper), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      integer :: first, last

      associate (e => self%equations)
         do first = 1, self%ham%nlane, self%width
            last = first + self%width - 1
            e%ham%nreal = max(0, min(self%width, self%ham%nreal - first + 1))
            e%w = w(first:last, :)
            e%q = q(first:last, :)
            e%p = p(first:last, :)
            call e%begin(t)
            call solve_part(self, status(first:last))
            call e%add_up(self%dq, self%dp)
            dq(first:last, :) = self%dq
            dp(first:last, :) = self%dp
         end do
         call add_counters(self%ham%counters, e%ham%counters)
         e%ham%counters = counters_type()
      end associate
   end subroutine increment

   !> The slopes of all groups, in lanes without a status.
   subroutine solve_part(self, status)
      type(stages_stepper), intent(inout) :: self
      integer(i8), intent(inout) :: status(self%width)
      integer(i8) :: fate(self%width)
      integer :: g

      do g = 1, size(self%newton)
         fate = merge(0_i8, -1_i8, status == 0)
         associate (group => self%equations%plan%group(g))
            call iterate_group(self%equations, group, fate)
            if (.not. any(fate > 0)) cycle
            if (.not. self%made(g)) call new_stage_newton(self%newton(g), self%equations, group, self%options)
            self%made(g) = .true.
            fate = merge(0_i8, -1_i8, fate > 0)
            call self%newton(g)%solve(self%equations, group, fate)
            status = merge(fate, status, fate > 0)
         end associate
      end do
   end subroutine solve_part

end module symsde_step_stages
