! SPDX-License-Identifier: BSD-3-Clause
!>    grad sum_k w_k H_k(t, q, p) = grad sum_k w_k H_k(0, q, p)   for all t?
!>
!> Whether noises change in time: compare their gradients at eight points and many times bit by bit, since a Hamiltonian
!> that does not depend on time gives the same bits at all times. Points and times can prove that noises change, not
!> that they do not: a change that is over between two of the tested times is not noticed. These are dense where times
!> of most models are, and reach to where those of any unit may be. Where parameters go by path, the noises of all paths
!> are looked at, eight paths at a time, each at a point. A parameter that is zero counts as small: steps of a path must
!> not depend on its neighbours, not by a last bit.
module symsde_model_probe_noise_time
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lane_unit
   use symsde_model_abstract, only: model_type
   use symsde_model_probe_one_path, only: one_path
   implicit none
   private
   public :: noise_changes_in_time

   real(wp), parameter :: earliest = 1.3e-30_wp, latest = 1e30_wp  !! first and last time of the test [time]
   real(wp), parameter :: usual(2) = [1.3e-3_wp, 1e5_wp]           !! times that are tested densely
   real(wp), parameter :: ratio = 1.618033988749895_wp             !! of successive times; no period fits them all

contains

   !> True if the gradient of the noises, all in one sum with different weights in each lane, differs at some later time
   !> from the gradient at t = 0.
   logical function noise_changes_in_time(model)
      class(model_type), intent(in), target :: model
      real(wp), dimension(lane_unit, model%traits%ndof) :: q, p
      real(wp) :: w(lane_unit, 0:model%traits%nnoise)
      type(one_path) :: paths
      integer(i8) :: place
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
      if (model%traits%nnoise == 0 .or. model%traits%autonomous) return
      call paths%begin(model, moves_zeros=.true.)
      do place = 0, paths%count - 1, lane_unit
         call paths%look_at(place, lane_unit)
         noise_changes_in_time = changes(paths%model, model%traits%ndof, model%traits%nnoise, w, q, p)
         if (noise_changes_in_time) exit
      end do
      call paths%finish()
   end function noise_changes_in_time

   !> Whether the gradient of this sum changes at these points.
   logical function changes(model, n, m, w, q, p)
      class(model_type), intent(in) :: model
      integer, intent(in) :: n, m
      real(wp), intent(in) :: w(lane_unit, 0:m)
      real(wp), intent(in), dimension(lane_unit, n) :: q, p
      real(wp), dimension(lane_unit, n) :: hq, hp, first_q, first_p
      real(wp) :: later

      changes = .false.
      call model%gradient(lane_unit, n, m, 0.0_wp, w, q, p, first_q, first_p)
      later = earliest
      ! About a hundred points in time, in geometric progression, since the model's unit of time is unknown.
      do while (later < latest)
         call model%gradient(lane_unit, n, m, later, w, q, p, hq, hp)
         changes = differ(size(hq), hq, first_q) .or. differ(size(hp), hp, first_p)
         if (changes) return
         later = merge(ratio, ratio**4, later >= usual(1) .and. later < usual(2))*later
      end do
   end function changes

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
