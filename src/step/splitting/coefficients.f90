! SPDX-License-Identifier: BSD-3-Clause
!> The weights of the Hamiltonians in the kicks of a step (symsde_scheme_kicks derives them). With
!> a_k = dZ_k/h - dW_k/2, the space-time-time area K_k and kappa = sum_i kappa_i,
!>
!>    w_i0 = b_i h,   w_ik = beta_i dW_k + gamma_i a_k + eta_i K_k,      v_0 = h,   v_k = dW_k + zeta K_k
!>    D_kl = h [ sum_{i<j} (c_j - c_i) (w_ik w_jl + w_il w_jk)/2 - 2 kappa v_k v_l ] - J_kl      where J is sampled
!>
!> Of a model damped by one rate beta, gamma and eta of the first kick and the last one change with gamma h, and nothing
!> else does (step/open/kick_law); or they get a further term, delta_i D_k/h, D_k being the noise of free motion along
!> the path. Unequal rates, a matrix and rotations keep the coefficients of the closed system; constant
!> noise gets its law at the end of the step (step/open/linear_noise).
!>
!> w_ik multiplies H_k in kick i, V = h U + sum_k v_k H_k is the sum squared by force-gradient kicks, and D_kl
!> multiplies the products H_k,q.M^-1 H_l,q. If J is not sampled, D = c h |h| delta_kl is known, and d is not filled.
!> The w_i0 and v_0 depend on the size of the step alone.
!>
!> Lanes are the paths of a block, or the next steps of a single path.
!>
!> Order of weighing a step: the weights of H if h has changed; then, noise by noise, a_k, all w_ik and v_k; and last
!> D_kl, which depends on the w and v of all noises.
!>
!> In a sum of two products the compiler might contract either one, and a single path would differ in its bits from a
!> path of a block. Parentheses around the second product allow only the first one to be contracted.
module symsde_step_splitting_coefficients
   use symsde_base_damping, only: damping_type, noise_of_scheme, noise_polynomial
   use symsde_base_functionals, only: path_dz, path_stt_area, path_magnus, path_decay
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: step_record
   use symsde_base_supports, only: noise_colours, noise_pairs, sort_noises, all_pairs
   use symsde_base_traits, only: model_traits
   use symsde_base_vectors, only: add_times, scale
   use symsde_scheme_kicks, only: kicks_type, mean_coefficient, flow_free
   use symsde_scheme_words, only: give_word_law
   use symsde_step_open_kick_law, only: give_law
   implicit none
   private
   public :: kick_weights, new_kick_weights, add_product

   !> The coefficients of a scheme of kicks, and the weights of the step that was weighed last.
   type :: kick_weights
      type(kicks_type) :: kicks
      logical :: products = .false.            !! whether noises are nonlinear, so that H_k,q . H_l,q matters
      logical, allocatable :: has_products(:)  !! kicks with more terms than the gradient of one sum (nkick)
      logical, allocatable :: multiplies(:)    !! kicks with products of the noises' gradients (nkick)
      real(wp) :: c = 0                        !! c in the mean form, D_kl = c h |h| delta_kl
      integer, allocatable :: noisy(:)         !! the noises that are not silent
      type(noise_colours) :: colours           !! the same in colours, as base/supports says
      integer, allocatable :: at(:, :)         !! column of D_kl in d, for the k of a colour that meets l; 0 = none
      !! (nnoise, colours%n)
      real(wp), allocatable :: w(:, :, :)      !! w_ik, w_i0 = b_i h (nlane, 0:nnoise, nkick)
      real(wp), allocatable :: v(:, :)         !! weights of V (nlane, 0:nnoise)
      real(wp), allocatable :: d(:, :)         !! D_kl of the pairs (nlane, size(pairs%k))
      type(noise_pairs) :: pairs               !! those that meet
      logical, private :: by_sums = .false.    !! whether some kick uses V
      logical, private :: uses_dz = .false.
      type(damping_type) :: damping
      integer :: damping_noise = noise_of_scheme  !! of the enumerators of base/damping
      type(kicks_type) :: closed               !! the coefficients without damping
      real(wp), private :: rate = 0            !! gamma of all degrees of freedom, if the noise has its exact law
      integer, private :: nlane = 0, nnoise = 0
      real(wp), private :: h = 0                   !! the step for which w_i0 and v_0 were computed
      real(wp), private, allocatable :: a(:)       !! a_k of one noise (nlane)
   contains
      procedure :: weigh
   end type kick_weights

