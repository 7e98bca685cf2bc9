! SPDX-License-Identifier: BSD-3-Clause
!> An ensemble: model, scheme and options, checked and probed, with a runner for every thread; and its drives.
!>
!>    new_ensemble: options, task of the steppers, lanes and threads, probes, noise, runners, warnings
!>    drive:        equip the runners, run_blocks (ensemble/run/threads), summarise
!>
!> Path i is a pure function of (seed, i, model, initial state, t0, scheme, step, refine, options, build,
!> CPU type): never of threads, blocks, neighbours or the number of paths.
module symsde_ensemble_run_driver
   use symsde_base_clock, only: seconds
   use symsde_base_contracts, only: contracts_are_executed
   use symsde_base_counters, only: counters_type
   use symsde_base_functionals, only: functional_set, name_functionals, path_areas, path_dz, path_stt_area
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lane_unit, lanes_for, padded
   use symsde_base_laws, only: law_gaussian
   use symsde_base_status, only: error_type, raise, status_ok, wrong_shape, invalid_argument, stopped, &
                                 callback_failed, paths_failed, out_of_memory
   use symsde_base_text, only: to_text
   use symsde_ensemble_contract, only: require_options
   use symsde_ensemble_run_areas, only: check_area_counters
   use symsde_ensemble_block_runner, only: block_runner
   use symsde_ensemble_block_single_path, only: new_single_path
   use symsde_ensemble_block_initial_state, only: initial_state
   use symsde_ensemble_monitor, only: monitor_type, tell_warnings
   use symsde_ensemble_observe_observer, only: observer_type
   use symsde_ensemble_run_probes, only: probe_declared, probe_whole_steps
   use symsde_ensemble_options, only: run_options, steppers_of
   use symsde_ensemble_block_runner_factory, only: runner_factory
   use symsde_ensemble_run_report, only: run_report, describe_left_out
   use symsde_ensemble_run_memory, only: fit_threads
   use symsde_ensemble_run_noise, only: new_noise, refuse_not_finite
   use symsde_ensemble_run_threads, only: shared_state, run_blocks, choose_nthread, usable_threads
   use symsde_ensemble_run_undeclared, only: warn_of_undeclared
   use symsde_ensemble_run_warnings, only: set_up_warnings
   use symsde_model_abstract, only: model_type
   use symsde_model_probe_friction, only: describe_friction
   use symsde_model_catalogue_by_name, only: is_built_in
   use symsde_noise_given, only: given_increments
   use symsde_noise_source, only: noise_type
   use symsde_scheme_scheme, only: scheme_type
   use symsde_solve_lapack, only: blas_single_thread, blas_restore_threads, name_lapack
   use symsde_step_task, only: resolve_task
   use symsde_step_open_kick_law, only: needed_functionals
   use symsde_step_stepper, only: stepper_type, stepper_task, most_single
   implicit none
   private
   public :: ensemble_type, new_ensemble, run_ensemble, choose_nlane, check_state

   integer, parameter :: chain_lanes = 32, longest_chain = 4096
   integer, parameter :: shortest_chain = 32  !! masses of chains whose whole steps go strip by strip

   !> Model, scheme and options, checked and probed, with a runner for every thread: ready to be driven any number of
   !> times. A drive leaves only the counters of the report for the next.
   type :: ensemble_type
      type(run_options) :: options
      type(run_report) :: report     !! totals of all drives; the outcome of the last one
      class(model_type), pointer, private :: model => null()
      class(noise_type), allocatable, private :: noise         !! noise of drives without given increments
      type(given_increments), private :: unchecked   !! those of this noise, if they are given
      type(runner_factory), private :: factory
      type(block_runner), allocatable, private :: runners(:)   !! a runner for every thread
   contains
      procedure :: drive
      procedure :: renumber
   end type ensemble_type

