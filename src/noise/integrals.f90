! SPDX-License-Identifier: BSD-3-Clause
!> The increments of a step, together with functionals of the same Brownian path (noise/functionals).
!>
!> A path is described by dW and H = dZ/h - dW/2 ~ N(0, |h|/12), independent of dW, on intervals that are halved where
!> more detail is needed:
!>
!>    W_1 = W/2 + 3/2 H + Z,    W_2 = W - W_1,          Z ~ N(0, |h|/16)
!>    H_1 = H/4 - Z/2 + N/2,    H_2 = H/4 - Z/2 - N/2,  N ~ N(0, |h|/12)
!>
!> This is the law of the halves given (W, H): W_1 has the right variance |h|/4 + (9/4) |h|/12 + |h|/16 = |h|/2, and the
!> halves of dZ merge to the whole again, dZ = dZ_1 + dZ_2 + (h/2) W_1.
!>
!> If K ~ N(0, |h|/720) is asked for, the path is described by K, too, and N depends on K:
!>
!>    N = 15/2 K + M,   K_1, K_2 = K/8 - M/4 +- D/4,    M ~ N(0, |h|/192),  D ~ N(0, |h|/180)
!>
!> and also if areas are drawn in law (base/area_rule), since K is part of them. Where the noise of decaying momenta
!> is asked for (path_decay), an interval has a further normal xi ~ N(0, 1) for each noise, which is one direction u in
!> the space of those that halve it (noise/decay_law): with Z, M, D, xi_1 and xi_2 drawn, r_i, each is moved by its
!> standard deviation times u_i (xi - sum_j u_j r_j). J is merged from four quarters of a
!> step (noise/functionals).
!>
!> Steps of a discrete law have no shape: dW of that law and areas +-|h|/2 (noise/discrete).
!>
!> An area is the sum over 2^n sub-increments of the step, each a parabola with its dW and H, with 2^n >= tau/(12 |h|)
!> for a time scale tau (model/probe/area_time): its mean-square error |h|^2/(12 2^n) is at
!> most |h|^3/tau.
!>
!> refine = l > 0: 2^l finer steps, merged as a balanced binary tree; dW has the bits of the source that makes only
!> dW, and the functionals at refine = l are, bit for bit, merged from those of step h/2 and refine = l-1.
!> refine = -l: the coarse step halved l times. Its dW come from the (W,H) halving, and differ from those of a source
!> that makes only dW: a run is halved on the path of the same scheme. The halvings of a run at refine = -l are the
!> sub-increments of the areas at refine = 0: one path.
!>
!> A step goes through these procedures: fill_pair asks for its finest intervals (finest_pair), which are drawn
!> (draw_shapes), halved down to the step where refine < 0 (descend), and get their functionals (complete), by halving
!> further if dW, H and K do not determine them (merge_halves); if refine > 0 the intervals are merged to the step
!> (sum_tree).
module symsde_noise_integrals
   use symsde_base_functionals, only: area_index, nfunctional, path_areas, path_magnus, path_decay
   use symsde_base_kinds, only: wp, i8
   use symsde_base_laws, only: law_gaussian
   use symsde_noise_discrete, only: discrete_pairs, sign_pairs
   use symsde_noise_functionals, only: path_interval, new_path_interval, shape_values, decay_values, merge_intervals, &
                                       magnus_of_quarters
   use symsde_noise_halving, only: path_shape, halving_draws, halve
   use symsde_noise_normal, only: normal_stream
   use symsde_noise_integral_draws, only: integral_draws, draw, draw_rests
   use symsde_noise_philox, only: purpose_increment, purpose_shape, purpose_halving, purpose_halves, purpose_stt_area, &
                                  purpose_stt_halving, purpose_decay, purpose_second_decay
   implicit none
   private
   public :: fill_pair

   integer, parameter :: magnus_levels = 2      !! halvings of a step for J
   integer, parameter :: levels_unseen = 6      !! lowest levels of halvings, in which the interrupt is not checked

   !> An interval to be halved further: its place, the shape of the path on it, and the draws that halve it.
   type :: known_interval
      integer :: level = 0         !! halvings that led to this interval
      integer(i8) :: index = 0     !! index of the interval in its level
      real(wp) :: length = 0
      type(path_shape) :: shape
      type(halving_draws) :: u
   end type known_interval

