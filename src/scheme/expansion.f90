! SPDX-License-Identifier: BSD-3-Clause
!> Schemes beyond strong order one, and weak schemes: a symplectic tableau applied to a modified Hamiltonian of the
!> step, with the law of increments that the order needs (docs/method/beyond-order-one.md).
!>
!>    gauss2_strong32         with dZ: strong 3/2 for commutative noises
!>    midpoint_areas          with areas: strong 1 for every noise
!>    gauss2_strong32_areas   with both: strong 3/2 for commutative noises, 1 for other noises
!>    gauss2_weak2            three-point increments: weak 2 for commutative noises
!>    gauss2_weak2_areas      with two-point areas, too: weak 2 for every noise
!>    midpoint_weak1          two-point increments, nothing added: weak 1
module symsde_scheme_expansion
   use symsde_base_functionals, only: functionals, path_dz, path_areas
   use symsde_base_kinds, only: wp
   use symsde_base_laws, only: law_gaussian, law_three_point, law_two_point
   use symsde_scheme_orders, only: set_order, evidence_none, evidence_claimed, additive_noise, commutative_noise, &
                                   general_noise, commuting_flows, weak_order
   use symsde_scheme_scheme, only: scheme_type, bracket_terms
   implicit none
   private
   public :: expand_scheme

contains

   !> The plain scheme under an expanded name: gauss2 or midpoint.
   pure function base_of(name) result(base)
      character(*), intent(in) :: name   !! one of the six names of expanded schemes
      character(len=index(name, '_') - 1) :: base

      base = name
   end function base_of

   !> Turn the plain scheme, gauss2 or midpoint, into the expanded scheme of this name: brackets, law, orders.
   !>
   !> Orders are those of the truncated logarithm of the flow (Castell 1993, adapted): dZ and the nested
   !> bracket leave a local error of size h^2 for commutative noises, areas alone one of size h^(3/2) with
   !> mean h^2. The mean of the flow with three-point increments and areas +-h/2 is that of the equation to h^2
   !> (docs/method/weak.md). Brackets of commuting Hamiltonians vanish: such flows keep the order of the plain scheme.
   !> A function that commutes with every H_j commutes with their brackets, too: quadratic invariants are kept.
   pure subroutine expand_scheme(scheme, name)
      type(scheme_type), intent(inout) :: scheme
      character(*), intent(in) :: name   !! one of the six names

      select case (name)
      case ('gauss2_strong32')
         scheme%asks = functionals([path_dz])
         scheme%brackets = bracket_terms(single=.true., nested=.true.)
         call declare(scheme, law_gaussian, 1.5_wp, 0.5_wp, 2.0_wp)
      case ('gauss2_strong32_areas')
         scheme%asks = functionals([path_dz, path_areas])
         scheme%brackets = bracket_terms(single=.true., areas=.true., nested=.true.)
         call declare(scheme, law_gaussian, 1.5_wp, 1.0_wp, 2.0_wp)
      case ('midpoint_areas')
         scheme%asks = functionals([path_areas])
         scheme%brackets = bracket_terms(areas=.true.)
         call declare(scheme, law_gaussian, 1.0_wp, 1.0_wp, 1.0_wp)
      case ('gauss2_weak2')
         scheme%brackets = bracket_terms(nested=.true.)
         call declare(scheme, law_three_point, 0.0_wp, 0.0_wp, 2.0_wp)
      case ('gauss2_weak2_areas')
         scheme%asks = functionals([path_areas])
         scheme%brackets = bracket_terms(areas=.true., nested=.true., crossed=.true.)
         call declare(scheme, law_three_point, 0.0_wp, 0.0_wp, 2.0_wp)
      case ('midpoint_weak1')
         call declare(scheme, law_two_point, 0.0_wp, 0.0_wp, 1.0_wp)
      case default  ! not an expanded scheme: leave the base unchanged
      end select
      scheme%reference = 'modified one-step Hamiltonian on '//base_of(name)//' (log-ODE; Castell 1993)'
      if (scheme%law /= law_gaussian) then
         call set_order(scheme%order(commuting_flows), 0.0_wp, evidence_none)
         scheme%reference = 'weak scheme on '//base_of(name)//', derived in docs/method/weak.md'
      end if
   end subroutine expand_scheme

   pure subroutine declare(scheme, law, commutative, general, weak)
      type(scheme_type), intent(inout) :: scheme
      integer, intent(in) :: law
      real(wp), intent(in) :: commutative, general  !! strong orders
      real(wp), intent(in) :: weak                  !! weak order for commutative noises; if crossed, for all noises

      scheme%law = law
      call set_order(scheme%order(additive_noise), commutative, evidence_claimed)
      call set_order(scheme%order(commutative_noise), commutative, evidence_claimed)
      call set_order(scheme%order(general_noise), general, evidence_claimed)
      call set_order(scheme%order(weak_order), weak, evidence_claimed)
      scheme%sharp = commutative > 0
   end subroutine declare

end module symsde_scheme_expansion
