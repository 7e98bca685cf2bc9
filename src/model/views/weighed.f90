! SPDX-License-Identifier: BSD-3-Clause
!> A view of a model whose Hamiltonians have factors that differ from path to path:
!>
!>    H_0 = a H'_0 + b H'_j,   H_k = c_k H'_k      with H' of the inner model and a, b, c_k of each path.
!>
!> Since a model is evaluated as sum_k w_k H_k, each call of the inner model has other weights: w'_0 = a w_0, w'_k = c_k
!> w_k, and w'_j has b w_0 beside. Nothing else is computed anew, so steps are those for any model, without the kernels
!> of the inner one.
module symsde_model_views_weighed
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lane_paths, only: lane_paths
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: weighed_model, new_weighed

   type, extends(model_type) :: weighed_model
      private
      class(model_type), allocatable :: inner
      real(wp), allocatable :: own(:, :)                   !! a, c_1 .. c_m, b of each path (npath or 1, 0:m+1)
      real(wp), pointer :: table(:, :) => null()           !! the same of another model, in a view that knows its paths
      integer :: onto = 0                                  !! j; 0 = none
   contains
      procedure :: value => value_inside
      procedure :: gradient
      procedure :: hessian
      procedure :: hessian_vector
      procedure :: gradient_hessian
      procedure :: hessian_banded
      procedure :: third_derivative
      procedure :: for_paths
   end type weighed_model

