! SPDX-License-Identifier: BSD-3-Clause
!> A view of a model that evaluates the real lanes only where at most half of a block is real: lanes that pad it to
!> full vectors are not passed to the model. With more, the whole block is: a compiler's vector loop takes all of its
!> lanes at once, in half the time of five, while a loop over one lane after another takes 1.6 times that of five.
!>
!> For models whose lanes have the same bits for any number of lanes (traits%any_lanes): a function that loops over
!> lanes then takes the time of one lane for one path, and not of eight. Inputs of the real lanes are gathered, outputs
!> distributed; padding gets the outputs of the last real lane, as if it had been computed.
module symsde_model_views_real_lanes
   use symsde_base_contracts, only: contracts_are_executed, require_padded
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lane_unit
   use symsde_base_maps, only: step_map
   use symsde_base_record, only: steps_record
   use symsde_model_abstract, only: model_type
   use symsde_model_contract, only: require_real_lanes
   use symsde_model_kernels, only: kernel_model, kernel_offers, kernels_of, offers_of
   implicit none
   private
   public :: real_lanes_model, new_real_lanes, fits_real_lanes

   integer, parameter :: narray = 10  !! w, q, p; a product's vectors or qq and qp; gradient; pp; further vectors

   type :: buffer_type
      real(wp), allocatable :: x(:)
   end type buffer_type

   !> One view for each thread: its buffers are used by one call at a time. It has no value function, since steps need
   !> none.
   type, extends(kernel_model) :: real_lanes_model
      private
      class(model_type), pointer :: model => null()
      class(kernel_model), pointer :: kernels => null()       !! whole steps of the model, if it has any
      integer, public :: nreal = 0                            !! number of real lanes; lanes past it are padding
      type(buffer_type), pointer :: buffer(:) => null()       !! (narray); a pointer, since a model is intent(in)
   contains
      procedure :: gradient
      procedure :: hessian
      procedure :: hessian_vector
      procedure :: third_derivative
      procedure :: gradient_hessian
      procedure :: hessian_banded
      procedure :: squares
      procedure :: has_flow
      procedure :: steps_by_parts
      procedure :: flow
      procedure :: failure_code
      procedure :: clear_failure
      procedure :: note_failure
      final :: release
   end type real_lanes_model

