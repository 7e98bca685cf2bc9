! SPDX-License-Identifier: BSD-3-Clause
!> Kicks for a path by itself, between drifts or rotations.
!>
!> The operations are those of step/splitting/stepper in their order. Weights are found for all steps ahead at once.
!> With one degree of freedom, sine and cosine of an angle are found once a kick, for all Hamiltonians.
!>
!> It is a twin, kept for the sake of time. A body that both include, with one lane here and the weights of one step at
!> a time, had the same bits. It took 1.2 to 1.5 of the time where noises have products, and 0.95 to 1.1 elsewhere.
module symsde_step_splitting_scalar_kicks
   use symsde_base_functionals, only: functional_set
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: step_record, steps_record, step_store, new_step_store
   use symsde_base_sincos, only: sincos_one
   use symsde_base_vectors, only: add, subtract, add_times
   use symsde_model_abstract, only: angle_terms
   use symsde_scheme_kicks, only: kicks_type
   use symsde_step_hamiltonian_mass, only: constant_mass
   use symsde_step_splitting_drift, only: drift_flow
   use symsde_step_splitting_coefficients, only: kick_weights, new_kick_weights
   use symsde_step_scalar_path, only: scalar_path
   implicit none
   private
   public :: scalar_kicks

   integer, parameter :: narrow = 4  !! degrees of freedom that leap one by one

   type, extends(scalar_path) :: scalar_kicks
      type(kicks_type) :: kicks
      type(drift_flow) :: between_kicks
      logical :: by_mass = .false.                     !! the mass is constant, and not known to be the identity
      type(constant_mass), allocatable :: mass         !! what is known of it
      type(kick_weights), private :: weights    !! of the steps ahead, a lane for each
      type(step_store), private :: ahead        !! what drives these: one step, a lane for each
      real(wp), allocatable, private :: w(:, :, :)         !! weights of each kick, side by side (0:m, nkick, step)
      real(wp), allocatable, private :: unit(:)            !! weights of one Hamiltonian alone (0:m)
      real(wp), allocatable, private :: slope(:), curvature(:)      !! H_j', H_j'' (0:m)
      type(angle_terms), allocatable, private :: terms(:)           !! of each H_j by itself (0:m)
      logical, private :: knows_terms = .false.                     !! they are found, once for all times
      real(wp), allocatable, dimension(:), private :: x, f, s, u, up, zero  !! (n)
      real(wp), allocatable, private :: v(:), g(:, :)      !! weights of V (0:m), H_k,q (n, m)
   contains
      procedure :: foresee
      procedure :: take
   end type scalar_kicks

