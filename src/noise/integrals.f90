! SPDX-License-Identifier: BSD-3-Clause
!> The increments of a step together with functionals of one and the same Brownian path (noise/functionals).
!>
!> A path is known by its dW and H = dZ/h - dW/2 ~ N(0, |h|/12), independent of dW, on intervals that are
!> halved where more of it is wanted:
!>
!>    W_1 = W/2 + 3/2 H + Z,    W_2 = W - W_1,          Z ~ N(0, |h|/16)
!>    H_1 = H/4 - Z/2 + N/2,    H_2 = H/4 - Z/2 - N/2,  N ~ N(0, |h|/12)
!>
!> An area is the sum over 2^n sub-increments of the step, each a parabola with its dW and H, n so large
!> that its mean-square error |h|^2/(12 2^n) is at most |h|^3 (time in units of the model).
!>
!> refine = l > 0: 2^l finer steps, merged as a balanced binary tree; dW has the bits of the source that
!> makes only dW, and the functionals at refine = l are, bit for bit, what those of h/2 and l-1 merge to.
!> refine = -l: the coarse step halved l times. Its dW are those of the (W,H) halving, not of the W-only
!> one of a source that makes only dW: a run is halved on the path of the same scheme. The halvings of a
!> run at refine = -l are the sub-increments of the areas at refine = 0: one path.
module symsde_noise_integrals
   use symsde_base_functionals, only: functional_set, nfunctional, path_areas
   use symsde_base_kinds, only: wp, i8
   use symsde_noise_functionals, only: path_interval, new_path_interval, parabola_values, merge_intervals
   use symsde_noise_normal, only: scaled_normal_pairs
   implicit none
   private
   public :: integral_draws, area_levels, fill_pair, shape_draws

   integer, parameter, public :: max_area_levels = 20  !! 2^20 sub-increments of a step

   ! counter words; 1 is the bridge of W alone, 2 the oscillator's
   integer, parameter :: purpose_increment = 0  !! dW at the finest step
   integer, parameter :: purpose_shape = 3      !! H at the finest step
   integer, parameter :: purpose_halving = 4    !! Z of a halving
   integer, parameter :: purpose_halves = 5     !! N of the same

   !> What the draws of a run are a function of.
   type :: integral_draws
      integer :: nnoise = 0
      integer(i8) :: seed = 0
      real(wp) :: h = 0                    !! step of the run, with its sign [time]
      integer :: refine = 0
      logical, allocatable :: silent(:)    !! noises for which nothing is drawn (nnoise)
      type(functional_set) :: asked        !! functionals that are wanted
   end type integral_draws

