! SPDX-License-Identifier: BSD-3-Clause
!> Newton's iteration on a block of small systems r(x) = 0, one per lane, each until its own corrections stagnate:
!>
!>    A d = r(x),   x <- x - d,   A = dr/dx
!>
!> The caller keeps the loop and its own equations:
!>
!>    call newton%start(status)
!>    do while (newton%running)
!>       ... residual newton%r and matrix newton%a (or newton%bands) at x ...
!>       call newton%update(x, status, counters)
!>    end do
!>
!> One unknown in the form x + s f(x) = 0, as all steppers have it, uses update_scalar: one pass over the lanes instead
!> of five; a step that begins at x = 0 uses first_scalar for its first iteration, instead of start. A stepper that
!> solves and corrects by itself calls only judge.
!>
!> The test of convergence is in solve/stagnation. Steppers whose matrix is the derivative of their residual to rounding
!> declare it (`exact`), which spares most lanes their last iteration.
!>
!> A lane that is done or failed is frozen: a path never depends on its neighbours. Loops are bounded by
!> max_iter.
module symsde_solve_newton
   use symsde_base_contracts, only: contracts_are_executed, require_statuses
   use symsde_base_kinds, only: wp, i8
   use symsde_base_counters, only: counters_type
   use symsde_base_status, only: error_type, raise, invalid_argument, not_converged, nonfinite, singular
   use symsde_base_text, only: to_text
   use symsde_solve_blocks, only: block_solver, new_block_solver
   use symsde_solve_contract, only: require_solved
   use symsde_solve_stagnation, only: stopping_test, linear, quadratic, done_at_once, never_done, failed
   use symsde_solve_stagnation, only: correct_first, correct_exact, fail_nonfinite
   use symsde_solve_stagnation, only: correct_scalar, iterate_scalar, correct_lanes, test_lanes
   use symsde_solve_shortening, only: shortening_type, new_shortening, start_shortening, reject, accept
   implicit none
   private
   public :: newton_type, newton_options, new_newton, check_newton, patience
   public :: start, update, judge, first_scalar, update_scalar, mark, stop_lanes

   !> Iterations after which one unknown is tested for rounding that cycles, as several unknowns are from the start. Few
   !> lanes iterate as often, and until then the test is shorter.
   integer, parameter :: patience = 8

   type :: newton_options
      integer :: max_iter = 100         !! bound of the iterations of one step, 1..1000
      integer :: fixed_point = 0        !! n > 0: exactly n fixed-point iterations instead of Newton
      logical :: shortens = .false.     !! shorten corrections that do not lower the residual; by `update` alone
   contains
      procedure :: is_free
   end type newton_options

   !> The iteration of a block. The caller fills r and a (or bands) at x, and afterwards r holds the correction; `last`
   !> says for each lane whether it runs.
   type :: newton_type
      integer :: nlane = 0, n = 0       !! lanes, unknowns of a lane
      logical :: affine = .false.       !! the equations are linear in the unknowns: one solve, no test
      logical :: running = .false.      !! whether some lane is not done yet
      type(newton_options) :: options
      integer :: most = 0               !! largest number of iterations of a step
      integer :: iteration = 0
      integer :: nrunning = 0           !! number of lanes that are not done
      logical :: keeps_matrix = .false. !! single path: the next update must keep the matrix
      real(wp), allocatable :: r(:, :)  !! residual (nlane, n); after an update: the correction
      real(wp), allocatable :: a(:, :, :)      !! matrix (nlane, n, n), dense case
      real(wp), allocatable :: bands(:, :, :)  !! matrix (nlane, -kl:ku, n), banded case
      real(wp), allocatable :: last(:)  !! size of the last correction, or done, or failed; >= 0 runs (nlane)
      real(wp), allocatable :: step(:)  !! size of this correction (nlane)
      real(wp), allocatable :: size(:)  !! size of the unknowns (nlane)
      logical :: exact = .false.        !! matrix is the derivative of the residual, to rounding
      type(stopping_test) :: test = linear
      logical, allocatable, private :: active(:)
      integer(i8), allocatable, private :: verdict(:)
      type(block_solver), private :: solver
      type(shortening_type) :: shortening
   contains
      procedure :: start
      procedure :: update
      procedure :: first_scalar
      procedure :: update_scalar
      procedure :: judge
      procedure :: fail
   end type newton_type

