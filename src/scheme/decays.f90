! SPDX-License-Identifier: BSD-3-Clause
!> A tableau with damping: its momentum coefficients with integrating factors.
!>
!> In a step from t_n let P(s) = exp(gamma s) p. (q, P) moves by the Hamiltonian exp(gamma s) H_j(q, exp(-gamma s) P),
!> to which the tableau is applied unchanged, from P = p_n on, with stage i at s = c_i h. In physical momenta
!> p_i = exp(-gamma c_i h) P_i the equations are the tableau's with decays, z = gamma h:
!>
!>    P_i     = exp(-c_i z) p_n - sum_j abar_ij exp(-(c_i - c_j) z) Hhat_q(Q_j,P_j)
!>    p_{n+1} = exp(-z) p_n - sum_j alpha_j exp(-(1 - c_j) z) Hhat_q(Q_j,P_j)
!>
!> while the equations of Q_i and q_{n+1} are those without damping. A symplectic tableau gives dp_{n+1} ^ dq_{n+1} =
!> exp(-z) dp_n ^ dq_n to rounding, for every Hamiltonian and all increments. Each degree of freedom may have a rate of
!> its own.
module symsde_scheme_decays
   use symsde_base_damping, only: damping_type, decay_less_one
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: tableau_decays, new_decays, free_temperature

   !> The factors of one step; without damping all exponentials are one, and their differences zero.
   type :: tableau_decays
      real(wp), allocatable :: begin(:, :)       !! exp(-c_i z): factor of p_n in stage i (nstage, ndof)
      real(wp), allocatable :: between(:, :, :)  !! exp(-(c_i - c_j) z): of stage j in stage i (nstage, nstage, ndof)
      real(wp), allocatable :: finish(:, :)      !! exp(-(1 - c_j) z): factor of stage j in p_{n+1} (nstage, ndof)
      real(wp), allocatable :: loss(:) !! exp(-z) - 1 without cancellation: factor of p_n in the increment (ndof)
      real(wp), allocatable, private :: rate(:)  !! gamma of each degree of freedom; not allocated: no damping
      real(wp), allocatable :: node(:)           !! c_i (nstage)
      real(wp), private :: h = 0                 !! the step that the factors belong to
   contains
      procedure :: set_step
   end type tableau_decays

contains

   !> Allocate the factors for nodes c, with the values of no damping.
   subroutine new_decays(self, damping, c, ndof)
      type(tableau_decays), intent(out) :: self
      type(damping_type), intent(in) :: damping
      real(wp), intent(in) :: c(:)   !! (nstage)
      integer, intent(in) :: ndof

      allocate (self%begin(size(c), ndof), self%between(size(c), size(c), ndof), self%finish(size(c), ndof), &
                source=1.0_wp)
      allocate (self%loss(ndof), source=0.0_wp)
      if (.not. allocated(damping%rate)) return
      self%rate = damping%rate
      self%node = c
   end subroutine new_decays

   !> Mean of p^2 of a damped free particle driven by noise of strength one, divided by the exact mean. Weights w_j of
   !> dW at the nodes c_j change the momentum by s dW in a step, s = sum_j w_j exp(-(1 - c_j) z), so that the mean is
   !> h s^2/(1 - exp(-2 z)); the exact mean is h/(2 z). Kicks add such sums for a and K, of variance h/12 and h/720.
   pure real(wp) function free_temperature(c, w, z) result(ratio)
      real(wp), intent(in) :: c(:)      !! (node)
      real(wp), intent(in) :: w(:, :)   !! weights of dW, a and K (node, 1 or 3)
      real(wp), intent(in) :: z         !! gamma h > 0
      real(wp), parameter :: variance(3) = [1.0_wp, 1/12.0_wp, 1/720.0_wp]
      real(wp) :: s
      integer :: i, j

      ratio = 0
      do j = 1, size(w, 2)
         s = 0
         !GCC$ novector  ! as in set_step
         do i = 1, size(c)
            s = s + w(i, j)*exp(-(1 - c(i))*z)
         end do
         ratio = ratio + variance(j)*s**2
      end do
      ratio = -2*z*ratio/decay_less_one(2*z)
   end function free_temperature

   !> Compute the factors for steps of length h, with its sign.
   subroutine set_step(self, h)
      class(tableau_decays), intent(inout) :: self
      real(wp), intent(in) :: h
      real(wp) :: z
      integer :: i, j, k

      if (.not. allocated(self%rate) .or. abs(h - self%h) <= 0) return
      self%h = h
      do k = 1, size(self%rate)
         z = self%rate(k)*h
         self%loss(k) = decay_less_one(z)
         do j = 1, size(self%node)
            ! No vectors: the last bits of a vector exponential depend on the width of registers.
            !GCC$ novector
            do i = 1, size(self%node)
               self%between(i, j, k) = exp(-(self%node(i) - self%node(j))*z)
            end do
            self%begin(j, k) = exp(-self%node(j)*z)
            self%finish(j, k) = exp(-(1 - self%node(j))*z)
         end do
      end do
   end subroutine set_step

end module symsde_scheme_decays
