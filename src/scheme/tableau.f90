! SPDX-License-Identifier: BSD-3-Clause
!>    Q_i = q_n + sum_j (a_ij h H_p + sum_k b_ij dW_k H_k,p)(P_j, Q_j),      weights alpha_i of h, beta_i of dW_k
!>    P_i = p_n - sum_j (abar_ij h H_q + sum_k bbar_ij dW_k H_k,q)(P_j, Q_j)
!>
!> Q_i and P_i are positions and momenta of stage i, and q_{n+1}, p_{n+1} the same sums with the weights in place of the
!> rows.
!>
!> A scheme from a partitioned tableau given by a user or the catalogue. It is symplectic if
!>
!>    alpha_i abar_ij + alpha_j a_ji = alpha_i alpha_j,    beta_i abar_ij + alpha_j b_ji = beta_i alpha_j,
!>    alpha_i bbar_ij + beta_j a_ji = alpha_i beta_j,      beta_i bbar_ij + beta_j b_ji = beta_i beta_j
!>
!> hold for all i, j. The conditions are sufficient, and necessary if no stage is superfluous.
module symsde_scheme_tableau
   use symsde_base_contracts, only: contracts_are_executed
   use symsde_base_kinds, only: wp
   use symsde_base_lanes, only: is_finite_lane
   use symsde_base_status, only: error_type, raise, invalid_argument, incompatible, wrong_shape
   use symsde_base_text, only: to_text
   use symsde_scheme_contract, only: require_scheme
   use symsde_scheme_scheme, only: scheme_type, tableau_form, symplecticity_residual
   use symsde_scheme_properties, only: declare_properties, tableau_order, coefficient_tolerance
   implicit none
   private
   public :: scheme_from_tableau

   real(wp), parameter :: tolerance = 64*epsilon(1.0_wp)
   character(*), parameter :: place = 'scheme_from_tableau'

