! SPDX-License-Identifier: BSD-3-Clause
!> Whether noises change in time: their gradients at eight points and some times, compared bit by bit, for a
!> Hamiltonian that does not depend on time gives the same bits at all times. Points and times can prove that
!> noises change, not that they do not.
module symsde_model_noise_time
   use symsde_base_kinds, only: wp
   use symsde_base_lanes, only: lane_unit
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: noise_changes_in_time

   real(wp), parameter :: later(7) = [1.7e-6_wp, 1.3e-3_wp, 0.0137_wp, 0.61_wp, 1.93_wp, 47.1_wp, 8.3e3_wp]  !! [time]

contains

   !> True where the gradient of some H_k, k >= 1, is another at a later time than at t = 0.
   logical function noise_changes_in_time(model)
      class(model_type), intent(in) :: model
      real(wp), dimension(lane_unit, model%traits%ndof) :: q, p, hq, hp, first_q, first_p
      real(wp) :: w(lane_unit, 0:model%traits%nnoise)
      integer :: i, l

      noise_changes_in_time = .false.
      do i = 1, model%traits%ndof
         q(:, i) = [(sin(1.3_wp*i + 0.7_wp*l), l=1, lane_unit)]
         p(:, i) = [(cos(0.9_wp*i + 1.1_wp*l), l=1, lane_unit)]
      end do
      w(:, 0) = 0
      do i = 1, model%traits%nnoise
         w(:, i) = [(1 + 0.37_wp*sin(1.9_wp*i + l), l=1, lane_unit)]
      end do
      associate (n => model%traits%ndof, m => model%traits%nnoise)
         if (m == 0) return
         call model%gradient(lane_unit, n, m, 0.0_wp, w, q, p, first_q, first_p)
         do i = 1, size(later)
            call model%gradient(lane_unit, n, m, later(i), w, q, p, hq, hp)
            if (any(abs(hq - first_q) > 0) .or. any(abs(hp - first_p) > 0)) noise_changes_in_time = .true.
            if (noise_changes_in_time) return
         end do
      end associate
   end function noise_changes_in_time

end module symsde_model_noise_time
