! SPDX-License-Identifier: BSD-3-Clause
!> The shape of a path on an interval, and its halves (noise/integrals has the laws of what is drawn).
module symsde_noise_halving
   use symsde_base_kinds, only: wp
   use symsde_base_vectors, only: add_times
   use symsde_noise_decay_law, only: decay_direction
   implicit none
   private
   public :: path_shape, halving_draws, halve, split_shapes, split_third

   !> The known shape of the path on an interval: dW, H and, if asked for, K and xi (nlane, nnoise); and the rest of its
   !> areas if drawn in law (nlane, pairs of noises).
   type :: path_shape
      real(wp), allocatable :: w(:, :), hh(:, :), kk(:, :), xi(:, :), rest(:, :)
   end type path_shape

   !> The draws of a halving: Z, N or M, D where K is known, and xi of the halves (nlane, nnoise).
   type :: halving_draws
      real(wp), allocatable :: z(:, :), n(:, :), d(:, :), xi_1(:, :), xi_2(:, :)
   end type halving_draws

contains

   !> Halve an interval of this length, whose xi, if it is asked for, determines a direction of the normals drawn.
   pure subroutine halve(rate, length, whole, drawn, left, right)
      real(wp), intent(in) :: rate      !! gamma of path_decay [1/time]
      real(wp), intent(in) :: length    !! length of the whole interval, with its sign [time]
      type(path_shape), intent(in) :: whole
      type(halving_draws), intent(in) :: drawn
      type(path_shape), intent(out) :: left, right
      type(halving_draws) :: u

      if (.not. allocated(whole%xi)) then
         call split(whole, drawn, left, right)
         return
      end if
      u = drawn
      call turn(size(whole%xi), length, rate*length, whole%xi, u%z, u%n, u%d, u%xi_1, u%xi_2)
      call split(whole, u, left, right)
      call move_alloc(u%xi_1, left%xi)
      call move_alloc(u%xi_2, right%xi)
   end subroutine halve

   !> Halve an interval by the formulas of noise/integrals. u%n holds N, or M if K is known: the part 15/2 K of N =
   !> 15/2 K + M is then added to H_1 and H_2 as (15/4) K.
   pure subroutine split(whole, u, left, right)
      type(path_shape), intent(in) :: whole
      type(halving_draws), intent(in) :: u
      type(path_shape), intent(out) :: left, right

      associate (n => size(whole%w))
         allocate (left%w, left%hh, right%w, right%hh, mold=whole%w)
         call split_shapes(n, whole%w, whole%hh, u%z, u%n, left%w, right%w, left%hh, right%hh)
         if (.not. allocated(whole%kk)) return
         allocate (left%kk, right%kk, mold=whole%w)
         call split_third(n, whole%kk, u%n, u%d, left%hh, right%hh, left%kk, right%kk)
      end associate
   end subroutine split

   !> VEC dW and H of the halves, from those of the whole, Z and N. The second half is computed as the whole less the
   !> first, so that dW of both add up exactly.
   pure subroutine split_shapes(n, w, hh, z, u, w1, w2, hh1, hh2)
      integer, intent(in) :: n
      real(wp), intent(in), dimension(n) :: w, hh, z, u
      real(wp), intent(out), dimension(n) :: w1, w2, hh1, hh2
      real(wp) :: mean
      integer :: i

      do i = 1, n
         w1(i) = 0.5_wp*w(i) + 1.5_wp*hh(i) + z(i)
         w2(i) = w(i) - w1(i)
         mean = 0.25_wp*hh(i) - 0.5_wp*z(i)
         hh1(i) = mean + 0.5_wp*u(i)
         hh2(i) = mean - 0.5_wp*u(i)
      end do
   end subroutine split_shapes

   !> VEC Add to H of the halves its part of K, and find K of the halves; u is M.
   pure subroutine split_third(n, kk, u, d, hh1, hh2, kk1, kk2)
      integer, intent(in) :: n
      real(wp), intent(in), dimension(n) :: kk, u, d
      real(wp), intent(inout), dimension(n) :: hh1, hh2
      real(wp), intent(out), dimension(n) :: kk1, kk2
      real(wp) :: mean
      integer :: i

      do i = 1, n
         hh1(i) = hh1(i) + 3.75_wp*kk(i)
         hh2(i) = hh2(i) - 3.75_wp*kk(i)
         mean = 0.125_wp*kk(i) - 0.25_wp*u(i)
         kk1(i) = mean + 0.25_wp*d(i)
         kk2(i) = mean - 0.25_wp*d(i)
      end do
   end subroutine split_third

   !> Move the normals of a halving so that their part along the direction of xi is xi.
   pure subroutine turn(n, length, z, xi, zz, mm, dd, xi_1, xi_2)
      integer, intent(in) :: n
      real(wp), intent(in) :: length, z   !! the whole interval's length [time], and gamma times it
      real(wp), intent(in) :: xi(n)
      real(wp), intent(inout), dimension(n) :: zz, mm, dd, xi_1, xi_2
      real(wp) :: u(5), scale(5), missing(n)

      u = decay_direction(z)
      scale = sqrt(abs(length)*[1/16.0_wp, 1/192.0_wp, 1/180.0_wp, 0.0_wp, 0.0_wp])
      scale(4:) = 1
      missing = xi
      call add_times(n, -u(1)/scale(1), zz, missing)
      call add_times(n, -u(2)/scale(2), mm, missing)
      call add_times(n, -u(3)/scale(3), dd, missing)
      call add_times(n, -u(4), xi_1, missing)
      call add_times(n, -u(5), xi_2, missing)
      call add_times(n, u(1)*scale(1), missing, zz)
      call add_times(n, u(2)*scale(2), missing, mm)
      call add_times(n, u(3)*scale(3), missing, dd)
      call add_times(n, u(4), missing, xi_1)
      call add_times(n, u(5), missing, xi_2)
   end subroutine turn

end module symsde_noise_halving
