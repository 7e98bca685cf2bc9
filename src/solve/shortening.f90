! SPDX-License-Identifier: BSD-3-Clause
!> Newton with shortened corrections: one that does not lower the residual is halved until it does,
!>
!>    x <- x - tau d,   A d = r(x),   tau = 1, 1/2, 1/4, ..  until  |r(x - tau d)| <= (1 - tau/4) |r(x)|
!>
!> with the largest entry of a lane's residual as its size, its merit. Only paths that plain Newton could not solve
!> come here, so these are plain loops, one lane at a time.
!>
!> An update calls `reject` before it solves, with the residual at the x of the last correction, and `accept` after it.
!> The system of a rejected lane is solved, too, but its solution is not used, as x is then a point on the way back.
module symsde_solve_shortening
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_positive_inf
   use symsde_base_kinds, only: wp
   implicit none
   private
   public :: shortening_type, new_shortening, start_shortening, reject, accept

   real(wp), parameter :: shortest = 2.0_wp**(-30)  !! a lane whose tau is below this fails
   real(wp), parameter :: rounding = 1e-10_wp       !! corrections smaller than this, relative to x, are not judged

   type :: shortening_type
      private
      real(wp), allocatable :: x(:, :), d(:, :)  !! last accepted unknowns and their correction (nlane, n)
      real(wp), allocatable :: merit(:)          !! largest residual at that x (nlane)
      real(wp), allocatable :: tau(:)            !! fraction of the correction applied (nlane)
      logical, allocatable :: rejected(:)        !! (nlane)
   end type shortening_type

contains

   !> Room for n unknowns in each of nlane lanes.
   subroutine new_shortening(self, nlane, n)
      type(shortening_type), intent(out) :: self
      integer, intent(in) :: nlane, n

      allocate (self%x(nlane, n), self%d(nlane, n), self%merit(nlane), self%tau(nlane), self%rejected(nlane))
   end subroutine new_shortening

   !> Start without a residual: the first residual is compared with infinity, so no correction is rejected.
   subroutine start_shortening(self)
      type(shortening_type), intent(inout) :: self

      self%merit = huge(1.0_wp)
      self%tau = 1
      self%x = 0
      self%d = 0
   end subroutine start_shortening

   !> Judge the last corrections by the residuals r at x, and halve corrections that did not lower them, x = x_old -
   !> tau d. A residual that is not finite counts as the largest number. Corrections at rounding are not judged. A lane
   !> whose tau is too short gets an infinite correction; the stopping test then fails it.
   subroutine reject(self, r, last, x, step, size)
      type(shortening_type), intent(inout) :: self
      real(wp), intent(in) :: r(:, :)              !! residuals at x (nlane, n)
      real(wp), intent(inout) :: last(:)           !! >= 0: the lane is running (nlane)
      real(wp), intent(inout) :: x(:, :), step(:), size(:)
      real(wp) :: merit
      integer :: lane

      do lane = 1, ubound(last, 1)
         merit = maxval(abs(r(lane, :)))
         ! Count a NaN as the largest number: comparisons with NaN are all false.
         if (.not. all(abs(r(lane, :)) <= huge(merit))) merit = huge(merit)
         ! Reject the correction of a running lane that has an earlier residual, if the new residual is not lower by the
         ! fraction tau/4, and the correction is above rounding.
         self%rejected(lane) = last(lane) >= 0 .and. self%merit(lane) < huge(merit) .and. &
                               .not. merit < (1 - 0.25_wp*self%tau(lane))*self%merit(lane) .and. &
                               maxval(abs(self%d(lane, :)))*self%tau(lane) > rounding*maxval(abs(self%x(lane, :)))
         if (self%rejected(lane)) then
            self%tau(lane) = self%tau(lane)/2
            x(lane, :) = self%x(lane, :) - self%tau(lane)*self%d(lane, :)
            step(lane) = last(lane)  ! counts as neither progress nor stagnation
            size(lane) = 0
            if (self%tau(lane) < shortest) step(lane) = ieee_value(merit, ieee_positive_inf)  ! fails the lane
         else
            self%merit(lane) = merit
         end if
      end do
   end subroutine reject

   !> Take the full corrections r of the running lanes that were not rejected, and keep x and correction for the next
   !> judgement.
   subroutine accept(self, r, last, x, step, size)
      type(shortening_type), intent(inout) :: self
      real(wp), intent(in) :: r(:, :)              !! corrections (nlane, n)
      real(wp), intent(in) :: last(:)
      real(wp), intent(inout) :: x(:, :), step(:), size(:)
      integer :: lane

      do lane = 1, ubound(last, 1)
         if (self%rejected(lane) .or. .not. last(lane) >= 0) cycle
         self%x(lane, :) = x(lane, :)
         self%d(lane, :) = r(lane, :)
         ! Each new correction is tried at full length.
         self%tau(lane) = 1
         x(lane, :) = x(lane, :) - r(lane, :)
         step(lane) = maxval(abs(r(lane, :))) + 0*sum(r(lane, :))
         size(lane) = maxval(abs(x(lane, :)))
      end do
   end subroutine accept

end module symsde_solve_shortening
