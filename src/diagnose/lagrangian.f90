! SPDX-License-Identifier: BSD-3-Clause
!> The discrete Lagrangian Lbar_h(p_n, q_n, p_{n+1}, q_{n+1}) of a scheme [WHSB] (49), its value
!> and its gradient, on and off the solutions of the scheme. Hhat is the one-step Hamiltonian.
!>
!> One stage, as the paper writes it in (61)-(62), (77)-(78), (88), with lambda = a_11:
!>
!>    Lbar_h = P.(q_{n+1} - q_n) - Hhat(P,Q),
!>    P = lambda p_n + (1-lambda) p_{n+1},   Q = (1-lambda) q_n + lambda q_{n+1}
!>
!> More stages, with free internal slopes V_i and momenta P_i (Hamilton-Pontryagin principle) and p_{n+1} as the
!> multiplier of q_{n+1} = q_n + sum_i alpha_i V_i:
!>
!>    Lbar_h = p_{n+1}.(q_{n+1} - q_n)
!>             + ext_{V,P} sum_i alpha_i [(P_i - p_{n+1}).V_i - Hhat(P_i,Q_i)],
!>    Q_i = q_n + sum_j a_ij V_j
!>
!> The expression is stationary in P_i and in V_j if
!>
!>    alpha_i (V_i - Hhat_p(P_i,Q_i)) = 0,     alpha_j (P_j - p_{n+1}) - sum_i alpha_i a_ij Hhat_q(P_i,Q_i) = 0
!>
!> so V_i = Hhat_p(P_i,Q_i) and P_i = p_{n+1} + sum_j (alpha_j a_ji/alpha_i) Hhat_q(P_j,Q_j), solved
!> here by Newton. (57) then holds identically and (58) is the constraint. Lbar_h is not a function of q_n, q_{n+1}
!> alone: such a function does not exist if Hhat_pp is singular, as for the Kubo oscillator at a h + sigma dW = 0. Only
!> a, alpha and c of the scheme enter, never abar: a wrong abar, or a wrong sign in a stepper, shows in the Legendre
!> transforms. If noise has its own coefficients (b, beta), drift and noise have separate stages with the Hamiltonians h
!> H and sum_k dW_k H_k.
!>
!> With (53), p_n = -dLbar_h/dq_n = p_{n+1} + sum_j alpha_j Hhat_q(P_j,Q_j), the momenta are those of the tableau:
!>
!>    P_i = p_n - sum_j abar_ij Hhat_q(P_j,Q_j),      abar_ij = alpha_j - alpha_j a_ji/alpha_i
!>
!> so that the symplectic conjugate of a is a result and no input, and (53) fails for a scheme with another abar.
!>
!> Where forces act (model/forces) the derivatives are those of Lbar_h and the work of Fhat, by the discrete
!> Lagrange-d'Alembert principle: Hhat_q - Fhat stands in the place of Hhat_q, at the same points. Then (47)-(48) and
!> the Legendre transforms hold along the solutions. The value is that of Lbar_h alone.
module symsde_diagnose_lagrangian
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lanes_for
   use symsde_base_status, only: error_type, raise, incompatible
   use symsde_ensemble_options, only: run_options
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type, tableau_form, correction_none, correction_mean
   use symsde_solve_newton, only: newton_type, newton_options, new_newton
   use symsde_step_task, only: resolve_correction
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian, new_one_step_hamiltonian
   implicit none
   private
   public :: discrete_lagrangian, lagrangian_gradient, new_discrete_lagrangian, lanes_of_diagnosis, lagrangian_numbers

   !> Partial derivatives of Lbar_h: with respect to q_n, p_n (left) and q_{n+1}, p_{n+1} (right).
   type :: lagrangian_gradient
      real(wp), allocatable, dimension(:, :) :: left_q, left_p, right_q, right_p  !! (nlane, ndof)
   end type lagrangian_gradient

   !> Slopes are ordered x(:, 1:n) = V_1, x(:, n+1:2n) = Hhat_q at stage 1, and so on.
   type :: discrete_lagrangian
      private
      type(one_step_hamiltonian), public :: ham
      type(newton_type) :: newton
      logical :: one_stage = .false.
      integer, public :: nstage = 0                !! stages of drift and noise together
      integer, allocatable, public :: part(:)      !! 1: all of Hhat, or the drift part; 2: the noise part (nstage)
      real(wp), allocatable, public :: c(:), alpha(:)  !! (nstage)
      real(wp), allocatable, public :: a(:, :)     !! a_ij (nstage, nstage)
      real(wp), allocatable :: back(:, :)          !! alpha_j a_ji/alpha_i (nstage, nstage)
      real(wp), allocatable :: v(:, :, :)          !! weights of each part (nlane, 0:nnoise, 2)
      real(wp), allocatable :: x(:, :)             !! slopes (nlane, 2 ndof nstage)
      real(wp), allocatable :: qs(:, :), ps(:, :), hq(:, :), hp(:, :)  !! a point and its derivatives (nlane, ndof)
      real(wp), allocatable :: hqq(:, :, :), hqp(:, :, :), hpp(:, :, :)
   contains
      procedure, public :: gradient
      procedure, public :: value
   end type discrete_lagrangian

