! SPDX-License-Identifier: BSD-3-Clause
!> Kicks between flows of the rest, as data: explicit, symplectic, of strong order 3/2 or 2 for any number of noises in
!> position (derived in docs/method/explicit.md).
!>
!> For H = p.M^-1 p/2 + U(t,q), M constant, and H_k(t,q) a step is a sequence of drifts and kicks. Kick i follows when
!> the drifts have reached t_n + c_i h, and is the flow of
!>
!>    b_i h U + sum_k w_ik H_k  +  kappa_i h V_q.M^-1 V_q  +  s_i/2 sum_kl D_kl H_k,q . M^-1 H_l,q
!>
!>    w_ik = beta_i dW_k + gamma_i a_k + eta_i K_k,       a_k = dZ_k/h - dW_k/2,   s = time in the step over h
!>    K_k  = int (s^2 - s + 1/6) dW_k /2, the space-time-time Levy area, of variance h/720
!>    V    = h U + sum_k (dW_k + zeta K_k) H_k
!>
!> The kicks of a noise miss part of its second Magnus term, sum_kl J_kl H_k,q . M^-1 H_l,q /2 with J_kl = int W_k (dW_l
!> - W_l) ds symmetrised. The last term above adds the missing part:
!>
!>    D_kl = h sum_{i<j} (c_j - c_i) (w_ik w_jl + w_il w_jk)/2 - 2 kappa h v_k v_l - J_kl,   v_k = dW_k + zeta K_k
!>
!> with J sampled for strong order 2; else with E J = 0 in place of J: D_kl = c h^2 delta_kl,
!>
!>    c = sum_{i<j} (c_j - c_i) (beta_i beta_j + gamma_i gamma_j/12 + eta_i eta_j/720) - 2 kappa (1 + zeta^2/720)
!>
!> for strong order 3/2, kappa = sum_i kappa_i. With dW alone (gamma = eta = 0) the same c gives weak order 2.
!>
!> Between kicks p is constant (flow_free), or a declared linear part rotates q and p (flow_rotation), or all of H acts
!> by the implicit midpoint rule (flow_midpoint), and the kicks are those of the noises alone, b = 0. The conditions are
!> the same for all three. With c = 0 only noises are kicked, and H may be any.
!>
!> In a word of flows (scheme/words) several kicks may have the same node c_i, drifts are free of damping, and kick i
!> comes after p <- exp(-decay_i gamma h) p.
module symsde_scheme_kicks
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: kicks_type, new_kicks, mean_coefficient, moment_residual
   public :: flow_free, flow_rotation, flow_midpoint

   enum, bind(c)
      enumerator :: flow_free = 0      !! flow of the kinetic energy
      enumerator :: flow_rotation = 1  !! flow of p.M^-1 p/2 and of a linear part with declared frequencies
      enumerator :: flow_midpoint = 2  !! step of H by the implicit midpoint rule
   end enum

   type :: kicks_type
      real(wp), allocatable :: c(:)        !! times in the step, 0 <= c_1 < c_2 < .. <= 1 (nkick)
      real(wp), allocatable :: b(:)        !! part of the potential U (nkick)
      real(wp), allocatable :: beta(:)     !! part of dW (nkick)
      real(wp), allocatable :: gamma(:)    !! factor of a (nkick)
      real(wp), allocatable :: eta(:)      !! factor of K (nkick)
      real(wp), allocatable :: delta(:)    !! factor of D/h, the noise of decaying momenta along the path (nkick)
      real(wp), allocatable :: kappa(:)    !! factor of h |V_q|^2 (nkick)
      real(wp), allocatable :: share(:)    !! s: part of the potential with D, their sum is one (nkick)
      real(wp) :: zeta = 0                 !! factor of K in V
      logical :: samples = .false.         !! whether J is sampled; else its mean is used
      integer :: flow = flow_free          !! flow between kicks: one of the enumerators
      real(wp), allocatable :: decay(:)    !! of a word: part of the step's decay before each kick (nkick)
      logical :: rational = .false.        !! drifts multiply momenta by (1 - x)/(1 + x), x = gamma tau/2, not exp(-2 x)
   contains
      procedure :: uses_dz
      procedure :: uses_k
      procedure :: is_word
      procedure :: ndrift
   end type kicks_type

