! SPDX-License-Identifier: BSD-3-Clause
!> Increments with two or three values, for weak schemes and for schemes that need bounded noise: dW = sqrt(h) x,
!>
!>    three-point   x = +-sqrt(3) with probability 1/6 each, else 0     moments of a normal up to the fifth
!>    two-point     x = +-1 with probability 1/2 each                   up to the third
!>
!> Areas of such steps are +-|h|/2, independent of the increments, with the mean and variance of true areas. A value is
!> found by comparing a uniform number with the edges of the law, so it depends on one counter alone, as a normal does.
module symsde_noise_discrete
   use symsde_base_kinds, only: wp, i8
   use symsde_base_laws, only: law_three_point
   use symsde_noise_normal, only: uniform_open_lanes
   use symsde_noise_philox, only: philox_lanes, philox_lanes_at, purpose_discrete, purpose_sign
   implicit none
   private
   public :: discrete_pairs, sign_pairs

contains

   !> Two independent draws of mean 0 and variance 1 a lane, in place of two normals: for the steps 2 pair and 2
   !> pair + 1. The caller scales them.
   subroutine discrete_pairs(nlane, seed, path, pair, noise, law, even, odd, ahead)
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: seed, path(nlane), pair  !! see normal_pairs
      integer, intent(in) :: noise
      integer, intent(in) :: law                          !! law_three_point or law_two_point
      real(wp), intent(out) :: even(nlane), odd(nlane)
      integer(i8), intent(in), optional :: ahead(nlane)   !! pairs from `pair` to each lane's own pair

      ! Both values of a draw follow from uniforms of 52 bits each.
      call uniforms(nlane, seed, path, pair, noise, purpose_discrete, even, odd, ahead)
      call to_values(nlane, law == law_three_point, even)
      call to_values(nlane, law == law_three_point, odd)
   end subroutine discrete_pairs

   !> Two independent signs +-1 a lane, of the area of a pair of noises in the same two steps.
   subroutine sign_pairs(nlane, seed, path, pair, index, even, odd, ahead)
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: seed, path(nlane), pair
      integer, intent(in) :: index                        !! area_index of the noises
      real(wp), intent(out) :: even(nlane), odd(nlane)
      integer(i8), intent(in), optional :: ahead(nlane)

      call uniforms(nlane, seed, path, pair, index, purpose_sign, even, odd, ahead)
      call to_values(nlane, .false., even)
      call to_values(nlane, .false., odd)
   end subroutine sign_pairs

   !> Two uniforms on (0, 1) a lane, from the four words of one draw. With `ahead` each lane has its own pair: a
   !> single path draws many steps at once.
   subroutine uniforms(nlane, seed, path, pair, noise, purpose, even, odd, ahead)
      integer, intent(in) :: nlane, noise, purpose
      integer(i8), intent(in) :: seed, path(nlane), pair
      real(wp), intent(out) :: even(nlane), odd(nlane)
      integer(i8), intent(in), optional :: ahead(nlane)
      integer(i8) :: words(nlane, 4)
      integer, allocatable :: noises(:)
      integer(i8), allocatable :: at(:)

      if (present(ahead)) then
         allocate (noises(nlane), source=noise)
         ! The counters of each lane's own pair; the noise is the same in all.
         at = pair + ahead
         call philox_lanes_at(nlane, seed, path, at, noises, 0, purpose, words)
      else
         call philox_lanes(nlane, seed, path, pair, noise, 0, purpose, words)
      end if
      call uniform_open_lanes(nlane, words, even, odd)
   end subroutine uniforms

   !> Turn uniforms on (0,1) into values of the law: -size below `edge`, +size above 1 - edge, 0 between. With two
   !> points no number is between.
   pure subroutine to_values(nlane, three, u)
      integer, intent(in) :: nlane
      logical, intent(in) :: three
      real(wp), intent(inout) :: u(nlane)
      real(wp) :: edge, size
      integer :: lane

      ! Two-point values are the three-point rule with edges at 1/2 and size one.
      edge = merge(1.0_wp/6, 0.5_wp, three)
      size = merge(sqrt(3.0_wp), 1.0_wp, three)
      do lane = 1, nlane
         u(lane) = merge(size, 0.0_wp, u(lane) > 1 - edge) - merge(size, 0.0_wp, u(lane) < edge)
      end do
   end subroutine to_values

end module symsde_noise_discrete
