! SPDX-License-Identifier: BSD-3-Clause
!> The brackets of step/one_dof/brackets_kinetic of an angle and a single path: brackets_kinetic.inc with one lane.
!>
!> This module computes the gradient and Hessian of
!>
!>    h H + sum_k [dW_k H_k + c_k {H_k,H} + (h|h|/12) {{H,H_k},H_k}],   c_k = h dW_k/2 - dZ_k,
!>
!> where H_j = e_j p^2/2 + U_j(q).
!>
!> A block fills an array with the derivatives U_j' .. U_j'''' of all j and then adds them. Here the derivatives of one
!> H_k are local numbers, added before those of the next are computed, so they stay in registers. The order of all sums
!> is that of a block, and so the bits are the same.
!>
!> Private to its family.
module symsde_step_one_dof_brackets_angle_single_path
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: step_record
   use symsde_base_sincos, only: sincos_one
   use symsde_model_kernels, only: angle_terms
   use symsde_step_hamiltonian_brackets, only: modified_hamiltonian
   use symsde_step_one_dof_brackets_kinetic, only: kinetic_brackets, q_, p_, qq, qp, pp, nplace
   implicit none
   private
   public :: evaluate_angle

contains

   pure integer function lanes(nlane)
      integer, intent(in) :: nlane

      lanes = 1
   end function lanes

   !> Gradient and Hessian h = (q_, p_, qq, qp, pp) of the sum at (q, p), in stage i; for i = 0 in the middle of the
   !> step. Corresponds to `evaluate` of blocks.
   subroutine evaluate_angle(self, parts, i, step, c, rate, q, p, h)
      type(kinetic_brackets), intent(in) :: self
      type(modified_hamiltonian), intent(in) :: parts
      integer, intent(in) :: i
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: c(0:self%nnoise), rate(0:self%nnoise), q(1), p(1)
      real(wp), intent(out) :: h(1, nplace)
      real(wp) :: s(1, nplace), g(1, 4), u(1, 4), v(1, 4), sine(1), cosine(1)
      real(wp) :: nested
      real(wp), pointer, contiguous :: w(:, :)  ! a name that gfortran 12 recognises as contiguous
      integer :: k

      w => step%w
      nested = merge(step%h*abs(step%h)/12, 0.0_wp, parts%active%nested)
      ! One sine and one cosine serve all noises and all orders of derivatives.
      sine(1) = sincos_one(q(1), cosine(1))
      associate (terms => self%terms, ends => self%ends, e => self%e, noisy => parts%noisy)
         ! g holds U_0' .. U_0'''' until the end: each noise whose H_k depends on p needs them and its own derivatives.
         call derive_lanes(1, terms(0, i), q, sine, cosine, g)
         call start(1, w(:, 0), e(0), g, p, s)
         do k = 1, self%nnoise
            if (.not. noisy(k)) cycle
            call derive_lanes(1, terms(k, i), q, sine, cosine, u)
            if (abs(e(k)) > 0) then  ! H_k,p = e_k p: this noise moves q too
               call add_moving(1, nested, w(:, k), c(k), [e(0), e(k)], g, u, p, s)
            else
               call add_still(1, nested, w(:, k), c(k), e(0), u, p, s)
            end if
         end do
         do k = 1, merge(self%nnoise, 0, self%ntime == 3)  ! runs only if noises change in time
            if (.not. noisy(k)) cycle
            call derive_lanes(1, ends(k, 2), q, sine, cosine, u)
            call derive_lanes(1, ends(k, 3), q, sine, cosine, v)
            call add_change(1, rate(k), u, v, s)
         end do
      end associate
      h = s
   end subroutine evaluate_angle

   include 'brackets_kinetic.inc'

end module symsde_step_one_dof_brackets_angle_single_path
