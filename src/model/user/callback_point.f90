! SPDX-License-Identifier: BSD-3-Clause
!> S = sum_j w_j H_j at a point: values and derivatives by a user's C functions, for whole blocks of lanes.
!>
!> An unwanted output is a work array whose content is discarded, or NULL for functions that accept NULL: writing to
!> NULL ends the process. Outputs are set to NaN before every call, so that lanes which a function does not write fail,
!> too: a function of numba returns 0 in the middle of a block if a lane divides by zero. A nonzero return aborts the
!> run: the outputs of that call become NaN and failure_code() returns the first such code.
!>
!> Private to its family.
module symsde_model_user_callback_point
   use, intrinsic :: iso_c_binding, only: c_associated, c_f_procpointer, c_funptr, c_null_ptr, c_ptr
   use symsde_base_kinds, only: wp, i4
   use symsde_base_status, only: out_of_memory
   use symsde_model_abstract, only: value_missing, hessian_by_differences, hessian_vector_composed
   use symsde_model_kernels, only: kernel_model
   use symsde_model_user_callback_functions, only: user_functions
   use symsde_model_user_failures, only: failure_record
   use symsde_model_user_outputs, only: little, find_room, spoil
   use symsde_model_user_path_parameters, only: path_parameters, lane_call
   use symsde_model_user_whole, only: whole_hessian, whole_gradient_hessian
   implicit none
   private
   public :: callback_point

   type, abstract, extends(kernel_model) :: callback_point
      type(user_functions) :: on
      logical :: null_accepted = .false.         !! unwanted outputs are NULL
      type(c_ptr) :: user = c_null_ptr           !! user pointer of all functions, unless parameters differ by path
      type(path_parameters) :: parameters        !! parameters by path, none by default
      type(failure_record) :: failure            !! first nonzero return
   contains
      procedure, non_overridable :: begin_call
      procedure, non_overridable :: end_call
      procedure :: gradient
      procedure :: value => weighted_value
      procedure :: hessian
      procedure :: hessian_vector
      procedure :: gradient_hessian
      procedure :: third_derivative
      procedure :: set_gradient_hessian
      procedure :: set_third_derivative
      procedure :: accept_null
      procedure :: failure_code
      procedure :: clear_failure
      procedure :: note_failure => note
   end type callback_point

