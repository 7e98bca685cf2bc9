! SPDX-License-Identifier: BSD-3-Clause
!> How far ahead a block works: increments that are drawn at once, and states that are kept until they are shown.
module symsde_ensemble_ahead
   use symsde_base_kinds, only: i8
   use symsde_ensemble_options, only: run_options
   implicit none
   private
   public :: pairs_ahead, states_ahead, pairs_of

   integer, parameter :: few_lanes = 8, few_columns = 8
   integer, parameter :: most_increments = 32768  !! of a block that are drawn ahead: 256 kB
   integer(i8), parameter :: most_states = 4096   !! values of q that are kept until they are shown: 32 kB

contains

   !> States after whole steps that are kept until they are shown.
   pure integer function states_ahead(nlane, ndof)
      integer, intent(in) :: nlane, ndof

      states_ahead = int(max(1_i8, min(128_i8, most_states/(int(nlane, i8)*ndof))))
   end function states_ahead

   !> Pairs of steps whose increments and functionals, so many columns a step, are drawn at once: two make use of all
   !> words of a draw, four of the fastest kernel, more spare passes over the block where a model takes whole steps,
   !> and the few paths of a small block fill the lanes of the generator with steps.
   pure integer function pairs_ahead(nlane, ncolumn)
      integer, intent(in) :: nlane, ncolumn

      if (nlane <= few_lanes .and. ncolumn <= few_columns) then
         pairs_ahead = 64
      else if (32_i8*nlane*ncolumn <= most_increments) then
         pairs_ahead = 16
      else if (8_i8*nlane*ncolumn <= most_increments) then
         pairs_ahead = 4
      else
         pairs_ahead = 2
      end if
   end function pairs_ahead

   !> Pairs of steps that a run touches, or a number of them that is no limit.
   pure integer function pairs_of(options)
      type(run_options), intent(in) :: options

      pairs_of = int(min(options%nstep/2 + 2, 1024_i8))
   end function pairs_of

end module symsde_ensemble_ahead
