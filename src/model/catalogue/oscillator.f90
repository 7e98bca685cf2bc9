! SPDX-License-Identifier: BSD-3-Clause
!>    S = sum_j w_j H_j = (a q^2 + c p^2)/2 + b q + e p
!>    a = r w_0 + A w_i,   b = B w_j,   c = r w_0 + C w_k,   e = E w_l
!>
!> Oscillators with a quadratic Hamiltonian, described by the terms of model/flows/oscillator: the rate r, the strengths
!> A .. E and the numbers i .. l of the noises. A model sets these terms when it is made, and whole steps follow from
!> them. An extension adds value and evaluate.
module symsde_model_catalogue_oscillator
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_maps, only: step_map
   use symsde_base_record, only: steps_record
   use symsde_model_kernels, only: angle_terms
   use symsde_model_flows_damped_oscillator, only: damped_oscillator_flow, damped_oscillator_has_flow
   use symsde_model_flows_oscillator, only: oscillator_terms, oscillator_flow, oscillator_has_flow
   use symsde_model_separable, only: separable_model
   implicit none
   private
   public :: oscillator_model

   type, abstract, extends(separable_model) :: oscillator_model
      type(oscillator_terms) :: terms
   contains
      procedure :: has_flow
      procedure :: flow
      procedure :: angle
   end type oscillator_model

contains

   !> Whether `flow` can take steps by this map. The answer depends on the noises too: oscillator_has_flow excludes
   !> steps for which a noise in a .. e is not implemented.
   pure logical function has_flow(self, map)
      class(oscillator_model), intent(in) :: self
      type(step_map), intent(in) :: map

      if (map%damped) then
         has_flow = damped_oscillator_has_flow(self%terms, map)
      else
         has_flow = oscillator_has_flow(self%terms, map)
      end if
   end function has_flow

   !> Whole steps, see model_type.
   subroutine flow(self, map, steps, ndof, q, p, qn, pn, status, counters)
      class(oscillator_model), intent(in) :: self
      type(step_map), intent(in) :: map
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: ndof
      real(wp), intent(in) :: q(steps%nlane, ndof), p(steps%nlane, ndof)
      real(wp), intent(out) :: qn(steps%nlane, ndof, steps%nstep/steps%every)
      real(wp), intent(out) :: pn(steps%nlane, ndof, steps%nstep/steps%every)
      integer(i8), intent(inout) :: status(steps%nlane)
      type(counters_type), intent(inout) :: counters

      if (map%damped) then
         call damped_oscillator_flow(self%terms, map, steps, q, p, qn, pn, counters)
      else
         call oscillator_flow(self%terms, map, steps, q, p, qn, pn, counters)
      end if
   end subroutine flow

   !> The terms for one path, see model_type; their rate is one.
   subroutine angle(self, nnoise, t, w, terms)
      class(oscillator_model), intent(in) :: self
      integer, intent(in) :: nnoise
      real(wp), intent(in) :: t, w(0:nnoise)
      type(angle_terms), intent(out) :: terms

      associate (s => self%terms)
         ! angle_terms uses other letters: c q^2/2 + d q + e p^2/2 + f p. A noise with number 0 has strength zero and
         ! reads w_0. A model with a rate other than one, such as kubo, overrides this.
         terms%c = w(0) + s%a*w(s%noise_a)
         terms%d = s%b*w(s%noise_b)
         terms%e = w(0) + s%c*w(s%noise_c)
         terms%f = s%e*w(s%noise_e)
      end associate
   end subroutine angle

end module symsde_model_catalogue_oscillator
