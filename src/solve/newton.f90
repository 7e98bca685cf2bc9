! SPDX-License-Identifier: BSD-3-Clause
!> Newton's iteration on a block of small systems, one a lane, each until its own corrections stagnate.
!>
!> The caller keeps the loop and its own equations:
!>
!>    call newton%start(status)
!>    do while (newton%running)
!>       ... residual newton%r and matrix newton%a (or newton%bands) at x ...
!>       call newton%update(x, status)
!>    end do
!>
!> A lane is done when its next correction would vanish in rounding: with d_k the size of its k-th
!> correction, when d_k^2/d_{k-1} <= eps*|x|/4 (the next one at the rate seen), or d_k itself is at
!> rounding level, or it has stopped shrinking within 1e-10 |x|. Tolerances looser than that make
!> invariants drift linearly. A lane that is done or failed is frozen: a path never depends on its
!> neighbours. Loops are bounded by max_iter.
module symsde_solve_newton
   use symsde_base_kinds, only: wp, i8
   use symsde_base_counters, only: counters_type
   use symsde_base_status, only: not_converged, nonfinite
   use symsde_solve_blocks, only: block_solver, new_block_solver
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
   end type newton_options

   type :: newton_type
      integer :: nlane = 0, n = 0       !! lanes, unknowns of a lane
      logical :: affine = .false.       !! the equations are linear in the unknowns: one solve, no test
      logical :: running = .false.      !! some lane is not done yet
      type(newton_options) :: options
      integer :: iteration = 0
      real(wp), allocatable :: r(:, :)  !! residual (nlane, n); after an update: the correction
      real(wp), allocatable :: a(:, :, :)      !! matrix (nlane, n, n), dense case
      real(wp), allocatable :: bands(:, :, :)  !! matrix (nlane, -kl:ku, n), banded case
      real(wp), allocatable, private :: last(:)       !! size of the last correction, or done, or failed
      logical, allocatable, private :: active(:)
      integer(i8), allocatable, private :: verdict(:)
      type(block_solver), private :: solver
   contains
      procedure :: start
      procedure :: update
   end type newton_type

