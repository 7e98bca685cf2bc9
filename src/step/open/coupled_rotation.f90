! SPDX-License-Identifier: BSD-3-Clause
!> Rotations of degrees of freedom that a matrix of friction couples, mass one: the flow over the time tau of
!>
!>    q' = p,   p' = -omega^2 q - Gamma p             (q, p) <- (q, p) + X (q, p),   X = exp(tau A) - 1
!>
!> of 2 ndof rows. X is a Taylor sum for a time tau/2^k and k doublings, X <- 2 X + X X, once for all steps of one size.
!> The trace of A is that of -Gamma, so that volume shrinks as the flow shrinks it.
module symsde_step_open_coupled_rotation
   use symsde_base_kinds, only: wp
   use symsde_base_vectors, only: add_times
   use symsde_step_open_matrices, only: multiply, halvings
   implicit none
   private
   public :: coupled_rotation, new_coupled_rotation

   integer, parameter :: nterm = 13  !! terms of the Taylor sum, for matrices of norm 1/4 at most

   type :: coupled_rotation
      private
      real(wp), allocatable :: field(:, :)       !! A (2 ndof, 2 ndof)
      real(wp), allocatable :: duration(:)       !! tau of each leg, whose matrix follows (nleg)
      real(wp), allocatable :: change(:, :, :)   !! X (2 ndof, 2 ndof, nleg)
   contains
      procedure :: move
   end type coupled_rotation

contains

   !> Allocate for nleg durations of a step.
   pure subroutine new_coupled_rotation(self, omega, friction, nleg)
      type(coupled_rotation), intent(out) :: self
      real(wp), intent(in) :: omega(:)         !! frequencies (ndof)
      real(wp), intent(in) :: friction(:, :)   !! Gamma [1/time] (ndof, ndof)
      integer, intent(in) :: nleg
      integer :: n, i

      n = size(omega)
      allocate (self%field(2*n, 2*n), self%duration(nleg), self%change(2*n, 2*n, nleg), source=0.0_wp)
      do i = 1, n
         self%field(i, n + i) = 1
         self%field(n + i, i) = -omega(i)**2
         self%field(n + 1:, n + i) = -friction(:, i)
      end do
   end subroutine new_coupled_rotation

   !> Move (q + dq, p + dp) over the time tau, leg `leg` of the step.
   pure subroutine move(self, leg, tau, nlane, ndof, q, p, dq, dp)
      class(coupled_rotation), intent(inout) :: self
      integer, intent(in) :: leg, nlane, ndof
      real(wp), intent(in) :: tau                                   !! duration with its sign [time]
      real(wp), intent(in) :: q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(inout) :: dq(nlane, ndof), dp(nlane, ndof)
      real(wp), dimension(nlane, ndof) :: x, y
      integer :: i, j

      if (abs(tau - self%duration(leg)) > 0) then
         self%duration(leg) = tau
         call exponential_less_one(2*ndof, self%field, tau, self%change(:, :, leg))
      end if
      x = q + dq
      y = p + dp
      do i = 1, ndof
         do j = 1, ndof
            call add_times(nlane, self%change(i, j, leg), x(:, j), dq(:, i))
            call add_times(nlane, self%change(i, ndof + j, leg), y(:, j), dq(:, i))
            call add_times(nlane, self%change(ndof + i, j, leg), x(:, j), dp(:, i))
            call add_times(nlane, self%change(ndof + i, ndof + j, leg), y(:, j), dp(:, i))
         end do
      end do
   end subroutine move

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
         call multiply(n, a, term, product)
         term = product*(short/k)
         change = change + term
      end do
      do k = 1, ndouble
         call multiply(n, change, change, product)
         change = 2*change + product
      end do
   end subroutine exponential_less_one

end module symsde_step_open_coupled_rotation
