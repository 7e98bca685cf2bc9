! SPDX-License-Identifier: BSD-3-Clause
!> The equation of the midpoint rule whose momenta are eliminated, and what solves it.
!>
!> Both unknowns of step/midpoint/eliminated, V = dp and dq, obey
!>
!>    x + f(base + c x) = 0,   d f/d x = (h/4) Hhat_qq
!>
!>    x = V     base = q_n + (h p_n + g)/2   c = h/4    f = Hhat_q
!>    x = dq    base = q_n                   c = 1/2    f = (h/2) Hhat_q - (h p_n + g)
!>
!> where g is the part of Hhat_p that additive noise makes. The derivative by x is the same in both cases, for V
!> since c = h/4, for dq since c = 1/2 stands beside the factor h/2 of f. So one residual, one matrix and one way to
!> solve serve both.
!>
!> A part takes the equation of some lanes and finds x by Newton's iteration
!>
!>    x <- x - (I + (h/4) K(Q))^{-1} (x + f(Q)),   Q = base + c x,   K = Hhat_qq,
!>
!> and how it solves these linear systems is all that the parts differ in: step/midpoint/dense eliminates matrices,
!> step/midpoint/tridiagonal the rows of a chain, and step/midpoint/krylov multiplies by K alone.
!>
!> The equation is a type of its own, apart from the parts, because the stepper sets it up (base, c, drift) and the
!> part only reads it, but for x and the rate.
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

   !> The equations of the lanes that are taken through a step together.
   !> Its arrays hold lanes in the first index, so that a kernel runs over them in vectors. The stepper sets h, t, c,
   !> base and drift, and the part finds x and the rate.
   type :: midpoint_equation
      integer :: nlane = 0, n = 0, m = 0         !! lanes, degrees of freedom, noises
      integer :: nreal = 0                       !! real paths among the lanes, for the counters
      logical :: for_dq = .false.                !! the unknown is dq, else V
      real(wp) :: h = 0, t = 0                   !! step, and time of the middle
      real(wp) :: c = 0
      real(wp), allocatable :: base(:, :)        !! rows 0 and n+1 are zero (nlane, 0:n+1)
      real(wp), allocatable :: x(:, :)           !! the unknown (nlane, n)
      real(wp), allocatable :: drift(:, :)       !! h p_n + g, set for dq (nlane, n)
      real(wp), allocatable :: still(:, :)       !! zero: the momentum for which the force is asked (nlane, n)
      logical :: noncontracting = .false.        !! in the equation of V: the rate is above one in some lane
      real(wp), allocatable :: rate(:)           !! then (h omega)^2/4 of each lane, about (nlane)
   contains
      procedure :: make_room
      procedure :: starts
      procedure :: weigh
   end type midpoint_equation

   !> A way to solve the equation. Its Newton iteration has the counts, stopping test and options of all steppers.
   type, abstract :: midpoint_part
      type(newton_type) :: newton
   contains
      procedure(make_interface), deferred :: make
      procedure(solve_interface), deferred :: solve
   end type midpoint_part

   abstract interface
      !> Make it ready for nlane lanes of a model: its Newton iteration, and room.
      subroutine make_interface(self, model, nlane, options)
         import :: midpoint_part, model_type, newton_options
         class(midpoint_part), intent(inout) :: self
         class(model_type), intent(in) :: model
         integer, intent(in) :: nlane
         type(newton_options), intent(in) :: options
      end subroutine make_interface

      !> x by Newton's iteration, from V = 0 or from the dq that V gave; the first one for V notes the rate.
      subroutine solve_interface(self, ham, eq, w, status)
         import :: midpoint_part, midpoint_equation, one_step_hamiltonian, wp, i8
         class(midpoint_part), intent(inout) :: self
         type(one_step_hamiltonian), intent(inout) :: ham    !! model and counters
         type(midpoint_equation), intent(inout) :: eq
         real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
         integer(i8), intent(inout) :: status(eq%nlane)      !! 0, or a code that freezes the lane
      end subroutine solve_interface
   end interface

contains

   !> Make room for the lanes. Rows 0 and n+1 of base stay zero: a chain reads neighbours there, which its ends
   !> lack.
   subroutine make_room(self)
      class(midpoint_equation), intent(inout) :: self

      associate (nlane => self%nlane, n => self%n)
         allocate (self%base(nlane, 0:n + 1), self%still(nlane, n), self%x(nlane, n), source=0.0_wp)
         allocate (self%drift(nlane, n), self%rate(nlane))
      end associate
   end subroutine make_room

   !> Whether this is the first iteration for V. There x = 0, so Q = base needs no pass, and the Hessian at this
   !> point gives the rate. The iteration for dq begins with the dq of V instead.
   pure logical function starts(self, newton)
      class(midpoint_equation), intent(in) :: self
      type(newton_type), intent(in) :: newton

      starts = newton%iteration == 0 .and. .not. self%for_dq
   end function starts

   !> Make f of the present unknown from Hhat_q, in rows first .. last of all lanes; for V it is Hhat_q itself.
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
