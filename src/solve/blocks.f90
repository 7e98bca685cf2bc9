! SPDX-License-Identifier: BSD-3-Clause
!> The linear systems of a block, one per lane, A x = b: eliminated across lanes, or lane by lane with exchanges of
!> rows.
!>
!>    one or two unknowns, dense      closed form (solve/elimination)
!>    dense up to max_lane_unknowns   A = L U without pivoting, strips of lanes at once (solve/elimination)
!>    banded                          likewise by bands (solve/banded)
!>    all others                      lane by lane, with exchanges of rows (solve/one_system)
!>
!> A lane whose pivots are not trusted is solved again, with exchanges of rows, from the same matrix, which elimination
!> across lanes does not change. The choice for a lane depends on its own numbers alone.
module symsde_solve_blocks
   use symsde_base_contracts, only: contracts_are_executed, require_statuses
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: status_ok
   use symsde_solve_banded, only: solve_banded_strip
   use symsde_solve_contract, only: require_system, require_solved
   use symsde_solve_elimination, only: solve_lanes, solve_strip, strip_lanes
   use symsde_solve_one_system, only: lapack_takes, solve_banded_lane, solve_lane
   implicit none
   private
   public :: block_solver, new_block_solver, solve_block, max_lane_unknowns, pivot_floor

   !> Dense systems up to this size are eliminated across lanes. At 32 unknowns that takes a third
   !> of LAPACK's time (2.1 against 6.0 microseconds, AVX-512, OpenBLAS), at 8 a tenth.
   integer, parameter :: max_lane_unknowns = 32

   !> Lanes whose pivot monitor is not above pivot_floor are solved with exchanges of rows. Other lanes lose at most
   !> three of sixteen digits in a solve, and the next Newton iteration restores them.
   real(wp), parameter :: pivot_floor = 1.0e-3_wp

   !> Solver for the systems of one block, with its work arrays.
   type :: block_solver
      integer :: nlane = 0                        !! lanes of the block
      integer :: n = 0                            !! unknowns of a system
      integer :: kl = -1                          !! diagonals below the main one; < 0: dense
      integer :: ku = -1                          !! diagonals above the main one
      integer :: rows = 0                         !! n, or kl+ku+1: middle extent of the matrices
      integer(i8) :: pivoted_solves = 0           !! systems solved with exchanges of rows so far
      integer(i8) :: lapack_solves = 0            !! systems of these that LAPACK solved
      integer :: width = 0                        !! lanes eliminated together
      real(wp), allocatable :: smallest(:)        !! (nlane) pivot monitor
      real(wp), allocatable :: rhs(:, :)          !! (nlane,n) right-hand sides
      real(wp), allocatable :: strip(:, :, :)     !! (width,rows,n) matrices of a strip
      real(wp), allocatable :: part(:, :)         !! (width,n) right-hand sides of a strip
   contains
      procedure :: solve => solve_block
   end type block_solver

