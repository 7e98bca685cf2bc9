! SPDX-License-Identifier: BSD-3-Clause
!> Uniform and normal numbers from the generator's words. Only + - * / sqrt and integer bits, so
!> that the numbers are the same on every x86-64 level when contraction is off; no library
!> function, so that a lane does not depend on where in a vector it sits.
module symsde_noise_normal
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_noise_philox, only: philox_lanes, philox_lanes_at
   implicit none
   private
   public :: uniform_open_lanes, normal_pair_lanes, normal_pairs, scaled_normal_pairs, scaled_normal_pairs_at

   !> Lanes done at once by `normal_pairs`: their words (32 bytes a lane) stay in the first cache.
   !> Smaller tiles pay the set-up of the generator's round keys more often.
   integer(i4), parameter :: tile = 256

   integer(i8), parameter :: one_bits = int(z'3FF0000000000000', i8)       ! 1.0
   integer(i8), parameter :: big_bits = int(z'4330000000000000', i8)       ! 2**52
   integer(i8), parameter :: root_bits = int(z'3FE6A09E667F3BCD', i8)      ! sqrt(1/2)
   integer(i8), parameter :: fraction_bits = int(z'000FFFFFFFFFFFFF', i8)
   real(wp), parameter :: big_bias = 2.0_wp**52 + 1023
   real(wp), parameter :: to_integer = 1.5_wp*2.0_wp**52  ! x + this - this rounds x to an integer
   real(wp), parameter :: one_less = 1 - 2.0_wp**(-53)

   ! log(2) in two parts: 42 bits, so that an exponent times it is exact, and the rest
   real(wp), parameter :: ln2_high = 0.6931471805598903_wp
   real(wp), parameter :: ln2_low = 5.497923018708371e-14_wp
   ! minimax on |s| <= 3 - sqrt(8), z = s**2, to 2**-59:
   ! log((1+s)/(1-s)) = 2 s + s z (l1 + l2 z + ..)
   real(wp), parameter :: l1 = 0.6666666666666734_wp, l2 = 0.39999999999414326_wp, &
                          l3 = 0.28571428742474353_wp, l4 = 0.22222198563515919_wp, l5 = 0.18183564865997923_wp, &
                          l6 = 0.1531403583486055_wp, l7 = 0.14796105583675156_wp
   ! minimax on |y| <= 1/2, z = y**2, to 2**-58 and 2**-64:
   ! sin(y pi/2) = y (s1 + s2 z + ..), cos(y pi/2) = 1 + z (c1 + c2 z + ..)
   real(wp), parameter :: s1 = 1.5707963267948966_wp, s2 = -0.6459640975062443_wp, &
                          s3 = 0.07969262624604302_wp, s4 = -0.004681754132341074_wp, &
                          s5 = 0.00016044115074192262_wp, s6 = -3.598643348404505e-06_wp, &
                          s7 = 5.633932688066633e-08_wp
   real(wp), parameter :: c1 = -1.2337005501361697_wp, c2 = 0.2536695079010469_wp, &
                          c3 = -0.020863480763315425_wp, c4 = 0.0009192602742247867_wp, &
                          c5 = -2.5202036989918693e-05_wp, c6 = 4.7106156058639734e-07_wp, &
                          c7 = -6.321885989811491e-09_wp

