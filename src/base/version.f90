! SPDX-License-Identifier: BSD-3-Clause
!> The version of the library, in a file of its own: CMake and the wheel read this line. fpm.toml and CITATION.cff
!> repeat the version; a test compares them.
module symsde_base_version
   implicit none
   private
   public :: library_version

   character(*), parameter :: library_version = '0.1.0'
end module symsde_base_version
