! SPDX-License-Identifier: BSD-3-Clause
!> The abstract monitor: it is called regularly with the progress, and may stop a run or a diagnosis.
module symsde_ensemble_monitor
   use symsde_base_clock, only: seconds
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type, raise, callback_failed, stopped
   implicit none
   private
   public :: monitor_type, stop_if_wanted, raise_stopped, tell_warnings

   real(wp), parameter :: pause = 0.05_wp  !! least time between two calls of the monitor [s]

   !> This base never stops. Extensions are called on the calling thread only, at most twenty times a second.
   type :: monitor_type
      integer(i8) :: chunk = 0                   !! steps between two calls; 0: chosen by duration
      real(wp), private :: last = -huge(1.0_wp)  !! time of the last call [s]
   contains
      procedure :: wants_stop
      procedure :: refuses
      procedure, non_overridable :: ask
   end type monitor_type

contains

   !> Report progress: done of total path-steps of a run, or parts of a diagnosis in its own unit. True stops the
   !> work at the next place where it can be left.
   logical function wants_stop(self, done, total)
      class(monitor_type), intent(inout) :: self
      integer(i8), intent(in) :: done, total

      wants_stop = .false.
   end function wants_stop

   !> Report all warnings before the first step of a run, one sentence a line. True refuses the run.
   logical function refuses(self, warnings)
      class(monitor_type), intent(inout) :: self
      character(*), intent(in) :: warnings

      refuses = .false.
   end function refuses

   !> Pass the warnings of a run, if there are any, to the monitor before the first step.
   subroutine tell_warnings(monitor, warnings, error)
      class(monitor_type), intent(inout) :: monitor
      character(*), intent(in) :: warnings
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error) .or. len(warnings) == 0) return
      if (monitor%refuses(warnings)) call raise(error, callback_failed, 'run_ensemble', 'the run was refused, '// &
                                                'before its first step, by who was told of its warnings')
   end subroutine tell_warnings

   !> Call `wants_stop`, unless its last call was less than `pause` ago.
   subroutine ask(self, done, total, stop_now)
      class(monitor_type), intent(inout) :: self
      integer(i8), intent(in) :: done, total
      logical, intent(out) :: stop_now
      real(wp) :: now

      stop_now = .false.
      now = seconds()
      if (now - self%last < pause) return
      self%last = now
      stop_now = self%wants_stop(done, total)
   end subroutine ask

   !> Call the monitor of a diagnosis, if there is one; a stop raises `stopped`.
   subroutine stop_if_wanted(monitor, done, total, place, error)
      class(monitor_type), intent(inout), optional :: monitor
      integer(i8), intent(in) :: done, total
      character(*), intent(in) :: place  !! the procedure to be stopped
      type(error_type), allocatable, intent(inout) :: error
      logical :: stop_now

      if (.not. present(monitor)) return
      call monitor%ask(done, total, stop_now)
      if (stop_now) call raise_stopped(place, error)
   end subroutine stop_if_wanted

   !> Raise `stopped` for a diagnosis.
   subroutine raise_stopped(place, error)
      character(*), intent(in) :: place  !! the procedure that stops
      type(error_type), allocatable, intent(inout) :: error

      call raise(error, stopped, place, 'the diagnosis was stopped on request: it has no result')
   end subroutine raise_stopped

end module symsde_ensemble_monitor
