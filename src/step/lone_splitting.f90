! SPDX-License-Identifier: BSD-3-Clause
!> Drifts and kicks for a path by itself, where the mass is the identity and no midpoint steps come between kicks.
!>
!> The operations are those of step/splitting in their order. Weights are found for all steps ahead at once. With one
!> degree of freedom, sine and cosine of an angle are found once a kick, for all Hamiltonians.
module symsde_step_lone_splitting
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: step_record, step_store, new_step_store
   use symsde_base_sincos, only: sincos_one
   use symsde_base_vectors, only: add_times
   use symsde_model_abstract, only: angle_terms
   use symsde_scheme_kicks, only: kicks_type
   use symsde_step_drift_flow, only: drift_flow
   use symsde_step_kick_weights, only: kick_weights, new_kick_weights
   use symsde_step_lone, only: lone_stepper
   implicit none
   private
   public :: lone_splitting

   type, extends(lone_stepper) :: lone_splitting
      type(kicks_type) :: kicks
      type(drift_flow) :: between_kicks
      type(kick_weights), private :: weights    !! of the steps ahead, a lane for each
      type(step_store), private :: ahead        !! what drives these: one step, a lane for each
      integer, private :: place = 0             !! where the first of them stands among those of the path
      integer, private :: lane = 0              !! the one to be taken
      real(wp), allocatable, private :: w(:)               !! weights of a kick (0:m)
      real(wp), allocatable, private :: unit(:)            !! weights of one Hamiltonian alone (0:m)
      real(wp), allocatable, private :: slope(:), curvature(:)      !! H_j', H_j'' (0:m)
      real(wp), allocatable, dimension(:), private :: x, f, s, u, up, zero  !! (n)
      real(wp), allocatable, private :: g(:, :)            !! H_k,q (n, m)
   contains
      procedure :: foresee
      procedure :: show
      procedure :: take
   end type lone_splitting

