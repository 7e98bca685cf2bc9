! SPDX-License-Identifier: BSD-3-Clause
!>    H = sum_i p_i^2/2 + sum_{i=0}^{n} (r_i^2/2 + beta r_i^4/4),   r_i = q_{i+1} - q_i,  q_0 = q_{n+1} = 0
!>    H_k = -sigma q_k,   k = 1 .. n
!>    dp_i = (f(r_i) - f(r_{i-1})) dt + sigma dW_i,   dq_i = p_i dt,   f(r) = r + beta r^3
!>
!> The Fermi-Pasta-Ulam chain (beta model) between fixed ends, with an additive noise on every momentum. E H = H_0 + n
!> sigma^2 t/2: every noise adds sigma^2/2 per unit of time. Without beta H is quadratic, with the frequencies 2 sin(pi
!> k/(2 n + 2)), all below 2. The units are the mass and the stiffness of a spring.
!>
!> The cost of every operation except the dense Hessian is proportional to n.
module symsde_model_catalogue_fpu_chain
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_maps, only: step_map
   use symsde_base_record, only: steps_record
   use symsde_base_status, only: error_type, raise, invalid_argument
   use symsde_base_text, only: name_length, to_text
   use symsde_base_traits, only: model_traits, strip_lanes
   use symsde_model_flows_fpu_chain, only: fpu_chain_flow, fpu_chain_has_flow
   use symsde_model_kernels, only: kernel_model, kernel_offers
   use symsde_model_parameters, only: require_finite, is_zero, largest_system
   implicit none
   private
   public :: fpu_chain_model, new_fpu_chain, fpu_chain_names, fpu_chain_defaults

   character(*), parameter :: fpu_chain_names(3) = &
                              [character(len=name_length) :: 'n', 'beta', 'sigma']
   real(wp), parameter :: fpu_chain_defaults(3) = [32.0_wp, 1.0_wp, 0.1_wp]

   integer, parameter :: few_sites = 12  !! most sites of a single path that is computed spring by spring

   type, extends(kernel_model) :: fpu_chain_model
      private
      real(wp) :: beta = 0   !! strength of the quartic term
      real(wp) :: sigma = 0  !! intensity of the noises
   contains
      procedure :: value => weighted_value
      procedure :: gradient
      procedure :: hessian
      procedure :: hessian_banded
      procedure :: chain_rows
      procedure :: force_stiffness
      procedure :: hessian_vector
      procedure :: pair
      procedure :: has_flow
      procedure :: flow
   end type fpu_chain_model

