! SPDX-License-Identifier: BSD-3-Clause
!> A chain whose Hamiltonians all depend on time, and an extended system that has time as a coordinate.
!>
!>    H   = p.p/2 + sum_i [(1 + 0.3 sin(3t+i)) q_i^2/2 + (1 + 0.4 t) q_i^4/4] + 0.2 cos(2t) sum_i q_i q_{i+1}
!>    H_1 = -0.5 (1 + 0.8 sin 4t) sum_i cos(i) q_i
!>    H_2 = 0.3 (1 + t) times    0,   sum_i sin q_i,   sum_i sin(i) p_i   or   sum_i q_i p_i
!>
!> In the extended system q_{n+1} = t and H gains the term p_{n+1}: time grows by h under the drift and not at all under
!> a noise, so a scheme that evaluates H at the times of its stages must give the same step for both systems. With
!> as_momentum, p_{n+1} = t and H loses q_{n+1}. Nothing depends on the variable conjugate to time, and the tests ignore
!> it.
module driven_model
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: model_traits
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: driven_type, new_driven, extended_type, new_extended

   integer, parameter, public :: linear_kick = 0, curved_kick = 1, additive_noise = 2, general_noise = 3

   type, extends(model_type) :: driven_type
      integer :: noise = linear_kick  !! kind of H_2
   contains
      procedure :: gradient => driven_gradient
   end type driven_type

   type, extends(model_type) :: extended_type
      type(driven_type) :: inner
      logical :: as_momentum = .false.  !! time is the last momentum instead of the last coordinate
   contains
      procedure :: gradient => extended_gradient
   end type extended_type

contains

   !> n masses; a bandwidth of 1 or more is declared.
   subroutine new_driven(self, n, bandwidth, noise)
      type(driven_type), intent(out) :: self
      integer, intent(in) :: n, bandwidth, noise

      self%name = 'driven'
      self%noise = noise
      self%traits = model_traits(ndof=n, nnoise=2, bandwidth=min(bandwidth, n - 1), identity_mass=.true., &
                                 separable=noise /= general_noise, &
                                 additive=any(noise == [linear_kick, additive_noise]), &
                                 position_noise=any(noise == [linear_kick, curved_kick]))
   end subroutine new_driven

   subroutine new_extended(self, inner, as_momentum)
      type(extended_type), intent(out) :: self
      type(driven_type), intent(in) :: inner
      logical, intent(in) :: as_momentum

      self%name = 'extended'
      self%inner = inner
      self%as_momentum = as_momentum
      self%traits = model_traits(ndof=inner%traits%ndof + 1, nnoise=inner%traits%nnoise)
   end subroutine new_extended

   subroutine driven_gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(driven_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp) :: kick(nlane), other(nlane)
      integer :: i

      kick = -0.5_wp*(1 + 0.8_wp*sin(4*t))*w(:, 1)
      other = 0.3_wp*(1 + t)*w(:, 2)
      do i = 1, ndof
         if (present(hq)) then
            hq(:, i) = w(:, 0)*((1 + 0.3_wp*sin(3*t + i))*q(:, i) + (1 + 0.4_wp*t)*q(:, i)**3) + cos(1.0_wp*i)*kick
            if (i > 1) hq(:, i) = hq(:, i) + w(:, 0)*0.2_wp*cos(2*t)*q(:, i - 1)
            if (i < ndof) hq(:, i) = hq(:, i) + w(:, 0)*0.2_wp*cos(2*t)*q(:, i + 1)
            if (self%noise == curved_kick) hq(:, i) = hq(:, i) + other*cos(q(:, i))
            if (self%noise == general_noise) hq(:, i) = hq(:, i) + other*p(:, i)
         end if
         if (present(hp)) then
            hp(:, i) = w(:, 0)*p(:, i)
            if (self%noise == additive_noise) hp(:, i) = hp(:, i) + sin(1.0_wp*i)*other
            if (self%noise == general_noise) hp(:, i) = hp(:, i) + other*q(:, i)
         end if
      end do
   end subroutine driven_gradient

   !> Compute every lane by a call of its own, since each lane has its own time.
   subroutine extended_gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(extended_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), dimension(1, ndof - 1) :: gq, gp
      integer :: lane

      do lane = 1, nlane
         call self%inner%gradient(1, ndof - 1, nnoise, merge(p(lane, ndof), q(lane, ndof), self%as_momentum), &
                                  w(lane:lane, :), q(lane:lane, :ndof - 1), p(lane:lane, :ndof - 1), gq, gp)
         if (present(hq)) then
            hq(lane, :ndof - 1) = gq(1, :)
            hq(lane, ndof) = merge(-w(lane, 0), 0.0_wp, self%as_momentum)
         end if
         if (present(hp)) then
            hp(lane, :ndof - 1) = gp(1, :)
            hp(lane, ndof) = merge(0.0_wp, w(lane, 0), self%as_momentum)
         end if
      end do
   end subroutine extended_gradient

end module driven_model