contains

   !> n, the number of halvings of a step whose areas are wanted.
   pure integer function area_levels(h)
      real(wp), intent(in) :: h            !! step [time]
      real(wp) :: parts

      parts = 1/(12*abs(h))
      area_levels = 0
      do while (2.0_wp**area_levels < parts .and. area_levels < max_area_levels)
         area_levels = area_levels + 1
      end do
   end function area_levels

   !> The steps 2*pair and 2*pair+1 of the run.
   subroutine fill_pair(d, nlane, path, pair, even, odd, drawn)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane), pair
      type(path_interval), intent(out) :: even, odd
      integer(i8), intent(inout) :: drawn

      if (d%refine == 0) then
         call finest_pair(d, nlane, path, pair, d%h, even, odd, drawn)
      else if (d%refine > 0) then
         call sum_tree(d, nlane, path, 2*pair, even, drawn)
         call sum_tree(d, nlane, path, 2*pair + 1, odd, drawn)
      else
         call descend(d, nlane, path, 2*pair, even, drawn)
         call descend(d, nlane, path, 2*pair + 1, odd, drawn)
      end if
   end subroutine fill_pair

   !> One step as the balanced binary tree of 2^refine finer ones.
   subroutine sum_tree(d, nlane, path, step, whole, drawn)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane), step
      type(path_interval), intent(out) :: whole
      integer(i8), intent(inout) :: drawn
      type(path_interval) :: partial(d%refine), even, odd, left
      integer(i8) :: i, first, carry
      integer :: level
      real(wp) :: fine

      fine = d%h/2.0_wp**d%refine
      first = step*2_i8**(d%refine - 1)  ! pairs of draws
      do i = 0, 2_i8**(d%refine - 1) - 1
         call finest_pair(d, nlane, path, first + i, fine, even, odd, drawn)
         call merge_intervals(nlane, d%nnoise, even, odd, whole)
         carry = i
         level = 1
         do while (mod(carry, 2_i8) == 1)  ! two complete sums of one size make one of the next
            left = partial(level)
            odd = whole
            call merge_intervals(nlane, d%nnoise, left, odd, whole)
            carry = carry/2
            level = level + 1
         end do
         if (level <= d%refine) partial(level) = whole
      end do
   end subroutine sum_tree

   !> The finest intervals 2*pair and 2*pair+1, of the given length.
   subroutine finest_pair(d, nlane, path, pair, length, even, odd, drawn)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane), pair
      real(wp), intent(in) :: length
      type(path_interval), intent(out) :: even, odd
      integer(i8), intent(inout) :: drawn
      real(wp), allocatable :: h1(:, :), h2(:, :), u1(:, :), u2(:, :), v1(:, :), v2(:, :)

      call new_path_interval(even, nlane, d%nnoise, length, d%asked)
      call new_path_interval(odd, nlane, d%nnoise, length, d%asked)
      allocate (h1(nlane, d%nnoise), h2(nlane, d%nnoise))
      call draw(d, nlane, path, pair, 0, purpose_increment, sqrt(abs(length)), even%w, odd%w, drawn)
      call draw(d, nlane, path, pair, 0, purpose_shape, sqrt(abs(length)/12), h1, h2, drawn)
      if (levels_below(d, length) > 0) call draw_halving(d, nlane, path, pair, 1, length, u1, u2, v1, v2, drawn)
      call complete(d, nlane, path, 0, 2*pair, h1, u1, v1, even, drawn)
      call complete(d, nlane, path, 0, 2*pair + 1, h2, u2, v2, odd, drawn)
   end subroutine finest_pair

   !> One step of a run at refine < 0: the coarse step that holds it, halved.
   subroutine descend(d, nlane, path, step, interval, drawn)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane), step
      type(path_interval), intent(out) :: interval
      integer(i8), intent(inout) :: drawn
      real(wp), allocatable, dimension(:, :) :: w, hh, w1, w2, h1, h2, u1, u2, v1, v2
      integer(i8) :: parent
      integer :: level, levels
      real(wp) :: length

      levels = -d%refine
      length = d%h*2.0_wp**levels
      parent = step/2_i8**levels
      allocate (w(nlane, d%nnoise), w1(nlane, d%nnoise), w2(nlane, d%nnoise))
      allocate (hh(nlane, d%nnoise), h1(nlane, d%nnoise), h2(nlane, d%nnoise))
      call draw(d, nlane, path, parent/2, 0, purpose_increment, sqrt(abs(length)), w1, w2, drawn)
      w = merge(w1, w2, mod(parent, 2_i8) == 0)
      call draw(d, nlane, path, parent/2, 0, purpose_shape, sqrt(abs(length)/12), h1, h2, drawn)
      hh = merge(h1, h2, mod(parent, 2_i8) == 0)
      do level = 1, levels
         parent = step/2_i8**(levels - level + 1)
         call draw_halving(d, nlane, path, parent/2, level, length, u1, u2, v1, v2, drawn)
         if (mod(parent, 2_i8) == 1) then
            u1 = u2
            v1 = v2
         end if
         call halve(nlane, d%nnoise, w, hh, u1, v1, w1, w2, h1, h2)
         if (mod(step/2_i8**(levels - level), 2_i8) == 0) then
            w = w1
            hh = h1
         else
            w = w2
            hh = h2
         end if
         length = length/2
      end do
      if (levels_below(d, length) > 0) then
         call draw_halving(d, nlane, path, step/2, levels + 1, length, u1, u2, v1, v2, drawn)
         if (mod(step, 2_i8) == 1) then
            u1 = u2
            v1 = v2
         end if
      end if
      call new_path_interval(interval, nlane, d%nnoise, length, d%asked)
      interval%w = w
      call complete(d, nlane, path, levels, step, hh, u1, v1, interval, drawn)
   end subroutine descend

   !> Halvings below an interval of this length: as many as the most demanding functional wants.
   pure integer function levels_below(d, length)
      type(integral_draws), intent(in) :: d
      real(wp), intent(in) :: length

      levels_below = 0
      if (d%asked%has(path_areas)) levels_below = area_levels(length)
   end function levels_below

   !> The functionals of an interval whose dW is there. Those that dW and H determine are not halved for.
   subroutine complete(d, nlane, path, level, index, hh, u, v, interval, drawn)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane, level                 !! halvings that led to this interval
      integer(i8), intent(in) :: path(nlane), index       !! number of the interval among its like
      real(wp), allocatable, intent(in) :: hh(:, :), u(:, :), v(:, :)
      type(path_interval), intent(inout) :: interval
      integer(i8), intent(inout) :: drawn
      type(integral_draws) :: below
      type(path_interval) :: whole
      integer :: f, last

      below = d
      below%asked%has = .false.
      last = level + levels_below(d, interval%length)
      if (last > level) below%asked%has(path_areas) = d%asked%has(path_areas)
      do f = 1, nfunctional
         if (d%asked%has(f) .and. .not. below%asked%has(f)) &
            call parabola_values(f, nlane, d%nnoise, interval%length, interval%w, hh, interval%of(f)%x)
      end do
      if (below%asked%is_empty()) return
      call merge_halves(below, nlane, path, level + 1, last, index, interval%length, interval%w, hh, u, v, whole, drawn)
      do f = 1, nfunctional
         if (below%asked%has(f)) call move_alloc(whole%of(f)%x, interval%of(f)%x)
      end do
   end subroutine complete

   !> Functionals of an interval from those of its halves, down to the last level.
   recursive subroutine merge_halves(d, nlane, path, level, last, index, length, w, hh, u, v, whole, drawn)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane
      integer, intent(in) :: level, last                  !! of this halving, of the last ones
      integer(i8), intent(in) :: path(nlane), index       !! number of the interval among its like
      real(wp), intent(in) :: length, w(nlane, d%nnoise)
      real(wp), allocatable, intent(in) :: hh(:, :), u(:, :), v(:, :)
      type(path_interval), intent(out) :: whole
      integer(i8), intent(inout) :: drawn
      type(path_interval) :: left, right
      real(wp), allocatable, dimension(:, :) :: w1, w2, h1, h2, u1, u2, v1, v2

      allocate (w1(nlane, d%nnoise), w2(nlane, d%nnoise), h1(nlane, d%nnoise), h2(nlane, d%nnoise))
      call halve(nlane, d%nnoise, w, hh, u, v, w1, w2, h1, h2)
      if (level == last) then
         call finest_interval(d, nlane, length/2, w1, h1, left)
         call finest_interval(d, nlane, length/2, w2, h2, right)
      else
         call draw_halving(d, nlane, path, index, level + 1, length/2, u1, u2, v1, v2, drawn)
         call merge_halves(d, nlane, path, level + 1, last, 2*index, length/2, w1, h1, u1, v1, left, drawn)
         call merge_halves(d, nlane, path, level + 1, last, 2*index + 1, length/2, w2, h2, u2, v2, right, drawn)
      end if
      call merge_intervals(nlane, d%nnoise, left, right, whole)
      whole%w = w  ! the sum of the halves to rounding
   end subroutine merge_halves

   !> A parabola.
   subroutine finest_interval(d, nlane, length, w, hh, interval)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane
      real(wp), intent(in) :: length, w(nlane, d%nnoise), hh(nlane, d%nnoise)
      type(path_interval), intent(out) :: interval
      integer :: f

      call new_path_interval(interval, nlane, d%nnoise, length, d%asked)
      interval%w = w
      do f = 1, nfunctional
         if (d%asked%has(f)) call parabola_values(f, nlane, d%nnoise, length, w, hh, interval%of(f)%x)
      end do
   end subroutine finest_interval

   !> The two halves of an interval.
   pure subroutine halve(nlane, nnoise, w, hh, u, v, w1, w2, h1, h2)
      integer, intent(in) :: nlane, nnoise
      real(wp), intent(in) :: w(nlane, nnoise), hh(nlane, nnoise)
      real(wp), intent(in) :: u(nlane, nnoise), v(nlane, nnoise)  !! Z and N
      real(wp), intent(out) :: w1(nlane, nnoise), w2(nlane, nnoise), h1(nlane, nnoise), h2(nlane, nnoise)

      w1 = 0.5_wp*w + 1.5_wp*hh + u
      w2 = w - w1
      h1 = 0.25_wp*hh - 0.5_wp*u
      h2 = h1 - 0.5_wp*v
      h1 = h1 + 0.5_wp*v
   end subroutine halve

   !> Z and N of the halvings of the intervals 2*pair and 2*pair+1 of one length.
   subroutine draw_halving(d, nlane, path, pair, level, length, u1, u2, v1, v2, drawn)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane, level                 !! level of this halving, from 1
      integer(i8), intent(in) :: path(nlane), pair
      real(wp), intent(in) :: length                      !! of the intervals to be halved
      real(wp), allocatable, intent(inout) :: u1(:, :), u2(:, :), v1(:, :), v2(:, :)
      integer(i8), intent(inout) :: drawn

      if (.not. allocated(u1)) then
         allocate (u1(nlane, d%nnoise), u2(nlane, d%nnoise))
         allocate (v1(nlane, d%nnoise), v2(nlane, d%nnoise))
      end if
      call draw(d, nlane, path, pair, level, purpose_halving, sqrt(abs(length)/16), u1, u2, drawn)
      call draw(d, nlane, path, pair, level, purpose_halves, sqrt(abs(length)/12), v1, v2, drawn)
   end subroutine draw_halving

   !> H = dZ/h - dW/2 of noise k at the finest steps 2*pair and 2*pair+1, the numbers that fill_pair takes for dZ.
   subroutine shape_draws(nlane, seed, path, pair, k, h, even, odd, drawn)
      integer, intent(in) :: nlane, k
      integer(i8), intent(in) :: seed, path(nlane), pair
      real(wp), intent(in) :: h            !! length of a step, either sign [time]
      real(wp), intent(out) :: even(nlane), odd(nlane)
      integer(i8), intent(inout) :: drawn

      call scaled_normal_pairs(nlane, seed, path, pair, k, 0, purpose_shape, sqrt(abs(h)/12), even, odd)
      drawn = drawn + 2
   end subroutine shape_draws

   !> Scaled normals of all noises for the intervals 2*pair and 2*pair+1; zero for silent noises.
   subroutine draw(d, nlane, path, pair, level, purpose, scale, even, odd, drawn)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane, level, purpose
      integer(i8), intent(in) :: path(nlane), pair
      real(wp), intent(in) :: scale
      real(wp), intent(inout) :: even(nlane, d%nnoise), odd(nlane, d%nnoise)
      integer(i8), intent(inout) :: drawn
      integer :: k

      do k = 1, d%nnoise
         if (d%silent(k)) then
            even(:, k) = 0
            odd(:, k) = 0
            cycle
         end if
         call scaled_normal_pairs(nlane, d%seed, path, pair, k, level, purpose, scale, even(:, k), odd(:, k))
         drawn = drawn + 2
      end do
   end subroutine draw

end module symsde_noise_integrals
