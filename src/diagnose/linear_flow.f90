! SPDX-License-Identifier: BSD-3-Clause
!>    dz = sum_j (A_j z + b_j) o dW_j,  dW_0 = dt,     A_i A_j = A_j A_i,  A_i b_j = A_j b_i
!>    z(t) = exp(t A_0 + sum_k W_k A_k) z_0 + ..,      as exp of the matrices (A_j, b_j; 0, 0) acting on (z, 1)
!>
!> Quadratic Hamiltonians whose flows commute: the solution is the flow of a single quadratic Hamiltonian
!>
!>    S = t H + sum_k W_k(t) H_k,   z(t) = exp(J Hess S) z_0  plus the effect of linear terms of S,
!>
!> whatever the path does between 0 and t. Fields J grad H_j = A_j z + b_j are read from gradients at unit points; they
!> commute if A_i A_j = A_j A_i and A_i b_j = A_j b_i, up to rounding. With b_j as an additional column the solution is
!> one matrix exponential.
!>
!> Momenta may be damped, by rates or by a matrix of friction, which are part of A_0. Where flows do not commute but
!> noise is constant, A_k = 0, the fields serve single steps (diagnose/linear_steps).
!>
!> In the Stratonovich sense d exp(X) = exp(X) dX if all X(t) commute with each other, as sums of commuting F_j do; so
!> exp(t F_0 + sum_k W_k F_k) solves the equation, and no intermediate steps are needed.
module symsde_diagnose_linear_flow
   use symsde_base_kinds, only: wp
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: linear_flow, new_linear_flow, exponential

   integer, parameter :: largest = 64                        !! largest number of degrees of freedom, and of noises
   real(wp), parameter :: rounding = 64*epsilon(1.0_wp)
   real(wp), parameter :: looked_at(6) = [0.0_wp, 0.11_wp, 0.37_wp, 0.5_wp, 0.79_wp, 1.0_wp]  !! fractions of t1 - t0

   type :: linear_flow
      integer :: n = 0                                       !! components of z = (q, p)
      real(wp), allocatable :: field(:, :, :)                !! (A_j, b_j; 0, 0) (n + 1, n + 1, 0:nnoise)
      logical :: commutes = .true.                           !! else noise is constant
   contains
      procedure :: solve
   end type linear_flow

