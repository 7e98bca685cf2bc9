! SPDX-License-Identifier: BSD-3-Clause
!> The eliminated midpoint without matrices, for many degrees of freedom and dense Hessians.
!>
!> Private to its family.
module symsde_step_midpoint_krylov
   use symsde_base_kinds, only: wp, i8
   use symsde_base_traits, only: dense
   use symsde_base_vectors, only: add_times
   use symsde_model_abstract, only: model_type
   use symsde_solve_newton, only: newton_options, new_newton
   use symsde_step_midpoint_equation, only: midpoint_equation, midpoint_part, position
   use symsde_step_implicit_newton_krylov, only: newton_krylov, new_newton_krylov, hessian_product
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   implicit none
   private
   public :: krylov_midpoint, new_krylov_midpoint

   type, extends(midpoint_part) :: krylov_midpoint
      private
      type(newton_krylov) :: products
      real(wp), allocatable :: q(:, :), r(:, :)  !! Q and residual (nlane, ndof)
   contains
      procedure :: iterate
   end type krylov_midpoint

contains

   !> Room for nlane lanes and two degrees of freedom or more.
   subroutine new_krylov_midpoint(self, model, nlane, options)
      type(krylov_midpoint), intent(out) :: self
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane
      type(newton_options), intent(in) :: options

      associate (n => model%traits%ndof)
         call new_newton(self%newton, nlane, n, options, .false., dense, dense, judge_only=.true.)
         call new_newton_krylov(self%products, nlane, n, n)
         allocate (self%q(nlane, n), self%r(nlane, n))
      end associate
   end subroutine new_krylov_midpoint

   subroutine iterate(self, ham, eq, w, status)
      class(krylov_midpoint), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(inout) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
      integer(i8), intent(inout) :: status(eq%nlane)
      logical :: first

      first = eq%starts(self%newton)
      call position(eq%nlane*eq%n, eq%c, eq%base(1, 1), eq%x, self%q)
      call ham%model%gradient(eq%nlane, eq%n, eq%m, eq%t, w, self%q, eq%still, hq=self%r)
      ham%counters%gradients = ham%counters%gradients + eq%nreal
      call eq%weigh(1, eq%n, self%r)
      call add_times(eq%nlane*eq%n, 1.0_wp, eq%x, self%r)
      associate (nlane => eq%nlane, n => eq%n, c => 0.25_wp*eq%h, k => self%products%krylov%k, &
                 v => self%products%krylov%v, u => self%products%uq)
         call self%products%begin(self%newton, self%r)
         do while (self%products%wanted > 0)  ! A = I + (h/4) Hhat_qq
            call hessian_product(ham, nlane, n, self%products%wanted, eq%t, w, self%q, eq%still, v(:, :, k), eq%still, &
                                 u, self%products%up)
            v(:, :, k + 1) = v(:, :, k) + c*u
            call self%products%take()
         end do
         call self%products%finish(self%newton, eq%x, status, ham%counters)
      end associate
      if (.not. first) return
      eq%stiff_ratio = self%products%krylov%largest - 1  ! the largest |A v| of vectors of size one
      eq%stiff = any(eq%stiff_ratio > 1)
   end subroutine iterate

end module symsde_step_midpoint_krylov
