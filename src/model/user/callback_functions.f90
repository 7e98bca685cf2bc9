! SPDX-License-Identifier: BSD-3-Clause
!> The C functions of a user's model, and their interfaces: arguments and results (symsde_gradient .. in symsde.h).
!>
!> Private to its family.
module symsde_model_user_callback_functions
   use, intrinsic :: iso_c_binding, only: c_double, c_int, c_ptr
   use symsde_model_chain_rows, only: chain_rows_callback
   implicit none
   private
   public :: user_functions, hessian_callback, gradient_hessian_callback
   public :: force_callback, force_derivative_callback, damping_callback

   !> The functions of a model, null where the user gives none; whole steps and parts of H have types of their own.
   type :: user_functions
      procedure(gradient_callback), pointer, nopass :: gradient => null()
      procedure(value_callback), pointer, nopass :: value => null()
      procedure(hessian_callback), pointer, nopass :: hessian => null()
      procedure(hessian_vector_callback), pointer, nopass :: hessian_vector => null()
      procedure(gradient_hessian_callback), pointer, nopass :: gradient_hessian => null()
      procedure(third_derivative_callback), pointer, nopass :: third_derivative => null()
      procedure(chain_rows_callback), pointer, nopass :: chain_rows => null()
      procedure(squares_callback), pointer, nopass :: squares => null()
      procedure(pull_callback), pointer, nopass :: pull => null()
   end type user_functions

   abstract interface
      !> Gradient of sum_j w_j H_j.
      function gradient_callback(nlane, ndof, nham, t, w, q, p, hq, hp, user) bind(c) result(code)
         import :: c_int, c_double, c_ptr
         integer(c_int), value :: nlane, ndof, nham
         real(c_double), value :: t
         real(c_double), intent(in) :: w(nlane, nham), q(nlane, ndof), p(nlane, ndof)
         real(c_double), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
         type(c_ptr), value :: user
         integer(c_int) :: code  !! 0 = ok
      end function gradient_callback

      !> Value of sum_j w_j H_j.
      function value_callback(nlane, ndof, nham, t, w, q, p, value, user) bind(c) result(code)
         import :: c_int, c_double, c_ptr
         integer(c_int), value :: nlane, ndof, nham
         real(c_double), value :: t
         real(c_double), intent(in) :: w(nlane, nham), q(nlane, ndof), p(nlane, ndof)
         real(c_double), intent(out) :: value(nlane)
         type(c_ptr), value :: user
         integer(c_int) :: code
      end function value_callback

      !> Blocks of the Hessian of sum_j w_j H_j.
      function hessian_callback(nlane, ndof, nham, t, w, q, p, hqq, hqp, hpp, user) &
         bind(c) result(code)
         import :: c_int, c_double, c_ptr
         integer(c_int), value :: nlane, ndof, nham
         real(c_double), value :: t
         real(c_double), intent(in) :: w(nlane, nham), q(nlane, ndof), p(nlane, ndof)
         real(c_double), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof)
         real(c_double), intent(out), optional :: hpp(nlane, ndof, ndof)
         type(c_ptr), value :: user
         integer(c_int) :: code
      end function hessian_callback

      !> The Hessian of sum_j w_j H_j times (vq, vp).
      function hessian_vector_callback(nlane, ndof, nham, t, w, q, p, vq, vp, uq, up, user) &
         bind(c) result(code)
         import :: c_int, c_double, c_ptr
         integer(c_int), value :: nlane, ndof, nham
         real(c_double), value :: t
         real(c_double), intent(in) :: w(nlane, nham), q(nlane, ndof), p(nlane, ndof)
         real(c_double), intent(in) :: vq(nlane, ndof), vp(nlane, ndof)
         real(c_double), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
         type(c_ptr), value :: user
         integer(c_int) :: code
      end function hessian_vector_callback

      !> Gradient and blocks of the Hessian at one point, for functions that share work between them.
      function gradient_hessian_callback(nlane, ndof, nham, t, w, q, p, hq, hp, hqq, hqp, hpp, user) &
         bind(c) result(code)
         import :: c_int, c_double, c_ptr
         integer(c_int), value :: nlane, ndof, nham
         real(c_double), value :: t
         real(c_double), intent(in) :: w(nlane, nham), q(nlane, ndof), p(nlane, ndof)
         real(c_double), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
         real(c_double), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof)
         real(c_double), intent(out), optional :: hpp(nlane, ndof, ndof)
         type(c_ptr), value :: user
         integer(c_int) :: code
      end function gradient_hessian_callback

      !> The gradient of a^T (Hessian of sum_j w_j H_j) b: third derivatives along (aq, ap) and (bq, bp).
      function third_derivative_callback(nlane, ndof, nham, t, w, q, p, aq, ap, bq, bp, uq, up, user) &
         bind(c) result(code)
         import :: c_int, c_double, c_ptr
         integer(c_int), value :: nlane, ndof, nham
         real(c_double), value :: t
         real(c_double), intent(in) :: w(nlane, nham), q(nlane, ndof), p(nlane, ndof)
         real(c_double), intent(in) :: aq(nlane, ndof), ap(nlane, ndof), bq(nlane, ndof), bp(nlane, ndof)
         real(c_double), intent(out) :: uq(nlane, ndof), up(nlane, ndof)
         type(c_ptr), value :: user
         integer(c_int) :: code
      end function third_derivative_callback

      !> w_0 F of the force, or sum_k w_k f_k of noise forces.
      function force_callback(nlane, ndof, nham, t, w, q, p, f, user) bind(c) result(code)
         import :: c_int, c_double, c_ptr
         integer(c_int), value :: nlane, ndof, nham
         real(c_double), value :: t
         real(c_double), intent(in) :: w(nlane, nham), q(nlane, ndof), p(nlane, ndof)
         real(c_double), intent(out) :: f(nlane, ndof)
         type(c_ptr), value :: user
         integer(c_int) :: code
      end function force_callback

      !> Derivatives of these forces: fq(:, i, j) of component i with respect to q_j, and fp(:, i, j) with respect to
      !> p_j.
      function force_derivative_callback(nlane, ndof, nham, t, w, q, p, fq, fp, user) bind(c) result(code)
         import :: c_int, c_double, c_ptr
         integer(c_int), value :: nlane, ndof, nham
         real(c_double), value :: t
         real(c_double), intent(in) :: w(nlane, nham), q(nlane, ndof), p(nlane, ndof)
         real(c_double), intent(out) :: fq(nlane, ndof, ndof), fp(nlane, ndof, ndof)
         type(c_ptr), value :: user
         integer(c_int) :: code
      end function force_derivative_callback

      !> Products of gradients and Hessians of all noises, and derivatives of sums: `squares` in model/kernels.
      function squares_callback(nlane, ndof, nham, t, q, g, w, c, s, user) bind(c) result(code)
         import :: c_int, c_double, c_ptr
         integer(c_int), value :: nlane, ndof, nham
         real(c_double), value :: t
         real(c_double), intent(in) :: q(nlane, ndof)
         real(c_double), intent(out) :: g(nlane, ndof)
         real(c_double), intent(in), dimension(nlane, nham), optional :: w, c
         real(c_double), intent(out), optional :: s(nlane, 6)
         type(c_ptr), value :: user
         integer(c_int) :: code
      end function squares_callback

      !> Covectors over several steps: `pull` in model/kernels.
      function pull_callback(nlane, ndof, nham, nmoving, nstep, t, h, part, dw, q, theta, u, c, user) bind(c) &
         result(code)
         import :: c_int, c_double, c_ptr
         integer(c_int), value :: nlane, ndof, nham, nmoving, nstep
         real(c_double), value :: t, h
         real(c_double), intent(in) :: part(2), dw(nlane, nham - 1, nstep)
         real(c_double), intent(in) :: q(nlane, nmoving, 0:nstep), theta(nlane, ndof - nmoving)
         real(c_double), intent(inout) :: u(nlane, ndof), c(nlane, nmoving)
         type(c_ptr), value :: user
         integer(c_int) :: code
      end function pull_callback

      !> Rates of damping, one for all momenta or one for each.
      function damping_callback(nlane, ndof, nrate, t, q, rate, user) bind(c) result(code)
         import :: c_int, c_double, c_ptr
         integer(c_int), value :: nlane, ndof, nrate
         real(c_double), value :: t
         real(c_double), intent(in) :: q(nlane, ndof)
         real(c_double), intent(out) :: rate(nlane, nrate)
         type(c_ptr), value :: user
         integer(c_int) :: code
      end function damping_callback
   end interface

end module symsde_model_user_callback_functions
