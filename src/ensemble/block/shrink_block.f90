! SPDX-License-Identifier: BSD-3-Clause
!> Narrower blocks for the remaining paths when others failed or were absorbed: lanes without a path cost nothing.
!>
!> As soon as half of the lanes of a block have a status, its other paths go on in a block of half the width, a quarter,
!> and so on, of at least eight lanes. Such a block has a runner of its own, made when first needed and kept for later
!> blocks; its observer writes the lanes back to their places in the wide block and shows the wide block to the observer
!> of the run. So observers see the same blocks as without narrowing. A path has the same bits in a block of any width,
!> and its noise is asked for by its global index: nothing that is computed depends on when a block was narrowed.
!>
!> The wide runner stays the owner of the block. While a narrower runner has its paths, the wide state is updated
!> whenever a state is shown, and when the narrower runner passes the paths on or back. A block narrows from the wide
!> state each time, never from another narrow one, so `origin` always names lanes of the wide block:
!>
!>    lane l of the narrow block  <->  lane origin(l) of the wide one       l = 1 .. nreal of the narrow block
module symsde_ensemble_block_shrink_block
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lane_unit, padded
   use symsde_base_status, only: error_type, stopped
   use symsde_ensemble_block_runner, only: block_runner
   use symsde_ensemble_observe_observer, only: observer_type
   use symsde_ensemble_block_runner_factory, only: runner_factory
   use symsde_step_block_state, only: lane_state
   implicit none
   private
   public :: narrow_down, come_back, narrower_width

   integer(i8), parameter :: worth_while = 16  !! fewest remaining steps for which a narrower block pays

   !> The observer of a narrower block: it shows its lanes at their places in the wide block to the observer of the run.
   type, extends(observer_type) :: spreading_observer
      type(block_runner), pointer :: wide => null(), narrow => null()
   contains
      procedure :: begin_block
      procedure :: observe
      procedure :: may_retire
      procedure :: end_block
   end type spreading_observer

