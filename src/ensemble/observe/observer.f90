! SPDX-License-Identifier: BSD-3-Clause
!> The abstract observer: it sees every block at every saved time, from the first to the last, and keeps results. Every
!> thread has its own copy of an observer, made by assignment before the threads start. Data that the copies share are
!> behind pointers.
module symsde_ensemble_observe_observer
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: steps_record
   use symsde_base_status, only: error_type
   use symsde_model_abstract, only: model_type
   use symsde_step_block_state, only: lane_state
   implicit none
   private
   public :: observer_type

   type, abstract :: observer_type
   contains
      procedure(begin_interface), deferred :: begin_block
      procedure(observe_interface), deferred :: observe
      procedure(end_interface), deferred :: end_block
      procedure :: observe_several => observe_each
      procedure :: may_retire => it_does_not
      procedure :: skip => nothing_to_skip
      procedure :: gather => nothing_to_gather
      procedure :: numbers => nothing_held
      procedure :: failure_code => never_failed
      procedure :: probe => nothing_to_probe
      procedure :: add_warnings => nothing_to_warn
      procedure :: see => nothing_to_ask
      procedure :: keeps_steps => it_does_not
      procedure :: keep_steps => nothing_to_keep
   end type observer_type

   abstract interface
      !> A block of nreal paths from global path `first` on, in nlane lanes, is about to run.
      subroutine begin_interface(self, first, nreal, nlane)
         import :: observer_type, i8
         class(observer_type), intent(inout) :: self
         integer(i8), intent(in) :: first
         integer, intent(in) :: nreal, nlane
      end subroutine begin_interface

      !> Take the state at saved time number isave (0 is t0). Lanes with a status have failed before t. The observer may
      !> retire lanes (state%retire): retired lanes are not shown any more, and a block with only retired lanes ends.
      subroutine observe_interface(self, isave, t, state)
         import :: observer_type, lane_state, i8, wp
         class(observer_type), intent(inout) :: self
         integer(i8), intent(in) :: isave
         real(wp), intent(in) :: t
         type(lane_state), intent(inout) :: state
      end subroutine observe_interface

      !> The block is done: its final state, with the status of each lane. Called by one thread at a time.
      subroutine end_interface(self, state)
         import :: observer_type, lane_state
         class(observer_type), intent(inout) :: self
         type(lane_state), intent(in) :: state
      end subroutine end_interface
   end interface

contains

   !> Take the states at saved times isave, isave + 1, ..., of lanes with the status of `state`. Afterwards `state`
   !> holds the last state shown: the first after which a lane is retired, if any. This default shows one state after
   !> another.
   subroutine observe_each(self, isave, nsave, t, nlane, q, p, state)
      class(observer_type), intent(inout) :: self
      integer(i8), intent(in) :: isave
      integer, intent(inout) :: nsave            !! states given; on return, states shown
      integer, intent(in) :: nlane               !! lanes of state
      real(wp), intent(in) :: t(nsave)
      type(lane_state), intent(inout) :: state
      real(wp), intent(in) :: q(nlane, state%ndof, nsave), p(nlane, state%ndof, nsave)
      integer :: k, before

      before = state%nfailed
      do k = 1, nsave
         call state%take_first(nlane, q(1, 1, k), p(1, 1, k))
         call self%observe(isave + k - 1, t(k), state)
         if (state%nfailed == before) cycle
         nsave = k
         return
      end do
   end subroutine observe_each

   !> Whether the observer may retire lanes; whether it is shown the steps (keep_steps).
   logical function it_does_not(self)
      class(observer_type), intent(in) :: self

      it_does_not = .false.
   end function it_does_not

   !> No lane counts from saved time number isave on: all have failed, or the run was stopped. Called at most once for a
   !> block, and instead of observe for the remaining times. This default does nothing.
   subroutine nothing_to_skip(self, isave)
      class(observer_type), intent(inout) :: self
      integer(i8), intent(in) :: isave
   end subroutine nothing_to_skip

   !> Deliver results: this thread has no further block. Called by one thread at a time.
   subroutine nothing_to_gather(self)
      class(observer_type), intent(inout) :: self
   end subroutine nothing_to_gather

   !> Number of eight-byte numbers that the copies of nthread threads hold at most during a run of npath paths.
   real(wp) function nothing_held(self, npath, nthread) result(numbers)
      class(observer_type), intent(in) :: self
      integer(i8), intent(in) :: npath
      integer, intent(in) :: nthread

      numbers = 0
   end function nothing_held

   !> Nonzero aborts the run: the return code of a user callback that the observer calls.
   integer function never_failed(self) result(code)
      class(observer_type), intent(in) :: self

      code = 0
   end function never_failed

   !> Probe the callbacks of the observer near the state of one path, before the run; refuse them by `error`. This
   !> default has no callbacks.
   subroutine nothing_to_probe(self, t, q0, p0, error)
      class(observer_type), intent(in) :: self
      real(wp), intent(in) :: t, q0(:), p0(:)
      type(error_type), allocatable, intent(inout) :: error
   end subroutine nothing_to_probe

   !> Add warnings about the results before the run, one sentence a line. This default adds none.
   subroutine nothing_to_warn(self, text)
      class(observer_type), intent(in) :: self
      character(:), allocatable, intent(inout) :: text
   end subroutine nothing_to_warn

   !> Use this view of the model, which knows the paths of the block, in place of the model. It outlives the observer.
   !> This default uses no model.
   subroutine nothing_to_ask(self, model)
      class(observer_type), intent(inout) :: self
      class(model_type), intent(in), target :: model
   end subroutine nothing_to_ask

   !> The first ntaken of these steps have been taken: their increments and functionals, before the states behind them
   !> are shown. An observer of steps sees blocks of one width. This default keeps nothing.
   subroutine nothing_to_keep(self, steps, ntaken)
      class(observer_type), intent(inout) :: self
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: ntaken
   end subroutine nothing_to_keep

end module symsde_ensemble_observe_observer
