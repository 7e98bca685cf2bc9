! SPDX-License-Identifier: BSD-3-Clause
!> Two implicit stages of one degree of freedom with brackets in their Hamiltonian, for a path by itself: the iterations
!> of step/one_dof/newton and the brackets of step/hamiltonian/brackets_one_dof in one lane. All that an angle has
!> follows from the terms of its Hamiltonians, each asked for once a time.
module symsde_step_one_dof_scalar_brackets
   use symsde_base_kinds, only: wp
   use symsde_model_abstract, only: model_type, angle_terms
   use symsde_scheme_scheme, only: bracket_terms
   use symsde_solve_stagnation, only: stopping_test, verdict_of
   use symsde_step_scalar_path, only: scalar_path
   use symsde_step_one_dof_scalar_newton, only: correct
   use symsde_step_hamiltonian_brackets_one_dof_kinetic, only: are_kinetic, find_angle_of_one
   use symsde_step_hamiltonian_brackets, only: modified_hamiltonian, new_modified_hamiltonian
   use symsde_step_hamiltonian_brackets_one_dof, only: single_brackets, new_single_brackets
   use symsde_step_one_dof_two_stages, only: stage_point, add_stages, solve_lanes
   implicit none
   private
   public :: scalar_brackets

   !> Gradient and Hessian at a point.
   type :: derivatives
      real(wp), dimension(1) :: q = 0, p = 0, qq = 0, qp = 0, pp = 0
   end type derivatives

   type, extends(scalar_path) :: scalar_brackets
      real(wp) :: a(2, 2) = 0, abar(2, 2) = 0, alpha(2) = 0, c(2) = 0
      type(stopping_test) :: test
      integer :: max_iter = 0
      type(bracket_terms) :: wanted
      type(modified_hamiltonian), private :: parts   !! of one lane
      type(single_brackets), private :: brackets
      type(angle_terms), allocatable, private :: terms(:, :)     !! of every H_j at times 0 .. 2 (0:m, 0:2)
      type(angle_terms), allocatable, private :: ends(:, :)      !! at both ends of a step in which noises change (m, 2)
      real(wp), private :: nested = 0                !! factor of the nested brackets
      real(wp), allocatable, private :: unit(:)      !! weights of one Hamiltonian alone (0:m)
   contains
      procedure :: lead
      procedure :: take
   end type scalar_brackets

contains

   subroutine lead(self, model)
      class(scalar_brackets), intent(inout) :: self
      class(model_type), intent(in), target :: model

      self%model => model
      self%n = 1
      self%m = model%traits%nnoise
      call new_modified_hamiltonian(self%parts, model, self%wanted, 1)
      call new_single_brackets(self%brackets, self%parts)
      associate (parts => self%parts, traits => model%traits)
         if (.not. (traits%has_angle_terms .and. are_kinetic(parts))) return
         if (parts%time_dependent) allocate (self%ends(self%m, 2))
      end associate
      allocate (self%terms(0:self%m, 0:2))
      allocate (self%unit(0:self%m), source=0.0_wp)
   end subroutine lead

   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(scalar_brackets), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      type(derivatives) :: one, two  ! at the stages
      real(wp) :: times(0:2), x(4), d(4), last, change, extent, qs(1), ps(1)
      integer :: iteration

      times(0) = t + 0.5_wp*h
      times(1) = t + self%c(1)*h
      times(2) = t + self%c(2)*h
      self%step%t = t
      call self%brackets%begin(self%parts, self%step)
      self%nested = merge(h*abs(h)/12, 0.0_wp, self%parts%active%nested)
      if (allocated(self%terms)) call find_terms_of_all(self, times, h)
      associate (a => self%a, abar => self%abar)
         x = 0
         call evaluate(self, 0, times(0), q, p, one)
         call solve_lanes(1, a, abar, one%q, one%q, one%p, one%p, one%qq, one%qq, one%qp, one%qp, one%pp, one%pp, x, d)
         call correct(4, d, x, change, extent, taken)
         last = 0
         iteration = 0
         do while (last >= 0)
            taken = taken .and. iteration < self%max_iter
            if (.not. taken) return
            iteration = iteration + 1
            call stage_point(1, 1, a, abar, q, p, x, qs, ps)
            call evaluate(self, 1, times(1), qs, ps, one)
            call stage_point(1, 2, a, abar, q, p, x, qs, ps)
            call evaluate(self, 2, times(2), qs, ps, two)
            call solve_lanes(1, a, abar, one%q, two%q, one%p, two%p, one%qq, two%qq, one%qp, two%qp, one%pp, two%pp, &
                             x, d)
            call correct(4, d, x, change, extent, taken)
            last = verdict_of(self%test, change, extent, last)
         end do
         if (taken) call add_stages(1, self%alpha, x, dq, dp)
      end associate
      self%counters%iterations = self%counters%iterations + iteration
      self%counters%solves = self%counters%solves + iteration
   end subroutine take

   !> The terms of every H_j at the three times, and at the ends of the step.
   subroutine find_terms_of_all(self, times, h)
      type(scalar_brackets), intent(inout) :: self
      real(wp), intent(in) :: times(0:2), h
      integer :: i, j

      do j = 0, self%m
         self%unit(j) = 1
         do i = 0, 2
            call self%model%angle(self%m, times(i), self%unit, self%terms(j, i))
         end do
         if (allocated(self%ends) .and. j > 0) then
            call self%model%angle(self%m, self%step%t, self%unit, self%ends(j, 1))
            call self%model%angle(self%m, self%step%t + h, self%unit, self%ends(j, 2))
         end if
         self%unit(j) = 0
      end do
   end subroutine find_terms_of_all

   !> At a point in time i.
   subroutine evaluate(self, i, t, q, p, d)
      type(scalar_brackets), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: t, q(1), p(1)
      type(derivatives), intent(inout) :: d

      associate (parts => self%parts, b => self%brackets, step => self%step, asked => self%brackets%asked)
         if (.not. allocated(self%terms)) then
            call b%evaluate(parts, t, step, q, p, d%q, d%p, d%qq, d%qp, d%pp, self%counters, 1)
            return
         end if
         call find_angle_of_one(self%m, parts%noisy, self%nested, step%w, b%c, b%rate, &
                                self%terms(:, i), self%ends, q(1), p(1), d%q(1), d%p(1), d%qq(1), d%qp(1), d%pp(1))
         self%counters%gradients = self%counters%gradients + asked
         self%counters%hessians = self%counters%hessians + asked
      end associate
   end subroutine evaluate

end module symsde_step_one_dof_scalar_brackets
