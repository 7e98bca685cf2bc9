! SPDX-License-Identifier: BSD-3-Clause
!> Gaussian increments of one noise that are finer or coarser than one draw a step:
!>
!>    finer    dW = sum of 2^l draws N(0, h/2^l), as a balanced binary tree: (x1 + x2) + (x3 + x4), ..
!>    coarser  W_1 = W/2 + e, W_2 = W - W_1 with e ~ N(0, H/4), from an increment W over H; once for every level
!>
!> Increments of several steps are made at once, so that all words of a draw are used, and few paths fill the lanes of
!> the generator with steps. The tree does not depend on how many leaves are drawn at a time, since sums of complete
!> subtrees are kept until their neighbour is complete (carry).
module symsde_noise_levels
   use symsde_base_interrupt, only: interrupt_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: padded, lane_unit
   use symsde_noise_normal, only: normal_stream, scaled_normal_column, scaled_normals_at, pairs_of_steps
   use symsde_noise_philox, only: purpose_increment, purpose_bridge
   implicit none
   private
   public :: normals_of, sum_finer, halve_coarser, carry

   integer, parameter :: most_ahead = 64  !! lanes of the generator for few paths

   !> The draws of one noise for the lanes of a block.
   type :: normals_of
      integer(i8) :: seed = 0
      integer :: noise = 0
      integer :: nreal = 0                   !! real lanes; further lanes repeat the last
      integer(i8), allocatable :: path(:)    !! (nlane)
      class(interrupt_type), pointer :: interrupt => null()  !! may stop the sums
   contains
      procedure :: is_left
   end type normals_of

