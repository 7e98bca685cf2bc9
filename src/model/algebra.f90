! SPDX-License-Identifier: BSD-3-Clause
!> Gradients of Poisson brackets and correction products of weighted sums of a model's Hamiltonians, from its own
!> gradients and Hessian-vector products; no third derivatives are needed.
!>
!>    {F,G} = F_q.G_p - F_p.G_q            grad {F,G} = Hess F (G_p, -G_q) - Hess G (F_p, -F_q)
!>    F_p.F_q                              grad (F_p.F_q) = Hess F (F_p, F_q)
!>
!> Where forces f act, the gradient of F_p.F_q is replaced, in the correction of one-sided schemes, by
!>
!>    (-(B_q A - B_p B), A_q A - A_p B) = Hess F (A, -B) - (f_q A - f_p B, 0),   A = F_p,  B = -F_q + f
!>
!> (arguments of a Hessian: q-part first; docs/method/beyond-order-one.md). The gradients are exact if the model's
!> products are, so a map that uses them is symplectic to rounding.
module symsde_model_algebra
   use symsde_base_kinds, only: wp
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: algebra_work, new_algebra_work, bracket_gradient, correction_gradient

   !> Sizes of the model, and work arrays for the gradients of two sums and one product, so that callers allocate once
   !> and not in every step.
   type :: algebra_work
      private
      integer :: nlane = 0, ndof = 0, nnoise = 0
      real(wp), allocatable :: fq(:, :), fp(:, :), gq(:, :), gp(:, :), uq(:, :), up(:, :)
   end type algebra_work

contains

   !> Allocate work arrays for blocks of nlane lanes of a model.
   subroutine new_algebra_work(work, nlane, ndof, nnoise)
      type(algebra_work), intent(out) :: work
      integer, intent(in) :: nlane, ndof, nnoise

      work%nlane = nlane
      work%ndof = ndof
      work%nnoise = nnoise
      allocate (work%fq(nlane, ndof), work%fp(nlane, ndof))
      allocate (work%gq(nlane, ndof), work%gp(nlane, ndof))
      allocate (work%uq(nlane, ndof), work%up(nlane, ndof))
   end subroutine new_algebra_work

   !> Gradient (bq, bp) of {F,G} for F = sum_j wf_j H_j and G = sum_j wg_j H_j.
   subroutine bracket_gradient(work, model, t, wf, wg, q, p, bq, bp)
      type(algebra_work), intent(inout) :: work
      class(model_type), intent(in) :: model
      real(wp), intent(in) :: t                                                   !! time [time]
      real(wp), intent(in), dimension(work%nlane, 0:work%nnoise) :: wf, wg        !! weights of F and of G
      real(wp), intent(in), dimension(work%nlane, work%ndof) :: q, p
      real(wp), intent(out), dimension(work%nlane, work%ndof) :: bq, bp

      associate (nlane => work%nlane, ndof => work%ndof, nnoise => work%nnoise)
         call model%gradient(nlane, ndof, nnoise, t, wf, q, p, work%fq, work%fp)
         call model%gradient(nlane, ndof, nnoise, t, wg, q, p, work%gq, work%gp)
         ! (G_p, -G_q) and (F_p, -F_q) are the fields of G and F: multiply the Hessian of each sum by the field of the
         ! other sum.
         work%gq = -work%gq
         work%fq = -work%fq
         call model%hessian_vector(nlane, ndof, nnoise, t, wf, q, p, work%gp, work%gq, bq, bp)
         call model%hessian_vector(nlane, ndof, nnoise, t, wg, q, p, work%fp, work%fq, work%uq, work%up)
      end associate
      ! Both weights may differ from lane to lane: {F,G} is bilinear in them.
      bq = bq - work%uq
      bp = bp - work%up
   end subroutine bracket_gradient

   !> Gradient (cq, cp) of F_p.F_q for F = sum_j w_j H_j, or its replacement (see the header) where forces act: one
   !> gradient, one Hessian-vector product.
   subroutine correction_gradient(work, model, t, w, q, p, cq, cp)
      type(algebra_work), intent(inout) :: work
      class(model_type), intent(in) :: model
      real(wp), intent(in) :: t, w(work%nlane, 0:work%nnoise)  !! time [time], weights of F
      real(wp), intent(in), dimension(work%nlane, work%ndof) :: q, p
      real(wp), intent(out), dimension(work%nlane, work%ndof) :: cq, cp

      associate (nlane => work%nlane, ndof => work%ndof, nnoise => work%nnoise)
         call model%gradient(nlane, ndof, nnoise, t, w, q, p, work%fq, work%fp)
         if (associated(model%forces)) then
            call model%force(nlane, ndof, nnoise, t, w, q, p, work%gq)
            work%fq = work%fq - work%gq
         end if
         ! F_q and F_p are exchanged in the call: d/dq (F_p.F_q) = F_qq F_p + F_qp F_q.
         call model%hessian_vector(nlane, ndof, nnoise, t, w, q, p, work%fp, work%fq, cq, cp)
         if (.not. associated(model%forces)) return
         call model%force_along(nlane, ndof, nnoise, t, w, q, p, work%fp, work%fq, work%gq)
         cq = cq - work%gq
      end associate
   end subroutine correction_gradient

end module symsde_model_algebra
