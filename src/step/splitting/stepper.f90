! SPDX-License-Identifier: BSD-3-Clause
!> Drifts and kicks for H = p.M^-1 p/2 + U(t,q) with any number of noises in position: explicit, symplectic; or
!> midpoint steps for H and kicks by the noises.
!>
!> What a kick is, and why: symsde_scheme_kicks. Each kick is a function of q alone, so its flow moves p by a
!> gradient; its Hamiltonians are taken at its own time t_n + c_i h, which serves potentials and noises that
!> depend on time. The parts with products of gradients need one Hessian-vector product each:
!>
!>    grad F_q.M^-1 F_q = 2 Hess F M^-1 F_q
!>    grad 1/2 sum_kl D_kl H_k,q.M^-1 H_l,q = sum_k Hess H_k M^-1 sum_l D_kl H_l,q
!>
!> Linear noises have no such part. A mass that is not the identity is asked of the model: its H_p at v is M^-1 v.
!> With one degree of freedom and mass one a gradient and Hessian of each Hamiltonian at the point of the kick serve
!> all of its parts.
module symsde_step_splitting_stepper
   use symsde_base_counters, only: counters_type, add_counters
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_vectors, only: add, subtract, add_times
   use symsde_scheme_kicks, only: flow_rotation, flow_midpoint
   use symsde_scheme_scheme, only: correction_none
   use symsde_step_hamiltonian_mass, only: new_constant_mass
   use symsde_step_splitting_drift, only: drift_flow, new_drift_flow
   use symsde_step_splitting_coefficients, only: kick_weights, new_kick_weights
   use symsde_step_scalar_path, only: scalar_path
   use symsde_step_splitting_scalar_kicks, only: scalar_kicks
   use symsde_step_splitting_midpoint_drift, only: midpoint_flow, new_midpoint_flow
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: splitting_stepper

   type, extends(stepper_type) :: splitting_stepper
      private
      type(kick_weights) :: weights
      type(drift_flow) :: between_kicks            !! what happens between kicks
      type(midpoint_flow), allocatable :: midpoint !! or this
      logical :: by_mass = .false.                 !! the mass is constant, and not known to be the identity
      real(wp), allocatable :: unit(:, :)          !! weights of one Hamiltonian alone (nlane, 0:nnoise)
      real(wp), allocatable :: x(:, :), y(:, :)    !! where q and p are in the step (nlane, ndof)
      real(wp), allocatable :: f(:, :)             !! gradient of a kick (nlane, ndof)
      real(wp), allocatable :: g(:, :, :)          !! H_k,q (nlane, ndof, nnoise)
      real(wp), allocatable :: slope(:, :)         !! H_j' (nlane, 0:nnoise), one degree of freedom
      real(wp), allocatable :: curvature(:, :, :)       !! H_j'' (nlane, 1, 0:nnoise), the same
      real(wp), allocatable :: s(:, :), zero(:, :), u(:, :), up(:, :)  !! a product (nlane, ndof)
   contains
      procedure :: make
      procedure :: increment
      procedure :: offer_scalar_path
      procedure :: tally
   end type splitting_stepper

