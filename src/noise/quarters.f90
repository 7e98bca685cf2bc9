! SPDX-License-Identifier: BSD-3-Clause
!> Steps of a block with dW, dZ, J and, if asked for, K: the numbers of noise/integrals, by other loops. J takes eight
!> normals for each noise and step. Of eight steps together all words of a draw are used, and the numbers of a strip of
!> lanes are used while they are in cache: noise by noise where none meets another, as noises at sites do not.
module symsde_noise_quarters
   use symsde_base_functionals, only: functional_set, path_dz, path_magnus, path_stt_area
   use symsde_base_kinds, only: wp, i8
   use symsde_base_laws, only: law_gaussian
   use symsde_base_record, only: step_request, step_store
   use symsde_noise_functionals, only: magnus_of_quarters
   use symsde_noise_halving, only: split_shapes, split_third
   use symsde_noise_integral_draws, only: integral_draws
   use symsde_noise_normal, only: normal_stream, pairs_of_steps, scaled_normal_column
   use symsde_noise_philox, only: purpose_increment, purpose_shape, purpose_halving, purpose_halves, purpose_stt_area, &
                                  purpose_stt_halving
   implicit none
   private
   public :: are_quartered, fill_quarters

   integer, parameter :: strip = 64              !! lanes whose numbers stay in cache
   integer, parameter :: most = 2*pairs_of_steps !! steps together

