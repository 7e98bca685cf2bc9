! SPDX-License-Identifier: BSD-3-Clause
!> The increments that drive a run, all at once, from the same noise source as in the run.
module symsde_ensemble_run_increments
   use symsde_base_interrupt, only: interrupt_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: default_nlane, path_of_lane
   use symsde_base_record, only: step_store, step_request, new_step_store
   use symsde_base_status, only: error_type
   use symsde_ensemble_monitor, only: monitor_type, stop_if_wanted, raise_stopped
   use symsde_ensemble_options, only: run_options, noise_path
   use symsde_noise_source, only: noise_type
   implicit none
   private
   public :: collect_increments

   !> Asks the monitor whether to stop, if the draws of a step take long.
   type, extends(interrupt_type) :: question
      class(monitor_type), pointer :: monitor => null()
      integer(i8) :: done = 0, total = 0
   contains
      procedure :: look
   end type question

contains

   !> dw(path, k, n) = dW_k of the n-th step of the run. Errors: stopped, by the monitor.
   subroutine collect_increments(noise, options, dw, error, monitor)
      class(noise_type), intent(in) :: noise
      type(run_options), intent(in) :: options
      real(wp), intent(inout) :: dw(:, :, :)  !! (npath, nnoise, nstep)
      type(error_type), allocatable, intent(inout) :: error
      class(monitor_type), intent(inout), target, optional :: monitor
      integer(i8) :: first

      if (allocated(error)) return
      if (noise%nnoise == 0 .or. options%nstep == 0) return
      do first = 0, options%npath - 1, default_nlane
         call fill_block(noise, options, first, dw, error, monitor)
         if (allocated(error)) return
      end do
   end subroutine collect_increments

   !> Write the increments of the paths of one block. The source draws the steps 2j and 2j+1 together. If a run begins
   !> with the second step of a pair, or ends with the first, the other step of the pair is left out.
   subroutine fill_block(noise, options, first, dw, error, monitor)
      class(noise_type), intent(in) :: noise
      type(run_options), intent(in) :: options
      integer(i8), intent(in) :: first           !! paths before the block
      real(wp), intent(inout) :: dw(:, :, :)     !! (npath, nnoise, nstep)
      type(error_type), allocatable, intent(inout) :: error
      class(monitor_type), intent(inout), target, optional :: monitor
      type(step_store) :: store  !! holds functionals, too, on which dW depends at refine < 0
      type(step_request) :: request
      integer(i8) :: pair, n, drawn
      type(question) :: patient
      integer :: half, k, nreal

      if (present(monitor)) patient%monitor => monitor
      patient%total = options%npath*options%nstep
      nreal = int(min(int(default_nlane, i8), options%npath - first))
      call new_step_store(store, default_nlane, noise%nnoise, 2, options%step, noise%asked)
      request%nlane = default_nlane
      request%nreal = nreal
      allocate (request%path(default_nlane))
      call path_of_lane(default_nlane, options%first_path + first, nreal, request%path)
      request%path = noise_path(options, request%path)
      do pair = options%first_step/2, (options%first_step + options%nstep - 1)/2
         patient%done = first*options%nstep + (2*pair - options%first_step)*nreal
         call stop_if_wanted(monitor, patient%done, patient%total, 'collect_increments', error)
         if (allocated(error)) return
         request%pair = pair
         call noise%fill(request, store, drawn, patient)
         if (patient%wanted) then
            call raise_stopped('collect_increments', error)
            return
         end if
         do half = 0, 1
            n = 2*pair + half - options%first_step + 1
            if (n < 1 .or. n > options%nstep) cycle
            do k = 1, noise%nnoise
               dw(first + 1:first + nreal, k, n) = store%w(:nreal, k, half)
            end do
         end do
      end do
   end subroutine fill_block

   !> Report progress to the monitor and ask whether to stop, unless it has already asked for a stop.
   subroutine look(self)
      class(question), intent(inout) :: self

      if (associated(self%monitor) .and. .not. self%wanted) &
         call self%monitor%ask(self%done, self%total, self%wanted)
   end subroutine look

end module symsde_ensemble_run_increments
