! SPDX-License-Identifier: BSD-3-Clause
!> The numbers 1/m_i of a diagonal mass, H = p.M^-1 p/2 + U(q).
!>
!> A model declares that its mass is constant, but not that it is diagonal: this is found by trying eight momenta. The
!> first is e = (1, .., 1), for which the velocity v_i is the i-th number if M is diagonal. Then p_i differs from row to
!> row, and M is diagonal if v_i is p_i times that number to 4 eps, seven times.
module symsde_model_diagonal_mass
   use symsde_base_kinds, only: wp
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: find_diagonal_mass

   integer, parameter :: nmomentum = 8  !! momenta at which velocities are compared

contains

   !> Look whether every velocity is a number times its momentum, at the time t and the position x, which do not matter
   !> to velocities. One momentum after the other: a view of the real lanes of a block (model/views/real_lanes) does not
   !> look at more than there are paths.
   subroutine find_diagonal_mass(model, t, x, inverse, diagonal)
      class(model_type), intent(in) :: model
      real(wp), intent(in) :: t, x(1, model%traits%ndof)
      real(wp), intent(out) :: inverse(model%traits%ndof)  !! 1/m_i, if M is diagonal
      logical, intent(out) :: diagonal
      real(wp) :: unit(1, 0:model%traits%nnoise), p(1, size(inverse)), v(1, size(inverse))
      integer :: i, j

      unit = 0
      unit(1, 0) = 1  ! the weight of H alone
      diagonal = .true.
      p = 1
      do j = 1, nmomentum
         call model%gradient(1, size(inverse), model%traits%nnoise, t, unit, x, p, hp=v)
         if (j == 1) inverse = v(1, :)
         do i = 1, size(inverse)
            diagonal = diagonal .and. abs(inverse(i)) <= huge(t) .and. &
                       abs(v(1, i) - inverse(i)*p(1, i)) <= 4*epsilon(t)*abs(v(1, i))
            p(1, i) = 1.5_wp + sin(1.7_wp*i*(j + 1) + (j + 1))  ! different for all masses
         end do
      end do
   end subroutine find_diagonal_mass

end module symsde_model_diagonal_mass
