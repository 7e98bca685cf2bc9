! SPDX-License-Identifier: BSD-3-Clause
!> Blocks on threads: the ensemble loop, and the only parallel region of the library.
!>
!> Path i is a pure function of (seed, i, model, initial state, t0, scheme, step, refine, options, build,
!> CPU type): never of threads, blocks, neighbours or the number of paths.
module symsde_ensemble_driver
   use, intrinsic :: iso_c_binding, only: c_int
   use omp_lib, only: omp_get_max_threads, omp_get_thread_num
   use symsde_base_clock, only: seconds
   use symsde_base_area_rule, only: area_rule, areas_in_law
   use symsde_base_functionals, only: functional_set, name_functionals, path_areas
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lanes_for, padded
   use symsde_base_laws, only: law_gaussian
   use symsde_base_status, only: error_type, raise, wrong_shape, invalid_argument, incompatible, stopped, &
                                 callback_failed, paths_failed, out_of_memory, too_large
   use symsde_base_text, only: to_text
   use symsde_ensemble_areas, only: choose_areas, check_area_counters
   use symsde_ensemble_block, only: block_runner, new_block_runner
   use symsde_ensemble_initial_state, only: initial_state, new_initial_state
   use symsde_ensemble_monitor, only: monitor_type
   use symsde_ensemble_observer, only: observer_type
   use symsde_ensemble_options, only: run_options, check_options
   use symsde_ensemble_report, only: run_report, describe_left_out
   use symsde_ensemble_room, only: fit_threads
   use symsde_ensemble_warnings, only: set_up_warnings
   use symsde_model_abstract, only: model_type
   use symsde_model_callback, only: callback_model
   use symsde_model_catalogue, only: is_built_in
   use symsde_model_few_lanes, only: few_lanes_model, new_few_lanes
   use symsde_model_probe, only: probe_model
   use symsde_noise_brownian, only: brownian_noise, new_brownian_noise
   use symsde_noise_prescribed, only: prescribed_noise, new_prescribed_noise
   use symsde_noise_source, only: noise_type
   use symsde_noise_truncation, only: truncation_bound, lost_variance
   use symsde_scheme_scheme, only: scheme_type
   use symsde_solve_lapack, only: blas_single_thread, blas_restore_threads
   use symsde_step_factory, only: stepper_options, new_stepper, resolve_correction
   use symsde_step_probe_flow, only: probe_flow
   use symsde_step_rescue, only: new_rescue
   use symsde_step_stepper, only: stepper_type
   implicit none
   private
   public :: run_ensemble, choose_nlane, new_noise

   integer, parameter :: chain_lanes = 32, longest_chain = 4096

   !> What the threads of one run share.
   type :: shared_state
      logical :: halted = .false.
      integer(i8) :: next = 0, finished = 0       !! blocks
      integer(i8) :: done = 0, total = 0          !! path-steps
      integer(i8) :: nfailed = 0, nstopped = 0    !! paths
   end type shared_state

   interface
      !> POSIX: rest for so many microseconds.
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
   end interface

