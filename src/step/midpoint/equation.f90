! SPDX-License-Identifier: BSD-3-Clause
!> The equation of the midpoint rule with eliminated momenta, and the interface of the parts that solve it.
!>
!> The two unknowns of step/midpoint/eliminated, V = dp and dq, obey
!>
!>    x + f(base + c x) = 0,   d f/d x = (h/4) Hhat_qq
!>
!>    x = V     base = q_n + (h p_n + g)/2   c = h/4    f = Hhat_q
!>    x = dq    base = q_n                   c = 1/2    f = (h/2) Hhat_q - (h p_n + g)
!>
!> where g is the part of Hhat_p from additive noise. The derivative with respect to x is the same in both cases, for V
!> since c = h/4, for dq since c = 1/2 is multiplied by the factor h/2 of f. So one residual, one matrix and one way to
!> solve serve both unknowns.
!>
!> A part gets the equation of some lanes and finds x by Newton's iteration
!>
!>    x <- x - (I + (h/4) K(Q))^{-1} (x + f(Q)),   Q = base + c x,   K = Hhat_qq,
!>
!> and the parts differ only in how they solve these linear systems: step/midpoint/dense eliminates matrices,
!> step/midpoint/tridiagonal the rows of a chain, and step/midpoint/krylov uses only products with K.
!>
!> The equation is a separate type, because the stepper sets it up (base, c, drift) and the part only reads it, except
!> for x and the rate.
!>
!> Private to its family.
module symsde_step_midpoint_equation
   use symsde_base_kinds, only: wp, i8
   use symsde_model_abstract, only: model_type
   use symsde_solve_newton, only: newton_type, newton_options
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   implicit none
   private
   public :: midpoint_equation, midpoint_part
   public :: position, correct_pair, weigh_force

   !> The equations of the lanes that are taken through a step together. Arrays have the lane as the first index, so
   !> that kernels run over lanes in vectors. The stepper sets h, t, c, base and drift, and the part finds x and the
   !> rate.
   type :: midpoint_equation
      integer :: nlane = 0, n = 0, m = 0         !! numbers of lanes, degrees of freedom, noises
      integer :: nreal = 0                       !! real paths among the lanes, for the counters
      logical :: for_dq = .false.                !! whether the unknown is dq, else V
      real(wp) :: h = 0, t = 0                   !! step, and time of its middle
      real(wp) :: c = 0
      real(wp), allocatable :: base(:, :)        !! rows 0 and n+1 are zero (nlane, 0:n+1)
      real(wp), allocatable :: x(:, :)           !! the unknown (nlane, n)
      real(wp), allocatable :: drift(:, :)       !! h p_n + g, set for dq (nlane, n)
      real(wp), allocatable :: still(:, :)       !! zero momenta for calls of the model (nlane, n)
      logical :: noncontracting = .false.        !! for V: whether the rate is above one in some lane
      real(wp), allocatable :: rate(:)           !! if noncontracting, about (h omega)^2/4 of each lane (nlane)
   contains
      procedure :: make_room
      procedure :: starts
      procedure :: weigh
   end type midpoint_equation

   !> A way to solve the equation. Its Newton iteration has the stopping test and the options that all steppers have,
   !> and counts as theirs do.
   type, abstract :: midpoint_part
      type(newton_type) :: newton
   contains
      procedure(make_interface), deferred :: make
      procedure(solve_interface), deferred :: solve
   end type midpoint_part

   abstract interface
      !> Prepare the part for nlane lanes of a model: its Newton iteration and arrays.
      subroutine make_interface(self, model, nlane, options)
         import :: midpoint_part, model_type, newton_options
         class(midpoint_part), intent(inout) :: self
         class(model_type), intent(in) :: model
         integer, intent(in) :: nlane
         type(newton_options), intent(in) :: options
      end subroutine make_interface

      !> Find x by Newton's iteration, from V = 0 or from the dq of V; the first iteration for V sets the rate.
      subroutine solve_interface(self, ham, eq, w, status)
         import :: midpoint_part, midpoint_equation, one_step_hamiltonian, wp, i8
         class(midpoint_part), intent(inout) :: self
         type(one_step_hamiltonian), intent(inout) :: ham    !! model and counters
         type(midpoint_equation), intent(inout) :: eq
         real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
         integer(i8), intent(inout) :: status(eq%nlane)      !! 0, or a code: the lane is skipped
      end subroutine solve_interface
   end interface

contains

   !> Allocate the arrays of the lanes. Rows 0 and n+1 of base stay zero, where a chain reads the missing neighbours of
   !> its ends.
   subroutine make_room(self)
      class(midpoint_equation), intent(inout) :: self

      associate (nlane => self%nlane, n => self%n)
         allocate (self%base(nlane, 0:n + 1), self%still(nlane, n), self%x(nlane, n), source=0.0_wp)
         allocate (self%drift(nlane, n), self%rate(nlane))
      end associate
   end subroutine make_room

   !> Whether this is the first iteration for V. There x = 0, so Q = base needs no pass, and the Hessian at this point
   !> gives the rate. The iteration for dq starts from the dq of V instead.
   pure logical function starts(self, newton)
      class(midpoint_equation), intent(in) :: self
      type(newton_type), intent(in) :: newton

      starts = newton%iteration == 0 .and. .not. self%for_dq
   end function starts

   !> Turn Hhat_q into f of the current unknown, in rows first .. last of all lanes; for V it is Hhat_q itself.
   subroutine weigh(self, first, last, f)
      class(midpoint_equation), intent(in) :: self
      integer, intent(in) :: first, last
      real(wp), intent(inout) :: f(self%nlane, first:last)

      if (self%for_dq) call weigh_force((last - first + 1)*self%nlane, 0.5_wp*self%h, self%drift(1, first), f)
   end subroutine weigh

   ! ---- kernels ----------------------------------------------------------------------------------

   include '../../solve/all_lanes.inc'
   include 'equation.inc'

end module symsde_step_midpoint_equation