contains

   !> Allocate for blocks of nlane lanes, and find the weights that matter to these kicks and this model. Additive
   !> noises have constant gradients, whose products have no effect unless forces go with them.
   subroutine new_kick_weights(self, kicks, traits, damping, damping_noise, nlane)
      type(kick_weights), intent(out) :: self
      type(kicks_type), intent(in) :: kicks
      type(model_traits), intent(in) :: traits
      type(damping_type), intent(in) :: damping
      integer, intent(in) :: damping_noise   !! of the enumerators of base/damping
      integer, intent(in) :: nlane
      integer :: k

      self%kicks = kicks
      self%c = mean_coefficient(kicks)
      self%nlane = nlane
      self%nnoise = traits%nnoise
      self%noisy = [(k, k=1, traits%nnoise)]
      if (allocated(traits%silent)) self%noisy = pack(self%noisy, .not. traits%silent)
      call sort_noises(traits%tied_supports(), self%noisy, traits%nnoise, traits%ndof, kicks%samples, 0, self%colours)
      self%products = size(self%noisy) > 0 .and. .not. traits%noise_is_constant()
      ! Kicks with kappa use V, and D of the sampled form uses its weights.
      self%by_sums = any(abs(kicks%kappa) > 0) .or. kicks%samples
      self%uses_dz = kicks%uses_dz()
      self%closed = kicks
      self%damping = damping
      self%damping_noise = damping_noise
      if (damping%acts() .and. damping%is_scalar() .and. kicks%flow == flow_free .and. &
          damping_noise /= noise_polynomial .and. (kicks%is_word() .or. self%uses_dz .and. &
                                                   .not. allocated(traits%quadratic_part))) self%rate = damping%rate(1)
      ! D multiplies products in kicks with a nonzero share; in the mean form it vanishes if c does.
      self%multiplies = self%products .and. abs(kicks%share) > 0 .and. (kicks%samples .or. abs(self%c) > 0)
      self%has_products = abs(kicks%kappa) > 0 .or. self%multiplies
      allocate (self%w(nlane, 0:self%nnoise, size(kicks%c)), self%v(nlane, 0:self%nnoise), self%a(nlane), source=0.0_wp)
      if (.not. (self%products .and. kicks%samples)) return
      call traits%find_meetings(self%pairs)
      if (.not. allocated(self%pairs%k)) call all_pairs(self%nnoise, self%pairs)
      allocate (self%d(nlane, size(self%pairs%k)), source=0.0_wp)
      call find_columns(self)
   end subroutine new_kick_weights

   !> For each colour and each noise l the column of D_kl, where k is the noise of this colour that meets l.
   pure subroutine find_columns(self)
      type(kick_weights), intent(inout) :: self
      integer :: colour_of(self%nnoise)
      integer :: c, kl

      colour_of = 0
      do c = 1, self%colours%n
         colour_of(self%colours%noise(self%colours%from(c) + 1:self%colours%from(c + 1))) = c
      end do
      allocate (self%at(self%nnoise, self%colours%n), source=0)
      do kl = 1, size(self%pairs%k)
         associate (k => self%pairs%k(kl), l => self%pairs%l(kl))
            ! A silent noise has no colour.
            if (min(colour_of(k), colour_of(l)) == 0) cycle
            self%at(l, colour_of(k)) = kl
            self%at(k, colour_of(l)) = kl
         end associate
      end do
   end subroutine find_columns

   !> Compute the weights of every kick, of V, and D, in the first nlane lanes, from the functionals of the step.
   !> Weights of silent noises keep their initial value zero.
   subroutine weigh(self, nlane, step)
      class(kick_weights), intent(inout) :: self
      integer, intent(in) :: nlane
      type(step_record), intent(in) :: step
      integer :: i, j

      associate (kicks => self%kicks)
         if (abs(step%h - self%h) > 0) then
            ! The weight of H is h in all lanes, since steps that are weighed together have the same h.
            self%h = step%h
            if (abs(self%rate) > 0 .and. kicks%is_word()) then
               call give_word_law(self%kicks, self%closed, self%rate*step%h)
            else if (abs(self%rate) > 0) then
               call give_law(self%kicks, self%closed, self%rate*step%h, self%damping_noise)
            end if
            self%v(:, 0) = step%h
            do i = 1, size(kicks%c)
               self%w(:, 0, i) = kicks%b(i)*step%h
            end do
         end if
         do j = 1, size(self%noisy)
            call weigh_noise(self, nlane, self%noisy(j), step)
         end do
         if (.not. allocated(self%d)) return
         call find_d(self, nlane, step)
      end associate
   end subroutine weigh

   !> The weights w_ik of noise k in every kick i, and v_k. If no K drives the step, zeta and eta are not used.
   subroutine weigh_noise(self, nlane, k, step)
      type(kick_weights), intent(inout) :: self
      integer, intent(in) :: nlane, k
      type(step_record), intent(in) :: step
      integer :: i

      associate (kicks => self%kicks, w => step%w)
         ! a_k = dZ_k/h - dW_k/2 is independent of dW_k, of variance |h|/12.
         if (self%uses_dz) self%a(:nlane) = step%of(path_dz)%x(:nlane, k)/step%h - 0.5_wp*w(:nlane, k)
         do i = 1, size(kicks%c)
            ! w_ik = beta_i dW_k + gamma_i a_k; eta_i K_k is added below.
            if (abs(kicks%gamma(i)) > 0) then
               self%w(:nlane, k, i) = kicks%beta(i)*w(:nlane, k) + (kicks%gamma(i)*self%a(:nlane))
            else
               call scale(nlane, kicks%beta(i), w(:, k), self%w(1, k, i))
            end if
         end do
         ! v_k = dW_k, to which zeta K_k is added below.
         if (self%by_sums) call scale(nlane, 1.0_wp, w(:, k), self%v(1, k))
         ! Without K the step has no further terms.
         if (.not. associated(step%of(path_stt_area)%x)) return
         associate (stt_area => step%of(path_stt_area)%x)
            if (self%by_sums) call add_times(nlane, kicks%zeta, stt_area(:, k), self%v(1, k))
            do i = 1, size(kicks%c)
               call add_times(nlane, kicks%eta(i), stt_area(:, k), self%w(1, k, i))
            end do
         end associate
         if (.not. associated(step%of(path_decay)%x)) return
         do i = 1, size(kicks%c)
            call add_times(nlane, kicks%delta(i)/step%h, step%of(path_decay)%x(:, k), self%w(1, k, i))
         end do
      end associate
   end subroutine weigh_noise

   !> D_kl of the sampled form, for the pairs k <= l that meet: the second Magnus term of the kicks minus J_kl. The sum
   !> over pairs of kicks is symmetrised in k and l, since only the symmetric part matters for the product of gradients.
   subroutine find_d(self, nlane, step)
      class(kick_weights), intent(inout) :: self
      integer, intent(in) :: nlane
      type(step_record), intent(in) :: step
      real(wp) :: kappa
      integer :: i, j, kl

      ! The force-gradient kicks already contain the products with kappa h v_k v_l. D has the factor 1/2, so twice these
      ! products are subtracted from D.
      kappa = sum(self%kicks%kappa)
      associate (c => self%kicks%c, w => self%w, v => self%v, d => self%d)
         do kl = 1, size(self%pairs%k)
            associate (k => self%pairs%k(kl), l => self%pairs%l(kl))
               ! Products are added from zero, one after the other: in a sum of two the compiler might fuse either one.
               d(:nlane, kl) = 0
               if (abs(kappa) > 0) call add_product(nlane, -2*kappa, v(:, k), v(:, l), d(:, kl))
               do j = 2, size(c)
                  do i = 1, j - 1
                     call add_product(nlane, 0.5_wp*(c(j) - c(i)), w(:, k, i), w(:, l, j), d(:, kl))
                     call add_product(nlane, 0.5_wp*(c(j) - c(i)), w(:, l, i), w(:, k, j), d(:, kl))
                  end do
               end do
               d(:nlane, kl) = step%h*d(:nlane, kl) - step%of(path_magnus)%x(:nlane, kl)
            end associate
         end do
      end associate
   end subroutine find_d

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC f = f + factor x y, lane by lane. Parentheses allow only the addition to be contracted.
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
