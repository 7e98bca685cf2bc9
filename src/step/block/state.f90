! SPDX-License-Identifier: BSD-3-Clause
!> The state of a block: increments are added and checked here, and failed paths are marked.
!>
!>    q_{n+1} = q_n + dq,   p_{n+1} = p_n + dp                 in every lane that is ok and whose sums are finite
!>
!> With compensation (Kahan) the sum uses d + low instead of d, and low becomes the rounding error of that sum:
!>
!>    y = d + low,   s = x + y,   low = y - (s - x),   x = s
!>
!> So the error of a sum of many small increments is one rounding, whatever the number of steps.
!>
!> A lane fails in three stages, so that it can be rescued in between: the stepper or `advance` gives the lane a status
!> and does not change its state; the rescue may still find increments, which `take_rescued` adds; for all other failed
!> lanes `record` notes the step of the failure and counts them. From then on their state does not change, though their
!> lanes are still computed along with the others.
!>
!> Where a model computes states by whole steps, its states are checked instead of increments: several states at once by
!> `judge`, which accepts all or none; those of a single step lane by lane by `take_sound`.
!>
!> A block has several lanes, or one: a single path, whose numbers are adjacent in memory.
!>
!> Kernels of blocks do not branch on a lane: they compute the new number in all lanes, and `merge` selects the new or
!> the old one. A branch would prevent vectors, and failed lanes are few.
module symsde_step_block_state
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: nonfinite
   implicit none
   private
   public :: lane_state, new_lane_state, passed_states

   integer, parameter :: narrow = 4  !! most numbers of a single path that are added one by one

   !> A failed path keeps its last good state, its status and the step in which it failed. Between the failure and
   !> `record` its status is set, failed_step is still -1 and nfailed does not count the path. Lanes of padding have a
   !> status from the start.
   type :: lane_state
      integer :: nlane = 0, ndof = 0
      integer :: nfailed = 0                   !! lanes with a status, padding included
      real(wp), allocatable :: q(:, :), p(:, :)              !! (nlane, ndof)
      real(wp), allocatable :: q_low(:, :), p_low(:, :)      !! rounding errors, if compensated (nlane, ndof)
      integer(i8), allocatable :: status(:)        !! 0 = ok, else a code of base/status (nlane)
      integer(i8), allocatable :: failed_step(:)   !! absolute step that failed, -1 = none (nlane)
      real(wp), allocatable, private :: bad(:)     !! 1 in lanes with rejected increments, else 0 (nlane)
   contains
      procedure :: advance
      procedure, private :: advance_block
      procedure :: take_rescued
      procedure :: record
      procedure :: has_new_failures
      procedure :: judge
      procedure :: take_sound
      procedure :: retire
      procedure :: take_first
   end type lane_state

   !> States of a block after some steps of one `advance`, kept until observers have seen them; n is their number, and
   !> zero when an advance begins. Low parts are not kept, since observers use only q and p.
   type :: passed_states
      integer :: n = 0                                   !! number of states
      real(wp), allocatable :: q(:, :, :), p(:, :, :)    !! (nlane, ndof, capacity)
   contains
      procedure :: put
   end type passed_states

