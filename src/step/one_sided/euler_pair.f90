! SPDX-License-Identifier: BSD-3-Clause
!> The implicit Euler pair: for a corrected or non-separable one-step Hamiltonian Hhat.
!>
!>    lambda = 0  p_{n+1} = p_n - Hhat_q(p_{n+1},q_n),  q_{n+1} = q_n + Hhat_p(p_{n+1},q_n)   [WHSB] (89)-(90)
!>    lambda = 1  q_{n+1} = q_n + Hhat_p(p_n,q_{n+1}),  p_{n+1} = p_n - Hhat_q(p_n,q_{n+1})   [WHSB] (91)-(92)
!>
!> Each method is implicit in one end point only, and explicit in the other. With d the increment of the implicit end
!> point Newton's iteration solves
!>
!>    lambda = 0  d + Hhat_q(p_n+d,q_n) = 0,   matrix I + Hhat_qp,   then  dq = Hhat_p(p_n+d,q_n)
!>    lambda = 1  d - Hhat_p(p_n,q_n+d) = 0,   matrix I - Hhat_pq,   then  dp = -Hhat_q(p_n,q_n+d)
!>
!> from d = 0, with half as many unknowns as the general stepper. (Hhat_qp)_ij is the derivative with respect to q_i and
!> p_j, Hhat_pq its transpose; the Fhat_p of forces is subtracted from Hhat_qp. The time of the step is that of its q
!> node: t_n for lambda = 0, t_{n+1} for lambda = 1.
!>
!> A corrected Hhat has a term with products of derivatives of H_k (step/hamiltonian/one_step), so that it is in general
!> not separable even if H is. The part of its Hessian with third derivatives is left out of the matrix; the root is the
!> same.
module symsde_step_one_sided_euler_pair
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_solve_newton, only: newton_type, new_newton
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: euler_pair_stepper, euler_pair_fits

   !> The stepper of both methods of the pair. A flag chooses the method, since only signs and arguments differ.
   type, extends(stepper_type) :: euler_pair_stepper
      private
      logical :: adjoint = .false.         !! whether lambda = 1
      type(newton_type) :: newton
      real(wp), allocatable :: x(:, :)     !! the unknown end point, p_{n+1} or q_{n+1} (nlane, ndof)
      real(wp), allocatable :: hqp(:, :, :)
   contains
      procedure :: make
      procedure :: increment
   end type euler_pair_stepper

contains

   !> Whether this stepper executes the task.
   logical function euler_pair_fits(task) result(fits)
      type(stepper_task), intent(in) :: task

      fits = task%is_tableau() .and. .not. task%has_brackets()
      if (fits) fits = task%scheme%is_euler_pair()
   end function euler_pair_fits

   !> Make the stepper. a_11 = 0 is lambda = 0, a_11 = 1 its adjoint; hqp is an array for the Hessian, which the adjoint
   !> reads transposed.
   subroutine make(self, task)
      class(euler_pair_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      self%name = 'one-sided'
      self%most_single = 2
      self%adjoint = task%scheme%a(1, 1) > 0.5_wp
      associate (t => task%model%traits, n => task%model%traits%ndof, nlane => task%nlane)
         call new_one_step_hamiltonian(self%ham, task%model, nlane, task%correction, &
                                       task%scheme%correction_coefficient())
         call new_newton(self%newton, nlane, n, task%newton, t%one_solve(.false.), -1, -1)
         allocate (self%x(nlane, n), self%hqp(nlane, n, n))
      end associate
      self%one_solve = self%newton%affine
   end subroutine make

   !> dq and dp: first the implicit end point by Newton, then the explicit one from the gradient at (q_n, p_{n+1}) or
   !> (q_{n+1}, p_n).
   subroutine increment(self, step, q, p, dq, dp, status)
      class(euler_pair_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)

      if (self%adjoint) then
         ! lambda = 1: q_{n+1} is implicit, then p_{n+1} = p_n - Hhat_q(p_n, q_{n+1}).
         call solve_end(self, step%t + step%h, step%w, q, p, dq, status)
         self%x = q + dq
         call self%ham%gradient(step%t + step%h, step%w, self%x, p, hq=dp)
         dp = -dp
      else
         ! lambda = 0: p_{n+1} is implicit, then q_{n+1} = q_n + Hhat_p(p_{n+1}, q_n).
         call solve_end(self, step%t, step%w, q, p, dp, status)
         self%x = p + dp
         call self%ham%gradient(step%t, step%w, q, self%x, hp=dq)
      end if
   end subroutine increment

   !> Newton for the increment d (nlane, ndof) of the implicit end point, from d = 0: d + Hhat_q(p_n+d,q_n) = 0, or d -
   !> Hhat_p(p_n,q_n+d) = 0 for the adjoint. Lanes with a status are skipped.
   subroutine solve_end(self, t, w, q, p, d, status)
      type(euler_pair_stepper), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: d(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)

      d = 0
      call self%newton%start(status)
      do while (self%newton%running)
         if (self%adjoint) then
            self%x = q + d
            call evaluate(self, t, w, self%x, p)
         else
            self%x = p + d
            call evaluate(self, t, w, q, self%x)
         end if
         if (self%ham%ndof == 1) then
            ! The equation is d + s f = 0 with s = 1 or -1, and the derivative 1 + s Hhat_qp.
            call self%newton%update_scalar(merge(-1.0_wp, 1.0_wp, self%adjoint), merge(-1.0_wp, 1.0_wp, self%adjoint), &
                                           d, status, self%ham%counters)
         else
            ! r is f on entry and becomes the residual of the equation.
            self%newton%r = merge(d - self%newton%r, d + self%newton%r, self%adjoint)
            call self%newton%update(d, status, self%ham%counters)
         end if
      end do
   end subroutine solve_end

   !> Hhat_q and I + Hhat_qp at (q, p) = (q_n, p_{n+1}), or Hhat_p and I - Hhat_pq at (q_{n+1}, p_n) for the adjoint, in
   !> the right-hand side and the matrix of Newton's iteration. The model gives Hhat_qp, which the adjoint reads
   !> transposed. A given number of fixed-point iterations needs only the gradient.
   subroutine evaluate(self, t, w, q, p)
      type(euler_pair_stepper), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in), dimension(self%ham%nlane, self%ham%ndof) :: q, p
      integer :: i

      associate (ham => self%ham, n => self%ham%ndof, newton => self%newton)
         if (newton%options%fixed_point > 0) then
            if (self%adjoint) call ham%gradient(t, w, q, p, hp=newton%r)
            if (.not. self%adjoint) call ham%gradient(t, w, q, p, hq=newton%r)
            return
         else if (.not. self%adjoint) then
            call ham%gradient_hessian(t, w, q, p, hq=newton%r, hqp=newton%a)
            if (ham%forced) newton%a = newton%a - ham%drag
         else if (n == 1) then
            call ham%gradient_hessian(t, w, q, p, hp=newton%r, hqp=newton%a)
         else
            call ham%gradient_hessian(t, w, q, p, hp=newton%r, hqp=self%hqp)
            do i = 1, n
               newton%a(:, i, :) = -self%hqp(:, :, i)
            end do
         end if
         if (n == 1) return  ! the scalar update uses the slope and adds the 1 itself
         do i = 1, n
            newton%a(:, i, i) = newton%a(:, i, i) + 1
         end do
      end associate
   end subroutine evaluate

end module symsde_step_one_sided_euler_pair
