! SPDX-License-Identifier: BSD-3-Clause
!> Truncated increments (Milstein, Repin, Tretyakov 2002): dW = sqrt(h) clip(xi, +-c), c = sqrt(2 l |ln(h/tau)|).
!>
!> E(xi - clip xi)^2 <= (h/tau)^l, so schemes of strong order one need l >= 2. The formula depends on units: the time
!> scale tau must be given, and near h = tau all noise would be clipped.
!>
!> This module has the numbers alone; noise/functionals clips the increments of steps. The report of a run says how much
!> of the variance is lost.
module symsde_noise_truncation
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, invalid_argument
   use symsde_base_text, only: to_text
   implicit none
   private
   public :: truncation_bound, lost_variance, clip_probability

   real(wp), parameter :: smallest_cut = 3  !! below it more than a percent of the variance is lost

contains

   !> The bound c of the standard normal for the step h. Refused if c < 3, since too many increments would be clipped,
   !> or if l or tau is not a positive finite number in its range.
   subroutine truncation_bound(h, order, tau, cut, error)
      real(wp), intent(in) :: h      !! step size [time]
      real(wp), intent(in) :: order  !! l > 0
      real(wp), intent(in) :: tau    !! time scale of the problem [time]
      real(wp), intent(out) :: cut   !! c
      type(error_type), allocatable, intent(inout) :: error

      ! cut has this value if the bound is refused.
      cut = 0
      if (.not. (order > 0 .and. order <= 100 .and. tau > 0 .and. tau <= huge(tau))) then
         call raise(error, invalid_argument, 'truncation_bound', 'truncation takes an order l and a time '// &
                    'scale tau, given l = '//to_text(order)//' and tau = '//to_text(tau)// &
                    ': give 0 < l <= 100 (2 for schemes of strong order one) and a finite tau > 0')
         return
      end if
      cut = sqrt(2*order*abs(log(abs(h)/tau)))
      if (.not. cut >= smallest_cut) then
         call raise(error, invalid_argument, 'truncation_bound', 'truncation at step '//to_text(h)// &
                    ' with l = '//to_text(order)//' and tau = '//to_text(tau)//' cuts normals at '// &
                    to_text(cut)//' and loses '//to_text(100*lost_variance(cut))// &
                    ' % of the variance; the cut must be at least 3: take a smaller step, a larger l or '// &
                    'a larger tau')
      end if
   end subroutine truncation_bound

   !> 1 - E clip(xi)^2 = erfc(c/sqrt 2)(1 - c^2) + c sqrt(2/pi) exp(-c^2/2)
   elemental real(wp) function lost_variance(cut)
      real(wp), intent(in) :: cut  !! c
      real(wp), parameter :: pi = acos(-1.0_wp)

      lost_variance = erfc(cut/sqrt(2.0_wp))*(1 - cut**2) + cut*sqrt(2/pi)*exp(-0.5_wp*cut**2)
   end function lost_variance

   !> P(|xi| > c), the share of increments that are cut.
   elemental real(wp) function clip_probability(cut)
      real(wp), intent(in) :: cut  !! c

      clip_probability = erfc(cut/sqrt(2.0_wp))
   end function clip_probability

end module symsde_noise_truncation
