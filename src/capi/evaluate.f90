! SPDX-License-Identifier: BSD-3-Clause
!> A model at points of the caller: value, gradient and Hessian, block by block.
module symsde_capi_evaluate
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_int, c_int64_t, c_ptr
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lane_paths, only: lane_paths
   use symsde_base_lanes, only: lanes_for, padded
   use symsde_base_memory, only: require_memory
   use symsde_base_status, only: error_type, raise, invalid_argument, missing_operation, wrong_shape, &
                                 out_of_memory, status_ok, callback_failed
   use symsde_base_text, only: to_text
   use symsde_capi_arrays, only: view
   use symsde_capi_error, only: finish, require, check_sizes
   use symsde_capi_model, only: use_model
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: symsde_model_value, symsde_model_gradient, symsde_model_hessian

   integer, parameter :: of_value = 1, of_gradient = 2, of_hessian = 3  !! function of the model to evaluate

   !> The caller's arrays as (npath, numbers per path), and a block of each array, copied and padded so that a path does
   !> not depend on its neighbours. An unwanted output is not associated, and its block not allocated.
   type :: points_type
      class(model_type), pointer :: model => null()
      class(model_type), pointer :: by_path => null()  !! view by path of a model that differs by path
      type(lane_paths), pointer :: paths => null()
      class(model_type), allocatable :: own   !! the user's model, if the handle has one
      integer(i8) :: npath = 0
      integer :: ndof = 0, nnoise = 0, nlane = 0
      real(wp), pointer, contiguous :: w(:, :) => null(), q(:, :) => null(), p(:, :) => null()
      real(wp), pointer, contiguous :: out1(:, :) => null(), out2(:, :) => null(), out3(:, :) => null()
      real(wp), allocatable :: wb(:, :), qb(:, :), pb(:, :)
      real(wp), allocatable :: block1(:, :), block2(:, :), block3(:, :)
   end type points_type