contains

   include 'newton.inc'
   include 'newton_scalar.inc'
   include 'all_lanes.inc'

   !> Whether the options ask for neither shortened corrections nor a number of iterations: then steppers may choose how
   !> to solve.
   pure logical function is_free(self)
      class(newton_options), intent(in) :: self

      is_free = self%fixed_point <= 0 .and. .not. self%shortens
   end function is_free

   !> Refuse numbers of iterations out of range.
   subroutine check_newton(options, error)
      type(newton_options), intent(in) :: options
      type(error_type), allocatable, intent(inout) :: error
      type(newton_options) :: standard

      if (options%max_iter < 1 .or. options%max_iter > 1000) then
         call raise(error, invalid_argument, 'check_newton', 'max_iter = '//to_text(options%max_iter)// &
                    ' is out of range: give 1 to 1000 Newton iterations a step ('//to_text(standard%max_iter)// &
                    ' by default)')
      else if (options%fixed_point < 0 .or. options%fixed_point > 1000) then
         call raise(error, invalid_argument, 'check_newton', 'fixed_point = '//to_text(options%fixed_point)// &
                    ' is out of range: give 1 to 1000 fixed-point iterations, or 0 for Newton')
      end if
   end subroutine check_newton

   !> Allocate n unknowns a lane; kl >= 0 makes the matrix banded with kl sub- and ku superdiagonals. The stopping test
   !> depends on the equations and their derivatives: done at once for linear equations, quadratic for exact
   !> derivatives, else linear. Shortened corrections and a given number of iterations (is_free false) use neither
   !> linearity nor exactness.
   subroutine new_newton(self, nlane, n, options, affine, kl, ku, judge_only, exact)
      type(newton_type), intent(out) :: self
      integer, intent(in) :: nlane, n
      type(newton_options), intent(in) :: options
      logical, intent(in) :: affine
      integer, intent(in) :: kl, ku  !! bands; both -1 for dense matrices
      logical, intent(in), optional :: judge_only  !! no matrix, no update: the stepper solves and corrects
      logical, intent(in), optional :: exact  !! the matrix is the derivative of the residual, to rounding

      self%nlane = nlane
      self%n = n
      self%options = options
      self%most = merge(options%fixed_point, options%max_iter, options%fixed_point > 0)
      self%affine = affine .and. options%is_free()
      ! Choose the stopping test; later lines overrule earlier ones.
      if (present(exact)) self%exact = exact .and. options%is_free()
      if (self%exact) self%test = quadratic
      if (self%affine) self%test = done_at_once
      if (options%fixed_point > 0) self%test = never_done
      allocate (self%last(nlane), self%step(nlane), self%size(nlane))
      if (present(judge_only)) then
         if (judge_only) return
      end if
      ! Allocate residuals and matrices; a stepper with its own linear solver needs none.
      allocate (self%r(nlane, n), self%active(nlane), self%verdict(nlane))
      if (options%shortens) call new_shortening(self%shortening, nlane, n)
      if (options%fixed_point > 0) return
      if (kl < 0) then
         allocate (self%a(nlane, n, n))
      else
         allocate (self%bands(nlane, -kl:ku, n))
      end if
      ! One unknown is divided by its derivative: update_scalar.
      if (kl >= 0 .or. n > 1) call new_block_solver(self%solver, nlane, n, kl, ku)
   end subroutine new_newton

   !> Solve A d = r, subtract d from the unknowns of the running lanes, and test each lane. Where corrections
   !> are shortened, first judge the last correction by the new residual, and halve it if the residual did not fall. A
   !> fixed-point iteration x <- x - r solves no system.
   subroutine update(self, x, status, counters)
      class(newton_type), intent(inout) :: self
      real(wp), intent(inout) :: x(self%nlane, self%n)         !! unknowns
      integer(i8), intent(inout) :: status(self%nlane)         !! code of a lane that fails
      type(counters_type), intent(inout) :: counters

      if (contracts_are_executed) call require_statuses(self%nlane, status, 'solve, newton')
      if (self%options%shortens) then
         call reject(self%shortening, self%r, self%last, x, self%step, self%size)
         call solve_correction(self, status, counters)
         call accept(self%shortening, self%r, self%last, x, self%step, self%size)
      else
         if (self%options%fixed_point == 0) call solve_correction(self, status, counters)
         call correct_lanes(self%nlane, self%n, self%r, self%last, x, self%step, self%size)
      end if
      call self%judge(status, counters)
      if (contracts_are_executed) call require_solved(self%nlane, self%n, status, x, 'solve, newton')
   end subroutine update

   !> Freeze a lane whose system could not be solved. For steppers with a linear solver of their own. The lane is
   !> counted here, and `mark` skips it.
   subroutine fail(self, lane, code, status, counters)
      class(newton_type), intent(inout) :: self
      integer, intent(in) :: lane
      integer(i8), intent(in) :: code                          !! status of the lane
      integer(i8), intent(inout) :: status(self%nlane)
      type(counters_type), intent(inout) :: counters

      status(lane) = code
      self%last(lane) = failed
      counters%failures = counters%failures + 1
   end subroutine fail

   !> End the iteration at its bound. Lanes that have not converged have failed, unless the options ask for this
   !> number of iterations.
   subroutine stop_lanes(self, status, counters)
      class(newton_type), intent(inout) :: self
      integer(i8), intent(inout) :: status(self%nlane)
      type(counters_type), intent(inout) :: counters

      self%nrunning = 0
      if (self%options%fixed_point > 0) return
      counters%failures = counters%failures + count(self%last >= 0 .and. status == 0)
      where (self%last >= 0 .and. status == 0) status = not_converged
   end subroutine stop_lanes

   !> r = A^{-1} r in every running lane: residuals become corrections. Lanes whose matrix is singular, or whose
   !> numbers are not finite, fail with that status, and are corrected by zero.
   subroutine solve_correction(self, status, counters)
      type(newton_type), intent(inout) :: self
      integer(i8), intent(inout) :: status(self%nlane)
      type(counters_type), intent(inout) :: counters
      integer(i8) :: pivoted, by_lapack

      ! Only lanes that run are solved; a verdict is given by the solver alone.
      self%active = self%last >= 0
      self%verdict = 0
      ! The solver's counters cover its whole life; add the difference of this call.
      pivoted = self%solver%pivoted_solves
      by_lapack = self%solver%lapack_solves
      if (allocated(self%bands)) then
         call self%solver%solve(self%bands, self%r, self%active, self%verdict)
      else
         call self%solver%solve(self%a, self%r, self%active, self%verdict)
      end if
      counters%pivoted_solves = counters%pivoted_solves + self%solver%pivoted_solves - pivoted
      counters%lapack_solves = counters%lapack_solves + self%solver%lapack_solves - by_lapack
      ! Lanes whose system failed get the correction zero, and are frozen.
      if (all(self%verdict == 0)) return
      counters%failures = counters%failures + count(self%active .and. self%verdict /= 0)
      where (self%active .and. self%verdict /= 0)
         status = self%verdict
         self%last = failed
      end where
   end subroutine solve_correction

   !> Lanes that failed in this update and have no status yet get one: singular where the derivative of a
   !> single equation vanished, else not finite.
   subroutine mark(self, status, counters)
      class(newton_type), intent(in) :: self
      integer(i8), intent(inout) :: status(self%nlane)
      type(counters_type), intent(inout) :: counters
      integer :: lane

      do lane = 1, self%nlane
         ! `failed` is -2; lanes above -1.5 run or are done.
         if (self%last(lane) > -1.5_wp .or. status(lane) /= 0) cycle
         status(lane) = nonfinite
         counters%failures = counters%failures + 1
         if (self%n == 1) then
            if (abs(self%r(lane, 1)) <= huge(1.0_wp)) status(lane) = singular
         end if
      end do
   end subroutine mark

end module symsde_solve_newton
