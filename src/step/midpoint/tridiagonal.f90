! SPDX-License-Identifier: BSD-3-Clause
!> The eliminated midpoint for chains, for which K = Hhat_qq is symmetric and tridiagonal. In the notation of
!> step/midpoint/equation an iteration is
!>
!>    (I + (h/4) K(Q)) d = x + f(Q),   Q = base + c x;   x <- x - d
!>
!> Rows are eliminated from both ends, downwards in an upper front and upwards in a lower one, until the two meet; from
!> there d is computed outwards and x is corrected at the same time (solve/tridiagonal). There are no exchanges of rows:
!> K is symmetric, and elimination is stable if I + (h/4) K is positive definite. Lanes whose pivots are not trusted are
!> solved with exchanges of rows (solve/one_system).
!>
!> Lanes are eliminated in strips whose number of lanes the compiler knows, so that data passed from row to row stay in
!> registers. If the model gives its rows (chain_rows), a strip takes the whole step alone, in arrays that stay in the
!> nearest caches, 640 bytes a row, and the rows are eliminated a panel at a time, as they are computed, from both ends:
!> neither force nor matrix is ever stored as a whole. For other models the bands of all lanes of a block are evaluated
!> in one call, since large calls are efficient, and are then eliminated in the same strips.
!>
!> An iteration is
!>
!> linearise    f and K in rows first .. last, at Q
!> eliminate    these rows, after those before them in their front
!> correct      d where the fronts meet, then x <- x - d outwards, with the sizes of d and x
!> judge        the stopping test of all lanes
!>
!> Private to its family.
module symsde_step_midpoint_tridiagonal
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: status_ok
   use symsde_base_traits, only: strip_lanes
   use symsde_base_vectors, only: add_times
   use symsde_model_abstract, only: model_type
   use symsde_model_kernels, only: kernel_offers, offers_of, has_exact_stiffness
   use symsde_solve_one_system, only: solve_banded_lane
   use symsde_solve_newton, only: newton_options, new_newton
   use symsde_solve_tridiagonal, only: upper_rows, eliminate_down_strip, eliminate_up_strip, meet_strip, &
                                       correct_strip, before_first_row, nfront
   use symsde_step_midpoint_equation, only: midpoint_equation, midpoint_part, position
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   implicit none
   private
   public :: tridiagonal_midpoint

   integer, parameter :: panel = 32  !! rows evaluated in one call of the model

   !> The part for rows. Arrays of a panel have nlane lanes, one strip if the model gives its rows; elimination always
   !> works on one strip.
   type, extends(midpoint_part) :: tridiagonal_midpoint
      private
      logical :: gives_rows = .false.
      integer :: nrow = 0                             !! rows evaluated at once: a panel, or all
      real(wp), allocatable :: q(:, :)                !! Q of these rows and of three around them (nlane, nrow+3)
      real(wp), allocatable :: hq(:, :), hqq(:, :, :) !! force and stiffness (nlane, 0:nrow), (nlane, 0:1, 0:nrow)
      real(wp), allocatable :: factor(:, :), rhs(:, :)  !! eliminated rows of a strip (strip_lanes, ndof)
      real(wp), allocatable :: x(:, :), f(:, :), k(:, :, :)  !! a strip of a block (strip_lanes, [0:1,] 0:ndof)
      real(wp) :: fronts(strip_lanes, nfront, 2) = 0  !! data of the last rows, in the upper and lower front
      real(wp) :: meeting(strip_lanes, 2) = 0         !! corrections where the fronts meet
      real(wp) :: trusted(strip_lanes) = 0
   contains
      procedure :: make
      procedure :: solve
   end type tridiagonal_midpoint

