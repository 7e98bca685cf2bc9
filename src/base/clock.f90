! SPDX-License-Identifier: BSD-3-Clause
!> Wall-clock time, for timings and for the intervals of progress reports. No result depends on it.
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
