! SPDX-License-Identifier: BSD-3-Clause
!> Decays of momenta whose rates are functions gamma_i(q, t) (base/rates).
!>
!> At a fixed position the momenta decay by exp(-G), G_i = int gamma_i(q, s) ds: exactly where gamma does not depend on
!> time, else by the three nodes of Gauss, with an error of the seventh power of the duration. A free drift of duration
!> tau stands between two such decays of half its duration,
!>
!>    p <- exp(-G(q)) p,   q <- q + tau M^-1 p,   p <- exp(-G(q)) p
!>
!> which has order two and shrinks volume exactly by the rates at its ends. Where gamma depends on time alone, the drift
!> with its decay is known:
!>
!>    q <- q + reach M^-1 p,   p <- exp(-G(tau)) p,        reach = int_0^tau exp(-G(s)) ds
!>
!> With the mean rate g = G(tau)/tau, reach = tau phi(g tau) + int exp(-g s) (exp(g s - G(s)) - 1) ds. The first part is
!> that of a constant rate. The second part vanishes with the change of gamma, and is computed at the nodes of Gauss.
module symsde_step_open_varying
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use symsde_base_damping, only: damping_type, decay_less_one
   use symsde_base_kinds, only: wp
   use symsde_base_exponential, only: to_losses
   use symsde_base_vectors, only: add_times
   use symsde_noise_decay_law, only: decay_integral
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   implicit none
   private
   public :: varying_decay, new_varying_decay, loss_of_step

   real(wp), parameter :: root = sqrt(15.0_wp)
   !> Nodes and weights of Gauss on [0, 1], and the integrals of Lagrange's polynomials up to each node.
   real(wp), parameter :: node(3) = [0.5_wp - root/10, 0.5_wp, 0.5_wp + root/10]
   real(wp), parameter :: weight(3) = [5.0_wp/18, 4.0_wp/9, 5.0_wp/18]
   real(wp), parameter :: upto(3, 3) = reshape([5/36.0_wp, 5/36.0_wp + root/24, 5/36.0_wp + root/30, &
                                                2/9.0_wp - root/15, 2/9.0_wp, 2/9.0_wp + root/15, &
                                                5/36.0_wp - root/30, 5/36.0_wp - root/24, 5/36.0_wp], [3, 3])

   type :: varying_decay
      private
      type(damping_type) :: damping
      integer :: nrate = 1
      integer :: nnode = size(node)            !! 1 if rates depend on position alone
      logical, public :: of_time_alone = .false.
      real(wp), allocatable :: total(:, :)     !! G (nlane, nrate), of one lane for all if rates depend on time alone
      real(wp), allocatable :: rate(:, :, :)   !! gamma at the nodes, of as many lanes (nlane, nrate, nnode)
      real(wp), allocatable :: nowhere(:, :)   !! a position for rates that depend on time alone (1, ndof)
   contains
      procedure :: decay
      procedure :: drift
      procedure :: integrate
   end type varying_decay

