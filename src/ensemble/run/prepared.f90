! SPDX-License-Identifier: BSD-3-Clause
!> A prepared run: checks, probes and allocations once; then any number of calls, of one step or of many.
!>
!> The run keeps the states of its paths. Between calls a program may read and change them: a thermostat, a collision, a
!> resampling of paths. Steps in several calls give the same bits as in one call, with any threads and blocks.
!>
!> A path that fails keeps its status, step and last good state until the run is reset. A stopped call leaves its blocks
!> at different steps; `resume` takes all of them to the end of the call.
module symsde_ensemble_run_prepared
   use, intrinsic :: iso_c_binding, only: c_associated, c_loc, c_null_ptr, c_ptr
   use symsde_base_contracts, only: contracts_are_executed, require
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_memory, only: require_memory, require_reserve
   use symsde_base_status, only: error_type, raise, incompatible, invalid_argument, wrong_shape, out_of_memory, stopped
   use symsde_base_text, only: to_text
   use symsde_ensemble_run_driver, only: ensemble_type, new_ensemble, check_state
   use symsde_ensemble_block_initial_state, only: initial_state
   use symsde_ensemble_monitor, only: monitor_type
   use symsde_ensemble_options, only: run_options, check_options, saved_count
   use symsde_ensemble_observe_recorder, only: path_recorder
   use symsde_ensemble_run_report, only: run_report
   use symsde_ensemble_run_simulate, only: paths_type, new_paths
   use symsde_model_abstract, only: model_type
   use symsde_noise_given, only: given_increments, increments_of
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: prepared_run, prepare

   integer(i8), parameter :: foreseen = 1000000  !! number of steps that the warnings of a prepared run are about

   !> The caller may change the values of q, p and their low parts between calls, but not their shape. Only a
   !> compensated run has low parts. A run has pointers into itself and cannot be copied: after an assignment the
   !> left-hand side is not prepared.
   type :: prepared_run
      real(wp), allocatable :: q(:, :), p(:, :)          !! present state (npath, ndof)
      real(wp), allocatable :: q_low(:, :), p_low(:, :)  !! low parts of the state (npath, ndof)
      integer(i4), allocatable :: status(:)              !! 0 = ok, else a code of base/status (npath)
      integer(i8), allocatable :: failed_step(:)         !! absolute step, -1 = none (npath)
      type(scheme_type), private :: scheme
      type(ensemble_type), private :: ensemble
      type(run_options), private :: given     !! options to begin again with after reset
      logical, private :: was_stopped = .false.    !! whether the last call was stopped
      integer(i8), private :: goal = 0        !! absolute step to which the last call was to go
      integer, private :: at_work = 0         !! 1 during a call
      logical, private :: was_assigned = .false.   !! whether the run was assigned to after it was prepared
      type(c_ptr), private :: home = c_null_ptr !! address of the run when it was prepared; a copy has another address
   contains
      procedure :: advance
      procedure :: resume
      procedure :: begin_steps
      procedure :: begin_rest
      procedure :: record
      procedure :: reset
      procedure :: next_step
      procedure :: time
      procedure :: options
      procedure :: get_report
      generic :: assignment(=) => leave_unprepared
      procedure, private :: leave_unprepared
      procedure, private :: restart
      procedure, private :: go
      procedure, private :: enter
      procedure, private :: leave
   end type prepared_run

