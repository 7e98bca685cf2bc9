! SPDX-License-Identifier: BSD-3-Clause
!> Moments of Kubo oscillators on any number of ranks of MPI, with the bits of one call of the library.
!>
!>    mpif90 ranks.f90 $(pkg-config --cflags --libs symsde) && mpirun -n 3 ./a.out
!>
!> The paths are cut into pieces of 1024. Rank r computes the pieces r, r + n, ..; rank 0 merges siblings, the pieces
!> 2 j and 2 j + 1, then siblings of twice that size, up to the whole. Which pieces are merged does not depend on the
!> ranks that computed them, and so neither do the bits.
program ranks
   use, intrinsic :: iso_fortran_env, only: error_unit
   use mpi_f08, only: mpi_init, mpi_finalize, mpi_comm_rank, mpi_comm_size, mpi_send, mpi_recv, mpi_abort, &
                      mpi_comm_world, mpi_status_ignore, mpi_double_precision, mpi_integer8
   use symsde
   implicit none

   !> Results of a piece: number of paths that count, means, sums of squared deviations.
   type :: part
      integer(i8), allocatable :: n_ok(:)
      real(wp), allocatable :: mean(:, :), m2(:, :)
   end type part

   integer(i8), parameter :: npath = 10000, each = 1024  !! each: 256 times a power of two
   integer, parameter :: npiece = int((npath + each - 1)/each)
   type(kubo_model) :: model
   type(scheme_type) :: scheme
   type(run_options) :: options
   type(moments_type) :: whole
   type(error_type), allocatable :: error
   type(part) :: pieces(0:npiece - 1)
   integer :: rank, size_of_world, piece, step

   call mpi_init()
   call mpi_comm_rank(mpi_comm_world, rank)
   call mpi_comm_size(mpi_comm_world, size_of_world)
   call new_kubo(model, a=1.0_wp, sigma=0.3_wp, error=error)
   call get_scheme(scheme, 'midpoint', error)
   options = run_options(step=0.02_wp, nstep=200_i8, npath=npath, seed=1_i8, save_every=50_i8, nthread=1)

   do piece = rank, npiece - 1, size_of_world
      call compute(piece, pieces(piece))
      if (rank > 0) call send(pieces(piece))
   end do
   if (rank == 0) then
      do piece = 0, npiece - 1
         if (mod(piece, size_of_world) > 0) call receive(mod(piece, size_of_world), pieces(piece))
      end do
      step = 1
      do while (step < npiece)
         do piece = 0, npiece - 1 - step, 2*step
            call merge_moments(pieces(piece)%n_ok, pieces(piece)%mean, pieces(piece)%m2, pieces(piece + step)%n_ok, &
                               pieces(piece + step)%mean, pieces(piece + step)%m2)
         end do
         step = 2*step
      end do
      call moments(model, scheme, options, q0=[1.0_wp], p0=[0.0_wp], result=whole, error=error)
      call check()
      print '(i0, a, f8.5, a, z16.16)', pieces(0)%n_ok(5), ' paths, E q = ', pieces(0)%mean(1, 5), ', its bits ', &
         pieces(0)%mean(1, 5)
      print '(a, z16.16)', 'bits of the sum of squared deviations ', pieces(0)%m2(1, 5)
      if (any(transfer(pieces(0)%mean, [0_i8]) /= transfer(whole%mean, [0_i8])) .or. &
          any(transfer(pieces(0)%m2, [0_i8]) /= transfer(whole%m2, [0_i8]))) error stop 'not the bits of one call'
      print '(a)', 'the bits of one call'
   end if
   call mpi_finalize()

contains

   !> Moments of one piece, by its global path indices.
   subroutine compute(piece, found)
      integer, intent(in) :: piece
      type(part), intent(out) :: found
      type(run_options) :: here
      type(moments_type) :: result

      here = options
      here%first_path = piece*each
      here%npath = min(each, npath - here%first_path)
      call moments(model, scheme, here, q0=[1.0_wp], p0=[0.0_wp], result=result, error=error)
      call check()
      found%n_ok = result%n_ok
      found%mean = result%mean
      found%m2 = result%m2
   end subroutine compute

   subroutine send(found)
      type(part), intent(in) :: found

      call mpi_send(shape(found%mean, kind=i8), 2, mpi_integer8, 0, 0, mpi_comm_world)
      call mpi_send(found%n_ok, size(found%n_ok), mpi_integer8, 0, 1, mpi_comm_world)
      call mpi_send(found%mean, size(found%mean), mpi_double_precision, 0, 2, mpi_comm_world)
      call mpi_send(found%m2, size(found%m2), mpi_double_precision, 0, 3, mpi_comm_world)
   end subroutine send

   !> The next piece of a rank: its pieces come in their order.
   subroutine receive(from, found)
      integer, intent(in) :: from
      type(part), intent(out) :: found
      integer(i8) :: extent(2)

      call mpi_recv(extent, 2, mpi_integer8, from, 0, mpi_comm_world, mpi_status_ignore)
      allocate (found%n_ok(extent(2)), found%mean(extent(1), extent(2)), found%m2(extent(1), extent(2)))
      call mpi_recv(found%n_ok, size(found%n_ok), mpi_integer8, from, 1, mpi_comm_world, mpi_status_ignore)
      call mpi_recv(found%mean, size(found%mean), mpi_double_precision, from, 2, mpi_comm_world, mpi_status_ignore)
      call mpi_recv(found%m2, size(found%m2), mpi_double_precision, from, 3, mpi_comm_world, mpi_status_ignore)
   end subroutine receive

   !> An error on one rank ends them all.
   subroutine check()
      if (.not. allocated(error)) return
      write (error_unit, '(a)') error%message
      call mpi_abort(mpi_comm_world, 1)
   end subroutine check

end program ranks
