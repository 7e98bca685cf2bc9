! SPDX-License-Identifier: BSD-3-Clause
!> Philox4x32-10, the counter-based generator of Salmon, Moraes, Dror and Shaw,
!> "Parallel random numbers: as easy as 1, 2, 3" (SC'11): four random 32-bit words are a pure
!> function of a 128-bit counter and a 64-bit key. The generator has no state.
!>
!> A 32-bit word is held in an i8, 0 .. 2**32-1. The counter map, version `counter_map_version`:
!>
!>     key(1)     low 32 bits of the seed
!>     key(2)     high 32 bits of the seed
!>     counter(1) low 32 bits of the path
!>     counter(2) high 16 bits of the path + 2**16 * (high 16 bits of the draw)
!>     counter(3) low 32 bits of the draw
!>     counter(4) noise + 2**20 * level + 2**26 * purpose
!>
!> with path and draw of 48 bits, noise of 20, level and purpose of 6 bits each: distinct
!> arguments never share a counter. The use of a draw's words is defined where it is drawn; the normals of fine steps 4j
!> .. 4j+3 are draw j (symsde_noise_normal). Any change of these rules needs a new version number.
!>
!> This file, and no other, is compiled with -fwrapv: the lane kernel needs the low 64 bits of an unsigned product,
!> which overflows a signed integer.
module symsde_noise_philox
   use symsde_base_kinds, only: i4, i8
   implicit none
   private
   public :: counter_map_version, philox_tile, philox_lanes, philox_two_lanes, philox_lanes_at, philox_words

   integer(i4), parameter :: counter_map_version = 2  !! recorded with every result

   ! Purposes in use, each of one kind of draws. A run has discrete increments or K, never both: these may share one.
   integer(i4), parameter, public :: purpose_increment = 0       !! dW at the finest step
   integer(i4), parameter, public :: purpose_bridge = 1          !! dW of a halving without functionals
   integer(i4), parameter, public :: purpose_oscillator = 2      !! rests of exact solutions
   integer(i4), parameter, public :: purpose_shape = 3           !! H at the finest step
   integer(i4), parameter, public :: purpose_halving = 4         !! Z of a halving
   integer(i4), parameter, public :: purpose_halves = 5          !! N of a halving, or M
   integer(i4), parameter, public :: purpose_stt_area = 6        !! K at the finest step
   integer(i4), parameter, public :: purpose_discrete = 6        !! increments of a discrete law
   integer(i4), parameter, public :: purpose_stt_halving = 7     !! D of a halving
   integer(i4), parameter, public :: purpose_rest = 8            !! normal terms of areas; their noise is a pair's index
   integer(i4), parameter, public :: purpose_passage = 9         !! numbers that decide on passages within a step
   integer(i4), parameter, public :: purpose_sign = 10           !! signs of areas; their noise is a pair's index
   integer(i4), parameter, public :: purpose_normal_state = 11   !! normal initial states
   integer(i4), parameter, public :: purpose_uniform_state = 12  !! uniform initial states
   integer(i4), parameter, public :: purpose_decay = 13          !! xi of D_k at the finest step, or of a first half
   integer(i4), parameter, public :: purpose_second_decay = 14   !! xi of D_k in the second half of a halving

   integer(i8), parameter :: low32 = int(z'FFFFFFFF', i8)
   integer(i8), parameter :: low16 = int(z'FFFF', i8)
   integer(i8), parameter :: multiplier(2) = [int(z'D2511F53', i8), int(z'CD9E8D57', i8)]
   integer(i8), parameter :: weyl(2) = [int(z'9E3779B9', i8), int(z'BB67AE85', i8)]
   integer, parameter :: nround = 10
   !> Most lanes of philox_two_lanes: their words (64 bytes per lane) and normals stay in cache.
   integer(i4), parameter :: philox_tile = 256

contains

   !> VEC Four random words for each path of a block, by the counter map above.
   !> About 80 operations a lane; 8 bytes in, 32 out; no branch, no table.
   subroutine philox_lanes(nlane, seed, path, draw, noise, level, purpose, words)
      integer(i4), intent(in) :: nlane           !! lanes of the block, any number
      integer(i8), intent(in) :: seed            !! the 64-bit key
      integer(i8), intent(in) :: path(nlane)     !! global path, 0 .. 2**48-1
      integer(i8), intent(in) :: draw            !! number of the draw, 0 .. 2**48-1
      integer(i4), intent(in) :: noise           !! 0 .. 2**20-1
      integer(i4), intent(in) :: level           !! 0 .. 63
      integer(i4), intent(in) :: purpose         !! 0 .. 63
      integer(i8), intent(out) :: words(nlane, 4)  !! each 0 .. 2**32-1
      integer(i8) :: k(nround, 2), m(2), c1, c2, c3, c4, high_draw, low_draw, tag
      integer(i4) :: lane, round

      call round_keys(seed, k)
      call multipliers(m)
      ! Words of the counter that all lanes share; lanes differ in the low word of the path.
      high_draw = ishft(ishft(draw, -32), 16)
      low_draw = iand(draw, low32)
      tag = tag_of(noise, level, purpose)
      do lane = 1, nlane
         c1 = iand(path(lane), low32)
         c2 = ior(ishft(path(lane), -32), high_draw)
         c3 = low_draw
         c4 = tag
         !GCC$ unroll 10
         do round = 1, nround
            call one_round(m(1), m(2), k(round, 1), k(round, 2), c1, c2, c3, c4)
         end do
         words(lane, 1) = c1
         words(lane, 2) = c2
         words(lane, 3) = c3
         words(lane, 4) = c4
      end do
   end subroutine philox_lanes

   !> VEC philox_lanes for two draws, `draw` and `draw` + 1, of paths that differ in their low 32 bits alone. Two chains
   !> of rounds in a lane hide the latency of products, and common work of the first rounds is done once: 0.85 of the
   !> time for each word.
   subroutine philox_two_lanes(nlane, seed, path, upper, draw, noise, level, purpose, words)
      integer(i4), intent(in) :: nlane           !! 1 .. philox_tile
      integer(i8), intent(in) :: seed, path(nlane)
      integer(i8), intent(in) :: upper           !! path/2**32, the same for all lanes
      integer(i8), intent(in) :: draw
      integer(i4), intent(in) :: noise, level, purpose
      integer(i8), intent(out) :: words(philox_tile, 4, 0:1)  !! words of the lanes 1 .. nlane
      integer(i8) :: k(nround, 2), m(2), c1, c2, c3, c4, d1, d2, d3, d4, c_high, d_high, c_low, d_low, tag
      integer(i4) :: lane, round

      call round_keys(seed, k)
      call multipliers(m)
      c_high = ior(upper, ishft(ishft(draw, -32), 16))
      d_high = ior(upper, ishft(ishft(draw + 1, -32), 16))
      c_low = iand(draw, low32)
      d_low = iand(draw + 1, low32)
      tag = tag_of(noise, level, purpose)
      do lane = 1, nlane
         c1 = iand(path(lane), low32)
         d1 = c1
         c2 = c_high
         d2 = d_high
         c3 = c_low
         d3 = d_low
         c4 = tag
         d4 = tag
         !GCC$ unroll 10
         do round = 1, nround
            call one_round(m(1), m(2), k(round, 1), k(round, 2), c1, c2, c3, c4)
            call one_round(m(1), m(2), k(round, 1), k(round, 2), d1, d2, d3, d4)
         end do
         words(lane, 1, 0) = c1
         words(lane, 2, 0) = c2
         words(lane, 3, 0) = c3
         words(lane, 4, 0) = c4
         words(lane, 1, 1) = d1
         words(lane, 2, 1) = d2
         words(lane, 3, 1) = d3
         words(lane, 4, 1) = d4
      end do
   end subroutine philox_two_lanes

   !> VEC philox_lanes with a draw and a noise for each lane: a single path fills its lanes with later draws, and
   !> with draws of several noises.
   subroutine philox_lanes_at(nlane, seed, path, draw, noise, level, purpose, words)
      integer(i4), intent(in) :: nlane           !! lanes, any number
      integer(i8), intent(in) :: seed, path(nlane), draw(nlane)
      integer(i4), intent(in) :: noise(nlane), level, purpose
      integer(i8), intent(out) :: words(nlane, 4)  !! each 0 .. 2**32-1
      integer(i8) :: k(nround, 2), m(2), c1, c2, c3, c4, tag
      integer(i4) :: lane, round

      call round_keys(seed, k)
      call multipliers(m)
      tag = tag_of(0, level, purpose)
      do lane = 1, nlane
         c1 = iand(path(lane), low32)
         c2 = ior(ishft(path(lane), -32), ishft(ishft(draw(lane), -32), 16))
         c3 = iand(draw(lane), low32)
         c4 = tag + int(noise(lane), i8)
         !GCC$ unroll 10
         do round = 1, nround
            call one_round(m(1), m(2), k(round, 1), k(round, 2), c1, c2, c3, c4)
         end do
         words(lane, 1) = c1
         words(lane, 2) = c2
         words(lane, 3) = c3
         words(lane, 4) = c4
      end do
   end subroutine philox_lanes_at

   !> The fourth word of the counter, noise + 2**20 level + 2**26 purpose.
   pure integer(i8) function tag_of(noise, level, purpose)
      integer(i4), intent(in) :: noise, level, purpose

      tag_of = int(noise, i8) + ishft(int(level, i8), 20) + ishft(int(purpose, i8), 26)
   end function tag_of

   !> The two multipliers, read through volatile: otherwise the compiler replaces multiplications by constants by chains
   !> of shifts and additions (without AVX-512: 8.8 instead of 6.7 ns per lane).
   subroutine multipliers(m)
      integer(i8), intent(out) :: m(2)
      integer(i8), volatile :: hidden(2)

      hidden = multiplier
      m = hidden
   end subroutine multipliers

   !> One round on one lane, with hi and lo the halves of a product of 64 bits:
   !>
   !>    (c1, c2, c3, c4) <- (hi(m2 c3) xor c2 xor k1,  lo(m2 c3),  hi(m1 c1) xor c4 xor k2,  lo(m1 c1))
   !>
   !> With -fwrapv the products are the low 64 bits of unsigned products; shifts give both halves.
   pure subroutine one_round(m1, m2, k1, k2, c1, c2, c3, c4)
      integer(i8), intent(in) :: m1, m2                !! the two multipliers
      integer(i8), intent(in) :: k1, k2                !! the keys of this round
      integer(i8), intent(inout) :: c1, c2, c3, c4     !! the counter, scrambled
      integer(i8) :: p1, p2

      p1 = m1*c1
      p2 = m2*c3
      c1 = ieor(ieor(ishft(p2, -32), c2), k1)
      c3 = ieor(ieor(ishft(p1, -32), c4), k2)
      c2 = iand(p2, low32)
      c4 = iand(p1, low32)
   end subroutine one_round

   !> The keys of the ten rounds: the seed's halves, each advanced by its Weyl constant.
   pure subroutine round_keys(seed, k)
      integer(i8), intent(in) :: seed
      integer(i8), intent(out) :: k(nround, 2)   !! each 0 .. 2**32-1
      integer :: round

      ! Advanced once for each round, as the published generator does after it.
      k(1, 1) = iand(seed, low32)
      k(1, 2) = ishft(seed, -32)
      do round = 2, nround
         k(round, :) = iand(k(round - 1, :) + weyl, low32)
      end do
   end subroutine round_keys

   !> Philox4x32-10 of one counter and key as published: the readable twin of the lane kernel, which cannot overflow,
   !> for known-answer tests.
   pure subroutine philox_words(counter, key, words)
      integer(i8), intent(in) :: counter(4)   !! each 0 .. 2**32-1
      integer(i8), intent(in) :: key(2)       !! each 0 .. 2**32-1
      integer(i8), intent(out) :: words(4)    !! each 0 .. 2**32-1
      integer(i8) :: k(2), high(2), low(2)
      integer :: round

      words = counter
      k = key
      do round = 1, nround
         call product32(multiplier(1), words(1), high(1), low(1))
         call product32(multiplier(2), words(3), high(2), low(2))
         words(1) = ieor(ieor(high(2), words(2)), k(1))
         words(3) = ieor(ieor(high(1), words(4)), k(2))
         words(2) = low(2)
         words(4) = low(1)
         k = iand(k + weyl, low32)
      end do
   end subroutine philox_words

   !> The high and low word of a 32 by 32 bit product, from halves of 16 bits.
   pure subroutine product32(a, b, high, low)
      integer(i8), intent(in) :: a, b        !! each 0 .. 2**32-1
      integer(i8), intent(out) :: high, low
      integer(i8) :: upper, lower

      ! a b = a b_low + 2**16 a b_high: both products fit into the 63 bits of an integer, and so does the carry
      ! between them.
      lower = a*iand(b, low16)                    ! below 2**48
      upper = a*ishft(b, -16) + ishft(lower, -16)  ! below 2**49; weighs 2**16
      high = ishft(upper, -16)
      low = ior(ishft(iand(upper, low16), 16), iand(lower, low16))
   end subroutine product32

end module symsde_noise_philox
