! SPDX-License-Identifier: BSD-3-Clause
!> Implicit midpoint for H = p.p/2 + U(q) with noise in position or additive: the momenta are eliminated.
!>
!>    p_{n+1} = p_n - Hhat_q(Q),   q_{n+1} = q_n + h (p_n + p_{n+1})/2 + g,   Q = (q_n + q_{n+1})/2
!>
!> ([WHSB] (82)-(83) for the synchrotron), g the constant part of Hhat_p from additive noise. The unknown
!> is V = p_{n+1} - p_n, half as many as in general:  V + Hhat_q(q_n + (h p_n + g)/2 + h V/4) = 0.
!>
!> Where a frequency is fast, (h omega)^2/4 > 1, dq = h (p_n + V/2) + g would cancel and lose h omega ulps of
!> q a step. In such lanes Newton goes on from there with dq as the unknown:
!>
!>    dq - (h p_n + g) + (h/2) Hhat_q(q_n + dq/2) = 0,   dp = 2 (dq - h p_n - g)/h
!>
!> with the same matrix. A lane is called stiff by its own first Hessian, never by its neighbours'.
!>
!> The equations, the switch and the increments stand here, once. What solves the linear systems is a part:
!> matrices eliminated across lanes (closed form, dense, banded), rows of a tridiagonal Hessian, or products
!> with the Hessian alone, for lanes that step/stages/stepper has not solved by iteration. They find the same root.
module symsde_step_midpoint_eliminated
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_lanes, only: lane_unit
   use symsde_base_traits, only: strip_lanes
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: correction_none
   use symsde_solve_newton, only: newton_options
   use symsde_step_lone, only: lone_stepper, few_of
   use symsde_step_midpoint_lone_eliminated, only: lone_midpoint
   use symsde_step_midpoint_lone_tridiagonal, only: lone_midpoint_rows
   use symsde_step_midpoint_dense, only: dense_midpoint, new_dense_midpoint
   use symsde_step_midpoint_krylov, only: krylov_midpoint, new_krylov_midpoint
   use symsde_step_midpoint_tridiagonal, only: tridiagonal_midpoint, new_tridiagonal_midpoint
   use symsde_step_midpoint_equation, only: midpoint_equation, new_midpoint_equation, midpoint_part
   use symsde_step_midpoint_update, only: find_bad_sums, add_in_place, find_bad
   use symsde_step_implicit_newton_krylov, only: does_without_matrices
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: midpoint_stepper, midpoint_fits, new_midpoint_stepper, midpoint_serves
   public :: by_matrix, by_rows, by_products

   integer, parameter :: by_matrix = 1, by_rows = 2, by_products = 3  !! what solves
   integer(i8), parameter :: copy_rests = 1  !! status of the copies that fill up lanes: any but 0

   type, extends(stepper_type) :: midpoint_stepper
      private
      class(midpoint_part), allocatable :: part
      type(midpoint_equation) :: eq            !! of the lanes that take the step together
      logical :: has_shift = .false.           !! additive noise moves the positions: g /= 0
      real(wp), allocatable :: extent(:)       !! the largest of q and p in a lane (eq%nlane)
      real(wp), allocatable :: shift(:, :)     !! g (eq%nlane, ndof)
      real(wp), allocatable :: w(:, :)         !! where not all lanes go together: their w (eq%nlane, 0:nnoise)
      real(wp), allocatable, dimension(:, :) :: q, p, dq, dp  !! where lanes are taken out (eq%nlane, ndof)
   contains
      procedure :: make
      procedure :: increment
      procedure :: move
      procedure :: offer_lone
   end type midpoint_stepper

