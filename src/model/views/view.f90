! SPDX-License-Identifier: BSD-3-Clause
!> A view of a model inside, whose Hamiltonians H' get other weights:
!>
!>    sum_k w_k H_k = sum_j v_j H'_j + terms that the view adds itself,     v = weigh(w), by default the first of w
!>
!> Here all derivatives are those of the model inside. A view that adds terms overrides the operations in which they are
!> seen. Codes of errors are those of the functions inside.
module symsde_model_views_view
   use symsde_base_kinds, only: wp
   use symsde_model_abstract, only: model_type
   use symsde_model_kernels, only: kernel_model
   implicit none
   private
   public :: view_model

   type, abstract, extends(kernel_model) :: view_model
      class(model_type), allocatable :: inner          !! the model inside
      class(model_type), pointer :: view => null()     !! a view of it for a runner, in place of `inner`
   contains
      procedure :: weigh => keep_weights
      procedure :: inside
      procedure :: inner_noises
      procedure :: value => value_inside
      procedure :: gradient
      procedure :: hessian
      procedure :: hessian_vector
      procedure :: gradient_hessian
      procedure :: hessian_banded
      procedure :: third_derivative
      procedure :: failure_code
      procedure :: clear_failure
      procedure :: note_failure
   end type view_model

contains

   !> The weights v (nlane, 0:m) of the Hamiltonians inside.
   subroutine keep_weights(self, nlane, nnoise, m, w, v)
      class(view_model), intent(in) :: self
      integer, intent(in) :: nlane, nnoise
      integer, intent(in) :: m                       !! noises of the model inside
      real(wp), intent(in) :: w(nlane, 0:nnoise)
      real(wp), intent(out) :: v(nlane, 0:m)

      v = w(:, :m)
   end subroutine keep_weights

   !> The model inside.
   function inside(self) result(model)
      class(view_model), intent(in), target :: self
      class(model_type), pointer :: model

      model => self%view
      if (.not. associated(model)) model => self%inner
   end function inside

   !> Number of noises of the model inside.
   pure integer function inner_noises(self)
      class(view_model), intent(in) :: self

      if (associated(self%view)) then
         inner_noises = self%view%traits%nnoise
      else
         inner_noises = self%inner%traits%nnoise
      end if
   end function inner_noises

   ! Operations of model_type.

   subroutine value_inside(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(view_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)
      real(wp) :: v(nlane, 0:self%inner_noises())
      class(model_type), pointer :: model

      model => self%inside()
      call self%weigh(nlane, nnoise, ubound(v, 2), w, v)
      call model%value(nlane, ndof, ubound(v, 2), t, v, q, p, value)
   end subroutine value_inside

   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(view_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp) :: v(nlane, 0:self%inner_noises())
      class(model_type), pointer :: model

      model => self%inside()
      call self%weigh(nlane, nnoise, ubound(v, 2), w, v)
      call model%gradient(nlane, ndof, ubound(v, 2), t, v, q, p, hq, hp)
   end subroutine gradient

   subroutine hessian(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      class(view_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional, dimension(nlane, ndof, ndof) :: hqq, hqp, hpp
      real(wp) :: v(nlane, 0:self%inner_noises())
      class(model_type), pointer :: model

      model => self%inside()
      call self%weigh(nlane, nnoise, ubound(v, 2), w, v)
      call model%hessian(nlane, ndof, ubound(v, 2), t, v, q, p, hqq, hqp, hpp)
   end subroutine hessian

   subroutine hessian_vector(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
      class(view_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: vq(nlane, ndof), vp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      real(wp) :: v(nlane, 0:self%inner_noises())
      class(model_type), pointer :: model

      model => self%inside()
      call self%weigh(nlane, nnoise, ubound(v, 2), w, v)
      call model%hessian_vector(nlane, ndof, ubound(v, 2), t, v, q, p, vq, vp, uq, up)
   end subroutine hessian_vector

   subroutine gradient_hessian(self, nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hqp, hpp)
      class(view_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), intent(out), optional, dimension(nlane, ndof, ndof) :: hqq, hqp, hpp
      real(wp) :: v(nlane, 0:self%inner_noises())
      class(model_type), pointer :: model

      model => self%inside()
      call self%weigh(nlane, nnoise, ubound(v, 2), w, v)
      call model%gradient_hessian(nlane, ndof, ubound(v, 2), t, v, q, p, hq, hp, hqq, hqp, hpp)
   end subroutine gradient_hessian

   subroutine hessian_banded(self, nlane, ndof, nnoise, b, t, w, q, p, hqq, hqp, hpp)
      class(view_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise, b
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional, dimension(nlane, -b:b, ndof) :: hqq, hqp, hpp
      real(wp) :: v(nlane, 0:self%inner_noises())
      class(model_type), pointer :: model

      model => self%inside()
      call self%weigh(nlane, nnoise, ubound(v, 2), w, v)
      call model%hessian_banded(nlane, ndof, ubound(v, 2), b, t, v, q, p, hqq, hqp, hpp)
   end subroutine hessian_banded

   subroutine third_derivative(self, nlane, ndof, nnoise, t, w, q, p, aq, ap, bq, bp, uq, up)
      class(view_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in), dimension(nlane, ndof) :: aq, ap, bq, bp
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      real(wp) :: v(nlane, 0:self%inner_noises())
      class(model_type), pointer :: model

      model => self%inside()
      call self%weigh(nlane, nnoise, ubound(v, 2), w, v)
      call model%third_derivative(nlane, ndof, ubound(v, 2), t, v, q, p, aq, ap, bq, bp, uq, up)
   end subroutine third_derivative

   integer function failure_code(self) result(code)
      class(view_model), intent(in) :: self
      class(model_type), pointer :: model

      model => self%inside()
      code = model%failure_code()
   end function failure_code

   subroutine clear_failure(self)
      class(view_model), intent(in) :: self
      class(model_type), pointer :: model

      model => self%inside()
      call model%clear_failure()
   end subroutine clear_failure

   subroutine note_failure(self, code)
      class(view_model), intent(in) :: self
      integer, intent(in) :: code
      class(model_type), pointer :: model

      model => self%inside()
      call model%note_failure(code)
   end subroutine note_failure

end module symsde_model_views_view
