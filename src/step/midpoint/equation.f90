! SPDX-License-Identifier: BSD-3-Clause
!> The equation of the midpoint rule whose momenta are eliminated, and what solves it.
!>
!> Both unknowns of step/midpoint/eliminated, V = dp and dq, obey
!>
!>    x + f(base + c x) = 0,   f' = (h/4) Hhat_qq
!>
!>    x = V     base = q_n + (h p_n + g)/2   c = h/4    f = Hhat_q
!>    x = dq    base = q_n                   c = 1/2    f = (h/2) Hhat_q - (h p_n + g)
!>
!> A part takes this for some lanes and finds x by Newton's iteration with matrices I + (h/4) Hhat_qq: how it
!> solves these is all that the parts differ in (step/midpoint/dense, _by_rows, _by_products).
!>
!> Private to its family.
module symsde_step_midpoint_equation
   use symsde_base_kinds, only: wp, i8
   use symsde_model_abstract, only: model_type
   use symsde_solve_newton, only: newton_type
   use symsde_solve_stagnation, only: quadratic, verdict_of
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   implicit none
   private
   public :: midpoint_equation, new_midpoint_equation, midpoint_part, solve_by_iterations
   public :: position, correct_pair, correction_of, solve_pair

   !> The equations of the lanes that are taken through a step together.
   type :: midpoint_equation
      integer :: nlane = 0, n = 0, m = 0         !! lanes, degrees of freedom, noises
      integer :: nreal = 0                       !! real paths among the lanes, what the counters count
      logical :: for_dq = .false.                !! the unknown is dq, else V
      real(wp) :: h = 0, t = 0                   !! step, and time of the middle
      real(wp) :: c = 0
      real(wp), allocatable :: base(:, :)        !! rows 0 and n+1 are zero (nlane, 0:n+1)
      real(wp), allocatable :: x(:, :)           !! the unknown (nlane, n)
      real(wp), allocatable :: drift(:, :)       !! h p_n + g, set for dq (nlane, n)
      real(wp), allocatable :: still(:, :)       !! zero: the momentum for which the force is asked (nlane, n)
      logical :: stiff = .false.                 !! of V: (h omega)^2/4 > 1 in some lane
      real(wp), allocatable :: stiff_ratio(:)      !! where stiff: (h omega)^2/4 of each lane, about (nlane)
   contains
      procedure :: make_room
      procedure :: starts
      procedure :: weigh
      procedure :: note_stiff_ratio
   end type midpoint_equation

   !> How the equation is solved.
   type, abstract :: midpoint_part
      type(newton_type) :: newton
   contains
      procedure :: solve => solve_by_iterations
      procedure(iterate_interface), deferred :: iterate
   end type midpoint_part

   abstract interface
      !> One of Newton's iterations; the first one for V notes the stiff_ratio.
      subroutine iterate_interface(self, ham, eq, w, status)
         import :: midpoint_part, midpoint_equation, one_step_hamiltonian, wp, i8
         class(midpoint_part), intent(inout) :: self
         type(one_step_hamiltonian), intent(inout) :: ham    !! model and counters
         type(midpoint_equation), intent(inout) :: eq
         real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
         integer(i8), intent(inout) :: status(eq%nlane)      !! 0, or a code that freezes the lane
      end subroutine iterate_interface
   end interface