contains

   !> Make the linear flow of a model between two times. reason is '' on success, else why there is none.
   subroutine new_linear_flow(self, model, t0, t1, reason)
      type(linear_flow), intent(out) :: self
      class(model_type), intent(in) :: model
      real(wp), intent(in) :: t0, t1
      character(:), allocatable, intent(out) :: reason
      integer :: j, i, m

      m = model%traits%nnoise
      self%n = 2*model%traits%ndof
      reason = ''
      ! Only models that declare the trait are tried, even if other models are linear.
      if (.not. model%traits%quadratic) then
         reason = 'is not declared quadratic'
      else if (.not. model%damping%is_constant()) then
         reason = 'has rates of damping that are functions'
      else if (allocated(model%damping%friction) .and. .not. model%traits%has_constant_mass()) then
         reason = 'does not declare a constant mass, on whose velocities friction acts'
      else if (max(model%traits%ndof, m) > largest) then
         reason = 'has more than 64 degrees of freedom or noises'
      end if
      if (len(reason) > 0) return
      ! The declaration may be wrong: read the fields, then compare them with the model at other points and times.
      allocate (self%field(self%n + 1, self%n + 1, 0:m), source=0.0_wp)
      do j = 0, m
         call read_field(self, model, t0, j)
      end do
      do j = 0, m
         ! A field that changes between t0 and t1 has no such flow.
         if (.not. holds(self, model, t0, t1, j)) reason = 'changes in time, or is not quadratic'
      end do
      do j = 0, m
         do i = 0, j - 1
            ! The extra row is zero, so that one matrix product tests both conditions.
            self%commutes = self%commutes .and. commute(self%field(:, :, i), self%field(:, :, j))
         end do
      end do
      if (len(reason) == 0 .and. .not. self%commutes .and. any(abs(self%field(:self%n, :self%n, 1:)) > 0)) &
         reason = 'has flows that do not commute, and noise that is not constant'
   end subroutine new_linear_flow

   !> A_j and b_j: halves of differences and sums of the field at opposite unit points.
   subroutine read_field(self, model, t, j)
      type(linear_flow), intent(inout) :: self
      class(model_type), intent(in) :: model
      real(wp), intent(in) :: t
      integer, intent(in) :: j
      real(wp) :: z(self%n), right(self%n), left(self%n)
      integer :: i

      z = 0
      call field_at(self, model, t, j, z, right)
      self%field(:self%n, self%n + 1, j) = right
      do i = 1, self%n
         z(i) = 1
         call field_at(self, model, t, j, z, right)
         z(i) = -1
         call field_at(self, model, t, j, z, left)
         z(i) = 0
         ! The difference of two opposite points cancels b_j and all even terms.
         self%field(:self%n, i, j) = 0.5_wp*(right - left)
      end do
   end subroutine read_field

   !> Whether the model has the linear field that was read, at a point without zeros and at times from t0 to t1.
   logical function holds(self, model, t0, t1, j)
      type(linear_flow), intent(in) :: self
      class(model_type), intent(in) :: model
      real(wp), intent(in) :: t0, t1
      integer, intent(in) :: j
      real(wp) :: z(self%n), found(self%n), known(self%n), allowed
      integer :: i

      do i = 1, self%n
         ! No two components are equal and none is zero, so that terms that are not linear in z show.
         z(i) = 1.3_wp + 0.7_wp*modulo(0.618_wp*i, 1.0_wp)
      end do
      known = matmul(self%field(:self%n, :self%n, j), z)
      known = known + self%field(:self%n, self%n + 1, j)
      ! Allow generously for rounding: nonlinear fields differ by far more.
      allowed = 1.0e-10_wp*(maxval(abs(known)) + maxval(abs(self%field(:, :, j))))
      holds = .true.
      do i = 1, size(looked_at)
         call field_at(self, model, t0 + looked_at(i)*(t1 - t0), j, z, found)
         holds = holds .and. all(abs(found - known) <= allowed)
      end do
   end function holds

   !> (H_j,p, -H_j,q) at one point, of H with its damping.
   subroutine field_at(self, model, t, j, z, field)
      type(linear_flow), intent(in) :: self
      class(model_type), intent(in) :: model
      real(wp), intent(in) :: t, z(self%n)
      integer, intent(in) :: j
      real(wp), intent(out) :: field(self%n)
      real(wp) :: w(1, 0:model%traits%nnoise), q(1, self%n/2), p(1, self%n/2), hq(1, self%n/2), hp(1, self%n/2)
      integer :: d

      d = self%n/2
      w = 0
      w(1, j) = 1
      q(1, :) = z(:d)
      p(1, :) = z(d + 1:)
      call model%gradient(1, d, model%traits%nnoise, t, w, q, p, hq, hp)
      field(:d) = hp(1, :)
      field(d + 1:) = -hq(1, :)
      if (j > 0) return
      if (allocated(model%damping%rate)) field(d + 1:) = field(d + 1:) - model%damping%rate*z(d + 1:)
      if (allocated(model%damping%friction)) field(d + 1:) = field(d + 1:) - matmul(model%damping%friction, hp(1, :))
   end subroutine field_at

   !> Whether a b = b a, up to rounding of the products.
   pure logical function commute(a, b)
      real(wp), intent(in) :: a(:, :), b(:, :)
      real(wp), dimension(size(a, 1), size(a, 1)) :: ab, ba

      ab = matmul(a, b)
      ba = matmul(b, a)
      commute = all(abs(ab - ba) <= rounding*size(a, 1)*maxval(abs(a))*maxval(abs(b)))
   end function commute

   !> Replace z by the state after the time t, with W_k = w(k).
   subroutine solve(self, t, w, z)
      class(linear_flow), intent(in) :: self
      real(wp), intent(in) :: t, w(:)           !! (nnoise)
      real(wp), intent(inout) :: z(self%n)
      real(wp), dimension(self%n + 1, self%n + 1) :: s, flow
      real(wp) :: moved(self%n)
      integer :: k

      ! S = t F_0 + sum_k W_k F_k with F_j = (A_j, b_j; 0, 0)
      s = t*self%field(:, :, 0)
      do k = 1, size(w)
         s = s + w(k)*self%field(:, :, k)
      end do
      flow = exponential(self%n + 1, s)
      ! The flow acts on (z, 1): its last column holds the contribution of linear terms.
      moved = matmul(flow(:self%n, :self%n), z)
      z = moved + flow(:self%n, self%n + 1)
   end subroutine solve

   !> exp(s): Taylor series of s/2^k, of norm at most 1/2, squared k times; the first omitted term, 2^-16/16!, is below
   !> 1e-18.
   pure function exponential(n, s) result(e)
      integer, intent(in) :: n
      real(wp), intent(in) :: s(n, n)
      real(wp) :: e(n, n), part(n, n), one(n, n), product(n, n)
      integer, parameter :: degree = 15
      integer :: i, k

      ! With the norm below 2^e, division by 2^(e+1) leaves less than 1/2, without rounding.
      k = max(0, exponent(maxval(sum(abs(s), dim=1))) + 1)
      part = scale(s, -k)
      one = 0
      do i = 1, n
         one(i, i) = 1
      end do
      e = one
      ! Sum the series by Horner's rule, 1 + s/1 (1 + s/2 (1 + .. )).
      do i = degree, 1, -1
         product = matmul(part, e)
         e = one + product/i
      end do
      do i = 1, k
         !   exp(s) = exp(s/2^k)^(2^k)
         product = matmul(e, e)
         e = product
      end do
   end function exponential

end module symsde_diagnose_linear_flow
