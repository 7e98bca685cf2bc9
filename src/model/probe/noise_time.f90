! SPDX-License-Identifier: BSD-3-Clause
!>    grad sum_k w_k H_k(t, q, p) = grad sum_k w_k H_k(0, q, p)   for all t?
!>
!> Whether noises change in time: compare their gradients at eight points and many times bit by bit, since a Hamiltonian
!> that does not depend on time gives the same bits at all times. Points and times can prove that noises change, not
!> that they do not: a change after 1e5 units of time, or one that is over between two of the tested times, is not
!> noticed.
module symsde_model_probe_noise_time
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lane_unit
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: noise_changes_in_time

   real(wp), parameter :: earliest = 1.3e-3_wp, latest = 1e5_wp  !! first and last time of the test [time]
   real(wp), parameter :: ratio = 1.618033988749895_wp           !! ratio of successive times; no period fits them all

contains

   !> True if the gradient of the noises, all in one sum with different weights in each lane, differs at some later time
   !> from the gradient at t = 0.
   logical function noise_changes_in_time(model)
      class(model_type), intent(in) :: model
      real(wp), dimension(lane_unit, model%traits%ndof) :: q, p, hq, hp, first_q, first_p
      real(wp) :: w(lane_unit, 0:model%traits%nnoise)
      real(wp) :: later
      integer :: i, l

      noise_changes_in_time = .false.
      ! The states are fixed, of order one, and different in all lanes, so that the result does not depend on a run.
      do i = 1, model%traits%ndof
         q(:, i) = [(sin(1.3_wp*i + 0.7_wp*l), l=1, lane_unit)]
         p(:, i) = [(cos(0.9_wp*i + 1.1_wp*l), l=1, lane_unit)]
      end do
      ! H may depend on time and has weight zero. The weights of noises differ, so that two noises cannot cancel at all
      ! points.
      w(:, 0) = 0
      do i = 1, model%traits%nnoise
         w(:, i) = [(1 + 0.37_wp*sin(1.9_wp*i + l), l=1, lane_unit)]
      end do
      associate (n => model%traits%ndof, m => model%traits%nnoise)
         if (m == 0) return
         call model%gradient(lane_unit, n, m, 0.0_wp, w, q, p, first_q, first_p)
         later = earliest
         ! Test about forty points in time, in geometric progression, since the model's unit of time is unknown.
         do while (later < latest)
            call model%gradient(lane_unit, n, m, later, w, q, p, hq, hp)
            noise_changes_in_time = differ(size(hq), hq, first_q) .or. differ(size(hp), hp, first_p)
            if (noise_changes_in_time) return
            later = ratio*later
         end do
      end associate
   end function noise_changes_in_time

   !> VEC Whether some number differs; a number that is NaN at one time only (sin(t)/t at 0) has not changed.
   pure logical function differ(n, a, b)
      integer, intent(in) :: n
      real(wp), intent(in) :: a(n), b(n)
      integer(i8) :: changed
      integer :: i

      changed = 0
      do i = 1, n
         ! Count all changes instead of leaving the loop at the first change: a loop without an exit can be vectorised.
         changed = changed + merge(1_i8, 0_i8, (abs(a(i)) <= huge(a) .or. abs(b(i)) <= huge(b)) .and. &
                                   .not. abs(a(i) - b(i)) <= 0)
      end do
      differ = changed > 0
   end function differ

end module symsde_model_probe_noise_time
