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
!> One gradient at Q with all weights gives dp. The shift is a gradient too, with the weights v_0 = 0 and v_k = dZ_k - h
!> dW_k/2: it is sum_k v_k H_{k,q} = -sum_k v_k g_k, which does not depend on the point.
module symsde_step_explicit_verlet_dz
   use symsde_base_functionals, only: path_dz
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_scheme_scheme, only: correction_none
   use symsde_model_probe_noise_time, only: noise_changes_in_time
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: verlet_dz_stepper

   type, extends(stepper_type) :: verlet_dz_stepper
      private
      logical :: time_dependent = .false.                     !! whether g changes in time
      real(wp), allocatable :: v(:, :)                !! weights 0, dZ_k - h dW_k/2 (nlane, 0:nnoise)
      real(wp), allocatable :: qs(:, :), shift(:, :)  !! (nlane, ndof)
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

end module symsde_step_explicit_verlet_dz
