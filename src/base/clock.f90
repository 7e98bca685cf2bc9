! SPDX-License-Identifier: BSD-3-Clause
!> The clock of the wall, for timings and for how often a host is told of progress. No result depends on it.
module symsde_base_clock
   use symsde_base_kinds, only: wp, i8
   implicit none
   private
   public :: seconds

contains

   !> Seconds since some moment in the past.
   real(wp) function seconds()
      integer(i8) :: ticks, rate

      call system_clock(ticks, rate)
      seconds = real(ticks, wp)/real(rate, wp)
   end function seconds

end module symsde_base_clock