contains

   !> Width of the next narrower block: half of the lanes, rounded up to whole vectors. A block that cannot be halved
   !> gets its own width back.
   elemental integer function narrower_width(nlane)
      integer, intent(in) :: nlane

      narrower_width = min(nlane, max(lane_unit, padded((nlane + 1)/2)))
   end function narrower_width

   !> Move the paths of a block to a narrower runner once half of its lanes have a status. Otherwise set active%enough
   !> to the number of such lanes that would cause it, which ends a chunk. The width is halved while the remaining paths
   !> fit. Near the end of a run, or without memory for narrower blocks, nothing is done.
   subroutine narrow_down(factory, wide, active)
      type(runner_factory), intent(in) :: factory
      type(block_runner), intent(inout), target :: wide            !! the runner of the whole block
      type(block_runner), pointer, intent(inout) :: active  !! the runner that has its paths now
      type(block_runner), pointer :: next
      integer :: width, nlive

      associate (nlane => active%state%nlane)
         active%enough = nlane  ! chunks do not end by failures, unless set below
         ! Blocks of eight lanes are the narrowest, since a vector is not halved.
         if (.not. factory%narrows .or. narrower_width(nlane) == nlane) return
         if (wide%options%first_step + wide%options%nstep - active%step < worth_while) return
         ! Half of the lanes, or nearly: as many as the next narrower block lacks.
         active%enough = nlane - narrower_width(nlane)
         if (active%state%nfailed < active%enough) return
         nlive = nlane - active%state%nfailed
         width = narrower_width(nlane)
      end associate
      ! Many paths may have ended since the last check: take the narrowest block that holds the remaining paths.
      do while (narrower_width(width) < width .and. nlive <= narrower_width(width))
         width = narrower_width(width)
      end do
      call find_runner(factory, wide, width, next)
      ! The block keeps its width, and no longer watches for lanes that end.
      if (.not. associated(next)) then
         active%enough = active%state%nlane
         return
      end if
      ! paths move from one narrow block to another through the wide state
      if (.not. associated(active, wide)) call leave(wide, active)
      call hand_over(wide, active, next)
      active => next
      ! Set the number of ended lanes at which to narrow again. A block of the least width goes on until its last lane
      ! has a status.
      active%enough = width - merge(narrower_width(width), 0, narrower_width(width) < width)
   end subroutine narrow_down

   !> Return the paths of a block to the wide runner, if a narrower runner has them: the wide runner finishes the block.
   subroutine come_back(wide, active)
      type(block_runner), intent(inout), target :: wide
      type(block_runner), pointer, intent(inout) :: active

      ! Return if no narrower runner has taken the paths.
      if (associated(active, wide)) return
      call leave(wide, active)
      ! The narrower runner took the steps: the wide runner continues from its step.
      wide%step = active%step
      active => wide
   end subroutine come_back

   !> Find the runner of this width in the list of the wide runner, or make it. It is null if it cannot be made;
   !> then the block keeps its width.
   subroutine find_runner(factory, wide, width, runner)
      type(runner_factory), intent(in) :: factory
      type(block_runner), intent(inout), target :: wide
      integer, intent(in) :: width
      type(block_runner), pointer, intent(out) :: runner
      type(error_type), allocatable :: error

      ! The list begins at the wide runner and is linked through `narrower`.
      runner => wide%narrower
      do while (associated(runner))
         if (runner%state%nlane == width) return
         runner => runner%narrower
      end do
      allocate (runner)
      call factory%new_runner(runner, width, .true., error)
      if (allocated(error)) then
         deallocate (runner)
         return
      end if
      allocate (runner%origin(width))
      ! The new runner becomes the first of the list, which the wide runner frees.
      runner%narrower => wide%narrower
      wide%narrower => runner
   end subroutine find_runner

   !> Let the ok paths of the wide block go on in another block, from the wide state, which is up to date. They keep
   !> their order; remaining lanes repeat the last path and have the status of padding.
   subroutine hand_over(wide, from, to)
      type(block_runner), intent(inout), target :: wide
      type(block_runner), intent(in) :: from
      type(block_runner), intent(inout), target :: to
      integer(i8) :: path(to%state%nlane)
      integer :: lane, n

      ! origin(1 .. n) are the lanes that are ok, in order.
      n = 0
      do lane = 1, wide%nreal
         if (wide%state%status(lane) /= 0) cycle
         n = n + 1
         to%origin(n) = lane
      end do
      ! Padding repeats the last path. n > 0, since a block without an ok lane is done.
      to%origin(n + 1:) = to%origin(n)
      ! Paths keep their global indices, by which their noise is drawn and their parameters are found.
      do lane = 1, to%state%nlane
         path(lane) = wide%path(to%origin(lane))
      end do
      ! The narrow runner draws from the same source, and shows its states to the observer of the wide runner.
      call to%equip(wide%options, spreading_observer(wide=wide, narrow=to), wide%drawn%noise)
      call to%begin_with(from%step, n, path)
      to%growth%look = -1
      associate (s => to%state, x => wide%state)
         call gather_lanes(x%nlane, s%nlane, s%ndof, to%origin, x%q, s%q)
         call gather_lanes(x%nlane, s%nlane, s%ndof, to%origin, x%p, s%p)
         ! Low parts of compensated sums move, too, or bits would change.
         if (allocated(s%q_low)) then
            call gather_lanes(x%nlane, s%nlane, s%ndof, to%origin, x%q_low, s%q_low)
            call gather_lanes(x%nlane, s%nlane, s%ndof, to%origin, x%p_low, s%p_low)
         end if
         s%status(:n) = 0
         s%failed_step(:n) = -1
         s%status(n + 1:) = stopped  ! padding, as in every block
         s%failed_step(n + 1:) = from%step
         s%nfailed = s%nlane - n
      end associate
      if (from%step < wide%growth%look) &
         call to%growth%begin(wide%options%first_step, wide%options%nstep, to%state)
   end subroutine hand_over

   !> Write the states of a narrower block's paths into the wide block, and the number of normals that a pair of their
   !> steps took.
   subroutine leave(wide, narrow)
      type(block_runner), intent(inout) :: wide
      type(block_runner), intent(in) :: narrow

      call spread_state(narrow%nreal, narrow%origin, narrow%state, wide%state)
      call wide%growth%take_lanes(narrow%growth, narrow%origin(:narrow%nreal))
      ! The wide runner counts the normals of the whole block at its end.
      wide%drawn%normals_of_pair = narrow%drawn%normals_of_pair
   end subroutine leave

   !> Write the lanes of a narrower block to their places in the wide block. Lanes that have a status there are not
   !> changed. From a lane that failed in the narrow block its last good state, its status and its step are copied.
   subroutine spread_state(nreal, origin, narrow, wide)
      integer, intent(in) :: nreal
      type(lane_state), intent(in) :: narrow
      integer, intent(in) :: origin(narrow%nlane)
      type(lane_state), intent(inout) :: wide
      integer :: lane
      logical :: is_ok(nreal)

      is_ok = wide%status(origin(:nreal)) == 0  ! before statuses are written, since it decides which lanes are copied
      call spread_lanes(wide%nlane, narrow%nlane, nreal, wide%ndof, origin, is_ok, narrow%q, wide%q)
      call spread_lanes(wide%nlane, narrow%nlane, nreal, wide%ndof, origin, is_ok, narrow%p, wide%p)
      if (allocated(wide%q_low)) then
         call spread_lanes(wide%nlane, narrow%nlane, nreal, wide%ndof, origin, is_ok, narrow%q_low, wide%q_low)
         call spread_lanes(wide%nlane, narrow%nlane, nreal, wide%ndof, origin, is_ok, narrow%p_low, wide%p_low)
      end if
      do lane = 1, nreal
         ! Lanes that failed in the narrow block: copy status and step, too.
         if (.not. is_ok(lane) .or. narrow%status(lane) == 0) cycle
         wide%status(origin(lane)) = narrow%status(lane)
         wide%failed_step(origin(lane)) = narrow%failed_step(lane)
         wide%nfailed = wide%nfailed + 1
      end do
   end subroutine spread_state

   !> Gather lanes: narrow(l, :) = wide(origin(l), :), padding included.
   pure subroutine gather_lanes(nwide, nnarrow, ndof, origin, wide, narrow)
      integer, intent(in) :: nwide, nnarrow, ndof, origin(nnarrow)
      real(wp), intent(in) :: wide(nwide, ndof)
      real(wp), intent(inout) :: narrow(nnarrow, ndof)
      integer :: lane, i

      do i = 1, ndof
         do lane = 1, nnarrow
            narrow(lane, i) = wide(origin(lane), i)
         end do
      end do
   end subroutine gather_lanes

   !> Spread lanes: wide(origin(l), :) = narrow(l, :) for real lanes that are ok in the wide block.
   pure subroutine spread_lanes(nwide, nnarrow, nreal, ndof, origin, is_ok, narrow, wide)
      integer, intent(in) :: nwide, nnarrow, nreal, ndof, origin(nnarrow)
      logical, intent(in) :: is_ok(nreal)
      real(wp), intent(in) :: narrow(nnarrow, ndof)
      real(wp), intent(inout) :: wide(nwide, ndof)
      integer :: lane, i

      do i = 1, ndof
         do lane = 1, nreal
            if (is_ok(lane)) wide(origin(lane), i) = narrow(lane, i)
         end do
      end do
   end subroutine spread_lanes

   ! ---- the observer of a narrower block ---------------------------------------------------------

   !> The observer of the run is not called: the wide block began before.
   subroutine begin_block(self, first, nreal, nlane)
      class(spreading_observer), intent(inout) :: self
      integer(i8), intent(in) :: first
      integer, intent(in) :: nreal, nlane
   end subroutine begin_block

   !> Show the wide block with these lanes at their places; lanes that its observer retires are retired here, too, with
   !> the same status and step.
   subroutine observe(self, isave, t, state)
      class(spreading_observer), intent(inout) :: self
      integer(i8), intent(in) :: isave
      real(wp), intent(in) :: t
      type(lane_state), intent(inout) :: state
      integer :: lane, before

      associate (wide => self%wide%state, origin => self%narrow%origin)
         ! Update the wide state first: the observer sees all paths of the block.
         call spread_state(self%narrow%nreal, origin, state, wide)
         ! The count shows whether the observer retired lanes; only then search these lanes.
         before = wide%nfailed
         call self%wide%observer%observe(isave, t, wide)
         if (wide%nfailed == before) return
         do lane = 1, self%narrow%nreal
            if (state%status(lane) /= 0 .or. wide%status(origin(lane)) == 0) cycle
            state%status(lane) = wide%status(origin(lane))
            state%failed_step(lane) = wide%failed_step(origin(lane))
         end do
         state%nfailed = count(state%status /= 0)
      end associate
   end subroutine observe

   !> Whether the observer of the run may retire lanes: the runner of the narrow block then keeps the state to return
   !> to.
   logical function may_retire(self)
      class(spreading_observer), intent(in) :: self

      may_retire = self%wide%observer%may_retire()
   end function may_retire

   !> The observer of the run is not called: the wide block ends later.
   subroutine end_block(self, state)
      class(spreading_observer), intent(inout) :: self
      type(lane_state), intent(in) :: state
   end subroutine end_block

end module symsde_ensemble_block_shrink_block
