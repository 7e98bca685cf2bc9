! SPDX-License-Identifier: BSD-3-Clause
!> What the kicks of a step weigh the Hamiltonians with: w_ik with b_i h in front, those of V, and D_kl of the sampled
!> form (symsde_scheme_kicks). Lanes are the paths of a block, or steps that a path by itself has ahead.
!>
!> Of a sum of two products the first is contracted: parentheses around the other say so, or a path by itself would have
!> other bits than one of a block.
!>
!> Private to its family.
module symsde_step_splitting_coefficients
   use symsde_base_functionals, only: path_dz, path_stt_area, path_magnus, pair_index
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: step_record
   use symsde_base_traits, only: model_traits
   use symsde_base_vectors, only: add_times, scale
   use symsde_scheme_kicks, only: kicks_type, mean_coefficient
   implicit none
   private
   public :: kick_weights, new_kick_weights

   type :: kick_weights
      type(kicks_type) :: kicks
      logical :: products = .false.            !! noises are not linear: H_k,q . H_l,q matters
      logical, allocatable :: has_products(:)  !! kicks that have parts beside the gradient of one sum (nkick)
      logical, allocatable :: multiplies(:)    !! of these, kicks with products of gradients of the noises (nkick)
      real(wp) :: c = 0                        !! of the mean form
      integer, allocatable :: noisy(:)         !! the noises that are not silent
      integer, allocatable :: at(:, :)           !! pair_index in any order (nnoise, nnoise)
      real(wp), allocatable :: w(:, :, :)      !! w_ik with b_i h in front (nlane, 0:nnoise, nkick)
      real(wp), allocatable :: v(:, :)         !! weights of V (nlane, 0:nnoise)
      real(wp), allocatable :: d(:, :)         !! D_kl at pair_index (nlane, nnoise(nnoise+1)/2)
      logical, private :: by_sums = .false.    !! kicks ask for V
      logical, private :: uses_dz = .false.
      integer, private :: nlane = 0, nnoise = 0
      real(wp), private :: h = 0                   !! that the weights of H belong to
      real(wp), private, allocatable :: a(:)       !! a_k of one noise (nlane)
      real(wp), private, allocatable :: s(:), u(:) !! sums of H_j' and H_j'' (nlane)
   contains
      procedure :: weigh
      procedure :: join
      procedure :: join_alone
   end type kick_weights

