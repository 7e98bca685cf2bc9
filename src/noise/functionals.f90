! SPDX-License-Identifier: BSD-3-Clause
!> The law of each functional of the path: its value on the finest intervals, how the values of neighbouring intervals
!> merge, and its bound in a truncated run. All properties of single functionals but their names (base/functionals) are
!> in this module. Merging is exact: the value of the whole interval consists of values of the halves and products
!> between the halves.
!>
!> A finest interval is given by its dW, its H = dZ/h - dW/2 and, if asked for, its K: a parabola, or a cubic. On it
!>
!>    dZ_k = h (dW_k/2 + H_k),   A_kl = H_k dW_l - H_l dW_k,   J_kl = h (dW_k dW_l/6 - (6/5) H_k H_l) - delta_kl h^2/15
!>
!> (J by its mean given dW and H; an area drawn in law has in addition 12 (K_k H_l - K_l H_k) and a normal term of
!> variance h^2/20, which give it the true mean and covariances given dW and H), D_k is a sum of dW, H, K and a normal
!> term (noise/decay_law), and neighbouring intervals merge by
!>
!>    dW = dW_1 + dW_2,  dZ = dZ_1 + dZ_2 + h_2 dW_1,  A_kl = A_1 + A_2 + (dW_k1 dW_l2 - dW_l1 dW_k2)/2
!>    K = (K_1 + K_2)/4 + (H_1 - H_2)/8  (halves),     J_kl = J_1 + J_2 + Z_k1 dW_l2 + dW_k1 (h_2 dW_l2 - Z_l2)
!>    D = exp(-gamma h_2) D_1 + phi(h_2) dW_1 + D_2
!>
!> Truncation uses the standard deviations sqrt|h| of dW, sqrt(|h|/12) of H and sqrt(|h|/720) of K, and that of the
!> normal term in D.
module symsde_noise_functionals
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use symsde_base_functionals, only: functional_set, functional_count, area_index, nfunctional, path_dz, &
                                      path_areas, path_stt_area, path_magnus, path_decay
   use symsde_base_kinds, only: wp
   use symsde_base_vectors, only: add_times
   use symsde_noise_decay_law, only: decay_path, decay_integral
   implicit none
   private
   public :: path_interval, new_path_interval, shape_values, decay_values, merge_intervals, magnus_of_quarters, &
             clip_increments, clip_interval

   integer, parameter :: strip = 32  !! lanes whose pairs of noises are formed together, from numbers in cache

   type :: interval_values
      real(wp), allocatable :: x(:, :)     !! (nlane, count_of); not allocated where not asked for
   end type interval_values

   !> One interval of the path in every lane: its increments, and the functionals asked for.
   type :: path_interval
      real(wp) :: length = 0               !! length of the interval, with its sign [time]
      real(wp) :: rate = 0                 !! gamma of path_decay [1/time]
      real(wp), allocatable :: w(:, :)     !! dW_k (nlane, nnoise)
      type(interval_values) :: of(nfunctional)
   end type path_interval

