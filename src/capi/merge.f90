! SPDX-License-Identifier: BSD-3-Clause
!> symsde_merge_moments: merge the moments of parts of an ensemble, computed anywhere, into the whole;
!> symsde_moment_errors: its variances and standard errors.
module symsde_capi_merge
   use, intrinsic :: iso_c_binding, only: c_int, c_int64_t, c_ptr
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type
   use symsde_capi_arrays, only: view
   use symsde_capi_error, only: finish, require, check_sizes
   use symsde_ensemble_statistics_merge, only: merge_moments, moment_errors
   implicit none
   private
   public :: symsde_merge_moments, symsde_moment_errors

contains

   !> Merge the moments of two siblings into the left one.
   function symsde_merge_moments(ntime, nvalue, n_ok, mean, m2, n_ok_right, mean_right, m2_right, error) &
      result(status) bind(c, name='symsde_merge_moments')
      integer(c_int64_t), intent(in), value :: ntime, nvalue
      type(c_ptr), intent(in), value :: n_ok, mean, m2                    !! [ntime], [ntime][nvalue]
      type(c_ptr), intent(in), value :: n_ok_right, mean_right, m2_right
      type(c_ptr), intent(in), value :: error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      integer(i8), pointer, contiguous :: n(:), n_right(:)
      real(wp), pointer, contiguous :: x(:, :), s(:, :), x_right(:, :), s_right(:, :)

      call check_sizes(nvalue, ntime, 1_i8, 'mean', refusal)
      call require(n_ok, 'n_ok', refusal)
      call require(mean, 'mean', refusal)
      call require(m2, 'm2', refusal)
      call require(n_ok_right, 'n_ok_right', refusal)
      call require(mean_right, 'mean_right', refusal)
      call require(m2_right, 'm2_right', refusal)
      if (.not. allocated(refusal)) then
         call view(n_ok, ntime, n)
         call view(mean, nvalue, ntime, x)
         call view(m2, nvalue, ntime, s)
         call view(n_ok_right, ntime, n_right)
         call view(mean_right, nvalue, ntime, x_right)
         call view(m2_right, nvalue, ntime, s_right)
         call merge_moments(n, x, s, n_right, x_right, s_right)
      end if
      status = finish(refusal, error)
   end function symsde_merge_moments

   !> Variances and standard errors of the whole, from its counts and sums.
   function symsde_moment_errors(ntime, nvalue, n_ok, mean, m2, variance, se_mean, error) &
      result(status) bind(c, name='symsde_moment_errors')
      integer(c_int64_t), intent(in), value :: ntime, nvalue
      type(c_ptr), intent(in), value :: n_ok, mean, m2, variance, se_mean     !! [ntime], [ntime][nvalue]
      type(c_ptr), intent(in), value :: error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      integer(i8), pointer, contiguous :: n(:)
      real(wp), pointer, contiguous :: x(:, :), s(:, :), found(:, :), deviation(:, :)

      call check_sizes(nvalue, ntime, 1_i8, 'mean', refusal)
      call require(n_ok, 'n_ok', refusal)
      call require(mean, 'mean', refusal)
      call require(m2, 'm2', refusal)
      call require(variance, 'variance', refusal)
      call require(se_mean, 'se_mean', refusal)
      if (.not. allocated(refusal)) then
         call view(n_ok, ntime, n)
         call view(mean, nvalue, ntime, x)
         call view(m2, nvalue, ntime, s)
         call view(variance, nvalue, ntime, found)
         call view(se_mean, nvalue, ntime, deviation)
         call moment_errors(n, x, s, found, deviation)
      end if
      status = finish(refusal, error)
   end function symsde_moment_errors

end module symsde_capi_merge
