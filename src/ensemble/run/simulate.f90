! SPDX-License-Identifier: BSD-3-Clause
!> The two runs of a user: simulate saves paths, moments keeps statistics only.
module symsde_ensemble_run_simulate
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_laws, only: law_gaussian
   use symsde_base_memory, only: require_memory
   use symsde_base_status, only: error_type, raise, too_large, out_of_memory, invalid_argument
   use symsde_base_text, only: to_text
   use symsde_ensemble_block_initial_state, only: initial_state
   use symsde_ensemble_run_driver, only: run_ensemble, choose_nlane
   use symsde_ensemble_observe_moment_collector, only: moment_collector, new_moment_collector, moment_store
   use symsde_ensemble_monitor, only: monitor_type
   use symsde_ensemble_observe_observables, only: observables_type
   use symsde_ensemble_observe_observer_plan, only: observer_plan, new_observer_plan
   use symsde_ensemble_observe_observers, only: new_observed_run, of_group_means
   use symsde_ensemble_options, only: run_options, check_options, saved_count
   use symsde_ensemble_observe_recorder, only: path_recorder
   use symsde_ensemble_run_report, only: run_report
   use symsde_ensemble_statistics_merge, only: moment_errors
   use symsde_ensemble_statistics_path_tree, only: moment_node, final_node
   use symsde_ensemble_observe_streaming, only: observer_request, observed_type, observed_run
   use symsde_model_abstract, only: model_type
   use symsde_noise_given, only: given_increments, increments_of
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: paths_type, moments_type, simulate, moments, collect_moments, new_paths, fill_times, begin_at

   !> Saved paths. Values of a path after its failure are NaN; last_q and last_p hold its last good state.
   type :: paths_type
      real(wp), allocatable :: t(:)                 !! saved times; the first is before the first step (ntime)
      real(wp), allocatable :: q(:, :, :)           !! (npath, ndof, ntime)
      real(wp), allocatable :: p(:, :, :)           !! (npath, ndof, ntime)
      integer(i4), allocatable :: status(:)         !! 0 = ok, else a code of base/status (npath)
      integer(i8), allocatable :: failed_step(:)    !! absolute step that failed, -1 = none (npath)
      real(wp), allocatable :: last_q(:, :), last_p(:, :)  !! last good state (npath, ndof)
      real(wp), allocatable :: q_low(:, :), p_low(:, :)    !! low parts of last_q, last_p, else zero (npath, ndof)
      type(run_report) :: report
   end type paths_type

   !> Moments over the paths that are ok up to each time. The values are q_1 .. q_n, p_1 .. p_n, the energy if
   !> has_energy, then the user's observables.
   type :: moments_type
      real(wp), allocatable :: t(:)                 !! (ntime)
      integer(i8), allocatable :: n_ok(:)           !! paths that are ok up to each time (ntime)
      real(wp), allocatable :: mean(:, :)           !! (nvalue, ntime)
      real(wp), allocatable :: variance(:, :)       !! unbiased; NaN for fewer than two paths (nvalue, ntime)
      real(wp), allocatable :: se_mean(:, :)        !! standard error of the mean (nvalue, ntime)
      real(wp), allocatable :: m2(:, :)             !! sums of squared deviations, needed to merge parts (nvalue, ntime)
      logical :: has_energy = .false.
      integer(i8), allocatable :: failed(:)         !! global indices of the first failed paths, at most 1000
      integer(i4), allocatable :: failed_status(:)
      integer(i8), allocatable :: failed_step(:)
      type(observed_type), allocatable :: observed(:)  !! results of the observers, in the order of their requests
      type(run_report) :: report
   end type moments_type

