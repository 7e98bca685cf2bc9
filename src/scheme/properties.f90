! SPDX-License-Identifier: BSD-3-Clause
!>    symplectic      alpha_i abar_ij + alpha_j a_ji = alpha_i alpha_j, and three conditions with noise (scheme/tableau)
!>    symmetric       alpha_j = alpha_j',  c_i + c_i' = 1,  a_ij + a_i'j' = alpha_j,       i' = r + 1 - i
!>    invariants      a = abar and b = bbar, of a symplectic tableau: all quadratic invariants are kept
!>    Stratonovich    beta^T b e = beta^T bbar e = 1/2,                                    e = (1, .., 1)
!>
!> Properties that follow from the coefficients of a scheme: symplecticity, symmetry, invariants, expected orders.
!>
!> Everything here is derived from the coefficients. Claims beyond these are set, and marked as claimed, where a scheme
!> is made (scheme/expansion, scheme/additive, scheme/catalogue).
module symsde_scheme_properties
   use symsde_base_kinds, only: wp
   use symsde_scheme_kicks, only: kicks_type
   use symsde_scheme_orders, only: set_order, evidence_derived, additive_noise, commutative_noise, general_noise, &
                                   commuting_flows, weak_order
   use symsde_scheme_scheme, only: scheme_type, tableau_form, galerkin_form, splitting_form, symplecticity_residual
   implicit none
   private
   public :: declare_properties, symmetry_residual, quadratic_residual, tableau_order
   public :: stratonovich_sum, conjugate_stratonovich_sum, coefficient_tolerance

   real(wp), parameter :: coefficient_tolerance = 1e-13_wp  !! a smaller residual is rounding of the coefficients
   real(wp), parameter :: order_tolerance = 1e-12_wp        !! larger, since order conditions sum more terms

