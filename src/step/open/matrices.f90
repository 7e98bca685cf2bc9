! SPDX-License-Identifier: BSD-3-Clause
!> Products of small matrices in flows of coupled momenta. Products are sums of columns, one after the other, so that a
!> lane has the same bits in a block as alone.
module symsde_step_open_matrices
   use symsde_base_kinds, only: wp
   use symsde_base_vectors, only: add_times
   implicit none
   private
   public :: multiply, add_product, halvings

contains

   !> z = x y, (n, n) each.
   pure subroutine multiply(n, x, y, z)
      integer, intent(in) :: n
      real(wp), intent(in) :: x(n, n), y(n, n)
      real(wp), intent(out) :: z(n, n)
      integer :: j, k

      z = 0
      do j = 1, n
         do k = 1, n
            call add_times(n, y(k, j), x(:, k), z(:, j))
         end do
      end do
   end subroutine multiply

   !> y_i = y_i + sum_j a_ij x_j in every lane.
   pure subroutine add_product(nlane, n, a, x, y)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: a(n, n), x(nlane, n)
      real(wp), intent(inout) :: y(nlane, n)
      integer :: i, j

      do i = 1, n
         do j = 1, n
            call add_times(nlane, a(i, j), x(:, j), y(:, i))
         end do
      end do
   end subroutine add_product

   !> How often tau is halved until the norm of a tau is 1/4 at most, for short Taylor sums; 0 if it is not finite.
   pure integer function halvings(n, a, tau)
      integer, intent(in) :: n
      real(wp), intent(in) :: a(n, n), tau
      real(wp) :: norm
      integer :: i

      norm = 0
      do i = 1, n
         norm = max(norm, abs(tau)*sum(abs(a(i, :))))
      end do
      halvings = 0
      if (norm <= huge(norm)) halvings = max(0, exponent(norm) + 2)
   end function halvings

end module symsde_step_open_matrices