contains

   !> Make the part for nlane lanes, a multiple of strip_lanes, and equal to strip_lanes if the model gives its
   !> rows: then one panel of rows is evaluated at a time, else all rows. Arrays are allocated at the first step. The
   !> quadratic stopping test needs rows or Hessian-vector products from the model; other bands do not count as
   !> exact derivatives.
   subroutine make(self, model, nlane, options)
      class(tridiagonal_midpoint), intent(inout) :: self
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane
      type(newton_options), intent(in) :: options
      type(kernel_offers) :: offers

      associate (t => model%traits, n => model%traits%ndof, &
                 exact => has_exact_stiffness(model))
         offers = offers_of(model)
         self%gives_rows = offers%rows
         self%nrow = merge(min(panel, n), n, self%gives_rows)
         call new_newton(self%newton, nlane, n, options, t%quadratic .and. exact, -1, -1, judge_only=.true., &
                         exact=exact)
      end associate
   end subroutine make

   !> Allocate the arrays of a panel (or of all rows), the eliminated rows of a strip, and for models without rows
   !> copies of a strip of the block.
   subroutine make_room(self, nlane, n)
      type(tridiagonal_midpoint), intent(inout) :: self
      integer, intent(in) :: nlane, n

      allocate (self%q(nlane, self%nrow + 3), self%hq(nlane, 0:self%nrow), self%hqq(nlane, 0:1, 0:self%nrow))
      allocate (self%factor(strip_lanes, n), self%rhs(strip_lanes, n))
      if (self%gives_rows) return
      allocate (self%x(strip_lanes, n), self%f(strip_lanes, n), self%k(strip_lanes, 0:1, 0:n))
   end subroutine make_room

   !> Find x of the lanes without a status, by Newton's iteration from V = 0 or from the dq of V.
   subroutine solve(self, ham, eq, w, status)
      class(tridiagonal_midpoint), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(inout) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
      integer(i8), intent(inout) :: status(eq%nlane)

      if (.not. allocated(self%q)) call make_room(self, eq%nlane, eq%n)
      if (.not. eq%for_dq) eq%x = 0
      call self%newton%start(status)
      do while (self%newton%running)
         call iterate(self, ham, eq, w, status)
      end do
   end subroutine solve

   !> Take one Newton iteration in all lanes. If the model gives rows and the chain fits in a panel, all rows are
   !> evaluated at once and eliminated. If the model gives rows and the chain is longer, panels are evaluated and
   !> eliminated one after the other. If the model gives no rows, the bands of the whole block are evaluated, and strips
   !> are copied and eliminated one after the other.
   subroutine iterate(self, ham, eq, w, status)
      type(tridiagonal_midpoint), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(inout) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
      integer(i8), intent(inout) :: status(eq%nlane)
      integer :: first, last, before, h

      h = upper_rows(eq%n)
      ! Rows that are all evaluated at once: a short chain, or the bands of a block.
      if (self%nrow == eq%n) call linearise(self, ham, eq, w, 1, eq%n, self%hq(1, 1), self%hqq(1, 0, 1))
      if (self%gives_rows .and. self%nrow == eq%n) then
         call eliminate_all(self, eq, eq%x, self%hq(1, 1), self%hqq)
         call correct(self, ham, eq, w, 0, eq%x, status)
      else if (self%gives_rows) then
         ! The first rows of both fronts: no row comes before them.
         self%fronts = spread(before_first_row, 3, 2)
         ! The upper front runs through rows 1 .. h, a panel at a time.
         do first = 1, h, self%nrow
            last = min(first + self%nrow - 1, h)
            call linearise(self, ham, eq, w, first, last, self%hq(1, 1), self%hqq(1, 0, 1))
            call eliminate(self, eq, first, last, eq%x, self%hq(1, 1), self%hqq)
         end do
         ! The lower front runs up through the panels of rows h+1 .. n from the last. Each panel also needs the row
         ! above it, which holds the entry that couples the two.
         do first = h + 1 + self%nrow*((eq%n - h + self%nrow - 1)/self%nrow - 1), h + 1, -self%nrow
            last = min(first + self%nrow - 1, eq%n)
            call linearise(self, ham, eq, w, first - 1, last, self%hq, self%hqq)
            call eliminate(self, eq, first, last, eq%x, self%hq(1, 1), self%hqq)
         end do
         call correct(self, ham, eq, w, 0, eq%x, status)
      else
         do before = 0, eq%nlane - strip_lanes, strip_lanes
            ! Copy unknowns, force and stiffness of a strip. An iteration eliminates and corrects one strip before
            ! the next, so that its rows are read while they are in cache.
            last = before + strip_lanes
            self%x(:, :) = eq%x(before + 1:last, :)
            self%f(:, :) = self%hq(before + 1:last, 1:)
            self%k(:, :, 1:) = self%hqq(before + 1:last, :, 1:)
            call eliminate_all(self, eq, self%x, self%f, self%k)
            call correct(self, ham, eq, w, before, self%x, status)
            eq%x(before + 1:last, :) = self%x
         end do
      end if
      ham%counters%gradients = ham%counters%gradients + eq%nreal
      ham%counters%hessians = ham%counters%hessians + eq%nreal
      call self%newton%judge(status, ham%counters)
   end subroutine iterate

   !> Eliminate all rows of a strip at once, in both fronts, with f and K of the whole chain.
   subroutine eliminate_all(self, eq, x, f, k)
      type(tridiagonal_midpoint), intent(inout) :: self
      type(midpoint_equation), intent(in) :: eq
      real(wp), intent(in) :: x(strip_lanes, eq%n), f(strip_lanes, eq%n), k(strip_lanes, 0:1, 0:eq%n)

      associate (h => upper_rows(eq%n))
         self%fronts = spread(before_first_row, 3, 2)
         call eliminate(self, eq, 1, h, x, f, k)
         call eliminate(self, eq, h + 1, eq%n, x, f(1, h + 1), k(1, 0, h))
      end associate
   end subroutine eliminate_all

   !> Eliminate rows first .. last of a strip, after those before them in their front: rows 1 .. upper_rows(n) belong to
   !> the upper front, all others to the lower one. factor and rhs of these rows remain to be solved outwards.
   subroutine eliminate(self, eq, first, last, x, f, k)
      type(tridiagonal_midpoint), intent(inout) :: self
      type(midpoint_equation), intent(in) :: eq
      integer, intent(in) :: first, last
      real(wp), intent(in) :: x(strip_lanes, eq%n)
      real(wp), intent(in) :: f(strip_lanes, first:last), k(strip_lanes, 0:1, first - 1:last)

      if (first <= upper_rows(eq%n)) then
         call eliminate_down_strip(last - first + 1, 0.25_wp*eq%h, x(1, first), f, k, self%fronts(1, 1, 1), &
                                   self%factor(1, first), self%rhs(1, first))
      else
         call eliminate_up_strip(last - first + 1, 0.25_wp*eq%h, x(1, first), f, k, self%fronts(1, 1, 2), &
                                 self%factor(1, first), self%rhs(1, first))
      end if
   end subroutine eliminate

   !> f and K in rows first .. last at Q = base + c x. In the first iteration for V the point is base itself, and is
   !> not copied.
   subroutine linearise(self, ham, eq, w, first, last, hq, hqq)
      type(tridiagonal_midpoint), intent(inout) :: self
      type(one_step_hamiltonian), intent(in) :: ham
      type(midpoint_equation), intent(in) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
      integer, intent(in) :: first, last
      real(wp), intent(inout) :: hq(eq%nlane, first:last), hqq(eq%nlane, 0:1, first:last)

      if (eq%starts(self%newton)) then
         call evaluate(ham, self%gives_rows, eq, w, first, last, eq%base(1, first - 1), hq, hqq)
      else
         call place(eq, first, last, self%q)
         call evaluate(ham, self%gives_rows, eq, w, first, last, self%q, hq, hqq)
      end if
      call eq%weigh(first, last, hq)
   end subroutine linearise

   !> Correct the unknowns of a strip, x <- x - d, from where its fronts meet, and in the first iteration set the rate
   !> of its lanes: the largest diagonal entry of I + (h/4) K minus one, which the fronts have computed.
   subroutine correct(self, ham, eq, w, before, x, status)
      type(tridiagonal_midpoint), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(inout) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
      integer, intent(in) :: before  !! number of lanes before the strip
      real(wp), intent(inout) :: x(strip_lanes, eq%n)
      integer(i8), intent(inout) :: status(eq%nlane)

      ! Solve for d of the two rows where the fronts meet, and find the lanes whose pivots are trusted in all rows.
      call meet_strip(self%fronts(1, 1, 1), self%fronts(1, 1, 2), self%meeting, self%trusted)
      associate (newton => self%newton, first => before + 1, last => before + strip_lanes)
         if (eq%starts(newton)) then
            eq%rate(first:last) = max(self%fronts(:, 5, 1), self%fronts(:, 5, 2)) - 1
            eq%noncontracting = eq%noncontracting .or. any(eq%rate(first:last) > 1)
         end if
         if (any(self%trusted <= 0 .and. newton%last(first:last) >= 0)) &
            call solve_suspects(self, ham, eq, w, before, status)
         call correct_strip(eq%n, self%meeting, self%factor, self%rhs, newton%last(first), x, &
                            newton%step(first), newton%size(first))
      end associate
   end subroutine correct

   !> Q in rows first-1 .. last+1, for a row of a chain reads its neighbours; rows 0 and n+1, beyond its ends, are
   !> zero.
   pure subroutine place(eq, first, last, q)
      type(midpoint_equation), intent(in) :: eq
      integer, intent(in) :: first, last
      real(wp), intent(inout) :: q(eq%nlane, first - 1:last + 1)
      integer :: low, high

      ! Compute rows that exist, and set all others to zero.
      low = max(first - 1, 1)
      high = min(last + 1, eq%n)
      call position((high - low + 1)*eq%nlane, eq%c, eq%base(1, low), eq%x(1, low), q(1, low))
      if (first == 1) q(:, 0) = 0
      if (last == eq%n) q(:, eq%n + 1) = 0
   end subroutine place

   !> Hhat_q and the two upper bands of Hhat_qq in rows first .. last: hqq(:, 0, i) is the diagonal and hqq(:, 1, i) the
   !> entry to its right. Models without rows compute all rows at once.
   subroutine evaluate(ham, gives_rows, eq, w, first, last, q, hq, hqq)
      type(one_step_hamiltonian), intent(in) :: ham
      logical, intent(in) :: gives_rows
      type(midpoint_equation), intent(in) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
      integer, intent(in) :: first, last
      real(wp), intent(in) :: q(eq%nlane, first - 1:last + 1)
      real(wp), intent(inout) :: hq(eq%nlane, first:last), hqq(eq%nlane, 0:1, first:last)

      if (gives_rows) then
         call ham%fast%chain_rows(eq%n, eq%m, first, last, eq%t, w, q, hq, hqq)
      else
         call ham%bare_force_stiffness(eq%nlane, 1, eq%t, w, q(:, 1:eq%n), eq%still, hq, hqq)
      end if
   end subroutine evaluate

   !> Solve running lanes of a strip whose pivots are not trusted one by one, with exchanges of rows. Their matrix I + c
   !> K, c = h/4, is computed again, as panels were not kept. Right-hand sides become the solution d and factors zero,
   !> those of the identity, so that the following outward pass for all lanes leaves d unchanged. A lane with a singular
   !> matrix fails.
   subroutine solve_suspects(self, ham, eq, w, before, status)
      type(tridiagonal_midpoint), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(in) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
      integer, intent(in) :: before
      integer(i8), intent(inout) :: status(eq%nlane)
      real(wp), allocatable :: q(:, :), r(:, :), hqq(:, :, :), bands(:, :, :)
      integer(i4) :: info
      integer :: i, lane

      associate (nlane => eq%nlane, n => eq%n, c => 0.25_wp*eq%h, newton => self%newton)
         allocate (q(nlane, 0:n + 1), r(nlane, n), hqq(nlane, 0:1, n), bands(nlane, -1:1, n))
         if (eq%starts(newton)) then
            q = eq%base
         else
            call place(eq, 1, n, q)
         end if
         call evaluate(ham, self%gives_rows, eq, w, 1, n, q, r, hqq)
         call eq%weigh(1, n, r)
         if (.not. eq%starts(newton)) call add_times(nlane*n, 1.0_wp, eq%x, r)
         ! bands(lane, d, i) is entry (i, i+d) of I + c K; K is symmetric, so the lower band is the upper one, shifted
         ! by a row.
         bands(:, 0, :) = 1 + c*hqq(:, 0, :)
         bands(:, 1, :) = c*hqq(:, 1, :)
         bands(:, -1, 2:) = bands(:, 1, :n - 1)
         bands(:, -1, 1) = 0
         do i = 1, strip_lanes
            lane = before + i
            if (self%trusted(i) > 0 .or. .not. newton%last(lane) >= 0) cycle
            call solve_banded_lane(nlane, n, 1, 1, lane, bands, r, info)
            ham%counters%pivoted_solves = ham%counters%pivoted_solves + 1
            self%meeting(i, :) = 0
            self%factor(i, :) = 0
            self%rhs(i, :) = r(lane, :)
            if (info == status_ok) cycle
            self%rhs(i, :) = 0
            call newton%fail(lane, int(info, i8), status, ham%counters)
         end do
      end associate
   end subroutine solve_suspects

end module symsde_step_midpoint_tridiagonal
