! SPDX-License-Identifier: BSD-3-Clause
!> Brackets of noises in position of a chain, from its rows (model/chain_rows). Where H_k depends on q alone and
!> H = p.p/2 + U(q), one sum F of noises that do not meet has the gradient (step/hamiltonian/brackets_exact)
!>
!>    (K r, s)     r = c p + e F_q,   s = c F_q,   K = Hess F,
!>
!> in which each degree of freedom i has one c_i. A gradient and a product would pass over the chain twice, and the
!> product over neighbours of sites as well; rows give F_q and the tridiagonal K at one pass,
!>
!>    (K r)_i = K_ii r_i + K_i,i+1 r_{i+1} + K_i-1,i r_{i-1},
!>
!> and K is diagonal where every noise touches a single degree of freedom.
!>
!> Private to its family.
module symsde_step_hamiltonian_noise_rows
   use symsde_base_kinds, only: wp
   use symsde_base_lane_paths, only: narrow, widen
   use symsde_base_traits, only: strip_lanes
   use symsde_model_abstract, only: model_type
   use symsde_model_kernels, only: kernel_model, kernel_offers, kernels_of, offers_of
   implicit none
   private
   public :: noise_rows, new_noise_rows

   !> The model and a strip of lanes: rows, and positions with a row of zeros at each end. A single path is a strip of
   !> one lane, if the model gives its rows with the same bits.
   type :: noise_rows
      class(kernel_model), pointer :: model => null()    !! null: the model gives no rows
      logical :: diagonal = .false.                      !! whether K is diagonal
      logical :: alone = .false.                         !! whether a strip is a single path
      integer, private :: width = strip_lanes            !! lanes of a strip
      integer, private :: chosen = 0                     !! the colour in w; 0 = none
      real(wp), allocatable, private :: w(:, :)          !! weights of F (width, 0:nnoise)
      real(wp), allocatable, private :: q(:, :)          !! (width, 0:ndof + 1)
      real(wp), allocatable, private :: f(:, :), k(:, :, :)  !! F_q (width, ndof); K_ii, K_i,i+1 (width, 0:1, ndof)
      real(wp), allocatable, private :: r(:, :)          !! (width, 0:ndof + 1); zero in the first and the last row
   contains
      procedure :: choose
      procedure :: add
   end type noise_rows

