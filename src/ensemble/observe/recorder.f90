! SPDX-License-Identifier: BSD-3-Clause
!> The observer that saves paths directly into the caller's arrays. Values after a failure are NaN.
module symsde_ensemble_observe_recorder
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_vectors, only: copy
   use symsde_ensemble_observe_observer, only: observer_type
   use symsde_step_block_state, only: lane_state
   implicit none
   private
   public :: path_recorder

   integer, parameter :: few = 8  !! most lanes of a block that are copied one by one

   !> Pointers to the caller's arrays, path first; null where the caller wants none. The last good state is kept for
   !> resuming and diagnosis. Low parts belong to compensated runs only.
   type, extends(observer_type) :: path_recorder
      integer(i8) :: first_path = 0
      real(wp), pointer, contiguous :: q(:, :, :) => null()        !! (npath, ndof, 0:nsave)
      real(wp), pointer, contiguous :: p(:, :, :) => null()        !! (npath, ndof, 0:nsave)
      integer(i4), pointer, contiguous :: status(:) => null()      !! (npath)
      integer(i8), pointer, contiguous :: failed_step(:) => null() !! (npath)
      real(wp), pointer, contiguous :: last_q(:, :) => null(), last_p(:, :) => null()  !! last good state (npath, ndof)
      real(wp), pointer, contiguous :: q_low(:, :) => null(), p_low(:, :) => null()    !! low parts (npath, ndof)
      integer(i8), private :: offset = 0
      integer, private :: nreal = 0
   contains
      procedure :: begin_block
      procedure :: observe
      procedure :: observe_several
      procedure :: end_block
      procedure :: skip
   end type path_recorder

contains

   subroutine begin_block(self, first, nreal, nlane)
      class(path_recorder), intent(inout) :: self
      integer(i8), intent(in) :: first
      integer, intent(in) :: nreal, nlane

      self%offset = first - self%first_path
      self%nreal = nreal
   end subroutine begin_block

   subroutine observe(self, isave, t, state)
      class(path_recorder), intent(inout) :: self
      integer(i8), intent(in) :: isave
      real(wp), intent(in) :: t
      type(lane_state), intent(inout) :: state
      real(wp) :: nan
      integer :: i, lane

      if (.not. associated(self%q)) return
      nan = ieee_value(t, ieee_quiet_nan)
      do i = 1, state%ndof
         do lane = 1, self%nreal
            self%q(self%offset + lane, i, isave + 1) = merge(state%q(lane, i), nan, state%status(lane) == 0)
            self%p(self%offset + lane, i, isave + 1) = merge(state%p(lane, i), nan, state%status(lane) == 0)
         end do
      end do
   end subroutine observe

   !> Save several times at once, without a copy of the states. If the lanes are all paths of the run, whole arrays
   !> are copied; for few lanes of a larger run the loop over times is the inner one.
   subroutine observe_several(self, isave, nsave, t, nlane, q, p, state)
      class(path_recorder), intent(inout) :: self
      integer(i8), intent(in) :: isave
      integer, intent(inout) :: nsave
      real(wp), intent(in) :: t(nsave)
      integer, intent(in) :: nlane
      type(lane_state), intent(inout) :: state
      real(wp), intent(in) :: q(nlane, state%ndof, nsave), p(nlane, state%ndof, nsave)
      integer :: lane

      if (associated(self%q)) then
         associate (last => isave + nsave)
            if (nlane == size(self%q, 1) .and. all(state%status(:nlane) == 0)) then
               call copy_all(q, self%q(:, :, isave + 1:last))
               call copy_all(p, self%p(:, :, isave + 1:last))
            else if (self%nreal > few) then
               call copy_lanes(self%nreal, nsave, q, state%status, self%q(:, :, isave + 1:last), self%offset)
               call copy_lanes(self%nreal, nsave, p, state%status, self%p(:, :, isave + 1:last), self%offset)
            else
               do lane = 1, self%nreal
                  associate (path => self%offset + lane)
                     call copy_lane(lane, nsave, q, state%status(lane), self%q(:, :, isave + 1:last), path)
                     call copy_lane(lane, nsave, p, state%status(lane), self%p(:, :, isave + 1:last), path)
                  end associate
               end do
            end if
         end associate
      end if
      call state%take_first(nlane, q(1, 1, nsave), p(1, 1, nsave))
   end subroutine observe_several

   !> Copy the states of all paths of a run whose paths are all the lanes.
   pure subroutine copy_all(x, saved)
      real(wp), intent(in), contiguous :: x(:, :, :)
      real(wp), intent(inout), contiguous :: saved(:, :, :)

      call copy(size(x), x, saved)
   end subroutine copy_all

   !> Copy the first lanes of x to paths offset + 1, ... of saved; NaN in lanes with a status.
   pure subroutine copy_lanes(nreal, nsave, x, status, saved, offset)
      integer, intent(in) :: nreal, nsave
      integer(i8), intent(in) :: status(nreal), offset
      real(wp), intent(in), contiguous :: x(:, :, :)
      real(wp), intent(inout), contiguous :: saved(:, :, :)  !! (npath, ndof, nsave)
      real(wp) :: nan
      integer :: i, k, lane

      nan = ieee_value(1.0_wp, ieee_quiet_nan)
      do k = 1, nsave
         do i = 1, size(x, 2)
            do lane = 1, nreal
               saved(offset + lane, i, k) = merge(x(lane, i, k), nan, status(lane) == 0)
            end do
         end do
      end do
   end subroutine copy_lanes

   !> Copy one lane of x to a path of saved; NaN if the lane has a status.
   pure subroutine copy_lane(lane, nsave, x, status, saved, path)
      integer, intent(in) :: lane, nsave
      integer(i8), intent(in) :: status, path
      real(wp), intent(in), contiguous :: x(:, :, :)
      real(wp), intent(inout), contiguous :: saved(:, :, :)  !! (npath, ndof, nsave)
      integer :: i, k

      if (status /= 0) then
         saved(path, :, :) = ieee_value(1.0_wp, ieee_quiet_nan)
         return
      end if
      do i = 1, size(x, 2)
         !GCC$ unroll 4
         do k = 1, nsave
            saved(path, i, k) = x(lane, i, k)
         end do
      end do
   end subroutine copy_lane

   !> NaN at all times from isave on.
   subroutine skip(self, isave)
      class(path_recorder), intent(inout) :: self
      integer(i8), intent(in) :: isave
      integer(i8) :: a, b

      if (.not. associated(self%q)) return
      a = self%offset + 1
      b = self%offset + self%nreal
      self%q(a:b, :, isave + 1:) = ieee_value(1.0_wp, ieee_quiet_nan)
      self%p(a:b, :, isave + 1:) = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine skip

   subroutine end_block(self, state)
      class(path_recorder), intent(inout) :: self
      type(lane_state), intent(in) :: state
      integer(i8) :: a, b

      a = self%offset + 1
      b = self%offset + self%nreal
      self%status(a:b) = int(state%status(:self%nreal), i4)
      if (associated(self%failed_step)) self%failed_step(a:b) = state%failed_step(:self%nreal)
      if (associated(self%last_q)) self%last_q(a:b, :) = state%q(:self%nreal, :)
      if (associated(self%last_p)) self%last_p(a:b, :) = state%p(:self%nreal, :)
      if (.not. allocated(state%q_low)) return
      if (associated(self%q_low)) self%q_low(a:b, :) = state%q_low(:self%nreal, :)
      if (associated(self%p_low)) self%p_low(a:b, :) = state%p_low(:self%nreal, :)
   end subroutine end_block

end module symsde_ensemble_observe_recorder
