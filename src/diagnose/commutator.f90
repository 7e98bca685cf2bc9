! SPDX-License-Identifier: BSD-3-Clause
!> Do the noises of a model commute, and which order is to be expected then? By brackets at sample points.
!>
!>    {H_k,H_l} constant for all k, l    commutative noises: increments alone reach strong order 1, dZ 3/2
!>    {H,H_k} constant for all k         the drift commutes too: the flow is that of H t + sum_k H_k W_k
!>
!> A bracket is constant where its gradient vanishes; that is what is measured, against the products
!> Hess F (field of G) of which it is the difference. Numbers below 1e-6 are rounding, or the error of
!> differences where the model has no analytic Hessian. Points can refute, not prove.
module symsde_diagnose_commutator
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, wrong_shape
   use symsde_base_text, only: to_text
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: commutator_type, commutator

   real(wp), parameter :: vanishing = 1e-6_wp  !! relative size of a gradient that is taken for zero

   type :: commutator_type
      real(wp) :: noise = 0             !! largest relative |grad {H_k,H_l}|
      real(wp) :: drift = 0             !! largest relative |grad {H,H_k}|
      integer :: k = 0, l = 0           !! the noises where the first is found
      logical :: commutative = .true.   !! the noises commute at all points
      logical :: flows_commute = .true. !! and with the drift
      character(:), allocatable :: text !! which order to expect, from which scheme
   end type commutator_type

contains

   !> Brackets at the points (q, p) and time t. Errors: wrong_shape.
   subroutine commutator(model, t, q, p, result, error)
      class(model_type), intent(in) :: model
      real(wp), intent(in) :: t                  !! time [1]
      real(wp), intent(in) :: q(:, :), p(:, :)   !! sample points (npoint, ndof)
      type(commutator_type), intent(out) :: result
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable :: qs(:, :), ps(:, :)
      real(wp) :: size_kl
      integer :: j, k

      if (allocated(error)) return
      if (any(shape(q) /= shape(p)) .or. size(q, 2) /= model%traits%ndof .or. size(q, 1) < 1) then
         call raise(error, wrong_shape, 'commutator', 'q is ('//to_text(size(q, 1))//','//to_text(size(q, 2))// &
                    ') and p ('//to_text(size(p, 1))//','//to_text(size(p, 2))//'); both must be (npoint,'// &
                    to_text(model%traits%ndof)//') with at least one point')
         return
      end if
      allocate (qs, source=q)
      allocate (ps, source=p)
      do k = 1, model%traits%nnoise
         do j = 0, k - 1
            size_kl = relative_gradient(model, size(q, 1), j, k, t, qs, ps)
            if (j == 0) then
               result%drift = max(result%drift, size_kl)
            else if (size_kl > result%noise .or. result%k == 0) then
               result%noise = size_kl
               result%k = j
               result%l = k
            end if
         end do
      end do
      result%commutative = result%noise <= vanishing
      result%flows_commute = result%commutative .and. result%drift <= vanishing
      call expect_orders(model%traits%nnoise, result)
   end subroutine commutator

   !> Largest over the points of |Hess F V_G - Hess G V_F| / (|Hess F V_G| + |Hess G V_F|) for F = H_j, G = H_k.
   real(wp) function relative_gradient(model, n, j, k, t, q, p) result(largest)
      class(model_type), intent(in) :: model
      integer, intent(in) :: n, j, k              !! points, Hamiltonians
      real(wp), intent(in) :: t, q(n, model%traits%ndof), p(n, model%traits%ndof)
      real(wp), dimension(n, model%traits%ndof) :: fq, fp, gq, gp, aq, ap, bq, bp
      real(wp) :: f(n, 0:model%traits%nnoise), g(n, 0:model%traits%nnoise)
      real(wp) :: difference, total
      integer :: i

      f = 0
      g = 0
      f(:, j) = 1
      g(:, k) = 1
      associate (d => model%traits%ndof, m => model%traits%nnoise)
         call model%gradient(n, d, m, t, f, q, p, fq, fp)
         call model%gradient(n, d, m, t, g, q, p, gq, gp)
         fq = -fq
         gq = -gq
         call model%hessian_vector(n, d, m, t, f, q, p, gp, gq, aq, ap)
         call model%hessian_vector(n, d, m, t, g, q, p, fp, fq, bq, bp)
      end associate
      largest = 0
      do i = 1, n
         difference = max(maxval(abs(aq(i, :) - bq(i, :))), maxval(abs(ap(i, :) - bp(i, :))))
         total = max(maxval(abs(aq(i, :)) + abs(bq(i, :))), maxval(abs(ap(i, :)) + abs(bp(i, :))))
         if (total > 0) largest = max(largest, difference/total)
         if (.not. total <= huge(total)) largest = huge(largest)
      end do
   end function relative_gradient

   !> Orders in words.
   pure subroutine expect_orders(nnoise, c)
      integer, intent(in) :: nnoise
      type(commutator_type), intent(inout) :: c

      if (nnoise == 0) then
         c%text = 'no noise: the order without noise of the scheme'
      else if (c%flows_commute) then
         c%text = 'all flows commute: strong order 1 from midpoint, 2 from gauss2, 3 from gauss3, with increments alone'
      else if (c%commutative) then
         c%text = 'the noises commute: strong order 1 from every consistent scheme with increments alone, 3/2 from '// &
                  'gauss2_strong32 with dZ; weak order 2 from gauss2_weak2'
      else
         c%text = 'the noises '//to_text(c%k)//' and '//to_text(c%l)//' do not commute: strong order 1/2 with '// &
                  'increments alone, 1 from midpoint_areas with areas; weak order 1'
      end if
   end subroutine expect_orders

end module symsde_diagnose_commutator
