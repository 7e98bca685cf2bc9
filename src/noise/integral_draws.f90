! SPDX-License-Identifier: BSD-3-Clause
!> The normals behind increments and functionals of a path (noise/integrals): each is a function of seed, path, step,
!> and its purpose.
!>
!> On a finest interval of length h the normals are, independent of each other,
!>
!>    dW ~ N(0, |h|),   H = dZ/h - dW/2 ~ N(0, |h|/12),   K ~ N(0, |h|/720),   rest of an area ~ N(0, h^2/20),
!>    xi ~ N(0, 1) of D_k (noise/decay_law)
!>
!> and in the halving of an interval Z, N or M, D, and xi of its halves (noise/integrals). Each has a purpose word of
!> its own in the counter, each halving a level, and each interval of a level a pair and a place in it: no two draws of
!> a run share a counter.
!>
!> The lanes of a block are paths in the same steps; for a single path the lanes are pairs of steps instead. Both use
!> the same counters, so the numbers do not depend on what the lanes are.
module symsde_noise_integral_draws
   use symsde_base_area_rule, only: area_rule, areas_in_law
   use symsde_base_functionals, only: functional_set, functional_count, area_index, path_areas, path_dz, &
                                      path_stt_area
   use symsde_base_interrupt, only: interrupt_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: padded
   use symsde_base_laws, only: law_gaussian
   use symsde_base_record, only: step_request, step_store
   use symsde_noise_few_paths, only: are_few, draw_few
   use symsde_noise_normal, only: normal_stream, &
                                  scaled_normal_pairs, scaled_normal_column, scaled_normals_at, scaled_pairs_at, &
                                  pairs_of_steps
   use symsde_noise_philox, only: purpose_increment, purpose_shape, purpose_stt_area, purpose_rest
   implicit none
   private
   public :: integral_draws, fill_direct, shape_draws, draw, draw_rests

   !> The arguments of all draws of a run.
   type :: integral_draws
      integer :: nnoise = 0
      integer(i8) :: seed = 0
      real(wp) :: h = 0                    !! step of the run, with its sign [time]
      integer :: refine = 0
      logical, allocatable :: silent(:)    !! silent noises, which need no draws (nnoise)
      logical, allocatable :: common(:)    !! noises drawn with the counters of path 0 for all paths (nnoise)
      type(functional_set) :: asked        !! functionals asked for
      type(area_rule) :: areas             !! how areas are drawn
      integer :: law = law_gaussian        !! law of the increments (base/laws)
      !> For a single path, the pairs of steps from the requested pair to each lane's pair (nlane)
      integer(i8), allocatable :: ahead(:)
      class(interrupt_type), pointer :: interrupt => null()  !! may stop the draws
   contains
      procedure :: look
      procedure :: is_left
      procedure :: are_direct
      procedure :: look_ahead
      procedure :: in_law
      procedure :: needs_stt_area
   end type integral_draws