contains

   !> The weights of all steps at once.
   subroutine foresee(self, own, place, nstep)
      class(lone_splitting), intent(inout) :: self
      type(step_store), intent(in) :: own
      integer, intent(in) :: place, nstep
      type(step_record) :: record
      integer :: k, f

      if (.not. allocated(self%unit)) call make_room(self, own)
      self%place = place
      associate (last => place + nstep - 1)
         do k = 1, self%m
            self%ahead%w(:nstep, k, 0) = own%w(1, k, place:last)
         end do
         do f = 1, size(own%of)
            if (.not. allocated(own%of(f)%x)) cycle
            do k = 1, size(own%of(f)%x, 2)
               self%ahead%of(f)%x(:nstep, k, 0) = own%of(f)%x(1, k, place:last)
            end do
         end do
      end associate
      call self%ahead%show(0, 0.0_wp, record)
      call self%weights%weigh(nstep, record)
   end subroutine foresee

   subroutine make_room(self, own)
      type(lone_splitting), intent(inout) :: self
      type(step_store), intent(in) :: own

      call new_step_store(self%ahead, own%capacity, own%nnoise, 2, own%h, own%asked)
      call new_kick_weights(self%weights, self%kicks, self%model%traits, own%capacity)
      associate (n => self%n, m => self%m)
         allocate (self%w(0:m), self%unit(0:m), self%zero(n), source=0.0_wp)
         allocate (self%x(n), self%f(n))
         if (n == 1) then
            allocate (self%slope(0:m), self%curvature(0:m), source=0.0_wp)
         else if (any(self%weights%has_products)) then
            allocate (self%s(n), self%u(n), self%up(n))
            if (self%weights%products) allocate (self%g(n, m))
         end if
      end associate
   end subroutine make_room

   subroutine show(self, own, i)
      class(lone_splitting), intent(inout) :: self
      type(step_store), intent(in), target :: own
      integer, intent(in) :: i

      self%lane = i - self%place + 1
   end subroutine show

   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(lone_splitting), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      real(wp) :: reached
      integer :: i, k

      taken = .true.
      dq = 0
      dp = 0
      reached = 0
      associate (n => self%n, c => self%kicks%c)
         do i = 1, size(c)
            if (c(i) > reached) call self%between_kicks%move(i, (c(i) - reached)*h, 1, n, q, p, dq, dp)
            reached = c(i)
            self%x(:) = q + dq
            !GCC$ novector  ! far from each other
            do k = 0, self%m
               self%w(k) = self%weights%w(self%lane, k, i)
            end do
            if (n > 1) then
               call find_force(self, i, t + reached*h, h, p)
            else if (self%weights%has_products(i)) then
               call find_derivatives(self, t + reached*h, p)
               self%f(1) = self%weights%join_alone(self%lane, i, h, self%slope, self%curvature)
            else
               call find_slope(self, i, t + reached*h, h, p)
            end if
            dp = dp - self%f
         end do
         if (reached < 1) call self%between_kicks%move(size(c) + 1, (1 - reached)*h, 1, n, q, p, dq, dp)
      end associate
   end subroutine take

   !> With one degree of freedom, the force of kick i where it is the gradient of one sum.
   subroutine find_slope(self, i, t, h, p)
      type(lone_splitting), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: t, h, p(1)
      type(angle_terms) :: terms
      real(wp) :: slope

      if (self%model%traits%has_angle_terms) then
         call self%model%angle(self%m, t, self%w, terms)
         self%f(1) = self%force_at(terms, t, self%w, self%x(1), p(1), slope)
      else
         call self%model%gradient(1, 1, self%m, t, self%w, self%x, p, hq=self%f)
      end if
      self%counters%gradients = self%counters%gradients + 1
      call self%between_kicks%remove_linear(self%kicks%b(i)*h, 1, 1, self%x, self%f)
   end subroutine find_slope

   !> With one degree of freedom, H_j' and H_j'' of every Hamiltonian that is not silent, those of H without what a
   !> rotation has.
   subroutine find_derivatives(self, t, p)
      type(lone_splitting), intent(inout) :: self
      real(wp), intent(in) :: t, p(1)
      real(wp), parameter :: one(1) = 1
      type(angle_terms) :: terms
      real(wp) :: sine, cosine
      integer :: j, k

      sine = 0
      cosine = 0
      if (self%model%traits%has_angle_terms) sine = sincos_one(self%x(1), cosine)
      associate (slope => self%slope, curvature => self%curvature, noisy => self%weights%noisy, x => self%x, &
                 c => self%counters)
         do j = 0, size(noisy)
            k = 0
            if (j > 0) k = noisy(j)
            self%unit(k) = 1
            if (self%model%traits%has_angle_terms) then
               call self%model%angle(self%m, t, self%unit, terms)
               slope(k) = terms%a*sine + (terms%b*cosine + (terms%c*x(1) + terms%d))
               curvature(k) = terms%a*cosine + (terms%c - terms%b*sine)
            else
               call self%model%gradient_hessian(1, 1, self%m, t, self%unit, x, p, hq=slope(k:k), hqq=curvature(k:k))
            end if
            self%unit(k) = 0
         end do
         c%gradients = c%gradients + 1 + size(noisy)
         c%hessians = c%hessians + 1 + size(noisy)
         if (.not. self%between_kicks%rotates) return
         call self%between_kicks%remove_linear(1.0_wp, 1, 1, x, slope(0:0))
         call self%between_kicks%remove_linear(1.0_wp, 1, 1, one, curvature(0:0))
      end associate
   end subroutine find_derivatives

   !> With several, f of kick i.
   subroutine find_force(self, i, t, h, p)
      type(lone_splitting), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: t, h, p(self%n)

      associate (n => self%n, weights => self%weights, kicks => self%kicks, flow => self%between_kicks, &
                 c => self%counters)
         call self%model%gradient(1, n, self%m, t, self%w, self%x, p, hq=self%f)
         c%gradients = c%gradients + 1
         if (flow%rotates) call flow%remove_linear(kicks%b(i)*h, 1, n, self%x, self%f)
         if (.not. weights%has_products(i)) return
         if (abs(kicks%kappa(i)) > 0) then
            self%w(:) = weights%v(self%lane, :)
            call self%model%gradient(1, n, self%m, t, self%w, self%x, p, hq=self%s)
            if (flow%rotates) call flow%remove_linear(h, 1, n, self%x, self%s)
            call self%model%hessian_vector(1, n, self%m, t, self%w, self%x, p, self%s, self%zero, self%u, self%up)
            if (flow%rotates) call flow%remove_linear(h, 1, n, self%s, self%u)
            call add_times(n, 2*kicks%kappa(i)*h, self%u, self%f)
            c%gradients = c%gradients + 1
            c%hessian_vectors = c%hessian_vectors + 1
         end if
         if (weights%multiplies(i)) call add_products(self, kicks%share(i), t, h, p)
      end associate
   end subroutine find_force

   !> f = f + share sum_k Hess H_k sum_l D_kl H_l,q
   subroutine add_products(self, share, t, h, p)
      type(lone_splitting), intent(inout) :: self
      real(wp), intent(in) :: share, t, h, p(self%n)
      integer :: k, l

      associate (n => self%n, m => self%m, weights => self%weights, noisy => self%weights%noisy, c => self%counters)
         do k = 1, size(noisy)
            self%unit(noisy(k)) = 1
            call self%model%gradient(1, n, m, t, self%unit, self%x, p, hq=self%g(:, noisy(k)))
            self%unit(noisy(k)) = 0
         end do
         do k = 1, size(noisy)
            self%s = 0
            if (weights%kicks%samples) then
               do l = 1, size(noisy)
                  call add_times(n, weights%d_of(self%lane, noisy(k), noisy(l)), self%g(:, noisy(l)), self%s)
               end do
            else
               call add_times(n, weights%c*h*abs(h), self%g(:, noisy(k)), self%s)
            end if
            self%unit(noisy(k)) = 1
            call self%model%hessian_vector(1, n, m, t, self%unit, self%x, p, self%s, self%zero, self%u, self%up)
            self%unit(noisy(k)) = 0
            call add_times(n, share, self%u, self%f)
         end do
         c%gradients = c%gradients + size(noisy)
         c%hessian_vectors = c%hessian_vectors + size(noisy)
      end associate
   end subroutine add_products

end module symsde_step_lone_splitting
