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
module symsde_step_splitting
   use symsde_base_counters, only: counters_type, add_counters
   use symsde_base_functionals, only: path_dz, path_stt_area, path_magnus, pair_index
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_scheme_kicks, only: kicks_type, mean_coefficient, flow_rotation, flow_midpoint
   use symsde_scheme_scheme, only: correction_none, splitting_form, frame_rotation
   use symsde_step_drift_flow, only: drift_flow, new_drift_flow
   use symsde_step_midpoint_flow, only: midpoint_flow, new_midpoint_flow
   use symsde_step_one_step_hamiltonian, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: splitting_stepper

   type, extends(stepper_type) :: splitting_stepper
      private
      type(kicks_type) :: kicks
      logical :: products = .false.                !! noises are not linear: H_k,q . H_l,q matters
      logical :: uses_dz = .false.
      logical, allocatable :: has_products(:)      !! kicks that have parts beside the gradient of one sum (nkick)
      logical :: by_sums = .false.                 !! kicks ask for V
      real(wp) :: c = 0                            !! of the mean form
      real(wp) :: h = 0                            !! that the weights of H belong to
      type(drift_flow) :: between_kicks            !! what happens between kicks
      type(midpoint_flow), allocatable :: midpoint !! or this
      logical :: by_mass = .false.                 !! the mass is constant, and not known to be the identity
      integer, allocatable :: noisy(:)             !! the noises that are not silent
      real(wp), allocatable :: a(:, :)             !! a_k (nlane, nnoise)
      real(wp), allocatable :: w(:, :, :)          !! w_ik with b_i h in front (nlane, 0:nnoise, nkick)
      real(wp), allocatable :: v(:, :)             !! weights of V (nlane, 0:nnoise)
      real(wp), allocatable :: unit(:, :)          !! weights of one Hamiltonian alone (nlane, 0:nnoise)
      real(wp), allocatable :: d(:, :)             !! D_kl at pair_index (nlane, nnoise(nnoise+1)/2)
      real(wp), allocatable :: x(:, :), y(:, :)    !! where q and p are in the step (nlane, ndof)
      real(wp), allocatable :: f(:, :)             !! gradient of a kick (nlane, ndof)
      real(wp), allocatable :: g(:, :, :)          !! H_k,q (nlane, ndof, nnoise)
      real(wp), allocatable :: slope(:, :)         !! H_j' (nlane, 0:nnoise), one degree of freedom
      real(wp), allocatable :: curvature(:, :, :)       !! H_j'' (nlane, 1, 0:nnoise), the same
      real(wp), allocatable :: s(:, :), zero(:, :), u(:, :), up(:, :)  !! a product (nlane, ndof)
   contains
      procedure :: fits
      procedure :: make
      procedure :: is_oracle
      procedure :: increment
      procedure :: tally
   end type splitting_stepper

