! SPDX-License-Identifier: BSD-3-Clause
!> Find the numbers 1/m_i of a diagonal mass, H = p.M^-1 p/2 + U(q).
!>
!> A model declares that its mass is constant, but not that it is diagonal; eight momenta decide this. At the first
!> momentum, (1, .., 1), the velocity v_i is the candidate for 1/m_i. M is diagonal if, at seven other momenta whose
!> components all differ, v_i is p_i times this candidate up to 4 eps.
module symsde_model_diagonal_mass
   use symsde_base_kinds, only: wp
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: find_diagonal_mass

   integer, parameter :: nmomentum = 8  !! momenta at which velocities are compared

contains

   !> Test whether every velocity is a number times its momentum, at time t and position x, which do not affect
   !> velocities. The momenta are tried one after the other, since a view of real lanes (model/views/real_lanes) has no
   !> more lanes than there are paths.
   subroutine find_diagonal_mass(model, t, x, inverse, diagonal)
      class(model_type), intent(in) :: model
      real(wp), intent(in) :: t, x(1, model%traits%ndof)
      real(wp), intent(out) :: inverse(model%traits%ndof)  !! 1/m_i, if M is diagonal
      logical, intent(out) :: diagonal
      real(wp) :: unit(1, 0:model%traits%nnoise), p(1, size(inverse)), v(1, size(inverse))
      integer :: i, j

      unit = 0
      unit(1, 0) = 1  ! weight one for H alone
      diagonal = .true.
      p = 1
      do j = 1, nmomentum
         call model%gradient(1, size(inverse), model%traits%nnoise, t, unit, x, p, hp=v)
         if (j == 1) inverse = v(1, :)
         do i = 1, size(inverse)
            diagonal = diagonal .and. abs(inverse(i)) <= huge(t) .and. &
                       abs(v(1, i) - inverse(i)*p(1, i)) <= 4*epsilon(t)*abs(v(1, i))
            p(1, i) = 1.5_wp + sin(1.7_wp*i*(j + 1) + (j + 1))  ! a different momentum for every mass
         end do
      end do
   end subroutine find_diagonal_mass

end module symsde_model_diagonal_mass
