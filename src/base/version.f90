! SPDX-License-Identifier: BSD-3-Clause
!> The version of the library. It stands here alone: CMake and the wheel read this line, and a test compares
!> what fpm.toml and CITATION.cff have to say by themselves.
module symsde_base_version
   implicit none
   private
   public :: library_version

   character(*), parameter :: library_version = '0.1.0'
end module symsde_base_version
