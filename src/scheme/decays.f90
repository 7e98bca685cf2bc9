! SPDX-License-Identifier: BSD-3-Clause
!> What damping makes of a tableau: an integrating factor in its momentum coefficients.
!>
!> In a step from t_n let P(s) = exp(gamma s) p. (q, P) moves by the Hamiltonian exp(gamma s) H_j(q, exp(-gamma s) P),
!> to which the tableau is applied as it stands, from P = p_n on, with stage i at s = c_i h. In physical momenta
!> p_i = exp(-gamma c_i h) P_i these are its own equations with decays, z = gamma h:
!>
!>    P_i     = exp(-c_i z) p_n - sum_j abar_ij exp(-(c_i - c_j) z) Hhat_q(Q_j,P_j)
!>    p_{n+1} = exp(-z) p_n - sum_j alpha_j exp(-(1 - c_j) z) Hhat_q(Q_j,P_j)
!>
!> while Q_i and q_{n+1} are as without damping. A symplectic tableau gives dp_{n+1} ^ dq_{n+1} = exp(-z) dp_n ^ dq_n to
!> rounding, for every Hamiltonian and all increments. Each degree of freedom may have a rate of its own.
module symsde_scheme_decays
   use symsde_base_damping, only: damping_type, decay_less_one
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: tableau_decays, new_decays, free_temperature

   !> The factors of one step; of a closed system all are one, and those of differences zero.
   type :: tableau_decays
      real(wp), allocatable :: begin(:, :)       !! exp(-c_i z): of p_n in stage i (nstage, ndof)
      real(wp), allocatable :: between(:, :, :)  !! exp(-(c_i - c_j) z): of stage j in stage i (nstage, nstage, ndof)
      real(wp), allocatable :: finish(:, :)      !! exp(-(1 - c_j) z): of stage j in p_{n+1} (nstage, ndof)
      real(wp), allocatable :: loss(:)           !! exp(-z) - 1 without cancellation: of p_n in the increment (ndof)
      real(wp), allocatable, private :: rate(:)  !! gamma of each degree of freedom; not allocated: closed
      real(wp), allocatable :: node(:)           !! c_i (nstage)
      real(wp), private :: h = 0                 !! the step that the factors are of
   contains
      procedure :: set_step
   end type tableau_decays

contains

   !> Room for the factors of nodes c, with those of a closed system.
   subroutine new_decays(self, damping, c, ndof)
      type(tableau_decays), intent(out) :: self
      type(damping_type), intent(in) :: damping
      real(wp), intent(in) :: c(:)   !! (nstage)
      integer, intent(in) :: ndof

      allocate (self%begin(size(c), ndof), self%between(size(c), size(c), ndof), self%finish(size(c), ndof), &
                source=1.0_wp)
      allocate (self%loss(ndof), source=0.0_wp)
      if (.not. damping%acts()) return
      self%rate = damping%rate
      self%node = c
   end subroutine new_decays

   !> What noise of strength one gives the mean of p^2 of a free particle at rest, over the right one: weights w_j of
   !> dW at the nodes c_j give the momentum s = sum_j w_j exp(-(1 - c_j) z) of it in a step, so that the mean is
   !> h s^2/(1 - exp(-2 z)), where h/(2 z) is right. Kicks have such sums for a and K, too, of variance h/12 and h/720.
   pure real(wp) function free_temperature(c, w, z) result(ratio)
      real(wp), intent(in) :: c(:)      !! (node)
      real(wp), intent(in) :: w(:, :)   !! of dW, a and K (node, 1 or 3)
      real(wp), intent(in) :: z         !! gamma h > 0
      real(wp), parameter :: variance(3) = [1.0_wp, 1/12.0_wp, 1/720.0_wp]
      real(wp) :: s
      integer :: i, j

      ratio = 0
      do j = 1, size(w, 2)
         s = 0
         do i = 1, size(c)
            s = s + w(i, j)*exp(-(1 - c(i))*z)
         end do
         ratio = ratio + variance(j)*s**2
      end do
      ratio = -2*z*ratio/decay_less_one(2*z)
   end function free_temperature

   !> The factors of steps of the length h, with its sign.
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
            ! Not in vectors, whose exponential has other last bits where registers are wider.
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
