! SPDX-License-Identifier: BSD-3-Clause
!> Bonds of a quadratic form D = z.S z/2, z = (q, p), by what the actions I_i = (q_i^2 + p_i^2)/2 do to them. With
!> psi = q + i p every D is a sum of
!>
!>    sum_i a_i I_i                 which commutes with all actions: no bond
!>    Re(c conj(psi_i) psi_j)       hopping:  Re c (q_i q_j + p_i p_j) - Im c (q_i p_j - p_i q_j)
!>    Re(conj(c) psi_i psi_j)       pairing:  Re c (q_i q_j - p_i p_j) + Im c (q_i p_j + p_i q_j)
!>    Re(conj(c) psi_i psi_i)/2     squeezing of one site, a pairing with j = i
!>
!> For K = sum_i u_i I_i and L = sum_i v_i I_i the bracket {K,{L,X}} of a bond X is a multiple of X,
!>
!>    {K,{L,X}} = -(u_i - u_j)(v_i - v_j) X   hopping,      -(u_i + u_j)(v_i + v_j) X   pairing.
module symsde_base_bonds
   use symsde_base_kinds, only: wp
   use symsde_base_supports, only: noise_supports, find_noises_at
   implicit none
   private
   public :: bond_list, find_bonds, find_bond_supports

   type :: bond_list
      integer :: n = 0                     !! number of bonds
      integer, allocatable :: i(:), j(:)   !! sites i < j, or i = j where one is squeezed (n)
      logical, allocatable :: pairs(:)     !! pairing, else hopping (n)
      real(wp), allocatable :: c(:, :)     !! real and imaginary part of c (2, n)
   end type bond_list

contains

   !> The bonds that do not vanish, of ndof sites, ordered by j and i.
   pure subroutine find_bonds(ndof, s, bonds)
      integer, intent(in) :: ndof
      real(wp), intent(in) :: s(2*ndof, 2*ndof)   !! second derivatives of D, by q and then by p
      type(bond_list), intent(out) :: bonds
      real(wp) :: c(2, 2)
      integer :: pass, kind, i, j

      ! The first pass counts.
      do pass = 1, 2
         bonds%n = 0
         do j = 1, ndof
            do i = 1, j
               associate (qq => s(i, j), pp => s(ndof + i, ndof + j), qp => s(i, ndof + j), pq => s(ndof + i, j))
                  c(1, 1) = 0.5_wp*(qq + pp)
                  c(2, 1) = 0.5_wp*(pq - qp)
                  c(1, 2) = 0.5_wp*(qq - pp)
                  c(2, 2) = 0.5_wp*(qp + pq)
               end associate
               do kind = merge(2, 1, i == j), 2
                  if (all(abs(c(:, kind)) <= 0)) cycle
                  bonds%n = bonds%n + 1
                  if (pass == 1) cycle
                  bonds%i(bonds%n) = i
                  bonds%j(bonds%n) = j
                  bonds%pairs(bonds%n) = kind == 2
                  bonds%c(:, bonds%n) = c(:, kind)
               end do
            end do
         end do
         if (pass == 1) allocate (bonds%i(bonds%n), bonds%j(bonds%n), bonds%pairs(bonds%n), bonds%c(2, bonds%n))
      end do
   end subroutine find_bonds

   !> The bonds that each noise touches, by the sites that it touches: two noises have brackets with D if they touch one
   !> bond together. Without supports of noises not given; a bond may stand twice.
   pure subroutine find_bond_supports(supports, nnoise, ndof, bonds, at_bonds)
      type(noise_supports), intent(in) :: supports
      integer, intent(in) :: nnoise, ndof
      type(bond_list), intent(in) :: bonds
      type(noise_supports), intent(out) :: at_bonds
      type(noise_supports) :: ends, at_site
      integer :: b, i, k, n, pass, at

      if (.not. supports%are_given()) return
      ! The bonds at each site, as noises at degrees of freedom.
      allocate (ends%from(bonds%n + 1), ends%dof(2*bonds%n))
      do b = 0, bonds%n
         ends%from(b + 1) = 2*b
      end do
      ends%dof(1::2) = bonds%i
      ends%dof(2::2) = bonds%j
      call find_noises_at(ends, bonds%n, ndof, at_site)
      allocate (at_bonds%from(nnoise + 1), source=0)
      do pass = 1, 2
         n = 0
         do k = 1, nnoise
            do i = supports%from(k) + 1, supports%from(k + 1)
               do at = at_site%from(supports%dof(i)) + 1, at_site%from(supports%dof(i) + 1)
                  n = n + 1
                  if (pass == 2) at_bonds%dof(n) = at_site%dof(at)
               end do
            end do
            at_bonds%from(k + 1) = n
         end do
         if (pass == 1) allocate (at_bonds%dof(n))
      end do
   end subroutine find_bond_supports

end module symsde_base_bonds
