! SPDX-License-Identifier: BSD-3-Clause
!> The noise that a linear drift receives over one step, whose length is the unit of time here:
!>
!>    dx = A x du + sum_k b_k dW_k,      xi = sum_k int_0^1 exp(u A) b_k dW_k(u),   u = time until the end of the step
!>
!> Its covariance C = sum_k int exp(uA) b_k b_k^T exp(uA)^T du is a Taylor sum for a time 2^-n and n doublings,
!>
!>    C(2t) = C(t) + exp(tA) C(t) exp(tA)^T
!>
!> which adds positive matrices and so loses no digits, neither for weak nor for strong damping (Van Loan's block
!> exponential has the same sum in its corner, but beside growing blocks). Nor do doublings of X = exp(tA) - 1,
!> X <- 2 X + X X, in any units: a light mass makes A large and t short, where the decay of momenta in exp(tA) itself
!> would be below rounding. Likewise int exp(uA) b_k u^r du, r = 0, 1, 2, which give the means of xi given dW,
!> a = dZ/h - dW/2 and K, since these are the first three polynomials of Legendre:
!>
!>    xi = sum_k B_k (dW_k, sqrt 12 a_k, sqrt 720 K_k) + rest
!>
!> A step that knows only these functionals gives xi its exact law by other matrices L_k,  sum_k L_k L_k^T = C. With a
!> factor C = F F^T and Y = F^-1 B, the law is L = F (Y Y^T)^(-1/2) Y: in the norm of C^-1 no other is nearer to B, and
!> what is known of xi by the functionals stays as it is, as E + gamma D = dW of free motion does. With one rate this is
!> law2 of noise/decay_law. (Y Y^T)^(-1/2) Y is found by the iteration of Newton and Schulz, Y <- (3 - Y Y^T) Y/2.
module symsde_noise_linear_law
   use symsde_base_kinds, only: wp
   use symsde_base_matrices, only: multiply, halvings
   implicit none
   private
   public :: integrate_noise, give_linear_law, factorise, remainder_of_noise

   integer, parameter :: nterm = 20                         !! terms of Taylor sums, for matrices of norm 1/4 at most
   integer, parameter :: most = 150                         !! iterations from a smallest singular value of 1e-16
   real(wp), parameter :: negligible = 100*epsilon(1.0_wp)  !! pivots of correlations that count as zero
   real(wp), parameter, public :: inverse_deviation(3) = [1.0_wp, sqrt(12.0_wp), sqrt(720.0_wp)]  !! of dW, a, K

