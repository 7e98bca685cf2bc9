! SPDX-License-Identifier: BSD-3-Clause
!> Whether paths of a block have grown beyond all bounds, as those of an unstable step do.
!>
!> A path has grown if at the end its largest |q_i| and its largest |p_i| both exceed `factor` times the largest values
!> that they had at the start and after a tenth of the steps. So units do not matter, and a path at rest at the start is
!> compared with where noise or a force has moved it. States are compared three times in a run and never inside a step:
!> growth by the step continues to the end. Runs of fewer than ten steps are not checked.
!>
!> Private to its family.
module symsde_ensemble_block_growth
   use symsde_base_kinds, only: wp, i8
   use symsde_step_block_state, only: lane_state
   implicit none
   private
   public :: growth_type

   real(wp), parameter :: factor = 1e6_wp

   type :: growth_type
      integer(i8) :: look = -1                           !! the state is compared before this absolute step; -1 = none
      real(wp), allocatable, private :: largest(:, :)    !! largest |q_i| and |p_i| so far (nlane, 2)
   contains
      procedure :: begin
      procedure :: note
      procedure :: take_lanes
      procedure :: count_grown
   end type growth_type

contains

   !> Begin a block with this state, before step number `first` of the run; nstep steps are to come.
   subroutine begin(self, first, nstep, state)
      class(growth_type), intent(inout) :: self
      integer(i8), intent(in) :: first, nstep
      type(lane_state), intent(in) :: state

      self%look = -1
      if (nstep < 10) return
      self%look = first + (nstep + 9)/10
      if (.not. allocated(self%largest)) allocate (self%largest(state%nlane, 2))
      self%largest = 0
      call self%note(state)
   end subroutine begin

   !> Update the largest |q_i| and |p_i| so far by those of this state.
   subroutine note(self, state)
      class(growth_type), intent(inout) :: self
      type(lane_state), intent(in) :: state

      call widen(state%nlane, state%ndof, state%q, self%largest(:, 1))
      call widen(state%nlane, state%ndof, state%p, self%largest(:, 2))
   end subroutine note

   !> Take in the largest values of a narrower block, if it has noted any: lane origin(l) of this block keeps the larger
   !> of its own value and the value of lane l of the narrower block.
   subroutine take_lanes(self, other, origin)
      class(growth_type), intent(inout) :: self
      type(growth_type), intent(in) :: other
      integer, intent(in) :: origin(:)
      integer :: lane

      if (other%look < 0) return
      do lane = 1, size(origin)
         self%largest(origin(lane), :) = max(self%largest(origin(lane), :), other%largest(lane, :))
      end do
   end subroutine take_lanes

   !> How many of the first nreal lanes are ok and have grown.
   integer function count_grown(self, nreal, state)
      class(growth_type), intent(in) :: self
      integer, intent(in) :: nreal
      type(lane_state), intent(in) :: state
      real(wp) :: reached(state%nlane, 2)
      integer :: lane

      count_grown = 0
      if (self%look < 0) return
      reached = 0
      call widen(state%nlane, state%ndof, state%q, reached(:, 1))
      call widen(state%nlane, state%ndof, state%p, reached(:, 2))
      do lane = 1, nreal
         if (state%status(lane) == 0 .and. all(self%largest(lane, :) > 0) .and. &
             all(reached(lane, :)/factor > self%largest(lane, :))) count_grown = count_grown + 1
      end do
   end function count_grown

   !> VEC Update the largest |x_i| of each lane, largest <- max(largest, |x_1| .. |x_n|). A NaN in x is skipped.
   pure subroutine widen(nlane, n, x, largest)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: x(nlane, n)
      real(wp), intent(inout) :: largest(nlane)
      integer :: lane, i

      do i = 1, n
         do lane = 1, nlane
            largest(lane) = merge(abs(x(lane, i)), largest(lane), abs(x(lane, i)) > largest(lane))
         end do
      end do
   end subroutine widen

end module symsde_ensemble_block_growth
