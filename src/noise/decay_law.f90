! SPDX-License-Identifier: BSD-3-Clause
!> The noise of a damped free motion over one step, made of functionals of the step that undamped kicks draw, too.
!>
!> With u = h - s, z = gamma h and phi(t) = (1 - exp(-gamma t))/gamma, momentum and position receive
!>
!>    E = int exp(-gamma u) dW,   D = int phi(u) dW,        E + gamma D = W
!>
!> so that beside W only D is needed. Two forms give (W, D) its exact law, from the normals of a = dZ/h - W/2 and K:
!>
!>    law2   D = h [psi W + rho_1 a]                               for kicks that follow dZ
!>    law3   D = h [psi W + 3 i_1(x)/x exp(-x) a - rho_2 K]        for kicks that follow K, too;  x = z/2
!>
!>    psi     = (z - 1 + exp(-z))/z^2 = sum_k (-z)^k/(k+2)!
!>    rho_1^2 = 12 exp(-z) sum_{k>=1} 2k z^(2k-2)/(2k+2)!
!>    rho_2^2 = 720 exp(-z) z^2 sum_{k>=2} 4k(k-1)(2k+3) z^(2k-4)/(2k+4)!
!>    i_1(x)  = x sum_k (x^2/2)^k/(k! (2k+3)!!)                    the modified spherical Bessel function
!>
!> D follows the path to the order of the kicks: its difference from int phi(u) dW has mean zero and size h^(5/2) in
!> law2, h^(7/2) in law3. Without damping psi = 1/2, rho_1 = 1, rho_2 = 0.
!>
!> The integral along the path itself has one more normal xi, which is independent of dW, a and K, and merges:
!>
!>    path   D = h [psi W + 3 i_1(x)/x exp(-x) a - 30 i_2(x)/x exp(-x) K + rho_3 sqrt|h| xi]
!>    rho_3^2 = exp(-z) z^4 sum_{k>=3} 8k(k-1)(k-2)(2k+3)(2k+5) z^(2k-6)/(2k+6)!
!>    D = exp(-gamma h_2) D_1 + phi(h_2) W_1 + D_2            over two neighbouring intervals h_1, h_2
!>
!> The sums have terms of one sign. For |z| > 20 closed forms lose no digits, with e = exp(-|z|):
!>
!>    rho_1^2 = 12 (z/2 - 1 + 2 e - e^2 - z e^2/2)/z^4,   3 i_1(x)/x exp(-x) = 3 (x - 1 + (x + 1) e)/(2 x^3)
!>    rho_2^2 = 60 (rho_1^2 - (3 i_1(x)/x exp(-x))^2),    rho_3^2 = (rho_2^2 - (30 i_2(x)/x exp(-x))^2)/720
!>    30 i_2(x)/x exp(-x) = 15 ((1 + 3/x^2)(1 - e) - 3 (1 + e)/x)/x^2,   and all grow by exp(|z|) where z < 0
!>
!> Where an interval is halved (noise/integrals), xi of the whole is one direction in the space of the normals that
!> halve it: Z, M and D of the halving, and xi_1, xi_2 of the halves. With y = z/2 its components follow from
!>
!>    g_Z Z + g_M M + g_D D + (exp(-y) xi_1 + xi_2) rho_3(y) sqrt|h/8| = rho_3(z) sqrt|h| xi
!>    g_Z = -exp(-y) sum_{k>=2} 4(k-1) y^(2k-2)/(2k+1)!,   g_M = 48 exp(-y) sum_{k>=3} (k-1)(k-2) y^(2k-3)/(2k+1)!
!>    g_D = (1 - exp(-y)) 30 i_2(y/2)/(y/2) exp(-y/2)/8
module symsde_noise_decay_law
   use symsde_base_damping, only: decay_less_one
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: decay_law2, decay_law3, decay_path, decay_direction, decay_integral

   integer, parameter :: nterm = 40            !! terms of the sums
   real(wp), parameter :: summed_up_to = 20    !! largest |z| for which sums are used
   real(wp), parameter :: least = 1e-8_wp      !! smallest |z| for which a direction is computed, and used below

