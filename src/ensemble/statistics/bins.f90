! SPDX-License-Identifier: BSD-3-Clause
!> Bins for counting numbers: bins of equal width between two numbers, or bins of equal relative width on both sides of
!> zero.
!>
!> Slots are 0 (below all bins), 1 .. nbin (ascending), nbin + 1 (above them) and nbin + 2 (NaN). Bins of equal relative
!> width, up to a factor of two, are 2^k equal parts of each power of two: the bin of a number is read from the bits of
!> the number, so that it is the same on every machine. Numbers smaller than all bins fall into the bin of zero, the
!> middle one.
module symsde_ensemble_statistics_bins
   use symsde_base_kinds, only: wp, i8
   implicit none
   private
   public :: bin_rule, new_equal_bins, new_relative_bins, quantile

   integer, parameter :: digits_of_mantissa = 52
   integer, parameter :: others = 3  !! slots besides the bins

   type :: bin_rule
      integer :: nbin = 0
      logical :: relative = .false.
      real(wp) :: low = 0, high = 0     !! range of equal bins
      integer :: side = 0, shift = 0    !! relative bins: bins of each sign; bits shifted out of a number
      integer(i8) :: base = 0           !! the remaining bits of the smallest magnitude
   contains
      procedure :: nslot
      procedure :: count_lanes
      procedure :: lower
      procedure :: middle
   end type bin_rule

