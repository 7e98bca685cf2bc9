! SPDX-License-Identifier: BSD-3-Clause
!> Sine and cosine of the same argument, for models whose forces need one or both in every lane. A call of the C library
!> in a loop becomes a vector call for most lanes and a scalar call for the rest, with different last bits; here each
!> lane is a pure function of its own argument.
module symsde_base_sincos
   use symsde_base_kinds, only: wp, i4, i8
   implicit none
   private
   public :: sincos_lanes, sincos_where_weighted, sincos_one, sine_of, sincos_bound, sincos_tile

   !> Arguments up to this size take the fast path: then x 2/pi rounds to less than 2**16, which
   !> makes the products with the 37-bit parts of pi/2 exact.
   real(wp), parameter :: sincos_bound = 1.0e5_wp

   !> Lanes at once for callers that use one of the two alone: room on the stack, since gfortran allocates arrays of
   !> variable length on the heap in every call.
   integer, parameter :: sincos_tile = 256

   !> Read as integers, the bits of |x| have the order of |x|, with infinities and NaNs above all numbers.
   integer(i8), parameter :: bound_bits = transfer(sincos_bound, 0_i8)

   real(wp), parameter :: two_over_pi = 0.6366197723675814_wp
   ! pi/2 in three parts of 37, 37 and 53 bits
   real(wp), parameter :: half_pi_1 = 1.5707963267923333_wp
   real(wp), parameter :: half_pi_2 = 2.5633441515839558e-12_wp
   real(wp), parameter :: half_pi_3 = 1.0562999066987428e-23_wp
   real(wp), parameter :: small = 0.785_wp  !! arguments below pi/4 need no reduction
   real(wp), parameter :: to_integer = 1.5_wp*2.0_wp**52  ! x + this - this rounds x to an integer
   ! minimax on |r| <= pi/4, z = r**2, to 2**-58 and 2**-64:
   ! sin(r) = r + r z (s1 + s2 z + ..), cos(r) = 1 - z/2 + z**2 (c1 + c2 z + ..)
   real(wp), parameter :: s1 = -0.16666666666666632_wp, s2 = 0.008333333333322418_wp, &
                          s3 = -0.00019841269829812402_wp, s4 = 2.755731369357982e-06_wp, &
                          s5 = -2.505075838538343e-08_wp, s6 = 1.5896811852068921e-10_wp
   real(wp), parameter :: c1 = 0.0416666666666666_wp, c2 = -0.0013888888888874131_wp, &
                          c3 = 2.4801587289487006e-05_wp, c4 = -2.755731435378607e-07_wp, &
                          c5 = 2.087572347857163e-09_wp, c6 = -1.1359658818861251e-11_wp

