! SPDX-License-Identifier: BSD-3-Clause
!> How many steps of a block are drawn ahead, and how many states are kept until the observer sees them. Both numbers
!> are bounded by memory: 288 kB of increments, 32 kB of positions. At least two pairs of steps and one state are kept.
!> The numbers change no result.
module symsde_ensemble_block_ahead
   use symsde_base_kinds, only: i8
   implicit none
   private
   public :: pairs_ahead, pairs_of, states_ahead, most_shown

   integer, parameter :: few_lanes = 8, few_columns = 8  !! largest small block: lanes, and columns a step
   integer, parameter :: columns_of_one = 256     !! most columns of a single path: 128 steps of 256 columns take 256 kB
   integer, parameter :: most_increments = 36864  !! increments drawn ahead for a block: 288 kB
   integer(i8), parameter :: most_states = 4096   !! values of q kept until the observer sees them: 32 kB
   integer, parameter :: most_shown = 128         !! states shown at once

contains

   !> Number of states after whole steps that are kept until the observer sees them: at least one.
   pure integer function states_ahead(nlane, ndof)
      integer, intent(in) :: nlane, ndof

      states_ahead = int(max(1_i8, min(int(most_shown, i8), most_states/(int(nlane, i8)*ndof))))
   end function states_ahead

   !> Number of pairs of steps that are drawn at once, for ncolumn columns of increments and functionals a step. Two
   !> pairs use all words of a draw, four use the fastest kernel. More, up to sixteen, save passes over the block if a
   !> model takes whole steps. A small block or a single path draws sixty-four, since steps then fill the generator's
   !> lanes, which its few paths would leave empty.
   pure integer function pairs_ahead(nlane, ncolumn)
      integer, intent(in) :: nlane, ncolumn

      if (nlane <= few_lanes .and. ncolumn <= merge(columns_of_one, few_columns, nlane == 1)) then
         pairs_ahead = 64
      else
         pairs_ahead = max(2, int(min(16_i8, most_increments/(2_i8*nlane*max(1, ncolumn))/4*4)))
      end if
   end function pairs_ahead

   !> Number of pairs of steps in a run of nstep steps, but at most `most`: a run may begin and end with half a pair,
   !> and draws from an even pair on.
   pure integer function pairs_of(nstep, most)
      integer(i8), intent(in) :: nstep
      integer, intent(in) :: most

      pairs_of = int(min(nstep/2 + 2, int(most, i8)))
   end function pairs_of

end module symsde_ensemble_block_ahead
