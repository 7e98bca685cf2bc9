! SPDX-License-Identifier: BSD-3-Clause
!> The flow between two kicks, over the time tau. On the left it is the flow of p.p/2; on the right that of p.p/2 +
!> sum_i omega_i^2 q_i^2/2 if a model declares this linear part, an exact rotation of every degree of freedom:
!>
!>    q <- q + tau p                  q <- cos(omega tau) q + sin(omega tau)/omega p
!>    p <- p                          p <- cos(omega tau) p - omega sin(omega tau) q
!>
!> In a damped model the free flow decays, by the rate gamma_i of every degree of freedom (or by a matrix of friction,
!> see step/open/friction; or by functions of position and time, see step/open/varying), and so does a rotation:
!>
!>    q <- q + M^-1 phi p,   p <- exp(-gamma tau) p,       phi = (1 - exp(-gamma tau))/gamma
!>    q <- q + (g - 1) q + s p,   p <- p + (g - 1 - gamma s) p - omega^2 s q
!>
!> with the response s of q to a kick of p and g = s' + gamma s. Unequal phi_i do not commute with a mass that is not
!> diagonal: p is stretched by them before M^-1 is applied. For mu = gamma/2, kappa^2 = omega^2 - mu^2 these are
!> s = exp(-mu tau) sin(kappa tau)/kappa and g = exp(-mu tau) cos(kappa tau) + mu s, or hyperbolic functions. Where
!> damping is strong, with the rates r = mu + sgn(mu) sqrt(-kappa^2), omega^2/r, and phi_r = (1 - exp(-r tau))/r,
!>
!>    s = exp(-omega^2 tau/r) phi_{r - omega^2/r},   g - 1 = omega^2 (phi_r - phi_{omega^2/r})/(r - omega^2/r)
!>
!> If a model declares a quadratic part D of H, with any coupling of q and p (magnetic fields, rotating frames), the
!> flow is that of D, exp(tau J S) (step/open/linear_flow), or exp(tau (J S - gamma)) where momenta decay. Kicks are
!> those of H - D then, a function of q.
!>
!> Increments are moved, not states, so that rounding errors are relative to increments: with (x, y) = (q + dq, p + dp),
!>
!>    dq <- dq + (cos(omega tau) - 1) x + sin(omega tau)/omega y
!>    dp <- dp + (cos(omega tau) - 1) y - omega sin(omega tau) x
!>
!> where cos - 1 = -2 sin^2(omega tau/2) is computed without cancellation. Cosine and sine are computed once for each
!> duration: every drift of a step (leg) keeps its own, and recomputes them when h changes. A rotation is exact for
!> every omega h, which does not limit the step; the kicks are then those of U without its linear part (remove_linear).
!> Coefficients of a decay are kept in the same way, dp <- dp + (exp(-gamma tau) - 1) y.
!>
!> In a word of flows (scheme/words) drifts are free, and momenta decay at kicks. The scheme gjf has rational functions
!> in place of these, phi = tau/(1 + gamma tau/2) and 1 - gamma phi.
!>
!> Private to its family.
module symsde_step_splitting_drift
   use symsde_base_kinds, only: wp
   use symsde_base_vectors, only: add_times
   use symsde_base_damping, only: damping_type, decay_less_one
   use symsde_base_sincos, only: sine_of
   use symsde_noise_decay_law, only: decay_integral
   use symsde_step_open_friction, only: friction_flow, new_friction_flow
   use symsde_step_open_linear_flow, only: linear_flow, new_linear_flow, hamiltonian_field, damped_field
   use symsde_step_open_varying, only: varying_decay, new_varying_decay
   implicit none
   private
   public :: drift_flow, new_drift_flow

   type :: drift_flow
      private
      logical, public :: rotates = .false.
      logical, public :: decays = .false.
      type(friction_flow), allocatable, public :: friction  !! flow with a matrix of friction
      type(linear_flow), allocatable :: coupled             !! rotation that couples degrees of freedom
      real(wp), allocatable, public :: inverse_mass(:, :)   !! D_pp of a quadratic part D (ndof, ndof)
      real(wp), allocatable :: stiffness(:, :)              !! D_qq (ndof, ndof)
      type(varying_decay), allocatable, public :: varying   !! decays by rates that are functions
      logical, public :: decays_at_kicks = .false.
      logical :: rational = .false.
      real(wp), allocatable :: part(:)             !! of a word: part of the decay before each kick (nkick)
      logical, public :: one_rate = .false.        !! all degrees of freedom decay alike
      real(wp), allocatable :: rate(:)             !! gamma (ndof)
      real(wp), allocatable, public :: reach(:, :), loss(:, :)  !! phi, exp(-gamma tau) - 1 (ndof, nleg)
      real(wp), allocatable :: omega(:)            !! frequencies (ndof)
      real(wp), allocatable :: duration(:)         !! tau of each leg, whose coefficients follow (nleg)
      real(wp), allocatable :: cosine_less_one(:, :), sine(:, :), sine_over(:, :)
      !! cos(omega tau) - 1, omega sin(omega tau), sin(omega tau)/omega; or g - 1, omega^2 s, s (ndof, nleg)
   contains
      procedure :: move
      procedure :: prepare
      procedure :: decay
      procedure :: stretches_first
      procedure :: stretch
      procedure :: decay_at
      procedure :: remove_linear
   end type drift_flow