contains

   !> Whether the view is for this model: a user's functions that accept any number of lanes. Others are called with
   !> padding.
   pure logical function fits_real_lanes(model)
      class(model_type), intent(in) :: model
      type(kernel_offers) :: offers

      offers = offers_of(model)
      fits_real_lanes = model%traits%any_lanes .and. .not. offers%rows  ! rows come in strips of a fixed width
   end function fits_real_lanes

   !> Make a view of a model, which must outlive it.
   subroutine new_real_lanes(self, model)
      type(real_lanes_model), intent(inout) :: self
      class(model_type), intent(in), target :: model
      type(kernel_offers) :: offers

      self%traits = model%traits
      self%name = model%name
      self%paths => model%paths
      self%forces => model%forces
      self%model => model
      self%kernels => kernels_of(model)
      offers = offers_of(model)
      self%offers%squares = offers%squares
      self%nreal = huge(0)  ! until a block sets it: calls at set-up have no padding
      allocate (self%buffer(narray))
   end subroutine new_real_lanes

   impure elemental subroutine release(self)
      type(real_lanes_model), intent(inout) :: self
      integer :: i

      if (.not. associated(self%buffer)) return
      do i = 1, size(self%buffer)  ! gfortran 12 frees the array of buffers without their components
         if (allocated(self%buffer(i)%x)) deallocate (self%buffer(i)%x)
      end do
      deallocate (self%buffer)
   end subroutine release

   !> Gradient of sum_j w_j H_j.
   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(real_lanes_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), pointer, contiguous :: a(:), b(:)

      if (self%nreal > nlane/2) then
         call self%model%gradient(nlane, ndof, nnoise, t, w, q, p, hq, hp)
         return
      end if
      call take_inputs(self, nlane, ndof, nnoise, w, q, p)
      call take_buffer(self, 6, ndof, present(hq), a)
      call take_buffer(self, 7, ndof, present(hp), b)
      associate (r => self%buffer, n => self%nreal)
         call self%model%gradient(n, ndof, nnoise, t, r(1)%x, r(2)%x, r(3)%x, a, b)
         if (present(hq)) call spread_lanes(nlane, n, ndof, a, hq)
         if (present(hp)) call spread_lanes(nlane, n, ndof, b, hp)
      end associate
   end subroutine gradient

   !> Blocks of the Hessian of sum_j w_j H_j.
   subroutine hessian(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      class(real_lanes_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof)
      real(wp), intent(out), optional :: hpp(nlane, ndof, ndof)
      real(wp), pointer, contiguous :: c(:), d(:), e(:)

      if (self%nreal > nlane/2) then
         call self%model%hessian(nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
         return
      end if
      call take_inputs(self, nlane, ndof, nnoise, w, q, p)
      call take_buffer(self, 4, ndof**2, present(hqq), c)
      call take_buffer(self, 5, ndof**2, present(hqp), d)
      call take_buffer(self, 8, ndof**2, present(hpp), e)
      associate (r => self%buffer, n => self%nreal)
         call self%model%hessian(n, ndof, nnoise, t, r(1)%x, r(2)%x, r(3)%x, c, d, e)
         if (present(hqq)) call spread_lanes(nlane, n, ndof**2, c, hqq)
         if (present(hqp)) call spread_lanes(nlane, n, ndof**2, d, hqp)
         if (present(hpp)) call spread_lanes(nlane, n, ndof**2, e, hpp)
      end associate
   end subroutine hessian

   !> Gradient and Hessian at one point.
   subroutine gradient_hessian(self, nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hqp, hpp)
      class(real_lanes_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof)
      real(wp), intent(out), optional :: hpp(nlane, ndof, ndof)
      real(wp), pointer, contiguous :: a(:), b(:), c(:), d(:), e(:)

      if (self%nreal > nlane/2) then
         call self%model%gradient_hessian(nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hqp, hpp)
         return
      end if
      call take_inputs(self, nlane, ndof, nnoise, w, q, p)
      call take_buffer(self, 6, ndof, present(hq), a)
      call take_buffer(self, 7, ndof, present(hp), b)
      call take_buffer(self, 4, ndof**2, present(hqq), c)
      call take_buffer(self, 5, ndof**2, present(hqp), d)
      call take_buffer(self, 8, ndof**2, present(hpp), e)
      associate (r => self%buffer, n => self%nreal)
         call self%model%gradient_hessian(n, ndof, nnoise, t, r(1)%x, r(2)%x, r(3)%x, a, b, c, d, e)
         if (present(hq)) call spread_lanes(nlane, n, ndof, a, hq)
         if (present(hp)) call spread_lanes(nlane, n, ndof, b, hp)
         if (present(hqq)) call spread_lanes(nlane, n, ndof**2, c, hqq)
         if (present(hqp)) call spread_lanes(nlane, n, ndof**2, d, hqp)
         if (present(hpp)) call spread_lanes(nlane, n, ndof**2, e, hpp)
      end associate
   end subroutine gradient_hessian

   !> Hessian of sum_j w_j H_j times (vq, vp).
   subroutine hessian_vector(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
      class(real_lanes_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: vq(nlane, ndof), vp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      real(wp), pointer, contiguous :: a(:), b(:)

      if (self%nreal > nlane/2) then
         call self%model%hessian_vector(nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
         return
      end if
      call take_inputs(self, nlane, ndof, nnoise, w, q, p)
      call gather(nlane, self%nreal, ndof, vq, self%buffer(4)%x)
      call gather(nlane, self%nreal, ndof, vp, self%buffer(5)%x)
      call take_buffer(self, 6, ndof, .true., a)
      call take_buffer(self, 7, ndof, .true., b)
      associate (r => self%buffer, n => self%nreal)
         call self%model%hessian_vector(n, ndof, nnoise, t, r(1)%x, r(2)%x, r(3)%x, r(4)%x, r(5)%x, a, b)
         call spread_lanes(nlane, n, ndof, a, uq)
         call spread_lanes(nlane, n, ndof, b, up)
      end associate
   end subroutine hessian_vector

   !> Third derivatives of sum_j w_j H_j along two vectors.
   subroutine third_derivative(self, nlane, ndof, nnoise, t, w, q, p, aq, ap, bq, bp, uq, up)
      class(real_lanes_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: aq(nlane, ndof), ap(nlane, ndof), bq(nlane, ndof), bp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      real(wp), pointer, contiguous :: a(:), b(:)

      if (self%nreal > nlane/2) then
         call self%model%third_derivative(nlane, ndof, nnoise, t, w, q, p, aq, ap, bq, bp, uq, up)
         return
      end if
      call take_inputs(self, nlane, ndof, nnoise, w, q, p)
      call gather(nlane, self%nreal, ndof, aq, self%buffer(4)%x)
      call gather(nlane, self%nreal, ndof, ap, self%buffer(5)%x)
      call gather(nlane, self%nreal, ndof, bq, self%buffer(9)%x)
      call gather(nlane, self%nreal, ndof, bp, self%buffer(10)%x)
      call take_buffer(self, 6, ndof, .true., a)
      call take_buffer(self, 7, ndof, .true., b)
      associate (r => self%buffer, n => self%nreal)
         call self%model%third_derivative(n, ndof, nnoise, t, r(1)%x, r(2)%x, r(3)%x, r(4)%x, r(5)%x, r(9)%x, &
                                          r(10)%x, a, b)
         call spread_lanes(nlane, n, ndof, a, uq)
         call spread_lanes(nlane, n, ndof, b, up)
      end associate
   end subroutine third_derivative

   !> Bands of the Hessian blocks.
   subroutine hessian_banded(self, nlane, ndof, nnoise, b, t, w, q, p, hqq, hqp, hpp)
      class(real_lanes_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      integer, intent(in) :: b
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, -b:b, ndof)
      real(wp), intent(out), optional :: hqp(nlane, -b:b, ndof)
      real(wp), intent(out), optional :: hpp(nlane, -b:b, ndof)
      real(wp), pointer, contiguous :: c(:), d(:), e(:)
      integer :: m

      if (self%nreal > nlane/2) then
         call self%model%hessian_banded(nlane, ndof, nnoise, b, t, w, q, p, hqq, hqp, hpp)
         return
      end if
      m = (2*b + 1)*ndof
      call take_inputs(self, nlane, ndof, nnoise, w, q, p)
      call take_buffer(self, 4, m, present(hqq), c)
      call take_buffer(self, 5, m, present(hqp), d)
      call take_buffer(self, 8, m, present(hpp), e)
      associate (r => self%buffer, n => self%nreal)
         call self%model%hessian_banded(n, ndof, nnoise, b, t, r(1)%x, r(2)%x, r(3)%x, c, d, e)
         if (present(hqq)) call spread_lanes(nlane, n, m, c, hqq)
         if (present(hqp)) call spread_lanes(nlane, n, m, d, hqp)
         if (present(hpp)) call spread_lanes(nlane, n, m, e, hpp)
      end associate
   end subroutine hessian_banded

   !> Products of gradients and Hessians of all noises.
   subroutine squares(self, nlane, ndof, nnoise, t, q, g, w, c, s)
      class(real_lanes_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, q(nlane, ndof)
      real(wp), intent(out) :: g(nlane, ndof)
      real(wp), intent(in), dimension(nlane, 0:nnoise), optional :: w, c
      real(wp), intent(out), optional :: s(nlane, 6)
      real(wp), pointer, contiguous :: a(:), b(:)

      if (self%nreal > nlane/2) then
         call self%kernels%squares(nlane, ndof, nnoise, t, q, g, w, c, s)
         return
      end if
      call gather(nlane, self%nreal, ndof, q, self%buffer(2)%x)
      call take_buffer(self, 6, ndof, .true., a)
      associate (r => self%buffer, n => self%nreal)
         if (present(s)) then
            call gather(nlane, n, nnoise + 1, w, self%buffer(1)%x)
            call gather(nlane, n, nnoise + 1, c, self%buffer(3)%x)
            call take_buffer(self, 7, 6, .true., b)
            call self%kernels%squares(n, ndof, nnoise, t, r(2)%x, a, r(1)%x, r(3)%x, b)
            call spread_lanes(nlane, n, 6, b, s)
         else
            call self%kernels%squares(n, ndof, nnoise, t, r(2)%x, a)
         end if
         call spread_lanes(nlane, n, ndof, a, g)
      end associate
   end subroutine squares

   pure logical function has_flow(self, map)
      class(real_lanes_model), intent(in) :: self
      type(step_map), intent(in) :: map

      has_flow = .false.
      if (associated(self%kernels)) has_flow = self%kernels%has_flow(map)
   end function has_flow

   !> Whether the model makes these whole steps of flows of two parts of H.
   pure logical function steps_by_parts(self, map)
      class(real_lanes_model), intent(in) :: self
      type(step_map), intent(in) :: map

      steps_by_parts = .false.
      if (associated(self%kernels)) steps_by_parts = self%kernels%steps_by_parts(map)
   end function steps_by_parts

   !> Whole steps get the number of real lanes.
   subroutine flow(self, map, steps, ndof, q, p, qn, pn, status, counters)
      class(real_lanes_model), intent(in) :: self
      type(step_map), intent(in) :: map
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: ndof
      real(wp), intent(in) :: q(steps%nlane, ndof), p(steps%nlane, ndof)
      real(wp), intent(out) :: qn(steps%nlane, ndof, steps%nstep/steps%every)
      real(wp), intent(out) :: pn(steps%nlane, ndof, steps%nstep/steps%every)
      integer(i8), intent(inout) :: status(steps%nlane)
      type(counters_type), intent(inout) :: counters

      call self%kernels%flow(map, steps, ndof, q, p, qn, pn, status, counters)
   end subroutine flow

   integer function failure_code(self) result(code)
      class(real_lanes_model), intent(in) :: self

      code = self%model%failure_code()
   end function failure_code

   subroutine clear_failure(self)
      class(real_lanes_model), intent(in) :: self

      call self%model%clear_failure()
   end subroutine clear_failure

   subroutine note_failure(self, code)
      class(real_lanes_model), intent(in) :: self
      integer, intent(in) :: code

      call self%model%note_failure(code)
   end subroutine note_failure

   !> Gather weights and state of the real lanes.
   subroutine take_inputs(self, nlane, ndof, nnoise, w, q, p)
      class(real_lanes_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)

      if (contracts_are_executed) call require_real_lanes(nlane, self%nreal)
      call gather(nlane, self%nreal, nnoise + 1, w, self%buffer(1)%x)
      call gather(nlane, self%nreal, ndof, q, self%buffer(2)%x)
      call gather(nlane, self%nreal, ndof, p, self%buffer(3)%x)
   end subroutine take_inputs

   !> A buffer for an output of ncol columns; null if it is not wanted, so that it counts as absent in a call.
   subroutine take_buffer(self, i, ncol, wanted, x)
      class(real_lanes_model), intent(in), target :: self
      integer, intent(in) :: i, ncol
      logical, intent(in) :: wanted
      real(wp), pointer, contiguous, intent(out) :: x(:)

      nullify (x)
      if (.not. wanted) return
      call fit(self%buffer(i)%x, self%nreal*ncol)
      x => self%buffer(i)%x
   end subroutine take_buffer

   !> Allocate at least n numbers, and a unit of lanes behind them.
   pure subroutine fit(x, n)
      real(wp), allocatable, intent(inout) :: x(:)
      integer, intent(in) :: n

      if (allocated(x)) then
         if (size(x) >= n + lane_unit) return
         deallocate (x)
      end if
      allocate (x(n + lane_unit))
   end subroutine fit

   !> Whole units of lanes are moved: what stands beyond the real lanes is overwritten by the next column.
   pure subroutine gather(nlane, n, ncol, x, real_ones)
      integer, intent(in) :: nlane, n, ncol
      real(wp), intent(in) :: x(nlane, ncol)
      real(wp), allocatable, intent(inout) :: real_ones(:)
      integer :: i, first, lane

      call fit(real_ones, n*ncol)
      do i = 1, ncol
         do first = 0, n - 1, lane_unit
            !GCC$ unroll 8
            do lane = first + 1, first + lane_unit
               real_ones((i - 1)*n + lane) = x(lane, i)
            end do
         end do
      end do
   end subroutine gather

   !> The opposite; padding repeats the last real lane.
   pure subroutine spread_lanes(nlane, n, ncol, real_ones, x)
      integer, intent(in) :: nlane, n, ncol
      real(wp), intent(in) :: real_ones(n*ncol + lane_unit)
      real(wp), intent(out) :: x(nlane, ncol)
      integer :: i, first, lane
      real(wp) :: last

      do i = 1, ncol
         last = real_ones(i*n)
         do first = 0, nlane - lane_unit, lane_unit
            if (first < n) then
               !GCC$ unroll 8
               do lane = first + 1, first + lane_unit
                  x(lane, i) = merge(real_ones((i - 1)*n + lane), last, lane <= n)
               end do
            else
               x(first + 1:first + lane_unit, i) = last
            end if
         end do
      end do
      if (contracts_are_executed) call require_padded(nlane, n, ncol, x, 'model, real lanes', 'answers')
   end subroutine spread_lanes

end module symsde_model_views_real_lanes
