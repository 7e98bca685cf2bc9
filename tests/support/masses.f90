! SPDX-License-Identifier: BSD-3-Clause
!> Springs between unequal masses, with a quartic term and noise in position; the mass matrix may couple momenta.
!>
!>    H   = p.R p/2 + sum_i (kappa q_i^2/2 + 0.3 q_i^4/4) + 0.4 sum_{i<n} (q_{i+1} - q_i)^2/2,   R = M^-1
!>    H_1 = 0.3 sum_i q_i^2/2
!>
!> The diagonal of R is 1/2.3, 1/0.7, 1/1.9, 1/0.35, repeated; the entries beside the diagonal are `tie`.
module masses
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: model_traits
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: masses_type, new_masses

   type, extends(model_type) :: masses_type
      real(wp) :: kappa = 0.9_wp, tie = 0
      real(wp) :: rate = 0 !! R grows with time by the factor 1 + rate t, so with rate /= 0 the mass is not constant
      real(wp), allocatable :: r(:)   !! the diagonal of R (ndof)
   contains
      procedure :: gradient
      procedure :: divide
   end type masses_type

contains

   !> n masses; bands are declared if the argument is present.
   subroutine new_masses(self, n, tie, bands)
      type(masses_type), intent(out) :: self
      integer, intent(in) :: n
      real(wp), intent(in) :: tie
      logical, intent(in) :: bands
      real(wp), parameter :: m(4) = [2.3_wp, 0.7_wp, 1.9_wp, 0.35_wp]
      integer :: i

      self%name = 'masses'
      self%tie = tie
      self%r = [(1/m(modulo(i - 1, 4) + 1), i=1, n)]
      self%traits = model_traits(ndof=n, nnoise=1, separable=.true., position_noise=.true., constant_mass=.true.)
      if (bands) self%traits%bandwidth = 1
   end subroutine new_masses

   !> Terms are added one after the other, so that their bits do not depend on the number of lanes.
   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(masses_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      integer :: i

      if (present(hp)) then
         call self%divide(nlane, p, hp)
         do i = 1, ndof
            hp(:, i) = w(:, 0)*(1 + self%rate*t)*hp(:, i)
         end do
      end if
      if (.not. present(hq)) return
      do i = 1, ndof
         hq(:, i) = self%kappa*q(:, i)
      end do
      do i = 1, ndof
         hq(:, i) = hq(:, i) + 0.3_wp*(q(:, i)*q(:, i)*q(:, i))
      end do
      do i = 2, ndof
         hq(:, i) = hq(:, i) + 0.4_wp*(q(:, i) - q(:, i - 1))
      end do
      do i = 2, ndof
         hq(:, i - 1) = hq(:, i - 1) - 0.4_wp*(q(:, i) - q(:, i - 1))
      end do
      do i = 1, ndof
         hq(:, i) = w(:, 0)*hq(:, i)
      end do
      do i = 1, ndof
         hq(:, i) = hq(:, i) + w(:, 1)*(0.3_wp*q(:, i))
      end do
   end subroutine gradient

   !> R p
   pure subroutine divide(self, nlane, p, v)
      class(masses_type), intent(in) :: self
      integer, intent(in) :: nlane
      real(wp), intent(in) :: p(nlane, size(self%r))
      real(wp), intent(out) :: v(nlane, size(self%r))
      integer :: i

      do i = 1, size(self%r)
         v(:, i) = self%r(i)*p(:, i)
      end do
      if (abs(self%tie) <= 0) return
      do i = 2, size(self%r)
         v(:, i) = v(:, i) + self%tie*p(:, i - 1)
      end do
      do i = 2, size(self%r)
         v(:, i - 1) = v(:, i - 1) + self%tie*p(:, i)
      end do
   end subroutine divide

end module masses
