! SPDX-License-Identifier: BSD-3-Clause
!> Position Verlet with dZ, for H = p.p/2 + U(q) with additive noise in p: strong order 2, explicit.
!>
!>    Q = q_n + h p_n/2,   p_{n+1} = p_n - h U'(Q) + g dW,   q_{n+1} = Q + h p_{n+1}/2 + g (dZ - h dW/2)
!>
!> summed over the noises, with constant g_k = -H_{k,q}. This is Verlet's step under h H + sum_k dW_k H_k followed by a
!> constant shift of q: symplectic for every h, dW, dZ. If g changes in time, it is evaluated at the middle of the step,
!> and g dW becomes g dW - (g_{n+1} - g_n) (dZ/h - dW/2), which is int g dW up to the curvature of g.
!>
!> Why dZ: over a step the noise moves q by g int_0^h W(s) ds = g dZ, while Verlet's drift gives g h dW/2. The shift
!> adds the difference, and so raises the strong order for additive noise from 1 to 2.
!>
!> In a damped model half drifts decay, and the shift s of q changes p by its friction, -gamma s:
!>
!>    Q = q_n + phi p_n,                              p* = exp(-gamma h/2) p_n - h U'(Q) + g dW
!>    q_{n+1} = Q + phi p* + s,   s = g (D - phi dW)  p_{n+1} = exp(-gamma h/2) p* - gamma s,   phi = phi(h/2)
!>
!> so that q and p receive g D and g (dW - gamma D), the noise of free motion where one rate damps (step/open/kick_law).
!> With unequal rates or a matrix of friction dZ - h dW/2 takes the place of D - phi dW, to the order of the scheme.
!>
!> One gradient at Q with all weights gives dp. The shift is a gradient too, with the weights v_0 = 0 and v_k = dZ_k - h
!> dW_k/2: it is sum_k v_k H_{k,q} = -sum_k v_k g_k, which does not depend on the point.
module symsde_step_explicit_verlet_dz
   use symsde_base_damping, only: damping_type, noise_of_scheme
   use symsde_base_functionals, only: path_dz, path_stt_area, path_decay
   use symsde_base_kinds, only: wp, i8
   use symsde_base_matrices, only: add_product
   use symsde_base_record, only: step_record
   use symsde_base_vectors, only: add_times
   use symsde_scheme_scheme, only: correction_none
   use symsde_model_probe_noise_time, only: noise_changes_in_time
   use symsde_noise_decay_law, only: decay_integral
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_open_friction, only: friction_flow, new_friction_flow
   use symsde_step_open_kick_law, only: has_law, free_motion
   use symsde_step_open_linear_noise, only: linear_noise, new_linear_noise
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: verlet_dz_stepper

   type, extends(stepper_type) :: verlet_dz_stepper
      private
      logical :: time_dependent = .false.                     !! whether g changes in time
      real(wp), allocatable :: v(:, :)                !! weights of the shift: 0, v_k (nlane, 0:nnoise)
      real(wp), allocatable :: qs(:, :), shift(:, :)  !! (nlane, ndof)
      type(damping_type) :: damping
      type(friction_flow), allocatable :: friction    !! half drifts with a matrix of friction
      integer :: damping_noise = noise_of_scheme      !! of the enumerators of base/damping
      logical :: by_law = .false.                     !! whether the noise is that of free motion
      type(linear_noise), allocatable :: rest         !! of the exact noise of drifts without one rate
      real(wp), allocatable :: ps(:, :), lost(:, :)   !! momenta within the step; their loss by the shift (nlane, ndof)
   contains
      procedure :: make
      procedure :: increment
   end type verlet_dz_stepper

