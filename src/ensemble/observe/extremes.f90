! SPDX-License-Identifier: BSD-3-Clause
!> The lowest and the highest value on each path up to each saved time.
!>
!> A row of the table is a saved time, its columns are the lowest and the highest value of a path until then. Answers
!> are their means with standard errors, (lowest or highest, time). counts are path and number of the saved time (t0 is
!> 0) of the lowest value of all paths and of the highest, -1 if there is none; these two values are the numbers of
!> single paths.
module symsde_ensemble_observe_extremes
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_value, ieee_quiet_nan
   use symsde_base_kinds, only: wp, i8
   use symsde_ensemble_statistics_path_tree, only: moment_node
   use symsde_ensemble_observe_streaming, only: streaming_observer
   implicit none
   private
   public :: extremes_observer, new_extremes_observer

   type, extends(streaming_observer) :: extremes_observer
      real(wp), allocatable :: reached(:, :)   !! lowest and highest value of each lane (nlane, 2)
   contains
      procedure :: open_block
      procedure :: take
      procedure :: clear
      procedure :: join
      procedure :: nanswer
      procedure :: answer
   end type extremes_observer

contains

   subroutine new_extremes_observer(self, ntime)
      type(extremes_observer), intent(out) :: self
      integer, intent(in) :: ntime

      self%nrow = ntime
      self%ncolumn = 2
      self%ncount = 4
      self%nsingle = 2
   end subroutine new_extremes_observer

   subroutine open_block(self)
      class(extremes_observer), intent(inout) :: self

      if (.not. allocated(self%reached)) allocate (self%reached(self%run%nlane, 2))
      self%reached(:, 1) = huge(1.0_wp)
      self%reached(:, 2) = -huge(1.0_wp)
   end subroutine open_block

   subroutine take(self, it, t, values, counts)
      class(extremes_observer), intent(inout) :: self
      integer, intent(in) :: it
      real(wp), intent(in) :: t
      real(wp), intent(in), contiguous :: values(:, :)
      logical, intent(in), contiguous :: counts(:)
      integer :: lane, side

      associate (x => values(:, self%request%values(1)))
         ! A NaN replaces the extreme and stays, so that it shows in the means.
         where (counts .and. .not. (x >= self%reached(:, 1) .or. ieee_is_nan(self%reached(:, 1)))) &
            self%reached(:, 1) = x
         where (counts .and. .not. (x <= self%reached(:, 2) .or. ieee_is_nan(self%reached(:, 2)))) &
            self%reached(:, 2) = x
         call self%row(it, self%reached, counts)
         if (.not. any(counts)) return
         do side = 1, 2
            lane = merge(minloc(x, 1, counts), maxloc(x, 1, counts), side == 1)
            if (ieee_is_nan(x(lane))) cycle
            if (self%counts(2*side - 1) >= 0) then
               if (.not. is_further(side, x(lane), self%first + lane - 1, self%singles(side), &
                                    self%counts(2*side - 1))) cycle
            end if
            self%singles(side) = x(lane)
            self%counts(2*side - 1:2*side) = [self%first + lane - 1, it - 1_i8]
         end do
      end associate
   end subroutine take

   !> Whether x is more extreme than x_old (lower, or higher, by side), or equal and on a path of lower index. Of equal
   !> values of one path the earlier is kept: times come in order, and a later value counts only if it is more extreme.
   pure logical function is_further(side, x, path, x_old, path_old)
      integer, intent(in) :: side   !! 1: lowest, 2: highest
      real(wp), intent(in) :: x, x_old
      integer(i8), intent(in) :: path, path_old

      is_further = merge(x < x_old, x > x_old, side == 1)
      if (x < x_old .or. x > x_old) return
      is_further = path < path_old
   end function is_further

   subroutine clear(self, counts, singles)
      class(extremes_observer), intent(in) :: self
      integer(i8), intent(out) :: counts(:)
      real(wp), intent(out) :: singles(:)

      counts = -1
      singles = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine clear

   subroutine join(self, counts, singles, more_counts, more_singles)
      class(extremes_observer), intent(in) :: self
      integer(i8), intent(inout) :: counts(:)
      real(wp), intent(inout) :: singles(:)
      integer(i8), intent(in) :: more_counts(:)
      real(wp), intent(in) :: more_singles(:)
      integer :: side

      do side = 1, 2
         associate (mine => counts(2*side - 1:2*side), other => more_counts(2*side - 1:2*side))
            if (other(1) < 0) cycle
            if (mine(1) >= 0) then
               if (.not. is_further(side, more_singles(side), other(1), singles(side), mine(1))) cycle
            end if
            mine = other
            singles(side) = more_singles(side)
         end associate
      end do
   end subroutine join

   integer(i8) function nanswer(self)
      class(extremes_observer), intent(in) :: self

      nanswer = 2_i8*self%nrow
   end function nanswer

   subroutine answer(self, counts, sums, values, errors)
      class(extremes_observer), intent(in) :: self
      integer(i8), intent(in) :: counts(:)
      real(wp), intent(in) :: sums(:)
      real(wp), intent(out) :: values(:), errors(:)
      type(moment_node) :: table
      real(wp) :: nan
      integer :: it

      nan = ieee_value(nan, ieee_quiet_nan)
      call self%to_table(sums, table)
      do it = 1, self%nrow
         associate (n => table%n(it), at => 2_i8*it)
            values(at - 1:at) = merge(table%mean(:, it), nan, n > 0.5_wp)
            errors(at - 1:at) = nan
            if (n > 1.5_wp) errors(at - 1:at) = sqrt(table%m2(:, it)/(n - 1)/n)
         end associate
      end do
   end subroutine answer

end module symsde_ensemble_observe_extremes
