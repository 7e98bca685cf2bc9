! SPDX-License-Identifier: BSD-3-Clause
!> A model as it is for chosen paths, where its parameters go by path: what is found for one of them holds for no other.
module symsde_model_probe_one_path
   use symsde_base_kinds, only: i8
   use symsde_base_lane_paths, only: lane_paths
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: one_path

   !> Paths that share parameters are one place, from 0 on. A model that is the same for all has one place.
   type :: one_path
      integer(i8) :: count = 1                         !! number of places
      class(model_type), pointer :: model => null()    !! the model that sees the chosen places
      class(model_type), pointer, private :: view => null()    !! owned with its paths, or null
      type(lane_paths), pointer, private :: paths => null()
   contains
      procedure :: begin
      procedure :: look_at
      procedure :: finish
   end type one_path

contains

   !> Begin with the first place, before a block has begun. A view of a model knows its paths, a model makes a view.
   subroutine begin(self, model, moves_zeros)
      class(one_path), intent(out) :: self
      class(model_type), intent(in), target :: model  !! must live as long
      logical, intent(in), optional :: moves_zeros    !! whether parameters that are zero are small instead

      self%model => model
      if (.not. model%traits%by_path) return
      self%paths => model%paths
      if (.not. associated(self%paths)) then
         allocate (self%paths)
         call model%for_paths(self%paths, self%view)
         if (.not. associated(self%view)) then
            deallocate (self%paths)
            return
         end if
         self%model => self%view
      end if
      self%count = max(model%traits%npath, 1_i8)
      if (present(moves_zeros)) self%paths%moves_zeros = moves_zeros
      call self%look_at(0_i8, 1)
   end subroutine begin

   !> Let lanes have the parameters of n places, from this one on, further lanes those of the last. Places beyond the
   !> last repeat it.
   subroutine look_at(self, place, n)
      class(one_path), intent(in) :: self
      integer(i8), intent(in) :: place
      integer, intent(in) :: n
      integer(i8) :: there(n)
      integer :: i

      if (.not. associated(self%paths)) return
      do i = 1, n
         there(i) = min(place + i, self%count) - 1
      end do
      call self%paths%begin(there, 0_i8, 1_i8)
   end subroutine look_at

   !> End with the first place, as it is.
   subroutine finish(self)
      class(one_path), intent(inout) :: self

      if (.not. associated(self%paths)) return
      self%paths%moves_zeros = .false.
      call self%look_at(0_i8, 1)
      if (.not. associated(self%view)) return  ! the paths are those of the view that was given
      deallocate (self%view)
      deallocate (self%paths)
   end subroutine finish

end module symsde_model_probe_one_path
