! SPDX-License-Identifier: BSD-3-Clause
!> Positions and momenta coupled by H; a loop over lanes, so that the bits of a lane do not depend on their number.
!>
!>    H   = p.p/2 + b (q.p)^2/2 + (q.q)^2/4
!>    H_1 = sigma q.p
module mixed_model
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: model_traits
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: mixed_type, new_mixed

   type, extends(model_type) :: mixed_type
      real(wp) :: b = 0, sigma = 0
   contains
      procedure :: gradient
   end type mixed_type

contains

   !> n degrees of freedom; the mass is the identity where b = 0.
   subroutine new_mixed(self, n, b, sigma)
      type(mixed_type), intent(out) :: self
      integer, intent(in) :: n
      real(wp), intent(in) :: b, sigma

      self%name = 'mixed'
      self%b = b
      self%sigma = sigma
      self%traits = model_traits(ndof=n, nnoise=1, identity_mass=.not. abs(b) > 0)
   end subroutine new_mixed

   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(mixed_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp) :: coupling, square
      integer :: lane, i

      do lane = 1, nlane
         coupling = self%sigma*w(lane, 1)
         square = 0
         !GCC$ novector
         do i = 1, ndof
            coupling = coupling + self%b*w(lane, 0)*q(lane, i)*p(lane, i)
            square = square + q(lane, i)**2
         end do
         square = square*w(lane, 0)
         !GCC$ novector
         do i = 1, ndof
            if (present(hq)) hq(lane, i) = coupling*p(lane, i) + square*q(lane, i)
            if (present(hp)) hp(lane, i) = w(lane, 0)*p(lane, i) + coupling*q(lane, i)
         end do
      end do
   end subroutine gradient

end module mixed_model