contains

   logical function fits(self, task)
      class(splitting_stepper), intent(in) :: self
      type(stepper_task), intent(in) :: task

      fits = task%scheme%form == splitting_form .or. task%scheme%frame == frame_rotation
   end function fits

   subroutine make(self, task)
      class(splitting_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task
      integer :: k

      self%name = 'drifts and kicks'
      self%takes_one_lane = .true.
      self%explicit = .true.
      self%kicks = task%scheme%kicks
      self%c = mean_coefficient(self%kicks)
      associate (t => task%model%traits, n => task%model%traits%ndof, m => task%model%traits%nnoise, &
                 nlane => task%nlane, nkick => size(self%kicks%c))
         call new_one_step_hamiltonian(self%ham, task%model, nlane, correction_none, 0.0_wp)
         self%by_mass = .not. t%identity_mass
         if (self%kicks%flow == flow_rotation) then
            call new_drift_flow(self%between_kicks, nkick + 1, t%rotation)
         else
            call new_drift_flow(self%between_kicks, nkick + 1)
         end if
         self%noisy = [(k, k=1, m)]
         if (allocated(t%silent)) self%noisy = pack(self%noisy, .not. t%silent)
         self%products = size(self%noisy) > 0 .and. .not. t%additive
         self%by_sums = any(abs(self%kicks%kappa) > 0) .or. self%kicks%samples
         self%uses_dz = self%kicks%uses_dz()
         self%has_products = abs(self%kicks%kappa) > 0 .or. (self%products .and. abs(self%kicks%share) > 0 .and. &
                                                             (self%kicks%samples .or. abs(self%c) > 0))
         allocate (self%w(nlane, 0:m, nkick), self%a(nlane, m), source=0.0_wp)
         allocate (self%x(nlane, n), self%f(nlane, n))
         allocate (self%v(nlane, 0:m), self%unit(nlane, 0:m), self%zero(nlane, n), source=0.0_wp)
         allocate (self%s(nlane, n), self%u(nlane, n), self%up(nlane, n))
         if (n == 1) allocate (self%slope(nlane, 0:m), self%curvature(nlane, 1, 0:m), source=0.0_wp)
         if (self%products) allocate (self%g(nlane, n, m), self%d(nlane, pair_index(m, m)), source=0.0_wp)
      end associate
      if (self%kicks%flow /= flow_midpoint) return
      allocate (self%midpoint)
      call new_midpoint_flow(self%midpoint, task)
      self%name = 'kicks between midpoint steps'
      self%explicit = .false.
      self%one_solve = self%midpoint%stepper%one_solve
      if (task%nlane == 1) self%takes_one_lane = allocated(self%midpoint%lone)
      if (allocated(self%midpoint%stepper%left_out)) self%left_out = self%midpoint%stepper%left_out
   end subroutine make

   pure logical function is_oracle(self)
      class(splitting_stepper), intent(in) :: self

      is_oracle = .true.
   end function is_oracle

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
      call weigh(self, step)
      reached = 0
      associate (kicks => self%kicks)
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

   !> The weights of every kick, of V, and D.
   subroutine weigh(self, step)
      type(splitting_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      integer :: i, j, k

      associate (kicks => self%kicks, nlane => self%ham%nlane)
         if (abs(step%h - self%h) > 0) then
            self%h = step%h
            self%v(:, 0) = step%h
            do i = 1, size(kicks%c)
               self%w(:, 0, i) = kicks%b(i)*step%h
            end do
         end if
         do j = 1, size(self%noisy)
            k = self%noisy(j)
            if (self%by_sums) self%v(:, k) = step%w(:, k)
            if (self%uses_dz) call find_a(nlane, step%h, step%w(:, k), step%of(path_dz)%x(:, k), self%a(:, k))
            do i = 1, size(kicks%c)
               if (abs(kicks%gamma(i)) > 0) then
                  self%w(:, k, i) = kicks%beta(i)*step%w(:, k) + kicks%gamma(i)*self%a(:, k)
               else
                  self%w(:, k, i) = kicks%beta(i)*step%w(:, k)
               end if
            end do
            if (.not. associated(step%of(path_stt_area)%x)) cycle
            if (self%by_sums) self%v(:, k) = self%v(:, k) + kicks%zeta*step%of(path_stt_area)%x(:, k)
            do i = 1, size(kicks%c)
               self%w(:, k, i) = self%w(:, k, i) + kicks%eta(i)*step%of(path_stt_area)%x(:, k)
            end do
         end do
         if (self%products .and. kicks%samples) call find_d(self, step)
      end associate
   end subroutine weigh

   !> D_kl of the sampled form.
   subroutine find_d(self, step)
      type(splitting_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp) :: kappa
      integer :: i, j, k, l, kl

      kappa = sum(self%kicks%kappa)
      associate (c => self%kicks%c, w => self%w, v => self%v)
         do l = 1, self%ham%nnoise
            do k = 1, l
               kl = pair_index(k, l)
               ! from zero, one product after the other: of a sum of two products either one may be fused
               self%d(:, kl) = 0
               call add_product(self%ham%nlane, -2*kappa, v(:, k), v(:, l), self%d(:, kl))
               do j = 2, size(c)
                  do i = 1, j - 1
                     call add_product(self%ham%nlane, 0.5_wp*(c(j) - c(i)), w(:, k, i), w(:, l, j), self%d(:, kl))
                     call add_product(self%ham%nlane, 0.5_wp*(c(j) - c(i)), w(:, l, i), w(:, k, j), self%d(:, kl))
                  end do
               end do
               self%d(:, kl) = step%h*self%d(:, kl) - step%of(path_magnus)%x(:, kl)
            end do
         end do
      end associate
   end subroutine find_d

   !> Kick i at the time t.
   subroutine kick(self, i, t, h, q, p, dq, dp)
      type(splitting_stepper), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: t, h
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(in) :: dq(self%ham%nlane, self%ham%ndof)
      real(wp), intent(inout) :: dp(self%ham%nlane, self%ham%ndof)

      associate (kicks => self%kicks, nlane => self%ham%nlane, n => self%ham%ndof)
         call add(nlane*n, q, dq, self%x)
         if (n == 1 .and. .not. self%by_mass .and. self%has_products(i)) then
            call find_single(self, i, t, h, p)
            call subtract(nlane, self%f, dp)
            return
         end if
         call self%ham%gradient(t, self%w(:, :, i), self%x, p, hq=self%f)
         call self%between_kicks%remove_linear(kicks%b(i)*h, nlane, n, self%x, self%f)
         if (abs(kicks%kappa(i)) > 0) call add_force_gradient(self, 2*kicks%kappa(i)*h, t, h, p)
         if (self%products .and. abs(kicks%share(i)) > 0 .and. (kicks%samples .or. abs(self%c) > 0)) &
            call add_products(self, kicks%share(i), t, h, p)
         call subtract(nlane*n, self%f, dp)
      end associate
   end subroutine kick

   !> f of kick i with one degree of freedom, from H_j' and H_j'' at the point.
   subroutine find_single(self, i, t, h, p)
      type(splitting_stepper), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: t, h, p(self%ham%nlane, 1)
      integer :: j, k, l

      associate (nlane => self%ham%nlane, noisy => self%noisy, kicks => self%kicks, slope => self%slope, &
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
         call weighted_sum(nlane, self%ham%nnoise, self%w(:, :, i), slope, self%f)
         if (abs(kicks%kappa(i)) > 0) then
            call weighted_sum(nlane, self%ham%nnoise, self%v, slope, self%s)
            call weighted_sum(nlane, self%ham%nnoise, self%v, curvature(:, 1, :), self%u)
            call add_product(nlane, 2*kicks%kappa(i)*h, self%s, self%u, self%f)
         end if
         if (.not. self%products .or. abs(kicks%share(i)) <= 0) return
         do j = 1, size(noisy)
            k = noisy(j)
            if (.not. kicks%samples) then
               call add_product(nlane, kicks%share(i)*self%c*h*abs(h), slope(:, k), curvature(:, 1, k), self%f)
               cycle
            end if
            self%s = 0
            do l = 1, size(noisy)
               call add_each(nlane, self%d(:, pair_index(min(k, noisy(l)), max(k, noisy(l)))), slope(:, noisy(l)), &
                             self%s)
            end do
            call add_product(nlane, kicks%share(i), self%s, curvature(:, 1, k), self%f)
         end do
      end associate
   end subroutine find_single

   !> f = f + factor Hess V M^-1 V_q
   subroutine add_force_gradient(self, factor, t, h, p)
      type(splitting_stepper), intent(inout) :: self
      real(wp), intent(in) :: factor, t, h
      real(wp), intent(in) :: p(self%ham%nlane, self%ham%ndof)

      associate (nlane => self%ham%nlane, n => self%ham%ndof)
         call self%ham%gradient(t, self%v, self%x, p, hq=self%s)
         call self%between_kicks%remove_linear(h, nlane, n, self%x, self%s)
         if (self%by_mass) call divide_by_mass(self, t, self%x)
         call self%ham%hessian_vector(t, self%v, self%x, p, self%s, self%zero, self%u, self%up)
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

      associate (nlane => self%ham%nlane, n => self%ham%ndof, noisy => self%noisy)
         do k = 1, size(noisy)
            self%unit(:, noisy(k)) = 1
            call self%ham%gradient(t, self%unit, self%x, p, hq=self%g(:, :, noisy(k)))
            self%unit(:, noisy(k)) = 0
         end do
         do k = 1, size(noisy)
            if (self%kicks%samples) then
               self%s = 0
               do l = 1, size(noisy)
                  do i = 1, n
                     self%s(:, i) = self%s(:, i) + self%d(:, pair_index(min(noisy(k), noisy(l)), &
                                                                        max(noisy(k), noisy(l))))*self%g(:, i, noisy(l))
                  end do
               end do
            else
               self%s = (self%c*h*abs(h))*self%g(:, :, noisy(k))
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

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC a = dZ/h - dW/2
   pure subroutine find_a(nlane, h, dw, dz, a)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: h, dw(nlane), dz(nlane)
      real(wp), intent(out) :: a(nlane)
      integer :: lane

      do lane = 1, nlane
         a(lane) = dz(lane)/h - 0.5_wp*dw(lane)
      end do
   end subroutine find_a

   !> VEC x = q + dq
   pure subroutine add(n, q, dq, x)
      integer, intent(in) :: n
      real(wp), intent(in) :: q(n), dq(n)
      real(wp), intent(out) :: x(n)
      integer :: i

      do i = 1, n
         x(i) = q(i) + dq(i)
      end do
   end subroutine add

   !> VEC dp = dp - f
   pure subroutine subtract(n, f, dp)
      integer, intent(in) :: n
      real(wp), intent(in) :: f(n)
      real(wp), intent(inout) :: dp(n)
      integer :: i

      do i = 1, n
         dp(i) = dp(i) - f(i)
      end do
   end subroutine subtract

   !> VEC total = sum_j weight_j x_j
   pure subroutine weighted_sum(nlane, m, weight, x, total)
      integer, intent(in) :: nlane, m
      real(wp), intent(in) :: weight(nlane, 0:m), x(nlane, 0:m)
      real(wp), intent(out) :: total(nlane)
      integer :: lane, j

      total = 0
      do j = 0, m
         do lane = 1, nlane
            total(lane) = total(lane) + weight(lane, j)*x(lane, j)
         end do
      end do
   end subroutine weighted_sum

   !> VEC f = f + x y; with a factor of one the product below may be rounded or not.
   pure subroutine add_each(nlane, x, y, f)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: x(nlane), y(nlane)
      real(wp), intent(inout) :: f(nlane)
      integer :: lane

      do lane = 1, nlane
         f(lane) = f(lane) + x(lane)*y(lane)
      end do
   end subroutine add_each

   !> VEC f = f + factor x y
   pure subroutine add_product(nlane, factor, x, y, f)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: factor, x(nlane), y(nlane)
      real(wp), intent(inout) :: f(nlane)
      integer :: lane

      do lane = 1, nlane
         f(lane) = f(lane) + factor*(x(lane)*y(lane))
      end do
   end subroutine add_product

   !> VEC f = f + factor u
   pure subroutine add_times(n, factor, u, f)
      integer, intent(in) :: n
      real(wp), intent(in) :: factor, u(n)
      real(wp), intent(inout) :: f(n)
      integer :: i

      do i = 1, n
         f(i) = f(i) + factor*u(i)
      end do
   end subroutine add_times

end module symsde_step_splitting