contains

   !> Allocate a block; every lane is ok. The caller loads the state, including low parts.
   subroutine new_lane_state(self, nlane, ndof, compensated)
      type(lane_state), intent(out) :: self
      integer, intent(in) :: nlane, ndof
      logical, intent(in) :: compensated  !! keep the low parts of q and p (Kahan's summation)

      self%nlane = nlane
      self%ndof = ndof
      allocate (self%q(nlane, ndof), self%p(nlane, ndof), self%bad(nlane))
      allocate (self%status(nlane), self%failed_step(nlane))
      if (compensated) allocate (self%q_low(nlane, ndof), self%p_low(nlane, ndof))
      self%status = 0
      self%failed_step = -1
   end subroutine new_lane_state

   !> Add the increments of one step in lanes that are ok and whose result is finite; the stepper's `advance` calls
   !> this after every step. `failed` is true if a lane fails in this step: the lane then has a status, may be
   !> rescued, and `record` notes the step of its failure. The pass that adds also counts bad lanes, so a step without a
   !> failure needs no extra pass over statuses.
   subroutine advance(self, dq, dp, failed)
      class(lane_state), intent(inout) :: self
      real(wp), intent(in) :: dq(self%nlane, self%ndof), dp(self%nlane, self%ndof)
      logical, intent(out) :: failed

      if (self%nlane > 1) then
         call self%advance_block(dq, dp, failed)
         return
      end if
      ! The numbers of a single path are adjacent in memory. `failed` is true if the path failed in this step, and not
      ! before.
      call advance_path(self%ndof, dq, dp, self%q, self%p, self%status(1), failed, self%q_low, self%p_low)
      failed = failed .and. self%nfailed == 0
      if (failed .and. self%status(1) == 0) self%status = nonfinite
   end subroutine advance

   !> `advance` of several lanes. Plain sums of one degree of freedom are judged and added in one pass; otherwise
   !> lanes are judged first. This procedure is type-bound so that it is not inlined: its vectors would make a single
   !> path align the stack.
   subroutine advance_block(self, dq, dp, failed)
      class(lane_state), intent(inout) :: self
      real(wp), intent(in) :: dq(self%nlane, self%ndof), dp(self%nlane, self%ndof)
      logical, intent(out) :: failed
      integer :: nbad

      if (self%ndof == 1 .and. .not. allocated(self%q_low)) then
         call advance_one(self%nlane, dq, dp, self%q, self%p, self%status, self%bad, nbad)
      else
         call find_bad(self%nlane, self%ndof, dq, dp, self%q, self%p, self%status, self%bad, nbad)
         call add(self%nlane, self%ndof, dq, self%bad, self%q, self%q_low)
         call add(self%nlane, self%ndof, dp, self%bad, self%p, self%p_low)
      end if
      ! Padding and lanes that failed before are bad too; nfailed counts them.
      failed = nbad > self%nfailed
      if (.not. failed) return
      where (self%status == 0 .and. self%bad > 0) self%status = nonfinite
   end subroutine advance_block

   !> Add the increments in rescued lanes, which had a status in this step and have none now. All other lanes have been
   !> advanced already, and count as bad here, so that no lane is advanced twice.
   subroutine take_rescued(self, status, dq, dp)
      class(lane_state), intent(inout) :: self
      integer(i8), intent(in) :: status(self%nlane)          !! status after the step, before the rescue
      real(wp), intent(in) :: dq(self%nlane, self%ndof), dp(self%nlane, self%ndof)
      integer :: nbad

      call find_bad(self%nlane, self%ndof, dq, dp, self%q, self%p, self%status, self%bad, nbad)
      ! `status` is nonzero in the lanes in which the step failed, self%status in the lanes that the rescue could not
      ! solve. A rescued lane whose sums are not finite has failed after all.
      where (status /= 0 .and. self%status == 0 .and. self%bad > 0) self%status = nonfinite
      self%bad = merge(self%bad, 1.0_wp, status /= 0)
      call add(self%nlane, self%ndof, dq, self%bad, self%q, self%q_low)
      call add(self%nlane, self%ndof, dp, self%bad, self%p, self%p_low)
   end subroutine take_rescued

   !> Whether lanes have got a status since failures were last counted. Tested after every step, so that `record` is
   !> called only if needed.
   pure logical function has_new_failures(self)
      class(lane_state), intent(in) :: self

      ! Padding has a status too, and is counted in nfailed.
      has_new_failures = count(self%status /= 0) > self%nfailed
   end function has_new_failures

   !> Judge states after whole steps of a model before they are shown: `taken` means that no further lane has
   !> failed. Lanes that failed before keep their last good state. If `taken` is false, the steps are repeated one
   !> by one, to find the step in which a lane failed. Padding is not judged, since a model need not compute it; nfailed
   !> - (nlane - nreal) real lanes had failed before.
   subroutine judge(self, nreal, nout, status, q, p, taken)
      class(lane_state), intent(inout) :: self
      integer, intent(in) :: nreal, nout
      integer(i8), intent(in) :: status(self%nlane)         !! status set by the model
      real(wp), intent(inout) :: q(self%nlane, self%ndof, nout), p(self%nlane, self%ndof, nout)
      logical, intent(out) :: taken
      integer :: nbad

      ! A single path has no padding; its numbers are counted if finite.
      if (self%nlane == 1) then
         nbad = merge(0, 1, count(abs(q) <= huge(q)) + count(abs(p) <= huge(p)) == 2*size(q) .and. status(1) == 0)
      else
         call find_bad_states(self%nlane, self%ndof*nout, nreal, status, q, p, self%bad, nbad)
      end if
      taken = nbad == self%nfailed - (self%nlane - nreal)
      ! The model has advanced lanes that had failed before: restore their last good state in the results.
      if (taken .and. nbad > 0) call keep(self%nlane, self%ndof, nout, self%q, self%p, self%status, q, p)
   end subroutine judge

   !> Accept the state after one whole step of a model in lanes that are ok and finite. Other lanes get a status: they
   !> may be rescued, and `record` notes the step of their failure.
   subroutine take_sound(self, status, q, p)
      class(lane_state), intent(inout) :: self
      integer(i8), intent(in) :: status(self%nlane)         !! status set by the model
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)
      integer :: lane

      ! lane by lane, without a kernel: this runs only for a step in which a lane fails
      do lane = 1, self%nlane
         if (self%status(lane) /= 0) cycle
         ! The code that the model has set, or nonfinite if the model has set none and the state is not finite.
         self%status(lane) = status(lane)
         if (status(lane) /= 0) cycle
         if (all(abs(q(lane, :)) <= huge(q)) .and. all(abs(p(lane, :)) <= huge(p))) then
            self%q(lane, :) = q(lane, :)
            self%p(lane, :) = p(lane, :)
         else
            self%status(lane) = nonfinite
         end if
      end do
   end subroutine take_sound

   !> Retire lanes that are ok when an observer is done with them: they then count like failed lanes, with a separate
   !> status. Their state remains the one that the observer saw, such as the end of a first passage.
   subroutine retire(self, leaves, status, step)
      class(lane_state), intent(inout) :: self
      logical, intent(in) :: leaves(self%nlane)
      integer(i8), intent(in) :: status, step               !! step: absolute number of the next step of these lanes

      where (leaves .and. self%status == 0)
         self%status = status
         self%failed_step = step
      end where
      self%nfailed = count(self%status /= 0)
   end subroutine retire

   !> Load the states of the first nlane lanes from arrays of nlane lanes: one of the passed states becomes the state
   !> that an observer sees.
   pure subroutine take_first(self, nlane, q, p)
      class(lane_state), intent(inout) :: self
      integer, intent(in) :: nlane
      real(wp), intent(in) :: q(nlane, self%ndof), p(nlane, self%ndof)
      integer :: i

      do i = 1, self%ndof
         self%q(:nlane, i) = q(:, i)
         self%p(:nlane, i) = p(:, i)
      end do
   end subroutine take_first

   !> Note this step for lanes that have got a status since the last call, and count all lanes with a status.
   subroutine record(self, step)
      class(lane_state), intent(inout) :: self
      integer(i8), intent(in) :: step   !! absolute number of the step

      where (self%status /= 0 .and. self%failed_step < 0) self%failed_step = step
      self%nfailed = count(self%status /= 0)
   end subroutine record

   !> Append a state; the caller makes sure that there is capacity.
   subroutine put(self, state)
      class(passed_states), intent(inout) :: self
      type(lane_state), intent(in) :: state
      integer :: lane, i

      self%n = self%n + 1
      associate (n => self%n)
         !GCC$ novector  ! few numbers, far from each other
         do i = 1, state%ndof
            do lane = 1, state%nlane
               self%q(lane, i, n) = state%q(lane, i)
               self%p(lane, i, n) = state%p(lane, i)
            end do
         end do
      end associate
   end subroutine put

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC One degree of freedom: check and add in one pass. With several degrees of freedom the verdict on a lane needs
   !> all its sums before any is stored, hence two passes (find_bad, add).
   pure subroutine advance_one(nlane, dq, dp, q, p, status, bad, nbad)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: dq(nlane), dp(nlane)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      integer(i8), intent(in) :: status(nlane)
      real(wp), intent(out) :: bad(nlane)
      integer, intent(out) :: nbad
      real(wp) :: qn, pn
      integer(i8) :: count
      logical :: ok
      integer :: lane

      count = 0
      ! A comparison with huge is also false for NaN.
      do lane = 1, nlane
         qn = q(lane) + dq(lane)
         pn = p(lane) + dp(lane)
         ok = status(lane) == 0 .and. abs(qn) <= huge(qn) .and. abs(pn) <= huge(pn)
         q(lane) = merge(qn, q(lane), ok)
         p(lane) = merge(pn, p(lane), ok)
         bad(lane) = merge(0.0_wp, 1.0_wp, ok)
         count = count + merge(0_i8, 1_i8, ok)
      end do
      nbad = int(count)
   end subroutine advance_one

   !> Advance a single path: add n numbers if their sums are finite and the path is ok, by Kahan's summation if there
   !> are low parts; otherwise nothing changes. All numbers are tested before the first is stored. The test uses plain
   !> sums, which differ from compensated ones by one rounding.
   pure subroutine advance_path(n, dq, dp, q, p, status, bad, q_low, p_low)
      integer, intent(in) :: n
      real(wp), intent(in) :: dq(n), dp(n)
      real(wp), intent(inout) :: q(n), p(n)
      integer(i8), intent(in) :: status
      logical, intent(out) :: bad
      real(wp), intent(inout), optional :: q_low(n), p_low(n)
      integer :: i

      bad = .not. (status == 0 .and. has_finite_sums(n, q, dq) .and. has_finite_sums(n, p, dp))
      if (bad) return
      if (present(q_low)) then
         do i = 1, n
            call add_low(dq(i), q(i), q_low(i))
            call add_low(dp(i), p(i), p_low(i))
         end do
      else if (n <= narrow) then  ! few numbers have just been stored one by one: add them one by one, too
         !GCC$ novector
         do i = 1, n
            q(i) = q(i) + dq(i)
            p(i) = p(i) + dp(i)
         end do
      else
         q = q + dq
         p = p + dp
      end if
   end subroutine advance_path

   !> VEC Whether x + d is finite in all n numbers. Up to four numbers are tested one by one: they have just been
   !> stored one by one, and a vector load would have to wait until these stores are in memory.
   pure logical function has_finite_sums(n, x, d)
      integer, intent(in) :: n
      real(wp), intent(in) :: x(n), d(n)
      integer(i8) :: count
      integer :: i

      if (n <= narrow) then
         has_finite_sums = .true.
         !GCC$ novector
         do i = 1, n
            has_finite_sums = has_finite_sums .and. abs(x(i) + d(i)) <= huge(x)
         end do
         return
      end if
      count = 0
      do i = 1, n
         count = count + merge(0_i8, 1_i8, abs(x(i) + d(i)) <= huge(x))
      end do
      has_finite_sums = count == 0
   end function has_finite_sums

   !> x = x + d by Kahan's summation: low, the rounding error of the last sum, is added to this sum. The compiler
   !> must not simplify these lines: in exact arithmetic low is zero.
   pure subroutine add_low(d, x, low)
      real(wp), intent(in) :: d
      real(wp), intent(inout) :: x, low
      real(wp) :: y, s

      ! y is the number to add, s - x the number that was added; low is their difference.
      y = d + low
      s = x + y
      low = y - (s - x)
      x = s
   end subroutine add_low

   !> VEC nbad = number of real lanes that have a status, or a number among the n that is not finite; bad = 1 in these
   !> lanes. Here n counts the numbers of all states, one after the other.
   pure subroutine find_bad_states(nlane, n, nreal, status, q, p, bad, nbad)
      integer, intent(in) :: nlane, n, nreal
      integer(i8), intent(in) :: status(nlane)
      real(wp), intent(in) :: q(nlane, n), p(nlane, n)
      real(wp), intent(out) :: bad(nlane)
      integer, intent(out) :: nbad
      integer(i8) :: count
      integer :: lane, i

      bad = 0
      do i = 1, n
         do lane = 1, nlane
            bad(lane) = bad(lane) + (0*q(lane, i) + 0*p(lane, i))  ! NaN if q or p is not finite
         end do
      end do
      count = 0
      ! Padding is not judged: bad is zero or NaN there, and is not read.
      do lane = 1, nreal
         bad(lane) = merge(0.0_wp, 1.0_wp, abs(bad(lane)) <= 0 .and. status(lane) == 0)
         count = count + merge(0_i8, 1_i8, bad(lane) <= 0)
      end do
      nbad = int(count)
   end subroutine find_bad_states

   !> VEC Copy the last good state (q, p) to all nout states (qn, pn) in lanes with a status, so that observers see
   !> failed paths where they ended.
   pure subroutine keep(nlane, ndof, nout, q, p, status, qn, pn)
      integer, intent(in) :: nlane, ndof, nout
      real(wp), intent(in) :: q(nlane, ndof), p(nlane, ndof)
      integer(i8), intent(in) :: status(nlane)
      real(wp), intent(inout) :: qn(nlane, ndof, nout), pn(nlane, ndof, nout)
      integer :: lane, i, k

      do k = 1, nout
         do i = 1, ndof
            do lane = 1, nlane
               qn(lane, i, k) = merge(qn(lane, i, k), q(lane, i), status(lane) == 0)
               pn(lane, i, k) = merge(pn(lane, i, k), p(lane, i), status(lane) == 0)
            end do
         end do
      end do
   end subroutine keep

   !> VEC bad = 1 in lanes that have failed or whose sums are not finite, else 0; nbad = number of bad lanes. `bad` is
   !> real, so that it has the width of the numbers and fits the same vectors.
   pure subroutine find_bad(nlane, ndof, dq, dp, q, p, status, bad, nbad)
      integer, intent(in) :: nlane, ndof
      real(wp), intent(in) :: dq(nlane, ndof), dp(nlane, ndof), q(nlane, ndof), p(nlane, ndof)
      integer(i8), intent(in) :: status(nlane)
      real(wp), intent(out) :: bad(nlane)
      integer, intent(out) :: nbad
      integer :: lane, i

      ! 0*x is 0 for finite x and NaN otherwise, and NaN stays NaN: no comparison for each value
      bad = 0
      do i = 1, ndof
         do lane = 1, nlane
            bad(lane) = bad(lane) + (0*(q(lane, i) + dq(lane, i)) + 0*(p(lane, i) + dp(lane, i)))
         end do
      end do
      ! bad = 1 if some sum is not finite or the lane had a status, else 0.
      do lane = 1, nlane
         bad(lane) = merge(0.0_wp, 1.0_wp, abs(bad(lane)) <= 0 .and. status(lane) == 0)
      end do
      ! Sums of ones and zeros are exact in any order.
      nbad = nint(sum(bad))
   end subroutine find_bad

   !> VEC x = x + d in lanes that are not bad; other lanes keep every bit of x. With `low`, Kahan's summation keeps
   !> the rounding error, and adds it in the next step.
   pure subroutine add(nlane, ndof, d, bad, x, low)
      integer, intent(in) :: nlane, ndof
      real(wp), intent(in) :: d(nlane, ndof), bad(nlane)
      real(wp), intent(inout) :: x(nlane, ndof)
      real(wp), intent(inout), optional :: low(nlane, ndof)
      real(wp) :: s, l
      integer :: lane, i

      do i = 1, ndof
         if (present(low)) then
            do lane = 1, nlane
               s = x(lane, i)
               l = low(lane, i)
               call add_low(d(lane, i), s, l)
               low(lane, i) = merge(l, low(lane, i), bad(lane) <= 0)
               x(lane, i) = merge(s, x(lane, i), bad(lane) <= 0)
            end do
         else
            do lane = 1, nlane
               x(lane, i) = merge(x(lane, i) + d(lane, i), x(lane, i), bad(lane) <= 0)
            end do
         end if
      end do
   end subroutine add

end module symsde_step_block_state