contains

   !> The weights of all steps at once.
   subroutine foresee(self, steps)
      class(scalar_kicks), intent(inout) :: self
      type(steps_record), intent(in) :: steps
      type(step_record) :: record
      integer :: i, k, f

      if (.not. allocated(self%unit)) call make_room(self, steps)
      associate (nstep => steps%nstep)
         do k = 1, self%m
            self%ahead%w(:nstep, k, 0) = steps%w(1, k, :)
         end do
         do f = 1, size(steps%of)
            if (.not. associated(steps%of(f)%x)) cycle
            do k = 1, size(steps%of(f)%x, 2)
               self%ahead%of(f)%x(:nstep, k, 0) = steps%of(f)%x(1, k, :)
            end do
         end do
         call self%ahead%show(0, 0.0_wp, record)
         call self%weights%weigh(nstep, record)
         do i = 1, size(self%w, 2)
            do k = 0, self%m
               self%w(k, i, :nstep) = self%weights%w(:nstep, k, i)
            end do
         end do
      end associate
   end subroutine foresee

   subroutine make_room(self, steps)
      type(scalar_kicks), intent(inout) :: self
      type(steps_record), intent(in) :: steps
      type(functional_set) :: asked
      integer :: f

      do f = 1, size(steps%of)
         asked%has(f) = associated(steps%of(f)%x)
      end do
      call new_step_store(self%ahead, steps%most, self%m, 2, steps%h, asked)
      call new_kick_weights(self%weights, self%kicks, self%model%traits, steps%most)
      associate (n => self%n, m => self%m)
         allocate (self%w(0:m, size(self%kicks%c), steps%most))
         allocate (self%unit(0:m), self%zero(n), source=0.0_wp)
         allocate (self%v(0:m), self%x(n), self%f(n), self%s(n), self%u(n), self%up(n))
         if (n == 1) allocate (self%slope(0:m), self%curvature(0:m), source=0.0_wp)
         if (n == 1) allocate (self%terms(0:m))
         if (self%weights%products) allocate (self%g(n, m))
      end associate
   end subroutine make_room

   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(scalar_kicks), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      real(wp) :: reached
      integer :: i

      taken = .true.
      reached = 0
      associate (n => self%n, c => self%kicks%c)
         !GCC$ novector  ! few numbers, mostly
         do i = 1, n
            dq(i) = 0
            dp(i) = 0
            self%f(i) = 0
            self%x(i) = q(i) + dq(i)
         end do
         do i = 1, size(c)
            if (c(i) > reached) call drift(self, i, t + reached*h, (c(i) - reached)*h, q, p, dq, dp)
            reached = c(i)
            if (n > 1 .or. self%by_mass) then
               call find_force(self, i, t + reached*h, h, p, self%w(:, i, self%now))
            else if (self%weights%has_products(i)) then
               call find_derivatives(self, self%m, t + reached*h, self%x, p, self%unit, self%slope, self%curvature)
               self%f(1) = self%weights%join_alone(self%now, i, h, self%w(:, i, self%now), self%slope, self%curvature)
            else
               call find_slope(self, i, t + reached*h, h, p, self%w(:, i, self%now))
            end if
         end do
         if (reached < 1) then
            call drift(self, size(c) + 1, t + reached*h, (1 - reached)*h, q, p, dq, dp)
         else
            !GCC$ novector
            do i = 1, n
               dp(i) = dp(i) - self%f(i)
            end do
         end if
      end associate
   end subroutine take

   !> The kick that was found, and the leg-th flow of the step, over the time tau from the time t on.
   subroutine drift(self, leg, t, tau, q, p, dq, dp)
      type(scalar_kicks), intent(inout) :: self
      integer, intent(in) :: leg
      real(wp), intent(in) :: t, tau, q(self%n), p(self%n)
      real(wp), intent(inout) :: dq(self%n), dp(self%n)

      if (.not. (self%by_mass .or. self%between_kicks%rotates)) then
         call leap(self%n, tau, self%f, q, p, dp, dq, self%x)
         return
      end if
      call subtract(self%n, self%f, dp)
      if (self%by_mass) then
         call add(self%n, p, dp, self%s)
         call divide_by_mass(self, t, q)
         call add_times(self%n, tau, self%s, dq)
      else
         call self%between_kicks%move(leg, tau, 1, self%n, q, p, dq, dp)
      end if
      call add(self%n, q, dq, self%x)
   end subroutine drift

   !> VEC Take the kick f, fly over the time tau, and say where the path is. Few numbers have just been written one by
   !> one: a vector of them would wait until they are in memory.
   pure subroutine leap(n, tau, f, q, p, dp, dq, x)
      integer, intent(in) :: n
      real(wp), intent(in) :: tau, f(n), q(n), p(n)
      real(wp), intent(inout) :: dp(n), dq(n)
      real(wp), intent(out) :: x(n)
      integer :: i

      if (n <= narrow) then
         !GCC$ novector
         do i = 1, n
            call leap_one(tau, f(i), q(i), p(i), dp(i), dq(i), x(i))
         end do
      else
         do i = 1, n
            call leap_one(tau, f(i), q(i), p(i), dp(i), dq(i), x(i))
         end do
      end if
   end subroutine leap

   pure subroutine leap_one(tau, f, q, p, dp, dq, x)
      real(wp), intent(in) :: tau, f, q, p
      real(wp), intent(inout) :: dp, dq
      real(wp), intent(out) :: x

      dp = dp - f
      dq = dq + tau*(p + dp)
      x = q + dq
   end subroutine leap_one

   !> M^-1 s in place of s.
   subroutine divide_by_mass(self, t, x)
      type(scalar_kicks), intent(inout) :: self
      real(wp), intent(in) :: t, x(self%n)  !! where the path is

      self%u = self%s
      self%unit(0) = 1
      if (allocated(self%mass)) then
         call self%mass%drift(self%model, 1, t, self%unit, x, self%u, self%s)
      else
         call self%model%gradient(1, self%n, self%m, t, self%unit, x, self%u, hp=self%s)
      end if
      self%unit(0) = 0
      self%counters%gradients = self%counters%gradients + 1
   end subroutine divide_by_mass

   !> With one degree of freedom, the force of kick i where it is the gradient of one sum.
   subroutine find_slope(self, i, t, h, p, w)
      type(scalar_kicks), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: t, h, p(1), w(0:self%m)
      type(angle_terms) :: terms
      real(wp) :: slope

      if (self%model%traits%has_angle_terms) then
         call self%model%angle(self%m, t, w, terms)
         self%f(1) = self%force_at(terms, t, w, self%x(1), p(1), slope)
      else
         call self%model%gradient(1, 1, self%m, t, w, self%x, p, hq=self%f)
      end if
      self%counters%gradients = self%counters%gradients + 1
      if (self%between_kicks%rotates) call self%between_kicks%remove_linear(self%kicks%b(i)*h, 1, 1, self%x, self%f)
   end subroutine find_slope

   !> With one degree of freedom, H_j' and H_j'' of every Hamiltonian that is not silent, those of H without what a
   !> rotation has.
   subroutine find_derivatives(self, m, t, x, p, unit, slope, curvature)
      type(scalar_kicks), intent(inout) :: self
      integer, intent(in) :: m
      real(wp), intent(in) :: t, x(1), p(1)
      real(wp), intent(inout) :: unit(0:m), slope(0:m), curvature(0:m)  !! of self
      real(wp), parameter :: one(1) = 1
      real(wp) :: sine, cosine
      integer :: j, k

      sine = 0
      cosine = 0
      if (self%model%traits%has_angle_terms) sine = sincos_one(x(1), cosine)
      associate (noisy => self%weights%noisy, c => self%counters)
         do j = 0, size(noisy)
            k = 0
            if (j > 0) k = noisy(j)
            unit(k) = 1
            if (self%model%traits%has_angle_terms) then
               associate (terms => self%terms(k))
                  if (.not. self%knows_terms) call self%model%angle(m, t, unit, terms)
                  slope(k) = terms%a*sine + (terms%b*cosine + (terms%c*x(1) + terms%d))
                  curvature(k) = terms%a*cosine + (terms%c - terms%b*sine)
               end associate
            else
               call self%model%gradient_hessian(1, 1, m, t, unit, x, p, hq=slope(k:k), hqq=curvature(k:k))
            end if
            unit(k) = 0
         end do
         self%knows_terms = self%model%traits%autonomous
         c%gradients = c%gradients + 1 + size(noisy)
         c%hessians = c%hessians + 1 + size(noisy)
         if (.not. self%between_kicks%rotates) return
         call self%between_kicks%remove_linear(1.0_wp, 1, 1, x, slope(0:0))
         call self%between_kicks%remove_linear(1.0_wp, 1, 1, one, curvature(0:0))
      end associate
   end subroutine find_derivatives

   !> With several, f of kick i.
   subroutine find_force(self, i, t, h, p, w)
      type(scalar_kicks), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: t, h, p(self%n), w(0:self%m)

      associate (n => self%n, weights => self%weights, kicks => self%kicks, flow => self%between_kicks, &
                 c => self%counters)
         call self%model%gradient(1, n, self%m, t, w, self%x, p, hq=self%f)
         c%gradients = c%gradients + 1
         if (flow%rotates) call flow%remove_linear(kicks%b(i)*h, 1, n, self%x, self%f)
         if (.not. weights%has_products(i)) return
         if (abs(kicks%kappa(i)) > 0) then
            self%v(:) = weights%v(self%now, :)
            call self%model%gradient(1, n, self%m, t, self%v, self%x, p, hq=self%s)
            if (flow%rotates) call flow%remove_linear(h, 1, n, self%x, self%s)
            if (self%by_mass) call divide_by_mass(self, t, self%x)
            call self%model%hessian_vector(1, n, self%m, t, self%v, self%x, p, self%s, self%zero, self%u, self%up)
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
      type(scalar_kicks), intent(inout) :: self
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
                  call add_times(n, weights%d(self%now, weights%at(noisy(k), noisy(l))), self%g(:, noisy(l)), self%s)
               end do
            else
               call add_times(n, weights%c*h*abs(h), self%g(:, noisy(k)), self%s)
            end if
            if (self%by_mass) call divide_by_mass(self, t, self%x)
            self%unit(noisy(k)) = 1
            call self%model%hessian_vector(1, n, m, t, self%unit, self%x, p, self%s, self%zero, self%u, self%up)
            self%unit(noisy(k)) = 0
            call add_times(n, share, self%u, self%f)
         end do
         c%gradients = c%gradients + size(noisy)
         c%hessian_vectors = c%hessian_vectors + size(noisy)
      end associate
   end subroutine add_products

end module symsde_step_splitting_scalar_kicks
