! SPDX-License-Identifier: BSD-3-Clause
!> Means of values at every saved time: the moments of the run, for an observer that looks at groups of paths.
!>
!> A row of the table is a saved time, its columns are the values. Answers are the means with standard errors,
!> (value, time); NaN for no path, and errors for fewer than two.
module symsde_ensemble_observe_mean_values
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use symsde_base_kinds, only: wp, i8
   use symsde_ensemble_observe_streaming, only: streaming_observer, observer_request
   use symsde_ensemble_statistics_path_tree, only: moment_node
   implicit none
   private
   public :: mean_values_observer, new_mean_values_observer

   type, extends(streaming_observer) :: mean_values_observer
      logical :: in_order = .false.      !! whether these are the first values of a run, which need no copies
      real(wp), allocatable :: x(:, :)   !! copies of the values that are observed (nlane, ncolumn)
   contains
      procedure :: open_block
      procedure :: take
      procedure :: nanswer
      procedure :: answer
   end type mean_values_observer

contains

   subroutine new_mean_values_observer(self, request, ntime)
      type(mean_values_observer), intent(out) :: self
      type(observer_request), intent(in) :: request
      integer, intent(in) :: ntime
      integer :: j

      self%nrow = ntime
      self%ncolumn = size(request%values)
      self%in_order = .true.
      do j = 1, self%ncolumn
         self%in_order = self%in_order .and. request%values(j) == j
      end do
   end subroutine new_mean_values_observer

   subroutine open_block(self)
      class(mean_values_observer), intent(inout) :: self

      if (.not. (self%in_order .or. allocated(self%x))) allocate (self%x(self%run%nlane, self%ncolumn))
   end subroutine open_block

   subroutine take(self, it, t, values, counts)
      class(mean_values_observer), intent(inout) :: self
      integer, intent(in) :: it
      real(wp), intent(in) :: t
      real(wp), intent(in), contiguous :: values(:, :)
      logical, intent(in), contiguous :: counts(:)
      integer :: j

      if (self%in_order) then
         call self%row(it, values(:, :self%ncolumn), counts)
         return
      end if
      do j = 1, self%ncolumn
         self%x(:, j) = values(:, self%request%values(j))
      end do
      call self%row(it, self%x, counts)
   end subroutine take

   integer(i8) function nanswer(self)
      class(mean_values_observer), intent(in) :: self

      nanswer = int(self%nrow, i8)*self%ncolumn
   end function nanswer

   subroutine answer(self, counts, sums, values, errors)
      class(mean_values_observer), intent(in) :: self
      integer(i8), intent(in) :: counts(:)
      real(wp), intent(in) :: sums(:)
      real(wp), intent(out) :: values(:), errors(:)
      type(moment_node) :: table
      real(wp) :: nan
      integer(i8) :: at
      integer :: it

      nan = ieee_value(nan, ieee_quiet_nan)
      call self%to_table(sums, table)
      do it = 1, self%nrow
         at = int(it - 1, i8)*self%ncolumn
         associate (n => table%n(it), mean => values(at + 1:at + self%ncolumn), se => errors(at + 1:at + self%ncolumn))
            mean = merge(table%mean(:, it), nan, n > 0.5_wp)
            se = nan
            if (n > 1.5_wp) se = sqrt(table%m2(:, it)/(n - 1)/n)
         end associate
      end do
   end subroutine answer

end module symsde_ensemble_observe_mean_values
