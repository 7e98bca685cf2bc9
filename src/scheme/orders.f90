! SPDX-License-Identifier: BSD-3-Clause
!>    strong   (E |x_N - x(T)|^2)^(1/2) <= C h^order,          weak   |E f(x_N) - E f(x(T))| <= C h^order
!>
!> Orders of convergence and their evidence: order conditions that the coefficients meet, a claim, a measurement.
!>
!> A derived order is computed from the coefficients that the stepper executes. A claimed order is stated by the author
!> of a scheme, or of this library, by arguments that no program here checks. Either may also have been measured
!> (scheme/measured): a slope with its 95 % half-width on one problem, and the ratio of the reference's error to the
!> smallest error that counts.
module symsde_scheme_orders
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: order_type, set_order
   public :: additive_noise, commutative_noise, general_noise, commuting_flows, weak_order, norder, order_names
   public :: evidence_none, evidence_claimed, evidence_derived, evidence_text

   enum, bind(c)
      enumerator :: additive_noise = 1     !! strong, every H_k linear
      enumerator :: commutative_noise = 2  !! strong, one noise, or every {H_k,H_l} constant
      enumerator :: general_noise = 3      !! strong
      enumerator :: commuting_flows = 4    !! strong, every {H,H_k} constant as well (Kubo oscillator)
      enumerator :: weak_order = 5         !! weak, commutative noise
   end enum
   ! The strong classes are nested: additive noises commute, and commuting flows are commutative noises.
   integer, parameter :: norder = 5
   character(len=15), parameter :: order_names(norder) = ['additive noise ', 'commutative    ', 'general        ', &
                                                          'commuting flows', 'weak           ']
   enum, bind(c)
      enumerator :: evidence_none = 0      !! no order: the scheme diverges, or is not made for such noise
      enumerator :: evidence_claimed = 1
      enumerator :: evidence_derived = 2   !! derived from the coefficients
   end enum

   type :: order_type
      real(wp) :: value = 0                  !! 0 = none
      integer :: evidence = evidence_none    !! evidence of the value
      character(len=26) :: problem = ''      !! problem of the measurement; blank = not measured
      real(wp) :: measured = 0               !! the slope of the error over the step
      real(wp) :: half_width = 0             !! half-width of the 95 % interval
      real(wp) :: floor = 0                  !! error of the reference over the smallest error that counts
   end type order_type

contains

   !> Set an order and its evidence; a value of zero has no evidence.
   pure subroutine set_order(order, value, evidence)
      type(order_type), intent(inout) :: order
      real(wp), intent(in) :: value
      integer, intent(in) :: evidence

      ! A scheme that does not converge has order zero, and claims nothing.
      order%value = value
      order%evidence = merge(evidence, evidence_none, value > 0)
   end subroutine set_order

   !> The certificate's word for the evidence of an order.
   pure function evidence_text(evidence) result(text)
      integer, intent(in) :: evidence
      character(len=merge(7, merge(7, 4, evidence == evidence_derived), evidence == evidence_claimed)) :: text

      text = 'none'
      if (evidence == evidence_claimed) text = 'claimed'
      if (evidence == evidence_derived) text = 'derived'
   end function evidence_text

end module symsde_scheme_orders
