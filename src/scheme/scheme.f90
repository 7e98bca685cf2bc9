! SPDX-License-Identifier: BSD-3-Clause
!> A scheme is data: nodes, weights, coefficients and declared traits. Steppers execute it.
!>
!> Tableau form (stochastic partitioned Runge-Kutta, schemes with as many quadrature nodes as degrees):
!>
!>    Q_i = q_n + sum_j (a_ij h H_p + sum_k b_ij dW_k H_{k,p})(P_j,Q_j),   t_j = t_n + c_j h
!>    P_i = p_n - sum_j (abar_ij h H_q + sum_k bbar_ij dW_k H_{k,q})(P_j,Q_j)
!>    q_{n+1} = q_n + sum_i (alpha_i h H_p + sum_k beta_i dW_k H_{k,p})(P_i,Q_i)
!>    p_{n+1} = p_n - sum_i (alpha_i h H_q + sum_k beta_i dW_k H_{k,q})(P_i,Q_i)
!>
!> Galerkin form (polynomial of degree s through control points q^0 .. q^s, nodes c_i, weights alpha_i):
!>
!>    L_h(q_n,q_{n+1}) = ext sum_i alpha_i [P_i . q_d'(c_i) - h H(P_i,q_d(c_i))] - sum_i beta_i sum_k dW_k H_k
!>
!> Splitting form (drifts and kicks for noise in position): scheme/kicks
!>
!> Ito form (Euler-Maruyama, for comparison): x_{n+1} = x_n + h f(x_n) + sum_k dW_k J grad H_k(x_n) with the drift f
!> of the Ito equation
!>
!> In every form all stages share the increments dW_k of the step: h and dW_k are weights of the Hamiltonians, and a map
!> that is symplectic for every h is symplectic for every path. `asks` has the functionals that a scheme uses beside dW,
!> `brackets` the terms it adds to Hhat, `needs` its conditions on the model.
module symsde_scheme_scheme
   use symsde_base_kinds, only: wp
   use symsde_base_functionals, only: functional_set
   use symsde_base_laws, only: law_gaussian
   use symsde_scheme_orders, only: order_type, norder, evidence_derived
   use symsde_scheme_kicks, only: kicks_type
   implicit none
   private
   public :: scheme_type, bracket_terms
   public :: tableau_form, galerkin_form, ito_form, splitting_form
   public :: correction_auto, correction_none, correction_mean, correction_increments
   public :: frame_none, frame_shift, frame_mean_path, frame_rotation
   public :: model_needs
   public :: symplectic_conjugate, symplecticity_residual, tidy

   enum, bind(c)
      enumerator :: tableau_form = 1   !! executed from a, abar, alpha (b, bbar, beta)
      enumerator :: galerkin_form = 2  !! executed from basis values and slopes
      enumerator :: ito_form = 3       !! Euler-Maruyama, the contrast that steps the Ito form
      enumerator :: splitting_form = 4 !! executed from kicks
   end enum
   enum, bind(c)
      ! Terms added to Hhat so that a scheme with beta^T b e = lambda /= 1/2 approximates the Stratonovich equation.
      enumerator :: correction_auto = 0        !! increments form, or none where the traits prove it vanishes
      enumerator :: correction_none = 1
      enumerator :: correction_mean = 2        !! (1/2-lambda) |h| sum_k H_{k,p}.H_{k,q}
      enumerator :: correction_increments = 3  !! (1/2-lambda) F_p.F_q with F = sum_k dW_k H_k
   end enum

   ! frame around the tableau's step, in schemes for one kind of noise alone (scheme/additive)
   enum, bind(c)
      enumerator :: frame_none = 0      !! the tableau is the whole step
      enumerator :: frame_shift = 1     !! a shift of q by dZ - h dW/2 comes last
      enumerator :: frame_mean_path = 2 !! positions and momenta relative to the mean of the path, which dZ gives
      enumerator :: frame_rotation = 3  !! the noise comes first, then drifts that are rotations
   end enum

   !> Traits that a model must declare; each component has the name of a trait.
   type :: model_needs
      logical :: additive = .false.
      logical :: position_noise = .false.
      logical :: additive_will_do = .false.   !! instead of position_noise, where drift and noise share coefficients
      logical :: identity_mass = .false.
      logical :: constant_mass = .false.      !! met by identity_mass, too
      logical :: quadratic_will_do = .false.  !! instead of constant_mass: a declared quadratic part
      logical :: actions_will_do = .false.    !! instead of position_noise, kicks by functions of the actions
      logical :: parts_will_do = .false.      !! instead of all needs, exact flows of a drift and of commuting kicks
      logical :: phases_will_do = .false.     !! the same where noises are linear in the actions
      logical :: rotation = .false.           !! frequencies of the linear part of H
      character(:), allocatable :: why        !! reason of the needs, for messages
      character(:), allocatable :: instead    !! scheme for models that do not meet the needs
   end type model_needs

   !> Brackets added to the one-step Hamiltonian (step/hamiltonian/brackets), for orders beyond one.
   type :: bracket_terms
      logical :: single = .false.  !! sum_k (h dW_k/2 - dZ_k) {H_k,H}
      logical :: areas = .false.   !! sum_{k<l} A_kl {H_l,H_k}
      logical :: nested = .false.  !! (h^2/12) sum_k {{H,H_k},H_k}
      logical :: crossed = .false. !! beside nested brackets, also (h/12) sum_kl dW_l {{H_l,H_k},H_k}
   contains
      procedure :: are_added
   end type bracket_terms

   type :: scheme_type
      character(:), allocatable :: name       !! name in the catalogue, or the user's
      character(:), allocatable :: reference  !! source in the literature
      integer :: form = tableau_form
      integer :: nstage = 0                   !! r: stages, quadrature nodes
      real(wp), allocatable :: c(:)           !! nodes in [0,1], one time per stage (nstage)
      real(wp), allocatable :: alpha(:)       !! weights of the drift (nstage)
      real(wp), allocatable :: beta(:)        !! weights of the noise (nstage)
      real(wp), allocatable :: a(:, :), abar(:, :)  !! drift coefficients of Q and P (nstage, nstage)
      real(wp), allocatable :: b(:, :), bbar(:, :)  !! noise coefficients of Q and P (nstage, nstage)
      integer :: degree = 0                   !! s: degree of the polynomial; 0 = not from a polynomial
      real(wp), allocatable :: basis(:, :)    !! l_mu(c_i), Galerkin form only (nstage, 0:degree)
      real(wp), allocatable :: slope(:, :)    !! l_mu'(c_i), Galerkin form only (nstage, 0:degree)
      type(kicks_type) :: kicks               !! kicks of the splitting form, and of the frame with a rotation
      type(functional_set) :: asks            !! functionals of the path that a step needs beside dW
      type(bracket_terms) :: brackets         !! added to the one-step Hamiltonian
      integer :: frame = frame_none           !! frame around the tableau's step
      type(model_needs) :: needs              !! conditions on the model
      character(:), allocatable :: remark     !! more facts on the scheme, for its certificate
      integer :: law = law_gaussian           !! law of the increments that a run draws (base/laws)
      logical :: symplectic = .false.
      logical :: symmetric = .false.          !! equal to its adjoint
      logical :: keeps_quadratic = .false.    !! quadratic invariants are preserved exactly
      integer :: structure = evidence_derived !! evidence of symmetric and keeps_quadratic
      type(order_type) :: order(norder)       !! orders by class of noise, each with its evidence
      integer :: order_noise_free = 0         !! order without noise
      real(wp) :: damped_order(2) = 0         !! measured strong orders with one rate of damping, of additive noise
                                              !! and of noise in position; 0 = not measured
      logical :: sharp = .false.              !! the order for commutative noise is not exceeded on generic problems
   contains
      procedure :: has_tableau
      procedure :: noise_coefficients_equal
      procedure :: correction_coefficient
      procedure :: is_midpoint
      procedure :: is_euler_pair
   end type scheme_type

contains

   !> Whether the scheme has the coefficients a, abar, b, bbar.
   pure logical function has_tableau(self)
      class(scheme_type), intent(in) :: self

      has_tableau = self%form == tableau_form .or. self%form == ito_form
   end function has_tableau

   !> Whether drift and noise share all coefficients, so that one gradient a stage serves both.
   pure function noise_coefficients_equal(self) result(equal)
      class(scheme_type), intent(in) :: self
      logical :: equal

      equal = .not. any(abs(self%alpha - self%beta) > 0)
      if (equal .and. self%form == tableau_form) &
         equal = .not. (any(abs(self%a - self%b) > 0) .or. any(abs(self%abar - self%bbar) > 0))
   end function noise_coefficients_equal

   !> Whether any bracket is added to the one-step Hamiltonian; crossed brackets come only with nested ones.
   pure logical function are_added(self)
      class(bracket_terms), intent(in) :: self

      are_added = self%single .or. self%areas .or. self%nested
   end function are_added

   !> Whether this is the midpoint rule: one stage in the middle of q and p, for drift and noise alike.
   pure logical function is_midpoint(self)
      class(scheme_type), intent(in) :: self

      is_midpoint = .false.
      if (self%form /= tableau_form .or. self%frame /= frame_none .or. self%nstage /= 1) return
      if (.not. self%noise_coefficients_equal()) return
      ! Compared exactly, since these numbers are exact in binary.
      is_midpoint = abs(self%a(1, 1) - 0.5_wp) <= 0 .and. abs(self%abar(1, 1) - 0.5_wp) <= 0 .and. &
                    abs(self%alpha(1) - 1) <= 0 .and. abs(self%c(1) - 0.5_wp) <= 0
   end function is_midpoint

   !> Whether this is symplectic Euler or its adjoint: one stage, lambda = 0 or 1, drift and noise alike. Then a =
   !> 0, abar = 1 or a = 1, abar = 0, with alpha = 1 and the node c = a. The general stepper executes schemes with
   !> another node.
   pure logical function is_euler_pair(self)
      class(scheme_type), intent(in) :: self

      is_euler_pair = .false.
      if (self%form /= tableau_form .or. self%nstage /= 1) return
      if (.not. self%noise_coefficients_equal() .or. abs(self%alpha(1) - 1) > 0) return
      if (abs(self%c(1) - self%a(1, 1)) > 0) return  ! a user's own stage time
      is_euler_pair = (abs(self%a(1, 1)) <= 0 .and. abs(self%abar(1, 1) - 1) <= 0) .or. &
                      (abs(self%a(1, 1) - 1) <= 0 .and. abs(self%abar(1, 1)) <= 0)
   end function is_euler_pair

   !> 1/2 - sum_ij beta_i b_ij: the factor of the correction that makes the scheme consistent with the
   !> Stratonovich equation. Zero for the midpoint, 1/2 - lambda for the one-sided family.
   pure function correction_coefficient(self) result(coefficient)
      class(scheme_type), intent(in) :: self
      real(wp) :: coefficient

      coefficient = 0
      if (self%form == tableau_form) coefficient = 0.5_wp - dot_product(self%beta, sum(self%b, dim=2))
      ! Zero means that no correction is formed, which would cost a Hessian: rounding must not hide a zero.
      if (abs(coefficient) < 16*epsilon(1.0_wp)) coefficient = 0
   end function correction_coefficient

   !> The partner abar_ij = alpha_j - alpha_j a_ji/alpha_i that makes (a, abar, alpha) symplectic.
   pure function symplectic_conjugate(a, alpha) result(abar)
      real(wp), intent(in) :: a(:, :)    !! (nstage, nstage)
      real(wp), intent(in) :: alpha(:)   !! all nonzero (nstage)
      real(wp) :: abar(size(alpha), size(alpha))
      integer :: i, j

      do j = 1, size(alpha)
         do i = 1, size(alpha)
            !   from alpha_i abar_ij + alpha_j a_ji = alpha_i alpha_j
            abar(i, j) = alpha(j) - alpha(j)*a(j, i)/alpha(i)
         end do
      end do
   end function symplectic_conjugate

   !> Round coefficients within rounding of zero to zero, so that explicit schemes are recognised.
   elemental real(wp) function tidy(x)
      real(wp), intent(in) :: x

      tidy = merge(0.0_wp, x, abs(x) < 8*epsilon(1.0_wp))
   end function tidy

   !> Largest residual of the four symplecticity conditions of a stochastic partitioned tableau
   !> (Ma-Ding; Holm-Tyranowski): alpha_i abar_ij + alpha_j a_ji = alpha_i alpha_j, and the three with noise.
   pure function symplecticity_residual(scheme) result(residual)
      type(scheme_type), intent(in) :: scheme  !! a scheme in tableau form
      real(wp) :: residual

      associate (s => scheme)
         !   (alpha, abar, alpha, a),  (beta, abar, alpha, b),  (alpha, bbar, beta, a),  (beta, bbar, beta, b)
         residual = max(condition(s%alpha, s%abar, s%alpha, s%a), condition(s%beta, s%abar, s%alpha, s%b), &
                        condition(s%alpha, s%bbar, s%beta, s%a), condition(s%beta, s%bbar, s%beta, s%b))
      end associate
   end function symplecticity_residual

   !> max_ij |x_i xbar_ij + y_j y2_ji - x_i y_j|
   pure function condition(x, xbar, y, y2) result(residual)
      real(wp), intent(in) :: x(:), xbar(:, :), y(:), y2(:, :)
      real(wp) :: residual
      integer :: i, j

      residual = 0
      do j = 1, size(x)
         do i = 1, size(x)
            residual = max(residual, abs(x(i)*xbar(i, j) + y(j)*y2(j, i) - x(i)*y(j)))
         end do
      end do
   end function condition

end module symsde_scheme_scheme