contains

   !> Compute value[npath] of sum_j w_j H_j.
   function symsde_model_value(model, npath, t, w, q, p, value, error) result(status) &
      bind(c, name='symsde_model_value')
      type(c_ptr), intent(in), value :: model, w, q, p, value, error
      integer(c_int64_t), intent(in), value :: npath
      real(c_double), intent(in), value :: t
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(points_type), target :: points

      call read_points(points, model, npath, w, q, p, refusal)
      call require(value, 'value', refusal)
      if (.not. allocated(refusal)) then
         if (.not. points%model%traits%has_value) &
            call raise(refusal, missing_operation, 'symsde_model_value', 'the model offers no value: give one '// &
                       'to symsde_model_new')
      end if
      if (.not. allocated(refusal)) call add_output(points, value, 1_i8, points%out1, points%block1, refusal)
      status = evaluate(points, of_value, t, refusal, error)
   end function symsde_model_value

   !> Compute hq, hp [ndof][npath] of sum_j w_j H_j; either may be NULL.
   function symsde_model_gradient(model, npath, t, w, q, p, hq, hp, error) result(status) &
      bind(c, name='symsde_model_gradient')
      type(c_ptr), intent(in), value :: model, w, q, p, hq, hp, error
      integer(c_int64_t), intent(in), value :: npath
      real(c_double), intent(in), value :: t
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(points_type), target :: points

      call read_points(points, model, npath, w, q, p, refusal)
      if (.not. allocated(refusal)) call points%model%require_gradient('symsde_model_gradient', 'this call', refusal)
      if (.not. (c_associated(hq) .or. c_associated(hp))) call require(hq, 'hq (and hp)', refusal)
      call add_output(points, hq, int(points%ndof, i8), points%out1, points%block1, refusal)
      call add_output(points, hp, int(points%ndof, i8), points%out2, points%block2, refusal)
      status = evaluate(points, of_gradient, t, refusal, error)
   end function symsde_model_gradient

   !> Compute hqq, hqp, hpp [ndof][ndof][npath] of sum_j w_j H_j; each may be NULL.
   function symsde_model_hessian(model, npath, t, w, q, p, hqq, hqp, hpp, error) result(status) &
      bind(c, name='symsde_model_hessian')
      type(c_ptr), intent(in), value :: model, w, q, p, hqq, hqp, hpp, error
      integer(c_int64_t), intent(in), value :: npath
      real(c_double), intent(in), value :: t
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(points_type), target :: points
      integer(i8) :: n

      call read_points(points, model, npath, w, q, p, refusal)
      if (.not. allocated(refusal)) call points%model%require_gradient('symsde_model_hessian', 'a Hessian', refusal)
      if (.not. (c_associated(hqq) .or. c_associated(hqp) .or. c_associated(hpp))) &
         call require(hqq, 'hqq (and hqp and hpp)', refusal)
      n = int(points%ndof, i8)**2
      call add_output(points, hqq, n, points%out1, points%block1, refusal)
      call add_output(points, hqp, n, points%out2, points%block2, refusal)
      call add_output(points, hpp, n, points%out3, points%block3, refusal)
      status = evaluate(points, of_hessian, t, refusal, error)
   end function symsde_model_hessian

   !> Read the model and its inputs, and allocate a block of inputs.
   subroutine read_points(points, model, npath, w, q, p, error)
      type(points_type), intent(out), target :: points
      type(c_ptr), intent(in) :: model, w, q, p
      integer(i8), intent(in) :: npath
      type(error_type), allocatable, intent(inout) :: error

      call use_model(model, points%own, points%model, error)
      if (npath < 0) call raise(error, invalid_argument, 'read_points', 'npath = '//to_text(npath)// &
                                ' is negative: give the number of points')
      if (allocated(error)) return
      if (points%model%traits%npath > 0 .and. npath /= 1 .and. npath /= points%model%traits%npath) &
         call raise(error, wrong_shape, 'read_points', 'model '//points%model%name//' has parameters for '// &
                    to_text(points%model%traits%npath)//' paths, and there are '//to_text(npath)// &
                    ' points: give a point for each path')
      if (allocated(error)) return
      points%npath = npath
      points%ndof = points%model%traits%ndof
      points%nnoise = points%model%traits%nnoise
      points%nlane = lanes_for(points%ndof, npath)
      if (points%ndof > 128) points%nlane = padded(1)  ! a block of dense Hessians is large
      call require_memory(points%nlane*evaluation_numbers(points%model), 'a call of model '//points%model%name, &
                          'give a smaller system', 'read_points', error)
      call add_array(points, w, 'w', points%nnoise + 1_i8, points%w, points%wb, error)
      call add_array(points, q, 'q', int(points%ndof, i8), points%q, points%qb, error)
      call add_array(points, p, 'p', int(points%ndof, i8), points%p, points%pb, error)
   end subroutine read_points

   !> Numbers per lane: the inputs, and the vectors of differences if the model has no Hessian.
   pure real(wp) function evaluation_numbers(model) result(numbers)
      class(model_type), intent(in) :: model

      numbers = 20.0_wp*model%traits%ndof + 4.0_wp*model%traits%nnoise
   end function evaluation_numbers

   !> View an array of n numbers per path, and allocate its block.
   subroutine add_array(points, given, what, n, array, block, error)
      type(points_type), intent(in) :: points
      type(c_ptr), intent(in) :: given
      character(*), intent(in) :: what
      integer(i8), intent(in) :: n
      real(wp), pointer, contiguous, intent(out) :: array(:, :)
      real(wp), allocatable, intent(out) :: block(:, :)
      type(error_type), allocatable, intent(inout) :: error
      integer :: info

      nullify (array)
      call require(given, what, error)
      call check_sizes(n, points%npath, 1_i8, what, error)
      if (allocated(error)) return
      call view(given, points%npath, n, array)
      allocate (block(points%nlane, n), stat=info)
      if (info /= 0) call raise(error, out_of_memory, 'add_array', what//' needs a block of '// &
                                to_text(8.0_wp*points%nlane*n)//' bytes, more than this process can have: give a '// &
                                'smaller system')
   end subroutine add_array

   !> Add an output, if the caller wants it.
   subroutine add_output(points, given, n, array, block, error)
      type(points_type), intent(in) :: points
      type(c_ptr), intent(in) :: given
      integer(i8), intent(in) :: n
      real(wp), pointer, contiguous, intent(out) :: array(:, :)
      real(wp), allocatable, intent(out) :: block(:, :)
      type(error_type), allocatable, intent(inout) :: error

      nullify (array)
      if (allocated(error)) return
      if (c_associated(given)) call add_array(points, given, 'output', n, array, block, error)
   end subroutine add_output

   !> Block by block: copy in, call the model, copy out, until all points are done or a callback fails.
   function evaluate(points, what, t, refusal, error) result(status)
      type(points_type), intent(inout) :: points
      integer, intent(in) :: what
      real(wp), intent(in) :: t
      type(error_type), allocatable, intent(in) :: refusal
      type(c_ptr), intent(in) :: error   !! symsde_error, may be NULL
      integer(c_int) :: status
      integer(i8) :: first

      if (allocated(refusal)) then
         status = finish(refusal, error)
         return
      end if
      call points%model%clear_failure()
      allocate (points%paths)
      call points%model%for_paths(points%paths, points%by_path)
      do first = 0, points%npath - 1, points%nlane
         if (associated(points%by_path)) then
            call ask_model(points%by_path, points, what, first, t)
         else
            call ask_model(points%model, points, what, first, t)
         end if
         if (points%model%failure_code() /= 0) exit
      end do
      if (associated(points%by_path)) deallocate (points%by_path)
      deallocate (points%paths)
      if (points%model%failure_code() /= 0) then
         status = finish(refusal, error, callback_failed, 'a callback returned '// &
                         to_text(points%model%failure_code())//' and the evaluation was aborted')
      else
         status = finish(refusal, error, status_ok)
      end if
   end function evaluate

   !> Evaluate one block; if the model differs by path, point i belongs to path i.
   subroutine ask_model(model, x, what, first, t)
      class(model_type), intent(in) :: model
      type(points_type), intent(inout) :: x
      integer, intent(in) :: what
      integer(i8), intent(in) :: first
      real(wp), intent(in) :: t
      integer(i8) :: path(x%nlane)
      integer :: lane

      do lane = 1, x%nlane
         path(lane) = min(first + lane, x%npath) - 1
      end do
      if (associated(x%by_path)) call x%paths%begin(path, 0_i8, 1_i8)
      call copy_in(x%w, first, x%wb)
      call copy_in(x%q, first, x%qb)
      call copy_in(x%p, first, x%pb)
      select case (what)
      case (of_value)
         call model%value(x%nlane, x%ndof, x%nnoise, t, x%wb, x%qb, x%pb, x%block1)
      case (of_gradient)
         call model%gradient(x%nlane, x%ndof, x%nnoise, t, x%wb, x%qb, x%pb, x%block1, x%block2)
      case default
         call model%hessian(x%nlane, x%ndof, x%nnoise, t, x%wb, x%qb, x%pb, x%block1, x%block2, x%block3)
      end select
      if (associated(x%out1)) call copy_out(x%block1, first, x%out1)
      if (associated(x%out2)) call copy_out(x%block2, first, x%out2)
      if (associated(x%out3)) call copy_out(x%block3, first, x%out3)
   end subroutine ask_model

   !> Copy the rows from `first` on; lanes past the last row repeat it.
   pure subroutine copy_in(array, first, block)
      real(wp), intent(in) :: array(:, :)
      integer(i8), intent(in) :: first
      real(wp), intent(out) :: block(:, :)
      integer :: i, lane

      do i = 1, size(block, 2)
         do lane = 1, size(block, 1)
            block(lane, i) = array(min(first + lane, size(array, 1, i8)), i)
         end do
      end do
   end subroutine copy_in

   pure subroutine copy_out(block, first, array)
      real(wp), intent(in) :: block(:, :)
      integer(i8), intent(in) :: first
      real(wp), intent(inout) :: array(:, :)
      integer :: i, lane

      do i = 1, size(block, 2)
         do lane = 1, int(min(size(block, 1, i8), size(array, 1, i8) - first))
            array(first + lane, i) = block(lane, i)
         end do
      end do
   end subroutine copy_out

end module symsde_capi_evaluate