contains

   !> Rows of a model whose noises are noises in position, H = p.p/2 + U(q); none if the model does not give them.
   subroutine new_noise_rows(self, model, nlane)
      type(noise_rows), intent(inout) :: self
      class(model_type), intent(in), target :: model
      integer, intent(in) :: nlane
      type(kernel_offers) :: offers
      integer :: k

      offers = offers_of(model)
      if (.not. offers%rows) return
      self%model => kernels_of(model)
      self%alone = nlane == 1 .and. offers%rows_of_one
      if (self%alone) self%width = 1
      associate (n => model%traits%ndof, m => model%traits%nnoise, touches => model%traits%touches)
         if (touches%are_given()) self%diagonal = all([(touches%from(k + 1) - touches%from(k) <= 1, k=1, m)])
         allocate (self%w(self%width, 0:m), self%q(self%width, 0:n + 1), self%r(self%width, 0:n + 1), source=0.0_wp)
         allocate (self%f(self%width, n), self%k(self%width, 0:1, n))
      end associate
   end subroutine new_noise_rows

   !> F is the sum of the noises of a colour, with these weights, which are the same in all lanes.
   pure subroutine choose(self, colour, f)
      class(noise_rows), intent(inout) :: self
      integer, intent(in) :: colour
      real(wp), intent(in) :: f(:, 0:)  !! (nlane, 0:nnoise)
      integer :: j

      if (colour == self%chosen) return
      do j = 0, ubound(f, 2)
         self%w(:, j) = f(1, j)
      end do
      self%chosen = colour
   end subroutine choose

   !> Add K r to hq, and store s in hp, of nlane lanes, a strip at a time; the last lane is repeated to fill up the last
   !> strip.
   subroutine add(self, nlane, t, e, c, q, p, hq, hp)
      class(noise_rows), intent(inout) :: self
      integer, intent(in) :: nlane
      real(wp), intent(in) :: t, e
      real(wp), intent(in), dimension(nlane, size(self%f, 2)) :: c, q, p
      real(wp), intent(inout), dimension(nlane, size(self%f, 2)) :: hq, hp
      integer :: before, until, i

      associate (n => size(self%f, 2), m => ubound(self%w, 2), model => self%model)
         if (self%alone) then
            call model%force_stiffness(1, n, m, 1, t, self%w, q, p, self%f, self%k)
            call add_alone(n, self%diagonal, e, c, p, self%f, self%k, self%r, hq, hp)
            return
         end if
         do before = 0, nlane - 1, strip_lanes
            until = min(strip_lanes, nlane - before)
            do i = 1, n
               self%q(:until, i) = q(before + 1:before + until, i)
               self%q(until + 1:, i) = q(nlane, i)
            end do
            call narrow(model%paths, before + 1, strip_lanes)
            call model%chain_rows(n, m, 1, n, t, self%w, self%q, self%f, self%k)
            call widen(model%paths)
            call add_strip(nlane, n, before, until, self%diagonal, e, c, p, self%f, self%k, self%r, hq, hp)
         end do
      end associate
   end subroutine add

   ! ---- kernels: the same operations for a strip, lane by lane, and for a single path, row by row ------------------

   !> VEC r = c p + e f, hq = hq + K r and hp = c f in the lanes before + 1 .. before + until. Parentheses allow only
   !> the first product to be contracted.
   pure subroutine add_strip(nlane, n, before, until, diagonal, e, c, p, f, k, r, hq, hp)
      integer, intent(in) :: nlane, n, before, until
      logical, intent(in) :: diagonal
      real(wp), intent(in) :: e, c(nlane, n), p(nlane, n), f(strip_lanes, n), k(strip_lanes, 0:1, n)
      real(wp), intent(inout) :: r(strip_lanes, 0:n + 1), hq(nlane, n), hp(nlane, n)
      integer :: i, lane
      real(wp) :: x

      do i = 1, n
         do lane = 1, until
            x = c(before + lane, i)*p(before + lane, i) + (e*f(lane, i))
            hq(before + lane, i) = hq(before + lane, i) + k(lane, 0, i)*x
            hp(before + lane, i) = c(before + lane, i)*f(lane, i)
            if (.not. diagonal) r(lane, i) = x
         end do
      end do
      if (diagonal) return
      do i = 1, n
         do lane = 1, until
            hq(before + lane, i) = hq(before + lane, i) + k(lane, 1, i)*r(lane, i + 1)
            hq(before + lane, i) = hq(before + lane, i) + k(lane, 1, max(1, i - 1))*r(lane, i - 1)
         end do
      end do
   end subroutine add_strip

   !> VEC The same of a single path.
   pure subroutine add_alone(n, diagonal, e, c, p, f, k, r, hq, hp)
      integer, intent(in) :: n
      logical, intent(in) :: diagonal
      real(wp), intent(in) :: e, c(n), p(n), f(n), k(0:1, n)
      real(wp), intent(inout) :: r(0:n + 1), hq(n), hp(n)
      integer :: i

      do i = 1, n
         r(i) = c(i)*p(i) + (e*f(i))
         hq(i) = hq(i) + k(0, i)*r(i)
         hp(i) = c(i)*f(i)
      end do
      if (diagonal) return
      do i = 1, n
         hq(i) = hq(i) + k(1, i)*r(i + 1)
         hq(i) = hq(i) + k(1, max(1, i - 1))*r(i - 1)
      end do
   end subroutine add_alone

end module symsde_step_hamiltonian_noise_rows
