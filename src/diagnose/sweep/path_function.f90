! SPDX-License-Identifier: BSD-3-Clause
!> A function f of the path, whose mean is differentiated: its values and its derivatives by the saved states.
module symsde_diagnose_sweep_path_function
   use symsde_base_kinds, only: wp, i8
   implicit none
   private
   public :: path_function

   !> All threads call one object, which is therefore intent(in).
   type, abstract :: path_function
   contains
      procedure(find_interface), deferred :: find
      procedure :: failure_code => never_failed
   end type path_function

   abstract interface
      !> Values and derivatives for some paths at once. A path whose value is not finite has failed.
      subroutine find_interface(self, first, nlane, ndof, ntime, nparameter, t, q, p, value, fq, fp, ftheta)
         import :: path_function, wp, i8
         class(path_function), intent(in) :: self
         integer(i8), intent(in) :: first                       !! global index of the first of these paths
         integer, intent(in) :: nlane, ndof, ntime, nparameter
         real(wp), intent(in) :: t(ntime)                       !! saved times, the first is the beginning
         real(wp), intent(in) :: q(nlane, ndof, ntime), p(nlane, ndof, ntime)
         real(wp), intent(out) :: value(nlane)
         real(wp), intent(out) :: fq(nlane, ndof, ntime), fp(nlane, ndof, ntime)  !! df/dq, df/dp
         real(wp), intent(out) :: ftheta(nlane, nparameter)     !! df/dtheta where f holds parameters itself
      end subroutine find_interface
   end interface

contains

   !> Nonzero if the function refused once.
   integer function never_failed(self) result(code)
      class(path_function), intent(in) :: self

      code = 0
   end function never_failed

end module symsde_diagnose_sweep_path_function