contains

   !> Coefficients of W, a and K in D/h, from the normals of W and a.
   pure function decay_law2(z) result(d)
      real(wp), intent(in) :: z   !! gamma h
      real(wp) :: d(3)

      d(1) = mean_of_motion(z)
      d(2) = growth(z)*first_root(abs(z))
      d(3) = 0
   end function decay_law2

   !> Coefficients of W, a and K in D/h, from the normals of all three.
   pure function decay_law3(z) result(d)
      real(wp), intent(in) :: z   !! gamma h
      real(wp) :: d(3)

      d(1) = mean_of_motion(z)
      d(2) = growth(z)*bessel_over(abs(z))
      d(3) = -sign(growth(z), z)*second_root(abs(z))
   end function decay_law3

   !> Coefficients of W, a, K and sqrt|h| xi in D/h along the path.
   pure function decay_path(z) result(d)
      real(wp), intent(in) :: z   !! gamma h
      real(wp) :: d(4)

      d(1) = mean_of_motion(z)
      d(2) = growth(z)*bessel_over(abs(z))
      d(3) = -sign(growth(z), z)*second_bessel_over(abs(z))
      d(4) = growth(z)*third_root(abs(z))
   end function decay_path

   !> The direction of xi in a halving: components along Z, M, D, xi_1 and xi_2, each divided by its standard deviation.
   !> The standard deviations are sqrt|h|/4 of Z, sqrt(|h|/192) of M and sqrt(|h|/180) of D. The sum of squares is one.
   pure function decay_direction(z) result(d)
      real(wp), intent(in) :: z   !! gamma h of the whole interval
      real(wp) :: d(5), y, e

      y = 0.5_wp*max(abs(z), least)
      e = exp(-y)
      if (y > summed_up_to) then
         d(1) = (3*(1 - e**2)/y - 1 - 4*e - e**2)/(4*y**2)
         d(2) = 6*((1 - e**2)*(1 + 15/y**2) - (7 + 16*e + 7*e**2)/y)/(sqrt(192.0_wp)*y**2)
      else
         d(1) = -e*halving_sum(y, 1)/4
         d(2) = 48*e*halving_sum(y, 2)/sqrt(192.0_wp)
      end if
      d(3) = -decay_less_one(y)*second_bessel_over(y)/(8*sqrt(180.0_wp))
      d(4) = e*third_root(y)/sqrt(8.0_wp)
      d(5) = third_root(y)/sqrt(8.0_wp)
      d = d/third_root(2*y)
      ! Back in time the factors of growth cancel, but the halves exchange their roles.
      if (z < 0) then
         d(2) = -d(2)
         y = d(4)
         d(4) = d(5)
         d(5) = y
      end if
   end function decay_direction

   !> phi(s h)/h = (1 - exp(-s z))/z, without cancellation; s where z is zero.
   elemental real(wp) function decay_integral(s, z) result(phi)
      real(wp), intent(in) :: s, z

      phi = s
      if (abs(z) > 0) phi = -decay_less_one(s*z)/z
   end function decay_integral

   !> For z < 0, exp(|z|) for rho_1, rho_2 and the Bessel function; else 1.
   pure real(wp) function growth(z)
      real(wp), intent(in) :: z

      growth = exp(max(0.0_wp, -z))
   end function growth

   !> psi(z), the mean of phi over the step.
   pure real(wp) function mean_of_motion(z) result(psi)
      real(wp), intent(in) :: z
      real(wp) :: term
      integer :: k

      if (abs(z) > 1) then
         psi = (z - 1 + exp(-z))/z**2
         return
      end if
      psi = 0
      term = 0.5_wp
      do k = 0, 20
         psi = psi + term
         term = -term*z/(k + 3)
      end do
   end function mean_of_motion

   !> rho_1, for z >= 0.
   pure real(wp) function first_root(z) result(root)
      real(wp), intent(in) :: z
      real(wp) :: e

      if (z > summed_up_to) then
         e = exp(-z)
         root = sqrt(12*(0.5_wp*z - 1 + 2*e - e**2 - 0.5_wp*z*e**2))/z**2
      else
         root = exp(-0.5_wp*z)*sqrt(12*positive_sum(z, 1))
      end if
   end function first_root

   !> rho_2, for z >= 0.
   pure real(wp) function second_root(z) result(root)
      real(wp), intent(in) :: z

      if (z > summed_up_to) then
         root = sqrt(60*(first_root(z) - bessel_over(z))*(first_root(z) + bessel_over(z)))
      else
         root = z*exp(-0.5_wp*z)*sqrt(720*positive_sum(z, 2))
      end if
   end function second_root

   !> 3 i_1(x)/x exp(-x) with x = z/2, for z >= 0: sum_k 3 (x^2/2)^k/(k! (2k+3)!!) exp(-x).
   pure real(wp) function bessel_over(z) result(total)
      real(wp), intent(in) :: z
      real(wp) :: term, x
      integer :: k

      x = 0.5_wp*z
      if (z > summed_up_to) then
         total = 1.5_wp*(x - 1 + (x + 1)*exp(-z))/x**3
         return
      end if
      total = 0
      term = exp(-x)
      do k = 0, nterm
         total = total + term
         term = term*(0.5_wp*x**2)/((k + 1.0_wp)*(2*k + 5))
      end do
   end function bessel_over

   !> 30 i_2(x)/x exp(-x) with x = z/2, for z >= 0: z exp(-x) sum_k 15 (x^2/2)^k/(k! (2k+5)!!).
   pure real(wp) function second_bessel_over(z) result(total)
      real(wp), intent(in) :: z
      real(wp) :: term, x, e
      integer :: k

      x = 0.5_wp*z
      if (z > summed_up_to) then
         e = exp(-z)
         total = 15*((1 + 3/x**2)*(1 - e) - 3*(1 + e)/x)/x**2
         return
      end if
      total = 0
      term = z*exp(-x)
      do k = 0, nterm
         total = total + term
         term = term*(0.5_wp*x**2)/((k + 1.0_wp)*(2*k + 7))
      end do
   end function second_bessel_over

   !> rho_3, for z >= 0.
   pure real(wp) function third_root(z) result(root)
      real(wp), intent(in) :: z

      if (z > summed_up_to) then
         root = sqrt((second_root(z) - second_bessel_over(z))*(second_root(z) + second_bessel_over(z))/720)
      else
         root = z**2*exp(-0.5_wp*z)*sqrt(positive_sum(z, 3))
      end if
   end function third_root

   !> sum_{k>=2} 4(k-1) y^(2k-2)/(2k+1)! for Z (number 1), sum_{k>=3} (k-1)(k-2) y^(2k-3)/(2k+1)! for M (number 2).
   pure real(wp) function halving_sum(y, number) result(total)
      real(wp), intent(in) :: y
      integer, intent(in) :: number
      real(wp) :: power   !! y^(2k-2)/(2k+1)!, or y^(2k-3)/(2k+1)!
      integer :: k

      total = 0
      power = merge(y**2, y, number == 1)/120
      do k = 2, nterm
         total = total + merge(4.0_wp, k - 2.0_wp, number == 1)*(k - 1)*power
         power = power*y**2/((2.0_wp*k + 2)*(2*k + 3))
      end do
   end function halving_sum

   !> The sums in rho_1, rho_2 and rho_3 (order 1, 2, 3), without the powers of z before the sums.
   pure real(wp) function positive_sum(z, order) result(total)
      real(wp), intent(in) :: z
      integer, intent(in) :: order
      real(wp) :: power   !! z^(2k-2)/(2k+2)!, z^(2k-4)/(2k+4)!, or z^(2k-6)/(2k+6)!
      integer :: k

      total = 0
      if (order == 1) then
         power = 1/24.0_wp
         do k = 1, nterm
            total = total + 2*k*power
            power = power*z**2/((2.0_wp*k + 3)*(2*k + 4))
         end do
      else if (order == 2) then
         power = 1/40320.0_wp
         do k = 2, nterm
            total = total + 4.0_wp*k*(k - 1)*(2*k + 3)*power
            power = power*z**2/((2.0_wp*k + 5)*(2*k + 6))
         end do
      else
         power = 1/479001600.0_wp
         do k = 3, nterm
            total = total + 8.0_wp*k*(k - 1)*(k - 2)*(2*k + 3)*(2*k + 5)*power
            power = power*z**2/((2.0_wp*k + 7)*(2*k + 8))
         end do
      end if
   end function positive_sum

end module symsde_noise_decay_law
