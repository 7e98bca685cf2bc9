! SPDX-License-Identifier: BSD-3-Clause
!> exp(-x) - 1 in every lane, for decays whose rates differ between lanes. A call of the C library in a loop becomes a
!> vector call for most lanes and a scalar call for the rest, with different last bits; here each lane is a pure
!> function of its own argument.
!>
!>    -x = n ln 2 + r,  |r| <= (ln 2)/2:   exp(-x) - 1 = 2^n e + (2^n - 1),  e = exp(r) - 1 = r + r^2 (1/2 + r/6 + ..)
module symsde_base_exponential
   use symsde_base_kinds, only: wp, i8
   implicit none
   private
   public :: to_losses

   real(wp), parameter :: bound = 700   !! arguments up to this size take the fast path, with 2^n as a normal number
   real(wp), parameter :: per_ln_2 = 1/log(2.0_wp)
   ! ln 2 in two parts, of 33 bits and of 53
   real(wp), parameter :: ln_2_1 = 0.69314718036912382_wp
   real(wp), parameter :: ln_2_2 = 1.9082149292705877e-10_wp
   real(wp), parameter :: to_integer = 1.5_wp*2.0_wp**52  ! x + this - this rounds x to an integer
   !> Taylor's coefficients 1/k!, k = 2 .. 13: the next term is below 2**-56 of the sum.
   real(wp), parameter :: c(2:13) = [1/2.0_wp, 1/6.0_wp, 1/24.0_wp, 1/120.0_wp, 1/720.0_wp, 1/5040.0_wp, &
                                     1/40320.0_wp, 1/362880.0_wp, 1/3628800.0_wp, 1/39916800.0_wp, &
                                     1/479001600.0_wp, 1/6227020800.0_wp]

contains

   !> x <- exp(-x) - 1, within 2 ulps. Larger, infinite and NaN arguments are left to the intrinsic, lane by lane.
   pure subroutine to_losses(nlane, x)
      integer, intent(in) :: nlane
      real(wp), intent(inout) :: x(nlane)
      integer :: lane

      if (all(abs(x) <= bound)) then
         call near(nlane, x)
         return
      end if
      !GCC$ novector
      do lane = 1, nlane
         if (abs(x(lane)) <= bound) then
            call near(1, x(lane:lane))
         else
            x(lane) = exp(-x(lane)) - 1
         end if
      end do
   end subroutine to_losses

   !> VEC The same for arguments up to the bound. No sum has two products, of which the compiler might contract either.
   pure subroutine near(nlane, x)
      integer, intent(in) :: nlane
      real(wp), intent(inout) :: x(nlane)
      real(wp) :: shifted, n, r, e, power
      integer :: lane

      do lane = 1, nlane
         shifted = to_integer - x(lane)*per_ln_2
         n = shifted - to_integer
         r = (-x(lane) - n*ln_2_1) - n*ln_2_2
         e = c(9) + r*(c(10) + r*(c(11) + r*(c(12) + r*c(13))))
         e = c(2) + r*(c(3) + r*(c(4) + r*(c(5) + r*(c(6) + r*(c(7) + r*(c(8) + r*e))))))
         e = r + (r*r)*e
         ! The last bits of `shifted` are those of n; they become the exponent of 2^n.
         power = transfer(ishft(transfer(shifted, 0_i8) + 1023_i8, 52), 0.0_wp)
         x(lane) = power*e + (power - 1)
      end do
   end subroutine near

end module symsde_base_exponential