contains

   !> exp(A), C, and the coefficients of dW_k, a_k and K_k in the means of xi.
   pure subroutine integrate_noise(n, m, a, b, flow, c, means)
      integer, intent(in) :: n, m                   !! components of x, and noises
      real(wp), intent(in) :: a(n, n), b(n, m)
      real(wp), intent(out) :: flow(n, n), c(n, n)
      real(wp), intent(out) :: means(n, m, 3)
      real(wp) :: v(n, m, 0:2), moved(n, m, 0:2), term(n, n), other(n, n), vector(n, m), t
      integer :: i, j, r, ndouble

      ndouble = halvings(n, a, 1.0_wp)
      t = scale(1.0_wp, -ndouble)
      ! exp(tA) = sum_j (tA)^j/j!,   int_0^t exp(uA) b u^r du = sum_j t^(r+1) (tA)^j b/(j! (j + r + 1))
      term = 0
      do i = 1, n
         term(i, i) = 1
      end do
      flow = 0  ! exp(tA) - 1 until the end
      v = 0
      do j = 0, nterm
         if (j > 0) flow = flow + term
         call multiply(n, m, term, b, vector)
         do r = 0, 2
            v(:, :, r) = v(:, :, r) + (t**(r + 1)/(j + r + 1))*vector
         end do
         call multiply(n, n, a, term, other)
         term = (t/(j + 1))*other
      end do
      ! C = sum_j t^(j+1)/(j+1)! T^j (b b^T) with T X = A X + X A^T
      call multiply_transposed(n, m, b, term)
      term = t*term
      c = 0
      do j = 0, nterm
         c = c + term
         call multiply(n, n, a, term, other)
         do i = 1, n
            term(:, i) = (t/(j + 2))*(other(:, i) + other(i, :))
         end do
      end do
      do i = 1, ndouble
         do r = 0, 2
            call multiply(n, m, flow, v(:, :, r), moved(:, :, r))
         end do
         moved = v + moved
         ! int_t^2t exp(uA) u^r du = exp(tA) int_0^t exp(uA) (u + t)^r du
         v(:, :, 2) = v(:, :, 2) + moved(:, :, 2) + (2*t)*moved(:, :, 1) + t**2*moved(:, :, 0)
         v(:, :, 1) = v(:, :, 1) + moved(:, :, 1) + t*moved(:, :, 0)
         v(:, :, 0) = v(:, :, 0) + moved(:, :, 0)
         call multiply(n, n, flow, c, term)
         do j = 1, n
            other(:, j) = c(:, j) + term(j, :)
         end do
         call multiply(n, n, flow, other, term)
         c = c + (other + term)
         call multiply(n, n, flow, flow, other)
         flow = 2*flow + other
         t = 2*t
      end do
      do i = 1, n
         flow(i, i) = 1 + flow(i, i)
      end do
      !   dW = int dW,  a = int (u - 1/2) dW,  K = int (u^2 - u + 1/6)/2 dW, of variance 1, 1/12 and 1/720
      means(:, :, 1) = v(:, :, 0)
      means(:, :, 2) = 12*(v(:, :, 1) - 0.5_wp*v(:, :, 0))
      means(:, :, 3) = 360*(v(:, :, 2) - v(:, :, 1) + v(:, :, 0)/6)
   end subroutine integrate_noise

   !> Coefficients of dW_k, a_k and, if known, K_k whose sum has the covariance c. Where c has more dimensions than the
   !> functionals, or where they say nothing of one, exact is false.
   pure subroutine give_linear_law(n, m, known, c, means, law, exact)
      integer, intent(in) :: n, m
      integer, intent(in) :: known                  !! 2 for dW and a, 3 for K, too
      real(wp), intent(in) :: c(n, n), means(n, m, 3)
      real(wp), intent(out) :: law(n, m, 3)
      logical, intent(out) :: exact
      real(wp), allocatable :: y(:, :)
      real(wp) :: f(n, n)
      integer :: pivot(n), rank, i, j, k, r

      law = 0
      call factorise(n, c, f, pivot, rank)
      exact = rank <= known*independent_noises(n, m, means)
      if (.not. exact) return
      ! Y by substitution in the rows of the pivots, where F is triangular.
      allocate (y(rank, m*known))
      do i = 1, rank
         do r = 1, known
            do k = 1, m
               y(i, k + (r - 1)*m) = means(pivot(i), k, r)/inverse_deviation(r)
            end do
         end do
         do k = 1, m*known
            do j = 1, i - 1
               y(i, k) = y(i, k) - f(pivot(i), j)*y(j, k)
            end do
            y(i, k) = y(i, k)/f(pivot(i), i)
         end do
      end do
      call make_orthonormal(rank, m*known, y, exact)
      if (.not. exact) return
      do r = 1, known
         do k = 1, m
            do i = 1, rank
               law(:, k, r) = law(:, k, r) + (inverse_deviation(r)*y(i, k + (r - 1)*m))*f(:, i)
            end do
         end do
      end do
   end subroutine give_linear_law

   !> How many noises push in different ways: the rank of the means as columns of noises. Beyond it some combination of
   !> noises pushes nothing, and rounding alone would tie its normals to what the law lacks.
   pure integer function independent_noises(n, m, means) result(rank)
      integer, intent(in) :: n, m
      real(wp), intent(in) :: means(n, m, 3)
      real(wp) :: gram(m, m), f(m, m)
      integer :: pivot(m), j, k

      do k = 1, m
         do j = 1, m
            gram(j, k) = sum(means(:, j, :)*means(:, k, :))
         end do
      end do
      call factorise(m, gram, f, pivot, rank)
   end function independent_noises

   !> Y <- (Y Y^T)^(-1/2) Y, whose rows are orthonormal. done is false where some combination of rows vanishes.
   pure subroutine make_orthonormal(n, m, y, done)
      integer, intent(in) :: n, m
      real(wp), intent(inout) :: y(n, m)
      logical, intent(out) :: done
      real(wp) :: error(n, n), change(n, m)
      integer :: i, j

      do i = 1, most
         call multiply_transposed(n, m, y, error)
         do j = 1, n
            error(j, j) = error(j, j) - 1
         end do
         done = all(abs(error) < 1e-8_wp)
         call multiply(n, m, error, y, change)
         y = y - 0.5_wp*change
         if (done) return  ! the last iteration has squared the error
      end do
   end subroutine make_orthonormal

   !> C = F F^T with exchanges; the row pivot(i) of F has i numbers. The rank counts pivots of the correlations.
   pure subroutine factorise(n, c, f, pivot, rank)
      integer, intent(in) :: n
      real(wp), intent(in) :: c(n, n)
      real(wp), intent(out) :: f(n, n)              !! columns beyond the rank are zero
      integer, intent(out) :: pivot(n), rank
      real(wp) :: deviation(n), left(n)
      logical :: done(n)
      integer :: i, j, at

      f = 0
      pivot = 0
      done = .false.
      do i = 1, n
         deviation(i) = sqrt(max(c(i, i), 0.0_wp))
         left(i) = merge(1.0_wp, 0.0_wp, deviation(i) > 0)
      end do
      do rank = 1, n
         at = maxloc(left, dim=1)
         if (.not. left(at) > negligible) exit
         pivot(rank) = at
         f(at, rank) = sqrt(left(at))
         done(at) = .true.
         left(at) = 0
         do i = 1, n
            if (done(i) .or. .not. deviation(i) > 0) cycle
            f(i, rank) = c(i, at)/deviation(i)/deviation(at)
            do j = 1, rank - 1
               f(i, rank) = f(i, rank) - f(i, j)*f(at, j)
            end do
            f(i, rank) = f(i, rank)/f(at, rank)
            left(i) = left(i) - f(i, rank)**2
         end do
      end do
      rank = rank - 1
      do i = 1, n
         f(i, :) = deviation(i)*f(i, :)
      end do
   end subroutine factorise

   !> z = x x^T, exactly symmetric.
   pure subroutine multiply_transposed(n, m, x, z)
      integer, intent(in) :: n, m
      real(wp), intent(in) :: x(n, m)
      real(wp), intent(out) :: z(n, n)
      integer :: i, j

      do j = 1, n
         do i = 1, j
            z(i, j) = dot_product(x(i, :), x(j, :))
            z(j, i) = z(i, j)
         end do
      end do
   end subroutine multiply_transposed

   !> The covariance of the rest of xi, given dW_k, a_k and K_k of all noises. With a small A it is the sum over further
   !> polynomials of Legendre, since the difference of C and B B^T would have lost its digits,
   !>
   !>    sum_{l>=3} (2l + 1) sum_k c_lk c_lk^T,   c_lk = sum_{j>=l} A^j b_k j!/((j - l)! (j + l + 1)!)
   pure subroutine remainder_of_noise(n, m, a, b, c, means, rest)
      integer, intent(in) :: n, m
      real(wp), intent(in) :: a(n, n), b(n, m), c(n, n), means(n, m, 3)
      real(wp), intent(out) :: rest(n, n)
      integer, parameter :: degree = 16, last = 48   ! of polynomials, and of powers
      real(wp), parameter :: small = 4               ! largest norm of A for the sum
      real(wp) :: power(n, m), moved(n, m), of(n, m, 3:degree), part(n, n), ratio
      integer :: i, j, l

      if (norm(n, a) > small) then
         rest = c
         do i = 1, 3
            power = means(:, :, i)/inverse_deviation(i)
            call multiply_transposed(n, m, power, part)
            rest = rest - part
         end do
         return
      end if
      of = 0
      power = b
      do j = 1, last
         ! A^j b/j!
         call multiply(n, m, a, power, moved)
         power = moved/j
         do l = 3, min(j, degree)
            ! (j!)^2/((j - l)! (j + l + 1)!) = 1/(j + 1) product over i = 1 .. l of (j - l + i)/(j + 1 + i)
            ratio = 1.0_wp/(j + 1)
            do i = 1, l
               ratio = ratio*(j - l + i)/(j + 1 + i)
            end do
            of(:, :, l) = of(:, :, l) + ratio*power
         end do
      end do
      rest = 0
      do l = degree, 3, -1
         call multiply_transposed(n, m, of(:, :, l), part)
         rest = rest + (2*l + 1)*part
      end do
   end subroutine remainder_of_noise

   !> The largest sum of a row.
   pure real(wp) function norm(n, a)
      integer, intent(in) :: n
      real(wp), intent(in) :: a(n, n)
      integer :: i

      norm = 0
      do i = 1, n
         norm = max(norm, sum(abs(a(i, :))))
      end do
   end function norm

end module symsde_noise_linear_law
