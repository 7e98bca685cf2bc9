! SPDX-License-Identifier: BSD-3-Clause
!> Implicit schemes of several stages.
!>
!> Where H = p.p/2 + U(q) with noise in position or additive the momenta are eliminated (step/stages/groups); so they
!> are where H = p.M^-1 p/2 + U(q) with noise in position, for iteration without matrices.
!> The slopes are found group by group: by fixed-point iteration in the lanes where the step is mild
!> (step/stages/fixed_point), by Newton's iteration in the others (step/stages/newton; the general stepper's where
!> momenta cannot be eliminated; midpoint's own where its matrices are large or made of differences). All find the
!> root that the general stepper finds. Lanes are taken through the whole step in parts that stay in cache.
module symsde_step_stages_stepper
   use symsde_base_counters, only: counters_type, add_counters
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lane_unit
   use symsde_base_memory, only: memory_for
   use symsde_base_record, only: step_record
   use symsde_base_status, only: not_converged
   use symsde_base_traits, only: strip_lanes
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type, tableau_form, correction_none
   use symsde_solve_newton, only: newton_options
   use symsde_step_hamiltonian_mass, only: new_constant_mass
   use symsde_step_implicit_general, only: general_stepper, new_general_stepper
   use symsde_step_lone, only: lone_stepper, few_of
   use symsde_step_stages_lone_newton, only: new_lone_stage_newton, fits_lone_newton
   use symsde_step_stages_lone, only: lone_stages
   use symsde_step_midpoint_eliminated, only: midpoint_stepper, new_midpoint_stepper, by_products
   use symsde_step_midpoint_full, only: midpoint_full_stepper, new_midpoint_full_stepper
   use symsde_step_implicit_newton_krylov, only: does_without_matrices
   use symsde_step_hamiltonian_noise_shift, only: new_noise_shift
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_stages_equations, only: stage_equations, new_stage_equations
   use symsde_solve_fixed_point, only: stiff_rate
   use symsde_step_stages_fixed_point, only: iterate_group, solved, untried
   use symsde_step_stages_groups, only: stage_group
   use symsde_step_stages_newton, only: stage_newton, new_stage_newton
   use symsde_step_stages_tridiagonal, only: tridiagonal_stages, new_tridiagonal_stages, fits_tridiagonal_stages, &
                                             solves_at_once
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: stages_stepper, stages_fits, fits_stages

   integer, parameter :: cached_values = 1024  !! of one array of a part
   !> Contraction from which Newton's iteration by rows is cheaper, for groups of one, two and three stages.
   real(wp), parameter :: slow_rate(3) = [1e-2_wp, 5e-3_wp, 3e-2_wp]

   !> The same for the general stepper's dense matrices of all unknowns, whose work grows as the cube of their number.
   real(wp), parameter :: stiff_rate_dense = 0.8_wp
   integer, parameter :: small = 12  !! unknowns up to which a dense matrix is worth as little

   !> What solves a group where iteration does not, made when the first lane needs it.
   type :: solver_slot
      logical :: has_rows = .false.                     !! lanes go to the rows before the matrices
      logical :: at_once = .false.                      !! .. and need no iteration before
      type(tridiagonal_stages), allocatable :: rows
      type(stage_newton), allocatable :: newton
   end type solver_slot

   type, extends(stepper_type) :: stages_stepper
      private
      integer :: width = 0                              !! lanes of a part
      type(newton_options) :: options
      type(stage_equations) :: equations                !! of the part in hand
      type(solver_slot), allocatable :: solver(:)       !! of each group
      type(scheme_type) :: scheme
      class(stepper_type), allocatable :: other         !! of lanes that are left
      logical :: leaves = .false.                       !! lanes that iteration does not solve are left to `other`
      logical :: midpoint_left = .false.                !! which is midpoint's
      integer(i8), allocatable, dimension(:) :: left, outcome  !! of the part (width)
      logical, allocatable :: wanted(:)                 !! (width)
      real(wp), allocatable, dimension(:, :) :: dq, dp, dq_left, dp_left  !! of the part (width, ndof)
   contains
      procedure :: make
      procedure :: increment
      procedure :: offer_lone
   end type stages_stepper