contains

   !> Make a chain of n masses. Refuses parameters that are not finite and n outside 1 .. 2^20 (invalid_argument).
   subroutine new_fpu_chain(self, n, beta, sigma, error)
      type(fpu_chain_model), intent(out) :: self
      integer, intent(in) :: n       !! number of masses
      real(wp), intent(in) :: beta   !! strength of the quartic term [1/length^2]
      real(wp), intent(in) :: sigma  !! intensity of the noise of every momentum [1/sqrt(time)]
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) return
      call require_finite('new_fpu_chain', 'beta', beta, error)
      call require_finite('new_fpu_chain', 'sigma', sigma, error)
      if (n < 1 .or. n > largest_system) &
         call raise(error, invalid_argument, 'new_fpu_chain', 'parameter n is '//to_text(n)// &
                    '; give a number of masses from 1 to '//to_text(largest_system))
      if (allocated(error)) return
      self%beta = beta
      self%sigma = sigma
      self%name = 'fpu_chain'
      ! The Hessian is tridiagonal; with one mass its bandwidth is zero. The frequencies are bounded only if beta = 0.
      self%traits = model_traits( &
                    ndof=n, nnoise=n, separable=.true., additive=.true., position_noise=.true., autonomous=.true., &
                    quadratic=is_zero(beta), identity_mass=.true., bandwidth=min(1, n - 1), &
                    has_value=.true., has_hessian=.true., has_hessian_vector=.true., &
                    max_frequency=merge(2.0_wp, 0.0_wp, is_zero(beta)))
      self%offers = kernel_offers(rows=.true., rows_of_one=.true., pair=n == 2)
      allocate (self%traits%silent(n), source=is_zero(sigma))  ! all noises have the same strength
   end subroutine new_fpu_chain

   !> Value of sum_j w_j H_j.
   subroutine weighted_value(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(fpu_chain_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)
      real(wp) :: r(nlane), beta, sigma
      integer :: i

      beta = self%beta
      sigma = self%sigma
      value = 0
      do i = 0, ndof
         call stretch(nlane, ndof, i, q, r)
         !   S = w_0 (sum_i p_i^2/2 + sum_i (r_i^2/2 + beta r_i^4/4)) - sigma sum_k w_k q_k
         value = value + r**2/2 + beta*r**4/4
      end do
      do i = 1, ndof
         value = value + p(:, i)**2/2
      end do
      value = w(:, 0)*value
      do i = 1, ndof
         value = value - sigma*w(:, i)*q(:, i)
      end do
   end subroutine weighted_value

   !> Gradient of sum_j w_j H_j: the difference of the forces r + beta r^3 of neighbouring springs.
   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(fpu_chain_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      integer :: i

      ! S_qi = w_0 (f(r_{i-1}) - f(r_i)) - sigma w_i,   f(r) = r + beta r^3,   S_p = w_0 p
      ! Three loops compute S_q with the same bits: by masses for a short single path, by springs for a long single
      ! path, by lanes for blocks.
      if (present(hq) .and. nlane == 1 .and. ndof <= few_sites) then
         call gradient_few(ndof, self%beta, self%sigma, w, q, hq)
      else if (present(hq) .and. nlane == 1) then
         call gradient_alone(ndof, self%beta, self%sigma, w, q, hq)
      else if (present(hq)) then
         call gradient_lanes(nlane, ndof, self%beta, self%sigma, w, q, hq)
      end if
      ! In a single path neighbouring masses are adjacent in memory, in a block neighbouring lanes.
      if (present(hp) .and. nlane == 1) then
         call velocity_alone(ndof, w(1, 0), p, hp)
      else if (present(hp)) then
         do i = 1, ndof
            hp(:, i) = w(:, 0)*p(:, i)
         end do
      end if
   end subroutine gradient

   !> All rows of a block, one after the other: hq_i = w_0 (f(r_{i-1}) - f(r_i)) - sigma w_i in every lane; each f is
   !> computed once and passed on.
   subroutine gradient_lanes(nlane, n, beta, sigma, w, q, hq)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: beta, sigma, w(nlane, 0:n), q(nlane, n)
      real(wp), intent(out) :: hq(nlane, n)
      real(wp) :: force(nlane), wall(nlane)  ! work space of a block; a single path does not use it
      integer :: i

      wall = 0
      ! The first spring is at the left end, r_0 = q_1; the wall is a mass at rest after the last one.
      force = q(:, 1)*(1 + beta*q(:, 1)**2)
      do i = 1, n - 1
         call gradient_row(nlane, beta, sigma, w, w(1, i), q(1, i), q(1, i + 1), force, hq(1, i))
      end do
      call gradient_row(nlane, beta, sigma, w, w(1, n), q(1, n), wall, force, hq(1, n))
   end subroutine gradient_lanes

   !> hp = w_0 p of one lane; masses are adjacent in memory.
   pure subroutine velocity_alone(n, weight, p, hp)
      integer, intent(in) :: n
      real(wp), intent(in) :: weight, p(n)
      real(wp), intent(out) :: hp(n)

      hp = weight*p
   end subroutine velocity_alone

   !> A short single chain, spring by spring: vector loads would have to wait for numbers that were stored one by one.
   pure subroutine gradient_few(n, beta, sigma, w, q, hq)
      integer, intent(in) :: n
      real(wp), intent(in) :: beta, sigma, w(0:n), q(n)
      real(wp), intent(out) :: hq(n)
      real(wp) :: r, force, next_force
      integer :: i

      force = q(1)*(1 + beta*q(1)**2)
      !GCC$ novector
      do i = 1, n - 1
         ! The force of the spring after mass i acts on mass i and, with the opposite sign, on mass i + 1.
         r = q(i + 1) - q(i)
         next_force = (r*(1 + beta*r**2))
         hq(i) = w(0)*(force - next_force) - (sigma*w(i))
         force = next_force
      end do
      r = 0 - q(n)
      next_force = (r*(1 + beta*r**2))
      hq(n) = w(0)*(force - next_force) - (sigma*w(n))
   end subroutine gradient_few

   !> VEC All rows of one lane; springs are adjacent in memory. Two loops, over springs and then over masses, have no
   !> operation that depends on the one before; tiles keep the forces in cache.
   pure subroutine gradient_alone(n, beta, sigma, w, q, hq)
      integer, intent(in) :: n
      real(wp), intent(in) :: beta, sigma, w(0:n), q(n)
      real(wp), intent(out) :: hq(n)
      integer, parameter :: tile = 64
      real(wp) :: force(0:tile), r, weight
      integer :: first, last, i

      weight = w(0)
      ! force(i) belongs to the spring after mass first + i; force(0) is passed from tile to tile.
      force(0) = q(1)*(1 + beta*q(1)**2)
      do first = 0, n - 1, tile
         last = min(tile, n - first)
         do i = 1, min(last, n - 1 - first)
            r = q(first + i + 1) - q(first + i)
            force(i) = r*(1 + beta*r**2)
         end do
         ! The last spring ends at the wall.
         if (first + last == n) then
            r = 0 - q(n)
            force(last) = r*(1 + beta*r**2)
         end if
         do i = 1, last
            hq(first + i) = weight*(force(i - 1) - force(i)) - (sigma*w(first + i))
         end do
         force(0) = force(last)
      end do
   end subroutine gradient_alone

   !> VEC Row i, from the force of the spring before it. On return `force` belongs to the spring after it.
   pure subroutine gradient_row(nlane, beta, sigma, weight, dw, q, next_q, force, hq)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: beta, sigma
      real(wp), intent(in), dimension(nlane) :: weight, dw, q, next_q
      real(wp), intent(inout) :: force(nlane)
      real(wp), intent(out) :: hq(nlane)
      real(wp) :: r, next_force
      integer :: lane

      do lane = 1, nlane
         r = next_q(lane) - q(lane)
         next_force = (r*(1 + beta*r**2))  ! parentheses prevent contraction with the difference
         hq(lane) = weight(lane)*(force(lane) - next_force) - (sigma*dw(lane))
         force(lane) = next_force
      end do
   end subroutine gradient_row

   !> Force and stiffness of one path of two masses, see model_type.
   !>   f = S_q = w_0 (f_1 - f_2, f_2 - f_3) - sigma (w_1, w_2),   f_i = r_i + beta r_i^3
   subroutine pair(self, nnoise, t, w, q1, q2, f1, f2, k11, k21, k12, k22)
      class(fpu_chain_model), intent(in) :: self
      integer, intent(in) :: nnoise
      real(wp), intent(in) :: t, w(0:nnoise)
      real(wp), value :: q1, q2
      real(wp), intent(out) :: f1, f2, k11, k21, k12, k22
      real(wp) :: r, force(3), k(3)
      integer :: i

      ! The three springs are stretched by q_1, q_2 - q_1 and -q_2, and have stiffness k = w_0 (1 + 3 beta r^2).
      !GCC$ unroll 3
      !GCC$ novector
      do i = 1, 3
         ! The index of the spring is a constant in each unrolled pass, so that merge costs nothing at run time.
         r = merge(q1, merge(q2 - q1, 0 - q2, i == 2), i == 1)
         force(i) = (r*(1 + self%beta*r**2))
         k(i) = (w(0)*(1 + 3*self%beta*r**2))
      end do
      f1 = w(0)*(force(1) - force(2)) - (self%sigma*w(1))
      f2 = w(0)*(force(2) - force(3)) - (self%sigma*w(2))
      !   K = (k_1 + k_2, -k_2; -k_2, k_2 + k_3)
      k11 = k(1) + k(2)
      k21 = -k(2)
      k12 = -k(2)
      k22 = k(2) + k(3)
   end subroutine pair

   !> Whether `flow` can take steps by this map.
   pure logical function has_flow(self, map)
      class(fpu_chain_model), intent(in) :: self
      type(step_map), intent(in) :: map

      has_flow = fpu_chain_has_flow(map, self%traits%ndof)
   end function has_flow

   !> Whole steps, see model_type. States that overflow are not finite: status is not set here.
   subroutine flow(self, map, steps, ndof, q, p, qn, pn, status, counters)
      class(fpu_chain_model), intent(in) :: self
      type(step_map), intent(in) :: map
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: ndof
      real(wp), intent(in), dimension(steps%nlane, ndof) :: q, p
      real(wp), intent(out), dimension(steps%nlane, ndof, steps%nstep/steps%every) :: qn, pn
      integer(i8), intent(inout) :: status(steps%nlane)
      type(counters_type), intent(inout) :: counters

      call fpu_chain_flow(map, self%beta, self%sigma, steps, ndof, q, p, qn, pn, counters)
   end subroutine flow

   !> Dense Hessian blocks of sum_j w_j H_j, for callers without bands. The noises are linear and do not contribute;
   !> S_qp = 0 and S_pp = w_0 I.
   subroutine hessian(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      class(fpu_chain_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional, dimension(nlane, ndof, ndof) :: hqq, hqp, hpp
      real(wp), allocatable :: bands(:, :, :)
      integer :: i, j

      if (present(hqq)) then
         ! The bands are spread over a matrix that is zero elsewhere; bands(:, d, i) is the entry (i, i + d).
         allocate (bands(nlane, -1:1, ndof))
         call self%hessian_banded(nlane, ndof, nnoise, 1, t, w, q, p, hqq=bands)
         hqq = 0
         do j = 1, ndof
            do i = max(1, j - 1), min(ndof, j + 1)
               hqq(:, i, j) = bands(:, j - i, i)
            end do
         end do
      end if
      if (present(hqp)) hqp = 0
      if (present(hpp)) then
         hpp = 0
         do i = 1, ndof
            hpp(:, i, i) = w(:, 0)
         end do
      end if
   end subroutine hessian

   !> Bands of the Hessian blocks; entries outside the matrix are zero.
   !>   hqq(:, d, i) = S_qq(i, i + d):   -k_{i-1} for d = -1,   k_{i-1} + k_i for d = 0,   -k_i for d = 1
   subroutine hessian_banded(self, nlane, ndof, nnoise, b, t, w, q, p, hqq, hqp, hpp)
      class(fpu_chain_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise, b  !! b: bandwidth, at least that of the traits
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional, dimension(nlane, -b:b, ndof) :: hqq, hqp, hpp
      real(wp) :: lower(nlane), upper(nlane)
      integer :: i

      if (present(hqq)) then
         hqq = 0
         !   S_qq: k_{i-1} + k_i on the diagonal, -k_i beside it,   k_i = w_0 (1 + 3 beta r_i^2)
         call stiffness(nlane, ndof, 0, self%beta, w(:, 0), q, lower)
         do i = 1, ndof
            call stiffness(nlane, ndof, i, self%beta, w(:, 0), q, upper)
            ! `lower` is the stiffness of the spring before mass i, `upper` of the one after it; each is evaluated once.
            hqq(:, 0, i) = lower + upper
            if (i < ndof) hqq(:, 1, i) = -upper
            if (i > 1) hqq(:, -1, i) = -lower
            lower = upper
         end do
      end if
      if (present(hqp)) hqp = 0
      if (present(hpp)) then
         hpp = 0
         do i = 1, ndof
            hpp(:, 0, i) = w(:, 0)
         end do
      end if
   end subroutine hessian_banded

   !> VEC Rows of gradient and bands for a strip of lanes; every spring is evaluated once. The outer loop is over rows:
   !> a row needs only the spring before it, which stays in registers of the strip.
   subroutine chain_rows(self, ndof, nnoise, first, last, t, w, q, hq, hqq)
      class(fpu_chain_model), intent(in) :: self
      integer, intent(in) :: ndof, nnoise, first, last
      real(wp), intent(in) :: t, w(strip_lanes, 0:nnoise), q(strip_lanes, first - 1:last + 1)
      real(wp), intent(out) :: hq(strip_lanes, first:last), hqq(strip_lanes, 0:1, first:last)
      real(wp), dimension(strip_lanes) :: weight, force, k  !! weight of H_0; values of the spring before the row
      real(wp) :: beta, sigma, next_force, next_k
      integer :: i, lane

      beta = self%beta
      sigma = self%sigma
      do lane = 1, strip_lanes
         ! Evaluate the spring before the first row; positions first - 1 and last + 1 are given too.
         weight(lane) = w(lane, 0)
         call spring(beta, weight(lane), q(lane, first) - q(lane, first - 1), force(lane), k(lane))
      end do
      do i = first, last
         do lane = 1, strip_lanes
            !   hq_i = w_0 (f(r_{i-1}) - f(r_i)) - sigma w_i,   hqq_ii = k_{i-1} + k_i,   hqq_i,i+1 = -k_i
            call spring(beta, weight(lane), q(lane, i + 1) - q(lane, i), next_force, next_k)
            hq(lane, i) = weight(lane)*(force(lane) - next_force) - (sigma*w(lane, i))
            hqq(lane, 0, i) = k(lane) + next_k
            hqq(lane, 1, i) = -next_k
            force(lane) = next_force
            k(lane) = next_k
         end do
      end do
   end subroutine chain_rows

   !> Force and upper bands; for one lane by the operations of chain_rows, with springs adjacent in memory.
   subroutine force_stiffness(self, nlane, ndof, nnoise, b, t, w, q, p, hq, hqq)
      class(fpu_chain_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise, b  !! b: traits%bandwidth
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: hq(nlane, ndof), hqq(nlane, 0:b, ndof)

      if (nlane == 1 .and. b == 1) then
         call rows_alone(ndof, self%beta, self%sigma, w, q, hq, hqq)
      else
         call self%gradient(nlane, ndof, nnoise, t, w, q, p, hq=hq)
         call upper_bands(nlane, ndof, b, self%beta, w(1, 0), q, hqq)
      end if
   end subroutine force_stiffness

   !> The stiffness of all rows of many lanes: the diagonal entry of row i and the entry that couples it to row i + 1.
   !> Bands below the diagonal are equal to these, and are not set.
   pure subroutine upper_bands(nlane, ndof, b, beta, w, q, hqq)
      integer, intent(in) :: nlane, ndof, b
      real(wp), intent(in) :: beta, w(nlane), q(nlane, ndof)  !! w: weights of H_0
      real(wp), intent(out) :: hqq(nlane, 0:b, ndof)
      real(wp) :: before(nlane), behind(nlane)
      integer :: i

      call stiffness(nlane, ndof, 0, beta, w, q, before)
      do i = 1, ndof
         call stiffness(nlane, ndof, i, beta, w, q, behind)
         hqq(:, :, i) = 0  ! a model may be declared to have more bands
         hqq(:, 0, i) = before + behind
         if (b > 0) hqq(:, 1, i) = -behind
         before = behind
      end do
   end subroutine upper_bands

   !> VEC Force and stiffness of all masses of one lane; springs are adjacent in memory. hq and hqq have the bits that
   !> chain_rows gives a lane of a strip, so that a path has the same bits alone and in a strip.
   pure subroutine rows_alone(n, beta, sigma, w, q, hq, hqq)
      integer, intent(in) :: n
      real(wp), intent(in) :: beta, sigma, w(0:n), q(n)
      real(wp), intent(out) :: hq(n), hqq(0:1, n)
      integer, parameter :: tile = 64
      real(wp) :: force(0:tile), k(0:tile), weight
      integer :: first, last, i

      weight = w(0)
      ! The loops of gradient_alone, with the stiffness in addition; tiles of 64 springs stay in the first cache.
      call spring(beta, weight, q(1), force(0), k(0))
      do first = 0, n - 1, tile
         last = min(tile, n - first)
         do i = 1, min(last, n - 1 - first)
            call spring(beta, weight, q(first + i + 1) - q(first + i), force(i), k(i))
         end do
         if (first + last == n) call spring(beta, weight, 0 - q(n), force(last), k(last))
         do i = 1, last
            hq(first + i) = weight*(force(i - 1) - force(i)) - (sigma*w(first + i))
            hqq(0, first + i) = k(i - 1) + k(i)
            hqq(1, first + i) = -k(i)
         end do
         force(0) = force(last)
         k(0) = k(last)
      end do
   end subroutine rows_alone

   !> Force and weighted stiffness of a spring that is stretched by r. The force is unweighted: the caller weights the
   !> difference of two forces, with one product instead of two.
   pure subroutine spring(beta, weight, r, force, k)
      real(wp), intent(in) :: beta, weight, r
      real(wp), intent(out) :: force, k
      real(wp) :: s

      !   f = r + beta r^3,   k = w_0 (1 + 3 beta r^2)
      s = beta*r**2
      force = r + s*r
      k = weight*(1 + 3*s)
   end subroutine spring

   !> Hessian of sum_j w_j H_j times (vq, vp): uq_i = k_{i-1} (vq_i - vq_{i-1}) - k_i (vq_{i+1} - vq_i), up = w_0 vp.
   subroutine hessian_vector(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
      class(fpu_chain_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: vq(nlane, ndof), vp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      real(wp) :: k(nlane), r(nlane)
      integer :: i

      do i = 0, ndof
         call stiffness(nlane, ndof, i, self%beta, w(:, 0), q, k)
         ! For the displacements vq, spring i pulls at both of its ends by k_i (vq_{i+1} - vq_i).
         call stretch(nlane, ndof, i, vq, r)
         ! The term of spring i is the first in uq of mass i + 1, the term of spring i + 1 is the second and last.
         if (i > 0) uq(:, i) = uq(:, i) - k*r
         if (i < ndof) uq(:, i + 1) = k*r
      end do
      do i = 1, ndof
         up(:, i) = w(:, 0)*vp(:, i)
      end do
   end subroutine hessian_vector

   !> r_i = x_{i+1} - x_i with x_0 = x_{n+1} = 0, for i = 0 .. n. With x = q this is the stretch of spring i, with x =
   !> vq its change.
   pure subroutine stretch(nlane, ndof, i, x, r)
      integer, intent(in) :: nlane, ndof, i
      real(wp), intent(in) :: x(nlane, ndof)
      real(wp), intent(out) :: r(nlane)

      if (i == 0) then
         r = x(:, 1)
      else if (i == ndof) then
         r = -x(:, ndof)
      else
         r = x(:, i + 1) - x(:, i)
      end if
   end subroutine stretch

   !> Stiffness of spring i times the weight of H: w_0 (1 + 3 beta r_i^2).
   pure subroutine stiffness(nlane, ndof, i, beta, w, q, k)
      integer, intent(in) :: nlane, ndof, i
      real(wp), intent(in) :: beta, w(nlane), q(nlane, ndof)  !! w: weights of H_0
      real(wp), intent(out) :: k(nlane)

      call stretch(nlane, ndof, i, q, k)
      k = w*(1 + 3*beta*k**2)
   end subroutine stiffness

end module symsde_model_catalogue_fpu_chain
