! SPDX-License-Identifier: BSD-3-Clause
!> The implicit midpoint rule without momenta for a single path: eliminated.inc with one lane.
!>
!>    V + Hhat_q(q_n + (h p_n + g)/2 + h V/4) = 0,   dp = V,   dq = h (p_n + V/2) + g
!>
!> A path has the bits that it has in a block. If (h omega)^2/4 > 1 it continues with dq as its unknown, like a lane.
!>
!> Earlier code with scalars written out by hand was faster: one or two unknowns now take 1.1 to 1.2 times as long
!> (henon_heiles 82 ns a step instead of 69), eight and more 1.0 to 1.1 times. An iteration calls three procedures that
!> are dispatched at run time or not inlined, and its numbers go through memory.
module symsde_step_midpoint_eliminated_single_path
   use symsde_base_damping, only: damping_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_traits, only: strip_lanes
   use symsde_model_abstract, only: model_type
   use symsde_model_kernels, only: kernel_offers, offers_of
   use symsde_scheme_decays, only: tableau_decays, new_decays
   use symsde_scheme_scheme, only: correction_none
   use symsde_solve_newton, only: newton_options
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_midpoint_dense_single_path, only: dense_midpoint
   use symsde_step_midpoint_eliminated, only: choose_way, by_rows, by_products
   use symsde_step_midpoint_equation, only: midpoint_equation, midpoint_part
   use symsde_step_midpoint_krylov, only: krylov_midpoint
   use symsde_step_midpoint_tridiagonal_single_path, only: tridiagonal_midpoint
   use symsde_step_stepper, only: stepper_type, stepper_task, few_of
   implicit none
   private
   public :: midpoint_stepper, new_midpoint_stepper, by_products

   integer, parameter :: unit = 1  !! lanes of a vector

   type, extends(stepper_type) :: midpoint_stepper
      private
      class(midpoint_part), allocatable :: part
      type(midpoint_equation) :: eq            !! equation of the one lane
      logical :: has_shift = .false.           !! whether additive noise moves the positions: g /= 0
      logical :: damped = .false.
      type(tableau_decays) :: decays           !! factors of momenta: one without damping, and `loss` zero
      real(wp), allocatable :: extent(:)       !! not allocated: only states of a block are moved
      real(wp), allocatable :: shift(:, :)     !! g (eq%nlane, ndof)
   contains
      procedure :: make
      procedure :: increment
   end type midpoint_stepper

contains

   include 'eliminated.inc'
   include '../../solve/one_lane.inc'

   !> dq and dp of the path (1, ndof): set up the equation for this step, and let the part solve it. There are no strips
   !> and no copies; the only lane is a real path, so that everything is counted.
   subroutine increment(self, step, q, p, dq, dp, status)
      class(midpoint_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      real(wp), pointer, contiguous :: w(:, :)  ! a name that gfortran 12 recognises as contiguous

      call begin(self, step)
      w => step%w
      ! No padding: every evaluation counts once.
      self%eq%nreal = 1
      call step_together(self, 1, 0, w, q, p, dq, dp, status)
   end subroutine increment

end module symsde_step_midpoint_eliminated_single_path
