! SPDX-License-Identifier: BSD-3-Clause
!> The products of kicks by noises of phases, K_k = sum_i s_ki (q_i^2 + p_i^2)/2, between flows of a quadratic part D:
!>
!>    (1/2) sum_kl D_kl {K_k, {K_l, D}} = sum_bonds eps_b X_b,   eps_b = -(1/2) sum_kl D_kl d_kb d_lb,
!>    d_kb = s_ki - s_kj of hopping between i and j,   s_ki + s_kj of pairing
!>
!> is D itself with other strengths of its bonds X_b (base/bonds): those of one noise at each site are
!> -(1/2) (s_i^2 D_ii + s_j^2 D_jj -+ 2 s_i s_j D_ij), which is D of the one noise s_i W_i -+ s_j W_j. Half of it acts
!> before the drifts and kicks of a step and half after them, bond by bond, in the other order after them. With
!> psi = q + i p and theta = eps |c|/2 each flow is exact:
!>
!>    hopping   psi_i <- cos theta psi_i - i sin theta u psi_j,   psi_j <- cos theta psi_j - i sin theta conj(u) psi_i
!>    pairing   psi_i <- cosh theta psi_i - i sinh theta u conj(psi_j),   psi_j likewise         u = c/|c|
!>
!> in which sinh is its series and cosh the root of 1 + sinh^2, so that the flow is symplectic whatever theta is.
!>
!> s_ki is H_k,q_i/q_i at a point q_i = q, p = 0, by one gradient for each set of noises that touch no site together.
!>
!> Private to its family.
module symsde_step_splitting_bond_turns
   use symsde_base_bonds, only: bond_list, find_bonds
   use symsde_base_kinds, only: wp
   use symsde_base_sincos, only: sincos_lanes
   use symsde_base_supports, only: noise_colours, noise_pairs, sort_noises
   use symsde_base_traits, only: model_traits
   use symsde_base_vectors, only: add_times_each
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   implicit none
   private
   public :: bond_turns, new_bond_turns

   real(wp), parameter :: near = 2.0_wp**(-10)   !! q at which strengths are read, in the domain of most H

   type :: bond_turns
      private
      type(bond_list) :: bonds
      real(wp), allocatable :: size_of(:), u(:, :) !! |c|, and the two parts of c/|c| (n), (2, n)
      type(noise_colours) :: sets                  !! of noises that touch no site together
      integer, allocatable :: set_of(:)            !! of each noise; 0 = silent (nnoise)
      logical, allocatable :: touched(:, :)        !! whether a noise touches a site (ndof, nnoise)
      integer, allocatable :: from(:)              !! bond b has the products from(b) + 1 .. from(b+1) (n + 1)
      integer, allocatable :: k(:), l(:), column(:)  !! the noises k <= l of a product, and the column of D_kl
      real(wp), allocatable :: factor(:, :)        !! of each product in eps |c|/4 (nlane, products)
      real(wp), allocatable :: s(:, :, :)          !! strengths (nlane, ndof, sets)
      real(wp), allocatable, dimension(:, :) :: q, p, gq, gp  !! the point, and a gradient there (nlane, ndof)
      real(wp), allocatable :: w(:, :)             !! weights of a set of noises (nlane, 0:nnoise)
      integer :: shown = 0                         !! the set in w; 0 = none
      real(wp), allocatable, dimension(:, :) :: less, across  !! cos theta - 1, sin theta of bonds (nlane, n)
      real(wp), allocatable, dimension(:) :: half, sine, cosine  !! (nlane)
      logical :: is_read = .false.                 !! strengths are known, those of the time of a step
   contains
      procedure :: find_angles
      procedure :: turn
   end type bond_turns

