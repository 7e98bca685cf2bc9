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
   integer, parameter :: most_ahead = 64     !! lanes of the generator for one noise
   integer, parameter :: most_at_once = 256  !! lanes of the generator for several noises

contains

   !> Whether the draws of these paths are made side by side: few paths, or few draws of all paths together.
   pure logical function are_few(nreal, npair)
      integer, intent(in) :: nreal  !! real paths of a block
      integer, intent(in) :: npair  !! pairs of steps

      are_few = nreal <= most_few .or. nreal*((npair + 1)/2) <= most_ahead
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
      integer(i8), dimension(most_ahead) :: path_of, draw_of
      integer :: noises(most_at_once)
      real(wp) :: drawn(most_at_once*4)
      integer :: ndraw, most, before, some, n, m, used, k, i, j

      ndraw = (npair + 1)/2
      most = min(ndraw, most_ahead/nreal)
      do before = 0, ndraw - 1, most
         some = min(most, ndraw - before)
         ! n lanes of the generator for each noise: first all paths of one draw, then all paths of the next.
         n = nreal*some
         do j = 0, some - 1
            !GCC$ novector  ! paths are few, and often one
            do i = 1, nreal
               path_of(j*nreal + i) = path(i)
               draw_of(j*nreal + i) = pair/2 + before + j
            end do
         end do
         ! k is the last noise that has been packed. The inner loop packs noises until another one would not fit.
         k = 0
         do while (k < size(silent))
            used = 0
            do while (k < size(silent) .and. used + n <= most_at_once)
               k = k + 1
               if (silent(k)) cycle
               do i = 1, n
                  paths(used + i) = merge(0_i8, path_of(i), common(k))
                  draws(used + i) = draw_of(i)
                  noises(used + i) = k
               end do
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
            do i = 0, used - 1, n
               j = 1 + nlane*(noises(i + 1) - 1 + ncolumn*4*before)
               if (nlane == 1) then
                  call spread_alone(min(4*some, 2*npair - 4*before), ncolumn, drawn(1 + i), m, x(j))
               else
                  call spread(nlane, nreal, min(4*some, 2*npair - 4*before), ncolumn, drawn(1 + i), m, x(j))
               end if
            end do
         end do
      end do
   end subroutine draw_few

   !> Write the numbers of one noise to its column of nstep steps: number i of draw j is that of step 4j + i. Lanes
   !> beyond the last path repeat it.
   pure subroutine spread(nlane, nreal, nstep, ncolumn, x, m, w)
      integer, intent(in) :: nlane, nreal, nstep, ncolumn, m
      real(wp), intent(in) :: x(3*m + nreal*((nstep + 3)/4))  !! numbers i stand m after numbers i - 1
      real(wp), intent(inout) :: w(nlane*(ncolumn*(nstep - 1) + 1))
      integer :: step, lane, first, from, to

      do step = 0, nstep - 1
         from = mod(step, 4)*m + (step/4)*nreal
         to = step*nlane*ncolumn
         if (nreal == nlane) then
            do first = 0, nlane - lane_unit, lane_unit
               !GCC$ unroll 8
               do lane = first + 1, first + lane_unit
                  w(to + lane) = x(from + lane)
               end do
            end do
            cycle
         end if
         do first = 0, nlane - lane_unit, lane_unit
            !GCC$ unroll 8
            do lane = first + 1, first + lane_unit
               w(to + lane) = x(from + nreal)
            end do
         end do
         !GCC$ novector  ! paths are few
         do lane = 1, nreal - 1
            w(to + lane) = x(from + lane)
         end do
      end do
   end subroutine spread

   !> spread for a block of one lane, four steps of a draw at a time. An odd number of pairs uses half of its last draw.
   pure subroutine spread_alone(nstep, ncolumn, x, m, w)
      integer, intent(in) :: nstep, ncolumn, m
      real(wp), intent(in) :: x(3*m + (nstep + 3)/4)
      real(wp), intent(inout) :: w(ncolumn*(nstep - 1) + 1)
      integer :: draw, i

      do draw = 0, nstep/4 - 1
         !GCC$ unroll 4
         do i = 0, 3
            w(1 + ncolumn*(4*draw + i)) = x(1 + m*i + draw)
         end do
      end do
      do i = 4*(nstep/4), nstep - 1
         w(1 + ncolumn*i) = x(1 + m*mod(i, 4) + nstep/4)
      end do
   end subroutine spread_alone

end module symsde_noise_few_paths