contains

   !> Whether this stepper executes the task.
   logical function stages_fits(task) result(fits)
      type(stepper_task), intent(in) :: task

      fits = .false.
      if (task%is_tableau() .and. task%correction == correction_none) &
         fits = fits_stages(task%model, task%scheme, task%newton)
   end function stages_fits

   subroutine make(self, task)
      class(stages_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task
      integer :: g, least

      self%options = task%newton
      self%scheme = task%scheme
      associate (model => task%model, traits => task%model%traits, scheme => task%scheme, nlane => task%nlane)
         call new_one_step_hamiltonian(self%ham, model, nlane, correction_none, 0.0_wp, scheme%brackets)
         self%width = nlane
         least = merge(strip_lanes, lane_unit, traits%has_chain_rows .and. modulo(nlane, strip_lanes) == 0)
         do while (mod(nlane, self%width) /= 0 .or. (self%width*traits%ndof > cached_values .and. self%width > least))
            self%width = self%width - lane_unit
         end do
         call new_stage_equations(self%equations, model, scheme, self%width)
         self%midpoint_left = scheme%is_midpoint() .and. self%equations%eliminated .and. &  ! no bracket, or a shift
                              (allocated(self%equations%mass) .or. &
                               does_without_matrices(traits, traits%ndof, self%options))
         self%leaves = self%midpoint_left .or. .not. self%equations%eliminated .or. allocated(self%equations%mass)
         allocate (self%solver(self%equations%plan%ngroup))
         do g = 1, size(self%solver)
            self%solver(g)%has_rows = self%equations%eliminated .and. .not. allocated(self%equations%mass) .and. &
                                      fits_tridiagonal_stages(traits, self%equations%plan%group(g))
            self%solver(g)%at_once = self%solver(g)%has_rows .and. solves_at_once(traits) .and. &
                                     .not. self%equations%plan%group(g)%explicit
         end do
         self%one_solve = all(self%equations%plan%group%explicit .or. self%solver%at_once)
         self%most_single = merge(0, 2, any(self%solver%at_once))
         allocate (self%left(self%width), self%outcome(self%width), self%wanted(self%width))
         allocate (self%dq(self%width, traits%ndof), self%dp(self%width, traits%ndof))
         self%name = 'stages'
         if (self%equations%eliminated) then
            self%name = 'stages, momenta eliminated'
            self%left_out = 'half of the unknowns: identity mass'
         end if
         if (allocated(self%equations%mass)) self%left_out = 'half of the unknowns of mild steps: constant mass'
         if (.not. self%midpoint_left) return
         if (.not. does_without_matrices(traits, unknowns_left(self), self%options)) return
      end associate
      self%left_out = 'matrices: products with the Hessian take their place; '//self%left_out
   end subroutine make

   !> Unknowns of the midpoint that takes the lanes that are left.
   pure integer function unknowns_left(self) result(n)
      class(stages_stepper), intent(in) :: self

      n = self%ham%ndof
      if (allocated(self%equations%mass)) n = 2*n
   end function unknowns_left

   !> Whether this stepper serves a model, scheme and options.
   pure logical function fits_stages(model, scheme, options)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme
      type(newton_options), intent(in) :: options

      fits_stages = .false.
      if (scheme%form /= tableau_form .or. .not. options%is_free()) return
      if (.not. (scheme%noise_coefficients_equal() .or. model%traits%nnoise == 0)) return
      associate (t => model%traits)
         fits_stages = t%ndof > 1 .or. t%eliminates_momenta()
      end associate
   end function fits_stages

   subroutine increment(self, step, q, p, dq, dp, status)
      class(stages_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      integer :: first, last

      associate (e => self%equations)
         do first = 1, self%ham%nlane, self%width
            last = first + self%width - 1
            e%ham%nreal = max(0, min(self%width, self%ham%nreal - first + 1))
            call e%begin(first, step, q, p)
            call solve_part(self, status(first:last))
            call e%add_up(self%dq, self%dp)
            if (any(self%left == 0)) call solve_left(self, self%left, status(first:last))
            dq(first:last, :) = self%dq
            dp(first:last, :) = self%dp
         end do
         call add_counters(self%ham%counters, e%ham%counters)
         e%ham%counters = counters_type()
      end associate
   end subroutine increment

   !> The slopes of all groups, in lanes without a status; left = 0 in those that the general stepper must take.
   subroutine solve_part(self, status)
      type(stages_stepper), intent(inout) :: self
      integer(i8), intent(inout) :: status(self%width)
      real(wp) :: too_stiff
      integer :: g

      self%left = -1
      too_stiff = too_stiff_for(self)
      do g = 1, size(self%solver)
         self%outcome = merge(solved, -1_i8, status == 0 .and. self%left < 0)
         associate (group => self%equations%plan%group(g), solver => self%solver(g))
            if (solver%at_once) then
               where (self%outcome == solved) self%outcome = untried
            else
               call iterate_group(self%equations, group, slowest(solver, group, too_stiff), too_stiff, &
                                  self%outcome)
            end if
            if (.not. any(self%outcome > solved)) cycle
            if (self%leaves) then
               self%left = merge(0_i8, self%left, self%outcome > solved)
            else
               call solve_group(self, group, solver, status)
            end if
         end associate
      end do
   end subroutine solve_part

   !> Contraction from which a lane is given up: one that goes to dense matrices waits longer.
   pure real(wp) function too_stiff_for(self) result(rate)
      class(stages_stepper), intent(in) :: self

      rate = stiff_rate
      if (self%leaves .and. .not. self%midpoint_left .and. 2*self%ham%ndof*self%scheme%nstage > small) &
         rate = stiff_rate_dense
   end function too_stiff_for

   !> Contraction from which a group is left to its solver.
   pure real(wp) function slowest(solver, group, too_stiff)
      type(solver_slot), intent(in) :: solver
      type(stage_group), intent(in) :: group
      real(wp), intent(in) :: too_stiff

      slowest = too_stiff
      if (solver%has_rows) slowest = slow_rate(merge(1, group%nmember, allocated(group%e)))
   end function slowest

   !> Paths one by one, where slopes are iterated and brackets are no more than a shift of momenta.
   subroutine offer_lone(self, lone)
      class(stages_stepper), intent(in) :: self
      class(lone_stepper), allocatable, intent(out) :: lone
      type(lone_stages), allocatable :: made
      integer :: g

      associate (e => self%equations, n => self%ham%ndof, traits => self%ham%model%traits)
         if (any(self%solver%at_once) .or. (e%eliminated .and. e%has_c) .or. .not. e%plan%in_order()) return
         if (allocated(self%ham%modified) .and. .not. allocated(e%shift)) return
         allocate (made)
         made%plan = e%plan
         made%eliminated = e%eliminated
         made%moves_with_p = e%moves_with_p()
         made%too_stiff = too_stiff_for(self)
         allocate (made%slot(size(self%solver)))
         do g = 1, size(self%solver)
            associate (slot => made%slot(g), group => made%plan%group(g))
               slot%too_slow = slowest(self%solver(g), group, made%too_stiff)
               slot%i1 = group%stage(1)
               slot%i2 = group%stage(group%nmember)
               slot%explicit = group%explicit
               if (self%leaves .or. self%solver(g)%has_rows .or. .not. fits_lone_newton(traits, group)) cycle
               allocate (slot%newton)
               call new_lone_stage_newton(slot%newton, traits, group, self%options%max_iter)
            end associate
         end do
         if (allocated(e%mass)) then
            allocate (made%mass)
            call new_constant_mass(made%mass, 1, n, self%ham%nnoise)
         end if
         if (allocated(e%shift)) then
            made%wants_record = .true.
            allocate (made%shift)
            call new_noise_shift(made%shift, self%ham%model, 1)
         end if
         made%most = few_of(n, merge(3, 4, e%eliminated), 8)  ! one more takes 0.8 to 1.5 of the time
         if (n == 2 .and. made%in_numbers(self%ham%model)) &  ! as many as go alone at all; five take as long as a block
            made%most = merge(12, 4, traits%has_lone_sweeps)
      end associate
      call move_alloc(made, lone)
   end subroutine offer_lone

   !> The slopes of a group where iteration has not found them, by rows if it may be, and else by its matrices.
   subroutine solve_group(self, group, solver, status)
      type(stages_stepper), intent(inout) :: self
      type(stage_group), intent(in) :: group
      type(solver_slot), intent(inout) :: solver
      integer(i8), intent(inout) :: status(self%width)

      self%wanted = self%outcome > solved
      if (solver%has_rows) then
         if (.not. allocated(solver%rows)) then
            allocate (solver%rows)
            call new_tridiagonal_stages(solver%rows, self%equations, group, self%options)
         end if
         call solver%rows%solve(self%equations, group, self%outcome, self%wanted)
         if (.not. any(self%wanted)) return
      end if
      if (.not. allocated(solver%newton)) then
         allocate (solver%newton)
         call new_stage_newton(solver%newton, self%equations, group, self%options)
      end if
      self%outcome = merge(0_i8, -1_i8, self%wanted)
      call solver%newton%solve(self%equations, group, self%outcome)
      status = merge(self%outcome, status, self%outcome > 0)
   end subroutine solve_group

   !> Increments of the lanes that are left, by the general stepper.
   subroutine solve_left(self, left, status)
      type(stages_stepper), intent(inout) :: self
      integer(i8), intent(inout) :: left(self%width), status(self%width)
      integer :: i

      if (.not. allocated(self%other)) then
         if (.not. (self%midpoint_left .or. &
                    memory_for(self%width*real(size(self%dq, 2)*self%scheme%nstage*2, wp)**2, 0))) then
            status = merge(int(not_converged, i8), status, left == 0)
            return
         end if
         call make_other(self)
         allocate (self%dq_left, self%dp_left, mold=self%dq)
      end if
      associate (e => self%equations)
         self%other%ham%nreal = e%ham%nreal
         call self%other%increment(e%step, e%q, e%p, self%dq_left, self%dp_left, left)
         call add_counters(e%ham%counters, self%other%ham%counters)
         self%other%ham%counters = counters_type()
      end associate
      do i = 1, size(self%dq, 2)
         self%dq(:, i) = merge(self%dq_left(:, i), self%dq(:, i), left == 0)
         self%dp(:, i) = merge(self%dp_left(:, i), self%dp(:, i), left == 0)
      end do
      status = merge(left, status, left > 0)
   end subroutine solve_left

   !> What takes the lanes that are left.
   subroutine make_other(self)
      type(stages_stepper), intent(inout) :: self
      type(general_stepper), allocatable :: general
      type(midpoint_stepper), allocatable :: eliminated
      type(midpoint_full_stepper), allocatable :: midpoint

      associate (model => self%equations%ham%model)
         if (self%midpoint_left .and. .not. allocated(self%equations%mass)) then
            allocate (eliminated)
            call new_midpoint_stepper(eliminated, model, self%width, self%options, by_products)
            call move_alloc(eliminated, self%other)
         else if (self%midpoint_left) then
            allocate (midpoint)
            call new_midpoint_full_stepper(midpoint, model, self%width, self%options)
            call move_alloc(midpoint, self%other)
         else
            allocate (general)
            call new_general_stepper(general, model, self%scheme, correction_none, self%width, self%options)
            if (allocated(self%ham%modified)) &  ! made in a step, it sees the model at real lanes alone
               general%ham%modified%time_dependent = self%ham%modified%time_dependent
            call move_alloc(general, self%other)
         end if
      end associate
   end subroutine make_other

end module symsde_step_stages_stepper
