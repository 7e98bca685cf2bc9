! SPDX-License-Identifier: BSD-3-Clause
!> Every degree of freedom is coupled to every other: dense Hessians, gradients at a cost proportional to ndof.
!>
!>    H   = sum_i (p_i^2 + kappa_i q_i^2)/2 + (c/2n) sum_ij (1 - cos(q_i - q_j)) + n b L^2/2
!>    H_1 = -sigma sum_i cos(i) q_i,   L = (1/n) sum_i q_i p_i
!>
!> Rotators in the field of their mean on springs of stiffness kappa_i = 1 .. kappa; the double sum is
!> n c (1 - |M|^2)/2 with M the mean of (cos q_i, sin q_i). With b /= 0 nothing is separable and no block of
!> the Hessian is sparse.
module mean_field_model
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: model_traits
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: mean_field_type, new_mean_field, bare_type, new_bare

   type, extends(model_type) :: mean_field_type
      real(wp) :: c = 1       !! coupling of the rotators
      real(wp) :: b = 0       !! coupling of positions and momenta
      real(wp) :: kappa = 1   !! stiffest spring; the softest is 1
      real(wp) :: sigma = 0.3_wp
   contains
      procedure :: value => weighted_value
      procedure :: gradient
      procedure :: hessian
      procedure :: hessian_vector
   end type mean_field_type

   !> The mean-field model with its gradient alone.
   type, extends(model_type) :: bare_type
      type(mean_field_type) :: whole
   contains
      procedure :: gradient => bare_gradient
   end type bare_type

contains

   !> n degrees of freedom with one noise on the momenta.
   subroutine new_mean_field(self, n, b, kappa)
      type(mean_field_type), intent(out) :: self
      integer, intent(in) :: n
      real(wp), intent(in) :: b, kappa

      self%name = 'mean_field'
      self%b = b
      self%kappa = kappa
      self%traits = model_traits(ndof=n, nnoise=1, separable=.not. abs(b) > 0, additive=.true., &
                                 position_noise=.true., identity_mass=.not. abs(b) > 0, has_value=.true., &
                                 has_hessian=.true., has_hessian_vector=.true.)
   end subroutine new_mean_field

   subroutine new_bare(self, n, b, kappa)
      type(bare_type), intent(out) :: self
      integer, intent(in) :: n
      real(wp), intent(in) :: b, kappa

      call new_mean_field(self%whole, n, b, kappa)
      self%name = 'bare_mean_field'
      self%traits = self%whole%traits
      self%traits%has_value = .false.
      self%traits%has_hessian = .false.
      self%traits%has_hessian_vector = .false.
   end subroutine new_bare

   subroutine bare_gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(bare_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)

      call self%whole%gradient(nlane, ndof, nnoise, t, w, q, p, hq, hp)
   end subroutine bare_gradient

   !> Stiffness of the spring of degree i.
   pure real(wp) function spring(self, i)
      class(mean_field_type), intent(in) :: self
      integer, intent(in) :: i

      spring = 1 + (self%kappa - 1)*(real(i, wp)/self%traits%ndof)**2
   end function spring

   !> Means over the degrees of freedom: of cos q, sin q and q p.
   pure subroutine means(nlane, ndof, q, p, mx, my, l)
      integer, intent(in) :: nlane, ndof
      real(wp), intent(in) :: q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: mx(nlane), my(nlane), l(nlane)
      integer :: i

      mx = 0
      my = 0
      l = 0
      do i = 1, ndof
         mx = mx + cos(q(:, i))
         my = my + sin(q(:, i))
         l = l + q(:, i)*p(:, i)
      end do
      mx = mx/ndof
      my = my/ndof
      l = l/ndof
   end subroutine means

   subroutine weighted_value(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(mean_field_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)
      real(wp), dimension(nlane) :: mx, my, l
      integer :: i

      call means(nlane, ndof, q, p, mx, my, l)
      value = w(:, 0)*ndof*(self%c*(1 - mx**2 - my**2) + self%b*l**2)/2
      do i = 1, ndof
         value = value + w(:, 0)*(p(:, i)**2 + spring(self, i)*q(:, i)**2)/2 - w(:, 1)*self%sigma*cos(1.0_wp*i)*q(:, i)
      end do
   end subroutine weighted_value

   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(mean_field_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), dimension(nlane) :: mx, my, l
      integer :: i

      call means(nlane, ndof, q, p, mx, my, l)
      do i = 1, ndof
         if (present(hq)) hq(:, i) = w(:, 0)*(spring(self, i)*q(:, i) + self%c*(mx*sin(q(:, i)) - my*cos(q(:, i))) &
                                              + self%b*l*p(:, i)) - w(:, 1)*self%sigma*cos(1.0_wp*i)
         if (present(hp)) hp(:, i) = w(:, 0)*(p(:, i) + self%b*l*q(:, i))
      end do
   end subroutine gradient

   subroutine hessian(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      class(mean_field_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof)
      real(wp), intent(out), optional :: hpp(nlane, ndof, ndof)
      real(wp), dimension(nlane) :: mx, my, l
      real(wp) :: x(nlane, ndof), y(nlane, ndof)
      integer :: i, j

      call means(nlane, ndof, q, p, mx, my, l)
      x = cos(q)
      y = sin(q)
      do j = 1, ndof
         do i = 1, ndof
            if (present(hqq)) hqq(:, i, j) = w(:, 0)*(self%b*p(:, i)*p(:, j) &
                                                      - self%c*(x(:, i)*x(:, j) + y(:, i)*y(:, j)))/ndof
            if (present(hqp)) hqp(:, i, j) = w(:, 0)*self%b*p(:, i)*q(:, j)/ndof
            if (present(hpp)) hpp(:, i, j) = w(:, 0)*self%b*q(:, i)*q(:, j)/ndof
         end do
         if (present(hqq)) hqq(:, j, j) = hqq(:, j, j) + w(:, 0)*(spring(self, j) + self%c*(mx*x(:, j) + my*y(:, j)))
         if (present(hqp)) hqp(:, j, j) = hqp(:, j, j) + w(:, 0)*self%b*l
         if (present(hpp)) hpp(:, j, j) = hpp(:, j, j) + w(:, 0)
      end do
   end subroutine hessian

   subroutine hessian_vector(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
      class(mean_field_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: vq(nlane, ndof), vp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      real(wp), dimension(nlane) :: mx, my, l, dmx, dmy, dl
      real(wp) :: x(nlane), y(nlane)
      integer :: i

      mx = 0
      my = 0
      l = 0
      dmx = 0
      dmy = 0
      dl = 0
      do i = 1, ndof
         x = cos(q(:, i))
         y = sin(q(:, i))
         uq(:, i) = x
         up(:, i) = y
         mx = mx + x
         my = my + y
         l = l + q(:, i)*p(:, i)
         dmx = dmx - y*vq(:, i)
         dmy = dmy + x*vq(:, i)
         dl = dl + vq(:, i)*p(:, i) + q(:, i)*vp(:, i)
      end do
      do i = 1, ndof
         x = uq(:, i)
         y = up(:, i)
         uq(:, i) = w(:, 0)*(spring(self, i)*vq(:, i) + self%c*((mx*x + my*y)*vq(:, i) + dmx*y - dmy*x)/ndof &
                             + self%b*(dl*p(:, i) + l*vp(:, i))/ndof)
         up(:, i) = w(:, 0)*(vp(:, i) + self%b*(dl*q(:, i) + l*vq(:, i))/ndof)
      end do
   end subroutine hessian_vector

end module mean_field_model
