! SPDX-License-Identifier: BSD-3-Clause
!> Counts of a value in bins, at every saved time: a histogram, or quantiles from bins of one relative width.
!>
!> counts(slot, time), with slots as in symsde_ensemble_statistics_bins: below, the bins, above, not a number. Answers
!> are the shares of the slots with binomial errors, or, if shares are requested, the quantiles (share, time) with their
!> errors.
module symsde_ensemble_observe_histogram
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type, raise, invalid_argument
   use symsde_base_text, only: to_text
   use symsde_ensemble_statistics_bins, only: bin_rule, new_equal_bins, new_relative_bins, quantile
   use symsde_ensemble_observe_streaming, only: streaming_observer, observer_request
   implicit none
   private
   public :: histogram_observer, new_histogram_observer

   integer, parameter :: most_bins = 1000000, most_parts = 4096

   type, extends(streaming_observer) :: histogram_observer
      type(bin_rule) :: rule
   contains
      procedure :: take
      procedure :: nanswer
      procedure :: answer
   end type histogram_observer

contains

   !> Make the observer of a histogram; `relative`: bins of one relative width instead of one absolute width.
   subroutine new_histogram_observer(self, request, ntime, relative, error)
      type(histogram_observer), intent(out) :: self
      type(observer_request), intent(in) :: request
      integer, intent(in) :: ntime
      logical, intent(in) :: relative
      type(error_type), allocatable, intent(inout) :: error
      integer :: i

      associate (low => request%low, high => request%high, bins => request%bins)
         if (.not. (low < high .and. high - low <= huge(low))) then
            call refuse('bins from '//to_text(low)//' to '//to_text(high)//' have no width: give low < high, both '// &
                        'finite')
         else if (relative .and. low < 2*tiny(low)) then
            call refuse('low = '//to_text(low)//' is too small for bins of equal relative width: give the smallest '// &
                        'magnitude that is to be distinguished from 0, 4.5e-308 or more')
         else if (relative .and. .not. any(bins == [(2**i, i=0, 12)])) then
            call refuse('bins = '//to_text(bins)//' parts of each power of two: give a power of two up to '// &
                        to_text(most_parts))
         else if (bins < 1 .or. bins > most_bins) then
            call refuse('bins = '//to_text(bins)//' is out of range: give 1 to '//to_text(most_bins))
         else if (relative) then
            call new_relative_bins(self%rule, low, high, bins)
         else
            call new_equal_bins(self%rule, low, high, bins)
         end if
      end associate
      self%ncount = int(self%rule%nslot(), i8)*ntime

   contains

      subroutine refuse(message)
         character(*), intent(in) :: message

         call raise(error, invalid_argument, 'new_histogram_observer', message)
      end subroutine refuse

   end subroutine new_histogram_observer

   subroutine take(self, it, t, values, counts)
      class(histogram_observer), intent(inout) :: self
      integer, intent(in) :: it
      real(wp), intent(in) :: t
      real(wp), intent(in), contiguous :: values(:, :)
      logical, intent(in), contiguous :: counts(:)
      integer(i8) :: at

      at = int(self%rule%nslot(), i8)*(it - 1)
      call self%rule%count_lanes(values(:, self%request%values(1)), counts, self%counts(at + 1:at + self%rule%nslot()))
   end subroutine take

   integer(i8) function nanswer(self)
      class(histogram_observer), intent(in) :: self

      nanswer = self%ncount
      if (allocated(self%request%shares)) nanswer = self%run%ntime*size(self%request%shares, kind=i8)
   end function nanswer

   subroutine answer(self, counts, sums, values, errors)
      class(histogram_observer), intent(in) :: self
      integer(i8), intent(in) :: counts(:)
      real(wp), intent(in) :: sums(:)
      real(wp), intent(out) :: values(:), errors(:)
      integer(i8) :: at, to
      integer :: it, i, nslot

      nslot = self%rule%nslot()
      do it = 1, self%run%ntime
         at = int(nslot, i8)*(it - 1)
         if (allocated(self%request%shares)) then
            do i = 1, size(self%request%shares)
               to = size(self%request%shares)*int(it - 1, i8) + i
               call quantile(self%rule, counts(at + 1:at + nslot), self%request%shares(i), values(to), errors(to))
            end do
         else
            call shares_of(counts(at + 1:at + nslot), values(at + 1:at + nslot), errors(at + 1:at + nslot))
         end if
      end do
   end subroutine answer

   !> Counts divided by their sum, with binomial standard errors; NaN where nothing was counted.
   pure subroutine shares_of(counts, shares, errors)
      integer(i8), intent(in) :: counts(:)
      real(wp), intent(out) :: shares(:), errors(:)
      real(wp) :: n

      n = real(sum(counts), wp)
      if (n < 0.5_wp) then
         shares = ieee_value(n, ieee_quiet_nan)
         errors = shares
         return
      end if
      shares = real(counts, wp)/n
      errors = sqrt(shares*(1 - shares)/n)
   end subroutine shares_of

end module symsde_ensemble_observe_histogram
