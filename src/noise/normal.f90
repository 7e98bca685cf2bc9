! SPDX-License-Identifier: BSD-3-Clause
!> Uniform and normal numbers from the generator's words. Only + - * / sqrt and integer bits are used, so that numbers
!> are the same on every x86-64 processor with fused multiply-add; no library function, so that a number does not depend
!> on its place in a vector.
!>
!> Normals come by Box and Muller, four from one draw of the generator: words 1-2 give the fine steps 4j and 4j+1, words
!> 3-4 the steps 4j+2 and 4j+3. Of the two words for a pair
!>
!>    the first gives the radius, r = sqrt(-2 log u), u = (k + 1/2)/2**32
!>    the second the angle: bits 1 .. 30 within a quarter turn, bits 31 and 0 the signs of the two normals
!>
!> With phi in (-pi/4, pi/4) the angle within the first quarter turn is pi/4 + phi, and
!>
!>    x_even = +- r/sqrt(2) (cos phi - sin phi),    x_odd = +- r/sqrt(2) (cos phi + sin phi),
!>
!> so that sine and cosine are polynomials on this short interval and no quadrant is looked up: the two signs, each a
!> bit of the word, turn the first quarter into the four. The logarithm splits u = 2**e m by its bits and sums
!> the series of log m = 2 artanh((m - 1)/(m + 1)).
!>
!> The law has 2**64 points for a pair; without more, it would be coarse in the tail and end at 6.8. So a radius with k
!> < 2**12, one pair in 2**20, uses 32 further bits from a draw of its own: u = (2**32 k + k' + 1/2)/2**64, up to r =
!> 9.5. This takes half the words and half the time of 64 bits for each uniform.
!>
!> Procedures differ in their lanes: paths in one pair of steps (scaled_normal_pairs), paths in several pairs
!> (scaled_normal_column), or any paths, draws and noises (scaled_normals_at, scaled_pairs_at). All give a path and a
!> step the same numbers.
module symsde_noise_normal
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_noise_philox, only: philox_tile, philox_lanes, philox_two_lanes, philox_lanes_at
   implicit none
   private
   public :: normal_stream, uniform_open_lanes, normal_pair_lanes, normal_pairs
   public :: scaled_normal_pairs, scaled_normal_steps, scaled_normal_column, scaled_normals_at, scaled_pairs_at

   integer(i4), parameter, public :: pairs_of_steps = 4  !! most pairs of scaled_normal_steps: two draws

   integer(i8), parameter :: one_bits = int(z'3FF0000000000000', i8)       ! 1.0
   integer(i8), parameter :: big_bits = int(z'4330000000000000', i8)       ! 2**52
   integer(i8), parameter :: root_bits = int(z'3FE6A09E667F3BCD', i8)      ! sqrt(1/2)
   integer(i8), parameter :: fraction_bits = int(z'000FFFFFFFFFFFFF', i8)
   integer(i8), parameter :: inner_bits = int(z'7FFFFFFE', i8)             ! 1 .. 30
   real(wp), parameter :: big = 2.0_wp**52
   real(wp), parameter :: one_less = 1 - 2.0_wp**(-53)

   integer(i8), parameter :: tail_words = 2_i8**12     !! radius words below this use further bits
   real(wp), parameter :: tail_size = sqrt(19.9_wp*0.6931471805599453094_wp) !! below r/sqrt(2) of all radii of the tail
   integer(i4), parameter :: tail_purpose = 32         !! added to the purpose for the draw of further bits

   real(wp), parameter :: ln2 = 0.6931471805599453094_wp
   ! minimax on |s| <= 3 - sqrt(8), z = s**2, to 2**-45: log((1+s)/(1-s)) = s (2 + z (l1 + l2 z + ..))
   real(wp), parameter :: l1 = 0.6666666667576858_wp, l2 = 0.39999995632836827_wp, l3 = 0.2857210799753787_wp, &
                          l4 = 0.22176236895507903_wp, l5 = 0.19583462563632337_wp
   ! minimax on |y| <= 1/2, z = y**2, to 2**-47 and 2**-43: sin(y pi/2) = y (s1 + s2 z + ..),
   ! cos(y pi/2) = 1 + z (c1 + c2 z + ..); y in units of 2**-31, powers of two, exact
   real(wp), parameter :: unit = 2.0_wp**(-31), unit2 = unit**2
   real(wp), parameter :: s1 = 1.5707963267948895_wp*unit, s2 = -0.6459640975042397_wp*unit*unit2, &
                          s3 = 0.07969262615353515_wp*unit*unit2**2, s4 = -0.004681752566780241_wp*unit*unit2**3, &
                          s5 = 0.00016042915251895755_wp*unit*unit2**4, s6 = -3.5562065761525054e-06_wp*unit*unit2**5
   real(wp), parameter :: c1 = -1.2337005501235707_wp*unit2, c2 = 0.2536695072116376_wp*unit2**2, &
                          c3 = -0.0208634684012751_wp*unit2**3, c4 = 0.0009191629221169082_wp*unit2**4, &
                          c5 = -2.4852206943562213e-05_wp*unit2**5

   !> A stream selects normals among all those of a path and a pair of fine steps.
   type :: normal_stream
      integer(i8) :: seed = 0          !! the 64-bit key
      integer(i4) :: noise = 0         !! 0 .. 2**20-1
      integer(i4) :: level = 0         !! 0 .. 63
      integer(i4) :: purpose = 0       !! 0 .. 31
      real(wp) :: scale = 1            !! standard deviation
   end type normal_stream

contains

   !> The two independent standard normals of the fine steps 2 pair and 2 pair + 1 for each path of a block.
   subroutine normal_pairs(nlane, seed, path, pair, noise, level, purpose, even, odd)
      integer(i4), intent(in) :: nlane         !! lanes of the block, any number
      integer(i8), intent(in) :: seed          !! the 64-bit key
      integer(i8), intent(in) :: path(nlane)   !! global path, 0 .. 2**48-1
      integer(i8), intent(in) :: pair          !! pair of fine steps, 0 .. 2**48-1
      integer(i4), intent(in) :: noise         !! 0 .. 2**20-1
      integer(i4), intent(in) :: level         !! 0 .. 63
      integer(i4), intent(in) :: purpose       !! 0 .. 31
      real(wp), intent(out) :: even(nlane)     !! N(0,1)
      real(wp), intent(out) :: odd(nlane)      !! N(0,1), independent of even

      ! Standard deviation one, the default of a stream.
      call scaled_normal_pairs(nlane, normal_stream(seed, noise, level, purpose), path, pair, even, odd)
   end subroutine normal_pairs

   !> normal_pairs of a stream: N(0, scale^2) of its noise, level and purpose. Of the four words of a draw two
   !> belong to this pair; tiles of philox_tile lanes keep words and normals in cache.
   subroutine scaled_normal_pairs(nlane, of, path, pair, even, odd)
      integer(i4), intent(in) :: nlane
      type(normal_stream), intent(in) :: of
      integer(i8), intent(in) :: path(nlane), pair
      real(wp), intent(out) :: even(nlane), odd(nlane)
      integer(i8) :: words(4*philox_tile), draw(philox_tile)
      integer(i4) :: first, n, word
      logical :: tails

      word = 2*int(mod(pair, 2_i8))  ! words of a draw before the words of this pair
      do first = 1, nlane, philox_tile
         n = min(philox_tile, nlane - first + 1)
         call philox_lanes(n, of%seed, path(first), pair/2, of%noise, of%level, of%purpose, words)
         associate (radius => words(word*n + 1:(word + 1)*n), angle => words((word + 1)*n + 1:(word + 2)*n))
            call normal_pair_lanes(n, radius, angle, of%scale, even(first), odd(first), tails)
            if (.not. tails) cycle
            draw = pair/2
            call mend_tails(n, of, path(first), draw, word + 1, radius, angle, even(first), odd(first))
         end associate
      end do
   end subroutine scaled_normal_pairs

   !> scaled_normal_pairs for npair pairs of fine steps from an even pair on, written into the columns of w of this
   !> noise.
   subroutine scaled_normal_steps(nlane, of, path, pair, npair, nnoise, w)
      integer(i4), intent(in) :: nlane
      type(normal_stream), intent(in) :: of    !! stream of noise 1 .. nnoise
      integer(i8), intent(in) :: path(nlane)
      integer(i8), intent(in) :: pair          !! first pair of fine steps, even
      integer(i4), intent(in) :: npair         !! 1 .. pairs_of_steps
      integer(i4), intent(in) :: nnoise
      real(wp), intent(inout) :: w(nlane, 0:nnoise, 0:2*npair - 1)

      call scaled_normal_column(nlane, of, path, pair, npair, nnoise + 1, w(1, of%noise, 0))
   end subroutine scaled_normal_steps

   !> scaled_normal_steps for one of several columns, the first column of x; long runs use this, since it uses every
   !> word. Four pairs are two draws, which the generator makes in one pass.
   subroutine scaled_normal_column(nlane, of, path, pair, npair, ncolumn, x)
      integer(i4), intent(in) :: nlane
      type(normal_stream), intent(in) :: of
      integer(i8), intent(in) :: path(nlane)
      integer(i8), intent(in) :: pair          !! first pair of fine steps, even
      integer(i4), intent(in) :: npair         !! 1 .. pairs_of_steps
      integer(i4), intent(in) :: ncolumn       !! columns of a step
      real(wp), intent(inout) :: x(nlane*(ncolumn*(2*npair - 1) + 1))  !! numbers every nlane*ncolumn
      integer(i8) :: words(philox_tile, 2, 0:3), draw(philox_tile)
      integer(i4) :: first, n, j
      logical :: tails

      first = 1
      do while (first <= nlane)
         ! The pass needs paths of one tile with equal high bits, as all are, except in a block across 2**32.
         n = neighbours(min(philox_tile, nlane - first + 1), path(first))
         call philox_two_lanes(n, of%seed, path(first), ishft(path(first), -32), pair/2, of%noise, of%level, &
                               of%purpose, words)
         ! words(:, :, j) are the words for radius and angle of pair j; two pairs make a draw.
         do j = 0, npair - 1
            call normal_pair_lanes(n, words(1, 1, j), words(1, 2, j), of%scale, x(first + 2*j*nlane*ncolumn), &
                                   x(first + (2*j + 1)*nlane*ncolumn), tails)
            if (.not. tails) cycle
            draw = (pair + j)/2
            call mend_tails(n, of, path(first), draw, 1 + 2*mod(j, 2), words(1, 1, j), words(1, 2, j), &
                            x(first + 2*j*nlane*ncolumn), x(first + (2*j + 1)*nlane*ncolumn))
         end do
         first = first + n
      end do
   end subroutine scaled_normal_column

   !> How many lanes, from the first on, have paths that differ in their low 32 bits alone: all, except in one block of
   !> 2**24. A loop without branches first combines differing high bits of all lanes.
   pure integer(i4) function neighbours(nlane, path)
      integer(i4), intent(in) :: nlane
      integer(i8), intent(in) :: path(nlane)
      integer(i8) :: upper, differing
      integer(i4) :: lane

      upper = ishft(path(1), -32)
      differing = 0
      do lane = 1, nlane
         differing = ior(differing, ieor(ishft(path(lane), -32), upper))
      end do
      neighbours = nlane
      if (differing == 0) return
      neighbours = 1
      do while (ishft(path(neighbours + 1), -32) == upper)
         neighbours = neighbours + 1
      end do
   end function neighbours

   !> Normals of the fine steps 4 draw .. 4 draw + 3, with a draw and a noise for each lane; the stream's noise is not
   !> used.
   subroutine scaled_normals_at(nlane, of, path, draw, noise, x)
      integer(i4), intent(in) :: nlane         !! lanes, any number
      type(normal_stream), intent(in) :: of
      integer(i8), intent(in) :: path(nlane), draw(nlane)
      integer(i4), intent(in) :: noise(nlane)
      real(wp), intent(out) :: x(nlane, 0:3)
      type(normal_stream) :: own
      integer(i8) :: words(4*philox_tile)
      integer(i4) :: first, n, j, lane, radius, angle
      logical :: tails

      do first = 1, nlane, philox_tile
         n = min(philox_tile, nlane - first + 1)
         call philox_lanes_at(n, of%seed, path(first), draw(first), noise(first), of%level, of%purpose, words)
         do j = 0, 2, 2
            radius = j*n
            angle = radius + n
            call normal_pair_lanes(n, words(radius + 1), words(angle + 1), of%scale, x(first, j), x(first, j + 1), &
                                   tails)
            if (.not. tails) cycle
            ! Each lane may have another noise, so tails are handled lane by lane.
            do lane = first, first + n - 1
               own = of
               own%noise = noise(lane)
               associate (i => lane - first + 1)
                  call mend_tails(1, own, path(lane), draw(lane), j + 1, words(radius + i), words(angle + i), &
                                  x(lane, j), x(lane, j + 1))
               end associate
            end do
         end do
      end do
   end subroutine scaled_normals_at

   !> The two normals of a pair of fine steps for each lane; the pairs are all even, or all odd.
   subroutine scaled_pairs_at(nlane, of, path, pair, even, odd)
      integer(i4), intent(in) :: nlane         !! lanes, any number
      type(normal_stream), intent(in) :: of
      integer(i8), intent(in) :: path(nlane), pair(nlane)
      real(wp), intent(out) :: even(nlane), odd(nlane)
      integer(i8) :: words(nlane, 4), draw(nlane)
      integer(i4) :: noises(nlane), word
      logical :: tails

      ! One draw makes the normals of two pairs; each lane takes the normals of its own pair.
      draw = pair/2
      noises = of%noise
      word = 1 + 2*int(mod(pair(1), 2_i8))
      call philox_lanes_at(nlane, of%seed, path, draw, noises, of%level, of%purpose, words)
      call normal_pair_lanes(nlane, words(1, word), words(1, word + 1), of%scale, even, odd, tails)
      if (tails) call mend_tails(nlane, of, path, draw, word, words(1, word), words(1, word + 1), even, odd)
   end subroutine scaled_pairs_at

   !> Compute pairs whose radius lies in the tail again, with the further bits of their draw. The angle stays.
   subroutine mend_tails(nlane, of, path, draw, word, radius, angle, even, odd)
      integer(i4), intent(in) :: nlane
      type(normal_stream), intent(in) :: of
      integer(i8), intent(in) :: path(nlane), draw(nlane)
      integer(i4), intent(in) :: word          !! index of the word of further bits for the radius
      integer(i8), intent(in) :: radius(nlane), angle(nlane)
      real(wp), intent(inout) :: even(nlane), odd(nlane)
      integer(i8) :: words(1, 4)
      real(wp) :: size
      integer(i4) :: lane

      do lane = 1, nlane
         if (radius(lane) >= tail_words) cycle
         ! The draw with the tail's purpose: 32 more bits below the bits of the radius.
         call philox_lanes(1, of%seed, path(lane), draw(lane), of%noise, of%level, of%purpose + tail_purpose, words)
         call normal_pair(real(ishft(radius(lane), 32) + words(1, word), wp) + 0.5_wp, 64, angle(lane), of%scale, &
                          even(lane), odd(lane), size)
      end do
   end subroutine mend_tails

   !> Two uniforms a lane in the open interval: (2 k + 1) / 2**53, with k the first 52 of the 64 bits of words 1-2, or
   !> of words 3-4. Symmetric about 1/2; never 0 or 1; every value is exact.
   subroutine uniform_open_lanes(nlane, words, u1, u2)
      integer(i4), intent(in) :: nlane
      integer(i8), intent(in) :: words(nlane, 4)          !! each 0 .. 2**32-1
      real(wp), intent(out) :: u1(nlane), u2(nlane)
      integer(i4) :: lane

      do lane = 1, nlane
         ! Two words to a uniform.
         u1(lane) = open_uniform(words(lane, 1), words(lane, 2))
         u2(lane) = open_uniform(words(lane, 3), words(lane, 4))
      end do
   end subroutine uniform_open_lanes

   !> VEC Two independent normals a lane by Box and Muller, without correcting tails. The error is at most 6.4e-14 of
   !> the radius. About 50 operations a lane, one division and one root among them; 16 bytes in, 16 out.
   subroutine normal_pair_lanes(nlane, radius, angle, scale, even, odd, tails)
      integer(i4), intent(in) :: nlane
      integer(i8), intent(in) :: radius(nlane), angle(nlane)   !! words, each 0 .. 2**32-1
      real(wp), intent(in) :: scale
      real(wp), intent(out) :: even(nlane), odd(nlane)         !! N(0,scale**2)
      logical, intent(out) :: tails                            !! some radius may lie in the tail
      real(wp) :: size, largest
      integer(i4) :: lane

      largest = 0
      do lane = 1, nlane
         ! k + 1/2 without a conversion: the bits of k become the last bits of a number in [2**52, 2**53), from which
         ! 2**52 is subtracted.
         call normal_pair(transfer(ior(radius(lane), big_bits), 0.0_wp) - (big - 0.5_wp), 32, angle(lane), scale, &
                          even(lane), odd(lane), size)
         ! One number for all lanes, compared at the end, instead of a test in each.
         largest = max(largest, size)
      end do
      tails = largest > scale*tail_size
   end subroutine normal_pair_lanes

   !> Two normals of a lane from u = x/2**bits and the word of the angle. In the first quarter turn the angle is
   !> pi/4 + phi, and its cosine and sine are (cos phi -+ sin phi)/sqrt(2); two more bits of the word give the signs.
   pure subroutine normal_pair(x, bits, angle, scale, even, odd, size)
      real(wp), intent(in) :: x                !! k + 1/2
      integer, intent(in) :: bits
      integer(i8), intent(in) :: angle
      real(wp), intent(in) :: scale
      real(wp), intent(out) :: even, odd
      real(wp), intent(out) :: size            !! scale r/sqrt(2)
      real(wp) :: y, z, cosine, sine

      ! r/sqrt(2) = sqrt(-log u), and 1/sqrt(2) is the factor of cos and sin below.
      size = scale*sqrt(minus_log(x, bits))
      ! An odd 31-bit number less 2**30, so that phi is never zero and its law is symmetric.
      y = transfer(ior(iand(angle, inner_bits), big_bits + 1), 0.0_wp) - (big + 2.0_wp**30)
      z = y*y
      sine = y*(s1 + z*(s2 + z*(s3 + z*(s4 + z*(s5 + z*s6)))))
      cosine = 1 + z*(c1 + z*(c2 + z*(c3 + z*(c4 + z*c5))))
      ! Bit 31 of the word becomes the sign of `even`, bit 0 the sign of `odd`.
      even = with_sign(size*(cosine - sine), ishft(angle, 32))
      odd = with_sign(size*(cosine + sine), ishft(angle, 63))
   end subroutine normal_pair

   !> -log(x/2**bits) for 1/2 <= x < 2**bits: x = 2**e m with m in [sqrt(1/2), sqrt(2)), f = m - 1, s = f/(2+f),
   !> log(m) = log((1+s)/(1-s)). Relative
   !> error 3e-14: no digits are lost next to u = 1, where e = bits.
   pure real(wp) function minus_log(x, bits)
      real(wp), intent(in) :: x
      integer, intent(in) :: bits
      real(wp) :: e, f, s, z
      integer(i8) :: pattern

      ! Adding this to the bits of x carries into the exponent where the mantissa is sqrt(2) or more.
      pattern = transfer(x, 0_i8) + (one_bits - root_bits)  ! the exponent field of `pattern` is e + 1023
      e = transfer(ior(ishft(pattern, -52), big_bits), 0.0_wp) - (big + 1023 + bits)
      f = transfer(iand(pattern, fraction_bits) + root_bits, 0.0_wp) - 1
      ! One division; |s| <= 3 - sqrt(8), where the odd polynomial is good to 2**-45.
      s = f/(2 + f)
      z = s*s
      minus_log = -ln2*e - s*(2 + z*(l1 + z*(l2 + z*(l3 + z*(l4 + z*l5)))))
   end function minus_log

   !> x >= 0 with the sign bit of a pattern.
   pure real(wp) function with_sign(x, pattern)
      real(wp), intent(in) :: x
      integer(i8), intent(in) :: pattern

      with_sign = transfer(ior(transfer(x, 0_i8), iand(pattern, not(huge(0_i8)))), 0.0_wp)
   end function with_sign

   !> (2 k + 1) / 2**53 from the first 52 bits k of two words: k as the fraction of a number in
   !> [1,2), less 1 - 2**-53, which is exact.
   pure function open_uniform(high, low) result(u)
      integer(i8), intent(in) :: high, low   !! each 0 .. 2**32-1
      real(wp) :: u

      u = transfer(ior(ior(ishft(high, 20), ishft(low, -12)), one_bits), 0.0_wp) - one_less
   end function open_uniform

end module symsde_noise_normal
