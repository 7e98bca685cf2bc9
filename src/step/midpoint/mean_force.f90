! SPDX-License-Identifier: BSD-3-Clause
!> The energy-drift-preserving scheme of Chen, Cohen, D'Ambrosio, Lang (2020), for H = p.p/2 + V(q) with
!> additive noise in p. Not symplectic: it is there for comparison.
!>
!>    Psi = p_n + g - (h/2) F,   F = int_0^1 V'(q_n + s h Psi) ds,   q_{n+1} = q_n + h Psi,   p_{n+1} = p_n + g - h F
!>
!> with the kick g = -sum_k dW_k H_{k,q}. On every path H_{n+1} = H_n + p_n.g + g.g/2, so E H grows exactly
!> as it must, for every h, as far as the quadrature of F is exact: four Gauss nodes, polynomials V up to
!> degree eight. Unknown is X = Psi - p_n; then p_{n+1} - p_n = 2 X - g.
!>
!> That is the equation of step/midpoint/equation, X + f(p_n + X) = 0, with the mean of forces
!>
!>    f = sum_j (w_j/2) h V'(q_n + s_j h Psi) - g,   f' = (h/4) K,   K = sum_j 2 w_j s_j h V''(q_n + s_j h Psi)
!>
!> and is solved as that of the midpoint is.
module symsde_step_midpoint_mean_force
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_traits, only: dense
   use symsde_base_vectors, only: add_times
   use symsde_scheme_scheme, only: scheme_type, correction_none
   use symsde_step_lone, only: lone_stepper, few_of
   use symsde_step_midpoint_lone_mean_force, only: lone_mean_force
   use symsde_step_midpoint_dense, only: dense_midpoint, new_dense_midpoint, solve_mildly
   use symsde_step_midpoint_equation, only: midpoint_equation, new_midpoint_equation, solve_by_iterations, position
   use symsde_step_hamiltonian_noise_shift, only: noise_shift, new_noise_shift
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian, new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: mean_force_stepper, mean_force_fits

   !> Contraction from which bands are solved for: a sweep asks for the forces of all nodes.
   real(wp), parameter :: stiff_rate_banded = 0.05_wp

   !> The midpoint's part with the mean of forces in place of one.
   type, extends(dense_midpoint) :: mean_part
      real(wp), allocatable :: node(:), weight(:)      !! s_j, w_j
      real(wp), allocatable, dimension(:, :) :: start, kick   !! q_n and g (nlane, ndof)
      real(wp), allocatable :: at(:, :), hq(:, :)      !! a node, and the force there (nlane, ndof)
      real(wp), allocatable :: hqq(:, :, :)            !! (nlane, ndof, ndof) or its bands
   contains
      procedure :: solve
      procedure :: find_force
      procedure :: linearise
   end type mean_part

   type, extends(stepper_type) :: mean_force_stepper
      private
      type(mean_part) :: part
      type(midpoint_equation) :: eq
      type(noise_shift) :: shift
      real(wp), allocatable :: v(:, :)                 !! weights h, 0 (nlane, 0:nnoise)
   contains
      procedure :: make
      procedure :: increment
      procedure :: offer_lone
   end type mean_force_stepper

