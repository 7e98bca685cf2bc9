! SPDX-License-Identifier: BSD-3-Clause
!> How many steps of a block are drawn ahead, and how many states are kept until the observer is shown them. Memory
!> bounds both numbers: 288 kB of increments, 32 kB of positions. Two pairs of steps and one state are kept in any
!> case. The numbers change no result.
module symsde_ensemble_block_ahead
   use symsde_base_kinds, only: i8
   implicit none
   private
   public :: pairs_ahead, pairs_of, states_ahead, most_shown

   integer, parameter :: few_lanes = 8, few_columns = 8  !! a small block has no more lanes, and columns a step
   integer, parameter :: columns_of_one = 256     !! of a single path: 128 steps of so many columns take 256 kB
   integer, parameter :: most_increments = 36864  !! increments of a block that are drawn ahead: 288 kB
   integer(i8), parameter :: most_states = 4096   !! values of q that are kept until the observer is shown them: 32 kB
   integer, parameter :: most_shown = 128         !! states that are shown at once

contains

   !> How many states after whole steps are kept until the observer is shown them: at least one.
   pure integer function states_ahead(nlane, ndof)
      integer, intent(in) :: nlane, ndof

      states_ahead = int(max(1_i8, min(int(most_shown, i8), most_states/(int(nlane, i8)*ndof))))
   end function states_ahead

   !> Pairs of steps whose increments and functionals, so many columns a step, are drawn at once. Two pairs make use of
   !> all words of a draw, and four of the fastest kernel. Sixteen spare passes over the block where a model takes whole
   !> steps. A small block, or a path by itself, takes sixty-four: its few paths leave lanes of the generator empty,
   !> which are filled with steps.
   pure integer function pairs_ahead(nlane, ncolumn)
      integer, intent(in) :: nlane, ncolumn

      if (nlane <= few_lanes .and. ncolumn <= merge(columns_of_one, few_columns, nlane == 1)) then
         pairs_ahead = 64
      else if (32_i8*nlane*ncolumn <= most_increments) then
         pairs_ahead = 16
      else if (8_i8*nlane*ncolumn <= most_increments) then
         pairs_ahead = 4
      else
         pairs_ahead = 2
      end if
   end function pairs_ahead

   !> Pairs that a run of so many steps touches at most, but not more than `most`: a run may begin and end with half a
   !> pair, and draws from an even pair on.
   pure integer function pairs_of(nstep, most)
      integer(i8), intent(in) :: nstep
      integer, intent(in) :: most

      pairs_of = int(min(nstep/2 + 2, int(most, i8)))
   end function pairs_of

end module symsde_ensemble_block_ahead
