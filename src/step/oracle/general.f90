! SPDX-License-Identifier: BSD-3-Clause
!> The general stepper, called oracle: any partitioned Runge-Kutta tableau, by Newton on all its stages.
!>
!> Unknowns are the slopes of the stages, F_i = Hhat_p and G_i = -Hhat_q at (Q_i, P_i):
!>
!>    F_i - Hhat_p(Q_i,P_i) = 0,   Q_i = q_n + sum_j a_ij F_j        dq = sum_i alpha_i F_i
!>    G_i + Hhat_q(Q_i,P_i) = 0,   P_i = p_n + sum_j abar_ij G_j     dp = sum_i alpha_i G_i
!>
!> An iteration computes the points of all stages, residual and matrix, and Newton's correction; after the last one dq
!> and dp are summed. If noise and drift have different coefficients, each of the two parts has its own slopes,
!>
!>    F_i^0 = h H_p,   F_i^1 = sum_k dW_k H_{k,p},   Q_i = q_n + sum_j (a_ij F_j^0 + b_ij F_j^1),
!>
!> and correspondingly for G, abar and bbar, alpha and beta.
!>
!> Damping (scheme/decays) multiplies p_n and the slopes G_j in P_i and p_{n+1} by factors; without damping they are
!> one.
!>
!> The unknowns are slopes instead of stage points, because slopes are increments of the step: their rounding is
!> relative to it, and dq and dp are sums of them. The block of Newton's matrix for the rows of stage i and the columns
!> of stage j is
!>
!>    delta_ij I + ( -a_ij Hhat_pq   -abar_ij Hhat_pp )      rows F_i
!>                 (  a_ij Hhat_qq    abar_ij Hhat_qp )      rows G_i       Hessian at (Q_i, P_i)
!>
!> with (Hhat_qp)_kl the derivative with respect to q_k and p_l, and Hhat_pq its transpose; for forces Fhat_q is
!> subtracted from Hhat_qq, and Fhat_p from Hhat_qp in the rows G_i. The matrix is dense and uses no structure of the
!> model or the tableau: the special steppers are tested against it, and step/implicit/rescue uses it for lanes that
!> they cannot solve.
module symsde_step_oracle_general
   use symsde_base_damping, only: damping_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_status, only: not_converged
   use symsde_model_abstract, only: model_type
   use symsde_scheme_decays, only: tableau_decays, new_decays
   use symsde_scheme_scheme, only: scheme_type
   use symsde_solve_newton, only: newton_type, newton_options, new_newton
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: general_stepper, new_general_stepper
   public :: split_weights, stage_point, linearise_all, look_back, first

   !> Slopes are ordered x(:, 1:n) = F of stage 1 and part 1, x(:, n+1:2n) = G of the same, and so on. The coefficients
   !> of part 1 and 2 are consecutive in the last index of a, abar and alpha.
   type, extends(stepper_type) :: general_stepper
      type(newton_type) :: newton
      integer :: nstage = 0, npart = 1         !! one part, or two: drift and noise
      real(wp), allocatable :: c(:)            !! nodes (nstage)
      real(wp), allocatable :: a(:, :, :), abar(:, :, :), alpha(:, :) !! (.., npart)
      type(tableau_decays) :: decays           !! decays of the momenta in this step
      real(wp), allocatable :: v(:, :, :)      !! weights of each part (nlane, 0:nnoise, npart)
      real(wp), allocatable, public :: x(:, :) !! slopes (nlane, 2 ndof nstage npart)
      real(wp), allocatable :: qs(:, :), ps(:, :)               !! vectors of one stage (nlane, ndof)
      real(wp), allocatable :: hqq(:, :, :), hqp(:, :, :), hpp(:, :, :)
   contains
      procedure :: make
      procedure :: increment
      procedure :: solve_stages
      procedure :: add_up
   end type general_stepper

