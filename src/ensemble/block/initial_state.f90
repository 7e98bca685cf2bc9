! SPDX-License-Identifier: BSD-3-Clause
!> The initial states of the paths of a run: the caller's arrays, as one argument for all threads.
!>
!> Arrays of one row give all paths the same state. A block takes rows offset + 1 .. offset + nreal, one to a lane, and
!> repeats its last row in every lane of padding, since the model is evaluated there, too. Padding has the status
!> `stopped`, so nothing is solved for it.
!>
!> Low parts resume compensated runs; statuses continue runs in which some paths failed or were stopped; both are null
!> unless given. Absent arrays are not passed to a parallel region: gfortran would compute their extents from arbitrary
!> memory.
module symsde_ensemble_block_initial_state
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: stopped
   use symsde_step_block_state, only: lane_state
   implicit none
   private
   public :: initial_state

   type :: initial_state
      real(wp), pointer :: q(:, :) => null(), p(:, :) => null()          !! (npath or 1, ndof)
      real(wp), pointer :: q_low(:, :) => null(), p_low(:, :) => null()  !! (npath or 1, ndof), or null
      integer(i4), pointer :: status(:) => null()       !! 0, or a code of base/status (npath), or null
      integer(i8), pointer :: failed_step(:) => null()  !! step in which a path failed or was stopped, -1 = none (npath)
      logical :: resumed = .false.    !! resume a stopped drive: paths that are ok have ended
   contains
      procedure :: give
   end type initial_state

contains

   !> Load the initial state of a block into its lanes s, with given statuses and low parts, else with status ok and low
   !> parts zero; lanes beyond its last path repeat that path. `step` is changed if a stopped drive is resumed.
   subroutine give(self, offset, nreal, last, step, s)
      class(initial_state), intent(in) :: self
      integer(i8), intent(in) :: offset     !! paths of the run before this block
      integer, intent(in) :: nreal          !! paths of the block
      integer(i8), intent(in) :: last       !! step at which the drive ends
      integer(i8), intent(inout) :: step    !! next step
      type(lane_state), intent(inout) :: s

      s%status = 0
      s%failed_step = -1
      if (associated(self%status)) call give_statuses(self, offset, nreal, last, step, s)
      s%status(nreal + 1:) = stopped  ! padding is neither solved nor counted
      ! Padding has a step, too: a lane with a status and no step would count as a failure of the next step.
      s%failed_step(nreal + 1:) = step
      s%nfailed = count(s%status /= 0)
      call load(self%q, offset, nreal, s%q)
      call load(self%p, offset, nreal, s%p)
      ! Runs without compensated sums have no low parts.
      if (.not. allocated(s%q_low)) return
      s%q_low = 0
      s%p_low = 0
      if (associated(self%q_low)) call load(self%q_low, offset, nreal, s%q_low)
      if (associated(self%p_low)) call load(self%p_low, offset, nreal, s%p_low)
   end subroutine give

   !> Load the statuses of paths that were run before. Failed paths stay failed. If a drive is resumed, stopped paths go
   !> on: all of a block were stopped before the same step, which comes next. A block without stopped paths is done; its
   !> `step` is set to the end.
   subroutine give_statuses(self, offset, nreal, last, step, s)
      type(initial_state), intent(in) :: self
      integer(i8), intent(in) :: offset, last
      integer, intent(in) :: nreal
      integer(i8), intent(inout) :: step
      type(lane_state), intent(inout) :: s
      integer :: lane

      s%status(:nreal) = self%status(offset + 1:offset + nreal)
      s%failed_step(:nreal) = self%failed_step(offset + 1:offset + nreal)
      ! Unless a stopped path is found, the block is done.
      if (self%resumed) step = last
      do lane = 1, nreal
         if (s%status(lane) /= stopped) cycle
         step = s%failed_step(lane)
         s%status(lane) = 0
         s%failed_step(lane) = -1
      end do
   end subroutine give_statuses

   !> Copy rows offset+1 .. offset+nreal of x0 (npath, ndof), or its only row, into lanes x (nlane, ndof); padding
   !> repeats the last.
   pure subroutine load(x0, offset, nreal, x)
      real(wp), intent(in) :: x0(:, :)
      integer(i8), intent(in) :: offset
      integer, intent(in) :: nreal
      real(wp), intent(out), contiguous :: x(:, :)
      integer :: lane, i

      do i = 1, size(x, 2)
         if (size(x0, 1) == 1) then
            x(:, i) = x0(1, i)
         else
            do lane = 1, size(x, 1)
               x(lane, i) = x0(offset + min(lane, nreal), i)
            end do
         end if
      end do
   end subroutine load

end module symsde_ensemble_block_initial_state
