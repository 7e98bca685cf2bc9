! SPDX-License-Identifier: BSD-3-Clause
!>    S = sum_j w_j H_j = w_0 p.p/2 + sum_i u_i(q_i, q_{i+1})
!>    row i:  hq(i) = dS/dq_i,   hqq(0,i) = d2S/dq_i^2,   hqq(1,i) = d2S/(dq_i dq_{i+1})
!>
!> The rows of a chain: the interface of a user's function, a check of models that may have one, and force and stiffness
!> of a whole block. Row i depends on q_{i-1}, q_i and q_{i+1} alone, and includes its stiffness: so a solver can
!> eliminate mass after mass without storing a matrix. Positions before the first and after the last row are given too;
!> they are zero at the ends of a chain.
module symsde_model_chain_rows
   use, intrinsic :: iso_c_binding, only: c_double, c_int, c_ptr
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, incompatible
   use symsde_base_traits, only: model_traits, strip_lanes
   use symsde_model_kernels, only: kernel_model
   implicit none
   private
   public :: block_from_rows, check_chain, chain_rows_callback

   abstract interface
      !> Rows first .. last of the force and of the stiffness of a chain, counted from 0.
      function chain_rows_callback(nlane, ndof, nham, first, last, t, w, q, hq, hqq, user) bind(c) result(code)
         import :: c_int, c_double, c_ptr
         integer(c_int), value :: nlane, ndof, nham, first, last
         real(c_double), value :: t
         real(c_double), intent(in) :: w(nlane, nham), q(nlane, first - 1:last + 1)
         real(c_double), intent(out) :: hq(nlane, first:last), hqq(nlane, 0:1, first:last)
         type(c_ptr), value :: user
         integer(c_int) :: code
      end function chain_rows_callback
   end interface

contains

   !> Refuse rows of a model that does not declare H = p.p/2 + U(q), tridiagonal, noise in position or additive.
   subroutine check_chain(name, traits, error)
      character(*), intent(in) :: name
      type(model_traits), intent(in) :: traits
      type(error_type), allocatable, intent(inout) :: error

      if (traits%bandwidth == 1 .and. traits%identity_mass .and. (traits%position_noise .or. traits%additive)) return
      call raise(error, incompatible, 'set_chain_rows', "model '"//name//"' does not declare what rows of a chain "// &
                 'need: declare bandwidth 1, identity_mass, and position_noise or additive, or give no rows')
   end subroutine check_chain

   !> force_stiffness with b = 1 for a model that offers chain_rows, for at most one strip of lanes. The last lane is
   !> repeated to fill the strip.
   subroutine block_from_rows(model, nlane, ndof, nnoise, t, w, q, hq, hqq)
      class(kernel_model), intent(in) :: model
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof)
      real(wp), intent(out) :: hq(nlane, ndof), hqq(nlane, 0:1, ndof)
      real(wp), allocatable :: ws(:, :), qs(:, :), f(:, :), k(:, :, :)  !! arrays of a strip
      integer :: lane

      ! A strip has strip_lanes lanes for any nlane, so that the compiler knows the length of the loops.
      allocate (ws(strip_lanes, 0:nnoise), qs(strip_lanes, 0:ndof + 1), f(strip_lanes, ndof), &
                k(strip_lanes, 0:1, ndof))
      qs(:, 0) = 0
      qs(:, ndof + 1) = 0
      do lane = 1, strip_lanes
         ws(lane, :) = w(min(lane, nlane), :)
         qs(lane, 1:ndof) = q(min(lane, nlane), :)
      end do
      call model%chain_rows(ndof, nnoise, 1, ndof, t, ws, qs, f, k)
      hq = f(:nlane, :)
      hqq = k(:nlane, :, :)
   end subroutine block_from_rows

end module symsde_model_chain_rows