contains

   !> The equations of so many lanes, without room.
   subroutine new_midpoint_equation(self, nlane, n, m)
      type(midpoint_equation), intent(out) :: self
      integer, intent(in) :: nlane, n, m

      self%nlane = nlane
      self%n = n
      self%m = m
   end subroutine new_midpoint_equation

   !> Room for its lanes.
   subroutine make_room(self)
      class(midpoint_equation), intent(inout) :: self

      associate (nlane => self%nlane, n => self%n)
         allocate (self%base(nlane, 0:n + 1), self%still(nlane, n), self%x(nlane, n), source=0.0_wp)
         allocate (self%drift(nlane, n), self%stiff_ratio(nlane))
      end associate
   end subroutine make_room

   !> Newton from V = 0, or from the dq that V gave.
   subroutine solve_by_iterations(self, ham, eq, w, status)
      class(midpoint_part), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(inout) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
      integer(i8), intent(inout) :: status(eq%nlane)

      if (.not. eq%for_dq) eq%x = 0
      call self%newton%start(status)
      do while (self%newton%running)
         call self%iterate(ham, eq, w, status)
      end do
   end subroutine solve_by_iterations

   !> Whether this is the first iteration for V, where the point is base.
   pure logical function starts(self, newton)
      class(midpoint_equation), intent(in) :: self
      type(newton_type), intent(in) :: newton

      starts = newton%iteration == 0 .and. .not. self%for_dq
   end function starts

   !> From the force in rows first .. last to f of this unknown.
   subroutine weigh(self, first, last, f)
      class(midpoint_equation), intent(in) :: self
      integer, intent(in) :: first, last
      real(wp), intent(inout) :: f(self%nlane, first:last)

      if (self%for_dq) call weigh_force((last - first + 1)*self%nlane, 0.5_wp*self%h, self%drift(1, first), f)
   end subroutine weigh

   !> Take in a slope of f, (h/4) Hhat_ii, of every lane; the first one of a step has `first` true.
   subroutine note_stiff_ratio(self, slope, first)
      class(midpoint_equation), intent(inout) :: self
      real(wp), intent(in) :: slope(self%nlane)
      logical, intent(in) :: first

      if (first) self%stiff_ratio = 0
      call take_larger(self%nlane, slope, self%stiff_ratio)
   end subroutine note_stiff_ratio

   !> Two unknowns of a path by itself, from V = 0, or from dq: the iterations that were taken, none where it does not
   !> converge, or where something is not finite. Whether the step is mild is for the caller to say: products with
   !> h/4 are contracted here as in lanes, since nothing else asks for them.
   subroutine solve_pair(model, m, max_iter, affine, t, h, w, base, x, slope, iteration, drift)
      class(model_type), intent(in) :: model
      integer, intent(in) :: m, max_iter   !! noises, iterations
      logical, intent(in) :: affine        !! one is all
      real(wp), intent(in) :: t, h, w(0:m), base(2)
      real(wp), intent(inout) :: x(2)      !! V or dq
      real(wp), intent(out) :: slope(2)    !! the first Hhat_ii
      integer, intent(out) :: iteration
      real(wp), intent(in), optional :: drift(2)  !! the unknown is dq
      real(wp) :: f1, f2, k11, k21, k12, k22, q1, q2, x1, x2, d1, d2, c, last, step, size

      c = merge(0.5_wp, 0.25_wp*h, present(drift))
      x1 = x(1)
      x2 = x(2)
      q1 = base(1)
      q2 = base(2)
      if (present(drift)) then
         q1 = q1 + c*x1
         q2 = q2 + c*x2
      end if
      last = 0
      do iteration = 1, max_iter
         call model%pair(m, t, w, q1, q2, f1, f2, k11, k21, k12, k22)
         if (iteration == 1) then
            slope(1) = k11
            slope(2) = k22
         end if
         if (present(drift)) then
            f1 = 0.5_wp*h*f1 - drift(1)
            f2 = 0.5_wp*h*f2 - drift(2)
         end if
         call correction(0.25_wp*h, f1, f2, k11, k21, k12, k22, x1, x2, d1, d2)
         x1 = x1 - d1
         x2 = x2 - d2
         step = max(abs(d1), abs(d2)) + 0*(d1 + d2)  ! NaN stays
         size = max(abs(x1), abs(x2))
         if (.not. step + size <= huge(c)) exit
         last = verdict_of(quadratic, step, size, last)
         if (affine .or. last < 0) then
            x(1) = x1
            x(2) = x2
            return
         end if
         q1 = base(1) + c*x1
         q2 = base(2) + c*x2
      end do
      iteration = 0
   end subroutine solve_pair

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC Q = base + c x
   pure subroutine position(n, c, base, x, q)
      integer, intent(in) :: n
      real(wp), intent(in) :: c, base(n), x(n)
      real(wp), intent(out) :: q(n)
      integer :: i

      do i = 1, n
         q(i) = base(i) + c*x(i)
      end do
   end subroutine position

   !> VEC Two unknowns: x = x - (I + c K)^{-1} (x + f) in running lanes, with the size of correction and unknowns in
   !> each.
   pure subroutine correct_pair(nlane, c, f, k, last, x, step, size)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: c, f(nlane, 2), k(nlane, 2, 2), last(nlane)
      real(wp), intent(inout) :: x(nlane, 2)
      real(wp), intent(out) :: step(nlane), size(nlane)
      real(wp) :: d1, d2
      integer :: lane

      do lane = 1, nlane
         call correction(c, f(lane, 1), f(lane, 2), k(lane, 1, 1), k(lane, 2, 1), k(lane, 1, 2), k(lane, 2, 2), &
                         x(lane, 1), x(lane, 2), d1, d2)
         x(lane, 1) = merge(x(lane, 1) - d1, x(lane, 1), last(lane) >= 0)
         x(lane, 2) = merge(x(lane, 2) - d2, x(lane, 2), last(lane) >= 0)
         step(lane) = max(abs(d1), abs(d2)) + 0*(d1 + d2)  ! NaN stays
         size(lane) = max(abs(x(lane, 1)), abs(x(lane, 2)))
      end do
   end subroutine correct_pair

   !> (I + c K)^{-1} (x + f), by Cramer's rule, which needs no pivots.
   pure subroutine correction(c, f1, f2, k11, k21, k12, k22, x1, x2, d1, d2)
      real(wp), intent(in) :: c, f1, f2, k11, k21, k12, k22, x1, x2
      real(wp), intent(out) :: d1, d2
      real(wp) :: a, b, e, d, r1, r2, inverse

      a = 1 + c*k11
      b = c*k12
      e = c*k21
      d = 1 + c*k22
      r1 = x1 + f1
      r2 = x2 + f2
      inverse = 1/(a*d - b*e)
      d1 = (d*r1 - b*r2)*inverse
      d2 = (a*r2 - e*r1)*inverse
   end subroutine correction

   !> The same for other modules: what they see is not inlined in the loop above.
   pure subroutine correction_of(c, f1, f2, k11, k21, k12, k22, x1, x2, d1, d2)
      real(wp), intent(in) :: c, f1, f2, k11, k21, k12, k22, x1, x2
      real(wp), intent(out) :: d1, d2

      call correction(c, f1, f2, k11, k21, k12, k22, x1, x2, d1, d2)
   end subroutine correction_of

   !> VEC (h/2) Hhat_q - (h p + g)
   pure subroutine weigh_force(n, half, drift, f)
      integer, intent(in) :: n
      real(wp), intent(in) :: half, drift(n)
      real(wp), intent(inout) :: f(n)
      integer :: i

      do i = 1, n
         f(i) = half*f(i) - drift(i)
      end do
   end subroutine weigh_force

   !> VEC
   pure subroutine take_larger(nlane, slope, stiff_ratio)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: slope(nlane)
      real(wp), intent(inout) :: stiff_ratio(nlane)
      integer :: lane

      do lane = 1, nlane
         stiff_ratio(lane) = merge(slope(lane), stiff_ratio(lane), slope(lane) > stiff_ratio(lane))
      end do
   end subroutine take_larger

end module symsde_step_midpoint_equation
