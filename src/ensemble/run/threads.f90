! SPDX-License-Identifier: BSD-3-Clause
!> Distribute blocks over threads: the loop over blocks, which is the only parallel region of the library, and the
!> choice of the number of threads.
!>
!>    run_blocks: start the threads
!>    run_share:  compute one block after the other, until none is left
!>    run_block:  compute a block to its end, chunk by chunk
!>    watch:      let the calling thread wait for the other threads
!>
!> Private to its family.
module symsde_ensemble_run_threads
   use, intrinsic :: iso_c_binding, only: c_int
   use omp_lib, only: omp_get_max_threads, omp_get_thread_num
   use symsde_base_clock, only: seconds
   use symsde_base_contracts, only: contracts_are_executed
   use symsde_base_interrupt, only: interrupt_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type, raise, invalid_argument, stopped, absorbed
   use symsde_base_text, only: to_text
   use symsde_ensemble_block_runner, only: block_runner
   use symsde_ensemble_block_initial_state, only: initial_state
   use symsde_ensemble_contract, only: require_counts
   use symsde_ensemble_monitor, only: monitor_type
   use symsde_ensemble_block_shrink_block, only: narrow_down, come_back
   use symsde_ensemble_options, only: run_options
   use symsde_ensemble_block_runner_factory, only: runner_factory
   implicit none
   private
   public :: shared_state, run_blocks, choose_nthread, usable_threads

   integer(c_int), parameter :: longest_wait = 200  !! longest sleep while waiting for other threads [us]
   real(wp), parameter :: moment = 0.025_wp         !! duration of a chunk [s]

   !> Data shared by the threads of one run.
   type :: shared_state
      logical :: stopping = .false.
      integer(i8) :: next = 0, finished = 0       !! next block to compute; number of blocks that have ended
      integer(i8) :: done = 0, total = 0          !! path-steps done, and path-steps of the whole run
      integer(i8) :: nfailed = 0, nstopped = 0    !! failed paths, and paths cut short by a stop
      integer(i8) :: ngrown = 0                   !! ok paths that have grown (block/growth)
   end type shared_state

   !> The stop flag as one thread reads it, between chunks and during long steps.
   type, extends(interrupt_type) :: stop_flag
      type(shared_state), pointer :: shared => null()
      class(monitor_type), pointer :: monitor => null()  !! called by the calling thread only
   contains
      procedure :: look
   end type stop_flag

   interface
      !> POSIX: sleep for this many microseconds.
      function usleep(microseconds) result(status) bind(c, name='usleep')
         import :: c_int
         integer(c_int), value :: microseconds
         integer(c_int) :: status
      end function usleep

      !> forked.c: nonzero in a process that was forked after the library was loaded.
      function process_is_forked() result(forked) bind(c)
         import :: c_int
         integer(c_int) :: forked
      end function process_is_forked

      !> float_mode.c: the rounding mode of this thread, and whether it keeps denormal numbers.
      function float_mode() result(mode) bind(c)
         import :: c_int
         integer(c_int) :: mode
      end function float_mode

      !> float_mode.c: set the mode of this thread.
      subroutine set_float_mode(mode) bind(c)
         import :: c_int
         integer(c_int), value :: mode
      end subroutine set_float_mode
   end interface

