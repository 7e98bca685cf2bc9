! SPDX-License-Identifier: BSD-3-Clause
!> The maps from (q, p) to (q', p') in one step, as equations, by which a stepper asks a model for whole steps. With
!> Hhat = h H + sum_k dW_k H_k:
!>
!>    euler_map, euler_adjoint_map     p' = p - Hhat_q(q, p'),  q' = q + Hhat_p(q, p'), and the same with (q', p)
!>    verlet_map, verlet_swapped_map   half of Hhat_q, Hhat_p, half of Hhat_q, as a tableau; half of Hhat_p first
!>    midpoint_map, gauss2_map ..      collocation at 1 to 4 nodes of Gauss
!>    lobatto3_map ..                  the pair of Lobatto IIIA for q and IIIB for p, of 3 and 4 nodes; or swapped
!>    gauss2_brackets_map              gauss2_map of Hhat with brackets of the H_j added to it
!>
!> For H = p.p/2 + U(q) with noise in position: drifts q + tau p with kicks p - b (h U_q + (..) H_k,q) between them,
!> where (..) is the kick's part of dW_k and of dZ_k. Some maps add H_k,q.H_k,q, whose gradient vanishes for additive
!> noise.
!>
!>    drift_kick_drift_map             one kick by dW_k alone
!>    kick_drift_kick_map              kicks at the ends of a step
!>    two_kicks_map                    kicks at both nodes of Gauss, drifts around and between them
!>    two_kicks_rotation_map           the same, with rotations by (p.p + q.q)/2 in the place of drifts
!>    force_gradient_map               kicks at both ends and between, which also follows the gradient of V_q.V_q
!>
!> If the model is damped, momenta decay in these maps as base/record describes.
module symsde_base_maps
   use symsde_base_text, only: name_length
   implicit none
   private
   public :: step_map, same_map
   public :: other_map, euler_map, euler_adjoint_map, verlet_map, verlet_swapped_map, midpoint_map, gauss2_map
   public :: gauss3_map, gauss4_map, lobatto3_map, lobatto3_swapped_map, lobatto4_map, lobatto4_swapped_map
   public :: gauss2_brackets_map, drift_kick_drift_map, kick_drift_kick_map, two_kicks_map, two_kicks_rotation_map
   public :: force_gradient_map

   enum, bind(c)
      enumerator :: other_map = 0, euler_map, euler_adjoint_map, verlet_map, verlet_swapped_map
      enumerator :: midpoint_map, gauss2_map, gauss3_map, gauss4_map
      enumerator :: lobatto3_map, lobatto3_swapped_map, lobatto4_map, lobatto4_swapped_map
      enumerator :: gauss2_brackets_map
      enumerator :: drift_kick_drift_map, kick_drift_kick_map, two_kicks_map, two_kicks_rotation_map, force_gradient_map
   end enum

   !> A map. The library's models know its equation; a user's model keeps functions by any label.
   type :: step_map
      integer :: equation = other_map
      logical :: corrected = .false.              !! corrected Euler pair: with +-F_p.F_q/2 added, F = sum_k dW_k H_k
      logical :: damped = .false.                 !! whether one rate damps the momenta
      logical :: products = .false.               !! whether the scheme adds H_k,q.H_k,q, sampled, to these kicks
      character(len=2*name_length) :: label = ''  !! name in messages; distinguishes maps with other equations
   end type step_map

contains

   !> Whether two maps have the same label, correction and damping.
   pure logical function same_map(a, b)
      type(step_map), intent(in) :: a, b

      same_map = a%label == b%label .and. (a%corrected .eqv. b%corrected) .and. (a%damped .eqv. b%damped)
   end function same_map

end module symsde_base_maps