contains

   !> VEC s = sin(x), c = cos(x). Up to |x| = sincos_bound within 1 ulp (measured: 0.91); larger, infinite and NaN
   !> arguments are left to the intrinsics, lane by lane. sin(-0.0) is +0.0. About 60 operations a lane, 8 bytes in,
   !> 16 out.
   pure subroutine sincos_lanes(n, x, s, c)
      integer(i4), intent(in) :: n        !! lanes, any number
      real(wp), intent(in) :: x(n)        !! radians
      real(wp), intent(out) :: s(n)       !! sin(x)
      real(wp), intent(out) :: c(n)       !! cos(x)
      integer(i8) :: beyond
      integer(i4) :: i

      beyond = 0
      do i = 1, n
         call sincos_near(x(i), s(i), c(i))
         beyond = ior(beyond, bound_bits - iand(transfer(x(i), 0_i8), huge(beyond)))
      end do
      if (beyond < 0) call sincos_far(n, x, s, c)
   end subroutine sincos_lanes

   !> sincos_lanes for products with these weights. If all weights vanish, s and c are set to zero: this happens when a
   !> Hamiltonian without sine and cosine is evaluated alone.
   pure subroutine sincos_where_weighted(n, weight, x, s, c)
      integer(i4), intent(in) :: n
      real(wp), intent(in) :: weight(n), x(n)
      real(wp), intent(out) :: s(n), c(n)
      integer(i8) :: bits
      integer(i4) :: i

      bits = 0
      do i = 1, n
         bits = ior(bits, iand(transfer(weight(i), 0_i8), huge(bits)))  ! bits of the weights without their signs
      end do
      if (bits /= 0) then
         call sincos_lanes(n, x, s, c)
      else
         s = 0
         c = 0
      end if
   end subroutine sincos_where_weighted

   !> Sine and cosine of one argument, with the bits it has in a lane. The sine is returned in a register, since a
   !> single path waits for it. A small angle needs no reduction.
   real(wp) function sincos_one(x, c) result(s)
      real(wp), value :: x               !! radians
      real(wp), intent(out) :: c         !! cos(x)

      if (abs(x) <= small) then
         call on_quarter(x, 0.0_wp, s, c)
      else if (abs(x) <= sincos_bound) then  ! outside sincos_near, so that it is contracted as in lanes
         call sincos_near(x, s, c)
      else
         s = sin(x)
         c = cos(x)
      end if
   end function sincos_one

   !> The sine alone, with the bits of a lane, for coefficients of a step. A loop over the intrinsic becomes a call of
   !> the vector math library, whose last bits depend on the width of the registers.
   elemental real(wp) function sine_of(x) result(s)
      real(wp), intent(in) :: x  !! radians
      real(wp), dimension(1) :: argument, as_array, cosine

      argument = x
      call sincos_lanes(1_i4, argument, as_array, cosine)
      s = as_array(1)
   end function sine_of

   !> The fast path. x = q pi/2 + r + low with q the nearest integer (Cody and Waite); x - q
   !> half_pi_1 is exact, and low collects what the second subtraction lost and the third part.
   !> The quarter turns q swap sine and cosine and set their signs: on bits, not by merge, since
   !> the oldest x86-64 level has no comparison of 64-bit integers.
   pure subroutine sincos_near(x, s, c)
      real(wp), intent(in) :: x
      real(wp), intent(out) :: s, c
      real(wp) :: shifted, turns, first, second, r, low, a, b
      integer(i8) :: q, a_bits, b_bits, swap

      shifted = x*two_over_pi + to_integer
      q = transfer(shifted, 0_i8)                 ! the last bits of `shifted` are those of the integer
      turns = shifted - to_integer
      first = x - turns*half_pi_1
      second = turns*half_pi_2
      r = first - second
      low = ((first - r) - second) - turns*half_pi_3
      call on_quarter(r, low, a, b)
      a_bits = transfer(a, 0_i8)
      b_bits = transfer(b, 0_i8)
      swap = iand(ieor(a_bits, b_bits), -iand(q, 1_i8))
      s = transfer(ieor(ieor(a_bits, swap), sign_bit(q)), 0.0_wp)
      c = transfer(ieor(ieor(b_bits, swap), sign_bit(ieor(q, ishft(q, 1)))), 0.0_wp)
   end subroutine sincos_near

   !> Sine and cosine of r + low, |r| <= pi/4.
   pure subroutine on_quarter(r, low, s, c)
      real(wp), intent(in) :: r, low
      real(wp), intent(out) :: s, c
      real(wp) :: z, half

      z = r*r
      s = r + (r*(z*(s1 + z*(s2 + z*(s3 + z*(s4 + z*(s5 + z*s6)))))) + low)
      half = 0.5_wp*z
      c = 1 - half
      c = c + (((1 - c) - half) + &
               (z*z*(c1 + z*(c2 + z*(c3 + z*(c4 + z*(c5 + z*c6))))) - r*low))
   end subroutine on_quarter

   !> Bit 1 of q, moved to the sign bit.
   pure function sign_bit(q) result(bits)
      integer(i8), intent(in) :: q
      integer(i8) :: bits

      bits = ishft(iand(q, 2_i8), 62)
   end function sign_bit

   !> Replace lanes beyond the bound and lanes that are not finite by the intrinsics' values.
   pure subroutine sincos_far(n, x, s, c)
      integer(i4), intent(in) :: n
      real(wp), intent(in) :: x(n)
      real(wp), intent(inout) :: s(n), c(n)
      integer(i4) :: i

      do i = 1, n
         if (abs(x(i)) <= sincos_bound) cycle
         s(i) = sin(x(i))
         c(i) = cos(x(i))
      end do
   end subroutine sincos_far

end module symsde_base_sincos