contains

   subroutine make(self, task)
      class(splitting_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      self%name = 'drifts and kicks'
      self%explicit = .true.
      call new_kick_weights(self%weights, task%scheme%kicks, task%model%traits, task%nlane)
      associate (t => task%model%traits, n => task%model%traits%ndof, m => task%model%traits%nnoise, &
                 nlane => task%nlane, kicks => self%weights%kicks)
         call new_one_step_hamiltonian(self%ham, task%model, nlane, correction_none, 0.0_wp)
         self%by_mass = .not. t%identity_mass
         if (kicks%flow == flow_rotation) then
            call new_drift_flow(self%between_kicks, size(kicks%c) + 1, t%rotation)
         else
            call new_drift_flow(self%between_kicks, size(kicks%c) + 1)
         end if
         allocate (self%x(nlane, n), self%f(nlane, n))
         allocate (self%unit(nlane, 0:m), self%zero(nlane, n), source=0.0_wp)
         allocate (self%s(nlane, n), self%u(nlane, n), self%up(nlane, n))
         if (n == 1) allocate (self%slope(nlane, 0:m), self%curvature(nlane, 1, 0:m), source=0.0_wp)
         if (self%weights%products) allocate (self%g(nlane, n, m), source=0.0_wp)
      end associate
      if (self%weights%kicks%flow /= flow_midpoint) return
      allocate (self%midpoint)
      call new_midpoint_flow(self%midpoint, task)
      self%name = 'kicks between midpoint steps'
      self%explicit = .false.
      self%one_solve = self%midpoint%stepper%one_solve
      self%most_single = min(2, self%midpoint%stepper%most_single)
      if (allocated(self%midpoint%stepper%left_out)) self%left_out = self%midpoint%stepper%left_out
   end subroutine make

   !> What takes paths one by one.
   subroutine offer_scalar_path(self, scalar)
      class(splitting_stepper), intent(in) :: self
      class(scalar_path), allocatable, intent(out) :: scalar
      type(scalar_kicks), allocatable :: made

      if (allocated(self%midpoint)) return  ! by a stepper of one lane
      allocate (made)
      made%by_mass = self%by_mass
      if (self%by_mass .and. allocated(self%ham%mass)) then
         allocate (made%mass)
         call new_constant_mass(made%mass, 1, self%ham%ndof, self%ham%nnoise)
      end if
      made%takes_all = .true.
      made%kicks = self%weights%kicks
      made%between_kicks = self%between_kicks
      if (self%weights%products .and. self%weights%kicks%samples) made%most = 12
      call move_alloc(made, scalar)
   end subroutine offer_scalar_path

   subroutine increment(self, step, q, p, dq, dp, status)
      class(splitting_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      real(wp) :: reached
      integer :: i

      dq = 0
      dp = 0
      call self%weights%weigh(self%ham%nlane, step)
      reached = 0
      associate (kicks => self%weights%kicks)
         do i = 1, size(kicks%c)
            if (kicks%c(i) > reached) &
               call drift(self, i, step%t + reached*step%h, (kicks%c(i) - reached)*step%h, q, p, dq, dp, status)
            reached = kicks%c(i)
            call kick(self, i, step%t + reached*step%h, step%h, q, p, dq, dp)
         end do
         if (reached < 1) &
            call drift(self, size(kicks%c) + 1, step%t + reached*step%h, (1 - reached)*step%h, q, p, dq, dp, status)
      end associate
   end subroutine increment

   !> Over the time tau from the time t on, the leg-th flow of the step.
   subroutine drift(self, leg, t, tau, q, p, dq, dp, status)
      type(splitting_stepper), intent(inout) :: self
      integer, intent(in) :: leg
      real(wp), intent(in) :: t, tau
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(inout) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)

      associate (nlane => self%ham%nlane, n => self%ham%ndof)
         if (allocated(self%midpoint)) then
            call self%midpoint%move(self%ham%nreal, t, tau, nlane, n, q, p, dq, dp, status)
         else if (self%by_mass) then
            call add(nlane*n, p, dp, self%s)
            call divide_by_mass(self, t, q)
            call add_times(nlane*n, tau, self%s, dq)
         else
            call self%between_kicks%move(leg, tau, nlane, n, q, p, dq, dp)
         end if
      end associate
   end subroutine drift

   !> M^-1 s in place of s.
   subroutine divide_by_mass(self, t, x)
      type(splitting_stepper), intent(inout) :: self
      real(wp), intent(in) :: t
      real(wp), intent(in) :: x(self%ham%nlane, self%ham%ndof)  !! where the path is

      self%u = self%s
      self%unit(:, 0) = 1
      call self%ham%gradient(t, self%unit, x, self%u, hp=self%s)
      self%unit(:, 0) = 0
   end subroutine divide_by_mass

   !> Kick i at the time t.
   subroutine kick(self, i, t, h, q, p, dq, dp)
      type(splitting_stepper), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: t, h
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(in) :: dq(self%ham%nlane, self%ham%ndof)
      real(wp), intent(inout) :: dp(self%ham%nlane, self%ham%ndof)

      associate (weights => self%weights, kicks => self%weights%kicks, nlane => self%ham%nlane, n => self%ham%ndof)
         call add(nlane*n, q, dq, self%x)
         if (n == 1 .and. .not. self%by_mass .and. weights%has_products(i)) then
            call find_single(self, i, t, h, p)
            call subtract(nlane, self%f, dp)
            return
         end if
         call self%ham%gradient(t, weights%w(:, :, i), self%x, p, hq=self%f)
         call self%between_kicks%remove_linear(kicks%b(i)*h, nlane, n, self%x, self%f)
         if (abs(kicks%kappa(i)) > 0) call add_force_gradient(self, 2*kicks%kappa(i)*h, t, h, p)
         if (weights%multiplies(i)) call add_products(self, kicks%share(i), t, h, p)
         call subtract(nlane*n, self%f, dp)
      end associate
   end subroutine kick

   !> f of kick i with one degree of freedom, from H_j' and H_j'' at the point.
   subroutine find_single(self, i, t, h, p)
      type(splitting_stepper), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: t, h, p(self%ham%nlane, 1)
      integer :: j, k

      associate (nlane => self%ham%nlane, weights => self%weights, noisy => self%weights%noisy, slope => self%slope, &
                 curvature => self%curvature)
         do j = 0, size(noisy)
            k = 0
            if (j > 0) k = noisy(j)
            self%unit(:, k) = 1
            call self%ham%gradient_hessian(t, self%unit, self%x, p, hq=slope(:, k:k), hqq=curvature(:, :, k:k))
            self%unit(:, k) = 0
         end do
         call self%between_kicks%remove_linear(1.0_wp, nlane, 1, self%x, slope(:, 0:0))
         self%s = 1
         call self%between_kicks%remove_linear(1.0_wp, nlane, 1, self%s, curvature(:, 1, 0:0))
         call weights%join(i, h, slope, curvature(:, 1, :), self%f)
      end associate
   end subroutine find_single

   !> f = f + factor Hess V M^-1 V_q
   subroutine add_force_gradient(self, factor, t, h, p)
      type(splitting_stepper), intent(inout) :: self
      real(wp), intent(in) :: factor, t, h
      real(wp), intent(in) :: p(self%ham%nlane, self%ham%ndof)

      associate (nlane => self%ham%nlane, n => self%ham%ndof)
         call self%ham%gradient(t, self%weights%v, self%x, p, hq=self%s)
         call self%between_kicks%remove_linear(h, nlane, n, self%x, self%s)
         if (self%by_mass) call divide_by_mass(self, t, self%x)
         call self%ham%hessian_vector(t, self%weights%v, self%x, p, self%s, self%zero, self%u, self%up)
         call self%between_kicks%remove_linear(h, nlane, n, self%s, self%u)
         call add_times(nlane*n, factor, self%u, self%f)
      end associate
   end subroutine add_force_gradient

   !> f = f + share sum_k Hess H_k M^-1 sum_l D_kl H_l,q
   subroutine add_products(self, share, t, h, p)
      type(splitting_stepper), intent(inout) :: self
      real(wp), intent(in) :: share, t, h
      real(wp), intent(in) :: p(self%ham%nlane, self%ham%ndof)
      integer :: i, k, l

      associate (nlane => self%ham%nlane, n => self%ham%ndof, weights => self%weights, noisy => self%weights%noisy)
         do k = 1, size(noisy)
            self%unit(:, noisy(k)) = 1
            call self%ham%gradient(t, self%unit, self%x, p, hq=self%g(:, :, noisy(k)))
            self%unit(:, noisy(k)) = 0
         end do
         do k = 1, size(noisy)
            if (weights%kicks%samples) then
               self%s = 0
               do l = 1, size(noisy)
                  do i = 1, n
                     self%s(:, i) = self%s(:, i) + weights%d(:, weights%at(noisy(k), noisy(l)))*self%g(:, i, noisy(l))
                  end do
               end do
            else
               self%s = (weights%c*h*abs(h))*self%g(:, :, noisy(k))
            end if
            if (self%by_mass) call divide_by_mass(self, t, self%x)
            self%unit(:, noisy(k)) = 1
            call self%ham%hessian_vector(t, self%unit, self%x, p, self%s, self%zero, self%u, self%up)
            self%unit(:, noisy(k)) = 0
            call add_times(nlane*n, share, self%u, self%f)
         end do
      end associate
   end subroutine add_products

   !> Add what was counted, by midpoint steps too.
   subroutine tally(self, total)
      class(splitting_stepper), intent(in) :: self
      type(counters_type), intent(inout) :: total

      call add_counters(total, self%ham%counters)
      if (allocated(self%midpoint)) call self%midpoint%tally(total)
   end subroutine tally

end module symsde_step_splitting_stepper
