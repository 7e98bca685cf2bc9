! SPDX-License-Identifier: BSD-3-Clause
!> Status codes, version and build of the library as text, and the memory that the process may still use.
module symsde_capi_info
   use, intrinsic :: iso_c_binding, only: c_f_pointer, c_int, c_ptr, c_size_t
   use, intrinsic :: iso_fortran_env, only: compiler_options, compiler_version
   use symsde_base_kinds, only: wp
   use symsde_base_memory, only: memory_left
   use symsde_base_status, only: error_type, status_ok, status_text
   use symsde_base_text, only: to_text
   use symsde_base_version, only: library_version
   use symsde_capi_error, only: finish, require
   use symsde_capi_text, only: put_text
   use symsde_noise_philox, only: counter_map_version
   use symsde_solve_lapack, only: name_lapack
   implicit none
   private
   public :: symsde_status_text, symsde_version, symsde_build_info, symsde_memory_left

contains

   !> The text of a status code.
   function symsde_status_text(code, buffer, size, needed) result(status) bind(c, name='symsde_status_text')
      integer(c_int), intent(in), value :: code
      type(c_ptr), intent(in), value :: buffer, needed
      integer(c_size_t), intent(in), value :: size
      integer(c_int) :: status

      call put_text(status_text(code), buffer, size, needed)
      status = status_ok
   end function symsde_status_text

   !> The version of the library.
   function symsde_version(buffer, size, needed) result(status) bind(c, name='symsde_version')
      type(c_ptr), intent(in), value :: buffer, needed
      integer(c_size_t), intent(in), value :: size
      integer(c_int) :: status

      call put_text(library_version, buffer, size, needed)
      status = status_ok
   end function symsde_version

   !> Lines 'key: value' about how the library was built, and which LAPACK is loaded.
   function symsde_build_info(buffer, size, needed) result(status) bind(c, name='symsde_build_info')
      type(c_ptr), intent(in), value :: buffer, needed
      integer(c_size_t), intent(in), value :: size
      integer(c_int) :: status
      character(:), allocatable :: arithmetic, openmp, options, lapack

      call drop_folders(compiler_options(), options)
      openmp = trim(merge('yes', 'no ', index(compiler_options(), '-fopenmp') > 0))
      arithmetic = trim(merge('fused        ', 'rounded twice', is_fused()))
      call name_lapack(lapack)
      call put_text('version: '//library_version//new_line('a')// &
                    'compiler: '//compiler_version()//new_line('a')// &
                    'compile options: '//options//new_line('a')// &
                    'counter map of the noise: '//to_text(counter_map_version)//new_line('a')// &
                    'arithmetic: '//arithmetic//new_line('a')// &
                    'openmp: '//openmp//new_line('a')// &
                    'lapack: '//lapack//new_line('a'), buffer, size, needed)
      status = status_ok
   end function symsde_build_info

   !> Bytes that the limits of the process's control groups leave now.
   function symsde_memory_left(bytes, error) result(status) bind(c, name='symsde_memory_left')
      type(c_ptr), intent(in), value :: bytes, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      real(wp), pointer :: left

      call require(bytes, 'bytes', refusal)
      if (.not. allocated(refusal)) then
         call c_f_pointer(bytes, left)
         left = memory_left()
      end if
      status = finish(refusal, error)
   end function symsde_memory_left

   !> Whether this library computes a b + c as one operation. The product (1 + e)(1 - e) = 1 - e**2 rounds to 1.
   logical function is_fused()
      real(wp), volatile :: a, b, c

      a = 1 + epsilon(1.0_wp)
      b = 1 - epsilon(1.0_wp)
      c = -1
      is_fused = abs(a*b + c) > 0
   end function is_fused

   !> Drop compile options that name folders of the machine that built the library.
   pure subroutine drop_folders(options, kept)
      character(*), intent(in) :: options
      character(:), allocatable, intent(out) :: kept
      character(:), allocatable :: word
      logical :: folder_follows
      integer :: first, last

      kept = ''
      folder_follows = .false.
      first = 1
      do while (first <= len_trim(options))
         last = first + scan(options(first:)//' ', ' ') - 2
         word = options(first:last)
         first = last + 2
         if (word == '-J' .or. word == '-I') then
            folder_follows = .true.
         else if (folder_follows .or. scan(word, '/') > 0) then
            folder_follows = .false.
         else
            kept = trim(kept//' '//word)
         end if
      end do
      kept = trim(adjustl(kept))
   end subroutine drop_folders

end module symsde_capi_info
