! SPDX-License-Identifier: BSD-3-Clause
!> Where the paths of a run begin: the caller's arrays, as one argument for all threads.
!>
!> Arrays of one row give all paths the same state. A block takes rows offset + 1 .. offset + nreal, one to a lane, and
!> its last row once more for every lane of padding: a lane must hold some state that the model can be asked about.
!> Padding has the status `stopped`, so nothing is solved for it.
!>
!> Low parts are there to resume compensated runs, statuses to go on with paths of which some failed or were stopped;
!> null where not given. An absent array is not handed to a parallel region: gfortran computes the extents of such an
!> argument from what happens to lie in memory.
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
      logical :: resumed = .false.    !! a stopped drive goes on, and paths that are ok are done
   contains
      procedure :: give
   end type initial_state

contains

   !> Load the initial state of a block into its lanes s, with statuses and low parts where they are given, else
   !> status ok and low parts zero; lanes past its last path repeat that path. `step` is changed where a stopped drive
   !> goes on.
   subroutine give(self, offset, nreal, last, step, s)
      class(initial_state), intent(in) :: self
      integer(i8), intent(in) :: offset     !! paths of the run before this block
      integer, intent(in) :: nreal          !! paths of the block
      integer(i8), intent(in) :: last       !! step with which the drive ends
      integer(i8), intent(inout) :: step    !! that comes next
      type(lane_state), intent(inout) :: s

      s%status = 0
      s%failed_step = -1
      if (associated(self%status)) call give_statuses(self, offset, nreal, last, step, s)
      s%status(nreal + 1:) = stopped  ! padding: nothing is solved for it, nothing counted
      ! Padding has a step, too: a lane with a status and no step would count as a failure of the present step.
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

   !> Statuses of paths that have been run before. Failed paths stay failed. Where a drive is resumed, stopped paths
   !> go on: all of a block were stopped in the same step, which comes next. A block without stopped paths is done;
   !> its `step` is set past the last one.
   subroutine give_statuses(self, offset, nreal, last, step, s)
      type(initial_state), intent(in) :: self
      integer(i8), intent(in) :: offset, last
      integer, intent(in) :: nreal
      integer(i8), intent(inout) :: step
      type(lane_state), intent(inout) :: s
      integer :: lane

      s%status(:nreal) = self%status(offset + 1:offset + nreal)
      s%failed_step(:nreal) = self%failed_step(offset + 1:offset + nreal)
      ! Unless some path is found that was stopped, the block is done.
      if (self%resumed) step = last
      do lane = 1, nreal
         if (s%status(lane) /= stopped) cycle
         step = s%failed_step(lane)
         s%status(lane) = 0
         s%failed_step(lane) = -1
      end do
   end subroutine give_statuses

   !> Copy rows offset+1 .. offset+nreal of x0 (npath, ndof), or its only row, into lanes x (nlane, ndof), the last
   !> one into the padding.
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