contains

   !> Integrate all paths and save them every options%save_every steps.
   subroutine simulate(model, scheme, options, q0, p0, run, error, dw, monitor, q0_low, p0_low)
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      real(wp), intent(in), target :: q0(:), p0(:)  !! initial state of all paths (ndof), or (npath*ndof) path first
      type(paths_type), intent(out), target :: run
      type(error_type), allocatable, intent(inout) :: error
      real(wp), intent(in), target, contiguous, optional :: dw(:, :, :)  !! increments (npath or 1, nnoise, rows)
      class(monitor_type), intent(inout), optional :: monitor
      real(wp), intent(in), target, optional :: q0_low(:, :), p0_low(:, :)  !! low parts, to resume (npath, ndof)
      type(path_recorder) :: recorder
      type(given_increments) :: given
      type(initial_state) :: from

      if (allocated(error)) return
      if (present(dw)) given = increments_of(dw)
      call check_options(options, error)
      if (.not. allocated(error)) call new_paths(run, options, model%traits%ndof, error)
      if (allocated(error)) return
      call begin_at(from, model%traits%ndof, q0, p0, q0_low, p0_low)
      recorder%first_path = options%first_path
      recorder%q => run%q
      recorder%p => run%p
      recorder%status => run%status
      recorder%failed_step => run%failed_step
      recorder%last_q => run%last_q
      recorder%last_p => run%last_p
      recorder%q_low => run%q_low
      recorder%p_low => run%p_low
      call run_ensemble(model, scheme, options, from, recorder, run%report, error, given, monitor)
   end subroutine simulate

   !> Integrate all paths and keep only moments and results of observers; memory grows with the number of saved times,
   !> not of paths.
   subroutine moments(model, scheme, options, q0, p0, result, error, observables, dw, monitor, q0_low, p0_low, &
                      observers)
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      real(wp), intent(in), target :: q0(:), p0(:)  !! initial state of all paths (ndof), or (npath*ndof) path first
      type(moments_type), intent(out) :: result
      type(error_type), allocatable, intent(inout) :: error
      class(observables_type), intent(in), target, optional :: observables
      real(wp), intent(in), target, contiguous, optional :: dw(:, :, :)
      class(monitor_type), intent(inout), optional :: monitor
      real(wp), intent(in), target, optional :: q0_low(:, :), p0_low(:, :)  !! low parts, to resume (npath, ndof)
      type(observer_request), intent(in), target, optional :: observers(:)
      type(observer_request), target :: none(0)
      type(observer_request), pointer :: wanted(:)
      type(given_increments) :: given
      type(initial_state) :: from

      if (allocated(error)) return
      if (present(dw)) given = increments_of(dw)
      wanted => none
      if (present(observers)) wanted => observers
      call check_options(options, error)
      if (allocated(error)) return
      call begin_at(from, model%traits%ndof, q0, p0, q0_low, p0_low)
      call collect_moments(model, scheme, options, from, result, error, wanted, observables, given, monitor)
   end subroutine moments

   !> `moments` of checked options, from an initial state.
   subroutine collect_moments(model, scheme, options, from, result, error, observers, observables, dw, monitor, &
                              recorder)
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      type(initial_state), intent(in) :: from
      type(moments_type), intent(out) :: result
      type(error_type), allocatable, intent(inout) :: error
      type(observer_request), intent(in) :: observers(:)
      class(observables_type), intent(in), target, optional :: observables
      type(given_increments), intent(in) :: dw
      class(monitor_type), intent(inout), optional :: monitor
      type(path_recorder), intent(in), optional :: recorder  !! saves paths, or their last states, beside
      type(moment_store), allocatable, target :: store
      type(observer_plan), target :: plan
      type(moment_collector) :: collector
      type(moment_node) :: root
      type(run_options) :: shown

      call check_shard(options, observers, error)
      if (.not. allocated(error)) call new_moments(result, model, options, error, observables)
      if (allocated(error)) return
      allocate (store)
      call plan_observers(plan, model, merge(law_gaussian, scheme%law, dw%exist()), options, observers, error, &
                          observables)
      if (allocated(error)) return
      call new_moment_collector(collector, model, choose_nlane(options, model), size(result%t), store, observables, &
                                plan, options%save_every, recorder)
      shown = options
      if (plan%watches_steps) shown%save_every = 1
      call run_ensemble(model, scheme, shown, from, collector, result%report, error, dw, monitor)
      if (allocated(error)) return
      call plan%deliver(result%observed)
      call final_node(store%tree, root)
      call to_moments(root, result)
      result%failed = store%failed(:store%nlisted)
      result%failed_status = store%status(:store%nlisted)
      result%failed_step = store%failed_step(:store%nlisted)
   end subroutine collect_moments

   !> Plan the work of the requested observers, if there are any.
   subroutine plan_observers(plan, model, law, options, observers, error, observables)
      type(observer_plan), intent(out) :: plan
      class(model_type), intent(in), target :: model
      integer, intent(in) :: law               !! law of the drawn increments
      type(run_options), intent(in) :: options
      type(observer_request), intent(in) :: observers(:)
      type(error_type), allocatable, intent(inout) :: error
      class(observables_type), intent(in), target, optional :: observables
      type(observed_run) :: run
      integer :: nobservable

      nobservable = 0
      if (present(observables)) nobservable = observables%nvalue
      call new_observed_run(run, model, options, choose_nlane(options, model), nobservable)
      if (present(observables)) run%observables => observables
      run%law = law
      call new_observer_plan(plan, observers, run, error)
   end subroutine plan_observers

   !> Refuse (invalid_argument) shards of moments that do not begin at a multiple of 256: such shards could not be
   !> merged into the tree of a whole run. Where means of groups are asked for, each group has a tree of its own.
   subroutine check_shard(options, observers, error)
      type(run_options), intent(in) :: options
      type(observer_request), intent(in) :: observers(:)
      type(error_type), allocatable, intent(inout) :: error

      if (mod(options%first_path, 256_i8) /= 0 .and. .not. any(of_group_means(observers))) then
         call raise(error, invalid_argument, 'moments', 'first_path = '//to_text(options%first_path)// &
                    ' does not begin a shard: moments need a multiple of 256')
      end if
   end subroutine check_shard

   !> Allocate the moments. Sizes that overflow and missing memory are refused.
   subroutine new_moments(result, model, options, error, observables)
      type(moments_type), intent(inout) :: result
      class(model_type), intent(in) :: model
      type(run_options), intent(in) :: options
      type(error_type), allocatable, intent(inout) :: error
      class(observables_type), intent(in), optional :: observables
      integer(i8) :: ntime, nvalue
      integer :: info

      ntime = saved_count(options)
      result%has_energy = model%traits%has_value
      nvalue = 2*model%traits%ndof + merge(1, 0, result%has_energy)
      if (present(observables)) nvalue = nvalue + observables%nvalue
      call require_memory((3.0_wp*nvalue + 1)*ntime, 'a result of '//to_text(nvalue)//' moments at '//to_text(ntime)// &
                          ' times', 'save less often (save_every), or free some', 'moments', error)
      if (allocated(error)) return
      info = 1
      if (ntime < huge(0)) allocate (result%t(ntime), result%mean(nvalue, ntime), result%variance(nvalue, ntime), &
                                     result%se_mean(nvalue, ntime), stat=info)
      if (info /= 0) then
         call raise(error, out_of_memory, 'moments', 'no memory for the moments of '//to_text(nvalue)// &
                    ' values at '//to_text(ntime)//' times, '//to_text(24.0_wp*nvalue*ntime)// &
                    ' bytes: save less often (save_every)')
         return
      end if
      call fill_times(options, ntime, result%t)
   end subroutine new_moments

   !> Compute mean, variance and standard error from counts, means and sums of squares. The sums are moved to the
   !> result.
   subroutine to_moments(root, result)
      type(moment_node), intent(inout) :: root      !! empty afterwards
      type(moments_type), intent(inout) :: result

      result%n_ok = int(root%n, i8)
      call move_alloc(root%mean, result%mean)
      call move_alloc(root%m2, result%m2)
      call moment_errors(result%n_ok, result%mean, result%m2, result%variance, result%se_mean)
   end subroutine to_moments

   !> Times t_n = t0 + n h of the saved points; the first is the time before the first step of the run.
   pure subroutine fill_times(options, ntime, t)
      type(run_options), intent(in) :: options
      integer(i8), intent(in) :: ntime
      real(wp), intent(out) :: t(ntime)
      integer(i8) :: i

      associate (t0 => options%t0, first => options%first_step, every => options%save_every, h => options%step)
         do i = 1, ntime
            t(i) = t0 + real(first + (i - 1)*every, wp)*h
         end do
      end associate
   end subroutine fill_times

   !> Allocate the saved paths. Sizes that overflow and missing memory are refused.
   subroutine new_paths(run, options, ndof, error)
      type(paths_type), intent(out) :: run
      type(run_options), intent(in) :: options
      integer, intent(in) :: ndof
      type(error_type), allocatable, intent(inout) :: error
      integer(i8) :: ntime
      real(wp) :: bytes
      integer :: info

      ntime = saved_count(options)
      bytes = 16.0_wp*real(options%npath, wp)*ndof*real(ntime, wp)
      if (bytes > 2.0_wp**62) then
         call raise(error, too_large, 'simulate', to_text(options%npath)//' paths, '//to_text(ndof)// &
                    ' degrees of freedom and '//to_text(ntime)//' saved times need '//to_text(bytes)// &
                    ' bytes: save less often (save_every), fewer paths, or use moments')
         return
      end if
      call require_memory(bytes/8 + ntime, 'a result of '//to_text(options%npath)//' paths at '//to_text(ntime)// &
                          ' times', 'save less often (save_every), fewer paths, or use moments', 'simulate', error)
      if (allocated(error)) return
      allocate (run%q(options%npath, ndof, ntime), run%p(options%npath, ndof, ntime), &
                run%status(options%npath), run%failed_step(options%npath), &
                run%last_q(options%npath, ndof), run%last_p(options%npath, ndof), stat=info)
      if (info == 0) allocate (run%q_low(options%npath, ndof), run%p_low(options%npath, ndof), &
                               source=0.0_wp, stat=info)
      if (info == 0) allocate (run%t(ntime), stat=info)
      if (info /= 0) then
         call raise(error, out_of_memory, 'simulate', 'no memory for '//to_text(bytes)//' bytes of saved paths: '// &
                    'save less often (save_every), fewer paths, or use moments')
         return
      end if
      call fill_times(options, ntime, run%t)
   end subroutine new_paths

   !> Set the initial state of a run to the caller's arrays.
   subroutine begin_at(from, ndof, q0, p0, q0_low, p0_low)
      type(initial_state), intent(out) :: from
      integer, intent(in) :: ndof
      real(wp), intent(in), target :: q0(:), p0(:)
      real(wp), intent(in), target, optional :: q0_low(:, :), p0_low(:, :)

      call view_rows(q0, ndof, from%q)
      call view_rows(p0, ndof, from%p)
      if (present(q0_low)) from%q_low => q0_low
      if (present(p0_low)) from%p_low => p0_low
   end subroutine begin_at

   !> View an initial state as (npath or 1, ndof). A size that is no multiple of ndof is left for the check of shapes
   !> to refuse.
   subroutine view_rows(x, ndof, rows)
      real(wp), intent(in), target :: x(:)
      integer, intent(in) :: ndof
      real(wp), pointer, intent(out) :: rows(:, :)
      integer(i8) :: n

      n = ndof
      if (mod(size(x, kind=i8), n) /= 0 .or. size(x) == 0) n = size(x, kind=i8)
      rows(1:size(x, kind=i8)/max(n, 1_i8), 1:n) => x
   end subroutine view_rows

end module symsde_ensemble_run_simulate