contains

   !> The scheme of the tableau (a, abar, alpha) for the drift and (b, bbar, beta) for the noise, by default the
   !> same. Stage times are the row sums of a, or c. A tableau that is not symplectic is refused unless
   !> allow_nonsymplectic is set; its scheme then has symplectic = .false. Errors: wrong_shape, invalid_argument
   !> (numbers), incompatible (not symplectic).
   subroutine scheme_from_tableau(scheme, a, abar, alpha, name, allow_nonsymplectic, error, &
                                  b, bbar, beta, c)
      type(scheme_type), intent(out) :: scheme
      real(wp), intent(in) :: a(:, :)     !! drift coefficients of Q (nstage, nstage)
      real(wp), intent(in) :: abar(:, :)  !! drift coefficients of P (nstage, nstage)
      real(wp), intent(in) :: alpha(:)    !! weights; their sum is one (nstage)
      character(*), intent(in) :: name
      logical, intent(in) :: allow_nonsymplectic
      type(error_type), allocatable, intent(inout) :: error
      real(wp), intent(in), optional :: b(:, :)     !! noise coefficients of Q, default a (nstage, nstage)
      real(wp), intent(in), optional :: bbar(:, :)  !! noise coefficients of P, default abar (nstage, nstage)
      real(wp), intent(in), optional :: beta(:)     !! noise weights, default alpha (nstage)
      real(wp), intent(in), optional :: c(:)        !! times of the stages, default row sums of a (nstage)
      real(wp) :: residual

      ! Check shapes first, then sums: with a wrong number of weights their sum means nothing. Each check keeps an error
      ! raised before.
      call check_vector('alpha', alpha, size(alpha), error)
      call check_matrix('a', a, size(alpha), error)
      call check_matrix('abar', abar, size(alpha), error)
      if (present(b)) call check_matrix('b', b, size(alpha), error)
      if (present(bbar)) call check_matrix('bbar', bbar, size(alpha), error)
      if (present(beta)) call check_vector('beta', beta, size(alpha), error)
      if (present(c)) call check_vector('c', c, size(alpha), error)
      call check_sum('alpha', alpha, error)
      if (present(beta)) call check_sum('beta', beta, error)
      if (allocated(error)) return
      ! The noise has the coefficients of the drift unless others are given.
      call fill(scheme, a, abar, alpha)
      ! The times of position Verlet are not row sums of a: its force is evaluated in the middle of the step.
      if (present(c)) scheme%c = c
      if (present(beta)) scheme%beta = beta
      if (present(b)) scheme%b = b
      if (present(bbar)) scheme%bbar = bbar
      scheme%name = trim(name)
      scheme%reference = 'tableau given by the user'
      ! The condition is written so that a residual that is not a number refuses the tableau.
      residual = symplecticity_residual(scheme)
      if (.not. (allow_nonsymplectic .or. residual < coefficient_tolerance)) then
         call raise(error, incompatible, place, "the tableau '"//trim(name)// &
                    "' is not symplectic: the conditions "// &
                    'alpha_i abar_ij + alpha_j a_ji = alpha_i alpha_j, and those with noise, fail by '// &
                    to_text(residual)//'; take symplectic_conjugate(a, alpha) for abar, or ask for '// &
                    'allow_nonsymplectic')
         return
      end if
      ! The order without noise depends on (a, abar, alpha) alone.
      call declare_properties(scheme, tableau_order(a, abar, alpha))
      if (contracts_are_executed) call require_scheme(scheme, 'scheme, tableau')
   end subroutine scheme_from_tableau

   !> Copy the coefficients, for the drift and for the noise.
   pure subroutine fill(scheme, a, abar, alpha)
      type(scheme_type), intent(inout) :: scheme
      real(wp), intent(in) :: a(:, :), abar(:, :), alpha(:)

      scheme%form = tableau_form
      scheme%nstage = size(alpha)
      scheme%alpha = alpha
      scheme%a = a
      scheme%abar = abar
      ! Stage i has one time, that of Q_i, for H_p and H_q alike: two times in a stage would break symplecticity if
      ! H(t,q,p) is not separable.
      scheme%c = sum(a, dim=2)
      scheme%beta = alpha
      scheme%b = a
      scheme%bbar = abar
   end subroutine fill

   !> Require one finite number for each stage.
   subroutine check_vector(what, x, nstage, error)
      character(*), intent(in) :: what
      real(wp), intent(in) :: x(:)
      integer, intent(in) :: nstage
      type(error_type), allocatable, intent(inout) :: error

      if (size(x) /= nstage .or. nstage == 0) then
         call raise(error, wrong_shape, place, what//' has '//to_text(size(x))// &
                    ' components; give one for each of the '//to_text(nstage)//' stages, and at least one stage')
      else if (.not. all(is_finite_lane(x))) then
         call raise(error, invalid_argument, place, what// &
                    ' holds a number that is not finite; give finite coefficients')
      end if
   end subroutine check_vector

   !> Require a square matrix of finite numbers, with as many rows as there are weights.
   subroutine check_matrix(what, x, nstage, error)
      character(*), intent(in) :: what
      real(wp), intent(in) :: x(:, :)
      integer, intent(in) :: nstage
      type(error_type), allocatable, intent(inout) :: error

      ! is_finite_lane sees NaN and infinities by their bits, as optimised comparisons may not.
      if (any(shape(x) /= nstage)) then
         call raise(error, wrong_shape, place, what//' is '//to_text(size(x, 1))//' by '// &
                    to_text(size(x, 2))//'; with '//to_text(nstage)//' weights it must be '// &
                    to_text(nstage)//' by '//to_text(nstage))
      else if (.not. all(is_finite_lane(x))) then
         call raise(error, invalid_argument, place, what// &
                    ' holds a number that is not finite; give finite coefficients')
      end if
   end subroutine check_matrix

   !> Require sum_i alpha_i = 1: the scheme is then consistent with the drift, and with beta in place of alpha with the
   !> noise.
   subroutine check_sum(what, x, error)
      character(*), intent(in) :: what
      real(wp), intent(in) :: x(:)
      type(error_type), allocatable, intent(inout) :: error

      if (abs(sum(x) - 1) > tolerance) &
         call raise(error, invalid_argument, place, 'the weights '//what//' sum to '// &
                    to_text(sum(x))//'; they must sum to one: divide them by their sum')
   end subroutine check_sum

end module symsde_scheme_tableau
