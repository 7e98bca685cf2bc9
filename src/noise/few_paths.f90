! SPDX-License-Identifier: BSD-3-Clause
!> Draws of few paths: a lane of the generator is a path, a draw of four steps, and a noise, since a vector of few paths
!> would be mostly padding, and one of eight waits for itself. The numbers are those of whole blocks (noise/normal).
module symsde_noise_few_paths
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: padded, lane_unit
   use symsde_noise_functionals, only: clip_increments
   use symsde_noise_normal, only: normal_stream, scaled_normals_at
   implicit none
   private
   public :: are_few, draw_few

   integer, parameter :: most_few = 8        !! most paths whose draws are made side by side, however many steps
   integer, parameter :: few_draws = 64      !! most draws of more paths that are made side by side
   integer, parameter :: most_ahead = 128    !! lanes of the generator for one noise
   integer, parameter :: least_ahead = 32    !! lanes of the generator for one noise among many
   integer, parameter :: most_at_once = 256  !! lanes of the generator for several noises

contains

   !> Whether the draws of these paths are made side by side: few paths, or few draws of all paths together.
   pure logical function are_few(nreal, npair)
      integer, intent(in) :: nreal  !! real paths of a block
      integer, intent(in) :: npair  !! pairs of steps

      are_few = nreal <= most_few .or. nreal*((npair + 1)/2) <= few_draws
   end function are_few

   !> Draw N(0, scale^2) for the steps 2 pair .. 2 pair + 2 npair - 1 of few paths, `pair` even, and all noises but
   !> silent ones, each clipped at `bound`. Lanes of the block beyond the nreal-th repeat it.
   subroutine draw_few(of, silent, common, bound, nlane, nreal, path, pair, npair, ncolumn, x)
      type(normal_stream), intent(in) :: of       !! its noise is not used
      logical, intent(in) :: silent(:), common(:) !! noises without draws, noises drawn for path 0 (noises)
      real(wp), intent(in) :: bound
      integer, intent(in) :: nlane, nreal, npair
      integer(i8), intent(in) :: path(nlane), pair
      integer, intent(in) :: ncolumn              !! columns of a step
      !> Begins with the column of the first noise in the first step.
      real(wp), intent(inout) :: x(nlane*(ncolumn*(2*npair - 1) + size(silent)))
      integer(i8), dimension(most_at_once) :: paths, draws
      integer(i8), dimension(most_ahead + lane_unit) :: path_of, draw_of
      integer :: noises(most_at_once), packed(most_at_once)
      real(wp) :: drawn(most_at_once*4 + lane_unit)  ! vectors are read from any path on
      integer :: ndraw, most, before, some, n, m, used, k, i, j
      logical :: any_common

      any_common = any(common)
      ndraw = (npair + 1)/2
      most = min(ndraw, most_ahead/nreal)
      ! Several paths: many noises take turns with few draws, so that columns of a step are written together.
      if (nlane > 1) then
         most = min(most, max(least_ahead/nreal, most_at_once/(nreal*max(1, count(.not. silent)))))
         most = max(1, most)
      end if
      ! Lanes of the generator for a noise: first all paths of one draw, then all paths of the next, whole vectors of
      ! paths over the rest of the vector before.
      if (nreal == 1) path_of(:most) = path(1)
      do j = 0, most - 1
         draw_of(j*nreal + 1:j*nreal + nreal) = pair/2 + j
         if (nreal == 1) cycle
         do i = 0, nreal - 1, lane_unit
            path_of(j*nreal + i + 1:j*nreal + i + lane_unit) = path(i + 1:i + lane_unit)
         end do
      end do
      do before = 0, ndraw - 1, most
         some = min(most, ndraw - before)
         n = nreal*some
         ! Paths and draws are the same for every noise.
         do j = 0, min(most_at_once/n, size(silent)) - 1
            do i = 1, n
               paths(j*n + i) = path_of(i)
               draws(j*n + i) = draw_of(i) + before
            end do
         end do
         ! k is the last noise that has been packed. The inner loop packs noises until another one would not fit.
         k = 0
         do while (k < size(silent))
            used = 0
            do while (k < size(silent) .and. used + n <= most_at_once)
               k = k + 1
               if (silent(k)) cycle
               packed(used/n + 1) = k
               noises(used + 1:used + n) = k
               if (any_common) paths(used + 1:used + n) = merge(0_i8, path_of(:n), common(k))
               used = used + n
            end do
            ! All of these noises were silent.
            if (used == 0) cycle
            m = padded(used)  ! a full vector: padding repeats the last lane
            paths(used + 1:m) = paths(used)
            draws(used + 1:m) = draws(used)
            noises(used + 1:m) = noises(used)
            call scaled_normals_at(m, of, paths, draws, noises, drawn)
            ! Clip before spreading, in one pass over the numbers of all noises.
            if (bound < huge(1.0_wp)) call clip_increments(4*m, bound, drawn)
            j = 1 + nlane*ncolumn*4*before
            if (nlane == 1) then
               call spread_alone(min(4*some, 2*npair - 4*before), ncolumn, used/n, packed, drawn, m, x(j))
            else
               call spread(nlane, nreal, min(4*some, 2*npair - 4*before), ncolumn, used/n, packed, n, drawn, m, x(j))
            end if
         end do
      end do
   end subroutine draw_few

   !> Write the numbers of these noises to their columns of nstep steps: number i of draw j is that of step 4j + i.
   !> Lanes beyond the last path repeat it. A vector of lanes is read from any path on, and the bits of its lanes are
   !> chosen without branches.
   pure subroutine spread(nlane, nreal, nstep, ncolumn, nnoise, noise, n, x, m, w)
      integer, intent(in) :: nlane, nreal, nstep, ncolumn, nnoise, m
      integer, intent(in) :: noise(nnoise)  !! their columns, in this order
      integer, intent(in) :: n              !! lanes of the generator for a noise
      !> Numbers i stand m after numbers i - 1; up to a vector beyond the last draw is read and not used.
      real(wp), intent(in) :: x(4*m + lane_unit)
      real(wp), intent(inout) :: w(nlane*(ncolumn*(nstep - 1) + noise(nnoise)))
      integer(i8) :: own(lane_unit)  ! all bits in lanes of paths, none beyond
      integer :: lane, first, step, k, from, before

      do first = 0, nlane - lane_unit, lane_unit
         do lane = 1, lane_unit
            own(lane) = merge(not(0_i8), 0_i8, first + lane <= nreal)
         end do
         ! Vectors without a path read the last vector with one.
         before = min(first, (nreal - 1)/lane_unit*lane_unit)
         do step = 0, nstep - 1
            do k = 1, nnoise
               from = 1 + m*mod(step, 4) + nreal*(step/4) + n*(k - 1)
               call give(own, x(from + nreal - 1), x(from + before), w(1 + first + nlane*(ncolumn*step + noise(k) - 1)))
            end do
         end do
      end do
   end subroutine spread

   !> The numbers of a step for one vector of lanes: its own ones, and in lanes without a path the last one.
   pure subroutine give(own, last, x, w)
      integer(i8), intent(in) :: own(lane_unit)
      real(wp), intent(in) :: last, x(lane_unit)
      real(wp), intent(inout) :: w(lane_unit)
      integer :: lane

      !GCC$ unroll 8
      do lane = 1, lane_unit
         w(lane) = transfer(ior(iand(transfer(x(lane), 0_i8), own(lane)), &
                                iand(transfer(last, 0_i8), not(own(lane)))), 0.0_wp)
      end do
   end subroutine give

   !> spread for a block of one lane, four steps of a draw at a time. An odd number of pairs uses half of its last draw.
   pure subroutine spread_alone(nstep, ncolumn, nnoise, noise, x, m, w)
      integer, intent(in) :: nstep, ncolumn, nnoise, m
      integer, intent(in) :: noise(nnoise)  !! their columns, in this order
      real(wp), intent(in) :: x(4*m)
      real(wp), intent(inout) :: w(ncolumn*(nstep - 1) + noise(nnoise))
      integer :: some, before, draw, k, i, n, from, to

      n = (nstep + 3)/4
      some = steps_together(nstep, ncolumn)/4
      do before = 0, nstep/4 - 1, some
         do k = 1, nnoise
            from = 1 + n*(k - 1)
            to = noise(k)
            do draw = before, min(before + some, nstep/4) - 1
               !GCC$ unroll 4
               do i = 0, 3
                  w(to + ncolumn*(4*draw + i)) = x(from + m*i + draw)
               end do
            end do
         end do
      end do
      do i = 4*(nstep/4), nstep - 1
         do k = 1, nnoise
            w(noise(k) + ncolumn*i) = x(1 + n*(k - 1) + m*mod(i, 4) + nstep/4)
         end do
      end do
   end subroutine spread_alone

   !> How many steps receive one noise before the next one comes: all where their numbers fit into the nearest cache,
   !> else few, since a column of many steps may fall on the same lines of it.
   pure integer function steps_together(nstep, width)
      integer, intent(in) :: nstep, width  !! steps, and numbers of a step
      integer, parameter :: cached = 2048, few = 16

      steps_together = merge(4*((nstep + 3)/4), few, nstep*width <= cached)
   end function steps_together

end module symsde_noise_few_paths
