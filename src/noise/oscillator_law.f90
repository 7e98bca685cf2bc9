! SPDX-License-Identifier: BSD-3-Clause
!> The exact law of the stochastic integrals in one step of an oscillator of unit frequency:
!>
!>    dW = W(h),   C = int_0^h cos(h-s) dW(s),   S = int_0^h sin(h-s) dW(s)
!>
!> jointly Gaussian with Var C = h/2 + sin(2h)/4, Var S = h/2 - sin(2h)/4, Cov(C,S) = sin(h)^2/2,
!> Cov(dW,C) = sin h, Cov(dW,S) = 1 - cos h (the u_k after [WHSB] (92)), given the increment dW,
!> H = dZ/h - dW/2 and K, the space-time-time area (base/functionals), since schemes may use any of these from the same
!> path.
!>
!> exp(iu) on [0,h] is a sum of Legendre polynomials with spherical Bessel functions j_n for coefficients
!> (Rayleigh's expansion), and the integrals of the polynomials are independent: dW the first, 2 H the second, 12 K
!> the third. So
!>
!>    C + i S = exp(i a) (R + i I),   a = h/2
!>    R = j_0(a) dW - 60 j_2(a) K + sqrt(h sum_{n=4,6,..} (2n+1) j_n(a)^2) xi_1
!>    I = 6 j_1(a) H + sqrt(h sum_{n=3,5,..} (2n+1) j_n(a)^2) xi_2
!>
!> with two further independent normals. The sums have positive terms and are used up to |h| = 8; beyond, the closed
!> forms (1 + sin(h)/h)/2 - j_0^2 - 5 j_2^2 and (1 - sin(h)/h)/2 - 3 j_1^2 lose no digits, but for small |h| they would
!> lose all. A step h < 0 keeps C and changes the sign of S.
module symsde_noise_oscillator_law
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_noise_normal, only: normal_pairs
   use symsde_noise_philox, only: purpose_oscillator
   implicit none
   private
   public :: oscillator_coefficients, oscillator_law, oscillator_integrals, oscillator_draws

   real(wp), parameter :: series_bound = 8           !! largest |h| for which series are summed
   integer, parameter :: nterm = 30                  !! terms of a Bessel function: 8^30/(30! 65!!/5!!) < 1e-40
   integer, parameter :: norder = 30                 !! terms of a sum: (4^30/61!!)^2 < 1e-42

   !> R and I as linear forms of dW, H, K, xi_1 and xi_2, and the rotation that takes them to (C, S).
   type :: oscillator_coefficients
      real(wp) :: cosine = 1  !! cosine of h/2
      real(wp) :: sine = 0
      real(wp) :: r_w = 1     !! coefficient of dW in R
      real(wp) :: r_k = 0     !! coefficient of K in R
      real(wp) :: r_1 = 0     !! coefficient of xi_1 in R
      real(wp) :: i_h = 0     !! coefficient of H in I
      real(wp) :: i_2 = 0     !! coefficient of xi_2 in I
   end type oscillator_coefficients

contains

   !> The coefficients for steps of length |h|; C = dW and S = 0 for h = 0.
   pure function oscillator_law(h) result(law)
      real(wp), intent(in) :: h   !! step, either sign [radians]
      type(oscillator_coefficients) :: law
      real(wp) :: a

      a = 0.5_wp*abs(h)
      if (.not. a > 0) return
      law%cosine = cos(a)
      law%sine = sin(a)
      law%r_w = law%sine/a
      if (2*a <= series_bound) then
         law%i_h = 6*a*bessel(1, a)
         law%r_k = -60*a**2*bessel(2, a)
         law%r_1 = sqrt(2*a)*a**4*sqrt(tail(4, a))
         law%i_2 = sqrt(2*a)*a**3*sqrt(tail(3, a))
      else
         law%i_h = 6*(law%r_w - law%cosine)/a
         law%r_k = -60*(3*(law%r_w - law%cosine)/a**2 - law%r_w)
         law%r_1 = sqrt(2*a*(0.5_wp*(1 + law%r_w*law%cosine) - law%r_w**2 - law%r_k**2/720))
         law%i_2 = sqrt(2*a*(0.5_wp*(1 - law%r_w*law%cosine) - law%i_h**2/12))
      end if
   end function oscillator_law

   !> sum over n = first, first + 2, .. of (2n+1) j_n(a)^2, over a^(2 first), so that it does not underflow.
   pure real(wp) function tail(first, a)
      integer, intent(in) :: first
      real(wp), intent(in) :: a    !! 0 < a <= 4
      integer :: n

      tail = 0
      do n = norder + first, first, -2
         tail = a**4*tail + (2*n + 1)*bessel(n, a)**2
      end do
   end function tail

   !> j_n(a)/a^n = sum_k (-a^2/2)^k/(k! (2n+2k+1)!!) by Horner's rule.
   pure real(wp) function bessel(n, a)
      integer, intent(in) :: n
      real(wp), intent(in) :: a    !! 0 < a <= 4
      integer :: k

      bessel = 1
      do k = nterm, 1, -1
         bessel = 1 - 0.5_wp*a**2/(k*(2*n + 2*k + 1.0_wp))*bessel
      end do
      do k = 1, n
         bessel = bessel/(2*k + 1)
      end do
   end function bessel

   !> C and S of one step for each path of a block, from dW, H, K and two normals of the path.
   pure subroutine oscillator_integrals(nlane, h, dw, shape, stt_area, xi1, xi2, c, s)
      integer(i4), intent(in) :: nlane
      real(wp), intent(in) :: h                       !! step, either sign [radians]
      real(wp), intent(in) :: dw(nlane)               !! increment, variance |h|
      real(wp), intent(in) :: shape(nlane)            !! H = dZ/h - dW/2, variance |h|/12, independent of dW
      real(wp), intent(in) :: stt_area(nlane)         !! K, variance |h|/720, independent of both
      real(wp), intent(in) :: xi1(nlane), xi2(nlane)  !! N(0,1), independent of all others
      real(wp), intent(out) :: c(nlane)               !! int cos(h-s) dW(s)
      real(wp), intent(out) :: s(nlane)               !! int sin(h-s) dW(s)
      type(oscillator_coefficients) :: law
      real(wp) :: r, i
      integer(i4) :: lane

      law = oscillator_law(h)
      do lane = 1, nlane
         r = law%r_w*dw(lane) + law%r_k*stt_area(lane) + law%r_1*xi1(lane)
         i = law%i_h*shape(lane) + law%i_2*xi2(lane)
         c(lane) = law%cosine*r - law%sine*i
         s(lane) = sign(1.0_wp, h)*(law%sine*r + law%cosine*i)
      end do
   end subroutine oscillator_integrals

   !> The two normals of (path, step, noise): a pure function of these numbers and the seed, independent of all
   !> increments by their own purpose word.
   subroutine oscillator_draws(nlane, seed, path, step, noise, xi1, xi2)
      integer(i4), intent(in) :: nlane
      integer(i8), intent(in) :: seed
      integer(i8), intent(in) :: path(nlane)            !! global path
      integer(i8), intent(in) :: step                   !! absolute step
      integer(i4), intent(in) :: noise                  !! k, from 1
      real(wp), intent(out) :: xi1(nlane), xi2(nlane)   !! N(0,1)

      call normal_pairs(nlane, seed, path, step, noise, 0_i4, purpose_oscillator, xi1, xi2)
   end subroutine oscillator_draws

end module symsde_noise_oscillator_law
