! SPDX-License-Identifier: BSD-3-Clause
!> symsde_draw_states: initial states from a law, by seed and path alone.
module symsde_capi_states
   use, intrinsic :: iso_c_binding, only: c_int, c_int64_t, c_ptr
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type, raise, wrong_shape
   use symsde_base_text, only: to_text
   use symsde_capi_arrays, only: view
   use symsde_capi_error, only: check_sizes, finish, require
   use symsde_noise_states, only: draw_states
   implicit none
   private
   public :: symsde_draw_states

contains

   !> Draw q, p[ndof][paths] = centre[2 ndof] + factor[2 ndof][2 ndof] z, or centre + factor[2 ndof] times z.
   function symsde_draw_states(law, seed, stream, first_path, paths, ndof, columns, centre, factor, q, p, error) &
      result(status) bind(c, name='symsde_draw_states')
      integer(c_int), intent(in), value :: law, stream, ndof, columns
      integer(c_int64_t), intent(in), value :: seed  ! unsigned in C: the same 64 bits
      integer(c_int64_t), intent(in), value :: first_path, paths
      type(c_ptr), intent(in), value :: centre, factor, q, p, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      real(wp), pointer, contiguous :: x(:), rows(:, :), to_q(:, :), to_p(:, :)
      real(wp), allocatable :: matrix(:, :)
      integer :: i

      if (columns /= 1 .and. columns /= 2*ndof) &
         call raise(refusal, wrong_shape, 'draw_states', 'columns = '//to_text(columns)// &
                    ': give 1, deviations of independent coordinates, or 2*ndof, the rows of a matrix')
      call check_sizes(int(ndof, i8), paths, 2_i8, 'q', refusal)
      call check_sizes(int(ndof, i8), int(columns, i8), 2_i8, 'factor', refusal)
      call require(centre, 'centre', refusal)
      call require(factor, 'factor', refusal)
      call require(q, 'q', refusal)
      call require(p, 'p', refusal)
      if (.not. allocated(refusal)) then
         call view(centre, 2_i8*ndof, x)
         call view(factor, int(columns, i8), 2_i8*ndof, rows)
         allocate (matrix(2*ndof, columns))
         do i = 1, columns
            ! C has rows first.
            matrix(:, i) = rows(i, :)
         end do
         call view(q, paths, int(ndof, i8), to_q)
         call view(p, paths, int(ndof, i8), to_p)
         call draw_states(law, seed, first_path, x, matrix, to_q, to_p, refusal, stream)
      end if
      status = finish(refusal, error)
   end function symsde_draw_states

end module symsde_capi_states
