! SPDX-License-Identifier: BSD-3-Clause
!> One step of a scheme, from many states, by the stepper that the factory chooses and by the general one.
module against_general
   use drive, only: take_step
   use scenes, only: stepper_of, draw_weights
   use symsde_base_kinds, only: wp, i8
   use symsde_model_abstract, only: model_type
   use symsde_step_factory, only: stepper_options
   use symsde_step_stepper, only: stepper_type
   implicit none
   private
   public :: states, disagreement

contains

   !> States in soft and steep parts of the potentials.
   subroutine states(nlane, n, q, p)
      integer, intent(in) :: nlane, n
      real(wp), allocatable, intent(out) :: q(:, :), p(:, :)   !! (nlane, n)
      integer :: i

      allocate (q(nlane, n), p(nlane, n))
      q = reshape([(0.5_wp*sin(0.7_wp*i + 0.3_wp), i=1, nlane*n)], [nlane, n])
      p = reshape([(0.5_wp*cos(1.3_wp*i), i=1, nlane*n)], [nlane, n])
   end subroutine states

   !> Largest difference of the increments of 32 states, in units of the last place of the increments of that path, or
   !> of h times its state where that is larger; huge if the factory chooses another stepper, or a step fails.
   real(wp) function disagreement(model, scheme, h, name, scale) result(worst)
      class(model_type), intent(in), target :: model
      character(*), intent(in) :: scheme
      real(wp), intent(in) :: h
      character(*), intent(in) :: name         !! name of the stepper that the factory must choose
      real(wp), intent(in), optional :: scale  !! factor of the first stepper's increments: a planted fault
      integer, parameter :: nlane = 32
      class(stepper_type), allocatable :: stages, general
      real(wp), allocatable :: w(:, :, :)
      real(wp), allocatable, dimension(:, :) :: q, p, dq1, dp1, dq2, dp2, z, area
      integer(i8) :: status1(nlane), status2(nlane)
      integer :: lane

      call stepper_of(stages, model, scheme, stepper_options(), nlane)
      call stepper_of(general, model, scheme, stepper_options(general=.true.), nlane)
      call draw_weights(nlane, model%traits%nnoise, 1, h, 20240301_i8, w)
      call states(nlane, model%traits%ndof, q, p)
      allocate (dq1, dp1, dq2, dp2, mold=q)
      associate (m => model%traits%nnoise)
         allocate (z(nlane, m), area(nlane, m*(m - 1)/2))
      end associate
      z = 0.3_wp*h*w(:, 1:, 0)
      area = 0.2_wp*h
      status1 = 0
      status2 = 0
      call take_step(stages, 0.3_wp, w(:, :, 0), q, p, dq1, dp1, status1, z, area)
      call take_step(general, 0.3_wp, w(:, :, 0), q, p, dq2, dp2, status2, z, area)
      if (present(scale)) dq1 = scale*dq1
      worst = 0
      do lane = 1, nlane
         worst = max(worst, max(maxval(abs(dq1(lane, :) - dq2(lane, :))), maxval(abs(dp1(lane, :) - dp2(lane, :)))) &
                     /spacing(max(maxval(abs(dq2(lane, :))), maxval(abs(dp2(lane, :))), &
                                  h*maxval(abs(q(lane, :))), h*maxval(abs(p(lane, :))))))
      end do
      if (any(status1 /= 0) .or. any(status2 /= 0) .or. stages%name /= name) worst = huge(worst)
   end function disagreement

end module against_general
