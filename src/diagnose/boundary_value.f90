! SPDX-License-Identifier: BSD-3-Clause
!>    dS(x) = 0,   S = sum_m Lbar_h(m),  q_0 and q_N given;      x <- x + length d,   S''(x) d = -S'(x)
!>
!> The stochastic Hamilton principle as a tool: the path between two given positions that makes the discrete action
!> stationary, [WHSB] Theorem 2.3 and (46)-(48), on a given Brownian path. The unknowns x are the V_i, P_i, p_{m+1} and
!> q_{m+1} of all steps.
!>
!> S'' is symmetric and banded, 4 ndof (r + 1) - 1 numbers wide for r stages: the operations of a correction are
!> proportional to the number of steps times the cube of a step's unknowns. S'' is indefinite, since S is stationary and
!> not minimal; so rows are exchanged instead of a Cholesky factorisation. At a conjugate point the linearised equations
!> have a solution that vanishes at both ends, and S'' is singular.
!>
!> Newton's method on diagnose/action_system; the banded matrix is solved with row exchanges. A correction is shortened
!> until it lowers the residual; a path is done when the residual is of the size of rounding and a correction does not
!> lower it. The result is the path that the scheme itself takes from (q_0, p_0) to q_N, up to rounding times the
!> condition number of the boundary value problem. The condition number is finite, and the solution unique near the
!> guess, for times below the first conjugate point (pi for an oscillator of unit frequency); at a conjugate point the
!> status is singular. Beyond a conjugate point a path may exist that Newton does not find from a straight line
!> (not_converged): pass a guess.
module symsde_diagnose_boundary_value
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use symsde_base_contracts, only: contracts_are_executed
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_lanes, only: lane_unit, default_nlane
   use symsde_base_memory, only: require_memory
   use symsde_base_status, only: error_type, raise, invalid_argument, wrong_shape, too_large, out_of_memory, &
                                 status_ok, not_converged, nonfinite
   use symsde_base_text, only: to_text
   use symsde_diagnose_action_system, only: action_system, new_action_system
   use symsde_diagnose_contract, only: require_paths
   use symsde_diagnose_lagrangian, only: discrete_lagrangian, new_discrete_lagrangian, lagrangian_numbers
   use symsde_ensemble_run_noise, only: new_noise, refuse_not_finite
   use symsde_ensemble_run_increments, only: collect_increments
   use symsde_ensemble_monitor, only: monitor_type, stop_if_wanted
   use symsde_ensemble_options, only: run_options, check_options
   use symsde_ensemble_run_memory, only: noise_numbers
   use symsde_model_abstract, only: model_type
   use symsde_noise_given, only: given_increments, increments_of
   use symsde_noise_source, only: noise_type
   use symsde_scheme_scheme, only: scheme_type
   use symsde_solve_banded_pivoting, only: banded_factors, new_banded_factors, factor_columns
   use symsde_solve_lapack, only: blas_single_thread, blas_restore_threads
   use symsde_solve_one_system, only: solve_factored
   implicit none
   private
   public :: stationary_path

   real(wp), parameter :: rounding = 1e-12_wp        !! residual of a solved path, in units of the unknowns
   ! A path is given up when even a correction shortened to 1e-6 does not improve it.
   real(wp), parameter :: shortest = 2.0_wp**(-20)   !! shortest step, as a fraction of a full correction
   real(wp), parameter :: patience = 2e7_wp !! multiplications of a linear solve between two calls of the monitor
   character(*), parameter :: place = 'stationary_path'

   !> The state of Newton's iteration for one path.
   type :: newton_state
      logical :: running = .false.
      integer(i4) :: status = status_ok
      real(wp) :: norm = huge(1.0_wp)  !! norm of the residual at the last accepted unknowns
      real(wp) :: length = 1           !! trial correction as a fraction of the full one
      real(wp) :: rcond = 0            !! reciprocal condition of the last matrix
      real(wp), allocatable :: x(:), d(:)  !! last accepted unknowns, and their full correction (nunknown)
   end type newton_state

