! SPDX-License-Identifier: BSD-3-Clause
!> Springs between neighbours and to the ground, a quartic term, and additive noise that may act on positions.
!>
!>    H   = sum_i p_i^2/2 + sum_i (kappa q_i^2/2 + beta q_i^4/4) + (c/2) sum_{i<n} (q_{i+1} - q_i)^2
!>    H_1 = sum_i (a p_i - s cos(i) q_i)
!>
!> The same model may be declared dense, banded or tridiagonal, with or without rows, with analytic derivatives or with
!> gradients alone: the step must be the same each time.
module spring_chain
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: model_traits, strip_lanes
   use symsde_model_kernels, only: kernel_model
   implicit none
   private
   public :: spring_chain_type, new_spring_chain

   type, extends(kernel_model) :: spring_chain_type
      real(wp) :: kappa = 1, c = 0, beta = 0, a = 0, s = 0
   contains
      procedure :: value => weighted_value
      procedure :: gradient
      procedure :: hessian
      procedure :: hessian_vector
      procedure :: chain_rows
   end type spring_chain_type

contains

   !> n masses; the Hessian is declared dense, and all derivatives are analytic.
   subroutine new_spring_chain(self, n, kappa, c, beta, a, s)
      type(spring_chain_type), intent(out) :: self
      integer, intent(in) :: n
      real(wp), intent(in) :: kappa, c, beta, a, s

      self%name = 'spring_chain'
      self%kappa = kappa
      self%c = c
      self%beta = beta
      self%a = a
      self%s = s
      self%traits = model_traits(ndof=n, nnoise=1, separable=.true., additive=.true., &
                                 position_noise=.not. abs(a) > 0, quadratic=.not. abs(beta) > 0, &
                                 identity_mass=.true., has_value=.true., has_hessian=.true., has_hessian_vector=.true.)
   end subroutine new_spring_chain

   subroutine weighted_value(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(spring_chain_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)
      integer :: i

      value = 0
      do i = 1, ndof
         value = value + w(:, 0)*(p(:, i)**2/2 + self%kappa*q(:, i)**2/2 + self%beta*q(:, i)**4/4) &
                 + w(:, 1)*(self%a*p(:, i) - self%s*cos(1.0_wp*i)*q(:, i))
         if (i < ndof) value = value + w(:, 0)*self%c*(q(:, i + 1) - q(:, i))**2/2
      end do
   end subroutine weighted_value

   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(spring_chain_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      integer :: i

      do i = 1, ndof
         if (present(hp)) hp(:, i) = w(:, 0)*p(:, i) + w(:, 1)*self%a
         if (.not. present(hq)) cycle
         hq(:, i) = self%kappa*q(:, i) + self%beta*q(:, i)**3
         if (i > 1) hq(:, i) = hq(:, i) + self%c*(q(:, i) - q(:, i - 1))
         if (i < ndof) hq(:, i) = hq(:, i) - self%c*(q(:, i + 1) - q(:, i))
         hq(:, i) = w(:, 0)*hq(:, i) - w(:, 1)*self%s*cos(1.0_wp*i)
      end do
   end subroutine gradient

   !> The diagonal entry of row i, not multiplied by the weight of H.
   pure subroutine diagonal(self, nlane, i, q, k)
      class(spring_chain_type), intent(in) :: self
      integer, intent(in) :: nlane, i
      real(wp), intent(in) :: q(nlane)
      real(wp), intent(out) :: k(nlane)

      k = self%kappa + 3*self%beta*q**2
      if (i > 1) k = k + self%c
      if (i < self%traits%ndof) k = k + self%c
   end subroutine diagonal

   subroutine hessian(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      class(spring_chain_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof)
      real(wp), intent(out), optional :: hpp(nlane, ndof, ndof)
      integer :: i

      if (present(hqq)) hqq = 0
      if (present(hqp)) hqp = 0
      if (present(hpp)) hpp = 0
      do i = 1, ndof
         if (present(hpp)) hpp(:, i, i) = w(:, 0)
         if (.not. present(hqq)) cycle
         call diagonal(self, nlane, i, q(:, i), hqq(:, i, i))
         hqq(:, i, i) = w(:, 0)*hqq(:, i, i)
         if (i < ndof) hqq(:, i, i + 1) = -w(:, 0)*self%c
         if (i < ndof) hqq(:, i + 1, i) = -w(:, 0)*self%c
      end do
   end subroutine hessian

   subroutine hessian_vector(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
      class(spring_chain_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: vq(nlane, ndof), vp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      real(wp) :: k(nlane)
      integer :: i

      do i = 1, ndof
         call diagonal(self, nlane, i, q(:, i), k)
         uq(:, i) = k*vq(:, i)
         if (i > 1) uq(:, i) = uq(:, i) - self%c*vq(:, i - 1)
         if (i < ndof) uq(:, i) = uq(:, i) - self%c*vq(:, i + 1)
         uq(:, i) = w(:, 0)*uq(:, i)
         up(:, i) = w(:, 0)*vp(:, i)
      end do
   end subroutine hessian_vector

   subroutine chain_rows(self, ndof, nnoise, first, last, t, w, q, hq, hqq)
      class(spring_chain_type), intent(in) :: self
      integer, intent(in) :: ndof, nnoise, first, last
      real(wp), intent(in) :: t, w(strip_lanes, 0:nnoise), q(strip_lanes, first - 1:last + 1)
      real(wp), intent(out) :: hq(strip_lanes, first:last), hqq(strip_lanes, 0:1, first:last)
      integer :: i

      do i = first, last
         hq(:, i) = self%kappa*q(:, i) + self%beta*q(:, i)**3
         if (i > 1) hq(:, i) = hq(:, i) + self%c*(q(:, i) - q(:, i - 1))
         if (i < ndof) hq(:, i) = hq(:, i) - self%c*(q(:, i + 1) - q(:, i))
         hq(:, i) = w(:, 0)*hq(:, i) - w(:, 1)*self%s*cos(1.0_wp*i)
         call diagonal(self, strip_lanes, i, q(:, i), hqq(:, 0, i))
         hqq(:, 0, i) = w(:, 0)*hqq(:, 0, i)
         hqq(:, 1, i) = -w(:, 0)*self%c
      end do
   end subroutine chain_rows

end module spring_chain