contains

   !> Check model, scheme and options, probe the model at the initial state, and allocate all that steps need. The model
   !> must live as long as the run; the scheme is copied. nstep and save_every of the options are not used.
   subroutine prepare(self, model, scheme, options, q0, p0, error, q0_low, p0_low)
      type(prepared_run), intent(out), target :: self
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      real(wp), intent(in) :: q0(:, :), p0(:, :)                     !! initial state (npath or 1, ndof)
      type(error_type), allocatable, intent(inout) :: error
      real(wp), intent(in), target, optional :: q0_low(:, :), p0_low(:, :)  !! low parts (npath or 1, ndof)
      type(run_options) :: chosen
      real(wp), pointer :: q_low(:, :), p_low(:, :)  !! the arguments, or null: an absent array is not passed on

      if (allocated(error)) return
      nullify (q_low, p_low)
      if (present(q0_low)) q_low => q0_low
      if (present(p0_low)) p_low => p0_low
      chosen = options
      chosen%save_every = 1
      chosen%nstep = max(0_i8, min(foreseen, 2_i8**46 - options%first_step))
      call check_options(chosen, error)
      if (allocated(error)) return
      self%home = c_loc(self%goal)
      self%scheme = scheme
      call new_ensemble(self%ensemble, model, self%scheme, chosen, q0, p0, path_recorder(), error)
      if (.not. allocated(error)) call new_state(self, options%npath, model%traits%ndof, options%compensated, error)
      if (.not. allocated(error)) call self%restart(chosen, q0, p0, q_low, p_low, error)
   end subroutine prepare

   !> Copy nothing on assignment, since pointers would point into the original; calls of the left-hand side are refused.
   impure elemental subroutine leave_unprepared(self, run)
      class(prepared_run), intent(inout) :: self  !! keeps its arrays: gfortran 12 reads them after run = run
      class(prepared_run), intent(in) :: run

      self%was_assigned = .true.
   end subroutine leave_unprepared

   !> Allocate the state of all paths. Errors: out_of_memory.
   subroutine new_state(self, npath, ndof, compensated, error)
      type(prepared_run), intent(inout) :: self
      integer(i8), intent(in) :: npath
      integer, intent(in) :: ndof
      logical, intent(in) :: compensated
      type(error_type), allocatable, intent(inout) :: error
      integer :: info

      call require_memory(real(npath, wp)*(merge(4, 2, compensated)*ndof + 2), 'the state of '//to_text(npath)// &
                          ' paths', 'prepare fewer paths', 'prepare', error)
      if (allocated(error)) return
      allocate (self%q(npath, ndof), self%p(npath, ndof), self%status(npath), self%failed_step(npath), stat=info)
      if (info == 0 .and. compensated) allocate (self%q_low(npath, ndof), self%p_low(npath, ndof), stat=info)
      if (info /= 0) call raise(error, out_of_memory, 'prepare', 'no memory for the state of '//to_text(npath)// &
                                ' paths: prepare fewer paths')
   end subroutine new_state

   !> Begin again from a given state, with the status of every path ok. First step, seed and first path keep their
   !> values unless given.
   subroutine reset(self, q0, p0, error, q0_low, p0_low, first_step, seed, first_path)
      class(prepared_run), intent(inout) :: self
      real(wp), intent(in) :: q0(:, :), p0(:, :)                     !! new state (npath or 1, ndof)
      type(error_type), allocatable, intent(inout) :: error
      real(wp), intent(in), target, optional :: q0_low(:, :), p0_low(:, :)  !! low parts (npath or 1, ndof), else 0
      integer(i8), intent(in), optional :: first_step, seed, first_path  !! see run_options
      type(run_options) :: wanted
      real(wp), pointer :: q_low(:, :), p_low(:, :)  !! the arguments, or null: an absent array is not passed on

      nullify (q_low, p_low)
      if (present(q0_low)) q_low => q0_low
      if (present(p0_low)) p_low => p0_low
      call self%enter('reset', error)
      if (allocated(error)) return
      wanted = self%given
      if (present(first_step)) wanted%first_step = first_step
      if (present(seed)) wanted%seed = seed
      if (present(first_path)) wanted%first_path = first_path
      call check_options(wanted, error)
      if (.not. allocated(error)) call check_state(wanted, size(self%q, 2), q0, p0, error)
      call self%restart(wanted, q0, p0, q_low, p_low, error)
      call self%leave()
   end subroutine reset

   !> Take over checked options and a checked state.
   subroutine restart(self, options, q0, p0, q_low, p_low, error)
      class(prepared_run), intent(inout) :: self
      type(run_options), intent(in) :: options
      real(wp), intent(in) :: q0(:, :), p0(:, :)                  !! (npath or 1, ndof)
      real(wp), intent(in), pointer :: q_low(:, :), p_low(:, :)   !! (npath or 1, ndof), or null
      type(error_type), allocatable, intent(inout) :: error

      call check_low(self, options, error, q_low, p_low)
      call self%ensemble%renumber(options, error)
      if (allocated(error)) return
      self%given = options
      self%goal = options%first_step
      self%was_stopped = .false.
      self%status = 0
      self%failed_step = -1
      call take_rows(self%q, q0)
      call take_rows(self%p, p0)
      if (allocated(self%q_low)) then
         call take_rows(self%q_low, q_low)
         call take_rows(self%p_low, p_low)
      end if
   end subroutine restart

   !> Take nstep more steps, with the noise of the run or with the increments dw. If `saved` is present, write into it
   !> the state at the beginning and after every save_every steps.
   subroutine advance(self, nstep, error, dw, monitor, saved, save_every)
      class(prepared_run), intent(inout) :: self
      integer(i8), intent(in) :: nstep
      type(error_type), allocatable, intent(inout) :: error
      real(wp), intent(in), target, contiguous, optional :: dw(:, :, :)  !! increments (npath or 1, nnoise, rows)
      class(monitor_type), intent(inout), optional :: monitor
      type(paths_type), intent(out), target, optional :: saved
      integer(i8), intent(in), optional :: save_every                    !! default 1
      type(path_recorder) :: recorder
      type(given_increments) :: given
      integer(i8) :: every

      if (allocated(error)) return
      if (present(dw)) given = increments_of(dw)
      every = max(1_i8, nstep)
      if (present(saved)) every = 1
      if (present(saved) .and. present(save_every)) every = save_every
      call self%begin_steps(nstep, every, error)
      if (allocated(error)) return
      if (present(saved)) then
         call new_paths(saved, self%ensemble%options, size(self%q, 2), error)
         if (.not. allocated(error)) recorder%q => saved%q
         if (.not. allocated(error)) recorder%p => saved%p
      end if
      call self%record(recorder, error, given, monitor)
      if (.not. allocated(error)) call show_state(self, saved)
   end subroutine advance

   !> Finish a call that was stopped. The caller passes the same increments dw and the array `saved` of the stopped call
   !> again.
   subroutine resume(self, error, dw, monitor, saved)
      class(prepared_run), intent(inout) :: self
      type(error_type), allocatable, intent(inout) :: error
      real(wp), intent(in), target, contiguous, optional :: dw(:, :, :)  !! increments (npath or 1, nnoise, rows)
      class(monitor_type), intent(inout), optional :: monitor
      type(paths_type), intent(inout), target, optional :: saved
      type(path_recorder) :: recorder
      type(given_increments) :: given

      if (allocated(error)) return
      if (present(dw)) given = increments_of(dw)
      call self%begin_rest(error)
      if (allocated(error)) return
      if (present(saved)) then
         if (size(saved%q, 3, i8) /= saved_count(self%ensemble%options)) &
            call raise(error, wrong_shape, 'resume', 'the saved paths have '//to_text(size(saved%q, 3))// &
                       ' times, the call that was stopped '//to_text(saved_count(self%ensemble%options))// &
                       ': give what that call saved')
         recorder%q => saved%q
         recorder%p => saved%p
      end if
      call self%record(recorder, error, given, monitor)
      if (.not. allocated(error)) call show_state(self, saved)
   end subroutine resume

   !> Begin a call that takes nstep more steps and saves after every save_every of them: afterwards self%options() are
   !> checked and those of the call. Without an error, `record` has to follow, which ends the call.
   subroutine begin_steps(self, nstep, save_every, error)
      class(prepared_run), intent(inout) :: self
      integer(i8), intent(in) :: nstep, save_every
      type(error_type), allocatable, intent(inout) :: error

      call self%enter('advance', error)
      if (allocated(error)) return
      if (self%was_stopped) then
         call raise(error, incompatible, 'advance', 'the last call was stopped on its way to step '// &
                    to_text(self%goal)//', with paths at different steps: resume or reset the run first')
      else
         self%ensemble%options%first_step = self%goal
         self%ensemble%options%nstep = nstep
         self%ensemble%options%save_every = save_every
         call check_options(self%ensemble%options, error)
      end if
      if (allocated(error)) call self%leave()
   end subroutine begin_steps

   !> Begin a call that finishes the stopped call; `record` has to follow here, too.
   subroutine begin_rest(self, error)
      class(prepared_run), intent(inout) :: self
      type(error_type), allocatable, intent(inout) :: error

      call self%enter('resume', error)
      if (allocated(error) .or. self%was_stopped) return
      call raise(error, incompatible, 'resume', 'the last call was not stopped: there is nothing to resume')
      call self%leave()
   end subroutine begin_rest

   !> Take the steps of a call that was begun, and end it. If `error` is allocated on entry, the call ends without
   !> steps.
   subroutine record(self, recorder, error, dw, monitor)
      class(prepared_run), intent(inout) :: self
      type(path_recorder), intent(inout) :: recorder   !! recorder whose q and p have room for the states, or for none
      type(error_type), allocatable, intent(inout) :: error
      type(given_increments), intent(in) :: dw
      class(monitor_type), intent(inout), optional :: monitor

      if (contracts_are_executed) call require(self%at_work == 1, 'ensemble, record', 'a call was begun')
      if (.not. allocated(error)) call self%go(recorder, error, dw, monitor)
      call self%leave()
   end subroutine record

   !> Run the ensemble from the state of the run: paths begin from self%q and self%p, and their last states are written
   !> there.
   subroutine go(self, recorder, error, dw, monitor)
      class(prepared_run), intent(inout), target :: self
      type(path_recorder), intent(inout) :: recorder
      type(error_type), allocatable, intent(inout) :: error
      type(given_increments), intent(in) :: dw         !! or none: the noise of the run
      class(monitor_type), intent(inout), optional :: monitor
      type(initial_state) :: from

      call check_own_state(self, error)
      call require_reserve('a call of a prepared run', 'advance', error)
      if (allocated(error)) return
      from%q => self%q
      from%p => self%p
      from%status => self%status
      from%failed_step => self%failed_step
      from%resumed = self%was_stopped
      recorder%last_q => self%q
      recorder%last_p => self%p
      recorder%status => self%status
      recorder%failed_step => self%failed_step
      if (allocated(self%q_low)) then
         from%q_low => self%q_low
         from%p_low => self%p_low
         recorder%q_low => self%q_low
         recorder%p_low => self%p_low
      end if
      recorder%first_path = self%ensemble%options%first_path
      call self%ensemble%drive(from, recorder, error, dw, monitor)
      if (allocated(error)) return
      self%goal = self%ensemble%options%first_step + self%ensemble%options%nstep
      self%was_stopped = self%ensemble%report%nstopped > 0
   end subroutine go

   !> Refuse (invalid_argument) a state that the caller has changed to values that are not finite. Paths that have
   !> failed may hold any values.
   subroutine check_own_state(self, error)
      class(prepared_run), intent(in) :: self
      type(error_type), allocatable, intent(inout) :: error
      integer(i8) :: path
      integer :: i

      do i = 1, size(self%q, 2)
         do path = 1, size(self%q, 1, i8)
            if (abs(self%q(path, i)) <= huge(1.0_wp) .and. abs(self%p(path, i)) <= huge(1.0_wp)) cycle
            if (.not. any(self%status(path) == [0_i4, int(stopped, i4)])) cycle
            call raise(error, invalid_argument, 'advance', 'q or p of path '// &
                       to_text(self%ensemble%options%first_path + path - 1)//' (degree of freedom '//to_text(i)// &
                       ', counted from 1) is not finite: it was changed to that, give finite numbers')
            return
         end do
      end do
   end subroutine check_own_state

   !> The absolute number of the next step; after a stopped call, of the next step once the call is resumed.
   integer(i8) function next_step(self)
      class(prepared_run), intent(in) :: self

      next_step = self%goal
   end function next_step

   !> The time t = t0 + n h at which the next step begins [time].
   real(wp) function time(self)
      class(prepared_run), intent(in) :: self

      time = self%ensemble%options%t0 + real(self%goal, wp)*self%ensemble%options%step
   end function time

   !> The options of the run, with the steps and saves of the last call.
   function options(self)
      class(prepared_run), intent(in) :: self
      type(run_options) :: options

      options = self%ensemble%options
   end function options

   !> The report of the run: counters and seconds of all calls, the outcome of the last call, and warnings computed for
   !> a million steps.
   subroutine get_report(self, report)
      class(prepared_run), intent(in) :: self
      type(run_report), intent(out) :: report

      report = self%ensemble%report
   end subroutine get_report

   !> A run serves one call at a time: a second thread is refused, and so is a callback that calls the run it belongs
   !> to.
   subroutine enter(self, place, error)
      class(prepared_run), intent(inout), target :: self
      character(*), intent(in) :: place
      type(error_type), allocatable, intent(inout) :: error
      integer :: before

      if (allocated(error)) return
      !$omp atomic capture
      before = self%at_work
      self%at_work = 1
      !$omp end atomic
      if (before /= 0) then
         call raise(error, incompatible, place, 'the prepared run is at work in another call: it serves one at a '// &
                    'time; prepare one for each thread')
      else if (self%was_assigned .or. &
               (c_associated(self%home) .and. .not. c_associated(self%home, c_loc(self%goal)))) then
         call raise(error, incompatible, place, 'the run was assigned from another one, and a prepared run points '// &
                    'to parts of itself: prepare it, or move the other one by a pointer or an allocatable')
         call self%leave()
      else if (.not. allocated(self%q)) then
         call raise(error, incompatible, place, 'the run is not prepared: call prepare first')
         call self%leave()
      end if
   end subroutine enter

   !> End the call, so that another call may begin.
   subroutine leave(self)
      class(prepared_run), intent(inout) :: self

      !$omp atomic write
      self%at_work = 0
   end subroutine leave

   !> Refuse low parts in a run without compensated summation, low parts of q without those of p or the reverse, and low
   !> parts of a wrong shape.
   subroutine check_low(self, options, error, q_low, p_low)
      class(prepared_run), intent(in) :: self
      type(run_options), intent(in) :: options
      type(error_type), allocatable, intent(inout) :: error
      real(wp), intent(in), optional :: q_low(:, :), p_low(:, :)   !! (npath or 1, ndof)

      if (.not. (present(q_low) .or. present(p_low)) .or. allocated(error)) return
      if (.not. allocated(self%q_low)) then
         call raise(error, incompatible, 'reset', 'the run was not prepared for compensated summation and has no '// &
                    'low parts: prepare it with compensated, or leave q0_low and p0_low out')
      else if (present(q_low) .and. present(p_low)) then
         call check_state(options, size(self%q, 2), q_low, p_low, error)
      else
         call raise(error, invalid_argument, 'reset', 'one of q0_low and p0_low is missing: give both, or none')
      end if
   end subroutine check_low

   !> Write into saved paths how each path ended: status, failed step and last state.
   subroutine show_state(self, saved)
      class(prepared_run), intent(in) :: self
      type(paths_type), intent(inout), optional :: saved

      if (.not. present(saved)) return
      saved%status = self%status
      saved%failed_step = self%failed_step
      saved%last_q = self%q
      saved%last_p = self%p
      if (allocated(self%q_low)) then
         saved%q_low = self%q_low
         saved%p_low = self%p_low
      end if
      saved%report = self%ensemble%report
   end subroutine show_state

   !> Copy the rows of a state, one row for all paths or one for each. Absent rows count as zero.
   pure subroutine take_rows(x, rows)
      real(wp), intent(inout) :: x(:, :)                 !! (npath, ndof)
      real(wp), intent(in), optional :: rows(:, :)       !! (npath or 1, ndof)
      integer :: i

      x = 0
      if (.not. present(rows)) return
      do i = 1, size(x, 2)
         if (size(rows, 1) == 1) then
            x(:, i) = rows(1, i)
         else
            x(:, i) = rows(:, i)
         end if
      end do
   end subroutine take_rows

end module symsde_ensemble_run_prepared
