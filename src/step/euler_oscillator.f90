! SPDX-License-Identifier: BSD-3-Clause
!> Symplectic Euler and its adjoint on an oscillator of unit frequency with additive noise, fused.
!>
!>    p_{n+1} = p_n - (h q_n - gamma dW_j),      q_{n+1} = q_n + (h p_{n+1} + sigma dW_i)       [WHSB] (89)-(90)
!>    q_{n+1} = q_n + (h p_n + sigma dW_i),      p_{n+1} = p_n - (h q_{n+1} - gamma dW_j)       [WHSB] (91)-(92)
!>
!> The plainer symsde_step_explicit asks the model for its gradient twice a step; agrees with it to a few ulps
!> (tests/verification/test_steppers.pf).
module symsde_step_euler_oscillator
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_model_abstract, only: model_type
   use symsde_model_additive_oscillator, only: additive_oscillator_model
   use symsde_model_linear_oscillator, only: linear_oscillator_model
   use symsde_scheme_scheme, only: scheme_type, correction_none
   use symsde_step_fused, only: fused_stepper_type, group
   use symsde_step_one_sided, only: is_one_sided
   use symsde_step_one_step_hamiltonian, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: euler_oscillator_stepper, new_euler_oscillator_stepper, fits_euler_oscillator

   type, extends(fused_stepper_type) :: euler_oscillator_stepper
      private
      logical :: adjoint = .false.
      real(wp) :: sigma = 0, gamma = 0     !! of the noises that move q and p
      integer :: i = 1, j = 1              !! which noises these are
   contains
      procedure :: fits
      procedure :: make
      procedure :: increment
      procedure :: pass
      procedure :: count_steps
   end type euler_oscillator_stepper

