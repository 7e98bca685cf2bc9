! SPDX-License-Identifier: BSD-3-Clause
!> Products and exponentials of small matrices, for linear flows. Products are sums of columns, one after the other, so
!> that a lane has the same bits in a block as alone.
module symsde_base_matrices
   use symsde_base_kinds, only: wp
   use symsde_base_vectors, only: add_times
   implicit none
   private
   public :: multiply, add_product, halvings, exponential_less_one

   integer, parameter :: nterm = 13  !! terms of the Taylor sum, for matrices of norm 1/4 at most

contains

   !> z = x y, with a square x.
   pure subroutine multiply(n, m, x, y, z)
      integer, intent(in) :: n, m
      real(wp), intent(in) :: x(n, n), y(n, m)
      real(wp), intent(out) :: z(n, m)
      integer :: j, k

      z = 0
      do j = 1, m
         do k = 1, n
            if (abs(y(k, j)) <= 0) cycle  ! far from the diagonal of a band; NaN is added
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

   !> exp(tau A) - 1.
   pure subroutine exponential_less_one(n, a, tau, change)
      integer, intent(in) :: n
      real(wp), intent(in) :: a(n, n), tau
      real(wp), intent(out) :: change(n, n)
      real(wp) :: term(n, n), product(n, n), short
      integer :: k, ndouble

      ndouble = halvings(n, a, tau)
      short = scale(tau, -ndouble)
      term = short*a
      change = term
      do k = 2, nterm
         call multiply(n, n, a, term, product)
         term = product*(short/k)
         change = change + term
      end do
      do k = 1, ndouble
         call multiply(n, n, change, change, product)
         change = 2*change + product
      end do
   end subroutine exponential_less_one

end module symsde_base_matrices