contains

   !> Allocate for blocks of nlane lanes; D_kl is given for these pairs of noises, or only for k = l where it is the
   !> same for all.
   pure subroutine new_bond_turns(self, nlane, traits, noisy, pairs)
      type(bond_turns), intent(out) :: self
      integer, intent(in) :: nlane
      type(model_traits), intent(in) :: traits
      integer, intent(in) :: noisy(:)              !! the noises that are not silent
      type(noise_pairs), intent(in) :: pairs       !! not allocated: k = l alone
      integer :: b, k

      call find_bonds(traits%ndof, traits%quadratic_part, self%bonds)
      call sort_noises(traits%touches, noisy, traits%nnoise, traits%ndof, .false., 0, self%sets)
      associate (n => traits%ndof, m => traits%nnoise, nbond => self%bonds%n, sets => self%sets)
         self%size_of = sqrt(self%bonds%c(1, :)**2 + self%bonds%c(2, :)**2)
         self%u = self%bonds%c
         do b = 1, nbond
            self%u(:, b) = self%u(:, b)/self%size_of(b)
         end do
         allocate (self%set_of(m), source=0)
         do b = 1, sets%n
            self%set_of(sets%noise(sets%from(b) + 1:sets%from(b + 1))) = b
         end do
         allocate (self%touched(n, m), source=.not. traits%touches%are_given())
         if (traits%touches%are_given()) then
            do k = 1, m
               self%touched(traits%touches%dof(traits%touches%from(k) + 1:traits%touches%from(k + 1)), k) = .true.
            end do
         end if
         call find_products(self, noisy, pairs)
         allocate (self%factor(nlane, size(self%k)), self%gq(nlane, n), self%gp(nlane, n))
         allocate (self%s(nlane, n, sets%n), source=0.0_wp)
         allocate (self%q(nlane, n), source=near)
         allocate (self%p(nlane, n), self%w(nlane, 0:m), source=0.0_wp)
         allocate (self%less(nlane, nbond), self%across(nlane, nbond))
         allocate (self%half(nlane), self%sine(nlane), self%cosine(nlane))
      end associate
   end subroutine new_bond_turns

   !> The products of each bond: the pairs of noises that touch it together.
   pure subroutine find_products(self, noisy, pairs)
      type(bond_turns), intent(inout) :: self
      integer, intent(in) :: noisy(:)
      type(noise_pairs), intent(in) :: pairs
      integer, allocatable :: k(:), l(:)
      integer :: b, kl, pass, n

      if (allocated(pairs%k)) then
         k = pairs%k
         l = pairs%l
      else
         k = noisy
         l = noisy
      end if
      allocate (self%from(self%bonds%n + 1), source=0)
      do pass = 1, 2
         n = 0
         do b = 1, self%bonds%n
            do kl = 1, size(k)
               if (min(self%set_of(k(kl)), self%set_of(l(kl))) == 0) cycle
               if (.not. (touches(self, k(kl), b) .and. touches(self, l(kl), b))) cycle
               n = n + 1
               if (pass == 1) cycle
               self%k(n) = k(kl)
               self%l(n) = l(kl)
               self%column(n) = kl
            end do
            self%from(b + 1) = n
         end do
         if (pass == 1) allocate (self%k(n), self%l(n), self%column(n))
      end do
   end subroutine find_products

   !> Whether noise k touches bond b.
   pure logical function touches(self, k, b)
      type(bond_turns), intent(in) :: self
      integer, intent(in) :: k, b

      touches = self%touched(self%bonds%i(b), k) .or. self%touched(self%bonds%j(b), k)
   end function touches

   !> The angles of half of the products of a step with t at its middle, from D_kl of the pairs, or one number for all
   !> k = l.
   subroutine find_angles(self, ham, t, nlane, d, mean)
      class(bond_turns), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      real(wp), intent(in) :: t
      integer, intent(in) :: nlane
      real(wp), intent(in), optional :: d(:, :)    !! (nlane, pairs)
      real(wp), intent(in), optional :: mean
      integer :: b, e

      call read_strengths(self, ham, t, nlane)
      do b = 1, self%bonds%n
         self%half = 0
         do e = self%from(b) + 1, self%from(b + 1)
            if (present(d)) call add_times_each(nlane, 1, self%factor(:, e), d(:, self%column(e)), self%half)
            if (present(mean)) self%half = self%half + mean*self%factor(:, e)
         end do
         if (self%bonds%pairs(b)) then
            call stretch_of(nlane, self%half, self%less(:, b), self%across(:, b))
         else
            call sincos_lanes(nlane, self%half, self%sine, self%cosine)
            call angle_of(nlane, self%sine, self%cosine, self%less(:, b), self%across(:, b))
         end if
      end do
   end subroutine find_angles

   !> Read s_ki at the time t and, where they differ from those of the step before, form the factors of D_kl in eps
   !> |c|/4.
   subroutine read_strengths(self, ham, t, nlane)
      type(bond_turns), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      real(wp), intent(in) :: t
      integer, intent(in) :: nlane
      integer :: b, e, set
      logical :: differs

      differs = .not. self%is_read
      self%is_read = .true.
      associate (sets => self%sets)
         do set = 1, sets%n
            if (self%shown /= set) then
               self%w = 0
               self%w(:, sets%noise(sets%from(set) + 1:sets%from(set + 1))) = 1
               self%shown = set
            end if
            call ham%gradient(t, self%w, self%q, self%p, self%gq, self%gp)
            self%gq = self%gq/near
            if (all(abs(self%gq - self%s(:, :, set)) <= 0)) cycle
            self%s(:, :, set) = self%gq
            differs = .true.
         end do
      end associate
      if (.not. differs) return
      do b = 1, self%bonds%n
         do e = self%from(b) + 1, self%from(b + 1)
            call find_difference(self, self%k(e), b, self%sine)
            call find_difference(self, self%l(e), b, self%cosine)
            ! The terms kl and lk are one product.
            self%factor(:, e) = -merge(0.125_wp, 0.25_wp, self%k(e) == self%l(e))*self%size_of(b)* &
                                (self%sine*self%cosine)
         end do
      end do
   end subroutine read_strengths

   !> d_kb of noise k and bond b.
   pure subroutine find_difference(self, k, b, d)
      type(bond_turns), intent(in) :: self
      integer, intent(in) :: k, b
      real(wp), intent(out) :: d(:)

      associate (i => self%bonds%i(b), j => self%bonds%j(b), set => self%set_of(k))
         d = 0
         if (self%touched(i, k)) d = self%s(:, i, set)
         if (.not. self%touched(j, k)) return
         if (self%bonds%pairs(b)) then
            d = d + self%s(:, j, set)
         else
            d = d - self%s(:, j, set)
         end if
      end associate
   end subroutine find_difference

   !> Move (q + dq, p + dp) by half of the products, all bonds in their order or in the other one.
   subroutine turn(self, backward, nlane, ndof, q, p, dq, dp)
      class(bond_turns), intent(in) :: self
      logical, intent(in) :: backward
      integer, intent(in) :: nlane, ndof
      real(wp), intent(in), dimension(nlane, ndof) :: q, p
      real(wp), intent(inout), dimension(nlane, ndof) :: dq, dp
      integer :: at, b

      do at = 1, self%bonds%n
         b = merge(self%bonds%n + 1 - at, at, backward)
         associate (i => self%bonds%i(b), j => self%bonds%j(b), less => self%less(:, b), across => self%across(:, b), &
                    u => self%u(:, b))
            if (i == j) then
               call squeeze(nlane, u, less, across, q(:, i), p(:, i), dq(:, i), dp(:, i))
            else
               call couple(nlane, merge(-1.0_wp, 1.0_wp, self%bonds%pairs(b)), u, less, across, q(:, i), p(:, i), &
                           q(:, j), p(:, j), dq(:, i), dp(:, i), dq(:, j), dp(:, j))
            end if
         end associate
      end do
   end subroutine turn

   ! ---- kernels ----------------------------------------------------------------------------------
   ! Parentheses around second products allow only the first to be contracted, in one lane as in many.

   !> VEC cos theta - 1 and sin theta from sine and cosine of theta/2.
   pure subroutine angle_of(nlane, sine, cosine, less, across)
      integer, intent(in) :: nlane
      real(wp), intent(in), dimension(nlane) :: sine, cosine
      real(wp), intent(out), dimension(nlane) :: less, across
      integer :: lane

      do lane = 1, nlane
         less(lane) = -2*(sine(lane)*sine(lane))
         across(lane) = 2*(sine(lane)*cosine(lane))
      end do
   end subroutine angle_of

   !> VEC cosh theta - 1 and sinh theta from theta/2, by the series of sinh to theta^11: to rounding for |theta| < 0.5.
   !> Lanes of long steps, where it is larger, have the sinh of the library.
   pure subroutine stretch_of(nlane, half, less, across)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: half(nlane)
      real(wp), intent(out), dimension(nlane) :: less, across
      real(wp) :: x, y
      integer :: lane

      do lane = 1, nlane
         x = 4*(half(lane)*half(lane))
         y = 1 + x*(1/110.0_wp)
         y = 1 + x*y*(1/72.0_wp)
         y = 1 + x*y*(1/42.0_wp)
         y = 1 + x*y*(1/20.0_wp)
         y = 1 + x*y*(1/6.0_wp)
         y = 2*(half(lane)*y)
         across(lane) = y
         less(lane) = (y*y)/(1 + sqrt(1 + (y*y)))
      end do
      if (all(abs(half) < 0.25_wp)) return
      ! The sinh of vectors has other last bits where registers are wider.
      !GCC$ novector
      do lane = 1, nlane
         if (abs(half(lane)) < 0.25_wp) cycle
         y = sinh(2*half(lane))
         across(lane) = y
         less(lane) = (y*y)/(1 + sqrt(1 + (y*y)))
      end do
   end subroutine stretch_of

   !> VEC Hopping between two sites, (x, y) and (v, w): -i u (v + i w) and -i conj(u) (x + i y); or with sign = -1
   !> pairing, which is hopping to conj(psi_j): -i u (v - i w), and conj(i conj(u) (x + i y)) = -i u (x - i y).
   pure subroutine couple(nlane, sign, u, less, across, qi, pi, qj, pj, dqi, dpi, dqj, dpj)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: sign, u(2)
      real(wp), intent(in), dimension(nlane) :: less, across, qi, pi, qj, pj
      real(wp), intent(inout), dimension(nlane) :: dqi, dpi, dqj, dpj
      real(wp) :: a(2), x, y, v, w
      integer :: lane

      a = sign*u
      do lane = 1, nlane
         x = qi(lane) + dqi(lane)
         y = pi(lane) + dpi(lane)
         v = qj(lane) + dqj(lane)
         w = pj(lane) + dpj(lane)
         dqi(lane) = dqi(lane) + (less(lane)*x + (across(lane)*(u(2)*v + (a(1)*w))))
         dpi(lane) = dpi(lane) + (less(lane)*y + (across(lane)*(a(2)*w - (u(1)*v))))
         dqj(lane) = dqj(lane) + (less(lane)*v + (across(lane)*(a(1)*y - (a(2)*x))))
         dpj(lane) = dpj(lane) + (less(lane)*w - (across(lane)*(u(2)*y + (u(1)*x))))
      end do
   end subroutine couple

   !> VEC Squeezing of one site: -i u (x - i y).
   pure subroutine squeeze(nlane, u, less, across, q, p, dq, dp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: u(2)
      real(wp), intent(in), dimension(nlane) :: less, across, q, p
      real(wp), intent(inout), dimension(nlane) :: dq, dp
      real(wp) :: x, y
      integer :: lane

      do lane = 1, nlane
         x = q(lane) + dq(lane)
         y = p(lane) + dp(lane)
         dq(lane) = dq(lane) + (less(lane)*x + (across(lane)*(u(2)*x - (u(1)*y))))
         dp(lane) = dp(lane) + (less(lane)*y - (across(lane)*(u(2)*y + (u(1)*x))))
      end do
   end subroutine squeeze

end module symsde_step_splitting_bond_turns
