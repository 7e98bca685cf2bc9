! SPDX-License-Identifier: BSD-3-Clause
!> The energy-drift-preserving scheme of Chen, Cohen, D'Ambrosio, Lang (2020), for H = p.p/2 + V(q) with
!> additive noise in p. Not symplectic: it is there for comparison.
!>
!>    Psi = p_n + g - (h/2) F,   F = int_0^1 V'(q_n + s h Psi) ds,   q_{n+1} = q_n + h Psi,   p_{n+1} = p_n + g - h F
!>
!> with the kick g = -sum_k dW_k H_{k,q}. On every path H_{n+1} = H_n + p_n.g + g.g/2, so E H grows exactly
!> as it must, for every h, as far as the quadrature of F is exact: four Gauss nodes, polynomials V up to
!> degree eight. Unknown is X = Psi - p_n; then p_{n+1} - p_n = 2 X - g.
module symsde_step_drift_preserving
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_traits, only: dense
   use symsde_scheme_scheme, only: scheme_type, correction_none
   use symsde_solve_newton, only: newton_type, new_newton
   use symsde_step_one_step_hamiltonian, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: drift_preserving_stepper, drift_preserving_fits

   type, extends(stepper_type) :: drift_preserving_stepper
      private
      type(newton_type) :: newton
      integer :: band = dense
      real(wp), allocatable :: node(:), weight(:)      !! of the mean force
      real(wp), allocatable :: v(:, :)                 !! weights h, 0 or 0, dW_k (nlane, 0:nnoise)
      real(wp), allocatable :: kick(:, :)              !! g (nlane, ndof)
      real(wp), allocatable :: qs(:, :), hq(:, :)      !! (nlane, ndof)
      real(wp), allocatable :: hqq(:, :, :)            !! (nlane, ndof, ndof) or its bands
   contains
      procedure :: make
      procedure :: increment
   end type drift_preserving_stepper

contains

   !> Whether this stepper executes the task.
   logical function drift_preserving_fits(task) result(fits)
      type(stepper_task), intent(in) :: task

      fits = .false.
      associate (t => task%model%traits)
         if (t%nnoise > 0 .and. .not. (t%additive .and. t%position_noise)) return
         if (t%identity_mass .and. task%is_plain()) fits = averages_forces(task%scheme)
      end associate
   end function drift_preserving_fits

   !> Whether a tableau is that of averaged forces: a_ij = c_i w_j, abar_ij = w_j/2, bbar_ij = w_j.
   pure logical function averages_forces(scheme)
      type(scheme_type), intent(in) :: scheme
      real(wp), parameter :: rounding = 4*epsilon(1.0_wp)
      integer :: i

      averages_forces = all(abs(scheme%alpha - scheme%beta) <= 0)
      do i = 1, scheme%nstage
         associate (w => scheme%alpha)
            averages_forces = averages_forces .and. all(abs(scheme%a(i, :) - scheme%c(i)*w) <= rounding) .and. &
                              all(abs(scheme%abar(i, :) - 0.5_wp*w) <= rounding) .and. &
                              all(abs(scheme%bbar(i, :) - w) <= rounding)
         end associate
      end do
   end function averages_forces

   subroutine make(self, task)
      class(drift_preserving_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task
      integer :: b

      self%name = 'drift preserving'
      self%takes_one_lane = .true.
      self%left_out = 'half of the unknowns: identity mass'
      self%node = task%scheme%c
      self%weight = task%scheme%alpha
      associate (t => task%model%traits, n => task%model%traits%ndof, nlane => task%nlane)
         b = t%bandwidth
         if (2*b + 1 >= n) b = dense
         self%band = b
         call new_one_step_hamiltonian(self%ham, task%model, nlane, correction_none, 0.0_wp)
         call new_newton(self%newton, nlane, n, task%newton, t%one_solve(b /= dense), b, b)
         allocate (self%v(nlane, 0:t%nnoise), self%kick(nlane, n), self%qs(nlane, n), self%hq(nlane, n))
         if (b == dense) then
            allocate (self%hqq(nlane, n, n))
         else
            allocate (self%hqq(nlane, -b:b, n))
         end if
      end associate
      self%one_solve = self%newton%affine
   end subroutine make

   subroutine increment(self, step, q, p, dq, dp, status)
      class(drift_preserving_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      real(wp) :: h, tm

      h = step%h
      tm = step%t + 0.5_wp*h
      self%kick = 0
      if (self%ham%nnoise > 0) then
         self%v = step%w
         self%v(:, 0) = 0
         call self%ham%gradient(tm, self%v, q, p, hq=self%kick)
         self%kick = -self%kick
      end if
      self%v = 0
      self%v(:, 0) = h
      dp = 0   ! X while it is sought
      call self%newton%start(status)
      do while (self%newton%running)
         call linearise(self, h, tm, q, p, dp)
         if (self%ham%ndof == 1) then
            call self%newton%update_scalar(1.0_wp, 1.0_wp, dp, status, self%ham%counters)
         else
            call self%newton%update(dp, status, self%ham%counters)
         end if
      end do
      dq = h*(p + dp)
      dp = 2*dp - self%kick
   end subroutine increment

   !> Residual X - g + (h/2) F and matrix I + (h^2/2) int_0^1 s V'' ds; without X and I for one unknown.
   subroutine linearise(self, h, tm, q, p, x)
      type(drift_preserving_stepper), intent(inout) :: self
      real(wp), intent(in) :: h, tm
      real(wp), intent(in), dimension(self%ham%nlane, self%ham%ndof) :: q, p, x
      integer :: j

      associate (newton => self%newton)
         newton%r = -self%kick
         if (allocated(newton%a)) newton%a = 0
         if (allocated(newton%bands)) newton%bands = 0
         do j = 1, size(self%node)
            self%qs = q + self%node(j)*h*(p + x)
            if (newton%options%fixed_point > 0) then
               call self%ham%gradient(tm, self%v, self%qs, p, hq=self%hq)
            else if (self%band == dense) then
               call self%ham%gradient_hessian(tm, self%v, self%qs, p, hq=self%hq, hqq=self%hqq)
               newton%a = newton%a + (0.5_wp*h*self%weight(j)*self%node(j))*self%hqq
            else
               call self%ham%gradient_hessian_banded(self%band, tm, self%v, self%qs, p, hq=self%hq, hqq=self%hqq)
               newton%bands = newton%bands + (0.5_wp*h*self%weight(j)*self%node(j))*self%hqq
            end if
            newton%r = newton%r + (0.5_wp*self%weight(j))*self%hq
         end do
         if (self%ham%ndof == 1) return
         newton%r = newton%r + x
         do j = 1, self%ham%ndof
            if (allocated(newton%a)) newton%a(:, j, j) = newton%a(:, j, j) + 1
            if (allocated(newton%bands)) newton%bands(:, 0, j) = newton%bands(:, 0, j) + 1
         end do
      end associate
   end subroutine linearise

end module symsde_step_drift_preserving
