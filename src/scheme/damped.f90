! SPDX-License-Identifier: BSD-3-Clause
!>    one rate           dp ^ dq times exp(-gamma h)
!>    unequal rates      volume times exp(-h sum gamma_i)
!>    a matrix           volume times exp(-h tr Gamma M^-1)
!>    gamma_i(q, t)      volume times exp(-sum int gamma_i dt), where momenta decay
!>
!> What a scheme does with damped momenta: whether it runs, and what its steps keep.
!>
!> With one rate a symplectic tableau keeps its form up to that factor (scheme/decays), and so do kicks between drifts
!> that decay. With unequal rates, a matrix or functions the flow itself keeps volume alone. Maps that are made of exact
!> flows, of a closed system's step between two decays, or of stages that follow each other keep it to rounding; with
!> unequal rates a tableau of several implicit stages does not, as no Hamiltonian is behind its decays, and keeps it to
!> its order.
module symsde_scheme_damped
   use symsde_base_laws, only: law_gaussian
   use symsde_base_kinds, only: wp
   use symsde_base_text, only: to_text
   use symsde_scheme_decays, only: free_temperature
   use symsde_scheme_dependency, only: is_explicit
   use symsde_scheme_kicks, only: flow_free, flow_rotation
   use symsde_scheme_orders, only: evidence_text
   use symsde_scheme_scheme, only: scheme_type, bracket_terms, tableau_form, galerkin_form, splitting_form, &
                                   frame_none, frame_shift, frame_rotation
   implicit none
   private
   public :: damped_refusal, tell_damping, temperature_of_weights
   public :: one_rate, unequal_rates, friction_matrix, varying_rates

   enum, bind(c)
      ! kinds of damping (base/damping)
      enumerator :: one_rate = 1
      enumerator :: unequal_rates = 2
      enumerator :: friction_matrix = 3
      enumerator :: varying_rates = 4
   end enum

