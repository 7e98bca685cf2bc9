! SPDX-License-Identifier: BSD-3-Clause
!> Linear systems A x = b of a block, one per lane, from products with A alone: GMRES.
!>
!> The caller multiplies, since only the caller has the matrices:
!>
!>    call krylov%start(b, last)          norm = |b|; lanes with last >= 0 are to be solved
!>    call krylov%seek(goal)              until |b - A x| <= goal
!>    do while (krylov%running)
!>       ... krylov%v(:, :, krylov%k + 1) = A krylov%v(:, :, krylov%k) ...
!>       call krylov%advance()
!>    end do
!>    ... krylov%x, and krylov%unsolved if the goal was not reached ...
!>
!> A may be any nonsingular matrix: it is symmetric if momenta are eliminated, otherwise not. Arnoldi's vectors v_i
!> span b, A b, A^2 b, ..: with V_k = (v_1, .., v_k) they obey A V_k = V_{k+1} H_k, H_k of k+1 rows with zeros below
!> the first subdiagonal, and x = V_k y with the y that makes |b - A x| = | |b| e_1 - H_k y | least. Givens rotations
!> make H_k triangular as it grows; applied to |b| e_1 they give g, whose last entry is the size of the residual, known
!> before x is computed. Vectors by modified Gram-Schmidt, no restart: Saad & Schultz, SIAM J. Sci. Stat. Comput. 7
!> (1986) 856.
!>
!> Sizes are Euclidean. All lanes multiply as long as one lane runs, but the solution of a lane uses only vectors up to
!> the one that reached its goal, whatever its neighbours need.
module symsde_solve_krylov
   use symsde_base_kinds, only: wp
   use symsde_base_vectors, only: add_times_each
   implicit none
   private
   public :: krylov_type, new_krylov, most_vectors

   integer, parameter :: most_vectors = 60  !! largest number of products A v in a solve

   !> The systems of a block, their vectors and rotations. A is not stored, as the caller multiplies. x and norm may be
   !> read when `running` is false.
   type :: krylov_type
      integer :: nlane = 0, n = 0          !! lanes, unknowns of a lane
      integer :: k = 0                     !! vector to multiply next
      integer :: nrunning = 0              !! lanes that have not reached their goal
      logical :: running = .false.
      real(wp), allocatable :: v(:, :, :)  !! Arnoldi's vectors (nlane, n, most+1)
      real(wp), allocatable :: x(:, :)     !! solutions; zero in lanes that were not to be solved (nlane, n)
      real(wp), allocatable :: norm(:)     !! |b - A x| (nlane)
      real(wp), allocatable :: largest(:)  !! the largest |A v| of all vectors of size one so far (nlane)
      logical, allocatable :: unsolved(:)  !! lanes to be solved whose goal is not reached (nlane)
      integer, private :: most = 0
      real(wp), allocatable, private :: goal(:)     !! (nlane)
      integer, allocatable, private :: length(:)    !! vectors in a lane's solution; -1: no solution (nlane)
      real(wp), allocatable, private :: h(:, :, :)  !! Hessenberg matrix, then its triangle (nlane, most+1, most)
      real(wp), allocatable, private :: c(:, :), s(:, :)  !! Givens rotations (nlane, most)
      real(wp), allocatable, private :: g(:, :)     !! right-hand side of the triangle (nlane, most+1)
   contains
      procedure :: start
      procedure :: seek
      procedure :: advance
   end type krylov_type

