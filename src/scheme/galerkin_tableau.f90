! SPDX-License-Identifier: BSD-3-Clause
!> The tableau that a Galerkin scheme is equal to if H = p.M^-1 p/2 + U(q) with a constant mass M.
!>
!> With r nodes and degree s the velocities q_d'(c_i) are values of a polynomial of degree s - 1 (step/oracle/galerkin
!> has the equations), and so are the momenta at the nodes, M times the velocities. With phi_m, m = 1..s, an orthogonal
!> basis of these polynomials for the sum over nodes,
!>
!>    sum_i alpha_i phi_l(c_i) phi_m(c_i) = delta_lm d_m,       Phi_m(t) = integral of phi_m from 0 to t,
!>
!> the equations are those of the tableau
!>
!>    a_ij = sum_m Phi_m(c_i) phi_m(c_j) alpha_j/d_m,           abar: its symplectic conjugate
!>
!> P_i = p_n + sum_j abar_ij G_j is such a polynomial, which the matrix a integrates exactly; for velocities due to
!> additive noise the matrix integrates their projection, as q_d does. Two nodes of Lobatto with s = 1 give
!> Stormer-Verlet, three with s = 2 Lobatto IIIA-IIIB (tests/verification/test_galerkin.pf).
module symsde_scheme_galerkin_tableau
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: model_traits
   use symsde_scheme_scheme, only: scheme_type, galerkin_form, tableau_form, symplectic_conjugate, tidy
   implicit none
   private
   public :: find_tableau

contains

   !> Find the tableau; it is not allocated if the scheme has none for this model.
   pure subroutine find_tableau(scheme, traits, tableau)
      type(scheme_type), intent(in) :: scheme
      type(model_traits), intent(in) :: traits
      type(scheme_type), allocatable, intent(out) :: tableau
      real(wp) :: phi(scheme%nstage, scheme%degree), integral(scheme%nstage, scheme%degree)
      real(wp) :: norm(scheme%degree), a(scheme%nstage, scheme%nstage)
      integer :: i, j

      if (scheme%form /= galerkin_form .or. .not. traits%has_constant_mass()) return
      if (traits%nnoise > 0 .and. .not. scheme%noise_coefficients_equal()) return
      call orthogonalise(scheme, phi, integral, norm)
      if (.not. all(norm > 0)) return  ! a sum with weights of both signs may vanish
      do j = 1, scheme%nstage
         do i = 1, scheme%nstage
            a(i, j) = scheme%alpha(j)*sum(integral(i, :)*phi(j, :)/norm)
         end do
      end do
      tableau = scheme
      tableau%form = tableau_form
      tableau%beta = scheme%alpha
      tableau%a = tidy(a)
      a = symplectic_conjugate(tableau%a, scheme%alpha)
      tableau%abar = tidy(a)
      tableau%b = tableau%a
      tableau%bbar = tableau%abar
   end subroutine find_tableau

   !> Values of the phi_m and Phi_m at the nodes, from values of the l_mu' and l_mu, mu = 1..s, which vanish at 0. A
   !> second pass removes the rounding errors of the first.
   pure subroutine orthogonalise(scheme, phi, integral, norm)
      type(scheme_type), intent(in) :: scheme  !! a scheme in Galerkin form
      real(wp), intent(out), dimension(scheme%nstage, scheme%degree) :: phi, integral
      real(wp), intent(out) :: norm(scheme%degree)
      real(wp) :: part
      integer :: m, l, pass

      phi = scheme%slope(:, 1:scheme%degree)
      integral = scheme%basis(:, 1:scheme%degree)
      do m = 1, scheme%degree
         do pass = 1, 2
            do l = 1, m - 1
               part = sum(scheme%alpha*phi(:, l)*phi(:, m))/norm(l)
               phi(:, m) = phi(:, m) - part*phi(:, l)
               integral(:, m) = integral(:, m) - part*integral(:, l)
            end do
         end do
         norm(m) = sum(scheme%alpha*phi(:, m)**2)
      end do
   end subroutine orthogonalise

end module symsde_scheme_galerkin_tableau