contains

   !> Allocate, and find out whether some g depends on time: then a step needs three more gradients instead of one.
   subroutine make(self, task)
      class(verlet_dz_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      self%name = 'Verlet with dZ'
      self%most_single = 2
      self%explicit = .true.
      self%time_dependent = noise_changes_in_time(task%model)
      call new_one_step_hamiltonian(self%ham, task%model, task%nlane, correction_none, 0.0_wp)
      allocate (self%v(task%nlane, 0:task%model%traits%nnoise), source=0.0_wp)
      allocate (self%qs(task%nlane, task%model%traits%ndof), self%shift(task%nlane, task%model%traits%ndof))
      if (.not. task%damping%acts()) return
      self%name = 'damped Verlet with dZ'
      self%damping = task%damping
      self%damping_noise = task%damping_noise
      self%by_law = has_law(task%scheme, task%damping, task%damping_noise)
      call new_linear_noise(self%rest, task)
      allocate (self%ps, self%lost, mold=self%qs)
      if (.not. allocated(task%damping%friction)) return
      allocate (self%friction)
      call new_friction_flow(self%friction, task%damping, 1)
   end subroutine make

   !> dq and dp of one step. dq = Q - q_n + h p_{n+1}/2 is computed as h (p_n + dp/2), so that it rounds like an
   !> increment.
   subroutine increment(self, step, q, p, dq, dp, status)
      class(verlet_dz_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      real(wp) :: h, tm
      integer :: k

      if (self%damping%acts()) then
         call damped_increment(self, step, q, p, dq, dp)
         return
      end if
      h = step%h
      tm = step%t + 0.5_wp*h
      ! Half a drift to Q, and the kick there: h U'(Q) - g dW by one gradient with the weights (h, dW_1, .., dW_m).
      self%qs = q + 0.5_wp*h*p
      call self%ham%gradient(tm, step%w, self%qs, p, hq=dp)
      dp = -dp
      if (.not. associated(step%of(path_dz)%x)) then  ! no noise has an effect here
         dq = h*(p + 0.5_wp*dp)
         return
      end if
      do k = 1, self%ham%nnoise
         self%v(:, k) = step%of(path_dz)%x(:, k) - 0.5_wp*h*step%w(:, k)
      end do
      if (self%time_dependent) then
         call self%ham%gradient(step%t + h, self%v, self%qs, p, hq=self%shift)
         ! -(g_{n+1} - g_n) (dZ/h - dW/2): the gradients at both ends of the step have the opposite sign of g.
         dp = dp + self%shift/h
         call self%ham%gradient(step%t, self%v, self%qs, p, hq=self%shift)
         dp = dp - self%shift/h
      end if
      dq = h*(p + 0.5_wp*dp)
      call self%ham%gradient(tm, self%v, self%qs, p, hq=self%shift)
      dq = dq - self%shift
   end subroutine increment

   !> Increments of a damped model. dp holds p* - p_n until the second half drift.
   subroutine damped_increment(self, step, q, p, dq, dp)
      type(verlet_dz_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      real(wp) :: tm
      integer :: k

      tm = step%t + 0.5_wp*step%h
      if (allocated(self%friction)) call self%friction%look(self%ham, step%t, q)
      dq = 0
      dp = 0
      self%ps = p
      call half_drift(self, 0.5_wp*step%h, dq, dp)
      self%qs = q + dq
      call self%ham%gradient(tm, step%w, self%qs, p, hq=self%shift)
      dp = dp - self%shift
      if (associated(step%of(path_dz)%x)) then
         do k = 1, self%ham%nnoise
            call weigh_shift(self, step, k)
         end do
         if (self%time_dependent) then
            call self%ham%gradient(step%t + step%h, self%v, self%qs, p, hq=self%shift)
            dp = dp + self%shift/step%h
            call self%ham%gradient(step%t, self%v, self%qs, p, hq=self%shift)
            dp = dp - self%shift/step%h
         end if
      end if
      self%ps = p + dp
      call half_drift(self, 0.5_wp*step%h, dq, dp)
      if (.not. associated(step%of(path_dz)%x)) return
      call self%ham%gradient(tm, self%v, self%qs, p, hq=self%shift)
      dq = dq - self%shift
      call rub(self, self%shift, self%lost)
      dp = dp + self%lost
      if (allocated(self%rest)) call self%rest%add(self%ham, step, q, dq, dp)
   end subroutine damped_increment

   !> The weight v_k of the shift, D_k - phi(h/2) dW_k or dZ_k - h dW_k/2.
   subroutine weigh_shift(self, step, k)
      type(verlet_dz_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      integer, intent(in) :: k
      real(wp) :: d(4), z

      associate (v => self%v(:, k), w => step%w(:, k), h => step%h, dz => step%of(path_dz)%x(:, k))
         if (.not. self%by_law) then
            self%v(:, k) = dz - 0.5_wp*h*w
            return
         end if
         z = self%damping%rate(1)*h
         d = free_motion(z, self%damping_noise, .false.)
         d(1) = d(1) - decay_integral(0.5_wp, z)
         self%v(:, k) = h*(d(1)*w + (d(2)*(dz/h - 0.5_wp*w)))
         if (associated(step%of(path_stt_area)%x)) &
            call add_times(size(v), h*d(3), step%of(path_stt_area)%x(:, k), self%v(1, k))
         if (associated(step%of(path_decay)%x)) &
            call add_times(size(v), d(4), step%of(path_decay)%x(:, k), self%v(1, k))
      end associate
   end subroutine weigh_shift

   !> The free flow of momenta ps over the time tau, with decay.
   subroutine half_drift(self, tau, dq, dp)
      type(verlet_dz_stepper), intent(inout) :: self
      real(wp), intent(in) :: tau
      real(wp), intent(inout), dimension(self%ham%nlane, self%ham%ndof) :: dq, dp
      real(wp) :: reach
      integer :: i

      if (allocated(self%friction)) then
         call self%friction%drift(1, tau, self%ham%nlane, self%ham%ndof, self%ps, dq, dp)
         return
      end if
      do i = 1, self%ham%ndof
         reach = tau*decay_integral(1.0_wp, self%damping%rate(i)*tau)
         call add_times(self%ham%nlane, reach, self%ps(:, i), dq(:, i))
         call add_times(self%ham%nlane, -self%damping%rate(i)*reach, self%ps(:, i), dp(:, i))
      end do
   end subroutine half_drift

   !> y = gamma x, or Gamma x: the mass is one.
   pure subroutine rub(self, x, y)
      type(verlet_dz_stepper), intent(in) :: self
      real(wp), intent(in) :: x(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: y(self%ham%nlane, self%ham%ndof)
      integer :: i

      y = 0
      if (allocated(self%friction)) then
         call add_product(self%ham%nlane, self%ham%ndof, self%damping%friction, x, y)
         return
      end if
      do i = 1, self%ham%ndof
         call add_times(self%ham%nlane, self%damping%rate(i), x(:, i), y(:, i))
      end do
   end subroutine rub

end module symsde_step_explicit_verlet_dz
