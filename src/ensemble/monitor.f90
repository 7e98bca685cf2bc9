! SPDX-License-Identifier: BSD-3-Clause
!> The abstract monitor: it is told of progress between chunks and may stop the run.
module symsde_ensemble_monitor
   use symsde_base_kinds, only: i8
   implicit none
   private
   public :: monitor_type

   !> This base never stops. Extensions are called on the calling thread only, ten times a second or so.
   type :: monitor_type
   contains
      procedure :: wants_stop
   end type monitor_type

contains

   !> Told how many path-steps are done of how many; true stops the run at the next chunk.
   logical function wants_stop(self, done, total)
      class(monitor_type), intent(inout) :: self
      integer(i8), intent(in) :: done, total  !! path-steps

      wants_stop = .false.
   end function wants_stop

end module symsde_ensemble_monitor