contains

   !> Set the traits and the expected orders of a scheme whose coefficients are complete.
   !>
   !> Strong order one for additive and commutative noise and weak order one need the weights to sum
   !> to one and beta^T b e = beta^T bbar e = 1/2; where only their sum is one, a correction
   !> Hamiltonian restores it, and the orders are those with correction = increments. If neither holds, the scheme does
   !> not converge to the Stratonovich equation, except for additive noise. For commuting flows a step integrates the
   !> one-step Hamiltonian, whose size is the square root of h, for unit time: half the order without noise.
   pure subroutine declare_properties(scheme, order_noise_free)
      type(scheme_type), intent(inout) :: scheme
      integer, intent(in) :: order_noise_free  !! order of the scheme without noise
      logical :: consistent, correctable
      real(wp) :: commutative, commuting

      ! In the expansion of a step the factor of the term H_k,qp H_k,p dW^2 and similar terms is beta^T b e; in the
      ! Stratonovich equation it is 1/2.
      consistent = abs(stratonovich_sum(scheme) - 0.5_wp) < coefficient_tolerance .and. &
                   abs(conjugate_stratonovich_sum(scheme) - 0.5_wp) < coefficient_tolerance
      correctable = abs(stratonovich_sum(scheme) + conjugate_stratonovich_sum(scheme) - 1) < &
                    coefficient_tolerance
      scheme%symplectic = scheme%form == galerkin_form
      if (scheme%form == tableau_form) &
         scheme%symplectic = symplecticity_residual(scheme) < coefficient_tolerance
      scheme%symmetric = symmetry_residual(scheme) < coefficient_tolerance
      scheme%keeps_quadratic = scheme%symplectic .and. &
                               quadratic_residual(scheme) < coefficient_tolerance
      scheme%order_noise_free = order_noise_free
      commutative = merge(1.0_wp, 0.0_wp, consistent .or. correctable)
      commuting = commutative
      if (consistent .and. scheme%noise_coefficients_equal()) commuting = max(1, order_noise_free/2)
      call set_order(scheme%order(additive_noise), 1.0_wp, evidence_derived)
      call set_order(scheme%order(commutative_noise), commutative, evidence_derived)
      call set_order(scheme%order(general_noise), 0.5_wp*commutative, evidence_derived)
      call set_order(scheme%order(commuting_flows), commuting, evidence_derived)
      call set_order(scheme%order(weak_order), commutative, evidence_derived)
      scheme%sharp = commutative > 0
   end subroutine declare_properties

   !> beta^T b e: one half for schemes that converge to the Stratonovich equation without correction. Galerkin
   !> schemes with more nodes than degrees are built only if it is one half.
   pure real(wp) function stratonovich_sum(scheme)
      type(scheme_type), intent(in) :: scheme

      stratonovich_sum = 0.5_wp
      if (scheme%has_tableau()) &
         stratonovich_sum = dot_product(scheme%beta, sum(scheme%b, dim=2))
   end function stratonovich_sum

   !> beta^T bbar e; by symplecticity beta^T b e + beta^T bbar e = 1.
   pure real(wp) function conjugate_stratonovich_sum(scheme)
      type(scheme_type), intent(in) :: scheme

      conjugate_stratonovich_sum = 0.5_wp
      if (scheme%has_tableau()) &
         conjugate_stratonovich_sum = dot_product(scheme%beta, sum(scheme%bbar, dim=2))
   end function conjugate_stratonovich_sum

   !> Distance of a scheme from its adjoint with the stages reversed: with i' = r+1-i the largest of
   !> |alpha_j - alpha_j'|, |c_i + c_i' - 1| and |a_ij + a_i'j' - alpha_j|, and alike for abar, b,
   !> bbar.
   pure real(wp) function symmetry_residual(scheme) result(residual)
      type(scheme_type), intent(in) :: scheme
      integer :: r

      r = scheme%nstage
      associate (s => scheme)
         residual = max(maxval(abs(s%alpha - s%alpha(r:1:-1))), &
                        maxval(abs(s%beta - s%beta(r:1:-1))), &
                        maxval(abs(s%c + s%c(r:1:-1) - 1)))
         if (s%form == splitting_form) then
            residual = max(residual, unlike_reversed(s%kicks))
         else if (s%form == galerkin_form) then
            residual = max(residual, maxval(abs(s%basis - s%basis(r:1:-1, s%degree:0:-1))), &
                           maxval(abs(s%slope + s%slope(r:1:-1, s%degree:0:-1))))
         else
            residual = max(residual, unlike_adjoint(s%a, s%alpha), unlike_adjoint(s%abar, s%alpha), &
                           unlike_adjoint(s%b, s%beta), unlike_adjoint(s%bbar, s%beta))
         end if
      end associate
   end function symmetry_residual

   !> Largest difference between the coefficients of kicks and of the same kicks in reverse order. Reversal changes the
   !> sign of a_k, but not of K_k.
   pure real(wp) function unlike_reversed(kicks) result(residual)
      type(kicks_type), intent(in) :: kicks

      associate (r => size(kicks%c))
         residual = maxval(abs([kicks%gamma + kicks%gamma(r:1:-1), kicks%eta - kicks%eta(r:1:-1), &
                                kicks%kappa - kicks%kappa(r:1:-1), kicks%share - kicks%share(r:1:-1)]))
         if (kicks%is_word()) residual = max(residual, maxval(abs(kicks%decay - kicks%decay(r:1:-1))))
      end associate
   end function unlike_reversed

   !> max_ij |a_ij + a_i'j' - alpha_j|
   pure real(wp) function unlike_adjoint(a, alpha) result(residual)
      real(wp), intent(in) :: a(:, :), alpha(:)
      integer :: i, j, r

      r = size(alpha)
      residual = 0
      do j = 1, r
         do i = 1, r
            residual = max(residual, abs(a(i, j) + a(r + 1 - i, r + 1 - j) - alpha(j)))
         end do
      end do
   end function unlike_adjoint

   !> Largest difference between the coefficients of Q and P. A symplectic tableau preserves every
   !> quadratic invariant where it vanishes; a Galerkin scheme with more nodes than degrees does not
   !> preserve them.
   pure real(wp) function quadratic_residual(scheme) result(residual)
      type(scheme_type), intent(in) :: scheme

      residual = 1
      if (scheme%has_tableau()) &
         residual = max(maxval(abs(scheme%a - scheme%abar)), maxval(abs(scheme%b - scheme%bbar)))
   end function quadratic_residual

   !> Order without noise of a partitioned tableau, 0 to 4, by the conditions of all rooted trees
   !> whose vertices are coloured with a or abar (Hairer, Lubich, Wanner, Geometric Numerical
   !> Integration, III.2).
   pure integer function tableau_order(a, abar, alpha) result(order)
      real(wp), intent(in) :: a(:, :)     !! (nstage, nstage)
      real(wp), intent(in) :: abar(:, :)  !! (nstage, nstage)
      real(wp), intent(in) :: alpha(:)    !! (nstage)
      real(wp) :: m(size(alpha), size(alpha), 2), c(size(alpha), 2)
      real(wp) :: row(size(alpha)), chain(size(alpha)), worst(4)
      integer :: x, y, z

      m(:, :, 1) = a
      m(:, :, 2) = abar
      ! m(:, :, x) is a for x = 1 and abar for x = 2, c(:, x) its row sums; all colourings of each tree are tried.
      c = sum(m, dim=2)
      worst = 0
      worst(1) = abs(sum(alpha) - 1)
      do x = 1, 2
         ! row = alpha^T m serves the trees whose root has one branch.
         row = matmul(alpha, m(:, :, x))
         ! The trees of order 2, 3 and 4 and their densities are, multiplied by alpha^T: c (2); c c (3), m c (6); c c
         ! c (4), c (m c) (8), m (c c) (12), m m c (24).
         call require(worst(2), dot_product(alpha, c(:, x)), 2)
         do y = 1, 2
            call require(worst(3), sum(alpha*c(:, x)*c(:, y)), 3)
            call require(worst(3), dot_product(row, c(:, y)), 6)
            do z = 1, 2
               chain = matmul(m(:, :, y), c(:, z))
               call require(worst(4), sum(alpha*c(:, x)*c(:, y)*c(:, z)), 4)
               call require(worst(4), sum(alpha*c(:, x)*chain), 8)
               call require(worst(4), sum(row*c(:, y)*c(:, z)), 12)
               call require(worst(4), dot_product(row, chain), 24)
            end do
         end do
      end do
      order = 0
      do while (order < 4)
         if (.not. worst(order + 1) < order_tolerance) exit
         order = order + 1
      end do
   end function tableau_order

   !> Require an order condition: the weight of a tree is one over its density.
   pure subroutine require(worst, weight, density)
      real(wp), intent(inout) :: worst  !! largest residual of this order so far
      real(wp), intent(in) :: weight
      integer, intent(in) :: density

      worst = max(worst, abs(weight - 1.0_wp/density))
   end subroutine require

end module symsde_scheme_properties
