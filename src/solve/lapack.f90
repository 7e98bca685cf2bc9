! SPDX-License-Identifier: BSD-3-Clause
!> The only file that calls LAPACK: one large system A x = b with row exchanges, P A = L U, and the threads of the BLAS.
!>
!> LAPACK's info is not a reliable sign of failure: a nearly singular matrix gives info = 0 and infinities, an exactly
!> singular one info = 0 with some libraries and info > 0 with others, subnormal numbers info = 0 and a wrong solution.
!> So info only decides whether there is a solution at all; solve/one_system checks the solution.
module symsde_solve_lapack
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_null_char
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: solve_by_lapack, lapack_is_usable, name_lapack, blas_single_thread, blas_restore_threads

   integer, parameter :: longest = 200  !! characters of a name

   interface
      !> LAPACK: LU factors of a general matrix with exchanges of rows; info > 0 where a pivot is zero.
      subroutine dgetrf(m, n, a, lda, ipiv, info)
         import :: wp
         integer, intent(in) :: m, n, lda
         real(wp), intent(inout) :: a(lda, *)
         integer, intent(out) :: ipiv(*)
         integer, intent(out) :: info
      end subroutine dgetrf

      !> LAPACK: solve with the factors of dgetrf, nrhs right-hand sides at once; trans = 'N' for A itself.
      subroutine dgetrs(trans, n, nrhs, a, lda, ipiv, b, ldb, info)
         import :: wp
         character, intent(in) :: trans
         integer, intent(in) :: n, nrhs, lda, ldb
         real(wp), intent(in) :: a(lda, *)
         integer, intent(in) :: ipiv(*)
         real(wp), intent(inout) :: b(ldb, *)
         integer, intent(out) :: info
      end subroutine dgetrs

      !> lapack_library.c: vendor of this process's LAPACK; the text ends with a null character.
      subroutine take_name(text, size) bind(c, name='lapack_name')
         import :: c_char, c_int
         integer(c_int), value :: size
         character(kind=c_char), intent(out) :: text(size)
      end subroutine take_name

      !> lapack_library.c: 0 where the BLAS cannot be kept to one thread.
      integer(c_int) function serves() bind(c, name='lapack_serves')
         import :: c_int
      end function serves

      !> lapack_library.c: the BLAS has one thread from now on.
      subroutine take_threads() bind(c, name='blas_threads_take')
      end subroutine take_threads

      !> lapack_library.c: undo one call of take_threads.
      subroutine give_back_threads() bind(c, name='blas_threads_give_back')
      end subroutine give_back_threads
   end interface

contains

   !> Put the solution of a x = b into x; x stays unchanged if there is none.
   subroutine solve_by_lapack(n, a, x)
      integer, intent(in) :: n            !! unknowns
      real(wp), intent(inout) :: a(n, n)  !! matrix, destroyed
      real(wp), intent(inout) :: x(n)     !! in: right-hand side; out: LAPACK's solution
      integer :: pivot(n), info

      call dgetrf(n, n, a, n, pivot, info)
      if (info == 0) call dgetrs('N', n, 1, a, n, pivot, x, n, info)
   end subroutine solve_by_lapack

   !> Whether the LAPACK of this process may be used: not if the threads of its BLAS cannot be set.
   logical function lapack_is_usable()
      lapack_is_usable = serves() /= 0
   end function lapack_is_usable

   !> Vendor and version of the LAPACK of this process, and of its BLAS if the vendor differs: bits of solutions
   !> depend on them.
   subroutine name_lapack(name)
      character(:), allocatable, intent(out) :: name
      character(kind=c_char) :: text(longest)
      integer :: i

      call take_name(text, int(longest, c_int))
      name = ''
      do i = 1, longest
         if (text(i) == c_null_char) exit
         name = name//text(i)
      end do
   end subroutine name_lapack

   !> Set a threaded BLAS to one thread: the library's threads solve many small systems, and threads within each solve
   !> would make them many times slower. Call blas_restore_threads once for each call. A BLAS without threads is left
   !> alone; a BLAS whose threads cannot be set is not used (lapack_is_usable).
   subroutine blas_single_thread()
      call take_threads()
   end subroutine blas_single_thread

   !> Restore the number of threads of the BLAS when its last user is done. Calls are counted, since calls of several
   !> threads overlap.
   subroutine blas_restore_threads()
      call give_back_threads()
   end subroutine blas_restore_threads

end module symsde_solve_lapack