contains

   !> For blocks of nlane lanes.
   subroutine new_kick_weights(self, kicks, traits, nlane)
      type(kick_weights), intent(out) :: self
      type(kicks_type), intent(in) :: kicks
      type(model_traits), intent(in) :: traits
      integer, intent(in) :: nlane
      integer :: k, l

      self%kicks = kicks
      self%c = mean_coefficient(kicks)
      self%nlane = nlane
      self%nnoise = traits%nnoise
      self%noisy = [(k, k=1, traits%nnoise)]
      if (allocated(traits%silent)) self%noisy = pack(self%noisy, .not. traits%silent)
      self%products = size(self%noisy) > 0 .and. .not. traits%additive
      self%by_sums = any(abs(kicks%kappa) > 0) .or. kicks%samples
      self%uses_dz = kicks%uses_dz()
      self%multiplies = self%products .and. abs(kicks%share) > 0 .and. (kicks%samples .or. abs(self%c) > 0)
      self%has_products = abs(kicks%kappa) > 0 .or. self%multiplies
      allocate (self%w(nlane, 0:self%nnoise, size(kicks%c)), self%v(nlane, 0:self%nnoise), self%a(nlane), source=0.0_wp)
      allocate (self%s(nlane), self%u(nlane))
      if (.not. self%products) return
      allocate (self%d(nlane, pair_index(self%nnoise, self%nnoise)), source=0.0_wp)
      allocate (self%at(self%nnoise, self%nnoise))
      do k = 1, self%nnoise
         self%at(:, k) = [(pair_index(min(k, l), max(k, l)), l=1, self%nnoise)]
      end do
   end subroutine new_kick_weights

   !> The weights of every kick, of V, and D, of as many lanes.
   subroutine weigh(self, nlane, step)
      class(kick_weights), intent(inout) :: self
      integer, intent(in) :: nlane
      type(step_record), intent(in) :: step
      integer :: i, j

      associate (kicks => self%kicks)
         if (abs(step%h - self%h) > 0) then
            self%h = step%h
            self%v(:, 0) = step%h
            do i = 1, size(kicks%c)
               self%w(:, 0, i) = kicks%b(i)*step%h
            end do
         end if
         do j = 1, size(self%noisy)
            call weigh_noise(self, nlane, self%noisy(j), step)
         end do
         if (.not. (self%products .and. kicks%samples)) return
         call find_d(self, nlane, step)
      end associate
   end subroutine weigh

   !> The weights of noise k.
   subroutine weigh_noise(self, nlane, k, step)
      type(kick_weights), intent(inout) :: self
      integer, intent(in) :: nlane, k
      type(step_record), intent(in) :: step
      integer :: i

      associate (kicks => self%kicks, w => step%w)
         if (self%uses_dz) call find_a(nlane, step%h, w(:, k), step%of(path_dz)%x(:, k), self%a)
         do i = 1, size(kicks%c)
            if (abs(kicks%gamma(i)) > 0) then
               call sum_of_two(nlane, kicks%beta(i), w(:, k), kicks%gamma(i), self%a, self%w(1, k, i))
            else
               call scale(nlane, kicks%beta(i), w(:, k), self%w(1, k, i))
            end if
         end do
         if (self%by_sums) call scale(nlane, 1.0_wp, w(:, k), self%v(1, k))
         if (.not. associated(step%of(path_stt_area)%x)) return
         associate (stt_area => step%of(path_stt_area)%x)
            if (self%by_sums) call add_times(nlane, kicks%zeta, stt_area(:, k), self%v(1, k))
            do i = 1, size(kicks%c)
               call add_times(nlane, kicks%eta(i), stt_area(:, k), self%w(1, k, i))
            end do
         end associate
      end associate
   end subroutine weigh_noise

   !> D_kl of the sampled form.
   subroutine find_d(self, nlane, step)
      type(kick_weights), intent(inout) :: self
      integer, intent(in) :: nlane
      type(step_record), intent(in) :: step
      real(wp) :: kappa
      integer :: i, j, k, l, kl

      kappa = sum(self%kicks%kappa)
      associate (c => self%kicks%c, w => self%w, v => self%v, d => self%d)
         do l = 1, self%nnoise
            do k = 1, l
               kl = pair_index(k, l)
               ! from zero, one product after the other: of a sum of two products either one may be fused
               d(:nlane, kl) = 0
               call add_product(nlane, -2*kappa, v(:, k), v(:, l), d(:, kl))
               do j = 2, size(c)
                  do i = 1, j - 1
                     call add_product(nlane, 0.5_wp*(c(j) - c(i)), w(:, k, i), w(:, l, j), d(:, kl))
                     call add_product(nlane, 0.5_wp*(c(j) - c(i)), w(:, l, i), w(:, k, j), d(:, kl))
                  end do
               end do
               d(:nlane, kl) = step%h*d(:nlane, kl) - step%of(path_magnus)%x(:nlane, kl)
            end do
         end do
      end associate
   end subroutine find_d

   !> f of kick i with one degree of freedom, from H_j' and H_j'' at the point.
   subroutine join(self, i, h, slope, curvature, f)
      class(kick_weights), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: h
      real(wp), intent(in) :: slope(self%nlane, 0:self%nnoise), curvature(self%nlane, 0:self%nnoise)
      real(wp), intent(out) :: f(self%nlane)
      integer :: j, k, l

      associate (n => self%nlane, m => self%nnoise, kicks => self%kicks, noisy => self%noisy)
         call weighted_sum(n, m, self%w(:, :, i), slope, f)
         if (abs(kicks%kappa(i)) > 0) then
            call weighted_sum(n, m, self%v, slope, self%s)
            call weighted_sum(n, m, self%v, curvature, self%u)
            call add_product(n, 2*kicks%kappa(i)*h, self%s, self%u, f)
         end if
         if (.not. self%multiplies(i)) return
         do j = 1, size(noisy)
            k = noisy(j)
            if (.not. kicks%samples) then
               call add_product(n, kicks%share(i)*self%c*h*abs(h), slope(:, k), curvature(:, k), f)
               cycle
            end if
            self%s = 0
            do l = 1, size(noisy)
               call add_each(n, self%d(:, self%at(k, noisy(l))), slope(:, noisy(l)), self%s)
            end do
            call add_product(n, kicks%share(i), self%s, curvature(:, k), f)
         end do
      end associate
   end subroutine join

   !> The same of one lane, by numbers. Parentheses keep the first product of a sum from being contracted with the next,
   !> and gcc contracts none of sums that it takes by vectors, or that two branches end in.
   pure real(wp) function join_alone(self, lane, i, h, w, slope, curvature) result(f)
      class(kick_weights), intent(in) :: self
      integer, intent(in) :: lane, i
      real(wp), intent(in) :: h, w(0:self%nnoise)  !! the weights of the kick
      real(wp), intent(in) :: slope(0:self%nnoise), curvature(0:self%nnoise)
      real(wp) :: s, u
      integer :: j, k, l

      associate (kicks => self%kicks, noisy => self%noisy, v => self%v)
         f = (w(0)*slope(0))
         !GCC$ novector
         do j = 1, self%nnoise
            f = f + w(j)*slope(j)
         end do
         if (abs(kicks%kappa(i)) > 0) then
            s = (v(lane, 0)*slope(0))
            u = (v(lane, 0)*curvature(0))
            !GCC$ novector
            do j = 1, self%nnoise
               s = s + v(lane, j)*slope(j)
               u = u + v(lane, j)*curvature(j)
            end do
            f = f + 2*kicks%kappa(i)*h*(s*u)
         end if
         if (.not. self%multiplies(i)) return
         if (kicks%samples) then
            do j = 1, size(noisy)
               k = noisy(j)
               s = (self%d(lane, self%at(k, noisy(1)))*slope(noisy(1)))
               !GCC$ novector
               do l = 2, size(noisy)
                  s = s + self%d(lane, self%at(k, noisy(l)))*slope(noisy(l))
               end do
               f = f + kicks%share(i)*(s*curvature(k))
            end do
         else
            !GCC$ novector
            do j = 1, size(noisy)
               f = f + kicks%share(i)*self%c*h*abs(h)*(slope(noisy(j))*curvature(noisy(j)))
            end do
         end if
      end associate
   end function join_alone

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC a = dZ/h - dW/2
   pure subroutine find_a(nlane, h, dw, dz, a)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: h, dw(nlane), dz(nlane)
      real(wp), intent(out) :: a(nlane)
      integer :: lane

      do lane = 1, nlane
         a(lane) = dz(lane)/h - 0.5_wp*dw(lane)
      end do
   end subroutine find_a

   !> VEC total = b x + c y
   pure subroutine sum_of_two(nlane, b, x, c, y, total)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: b, x(nlane), c, y(nlane)
      real(wp), intent(out) :: total(nlane)
      integer :: lane

      do lane = 1, nlane
         total(lane) = b*x(lane) + (c*y(lane))
      end do
   end subroutine sum_of_two

   !> VEC total = sum_j weight_j x_j
   pure subroutine weighted_sum(nlane, m, weight, x, total)
      integer, intent(in) :: nlane, m
      real(wp), intent(in) :: weight(nlane, 0:m), x(nlane, 0:m)
      real(wp), intent(out) :: total(nlane)
      integer :: lane, j

      total = 0
      do j = 0, m
         do lane = 1, nlane
            total(lane) = total(lane) + weight(lane, j)*x(lane, j)
         end do
      end do
   end subroutine weighted_sum

   !> VEC f = f + x y; with a factor of one the product below may be rounded or not.
   pure subroutine add_each(nlane, x, y, f)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: x(nlane), y(nlane)
      real(wp), intent(inout) :: f(nlane)
      integer :: lane

      do lane = 1, nlane
         f(lane) = f(lane) + x(lane)*y(lane)
      end do
   end subroutine add_each

   !> VEC f = f + factor x y
   pure subroutine add_product(nlane, factor, x, y, f)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: factor, x(nlane), y(nlane)
      real(wp), intent(inout) :: f(nlane)
      integer :: lane

      do lane = 1, nlane
         f(lane) = f(lane) + factor*(x(lane)*y(lane))
      end do
   end subroutine add_product

end module symsde_step_splitting_coefficients