contains

   !> Room for n unknowns a lane; kl >= 0 makes the matrix banded with kl sub- and ku superdiagonals.
   subroutine new_newton(self, nlane, n, options, affine, kl, ku)
      type(newton_type), intent(out) :: self
      integer, intent(in) :: nlane, n
      type(newton_options), intent(in) :: options
      logical, intent(in) :: affine
      integer, intent(in) :: kl, ku  !! both -1 for dense matrices

      self%nlane = nlane
      self%n = n
      self%options = options
      self%affine = affine .and. options%fixed_point == 0
      allocate (self%r(nlane, n), self%last(nlane), self%active(nlane), self%verdict(nlane))
      if (options%fixed_point > 0) return
      if (kl < 0) then
         allocate (self%a(nlane, n, n))
      else
         allocate (self%bands(nlane, -kl:ku, n))
      end if
      if (kl >= 0 .or. n > 2) call new_block_solver(self%solver, nlane, n, kl, ku)
   end subroutine new_newton

   !> Begin the iterations of one step; lanes with a status are frozen from the start.
   subroutine start(self, status)
      class(newton_type), intent(inout) :: self
      integer(i8), intent(in) :: status(self%nlane)
      integer :: lane

      do lane = 1, self%nlane
         self%last(lane) = merge(huge(1.0_wp), failed, status(lane) == 0)
      end do
      self%iteration = 0
      self%running = any(status == 0)
   end subroutine start

   !> Solve for the correction, add it to the unknowns of the running lanes, and test each lane.
   subroutine update(self, x, status, counters)
      class(newton_type), intent(inout) :: self
      real(wp), intent(inout) :: x(self%nlane, self%n)         !! unknowns
      integer(i8), intent(inout) :: status(self%nlane)         !! code of a lane that fails
      type(counters_type), intent(inout) :: counters
      integer :: nrunning, nfailed

      self%iteration = self%iteration + 1
      call count_running(self%nlane, self%last, nrunning)
      counters%iterations = counters%iterations + nrunning
      if (self%options%fixed_point == 0) then
         call solve_correction(self, status, counters)
         counters%solves = counters%solves + nrunning
      end if
      call correct_lanes(self%nlane, self%n, test_level(self), self%r, x, self%last, nrunning, nfailed)
      if (self%iteration >= limit(self) .and. nrunning > 0) then
         where (self%last >= 0) self%last = merge(done, failed, self%options%fixed_point > 0)
         call mark(self, not_converged, status)
         nrunning = 0
      else if (nfailed > 0) then
         call mark(self, nonfinite, status)
      end if
      self%running = nrunning > 0
   end subroutine update

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

      if (allocated(self%bands)) then
         self%active = self%last >= 0
         self%verdict = 0
         before = self%solver%lapack_solves
         call self%solver%solve(self%bands, self%r, self%active, self%verdict)
      else if (self%n == 1) then
         call solve_one(self%nlane, self%a, self%r)
         return
      else if (self%n == 2) then
         call solve_two(self%nlane, self%a, self%r)
         return
      else
         self%active = self%last >= 0
         self%verdict = 0
         before = self%solver%lapack_solves
         call self%solver%solve(self%a, self%r, self%active, self%verdict)
      end if
      counters%lapack_solves = counters%lapack_solves + self%solver%lapack_solves - before
      where (self%active .and. self%verdict /= 0)
         status = self%verdict
         self%last = failed
      end where
   end subroutine solve_correction

   !> Lanes that failed in this update and have no status yet get one.
   pure subroutine mark(self, code, status)
      type(newton_type), intent(in) :: self
      integer, intent(in) :: code
      integer(i8), intent(inout) :: status(self%nlane)

      where (self%last == failed .and. status == 0) status = code
   end subroutine mark

   ! ---- kernels: plain loops over lanes ----------------------------------------------------------

   pure subroutine count_running(nlane, last, nrunning)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: last(nlane)
      integer, intent(out) :: nrunning
      integer :: lane

      nrunning = 0
      do lane = 1, nlane
         nrunning = nrunning + merge(1, 0, last(lane) >= 0)
      end do
   end subroutine count_running

   pure subroutine solve_one(nlane, a, r)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: a(nlane)
      real(wp), intent(inout) :: r(nlane)
      integer :: lane

      do lane = 1, nlane
         r(lane) = r(lane)/a(lane)
      end do
   end subroutine solve_one

   !> Cramer's rule: for matrices near the identity as accurate as elimination, and one division.
   pure subroutine solve_two(nlane, a, r)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: a(nlane, 2, 2)
      real(wp), intent(inout) :: r(nlane, 2)
      real(wp) :: inverse, r1
      integer :: lane

      do lane = 1, nlane
         inverse = 1/(a(lane, 1, 1)*a(lane, 2, 2) - a(lane, 1, 2)*a(lane, 2, 1))
         r1 = r(lane, 1)
         r(lane, 1) = (a(lane, 2, 2)*r1 - a(lane, 1, 2)*r(lane, 2))*inverse
         r(lane, 2) = (a(lane, 1, 1)*r(lane, 2) - a(lane, 2, 1)*r1)*inverse
      end do
   end subroutine solve_two

   !> x = x - r in running lanes; then the stopping test of the module's header.
   pure subroutine correct_lanes(nlane, n, level, r, x, last, nrunning, nfailed)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: level
      real(wp), intent(in) :: r(nlane, n)
      real(wp), intent(inout) :: x(nlane, n), last(nlane)
      integer, intent(out) :: nrunning, nfailed
      real(wp) :: step(nlane), size(nlane), d, s
      logical :: quiet, stuck, finite
      integer :: lane, i

      step = 0
      size = 0
      do i = 1, n
         do lane = 1, nlane
            x(lane, i) = merge(x(lane, i) - r(lane, i), x(lane, i), last(lane) >= 0)
            step(lane) = max(step(lane), abs(r(lane, i))) + 0*r(lane, i)
            size(lane) = max(size(lane), abs(x(lane, i)))
         end do
      end do
      nrunning = 0
      nfailed = 0
      do lane = 1, nlane
         d = step(lane)
         s = size(lane)
         finite = d <= huge(d) .and. s <= huge(s)
         quiet = d <= level*s .or. d*(d/last(lane)) <= level*s
         stuck = d >= last(lane) .and. d <= stagnation*s .and. level > 0
         d = merge(merge(done, d, quiet .or. stuck), failed, finite)
         last(lane) = merge(d, last(lane), last(lane) >= 0)
         nrunning = nrunning + merge(1, 0, last(lane) >= 0)
         nfailed = nfailed + merge(1, 0, last(lane) < -1.5_wp)
      end do
   end subroutine correct_lanes

end module symsde_solve_newton
