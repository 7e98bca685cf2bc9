! SPDX-License-Identifier: BSD-3-Clause
!> The report of a run: the chosen stepper, work that was left out, counters, failures and timings.
module symsde_ensemble_run_report
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: status_ok
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type, correction_none
   use symsde_step_stepper, only: stepper_type
   implicit none
   private
   public :: run_report, describe_left_out

   !> The report of a run; a prepared run adds up the counters and seconds of all its calls.
   type :: run_report
      integer(i4) :: status = status_ok          !! ok, or the numerical outcome of the whole run
      character(:), allocatable :: stepper       !! name of the stepper that the factory chose
      character(:), allocatable :: left_out      !! work that model and scheme do not need
      character(:), allocatable :: warnings      !! problems that are foreseen before the run, one per line
      character(:), allocatable :: damping       !! description of the damping; empty for a closed system
      character(:), allocatable :: functionals   !! functionals drawn besides dW: 'dZ and K'
      character(:), allocatable :: lapack        !! LAPACK library that solved systems; not allocated if none did
      integer :: correction = correction_none    !! the correction that was active
      type(counters_type) :: counters
      integer(i8) :: nfailed = 0                 !! paths with a numerical failure
      integer(i8) :: nstopped = 0                !! paths cut short by a stop
      integer(i8) :: ngrown = 0                  !! ok paths that have grown (block/growth)
      integer :: nthread = 1, nlane = 0
      real(wp) :: lost_variance = 0              !! variance that a normal loses by truncation
      real(wp) :: seconds_setup = 0, seconds_run = 0
   end type run_report

contains

   !> List the work that the traits of the model make unnecessary, joined by semicolons.
   subroutine describe_left_out(model, scheme, correction, stepper, text)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme
      integer, intent(in) :: correction
      class(stepper_type), intent(in) :: stepper  !! stepper that the factory chose
      character(:), allocatable, intent(out) :: text
      integer :: nsilent

      text = ''
      nsilent = 0
      if (allocated(model%traits%silent)) nsilent = count(model%traits%silent)
      if (nsilent == model%traits%nnoise) then
         call add('no noise: no generator, no increments')
      else if (nsilent > 0) then
         call add('noises of strength zero: nothing drawn for them')
      end if
      if (abs(scheme%correction_coefficient()) > 0 .and. correction == correction_none) then
         if (model%traits%correction_vanishes()) then
            call add('correction: it vanishes for this noise')
         else
            call add('correction: switched off, the scheme converges to another equation')
         end if
      end if
      if (stepper%explicit) call add('solver: the step is explicit')
      if (stepper%one_solve) call add('iteration: the equations are linear, one solve a step')
      if (allocated(stepper%left_out)) call add(stepper%left_out)

   contains

      subroutine add(sentence)
         character(*), intent(in) :: sentence

         if (len(text) > 0) text = text//'; '
         text = text//sentence
      end subroutine add

   end subroutine describe_left_out

end module symsde_ensemble_run_report