contains

   !> Why a scheme is refused for a kind of damping, as the end of a sentence that begins with its name; not allocated
   !> where it runs. Brackets with H, or between drift and noise, would have to include the change of exp(gamma s) H_k
   !> in time; between unequal decays of stages no product of two gradients keeps its form.
   pure subroutine damped_refusal(scheme, kind, brackets, products, why)
      type(scheme_type), intent(in) :: scheme
      integer, intent(in) :: kind                   !! one of the four enumerators
      type(bracket_terms), intent(in) :: brackets   !! brackets that act
      logical, intent(in) :: products               !! whether a correction of one-sided schemes acts
      character(:), allocatable, intent(out) :: why

      if (scheme%law /= law_gaussian) then
         why = 'draws increments for means alone, whose order nobody has found for damped momenta'
      else if (.not. (scheme%form == tableau_form .or. scheme%form == splitting_form) .or. &
               all(scheme%frame /= [frame_none, frame_shift, frame_rotation])) then
         why = 'is neither a tableau, whose coefficients decay, nor made of kicks and of flows that decay'
      else if (brackets%single .or. brackets%nested) then
         why = 'adds brackets of H, which damping would change in time'
      else if (scheme%kicks%is_word() .and. kind /= one_rate) then
         why = 'is a word, whose noise has one law for all momenta, that of one rate'
      else if (scheme%kicks%rational .and. kind /= one_rate .and. kind /= unequal_rates) then
         why = 'multiplies momenta by rational functions of rates, which are numbers for it'
      else if ((brackets%areas .or. products) .and. kind == unequal_rates .and. scheme%nstage > 1) then
         why = 'adds products of gradients, which keep their form where all rates are equal'
      else if (kind == varying_rates .and. (scheme%frame /= frame_none .or. scheme%kicks%flow /= flow_free)) then
         why = 'is made of kicks and of flows that decay by numbers, rates or a matrix'
      end if
   end subroutine damped_refusal

   !> What steps keep of dp ^ dq for a kind of damping, or why the scheme is refused. A Galerkin scheme is judged as the
   !> tableau that executes it for a model.
   pure subroutine tell_damping(scheme, symplectic, corrected, kind, text)
      type(scheme_type), intent(in) :: scheme
      logical, intent(in) :: symplectic   !! whether steps of closed systems are symplectic
      logical, intent(in) :: corrected    !! whether a correction exists and is needed
      integer, intent(in) :: kind         !! one of the four enumerators
      character(:), allocatable, intent(out) :: text
      type(scheme_type) :: executed
      character(:), allocatable :: why

      executed = scheme
      if (scheme%form == galerkin_form) executed%form = tableau_form
      executed%brackets%areas = .false.  ! areas act only where noises do not commute
      call damped_refusal(executed, kind, executed%brackets, products=.false., why=why)
      if (allocated(why)) then
         text = 'refused: it '//why
         return
      else if (.not. symplectic) then
         text = 'no factor of dp ^ dq, nor of volume'
         return
      else if (kind == one_rate) then
         text = 'exp(-gamma h)'
         if (scheme%kicks%rational) text = '(1 - x)/(1 + x), x = gamma h/2'
         text = 'dp ^ dq times '//text//' ('//evidence_text(scheme%structure)//'); <p^2> of a free particle '// &
                to_text(temperature_at_rest(executed, 1.0_wp))//'/beta at gamma h = 1'
      else if (scheme%kicks%rational) then
         text = 'volume times the product of (1 - x_i)/(1 + x_i), x_i = gamma_i h/2'
      else
         text = 'volume times exp(-h sum gamma_i)'
         if (kind == friction_matrix) text = 'volume times exp(-h tr Gamma M^-1)'
         if (kind == varying_rates) text = 'volume times exp(-sum int gamma_i dt), by the rates where momenta decay'
         if (.not. keeps_damped_volume(scheme, kind)) text = text//', at least to the order of the scheme'
         text = text//'; no form'
         if (kind == varying_rates) text = text//' but with one gamma(t)'
         if (kind == unequal_rates .and. scheme%nstage > 1) then
            if (corrected) text = text//'; refused where the correction acts'
            if (scheme%brackets%areas) text = text//'; refused where areas act'
         end if
      end if
      if (scheme%form == galerkin_form) text = text//'; where it is a tableau for the model'
   end subroutine tell_damping

   !> Whether steps with unequal rates, a matrix or functions multiply volume by its factor to rounding.
   pure logical function keeps_damped_volume(scheme, kind)
      type(scheme_type), intent(in) :: scheme
      integer, intent(in) :: kind

      keeps_damped_volume = scheme%form == splitting_form .or. scheme%nstage == 1 .or. kind /= unequal_rates
      if (.not. keeps_damped_volume .and. scheme%form /= galerkin_form) &
         keeps_damped_volume = is_explicit(scheme, .true.)
   end function keeps_damped_volume

   !> Mean of p^2 of a free particle in a bath of one rate, over the exact mean 1/beta: one if kicks have the exact law
   !> of the noise, as kicks between free drifts, kicks with dZ between rotations, the shift by dZ and words have.
   pure real(wp) function temperature_at_rest(scheme, z) result(ratio)
      type(scheme_type), intent(in) :: scheme   !! a scheme that runs with one rate of damping
      real(wp), intent(in) :: z                 !! gamma h > 0

      ratio = 1
      if (scheme%frame == frame_shift) return
      if (scheme%form == splitting_form) then
         if (scheme%kicks%flow == flow_free) return
         if (scheme%kicks%flow == flow_rotation .and. scheme%kicks%uses_dz()) return
      end if
      ratio = temperature_of_weights(scheme, z)
   end function temperature_at_rest

   !> The same where the noise keeps its weights without damping.
   pure real(wp) function temperature_of_weights(scheme, z) result(ratio)
      type(scheme_type), intent(in) :: scheme   !! a scheme that runs with damping
      real(wp), intent(in) :: z                 !! gamma h > 0
      real(wp) :: w(size(scheme%c), 3)          ! weights of dW, a and K in each node

      if (scheme%frame == frame_shift) then
         ! p receives exp(-z/2) dW - z a, with Var a = h/12.
         ratio = (exp(-z) + z**2/12)*2*z/(1 - exp(-2*z))
         return
      end if
      w = 0
      if (allocated(scheme%kicks%beta)) then
         w(:, 1) = scheme%kicks%beta
         w(:, 2) = scheme%kicks%gamma
         w(:, 3) = scheme%kicks%eta
      else
         w(:, 1) = scheme%beta
      end if
      ratio = free_temperature(scheme%c, w, z)
   end function temperature_of_weights

end module symsde_scheme_damped
