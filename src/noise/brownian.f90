! SPDX-License-Identifier: BSD-3-Clause
!> Brownian increments from the counter-based generator: every draw is a function of (seed, path, step, noise).
!>
!> refine = 0   dW = sqrt(h) xi, one normal a step
!> refine = l   the sum of 2^l normals at step h/2^l, added as a balanced binary tree: the increments at
!>              refine = l equal, bit for bit, the sums of two at step h/2 and refine = l-1
!> refine = -l  the increments at step 2^l h, halved l times by the Brownian bridge, so that a run can be
!>              repeated at half its step on the same path: W_1 = W/2 + sqrt(H)/2 xi, W_2 = W - W_1
!>
!> where H = 2^l h .. 2h is the step that is halved. Increments of a discrete law are sums of discrete draws at refine
!> > 0, and have no bridge. A noise that is common to all paths is drawn with the counters of path 0 for each of them.
!> A silent noise has dW = 0 and draws nothing, which changes no other noise: each has counters of its own.
!>
!> The contents of a request decide which procedure fills it:
!>
!>    functionals of the path (dZ, areas, ..)      fill_functionals, by noise/integrals
!>    Gaussian, refine = 0, from an even pair on   fill_ahead: draws whose four normals are all used
!>    everything else                              fill_others, by noise/levels or by sums of discrete draws
!>
!> All three give a step the same numbers. They differ in whether lanes of the generator are the paths of a block, or
!> steps and noises of few paths: a vector of few paths would be mostly padding.
module symsde_noise_brownian
   use symsde_base_contracts, only: contracts_are_executed
   use symsde_base_functionals, only: nfunctional, path_areas
   use symsde_base_interrupt, only: interrupt_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lane_unit
   use symsde_base_laws, only: law_gaussian, law_text
   use symsde_base_record, only: step_request, step_store
   use symsde_base_status, only: error_type, raise, invalid_argument, incompatible
   use symsde_base_text, only: to_text
   use symsde_noise_contract, only: require_request, require_filled
   use symsde_noise_discrete, only: discrete_pairs
   use symsde_noise_few_paths, only: are_few, draw_few
   use symsde_noise_functionals, only: path_interval, clip_increments, clip_interval
   use symsde_noise_integral_draws, only: integral_draws, fill_direct
   use symsde_noise_integrals, only: fill_pair
   use symsde_noise_levels, only: normals_of, sum_finer, halve_coarser, carry
   use symsde_noise_normal, only: normal_stream, scaled_normal_steps, pairs_of_steps
   use symsde_noise_philox, only: purpose_increment
   use symsde_noise_quarters, only: are_quartered, fill_quarters
   use symsde_noise_source, only: noise_type
   implicit none
   private
   public :: brownian_noise, new_brownian_noise

   integer, parameter, public :: max_refine = 30  !! largest |refine|

   !> A source is immutable: all threads fill their stores from the same source.
   type, extends(noise_type) :: brownian_noise
      private
      integer(i8) :: seed = 0
      integer :: refine = 0
      real(wp) :: h = 0   !! step size of the run [time]
      real(wp) :: signed_h = 0
      integer :: law = law_gaussian
   contains
      procedure :: fill => fill_brownian
   end type brownian_noise

