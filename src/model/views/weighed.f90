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
   use symsde_model_views_view, only: view_model
   implicit none
   private
   public :: weighed_model, new_weighed

   type, extends(view_model) :: weighed_model
      private
      real(wp), allocatable :: own(:, :)                   !! a, c_1 .. c_m, b of each path (npath or 1, 0:m+1)
      real(wp), pointer :: table(:, :) => null()           !! the same of another model, in a view that knows its paths
      integer :: onto = 0                                  !! j; 0 = none
   contains
      procedure :: weigh
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
   subroutine weigh(self, nlane, nnoise, m, w, v)
      class(weighed_model), intent(in) :: self
      integer, intent(in) :: nlane, nnoise, m   !! m = nnoise
      real(wp), intent(in) :: w(nlane, 0:nnoise)
      real(wp), intent(out) :: v(nlane, 0:m)

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
