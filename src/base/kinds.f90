! SPDX-License-Identifier: BSD-3-Clause
!> The kinds of every number in the library: one real kind, two integer kinds.
module symsde_base_kinds
   use, intrinsic :: iso_c_binding, only: c_double, c_int32_t, c_int64_t
   implicit none
   private
   public :: wp, i4, i8, unwritten_bits

   integer, parameter :: wp = c_double   !! the only real kind
   integer, parameter :: i4 = c_int32_t  !! sizes of a block, codes, lane status
   integer, parameter :: i8 = c_int64_t  !! paths, steps, seeds, counters

   !> Outputs of callbacks are filled with these bits before a call: a NaN that no computation makes. The constant
   !> is an integer, since gfortran does not keep the bits of a constant NaN.
   integer(i8), parameter :: unwritten_bits = int(z'7FF8A5EED0DDBA11', i8)
end module symsde_base_kinds
