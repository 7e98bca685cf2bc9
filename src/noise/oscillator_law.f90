! SPDX-License-Identifier: BSD-3-Clause
!> The exact law of what one step of an oscillator of unit frequency takes from its Brownian motion:
!>
!>    dW = W(h),   C = int_0^h cos(h-s) dW(s),   S = int_0^h sin(h-s) dW(s)
!>
!> jointly Gaussian with Var C = h/2 + sin(2h)/4, Var S = h/2 - sin(2h)/4, Cov(C,S) = sin(h)^2/2,
!> Cov(dW,C) = sin h, Cov(dW,S) = 1 - cos h (the u_k after [WHSB] (92)). Given dW, with two
!> independent normals of its own,
!>
!>    S = dW (1 - cos h)/h + sqrt(vs) xi_1
!>    C = dW sin(h)/h + (cs/sqrt(vs)) xi_1 + sqrt(vp) xi_2
!>
!>    vs = Var(S|dW)  = h^3/12 - ..    cs = Cov(C,S|dW) = -h^4/24 + ..
!>    vp = Var(C|dW,S) = (h - sin h) g(h)/vs = h^5/720 - ..,   g = (h + sin h)/4 - (1 - cos h)/h
!>
!> As differences of closed forms these lose all digits at small h (vp below h = 5e-4), so
!> they are summed as power series up to |h| = 2. Relative error of the coefficients, measured
!> against real128: 6e-16 up to there, 4e-15 beyond. A step h < 0 leaves C and turns S around.
module symsde_noise_oscillator_law
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_noise_normal, only: normal_pairs
   implicit none
   private
   public :: oscillator_coefficients, oscillator_law, oscillator_integrals, oscillator_draws

   integer(i4), parameter :: purpose_oscillator = 2  !! counter word of these draws
   real(wp), parameter :: series_bound = 2           !! largest |h| for which series are summed
   integer, parameter :: nterm = 24                  !! terms: 16**24/48! < 1e-32

   !> C and S as linear forms of dW, xi_1 and xi_2.
   type :: oscillator_coefficients
      real(wp) :: s_w = 0    !! of dW in S
      real(wp) :: s_1 = 0    !! of xi_1 in S
      real(wp) :: c_w = 0    !! of dW in C
      real(wp) :: c_1 = 0    !! of xi_1 in C
      real(wp) :: c_2 = 0    !! of xi_2 in C
   end type oscillator_coefficients

contains

   !> The coefficients for steps of length h; all zero but c_w = 1 for h = 0.
   pure function oscillator_law(h) result(law)
      real(wp), intent(in) :: h   !! step, either sign [radians]
      type(oscillator_coefficients) :: law
      real(wp) :: x, vs, cs, vp

      law%c_w = 1
      x = abs(h)
      if (.not. x > 0) return
      law%c_w = sin(x)/x
      law%s_w = 2*sin(0.5_wp*x)**2/h
      if (x <= series_bound) then
         call conditional_series(x, vs, cs, vp)
      else
         call conditional_closed(x, vs, cs, vp)
      end if
      law%s_1 = sign(x*sqrt(x*vs), h)
      law%c_1 = x*x*sqrt(x/vs)*cs
      law%c_2 = x*x*sqrt(x*vp)
   end function oscillator_law

   !> C and S of one step for each path of a block, from dW and two normals that belong to it.
   pure subroutine oscillator_integrals(nlane, h, dw, xi1, xi2, c, s)
      integer(i4), intent(in) :: nlane
      real(wp), intent(in) :: h                       !! step, either sign [radians]
      real(wp), intent(in) :: dw(nlane)               !! increment, variance |h|
      real(wp), intent(in) :: xi1(nlane), xi2(nlane)  !! N(0,1), independent of dw and of each other
      real(wp), intent(out) :: c(nlane)               !! int cos(h-s) dW(s)
      real(wp), intent(out) :: s(nlane)               !! int sin(h-s) dW(s)
      type(oscillator_coefficients) :: law
      integer(i4) :: lane

      law = oscillator_law(h)
      do lane = 1, nlane
         c(lane) = law%c_w*dw(lane) + law%c_1*xi1(lane) + law%c_2*xi2(lane)
         s(lane) = law%s_w*dw(lane) + law%s_1*xi1(lane)
      end do
   end subroutine oscillator_integrals

   !> The two normals of (path, step, noise): a pure function of these and the seed, independent of
   !> all increments by a purpose word of their own.
   subroutine oscillator_draws(nlane, seed, path, step, noise, xi1, xi2)
      integer(i4), intent(in) :: nlane
      integer(i8), intent(in) :: seed
      integer(i8), intent(in) :: path(nlane)            !! global path
      integer(i8), intent(in) :: step                   !! absolute step
      integer(i4), intent(in) :: noise                  !! k, from 1
      real(wp), intent(out) :: xi1(nlane), xi2(nlane)   !! N(0,1)

      call normal_pairs(nlane, seed, path, step, noise, 0_i4, purpose_oscillator, xi1, xi2)
   end subroutine oscillator_draws

   !> Power series by Horner's rule, as multiples of their leading powers (no underflow):
   !>    vs = sum_{k>=1} (-1)^{k+1} (4^k (k-1) + 2)/(2k+2)! h^{2k+1}
   !>    cs = sum_{k>=2} (-1)^{k+1} (4^{k-1} (2k-3) + 1)/(2k+1)! h^{2k}
   !>    h - sin h = sum_{k>=1} (-1)^{k+1} h^{2k+1}/(2k+1)!
   !>    g  = sum_{k>=2} (-1)^k (k-1)/(2 (2k+2)!) h^{2k+1}
   pure subroutine conditional_series(h, vs, cs, vp)
      real(wp), intent(in) :: h                !! 0 < h <= 2
      real(wp), intent(out) :: vs, cs, vp      !! over h^3, h^4, h^5
      real(wp) :: inverse(2*nterm + 2), z, sign_k, four, rest, g
      integer :: k

      inverse(1) = 1   ! 1/j!
      do k = 2, size(inverse)
         inverse(k) = inverse(k - 1)/k
      end do
      z = h*h
      vs = 0
      cs = 0
      rest = 0
      g = 0
      do k = nterm, 1, -1
         sign_k = 1 - 2*mod(k, 2)
         four = 4.0_wp**k
         vs = z*vs - sign_k*(four*(k - 1) + 2)*inverse(2*k + 2)
         rest = z*rest - sign_k*inverse(2*k + 1)
         if (k == 1) exit
         cs = z*cs - sign_k*(0.25_wp*four*(2*k - 3) + 1)*inverse(2*k + 1)
         g = z*g + sign_k*0.5_wp*(k - 1)*inverse(2*k + 2)
      end do
      vp = rest*g/vs
   end subroutine conditional_series

   !> The closed forms, for h where they lose few digits; over h^3, h^4, h^5 as the series.
   pure subroutine conditional_closed(h, vs, cs, vp)
      real(wp), intent(in) :: h
      real(wp), intent(out) :: vs, cs, vp
      real(wp) :: sine, versine

      sine = sin(h)
      versine = 2*sin(0.5_wp*h)**2
      vs = (0.5_wp*h - 0.25_wp*sin(2*h) - versine**2/h)/h**3
      cs = (0.5_wp*sine**2 - sine*versine/h)/h**4
      vp = (h - sine)*(0.25_wp*(h + sine) - versine/h)/h**8/vs
   end subroutine conditional_closed

end module symsde_noise_oscillator_law
