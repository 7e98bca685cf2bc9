! SPDX-License-Identifier: BSD-3-Clause
!> The shape of a path on an interval, and its halves (noise/integrals has the laws of what is drawn).
module symsde_noise_halving
   use symsde_base_kinds, only: wp
   use symsde_base_vectors, only: add_times
   use symsde_noise_decay_law, only: decay_direction
   implicit none
   private
   public :: path_shape, halving_draws, halve

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

      ! The second half is computed as the whole less the first, so that dW of both add up exactly.
      left%w = 0.5_wp*whole%w + 1.5_wp*whole%hh + u%z
      right%w = whole%w - left%w
      left%hh = 0.25_wp*whole%hh - 0.5_wp*u%z
      right%hh = left%hh - 0.5_wp*u%n
      left%hh = left%hh + 0.5_wp*u%n
      if (.not. allocated(whole%kk)) return
      left%hh = left%hh + 3.75_wp*whole%kk
      right%hh = right%hh - 3.75_wp*whole%kk
      left%kk = 0.125_wp*whole%kk - 0.25_wp*u%n
      right%kk = left%kk - 0.25_wp*u%d
      left%kk = left%kk + 0.25_wp*u%d
   end subroutine split

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