contains

   !> Whether this stepper executes the task.
   logical function midpoint_fits(task) result(fits)
      type(stepper_task), intent(in) :: task

      fits = task%is_plain() .and. task%scheme%is_midpoint() .and. midpoint_serves(task%model, task%newton)
   end function midpoint_fits

   !> Whether momenta are eliminated, and matrices or rows solve what remains.
   pure logical function midpoint_serves(model, options)
      class(model_type), intent(in) :: model
      type(newton_options), intent(in) :: options

      midpoint_serves = model%traits%eliminates_momenta() .and. choose_way(model, options) /= by_products
   end function midpoint_serves

   subroutine make(self, task)
      class(midpoint_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      call new_midpoint_stepper(self, task%model, task%nlane, task%newton)
      self%one_solve = self%part%newton%affine
      self%left_out = 'half of the unknowns: identity mass'
   end subroutine make

   !> A midpoint stepper for blocks of nlane lanes.
   subroutine new_midpoint_stepper(self, model, nlane, options, way)
      type(midpoint_stepper), intent(out) :: self
      class(model_type), intent(in), target :: model
      integer, intent(in) :: nlane
      type(newton_options), intent(in) :: options
      integer, intent(in), optional :: way  !! by_matrix, by_rows or by_products, if not the fastest
      integer :: chosen, together

      chosen = choose_way(model, options)
      if (present(way)) chosen = way
      together = nlane
      self%name = 'midpoint, momenta eliminated'
      select case (chosen)
      case (by_rows)
         self%name = 'midpoint, momenta eliminated, tridiagonal'
         if (model%traits%has_chain_rows .or. modulo(nlane, strip_lanes) /= 0) together = strip_lanes
         allocate (tridiagonal_midpoint :: self%part)
      case (by_products)
         self%name = 'midpoint, momenta eliminated, matrix-free'
         allocate (krylov_midpoint :: self%part)
      case default
         allocate (dense_midpoint :: self%part)
      end select
      select type (part => self%part)
      type is (tridiagonal_midpoint)
         call new_tridiagonal_midpoint(part, model, together, options)
      type is (krylov_midpoint)
         call new_krylov_midpoint(part, model, together, options)
      type is (dense_midpoint)
         call new_dense_midpoint(part, model, together, options)
      end select
      call new_one_step_hamiltonian(self%ham, model, nlane, correction_none, 0.0_wp)
      associate (n => model%traits%ndof, m => model%traits%nnoise)
         call new_midpoint_equation(self%eq, together, n, m)
         self%has_shift = m > 0 .and. .not. model%traits%position_noise
         self%moves = chosen == by_rows .and. modulo(nlane, together) == 0 .and. .not. self%has_shift
      end associate
   end subroutine new_midpoint_stepper

   !> Room for lanes, made for the first step: that of a large system takes as long as some runs, and where lone paths
   !> take all steps it is not needed.
   subroutine make_room(self)
      type(midpoint_stepper), intent(inout) :: self

      call self%eq%make_room()
      associate (nlane => self%ham%nlane, together => self%eq%nlane, n => self%eq%n)
         if (self%moves) allocate (self%extent(together))
         if (self%has_shift) allocate (self%shift(together, n))
         if (self%moves .or. modulo(nlane, together) /= 0) &
            allocate (self%q(together, n), self%p(together, n), self%dq(together, n), self%dp(together, n))
         if (together /= nlane) allocate (self%w(together, 0:self%eq%m))
      end associate
   end subroutine make_room

   !> Paths one by one, where matrices or rows solve, noise is in position, one unknown or two have their derivatives.
   subroutine offer_lone(self, lone)
      class(midpoint_stepper), intent(in) :: self
      class(lone_stepper), allocatable, intent(out) :: lone
      type(lone_midpoint), allocatable :: made
      type(lone_midpoint_rows), allocatable :: rows

      if (self%has_shift) return
      select type (part => self%part)
      type is (dense_midpoint)
         if (.not. part%newton%options%is_free()) return
         if (self%eq%n == 1 .and. .not. self%ham%model%traits%has_hessian) return
         if (self%eq%n == 2 .and. .not. (part%iterates .or. self%ham%model%traits%has_hessian)) return
         if (self%eq%n > 1 .and. .not. (part%iterates .or. part%pairs)) return
         allocate (made)
         if (self%eq%n == 2 .and. self%ham%model%traits%has_lone_pair) made%most = 5  ! six take 1.06 of the time
         if (self%eq%n > 2) made%most = 6  ! seven take 0.8 to 1.0, eight 1.4 to 1.9
         made%affine = part%newton%affine
         made%iterates = part%iterates
         made%max_iter = part%newton%options%max_iter
         call move_alloc(made, lone)
      type is (tridiagonal_midpoint)
         if (self%ham%model%traits%has_chain_rows .and. .not. self%ham%model%traits%has_lone_rows) return
         allocate (rows)
         rows%most = few_of(self%eq%n, 4, 6)  ! five take 0.9 to 1.0
         rows%test = part%newton%test
         rows%max_iter = part%newton%options%max_iter
         call move_alloc(rows, lone)
      end select
   end subroutine offer_lone

   !> What solves the linear systems of a model fastest.
   pure integer function choose_way(model, options) result(way)
      class(model_type), intent(in) :: model
      type(newton_options), intent(in) :: options

      way = by_matrix
      if (.not. options%is_free()) return
      associate (t => model%traits)
         if (t%bandwidth == 1 .and. t%ndof > 2 .and. .not. t%differences_alone()) then
            way = by_rows
         else if (does_without_matrices(t, t%ndof, options)) then
            way = by_products
         end if
      end associate
   end function choose_way

   subroutine increment(self, step, q, p, dq, dp, status)
      class(midpoint_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      integer :: before

      call begin(self, step)
      associate (nlane => self%ham%nlane, together => self%eq%nlane)
         if (together == nlane) then
            self%eq%nreal = self%ham%nreal
            call step_together(self, nlane, 0, step%w, q, p, dq, dp, status)
            return
         end if
         do before = 0, nlane - together, together
            self%eq%nreal = max(0, min(together, self%ham%nreal - before))
            call take_rows(nlane, self%ham%nnoise + 1, before, step%w, self%w)
            call step_together(self, nlane, before, self%w, q, p, dq, dp, status(before + 1))
         end do
         if (before < nlane) call fill_up(self, before, step%w, q, p, dq, dp, status)
      end associate
   end subroutine increment

   subroutine begin(self, step)
      type(midpoint_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step

      if (.not. allocated(self%eq%x)) call make_room(self)
      self%eq%h = step%h
      self%eq%t = step%t + 0.5_wp*step%h
   end subroutine begin

   !> Lanes that go together get their new state while the old one is near.
   subroutine move(self, step, q, p, status)
      class(midpoint_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(inout) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      integer :: before

      call begin(self, step)
      associate (nlane => self%ham%nlane, together => self%eq%nlane)
         do before = 0, nlane - together, together
            self%eq%nreal = max(0, min(together, self%ham%nreal - before))
            if (together == nlane) then
               call move_together(self, nlane, before, step%w, q, p, status)
            else
               call take_rows(nlane, self%ham%nnoise + 1, before, step%w, self%w)
               call move_together(self, nlane, before, self%w, q, p, status(before + 1))
            end if
         end do
      end associate
   end subroutine move

   !> The last lanes of a block, too few to go together: the very last one fills up, in copies that rest.
   subroutine fill_up(self, before, w, q, p, dq, dp, status)
      class(midpoint_stepper), intent(inout) :: self
      integer, intent(in) :: before   !! lanes that are done
      real(wp), intent(in) :: w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(inout) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      integer(i8) :: lane_status(self%eq%nlane)
      integer :: lane, last

      associate (left => self%ham%nlane - before, together => self%eq%nlane)
         do lane = 1, together
            last = before + min(lane, left)
            self%w(lane, :) = w(last, :)
            self%q(lane, :) = q(last, :)
            self%p(lane, :) = p(last, :)
         end do
         lane_status = copy_rests
         lane_status(:left) = status(before + 1:)
         self%eq%nreal = max(0, min(left, self%ham%nreal - before))
         call step_together(self, together, 0, self%w, self%q, self%p, self%dq, self%dp, lane_status)
         dq(before + 1:, :) = self%dq(:left, :)
         dp(before + 1:, :) = self%dp(:left, :)
         status(before + 1:) = lane_status(:left)
      end associate
   end subroutine fill_up

   !> One step of the lanes that go together.
   subroutine step_together(self, nlane, before, w, q, p, dq, dp, status)
      class(midpoint_stepper), intent(inout) :: self
      integer, intent(in) :: nlane, before  !! lanes of the block, and of them before these
      real(wp), intent(in) :: w(self%eq%nlane, 0:self%eq%m), q(nlane, self%eq%n), p(nlane, self%eq%n)
      real(wp), intent(inout) :: dq(nlane, self%eq%n), dp(nlane, self%eq%n)
      integer(i8), intent(inout) :: status(self%eq%nlane)

      call solve_mild(self, nlane, before, w, q, p, status)
      call finish_increments(self, nlane, before, w, q, p, dq, dp, status)
   end subroutine step_together

   !> V of the lanes that go together.
   subroutine solve_mild(self, nlane, before, w, q, p, status)
      class(midpoint_stepper), intent(inout) :: self
      integer, intent(in) :: nlane, before
      real(wp), intent(in) :: w(self%eq%nlane, 0:self%eq%m), q(nlane, self%eq%n), p(nlane, self%eq%n)
      integer(i8), intent(inout) :: status(self%eq%nlane)

      associate (eq => self%eq)
         eq%for_dq = .false.
         eq%stiff = .false.
         eq%c = 0.25_wp*eq%h
         call half_drift(nlane, eq%n, before, eq%nlane, eq%h, q, p, eq%base(1, 1), self%extent)
         if (self%has_shift) call add_shift(self, w)
         call self%part%solve(self%ham, eq, w, status)
      end associate
   end subroutine solve_mild

   !> Their increments, from V, and in stiff lanes from dq.
   subroutine finish_increments(self, nlane, before, w, q, p, dq, dp, status)
      class(midpoint_stepper), intent(inout) :: self
      integer, intent(in) :: nlane, before
      real(wp), intent(in) :: w(self%eq%nlane, 0:self%eq%m), q(nlane, self%eq%n), p(nlane, self%eq%n)
      real(wp), intent(inout) :: dq(nlane, self%eq%n), dp(nlane, self%eq%n)
      integer(i8), intent(inout) :: status(self%eq%nlane)

      associate (eq => self%eq, first => before + 1, last => before + self%eq%nlane)
         call find_increments(nlane, eq%n, before, eq%nlane, eq%h, p, eq%x, dq, dp)
         if (self%has_shift) dq(first:last, :) = dq(first:last, :) + self%shift
         if (eq%stiff) call step_stiff(self, nlane, before, w, q, p, dq, dp, status)
      end associate
   end subroutine finish_increments

   !> One step of the states of lanes that go together.
   subroutine move_together(self, nlane, before, w, q, p, status)
      class(midpoint_stepper), intent(inout) :: self
      integer, intent(in) :: nlane, before
      real(wp), intent(in) :: w(self%eq%nlane, 0:self%eq%m)
      real(wp), intent(inout) :: q(nlane, self%eq%n), p(nlane, self%eq%n)
      integer(i8), intent(inout) :: status(self%eq%nlane)
      integer :: i

      call solve_mild(self, nlane, before, w, q, p, status)
      associate (eq => self%eq, n => self%eq%n, together => self%eq%nlane, first => before + 1, &
                 last => before + self%eq%nlane)
         if (eq%stiff) then
            self%q = q(first:last, :)
            self%p = p(first:last, :)
            call finish_increments(self, together, 0, w, self%q, self%p, self%dq, self%dp, status)
            eq%base(:, 1:n) = self%q + self%dq
            eq%x = self%p + self%dp
            call find_bad(together, n, eq%base(1, 1), eq%x, status)
            do i = 1, n
               q(first:last, i) = merge(eq%base(:, i), q(first:last, i), status == 0)
               p(first:last, i) = merge(eq%x(:, i), p(first:last, i), status == 0)
            end do
         else
            if (.not. maxval(self%extent + self%part%newton%size)*(1 + abs(eq%h)) <= 0.1_wp*huge(eq%h)) &
               call find_bad_sums(nlane, n, before, together, eq%h, q, p, eq%x, status)
            call add_in_place(nlane, n, before, together, eq%h, eq%x, status, q, p)
         end if
      end associate
   end subroutine move_together

   !> Half of g to the positions; g does not depend on where it is read.
   subroutine add_shift(self, w)
      class(midpoint_stepper), intent(inout) :: self
      real(wp), intent(in) :: w(self%eq%nlane, 0:self%eq%m)

      associate (eq => self%eq)
         call self%ham%model%gradient(eq%nlane, eq%n, eq%m, eq%t, w, eq%base(1, 1), eq%still, hp=self%shift)
         self%ham%counters%gradients = self%ham%counters%gradients + eq%nreal
         eq%base(:, 1:eq%n) = eq%base(:, 1:eq%n) + 0.5_wp*self%shift
      end associate
   end subroutine add_shift

   !> In the stiff lanes, dq as the unknown, from what V gave.
   subroutine step_stiff(self, nlane, before, w, q, p, dq, dp, status)
      class(midpoint_stepper), intent(inout) :: self
      integer, intent(in) :: nlane, before
      real(wp), intent(in) :: w(self%eq%nlane, 0:self%eq%m), q(nlane, self%eq%n), p(nlane, self%eq%n)
      real(wp), intent(inout) :: dq(nlane, self%eq%n), dp(nlane, self%eq%n)
      integer(i8), intent(inout) :: status(self%eq%nlane)
      integer(i8) :: lane_status(self%eq%nlane)
      integer :: i

      associate (eq => self%eq, n => self%eq%n, first => before + 1, last => before + self%eq%nlane)
         lane_status = merge(0_i8, -1_i8, eq%stiff_ratio > 1 .and. status == 0)
         if (all(lane_status < 0)) return
         eq%for_dq = .true.
         eq%c = 0.5_wp
         eq%base(:, 1:n) = q(first:last, :)
         eq%drift = eq%h*p(first:last, :)
         if (self%has_shift) eq%drift = eq%drift + self%shift
         eq%x = dq(first:last, :)
         call self%part%solve(self%ham, eq, w, lane_status)
         do i = 1, n
            dq(first:last, i) = merge(eq%x(:, i), dq(first:last, i), lane_status == 0)
            dp(first:last, i) = merge(2*(eq%x(:, i) - eq%drift(:, i))/eq%h, dp(first:last, i), lane_status == 0)
         end do
         where (lane_status > 0) status = lane_status
      end associate
   end subroutine step_stiff

   ! ---- kernels: lanes before+1 .. before+together of a block, a vector at a time

   !> VEC base = q + h p/2
   pure subroutine half_drift(nlane, n, before, together, h, q, p, base, extent)
      integer, intent(in) :: nlane, n, before, together
      real(wp), intent(in) :: h, q(nlane, n), p(nlane, n)
      real(wp), intent(out) :: base(together, n)
      real(wp), intent(out), optional :: extent(together)  !! the largest of q and p
      real(wp) :: largest(lane_unit)
      integer :: i, done, lane

      do done = 0, together - lane_unit, lane_unit
         largest = 0
         do i = 1, n
            !GCC$ unroll 8
            do lane = 1, lane_unit
               base(done + lane, i) = q(before + done + lane, i) + 0.5_wp*(h*p(before + done + lane, i))
               largest(lane) = max(max(abs(q(before + done + lane, i)), abs(p(before + done + lane, i))), largest(lane))
            end do
         end do
         if (present(extent)) extent(done + 1:done + lane_unit) = largest
      end do
   end subroutine half_drift

   !> VEC dp = V and dq = h (p + V/2)
   pure subroutine find_increments(nlane, n, before, together, h, p, v, dq, dp)
      integer, intent(in) :: nlane, n, before, together
      real(wp), intent(in) :: h, p(nlane, n), v(together, n)
      real(wp), intent(inout) :: dq(nlane, n), dp(nlane, n)
      integer :: i, lane

      do i = 1, n
         do lane = 1, together
            dp(before + lane, i) = v(lane, i)
            dq(before + lane, i) = h*(p(before + lane, i) + 0.5_wp*v(lane, i))
         end do
      end do
   end subroutine find_increments

   !> VEC Rows of a strip.
   pure subroutine take_rows(nlane, nrow, before, x, y)
      integer, intent(in) :: nlane, nrow, before
      real(wp), intent(in) :: x(nlane, nrow)
      real(wp), intent(out) :: y(strip_lanes, nrow)
      integer :: i, lane

      do i = 1, nrow
         !GCC$ unroll 16
         do lane = 1, strip_lanes
            y(lane, i) = x(before + lane, i)
         end do
      end do
   end subroutine take_rows

end module symsde_step_midpoint_eliminated