contains

   !> Allocate for blocks of nlane lanes.
   subroutine new_varying_decay(self, damping, nlane, ndof)
      type(varying_decay), intent(out) :: self
      type(damping_type), intent(in) :: damping   !! damping by functions
      integer, intent(in) :: nlane, ndof
      integer :: n

      self%damping = damping
      if (.not. damping%varying%one) self%nrate = ndof
      self%of_time_alone = .not. damping%varying%of_position
      if (damping%varying%of_position .and. .not. damping%varying%of_time) self%nnode = 1
      n = merge(1, nlane, self%of_time_alone)
      allocate (self%total(n, self%nrate), self%rate(n, self%nrate, self%nnode), self%nowhere(1, ndof), source=0.0_wp)
   end subroutine new_varying_decay

   !> G over the time tau from t on, at the positions x. Without gain a negative rate makes it NaN, and so does a rate
   !> that is refused.
   subroutine integrate(self, t, tau, nlane, ndof, x, code)
      class(varying_decay), intent(inout) :: self
      integer, intent(in) :: nlane, ndof
      real(wp), intent(in) :: t, tau, x(nlane, ndof)
      integer, intent(out) :: code   !! 0, or why the rates are refused
      real(wp) :: at, part
      integer :: i

      self%total = 0
      do i = 1, self%nnode
         at = t
         part = tau
         if (self%nnode > 1) then
            at = t + node(i)*tau
            part = weight(i)*tau
         end if
         if (self%of_time_alone) then
            call self%damping%varying%find(1, ndof, self%nrate, at, self%nowhere, self%rate(:, :, i), code)
         else
            call self%damping%varying%find(nlane, ndof, self%nrate, at, x, self%rate(:, :, i), code)
         end if
         if (code /= 0) exit
         if (.not. self%damping%gain) call refuse_gain(size(self%total), self%rate(:, :, i))
         call add_times(size(self%total), part, self%rate(:, :, i), self%total)
      end do
      if (code /= 0) self%total = ieee_value(tau, ieee_quiet_nan)
   end subroutine integrate

   !> exp(-G) - 1 of a step of length h from t on, where all momenta have one rate that depends on time alone.
   real(wp) function loss_of_step(damping, ndof, t, h) result(loss)
      type(damping_type), intent(in) :: damping
      integer, intent(in) :: ndof
      real(wp), intent(in) :: t, h
      type(varying_decay) :: varying
      integer :: code

      call new_varying_decay(varying, damping, 1, ndof)
      call varying%integrate(t, h, 1, ndof, varying%nowhere, code)
      loss = decay_less_one(varying%total(1, 1))
   end function loss_of_step

   !> dp <- dp + (exp(-G) - 1) (p + dp) at the positions x, over the time tau from t on.
   subroutine decay(self, ham, t, tau, nlane, ndof, x, p, dp)
      class(varying_decay), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      integer, intent(in) :: nlane, ndof
      real(wp), intent(in) :: t, tau, x(nlane, ndof), p(nlane, ndof)
      real(wp), intent(inout) :: dp(nlane, ndof)
      integer :: i, k, code

      call self%integrate(t, tau, nlane, ndof, x, code)
      if (code /= 0) call ham%model%note_failure(code)
      if (.not. self%of_time_alone) call to_losses(size(self%total), self%total)
      do i = 1, ndof
         k = min(i, self%nrate)
         if (.not. self%of_time_alone) then
            call lose(nlane, self%total(:, k), p(:, i), dp(:, i))
         else
            if (k == i) self%total(1, k) = decay_less_one(self%total(1, k))
            call lose_alike(nlane, self%total(1, k), p(:, i), dp(:, i))
         end if
      end do
   end subroutine decay

   !> The drift with decay where gamma depends on time alone, over the time tau from t on: dq <- dq + reach v with the
   !> velocity v, dp <- dp + (exp(-G) - 1) (p + dp).
   subroutine drift(self, ham, t, tau, nlane, ndof, x, v, p, dq, dp)
      class(varying_decay), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      integer, intent(in) :: nlane, ndof
      real(wp), intent(in) :: t, tau
      real(wp), intent(in), dimension(nlane, ndof) :: x, v, p
      real(wp), intent(inout), dimension(nlane, ndof) :: dq, dp
      real(wp) :: g, reach, loss, rate(size(node))
      integer :: i, k, code

      call self%integrate(t, tau, nlane, ndof, x, code)
      if (code /= 0) call ham%model%note_failure(code)
      do i = 1, ndof
         k = min(i, self%nrate)
         if (k == i) then
            ! all lanes have the same rates
            g = self%total(1, k)
            rate = self%rate(1, k, :)
            rate = tau*rate
            reach = tau*decay_integral(1.0_wp, g) + tau*change(rate, g)
            loss = decay_less_one(g)
         end if
         call add_times(nlane, reach, v(:, i), dq(:, i))
         call lose_alike(nlane, loss, p(:, i), dp(:, i))
      end do
   end subroutine drift

   !> int_0^1 exp(-g s) (exp(g s - G(s)) - 1) ds, in units of the duration.
   pure real(wp) function change(rate, g)
      real(wp), intent(in) :: rate(3)   !! gamma tau at the nodes
      real(wp), intent(in) :: g         !! mean of gamma tau
      integer :: i

      change = 0
      !GCC$ novector
      do i = 1, size(node)
         change = change + weight(i)*exp(-g*node(i))*decay_less_one(sum(upto(i, :)*rate) - g*node(i))
      end do
   end function change

   ! ---- kernels ----------------------------------------------------------------------------------

   !> Make negative rates NaN.
   pure subroutine refuse_gain(n, rate)
      integer, intent(in) :: n
      real(wp), intent(inout) :: rate(n)
      integer :: i

      do i = 1, n
         if (rate(i) < 0) rate(i) = ieee_value(rate(i), ieee_quiet_nan)
      end do
   end subroutine refuse_gain

   !> VEC dp <- dp + loss (p + dp)
   pure subroutine lose(nlane, loss, p, dp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: loss(nlane), p(nlane)
      real(wp), intent(inout) :: dp(nlane)
      integer :: lane

      do lane = 1, nlane
         dp(lane) = dp(lane) + loss(lane)*(p(lane) + dp(lane))
      end do
   end subroutine lose

   !> VEC The same with one number for all lanes.
   pure subroutine lose_alike(nlane, loss, p, dp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: loss, p(nlane)
      real(wp), intent(inout) :: dp(nlane)
      integer :: lane

      do lane = 1, nlane
         dp(lane) = dp(lane) + loss*(p(lane) + dp(lane))
      end do
   end subroutine lose_alike

end module symsde_step_open_varying