contains

   !> Whether J is asked for beside dZ and perhaps K, of steps as drawn.
   pure logical function are_quartered(d)
      type(integral_draws), intent(in) :: d

      are_quartered = d%refine == 0 .and. d%law == law_gaussian .and. &
                      all(d%asked%has([path_dz, path_magnus])) .and. &
                      count(d%asked%has) == count(d%asked%has([path_dz, path_magnus, path_stt_area]))
   end function are_quartered

   !> Fill all steps of a request that begins with an even pair.
   subroutine fill_quarters(d, request, store, drawn)
      type(integral_draws), intent(in) :: d
      type(step_request), intent(in) :: request
      type(step_store), intent(inout) :: store
      integer(i8), intent(inout) :: drawn
      real(wp), allocatable :: work(:)   !! of the quarters and halves of noises that meet
      type(functional_set) :: asked
      logical :: apart
      integer :: first, n, j, nstep, k, m, slot, hh, halves, last

      asked = d%asked
      apart = .false.
      if (allocated(asked%meeting%k)) apart = all(asked%meeting%k == asked%meeting%l)
      if (apart) then  ! each noise by itself
         asked%meeting%k = [1]
         asked%meeting%l = [1]
      end if
      m = merge(1, d%nnoise, apart)
      ! The places of dW, H and of dW of the halves. New memory in every request would take longer than the draws.
      hh = strip*m*4*most + 1
      halves = 2*hh - 1
      last = halves + strip*m*2*most - 1
      call move_alloc(store%work, work)
      if (allocated(work)) then
         if (size(work) < last) deallocate (work)
      end if
      if (.not. allocated(work)) allocate (work(last))
      do first = 1, request%nlane, strip
         n = min(strip, request%nlane - first + 1)
         do j = 0, request%npair - 1, pairs_of_steps
            nstep = 2*min(pairs_of_steps, request%npair - j)
            do k = 1, d%nnoise
               slot = merge(1, k, apart)
               call draw_noise(d, k, n, request%path(first), request%pair + j, nstep, first, 2*j, m, slot, store, &
                               work, work(hh), work(halves))
               if (apart .or. k == m) call merge_steps(d, asked, n, m, nstep, first, 2*j, k - slot, store, work, &
                                                       work(hh), work(halves))
            end do
         end do
      end do
      call move_alloc(work, store%work)
      drawn = drawn + 2*request%npair*merge(12, 8, d%needs_stt_area())*count(.not. d%silent)
   end subroutine fill_quarters

   !> Noise k in nstep steps of n lanes, from lane `first` and step `from` of the store on: dW, dZ and K, and the shapes
   !> of the quarters and dW of the halves, into place `slot` of m noises.
   subroutine draw_noise(d, k, n, path, pair, nstep, first, from, m, slot, store, quarter_w, quarter_hh, halves)
      type(integral_draws), intent(in) :: d
      integer, intent(in) :: k, n, nstep, first, from, m, slot
      integer(i8), intent(in) :: path(n), pair
      type(step_store), intent(inout) :: store
      real(wp), intent(inout), dimension(n, m, 4, 0:nstep - 1) :: quarter_w, quarter_hh
      real(wp), intent(inout) :: halves(n, m, 2, 0:nstep - 1)
      ! (n, nstep), or (n, 2, nstep) for halvings of the halves
      real(wp), dimension(2*strip*most) :: w, hh, kk, z, u, v  ! half of each is used
      real(wp), dimension(2*strip*most) :: zz, uu, vv
      real(wp), dimension(strip, 2) :: half_w, half_hh, half_kk, quarter_kk
      real(wp) :: parts
      integer :: step, at, i, to
      logical :: third

      third = d%needs_stt_area()
      parts = merge(192, 12, third)
      call draw(0, purpose_increment, 1.0_wp, w)
      call draw(0, purpose_shape, 12.0_wp, hh)
      call draw(1, purpose_halving, 16.0_wp, z)
      call draw(1, purpose_halves, parts, u)
      call draw(2, purpose_halving, 16.0_wp, zz)
      call draw(2, purpose_halves, parts, uu)
      if (third) then
         call draw(0, purpose_stt_area, 720.0_wp, kk)
         call draw(1, purpose_stt_halving, 180.0_wp, v)
         call draw(2, purpose_stt_halving, 180.0_wp, vv)
      end if
      do step = 0, nstep - 1
         at = step*n + 1
         call split_shapes(n, w(at), hh(at), z(at), u(at), half_w(1, 1), half_w(1, 2), half_hh(1, 1), half_hh(1, 2))
         if (third) call split_third(n, kk(at), u(at), v(at), half_hh(1, 1), half_hh(1, 2), half_kk(1, 1), &
                                     half_kk(1, 2))
         do i = 1, 2
            halves(:, slot, i, step) = half_w(:n, i)
            at = (2*step + i - 1)*n + 1
            associate (q => 2*i - 1)
               call split_shapes(n, half_w(1, i), half_hh(1, i), zz(at), uu(at), quarter_w(1, slot, q, step), &
                                 quarter_w(1, slot, q + 1, step), quarter_hh(1, slot, q, step), &
                                 quarter_hh(1, slot, q + 1, step))
               if (third) call split_third(n, half_kk(1, i), uu(at), vv(at), quarter_hh(1, slot, q, step), &
                                           quarter_hh(1, slot, q + 1, step), quarter_kk(1, 1), quarter_kk(1, 2))
            end associate
         end do
         to = from + step
         at = step*n
         store%w(first:first + n - 1, k, to) = w(at + 1:at + n)
         store%of(path_dz)%x(first:first + n - 1, k, to) = d%h*(0.5_wp*w(at + 1:at + n) + hh(at + 1:at + n))
         if (third) store%of(path_stt_area)%x(first:first + n - 1, k, to) = kk(at + 1:at + n)
      end do

   contains

      !> N(0, |length|/parts) into x: the halvings of a step are those of level 1, and those of its halves of level 2.
      subroutine draw(level, purpose, parts, x)
         integer, intent(in) :: level, purpose
         real(wp), intent(in) :: parts
         real(wp), intent(inout) :: x(2*strip*most)
         real(wp) :: length
         integer(i8) :: of_path(strip), from_pair
         integer :: i, npair

         npair = merge(2, 1, level == 2)*nstep/2
         if (d%silent(k)) then
            x(:2*npair*n) = 0
            return
         end if
         of_path(:n) = merge(0_i8, path, d%common(k))
         length = d%h
         if (level == 2) length = d%h/2
         ! A pair of steps, or the pair of halves of one step.
         from_pair = merge(2, 1, level == 2)*pair
         do i = 0, npair - 1, pairs_of_steps
            call scaled_normal_column(n, normal_stream(d%seed, k, level, purpose, sqrt(abs(length)/parts)), of_path, &
                                      from_pair + i, min(pairs_of_steps, npair - i), 1, x(1 + 2*i*n))
         end do
      end subroutine draw

   end subroutine draw_noise

   !> J of nstep steps, from the quarters of m noises, into the columns behind `column`.
   subroutine merge_steps(d, asked, n, m, nstep, first, from, column, store, quarter_w, quarter_hh, halves)
      type(integral_draws), intent(in) :: d
      type(functional_set), intent(in) :: asked  !! with the pairs of these noises
      integer, intent(in) :: n, m, nstep, first, from, column
      type(step_store), intent(inout) :: store
      real(wp), intent(in), dimension(n, m, 4, 0:nstep - 1) :: quarter_w, quarter_hh
      real(wp), intent(in) :: halves(n, m, 2, 0:nstep - 1)
      real(wp) :: x(n, asked%count_of(path_magnus, m))
      integer :: step

      do step = 0, nstep - 1
         call magnus_of_quarters(n, m, asked, d%h/4, quarter_w(1, 1, 1, step), quarter_hh(1, 1, 1, step), &
                                 halves(1, 1, 1, step), x)
         store%of(path_magnus)%x(first:first + n - 1, column + 1:column + size(x, 2), from + step) = x
      end do
   end subroutine merge_steps

end module symsde_noise_quarters
