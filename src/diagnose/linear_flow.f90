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
   use symsde_base_matrices, only: exponential_less_one
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: linear_flow, new_linear_flow

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
      real(wp) :: z(self%n), found(self%n), known(self%n), allowed(self%n)
      integer :: i, half

      do i = 1, self%n
         ! No two components are equal and none is zero, so that terms that are not linear in z show.
         z(i) = 1.3_wp + 0.7_wp*modulo(0.618_wp*i, 1.0_wp)
      end do
      known = matmul(self%field(:self%n, :self%n, j), z)
      known = known + self%field(:self%n, self%n + 1, j)
      ! Allow generously for rounding, of velocities and of forces: nonlinear fields differ by far more.
      half = self%n/2
      allowed(:half) = 1.0e-10_wp*(maxval(abs(known(:half))) + maxval(abs(self%field(:half, :, j))))
      allowed(half + 1:) = 1.0e-10_wp*(maxval(abs(known(half + 1:))) + maxval(abs(self%field(half + 1:self%n, :, j))))
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

   !> Whether a b = b a, up to rounding of the products: in each block by the sizes of the blocks that it is made of,
   !> since positions, momenta and the last column have different units.
   pure logical function commute(a, b)
      real(wp), intent(in) :: a(:, :), b(:, :)
      real(wp), dimension(size(a, 1), size(a, 1)) :: ab, ba, allowed
      real(wp), dimension(3, 3) :: of_a, of_b, of_both
      integer :: last(0:3), i, j

      last = [0, size(a, 1)/2, size(a, 1) - 1, size(a, 1)]
      ab = matmul(a, b)
      ba = matmul(b, a)
      do j = 1, 3
         do i = 1, 3
            of_a(i, j) = maxval(abs(a(last(i - 1) + 1:last(i), last(j - 1) + 1:last(j))))
            of_b(i, j) = maxval(abs(b(last(i - 1) + 1:last(i), last(j - 1) + 1:last(j))))
         end do
      end do
      of_both = matmul(of_a, of_b) + matmul(of_b, of_a)
      do j = 1, 3
         do i = 1, 3
            allowed(last(i - 1) + 1:last(i), last(j - 1) + 1:last(j)) = of_both(i, j)
         end do
      end do
      commute = all(abs(ab - ba) <= rounding*size(a, 1)*allowed)
   end function commute

   !> Replace z by the state after the time t, with W_k = w(k).
   subroutine solve(self, t, w, z)
      class(linear_flow), intent(in) :: self
      real(wp), intent(in) :: t, w(:)           !! (nnoise)
      real(wp), intent(inout) :: z(self%n)
      real(wp), dimension(self%n + 1, self%n + 1) :: s, change
      real(wp) :: moved(self%n)
      integer :: k

      ! S = t F_0 + sum_k W_k F_k with F_j = (A_j, b_j; 0, 0)
      s = t*self%field(:, :, 0)
      do k = 1, size(w)
         s = s + w(k)*self%field(:, :, k)
      end do
      call exponential_less_one(self%n + 1, s, 1.0_wp, change)
      ! The flow acts on (z, 1): its last column holds the contribution of linear terms.
      moved = matmul(change(:self%n, :self%n), z)
      z = z + (moved + change(:self%n, self%n + 1))
   end subroutine solve

end module symsde_diagnose_linear_flow