contains

   !> Look whether a stop is wanted, since areas of many sub-increments take long.
   subroutine look(self)
      class(integral_draws), intent(in) :: self

      if (associated(self%interrupt)) call self%interrupt%look()
   end subroutine look

   !> Whether an interrupt has stopped the draws, so that all values made from them are invalid.
   pure logical function is_left(self)
      class(integral_draws), intent(in) :: self

      ! Without an interrupt the draws are never left.
      is_left = .false.
      if (associated(self%interrupt)) is_left = self%interrupt%wanted
   end function is_left

   !> Whether only dZ, or dZ and K, are asked for, and steps are used as drawn: no interval is halved or merged.
   pure logical function are_direct(self)
      class(integral_draws), intent(in) :: self

      are_direct = self%refine == 0 .and. self%asked%has(path_dz) .and. &
                   count(self%asked%has) == count(self%asked%has([path_dz, path_stt_area]))
   end function are_direct

   !> Let the lanes be npair pairs of steps of a path, from an even pair on. Even pairs fill the first half of the
   !> lanes, odd pairs the second: an even pair and the next odd pair share a draw. `ahead` counts pairs from the first
   !> pair of the coarsest interval, of which `behind` pairs come before the wanted steps. Both halves are padded to
   !> whole vectors.
   pure subroutine look_ahead(self, npair, behind)
      class(integral_draws), intent(inout) :: self
      integer, intent(in) :: npair
      integer(i8), intent(in) :: behind  !! even
      integer :: half, i

      ! An odd number of pairs leaves a lane of the second half without use.
      half = padded((npair + 1)/2)
      allocate (self%ahead(2*half))
      do i = 1, half
         ! Lane i of each half: the pairs number 2 i - 2 and 2 i - 1 from the first wanted one.
         self%ahead(i) = behind + 2*(i - 1)
         self%ahead(half + i) = behind + 2*i - 1
      end do
   end subroutine look_ahead

   !> Draw the numbers of fill_pair directly into the store, for several pairs of steps, an even one first, so that
   !> all words of a draw are used. For each noise draw dW, then H in the place of dZ, then K if asked for; at the
   !> end dZ = h (dW/2 + H) replaces H.
   subroutine fill_direct(d, request, store, drawn)
      type(integral_draws), intent(in) :: d
      type(step_request), intent(in) :: request
      type(step_store), intent(inout) :: store
      integer(i8), intent(inout) :: drawn
      integer(i8) :: from(request%nlane)
      integer :: k, j, step, n
      logical :: few
      real(wp) :: root

      ! Standard deviations as at the head of this file; |h|, since a step back in time has the same law.
      root = sqrt(abs(d%h))
      associate (w => store%w, dz => store%of(path_dz), stt_area => store%of(path_stt_area), m => d%nnoise)
         few = are_few(request%nreal, request%npair)
         if (few) then
            call draw_beside(purpose_increment, root, m + 1, w(1, 1, 0))
            call draw_beside(purpose_shape, sqrt(abs(d%h)/12), m, dz%x(1, 1, 0))
            if (allocated(stt_area%x)) call draw_beside(purpose_stt_area, sqrt(abs(d%h)/720), m, stt_area%x(1, 1, 0))
         end if
         do k = 1, m
            if (few .or. d%silent(k)) cycle
            ! A noise that all paths share is drawn for path 0 in every lane.
            from = merge(0_i8, request%path, d%common(k))
            do j = 0, request%npair - 1, pairs_of_steps
               ! Take as many pairs as two draws hold: the generator makes at most two draws in one pass.
               n = min(pairs_of_steps, request%npair - j)
               ! w has a column for h, hence m + 1 columns a step; functionals have m.
               call draw_column(purpose_increment, root, m + 1, w(1, k, 2*j))
               call draw_column(purpose_shape, sqrt(abs(d%h)/12), m, dz%x(1, k, 2*j))
               if (allocated(stt_area%x)) &
                  call draw_column(purpose_stt_area, sqrt(abs(d%h)/720), m, stt_area%x(1, k, 2*j))
            end do
         end do
         do step = 0, 2*request%npair - 1
            ! dZ comes last, since H is drawn for several steps in one pass.
            call dz_of_shape(request%nlane*m, d%h, w(1, 1, step), dz%x(1, 1, step))
         end do
         do k = 1, m
            if (.not. d%silent(k)) cycle
            w(:, k, :) = 0
            dz%x(:, k, :) = 0
            if (allocated(stt_area%x)) stt_area%x(:, k, :) = 0
         end do
      end associate

   contains

      !> Draw one functional of all noises in all steps of few paths, N(0, scale^2) into x.
      subroutine draw_beside(purpose, scale, ncolumn, x)
         integer, intent(in) :: purpose, ncolumn
         real(wp), intent(in) :: scale
         !> Begins with the column of the first noise.
         real(wp), intent(inout) :: x(request%nlane*(ncolumn*(2*request%npair - 1) + d%nnoise))

         call draw_few(normal_stream(d%seed, 0, 0, purpose, scale), d%silent, d%common, huge(1.0_wp), request%nlane, &
                       request%nreal, request%path, request%pair, request%npair, ncolumn, x)
         drawn = drawn + 2*request%npair*count(.not. d%silent)
      end subroutine draw_beside

      !> Draw one functional of noise k in n pairs of steps: N(0, scale^2) into every ncolumn-th column of x, which
      !> begins with the column of this noise in the first of these steps.
      subroutine draw_column(purpose, scale, ncolumn, x)
         integer, intent(in) :: purpose, ncolumn
         real(wp), intent(in) :: scale
         real(wp), intent(inout) :: x(request%nlane*(ncolumn*(2*n - 1) + 1))

         call scaled_normal_column(request%nlane, normal_stream(d%seed, k, 0, purpose, scale), from, request%pair + j, &
                                   n, ncolumn, x)
         drawn = drawn + 2*n
      end subroutine draw_column

   end subroutine fill_direct

   !> dZ = h (dW/2 + H) of n lanes and noises, in the place of H; h has its sign.
   pure subroutine dz_of_shape(n, h, w, z)
      integer, intent(in) :: n
      real(wp), intent(in) :: h, w(n)
      real(wp), intent(inout) :: z(n)
      integer :: i

      do i = 1, n
         z(i) = h*(0.5_wp*w(i) + z(i))
      end do
   end subroutine dz_of_shape

   !> Whether areas are asked for and drawn in law: K and a normal term then replace sub-increments, and halving the
   !> step would give other areas.
   pure logical function in_law(self)
      class(integral_draws), intent(in) :: self

      in_law = self%asked%has(path_areas) .and. self%areas%kind == areas_in_law
   end function in_law

   !> Whether K is drawn, too: if it is asked for, or part of areas in law.
   pure logical function needs_stt_area(self)
      class(integral_draws), intent(in) :: self

      needs_stt_area = self%asked%has(path_stt_area) .or. self%in_law()
   end function needs_stt_area

   !> Draw the normal terms of areas for the intervals 2*pair and 2*pair+1: scaled normals for all pairs of noises k <
   !> l. They are zero if one of the two noises is silent, and taken from path 0 if both are common. The counter's word
   !> for the noise holds the index of the pair; the purpose keeps pairs apart from noises.
   subroutine draw_rests(d, nlane, path, pair, scale, even, odd, drawn)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane), pair
      real(wp), intent(in) :: scale
      real(wp), allocatable, intent(out) :: even(:, :), odd(:, :)  !! (nlane, pairs of noises)
      integer(i8), intent(inout) :: drawn
      integer(i8) :: from(nlane)
      integer :: k, l, kl

      ! Zero for silent pairs, which are skipped below.
      allocate (even(nlane, functional_count(path_areas, d%nnoise)), source=0.0_wp)
      allocate (odd, source=even)
      do l = 2, d%nnoise
         do k = 1, l - 1
            ! A silent noise has no area with another.
            if (d%silent(k) .or. d%silent(l)) cycle
            ! The index of the pair, instead of the number of a noise.
            kl = area_index(k, l)
            from = merge(0_i8, path, d%common(k) .and. d%common(l))
            call draw_one(d, normal_stream(d%seed, kl, 0, purpose_rest, scale), nlane, from, pair, even(:, kl), &
                          odd(:, kl))
            drawn = drawn + 2
         end do
      end do
   end subroutine draw_rests

   !> Draw H = dZ/h - dW/2 and K of noise k at the finest steps 2*pair and 2*pair+1: the numbers of fill_pair, for
   !> callers that need no dW.
   subroutine shape_draws(nlane, seed, path, pair, k, h, hh, kk, drawn)
      integer, intent(in) :: nlane, k
      integer(i8), intent(in) :: seed, path(nlane), pair
      real(wp), intent(in) :: h            !! length of a step, either sign [time]
      real(wp), intent(out) :: hh(nlane, 0:1), kk(nlane, 0:1)
      integer(i8), intent(inout) :: drawn

      ! The streams: level 0, since no interval is halved, and the purpose.
      call scaled_normal_pairs(nlane, normal_stream(seed, k, 0, purpose_shape, sqrt(abs(h)/12)), path, pair, hh(:, 0), &
                               hh(:, 1))
      call scaled_normal_pairs(nlane, normal_stream(seed, k, 0, purpose_stt_area, sqrt(abs(h)/720)), path, pair, &
                               kk(:, 0), kk(:, 1))
      ! Two numbers of H and two of K.
      drawn = drawn + 4
   end subroutine shape_draws

   !> Draw scaled normals of all noises for the intervals 2*pair and 2*pair+1 of a level, into (nlane, nnoise) each;
   !> zero for silent noises. `of` gives level, purpose and scale; the noise runs from 1 to nnoise here.
   subroutine draw(d, of, nlane, path, pair, even, odd, drawn)
      type(integral_draws), intent(in) :: d
      type(normal_stream), intent(in) :: of   !! seed and noise are set here
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane), pair
      real(wp), allocatable, intent(inout) :: even(:, :), odd(:, :)  !! (nlane, nnoise)
      integer(i8), intent(inout) :: drawn
      integer(i8) :: from(nlane)
      integer :: k

      ! Allocated once, for callers that halve again and again.
      if (.not. allocated(even)) allocate (even(nlane, d%nnoise), odd(nlane, d%nnoise))
      do k = 1, d%nnoise
         if (d%silent(k)) then
            even(:, k) = 0
            odd(:, k) = 0
            cycle
         end if
         from = merge(0_i8, path, d%common(k))
         call draw_one(d, normal_stream(d%seed, k, of%level, of%purpose, of%scale), nlane, from, pair, even(:, k), &
                       odd(:, k))
         drawn = drawn + 2
      end do
   end subroutine draw

   !> Draw the normals of one noise, or of one pair of noises. If lanes are paths, they share the pair of steps. If
   !> lanes are ahead, each has its own pair: a step `ahead` pairs later is 2^finer times as many pairs of these
   !> intervals later.
   subroutine draw_one(d, of, nlane, path, pair, even, odd)
      type(integral_draws), intent(in) :: d
      type(normal_stream), intent(in) :: of
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane), pair
      real(wp), intent(out) :: even(nlane), odd(nlane)
      integer(i8) :: at(nlane)  ! pairs of intervals of this length
      integer :: noises(nlane), finer

      if (.not. allocated(d%ahead)) then
         call scaled_normal_pairs(nlane, of, path, pair, even, odd)
         return
      end if
      ! If intervals are finer than steps, every lane needs its own draw. Its pairs are all even or all odd, since
      ! they lie multiples of two apart.
      finer = d%refine + max(of%level - 1, 0)
      at = pair + ishft(d%ahead, finer)
      if (finer > 0) then
         call scaled_pairs_at(nlane, of, path, at, even, odd)
      else
         ! Otherwise one draw gives the numbers of two neighbouring lanes, and is made once.
         noises = of%noise
         call share_draws(nlane, padded(int(at(nlane)/2 - at(1)/2) + 1))
      end if

   contains

      !> Make ndraw draws from the first one on, and read each lane's two numbers off its draw: columns 0, 1 of an
      !> even pair and 2, 3 of an odd one. Where intervals are longer than steps several lanes read the same numbers.
      subroutine share_draws(nlane, ndraw)
         integer, intent(in) :: nlane, ndraw
         integer(i8) :: draws(ndraw)
         real(wp) :: x(ndraw, 0:3)
         integer :: i, lane

         do i = 1, ndraw
            ! Draw j makes the normals of the pairs 2 j and 2 j + 1.
            draws(i) = at(1)/2 + i - 1
         end do
         ! Draw all numbers of one path, whose index is in every lane.
         call scaled_normals_at(ndraw, of, path(:ndraw), draws, noises(:ndraw), x)
         do lane = 1, nlane
            i = int(at(lane)/2 - at(1)/2) + 1
            ! An even pair has the first two normals of its draw, an odd one the last two.
            even(lane) = x(i, 2*mod(at(lane), 2_i8))
            odd(lane) = x(i, 2*mod(at(lane), 2_i8) + 1)
         end do
      end subroutine share_draws

   end subroutine draw_one

end module symsde_noise_integral_draws
