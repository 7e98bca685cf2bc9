! SPDX-License-Identifier: BSD-3-Clause
!> The noise of kicks between drifts that decay, for a model that is damped by one rate. The noise of free motion gets
!> its exact law (noise/decay_law): the first kick takes more and the last one less,
!>
!>    d_k = (D_k/h - sum_i phi_i w_ik)/(phi_1 - phi_n),   phi_i = phi((1 - c_i) h)/h
!>
!> so that sum_i w_ik = dW_k and sum_i h phi_i w_ik = D_k. Both are linear in dW, a and K: beta, gamma and eta of these
!> two kicks change with gamma h.
module symsde_step_open_kick_law
   use symsde_base_kinds, only: wp
   use symsde_noise_decay_law, only: decay_law2, decay_law3, decay_integral
   use symsde_scheme_kicks, only: kicks_type
   implicit none
   private
   public :: give_law

contains

   !> Kicks whose noise has the law of free motion with decay, z = gamma h.
   pure subroutine give_law(kicks, closed, z)
      type(kicks_type), intent(inout) :: kicks
      type(kicks_type), intent(in) :: closed
      real(wp), intent(in) :: z
      real(wp) :: d(3), phi(size(closed%c))
      integer :: last

      last = size(closed%c)
      phi = decay_integral(1 - closed%c, z)
      d = decay_law2(z)
      if (closed%uses_k()) d = decay_law3(z)
      d(1) = d(1) - sum(phi*closed%beta)
      d(2) = d(2) - sum(phi*closed%gamma)
      d(3) = d(3) - sum(phi*closed%eta)
      d = d/(phi(1) - phi(last))
      kicks%beta(1) = closed%beta(1) + d(1)
      kicks%gamma(1) = closed%gamma(1) + d(2)
      kicks%eta(1) = closed%eta(1) + d(3)
      kicks%beta(last) = closed%beta(last) - d(1)
      kicks%gamma(last) = closed%gamma(last) - d(2)
      kicks%eta(last) = closed%eta(last) - d(3)
   end subroutine give_law

end module symsde_step_open_kick_law