contains

   !> Lanes of a block: the user's choice, or by the size of the system and the number of paths. Chains take
   !> 32 at least, up to 4096 masses: rows of 8 lanes cost twice as much each (10 and 20 ns a mass, AVX-512),
   !> whether or not the block fits the cache. With dense matrices that would be too much memory.
   pure integer function choose_nlane(options, model)
      type(run_options), intent(in) :: options
      class(model_type), intent(in) :: model

      choose_nlane = options%nlane
      if (choose_nlane /= 0) return
      associate (n => model%traits%ndof, b => model%traits%bandwidth)
         choose_nlane = lanes_for(n, options%npath)
         if (b >= 0 .and. 4*b < n .and. n <= longest_chain) &
            choose_nlane = max(choose_nlane, padded(int(min(int(chain_lanes, i8), max(options%npath, 1_i8)))))
      end associate
   end function choose_nlane

   !> Run all paths and show them to (copies of) the observer.
   subroutine run_ensemble(model, scheme, options, q0, p0, observer, monitor, report, error, &
                           dw, q0_low, p0_low)
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      real(wp), intent(in), target :: q0(:, :), p0(:, :)      !! initial state (npath or 1, ndof)
      class(observer_type), intent(in) :: observer    !! for blocks of choose_nlane(options, model) lanes
      class(monitor_type), intent(inout) :: monitor
      type(run_report), intent(out) :: report
      type(error_type), allocatable, intent(inout) :: error
      real(wp), intent(in), target, contiguous, optional :: dw(:, :, :)  !! increments (npath or 1, nnoise, rows)
      real(wp), intent(in), target, optional :: q0_low(:, :), p0_low(:, :)       !! low parts, to resume
      class(noise_type), allocatable, target :: noise
      type(block_runner), allocatable :: runners(:)
      type(shared_state) :: shared
      type(initial_state) :: from
      real(wp) :: start

      start = seconds()
      call check_options(options, error)
      if (.not. allocated(error)) call check_state(options, model%traits%ndof, q0, p0, error)
      if (.not. allocated(error)) call plan_run(model, scheme, options, observer, report, error)
      if (.not. (allocated(error) .or. is_built_in(model))) &
         call probe_model(model, options%t0, q0(1, :), p0(1, :), error)
      if (.not. allocated(error)) call new_noise(noise, model, options, report%lost_variance, error, dw, scheme)
      if (.not. allocated(error)) &
         call new_runners(runners, model, scheme, options, observer, noise, report, error)
      if (.not. (allocated(error) .or. is_built_in(model))) &
         call probe_flow(runners(1)%stepper, model, scheme, options%t0, options%step, q0(1, :), p0(1, :), error)
      if (allocated(error)) return
      call set_up_warnings(model, scheme, options, runners(1)%stepper%explicit, q0(1, :), p0(1, :), &
                           report%lost_variance, report%warnings)
      call model%clear_failure()
      report%seconds_setup = seconds() - start

      start = seconds()
      shared%total = options%npath*options%nstep
      call blas_single_thread()
      call new_initial_state(from, q0, p0, q0_low, p0_low)
      call run_blocks(runners, options, from, monitor, shared)
      call blas_restore_threads()
      report%seconds_run = seconds() - start
      call summarise(runners, model, shared, report)
   end subroutine run_ensemble

   !> The parallel loop over blocks.
   subroutine run_blocks(runners, options, start, monitor, shared)
      type(block_runner), intent(inout) :: runners(:)
      type(run_options), intent(in) :: options
      type(initial_state), intent(in) :: start
      class(monitor_type), intent(inout) :: monitor
      type(shared_state), intent(inout) :: shared
      integer(i8) :: iblock, nblock, nlane
      integer :: me, nreal
      logical :: halted

      nlane = runners(1)%state%nlane
      nblock = (options%npath + nlane - 1)/nlane
      !$omp parallel num_threads(size(runners)) default(none) private(me, nreal, iblock, halted) &
      !$omp shared(runners, options, start, monitor, shared, nblock, nlane)
      me = omp_get_thread_num() + 1
      do
         !$omp atomic capture
         iblock = shared%next
         shared%next = shared%next + 1
         !$omp end atomic
         if (iblock >= nblock) exit
         nreal = int(min(nlane, options%npath - iblock*nlane))
         !$omp atomic read
         halted = shared%halted
         if (halted) then
            call runners(me)%pass_over(options%first_path + iblock*nlane, nreal, start)
         else
            call runners(me)%begin(options%first_path + iblock*nlane, nreal, start)
            call run_block(runners(me), me == 1, monitor, shared)
         end if
         !$omp critical (symsde_end_block)
         call runners(me)%observer%end_block(runners(me)%state)
         shared%nstopped = shared%nstopped + count(runners(me)%state%status(:nreal) == stopped)
         shared%nfailed = shared%nfailed + count(runners(me)%state%status(:nreal) /= 0 .and. &
                                                 runners(me)%state%status(:nreal) /= stopped)
         !$omp end critical (symsde_end_block)
         !$omp atomic update
         shared%finished = shared%finished + 1
      end do
      if (me == 1) call watch(nblock, monitor, shared)
      !$omp end parallel
   end subroutine run_blocks

   !> The calling thread has no block left: until the others are done it still tells the monitor, so that a
   !> run can be stopped whichever thread works on its last block.
   subroutine watch(nblock, monitor, shared)
      integer(i8), intent(in) :: nblock
      class(monitor_type), intent(inout) :: monitor
      type(shared_state), intent(inout) :: shared
      integer(i8) :: finished, done
      integer(c_int) :: ignored
      logical :: stop_now

      do
         !$omp atomic read
         finished = shared%finished
         if (finished >= nblock) exit
         ignored = usleep(200_c_int)
         !$omp atomic read
         done = shared%done
         call monitor%ask(done, shared%total, stop_now)
         if (stop_now) then
            !$omp atomic write
            shared%halted = .true.
         end if
      end do
   end subroutine watch

   !> One block, chunk by chunk; between chunks the stop flag is read and the monitor is told.
   subroutine run_block(runner, is_caller, monitor, shared)
      type(block_runner), intent(inout) :: runner
      logical, intent(in) :: is_caller   !! this is the thread that called the library
      class(monitor_type), intent(inout) :: monitor
      type(shared_state), intent(inout) :: shared
      integer(i8) :: before, done
      logical :: stop_now

      do while (.not. runner%is_done())
         !$omp atomic read
         stop_now = shared%halted
         if (stop_now) exit
         before = runner%step
         call runner%run_chunk()
         !$omp atomic capture
         shared%done = shared%done + (runner%step - before)*runner%nreal
         done = shared%done
         !$omp end atomic
         stop_now = runner%stepper%ham%model%failure_code() /= 0 .or. runner%observer%failure_code() /= 0
         if (is_caller .and. .not. stop_now) call monitor%ask(done, shared%total, stop_now)
         if (stop_now) then
            !$omp atomic write
            shared%halted = .true.
         end if
      end do
      call runner%finish()
   end subroutine run_block

   !> Lanes of a block, and threads: as many as are asked for, have blocks to do, and find memory.
   subroutine plan_run(model, scheme, options, observer, report, error)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      class(observer_type), intent(in) :: observer
      type(run_report), intent(inout) :: report
      type(error_type), allocatable, intent(inout) :: error
      integer(i8) :: nblock
      integer :: nthread

      call choose_nthread(options, nthread, error)
      if (allocated(error)) return
      report%nlane = choose_nlane(options, model)
      nblock = (options%npath + report%nlane - 1)/report%nlane
      report%nthread = int(min(int(nthread, i8), nblock))
      call fit_threads(model, scheme, options, observer, report%nlane, report%nthread, error)
   end subroutine plan_run

   !> One runner for every thread.
   subroutine new_runners(runners, model, scheme, options, observer, noise, report, error)
      type(block_runner), allocatable, intent(out) :: runners(:)
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      class(observer_type), intent(in) :: observer
      class(noise_type), intent(in), target :: noise
      type(run_report), intent(inout) :: report
      type(error_type), allocatable, intent(inout) :: error
      class(stepper_type), allocatable :: stepper
      type(stepper_options) :: choice
      type(few_lanes_model), pointer :: few
      class(model_type), pointer :: seen
      integer :: i, info

      choice%correction = options%correction
      choice%general = options%general
      choice%newton%max_iter = options%max_iter
      choice%newton%fixed_point = options%fixed_point
      choice%as_increments = options%compensated
      call resolve_correction(report%correction, model, scheme, options%correction, error)
      if (allocated(error)) return
      allocate (runners(report%nthread), stat=info)
      if (info /= 0) then
         call raise(error, out_of_memory, 'run_ensemble', 'no memory for '//to_text(report%nthread)//' threads')
         return
      end if
      do i = 1, report%nthread
         call look_at_real_lanes(model, options%npath, report%nlane, few, seen)
         call new_stepper(stepper, seen, scheme, choice, report%nlane, error)
         if (allocated(error)) return
         if (i == 1) report%stepper = stepper%name
         call new_block_runner(runners(i), options, report%nlane, stepper, observer, noise)
         runners(i)%few => few
         call new_rescue(runners(i)%rescue, model, scheme, runners(i)%stepper, choice%newton)
      end do
      call describe_left_out(model, scheme, report%correction, runners(1)%stepper, report%left_out)
   end subroutine new_runners

   !> The model as a stepper sees it: padding is kept from functions whose lanes do not need it.
   subroutine look_at_real_lanes(model, npath, nlane, few, seen)
      class(model_type), intent(in), target :: model
      integer(i8), intent(in) :: npath
      integer, intent(in) :: nlane
      type(few_lanes_model), pointer, intent(out) :: few  !! a view to be owned by the runner, or null
      class(model_type), pointer, intent(out) :: seen

      nullify (few)
      seen => model
      if (mod(npath, int(nlane, i8)) == 0) return
      select type (model)
      type is (callback_model)
         if (.not. model%any_lanes) return
         allocate (few)
         call new_few_lanes(few, model)
         seen => few
      end select
   end subroutine look_at_real_lanes

   !> The noise source of a run: prescribed increments where they are given, else Brownian.
   !> A scheme may ask for a law and for functionals of the path; without one these are dW, Gaussian.
   subroutine new_noise(noise, model, options, lost, error, dw, scheme)
      class(noise_type), allocatable, intent(out) :: noise
      class(model_type), intent(in) :: model
      type(run_options), intent(in) :: options
      real(wp), intent(out) :: lost  !! variance of a normal lost to truncation
      type(error_type), allocatable, intent(inout) :: error
      real(wp), intent(in), target, contiguous, optional :: dw(:, :, :)
      type(scheme_type), intent(in), optional :: scheme
      type(prescribed_noise) :: prescribed
      type(brownian_noise) :: brownian
      logical, allocatable :: silent(:)
      integer(i8) :: extent(3)
      real(wp) :: cut
      type(area_rule) :: areas
      type(functional_set) :: asked
      integer :: law

      lost = 0
      law = law_gaussian
      if (present(scheme)) then
         law = scheme%law
         asked = scheme%asks%needed_for(model%traits)
         call choose_areas(model, scheme, options, asked, areas, error)
         if (.not. allocated(error)) call check_functionals(model, scheme, options, asked, areas, present(dw), error)
         if (allocated(error)) return
      end if
      if (present(dw)) then
         extent = shape(dw, i8)
         call check_increments(options, model%traits%nnoise, extent, error)
         if (allocated(error)) return
         if (.not. all(abs(dw) <= huge(dw))) then
            call raise(error, invalid_argument, 'run_ensemble', 'the prescribed increments hold values that '// &
                       'are not finite: give finite numbers only')
            return
         end if
         call new_prescribed_noise(prescribed, dw, options%first_path, options%first_step, options%refine, &
                                   options%step)
         allocate (noise, source=prescribed)
      else
         allocate (silent(model%traits%nnoise), source=.false.)
         if (allocated(model%traits%silent)) silent = model%traits%silent
         call new_brownian_noise(brownian, model%traits%nnoise, options%seed, options%step, options%refine, &
                                 silent, error, law)
         if (allocated(error)) return
         allocate (noise, source=brownian)
      end if
      noise%asked = asked
      noise%areas = areas
      if (.not. abs(options%truncation) <= 0) then
         call truncation_bound(options%step, options%truncation, options%truncation_time, cut, error)
         noise%bound = cut*sqrt(abs(options%step))
         lost = lost_variance(cut)
      end if
   end subroutine new_noise

   !> What a scheme asks for beyond increments must be there: in prescribed increments it comes from finer
   !> rows.
   subroutine check_functionals(model, scheme, options, asked, areas, prescribed, error)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      type(functional_set), intent(in) :: asked
      type(area_rule), intent(in) :: areas
      logical, intent(in) :: prescribed
      type(error_type), allocatable, intent(inout) :: error
      character(:), allocatable :: what

      if (asked%is_empty()) return
      call name_functionals(asked, what)
      if (prescribed) then
         if (asked%has(path_areas) .and. areas%kind == areas_in_law) then
            call raise(error, incompatible, 'run_ensemble', 'prescribed increments are the path, and its areas '// &
                       'follow from them: leave the choice of areas in law out')
            return
         end if
         if (options%refine >= 1) return
         call raise(error, incompatible, 'run_ensemble', 'scheme '//scheme%name//' needs '//what//' for model '// &
                    model%name//', which one prescribed increment a step does not determine: give finer rows, '// &
                    '2^refine a step with refine >= 1, or a scheme that needs increments only, such as midpoint')
      else if (asked%has(path_areas)) then
         call check_area_counters(model%traits%nnoise, options, areas, error)
      end if
   end subroutine check_functionals

   !> Prescribed increments must have one row for every (finer) step and one column for every noise.
   subroutine check_increments(options, nnoise, extent, error)
      type(run_options), intent(in) :: options
      integer, intent(in) :: nnoise
      integer(i8), intent(in) :: extent(3)
      type(error_type), allocatable, intent(inout) :: error
      integer(i8) :: rows

      if (options%refine < 0) then
         call raise(error, incompatible, 'run_ensemble', 'refine = '//to_text(options%refine)// &
                    ' needs draws of its own and cannot refine prescribed increments: give refine >= 0')
         return
      end if
      rows = options%nstep*2_i8**options%refine
      if (extent(3) /= rows .or. extent(2) /= nnoise .or. &
          (extent(1) /= 1 .and. extent(1) /= options%npath)) then
         call raise(error, wrong_shape, 'run_ensemble', 'the prescribed increments have '//to_text(extent(3))// &
                    ' rows, '//to_text(extent(2))//' noises and '//to_text(extent(1))//' paths; needed are '// &
                    to_text(rows)//' rows (steps*2^refine), '//to_text(nnoise)//' noises and '// &
                    to_text(options%npath)//' paths or one for all')
      end if
   end subroutine check_increments

   !> Initial states must be finite and have one column for every degree of freedom.
   subroutine check_state(options, ndof, q0, p0, error)
      type(run_options), intent(in) :: options
      integer, intent(in) :: ndof
      real(wp), intent(in) :: q0(:, :), p0(:, :)
      type(error_type), allocatable, intent(inout) :: error

      if (size(q0, 2) /= ndof .or. size(p0, 2) /= ndof .or. .not. fits(size(q0, 1, i8)) .or. &
          .not. fits(size(p0, 1, i8))) then
         call raise(error, wrong_shape, 'run_ensemble', 'the initial q has '//to_text(size(q0, 2))// &
                    ' degrees of freedom and '//to_text(size(q0, 1))//' paths, the initial p '// &
                    to_text(size(p0, 2))//' and '//to_text(size(p0, 1))//'; needed are '//to_text(ndof)// &
                    ' degrees of freedom and '//to_text(options%npath)//' paths or one for all')
      else if (.not. (all(abs(q0) <= huge(q0)) .and. all(abs(p0) <= huge(p0)))) then
         call raise(error, invalid_argument, 'run_ensemble', 'the initial state holds values that are not '// &
                    'finite: give finite numbers only')
      end if

   contains

      pure logical function fits(rows)
         integer(i8), intent(in) :: rows

         fits = rows == 1 .or. rows == options%npath
      end function fits

   end subroutine check_state

   !> Threads: the option, else SYMSDE_NUM_THREADS, else what OpenMP would take; one in a forked process. A variable
   !> that is set to something else than a number of threads is refused: who sets it would be surprised otherwise.
   subroutine choose_nthread(options, nthread, error)
      type(run_options), intent(in) :: options
      integer, intent(out) :: nthread
      type(error_type), allocatable, intent(inout) :: error
      integer, parameter :: most = 1024
      character(len=32) :: text
      integer :: info

      nthread = options%nthread
      if (process_is_forked() /= 0) nthread = 1
      if (nthread > 0) return
      call get_environment_variable('SYMSDE_NUM_THREADS', text, status=info)
      if (info > 0 .or. text == '') then  ! not set, or empty
         nthread = max(1, omp_get_max_threads())
         return
      end if
      text = adjustl(text)
      if (info == 0 .and. len_trim(text) <= 4 .and. verify(trim(text), '0123456789') == 0) read (text, '(i4)') nthread
      if (nthread < 1 .or. nthread > most) &
         call raise(error, invalid_argument, 'run_ensemble', 'the environment variable SYMSDE_NUM_THREADS is "'// &
                    trim(text)//'": give a whole number from 1 to '//to_text(most)//', or unset it')
   end subroutine choose_nthread

   !> Sum the counters of the threads and name the outcome.
   subroutine summarise(runners, model, shared, report)
      type(block_runner), intent(in) :: runners(:)
      class(model_type), intent(in) :: model
      type(shared_state), intent(in) :: shared
      type(run_report), intent(inout) :: report
      integer :: i

      do i = 1, size(runners)
         call runners(i)%tally(report%counters)
      end do
      report%nfailed = shared%nfailed
      report%nstopped = shared%nstopped
      if (model%failure_code() /= 0 .or. runners(1)%observer%failure_code() /= 0) then
         report%status = callback_failed
      else if (shared%nstopped > 0) then
         report%status = stopped
      else if (shared%nfailed > 0) then
         report%status = paths_failed
      end if
   end subroutine summarise

end module symsde_ensemble_driver