contains

   !> Make a Brownian source for a run with step h. Refused are a bridge of discrete increments, which do not halve
   !> into others of their law, and more than max_refine levels, each of which doubles the number of draws.
   subroutine new_brownian_noise(self, nnoise, seed, h, refine, silent, error, law)
      type(brownian_noise), intent(out) :: self
      integer, intent(in) :: nnoise       !! m
      integer(i8), intent(in) :: seed     !! all 64 bits are the key of the generator
      real(wp), intent(in) :: h           !! step size, may be negative: |h| sets the variance [time]
      integer, intent(in) :: refine       !! levels finer (> 0) or coarser (< 0) than one draw a step
      logical, intent(in) :: silent(:)    !! silent noises, which need no draws (nnoise)
      type(error_type), allocatable, intent(inout) :: error
      integer, intent(in), optional :: law !! law of increments (base/laws); Gaussian if absent

      if (present(law)) self%law = law
      if (self%law /= law_gaussian .and. refine < 0) then
         call raise(error, incompatible, 'new_brownian_noise', 'refine = '//to_text(refine)// &
                    ' halves Gaussian increments, and these are '//law_text(self%law)// &
                    ': give refine >= 0, or a scheme with Gaussian increments')
         return
      end if
      if (refine < -max_refine .or. refine > max_refine) then  ! the smallest integer has no absolute value
         call raise(error, invalid_argument, 'new_brownian_noise', 'refine = '//to_text(refine)// &
                    ' is out of range: give an integer between -'//to_text(max_refine)//' and '// &
                    to_text(max_refine)//', each level doubles the number of draws')
         return
      end if
      self%nnoise = nnoise
      self%seed = seed
      ! |h| makes the scale of dW; dZ and other functionals need the sign.
      self%h = abs(h)
      self%signed_h = h
      self%refine = refine
      self%silent = silent
      ! Noises that all paths share are named by the caller later on.
      allocate (self%common(nnoise), source=.false.)
   end subroutine new_brownian_noise

   !> Fill the steps 2 pair .. 2 pair + 2 npair - 1 of the request. Several pairs at once give the same numbers as pair
   !> by pair, but use every word of a draw, and spare few paths the cost of padding.
   subroutine fill_brownian(self, request, store, drawn, interrupt)
      class(brownian_noise), intent(in) :: self
      type(step_request), intent(in) :: request
      type(step_store), intent(inout) :: store
      integer(i8), intent(out) :: drawn
      class(interrupt_type), intent(inout), target, optional :: interrupt

      if (contracts_are_executed) call require_request(self, request, store)
      drawn = 0
      ! Discrete increments of few paths are drawn by fill_functionals, too: it draws several steps at once, and gives
      ! the same increments.
      if (.not. self%asked%is_empty() .or. &
          (self%law /= law_gaussian .and. looks_ahead(self, request))) then
         call fill_functionals(self, request, store, drawn, interrupt)
      else if (self%law == law_gaussian .and. self%refine == 0 .and. mod(request%pair, 2_i8) == 0) then
         call fill_ahead(self, request%nlane, request%nreal, request%path, request%pair, request%npair, store%w, drawn)
      else
         call fill_others(self, request, store%w, drawn, interrupt)
      end if
      if (contracts_are_executed) call require_filled(self, request, store, 0, 2*request%npair - 1, interrupt)
   end subroutine fill_brownian

   !> Make increments of several steps for any law and refinement, one noise after another: dw (nlane, steps) of one
   !> noise is an array of its own, copied to its column of w. Truncation comes last, on the increments of steps.
   subroutine fill_others(self, request, w, drawn, interrupt)
      class(brownian_noise), intent(in) :: self
      type(step_request), intent(in) :: request
      real(wp), intent(inout) :: w(request%nlane, 0:self%nnoise, 0:2*request%npair - 1)
      integer(i8), intent(inout) :: drawn
      class(interrupt_type), intent(inout), target, optional :: interrupt
      real(wp), allocatable :: dw(:, :)
      type(normals_of) :: normals
      integer :: k, step

      ! In dw the steps of one noise are adjacent, as sums and bridges need; in w the noises of one step are adjacent.
      allocate (dw(request%nlane, 0:2*request%npair - 1))
      normals%seed = self%seed
      normals%nreal = request%nreal
      if (present(interrupt)) normals%interrupt => interrupt
      associate (nlane => request%nlane, first => 2*request%pair, nstep => 2*request%npair, levels => abs(self%refine))
         do k = 1, self%nnoise
            if (self%silent(k)) then
               w(:, k, :) = 0
               cycle
            end if
            normals%noise = k
            ! Every lane of a common noise has the counters of path 0, and so the same numbers.
            normals%path = merge(0_i8, request%path, self%common(k))
            if (self%law /= law_gaussian) then
               call sum_discrete(self, normals, nlane, first, nstep, dw, drawn)
            else if (self%refine > 0) then
               call sum_finer(normals, nlane, first, nstep, levels, self%h, dw, drawn)
            else
               ! At refine = 0 no increment is halved: these are plain draws that begin with an odd pair.
               call halve_coarser(normals, nlane, first, nstep, levels, self%h, dw, drawn)
            end if
            ! An interrupt leaves w unfinished: no caller uses it.
            if (normals%is_left()) return
            do step = 0, nstep - 1
               if (self%bound < huge(1.0_wp)) call clip_increments(nlane, self%bound, dw(:, step))
               w(:, k, step) = dw(:, step)
            end do
         end do
      end associate
   end subroutine fill_others

   !> Gaussian increments of several pairs from an even one on, one draw a step: dW = sqrt(h) xi. A draw makes four
   !> normals, for the steps of two pairs, so a path needs (npair + 1)/2 draws. If all paths together need few
   !> draws, draws and paths fill the lanes of the generator side by side.
   subroutine fill_ahead(self, nlane, nreal, path, pair, npair, w, drawn)
      class(brownian_noise), intent(in) :: self
      integer, intent(in) :: nlane, nreal
      integer(i8), intent(in) :: path(nlane), pair
      integer, intent(in) :: npair
      real(wp), intent(inout) :: w(nlane, 0:self%nnoise, 0:2*npair - 1)
      integer(i8), intent(inout) :: drawn
      logical :: few
      integer :: k

      few = are_few(nreal, npair)
      do k = 1, self%nnoise
         if (self%silent(k)) then
            w(:, k, :) = 0
         else
            if (.not. few) call fill_many(self, nlane, path, pair, npair, k, w)
            ! One normal for each step of this noise, however many paths there are.
            drawn = drawn + 2*npair
         end if
      end do
      if (few) call draw_few(normal_stream(self%seed, 0, 0, purpose_increment, sqrt(self%h)), self%silent, &
                             self%common, self%bound, nlane, nreal, path, pair, npair, self%nnoise + 1, w(1, 1, 0))
   end subroutine fill_ahead

   !> Noise k for whole blocks: the lanes of the generator are the paths, and the normals are written directly into w,
   !> up to pairs_of_steps pairs in one pass.
   subroutine fill_many(self, nlane, path, pair, npair, k, w)
      class(brownian_noise), intent(in) :: self
      integer, intent(in) :: nlane, npair, k
      integer(i8), intent(in) :: path(nlane), pair
      real(wp), intent(inout) :: w(nlane, 0:self%nnoise, 0:2*npair - 1)
      integer(i8) :: from(nlane)
      integer :: j, step

      from = merge(0_i8, path, self%common(k))
      do j = 0, npair - 1, pairs_of_steps
         call scaled_normal_steps(nlane, normal_stream(self%seed, k, 0, purpose_increment, sqrt(self%h)), from, &
                                  pair + j, min(pairs_of_steps, npair - j), self%nnoise, w(1, 0, 2*j))
      end do
      if (.not. self%bound < huge(1.0_wp)) return
      do step = 0, 2*npair - 1
         call clip_increments(nlane, self%bound, w(:, k, step))
      end do
   end subroutine fill_many

   !> Fill increments and functionals of the path, step by step in the arrays of noise/integrals, which are then
   !> copied into the store.
   subroutine fill_functionals(self, request, store, drawn, interrupt)
      class(brownian_noise), intent(in) :: self
      type(step_request), intent(in) :: request
      type(step_store), intent(inout) :: store
      integer(i8), intent(inout) :: drawn
      class(interrupt_type), intent(inout), target, optional :: interrupt
      type(integral_draws) :: draws
      type(path_interval) :: steps(0:1)
      integer(i8) :: of_path, behind
      integer :: i, f

      ! The arguments of all draws; the caller sets how many lanes are drawn.
      draws = integral_draws(self%nnoise, self%seed, self%signed_h, self%refine, self%silent, self%common, &
                             self%asked, self%areas, self%law)
      if (present(interrupt)) draws%interrupt => interrupt
      ! Without truncation dZ and K are written into the store directly, as dW is.
      if (draws%are_direct() .and. mod(request%pair, 2_i8) == 0 .and. .not. self%bound < huge(1.0_wp)) then
         call fill_direct(draws, request, store, drawn)
         return
      end if
      if (are_quartered(draws) .and. mod(request%pair, 2_i8) == 0 .and. .not. looks_ahead(self, request) .and. &
          .not. self%bound < huge(1.0_wp)) then
         call fill_quarters(draws, request, store, drawn)
         return
      end if
      ! Path by path, each with all its steps as lanes. At refine < 0 steps are halves of longer intervals, so the
      ! lanes are counted from the first pair of the interval that holds the first step.
      if (looks_ahead(self, request)) then
         behind = mod(request%pair, 2_i8**max(-self%refine, 0))
         call draws%look_ahead(request%npair, behind)
         do i = 1, request%nreal
            call fill_alone(self, draws, request, request%pair - behind, i, store, of_path)
            if (draws%is_left()) return
         end do
         ! `drawn` counts the normals of one path.
         drawn = drawn + of_path
         call repeat_last(self, request, store)
         return
      end if
      do i = 0, 2*request%npair - 1
         ! Two steps at a time, since one call makes both.
         if (mod(i, 2) == 0) &
            call fill_pair(draws, request%nlane, request%path, request%pair + i/2, steps(0), steps(1), drawn)
         if (draws%is_left()) return
         associate (step => steps(mod(i, 2)))
            if (self%bound < huge(1.0_wp)) call clip_interval(request%nlane, self%nnoise, self%bound, step)
            ! Column 0 of the weights is h, which the store has from the beginning.
            store%w(:, 1:, i) = step%w
            do f = 1, nfunctional
               if (self%asked%has(f)) store%of(f)%x(:, :, i) = step%of(f)%x
            end do
         end associate
      end do
   end subroutine fill_functionals

   !> Whether lanes are pairs of steps instead of paths: for one path, and for up to a vector of paths if a step is a
   !> sum of many draws, but not with areas, whose sub-increments fill the lanes.
   pure logical function looks_ahead(self, request)
      class(brownian_noise), intent(in) :: self
      type(step_request), intent(in) :: request

      looks_ahead = request%npair > 1 .and. mod(request%pair, 2_i8) == 0 .and. &
                    request%nlane <= merge(lane_unit, 1, self%refine /= 0 .and. .not. self%asked%has(path_areas))
   end function looks_ahead

   !> Give padding the increments and functionals of the last path, so that models and solvers see in padding only
   !> values that a real path has.
   subroutine repeat_last(self, request, store)
      class(brownian_noise), intent(in) :: self
      type(step_request), intent(in) :: request
      type(step_store), intent(inout) :: store
      integer :: lane, f

      associate (n => request%nreal, last => 2*request%npair - 1)
         do lane = n + 1, request%nlane
            store%w(lane, 1:, :last) = store%w(n, 1:, :last)
            do f = 1, nfunctional
               if (self%asked%has(f)) store%of(f)%x(lane, :, :last) = store%of(f)%x(n, :, :last)
            end do
         end do
      end associate
   end subroutine repeat_last

   !> Fill a single path. The lanes of the generator, and of all values derived from its draws, are pairs of steps,
   !> an even one first. steps(0) holds the even step of every pair, steps(1) the odd one, in the order of
   !> look_ahead: even pairs first, then odd pairs.
   subroutine fill_alone(self, draws, request, pair, lane, store, drawn)
      class(brownian_noise), intent(in) :: self
      type(integral_draws), intent(in) :: draws  !! draws, with `ahead` set by look_ahead
      type(step_request), intent(in) :: request
      integer(i8), intent(in) :: pair            !! pair from which `ahead` counts
      integer, intent(in) :: lane                !! lane of the path in the block
      type(step_store), intent(inout) :: store
      integer(i8), intent(out) :: drawn
      integer(i8), allocatable :: path(:)
      type(path_interval) :: steps(0:1)
      integer(i8) :: of_pair
      integer :: i, f, n

      ! n counts the lanes of the generator: even and odd pairs of steps, each padded to whole vectors.
      n = size(draws%ahead)
      allocate (path(n), source=request%path(lane))
      of_pair = 0
      call fill_pair(draws, n, path, pair, steps(0), steps(1), of_pair)
      if (draws%is_left()) return
      ! of_pair counts the draws of one lane for its two steps.
      drawn = request%npair*of_pair
      do i = 0, 1
         ! The lanes are steps, but each is truncated like a step of a block.
         if (self%bound < huge(1.0_wp)) call clip_interval(n, self%nnoise, self%bound, steps(i))
         ! Skip the first of the nnoise + 1 columns of weights, which is h.
         call spread_lanes(self%nnoise, self%nnoise + 1, steps(i)%w, store%w(lane, 1, i))
         do f = 1, nfunctional
            if (.not. self%asked%has(f)) cycle
            associate (x => steps(i)%of(f)%x)
               call spread_lanes(size(x, 2), size(x, 2), x, store%of(f)%x(lane, 1, i))
            end associate
         end do
      end do

   contains

      !> Spread x (lanes, ncolumn) over every other step of an array with nstep columns a step: pair j goes to step 2
      !> j.
      pure subroutine spread_lanes(ncolumn, nstep, x, w)
         integer, intent(in) :: ncolumn, nstep
         real(wp), intent(in) :: x(n, ncolumn)
         !> Begins with this path's lane of the first column.
         real(wp), intent(inout) :: w(1 + request%nlane*(2*(request%npair - 1)*nstep + ncolumn - 1))
         integer, parameter :: tile = 16  ! pairs: columns of all of them may fall on the same lines of a cache
         integer :: first, j, k

         do first = 0, request%npair - 1, tile
            do k = 1, ncolumn
               do j = first, min(first + tile, request%npair) - 1  ! x has the odd pairs after the even ones
                  ! A column of the store has nlane numbers; this path's is written.
                  w(1 + request%nlane*(2*j*nstep + k - 1)) = x(1 + j/2 + mod(j, 2)*(n/2), k)
               end do
            end do
         end do
      end subroutine spread_lanes

   end subroutine fill_alone

   !> Sum increments of a discrete law, 2^refine draws of variance h/2^refine each, as a balanced binary tree. One draw
   !> gives two neighbours: two steps at refine = 0, else two leaves of one step.
   subroutine sum_discrete(self, of, nlane, first, nstep, dw, drawn)
      class(brownian_noise), intent(in) :: self
      type(normals_of), intent(in) :: of       !! noise and paths of the draws
      integer, intent(in) :: nlane, nstep
      integer(i8), intent(in) :: first
      real(wp), intent(inout) :: dw(nlane, 0:nstep - 1)
      integer(i8), intent(inout) :: drawn
      real(wp) :: even(nlane), odd(nlane), scale
      real(wp), allocatable :: partial(:, :)
      integer(i8) :: i, npair
      integer :: step

      ! Standard deviation of a draw at the finest step.
      scale = sqrt(self%h/2.0_wp**self%refine)
      ! Pairs of draws in a step, one at refine = 0, where a pair is two steps.
      npair = 2_i8**max(self%refine - 1, 0)
      allocate (partial(nlane, max(self%refine - 1, 0)))
      do step = 0, nstep - 1, merge(2, 1, self%refine == 0)
         do i = 0, npair - 1
            if (of%is_left()) return
            call discrete_pairs(nlane, self%seed, of%path, (first + step)*2_i8**self%refine/2 + i, of%noise, self%law, &
                                even, odd)
            drawn = drawn + 2
            even = scale*even
            odd = scale*odd
            ! At refine = 0 both values of the draw are steps.
            if (self%refine == 0) exit
            ! The lowest level of the tree; `carry` adds the levels above.
            even = even + odd
            call carry(nlane, i, partial, even)
         end do
         dw(:, step) = even
         if (self%refine == 0) dw(:, step + 1) = odd
      end do
   end subroutine sum_discrete

end module symsde_noise_brownian
