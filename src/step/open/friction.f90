! SPDX-License-Identifier: BSD-3-Clause
!> Friction on velocities by a symmetric matrix, p' = .. - Gamma M^-1 p, with a constant mass M: the free flow over the
!> time tau. With B = M^-1 Gamma, v = M^-1 p and
!>
!>    Phi(tau) = int_0^tau exp(-B s) ds
!>
!>    q <- q + Phi v,   p <- p - Gamma Phi v          exp(-Gamma M^-1 tau) - 1 = -(Phi B)^T
!>
!> so that one matrix determines the flow over a duration. The trace of B is the rate at which volume shrinks. The
!> matrices are computed once for all steps of one size: by a Taylor sum for a time tau/2^k and k doublings, which have
!> no cancellation,
!>
!>    Phi(2 tau) = 2 Phi - B Phi Phi
!>
!> M is unknown: its inverse is found by calling the model at the position of the first path, one velocity for each
!> column of Gamma.
module symsde_step_open_friction
   use symsde_base_damping, only: damping_type
   use symsde_base_kinds, only: wp
   use symsde_base_matrices, only: multiply, add_product, halvings
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   implicit none
   private
   public :: friction_flow, new_friction_flow

   integer, parameter :: nterm = 12  !! terms of the Taylor sum, for matrices of norm 1/4 at most

   type :: friction_flow
      private
      real(wp), allocatable :: friction(:, :)   !! Gamma [mass/time] (ndof, ndof)
      real(wp), allocatable :: rate(:, :)       !! B = M^-1 Gamma [1/time] (ndof, ndof)
      logical :: known = .false.                !! whether B has been found
      real(wp), allocatable :: duration(:)      !! tau of each leg, whose matrices follow (nleg)
      real(wp), allocatable :: reach(:, :, :)   !! Phi: factor of the velocity in q (ndof, ndof, nleg)
      real(wp), allocatable :: brake(:, :, :)   !! -Gamma Phi: factor of the velocity in p (ndof, ndof, nleg)
      real(wp), allocatable :: loss(:, :, :)    !! -(Phi B)^T: factor of p in p (ndof, ndof, nleg)
   contains
      procedure :: look
      procedure :: drift
      procedure :: decay
   end type friction_flow

contains

   !> Allocate for nleg durations of a step.
   pure subroutine new_friction_flow(self, damping, nleg)
      type(friction_flow), intent(out) :: self
      type(damping_type), intent(in) :: damping   !! damping by a matrix
      integer, intent(in) :: nleg
      integer :: n

      n = size(damping%friction, 1)
      self%friction = damping%friction
      allocate (self%rate(n, n), self%duration(nleg), source=0.0_wp)
      allocate (self%reach(n, n, nleg), self%brake(n, n, nleg), self%loss(n, n, nleg), source=0.0_wp)
   end subroutine new_friction_flow

   !> Find B at the position of some path, unless it is known. If no path has a finite position, the next call tries
   !> again.
   subroutine look(self, ham, t, q)
      class(friction_flow), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      real(wp), intent(in) :: t, q(ham%nlane, ham%ndof)
      real(wp), dimension(1, ham%ndof) :: x, p, v
      real(wp) :: w(1, 0:ham%nnoise)
      integer :: j, lane

      if (self%known) return
      do lane = 1, ham%nlane
         if (all(abs(q(lane, :)) <= huge(t))) exit
      end do
      if (lane > ham%nlane) return
      self%known = .true.
      if (ham%model%traits%identity_mass) then
         self%rate = self%friction
         return
      end if
      x(1, :) = q(lane, :)
      w = 0
      w(1, 0) = 1
      do j = 1, size(p, 2)
         p(1, :) = self%friction(:, j)
         call ham%bare_gradient(1, t, w, x, p, hp=v)
         self%rate(:, j) = v(1, :)
      end do
   end subroutine look

   !> The free flow over the time tau, leg `leg` of the step, from the velocity v.
   subroutine drift(self, leg, tau, nlane, ndof, v, dq, dp)
      class(friction_flow), intent(inout) :: self
      integer, intent(in) :: leg, nlane, ndof
      real(wp), intent(in) :: tau                                   !! duration with its sign [time]
      real(wp), intent(in) :: v(nlane, ndof)
      real(wp), intent(inout) :: dq(nlane, ndof), dp(nlane, ndof)

      call set_leg(self, leg, tau)
      call add_product(nlane, ndof, self%reach(:, :, leg), v, dq)
      call add_product(nlane, ndof, self%brake(:, :, leg), v, dp)
   end subroutine drift

   !> dp <- dp + (exp(-Gamma M^-1 tau) - 1) p.
   subroutine decay(self, leg, tau, nlane, ndof, p, dp)
      class(friction_flow), intent(inout) :: self
      integer, intent(in) :: leg, nlane, ndof
      real(wp), intent(in) :: tau                                   !! duration with its sign [time]
      real(wp), intent(in) :: p(nlane, ndof)
      real(wp), intent(inout) :: dp(nlane, ndof)

      call set_leg(self, leg, tau)
      call add_product(nlane, ndof, self%loss(:, :, leg), p, dp)
   end subroutine decay

   !> Compute the matrices of a leg if its duration has changed.
   pure subroutine set_leg(self, leg, tau)
      class(friction_flow), intent(inout) :: self
      integer, intent(in) :: leg
      real(wp), intent(in) :: tau
      real(wp), dimension(size(self%rate, 1), size(self%rate, 1)) :: phi, braking, lost
      integer :: n, i, j

      if (abs(tau - self%duration(leg)) <= 0) return
      n = size(self%rate, 1)
      call integrate(n, self%rate, tau, phi)
      self%reach(:, :, leg) = phi
      call multiply(n, n, self%friction, phi, braking)
      call multiply(n, n, phi, self%rate, lost)
      do j = 1, n
         do i = 1, n
            self%brake(i, j, leg) = -braking(i, j)
            self%loss(i, j, leg) = -lost(j, i)
         end do
      end do
      if (self%known) self%duration(leg) = tau
   end subroutine set_leg

   !> Phi(tau), by sum and doublings. If b is not finite, neither is the result.
   pure subroutine integrate(n, b, tau, phi)
      integer, intent(in) :: n
      real(wp), intent(in) :: b(n, n), tau
      real(wp), intent(out) :: phi(n, n)
      real(wp) :: term(n, n), square(n, n), short
      integer :: i, k, ndouble

      ndouble = halvings(n, b, tau)
      short = scale(tau, -ndouble)
      ! Phi = sum_k term_k,   term_0 = tau,   term_k = -tau B term_{k-1}/(k + 1)
      term = 0
      do i = 1, n
         term(i, i) = short
      end do
      phi = term
      do k = 1, nterm
         call multiply(n, n, b, term, square)
         term = square*(-short/(k + 1))
         phi = phi + term
      end do
      do k = 1, ndouble
         call multiply(n, n, phi, phi, square)
         call multiply(n, n, b, square, term)
         phi = 2*phi - term
      end do
   end subroutine integrate

end module symsde_step_open_friction