contains

   !> Make room for an interval of this length and for the functionals that are asked for; the caller gives dW and
   !> values.
   pure subroutine new_path_interval(self, nlane, nnoise, length, asked)
      type(path_interval), intent(out) :: self
      integer, intent(in) :: nlane, nnoise
      real(wp), intent(in) :: length
      type(functional_set), intent(in) :: asked
      integer :: f

      self%length = length
      self%rate = asked%rate
      allocate (self%w(nlane, nnoise))
      do f = 1, nfunctional
         if (asked%has(f)) allocate (self%of(f)%x(nlane, asked%count_of(f, nnoise)))
      end do
   end subroutine new_path_interval

   !> Values x of a functional on an interval with dW, H and K, each (nlane, nnoise), by the formulas at the head. K
   !> and `rest` count as zero if absent. J is that of the pairs of noises that `asked` has.
   pure subroutine shape_values(functional, asked, nlane, nnoise, length, w, hh, x, kk, rest)
      integer, intent(in) :: functional, nlane, nnoise
      type(functional_set), intent(in) :: asked
      real(wp), intent(in) :: length, w(nlane, nnoise), hh(nlane, nnoise)
      real(wp), intent(out) :: x(nlane, asked%count_of(functional, nnoise))
      real(wp), intent(in), optional :: kk(nlane, nnoise)  !! zero if absent
      !> The normal terms of areas drawn in law; without them areas are those of the parabola.
      real(wp), intent(in), optional :: rest(nlane, functional_count(path_areas, nnoise))
      real(wp) :: variance
      integer :: k, l, kl, lane

      select case (functional)
      case (path_areas)
         do l = 2, nnoise
            do k = 1, l - 1
               ! The area of the parabola through the ends with this H; an area drawn in law gets a term of K and a
               ! normal term, too.
               x(:, area_index(k, l)) = hh(:, k)*w(:, l) - hh(:, l)*w(:, k)
               if (present(rest)) x(:, area_index(k, l)) = x(:, area_index(k, l)) + rest(:, area_index(k, l)) &
                                                           + 12*(kk(:, k)*hh(:, l) - kk(:, l)*hh(:, k))
            end do
         end do
      case (path_stt_area)
         x = 0
         if (present(kk)) x = kk
      case (path_magnus)
         k = 0
         l = 0
         do kl = 1, size(x, 2)
            call asked%next_pair(kl, k, l)
            variance = open_variance(k, l, length)
            do lane = 1, nlane
               x(lane, kl) = magnus_shape(length, w(lane, k), w(lane, l), hh(lane, k), hh(lane, l), variance)
            end do
         end do
      case (path_dz)
         x = length*(0.5_wp*w + hh)
      case default  ! a functional without a case: NaN stops every path
         x = ieee_value(length, ieee_quiet_nan)
      end select
   end subroutine shape_values

   !> The mean of J_kl on an interval given dW and H of noises k and l, less a variance.
   pure real(wp) function magnus_shape(length, wk, wl, hk, hl, variance) result(x)
      real(wp), intent(in) :: length, wk, wl, hk, hl, variance

      x = length*(wk*wl/6 - 1.2_wp*hk*hl)
      x = x - variance
   end function magnus_shape

   !> The variance of the path that H leaves open, which is subtracted from the diagonal of J, so that E J = 0.
   pure real(wp) function open_variance(k, l, length)
      integer, intent(in) :: k, l
      real(wp), intent(in) :: length

      open_variance = 0
      if (k == l) open_variance = length*abs(length)/15
   end function open_variance

   !> J_kl of two neighbours from J, dZ and dW of both, and the length of the right one; symmetrised in k and l: it
   !> multiplies H_k,q . M^-1 H_l,q, which is symmetric.
   pure real(wp) function magnus_of_two(x1, x2, h2, z1k, z1l, w1k, w1l, z2k, z2l, w2k, w2l) result(x)
      real(wp), intent(in) :: x1, x2, h2, z1k, z1l, w1k, w1l, z2k, z2l, w2k, w2l

      x = (x1 + x2) + 0.5_wp*(z1k*w2l + w1k*(h2*w2l - z2l) + z1l*w2k + w1l*(h2*w2k - z2k))
   end function magnus_of_two

   !> D on an interval with dW, H and K, and with the normal term xi of each noise; without xi, that of the cubic.
   pure subroutine decay_values(nlane, nnoise, length, rate, w, hh, kk, x, xi)
      integer, intent(in) :: nlane, nnoise
      real(wp), intent(in) :: length, rate   !! length of the interval with its sign [time]; gamma [1/time]
      real(wp), intent(in), dimension(nlane, nnoise) :: w, hh, kk
      real(wp), intent(out) :: x(nlane, nnoise)
      real(wp), intent(in), optional :: xi(nlane, nnoise)  !! normals of variance one
      real(wp) :: d(4)

      d = decay_path(rate*length)
      d = length*d
      x = 0
      call add_known(nlane*nnoise, d(:3), w, hh, kk, x)
      if (present(xi)) call add_times(nlane*nnoise, d(4)*sqrt(abs(length)), xi, x)
   end subroutine decay_values

   !> x = x + d_1 w + d_2 hh + d_3 kk.
   pure subroutine add_known(n, d, w, hh, kk, x)
      integer, intent(in) :: n
      real(wp), intent(in) :: d(3), w(n), hh(n), kk(n)
      real(wp), intent(inout) :: x(n)

      call add_times(n, d(1), w, x)
      call add_times(n, d(2), hh, x)
      call add_times(n, d(3), kk, x)
   end subroutine add_known

   !> Merge two neighbouring intervals, whose functionals are those that are asked for.
   pure subroutine merge_intervals(nlane, nnoise, asked, left, right, whole)
      integer, intent(in) :: nlane, nnoise
      type(functional_set), intent(in) :: asked
      type(path_interval), intent(in) :: left, right
      type(path_interval), intent(out) :: whole
      integer :: f, k

      ! Lengths add, with their sign: two steps back in time are one longer step back.
      call new_path_interval(whole, nlane, nnoise, left%length + right%length, asked)
      ! dW first: all products below are of increments of the halves.
      whole%w = left%w + right%w
      do f = 1, nfunctional
         if (.not. asked%has(f)) cycle
         associate (x1 => left%of(f)%x, x2 => right%of(f)%x, x => whole%of(f)%x, w1 => left%w, w2 => right%w)
            select case (f)
            case (path_dz)
               do k = 1, nnoise
                  ! On the right half W - W(t) exceeds W - W(t + h/2) by dW_1.
                  x(:, k) = (x1(:, k) + x2(:, k)) + right%length*w1(:, k)
               end do
            case (path_areas)
               call merge_areas(nlane, nnoise, w1, w2, x1, x2, x)
            case (path_stt_area)
               ! H = dZ/h - dW/2 of the halves: the K of the whole depends on their difference.
               x = 0.25_wp*(x1 + x2) + 0.125_wp*(left%of(path_dz)%x/left%length - right%of(path_dz)%x/right%length &
                                                 - 0.5_wp*(w1 - w2))
            case (path_magnus)
               ! J needs dZ of both halves, which are present whenever J is.
               call merge_magnus(nlane, size(x, 2), asked, left, right, x)
            case (path_decay)
               ! The parts of D_1 and dW_1 at the end of the right half.
               x = x2
               call add_times(nlane*nnoise, exp(-left%rate*right%length), x1, x)
               call add_times(nlane*nnoise, right%length*decay_integral(1.0_wp, left%rate*right%length), w1, x)
            case default  ! a functional without a case: NaN stops every path
               x = ieee_value(left%length, ieee_quiet_nan)
            end select
         end associate
      end do
   end subroutine merge_intervals

   !> J_kl of two neighbours.
   pure subroutine merge_magnus(nlane, npair, asked, left, right, x)
      integer, intent(in) :: nlane, npair
      type(functional_set), intent(in) :: asked
      type(path_interval), intent(in) :: left, right
      real(wp), intent(inout) :: x(nlane, npair)
      integer :: k, l, kl, lane

      k = 0
      l = 0
      associate (x1 => left%of(path_magnus)%x, x2 => right%of(path_magnus)%x, z1 => left%of(path_dz)%x, &
                 z2 => right%of(path_dz)%x, w1 => left%w, w2 => right%w, h2 => right%length)
         do kl = 1, npair
            call asked%next_pair(kl, k, l)
            do lane = 1, nlane
               x(lane, kl) = magnus_of_two(x1(lane, kl), x2(lane, kl), h2, z1(lane, k), z1(lane, l), w1(lane, k), &
                                           w1(lane, l), z2(lane, k), z2(lane, l), w2(lane, k), w2(lane, l))
            end do
         end do
      end associate
   end subroutine merge_magnus

   !> J of an interval from the shapes of its quarters, with the bits of shape_values and of merge_magnus from quarter
   !> to half to whole. dW of the halves is their own, since that of the quarters adds up to it to rounding alone.
   pure subroutine magnus_of_quarters(nlane, nnoise, asked, length, w, hh, halves, x)
      integer, intent(in) :: nlane, nnoise
      type(functional_set), intent(in) :: asked
      real(wp), intent(in) :: length  !! length of a quarter, with its sign [time]
      real(wp), intent(in), dimension(nlane, nnoise, 4) :: w, hh
      real(wp), intent(in) :: halves(nlane, nnoise, 2)  !! dW
      real(wp), intent(out) :: x(nlane, asked%count_of(path_magnus, nnoise))
      real(wp) :: z(strip, nnoise, 4), zz(strip, nnoise, 2)
      integer :: first, n, k, l, kl, i

      do first = 1, nlane, strip
         n = min(strip, nlane - first + 1)
         ! dZ of the quarters and of the halves.
         associate (last => first + n - 1)
            z(:n, :, :) = length*(0.5_wp*w(first:last, :, :) + hh(first:last, :, :))
            do i = 1, 2
               zz(:n, :, i) = (z(:n, :, 2*i - 1) + z(:n, :, 2*i)) + length*w(first:last, :, 2*i - 1)
            end do
         end associate
         k = 0
         l = 0
         do kl = 1, size(x, 2)
            call asked%next_pair(kl, k, l)
            call merge_pair(first, n, k, l, x(:, kl))
         end do
      end do

   contains

      !> VEC J_kl of n lanes from `first` on.
      pure subroutine merge_pair(first, n, k, l, x)
         integer, intent(in) :: first, n, k, l
         real(wp), intent(inout) :: x(nlane)
         real(wp) :: own(4), two(2), variance
         integer :: lane, at, i, j

         variance = open_variance(k, l, length)
         do at = 1, n
            lane = first + at - 1
            !GCC$ unroll 4
            do i = 1, 4
               own(i) = magnus_shape(length, w(lane, k, i), w(lane, l, i), hh(lane, k, i), hh(lane, l, i), variance)
            end do
            !GCC$ unroll 2
            do i = 1, 2
               j = 2*i - 1
               two(i) = magnus_of_two(own(j), own(j + 1), length, z(at, k, j), z(at, l, j), w(lane, k, j), &
                                      w(lane, l, j), z(at, k, j + 1), z(at, l, j + 1), w(lane, k, j + 1), &
                                      w(lane, l, j + 1))
            end do
            x(lane) = magnus_of_two(two(1), two(2), 2*length, zz(at, k, 1), zz(at, l, 1), halves(lane, k, 1), &
                                    halves(lane, l, 1), zz(at, k, 2), zz(at, l, 2), halves(lane, k, 2), &
                                    halves(lane, l, 2))
         end do
      end subroutine merge_pair

   end subroutine magnus_of_quarters

   !> A_kl of two neighbours: the sum of their areas, and the area of the triangle that dW_1 and dW_2 span.
   pure subroutine merge_areas(nlane, nnoise, w1, w2, a1, a2, a)
      integer, intent(in) :: nlane, nnoise
      real(wp), intent(in) :: w1(nlane, nnoise), w2(nlane, nnoise)
      real(wp), intent(in) :: a1(nlane, functional_count(path_areas, nnoise))
      real(wp), intent(in) :: a2(nlane, functional_count(path_areas, nnoise))
      real(wp), intent(out) :: a(nlane, functional_count(path_areas, nnoise))
      integer :: k, l, kl, lane

      do l = 2, nnoise
         do k = 1, l - 1
            kl = area_index(k, l)
            do lane = 1, nlane
               a(lane, kl) = (a1(lane, kl) + a2(lane, kl)) &
                             + 0.5_wp*(w1(lane, k)*w2(lane, l) - w1(lane, l)*w2(lane, k))
            end do
         end do
      end do
   end subroutine merge_areas

   !> Clip n increments to [-bound, bound]: increments of steps, not the draws that they are summed from. The bound
   !> is a bound on the noise of a step.
   pure subroutine clip_increments(n, bound, dw)
      integer, intent(in) :: n
      real(wp), intent(in) :: bound
      real(wp), intent(inout) :: dw(n)
      integer :: i

      do i = 1, n
         dw(i) = min(max(dw(i), -bound), bound)
      end do
   end subroutine clip_increments

   !> Truncate a step: dW_k to the bound, H_k = dZ_k/h - dW_k/2, K_k and the normal term of D_k to the same number of
   !> standard deviations, areas to bound^2/2 and J to |h| bound^2/2. Areas and J exceed their bounds less often than
   !> dW_k does.
   pure subroutine clip_interval(nlane, nnoise, bound, step)
      integer, intent(in) :: nlane, nnoise
      real(wp), intent(in) :: bound                 !! bound of dW [sqrt(time)]
      type(path_interval), intent(inout) :: step
      real(wp) :: shape(nlane), hh(nlane, nnoise), d(4)
      integer :: k

      if (allocated(step%of(path_decay)%x)) then
         ! Take from D what dW, H and K determine of it, which the truncated ones add again below.
         d = decay_path(step%rate*step%length)
         d = -step%length*d
         hh = step%of(path_dz)%x/step%length - 0.5_wp*step%w
         call add_known(nlane*nnoise, d(:3), step%w, hh, step%of(path_stt_area)%x, step%of(path_decay)%x)
      end if
      do k = 1, nnoise
         ! Take H from dW and dZ as drawn, and compute dZ again from the truncated dW and H.
         if (allocated(step%of(path_dz)%x)) then
            shape = step%of(path_dz)%x(:, k)/step%length - 0.5_wp*step%w(:, k)
            call clip_increments(nlane, bound/sqrt(12.0_wp), shape)
         end if
         ! H was found from the full dW; with the truncated dW it would belong to another path.
         call clip_increments(nlane, bound, step%w(:, k))
         if (allocated(step%of(path_dz)%x)) step%of(path_dz)%x(:, k) = step%length*(0.5_wp*step%w(:, k) + shape)
      end do
      if (allocated(step%of(path_areas)%x)) &
         ! Areas and J are bounded directly: neither is a multiple of one normal.
         call clip_increments(size(step%of(path_areas)%x), 0.5_wp*bound**2, step%of(path_areas)%x)
      if (allocated(step%of(path_stt_area)%x)) &
         ! K is truncated at as many of its own standard deviations as dW.
         call clip_increments(size(step%of(path_stt_area)%x), bound/sqrt(720.0_wp), step%of(path_stt_area)%x)
      if (allocated(step%of(path_magnus)%x)) &
         call clip_increments(size(step%of(path_magnus)%x), 0.5_wp*abs(step%length)*bound**2, step%of(path_magnus)%x)
      if (.not. allocated(step%of(path_decay)%x)) return
      d = -d
      call clip_increments(size(step%of(path_decay)%x), abs(d(4))*bound, step%of(path_decay)%x)
      hh = step%of(path_dz)%x/step%length - 0.5_wp*step%w
      call add_known(nlane*nnoise, d(:3), step%w, hh, step%of(path_stt_area)%x, step%of(path_decay)%x)
   end subroutine clip_interval

end module symsde_noise_functionals
