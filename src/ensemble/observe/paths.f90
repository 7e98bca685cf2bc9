! SPDX-License-Identifier: BSD-3-Clause
!> Chosen paths: some of their values at every saved time, beside the other results of the ensemble. counts: 0 for each
!> path that was run, -1 for a path that was not. The numbers of single paths are the answers, with errors of zero:
!> (value, time, path), NaN after a path has failed or left.
module symsde_ensemble_observe_paths
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type, raise, invalid_argument
   use symsde_base_text, only: to_text
   use symsde_ensemble_observe_streaming, only: streaming_observer, observer_request, observed_run
   implicit none
   private
   public :: paths_observer, new_paths_observer

   type, extends(streaming_observer) :: paths_observer
      integer, allocatable :: place(:)   !! place of each lane among the chosen paths; 0 = not chosen (nlane)
   contains
      procedure :: open_block
      procedure :: take
      procedure :: clear
      procedure :: join
      procedure :: nanswer
      procedure :: answer
   end type paths_observer

contains

   subroutine new_paths_observer(self, request, run, error)
      type(paths_observer), intent(out) :: self
      type(observer_request), intent(in) :: request
      type(observed_run), intent(in) :: run
      type(error_type), allocatable, intent(inout) :: error
      integer(i8) :: before
      integer :: i

      if (.not. allocated(request%paths)) then
         call raise(error, invalid_argument, 'new_paths_observer', 'no path is chosen: give at least one')
         return
      end if
      before = -1
      do i = 1, size(request%paths)
         if (request%paths(i) <= before) then
            call raise(error, invalid_argument, 'new_paths_observer', 'path '//to_text(request%paths(i))// &
                       ' comes after '//to_text(before)//': give indices from 0 on, in ascending order')
         end if
         before = request%paths(i)
      end do
      self%ncount = size(request%paths, kind=i8)
      self%nsingle = self%ncount*size(request%values)*run%ntime
   end subroutine new_paths_observer

   subroutine open_block(self)
      class(paths_observer), intent(inout) :: self
      integer :: i

      if (.not. allocated(self%place)) allocate (self%place(self%run%nlane))
      self%place = 0
      do i = 1, size(self%request%paths)
         associate (path => self%request%paths(i))
            if (path < self%first .or. path >= self%first + self%nreal) cycle
            if (allocated(self%mine)) then
               if (.not. self%mine(path - self%first + 1)) cycle
            end if
            self%place(path - self%first + 1) = i
            self%counts(i) = 0
         end associate
      end do
   end subroutine open_block

   subroutine take(self, it, t, values, counts)
      class(paths_observer), intent(inout) :: self
      integer, intent(in) :: it
      real(wp), intent(in) :: t
      real(wp), intent(in), contiguous :: values(:, :)
      logical, intent(in), contiguous :: counts(:)
      integer(i8) :: at
      integer :: lane, n

      n = size(self%request%values)
      do lane = 1, self%nreal
         if (self%place(lane) == 0 .or. .not. counts(lane)) cycle
         at = n*((self%place(lane) - 1_i8)*self%run%ntime + it - 1)
         self%singles(at + 1:at + n) = values(lane, self%request%values)
      end do
   end subroutine take

   subroutine clear(self, counts, singles)
      class(paths_observer), intent(in) :: self
      integer(i8), intent(out) :: counts(:)
      real(wp), intent(out) :: singles(:)

      counts = -1
      singles = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine clear

   subroutine join(self, counts, singles, more_counts, more_singles)
      class(paths_observer), intent(in) :: self
      integer(i8), intent(inout) :: counts(:)
      real(wp), intent(inout) :: singles(:)
      integer(i8), intent(in) :: more_counts(:)
      real(wp), intent(in) :: more_singles(:)
      integer(i8) :: n, i

      n = self%nsingle/max(self%ncount, 1_i8)
      do i = 1, self%ncount
         if (more_counts(i) < 0) cycle
         counts(i) = more_counts(i)
         singles((i - 1)*n + 1:i*n) = more_singles((i - 1)*n + 1:i*n)
      end do
   end subroutine join

   integer(i8) function nanswer(self)
      class(paths_observer), intent(in) :: self

      nanswer = self%nsingle
   end function nanswer

   subroutine answer(self, counts, sums, values, errors)
      class(paths_observer), intent(in) :: self
      integer(i8), intent(in) :: counts(:)
      real(wp), intent(in) :: sums(:)
      real(wp), intent(out) :: values(:), errors(:)

      values = sums
      errors = 0
   end subroutine answer

end module symsde_ensemble_observe_paths