contains

   !> Make the stepper of a task, with the scheme's brackets and the correction of the task.
   subroutine make(self, task)
      class(general_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      call new_general_stepper(self, task%model, task%scheme, task%correction, task%nlane, task%newton, &
                               task%damping)
      if (task%damping%acts()) self%name = 'general, damped'
      ! Linear equations with an exact matrix take one solve, which a run's report mentions.
      self%one_solve = self%newton%affine
   end subroutine make

   !> Make a general stepper for blocks of nlane lanes. The rescue makes one with the coefficients of another stepper's
   !> task.
   subroutine new_general_stepper(self, model, scheme, correction, nlane, options, damping, diagonals)
      class(general_stepper), intent(out) :: self
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme   !! a scheme in tableau form
      integer, intent(in) :: correction         !! resolved: never correction_auto
      integer, intent(in) :: nlane
      type(newton_options), intent(in) :: options
      type(damping_type), intent(in) :: damping
      integer, intent(in), optional :: diagonals  !! on either side, of a matrix with bands, which the caller fills
      integer :: n, nstage, side

      side = -1
      if (present(diagonals)) side = diagonals
      n = model%traits%ndof
      nstage = scheme%nstage
      self%name = 'general'
      self%most_single = 2
      self%nstage = nstage
      ! Drift and noise are two parts only if a coefficient differs between them, since separate slopes double the
      ! unknowns.
      self%npart = merge(1, 2, scheme%noise_coefficients_equal() .or. model%traits%nnoise == 0)
      self%c = scheme%c
      call new_decays(self%decays, damping, scheme%c, n)
      allocate (self%a(nstage, nstage, self%npart), self%abar(nstage, nstage, self%npart))
      allocate (self%alpha(nstage, self%npart))
      ! Part 1 has the coefficients of the drift, or of drift and noise together; part 2 the coefficients of the
      ! noise.
      self%a(:, :, 1) = scheme%a
      self%abar(:, :, 1) = scheme%abar
      self%alpha(:, 1) = scheme%alpha
      if (self%npart == 2) then
         self%a(:, :, 2) = scheme%b
         self%abar(:, :, 2) = scheme%bbar
         self%alpha(:, 2) = scheme%beta
      end if
      call new_one_step_hamiltonian(self%ham, model, nlane, correction, scheme%correction_coefficient(), &
                                    scheme%brackets)
      call new_newton(self%newton, nlane, 2*n*nstage*self%npart, options, &
                      model%traits%one_solve(.false.) .and. &
                      .not. allocated(self%ham%modified), side, side)
      ! Newton's iteration has arrays for residual and matrix; here the arrays of weights, slopes, and vectors of one
      ! stage are allocated.
      allocate (self%v(nlane, 0:model%traits%nnoise, self%npart))
      allocate (self%x(nlane, 2*n*nstage*self%npart), self%qs(nlane, n), self%ps(nlane, n))
      if (side < 0) allocate (self%hqq(nlane, n, n), self%hqp(nlane, n, n), self%hpp(nlane, n, n))
   end subroutine new_general_stepper

   !> dq and dp (nlane, ndof), by Newton's iteration from slopes of zero. In lanes that fail they are sums of
   !> unfinished slopes, which are not used.
   subroutine increment(self, step, q, p, dq, dp, status)
      class(general_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)

      self%x = 0
      call self%solve_stages(step, q, p, status)
      call self%add_up(p, dq, dp)
   end subroutine increment

   !> Newton for the slopes, starting with the slopes in x: zero, or the result of a continuation with smaller
   !> weights. step%h places the nodes, whatever the weights are, so that a fraction of the increments leaves the
   !> times unchanged.
   subroutine solve_stages(self, step, q, p, status)
      class(general_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      real(wp) :: near(self%ham%nlane)
      logical :: begun

      ! Each part is evaluated with its own weights.
      call split_weights(self, step%w)
      call self%decays%set_step(step%h)
      call self%newton%start(status)
      begun = .false.
      near = 0
      do while (self%newton%running)
         call linearise_all(self, step, q, p)
         ! The initial size of the slopes: of the residual, which is (-Hhat_p, Hhat_q) at x = 0, or of x.
         if (.not. begun) near = max(maxval(abs(self%newton%r), dim=2), maxval(abs(self%x), dim=2))
         begun = .true.
         call self%newton%update(self%x, status, self%ham%counters)
      end do
      call look_back(self, step, q, p, near, status)
   end subroutine solve_stages

   !> Residuals and matrix at the slopes x, for all stages, in newton%r and newton%a. Each stage is evaluated once for
   !> each part, and fills its rows of the matrix in all columns: with two parts, Q_i and P_i depend on the slopes of
   !> both.
   subroutine linearise_all(self, step, q, p)
      class(general_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      integer :: i, part

      if (allocated(self%newton%a)) self%newton%a = 0
      do i = 1, self%nstage
         call stage_point(self, i, q, p)
         do part = 1, self%npart
            call linearise(self, i, part, step)
         end do
      end do
   end subroutine linearise_all

   !> Newton's iteration ends when corrections are small relative to the largest slope. If it diverged temporarily, one
   !> slope may exceed the others by so many powers of ten (q^3 for q = 1e31) that the equations of the others are not
   !> solved. So lanes whose slopes have grown far beyond their initial size are tested again: every slope of every
   !> stage separately.
   subroutine look_back(self, step, q, p, near, status)
      class(general_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(in) :: near(self%ham%nlane)   !! largest slope at the beginning
      integer(i8), intent(inout) :: status(self%ham%nlane)
      real(wp), parameter :: far = 1e6_wp, solved = 1e-6_wp
      logical :: grown(self%ham%nlane)
      real(wp) :: largest
      integer :: lane, at

      ! One solve of linear equations cannot diverge, and a given number of iterations need not converge.
      if (self%newton%affine .or. self%newton%options%fixed_point > 0) return
      ! Find converged lanes with slopes beyond a million times the slopes at the beginning.
      grown = status == 0 .and. maxval(abs(self%x), dim=2) > far*near
      if (.not. any(grown)) return
      call linearise_all(self, step, q, p)
      associate (n => self%ham%ndof, x => self%x, r => self%newton%r)
         do lane = 1, self%ham%nlane
            if (.not. grown(lane)) cycle
            do at = 1, size(x, 2), n
               ! Compare the residual of each slope vector with its size, or with the initial size.
               largest = max(near(lane), maxval(abs(x(lane, at:at + n - 1))))
               if (all(abs(r(lane, at:at + n - 1)) <= solved*largest)) cycle
               status(lane) = not_converged
               self%ham%counters%failures = self%ham%counters%failures + 1
               exit
            end do
         end do
      end associate
   end subroutine look_back

   !> dq = sum_i alpha_i F_i, dp = sum_i alpha_i G_i; with damping, dp = (exp(-z) - 1) p_n + sum_i alpha_i exp(-(1-c_i)
   !> z) G_i.
   subroutine add_up(self, p, dq, dp)
      class(general_stepper), intent(in) :: self
      real(wp), intent(in) :: p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer :: i, k, part, at

      dq = 0
      do k = 1, self%ham%ndof
         dp(:, k) = self%decays%loss(k)*p(:, k)
      end do
      associate (n => self%ham%ndof)
         do part = 1, self%npart
            do i = 1, self%nstage
               at = first(self, i, part)
               dq = dq + self%alpha(i, part)*self%x(:, at:at + n - 1)
               do k = 1, n
                  dp(:, k) = dp(:, k) + self%alpha(i, part)*self%decays%finish(i, k)*self%x(:, at + n + k - 1)
               end do
            end do
         end do
      end associate
   end subroutine add_up

   !> The first column of the slopes of stage i and a part: F has ndof columns from there, and G the next ndof.
   pure integer function first(self, i, part)
      class(general_stepper), intent(in) :: self
      integer, intent(in) :: i, part

      first = 2*self%ham%ndof*((part - 1)*self%nstage + i - 1) + 1
   end function first

   !> Set the weights of the one-step Hamiltonian for each part. A single part has all weights; of two, the first has
   !> (h, 0, .., 0) and the second (0, dW_1, .., dW_m).
   subroutine split_weights(self, w)
      class(general_stepper), intent(inout) :: self
      real(wp), intent(in) :: w(self%ham%nlane, 0:self%ham%nnoise)

      self%v(:, :, 1) = w
      if (self%npart == 2) then
         self%v(:, 1:, 1) = 0
         self%v(:, :, 2) = w
         self%v(:, 0, 2) = 0
      end if
   end subroutine split_weights

   !> Q_i = q_n + sum_j a_ij F_j and P_i = p_n + sum_j abar_ij G_j, over both parts if there are two, in qs and ps.
   subroutine stage_point(self, i, q, p)
      class(general_stepper), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      integer :: j, k, part, at

      associate (n => self%ham%ndof, decays => self%decays)
         ! The sums begin with q_n and p_n, and include slopes with a zero coefficient: the oracle omits nothing.
         self%qs = q
         do k = 1, n
            self%ps(:, k) = decays%begin(i, k)*p(:, k)
         end do
         do part = 1, self%npart
            do j = 1, self%nstage
               at = first(self, j, part)
               self%qs = self%qs + self%a(i, j, part)*self%x(:, at:at + n - 1)
               do k = 1, n
                  self%ps(:, k) = self%ps(:, k) + self%abar(i, j, part)*decays%between(i, j, k) &
                                  *self%x(:, at + n + k - 1)
               end do
            end do
         end do
      end associate
   end subroutine stage_point

   !> Rows of residual and matrix of stage i and one part: F_i - Hhat_p and G_i + Hhat_q with the weights of this part.
   !> Gradients are stored in r, and the slopes are then combined with them.
   subroutine linearise(self, i, part, step)
      class(general_stepper), intent(inout) :: self
      integer, intent(in) :: i, part
      type(step_record), intent(in) :: step
      real(wp) :: t
      integer :: n, at, k

      ! All derivatives of a stage are evaluated at the same time.
      t = step%t + self%c(i)*step%h
      n = self%ham%ndof
      at = first(self, i, part)
      associate (r => self%newton%r, hp => at, hq => at + n)
         ! A given number of fixed-point iterations has no matrix and needs only the gradient.
         if (.not. allocated(self%newton%a)) then
            call self%ham%gradient(t, self%v(:, :, part), self%qs, self%ps, &
                                   hq=r(:, hq:hq + n - 1), hp=r(:, hp:hp + n - 1), step=step)
         else
            call self%ham%gradient_hessian(t, self%v(:, :, part), self%qs, self%ps, &
                                           hq=r(:, hq:hq + n - 1), hp=r(:, hp:hp + n - 1), &
                                           hqq=self%hqq, hqp=self%hqp, hpp=self%hpp, step=step)
            call matrix_rows(self, i, at)
         end if
         ! r is the gradient and becomes the residual.
         do k = 0, n - 1
            r(:, hp + k) = self%x(:, hp + k) - r(:, hp + k)
            r(:, hq + k) = self%x(:, hq + k) + r(:, hq + k)
         end do
      end associate
   end subroutine linearise

   !> Rows from `at` to at+2n-1 of the matrix, from the Hessian at stage i: n rows of F_i, then n of G_i, in the columns
   !> of all stages and parts, and I on the diagonal. hqp(:, l, k) is entry (k, l) of Hhat_pq.
   subroutine matrix_rows(self, i, at)
      class(general_stepper), intent(inout) :: self
      integer, intent(in) :: i, at
      real(wp) :: abar(self%ham%ndof)   !! abar_ij, with the decay of each degree of freedom
      integer :: n, j, part, to, k, l

      n = self%ham%ndof
      associate (m => self%newton%a)
         do part = 1, self%npart
            do j = 1, self%nstage
               to = first(self, j, part)
               abar = self%abar(i, j, part)*self%decays%between(i, j, :)
               ! Entry (k, l) of each of the four blocks in the header.
               do l = 0, n - 1
                  do k = 0, n - 1
                     m(:, at + k, to + l) = -self%a(i, j, part)*self%hqp(:, l + 1, k + 1)
                     m(:, at + k, to + n + l) = -abar(l + 1)*self%hpp(:, k + 1, l + 1)
                     m(:, at + n + k, to + l) = self%a(i, j, part)*self%hqq(:, k + 1, l + 1)
                     m(:, at + n + k, to + n + l) = abar(l + 1)*self%hqp(:, k + 1, l + 1)
                     if (self%ham%forced) m(:, at + n + k, to + n + l) = m(:, at + n + k, to + n + l) &
                                                                         - abar(l + 1)*self%ham%drag(:, k + 1, l + 1)
                  end do
               end do
            end do
         end do
         do k = at, at + 2*n - 1
            ! The diagonal: F_i and G_i occur in their equations with factor one.
            m(:, k, k) = m(:, k, k) + 1
         end do
      end associate
   end subroutine matrix_rows

end module symsde_step_oracle_general
