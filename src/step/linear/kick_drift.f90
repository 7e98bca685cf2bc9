! SPDX-License-Identifier: BSD-3-Clause
!> Explicit steps of separable models, Hhat = T(p) + U(q), as kicks around one drift, and their transposed maps in the
!> reverse order:
!>
!>    p <- p - b_1 U_q(q)                       u <- u - b_2 U_qq c            at q_{n+1}
!>    q <- q + T_p(p)                           c <- c + T_pp u                at the momenta between the kicks
!>    p <- p - b_2 U_q(q)                       u <- u - b_1 U_qq c            at q_n
!>
!> Stoermer-Verlet has b = (1/2, 1/2), symplectic Euler (1, 0) and its adjoint (0, 1). A kick changes u alone, and its
!> map is linear in the weights, so the kick that ends a step and the kick that begins the next step, both at q_{n+1},
!> are done as one kick, with the sums of their weights.
!>
!> Where Hhat_qq has few entries, those of several steps are computed at once, as if the steps were further lanes.
!>
!> Tangent vectors go the same way forward: dp <- dp - b_1 U_qq dq, dq <- dq + T_pp dp, dp <- dp - b_2 U_qq dq.
!>
!> Rows of the parameters: u_theta <- u_theta - b U_{theta q} c, by the same product. T holds no parameters.
!>
!> Private to its family.
module symsde_step_linear_kick_drift
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_status, only: error_type, raise, false_trait
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type, correction_none
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_linear_linear_step, only: linear_step
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: kick_drift_step, kick_drift_fits, new_kick_drift

   integer, parameter :: most_entries = 16      !! of Hhat_qq and Hhat_{theta q}, beyond which products take less time
   real(wp), parameter :: close = 1e-9_wp      !! largest relative difference between `pull` and products
   integer, parameter :: cached = 4096         !! numbers that fit into the nearest cache

   type, extends(linear_step) :: kick_drift_step
      private
      real(wp) :: part(2) = 0                !! parts of the kick before the drift and behind it
      logical :: by_h = .false.              !! the drift is q <- q + h p, whatever the parameters
      real(wp), allocatable :: w(:, :)       !! weights of a kick (nlane, 0:nnoise)
      real(wp), pointer, contiguous :: last_w(:, :) => null()   !! weights of the last step, if its first kick waits
      logical :: waits = .false.             !! whether the kick that began the last step is still to be done
      real(wp) :: t = 0                      !! time of the step
      real(wp), allocatable, dimension(:, :) :: vq, vp, uq, up   !! vectors and products (nlane, nwide)
      real(wp), allocatable, dimension(:, :) :: cq, zero         !! c, whose rows of parameters are zero, and zero
      logical :: pulls = .false.             !! the wide model takes covectors over several steps
      integer :: ahead = 0                   !! most steps whose kicks are computed ahead; 0 = none
      real(wp), allocatable, dimension(:, :) :: ahead_w, ahead_q, ahead_p  !! (nlane ahead, ..)
      real(wp), allocatable :: hqq(:, :, :)  !! (nlane ahead, nwide, nwide)
   contains
      procedure :: back
      procedure :: take_back
      procedure :: check
      procedure :: forth
      procedure :: settle
   end type kick_drift_step