contains

   !> Begin a call of a user's function for nlane lanes, which gets now%user.
   subroutine begin_call(self, nlane, now)
      class(callback_point), intent(in) :: self
      integer, intent(in) :: nlane
      type(lane_call), intent(out) :: now

      now%user = self%user
      if (self%parameters%act) call self%parameters%enter(self%paths, nlane, self%user, now)
   end subroutine begin_call

   !> End it, and keep the code that the function returned, if it failed.
   subroutine end_call(self, now, code)
      class(callback_point), intent(in) :: self
      type(lane_call), intent(inout) :: now
      integer(i4), intent(in) :: code   !! 0 = ok

      if (self%parameters%act) call now%leave()
      if (code /= 0) call self%failure%note(code)
   end subroutine end_call

   !> Add a function that computes gradient and Hessian together, before the model is used; it also replaces a missing
   !> Hessian. c_null_funptr removes it.
   subroutine set_gradient_hessian(self, gradient_hessian)
      class(callback_point), intent(inout) :: self
      type(c_funptr), intent(in) :: gradient_hessian  !! a gradient_hessian_callback, or c_null_funptr

      call self%passed%forget()
      nullify (self%on%gradient_hessian)
      if (c_associated(gradient_hessian)) call c_f_procpointer(gradient_hessian, self%on%gradient_hessian)
      self%traits%has_hessian = associated(self%on%hessian) .or. associated(self%on%gradient_hessian)
   end subroutine set_gradient_hessian

   !> Add a function for third derivatives, which nested brackets need, before the model is used; c_null_funptr removes
   !> it.
   subroutine set_third_derivative(self, third_derivative)
      class(callback_point), intent(inout) :: self
      type(c_funptr), intent(in) :: third_derivative  !! a third_derivative_callback, or c_null_funptr

      call self%passed%forget()
      nullify (self%on%third_derivative)
      self%traits%has_third_derivative = c_associated(third_derivative)
      if (self%traits%has_third_derivative) call c_f_procpointer(third_derivative, self%on%third_derivative)
   end subroutine set_third_derivative

   !> Declare, before the model is used, that its functions accept NULL for outputs.
   subroutine accept_null(self)
      class(callback_point), intent(inout) :: self

      self%null_accepted = .true.
      call self%passed%forget()
   end subroutine accept_null

   !> Gradient of sum_j w_j H_j.
   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(callback_point), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), target :: few(little)
      real(wp), allocatable, target :: more(:)
      real(wp), pointer, contiguous :: unwanted(:)
      type(lane_call) :: now
      integer(i4) :: code

      if (.not. associated(self%on%gradient)) then
         call spoil(nlane*ndof, hq, hp)
         return
      end if
      call self%begin_call(nlane, now)
      if (.not. self%passed%is_kept()) call spoil(nlane*ndof, hq, hp)
      code = out_of_memory
      if (self%null_accepted .or. (present(hq) .and. present(hp))) then
         code = self%on%gradient(nlane, ndof, nnoise + 1, t, w, q, p, hq, hp, now%user)
      else
         call find_room(nlane*ndof, few, more, unwanted)
         if (present(hq) .and. associated(unwanted)) then
            code = self%on%gradient(nlane, ndof, nnoise + 1, t, w, q, p, hq, unwanted, now%user)
         else if (associated(unwanted)) then
            code = self%on%gradient(nlane, ndof, nnoise + 1, t, w, q, p, unwanted, hp, now%user)
         end if
      end if
      call self%end_call(now, code)
      if (code /= 0) call spoil(nlane*ndof, hq, hp)
   end subroutine gradient

   !> Value of sum_j w_j H_j; NaN if the user gave no function for it.
   subroutine weighted_value(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(callback_point), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)
      type(lane_call) :: now
      integer(i4) :: code

      if (.not. associated(self%on%value)) then
         call value_missing(self, nlane, ndof, nnoise, t, w, q, p, value)
         return
      end if
      call self%begin_call(nlane, now)
      call spoil(nlane, value)
      code = self%on%value(nlane, ndof, nnoise + 1, t, w, q, p, value, now%user)
      call self%end_call(now, code)
      if (code /= 0) call spoil(nlane, value)
   end subroutine weighted_value

   !> Blocks of the Hessian of sum_j w_j H_j: from the user's function, else from the joint function, from products
   !> or from differences.
   subroutine hessian(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      class(callback_point), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), dimension(nlane, ndof, ndof), optional :: hqq, hqp, hpp
      type(lane_call) :: now
      integer(i4) :: code

      if (.not. associated(self%on%hessian)) then
         if (associated(self%on%gradient_hessian)) then
            call self%gradient_hessian(nlane, ndof, nnoise, t, w, q, p, hqq=hqq, hqp=hqp, hpp=hpp)
            return
         end if
         call hessian_by_differences(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
         return
      end if
      call self%begin_call(nlane, now)
      if (self%null_accepted .or. (present(hqq) .and. present(hqp) .and. present(hpp))) then
         call spoil(nlane*ndof**2, hqq, hqp, hpp)
         code = self%on%hessian(nlane, ndof, nnoise + 1, t, w, q, p, hqq, hqp, hpp, now%user)
      else
         call whole_hessian(self%on%hessian, nlane, ndof, nnoise, t, w, q, p, now%user, code, hqq, hqp, hpp)
      end if
      call self%end_call(now, code)
      if (code /= 0) call spoil(nlane*ndof**2, hqq, hqp, hpp)
   end subroutine hessian

   !> Hessian of sum_j w_j H_j times (vq, vp): from the user's function, else from the Hessian or from differences.
   subroutine hessian_vector(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
      class(callback_point), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: vq(nlane, ndof), vp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      type(lane_call) :: now
      integer(i4) :: code

      if (.not. associated(self%on%hessian_vector)) then
         call hessian_vector_composed(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
         return
      end if
      call self%begin_call(nlane, now)
      if (.not. self%passed%is_kept()) call spoil(nlane*ndof, uq, up)
      code = self%on%hessian_vector(nlane, ndof, nnoise + 1, t, w, q, p, vq, vp, uq, up, now%user)
      call self%end_call(now, code)
      if (code /= 0) call spoil(nlane*ndof, uq, up)
   end subroutine hessian_vector

   !> Gradient and Hessian at one point; one after the other if the user offers no joint function.
   subroutine gradient_hessian(self, nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hqp, hpp)
      class(callback_point), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), intent(out), dimension(nlane, ndof, ndof), optional :: hqq, hqp, hpp
      type(lane_call) :: now
      integer(i4) :: code

      if (.not. associated(self%on%gradient_hessian)) then
         call self%gradient(nlane, ndof, nnoise, t, w, q, p, hq, hp)
         call self%hessian(nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
         return
      end if
      call self%begin_call(nlane, now)
      if (self%null_accepted .or. (present(hq) .and. present(hp) .and. present(hqq) .and. present(hqp) .and. &
                                   present(hpp))) then
         if (.not. self%passed%is_kept()) then
            call spoil(nlane*ndof, hq, hp)
            call spoil(nlane*ndof**2, hqq, hqp, hpp)
         end if
         code = self%on%gradient_hessian(nlane, ndof, nnoise + 1, t, w, q, p, hq, hp, hqq, hqp, hpp, now%user)
      else
         call whole_gradient_hessian(self%on%gradient_hessian, nlane, ndof, nnoise, t, w, q, p, now%user, code, &
                                     hq, hp, hqq, hqp, hpp)
      end if
      call self%end_call(now, code)
      if (code == 0) return
      call spoil(nlane*ndof, hq, hp)
      call spoil(nlane*ndof**2, hqq, hqp, hpp)
   end subroutine gradient_hessian

   !> Third derivatives of sum_j w_j H_j along two vectors; called only with the trait has_third_derivative.
   subroutine third_derivative(self, nlane, ndof, nnoise, t, w, q, p, aq, ap, bq, bp, uq, up)
      class(callback_point), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: aq(nlane, ndof), ap(nlane, ndof), bq(nlane, ndof), bp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      type(lane_call) :: now
      integer(i4) :: code

      call self%begin_call(nlane, now)
      call spoil(nlane*ndof, uq, up)
      code = self%on%third_derivative(nlane, ndof, nnoise + 1, t, w, q, p, aq, ap, bq, bp, uq, up, now%user)
      call self%end_call(now, code)
      if (code /= 0) call spoil(nlane*ndof, uq, up)
   end subroutine third_derivative

   !> The first nonzero code that a function returned since clear_failure; 0 = none.
   integer function failure_code(self) result(code)
      class(callback_point), intent(in) :: self

      code = self%failure%first()
   end function failure_code

   !> Forget a failure before a run.
   subroutine clear_failure(self)
      class(callback_point), intent(in) :: self

      call self%failure%clear()
   end subroutine clear_failure

   !> Keep the first nonzero code. If two threads fail at the same moment, either code may be kept.
   subroutine note(self, code)
      class(callback_point), intent(in) :: self
      integer, intent(in) :: code

      call self%failure%note(int(code, i4))
   end subroutine note

end module symsde_model_user_callback_point
