! SPDX-License-Identifier: BSD-3-Clause
!> The energy-drift-preserving scheme, whose step uses a mean of forces, for blocks of paths:
!>
!>    F = int_0^1 V'(q_n + s h Psi) ds,   Psi = p_n + g - (h/2) F,   q_{n+1} = q_n + h Psi,   p_{n+1} = p_n + g - h F
!>
!> The derivation and the equation of X = Psi - p_n are in the body, mean_force.inc; matrices and sweeps are those of
!> step/midpoint/dense. This file recognises the scheme by the coefficients of its tableau.
module symsde_step_midpoint_mean_force
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_traits, only: dense
   use symsde_scheme_scheme, only: scheme_type, correction_none
   use symsde_step_midpoint_dense, only: dense_midpoint, find_force_stiffness
   use symsde_step_midpoint_equation, only: midpoint_equation, position
   use symsde_step_hamiltonian_noise_shift, only: noise_shift, new_noise_shift
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian, new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task, few_of
   implicit none
   private
   public :: mean_force_stepper, mean_force_fits

   include 'mean_force.inc'
   include '../../solve/all_lanes.inc'

   !> Whether this stepper executes the task: a tableau of averaged forces, H = p.p/2 + V(q), and either no noise or
   !> additive noise in p.
   logical function mean_force_fits(task) result(fits)
      type(stepper_task), intent(in) :: task

      fits = .false.
      associate (t => task%model%traits)
         ! Noise that moves positions, or depends on them, is no constant kick g of the momenta.
         if (t%nnoise > 0 .and. .not. (t%additive .and. t%position_noise)) return
         if (t%identity_mass .and. task%is_plain()) fits = averages_forces(task%scheme)
      end associate
   end function mean_force_fits

   !> Whether a tableau averages forces: a_ij = c_i w_j, abar_ij = w_j/2, bbar_ij = w_j. Its stages are Q_i = q_n +
   !> c_i h Psi with Psi = sum_j w_j P_j, and all P_i are Psi = p_n + g - (h/2) sum_j w_j V'(Q_j). Coefficients are
   !> compared up to rounding, since a user may have written the same tableau.
   pure logical function averages_forces(scheme)
      type(scheme_type), intent(in) :: scheme
      real(wp), parameter :: rounding = 4*epsilon(1.0_wp)
      integer :: i

      averages_forces = all(abs(scheme%alpha - scheme%beta) <= 0)
      do i = 1, scheme%nstage
         associate (w => scheme%alpha)
            averages_forces = averages_forces .and. all(abs(scheme%a(i, :) - scheme%c(i)*w) <= rounding) .and. &
                              all(abs(scheme%abar(i, :) - 0.5_wp*w) <= rounding) .and. &
                              all(abs(scheme%bbar(i, :) - w) <= rounding)
         end associate
      end do
   end function averages_forces

end module symsde_step_midpoint_mean_force
