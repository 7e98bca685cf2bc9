! SPDX-License-Identifier: BSD-3-Clause
!>    H_j(t,q,p) = T_j(t,p) + U_j(t,q),        S = sum_j w_j H_j
!>    grad S = (sum_j w_j U_j', sum_j w_j T_j'),     Hess S = (sum_j w_j U_j'', 0; 0, sum_j w_j T_j'')
!>
!> Models whose Hamiltonians are sums of a function of q and a function of p, implemented as one kernel.
!>
!> An extension defines `evaluate`, which computes any of gradient and diagonal Hessian blocks; all other operations are
!> derived from it here, so that a gradient has the same bits alone and together with the Hessian. For few degrees of
!> freedom, since the blocks are dense.
module symsde_model_separable
   use symsde_base_kinds, only: wp
   use symsde_model_kernels, only: kernel_model
   implicit none
   private
   public :: separable_model

   type, abstract, extends(kernel_model) :: separable_model
   contains
      procedure(evaluate_interface), deferred :: evaluate
      procedure :: gradient
      procedure :: hessian
      procedure :: gradient_hessian
      procedure :: hessian_vector
   end type separable_model

   abstract interface
      !> Gradient and diagonal Hessian blocks of sum_j w_j H_j; an absent output is not wanted.
      subroutine evaluate_interface(self, nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hpp)
         import :: separable_model, wp
         class(separable_model), intent(in) :: self
         integer, intent(in) :: nlane, ndof, nnoise
         real(wp), intent(in) :: t                   !! time [time]
         real(wp), intent(in) :: w(nlane, 0:nnoise)  !! weights of H_0 .. H_m
         real(wp), intent(in) :: q(nlane, ndof), p(nlane, ndof)
         real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
         real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hpp(nlane, ndof, ndof)
      end subroutine evaluate_interface
   end interface

contains

   !> Gradient of sum_j w_j H_j. Both halves come from one call, so that a kernel that needs sine and cosine of q for
   !> S_q computes them once.
   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(separable_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)

      call self%evaluate(nlane, ndof, nnoise, t, w, q, p, hq=hq, hp=hp)
   end subroutine gradient

   !> Blocks of the Hessian of sum_j w_j H_j; the mixed block is zero.
   subroutine hessian(self, nlane, ndof, nnoise, t, w, q, p, hqq, hqp, hpp)
      class(separable_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof)
      real(wp), intent(out), optional :: hpp(nlane, ndof, ndof)

      call self%evaluate(nlane, ndof, nnoise, t, w, q, p, hqq=hqq, hpp=hpp)
      if (present(hqp)) hqp = 0
   end subroutine hessian

   !> Gradient and Hessian at one point, as Newton's iteration needs them.
   subroutine gradient_hessian(self, nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hqp, hpp)
      class(separable_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof)
      real(wp), intent(out), optional :: hpp(nlane, ndof, ndof)

      call self%evaluate(nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hpp)
      if (present(hqp)) hqp = 0
   end subroutine gradient_hessian

   !> Hessian of sum_j w_j H_j times (vq, vp). Blocks of a path with two degrees of freedom are local arrays: allocating
   !> them would take as long as the rest.
   subroutine hessian_vector(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, uq, up)
      class(separable_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: vq(nlane, ndof), vp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      real(wp) :: hqq(2, 2), hpp(2, 2)
      real(wp), allocatable :: blocks(:, :, :, :)  !! hqq and hpp, each (nlane, ndof, ndof)

      ! A frequent case of a single path, for which the compiler knows the lengths of the blocks.
      if (nlane == 1 .and. ndof == 2) then
         call self%evaluate(nlane, ndof, nnoise, t, w, q, p, hqq=hqq, hpp=hpp)
         call multiply(1, 2, hqq, hpp, vq, vp, uq, up)
      else
         allocate (blocks(nlane, ndof, ndof, 2))
         call self%evaluate(nlane, ndof, nnoise, t, w, q, p, hqq=blocks(:, :, :, 1), hpp=blocks(:, :, :, 2))
         call multiply(nlane, ndof, blocks(:, :, :, 1), blocks(:, :, :, 2), vq, vp, uq, up)
      end if
   end subroutine hessian_vector

   !> (uq, up) = (hqq vq, hpp vp). The caller passes literals, for which the compiler unrolls loops; parentheses keep
   !> the first product of a sum from being contracted with the next.
   pure subroutine multiply(nlane, ndof, hqq, hpp, vq, vp, uq, up)
      integer, value :: nlane, ndof
      real(wp), intent(in) :: hqq(nlane, ndof, ndof), hpp(nlane, ndof, ndof), vq(nlane, ndof), vp(nlane, ndof)
      real(wp), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
      integer :: lane, i, j

      do i = 1, ndof
         do lane = 1, nlane
            ! The sum begins with its first product instead of zero, which saves an addition.
            uq(lane, i) = (hqq(lane, i, 1)*vq(lane, 1))
            up(lane, i) = (hpp(lane, i, 1)*vp(lane, 1))
         end do
         do j = 2, ndof
            do lane = 1, nlane
               uq(lane, i) = uq(lane, i) + hqq(lane, i, j)*vq(lane, j)
               up(lane, i) = up(lane, i) + hpp(lane, i, j)*vp(lane, j)
            end do
         end do
      end do
   end subroutine multiply

end module symsde_model_separable