contains

   !> Make the steps 2*pair and 2*pair+1 of the run with their functionals; for a single path, the steps of all pairs in
   !> its lanes. Both steps are made together, since one draw gives normals for both.
   subroutine fill_pair(d, nlane, path, pair, even, odd, drawn)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane), pair
      type(path_interval), intent(out) :: even, odd
      integer(i8), intent(inout) :: drawn

      if (d%refine > 0) then
         call sum_tree(d, nlane, path, 2*pair, even, drawn)
         call sum_tree(d, nlane, path, 2*pair + 1, odd, drawn)
      else
         call finest_pair(d, nlane, path, pair, d%h, even, odd, drawn)
      end if
   end subroutine fill_pair

   !> Make one step as the balanced binary tree of 2^refine finer steps: partial(l) keeps a complete sum of 2^l of
   !> them until the next sum of its size is complete, as a digit waits for a carry.
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

      ! Length of a finest interval, with its sign.
      fine = d%h/2.0_wp**d%refine
      ! A draw makes two fine steps; the step has 2^(refine-1) draws, numbered through the run.
      first = step*2_i8**(d%refine - 1)  ! draws before this step
      do i = 0, 2_i8**(d%refine - 1) - 1
         ! The sum may end between any two draws if an interrupt asks for it.
         if (associated(d%interrupt)) call d%interrupt%after_part()
         call finest_pair(d, nlane, path, first + i, fine, even, odd, drawn)
         if (d%is_left()) return
         call merge_intervals(nlane, d%nnoise, d%asked, even, odd, whole)
         carry = i
         level = 1
         ! Climb levels above the first: as many as the binary number i ends with ones.
         do while (mod(carry, 2_i8) == 1)  ! two complete sums of one size make one of the next
            left = partial(level)
            odd = whole
            call merge_intervals(nlane, d%nnoise, d%asked, left, odd, whole)
            carry = carry/2
            level = level + 1
         end do
         if (level <= d%refine) partial(level) = whole
      end do
   end subroutine sum_tree

   !> Make the finest intervals 2*pair and 2*pair+1, of the given length: the steps themselves at refine <= 0. At
   !> refine < 0 their coarse interval is drawn, 2^level times as long, in which the pair has the number pair/2^level.
   subroutine finest_pair(d, nlane, path, pair, length, even, odd, drawn)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane), pair
      real(wp), intent(in) :: length
      type(path_interval), intent(out) :: even, odd
      integer(i8), intent(inout) :: drawn
      type(known_interval) :: first, second
      integer :: level

      if (d%law /= law_gaussian) then
         call discrete_pair(d, nlane, path, pair, length, even, odd, drawn)
         return
      end if
      level = max(-d%refine, 0)
      ! The numbers select the draws that halve the two intervals.
      call number_pair(first, second, level, pair, length)
      call draw_shapes(d, nlane, path, pair/2_i8**level, length*2.0_wp**level, first%shape, second%shape, drawn)
      if (level > 0) call descend(d, nlane, path, pair, first%shape, second%shape, drawn)
      ! One draw halves both intervals.
      if (levels_below(d, length) > 0) &
         call draw_halving(d, nlane, path, pair, level + 1, length, first%u, second%u, drawn)
      call complete(d, nlane, path, first, even, drawn)
      call complete(d, nlane, path, second, odd, drawn)
   end subroutine finest_pair

   !> Make dW and areas of a discrete law on the finest intervals 2*pair and 2*pair+1: first values of variance one in
   !> the arrays of dW and areas, at the end multiplied by sqrt|h| and |h|/2.
   subroutine discrete_pair(d, nlane, path, pair, length, even, odd, drawn)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane), pair
      real(wp), intent(in) :: length
      type(path_interval), intent(out) :: even, odd
      integer(i8), intent(inout) :: drawn
      integer(i8) :: from(nlane)
      integer(i8), allocatable :: ahead(:)  ! allocated for a single path alone
      integer :: k, l, kl

      ! One pair of steps is 2^refine pairs of draws.
      if (allocated(d%ahead)) ahead = 2_i8**d%refine*d%ahead
      call new_path_interval(even, nlane, d%nnoise, length, d%asked)
      call new_path_interval(odd, nlane, d%nnoise, length, d%asked)
      even%w = 0
      odd%w = 0
      if (d%asked%has(path_areas)) even%of(path_areas)%x = 0
      if (d%asked%has(path_areas)) odd%of(path_areas)%x = 0
      do l = 1, d%nnoise
         if (d%silent(l)) cycle
         from = merge(0_i8, path, d%common(l))
         call discrete_pairs(nlane, d%seed, from, pair, l, d%law, even%w(:, l), odd%w(:, l), ahead)
         drawn = drawn + 2
         do k = 1, l - 1
            if (d%silent(k) .or. .not. d%asked%has(path_areas)) cycle
            kl = area_index(k, l)
            from = merge(0_i8, path, d%common(l) .and. d%common(k))
            call sign_pairs(nlane, d%seed, from, pair, kl, even%of(path_areas)%x(:, kl), &
                            odd%of(path_areas)%x(:, kl), ahead)
            drawn = drawn + 2
         end do
      end do
      ! The scale comes last, one product for all noises.
      even%w = sqrt(abs(length))*even%w
      odd%w = sqrt(abs(length))*odd%w
      if (.not. d%asked%has(path_areas)) return
      even%of(path_areas)%x = (0.5_wp*abs(length))*even%of(path_areas)%x
      odd%of(path_areas)%x = (0.5_wp*abs(length))*odd%of(path_areas)%x
   end subroutine discrete_pair

   !> Draw dW, H, K and the normal terms of areas, each (nlane, nnoise), of the intervals 2*pair and 2*pair+1 with which
   !> a run starts: the finest at refine >= 0, at refine < 0 the coarse ones, which are halved.
   subroutine draw_shapes(d, nlane, path, pair, length, even, odd, drawn)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane), pair
      real(wp), intent(in) :: length
      type(path_shape), intent(out) :: even, odd
      integer(i8), intent(inout) :: drawn

      call draw(d, normal_stream(purpose=purpose_increment, scale=sqrt(abs(length))), nlane, path, pair, &
                even%w, odd%w, drawn)
      call draw(d, normal_stream(purpose=purpose_shape, scale=sqrt(abs(length)/12)), nlane, path, pair, &
                even%hh, odd%hh, drawn)
      if (d%needs_stt_area()) &
         call draw(d, normal_stream(purpose=purpose_stt_area, scale=sqrt(abs(length)/720)), nlane, path, pair, &
                   even%kk, odd%kk, drawn)
      if (d%asked%has(path_decay)) &
         call draw(d, normal_stream(purpose=purpose_decay, scale=1.0_wp), nlane, path, pair, even%xi, odd%xi, drawn)
      if (d%in_law()) call draw_rests(d, nlane, path, pair, abs(length)/sqrt(20.0_wp), even%rest, odd%rest, drawn)
   end subroutine draw_shapes

   !> Find the steps 2*pair and 2*pair+1 of a run at refine < 0, from the pair of coarse intervals that holds them.
   !> At every level each lane takes the interval of the two that holds its pair, and halves it: left and right become
   !> the halves.
   subroutine descend(d, nlane, path, pair, left, right, drawn)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane), pair
      type(path_shape), intent(inout) :: left, right
      integer(i8), intent(inout) :: drawn
      type(path_shape) :: whole
      type(halving_draws) :: u1, u2
      integer(i8) :: at(nlane)
      logical :: odd(nlane)  ! the interval that holds the step is the second of its pair
      integer :: level, longer

      at = pair
      if (allocated(d%ahead)) at = at + d%ahead
      do level = 1, -d%refine
         ! Halvings still to do: an interval of this level has 2^longer pairs of steps.
         longer = -d%refine - level
         odd = mod(at/2_i8**longer, 2_i8) == 1
         call draw_halving(d, nlane, path, pair/2_i8**(longer + 1), level, d%h*2.0_wp**(longer + 1), u1, u2, drawn)
         ! From here on `left` is the interval that holds the step, and u1 holds the draws that halve it.
         call choose(odd, right%w, left%w)
         call choose(odd, right%hh, left%hh)
         call choose(odd, right%kk, left%kk)
         call choose(odd, right%xi, left%xi)
         ! The draws of the same interval.
         call choose(odd, u2%z, u1%z)
         call choose(odd, u2%n, u1%n)
         call choose(odd, u2%d, u1%d)
         call choose(odd, u2%xi_1, u1%xi_1)
         call choose(odd, u2%xi_2, u1%xi_2)
         whole = left
         call halve(d%asked%rate, d%h*2.0_wp**(longer + 1), whole, u1, left, right)
      end do
   end subroutine descend

   !> Lanes of the second half take the values of that half. Arrays of functionals that were not drawn are skipped.
   pure subroutine choose(in_second, second, chosen)
      logical, intent(in) :: in_second(:)                         !! (nlane)
      real(wp), allocatable, intent(in) :: second(:, :)           !! (nlane, nnoise)
      real(wp), allocatable, intent(inout) :: chosen(:, :)        !! in: values of the first half
      integer :: k

      if (.not. allocated(second)) return
      do k = 1, size(second, 2)
         chosen(:, k) = merge(second(:, k), chosen(:, k), in_second)
      end do
   end subroutine choose

   !> Halvings below an interval of this length: as many as the most demanding functional needs.
   pure integer function levels_below(d, length)
      type(integral_draws), intent(in) :: d
      real(wp), intent(in) :: length

      ! dW, dZ and K need no halving.
      levels_below = 0
      if (d%asked%has(path_areas)) levels_below = d%areas%levels(length)
      if (d%asked%has(path_magnus)) levels_below = max(levels_below, magnus_levels)
   end function levels_below

   !> Make an interval with its functionals. Functionals that dW, H and K determine need no halving.
   subroutine complete(d, nlane, path, known, interval, drawn)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane)
      type(known_interval), intent(in) :: known
      type(path_interval), intent(out) :: interval
      integer(i8), intent(inout) :: drawn
      type(path_interval) :: whole
      integer :: last

      ! dW, H and K determine dZ, K, and areas in law.
      call finest_interval(d, nlane, known%length, known%shape, interval, whole=.true.)
      last = known%level + levels_below(d, known%length)
      ! All functionals asked for are determined.
      if (last == known%level) return
      ! J alone needs no intervals between the quarters and the whole.
      if (.not. (d%asked%has(path_areas) .or. d%asked%has(path_decay))) then
         call merge_quarters(d, nlane, path, known, interval%of(path_magnus)%x, drawn)
         return
      end if
      call merge_halves(d, nlane, path, last, known, whole, drawn)
      if (d%is_left()) return
      ! Keep dZ and K as drawn; the merged values equal them up to rounding.
      if (d%asked%has(path_areas) .and. .not. d%in_law()) &
         call move_alloc(whole%of(path_areas)%x, interval%of(path_areas)%x)
      if (d%asked%has(path_magnus)) call move_alloc(whole%of(path_magnus)%x, interval%of(path_magnus)%x)
   end subroutine complete

   !> Make J of an interval from its quarters: the values of merge_halves, without an interval for each of its parts.
   subroutine merge_quarters(d, nlane, path, known, x, drawn)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane)
      type(known_interval), intent(in) :: known
      real(wp), allocatable, intent(inout) :: x(:, :)  !! (nlane, pairs of noises)
      integer(i8), intent(inout) :: drawn
      type(known_interval) :: first, second
      type(path_shape) :: a, b
      real(wp), allocatable :: w(:, :, :), hh(:, :, :), halves(:, :, :)

      call number_pair(first, second, known%level + 1, known%index, known%length/2)
      call halve(d%asked%rate, known%length, known%shape, known%u, first%shape, second%shape)
      call draw_halving(d, nlane, path, known%index, first%level + 1, first%length, first%u, second%u, drawn)
      allocate (w(nlane, d%nnoise, 4), hh(nlane, d%nnoise, 4), halves(nlane, d%nnoise, 2))
      halves(:, :, 1) = first%shape%w
      halves(:, :, 2) = second%shape%w
      call halve(d%asked%rate, first%length, first%shape, first%u, a, b)
      call keep(1)
      call halve(d%asked%rate, second%length, second%shape, second%u, a, b)
      call keep(3)
      call magnus_of_quarters(nlane, d%nnoise, d%asked, first%length/2, w, hh, halves, x)

   contains

      subroutine keep(i)
         integer, intent(in) :: i

         w(:, :, i) = a%w
         hh(:, :, i) = a%hh
         w(:, :, i + 1) = b%w
         hh(:, :, i + 1) = b%hh
      end subroutine keep

   end subroutine merge_quarters

   !> Make the functionals of an interval from those of its halves, down to the last level. The interrupt is checked
   !> when levels_unseen + 1 levels remain: often enough to stop soon, seldom enough to cost little.
   recursive subroutine merge_halves(d, nlane, path, last, known, whole, drawn)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane
      integer, intent(in) :: last                         !! level of the finest intervals
      integer(i8), intent(in) :: path(nlane)
      type(known_interval), intent(in) :: known
      type(path_interval), intent(out) :: whole
      integer(i8), intent(inout) :: drawn
      type(path_interval) :: left, right
      type(known_interval) :: first, second

      if (last - known%level == levels_unseen + 1) call d%look()
      if (d%is_left()) return
      call number_pair(first, second, known%level + 1, known%index, known%length/2)
      ! The caller made the draws of this halving together with those of the neighbouring interval.
      call halve(d%asked%rate, known%length, known%shape, known%u, first%shape, second%shape)
      if (first%level == last) then
         call finest_interval(d, nlane, first%length, first%shape, left)
         call finest_interval(d, nlane, second%length, second%shape, right)
      else
         ! Draw for the next halving, of both halves at once.
         call draw_halving(d, nlane, path, known%index, first%level + 1, first%length, first%u, second%u, drawn)
         call merge_halves(d, nlane, path, last, first, left, drawn)
         call merge_halves(d, nlane, path, last, second, right, drawn)
         if (d%is_left()) return
      end if
      call merge_intervals(nlane, d%nnoise, d%asked, left, right, whole)
      whole%w = known%shape%w  ! equals the sum of the halves, to rounding
   end subroutine merge_halves

   !> Number the intervals 2*pair and 2*pair+1 of a level.
   pure subroutine number_pair(even, odd, level, pair, length)
      type(known_interval), intent(out) :: even, odd
      integer, intent(in) :: level
      integer(i8), intent(in) :: pair
      real(wp), intent(in) :: length

      even%level = level
      odd%level = level
      even%index = 2*pair
      odd%index = 2*pair + 1
      even%length = length
      odd%length = length
   end subroutine number_pair

   !> Make an interval from its shape: dW itself, and each functional by its formula.
   subroutine finest_interval(d, nlane, length, shape, interval, whole)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane
      real(wp), intent(in) :: length
      type(path_shape), intent(in) :: shape
      type(path_interval), intent(out) :: interval
      logical, intent(in), optional :: whole  !! a step, whose J is that of its quarters, and is not computed here
      logical :: quartered
      integer :: f

      quartered = .false.
      if (present(whole)) quartered = whole
      call new_path_interval(interval, nlane, d%nnoise, length, d%asked)
      interval%w = shape%w
      do f = 1, nfunctional
         if (f == path_decay .and. d%asked%has(f)) then
            call decay_values(nlane, d%nnoise, length, d%asked%rate, shape%w, shape%hh, shape%kk, interval%of(f)%x, &
                              shape%xi)
         else if (d%asked%has(f) .and. .not. (quartered .and. f == path_magnus)) then
            call shape_values(f, d%asked, nlane, d%nnoise, length, shape%w, shape%hh, interval%of(f)%x, shape%kk, &
                              shape%rest)
         end if
      end do
   end subroutine finest_interval

   !> Draw Z, N or M, and D for the halvings of the intervals 2*pair and 2*pair+1 of one length. The level keeps the
   !> halvings of intervals of different lengths apart.
   subroutine draw_halving(d, nlane, path, pair, level, length, even, odd, drawn)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane, level                 !! level of this halving, from 1
      integer(i8), intent(in) :: path(nlane), pair
      real(wp), intent(in) :: length                      !! length of the intervals to be halved
      type(halving_draws), intent(inout) :: even, odd
      integer(i8), intent(inout) :: drawn
      real(wp) :: parts

      ! Variance of N as a fraction 1/parts of |h|, and of M if K is known.
      parts = 12
      call draw(d, normal_stream(level=level, purpose=purpose_halving, scale=sqrt(abs(length)/16)), nlane, path, pair, &
                even%z, odd%z, drawn)
      if (d%needs_stt_area()) then
         parts = 192
         call draw(d, normal_stream(level=level, purpose=purpose_stt_halving, scale=sqrt(abs(length)/180)), nlane, &
                   path, pair, even%d, odd%d, drawn)
      end if
      call draw(d, normal_stream(level=level, purpose=purpose_halves, scale=sqrt(abs(length)/parts)), nlane, path, &
                pair, even%n, odd%n, drawn)
      if (.not. d%asked%has(path_decay)) return
      call draw(d, normal_stream(level=level, purpose=purpose_decay, scale=1.0_wp), nlane, path, pair, even%xi_1, &
                odd%xi_1, drawn)
      call draw(d, normal_stream(level=level, purpose=purpose_second_decay, scale=1.0_wp), nlane, path, pair, &
                even%xi_2, odd%xi_2, drawn)
   end subroutine draw_halving

end module symsde_noise_integrals
