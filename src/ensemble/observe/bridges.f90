! SPDX-License-Identifier: BSD-3-Clause
!> A value that is inside an interval before and after a step may have been outside in between. A Brownian bridge gives
!> the probability, and a random number decides.
module symsde_ensemble_observe_bridges
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_noise_philox, only: philox_lanes, purpose_passage
   implicit none
   private
   public :: bridge_chances, deciding_numbers

contains

   !> Probabilities that values which are inside before and after a step left the interval below or above during it;
   !> zero if they are not inside, or if no noise acts on them.
   pure subroutine bridge_chances(n, low, high, h, rate, before, after, chance)
      integer, intent(in) :: n
      real(wp), intent(in) :: low, high
      real(wp), intent(in) :: h                !! > 0 [time]
      real(wp), intent(in) :: rate(n)          !! growth of the variance of each value, per time
      real(wp), intent(in) :: before(n), after(n)
      real(wp), intent(out) :: chance(n, 2)
      real(wp) :: spread
      integer :: i

      chance = 0
      do i = 1, n
         if (.not. (after(i) > low .and. after(i) < high)) cycle
         spread = rate(i)*h
         if (.not. spread > 0) cycle
         chance(i, 1) = passed(before(i) - low, after(i) - low, spread)
         chance(i, 2) = passed(high - before(i), high - after(i), spread)
      end do
   end subroutine bridge_chances

   !> Probability that a bridge between two points at distances a, b > 0 from an end has passed that end; 0 below 1e-20.
   pure real(wp) function passed(a, b, spread)
      real(wp), intent(in) :: a, b, spread   !! spread: s^2 h

      passed = 0
      if (2*a*b < 46*spread) passed = exp(-2*a*b/spread)
   end function passed

   !> One number in (0, 1) for each path, for a step and a watched value.
   subroutine deciding_numbers(n, seed, path, step, value, words, u)
      integer, intent(in) :: n, value
      integer(i8), intent(in) :: seed, step, path(n)
      integer(i8), intent(out) :: words(n, 4)        !! work
      real(wp), intent(out) :: u(n)

      call philox_lanes(n, seed, path, step, int(value, i4), 0_i4, purpose_passage, words)
      u = (real(words(:, 1), wp)*2.0_wp**32 + real(words(:, 2), wp) + 0.5_wp)*2.0_wp**(-64)
   end subroutine deciding_numbers

end module symsde_ensemble_observe_bridges