contains

   !> Allocate n unknowns a lane and as many vectors as a solve may use: at most n, since n vectors span all.
   subroutine new_krylov(self, nlane, n)
      type(krylov_type), intent(out) :: self
      integer, intent(in) :: nlane  !! lanes of the block, a multiple of 8
      integer, intent(in) :: n      !! unknowns of a system

      self%nlane = nlane
      self%n = n
      self%most = min(n, most_vectors)
      associate (m => self%most)
         allocate (self%v(nlane, n, m + 1), self%x(nlane, n))
         allocate (self%norm(nlane), self%largest(nlane), self%goal(nlane))
         allocate (self%unsolved(nlane), self%length(nlane))
         allocate (self%h(nlane, m + 1, m), self%c(nlane, m), self%s(nlane, m), self%g(nlane, m + 1))
      end associate
   end subroutine new_krylov

   !> Take right-hand sides, return their sizes in norm, and form v_1 = b/|b|.
   subroutine start(self, b, last)
      class(krylov_type), intent(inout) :: self
      real(wp), intent(in) :: b(self%nlane, self%n)
      real(wp), intent(in) :: last(self%nlane)  !! negative: the lane is not to be solved

      self%v(:, :, 1) = b
      ! b is divided by its largest entry first, then by its size.
      call largest_of(self%nlane, self%n, b, self%largest)  ! squares of unscaled entries may overflow
      call scale_by(self%nlane, self%n, self%largest, self%v(:, :, 1))
      ! |b| = largest |b/largest|; 0*largest makes it NaN where a component is not finite.
      call product_of(self%nlane, self%n, self%v(:, :, 1), self%v(:, :, 1), self%norm)
      self%norm = sqrt(self%norm)
      call scale_by(self%nlane, self%n, self%norm, self%v(:, :, 1))
      self%norm = self%largest*self%norm + 0*self%largest
      self%unsolved = last >= 0
   end subroutine start

   !> Begin with x = 0 and the residual b. A lane whose b is not above the goal is solved by x = 0; a lane whose b
   !> is not finite stays unsolved. `seek` is separate from `start`, since a goal may depend on the size of b.
   subroutine seek(self, goal)
      class(krylov_type), intent(inout) :: self
      real(wp), intent(in) :: goal(self%nlane)  !! sizes of the residual to reach
      logical :: ready(self%nlane)

      self%goal = goal
      self%unsolved = self%unsolved .and. .not. (self%norm <= goal .and. self%norm <= huge(1.0_wp))
      ready = self%unsolved .and. self%norm <= huge(1.0_wp)
      ! A lane with length = k - 1 may use vector k; a lane with length -1 uses none.
      self%length = merge(0, -1, ready)
      ! The right-hand side of the least squares problem is |b| e_1. In lanes that are not to be solved it is zero, and
      ! stays zero.
      self%g(:, 1) = merge(self%norm, 0.0_wp, ready)
      self%x = 0
      self%largest = 0
      self%k = 1
      self%nrunning = count(ready)
      self%running = self%nrunning > 0
   end subroutine seek

   !> Take the product A v_k, form v_{k+1} and column k of H, and continue with the next vector, or end with the
   !> solutions.
   subroutine advance(self)
      class(krylov_type), intent(inout) :: self

      ! v_{k+1} and column k of H; then H made triangular; then the lanes whose residual is small enough.
      call orthogonalise(self, self%k)
      call rotate(self%nlane, self%most, self%k, self%unsolved, self%length, self%h, self%c, self%s, self%g, &
                  self%largest)
      call judge_lanes(self%nlane, self%k, self%h(:, self%k, self%k), self%g(:, self%k + 1), self%goal, &
                       self%norm, self%length, self%unsolved, self%nrunning)
      ! Without a running lane, or without room for another vector, sum up the solutions from the vectors so far.
      self%running = self%nrunning > 0 .and. self%k < self%most
      if (self%running) then
         self%k = self%k + 1
      else
         call add_up(self)
      end if
   end subroutine advance

   !> Column k of H, h_ik = v_i.(A v_k), and v_{k+1} = (A v_k - sum_i h_ik v_i)/h_{k+1,k}. Each pass subtracts one
   !> vector and multiplies by the next, so that the product is read once for both.
   subroutine orthogonalise(self, k)
      type(krylov_type), intent(inout) :: self
      integer, intent(in) :: k
      integer :: i

      associate (nlane => self%nlane, n => self%n, v => self%v, h => self%h)
         ! h_1k first: A v_k times v_1, before any vector is subtracted.
         call product_of(nlane, n, v(:, :, 1), v(:, :, k + 1), h(:, 1, k))
         do i = 1, k - 1
            call remove_and_multiply(nlane, n, h(:, i, k), v(:, :, i), v(:, :, i + 1), v(:, :, k + 1), h(:, i + 1, k))
         end do
         call remove_and_square(nlane, n, h(:, k, k), v(:, :, k), v(:, :, k + 1), h(:, k + 1, k))
         ! The rest is v_{k+1} times its size h_{k+1,k}. If the rest is zero, x is exact and v_{k+1} becomes zero.
         h(:, k + 1, k) = sqrt(h(:, k + 1, k))
         call scale_by(nlane, n, h(:, k + 1, k), v(:, :, k + 1))
      end associate
   end subroutine orthogonalise

   !> x = sum_i y_i v_i over the first `length` vectors of each lane, with y from its triangle H y = g, from the last
   !> row up. y replaces g, and is zero from length + 1 on.
   subroutine add_up(self)
      type(krylov_type), intent(inout) :: self
      real(wp) :: divisor(self%nlane)
      integer :: i, j

      associate (y => self%g, h => self%h, length => self%length)
         do i = maxval(length), 1, -1
            ! Vectors beyond a lane's length serve its neighbours, and do not enter its sum.
            do j = i + 1, maxval(length)
               y(:, i) = y(:, i) - merge(h(:, i, j)*y(:, j), 0.0_wp, j <= length)
            end do
            ! Triangle: y_i = (g_i - sum_{j>i} h_ij y_j)/h_ii. In lanes beyond their length one is added to the
            ! divisor.
            divisor = sign(abs(h(:, i, i)) + merge(0.0_wp, 1.0_wp, i <= length), h(:, i, i))  ! a sum, never zero
            y(:, i) = merge(y(:, i)/divisor, 0.0_wp, i <= length)
            ! y_i is final now; add its part to x.
            call add_times_each(self%nlane, self%n, y(:, i), self%v(:, :, i), self%x)
         end do
      end associate
   end subroutine add_up

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC dot = a.b of every lane, a sum over its n components in their order.
   pure subroutine product_of(nlane, n, a, b, dot)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: a(nlane, n), b(nlane, n)
      real(wp), intent(out) :: dot(nlane)
      integer :: i, lane

      dot = 0
      do i = 1, n
         do lane = 1, nlane
            dot(lane) = dot(lane) + a(lane, i)*b(lane, i)
         end do
      end do
   end subroutine product_of

   !> VEC The largest component of every lane; not finite where any component is not: 0*(..) keeps a NaN.
   pure subroutine largest_of(nlane, n, a, largest)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: a(nlane, n)
      real(wp), intent(out) :: largest(nlane)
      integer :: i, lane

      largest = 0
      do i = 1, n
         do lane = 1, nlane
            largest(lane) = max(largest(lane), abs(a(lane, i))) + 0*(largest(lane) + a(lane, i))
         end do
      end do
   end subroutine largest_of

   !> VEC u = u - c a, and dot = b.u of the result, the next coefficient of modified Gram-Schmidt.
   pure subroutine remove_and_multiply(nlane, n, c, a, b, u, dot)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: c(nlane), a(nlane, n), b(nlane, n)
      real(wp), intent(inout) :: u(nlane, n)
      real(wp), intent(out) :: dot(nlane)
      integer :: i, lane

      dot = 0
      do i = 1, n
         do lane = 1, nlane
            u(lane, i) = u(lane, i) - c(lane)*a(lane, i)
            dot(lane) = dot(lane) + b(lane, i)*u(lane, i)
         end do
      end do
   end subroutine remove_and_multiply

   !> VEC u = u - c a, and dot = u.u of the new u: subtract the last vector, and measure the rest.
   pure subroutine remove_and_square(nlane, n, c, a, u, dot)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: c(nlane), a(nlane, n)
      real(wp), intent(inout) :: u(nlane, n)
      real(wp), intent(out) :: dot(nlane)
      integer :: i, lane

      dot = 0
      do i = 1, n
         do lane = 1, nlane
            u(lane, i) = u(lane, i) - c(lane)*a(lane, i)
            dot(lane) = dot(lane) + u(lane, i)*u(lane, i)
         end do
      end do
   end subroutine remove_and_square

   !> VEC u = u/size, or 0 if the size is zero (or has no inverse) or not finite.
   pure subroutine scale_by(nlane, n, size, u)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: size(nlane)
      real(wp), intent(inout) :: u(nlane, n)
      real(wp) :: factor(nlane)
      integer :: i, lane

      do lane = 1, nlane
         factor(lane) = 1/size(lane)
         factor(lane) = merge(factor(lane), 0.0_wp, size(lane) >= tiny(1.0_wp))
      end do
      do i = 1, n
         do lane = 1, nlane
            u(lane, i) = merge(factor(lane)*u(lane, i), 0.0_wp, factor(lane) > 0)
         end do
      end do
   end subroutine scale_by

   !> Apply the earlier rotations to column k of H; make a rotation that sets its last entry to zero, and apply it
   !> to g. Before that, compare the size of the column, |A v_k|, with the largest size of each running lane.
   pure subroutine rotate(nlane, most, k, unsolved, length, h, c, s, g, largest)
      integer, intent(in) :: nlane, most, k
      logical, intent(in) :: unsolved(nlane)
      integer, intent(in) :: length(nlane)  !! vectors used so far; further ones serve other lanes
      real(wp), intent(inout) :: h(nlane, most + 1, most), c(nlane, most), s(nlane, most)
      real(wp), intent(inout) :: g(nlane, most + 1), largest(nlane)
      real(wp) :: total(nlane), a(nlane), d(nlane), divisor(nlane)
      integer :: i

      ! |A v_k|^2 is the sum of squares of column k, since the v_i are orthonormal.
      total = h(:, k + 1, k)**2
      do i = 1, k
         total = total + h(:, i, k)**2
      end do
      largest = merge(max(largest, sqrt(total)), largest, unsolved .and. length == k - 1)
      ! The earlier rotations, in the order in which they were made.
      do i = 1, k - 1
         a = c(:, i)*h(:, i, k) + s(:, i)*h(:, i + 1, k)
         h(:, i + 1, k) = c(:, i)*h(:, i + 1, k) - s(:, i)*h(:, i, k)
         h(:, i, k) = a
      end do
      ! The rotation (c, s; -s, c) that turns (h_kk, h_{k+1,k}) into (d, 0).
      d = sqrt(h(:, k, k)**2 + h(:, k + 1, k)**2)
      divisor = d + merge(0.0_wp, 1.0_wp, d > 0)  ! a sum: a choice of divisors lets the compiler divide by both
      c(:, k) = merge(h(:, k, k)/divisor, 1.0_wp, d > 0)
      s(:, k) = merge(h(:, k + 1, k)/divisor, 0.0_wp, d > 0)
      h(:, k, k) = d
      ! Apply the rotation that makes column k triangular to the right-hand side; |g_{k+1}| is the size of the
      ! rest.
      g(:, k + 1) = -s(:, k)*g(:, k)
      g(:, k) = c(:, k)*g(:, k)
   end subroutine rotate

   !> Find the lanes that vector k has brought to their goal: |g_{k+1}| is the size of the residual. If the diagonal
   !> entry of column k is zero or not finite, the matrix is singular or not finite: the lane keeps its vectors and uses
   !> no more.
   pure subroutine judge_lanes(nlane, k, diagonal, rest, goal, norm, length, unsolved, nrunning)
      integer, intent(in) :: nlane, k
      real(wp), intent(in) :: diagonal(nlane), rest(nlane), goal(nlane)
      real(wp), intent(inout) :: norm(nlane)
      integer, intent(inout) :: length(nlane)
      logical, intent(inout) :: unsolved(nlane)
      integer, intent(out) :: nrunning
      logical :: takes
      integer :: lane

      nrunning = 0
      do lane = 1, nlane
         ! Vectors are used in order: a lane that has skipped a vector uses no more.
         takes = unsolved(lane) .and. length(lane) == k - 1 .and. diagonal(lane) > 0
         takes = takes .and. abs(rest(lane)) <= huge(1.0_wp)
         ! With vector k a lane has the residual |g_{k+1}|, and is solved if the residual reaches the goal.
         length(lane) = merge(k, length(lane), takes)
         norm(lane) = merge(abs(rest(lane)), norm(lane), takes)
         unsolved(lane) = unsolved(lane) .and. .not. (takes .and. norm(lane) <= goal(lane))
         nrunning = nrunning + merge(1, 0, takes .and. unsolved(lane))
      end do
   end subroutine judge_lanes

end module symsde_solve_krylov
