! SPDX-License-Identifier: BSD-3-Clause
!> Kicks by functions of the actions I_k = (q_k^2 + p_k^2)/2: the exact flow of K = b h K_0 + sum_j w_j K_j turns every
!> plane (q_k, p_k) by an angle of its own, for actions stay as they are:
!>
!>    theta_k = dK/dI_k = (q_k G_k + p_k G_{n+k})/(q_k^2 + p_k^2),    G = grad K
!>
!>    q_k <- cos theta_k q_k + sin theta_k p_k,    p_k <- cos theta_k p_k - sin theta_k q_k
!>
!> K_0 = H - D is what a quadratic part D = z.S z/2 leaves of H, so that G is the gradient of the model less b h S z. An
!> error of G of the size of its rounding turns the plane by as little. The sum of all q_k^2 + p_k^2 stays the same to
!> rounding, in which half of an angle gives cos theta - 1 = -2 sin^2(theta/2) without cancellation.
!>
!> Private to its family.
module symsde_step_splitting_turns
   use symsde_base_kinds, only: wp
   use symsde_base_sincos, only: sincos_lanes
   use symsde_base_vectors, only: add, add_times
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   implicit none
   private
   public :: action_turns, new_action_turns

   integer, parameter :: at_a_time = 128  !! angles of a few paths that are found together, to fill vectors

   type :: action_turns
      private
      integer, allocatable :: from(:)             !! row i of S has the entries from(i)+1 .. from(i+1) (2 ndof + 1)
      integer, allocatable :: column(:)           !! their columns (nonzero)
      real(wp), allocatable :: entry(:)           !! their values (nonzero)
      real(wp), allocatable :: z(:, :), g(:, :)   !! the point of a kick, and the gradient there (nlane, 2 ndof)
      real(wp), allocatable, dimension(:) :: half, sine, cosine  !! theta_k/2 and its functions (nlane*planes)
      integer :: planes = 1                       !! planes that are turned at a time
   contains
      procedure :: turn
   end type action_turns

contains

   !> Allocate for blocks of nlane lanes.
   pure subroutine new_action_turns(self, nlane, ndof, s)
      type(action_turns), intent(out) :: self
      integer, intent(in) :: nlane, ndof
      real(wp), intent(in) :: s(2*ndof, 2*ndof)   !! second derivatives of D, by q and then by p
      integer :: i, j, n

      n = count(abs(s) > 0)
      self%planes = min(ndof, max(1, at_a_time/nlane))
      allocate (self%from(2*ndof + 1), self%column(n), self%entry(n))
      allocate (self%z(nlane, 2*ndof), self%g(nlane, 2*ndof))
      allocate (self%half(nlane*self%planes), self%sine(nlane*self%planes), self%cosine(nlane*self%planes))
      n = 0
      do i = 1, 2*ndof
         self%from(i) = n
         do j = 1, 2*ndof
            if (abs(s(i, j)) <= 0) cycle
            n = n + 1
            self%column(n) = j
            self%entry(n) = s(i, j)
         end do
      end do
      self%from(2*ndof + 1) = n
   end subroutine new_action_turns

   !> Kick (q + dq, p + dp) at the time t by the weights w, of which that of H is `weight` in all lanes.
   subroutine turn(self, ham, t, weight, w, nlane, ndof, q, p, dq, dp)
      class(action_turns), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      integer, intent(in) :: nlane, ndof
      real(wp), intent(in) :: t, weight
      real(wp), intent(in) :: w(nlane, 0:ham%nnoise)
      real(wp), intent(in), dimension(nlane, ndof) :: q, p
      real(wp), intent(inout), dimension(nlane, ndof) :: dq, dp
      real(wp) :: g
      integer :: i, k, n

      call add(size(q), q, dq, self%z(:, :ndof))
      call add(size(p), p, dp, self%z(:, ndof + 1:))
      call ham%gradient(t, w, self%z(:, :ndof), self%z(:, ndof + 1:), self%g(:, :ndof), self%g(:, ndof + 1:))
      do i = 1, 2*ndof
         if (nlane == 1) then  ! without calls
            g = self%g(1, i)
            do k = self%from(i) + 1, self%from(i + 1)
               g = g + (-weight*self%entry(k))*self%z(1, self%column(k))
            end do
            self%g(1, i) = g
            cycle
         end if
         do k = self%from(i) + 1, self%from(i + 1)
            call add_times(nlane, -weight*self%entry(k), self%z(:, self%column(k)), self%g(:, i))
         end do
      end do
      ! Angles of planes that follow each other are numbers that follow each other.
      do i = 1, ndof, self%planes
         n = nlane*min(self%planes, ndof + 1 - i)
         call find_half(n, self%z(1, i), self%z(1, ndof + i), self%g(1, i), self%g(1, ndof + i), self%half)
         call sincos_lanes(n, self%half, self%sine, self%cosine)
         call rotate(n, self%sine, self%cosine, self%z(1, i), self%z(1, ndof + i), dq(1, i), dp(1, i))
      end do
   end subroutine turn

   !> VEC Half of the angle of one plane. Where both x and y vanish, so does the angle. Parentheses around the second
   !> product allow only the first to be contracted, in one lane as in many.
   pure subroutine find_half(nlane, x, y, gx, gy, half)
      integer, intent(in) :: nlane
      real(wp), intent(in), dimension(nlane) :: x, y, gx, gy
      real(wp), intent(out) :: half(nlane)
      integer :: lane

      do lane = 1, nlane
         half(lane) = 0.5_wp*(x(lane)*gx(lane) + (y(lane)*gy(lane)))/ &
                      max(x(lane)*x(lane) + (y(lane)*y(lane)), tiny(1.0_wp))
      end do
   end subroutine find_half

   !> VEC Turn one plane by twice an angle of this sine and cosine.
   pure subroutine rotate(nlane, sine, cosine, x, y, dq, dp)
      integer, intent(in) :: nlane
      real(wp), intent(in), dimension(nlane) :: sine, cosine, x, y
      real(wp), intent(inout), dimension(nlane) :: dq, dp
      real(wp) :: less, across
      integer :: lane

      do lane = 1, nlane
         less = -2*(sine(lane)*sine(lane))
         across = 2*(sine(lane)*cosine(lane))
         dq(lane) = dq(lane) + (less*x(lane) + (across*y(lane)))
         dp(lane) = dp(lane) + (less*y(lane) - (across*x(lane)))
      end do
   end subroutine rotate

end module symsde_step_splitting_turns
