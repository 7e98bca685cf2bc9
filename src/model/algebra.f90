! SPDX-License-Identifier: BSD-3-Clause
!> Gradients of Poisson brackets and correction products of weighted sums of a model's Hamiltonians, from its own
!> gradients and Hessian-vector products; no third derivatives are needed.
!>
!>    {F,G} = F_q.G_p - F_p.G_q            grad {F,G} = Hess F (G_p, -G_q) - Hess G (F_p, -F_q)
!>    F_p.F_q                              grad (F_p.F_q) = Hess F (F_p, F_q)
!>
!> (arguments of a Hessian: q-part first; docs/method/beyond-order-one.md). The gradients are exact where the model's
!> products are, so a map that uses them stays symplectic to rounding.
module symsde_model_algebra
   use symsde_base_kinds, only: wp
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: algebra_work, new_algebra_work, bracket_gradient, correction_gradient

   !> Room for the gradients of two sums and one product, so that loops over time do not allocate.
   type :: algebra_work
      private
      real(wp), allocatable :: fq(:, :), fp(:, :), gq(:, :), gp(:, :), uq(:, :), up(:, :)
   end type algebra_work

contains

   !> Room for blocks of nlane lanes and ndof degrees of freedom.
   subroutine new_algebra_work(work, nlane, ndof)
      type(algebra_work), intent(out) :: work
      integer, intent(in) :: nlane, ndof

      allocate (work%fq(nlane, ndof), work%fp(nlane, ndof))
      allocate (work%gq(nlane, ndof), work%gp(nlane, ndof))
      allocate (work%uq(nlane, ndof), work%up(nlane, ndof))
   end subroutine new_algebra_work

   !> Gradient (bq, bp) of {F,G} for F = sum_j wf_j H_j and G = sum_j wg_j H_j.
   subroutine bracket_gradient(model, nlane, ndof, nnoise, t, wf, wg, q, p, bq, bp, work)
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t                                        !! time [time]
      real(wp), intent(in) :: wf(nlane, 0:nnoise), wg(nlane, 0:nnoise) !! weights of F and of G
      real(wp), intent(in) :: q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: bq(nlane, ndof), bp(nlane, ndof)
      type(algebra_work), intent(inout) :: work                        !! for these nlane and ndof

      call model%gradient(nlane, ndof, nnoise, t, wf, q, p, work%fq, work%fp)
      call model%gradient(nlane, ndof, nnoise, t, wg, q, p, work%gq, work%gp)
      work%gq = -work%gq
      work%fq = -work%fq
      call model%hessian_vector(nlane, ndof, nnoise, t, wf, q, p, work%gp, work%gq, bq, bp)
      call model%hessian_vector(nlane, ndof, nnoise, t, wg, q, p, work%fp, work%fq, &
                                work%uq, work%up)
      bq = bq - work%uq
      bp = bp - work%up
   end subroutine bracket_gradient

   !> Gradient (cq, cp) of F_p.F_q for F = sum_j w_j H_j: one gradient, one Hessian-vector product.
   subroutine correction_gradient(model, nlane, ndof, nnoise, t, w, q, p, cq, cp, work)
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise)  !! time [time], weights of F
      real(wp), intent(in) :: q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: cq(nlane, ndof), cp(nlane, ndof)
      type(algebra_work), intent(inout) :: work      !! for these nlane and ndof

      call model%gradient(nlane, ndof, nnoise, t, w, q, p, work%fq, work%fp)
      call model%hessian_vector(nlane, ndof, nnoise, t, w, q, p, work%fp, work%fq, cq, cp)
   end subroutine correction_gradient

end module symsde_model_algebra
