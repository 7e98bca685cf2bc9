! SPDX-License-Identifier: BSD-3-Clause
!> Newton's iteration on a block of small systems, one a lane, each until its own corrections stagnate.
!>
!> The caller keeps the loop and its own equations:
!>
!>    call newton%start(status)
!>    do while (newton%running)
!>       ... residual newton%r and matrix newton%a (or newton%bands) at x ...
!>       call newton%update(x, status, counters)
!>    end do
!>
!> One unknown in the form x + s f(x) = 0, as all steppers have it, goes through update_scalar: one pass
!> over the lanes instead of five. A stepper that solves and corrects by itself calls only judge.
!>
!> A lane is done when its next correction would vanish in rounding: with d_k the size of its k-th
!> correction, when d_k itself is at most eps |x|/4, or the next one would be at the rate d_k/d_{k-1}
!> seen, or it has stopped shrinking within 1e-10 |x|. Tolerances looser than that make invariants
!> drift linearly. A lane that is done or failed is frozen: a path never depends on its
!> neighbours. Loops are bounded by max_iter.
module symsde_solve_newton
   use symsde_base_kinds, only: wp, i8
   use symsde_base_counters, only: counters_type
   use symsde_base_status, only: not_converged, nonfinite, singular
   use symsde_solve_blocks, only: block_solver, new_block_solver
   use symsde_solve_damping, only: damping_type, new_damping, start_damping, reject, accept
   implicit none
   private
   public :: newton_type, newton_options, new_newton

   real(wp), parameter :: done = -1      !! value of `last` for a lane that has converged
   real(wp), parameter :: failed = -2    !! value of `last` for a lane that has failed
   real(wp), parameter :: rounding = 0.25_wp*epsilon(1.0_wp)
   real(wp), parameter :: stagnation = 1e-10_wp

   type :: newton_options
      integer :: max_iter = 100         !! bound of the iterations of one step, 1..1000
      integer :: fixed_point = 0        !! n > 0: exactly n fixed-point iterations instead of Newton
      logical :: damped = .false.       !! shorten corrections that do not lower the residual; update only
   end type newton_options

   type :: newton_type
      integer :: nlane = 0, n = 0       !! lanes, unknowns of a lane
      logical :: affine = .false.       !! the equations are linear in the unknowns: one solve, no test
      logical :: running = .false.      !! some lane is not done yet
      type(newton_options) :: options
      integer :: iteration = 0
      integer :: nrunning = 0           !! lanes that are not done
      real(wp), allocatable :: r(:, :)  !! residual (nlane, n); after an update: the correction
      real(wp), allocatable :: a(:, :, :)      !! matrix (nlane, n, n), dense case
      real(wp), allocatable :: bands(:, :, :)  !! matrix (nlane, -kl:ku, n), banded case
      real(wp), allocatable :: last(:)  !! size of the last correction, or done, or failed; >= 0 runs (nlane)
      real(wp), allocatable :: step(:)  !! size of this correction (nlane)
      real(wp), allocatable :: size(:)  !! size of the unknowns (nlane)
      logical, allocatable, private :: active(:)
      integer(i8), allocatable, private :: verdict(:)
      type(block_solver), private :: solver
      type(damping_type), private :: damping
   contains
      procedure :: start
      procedure :: update
      procedure :: update_scalar
      procedure :: judge
      procedure :: fail
   end type newton_type

