! SPDX-License-Identifier: BSD-3-Clause
!> How much memory a run takes at most, and how many threads fit.
module symsde_ensemble_run_memory
   use symsde_base_functionals, only: functional_set, path_areas, path_decay, path_magnus
   use symsde_base_kinds, only: wp
   use symsde_base_lanes, only: padded
   use symsde_base_memory, only: memory_for, require_memory
   use symsde_base_status, only: error_type
   use symsde_base_text, only: to_text
   use symsde_ensemble_block_ahead, only: pairs_ahead, states_ahead
   use symsde_ensemble_block_shrink_block, only: narrower_width
   use symsde_ensemble_observe_observer, only: observer_type
   use symsde_ensemble_options, only: run_options
   use symsde_scheme_kicks, only: kicks_type
   use symsde_scheme_scheme, only: splitting_form
   use symsde_step_open_kick_law, only: needed_functionals
   use symsde_step_memory, only: step_memory, find_step_memory
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: fit_threads, narrower_numbers, noise_numbers

   integer, parameter :: levels = 64  !! most halvings of an interval for the integrals of a step

contains

   !> Find the number of threads for which a run fits into memory, and whether remaining paths may go on in narrower
   !> blocks. Narrower blocks are given up first, then threads are halved; neither changes a result. A run that does
   !> not fit on one thread is refused (out_of_memory).
   subroutine fit_threads(task, options, observer, nlane, nthread, narrows, error)
      type(stepper_task), intent(in) :: task
      type(run_options), intent(in) :: options
      class(observer_type), intent(in) :: observer
      integer, intent(in) :: nlane          !! lanes of a block
      integer, intent(inout) :: nthread     !! in: number of threads wanted; out: number that the memory allows
      logical, intent(out) :: narrows       !! whether remaining paths may go on in narrower blocks
      type(error_type), allocatable, intent(inout) :: error
      type(step_memory) :: step
      real(wp) :: block

      narrows = .false.
      if (allocated(error)) return
      call find_step_memory(task, step)
      block = block_numbers(task, step, options, nlane)
      narrows = memory_for(nthread*(block + narrower_numbers(task, step, options, nlane)) + &
                           observer%numbers(options%npath, nthread), nthread - 1)
      if (narrows) return
      do while (nthread > 1)
         if (memory_for(nthread*block + observer%numbers(options%npath, nthread), nthread - 1)) return
         nthread = nthread/2
      end do
      if (memory_for(block + observer%numbers(options%npath, 1), 0)) return  ! making the texts below takes time
      call require_memory(block + observer%numbers(options%npath, 1), 'the run of model '//task%model%name// &
                          ' by scheme '//task%scheme%name//' ('//to_text(task%model%traits%ndof)// &
                          ' degrees of freedom, '//to_text(nlane)//' paths at a time)', 'give a smaller system, '// &
                          'a scheme of one stage such as midpoint, fewer lanes, or save less often', 'run_ensemble', &
                          error)
   end subroutine fit_threads

   !> Number of eight-byte numbers that all narrower blocks of one thread hold together.
   real(wp) function narrower_numbers(task, step, options, nlane) result(numbers)
      type(stepper_task), intent(in) :: task
      type(step_memory), intent(in) :: step
      type(run_options), intent(in) :: options
      integer, intent(in) :: nlane
      integer :: width

      numbers = 0
      width = nlane
      do while (narrower_width(width) < width)
         width = narrower_width(width)
         numbers = numbers + block_numbers(task, step, options, width)
      end do
   end function narrower_numbers

   !> Number of eight-byte numbers that one thread holds for blocks of nlane lanes: the stepper, the paths of a block,
   !> and their noise. A single path also prepares later steps in lanes.
   real(wp) function block_numbers(task, step, options, nlane) result(numbers)
      type(stepper_task), intent(in) :: task
      type(step_memory), intent(in) :: step
      type(run_options), intent(in) :: options
      integer, intent(in) :: nlane
      type(functional_set) :: asked
      real(wp) :: ahead, kept
      integer :: ndof, nnoise, ncolumn

      ndof = task%model%traits%ndof
      nnoise = task%model%traits%nnoise
      asked = needed_functionals(task%scheme, task%model%traits, task%damping, task%damping_noise)
      ncolumn = asked%columns(nnoise)
      ahead = 2*pairs_ahead(nlane, ncolumn)
      kept = 2*states_ahead(nlane, ndof)
      numbers = step%numbers(nlane) + nlane*((12.0_wp + kept)*ndof + ahead*(ncolumn + 1)) &
                + noise_numbers(nnoise, asked, nlane)
      if (nlane > 1) return
      if (task%scheme%form == splitting_form) &    ! weights of kicks are computed for all steps drawn ahead
         numbers = numbers + ahead*kick_numbers(task%scheme%kicks, asked, nnoise)
      if (.not. asked%is_empty()) &                ! pairs of steps are filled as neighbouring lanes
         numbers = numbers + noise_numbers(nnoise, asked, 2*padded(pairs_ahead(1, ncolumn)/2))
   end function block_numbers

   !> Number of eight-byte numbers that a single path keeps for steps whose kick weights are computed ahead: increments
   !> and functionals, the weights w of the kicks, V, and D if J is sampled. Each is kept twice: as lanes to compute
   !> weights, and by steps.
   pure real(wp) function kick_numbers(kicks, asked, nnoise) result(numbers)
      type(kicks_type), intent(in) :: kicks
      type(functional_set), intent(in) :: asked   !! functionals beside the increments
      integer, intent(in) :: nnoise
      real(wp) :: m

      m = nnoise
      numbers = asked%columns(nnoise) + 1 + 2*(m + 1)*(size(kicks%c) + 1) + 1
      if (asked%has(path_magnus)) numbers = numbers + 2*asked%count_of(path_magnus, nnoise)
   end function kick_numbers

   !> Number of eight-byte numbers that a source of noise needs to fill a block of nlane lanes: increments, and the
   !> functionals of the intervals that are merged into one step.
   pure real(wp) function noise_numbers(nnoise, asked, nlane)
      integer, intent(in) :: nnoise, nlane
      type(functional_set), intent(in) :: asked   !! functionals beside the increments
      real(wp) :: m

      m = nnoise
      noise_numbers = nlane*(8*m + levels)
      if (.not. asked%is_empty()) noise_numbers = noise_numbers + nlane*levels*5*m
      if (asked%has(path_decay)) noise_numbers = noise_numbers + nlane*levels*6*m
      if (asked%has(path_areas)) noise_numbers = noise_numbers + nlane*levels*m*(m - 1)
   end function noise_numbers

end module symsde_ensemble_run_memory