contains

   !> nbin bins of equal width from low to high.
   pure subroutine new_equal_bins(self, low, high, nbin)
      type(bin_rule), intent(out) :: self
      real(wp), intent(in) :: low, high   !! finite, low < high
      integer, intent(in) :: nbin         !! 1 or more

      self%nbin = nbin
      self%low = low
      self%high = high
   end subroutine new_equal_bins

   !> Bins for magnitudes from low to high, widened to powers of two; each power of two is divided into this many parts.
   pure subroutine new_relative_bins(self, low, high, parts)
      type(bin_rule), intent(out) :: self
      real(wp), intent(in) :: low, high   !! normal numbers, 0 < low < high
      integer, intent(in) :: parts        !! a power of two
      integer(i8) :: last

      self%relative = .true.
      self%shift = digits_of_mantissa - exponent(real(parts, wp)) + 1
      self%base = shiftr(transfer(set_exponent(0.5_wp, exponent(low)), 0_i8), self%shift)
      last = shiftr(transfer(scale(1.0_wp, exponent(nearest(high, -1.0_wp))), 0_i8), self%shift)
      self%side = int(last - self%base)
      self%nbin = 2*self%side + 1
   end subroutine new_relative_bins

   pure integer function nslot(self)
      class(bin_rule), intent(in) :: self

      nslot = self%nbin + others
   end function nslot

   !> Count the values of the lanes that take part.
   pure subroutine count_lanes(self, x, counts, slots)
      class(bin_rule), intent(in) :: self
      real(wp), intent(in), contiguous :: x(:)
      logical, intent(in) :: counts(:)
      integer(i8), intent(inout) :: slots(0:)
      integer :: slot(size(x)), lane

      if (self%relative) then
         call find_relative(size(x), x, self%base, self%shift, self%side, slot)
      else
         call find_equal(size(x), x, self%low, self%high, self%nbin, slot)
      end if
      do lane = 1, size(x)
         if (counts(lane)) slots(slot(lane)) = slots(slot(lane)) + 1
      end do
   end subroutine count_lanes

   !> VEC Slots of numbers: the quotient, corrected by comparing with the two edges of the bin, since the quotient may
   !> be off by rounding.
   pure subroutine find_equal(n, x, low, high, nbin, slot)
      integer, intent(in) :: n, nbin
      real(wp), intent(in) :: x(n), low, high
      integer, intent(out) :: slot(n)
      real(wp) :: inside, rate, width
      integer :: lane

      rate = nbin/(high - low)
      width = (high - low)/nbin
      do lane = 1, n
         inside = merge(x(lane), low, x(lane) >= low .and. x(lane) < high)
         slot(lane) = 1 + min(int((inside - low)*rate), nbin - 1)
         slot(lane) = slot(lane) - merge(1, 0, inside < low + (slot(lane) - 1)*width)
         slot(lane) = slot(lane) + merge(1, 0, slot(lane) < nbin .and. inside >= low + slot(lane)*width)
         slot(lane) = merge(slot(lane), 0, x(lane) >= low)
         slot(lane) = merge(nbin + 1, slot(lane), x(lane) >= high)
         slot(lane) = merge(slot(lane), nbin + 2, x(lane) >= low .or. x(lane) < low)
      end do
   end subroutine find_equal

   !> VEC Slots of numbers, from their sign, exponent and leading bits.
   pure subroutine find_relative(n, x, base, shift, side, slot)
      integer, intent(in) :: n, shift, side
      real(wp), intent(in) :: x(n)
      integer(i8), intent(in) :: base
      integer, intent(out) :: slot(n)
      integer(i8) :: place
      integer :: lane

      do lane = 1, n
         place = shiftr(transfer(abs(x(lane)), 0_i8), shift) - base + 1
         place = min(max(place, 0_i8), int(side, i8) + 1)
         slot(lane) = side + 1 + int(merge(-place, place, x(lane) < 0))
         slot(lane) = merge(slot(lane), 2*side + 3, x(lane) >= 0 .or. x(lane) < 0)
      end do
   end subroutine find_relative

   !> Lower edge of bin i; for i = nbin + 1 the upper edge of the last bin.
   pure real(wp) function lower(self, i)
      class(bin_rule), intent(in) :: self
      integer, intent(in) :: i

      if (self%relative) then
         if (i > self%side + 1) then
            lower = transfer(shiftl(self%base + (i - self%side - 2), self%shift), 0.0_wp)
         else
            lower = -transfer(shiftl(self%base + (self%side + 1 - i), self%shift), 0.0_wp)
         end if
      else
         lower = self%low + (i - 1)*((self%high - self%low)/self%nbin)
         if (i > self%nbin) lower = self%high
      end if
   end function lower

   !> The middle of bin i; for the slots below and above the bins, the edge of the bins on that side.
   pure real(wp) function middle(self, i)
      class(bin_rule), intent(in) :: self
      integer, intent(in) :: i

      if (i < 1) then
         middle = self%lower(1)
      else if (i > self%nbin) then
         middle = self%lower(self%nbin + 1)
      else
         middle = 0.5_wp*(self%lower(i) + self%lower(i + 1))
      end if
   end function middle

   !> Quantile: the middle of the bin below which a share of all counted numbers lies. Its error is the chance error
   !> (one standard error, from the ranks) combined with half the width of the bin. NaN if nothing was counted, if some
   !> value was NaN, or if the quantile lies outside of all bins.
   pure subroutine quantile(rule, slots, share, x, error)
      use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
      type(bin_rule), intent(in) :: rule
      integer(i8), intent(in) :: slots(0:)     !! counts
      real(wp), intent(in) :: share            !! 0 .. 1
      real(wp), intent(out) :: x, error
      real(wp) :: n, spread
      integer :: i, first, last

      x = ieee_value(x, ieee_quiet_nan)
      error = x
      n = real(sum(slots(0:rule%nbin + 1)), wp)
      if (n < 0.5_wp .or. slots(rule%nbin + 2) > 0) return
      i = slot_of_rank(rule%nbin, slots, share*n)
      if (i < 1 .or. i > rule%nbin) return
      spread = sqrt(share*(1 - share)/n)
      first = slot_of_rank(rule%nbin, slots, max(share - spread, 0.0_wp)*n)
      last = slot_of_rank(rule%nbin, slots, min(share + spread, 1.0_wp)*n)
      x = rule%middle(i)
      if (first < 1 .or. last > rule%nbin) return
      error = 0.5_wp*((rule%middle(last) - rule%middle(first)) + (rule%lower(i + 1) - rule%lower(i)))
   end subroutine quantile

   !> The slot that contains the number of a rank 0 .. n.
   pure integer function slot_of_rank(nbin, slots, rank) result(i)
      integer, intent(in) :: nbin
      integer(i8), intent(in) :: slots(0:)
      real(wp), intent(in) :: rank
      integer(i8) :: below
      integer :: k

      below = 0
      i = 0
      do k = 0, nbin + 1
         if (slots(k) == 0) cycle
         i = k
         below = below + slots(k)
         if (real(below, wp) >= rank) return
      end do
   end function slot_of_rank

end module symsde_ensemble_statistics_bins
