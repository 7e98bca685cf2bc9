! SPDX-License-Identifier: BSD-3-Clause
!> Contracts, executed: requirements of a family of procedures on its callers, and its promises.
!>
!> The file contract.f90 of each area of src states requirements and promises of the area; they are called as
!>
!>    if (contracts_are_executed) call require_request(..)
!>
!> The presets dev and sanitize compile a copy of this file in which the constant is true (CMakeLists.txt beside it).
!> Everywhere else it is false, and compilers leave such lines out.
!>
!> Mistakes of users are refused with an error before any contract is reached. A broken contract is a defect of the
!> library or of the contract, and ends the program with a message: contract of PLACE broken: SENTENCE
module symsde_base_contracts
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: status_ok, stopped, absorbed
   implicit none
   private
   public :: contracts_are_executed, require, require_finite, require_finite_lanes, require_padded, require_statuses

   logical, parameter :: contracts_are_executed = .false.

contains

   !> The condition must hold.
   pure subroutine require(holds, place, sentence)
      logical, intent(in) :: holds
      character(*), intent(in) :: place      !! area and procedure
      character(*), intent(in) :: sentence   !! the condition in words

      if (.not. holds) error stop 'contract of '//place//' broken: '//sentence
   end subroutine require

   !> All n numbers must be finite.
   pure subroutine require_finite(n, x, place, what)
      integer, intent(in) :: n
      real(wp), intent(in) :: x(n)
      character(*), intent(in) :: place, what

      call require(count(abs(x) <= huge(x)) == n, place, what//' are finite')
   end subroutine require_finite

   !> The n numbers of every lane without a status must be finite; other lanes may hold anything.
   pure subroutine require_finite_lanes(nlane, n, status, x, place, what)
      integer, intent(in) :: nlane, n
      integer(i8), intent(in) :: status(nlane)
      real(wp), intent(in) :: x(nlane, n)
      character(*), intent(in) :: place, what
      integer :: i

      do i = 1, n
         call require(all(abs(x(:, i)) <= huge(x) .or. status /= 0), place, &
                      what//' are finite in lanes without a status')
      end do
   end subroutine require_finite_lanes

   !> Lanes beyond nreal must repeat lane nreal, bit for bit.
   pure subroutine require_padded(nlane, nreal, n, x, place, what)
      integer, intent(in) :: nlane, nreal, n
      real(wp), intent(in) :: x(nlane, n)
      character(*), intent(in) :: place, what
      integer :: i, lane

      do i = 1, n
         do lane = nreal + 1, nlane
            call require(transfer(x(lane, i), 0_i8) == transfer(x(nreal, i), 0_i8), place, &
                         what//' of padding repeat those of the last real lane')
         end do
      end do
   end subroutine require_padded

   !> Every lane must have a lane's status: ok, or one of the numerical outcomes of base/status that a path can have.
   pure subroutine require_statuses(nlane, status, place)
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: status(nlane)
      character(*), intent(in) :: place

      call require(all((status >= status_ok .and. status <= stopped) .or. status == absorbed), place, &
                   'statuses of lanes are codes that a path can have')
   end subroutine require_statuses

end module symsde_base_contracts
