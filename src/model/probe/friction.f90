! SPDX-License-Identifier: BSD-3-Clause
!> Whether a force looks like linear friction, F_i = -gamma_i p_i with constants gamma_i: at three points around a
!> state, at two times. That is no proof, and replaces nothing. The report of a run says so, since the damping of a
!> model is exact where a force is not.
module symsde_model_probe_friction
   use symsde_base_kinds, only: wp
   use symsde_base_text, only: to_text
   use symsde_model_abstract, only: model_type
   use symsde_model_probe_points, only: probe_points, new_probe_points, nlane, npoint
   implicit none
   private
   public :: describe_friction

   real(wp), parameter :: alike = 1.0e-12_wp  !! relative differences of rates that are rounding

contains

   !> What to say of the force on a model; empty where it is no such friction.
   subroutine describe_friction(model, t, later, q0, p0, text)
      class(model_type), intent(in), target :: model
      real(wp), intent(in) :: t, later          !! two times of the run [time]
      real(wp), intent(in) :: q0(:), p0(:)      !! the initial state of a path (ndof)
      character(:), allocatable, intent(out) :: text
      type(probe_points) :: points
      real(wp), allocatable :: w(:, :), f(:, :), rate(:)
      integer :: i, n, lane, look

      text = ''
      if (.not. associated(model%forces)) return
      if (.not. model%traits%forces%drift .or. model%traits%forces%drift_in_position) return
      call new_probe_points(points, model, t, q0, p0)
      n = points%ndof
      allocate (w(nlane, 0:points%nnoise), f(nlane, n), rate(n), source=0.0_wp)
      w(:, 0) = 1
      do look = 1, 2
         call model%force(nlane, n, points%nnoise, merge(t, later, look == 1), w, points%q, points%p, f)
         ! the second point is displaced in every coordinate, so that no momentum vanishes there
         if (look == 1) rate = -f(2, :)/points%p(2, :)
         do i = 1, n
            do lane = 1, npoint
               if (.not. abs(f(lane, i) + rate(i)*points%p(lane, i)) <= alike*abs(f(lane, i))) return
            end do
         end do
      end do
      if (all(abs(rate) <= 0)) return
      text = 'by a force that is -gamma p wherever it was probed, gamma = '//to_text(minval(rate))
      if (maxval(rate) - minval(rate) > alike*maxval(abs(rate))) text = text//' to '//to_text(maxval(rate))
      text = text//': as damping its steps are exactly conformal, and more schemes take it'
   end subroutine describe_friction

end module symsde_model_probe_friction