contains

   !> Make kicks from the coefficients given, others being zero; share is b by default. Noise is kicked by the parts of
   !> the potential, or, in a word, by those of the decay.
   pure subroutine new_kicks(kicks, c, b, gamma, eta, kappa, zeta, share, flow, decay)
      type(kicks_type), intent(out) :: kicks
      real(wp), intent(in) :: c(:), b(:)           !! (nkick)
      real(wp), intent(in), optional :: gamma(:)   !! (nkick)
      real(wp), intent(in), optional :: eta(:), kappa(:), share(:) !! (nkick)
      real(wp), intent(in), optional :: zeta
      integer, intent(in), optional :: flow        !! with flow_midpoint b is the weight of noises alone
      real(wp), intent(in), optional :: decay(:)   !! of a word (nkick)

      kicks%c = c
      kicks%b = b
      kicks%beta = b
      kicks%share = b
      allocate (kicks%gamma(size(c)), kicks%eta(size(c)), kicks%delta(size(c)), kicks%kappa(size(c)), source=0.0_wp)
      if (present(gamma)) kicks%gamma = gamma
      if (present(flow)) kicks%flow = flow
      if (kicks%flow == flow_midpoint) kicks%b = 0
      if (present(eta)) kicks%eta = eta
      if (present(kappa)) kicks%kappa = kappa
      if (present(share)) kicks%share = share
      if (present(zeta)) kicks%zeta = zeta
      if (present(decay)) then
         kicks%decay = decay
         kicks%beta = decay
      end if
   end subroutine new_kicks

   !> Whether kicks use dZ, so that the scheme approximates paths. With kicks by dW alone it approximates means.
   pure logical function uses_dz(self)
      class(kicks_type), intent(in) :: self

      uses_dz = any(abs(self%gamma) > 0)
   end function uses_dz

   !> Whether the kicks are those of a word, whose drifts do not decay.
   pure logical function is_word(self)
      class(kicks_type), intent(in) :: self

      is_word = allocated(self%decay)
   end function is_word

   pure logical function uses_k(self)
      class(kicks_type), intent(in) :: self

      uses_k = any(abs(self%eta) > 0)
   end function uses_k

   !> Drifts of a step: one before each kick and one after the last, but none outside of kicks at the ends.
   pure integer function ndrift(self)
      class(kicks_type), intent(in) :: self

      ndrift = size(self%c) + 1 - count([self%c(1) <= 0, self%c(size(self%c)) >= 1])
   end function ndrift

   !> The c of the mean form: E D_kl = c h^2 delta_kl, from Var dW = h, Var a = h/12, Var K = h/720.
   pure real(wp) function mean_coefficient(kicks) result(c)
      type(kicks_type), intent(in) :: kicks

      c = ordered_sum(kicks%c, kicks%beta) + ordered_sum(kicks%c, kicks%gamma)/12 &
          + ordered_sum(kicks%c, kicks%eta)/720 - 2*sum(kicks%kappa)*(1 + kicks%zeta**2/720)
      if (abs(c) < 16*epsilon(1.0_wp)) c = 0
   end function mean_coefficient

   !> sum_{i<j} (c_j - c_i) x_i x_j
   pure real(wp) function ordered_sum(c, x)
      real(wp), intent(in) :: c(:), x(:)
      integer :: i, j

      ordered_sum = 0
      do j = 2, size(c)
         do i = 1, j - 1
            ordered_sum = ordered_sum + (c(j) - c(i))*x(i)*x(j)
         end do
      end do
   end function ordered_sum

   !> How far the kicks of a noise are from its moments int s^r dW, r = 0 .. degree, with s^0 = 1, int s dW =
   !> dW/2 - a, int s^2 dW = dW/3 - a + 2K: the largest |sum_i w_i c_i^r - moment| over the three coefficients,
   !> and of those of the potential, 1/(r+1). Strong order 3/2 needs degree one. Kicks by dW alone do not use a, and
   !> flows that contain the potential do not kick it: these moments are then left out.
   pure real(wp) function moment_residual(kicks, degree) result(residual)
      type(kicks_type), intent(in) :: kicks
      integer, intent(in) :: degree  !! 0, 1 or 2
      integer :: r

      residual = 0
      do r = 0, degree
         associate (power => kicks%c**r)
            residual = max(residual, abs(sum(kicks%beta*power) - 1.0_wp/(r + 1)))
            if (kicks%flow /= flow_midpoint) residual = max(residual, abs(sum(kicks%b*power) - 1.0_wp/(r + 1)))
            if (kicks%uses_dz()) residual = max(residual, abs(sum(kicks%gamma*power) - merge(0, -1, r == 0)), &
                                                abs(sum(kicks%eta*power) - merge(2, 0, r == 2)))
         end associate
      end do
   end function moment_residual

end module symsde_scheme_kicks
