! SPDX-License-Identifier: BSD-3-Clause
!> Derivatives in the angle q of several functions U = -a cos q + b sin q + c q at once, by one sine and one cosine.
module symsde_model_sine_derivatives
   use symsde_base_kinds, only: wp
   use symsde_base_sincos, only: sincos_lanes, sincos_tile
   implicit none
   private
   public :: sine_derivatives

contains

   !> U', U'', U''' of function j in u(:, :, j).
   subroutine sine_derivatives(nlane, nfunction, a, b, c, q, u)
      integer, intent(in) :: nlane, nfunction
      real(wp), intent(in), dimension(nfunction) :: a, b, c
      real(wp), intent(in) :: q(nlane)
      real(wp), intent(out) :: u(nlane, 3, nfunction)
      real(wp), dimension(sincos_tile) :: sine, cosine
      integer :: first, n, j

      do first = 1, nlane, sincos_tile
         n = min(sincos_tile, nlane - first + 1)
         call sincos_lanes(n, q(first), sine, cosine)
         do j = 1, nfunction
            call one_function(n, a(j), b(j), c(j), sine, cosine, u(first, 1, j), u(first, 2, j), u(first, 3, j))
         end do
      end do
   end subroutine sine_derivatives

   !> VEC
   pure subroutine one_function(nlane, a, b, c, sine, cosine, u1, u2, u3)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: a, b, c, sine(nlane), cosine(nlane)
      real(wp), intent(out), dimension(nlane) :: u1, u2, u3
      real(wp) :: turning
      integer :: lane

      do lane = 1, nlane
         turning = a*sine(lane) + b*cosine(lane)
         u1(lane) = turning + c
         u2(lane) = a*cosine(lane) - b*sine(lane)
         u3(lane) = -turning
      end do
   end subroutine one_function

end module symsde_model_sine_derivatives