contains

   !> Whether this stepper executes the task.
   logical function mean_force_fits(task) result(fits)
      type(stepper_task), intent(in) :: task

      fits = .false.
      associate (t => task%model%traits)
         if (t%nnoise > 0 .and. .not. (t%additive .and. t%position_noise)) return
         if (t%identity_mass .and. task%is_plain()) fits = averages_forces(task%scheme)
      end associate
   end function mean_force_fits

   !> Whether a tableau is that of averaged forces: a_ij = c_i w_j, abar_ij = w_j/2, bbar_ij = w_j.
   pure logical function averages_forces(scheme)
      type(scheme_type), intent(in) :: scheme
      real(wp), parameter :: rounding = 4*epsilon(1.0_wp)
      integer :: i

      averages_forces = all(abs(scheme%alpha - scheme%beta) <= 0)
      do i = 1, scheme%nstage
         associate (w => scheme%alpha)
            averages_forces = averages_forces .and. all(abs(scheme%a(i, :) - scheme%c(i)*w) <= rounding) .and. &
                              all(abs(scheme%abar(i, :) - 0.5_wp*w) <= rounding) .and. &
                              all(abs(scheme%bbar(i, :) - w) <= rounding)
         end associate
      end do
   end function averages_forces

   subroutine make(self, task)
      class(mean_force_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      self%name = 'drift preserving'
      self%most_single = 2
      self%left_out = 'half of the unknowns: identity mass'
      call new_dense_midpoint(self%part%dense_midpoint, task%model, task%nlane, task%newton)
      self%one_solve = self%part%newton%affine
      associate (part => self%part, n => task%model%traits%ndof, m => task%model%traits%nnoise, nlane => task%nlane)
         part%node = task%scheme%c
         part%weight = task%scheme%alpha
         allocate (part%start(nlane, n), part%kick(nlane, n), part%at(nlane, n), part%hq(nlane, n))
         if (part%band == dense) then
            allocate (part%hqq(nlane, n, n))
         else
            allocate (part%hqq(nlane, -part%band:part%band, n))
            part%too_stiff = stiff_rate_banded
         end if
         call new_one_step_hamiltonian(self%ham, task%model, nlane, correction_none, 0.0_wp)
         call new_midpoint_equation(self%eq, nlane, n, m)
         call self%eq%make_room()
         call new_noise_shift(self%shift, task%model, nlane)
         allocate (self%v(nlane, 0:m), source=0.0_wp)
      end associate
   end subroutine make

   subroutine increment(self, step, q, p, dq, dp, status)
      class(mean_force_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)

      associate (eq => self%eq, part => self%part, n => self%ham%ndof, numbers => size(q))
         eq%h = step%h
         eq%t = step%t + 0.5_wp*step%h
         eq%c = 1
         eq%nreal = self%ham%nreal
         eq%base(:, 1:n) = p
         part%start = q
         part%kick = 0
         call self%shift%weigh(1.0_wp, 0.0_wp, step)
         call self%shift%add(self%ham%model, eq%t, 1.0_wp, part%start, part%kick)
         self%ham%counters%gradients = self%ham%counters%gradients + self%shift%asked*self%ham%nreal
         self%shift%asked = 0
         self%v(:, 0) = step%h
         call part%solve(self%ham, eq, self%v, status)
         call find_increments(numbers, step%h, p, eq%x, part%kick, dq, dp)
      end associate
   end subroutine increment

   !> Paths one by one: by Newton's iteration of two unknowns, by iteration of more.
   subroutine offer_lone(self, lone)
      class(mean_force_stepper), intent(in) :: self
      class(lone_stepper), allocatable, intent(out) :: lone
      type(lone_mean_force), allocatable :: made

      associate (part => self%part, t => self%ham%model%traits)
         if (.not. (part%iterates .or. (part%pairs .and. t%has_hessian))) return
         allocate (made)
         made%most = few_of(t%ndof, merge(3, 4, part%iterates), 6)  ! one more takes 1.1 to 1.4 of the time
         made%iterates = part%iterates
         made%too_stiff = part%too_stiff
         made%test = part%newton%test
         made%max_iter = part%newton%options%max_iter
         made%wants_record = .true.
         made%node = part%node
         made%weight = part%weight
         call new_noise_shift(made%shift, self%ham%model, 1)
         call move_alloc(made, lone)
      end associate
   end subroutine offer_lone

   ! ---- the part that solves ---------------------------------------------------------------------

   !> As the midpoint's, but the point is not moved by a quarter of the step where there is one unknown.
   subroutine solve(self, ham, eq, w, status)
      class(mean_part), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(inout) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
      integer(i8), intent(inout) :: status(eq%nlane)

      if (self%iterates) then
         call solve_mildly(self, ham, eq, w, status)
      else
         call solve_by_iterations(self, ham, eq, w, status)
      end if
   end subroutine solve

   !> f where Psi = q.
   subroutine find_force(self, ham, eq, w, q, force)
      class(mean_part), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(in) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m), q(eq%nlane, eq%n)
      real(wp), intent(out) :: force(eq%nlane, eq%n)
      integer :: j

      force = -self%kick
      do j = 1, size(self%node)
         call position(size(q), self%node(j)*eq%h, self%start, q, self%at)
         call self%dense_midpoint%find_force(ham, eq, w, self%at, self%hq)
         call add_times(size(q), 0.5_wp*self%weight(j), self%hq, force)
      end do
   end subroutine find_force

   !> f and K where Psi = q.
   subroutine linearise(self, ham, eq, w, q)
      class(mean_part), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(in) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m), q(eq%nlane, eq%n)
      real(wp) :: share
      integer :: j

      if (self%newton%options%fixed_point > 0) then
         call self%find_force(ham, eq, w, q, self%newton%r)
         return
      end if
      associate (newton => self%newton, model => ham%model, nlane => eq%nlane, n => eq%n, c => ham%counters)
         newton%r = -self%kick
         if (self%band == dense) newton%a = 0
         if (self%band /= dense) newton%bands = 0
         do j = 1, size(self%node)
            call position(size(q), self%node(j)*eq%h, self%start, q, self%at)
            share = 2*self%weight(j)*self%node(j)
            if (self%band == dense) then
               call model%gradient_hessian(nlane, n, eq%m, eq%t, w, self%at, eq%still, hq=self%hq, hqq=self%hqq)
               call add_times(size(newton%a), share, self%hqq, newton%a)
            else
               call model%gradient(nlane, n, eq%m, eq%t, w, self%at, eq%still, hq=self%hq)
               call model%hessian_banded(nlane, n, eq%m, self%band, eq%t, w, self%at, eq%still, hqq=self%hqq)
               call add_times(size(newton%bands), share, self%hqq, newton%bands)
            end if
            call add_times(size(q), 0.5_wp*self%weight(j), self%hq, newton%r)
         end do
         c%gradients = c%gradients + size(self%node)*eq%nreal
         c%hessians = c%hessians + size(self%node)*eq%nreal
      end associate
   end subroutine linearise

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC
   pure subroutine find_increments(n, h, p, x, kick, dq, dp)
      integer, intent(in) :: n
      real(wp), intent(in) :: h, p(n), x(n), kick(n)
      real(wp), intent(out) :: dq(n), dp(n)
      integer :: i

      do i = 1, n
         dq(i) = h*(p(i) + x(i))
         dp(i) = 2*x(i) - kick(i)
      end do
   end subroutine find_increments

end module symsde_step_midpoint_mean_force