contains

   !> Drifts of nleg different durations in a step; rotations where omega is given, decays where momenta are damped, at
   !> kicks where parts of them are given.
   subroutine new_drift_flow(self, nleg, nlane, ndof, omega, damping, part, rational, quadratic)
      type(drift_flow), intent(out) :: self
      integer, intent(in) :: nleg, nlane, ndof
      real(wp), intent(in), optional :: omega(:)  !! frequencies (ndof)
      type(damping_type), intent(in), optional :: damping
      real(wp), allocatable, intent(in), optional :: part(:)   !! not allocated: not at kicks (nleg - 1)
      logical, intent(in), optional :: rational                !! rational functions in place of exponentials
      real(wp), intent(in), optional :: quadratic(:, :)        !! S of a quadratic part (2 ndof, 2 ndof)

      if (present(quadratic)) then
         call new_quadratic_flow(self, nleg, ndof, quadratic, damping)
         return
      end if
      if (present(damping)) self%decays = damping%acts()
      if (self%decays) then
         if (allocated(damping%friction)) then
            allocate (self%friction)
            call new_friction_flow(self%friction, damping, nleg)
         else if (.not. damping%is_constant()) then
            allocate (self%varying)
            call new_varying_decay(self%varying, damping, nlane, ndof)
         else
            self%rate = damping%rate
            self%one_rate = damping%is_scalar()
            allocate (self%duration(nleg), source=0.0_wp)
            allocate (self%reach(size(self%rate), nleg), self%loss(size(self%rate), nleg), source=0.0_wp)
         end if
      end if
      if (self%decays .and. present(part)) then
         self%decays_at_kicks = allocated(part)
         self%decays = .not. allocated(part)
         if (allocated(part)) self%part = part
      end if
      if (present(rational)) self%rational = rational
      if (.not. present(omega)) return
      self%rotates = .true.
      self%decays = .false.  ! a rotation decays by itself
      self%omega = omega
      if (allocated(self%duration)) deallocate (self%duration, self%reach, self%loss)
      if (allocated(self%friction)) then
         deallocate (self%friction)
         allocate (self%coupled)
         call new_linear_flow(self%coupled, oscillator_field(omega, damping%friction), nleg)
         return
      end if
      allocate (self%duration(nleg), source=0.0_wp)
      allocate (self%cosine_less_one(size(omega), nleg), self%sine(size(omega), nleg), source=0.0_wp)
      allocate (self%sine_over(size(omega), nleg), source=0.0_wp)
   end subroutine new_drift_flow

   !> Flows of a quadratic part z.S z/2, whose momenta may decay.
   subroutine new_quadratic_flow(self, nleg, ndof, s, damping)
      type(drift_flow), intent(inout) :: self
      integer, intent(in) :: nleg, ndof
      real(wp), intent(in) :: s(2*ndof, 2*ndof)
      type(damping_type), intent(in), optional :: damping   !! rates, or a matrix of friction where S_qp = 0
      real(wp) :: field(2*ndof, 2*ndof)

      self%rotates = .true.
      self%decays = .false.
      self%inverse_mass = s(ndof + 1:, ndof + 1:)
      self%stiffness = s(:ndof, :ndof)
      field = hamiltonian_field(s)
      if (present(damping)) field = damped_field(s, damping)
      allocate (self%coupled)
      call new_linear_flow(self%coupled, field, nleg)
   end subroutine new_quadratic_flow

   !> The field of oscillators with a matrix of friction, mass one: q' = p, p' = -omega^2 q - Gamma p.
   pure function oscillator_field(omega, friction) result(field)
      real(wp), intent(in) :: omega(:)         !! frequencies (ndof)
      real(wp), intent(in) :: friction(:, :)   !! Gamma [1/time] (ndof, ndof)
      real(wp) :: field(2*size(omega), 2*size(omega))
      integer :: n, i

      n = size(omega)
      field = 0
      do i = 1, n
         field(i, n + i) = 1
         field(n + i, i) = -omega(i)**2
         field(n + 1:, n + i) = -friction(:, i)
      end do
   end function oscillator_field

   !> Rotate (q + dq, p + dp) over the time tau, leg `leg` of the step. Without rotation a drift is one pass together
   !> with the kick before it (leap of stepper.inc).
   subroutine move(self, leg, tau, nlane, ndof, q, p, dq, dp)
      class(drift_flow), intent(inout) :: self
      integer, intent(in) :: leg, nlane, ndof
      real(wp), intent(in) :: tau                                   !! duration with its sign [time]
      real(wp), intent(in) :: q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(inout) :: dq(nlane, ndof), dp(nlane, ndof)
      real(wp) :: of_q, of_p, sine, sine_over
      integer :: i

      if (allocated(self%coupled)) then
         call self%coupled%move(leg, tau, nlane, ndof, q, p, dq, dp)
         return
      end if
      ! Steps of one size compute their coefficients in the first of them.
      if (abs(tau - self%duration(leg)) > 0) call rotate_over(self, leg, tau)
      do i = 1, ndof
         ! local numbers, which no store of a lane can change
         of_q = self%cosine_less_one(i, leg)
         sine = self%sine(i, leg)
         sine_over = self%sine_over(i, leg)
         of_p = of_q
         if (allocated(self%rate)) of_p = of_q - self%rate(i)*sine_over
         call rotate(nlane, of_q, of_p, sine, sine_over, q(:, i), p(:, i), dq(:, i), dp(:, i))
      end do
   end subroutine move

   !> The coefficients of a drift with decay over the time tau, which may be negative, the leg-th of the step.
   subroutine prepare(self, leg, tau)
      class(drift_flow), intent(inout) :: self
      integer, intent(in) :: leg
      real(wp), intent(in) :: tau

      if (abs(tau - self%duration(leg)) <= 0) return
      self%duration(leg) = tau
      if (self%rational) then
         self%reach(:, leg) = tau/(1 + 0.5_wp*(self%rate*tau))
      else
         self%reach(:, leg) = tau*decay_integral(1.0_wp, self%rate*tau)
      end if
      self%loss(:, leg) = -self%rate*self%reach(:, leg)
   end subroutine prepare

   !> Drift with decay over the time tau, leg `leg` of the step: dq <- dq + phi v with the velocity v = M^-1 (p + dp),
   !> or dq <- dq + v with v = M^-1 phi (p + dp) where `stretches_first` says so, and dp <- dp + (exp(-gamma tau) - 1)
   !> (p + dp).
   subroutine decay(self, leg, tau, nlane, ndof, v, p, dq, dp)
      class(drift_flow), intent(inout) :: self
      integer, intent(in) :: leg, nlane, ndof
      real(wp), intent(in) :: tau                                   !! duration with its sign [time]
      real(wp), intent(in) :: v(nlane, ndof), p(nlane, ndof)
      real(wp), intent(inout) :: dq(nlane, ndof), dp(nlane, ndof)
      integer :: i

      if (allocated(self%friction)) then
         call self%friction%drift(leg, tau, nlane, ndof, v, dq, dp)
         return
      end if
      call self%prepare(leg, tau)
      do i = 1, ndof
         if (self%stretches_first()) then
            dq(:, i) = dq(:, i) + v(:, i)
         else
            call add_times(nlane, self%reach(i, leg), v(:, i), dq(:, i))
         end if
         call lose(nlane, self%loss(i, leg), p(:, i), dp(:, i))
      end do
   end subroutine decay

   !> Whether phi differs between degrees of freedom, so that `decay` is given v = M^-1 phi (p + dp).
   pure logical function stretches_first(self)
      class(drift_flow), intent(in) :: self

      stretches_first = self%decays .and. allocated(self%rate) .and. .not. self%one_rate
   end function stretches_first

   !> p_i <- phi_i p_i, of leg `leg` of the step.
   subroutine stretch(self, leg, tau, nlane, ndof, p)
      class(drift_flow), intent(inout) :: self
      integer, intent(in) :: leg, nlane, ndof
      real(wp), intent(in) :: tau                                   !! duration with its sign [time]
      real(wp), intent(inout) :: p(nlane, ndof)
      integer :: i

      call self%prepare(leg, tau)
      do i = 1, ndof
         p(:, i) = self%reach(i, leg)*p(:, i)
      end do
   end subroutine stretch

   !> The decay before kick i of a step of length h: dp <- dp + (exp(-part_i gamma h) - 1) (p + dp).
   subroutine decay_at(self, i, h, nlane, ndof, p, dp)
      class(drift_flow), intent(inout) :: self
      integer, intent(in) :: i, nlane, ndof
      real(wp), intent(in) :: h                                     !! with its sign [time]
      real(wp), intent(in) :: p(nlane, ndof)
      real(wp), intent(inout) :: dp(nlane, ndof)
      real(wp) :: y(nlane, ndof)
      integer :: j

      if (.not. self%part(i) > 0) return
      if (allocated(self%friction)) then
         y = p + dp
         call self%friction%decay(i, self%part(i)*h, nlane, ndof, y, dp)
         return
      end if
      if (abs(h - self%duration(i)) > 0) then
         self%duration(i) = h
         self%loss(:, i) = decay_less_one(self%part(i)*self%rate*h)
      end if
      do j = 1, ndof
         call lose(nlane, self%loss(j, i), p(:, j), dp(:, j))
      end do
   end subroutine decay_at

   !> Subtract the linear part from the gradient of weight*U, f <- f - weight omega_i^2 x_i, or weight D_qq x, since the
   !> rotation includes it.
   pure subroutine remove_linear(self, weight, nlane, ndof, x, f)
      class(drift_flow), intent(in) :: self
      real(wp), intent(in) :: weight
      integer, intent(in) :: nlane, ndof
      real(wp), intent(in) :: x(nlane, ndof)
      real(wp), intent(inout) :: f(nlane, ndof)
      integer :: i, j

      if (.not. self%rotates) return
      if (allocated(self%stiffness)) then
         do i = 1, ndof
            do j = 1, ndof
               if (abs(self%stiffness(i, j)) > 0) &
                  call add_times(nlane, -weight*self%stiffness(i, j), x(:, j), f(:, i))
            end do
         end do
         return
      end if
      do i = 1, ndof
         f(:, i) = f(:, i) - weight*self%omega(i)**2*x(:, i)
      end do
   end subroutine remove_linear

   !> Coefficients of the rotation over tau, which may be negative. cos - 1 without cancellation; omega = 0 leaves p
   !> constant.
   pure subroutine rotate_over(self, leg, tau)
      type(drift_flow), intent(inout) :: self
      integer, intent(in) :: leg
      real(wp), intent(in) :: tau
      integer :: i

      self%duration(leg) = tau
      if (allocated(self%rate)) then
         do i = 1, size(self%omega)
            call respond(self%omega(i), 0.5_wp*self%rate(i), tau, self%cosine_less_one(i, leg), self%sine_over(i, leg))
            self%sine(i, leg) = self%omega(i)**2*self%sine_over(i, leg)
         end do
         return
      end if
      self%cosine_less_one(:, leg) = -2*sine_of(0.5_wp*tau*self%omega)**2
      self%sine(:, leg) = self%omega*sine_of(tau*self%omega)
      ! sin(omega tau)/omega becomes tau as omega -> 0, a free drift.
      where (self%omega > 0)
         self%sine_over(:, leg) = sine_of(tau*self%omega)/self%omega
      else where
         self%sine_over(:, leg) = tau
      end where
   end subroutine rotate_over

   !> g - 1 and s of a rotation that decays, by the formulas at the head.
   pure subroutine respond(omega, mu, tau, g_less_one, s)
      real(wp), intent(in) :: omega, mu   !! frequency, and half of the rate
      real(wp), intent(in) :: tau
      real(wp), intent(out) :: g_less_one, s
      real(wp), parameter :: strong = 1   ! tau sqrt(-kappa^2) from which two rates are used
      real(wp) :: kappa, square, far, near, decay

      square = (omega - mu)*(omega + mu)
      kappa = sqrt(abs(square))
      if (square < 0 .and. kappa*abs(tau) > strong) then
         far = mu + sign(kappa, mu)
         near = omega**2/far
         s = exp(-near*tau)*tau*decay_integral(1.0_wp, (far - near)*tau)
         g_less_one = omega**2*tau*(decay_integral(1.0_wp, far*tau) - decay_integral(1.0_wp, near*tau))/(far - near)
         return
      end if
      decay = exp(-mu*tau)
      s = tau
      g_less_one = 0
      if (square < 0) then
         s = sinh(kappa*tau)/kappa
         g_less_one = 2*sinh(0.5_wp*kappa*tau)**2
      else if (kappa > 0) then
         s = sine_of(kappa*tau)/kappa
         g_less_one = -2*sine_of(0.5_wp*kappa*tau)**2
      end if
      g_less_one = decay_less_one(mu*tau) + decay*(g_less_one + mu*s)
      s = decay*s
   end subroutine respond

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC dp <- dp + loss (p + dp)
   pure subroutine lose(nlane, loss, p, dp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: loss, p(nlane)
      real(wp), intent(inout) :: dp(nlane)
      integer :: lane

      do lane = 1, nlane
         dp(lane) = dp(lane) + loss*(p(lane) + dp(lane))
      end do
   end subroutine lose

   !> VEC The rotation of one degree of freedom in all lanes. q changes by the part of_q of itself and p by of_p, both
   !> cos - 1 without decay. Parentheses around the second product allow only the first to be contracted, in one lane as
   !> in many.
   pure subroutine rotate(nlane, of_q, of_p, sine, sine_over, q, p, dq, dp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: of_q, of_p, sine, sine_over, q(nlane), p(nlane)
      real(wp), intent(inout) :: dq(nlane), dp(nlane)
      real(wp) :: x, y
      integer :: lane

      do lane = 1, nlane
         x = q(lane) + dq(lane)
         y = p(lane) + dp(lane)
         dq(lane) = dq(lane) + (of_q*x + (sine_over*y))
         dp(lane) = dp(lane) + (of_p*y - (sine*x))
      end do
   end subroutine rotate

end module symsde_step_splitting_drift
