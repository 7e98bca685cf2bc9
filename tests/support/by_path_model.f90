! SPDX-License-Identifier: BSD-3-Clause
!> A view whose model differs from path to path: path first + i - 1 has model i of a table, later paths the last model.
!>
!> Each lane is computed by a call of its own. With a table of one model all paths have this model. An argument of the
!> constructor decides whether rows of chains are offered.
module by_path_model
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lane_paths, only: lane_paths
   use symsde_base_traits, only: strip_lanes
   use symsde_model_abstract, only: model_type
   use symsde_model_kernels, only: kernel_model, kernels_of
   implicit none
   private
   public :: by_path_type, model_slot, new_by_path

   type :: model_slot
      class(model_type), allocatable :: model
   end type model_slot

   type, extends(kernel_model) :: by_path_type
      type(model_slot), pointer :: table(:) => null()
      integer(i8) :: first = 0
   contains
      procedure :: gradient
      procedure :: value => value_by_path
      procedure :: hessian
      procedure :: hessian_vector
      procedure :: third_derivative
      procedure :: chain_rows
      procedure :: for_paths
   end type by_path_type

contains

   subroutine new_by_path(self, table, first, rows)
      type(by_path_type), intent(out) :: self
      type(model_slot), intent(in), target :: table(:)
      integer(i8), intent(in) :: first
      logical, intent(in) :: rows

      self%table => table
      self%first = first
      self%traits = table(1)%model%traits
      self%traits%any_lanes = .true.
      self%offers%rows = rows
      self%name = 'by path'
   end subroutine new_by_path

   !> A view of the same table that knows the paths of its lanes.
   subroutine for_paths(self, paths, view)
      class(by_path_type), intent(in), target :: self
      type(lane_paths), pointer, intent(in) :: paths
      class(model_type), pointer, intent(out) :: view
      type(by_path_type), pointer :: told

      nullify (view)
      if (size(self%table) == 1) return
      allocate (told)
      call new_by_path(told, self%table, self%first, self%offers%rows)
      told%paths => paths
      view => told
   end subroutine for_paths

   !> For every lane, the index in the table of its model.
   subroutine find_places(self, nlane, place)
      class(by_path_type), intent(in) :: self
      integer, intent(in) :: nlane
      integer, intent(out) :: place(nlane)
      integer(i8) :: path(nlane)

      place = 1
      if (.not. associated(self%paths)) return
      call self%paths%find(nlane, path)
      place = int(max(1_i8, min(path - self%first + 1, size(self%table, kind=i8))))
   end subroutine find_places

   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(by_path_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp) :: a(1, ndof), b(1, ndof)
      integer :: place(nlane), l

      call find_places(self, nlane, place)
      do l = 1, nlane
         call self%table(place(l))%model%gradient(1, ndof, nnoise, t, w(l, :), q(l, :), p(l, :), a, b)
         if (present(hq)) hq(l, :) = a(1, :)
         if (present(hp)) hp(l, :) = b(1, :)
      end do
   end subroutine gradient

   subroutine value_by_path(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(by_path_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)
      integer :: place(nlane), l

      call find_places(self, nlane, place)
      do l = 1, nlane
         call self%table(place(l))%model%value(1, ndof, nnoise, t, w(l, :), q(l, :), p(l, :), value(l:l))
      end do
   end subroutine value_by_path

   subroutine hessian(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      class(by_path_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof), hpp(nlane, ndof, ndof)
      real(wp), dimension(1, ndof, ndof) :: a, b, c
      integer :: place(nlane), l

      call find_places(self, nlane, place)
      do l = 1, nlane
         call self%table(place(l))%model%hessian(1, ndof, nnoise, t, w(l, :), q(l, :), p(l, :), a, b, c)
         if (present(hqq)) hqq(l, :, :) = a(1, :, :)
         if (present(hqp)) hqp(l, :, :) = b(1, :, :)
         if (present(hpp)) hpp(l, :, :) = c(1, :, :)
      end do
   end subroutine hessian

   subroutine hessian_vector(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
      class(by_path_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: vq(nlane, ndof), vp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      integer :: place(nlane), l

      call find_places(self, nlane, place)
      do l = 1, nlane
         call self%table(place(l))%model%hessian_vector(1, ndof, nnoise, t, w(l, :), q(l, :), p(l, :), vq(l, :), &
                                                        vp(l, :), uq(l, :), up(l, :))
      end do
   end subroutine hessian_vector

   subroutine third_derivative(self, nlane, ndof, nnoise, t, w, q, p, aq, ap, bq, bp, uq, up)
      class(by_path_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: aq(nlane, ndof), ap(nlane, ndof), bq(nlane, ndof), bp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      integer :: place(nlane), l

      call find_places(self, nlane, place)
      do l = 1, nlane
         call self%table(place(l))%model%third_derivative(1, ndof, nnoise, t, w(l, :), q(l, :), p(l, :), aq(l, :), &
                                                          ap(l, :), bq(l, :), bp(l, :), uq(l, :), up(l, :))
      end do
   end subroutine third_derivative

   !> Rows of every lane, computed by a strip that holds copies of this lane alone.
   subroutine chain_rows(self, ndof, nnoise, first, last, t, w, q, hq, hqq)
      class(by_path_type), intent(in) :: self
      integer, intent(in) :: ndof, nnoise, first, last
      real(wp), intent(in) :: t, w(strip_lanes, 0:nnoise), q(strip_lanes, first - 1:last + 1)
      real(wp), intent(out) :: hq(strip_lanes, first:last), hqq(strip_lanes, 0:1, first:last)
      real(wp) :: f(strip_lanes, first:last), k(strip_lanes, 0:1, first:last)
      class(kernel_model), pointer :: kernels
      integer :: place(strip_lanes), l

      call find_places(self, strip_lanes, place)
      do l = 1, strip_lanes
         kernels => kernels_of(self%table(place(l))%model)
         call kernels%chain_rows(ndof, nnoise, first, last, t, spread(w(l, :), 1, strip_lanes), &
                                 spread(q(l, :), 1, strip_lanes), f, k)
         hq(l, :) = f(1, :)
         hqq(l, :, :) = k(1, :, :)
      end do
   end subroutine chain_rows

end module by_path_model