contains

   !> The number of lanes of a block: as the user chooses, else by the size of the system and the number of paths.
   !> Chains of up to 4096 masses get at least 32 lanes if there are so many paths: with 8 lanes a row, each lane costs
   !> twice as much (20 ns a mass instead of 10, AVX-512), whether or not the block fits the cache. With dense matrices
   !> 32 lanes would take too much memory.
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

   !> Whether a model takes whole steps of a chain, row after row of a strip of eight lanes, driven by dW, dZ and K.
   !> In blocks of one strip its states and the draws of several steps stay near: .77 to .95 of the time of wide blocks.
   !> Of shorter chains calls take a considerable part, and other functionals are drawn for many lanes together.
   pure logical function goes_by_strips(task, options) result(goes)
      type(stepper_task), intent(in) :: task
      type(run_options), intent(in) :: options
      type(functional_set) :: asked

      associate (t => task%model%traits)
         asked = needed_functionals(task%scheme, t, task%model%damping, options%damping_noise)
         goes = allocated(task%flow) .and. .not. t%has_parts .and. t%ndof >= shortest_chain .and. &
                options%refine == 0 .and. options%truncation <= 0 .and. &
                task%scheme%law == law_gaussian .and. &
                count(asked%has) == count(asked%has([path_dz, path_stt_area]))
      end associate
   end function goes_by_strips

   !> Run all paths and show them to (copies of) the observer: an ensemble driven once.
   subroutine run_ensemble(model, scheme, options, from, observer, report, error, dw, monitor)
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in), target :: scheme
      type(run_options), intent(in) :: options        !! checked
      type(initial_state), intent(in) :: from
      class(observer_type), intent(in) :: observer    !! observer for blocks of choose_nlane(options, model) lanes
      type(run_report), intent(out) :: report
      type(error_type), allocatable, intent(inout) :: error
      type(given_increments), intent(in) :: dw        !! increments, or none
      class(monitor_type), intent(inout), optional :: monitor
      type(ensemble_type), target :: ensemble

      call new_ensemble(ensemble, model, scheme, options, from%q, from%p, observer, error, dw)
      if (allocated(error)) return
      if (present(monitor)) call tell_warnings(monitor, ensemble%report%warnings, error)
      if (allocated(error)) return
      call ensemble%drive(from, observer, error, given_increments(), monitor)
      report = ensemble%report
   end subroutine run_ensemble

   !> Check, probe and choose everything that is the same for all drives of the ensemble, and make its runners. Given
   !> increments are those of drives without their own: their numbers are checked when they are read.
   subroutine new_ensemble(self, model, scheme, options, q0, p0, observer, error, dw)
      type(ensemble_type), intent(out), target :: self
      class(model_type), intent(in), target :: model          !! must live as long as the ensemble
      type(scheme_type), intent(in), target :: scheme         !! must live as long as the ensemble
      type(run_options), intent(in) :: options        !! checked
      real(wp), intent(in) :: q0(:, :), p0(:, :)      !! initial state (npath or 1, ndof)
      class(observer_type), intent(in) :: observer    !! observer of the same kind as the observers of the drives
      type(error_type), allocatable, intent(inout) :: error
      type(given_increments), intent(in), optional :: dw
      class(stepper_type), allocatable :: single  ! stepper of one lane, if paths run one by one
      real(wp) :: start

      start = seconds()
      if (contracts_are_executed) call require_options(options, 'ensemble, new')
      self%model => model
      self%options = options
      call check_state(options, model%traits%ndof, q0, p0, error)
      if (model%traits%npath /= 0 .and. model%traits%npath*options%row_paths /= options%npath) &
         call raise(error, wrong_shape, 'run_ensemble', 'model '//model%name//' has parameters for '// &
                    to_text(model%traits%npath*options%row_paths)//' paths, and the run has '// &
                    to_text(options%npath)//': give parameters for each path, or one for all')
      if (.not. allocated(error)) call resolve_task(self%factory%task, model, scheme, steppers_of(options), error)
      if (.not. allocated(error)) call plan_run(self, observer, single, error)
      call probe_declared(model, options%t0, q0(1, :), p0(1, :), error)
      call observer%probe(options%t0, q0(1, :), p0(1, :), error)
      if (allocated(error)) return
      if (present(dw)) self%unchecked = dw
      call new_noise(self%noise, model, options, self%report%lost_variance, error, self%unchecked, scheme)
      if (.not. allocated(error)) call new_runners(self, scheme, single, error)
      if (allocated(error)) return
      if (.not. model%damping%acts()) &
         call describe_friction(model, options%t0, options%t0 + options%step*merge(1, 0, options%nstep > 0), q0(1, :), &
                                p0(1, :), self%report%damping)
      call probe_whole_steps(self%runners(1)%stepper, model, scheme, options%t0, options%step, q0(1, :), p0(1, :), &
                             error)
      if (allocated(error)) return
      self%options%area_time = self%noise%areas%time
      call set_up_warnings(model, merge(1, 8, has_any_lanes(model)), scheme, options, &
                           self%runners(1)%stepper%explicit, q0(1, :), p0(1, :), &
                           self%report%lost_variance, self%report%warnings)
      call warn_of_undeclared(self%report%warnings, model, self%factory%task, self%runners(1)%stepper%explicit, &
                              options%nstep*((options%npath - 1)/self%report%nlane + 1), options%t0, q0(1, :), p0(1, :))
      call observer%add_warnings(self%report%warnings)
      self%report%seconds_setup = seconds() - start
   end subroutine new_ensemble

   !> Take all paths through the steps of self%options. The number of steps, the first step and the saves may have
   !> changed since the ensemble was made. Given increments are for this drive alone, and checked before it.
   !>
   !> Increments that were given before the first drive are checked as blocks read them, and a number that is not finite
   !> stops the drive. Blocks whose paths have ended do not read on; so a drive that took fewer steps checks all numbers
   !> again: what is refused depends on no block.
   subroutine drive(self, from, observer, error, dw, monitor)
      class(ensemble_type), intent(inout), target :: self
      type(initial_state), intent(in) :: from
      class(observer_type), intent(in) :: observer    !! observer for blocks of self%report%nlane lanes
      type(error_type), allocatable, intent(inout) :: error
      type(given_increments), intent(in) :: dw        !! increments of this drive alone, or none
      class(monitor_type), intent(inout), optional :: monitor
      type(monitor_type) :: no_monitor
      class(noise_type), allocatable, target :: given
      class(noise_type), pointer :: noise
      type(shared_state) :: shared
      real(wp) :: start, lost
      integer :: nthread, i

      if (allocated(error)) return
      if (contracts_are_executed) call require_options(self%options, 'ensemble, drive')
      if (dw%exist()) then
         call new_noise(given, self%model, self%options, lost, error, dw, self%factory%task%scheme)
         call refuse_not_finite(dw, self%options, error)
         noise => given
      else
         noise => self%noise
         if (noise%asked%has(path_areas)) &
            call check_area_counters(self%model%traits%nnoise, self%factory%task%scheme%law, self%options, &
                                     noise%areas, error)
      end if
      if (allocated(error)) return
      start = seconds()
      nthread = usable_threads(size(self%runners), real(self%model%traits%ndof, wp)*self%options%npath* &
                               self%options%nstep)
      do i = 1, nthread
         call self%runners(i)%equip(self%options, observer, noise)
      end do
      call self%model%clear_failure()
      shared%total = self%options%npath*self%options%nstep
      call blas_single_thread()
      if (present(monitor)) then
         call run_blocks(self%runners(:nthread), self%factory, self%options, from, monitor, shared)
      else
         call run_blocks(self%runners(:nthread), self%factory, self%options, from, no_monitor, shared)
      end if
      call blas_restore_threads()
      self%report%seconds_run = self%report%seconds_run + (seconds() - start)
      call summarise(self, shared)
      if (self%unchecked%exist() .and. .not. dw%exist() .and. self%report%counters%steps < shared%total) &
         call refuse_not_finite(self%unchecked, self%options, error)
   end subroutine drive

   !> Use another first path, first step and seed in later drives. Another seed needs another source of noise.
   subroutine renumber(self, options, error)
      class(ensemble_type), intent(inout) :: self
      type(run_options), intent(in) :: options     !! checked; equal to its own except for these and the steps
      type(error_type), allocatable, intent(inout) :: error
      integer(i8) :: seed

      if (allocated(error)) return
      seed = self%options%seed
      self%options%first_path = options%first_path
      self%options%first_step = options%first_step
      self%options%seed = options%seed
      if (options%seed /= seed) &
         call new_noise(self%noise, self%model, self%options, self%report%lost_variance, error, &
                        scheme=self%factory%task%scheme)
   end subroutine renumber

   !> Choose the lanes of a block (one, if paths are so few that they run one by one) and the number of threads: at
   !> most the number asked for, the number of blocks, and the number that memory allows.
   subroutine plan_run(self, observer, single, error)
      type(ensemble_type), intent(inout) :: self
      class(observer_type), intent(in) :: observer
      class(stepper_type), allocatable, intent(out) :: single
      type(error_type), allocatable, intent(inout) :: error
      integer :: nthread, nlane

      call choose_nthread(self%options, nthread, error)
      if (allocated(error)) return
      if (self%options%npath <= most_single .and. has_any_lanes(self%model)) then
         call fit(1)
         if (.not. allocated(error)) call new_single_path(single, self%factory%task, self%model, &
                                                          self%options%npath, error)
      end if
      nlane = choose_nlane(self%options, self%model)
      if (self%options%nlane == 0 .and. goes_by_strips(self%factory%task, self%options)) &
         nlane = min(nlane, lane_unit)
      if (.not. allocated(single)) call fit(nlane)

   contains

      !> Set the number of lanes of a block, and take as many threads as there are blocks, if they fit into memory.
      subroutine fit(nlane)
         integer, intent(in) :: nlane

         if (allocated(error)) return
         associate (report => self%report)
            report%nlane = nlane
            report%nthread = int(min(int(nthread, i8), (self%options%npath + nlane - 1)/nlane))
            call fit_threads(self%factory%task, self%options, observer, nlane, report%nthread, self%factory%narrows, &
                             error)
            self%factory%narrows = self%factory%narrows .and. .not. observer%keeps_steps()
         end associate
      end subroutine fit

   end subroutine plan_run

   !> Make one runner for every thread, and report the stepper and the terms that it leaves out.
   subroutine new_runners(self, scheme, single, error)
      type(ensemble_type), intent(inout), target :: self
      type(scheme_type), intent(in) :: scheme   !! scheme as the user named it
      class(stepper_type), allocatable, intent(inout) :: single  !! moved into the first runner, if allocated
      type(error_type), allocatable, intent(inout) :: error
      logical :: has_padding
      integer :: i, n, info

      associate (report => self%report, model => self%model)
         self%factory%options = self%options
         self%factory%asked = self%noise%asked
         report%correction = self%factory%task%correction
         ! only threads that have work get a runner
         n = usable_threads(report%nthread, real(model%traits%ndof, wp)*self%options%npath*self%options%nstep)
         allocate (self%runners(n), stat=info)
         if (info /= 0) then
            call raise(error, out_of_memory, 'new_runners', 'no memory for '//to_text(report%nthread)//' threads')
            return
         end if
         has_padding = mod(self%options%npath, int(report%nlane, i8)) > 0
         do i = 1, n
            call self%factory%new_runner(self%runners(i), report%nlane, has_padding, error, single)
            if (allocated(error)) return
         end do
         report%stepper = self%runners(1)%stepper%name
         call describe_left_out(model, scheme, report%correction, self%runners(1)%stepper, report%left_out)
         call model%damping%describe(model%traits, scheme%symplectic, report%damping)
         call name_functionals(self%noise%asked, report%functionals)
      end associate
   end subroutine new_runners

   !> Whether a lane has the same bits whatever the number of lanes. True for models of the catalogue, and for models
   !> declared so by users.
   pure logical function has_any_lanes(model)
      class(model_type), intent(in) :: model

      has_any_lanes = (is_built_in(model) .and. .not. model%calls_users()) .or. model%traits%any_lanes
   end function has_any_lanes

   !> Refuse initial states that are not finite (invalid_argument), or do not have one column for every degree of
   !> freedom and one row, or one for every path (wrong_shape).
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

   !> Sum the counters of the threads and set the outcome. A failed callback takes precedence over a stop, since it
   !> causes the stop, and a stop over failed paths.
   subroutine summarise(self, shared)
      type(ensemble_type), intent(inout) :: self
      type(shared_state), intent(in) :: shared
      integer :: i

      associate (report => self%report)
         report%counters = counters_type()
         do i = 1, size(self%runners)
            call self%runners(i)%tally(report%counters)
         end do
         if (report%counters%lapack_solves > 0) call name_lapack(report%lapack)
         report%nfailed = shared%nfailed
         report%nstopped = shared%nstopped
         report%ngrown = shared%ngrown
         report%status = status_ok
         if (self%model%failure_code() /= 0 .or. self%runners(1)%observer%failure_code() /= 0) then
            report%status = callback_failed
         else if (shared%nstopped > 0) then
            report%status = stopped
         else if (shared%nfailed > 0) then
            report%status = paths_failed
         end if
      end associate
   end subroutine summarise

end module symsde_ensemble_run_driver