contains

   logical function fits(self, task)
      class(euler_oscillator_stepper), intent(in) :: self
      type(stepper_task), intent(in) :: task

      fits = .false.
      if (task%is_plain()) fits = fits_euler_oscillator(task%model, task%scheme)
   end function fits

   subroutine make(self, task)
      class(euler_oscillator_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      call new_euler_oscillator_stepper(self, task%model, task%scheme, task%nlane)
   end subroutine make

   !> Whether this stepper serves the model and the scheme, without correction.
   logical function fits_euler_oscillator(model, scheme)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme

      select type (model)
      type is (additive_oscillator_model)
         fits_euler_oscillator = is_one_sided(scheme)
      type is (linear_oscillator_model)
         fits_euler_oscillator = is_one_sided(scheme)
      class default
         fits_euler_oscillator = .false.
      end select
   end function fits_euler_oscillator

   !> A stepper for blocks of nlane lanes; requires fits_euler_oscillator(model, scheme).
   subroutine new_euler_oscillator_stepper(self, model, scheme, nlane)
      type(euler_oscillator_stepper), intent(out) :: self
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      integer, intent(in) :: nlane

      self%name = 'explicit, fused for oscillators'
      self%explicit = .true.
      self%adjoint = scheme%a(1, 1) > 0.5_wp
      select type (model)
      type is (additive_oscillator_model)
         self%sigma = model%sigma
         self%gamma = model%gamma
         self%j = 2
      type is (linear_oscillator_model)
         self%gamma = model%sigma
      end select
      call new_one_step_hamiltonian(self%ham, model, nlane, correction_none, 0.0_wp)
   end subroutine new_euler_oscillator_stepper

   subroutine increment(self, step, q, p, dq, dp, status)
      class(euler_oscillator_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)

      associate (nlane => self%ham%nlane, m => self%ham%nnoise, h => step%h, i => self%i, j => self%j)
         if (self%adjoint) then
            call find_increments(nlane, m, -h, self%sigma, self%gamma, i, j, step%w, p, q, dp, dq)
         else
            call find_increments(nlane, m, h, self%gamma, self%sigma, j, i, step%w, q, p, dq, dp)
         end if
      end associate
      call self%count_steps(1)
   end subroutine increment

   subroutine pass(self, nstep, w, q, p, qn, pn)
      class(euler_oscillator_stepper), intent(inout) :: self
      integer, intent(in) :: nstep
      real(wp), intent(in) :: w(self%ham%nlane, 0:self%ham%nnoise, nstep)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: qn(self%ham%nlane, self%ham%ndof), pn(self%ham%nlane, self%ham%ndof)

      ! the adjoint is the scheme itself with (q, p) -> (p, -q) and the two noises exchanged
      associate (nlane => self%ham%nlane, m => self%ham%nnoise, h => w(1, 0, 1), i => self%i, j => self%j)
         if (self%adjoint .and. nstep == group) then
            call step_group(nlane, m, -h, self%sigma, self%gamma, i, j, w, p, q, pn, qn)
         else if (self%adjoint) then
            call step_once(nlane, m, -h, self%sigma, self%gamma, i, j, w, p, q, pn, qn)
         else if (nstep == group) then
            call step_group(nlane, m, h, self%gamma, self%sigma, j, i, w, q, p, qn, pn)
         else
            call step_once(nlane, m, h, self%gamma, self%sigma, j, i, w, q, p, qn, pn)
         end if
      end associate
   end subroutine pass

   !> Two gradients a step and path.
   subroutine count_steps(self, nstep)
      class(euler_oscillator_stepper), intent(inout) :: self
      integer, intent(in) :: nstep

      self%ham%counters%gradients = self%ham%counters%gradients + 2*nstep*self%ham%nreal
   end subroutine count_steps

   ! ---- kernels: y is moved by the force of x, then x by y -----------------------------------------

   !> VEC The increments of one step.
   pure subroutine find_increments(nlane, nnoise, h, kick, shift, k, s, w, x, y, dx, dy)
      integer, intent(in) :: nlane, nnoise, k, s
      real(wp), intent(in) :: h, kick, shift, w(nlane, 0:nnoise), x(nlane), y(nlane)
      real(wp), intent(out) :: dx(nlane), dy(nlane)
      integer :: lane

      do lane = 1, nlane
         dy(lane) = -(h*x(lane) - kick*w(lane, k))
         dx(lane) = h*(y(lane) + dy(lane)) + shift*w(lane, s)
      end do
   end subroutine find_increments

   !> VEC One step.
   pure subroutine step_once(nlane, nnoise, h, kick, shift, k, s, w, x, y, xn, yn)
      integer, intent(in) :: nlane, nnoise, k, s
      real(wp), intent(in) :: h, kick, shift, w(nlane, 0:nnoise), x(nlane), y(nlane)
      real(wp), intent(out) :: xn(nlane), yn(nlane)
      real(wp) :: u, v
      integer :: lane

      do lane = 1, nlane
         u = x(lane)
         v = y(lane)
         call kick_and_drift(h, kick*w(lane, k), shift*w(lane, s), u, v)
         xn(lane) = u
         yn(lane) = v
      end do
   end subroutine step_once

   !> VEC A group of steps.
   pure subroutine step_group(nlane, nnoise, h, kick, shift, k, s, w, x, y, xn, yn)
      integer, intent(in) :: nlane, nnoise, k, s
      real(wp), intent(in) :: h, kick, shift, w(nlane, 0:nnoise, group), x(nlane), y(nlane)
      real(wp), intent(out) :: xn(nlane), yn(nlane)
      real(wp) :: u, v
      integer :: lane, step

      do lane = 1, nlane
         u = x(lane)
         v = y(lane)
         !GCC$ unroll 8
         do step = 1, group
            call kick_and_drift(h, kick*w(lane, k, step), shift*w(lane, s, step), u, v)
         end do
         xn(lane) = u
         yn(lane) = v
      end do
   end subroutine step_group

   pure subroutine kick_and_drift(h, force, shift, x, y)
      real(wp), intent(in) :: h, force, shift
      real(wp), intent(inout) :: x, y

      y = y - (h*x - force)
      x = x + (h*y + shift)
   end subroutine kick_and_drift

end module symsde_step_euler_oscillator