contains

   !> A model with these factors (npath or 1, 0:m+1). They and the inner model, which is closed, are moved into it.
   !> Bounds of frequencies and of noises, which belong to one path, are not declared, and neither is a stiff linear
   !> part where H has factors.
   subroutine new_weighed(self, inner, factors, onto, keeps_drift)
      type(weighed_model), intent(out) :: self
      class(model_type), allocatable, intent(inout) :: inner
      real(wp), allocatable, intent(inout) :: factors(:, :)
      integer, intent(in) :: onto             !! noise whose Hamiltonian is a part of H, too; 0 = none
      logical, intent(in) :: keeps_drift      !! whether H is that of the inner model on all paths

      self%name = inner%name
      self%traits = inner%traits
      self%traits%by_path = .true.
      self%traits%npath = merge(size(factors, 1, i8), 0_i8, size(factors, 1) > 1)
      self%traits%max_frequency = 0
      self%traits%noise_lipschitz = 0
      if (.not. keeps_drift) then
         if (allocated(self%traits%rotation)) deallocate (self%traits%rotation)
         if (onto == 0) then
            self%traits%identity_mass = .false.
            self%traits%constant_mass = .false.
            self%traits%diagonal_mass = .false.
         end if
      end if
      self%onto = onto
      call move_alloc(factors, self%own)
      call move_alloc(inner, self%inner)
   end subroutine new_weighed

   !> The weights of the Hamiltonians of the inner model.
   subroutine weigh(self, nlane, nnoise, w, v)
      class(weighed_model), intent(in) :: self
      integer, intent(in) :: nlane, nnoise
      real(wp), intent(in) :: w(nlane, 0:nnoise)
      real(wp), intent(out) :: v(nlane, 0:nnoise)

      if (associated(self%table)) then
         call weigh_by(self, self%table, nlane, nnoise, w, v)
      else
         call weigh_by(self, self%own, nlane, nnoise, w, v)
      end if
   end subroutine weigh

   subroutine weigh_by(self, factors, nlane, nnoise, w, v)
      class(weighed_model), intent(in) :: self
      integer, intent(in) :: nlane, nnoise
      real(wp), intent(in) :: factors(:, 0:)
      real(wp), intent(in) :: w(nlane, 0:nnoise)
      real(wp), intent(out) :: v(nlane, 0:nnoise)
      integer(i8) :: row(nlane)
      integer :: k, lane

      row = 0
      if (associated(self%paths)) call self%paths%find_places(nlane, row)
      row = max(1_i8, min(row + 1, size(factors, 1, i8)))
      do k = 0, nnoise
         do lane = 1, nlane
            v(lane, k) = factors(row(lane), k)*w(lane, k)
         end do
      end do
      if (self%onto == 0) return
      do lane = 1, nlane
         v(lane, self%onto) = v(lane, self%onto) + factors(row(lane), nnoise + 1)*w(lane, 0)
      end do
   end subroutine weigh_by

   !> See model_type, as all that follow.
   subroutine value_inside(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(weighed_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)
      real(wp) :: v(nlane, 0:nnoise)

      call weigh(self, nlane, nnoise, w, v)
      call self%inner%value(nlane, ndof, nnoise, t, v, q, p, value)
   end subroutine value_inside

   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(weighed_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp) :: v(nlane, 0:nnoise)

      call weigh(self, nlane, nnoise, w, v)
      call self%inner%gradient(nlane, ndof, nnoise, t, v, q, p, hq, hp)
   end subroutine gradient

   subroutine hessian(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      class(weighed_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof)
      real(wp), intent(out), optional :: hpp(nlane, ndof, ndof)
      real(wp) :: v(nlane, 0:nnoise)

      call weigh(self, nlane, nnoise, w, v)
      call self%inner%hessian(nlane, ndof, nnoise, t, v, q, p, hqq, hqp, hpp)
   end subroutine hessian

   subroutine hessian_vector(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
      class(weighed_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: vq(nlane, ndof), vp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      real(wp) :: v(nlane, 0:nnoise)

      call weigh(self, nlane, nnoise, w, v)
      call self%inner%hessian_vector(nlane, ndof, nnoise, t, v, q, p, vq, vp, uq, up)
   end subroutine hessian_vector

   subroutine gradient_hessian(self, nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hqp, hpp)
      class(weighed_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof)
      real(wp), intent(out), optional :: hpp(nlane, ndof, ndof)
      real(wp) :: v(nlane, 0:nnoise)

      call weigh(self, nlane, nnoise, w, v)
      call self%inner%gradient_hessian(nlane, ndof, nnoise, t, v, q, p, hq, hp, hqq, hqp, hpp)
   end subroutine gradient_hessian

   subroutine hessian_banded(self, nlane, ndof, nnoise, b, t, w, q, p, hqq, hqp, hpp)
      class(weighed_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      integer, intent(in) :: b
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, -b:b, ndof)
      real(wp), intent(out), optional :: hqp(nlane, -b:b, ndof)
      real(wp), intent(out), optional :: hpp(nlane, -b:b, ndof)
      real(wp) :: v(nlane, 0:nnoise)

      call weigh(self, nlane, nnoise, w, v)
      call self%inner%hessian_banded(nlane, ndof, nnoise, b, t, v, q, p, hqq, hqp, hpp)
   end subroutine hessian_banded

   subroutine third_derivative(self, nlane, ndof, nnoise, t, w, q, p, aq, ap, bq, bp, uq, up)
      class(weighed_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: aq(nlane, ndof), ap(nlane, ndof), bq(nlane, ndof), bp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      real(wp) :: v(nlane, 0:nnoise)

      call weigh(self, nlane, nnoise, w, v)
      call self%inner%third_derivative(nlane, ndof, nnoise, t, v, q, p, aq, ap, bq, bp, uq, up)
   end subroutine third_derivative

   !> A view that reads its rows of the factors of this model, and has a copy of the inner one.
   subroutine for_paths(self, paths, view)
      class(weighed_model), intent(in), target :: self
      type(lane_paths), pointer, intent(in) :: paths
      class(model_type), pointer, intent(out) :: view
      type(weighed_model), pointer :: of_paths

      nullify (view)
      if (size(self%own, 1) == 1) return
      allocate (of_paths)
      of_paths%name = self%name
      of_paths%traits = self%traits
      of_paths%damping = self%damping
      of_paths%forces => self%forces
      of_paths%onto = self%onto
      of_paths%table(1:, 0:) => self%own
      of_paths%paths => paths
      allocate (of_paths%inner, source=self%inner)
      view => of_paths
   end subroutine for_paths

end module symsde_model_views_weighed