contains

   !> Number of unknowns of the internal stages of a path; the size of blocks depends on it.
   pure integer function count_unknowns(model, scheme) result(n)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme

      ! The unknowns are V_i and Hhat_q at stage i, in ndof degrees of freedom each.
      n = 2*model%traits%ndof*scheme%nstage
      if (.not. has_one_part(model, scheme)) n = 2*n
   end function count_unknowns

   !> Lanes of a block of a diagnosis. Their number falls with the square of the unknowns, since matrices are stored
   !> lane by lane and the calling program should not wait long for the end of a block.
   pure integer function lanes_of_diagnosis(model, scheme, npath) result(nlane)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme
      integer(i8), intent(in) :: npath   !! paths or points

      ! lanes_for is given unknowns^2/16 in place of degrees of freedom: a lane's cost grows with that square.
      nlane = lanes_for(int(min(real(count_unknowns(model, scheme), wp)**2/16 + 1, 1e6_wp)), npath)
   end function lanes_of_diagnosis

   !> Numbers of eight bytes that a discrete Lagrangian of nlane lanes holds at most.
   pure real(wp) function lagrangian_numbers(model, scheme, nlane) result(numbers)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme
      integer, intent(in) :: nlane
      real(wp) :: n, unknowns

      n = model%traits%ndof
      unknowns = count_unknowns(model, scheme)
      ! Newton's matrices of all lanes, Hessians, points and weights, and work arrays of the solver.
      numbers = nlane*(unknowns**2 + 9*n**2 + 80*n + 12*unknowns + 10*(model%traits%nnoise + 1)) + 2*unknowns**2
   end function lagrangian_numbers

   !> Make the discrete Lagrangian of a scheme for blocks of nlane lanes. Errors: incompatible for schemes without a
   !> discrete Lagrangian; errors of resolve_correction.
   subroutine new_discrete_lagrangian(self, model, scheme, options, nlane, error)
      type(discrete_lagrangian), intent(out) :: self
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      integer, intent(in) :: nlane
      type(error_type), allocatable, intent(inout) :: error
      type(newton_options) :: newton
      integer :: n, correction

      ! Refuse schemes without an action before anything is allocated.
      call check_scheme(scheme, error)
      call model%damping%refuse(model%name, 'new_discrete_lagrangian', 'the discrete action', error)
      call model%refuse_paths('new_discrete_lagrangian', 'the discrete action', error)
      call model%require_gradient('new_discrete_lagrangian', 'the discrete action', error)
      if (allocated(error)) return
      call resolve_correction(correction, model, scheme, options%correction, error)
      if (allocated(error)) return
      ! The following code uses only a, alpha and c.
      call flatten(self, scheme, has_one_part(model, scheme), error)
      if (allocated(error)) return
      ! Hhat includes the correction that the options ask for: this is the Lagrangian of the corrected scheme.
      call new_one_step_hamiltonian(self%ham, model, nlane, correction, &
                                    scheme%correction_coefficient())
      n = model%traits%ndof
      allocate (self%qs(nlane, n), self%ps(nlane, n), self%hq(nlane, n), self%hp(nlane, n))
      allocate (self%v(nlane, 0:model%traits%nnoise, 2))
      ! One stage needs no solver: P and Q are known from the end points.
      if (self%one_stage) return
      ! A quadratic Hhat makes the equations linear; one iteration then solves them.
      newton%max_iter = options%max_iter
      call new_newton(self%newton, nlane, 2*n*self%nstage, newton, &
                      model%traits%quadratic .and. correction == correction_none .and. .not. self%ham%forced, -1, -1)
      allocate (self%x(nlane, 2*n*self%nstage))
      allocate (self%hqq(nlane, n, n), self%hqp(nlane, n, n), self%hpp(nlane, n, n))
   end subroutine new_discrete_lagrangian

   !> Partial derivatives of Lbar_h; the arrays of d must be allocated.
   subroutine gradient(self, t, w, q0, p0, q1, p1, d, status)
      class(discrete_lagrangian), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%ham%nlane, 0:self%ham%nnoise)   !! t_n; h, dW_1 .. dW_m
      real(wp), intent(in), dimension(self%ham%nlane, self%ham%ndof) :: q0, p0, q1, p1
      type(lagrangian_gradient), intent(inout) :: d
      integer(i8), intent(inout) :: status(self%ham%nlane)   !! 0, or the reason why the stages were not solved
      integer :: i, at

      call split_weights(self, w)
      if (self%one_stage) then
         call one_point(self, q0, p0, q1, p1)
         call self%ham%gradient(t + self%c(1)*w(1, 0), self%v(:, :, 1), self%qs, self%ps, &
                                self%hq, self%hp)
         !   d/dq_n = -P - (1-lambda) Hhat_q,                 d/dq_{n+1} = P - lambda Hhat_q
         !   d/dp_n = lambda (q_{n+1} - q_n - Hhat_p),        d/dp_{n+1} = (1-lambda) (q_{n+1} - q_n - Hhat_p)
         d%left_q = -self%ps - (1 - self%a(1, 1))*self%hq
         d%right_q = self%ps - self%a(1, 1)*self%hq
         d%left_p = self%a(1, 1)*((q1 - q0) - self%hp)
         d%right_p = (1 - self%a(1, 1))*((q1 - q0) - self%hp)
         return
      end if
      call solve_stages(self, t, w(1, 0), q0, p1, status)
      ! By the envelope theorem only explicit occurrences of the end points are differentiated, since the internal
      ! variables are stationary.
      ! d/dq_n = -p_{n+1} - sum_i alpha_i Hhat_q,        d/dq_{n+1} = p_{n+1}
      ! d/dp_n = 0,                                      d/dp_{n+1} = q_{n+1} - q_n - sum_i alpha_i V_i
      d%left_q = -p1
      d%left_p = 0
      d%right_q = p1
      d%right_p = q1 - q0
      associate (n => self%ham%ndof)
         do i = 1, self%nstage
            at = 2*n*(i - 1)
            d%right_p = d%right_p - self%alpha(i)*self%x(:, at + 1:at + n)
            d%left_q = d%left_q - self%alpha(i)*self%x(:, at + n + 1:at + 2*n)
         end do
      end associate
   end subroutine gradient

   !> The value of Lbar_h; the model must have values.
   subroutine value(self, t, w, q0, p0, q1, p1, action, status)
      class(discrete_lagrangian), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%ham%nlane, 0:self%ham%nnoise)   !! t_n; h, dW_1 .. dW_m
      real(wp), intent(in), dimension(self%ham%nlane, self%ham%ndof) :: q0, p0, q1, p1
      real(wp), intent(out) :: action(self%ham%nlane)
      integer(i8), intent(inout) :: status(self%ham%nlane)   !! 0, or the reason why the stages were not solved
      real(wp) :: h(self%ham%nlane)
      integer :: i, at

      call split_weights(self, w)
      if (self%one_stage) then
         call one_point(self, q0, p0, q1, p1)
         call hamiltonian_value(self, 1, t + self%c(1)*w(1, 0), h)
         action = sum(self%ps*(q1 - q0), dim=2) - h
         return
      end if
      call solve_stages(self, t, w(1, 0), q0, p1, status)
      !   p_{n+1}.(q_{n+1} - q_n) + sum_i alpha_i [(P_i - p_{n+1}).V_i - Hhat(P_i,Q_i)]
      action = sum(p1*(q1 - q0), dim=2)
      associate (n => self%ham%ndof)
         do i = 1, self%nstage
            at = 2*n*(i - 1)
            call stage_point(self, i, q0, p1)
            call hamiltonian_value(self, self%part(i), t + self%c(i)*w(1, 0), h)
            action = action &
                     + self%alpha(i)*(sum((self%ps - p1)*self%x(:, at + 1:at + n), dim=2) - h)
         end do
      end associate
   end subroutine value

   !> Whether drift and noise share all coefficients, or there is no noise.
   pure logical function has_one_part(model, scheme)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme

      has_one_part = model%traits%nnoise == 0
      if (.not. has_one_part) has_one_part = scheme%noise_coefficients_equal()
   end function has_one_part

   !> Refuse schemes without a discrete Lagrangian of the Hamiltonians themselves.
   subroutine check_scheme(scheme, error)
      type(scheme_type), intent(in) :: scheme
      type(error_type), allocatable, intent(inout) :: error

      if (.not. scheme%symplectic) then
         call raise(error, incompatible, 'new_discrete_lagrangian', 'scheme '//scheme%name// &
                    ' is not symplectic and comes from no discrete Lagrangian: it has no '// &
                    'discrete action; take a symplectic scheme such as midpoint')
      else if (scheme%form /= tableau_form) then
         call raise(error, incompatible, 'new_discrete_lagrangian', 'scheme '//scheme%name// &
                    ' is in Galerkin form, for which the discrete action is not offered: '// &
                    'choose a scheme with as many nodes as its degree, such as midpoint or gauss2')
      else if (scheme%brackets%are_added() .or. .not. scheme%asks%is_empty()) then
         call raise(error, incompatible, 'new_discrete_lagrangian', 'scheme '//scheme%name// &
                    ' adds brackets or dZ to the increments, which the discrete action does not know: '// &
                    'take the plain scheme, such as midpoint or gauss2')
      end if
   end subroutine check_scheme

   !> Make one list of stages; if noise has its own coefficients, its stages follow those of the drift. Stages with zero
   !> weight that no stage uses are left out.
   subroutine flatten(self, scheme, one_part, error)
      type(discrete_lagrangian), intent(inout) :: self
      type(scheme_type), intent(in) :: scheme
      logical, intent(in) :: one_part
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable :: alpha(:), a(:, :)
      integer :: keep(2*scheme%nstage), r, i

      r = scheme%nstage
      if (one_part) then
         alpha = scheme%alpha
         a = scheme%a
      else
         allocate (alpha(2*r), a(2*r, 2*r))
         alpha(:r) = scheme%alpha
         alpha(r + 1:) = scheme%beta
         ! Every stage, of drift or noise, sees the slopes of both: drift slopes by a, noise slopes by b.
         a(:r, :r) = scheme%a
         a(r + 1:, :r) = scheme%a
         a(:r, r + 1:) = scheme%b
         a(r + 1:, r + 1:) = scheme%b
      end if
      do i = 1, size(alpha)
         if (.not. (abs(alpha(i)) > 0 .or. any(abs(a(:, i)) > 0))) cycle
         self%nstage = self%nstage + 1
         keep(self%nstage) = i
      end do
      associate (k => keep(:self%nstage))
         self%alpha = alpha(k)
         self%a = a(k, k)
         self%part = (k - 1)/r + 1
         ! Stages of the noise have the same times as stages of the drift.
         k = mod(k - 1, r) + 1
         self%c = scheme%c(k)
      end associate
      if (any(abs(self%alpha) <= 0)) then
         call raise(error, incompatible, 'new_discrete_lagrangian', 'scheme '//scheme%name// &
                    ' uses a stage of weight zero, whose momentum no discrete Lagrangian '// &
                    'determines: take a scheme without such stages')
         return
      end if
      self%one_stage = one_part .and. self%nstage == 1
      allocate (self%back(self%nstage, self%nstage))
      do i = 1, self%nstage
         !   back_ij = alpha_j a_ji/alpha_i:  the momenta P_i = p_{n+1} + sum_j back_ij Hhat_q(P_j,Q_j)
         self%back(i, :) = self%alpha*self%a(:, i)/self%alpha(i)
      end do
   end subroutine flatten

   !> One part: all weights. Two parts: (h, 0, .., 0) and (0, dW_1, .., dW_m).
   subroutine split_weights(self, w)
      type(discrete_lagrangian), intent(inout) :: self
      real(wp), intent(in) :: w(self%ham%nlane, 0:self%ham%nnoise)

      self%v(:, :, 1) = w
      ! If noise has its own stages, drift stages use H alone, and noise stages H_k alone.
      if (all(self%part == 1)) return
      self%v(:, 1:, 1) = 0
      self%v(:, :, 2) = w
      self%v(:, 0, 2) = 0
   end subroutine split_weights

   !> The point (Q, P) of the one-stage form.
   subroutine one_point(self, q0, p0, q1, p1)
      type(discrete_lagrangian), intent(inout) :: self
      real(wp), intent(in), dimension(self%ham%nlane, self%ham%ndof) :: q0, p0, q1, p1

      associate (lambda => self%a(1, 1))
         ! lambda = 1/2 gives the midpoint of q and of p, as in (61)-(62); 0 and 1 give the Euler pair, as in (88).
         self%qs = (1 - lambda)*q0 + lambda*q1
         self%ps = lambda*p0 + (1 - lambda)*p1
      end associate
   end subroutine one_point

   !> Compute (Q_i, P_i) from the slopes.
   subroutine stage_point(self, i, q0, p1)
      type(discrete_lagrangian), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in), dimension(self%ham%nlane, self%ham%ndof) :: q0, p1
      integer :: j, at

      associate (n => self%ham%ndof)
         self%qs = q0
         self%ps = p1
         do j = 1, self%nstage
            at = 2*n*(j - 1)
            !   Q_i = q_n + sum_j a_ij V_j,   P_i = p_{n+1} + sum_j back_ij F_j
            self%qs = self%qs + self%a(i, j)*self%x(:, at + 1:at + n)
            self%ps = self%ps + self%back(i, j)*self%x(:, at + n + 1:at + 2*n)
         end do
      end associate
   end subroutine stage_point

   !> Solve for the slopes of all stages by Newton, given q_n and p_{n+1}.
   subroutine solve_stages(self, t, h, q0, p1, status)
      type(discrete_lagrangian), intent(inout) :: self
      real(wp), intent(in) :: t, h
      real(wp), intent(in), dimension(self%ham%nlane, self%ham%ndof) :: q0, p1
      integer(i8), intent(inout) :: status(self%ham%nlane)
      integer :: i, at

      ! Start with zero slopes, Q_i = q_n and P_i = p_{n+1}; their error has the size of a step.
      self%x = 0
      call self%newton%start(status)
      do while (self%newton%running)
         do i = 1, self%nstage
            call stage_point(self, i, q0, p1)
            call self%ham%gradient_hessian(t + self%c(i)*h, self%v(:, :, self%part(i)), &
                                           self%qs, self%ps, self%hq, self%hp, &
                                           self%hqq, self%hqp, self%hpp)
            associate (n => self%ham%ndof)
               at = 2*n*(i - 1)
               ! r = (V_i - Hhat_p(P_i,Q_i), F_i - Hhat_q(P_i,Q_i)),   F_i is the second slope
               self%newton%r(:, at + 1:at + n) = self%x(:, at + 1:at + n) - self%hp
               self%newton%r(:, at + n + 1:at + 2*n) = self%x(:, at + n + 1:at + 2*n) - self%hq
            end associate
            call matrix_rows(self, i)
         end do
         ! Take one Newton step in all lanes; lanes that have failed or are done do not change.
         call self%newton%update(self%x, status, self%ham%counters)
      end do
   end subroutine solve_stages

   !> Rows of stage i of the matrix, from the Hessian at the stage.
   subroutine matrix_rows(self, i)
      type(discrete_lagrangian), intent(inout) :: self
      integer, intent(in) :: i
      integer :: n, j, k, l, at, to

      n = self%ham%ndof
      at = 2*n*(i - 1)
      associate (m => self%newton%a)
         do j = 1, self%nstage
            to = 2*n*(j - 1)
            do l = 1, n
               do k = 1, n
                  ! dQ_i/dV_j = a_ij and dP_i/dF_j = back_ij. hqp(k, l) is the derivative in q_k and p_l: the indices
                  ! below are in that order.
                  m(:, at + k, to + l) = -self%a(i, j)*self%hqp(:, l, k)
                  m(:, at + k, to + n + l) = -self%back(i, j)*self%hpp(:, k, l)
                  m(:, at + n + k, to + l) = -self%a(i, j)*self%hqq(:, k, l)
                  m(:, at + n + k, to + n + l) = -self%back(i, j)*self%hqp(:, k, l)
                  if (self%ham%forced) m(:, at + n + k, to + n + l) = m(:, at + n + k, to + n + l) &
                                                                      + self%back(i, j)*self%ham%drag(:, k, l)
               end do
            end do
         end do
         do k = at + 1, at + 2*n
            ! V_i and F_i occur in their equations with the factor one.
            m(:, k, k) = m(:, k, k) + 1
         end do
      end associate
   end subroutine matrix_rows

   !> Value of a part of Hhat, correction included, at (qs, ps).
   subroutine hamiltonian_value(self, part, t, h)
      type(discrete_lagrangian), intent(inout) :: self
      integer, intent(in) :: part
      real(wp), intent(in) :: t
      real(wp), intent(out) :: h(self%ham%nlane)
      real(wp) :: noise(self%ham%nlane, 0:self%ham%nnoise), product(self%ham%nlane)
      integer :: k

      associate (ham => self%ham)
         !   h H + sum_k dW_k H_k, or one part of it
         call ham%model%value(ham%nlane, ham%ndof, ham%nnoise, t, self%v(:, :, part), self%qs, &
                              self%ps, h)
         if (ham%correction == correction_none) return
         ! Add the correction: coefficient h sum_k H_k,p.H_k,q in its mean form, or coefficient F_p.F_q with F =
         ! sum_k dW_k H_k.
         noise = 0
         if (ham%correction == correction_mean) then
            do k = 1, ham%nnoise
               noise(:, k) = 1
               call product_of_gradients(self, t, noise, product)
               noise(:, k) = 0
               h = h + ham%coefficient*self%v(:, 0, part)*product
            end do
         else
            noise(:, 1:) = self%v(:, 1:, part)
            call product_of_gradients(self, t, noise, product)
            h = h + ham%coefficient*product
         end if
      end associate
   end subroutine hamiltonian_value

   !> F_p.F_q at (qs, ps) for F = sum_j v_j H_j.
   subroutine product_of_gradients(self, t, v, product)
      type(discrete_lagrangian), intent(inout) :: self
      real(wp), intent(in) :: t, v(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(out) :: product(self%ham%nlane)

      associate (ham => self%ham)
         call ham%model%gradient(ham%nlane, ham%ndof, ham%nnoise, t, v, self%qs, self%ps, &
                                 self%hq, self%hp)
      end associate
      product = sum(self%hq*self%hp, dim=2)
   end subroutine product_of_gradients

end module symsde_diagnose_lagrangian