contains

   !> Whether the step is kicks around a drift: by the coefficients, for models that are separable for all values of the
   !> parameters, without damping or forces.
   logical function kick_drift_fits(task, wide)
      type(stepper_task), intent(in) :: task
      class(model_type), intent(in) :: wide
      real(wp) :: part(2)

      kick_drift_fits = .false.
      if (.not. task%is_plain() .or. task%damping%acts()) return
      call find_parts(task%scheme, part)
      associate (t => task%model%traits)
         kick_drift_fits = sum(part) > 0 .and. t%separable .and. wide%traits%separable .and. &
                           .not. (t%forces%act() .or. wide%traits%forces%act()) .and. &
                           (t%autonomous .or. (t%identity_mass .and. (t%position_noise .or. t%nnoise == 0)))
      end associate
   end function kick_drift_fits

   !> The parts of the kick before and behind the drift; zero for other schemes.
   pure subroutine find_parts(scheme, part)
      type(scheme_type), intent(in) :: scheme
      real(wp), intent(out) :: part(2)
      real(wp), parameter :: half = 0.5_wp
      logical :: is_verlet

      part = 0
      if (scheme%is_euler_pair()) then
         part(1) = scheme%abar(1, 1)
         part(2) = scheme%a(1, 1)
      else if (scheme%nstage == 2 .and. scheme%noise_coefficients_equal()) then
         is_verlet = all(abs(scheme%alpha - half) <= 0) .and. all(abs(scheme%c - [0, 1]) <= 0) .and. &
                     all(abs(scheme%a(1, :)) <= 0) .and. all(abs(scheme%a(2, :) - half) <= 0) .and. &
                     all(abs(scheme%abar(:, 1) - half) <= 0) .and. all(abs(scheme%abar(:, 2)) <= 0)
         if (is_verlet) part = half
      end if
   end subroutine find_parts

   !> Make the transposed step for blocks of nlane lanes.
   subroutine new_kick_drift(self, task, wide, nlane)
      type(kick_drift_step), intent(out) :: self
      type(stepper_task), intent(in) :: task
      class(model_type), intent(in), target :: wide
      integer, intent(in) :: nlane

      self%nlane = nlane
      self%ndof = task%model%traits%ndof
      self%nwide = wide%traits%ndof
      call find_parts(task%scheme, self%part)
      associate (t => task%model%traits)
         self%by_h = t%identity_mass .and. (t%position_noise .or. t%nnoise == 0)
         self%by_position = self%by_h
      end associate
      call new_one_step_hamiltonian(self%ham, wide, nlane, correction_none, 0.0_wp)
      allocate (self%w(nlane, 0:wide%traits%nnoise), source=0.0_wp)
      allocate (self%vq(nlane, self%nwide), self%vp(nlane, self%nwide), source=0.0_wp)
      allocate (self%cq(nlane, self%nwide), self%zero(nlane, self%nwide), source=0.0_wp)
      allocate (self%uq(nlane, self%nwide), self%up(nlane, self%nwide))
      self%pulls = self%by_h .and. self%ham%offers%pull
      if (self%pulls) return
      if (self%ndof*self%nwide > most_entries .or. .not. (self%by_h .and. wide%traits%has_hessian)) return
      self%ahead = 1
      associate (numbers => 1 + wide%traits%nnoise + self%nwide + self%nwide**2)
         if (wide%traits%autonomous) self%ahead = max(1, cached/(nlane*numbers))
      end associate
      associate (n => nlane*self%ahead)
         allocate (self%ahead_w(n, 0:wide%traits%nnoise), self%ahead_q(n, self%nwide))
         allocate (self%hqq(n, self%nwide, self%nwide))
         allocate (self%ahead_p(n, self%nwide), source=0.0_wp)
      end associate
   end subroutine new_kick_drift

   !> Take covectors back over several steps. Hhat_qq is computed at some states at once, from state `high` down; where
   !> fewer are left, the last is repeated. Each kick has the weights of the steps that end and begin at its state.
   subroutine take_back(self, low, high, nstep, t, h, dw, q, u, c, taken)
      class(kick_drift_step), intent(inout) :: self
      integer, intent(in) :: low, high, nstep
      real(wp), intent(in) :: t, h
      real(wp), intent(in) :: dw(self%nlane, self%ham%nnoise, 0:nstep - 1)
      real(wp), intent(in) :: q(self%nlane, self%ndof, 0:nstep)
      real(wp), intent(inout) :: u(self%nlane, self%nrow), c(self%nlane, self%ndof)
      logical, intent(out) :: taken
      integer :: j, first, state

      taken = self%pulls .or. self%ahead > 0
      if (.not. taken) return
      if (self%pulls) then
         call self%ham%fast%pull(self%nlane, self%nwide, self%ham%nnoise, self%ndof, high - low, t, h, self%part, &
                                 dw(:, :, low:high - 1), q(:, :, low:high), self%q(:, self%ndof + 1:), u, c)
         return
      end if
      call repeat_parameters(self)
      do first = high, low, -self%ahead
         do j = 0, self%ahead - 1
            state = max(low, first - j)
            call weigh_kick(self, self%nlane*j, merge(self%part(2), 0.0_wp, state > low), &
                            merge(self%part(1), 0.0_wp, state < high), h, dw(:, :, max(low, state - 1)), &
                            dw(:, :, min(high - 1, state)), q(:, :, state))
         end do
         call self%ham%bare_gradient_hessian(self%nlane*self%ahead, t + real(first - low, wp)*h, self%ahead_w, &
                                             self%ahead_q, self%ahead_p, hqq=self%hqq)
         do j = 0, min(self%ahead - 1, first - low)
            call kick_ahead(self, self%nlane*j, u, c)
            if (first - j > low) call drift_by_h(self%nlane, self%ndof, h, u, c)
         end do
      end do
   end subroutine take_back

   !> Compare `pull` of the wide model with products of its Hessian, over two steps through states of size one. A model
   !> that is not finite there is not tested.
   subroutine check(self, theta, t, h, error)
      class(kick_drift_step), intent(inout) :: self
      real(wp), intent(in) :: theta(:)
      real(wp), intent(in) :: t, h
      type(error_type), allocatable, intent(inout) :: error
      integer, parameter :: nstep = 2
      real(wp) :: rows(self%nlane, size(theta)), q(self%nlane, self%ndof, 0:nstep)
      real(wp) :: dw(self%nlane, self%ham%nnoise, 0:nstep - 1)
      real(wp), dimension(self%nlane, self%nrow) :: u, right_u
      real(wp), dimension(self%nlane, self%ndof) :: c, right_c
      real(wp) :: a, b, size_of
      integer :: i, s
      logical :: taken

      if (allocated(error) .or. .not. self%pulls) return
      do i = 1, size(theta)
         rows(:, i) = theta(i)
      end do
      call self%set_parameters(rows)
      call scatter(size(q), 0.3_wp, 1.0_wp, q)
      call scatter(size(dw), -0.4_wp, sqrt(abs(h)), dw)
      call scatter(size(u), -0.3_wp, 1.0_wp, u)
      call scatter(size(c), 0.2_wp, 1.0_wp, c)
      right_u = u
      right_c = c
      call self%take_back(0, nstep, nstep, t, h, dw, q, u, c, taken)
      do s = nstep, 0, -1
         a = merge(self%part(2), 0.0_wp, s > 0)
         b = merge(self%part(1), 0.0_wp, s < nstep)
         self%w(:, 0) = (a + b)*h
         self%w(:, 1:) = a*dw(:, :, max(0, s - 1)) + b*dw(:, :, min(nstep - 1, s))
         self%t = t + s*h
         call kick(self, q(:, :, s), right_u, right_c)
         if (s > 0) call drift_by_h(self%nlane, self%ndof, h, right_u, right_c)
      end do
      size_of = maxval(abs(right_u)) + maxval(abs(right_c))
      if (.not. size_of < huge(size_of)) return
      if (.not. max(maxval(abs(u - right_u)), maxval(abs(c - right_c))) <= close*size_of) &
         call raise(error, false_trait, 'check_pull', "model '"//self%ham%model%name//"' takes covectors over two "// &
                    'steps as its Hessian does not: correct pull or hessian_vector, or give no pull')
   end subroutine check

   !> Numbers from low to low + 1, times a factor.
   pure subroutine scatter(n, low, factor, x)
      integer, intent(in) :: n
      real(wp), intent(in) :: low, factor
      real(wp), intent(out) :: x(n)
      real(wp), parameter :: golden = 0.6180339887498949_wp
      integer :: i

      do i = 1, n
         x(i) = factor*(low + modulo(i*golden, 1.0_wp))
      end do
   end subroutine scatter

   !> The parameters of the lanes, for all states that are computed at once.
   subroutine repeat_parameters(self)
      type(kick_drift_step), intent(inout) :: self
      integer :: i, j

      do i = self%ndof + 1, self%nwide
         do j = 0, self%ahead - 1
            self%ahead_q(self%nlane*j + 1:self%nlane*(j + 1), i) = self%q(:, i)
         end do
      end do
   end subroutine repeat_parameters

   !> State and weights of a kick, behind `from` other rows: parts of those of the step that it ends, and of the step
   !> that it begins.
   subroutine weigh_kick(self, from, ends, begins, h, before, behind, q)
      type(kick_drift_step), intent(inout) :: self
      integer, intent(in) :: from
      real(wp), intent(in) :: ends, begins, h
      real(wp), intent(in), dimension(self%nlane, self%ham%nnoise) :: before, behind
      real(wp), intent(in) :: q(self%nlane, self%ndof)
      integer :: i, lane

      do lane = 1, self%nlane
         self%ahead_w(from + lane, 0) = (ends + begins)*h
      end do
      do i = 1, self%ham%nnoise
         do lane = 1, self%nlane
            self%ahead_w(from + lane, i) = ends*before(lane, i) + begins*behind(lane, i)
         end do
      end do
      do i = 1, self%ndof
         do lane = 1, self%nlane
            self%ahead_q(from + lane, i) = q(lane, i)
         end do
      end do
   end subroutine weigh_kick

   !> c <- c + h u
   pure subroutine drift_by_h(nlane, ndof, h, u, c)
      integer, intent(in) :: nlane, ndof
      real(wp), intent(in) :: h, u(nlane, ndof)
      real(wp), intent(inout) :: c(nlane, ndof)
      integer :: i, lane

      do i = 1, ndof
         do lane = 1, nlane
            c(lane, i) = c(lane, i) + h*u(lane, i)
         end do
      end do
   end subroutine drift_by_h

   subroutine back(self, step, q0, p0, q1, p1, u, c, status)
      class(kick_drift_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q0(self%nlane, self%ndof), p0(self%nlane, self%ndof)
      real(wp), intent(in) :: q1(self%nlane, self%ndof), p1(self%nlane, self%ndof)
      real(wp), intent(inout) :: u(self%nlane, self%nrow), c(self%nlane, self%ndof)
      integer(i8), intent(inout) :: status(self%nlane)

      if (self%part(2) > 0 .or. self%waits) then
         call load_weights(self, self%part(2), step%w)
         self%t = step%t + step%h
         call kick(self, q1, u, c)
      end if
      if (self%by_h) then
         call drift_by_h(self%nlane, self%ndof, step%h, u, c)
      else
         call drift(self, step, q0, p0, u, c)
      end if
      self%waits = self%part(1) > 0
      self%t = step%t
      self%last_w => step%w
   end subroutine back

   !> Do the kick that begins the last step taken backward.
   subroutine settle(self, q0, p0, u, c)
      class(kick_drift_step), intent(inout) :: self
      real(wp), intent(in) :: q0(self%nlane, self%ndof), p0(self%nlane, self%ndof)
      real(wp), intent(inout) :: u(self%nlane, self%nrow), c(self%nlane, self%ndof)

      if (.not. self%waits) return
      call load_weights(self, 0.0_wp, self%last_w)
      call kick(self, q0, u, c)
      self%waits = .false.
   end subroutine settle

   subroutine forth(self, step, q0, p0, q1, p1, m, vq, vp, status)
      class(kick_drift_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q0(self%nlane, self%ndof), p0(self%nlane, self%ndof)
      real(wp), intent(in) :: q1(self%nlane, self%ndof), p1(self%nlane, self%ndof)
      integer, intent(in) :: m
      real(wp), intent(inout) :: vq(self%nlane, self%nrow, m), vp(self%nlane, self%ndof, m)
      integer(i8), intent(inout) :: status(self%nlane)
      integer :: i, j

      call move_momenta(self%part(1), step%t, q0, p0)
      if (self%by_h) then
         do j = 1, m
            do i = 1, self%ndof
               vq(:, i, j) = vq(:, i, j) + step%h*vp(:, i, j)
            end do
         end do
      else
         call load_between(self, step, q0, p0)
         do j = 1, m
            self%vq = vq(:, :, j)
            self%vp(:, :self%ndof) = vp(:, :, j)
            call self%ham%bare_product(self%nlane, self%nlane, step%t, step%w, self%q, self%p, self%vq, self%vp, &
                                       self%uq, self%up)
            vq(:, :self%ndof, j) = vq(:, :self%ndof, j) + self%up(:, :self%ndof)
         end do
      end if
      call move_momenta(self%part(2), step%t + step%h, q1, p1)

   contains

      !> dp <- dp - b (U_qq dq + U_q,theta dtheta)
      subroutine move_momenta(part, t, q, p)
         real(wp), intent(in) :: part, t
         real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)
         integer :: column

         if (.not. part > 0) return
         call self%load(q, p)
         do column = 1, m
            self%vq = vq(:, :, column)
            call self%ham%bare_product(self%nlane, self%nlane, t, step%w, self%q, self%p, self%vq, self%zero, &
                                       self%uq, self%up)
            vp(:, :, column) = vp(:, :, column) - part*self%uq(:, :self%ndof)
         end do
      end subroutine move_momenta

   end subroutine forth

   !> The point between the kicks.
   subroutine load_between(self, step, q0, p0)
      type(kick_drift_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q0(self%nlane, self%ndof), p0(self%nlane, self%ndof)

      call self%load(q0, p0)
      if (.not. self%part(1) > 0) return
      call self%ham%bare_gradient(self%nlane, step%t, step%w, self%q, self%p, hq=self%uq)
      self%p(:, :self%ndof) = self%p(:, :self%ndof) - self%part(1)*self%uq(:, :self%ndof)
   end subroutine load_between

   !> The weights of a kick: a part of those of the step that it ends, and the waiting part of the step that it begins.
   subroutine load_weights(self, part, w)
      type(kick_drift_step), intent(inout) :: self
      real(wp), intent(in) :: part
      real(wp), intent(in) :: w(self%nlane, 0:self%ham%nnoise)
      integer :: k, lane

      do k = 0, self%ham%nnoise
         do lane = 1, self%nlane
            self%w(lane, k) = part*w(lane, k)
         end do
         if (.not. self%waits) cycle
         do lane = 1, self%nlane
            self%w(lane, k) = self%w(lane, k) + self%part(1)*self%last_w(lane, k)
         end do
      end do
   end subroutine load_weights

   !> u <- u - Hhat_qq c with the Hessian computed ahead, behind `from` other rows.
   subroutine kick_ahead(self, from, u, c)
      type(kick_drift_step), intent(in) :: self
      integer, intent(in) :: from
      real(wp), intent(inout) :: u(self%nlane, self%nrow)
      real(wp), intent(in) :: c(self%nlane, self%ndof)
      integer :: i, j, lane

      do i = 1, self%nwide
         do j = 1, self%ndof
            do lane = 1, self%nlane
               u(lane, i) = u(lane, i) - self%hqq(from + lane, i, j)*c(lane, j)
            end do
         end do
      end do
   end subroutine kick_ahead

   !> u <- u - Hhat_qq c with the weights of the kick, at q.
   subroutine kick(self, q, u, c)
      type(kick_drift_step), intent(inout) :: self
      real(wp), intent(in) :: q(self%nlane, self%ndof)
      real(wp), intent(inout) :: u(self%nlane, self%nrow)
      real(wp), intent(in) :: c(self%nlane, self%ndof)
      integer :: i, lane

      do i = 1, self%ndof
         do lane = 1, self%nlane
            self%q(lane, i) = q(lane, i)
            self%cq(lane, i) = c(lane, i)
         end do
      end do
      ! U_qq does not depend on p, which keeps the value it had
      call self%ham%bare_product(self%nlane, self%nlane, self%t, self%w, self%q, self%p, self%cq, self%zero, &
                                 self%uq, self%up)
      do i = 1, self%nwide
         do lane = 1, self%nlane
            u(lane, i) = u(lane, i) - self%uq(lane, i)
         end do
      end do
   end subroutine kick

   !> c <- c + Hhat_pp u, at the momenta between the kicks.
   subroutine drift(self, step, q0, p0, u, c)
      type(kick_drift_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q0(self%nlane, self%ndof), p0(self%nlane, self%ndof)
      real(wp), intent(in) :: u(self%nlane, self%nrow)
      real(wp), intent(inout) :: c(self%nlane, self%ndof)

      call load_between(self, step, q0, p0)
      self%vq = 0
      self%vp(:, :self%ndof) = u(:, :self%ndof)
      call self%ham%bare_product(self%nlane, self%nlane, step%t, step%w, self%q, self%p, self%vq, self%vp, &
                                 self%uq, self%up)
      c = c + self%up(:, :self%ndof)
   end subroutine drift

end module symsde_step_linear_kick_drift