contains

   !> Check the interrupt, once for each part of a sum; if true, the sum is invalid. A sum of 2^30 draws takes a while,
   !> and a user may stop it.
   logical function is_left(self)
      class(normals_of), intent(in) :: self

      is_left = .false.
      if (.not. associated(self%interrupt)) return
      call self%interrupt%after_part()
      is_left = self%interrupt%wanted
   end function is_left

   !> dW (nlane, nstep) of an even number of steps, an even one first: the sum of 2^refine draws at step h/2^refine
   !> each, added as a balanced binary tree. 2^levels neighbours are summed at once in `fine`. With larger refine
   !> these sums are leaves of a tree of refine - levels more levels; with smaller refine several steps are made at
   !> once.
   subroutine sum_finer(self, nlane, first, nstep, refine, h, dw, drawn)
      type(normals_of), intent(in) :: self
      integer, intent(in) :: nlane, nstep
      integer(i8), intent(in) :: first
      integer, intent(in) :: refine            !! > 0
      real(wp), intent(in) :: h                !! > 0
      real(wp), intent(inout) :: dw(nlane, 0:nstep - 1)
      integer(i8), intent(inout) :: drawn
      real(wp), allocatable :: fine(:, :), partial(:, :)
      real(wp) :: scale
      integer(i8) :: i
      integer :: levels, step, count, n, level

      ! The lowest levels of the tree, in one array.
      levels = min(refine, levels_at_once(self))
      ! Standard deviation of a leaf.
      scale = sqrt(h/2.0_wp**refine)
      allocate (fine(nlane, 0:2**levels_at_once(self) - 1), partial(nlane, refine - levels))
      do step = 0, nstep - 1, 2**(levels_at_once(self) - levels)
         count = min(2**(levels_at_once(self) - levels), nstep - step)
         do i = 0, 2_i8**(refine - levels) - 1
            ! After an interrupt dw is unfinished, and callers discard it.
            if (self%is_left()) return
            ! n draws are added at once: of one part of a step, or of `count` whole steps.
            n = count*2**levels
            call draw_steps(self, nlane, (first + step)*2_i8**refine + i*n, n, 0, scale, fine)
            drawn = drawn + n
            ! After each level half as many sums are left, in the first columns of `fine`.
            do level = 1, levels
               n = n/2
               call add_pairs(nlane, n, fine)
            end do
            ! The first column of `fine` is now the sum of this part of the step, a leaf of the tree above.
            if (refine > levels) call carry(nlane, i, partial, fine)
         end do
         dw(:, step:step + count - 1) = fine(:, :count - 1)
      end do
   end subroutine sum_finer

   !> Levels of fine increments that are summed at once. For few paths increments fill the lanes of the generator, four
   !> a lane; for many paths eight are drawn at once.
   pure integer function levels_at_once(self) result(levels)
      type(normals_of), intent(in) :: self

      ! Eight increments are the four pairs that the generator makes of two draws.
      levels = 3
      if (self%nreal > lane_unit) return
      levels = 8
      ! 2^(levels - 2) draws of each path need as many lanes, and most_ahead is the limit.
      do while (self%nreal*2**(levels - 2) > most_ahead)
         levels = levels - 1
      end do
   end function levels_at_once

   !> Add the i-th sum x (nlane) to the tree, i from 0, like a carry in binary counting: two complete sums of one size
   !> make one of the next. partial(:, l) holds the sum of 2^(l-1) leaves that waits for its neighbour. On return x is
   !> the largest sum that the i-th one has completed: the whole, after the last.
   pure subroutine carry(nlane, i, partial, x)
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: i
      real(wp), intent(inout) :: partial(:, :), x(nlane)
      integer(i8) :: left
      integer :: level

      left = i
      level = 1
      do while (mod(left, 2_i8) == 1)
         ! The earlier sum is the left operand, as in every pair of the tree.
         x = partial(:, level) + x
         left = left/2
         level = level + 1
      end do
      ! The last sum has no neighbour to wait for.
      if (level <= size(partial, 2)) partial(:, level) = x
   end subroutine carry

   !> dW (nlane, nstep) of steps from any step on: increments at step 2^level h, halved once for every level. Of each
   !> level only intervals `low` to `high` are kept, which hold the wanted steps. x holds increments of the level
   !> from interval `base` on, and e the normals that halve them, from interval `from` on: a draw makes four
   !> intervals.
   subroutine halve_coarser(self, nlane, first, nstep, levels, h, dw, drawn)
      type(normals_of), intent(in) :: self
      integer, intent(in) :: nlane, nstep
      integer(i8), intent(in) :: first
      integer, intent(in) :: levels            !! >= 0
      real(wp), intent(in) :: h                !! > 0
      real(wp), intent(inout) :: dw(nlane, 0:nstep - 1)
      integer(i8), intent(inout) :: drawn
      real(wp), allocatable, dimension(:, :) :: x, e, halves
      real(wp) :: coarse
      integer(i8) :: base, from, low, high  ! indices in this level: of x(:, 0), of e(:, 0), first and last wanted
      integer :: level, n, i

      ! Intervals that hold nstep steps, rounded down and up to multiples of four.
      allocate (x(nlane, 0:nstep + 7), e(nlane, 0:nstep + 7), halves(nlane, 0:nstep + 7))
      ! Find the longest intervals that hold the steps, and draw their increments.
      coarse = h*2.0_wp**levels
      low = first/2_i8**levels
      high = (first + nstep - 1)/2_i8**levels
      base = low - mod(low, 4_i8)
      ! Draw from a multiple of four on to the last wanted interval, in whole draws.
      n = fours(high - base + 1)
      call draw_steps(self, nlane, base, n, 0, sqrt(coarse), x)
      do level = 1, levels
         ! Interval j of this level gives the intervals 2 j and 2 j + 1 of the next level.
         from = low - mod(low, 4_i8)
         n = fours(high - from + 1)
         call draw_steps(self, nlane, from, n, level, 0.5_wp*sqrt(coarse), e)
         do i = 0, int(high - low)
            ! The standard deviation of e is sqrt(H)/2 for the interval of length H that is halved.
            call halve(nlane, x(1, low + i - base), e(1, low + i - from), halves(1, 2*i), halves(1, 2*i + 1))
         end do
         call move_alloc(halves, x)
         allocate (halves(nlane, 0:nstep + 7))
         ! Indices in the next level, whose first and last intervals may not be wanted.
         base = 2*low
         low = first/2_i8**(levels - level)
         high = (first + nstep - 1)/2_i8**(levels - level)
         coarse = coarse/2
      end do
      dw = x(:, low - base:high - base)
      drawn = drawn + nstep  ! a draw per step in the long run: 1 + 1 + 2 + 4 + .. for 2^levels steps
   end subroutine halve_coarser

   !> n rounded up to a multiple of four, the intervals of a draw.
   pure integer function fours(n)
      integer(i8), intent(in) :: n

      fours = 4*int((n + 3)/4)
   end function fours

   !> Draw N(0, scale^2) of nstep steps from `first` on, both multiples of four, into x (nlane, nstep). Level 0 draws
   !> increments, level l normals of the bridge under another purpose, so the two share no draw.
   subroutine draw_steps(self, nlane, first, nstep, level, scale, x)
      type(normals_of), intent(in) :: self
      integer, intent(in) :: nlane, nstep, level
      integer(i8), intent(in) :: first
      real(wp), intent(in) :: scale
      real(wp), intent(inout) :: x(nlane, 0:nstep - 1)
      type(normal_stream) :: of
      integer :: i, n

      ! The level is a word of the counter: a run at half the step halves the same bridge one level further.
      of = normal_stream(self%seed, self%noise, level, merge(purpose_increment, purpose_bridge, level == 0), scale)
      ! For a vector of paths or fewer, lanes are draws of all paths, as many as fit. Otherwise lanes are paths.
      if (self%nreal <= lane_unit) then
         do i = 0, nstep - 1, 4*(most_ahead/self%nreal)
            n = min(nstep - i, 4*(most_ahead/self%nreal))
            call draw_few(self, of, nlane, first + i, n, x(1, i))
         end do
      else
         do i = 0, nstep - 1, 2*pairs_of_steps
            call scaled_normal_column(nlane, of, self%path, (first + i)/2, min(pairs_of_steps, (nstep - i)/2), 1, &
                                      x(1, i))
         end do
      end if
   end subroutine draw_steps

   !> Few paths: a lane of the generator is four steps of a path; paths change fastest, and draw i of path j is lane (i
   !> - 1) nreal + j.
   subroutine draw_few(self, of, nlane, first, nstep, x)
      type(normals_of), intent(in) :: self
      type(normal_stream), intent(in) :: of
      integer, intent(in) :: nlane, nstep
      integer(i8), intent(in) :: first
      real(wp), intent(inout) :: x(nlane, 0:nstep - 1)
      integer(i8) :: paths(most_ahead), draws(most_ahead)
      integer :: noises(most_ahead), n, i
      real(wp) :: drawn(4*most_ahead)

      ! Number of lanes that four steps of every path need, rounded up to whole vectors.
      n = padded(self%nreal*(nstep/4))
      noises = self%noise
      do i = 1, n  ! a whole vector; padding is not used
         paths(i) = self%path(1 + mod(i - 1, self%nreal))
         draws(i) = first/4 + (i - 1)/self%nreal
      end do
      call scaled_normals_at(n, of, paths, draws, noises, drawn)
      call spread(n, self%nreal, nlane, nstep, drawn, x)
   end subroutine draw_few

   ! ---- kernels ----------------------------------------------------------------------------------

   !> Move numbers from lanes of the generator, (n, 4), to lanes of the block; padding repeats the last real path.
   pure subroutine spread(n, nreal, nlane, nstep, drawn, x)
      integer, intent(in) :: n, nreal, nlane, nstep
      real(wp), intent(in) :: drawn(n, 0:3)
      real(wp), intent(inout) :: x(nlane, 0:nstep - 1)
      integer :: step, lane

      do step = 0, nstep - 1
         do lane = 1, nlane
            ! Lane and column of the generator that hold this step of this path.
            x(lane, step) = drawn((step/4)*nreal + min(lane, nreal), mod(step, 4))
         end do
      end do
   end subroutine spread

   !> Replace n pairs of neighbours by their sums: the next level of the tree, in the first n columns.
   pure subroutine add_pairs(nlane, n, x)
      integer, intent(in) :: nlane, n
      real(wp), intent(inout) :: x(nlane, 0:2*n - 1)
      integer :: i, lane

      do i = 0, n - 1
         do lane = 1, nlane
            x(lane, i) = x(lane, 2*i) + x(lane, 2*i + 1)
         end do
      end do
   end subroutine add_pairs

   !> VEC W_1 = W/2 + e, W_2 = W - W_1
   pure subroutine halve(nlane, w, e, one, two)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: w(nlane), e(nlane)
      real(wp), intent(out) :: one(nlane), two(nlane)
      integer :: lane

      do lane = 1, nlane
         ! The second half is the rest, so that both add up to w to rounding.
         one(lane) = 0.5_wp*w(lane) + e(lane)
         two(lane) = w(lane) - one(lane)
      end do
   end subroutine halve

end module symsde_noise_levels