contains

   !> Set up a solver for blocks of one shape; a second call on the same solver sets it up again.
   subroutine new_block_solver(self, nlane, n, kl, ku)
      type(block_solver), intent(out) :: self
      integer, intent(in) :: nlane  !! lanes of the block, a multiple of 8
      integer, intent(in) :: n      !! unknowns of a system, >= 1
      integer, intent(in) :: kl     !! diagonals below the main one; < 0: dense matrices
      integer, intent(in) :: ku     !! diagonals above the main one; not used if dense

      if (contracts_are_executed) call require_system(nlane, n, kl, ku)
      self%nlane = nlane
      self%n = n
      self%rows = n
      if (kl >= 0) then
         self%kl = kl
         self%ku = ku
         self%rows = kl + ku + 1
      end if
      ! The number of lanes whose matrices fit into cache; results do not depend on it.
      self%width = strip_lanes(nlane, self%rows*n)
      allocate (self%smallest(nlane), source=0.0_wp)
      allocate (self%rhs(nlane, n))
      ! Closed forms and large systems use no strips.
      if (closed_form(self) .or. too_large(self)) return
      allocate (self%strip(self%width, self%rows, n), self%part(self%width, n))
   end subroutine new_block_solver

   !> Solve the systems of all active lanes. Dense: a(nlane, n, n). Banded: a(nlane, -kl:ku, n) with a(lane, d, i) =
   !> A(i, i+d). Lanes that fail get their status and the solution zero, so that an update by it changes nothing.
   !> Other lanes keep their status. In lanes that are not active x is undefined, and no exchange of rows is tried.
   subroutine solve_block(self, a, x, active, status)
      class(block_solver), intent(inout) :: self
      real(wp), intent(in) :: a(self%nlane, self%rows, self%n)  !! matrices, kept
      real(wp), intent(inout) :: x(self%nlane, self%n)          !! right-hand sides, then solutions
      logical, intent(in) :: active(self%nlane)                 !! lanes to solve
      integer(i8), intent(inout) :: status(self%nlane)          !! set to singular or nonfinite
      integer :: nactive, nsuspect

      if (contracts_are_executed) call require_statuses(self%nlane, status, 'solve, block')
      nactive = count(active)
      if (nactive == 0) return
      ! With a monitor of zero, every active lane is solved by itself.
      if (too_large(self)) then
         self%smallest = 0
         call solve_suspects(self, a, x, active, status)
      else
         ! Elimination replaces right-hand sides by solutions, and the right-hand sides may be needed again; matrices
         ! are kept.
         self%rhs(:, :) = x
         call eliminate(self, a, x, active)
         call find_suspects(self%nlane, self%n, x, active, self%smallest, nsuspect)
         if (nsuspect > 0) call solve_suspects(self, a, x, active, status)
      end if
      if (contracts_are_executed) call require_solved(self%nlane, self%n, status, x, 'solve, block', active)
   end subroutine solve_block

   !> Whether the systems are dense and of one or two unknowns, which have a closed form and need no strips.
   pure logical function closed_form(self)
      type(block_solver), intent(in) :: self

      closed_form = self%kl < 0 .and. self%n <= 2
   end function closed_form

   !> Whether the systems are dense and too large to be eliminated across lanes.
   pure logical function too_large(self)
      type(block_solver), intent(in) :: self

      too_large = self%kl < 0 .and. self%n > max_lane_unknowns
   end function too_large

   !> Eliminate across lanes, strip by strip; strips without an active lane are skipped. A strip is copied, so that it
   !> stays in cache while its n^2 entries are read n times.
   subroutine eliminate(self, a, x, active)
      type(block_solver), intent(inout) :: self
      real(wp), intent(in) :: a(self%nlane, self%rows, self%n)  !! matrices
      real(wp), intent(inout) :: x(self%nlane, self%n)          !! right-hand sides, then solutions
      logical, intent(in) :: active(self%nlane)                 !! lanes to solve
      integer :: first, width

      if (closed_form(self)) then
         ! Solve all lanes at once, active or not.
         call solve_lanes(self%nlane, self%n, a, x, self%smallest)
         return
      end if
      do first = 1, self%nlane, self%width
         width = min(self%width, self%nlane - first + 1)
         ! A strip is eliminated as a whole if it has an active lane; results of other lanes are not used.
         if (.not. any(active(first:first + width - 1))) cycle
         if (self%kl < 0) then
            call solve_strip(self%nlane, self%n, first, width, a, x, self%smallest, &
                             self%strip, self%part)
         else
            call solve_banded_strip(self%nlane, self%n, self%kl, self%ku, first, width, a, x, &
                                    self%smallest, self%strip, self%part)
         end if
      end do
   end subroutine eliminate

   !> Count the active lanes whose pivots are not trusted or whose solution is not finite. The latter get the
   !> monitor 0, so that the monitor alone tells which lanes are solved again.
   subroutine find_suspects(nlane, n, x, active, smallest, nsuspect)
      integer, intent(in) :: nlane                !! lanes of the block
      integer, intent(in) :: n                    !! unknowns of a system
      real(wp), intent(in) :: x(nlane, n)         !! solutions
      logical, intent(in) :: active(nlane)        !! lanes to solve
      real(wp), intent(inout) :: smallest(nlane)  !! pivot monitor
      integer, intent(out) :: nsuspect            !! lanes to solve by themselves
      integer :: lane, i

      do i = 1, n
         do lane = 1, nlane
            ! A solution that is not finite gets the monitor 0.
            smallest(lane) = merge(smallest(lane), 0.0_wp, abs(x(lane, i)) <= huge(1.0_wp))
         end do
      end do
      nsuspect = 0
      do lane = 1, nlane
         nsuspect = nsuspect + merge(1, 0, active(lane) .and. smallest(lane) <= pivot_floor)
      end do
   end subroutine find_suspects

   !> Solve the active lanes with a small pivot monitor one by one with exchanges of rows, from their original
   !> matrices and right-hand sides. A lane that fails here gets its status and the solution zero.
   subroutine solve_suspects(self, a, x, active, status)
      type(block_solver), intent(inout) :: self
      real(wp), intent(in) :: a(self%nlane, self%rows, self%n)  !! matrices
      real(wp), intent(inout) :: x(self%nlane, self%n)          !! right-hand sides, then solutions
      logical, intent(in) :: active(self%nlane)                 !! lanes to solve
      integer(i8), intent(inout) :: status(self%nlane)          !! set if a solve fails
      integer(i4) :: info
      integer :: lane

      do lane = 1, self%nlane
         if (.not. active(lane) .or. self%smallest(lane) > pivot_floor) cycle
         ! Elimination has overwritten x; large systems were not eliminated, and x is still their right-hand side.
         if (.not. too_large(self)) x(lane, :) = self%rhs(lane, :)
         if (self%kl < 0) then
            call solve_lane(self%nlane, self%n, lane, a, x, info)
            if (lapack_takes(self%n)) self%lapack_solves = self%lapack_solves + 1
         else
            call solve_banded_lane(self%nlane, self%n, self%kl, self%ku, lane, a, x, info)
         end if
         ! Counted whether it succeeds or not, for reports.
         self%pivoted_solves = self%pivoted_solves + 1
         ! Exchanges of rows did not help: the matrix is singular, or a number is not finite.
         if (info == status_ok) cycle
         status(lane) = info
         x(lane, :) = 0
      end do
   end subroutine solve_suspects

end module symsde_solve_blocks
