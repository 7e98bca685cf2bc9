! SPDX-License-Identifier: BSD-3-Clause
!> Steps and noises driven by plain arrays, which are copied into records and stores of steps, and back.
module drive
   use symsde_base_functionals, only: path_dz, path_areas, functional_set
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record, step_store, step_request, new_step_store
   use symsde_noise_source, only: noise_type
   use symsde_step_stepper, only: stepper_type
   implicit none
   private
   public :: take_step, fill_steps, record_of

contains

   !> One step of a stepper from time t with the weights w, and with dZ and areas if the scheme uses them.
   subroutine take_step(stepper, t, w, q, p, dq, dp, status, z, area)
      class(stepper_type), intent(inout) :: stepper
      real(wp), intent(in) :: t, w(:, 0:), q(:, :), p(:, :)  ! (nlane, 0:nnoise), (nlane, ndof)
      real(wp), intent(out) :: dq(:, :), dp(:, :)
      integer(i8), intent(inout) :: status(:)
      real(wp), intent(in), optional :: z(:, :), area(:, :)
      type(step_store), target :: store
      type(step_record) :: step

      call record_of(store, step, t, w, z, area)
      call stepper%increment(step, q, p, dq, dp, status)
   end subroutine take_step

   !> A record of one step. It points into the store, which must outlive it.
   subroutine record_of(store, step, t, w, z, area)
      type(step_store), intent(out), target :: store
      type(step_record), intent(out) :: step
      real(wp), intent(in) :: t, w(:, 0:)
      real(wp), intent(in), optional :: z(:, :), area(:, :)
      type(functional_set) :: asked

      asked%has(path_dz) = present(z)
      asked%has(path_areas) = present(area)
      call new_step_store(store, size(w, 1), ubound(w, 2), 2, w(1, 0), asked)
      store%w(:, :, 0) = w
      if (present(z)) store%of(path_dz)%x(:, :, 0) = z
      if (present(area)) store%of(path_areas)%x(:, :, 0) = area
      call store%show(0, t, step)
   end subroutine record_of

   !> Draw as many steps as w holds, from step 2*pair on; z and area are present if the source was asked for them. The
   !> number of normals drawn is added to drawn.
   subroutine fill_steps(noise, path, pair, w, drawn, nreal, z, area)
      class(noise_type), intent(in) :: noise
      integer(i8), intent(in) :: path(:), pair
      real(wp), intent(inout) :: w(:, 0:, 0:)  ! (nlane, 0:nnoise, 0:nstep-1)
      integer(i8), intent(inout) :: drawn
      integer, intent(in), optional :: nreal
      real(wp), intent(inout), optional :: z(:, :, :), area(:, :, :)
      type(step_store) :: store
      type(step_request) :: request
      integer(i8) :: more

      call new_step_store(store, size(path), ubound(w, 2), size(w, 3), w(1, 0, 0), noise%asked)
      store%w = w
      if (present(z)) store%of(path_dz)%x = z
      if (present(area)) store%of(path_areas)%x = area
      request = step_request(size(path), size(path), path, pair, size(w, 3)/2)
      if (present(nreal)) request%nreal = nreal
      call noise%fill(request, store, more)
      w = store%w
      if (present(z)) z = store%of(path_dz)%x
      if (present(area)) area = store%of(path_areas)%x
      drawn = drawn + more
   end subroutine fill_steps

end module drive
