! SPDX-License-Identifier: BSD-3-Clause
!> Rates of damping that are functions of position and time, gamma_i(q, t) [1/time].
!>
!> A user's function extends rate_type, as a model extends model_type: it says in its components what the rates
!> depend on, and gives `find`. Each lane must be computed from its own numbers alone; several threads call at once.
module symsde_base_rates
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: rate_type

   !> Immutable once constructed, as a model is.
   type, abstract :: rate_type
      logical :: one = .true.           !! one rate for all momenta, else one for each
      logical :: of_position = .true.   !! whether rates depend on q
      logical :: of_time = .true.       !! whether rates depend on t
   contains
      procedure(find_interface), deferred :: find
   end type rate_type

   abstract interface
      !> The rates at (q, t).
      subroutine find_interface(self, nlane, ndof, nrate, t, q, rate, code)
         import :: rate_type, wp
         class(rate_type), intent(in) :: self
         integer, intent(in) :: nlane, ndof
         integer, intent(in) :: nrate                    !! number of rates: 1 if `one`, else ndof
         real(wp), intent(in) :: t                       !! time [time]
         real(wp), intent(in) :: q(nlane, ndof)
         real(wp), intent(out) :: rate(nlane, nrate)     !! [1/time]
         integer, intent(out) :: code                    !! 0, or the reason for a refusal, which ends the run
      end subroutine find_interface
   end interface

end module symsde_base_rates
