! SPDX-License-Identifier: BSD-3-Clause
!> Autocovariance of a value along time, for lags of 0 .. L saved points, of a stationary process.
!>
!> Let x be the value minus a number c near its mean. Each path that is ok to the end adds averages over time to row l
!> of the table: x(t) x(t - l) in column 1, (x(t) + x(t - l))/2 in column 2, and the same two averages for l = 0 in
!> columns 3 and 4. With m the mean of column 4, C(l) = <x(t) x(t - l)> - m <x(t) + x(t - l)> + m^2; the error of m
!> changes it in second order only. Paths are independent, so errors are those of means over paths, whatever the
!> correlation along a path. Answers are (C(l) and C(l)/C(0), l).
module symsde_ensemble_observe_autocorrelation
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type, raise, invalid_argument
   use symsde_base_text, only: to_text
   use symsde_ensemble_statistics_comoments, only: pair_place
   use symsde_ensemble_statistics_path_tree, only: moment_node
   use symsde_ensemble_observe_streaming, only: streaming_observer, observer_request, with_pairs
   use symsde_step_block_state, only: lane_state
   implicit none
   private
   public :: autocorrelation_observer, new_autocorrelation_observer

   type, extends(streaming_observer) :: autocorrelation_observer
      integer :: nlag = 0
      real(wp), allocatable :: last(:, :)      !! the last values of each lane, in a ring (nlane, 0:nlag)
      real(wp), allocatable :: product(:, :)   !! sums over time of x(t) x(t - l) (nlane, 0:nlag)
      real(wp), allocatable :: mean(:, :)      !! sums over time of (x(t) + x(t - l))/2 (nlane, 0:nlag)
   contains
      procedure :: open_block
      procedure :: take
      procedure :: close_block
      procedure :: nanswer
      procedure :: answer
   end type autocorrelation_observer

contains

   subroutine new_autocorrelation_observer(self, request, ntime, error)
      type(autocorrelation_observer), intent(out) :: self
      type(observer_request), intent(in) :: request
      integer, intent(in) :: ntime
      type(error_type), allocatable, intent(inout) :: error

      self%nlag = request%bins
      self%nrow = self%nlag + 1
      self%ncolumn = 4
      self%kept = with_pairs
      if (self%nlag < 0 .or. self%nlag >= ntime) &
         call raise(error, invalid_argument, 'new_autocorrelation_observer', 'lags = '//to_text(self%nlag)// &
                    ' saved points, and there are '//to_text(ntime)//' saved times: give 0 to '//to_text(ntime - 1))
      if (.not. abs(request%low) <= huge(1.0_wp)) &
         call raise(error, invalid_argument, 'new_autocorrelation_observer', 'about = '//to_text(request%low)// &
                    ' is not finite: give a number near the mean')
   end subroutine new_autocorrelation_observer

   subroutine open_block(self)
      class(autocorrelation_observer), intent(inout) :: self

      if (.not. allocated(self%last)) &
         allocate (self%last(self%run%nlane, 0:self%nlag), self%product(self%run%nlane, 0:self%nlag), &
                   self%mean(self%run%nlane, 0:self%nlag))
      self%product = 0
      self%mean = 0
   end subroutine open_block

   subroutine take(self, it, t, values, counts)
      class(autocorrelation_observer), intent(inout) :: self
      integer, intent(in) :: it
      real(wp), intent(in) :: t
      real(wp), intent(in), contiguous :: values(:, :)
      logical, intent(in), contiguous :: counts(:)
      integer :: lag, now, before

      now = mod(it - 1, self%nlag + 1)
      self%last(:, now) = values(:, self%request%values(1)) - self%request%low
      do lag = 0, min(self%nlag, it - 1)
         before = modulo(it - 1 - lag, self%nlag + 1)
         call add(size(counts), self%last(:, now), self%last(:, before), self%product(:, lag), self%mean(:, lag))
      end do
   end subroutine take

   !> VEC Add x y and (x + y)/2 to the sums over time.
   pure subroutine add(nlane, x, y, product, mean)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: x(nlane), y(nlane)
      real(wp), intent(inout) :: product(nlane), mean(nlane)
      integer :: lane

      do lane = 1, nlane
         product(lane) = product(lane) + x(lane)*y(lane)
         mean(lane) = mean(lane) + 0.5_wp*(x(lane) + y(lane))
      end do
   end subroutine add

   subroutine close_block(self, state)
      class(autocorrelation_observer), intent(inout) :: self
      type(lane_state), intent(in) :: state
      real(wp) :: x(state%nlane, 4)
      logical :: counts(state%nlane)
      integer :: lag

      counts = state%status == 0
      if (allocated(self%mine)) counts = counts .and. self%mine
      if (.not. any(counts)) return
      x(:, 3) = self%product(:, 0)/self%run%ntime
      x(:, 4) = self%mean(:, 0)/self%run%ntime
      do lag = 0, self%nlag
         x(:, 1) = self%product(:, lag)/(self%run%ntime - lag)
         x(:, 2) = self%mean(:, lag)/(self%run%ntime - lag)
         call self%row(lag + 1, x, counts)
      end do
   end subroutine close_block

   integer(i8) function nanswer(self)
      class(autocorrelation_observer), intent(in) :: self

      nanswer = 2_i8*self%nrow
   end function nanswer

   subroutine answer(self, counts, sums, values, errors)
      class(autocorrelation_observer), intent(in) :: self
      integer(i8), intent(in) :: counts(:)
      real(wp), intent(in) :: sums(:)
      real(wp), intent(out) :: values(:), errors(:)
      type(moment_node) :: table
      real(wp) :: n, m, c, c0, rho, lag(4), zero(4), ratio(4)
      integer :: i

      values = ieee_value(n, ieee_quiet_nan)
      errors = values
      call self%to_table(sums, table)
      n = table%n(1)
      if (n < 0.5_wp) return
      m = table%mean(4, 1)
      lag = [1.0_wp, -2*m, 0.0_wp, 0.0_wp]   ! C(l) is linear in the columns of its row
      c0 = dot_product(lag, table%mean(:, 1)) + m**2
      zero = [0.0_wp, 0.0_wp, 1.0_wp, -2*m]  ! C(0) has the same columns
      do i = 1, self%nrow
         c = dot_product(lag, table%mean(:, i)) + m**2
         rho = c/merge(c0, 1.0_wp, abs(c0) > 0)
         ratio = lag - rho*zero
         values(2*i - 1) = c
         if (abs(c0) > 0) values(2*i) = rho
         if (n < 1.5_wp) cycle
         errors(2*i - 1) = sqrt(variance_along(lag, table%pairs(:, i))/(n - 1)/n)
         if (abs(c0) > 0) errors(2*i) = sqrt(variance_along(ratio, table%pairs(:, i))/(n - 1)/n)/abs(c0)
      end do
      if (n > 1.5_wp .and. abs(c0) > 0) errors(2) = 0  ! C(0)/C(0) is 1 without error
   end subroutine answer

   !> Sum of squared deviations of a combination of the columns.
   pure real(wp) function variance_along(weights, pairs)
      real(wp), intent(in) :: weights(4), pairs(:)
      integer :: i, j

      variance_along = 0
      do j = 1, 4
         do i = 1, j
            variance_along = variance_along + merge(1, 2, i == j)*weights(i)*weights(j)*pairs(pair_place(i, j))
         end do
      end do
      variance_along = max(variance_along, 0.0_wp) + 0*variance_along  ! max may drop a NaN
   end function variance_along

end module symsde_ensemble_observe_autocorrelation
