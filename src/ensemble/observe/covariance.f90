! SPDX-License-Identifier: BSD-3-Clause
!> Covariances of some values at every saved time, with standard errors from fourth moments.
!>
!> A row of the table is a saved time; answers are (pair, time), the pairs (1,1), (1,2), (2,2), (1,3) ..: sum u v/(n -
!> 1), and its error sqrt((<u^2 v^2> - <u v>^2)/n).
module symsde_ensemble_observe_covariance
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use symsde_base_kinds, only: wp, i8
   use symsde_ensemble_statistics_comoments, only: pair_count
   use symsde_ensemble_statistics_path_tree, only: moment_node
   use symsde_ensemble_observe_streaming, only: streaming_observer, observer_request, with_errors
   implicit none
   private
   public :: covariance_observer, new_covariance_observer

   type, extends(streaming_observer) :: covariance_observer
   contains
      procedure :: take
      procedure :: nanswer
      procedure :: answer
   end type covariance_observer

contains

   subroutine new_covariance_observer(self, request, ntime)
      type(covariance_observer), intent(out) :: self
      type(observer_request), intent(in) :: request
      integer, intent(in) :: ntime

      self%nrow = ntime
      self%ncolumn = size(request%values)
      self%kept = with_errors
   end subroutine new_covariance_observer

   subroutine take(self, it, t, values, counts)
      class(covariance_observer), intent(inout) :: self
      integer, intent(in) :: it
      real(wp), intent(in) :: t
      real(wp), intent(in), contiguous :: values(:, :)
      logical, intent(in), contiguous :: counts(:)
      real(wp) :: x(size(values, 1), size(self%request%values))
      integer :: i

      do i = 1, size(x, 2)
         x(:, i) = values(:, self%request%values(i))
      end do
      call self%row(it, x, counts)
   end subroutine take

   integer(i8) function nanswer(self)
      class(covariance_observer), intent(in) :: self

      nanswer = int(self%nrow, i8)*pair_count(self%ncolumn)
   end function nanswer

   subroutine answer(self, counts, sums, values, errors)
      class(covariance_observer), intent(in) :: self
      integer(i8), intent(in) :: counts(:)
      real(wp), intent(in) :: sums(:)
      real(wp), intent(out) :: values(:), errors(:)
      type(moment_node) :: table
      real(wp) :: n
      integer(i8) :: at
      integer :: it, k, npair

      values = ieee_value(n, ieee_quiet_nan)
      errors = values
      call self%to_table(sums, table)
      npair = pair_count(self%ncolumn)
      do it = 1, self%nrow
         n = table%n(it)
         if (n < 1.5_wp) cycle
         do k = 1, npair
            at = int(npair, i8)*(it - 1) + k
            associate (uv => table%pairs(with_errors*(k - 1) + 1, it), uuvv => table%pairs(with_errors*k, it))
               values(at) = uv/(n - 1)
               errors(at) = sqrt(max(uuvv/n - (uv/n)**2, 0.0_wp)/n) + 0*uv  ! max may drop a NaN
            end associate
         end do
      end do
   end subroutine answer

end module symsde_ensemble_observe_covariance