contains

   !> Room for n unknowns a lane; kl >= 0 makes the matrix banded with kl sub- and ku superdiagonals.
   subroutine new_newton(self, nlane, n, options, affine, kl, ku, judge_only)
      type(newton_type), intent(out) :: self
      integer, intent(in) :: nlane, n
      type(newton_options), intent(in) :: options
      logical, intent(in) :: affine
      integer, intent(in) :: kl, ku  !! both -1 for dense matrices
      logical, intent(in), optional :: judge_only  !! no matrix, no update: the stepper solves and corrects

      self%nlane = nlane
      self%n = n
      self%options = options
      self%affine = affine .and. options%fixed_point == 0 .and. .not. options%damped
      allocate (self%last(nlane), self%step(nlane), self%size(nlane))
      if (present(judge_only)) then
         if (judge_only) return
      end if
      allocate (self%r(nlane, n), self%active(nlane), self%verdict(nlane))
      if (options%damped) call new_damping(self%damping, nlane, n)
      if (options%fixed_point > 0) return
      if (kl < 0) then
         allocate (self%a(nlane, n, n))
      else
         allocate (self%bands(nlane, -kl:ku, n))
      end if
      if (kl >= 0 .or. n > 1) call new_block_solver(self%solver, nlane, n, kl, ku)
   end subroutine new_newton

   !> Begin the iterations of one step; lanes with a status are frozen from the start.
   subroutine start(self, status)
      class(newton_type), intent(inout) :: self
      integer(i8), intent(in) :: status(self%nlane)

      call start_lanes(self%nlane, status, self%last, self%nrunning)
      self%iteration = 0
      self%running = self%nrunning > 0
      if (self%options%damped) call start_damping(self%damping)
   end subroutine start

   !> Solve for the correction, add it to the unknowns of the running lanes, and test each lane.
   subroutine update(self, x, status, counters)
      class(newton_type), intent(inout) :: self
      real(wp), intent(inout) :: x(self%nlane, self%n)         !! unknowns
      integer(i8), intent(inout) :: status(self%nlane)         !! code of a lane that fails
      type(counters_type), intent(inout) :: counters

      if (self%options%damped) then
         call reject(self%damping, self%r, self%last, x, self%step, self%size)
         call solve_correction(self, status, counters)
         call accept(self%damping, self%r, self%last, x, self%step, self%size)
      else
         if (self%options%fixed_point == 0) call solve_correction(self, status, counters)
         call correct_lanes(self%nlane, self%n, self%r, self%last, x, self%step, self%size)
      end if
      call self%judge(status, counters)
   end subroutine update

   !> The same for one unknown, x + sign*f(x) = 0 with derivative 1 + slope*f': f in r, f' in a.
   subroutine update_scalar(self, sign, slope, x, status, counters)
      class(newton_type), intent(inout) :: self
      real(wp), intent(in) :: sign                             !! of f in the equation
      real(wp), intent(in) :: slope                            !! factor of f' in the derivative
      real(wp), intent(inout) :: x(self%nlane)
      integer(i8), intent(inout) :: status(self%nlane)
      type(counters_type), intent(inout) :: counters

      integer :: nrunning, nfailed

      if (self%options%fixed_point > 0) then
         call iterate_scalar(self%nlane, sign, self%r, self%last, x, self%step, self%size)
         call self%judge(status, counters)
      else
         call correct_scalar(self%nlane, test_level(self), sign, slope, self%r, self%a, self%last, x, &
                             nrunning, nfailed)
         call conclude(self, nrunning, nfailed, status, counters)
      end if
   end subroutine update_scalar

   !> Test every lane by the sizes of its correction and unknowns, and give lanes that fail their status.
   subroutine judge(self, status, counters)
      class(newton_type), intent(inout) :: self
      integer(i8), intent(inout) :: status(self%nlane)
      type(counters_type), intent(inout) :: counters
      integer :: nrunning, nfailed

      call test_lanes(self%nlane, test_level(self), self%step, self%size, self%last, nrunning, nfailed)
      call conclude(self, nrunning, nfailed, status, counters)
   end subroutine judge

   !> Freeze a lane whose system could not be solved.
   subroutine fail(self, lane, code, status, counters)
      class(newton_type), intent(inout) :: self
      integer, intent(in) :: lane
      integer(i8), intent(in) :: code                          !! its status
      integer(i8), intent(inout) :: status(self%nlane)
      type(counters_type), intent(inout) :: counters

      status(lane) = code
      self%last(lane) = failed
      counters%failures = counters%failures + 1
   end subroutine fail

   !> Count the iteration, give lanes that failed their status, and end at the bound of iterations.
   subroutine conclude(self, nrunning, nfailed, status, counters)
      class(newton_type), intent(inout) :: self
      integer, intent(in) :: nrunning, nfailed    !! lanes that go on, and lanes that have ever failed
      integer(i8), intent(inout) :: status(self%nlane)
      type(counters_type), intent(inout) :: counters

      self%iteration = self%iteration + 1
      counters%iterations = counters%iterations + self%nrunning
      if (self%options%fixed_point == 0) counters%solves = counters%solves + self%nrunning
      self%nrunning = nrunning
      if (nfailed > 0) call mark(self, status, counters)
      if (self%iteration >= limit(self) .and. self%nrunning > 0) then
         if (self%options%fixed_point == 0) then
            counters%failures = counters%failures + count(self%last >= 0 .and. status == 0)
            where (self%last >= 0 .and. status == 0) status = not_converged
         end if
         self%nrunning = 0
      end if
      self%running = self%nrunning > 0
   end subroutine conclude

   !> Rounding level of the stopping test: affine systems are done after one solve, fixed-point runs
   !> after their fixed number of iterations.
   pure real(wp) function test_level(self)
      type(newton_type), intent(in) :: self

      test_level = rounding
      if (self%affine) test_level = huge(1.0_wp)
      if (self%options%fixed_point > 0) test_level = -1
   end function test_level

   pure integer function limit(self)
      type(newton_type), intent(in) :: self

      limit = self%options%max_iter
      if (self%options%fixed_point > 0) limit = self%options%fixed_point
   end function limit

   !> r = A^{-1} r in every running lane.
   subroutine solve_correction(self, status, counters)
      type(newton_type), intent(inout) :: self
      integer(i8), intent(inout) :: status(self%nlane)
      type(counters_type), intent(inout) :: counters
      integer(i8) :: before

      self%active = self%last >= 0
      self%verdict = 0
      before = self%solver%lapack_solves
      if (allocated(self%bands)) then
         call self%solver%solve(self%bands, self%r, self%active, self%verdict)
      else
         call self%solver%solve(self%a, self%r, self%active, self%verdict)
      end if
      counters%lapack_solves = counters%lapack_solves + self%solver%lapack_solves - before
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
      type(newton_type), intent(in) :: self
      integer(i8), intent(inout) :: status(self%nlane)
      type(counters_type), intent(inout) :: counters
      integer :: lane

      do lane = 1, self%nlane
         if (self%last(lane) > -1.5_wp .or. status(lane) /= 0) cycle
         status(lane) = nonfinite
         counters%failures = counters%failures + 1
         if (self%n == 1) then
            if (abs(self%r(lane, 1)) <= huge(1.0_wp)) status(lane) = singular
         end if
      end do
   end subroutine mark

   ! ---- kernels: plain loops over lanes ----------------------------------------------------------

   !> VEC
   pure subroutine start_lanes(nlane, status, last, nrunning)
      integer, intent(in) :: nlane
      integer(i8), intent(in) :: status(nlane)
      real(wp), intent(out) :: last(nlane)
      integer, intent(out) :: nrunning
      integer(i8) :: running
      integer :: lane

      running = 0
      do lane = 1, nlane
         last(lane) = merge(huge(1.0_wp), failed, status(lane) == 0)
         running = running + merge(1_i8, 0_i8, status(lane) == 0)
      end do
      nrunning = int(running)
   end subroutine start_lanes

   !> VEC One unknown: x = x - (x + s f)/(1 + g f') in running lanes, and the test of every lane.
   pure subroutine correct_scalar(nlane, level, s, g, f, df, last, x, nrunning, nfailed)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: level, s, g, f(nlane), df(nlane)
      real(wp), intent(inout) :: last(nlane), x(nlane)
      integer, intent(out) :: nrunning, nfailed
      real(wp) :: d, new
      integer(i8) :: running, bad
      integer :: lane

      running = 0
      bad = 0
      do lane = 1, nlane
         d = (x(lane) + s*f(lane))/(1 + g*df(lane))
         new = merge(x(lane) - d, x(lane), last(lane) >= 0)
         x(lane) = new
         new = verdict_of(level, abs(d), abs(new), last(lane))
         last(lane) = new
         running = running + runs(new)
         bad = bad + has_failed(new)
      end do
      nrunning = int(running)
      nfailed = int(bad)
   end subroutine correct_scalar

   !> VEC One unknown, one fixed-point iteration: x = -s f in running lanes.
   pure subroutine iterate_scalar(nlane, s, f, last, x, step, size)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: s, f(nlane), last(nlane)
      real(wp), intent(inout) :: x(nlane)
      real(wp), intent(out) :: step(nlane), size(nlane)
      integer :: lane

      do lane = 1, nlane
         step(lane) = abs(x(lane) + s*f(lane))
         x(lane) = merge(-s*f(lane), x(lane), last(lane) >= 0)
         size(lane) = abs(x(lane))
      end do
   end subroutine iterate_scalar

   !> VEC x = x - r in running lanes, with the size of correction and unknowns in each.
   pure subroutine correct_lanes(nlane, n, r, last, x, step, size)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: r(nlane, n), last(nlane)
      real(wp), intent(inout) :: x(nlane, n)
      real(wp), intent(out) :: step(nlane), size(nlane)
      integer :: lane, i

      do lane = 1, nlane
         x(lane, 1) = merge(x(lane, 1) - r(lane, 1), x(lane, 1), last(lane) >= 0)
         step(lane) = abs(r(lane, 1))
         size(lane) = abs(x(lane, 1))
      end do
      do i = 2, n
         do lane = 1, nlane
            x(lane, i) = merge(x(lane, i) - r(lane, i), x(lane, i), last(lane) >= 0)
            ! 0*r keeps a NaN, which max would drop
            step(lane) = max(step(lane), abs(r(lane, i))) + 0*r(lane, i)
            size(lane) = max(size(lane), abs(x(lane, i)))
         end do
      end do
   end subroutine correct_lanes

   !> VEC The stopping test for lanes whose correction and unknowns have these sizes.
   pure subroutine test_lanes(nlane, level, step, size, last, nrunning, nfailed)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: level, step(nlane), size(nlane)
      real(wp), intent(inout) :: last(nlane)
      integer, intent(out) :: nrunning, nfailed
      real(wp) :: next
      integer(i8) :: running, bad
      integer :: lane

      running = 0
      bad = 0
      do lane = 1, nlane
         next = verdict_of(level, step(lane), size(lane), last(lane))
         last(lane) = next
         running = running + runs(next)
         bad = bad + has_failed(next)
      end do
      nrunning = int(running)
      nfailed = int(bad)
   end subroutine test_lanes

   !> The stopping test of the module's header for one lane: at rate 2^-k the next correction is 2^-k
   !> times this one. The size of the correction, or done, or failed. One bound is put together and
   !> compared with, because comparisons are what this costs.
   pure function verdict_of(level, d, size, last) result(next)
      real(wp), intent(in) :: level, d, size, last
      real(wp), parameter :: slow = 2.0_wp**(-13), fast = 2.0_wp**(-26)
      real(wp) :: next, bound

      bound = merge(1/slow, 1.0_wp, d <= slow*last)
      bound = level*size*merge(1/fast, bound, d <= fast*last)
      bound = merge(max(level, merge(stagnation, level, level > 0))*size, bound, d >= last)
      next = merge(done, d, d <= bound)
      next = merge(next, failed, d + size <= huge(d))
      next = merge(next, last, last >= 0)
   end function verdict_of

   !> 1 where the verdict is that the lane goes on, else 0: its sign bit, without a comparison.
   pure integer(i8) function runs(next)
      real(wp), intent(in) :: next

      runs = 1 - ishft(transfer(next, 0_i8), -63)
   end function runs

   !> 1 for `failed`, else 0: failed = -2 has the two highest bits set, done = -1 only the sign.
   pure integer(i8) function has_failed(next)
      real(wp), intent(in) :: next
      integer(i8) :: bits

      bits = transfer(next, 0_i8)
      has_failed = ishft(iand(bits, ishft(bits, 1)), -63)
   end function has_failed

end module symsde_solve_newton
