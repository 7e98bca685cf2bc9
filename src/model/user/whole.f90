! SPDX-License-Identifier: BSD-3-Clause
!> Hessians of user's functions that write all of their outputs, for callers that need only some of them.
!>
!> Private to its family.
module symsde_model_user_whole
   use, intrinsic :: iso_c_binding, only: c_ptr
   use symsde_base_kinds, only: wp, i4
   use symsde_base_status, only: out_of_memory
   use symsde_model_user_callback_functions, only: hessian_callback, gradient_hessian_callback
   use symsde_model_user_outputs, only: little, find_room, keep, spoil
   implicit none
   private
   public :: whole_hessian, whole_gradient_hessian

contains

   !> Compute all blocks of the Hessian by a function that does not accept NULL, and keep the blocks that are
   !> present.
   subroutine whole_hessian(function, nlane, ndof, nnoise, t, w, q, p, user, code, hqq, hqp, hpp)
      procedure(hessian_callback) :: function
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      type(c_ptr), intent(in) :: user
      integer(i4), intent(out) :: code
      real(wp), intent(out), dimension(nlane, ndof, ndof), optional :: hqq, hqp, hpp
      real(wp), target :: few(little)
      real(wp), allocatable, target :: more(:)
      real(wp), pointer, contiguous :: r(:)

      code = out_of_memory
      associate (b => nlane*ndof**2)
         call find_room(3*b, few, more, r)
         if (.not. associated(r)) return
         call spoil(3*b, r)
         code = function(nlane, ndof, nnoise + 1, t, w, q, p, r(:b), r(b + 1:2*b), r(2*b + 1:3*b), user)
         call keep(b, r(:b), hqq)
         call keep(b, r(b + 1:2*b), hqp)
         call keep(b, r(2*b + 1:3*b), hpp)
      end associate
   end subroutine whole_hessian

   !> Compute gradient and all blocks of the Hessian by such a joint function, and keep the outputs that are present.
   subroutine whole_gradient_hessian(function, nlane, ndof, nnoise, t, w, q, p, user, code, hq, hp, hqq, hqp, &
                                     hpp)
      procedure(gradient_hessian_callback) :: function
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      type(c_ptr), intent(in) :: user
      integer(i4), intent(out) :: code
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), intent(out), dimension(nlane, ndof, ndof), optional :: hqq, hqp, hpp
      real(wp), target :: few(little)
      real(wp), allocatable, target :: more(:)
      real(wp), pointer, contiguous :: r(:), s(:)

      code = out_of_memory
      associate (b => nlane*ndof**2, g => nlane*ndof)
         call find_room(3*b + 2*g, few, more, r)
         if (.not. associated(r)) return
         s => r(3*b + 1:)
         call spoil(3*b + 2*g, r)
         code = function(nlane, ndof, nnoise + 1, t, w, q, p, s(:g), s(g + 1:2*g), r(:b), &
                         r(b + 1:2*b), r(2*b + 1:3*b), user)
         call keep(g, s(:g), hq)
         call keep(g, s(g + 1:2*g), hp)
         call keep(b, r(:b), hqq)
         call keep(b, r(b + 1:2*b), hqp)
         call keep(b, r(2*b + 1:3*b), hpp)
      end associate
   end subroutine whole_gradient_hessian

end module symsde_model_user_whole
