! SPDX-License-Identifier: BSD-3-Clause
!> Exact rotation, for H = p.p/2 + sum_i omega_i^2 q_i^2/2 + V(q) with noise that depends on q: explicit.
!>
!>    p* = p_n - h V'(q_n)/2 - sum_k dW_k H_{k,q}(q_n)
!>    (q_{n+1}, p^) = exact flow of p.p/2 + omega^2 q^2/2 over h from (q_n, p*)
!>    p_{n+1} = p^ - h V'(q_{n+1})/2
!>
!> (trigonometric; Cohen 2012). Shears and a rotation: symplectic for every h and dW. Where V vanishes and
!> the noise is additive, E H grows exactly as it must for every h: a kick adds its square and the rotation
!> keeps H. The declared omega costs no accuracy where it is wrong, V is what remains.
module symsde_step_exact_rotation
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: correction_none, frame_rotation
   use symsde_step_drift_flow, only: drift_flow, new_drift_flow
   use symsde_step_one_step_hamiltonian, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: exact_rotation_stepper, new_exact_rotation_stepper

   type, extends(stepper_type) :: exact_rotation_stepper
      private
      type(drift_flow) :: between_kicks                !! the rotation
      real(wp), allocatable :: v(:, :)           !! weights of a kick (nlane, 0:nnoise)
      real(wp), allocatable :: x(:, :), f(:, :)  !! (nlane, ndof)
   contains
      procedure :: fits
      procedure :: make
      procedure :: increment
   end type exact_rotation_stepper

contains

   logical function fits(self, task)
      class(exact_rotation_stepper), intent(in) :: self
      type(stepper_task), intent(in) :: task

      fits = task%scheme%frame == frame_rotation
   end function fits

   subroutine make(self, task)
      class(exact_rotation_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      call new_exact_rotation_stepper(self, task%model, task%nlane)
   end subroutine make

   !> A stepper for blocks of nlane lanes; the model declares its frequencies, traits%rotation.
   subroutine new_exact_rotation_stepper(self, model, nlane)
      type(exact_rotation_stepper), intent(out) :: self
      class(model_type), intent(in), target :: model
      integer, intent(in) :: nlane

      self%name = 'exact rotation'
      self%explicit = .true.
      call new_one_step_hamiltonian(self%ham, model, nlane, correction_none, 0.0_wp)
      call new_drift_flow(self%between_kicks, 1, model%traits%rotation)
      associate (n => model%traits%ndof)
         allocate (self%v(nlane, 0:model%traits%nnoise), source=0.0_wp)
         allocate (self%x(nlane, n), self%f(nlane, n))
      end associate
   end subroutine new_exact_rotation_stepper

   subroutine increment(self, step, q, p, dq, dp, status)
      class(exact_rotation_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)

      associate (nlane => self%ham%nlane, n => self%ham%ndof, half => 0.5_wp*step%h)
         self%v = step%w
         self%v(:, 0) = half
         call self%ham%gradient(step%t, self%v, q, p, hq=self%f)
         call self%between_kicks%remove_linear(half, nlane, n, q, self%f)
         dq = 0
         dp = -self%f
         call self%between_kicks%move(1, step%h, nlane, n, q, p, dq, dp)
         self%x = q + dq
         self%v(:, 1:) = 0
         call self%ham%gradient(step%t + step%h, self%v, self%x, p, hq=self%f)
         call self%between_kicks%remove_linear(half, nlane, n, self%x, self%f)
         dp = dp - self%f
      end associate
   end subroutine increment

end module symsde_step_exact_rotation