contains

   !> Run the parallel loop over blocks. All threads must round like the calling thread, or results would depend on
   !> which thread computes a block. Threads of OpenMP keep the rounding mode they were started with, or that a parallel
   !> region of the calling program set; so the mode is set here, and restored at the end.
   subroutine run_blocks(runners, factory, options, start, monitor, shared)
      type(block_runner), intent(inout), target :: runners(:)
      type(runner_factory), intent(in) :: factory
      type(run_options), intent(in) :: options
      type(initial_state), intent(in) :: start
      class(monitor_type), intent(inout), target :: monitor
      type(shared_state), intent(inout), target :: shared
      integer(c_int) :: mode, own

      if (size(runners) == 1) then  ! even a team of one thread costs a microsecond
         call run_share(1, runners, factory, options, start, monitor, shared)
      else
         mode = float_mode()
         !$omp parallel num_threads(size(runners)) default(none) private(own) &
         !$omp shared(runners, factory, options, start, monitor, shared, mode)
         own = float_mode()
         call set_float_mode(mode)
         call run_share(omp_get_thread_num() + 1, runners, factory, options, start, monitor, shared)
         call set_float_mode(own)
         !$omp end parallel
      end if
      if (contracts_are_executed) call require_counts((options%npath - 1)/runners(1)%state%nlane + 1, shared%finished, &
                                                      options%npath, shared%nfailed + shared%nstopped)
   end subroutine run_blocks

   !> Compute one block after another on this thread, with its own runner, until no block is left.
   subroutine run_share(me, runners, factory, options, start, monitor, shared)
      integer, intent(in) :: me   !! 1 is the thread that called the library
      type(block_runner), intent(inout), target :: runners(:)
      type(runner_factory), intent(in) :: factory
      type(run_options), intent(in) :: options
      type(initial_state), intent(in) :: start
      class(monitor_type), intent(inout), target :: monitor
      type(shared_state), intent(inout), target :: shared
      type(stop_flag) :: flag
      integer(i8) :: iblock, nblock, nlane
      integer :: nreal
      logical :: stopping

      flag%shared => shared
      if (me == 1) flag%monitor => monitor
      nlane = runners(1)%state%nlane
      nblock = (options%npath + nlane - 1)/nlane
      do
         !$omp atomic capture
         iblock = shared%next
         shared%next = shared%next + 1
         !$omp end atomic
         if (iblock >= nblock) exit
         nreal = int(min(nlane, options%npath - iblock*nlane))
         !$omp atomic read
         stopping = shared%stopping
         if (stopping) then
            call runners(me)%pass_over(options%first_path + iblock*nlane, nreal, start)
         else
            call runners(me)%begin(options%first_path + iblock*nlane, nreal, start)
            call run_block(runners(me), factory, monitor%chunk, flag, shared)
         end if
         !$omp critical (symsde_end_block)
         call runners(me)%observer%end_block(runners(me)%state)
         associate (status => runners(me)%state%status(:nreal))
            shared%nstopped = shared%nstopped + count(status == stopped)
            if (.not. stopping) &
               shared%ngrown = shared%ngrown + runners(me)%growth%count_grown(nreal, runners(me)%state)
            shared%nfailed = shared%nfailed + count(status /= 0 .and. status /= stopped .and. status /= absorbed)
         end associate
         !$omp end critical (symsde_end_block)
         !$omp atomic update
         shared%finished = shared%finished + 1
      end do
      !$omp critical (symsde_end_block)
      call runners(me)%observer%gather()
      !$omp end critical (symsde_end_block)
      if (me == 1) call watch(nblock, flag, shared)
   end subroutine run_share

   !> Let the calling thread, which has no block left, wait for the other threads. Meanwhile it keeps calling the
   !> monitor, so that a run can be stopped whichever thread computes the last block.
   subroutine watch(nblock, flag, shared)
      integer(i8), intent(in) :: nblock
      type(stop_flag), intent(inout) :: flag
      type(shared_state), intent(inout) :: shared
      integer(i8) :: finished
      integer(c_int) :: ignored, wait_time

      wait_time = 5
      do
         !$omp atomic read
         finished = shared%finished
         if (finished >= nblock) exit
         ignored = usleep(wait_time)
         wait_time = min(2*wait_time, longest_wait)
         call flag%look()
      end do
   end subroutine watch

   !> Find out whether the run shall stop: a draw may have wanted it. Only the thread that called the library calls the
   !> monitor; other threads read the stop flag.
   subroutine look(self)
      class(stop_flag), intent(inout) :: self
      integer(i8) :: done
      logical :: stopping, asks

      !$omp atomic read
      stopping = self%shared%stopping
      asks = .false.
      if (associated(self%monitor)) then
         !$omp atomic read
         done = self%shared%done
         call self%monitor%ask(done, self%shared%total, asks)
      end if
      if (asks .or. self%wanted) then
         !$omp atomic write
         self%shared%stopping = .true.
      end if
      self%wanted = asks .or. self%wanted .or. stopping
   end subroutine look

   !> Run one block to its end, chunk by chunk. Between chunks read the stop flag, report to the monitor, and move
   !> remaining paths to a narrower block. The monitor sets the steps of a chunk; by default the clock does, which
   !> affects nothing else.
   subroutine run_block(runner, factory, chunk, flag, shared)
      type(block_runner), intent(inout), target :: runner
      type(runner_factory), intent(in) :: factory
      integer(i8), intent(in) :: chunk   !! steps of a chunk, from the monitor; 0 = by the clock
      type(stop_flag), intent(inout) :: flag
      type(shared_state), intent(inout) :: shared
      type(block_runner), pointer :: active   !! runner that holds the paths of the block now
      integer(i8) :: before
      real(wp) :: began, took
      logical :: stop_now

      active => runner
      do while (.not. active%is_done())
         !$omp atomic read
         stop_now = shared%stopping
         if (stop_now) exit
         call narrow_down(factory, runner, active)
         before = active%step
         active%chunk = merge(chunk, runner%chunk, chunk > 0)
         began = seconds()
         call active%run_chunk(flag)
         took = max(seconds() - began, 1e-9_wp)
         runner%chunk = max(1_i8, int(min(16.0_wp, moment/took)*(active%step - before), i8))
         !$omp atomic update
         shared%done = shared%done + (active%step - before)*runner%nreal
         if (runner%stepper%ham%model%failure_code() /= 0 .or. runner%observer%failure_code() /= 0) then
            !$omp atomic write
            shared%stopping = .true.
         else
            call flag%look()
         end if
      end do
      call come_back(runner, active)
      call runner%finish()
   end subroutine run_block

   !> The number of threads that pays for an amount of work, at most nthread; one in a forked process, since the threads
   !> of OpenMP do not exist in it. Waking a thread takes microseconds, and far longer if other programs keep the
   !> processors busy.
   integer function usable_threads(nthread, work)
      integer, intent(in) :: nthread
      real(wp), intent(in) :: work     !! degrees of freedom times paths times steps
      real(wp), parameter :: share = 2000  !! work of a thread that is worth waking it: ten microseconds or more

      usable_threads = max(1, min(nthread, int(min(work/share, 1024.0_wp))))
      if (usable_threads == 1) return  ! asking the system whether this process is forked takes time
      if (process_is_forked() /= 0) usable_threads = 1
   end function usable_threads

   !> Choose the number of threads: from the options, else from SYMSDE_NUM_THREADS, else from OpenMP; one in a forked
   !> process. A variable that is not a valid number of threads is refused: a user who sets it expects an effect.
   subroutine choose_nthread(options, nthread, error)
      type(run_options), intent(in) :: options
      integer, intent(out) :: nthread
      type(error_type), allocatable, intent(inout) :: error
      integer, parameter :: most = 1024
      character(len=32) :: text
      integer :: info

      nthread = options%nthread
      if (nthread == 1) return
      if (process_is_forked() /= 0) nthread = 1
      if (nthread > 0) return
      call get_environment_variable('SYMSDE_NUM_THREADS', text, status=info)
      if (info > 0 .or. text == '') then  ! the variable is not set, or empty
         nthread = max(1, omp_get_max_threads())
         return
      end if
      text = adjustl(text)
      if (info == 0 .and. len_trim(text) <= 4 .and. verify(trim(text), '0123456789') == 0) read (text, '(i4)') nthread
      if (nthread < 1 .or. nthread > most) &
         call raise(error, invalid_argument, 'run_ensemble', 'the environment variable SYMSDE_NUM_THREADS is "'// &
                    trim(text)//'": give a whole number from 1 to '//to_text(most)//', or unset it')
   end subroutine choose_nthread

end module symsde_ensemble_run_threads
