! SPDX-License-Identifier: BSD-3-Clause
!> Euler-Maruyama on the Ito form: the contrast. Not symplectic; it blows up where the others do not.
!>
!> x = (q,p), V_k = (H_{k,p}, -H_{k,q}):  dx = (V_0 + (1/2) sum_k DV_k V_k) dt + sum_k V_k dW_k   (Ito)
!> DV_k V_k = (u_p, -u_q) with u = Hess H_k V_k, one Hessian-vector product for every noise; with one degree of freedom
!> the Hessian itself, which comes with the gradient.
module symsde_step_explicit_euler_maruyama
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_vectors, only: subtract, add_times
   use symsde_scheme_scheme, only: correction_none
   use symsde_step_lone, only: lone_stepper
   use symsde_step_explicit_lone_tableau, only: lone_explicit, one_slope
   use symsde_step_explicit_lone_swing, only: new_lone_explicit
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: euler_maruyama_stepper

   type, extends(stepper_type) :: euler_maruyama_stepper
      private
      logical :: has_ito_drift = .true.
      real(wp), allocatable :: e(:, :)       !! weights that single out one noise (nlane, 0:nnoise)
      real(wp), allocatable :: fq(:, :), fp(:, :), uq(:, :), up(:, :)
      real(wp), allocatable, dimension(:, :, :) :: hqq, hqp, hpp  !! with one degree of freedom (nlane, 1, 1)
   contains
      procedure :: make
      procedure :: increment
      procedure :: offer_lone
   end type euler_maruyama_stepper

contains

   subroutine make(self, task)
      class(euler_maruyama_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      self%name = 'Euler-Maruyama (not symplectic)'
      self%most_single = 2
      self%explicit = .true.
      self%has_ito_drift = .not. task%model%traits%correction_vanishes()
      associate (n => task%model%traits%ndof, m => task%model%traits%nnoise, nlane => task%nlane)
         call new_one_step_hamiltonian(self%ham, task%model, nlane, correction_none, 0.0_wp)
         allocate (self%e(nlane, 0:m), source=0.0_wp)
         allocate (self%fq(nlane, n), self%fp(nlane, n), self%uq(nlane, n), self%up(nlane, n))
         if (n == 1) allocate (self%hqq(nlane, 1, 1), self%hqp(nlane, 1, 1), self%hpp(nlane, 1, 1))
      end associate
   end subroutine make

   !> What takes paths one by one, by one slope; the Ito drift of one degree of freedom whose model has terms.
   subroutine offer_lone(self, lone)
      class(euler_maruyama_stepper), intent(in) :: self
      class(lone_stepper), allocatable, intent(out) :: lone
      class(lone_explicit), allocatable :: made

      associate (traits => self%ham%model%traits)
         if (self%has_ito_drift .and. .not. (traits%has_angle_terms .or. traits%has_linear_terms)) return
         call new_lone_explicit(made, one_slope, traits)
      end associate
      call move_alloc(made, lone)
   end subroutine offer_lone

   subroutine increment(self, step, q, p, dq, dp, status)
      class(euler_maruyama_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      real(wp) :: half
      integer :: k, n

      half = 0.5_wp*abs(step%h)  ! of the variance of dW
      n = size(q)
      call self%ham%gradient(step%t, step%w, q, p, hq=self%fq, hp=dq)
      dp = 0
      call subtract(n, self%fq, dp)
      if (.not. self%has_ito_drift) return
      do k = 1, self%ham%nnoise
         self%e(:, k) = 1
         call ito_drift(self, step%t, q, p)
         self%e(:, k) = 0
         call add_times(n, half, self%up, dq)
         call add_times(n, -half, self%uq, dp)
      end do
   end subroutine increment

   !> u = Hess H_k (H_{k,p}, -H_{k,q}) for the noise singled out by the weights e.
   subroutine ito_drift(self, t, q, p)
      type(euler_maruyama_stepper), intent(inout) :: self
      real(wp), intent(in) :: t
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)

      associate (nlane => self%ham%nlane, n => self%ham%ndof, m => self%ham%nnoise, c => self%ham%counters)
         if (n == 1) then
            call self%ham%gradient_hessian(t, self%e, q, p, self%fq, self%fp, self%hqq, self%hqp, self%hpp)
            call multiply(nlane, self%hqq, self%hqp, self%hpp, self%fq, self%fp, self%uq, self%up)
            return
         end if
         call self%ham%model%gradient(nlane, n, m, t, self%e, q, p, self%fq, self%fp)
         self%fq = -self%fq
         call self%ham%model%hessian_vector(nlane, n, m, t, self%e, q, p, self%fp, self%fq, self%uq, self%up)
         c%gradients = c%gradients + self%ham%nreal
         c%hessian_vectors = c%hessian_vectors + self%ham%nreal
      end associate
   end subroutine ito_drift

   !> VEC u = Hess (f_p, -f_q): products are added one after the other, or lanes would differ in their last bits.
   pure subroutine multiply(nlane, hqq, hqp, hpp, fq, fp, uq, up)
      integer, intent(in) :: nlane
      real(wp), intent(in), dimension(nlane) :: hqq, hqp, hpp, fq, fp
      real(wp), intent(out) :: uq(nlane), up(nlane)
      real(wp) :: x, y
      integer :: lane

      do lane = 1, nlane
         x = 0
         y = 0
         x = x + hqq(lane)*fp(lane)
         y = y + hqp(lane)*fp(lane)
         uq(lane) = x - hqp(lane)*fq(lane)
         up(lane) = y - hpp(lane)*fq(lane)
      end do
   end subroutine multiply

end module symsde_step_explicit_euler_maruyama
