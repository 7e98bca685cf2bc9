! SPDX-License-Identifier: BSD-3-Clause
!> The eliminated midpoint without matrices, for many degrees of freedom and dense Hessians. In the notation of
!> step/midpoint/equation an iteration is
!>
!>    r = x + f(Q),  Q = base + c x;   A d = r  with  A v = v + (h/4) Hhat_qq(Q) v;   x <- x - d
!>
!> GMRES (step/implicit/newton_krylov) finds d from a few products A v, as many as the goal of the iteration requires.
!> Each is a product with the Hessian, or the difference of two gradients; a matrix would take ndof products, and
!> ndof^3/3 operations to eliminate.
!>
!> A is close to I if (h omega)^2/4 is small, so that few products suffice. The iteration ends by the same test as all
!> others, so its root is that of the parts with matrices.
!>
!> Private to its family.
module symsde_step_midpoint_krylov
   use symsde_base_kinds, only: wp, i8
   use symsde_base_traits, only: dense
   use symsde_base_vectors, only: add_times
   use symsde_model_abstract, only: model_type
   use symsde_solve_newton, only: newton_options, new_newton
   use symsde_step_midpoint_equation, only: midpoint_equation, midpoint_part, position
   use symsde_step_implicit_newton_krylov, only: newton_krylov, new_newton_krylov
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   implicit none
   private
   public :: krylov_midpoint

   !> The part without matrices: GMRES and its vectors, the point and the residual.
   type, extends(midpoint_part) :: krylov_midpoint
      private
      type(newton_krylov) :: products
      real(wp), allocatable :: q(:, :), r(:, :)  !! Q and residual (nlane, ndof)
   contains
      procedure :: make
      procedure :: solve
   end type krylov_midpoint

contains

   !> Allocate for nlane lanes and two degrees of freedom or more, without matrices; only the test of Newton's iteration
   !> is used.
   subroutine make(self, model, nlane, options)
      class(krylov_midpoint), intent(inout) :: self
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane
      type(newton_options), intent(in) :: options

      associate (n => model%traits%ndof)
         call new_newton(self%newton, nlane, n, options, .false., dense, dense, judge_only=.true.)
         call new_newton_krylov(self%products, nlane, n, n)
         allocate (self%q(nlane, n), self%r(nlane, n))
      end associate
   end subroutine make

   !> Find x in lanes without a status, from V = 0 or from the dq of V. step/implicit/newton_krylov solves and judges
   !> every iteration; this procedure computes the residual x + f and the products that it asks for.
   subroutine solve(self, ham, eq, w, status)
      class(krylov_midpoint), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(inout) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
      integer(i8), intent(inout) :: status(eq%nlane)
      logical :: first

      associate (nlane => eq%nlane, n => eq%n, c => 0.25_wp*eq%h, newton => self%newton, products => self%products, &
                 k => self%products%krylov%k, v => self%products%krylov%v)
         if (.not. eq%for_dq) eq%x = 0
         call newton%start(status)
         do while (newton%running)
            first = eq%starts(newton)
            ! Residual r = x + f(Q): the force at Q, turned into f of this unknown, plus x.
            call position(nlane*n, eq%c, eq%base(1, 1), eq%x, self%q)
            call ham%bare_gradient(nlane, eq%t, w, self%q, eq%still, hq=self%r)
            ham%counters%gradients = ham%counters%gradients + eq%nreal
            call eq%weigh(1, n, self%r)
            call add_times(nlane*n, 1.0_wp, eq%x, self%r)
            call products%begin(newton, self%r)
            do while (products%wanted > 0)  ! A = I + (h/4) Hhat_qq
               ! v_{k+1} = v_k + (h/4) Hhat_qq v_k: the p part of the vector is zero (eq%still), and the p part of the
               ! product is not read.
               call ham%bare_product(nlane, products%wanted, eq%t, w, self%q, eq%still, v(:, :, k), eq%still, &
                                     products%uq, products%up)
               v(:, :, k + 1) = v(:, :, k) + c*products%uq
               call products%take()
            end do
            call products%finish(newton, eq%x, status, ham%counters)
            ! |A v| - 1 is at most |(h/4) K v| for |v| = 1, so a lane that counts as noncontracting has a rate above
            ! one. A lane is judged by its own vectors alone: its bits must not depend on the number of vectors of its
            ! neighbours.
            if (first) eq%rate = products%krylov%largest - 1  ! the largest |A v| of vectors of size one
            if (first) eq%noncontracting = any(eq%rate > 1)
         end do
      end associate
   end subroutine solve

end module symsde_step_midpoint_krylov
