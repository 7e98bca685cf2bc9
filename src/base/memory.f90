! SPDX-License-Identifier: BSD-3-Clause
!> Memory is checked before it is allocated: a failing allocation without stat= would end the calling process.
!>
!> Every entry point adds up the most that it will hold, in numbers of eight bytes, and asks here. The reserve covers
!> small temporaries and small runs; every entry point checks it first, since the whole question takes microseconds, as
!> long as some runs. Threads of the calling program may still take the memory in between.
module symsde_base_memory
   use, intrinsic :: iso_c_binding, only: c_double, c_int
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, out_of_memory
   use symsde_base_text, only: to_text
   implicit none
   private
   public :: require_memory, require_reserve, memory_for, memory_left

   real(wp), parameter :: reserve = 12.0_wp*2**20  !! bytes for texts, small arrays and the allocator itself
   character(*), parameter :: reserve_text = '12582912'  !! reserve as text: without memory no number can be written
   real(wp), parameter :: small = 5.0_wp*2**20    !! bytes that need no check beyond the reserve
   real(wp), parameter :: share = 1.02_wp         !! factor for the allocator's overhead on large arrays

   interface
      !> 1 if so many bytes, and threads besides the calling one, are available.
      function symsde_memory_available(bytes, threads) result(available) bind(c, name='symsde_memory_available')
         import :: c_double, c_int
         real(c_double), value :: bytes
         integer(c_int), value :: threads
         integer(c_int) :: available
      end function symsde_memory_available

      !> Bytes that the control groups of this process leave; infinity if none has a limit.
      function memory_left() result(bytes) bind(c, name='symsde_groups_leave')
         import :: c_double
         real(c_double) :: bytes
      end function memory_left
   end interface

contains

   !> Whether so many numbers, and threads besides the calling one, are available.
   logical function memory_for(numbers, threads)
      real(wp), intent(in) :: numbers  !! numbers of eight bytes
      integer, intent(in) :: threads

      memory_for = threads == 0 .and. numbers > 0 .and. 8*numbers <= small
      if (memory_for) return
      memory_for = symsde_memory_available(share*8*numbers + reserve, int(threads, c_int)) /= 0
   end function memory_for

   !> Refuse (out_of_memory) a request that exceeds memory, and state its size in bytes.
   subroutine require_memory(numbers, what, remedy, place, error)
      real(wp), intent(in) :: numbers          !! numbers of eight bytes held at one time, at most
      character(*), intent(in) :: what, remedy !! the object that needs them, advice for the user
      character(*), intent(in) :: place        !! the procedure that would allocate them
      type(error_type), allocatable, intent(inout) :: error

      call require_reserve(what, place, error)
      if (allocated(error)) return
      if (memory_for(numbers, 0)) return
      call raise(error, out_of_memory, place, what//' needs '//to_text(share*8*numbers + reserve)// &
                 ' bytes of memory, more than this process can have: '//remedy)
   end subroutine require_memory

   !> Refuse (out_of_memory) to begin without the reserve: every entry point calls this before it allocates.
   subroutine require_reserve(what, place, error)
      character(*), intent(in) :: what   !! the work that begins
      character(*), intent(in) :: place  !! the procedure that begins it
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) return
      if (memory_for(0.0_wp, 0)) return
      call raise(error, out_of_memory, place, what//' needs '//reserve_text//' bytes of memory, more than this '// &
                 'process can have: free some')
   end subroutine require_reserve

end module symsde_base_memory
