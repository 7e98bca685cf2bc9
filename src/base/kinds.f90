! SPDX-License-Identifier: BSD-3-Clause
!> The kinds of every number in the library: one real kind, two integer kinds.
module symsde_base_kinds
   use, intrinsic :: iso_c_binding, only: c_double, c_int32_t, c_int64_t
   implicit none
   private
   public :: wp, i4, i8

   integer, parameter :: wp = c_double   !! the only real kind
   integer, parameter :: i4 = c_int32_t  !! sizes of a block, codes, lane status
   integer, parameter :: i8 = c_int64_t  !! paths, steps, seeds, counters
end module symsde_base_kinds