contains

   !> Two independent standard normals for each path of a block: the words of `philox_lanes` for
   !> these arguments turned by `normal_pair_lanes`, in tiles that stay in the first cache.
   !> Fine step 2 pair takes `even`, fine step 2 pair + 1 takes `odd`.
   subroutine normal_pairs(nlane, seed, path, pair, noise, level, purpose, even, odd)
      integer(i4), intent(in) :: nlane         !! lanes of the block, any number
      integer(i8), intent(in) :: seed          !! the 64-bit key
      integer(i8), intent(in) :: path(nlane)   !! global path, 0 .. 2**48-1
      integer(i8), intent(in) :: pair          !! pair of fine steps, 0 .. 2**48-1
      integer(i4), intent(in) :: noise         !! 0 .. 2**20-1
      integer(i4), intent(in) :: level         !! 0 .. 63
      integer(i4), intent(in) :: purpose       !! 0 .. 63
      real(wp), intent(out) :: even(nlane)     !! N(0,1)
      real(wp), intent(out) :: odd(nlane)      !! N(0,1), independent of even

      call scaled_normal_pairs(nlane, seed, path, pair, noise, level, purpose, 1.0_wp, even, odd)
   end subroutine normal_pairs

   !> The same normals times a scale, to the bit as if multiplied afterwards, without a pass for it.
   subroutine scaled_normal_pairs(nlane, seed, path, pair, noise, level, purpose, scale, even, odd)
      integer(i4), intent(in) :: nlane         !! lanes of the block, any number
      integer(i8), intent(in) :: seed          !! the 64-bit key
      integer(i8), intent(in) :: path(nlane)   !! global path, 0 .. 2**48-1
      integer(i8), intent(in) :: pair          !! pair of fine steps, 0 .. 2**48-1
      integer(i4), intent(in) :: noise         !! 0 .. 2**20-1
      integer(i4), intent(in) :: level         !! 0 .. 63
      integer(i4), intent(in) :: purpose       !! 0 .. 63
      real(wp), intent(in) :: scale            !! standard deviation
      real(wp), intent(out) :: even(nlane)     !! N(0,scale**2)
      real(wp), intent(out) :: odd(nlane)      !! N(0,scale**2), independent of even
      integer(i8) :: words(tile, 4)
      integer(i4) :: first, n

      do first = 1, nlane, tile
         n = min(tile, nlane - first + 1)
         call philox_lanes(n, seed, path(first), pair, noise, level, purpose, words)
         call scaled_pair_lanes(n, words, scale, even(first), odd(first))
      end do
   end subroutine scaled_normal_pairs

   !> The same numbers with a pair for each lane.
   subroutine scaled_normal_pairs_at(nlane, seed, path, pair, noise, level, purpose, scale, even, odd)
      integer(i4), intent(in) :: nlane         !! lanes, any number
      integer(i8), intent(in) :: seed          !! the 64-bit key
      integer(i8), intent(in) :: path(nlane)   !! global path, 0 .. 2**48-1
      integer(i8), intent(in) :: pair(nlane)   !! pair of fine steps, 0 .. 2**48-1
      integer(i4), intent(in) :: noise, level, purpose
      real(wp), intent(in) :: scale            !! standard deviation
      real(wp), intent(out) :: even(nlane)     !! N(0,scale**2)
      real(wp), intent(out) :: odd(nlane)      !! N(0,scale**2), independent of even
      integer(i8) :: words(tile, 4)
      integer(i4) :: first, n

      do first = 1, nlane, tile
         n = min(tile, nlane - first + 1)
         call philox_lanes_at(n, seed, path(first), pair(first), noise, level, purpose, words)
         call scaled_pair_lanes(n, words, scale, even(first), odd(first))
      end do
   end subroutine scaled_normal_pairs_at

   !> Two uniforms a lane in the open interval: (2 k + 1) / 2**53, k the first 52 of the 64 bits of
   !> words 1-2 and of words 3-4. Symmetric about 1/2; never 0 or 1; every value is exact.
   subroutine uniform_open_lanes(nlane, words, u1, u2)
      integer(i4), intent(in) :: nlane
      integer(i8), intent(in) :: words(nlane, 4)          !! each 0 .. 2**32-1
      real(wp), intent(out) :: u1(nlane), u2(nlane)
      integer(i4) :: lane

      do lane = 1, nlane
         u1(lane) = open_uniform(words(lane, 1), words(lane, 2))
         u2(lane) = open_uniform(words(lane, 3), words(lane, 4))
      end do
   end subroutine uniform_open_lanes

   !> Two independent standard normals a lane by Box and Muller: with the uniforms u1, u2 of
   !> `uniform_open_lanes`, even = r cos(2 pi u2), odd = r sin(2 pi u2), r = sqrt(-2 log u1).
   !> Both are at most sqrt(106 log 2) = 8.58 in size, and within 3 ulp (measured: logarithm 0.80,
   !> sine and cosine 1.47, the normals 2.92). About 90 operations a lane, one division and
   !> one root among them; 32 bytes in, 16 out.
   subroutine normal_pair_lanes(nlane, words, even, odd)
      integer(i4), intent(in) :: nlane
      integer(i8), intent(in) :: words(nlane, 4)   !! each 0 .. 2**32-1
      real(wp), intent(out) :: even(nlane)         !! N(0,1)
      real(wp), intent(out) :: odd(nlane)          !! N(0,1), independent of even

      call scaled_pair_lanes(nlane, words, 1.0_wp, even, odd)
   end subroutine normal_pair_lanes

   !> VEC The kernel of normal_pair_lanes, its results times a scale.
   subroutine scaled_pair_lanes(nlane, words, scale, even, odd)
      integer(i4), intent(in) :: nlane
      integer(i8), intent(in) :: words(nlane, 4)
      real(wp), intent(in) :: scale
      real(wp), intent(out) :: even(nlane), odd(nlane)
      real(wp) :: radius, cosine, sine
      integer(i4) :: lane

      do lane = 1, nlane
         radius = sqrt(-2*log_unit(open_uniform(words(lane, 1), words(lane, 2))))
         call sincos_turn(open_uniform(words(lane, 3), words(lane, 4)), cosine, sine)
         even(lane) = scale*(radius*cosine)
         odd(lane) = scale*(radius*sine)
      end do
   end subroutine scaled_pair_lanes

   !> (2 k + 1) / 2**53 from the first 52 bits k of two words: k as the fraction of a number in
   !> [1,2), less 1 - 2**-53, which is exact.
   pure function open_uniform(high, low) result(u)
      integer(i8), intent(in) :: high, low   !! each 0 .. 2**32-1
      real(wp) :: u

      u = transfer(ior(ior(ishft(high, 20), ishft(low, -12)), one_bits), 0.0_wp) - one_less
   end function open_uniform

   !> log(u) for normal numbers u > 0: u = 2**e m with m in [sqrt(1/2), sqrt(2)), f = m - 1,
   !> s = f/(2+f), log(m) = f - f**2/2 + s (f**2/2 + z (l1 + l2 z + ..)), z = s**2.
   pure function log_unit(u) result(y)
      real(wp), intent(in) :: u
      real(wp) :: y
      real(wp) :: e, f, half, s, z, series
      integer(i8) :: bits

      bits = transfer(u, 0_i8) + (one_bits - root_bits)  ! its exponent field is e + 1023
      e = transfer(ior(ishft(bits, -52), big_bits), 0.0_wp) - big_bias
      f = transfer(iand(bits, fraction_bits) + root_bits, 0.0_wp) - 1
      s = f/(2 + f)
      z = s*s
      series = z*(l1 + z*(l2 + z*(l3 + z*(l4 + z*(l5 + z*(l6 + z*l7))))))
      half = 0.5_wp*f*f
      y = e*ln2_high - ((half - (s*(half + series) + e*ln2_low)) - f)
   end function log_unit

   !> cos and sin of 2 pi u for 0 <= u <= 1: 4 u = q + y with q an integer and |y| <= 1/2, both
   !> exact; the quarter turns q swap the two and set their signs. On bits, not by merge: the
   !> oldest level has no comparison of 64-bit integers, and the loop would not vectorise there.
   pure subroutine sincos_turn(u, cosine, sine)
      real(wp), intent(in) :: u
      real(wp), intent(out) :: cosine, sine
      real(wp) :: shifted, y, z, a, b
      integer(i8) :: q, a_bits, b_bits, swap

      shifted = 4*u + to_integer
      q = transfer(shifted, 0_i8)                 ! its last bits are those of the integer
      y = 4*u - (shifted - to_integer)
      z = y*y
      a = y*(s1 + z*(s2 + z*(s3 + z*(s4 + z*(s5 + z*(s6 + z*s7))))))
      b = 1 + z*(c1 + z*(c2 + z*(c3 + z*(c4 + z*(c5 + z*(c6 + z*c7))))))
      a_bits = transfer(a, 0_i8)
      b_bits = transfer(b, 0_i8)
      swap = iand(ieor(a_bits, b_bits), -iand(q, 1_i8))
      sine = transfer(ieor(ieor(a_bits, swap), sign_bit(q)), 0.0_wp)
      cosine = transfer(ieor(ieor(b_bits, swap), sign_bit(ieor(q, ishft(q, 1)))), 0.0_wp)
   end subroutine sincos_turn

   !> Bit 1 of q at the place of the sign.
   pure function sign_bit(q) result(bits)
      integer(i8), intent(in) :: q
      integer(i8) :: bits

      bits = ishft(iand(q, 2_i8), 62)
   end function sign_bit

end module symsde_noise_normal