contains

   !> q(path, :, n+1), p(path, :, n+1), n = 0 .. nstep: the stationary path from q_start to q_end over the
   !> steps of the options (step, nstep, npath, t0, first_step, correction, max_iter; the increments are
   !> those of a run with these options, or dw). status(path): ok; singular, at a conjugate point;
   !> not_converged; nonfinite. Paths that are not ok are NaN.
   !> Errors: those of check_options; incompatible for schemes without a discrete Lagrangian of the model's
   !> Hamiltonians; wrong_shape, invalid_argument; out_of_memory; stopped, by the monitor.
   subroutine stationary_path(model, scheme, options, q_start, q_end, q, p, status, error, dw, guess_q, &
                              guess_p, rcond, monitor)
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      real(wp), intent(in) :: q_start(:, :), q_end(:, :)   !! q_0 and q_N (npath or 1, ndof)
      real(wp), intent(out) :: q(:, :, :), p(:, :, :)      !! (npath, ndof, nstep+1)
      integer(i4), intent(out) :: status(:)                !! (npath)
      type(error_type), allocatable, intent(inout) :: error
      real(wp), intent(in), target, contiguous, optional :: dw(:, :, :)  !! increments (npath or 1, nnoise, rows)
      real(wp), intent(in), target, optional :: guess_q(:, :, :)   !! default: a straight line (npath, ndof, nstep+1)
      real(wp), intent(in), target, optional :: guess_p(:, :, :)   !! default: its velocity, or 0 (npath, ndof, nstep+1)
      real(wp), intent(out), optional :: rcond(:)          !! 1/condition number, estimated (npath)
      class(monitor_type), intent(inout), optional :: monitor
      type(discrete_lagrangian) :: lagrangian
      type(action_system) :: system
      type(newton_state) :: states(lane_unit)
      class(noise_type), allocatable :: noise
      real(wp), allocatable :: w(:, :, :)
      real(wp) :: lost
      real(wp), pointer, dimension(:, :, :) :: given_q, given_p  !! the guesses, or null
      type(given_increments) :: given
      integer :: first, nreal, info

      nullify (given_q, given_p)
      if (present(dw)) given = increments_of(dw)
      if (present(guess_q)) given_q => guess_q
      if (present(guess_p)) given_p => guess_p
      ! Pointers replace the optional arrays: null means absent in the procedures below.
      call model%refuse_forces(place, 'a path that makes the action stationary', error)
      call check(model, options, q_start, q_end, q, p, status, error, given_q, given_p)
      if (present(rcond)) then
         if (size(rcond) /= size(status)) call refuse_shape('rcond', error)
      end if
      if (allocated(error)) return
      ! A step has at most 2 ndof (2 r + 1) unknowns, since noise may have its own stages.
      if (4.0_wp*model%traits%ndof*(scheme%nstage + 1)*options%nstep > huge(0)) then
         call raise(error, too_large, place, to_text(options%nstep)//' steps have more unknowns than can be '// &
                    'numbered: give fewer steps')
         return
      end if
      ! Check memory first; then set up the Lagrangian of the scheme, the noise of the run, and the equations of a
      ! block.
      call judge_memory(model, scheme, options, error)
      call new_discrete_lagrangian(lagrangian, model, scheme, options, lane_unit, error)
      if (.not. allocated(error)) call new_noise(noise, model, options, lost, error, given, scheme)
      call refuse_not_finite(given, options, error)
      if (allocated(error)) return
      call new_action_system(system, lagrangian, int(options%nstep), &
                             options%t0 + real(options%first_step, wp)*options%step, options%step, error)
      if (allocated(error)) return
      ! Draw all increments at once: an equation of step m contains increments of its neighbours, and Newton needs
      ! them many times.
      allocate (w(options%npath, noise%nnoise, options%nstep), stat=info)
      if (info /= 0) then
         call raise(error, out_of_memory, place, 'no memory for the increments of '//to_text(options%nstep)// &
                    ' steps: give fewer steps or paths')
         return
      end if
      ! Blocks of any size draw the increments of a run with these options.
      call collect_increments(noise, options, w, error, monitor)
      if (allocated(error)) return
      call blas_single_thread()
      ! A block has few paths: each path has a banded matrix, and the matrices are factored one after the other in the
      ! same array.
      do first = 1, size(q, 1), lane_unit
         nreal = min(lane_unit, size(q, 1) - first + 1)
         ! Each block loads its end points and weights, guesses the unknowns, iterates, and stores its paths.
         call load(system, first, nreal, q_start, q_end, w)
         call start_guess(system, model, first, nreal, given_q, given_p)
         call solve_block(system, options%max_iter, nreal, states, int(first - 1, i8), options%npath, error, monitor)
         if (allocated(error)) exit
         call store(system, first, nreal, states, q, p, status)
         if (present(rcond)) rcond(first:first + nreal - 1) = states(:nreal)%rcond
      end do
      call blas_restore_threads()
      if (contracts_are_executed .and. .not. allocated(error)) call require_paths(status, q, p)
   end subroutine stationary_path

   !> Check the memory of the increments of all paths, and of a block's Lagrangian, equations with their band, and
   !> Newton work.
   subroutine judge_memory(model, scheme, options, error)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      type(error_type), allocatable, intent(inout) :: error
      real(wp) :: n, m, stages, length, unknowns, numbers

      n = model%traits%ndof
      m = model%traits%nnoise
      stages = 2.0_wp*scheme%nstage   ! at most: noise may have its own stages
      length = 2*n*(stages + 1)
      unknowns = length*options%nstep
      ! Count the increments, arrays for drawing, the Lagrangian, a band with its fill (3 width + 1 wide), vectors
      ! of unknowns, and the Hessians of all stages.
      numbers = real(options%npath, wp)*m*options%nstep &
                + noise_numbers(model%traits%nnoise, scheme%asks, default_nlane) &
                + lagrangian_numbers(model, scheme, lane_unit) + 6*unknowns*length + 64*unknowns &
                + lane_unit*(3*n**2*stages + m + 1)*options%nstep
      call require_memory(numbers, 'the stationary path of '//to_text(options%nstep)//' steps of model '//model%name// &
                          ' under scheme '//scheme%name, 'give fewer steps or paths, or a smaller system', place, error)
   end subroutine judge_memory

   !> Apply Newton's method to the paths of a block; every iteration differentiates all paths at once.
   subroutine solve_block(system, max_iter, nreal, states, done, npath, error, monitor)
      type(action_system), intent(inout) :: system
      integer, intent(in) :: max_iter, nreal
      type(newton_state), intent(out) :: states(:)
      integer(i8), intent(in) :: done, npath   !! paths before the block, and all paths, for the monitor
      type(error_type), allocatable, intent(inout) :: error
      class(monitor_type), intent(inout), optional :: monitor
      integer :: iteration, lane

      ! A path that is done keeps its unknowns; it is still differentiated along with the others.
      states(:nreal)%running = .true.
      ! Iteration 0 judges the guess; every later iteration judges the trial of the iteration before.
      do iteration = 0, max_iter
         call system%differentiate()
         do lane = 1, nreal
            call stop_if_wanted(monitor, done, npath, place, error)
            if (states(lane)%running .and. .not. allocated(error)) &
               call iterate(system, lane, iteration == max_iter, states(lane), done, npath, error, monitor)
            if (allocated(error)) return
         end do
         if (.not. any(states%running)) return
      end do
   end subroutine solve_block

   !> Judge the unknowns of a path, and compute the next trial.
   subroutine iterate(system, lane, last, state, done, npath, error, monitor)
      type(action_system), intent(inout) :: system
      integer, intent(in) :: lane
      logical, intent(in) :: last     !! whether this is the last iteration
      type(newton_state), intent(inout) :: state
      integer(i8), intent(in) :: done, npath   !! paths done, and all paths, for the monitor
      type(error_type), allocatable, intent(inout) :: error
      class(monitor_type), intent(inout), optional :: monitor
      real(wp) :: norm
      logical :: better

      associate (x => system%x(:, lane), r => system%r(:, lane))
         ! Armijo's rule with factor 1/4: a correction of `length` must lower the residual by a quarter of the decrease
         ! for linear equations. The first iteration accepts any residual.
         norm = norm2(r)
         better = norm <= (1 - 0.25_wp*state%length)*state%norm
         if (.not. allocated(state%x)) better = norm <= huge(norm)
         ! Undo a trial that is no better: a shorter correction starts from the same unknowns.
         if (.not. better .and. allocated(state%x)) x = state%x
         ! Accept a better trial.
         if (better) then
            state%norm = norm
            state%x = x
            ! The equations are not finite at the guess, so the iteration cannot start.
         else if (.not. allocated(state%x)) then
            call finish(nonfinite)
            return
            ! The residual cannot be lowered and is of the size of rounding: accept these unknowns as the solution.
         else if (state%norm <= rounding*sqrt(real(size(x), wp))*maxval(abs(x))) then
            call finish(status_ok)
            return
         else
            ! The trial is neither better nor a solution: try half of the correction.
            state%length = 0.5_wp*state%length
         end if
         ! All equations hold exactly: no correction would change anything.
         if (norm <= 0) then
            call finish(status_ok)
         else if (last .or. state%length < shortest) then
            call finish(not_converged)
            if (state%norm <= rounding*sqrt(real(size(x), wp))*maxval(abs(x))) state%status = status_ok
         else
            ! Accepted unknowns get a new correction; after a rejected trial the old correction is used with its new
            ! length.
            if (better) call find_correction(system, lane, state, done, npath, error, monitor)
            if (state%running) x = state%x + state%length*state%d
         end if
      end associate

   contains

      !> End the iteration of the path with this status.
      subroutine finish(status)
         integer(i4), intent(in) :: status

         state%running = .false.
         state%status = status
      end subroutine finish

   end subroutine iterate

   !> The full correction at the last differentiated unknowns. The matrix is factored in parts, and the monitor is
   !> called between them.
   subroutine find_correction(system, lane, state, done, npath, error, monitor)
      type(action_system), intent(inout) :: system
      integer, intent(in) :: lane
      type(newton_state), intent(inout) :: state
      integer(i8), intent(in) :: done, npath   !! numbers of paths, for the monitor
      type(error_type), allocatable, intent(inout) :: error
      class(monitor_type), intent(inout), optional :: monitor
      type(banded_factors) :: factors

      !   S''(x) d = -S'(x)
      call system%fill_matrix(lane)
      ! The right side becomes the correction in place.
      state%d = -system%r(:, lane)
      state%length = 1
      call new_banded_factors(factors, system%nunknown, system%width, system%width, system%band)
      ! A matrix that is not finite does not mean a conjugate point; its status is nonfinite.
      state%status = nonfinite
      state%running = factors%norm <= huge(1.0_wp)   ! NaN and infinities show in the norm
      if (.not. state%running) return
      do while (factors%done < factors%n .and. .not. factors%is_singular)
         call stop_if_wanted(monitor, done, npath, place, error)
         if (allocated(error)) return
         call factor_columns(factors, system%band, patience)
      end do
      ! The reciprocal condition shows how far the end point is from a conjugate point, where S'' is singular.
      call solve_factored(factors, system%band, state%d, state%status, state%rcond)
      state%running = state%status == status_ok
   end subroutine find_correction

   !> Load end points and weights of the paths from `first` on; lanes beyond the last path repeat it.
   subroutine load(system, first, nreal, q_start, q_end, dw)
      type(action_system), intent(inout) :: system
      integer, intent(in) :: first, nreal
      real(wp), intent(in) :: q_start(:, :), q_end(:, :), dw(:, :, :)
      integer :: lane, path

      system%w(:, 0, :) = system%h
      do lane = 1, system%nlane
         path = first + min(lane, nreal) - 1
         ! The weights of Hhat in each step are h, dW_1 .. dW_m; end points are given once for all paths or for each.
         system%w(lane, 1:, :) = dw(path, :, :)
         system%q_start(lane, :) = q_start(min(path, size(q_start, 1)), :)
         system%q_end(lane, :) = q_end(min(path, size(q_end, 1)), :)
      end do
   end subroutine load

   !> The guess: the caller's path, or a straight line in q with its velocity as momentum if H = p.p/2 + U(q), else
   !> momentum zero.
   subroutine start_guess(system, model, first, nreal, guess_q, guess_p)
      type(action_system), intent(inout) :: system
      class(model_type), intent(in) :: model
      integer, intent(in) :: first, nreal
      real(wp), intent(in), pointer :: guess_q(:, :, :), guess_p(:, :, :)
      real(wp) :: before(system%ndof), now(system%ndof), v(system%ndof), p(system%ndof)
      integer :: lane, path, step, i, at

      associate (n => system%ndof, nstep => system%nstep)
         do lane = 1, system%nlane
            path = first + min(lane, nreal) - 1
            now = system%q_start(lane, :)
            do step = 1, nstep
               before = now
               now = before + (system%q_end(lane, :) - system%q_start(lane, :))/nstep
               ! The first position of a given guess is not used, since q_0 is known.
               if (associated(guess_q)) now = guess_q(path, :, step + 1)
               !   v = q_{m+1} - q_m,   p = v/h
               v = now - before
               p = merge(v/system%h, 0.0_wp, model%traits%identity_mass)
               if (associated(guess_p)) p = guess_p(path, :, step + 1)
               do i = 1, system%lagrangian%nstage
                  at = system%stage_at(step, i)
                  ! Along a straight line V_i is q_{m+1} - q_m; stages of the noise alone start with zero velocity.
                  system%x(at + 1:at + n, lane) = merge(v, 0.0_wp, system%lagrangian%part(i) == 1)
                  ! All stages of a step start with the momentum of the step.
                  system%x(at + n + 1:at + 2*n, lane) = p
               end do
               at = system%momentum_at(step)
               system%x(at + 1:at + n, lane) = p
               if (step < nstep) system%x(at + n + 1:at + 2*n, lane) = now
            end do
         end do
      end associate
   end subroutine start_guess

   !> Store the paths of a block in the caller's arrays.
   subroutine store(system, first, nreal, states, q, p, status)
      type(action_system), intent(inout) :: system
      integer, intent(in) :: first, nreal
      type(newton_state), intent(in) :: states(:)
      real(wp), intent(inout) :: q(:, :, :), p(:, :, :)
      integer(i4), intent(inout) :: status(:)
      real(wp) :: p0(system%nlane, system%ndof), now(system%ndof)
      integer :: lane, path, step, at

      ! Find p_0 first, from the stages of the first step. The other momenta are unknowns and are read from x.
      call system%first_momentum(p0)
      do lane = 1, nreal
         path = first + lane - 1
         status(path) = states(lane)%status
         p(path, :, 1) = p0(lane, :)
         do step = 0, system%nstep
            ! State n is stored at index n + 1; p_{m+1} is read from the end of step m.
            now = system%position(step, lane)
            q(path, :, step + 1) = now
            at = system%momentum_at(step)
            if (step > 0) p(path, :, step + 1) = system%x(at + 1:at + system%ndof, lane)
         end do
         ! Set a path that was not found to NaN, so that nobody uses it.
         if (status(path) == status_ok) cycle
         q(path, :, :) = ieee_value(0.0_wp, ieee_quiet_nan)
         p(path, :, :) = ieee_value(0.0_wp, ieee_quiet_nan)
      end do
   end subroutine store

   !> Check options, shapes and values.
   subroutine check(model, options, q_start, q_end, q, p, status, error, guess_q, guess_p)
      class(model_type), intent(in) :: model
      type(run_options), intent(in) :: options
      real(wp), intent(in) :: q_start(:, :), q_end(:, :), q(:, :, :), p(:, :, :)
      integer(i4), intent(in) :: status(:)
      type(error_type), allocatable, intent(inout) :: error
      real(wp), intent(in), pointer :: guess_q(:, :, :), guess_p(:, :, :)
      integer(i8) :: wanted(3)

      call check_options(options, error)
      if (allocated(error)) return
      if (options%nstep < 1) call raise(error, invalid_argument, place, 'steps = '//to_text(options%nstep)// &
                                        ': a path between two positions needs at least one step')
      !   (npath, ndof, nstep + 1)
      wanted(1) = options%npath
      wanted(2) = model%traits%ndof
      wanted(3) = options%nstep + 1
      if (any(shape(q, i8) /= wanted)) call refuse_shape('q', error)
      if (any(shape(p, i8) /= wanted)) call refuse_shape('p', error)
      if (size(status, kind=i8) /= options%npath) call refuse_shape('status', error)
      call check_ends('q_start', q_start)
      call check_ends('q_end', q_end)
      if (associated(guess_q)) then
         if (any(shape(guess_q, i8) /= wanted)) call refuse_shape('guess_q', error)
      end if
      if (associated(guess_p)) then
         if (any(shape(guess_p, i8) /= wanted)) call refuse_shape('guess_p', error)
      end if

   contains

      !> Check a given position: one for all paths or one for each path, and finite.
      subroutine check_ends(what, x)
         character(*), intent(in) :: what
         real(wp), intent(in) :: x(:, :)

         if (size(x, 2) /= model%traits%ndof .or. &
             (size(x, 1) /= 1 .and. size(x, 1, i8) /= options%npath)) call refuse_shape(what, error)
         if (.not. all(abs(x) <= huge(x))) call raise(error, invalid_argument, place, what// &
                                                      ' holds values that are not finite: give finite positions')
      end subroutine check_ends

   end subroutine check

   !> One message for all arrays: it lists every shape that is wanted.
   subroutine refuse_shape(what, error)
      character(*), intent(in) :: what
      type(error_type), allocatable, intent(inout) :: error

      call raise(error, wrong_shape, place, what//' has the wrong shape: needed are q_start and q_end '// &
                 '(npath or 1,ndof), q, p and guesses (npath,ndof,nstep+1), status and rcond (npath)')
   end subroutine refuse_shape

end module symsde_diagnose_boundary_value
