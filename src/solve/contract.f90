! SPDX-License-Identifier: BSD-3-Clause
!> The contract of solvers: linear systems of a block (solve/blocks) and Newton's iteration (solve/newton).
!>
!> Required: systems have rows and a diagonal, and statuses are codes that a path can have. Matrices and right-hand
!> sides need not be finite: a lane that is not finite gets a status. Promised: statuses stay such codes, and solutions
!> are finite in lanes that were solved and have no status.
module symsde_solve_contract
   use symsde_base_contracts, only: require, require_statuses, require_finite_lanes
   use symsde_base_kinds, only: wp, i8
   implicit none
   private
   public :: require_system, require_solved

contains

   !> Requirements when a solver is made.
   pure subroutine require_system(nlane, n, kl, ku)
      integer, intent(in) :: nlane, n
      integer, intent(in) :: kl, ku   !! diagonals below and above the main one; kl < 0: dense

      call require(nlane >= 1 .and. n >= 1, 'solve, new solver', 'there are lanes and unknowns')
      call require(kl < 0 .or. ku >= 0, 'solve, new solver', 'a banded matrix has its main diagonal')
   end subroutine require_system

   !> Promises of a solver to its callers.
   subroutine require_solved(nlane, n, status, x, place, active)
      integer, intent(in) :: nlane, n
      integer(i8), intent(in) :: status(nlane)
      real(wp), intent(in) :: x(nlane, n)
      character(*), intent(in) :: place                  !! area and procedure
      logical, intent(in), optional :: active(nlane)     !! lanes that were to be solved; all if absent
      integer(i8) :: looked(nlane)

      call require_statuses(nlane, status, place)
      looked = status
      if (present(active)) where (.not. active) looked = 1
      call require_finite_lanes(nlane, n, looked, x, place, 'solutions')
   end subroutine require_solved

end module symsde_solve_contract
