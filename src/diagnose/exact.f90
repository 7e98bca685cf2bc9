! SPDX-License-Identifier: BSD-3-Clause
!> Exact solutions along the Brownian path that drives a run, for models with a known solution.
!>
!>    kubo                  rotation by theta = a t + sigma W(t):
!>                          q = q0 cos theta + p0 sin theta,  p = p0 cos theta - q0 sin theta
!>    linear_oscillator,    Y_{k+1} = F Y_k + u_k, Y = (q,p), F = (cos h, sin h; -sin h, cos h),
!>    additive_oscillator   u_k = sigma (C_1; -S_1) + gamma (S_2; C_2)         (after [WHSB] (92))
!>
!>    quadratic models      whose flows commute: the flow of t H + sum_k W_k(t) H_k (diagnose/linear_flow); or with
!>                          constant noise, step by step (diagnose/linear_steps); damped by rates or a matrix, too
!>
!> with C_k = int cos(h - s) dW_k(s) and S_k = int sin(h - s) dW_k(s) over the step: sigma moves q, gamma moves p.
!>
!> The recursion is the variation of constants. Let A = (0, 1; -1, 0), F = exp(A h), and let b_k be the constant vector
!> in dY = .. + b_k dW_k:
!>
!>    dY = A Y dt + sum_k b_k dW_k,      Y_{k+1} = F Y_k + sum_k int exp(A (h - s)) b_k dW_k(s),
!>    exp(A s) = (cos s, sin s; -sin s, cos s),      b = (to_q, to_p):  int = to_q (C; -S) + to_p (S; C)
!>
!> Given dW_k the integrals C_k and S_k are not determined by the increments: their deviation from the conditional mean
!> has the size h^(3/2), and is normal with a known covariance. A reference that used the mean instead would have an
!> error as large as the schemes it is to judge.
!>
!> W(t) is the sum of the run's increments. (C_k, S_k) are drawn from their law given the quantities dW_k, H_k = dZ_k/h
!> - dW_k/2 and K_k of the run; this takes two more normals for each step and noise (noise/oscillator_law). The solution
!> has the exact law jointly with the increments, and with dZ or K if the scheme uses them. A scheme that does not use
!> H_k and K_k gets the same solution as a scheme that does. With refine = l > 0 the recursion runs on the finer draws,
!> so that the path is the same for (step, l) and (step/2, l-1), and for all schemes. With refine < 0 the halving of a
!> step depends on all that the scheme draws, so that the path depends on the scheme. Truncation is not applied: the
!> solution follows the Brownian path itself. Prescribed increments are used as given; if the scheme uses dZ, then dZ of
!> the polygon through them, as in the run.
module symsde_diagnose_exact
   use symsde_base_functionals, only: path_dz, path_stt_area, path_decay
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lanes_for, path_of_lane
   use symsde_base_laws, only: law_gaussian, law_text
   use symsde_base_record, only: step_store, step_request, new_step_store
   use symsde_base_status, only: error_type, raise, wrong_shape, missing_operation, incompatible
   use symsde_base_text, only: to_text
   use symsde_diagnose_linear_flow, only: linear_flow, new_linear_flow
   use symsde_diagnose_linear_steps, only: linear_steps, new_linear_steps
   use symsde_ensemble_run_noise, only: new_noise, refuse_not_finite
   use symsde_ensemble_monitor, only: monitor_type, stop_if_wanted
   use symsde_ensemble_options, only: run_options, noise_path, check_options, saved_count
   use symsde_model_abstract, only: model_type
   use symsde_model_catalogue_additive_oscillator, only: additive_oscillator_model
   use symsde_model_catalogue_kubo, only: kubo_model
   use symsde_model_catalogue_linear_oscillator, only: linear_oscillator_model
   use symsde_noise_brownian, only: max_refine
   use symsde_noise_given, only: given_increments, increments_of
   use symsde_noise_integral_draws, only: shape_draws
   use symsde_noise_oscillator_law, only: oscillator_integrals, oscillator_draws
   use symsde_noise_source, only: noise_type
   use symsde_scheme_scheme, only: scheme_type
   use symsde_step_open_kick_law, only: needed_functionals
   implicit none
   private
   public :: exact_solution

   !> The common form of the three models: dq = a p dt + .., dp = -a q dt + ..
   type :: oscillator
      logical :: additive = .false.
      real(wp) :: a = 0                        !! angular velocity [1/time]
      real(wp) :: sigma = 0                    !! kubo: noise of the angular velocity
      real(wp), allocatable :: to_q(:), to_p(:)  !! additive: dW_k in dq and in dp (nnoise)
      type(linear_flow), allocatable :: flow   !! flow of a quadratic model whose flows commute
      type(linear_steps), allocatable :: steps !! of a quadratic model with constant noise
   end type oscillator

   !> State of one block of paths.
   type :: exact_block
      integer :: nlane = 0, nreal = 0
      integer(i8) :: first = 0                 !! first path of the block, from 0
      type(step_request) :: request            !! request for a pair of steps
      type(step_store) :: store                !! increments that were filled in
      real(wp), allocatable, dimension(:, :, :) :: shape, stt_area  !! H_k and K_k of the pair (nlane, nnoise, 0:1)
      real(wp), allocatable, dimension(:, :) :: q0, p0, q, p  !! (nlane, ndof)
      real(wp), allocatable, dimension(:, :) :: sum_w, low    !! W_k(t) (nlane, nnoise)
      real(wp), allocatable, dimension(:) :: xi1, xi2, c, s   !! (nlane)
   end type exact_block

contains

   !> q(path, i, n), p(path, i, n) at the saved times of a run with these options, t0 included.
   !> Errors: missing_operation for models without an exact solution; incompatible for schemes whose increments are not
   !> Brownian; wrong_shape; those of check_options and of the noise; stopped, by the monitor.
   subroutine exact_solution(model, options, q0, p0, q, p, error, dw, scheme, monitor)
      class(model_type), intent(in) :: model
      type(run_options), intent(in) :: options
      real(wp), intent(in) :: q0(:, :), p0(:, :)        !! initial state (npath or 1, ndof)
      real(wp), intent(out) :: q(:, :, :), p(:, :, :)   !! (npath, ndof, ntime)
      type(error_type), allocatable, intent(inout) :: error
      !> increments (npath or 1, nnoise, rows)
      real(wp), intent(in), target, contiguous, optional :: dw(:, :, :)
      type(scheme_type), intent(in), optional :: scheme !! scheme of the run; if absent, only dW is drawn
      class(monitor_type), intent(inout), optional :: monitor
      class(noise_type), allocatable, target :: noise
      type(oscillator) :: system
      type(exact_block) :: work
      type(run_options) :: fine
      type(given_increments) :: given
      real(wp) :: lost
      integer(i8) :: n, done

      if (allocated(error)) return
      if (present(dw)) given = increments_of(dw)
      call check_options(options, error)
      if (.not. allocated(error)) call recognise(model, options, system, error)
      if (.not. allocated(error)) call check_shapes(model%traits%ndof, options, q0, p0, q, p, error)
      if (allocated(error)) return
      fine = finest(options)
      ! Draw with the generator of the run for the same paths and steps, which gives the same increments.
      call new_noise(noise, model, fine, lost, error, given)
      call refuse_not_finite(given, fine, error)
      if (present(scheme)) call ask_for(scheme, model, options%damping_noise, noise, error)
      if (allocated(error)) return
      if (system%additive .and. allocated(system%flow)) then
         allocate (system%steps)
         call new_linear_steps(system%steps, system%flow%n, noise%nnoise, system%flow%field, fine%step, noise%common)
      end if
      call new_block(work, noise, model%traits%ndof, model%traits%nnoise, fine)
      do while (work%first < fine%npath)
         call begin_block(work, fine, q0, p0)
         call save_point(work, 1, q, p)
         do n = fine%first_step, fine%first_step + fine%nstep - 1
            done = n - fine%first_step
            call stop_if_wanted(monitor, work%first*fine%nstep + done*work%nreal, fine%npath*fine%nstep, &
                                'exact_solution', error)
            if (allocated(error)) return
            ! Steps are drawn in pairs; the first one may be the second of its pair.
            if (noise%nnoise > 0 .and. (mod(n, 2_i8) == 0 .or. n == fine%first_step)) &
               call fill(work, noise, system, fine, n/2)
            call advance(work, noise, system, fine, n)
            done = done + 1
            if (mod(done, fine%save_every) /= 0) cycle
            ! These models depend on W(t) alone: compute saved states from the start, so that errors do not add up.
            if (.not. system%additive) call rotate(work, system, real(done, wp)*fine%step)
            call save_point(work, int(done/fine%save_every) + 1, q, p)
         end do
         work%first = work%first + work%nlane
      end do
   end subroutine exact_solution

   !> Request the functionals that the scheme uses.
   subroutine ask_for(scheme, model, damping_noise, noise, error)
      type(scheme_type), intent(in) :: scheme
      class(model_type), intent(in) :: model
      integer, intent(in) :: damping_noise   !! an enumerator of base/damping
      class(noise_type), allocatable, intent(inout) :: noise
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error)) return
      ! Two-point and three-point increments do not belong to a Brownian path.
      if (scheme%law /= law_gaussian) then
         call raise(error, incompatible, 'exact_solution', 'scheme '//scheme%name//' draws '//law_text(scheme%law)// &
                    ' increments and follows no Brownian path, so there is no exact solution beside it: compare '// &
                    'expectations, or take a scheme with Gaussian increments')
         return
      end if
      ! The same functionals are requested from the same source, so that it draws the same numbers as in the run.
      noise%asked = needed_functionals(scheme, model%traits, model%damping, damping_noise)
      if (noise%asked%has(path_decay)) &
         call raise(error, incompatible, 'exact_solution', 'the exact solution is drawn given dW, dZ and K, and '// &
                    'this run draws the noise of damped free motion along its path, too: leave damping_noise out')
   end subroutine ask_for

   !> Get increments of the steps 2*pair and 2*pair+1; for additive noise also H_k and K_k, from the run, or drawn here
   !> with the counters of the run.
   subroutine fill(work, noise, system, options, pair)
      type(exact_block), intent(inout) :: work
      class(noise_type), intent(in) :: noise
      type(oscillator), intent(in) :: system
      type(run_options), intent(in) :: options
      integer(i8), intent(in) :: pair
      integer(i8) :: drawn, from(work%nlane)
      real(wp) :: shape(work%nlane, 0:1), stt_area(work%nlane, 0:1)
      integer :: k

      work%request%pair = pair
      call noise%fill(work%request, work%store, drawn)
      if (.not. system%additive) return
      do k = 1, noise%nnoise
         if (noise%silent(k)) cycle
         from = work%request%path
         if (noise%common(k)) from = 0
         ! Draw H_k and K_k with the counters of a run; if the run draws them itself, its values replace these
         ! below.
         call shape_draws(work%nlane, options%seed, from, pair, k, options%step, shape, stt_area, drawn)
         work%shape(:, k, :) = shape
         work%stt_area(:, k, :) = stt_area
      end do
      !   H_k = dZ_k/h - dW_k/2
      if (noise%asked%has(path_dz)) &
         work%shape = work%store%of(path_dz)%x/options%step - 0.5_wp*work%store%w(:, 1:, :)
      if (noise%asked%has(path_stt_area)) work%stt_area = work%store%of(path_stt_area)%x
   end subroutine fill

   !> Read the model's parameters from its gradients at unit points and unit weights, which give them exactly.
   subroutine recognise(model, options, system, error)
      class(model_type), intent(in) :: model
      type(run_options), intent(in) :: options
      type(oscillator), intent(out) :: system
      type(error_type), allocatable, intent(inout) :: error
      integer :: k

      call model%refuse_forces('exact_solution', 'the exact solution', error)
      call model%refuse_paths('exact_solution', 'the exact solution', error)
      call model%require_gradient('exact_solution', 'the exact solution', error)
      if (allocated(error)) return
      if (model%damping%acts()) then
         call recognise_linear(model, options, system, error)
         return
      end if
      select type (model)
      type is (kubo_model)
         !   H_p(0, 1) = a,   H_1,p(0, 1) = sigma
         system%a = slope(model, 0, 1.0_wp)
         system%sigma = slope(model, 1, 1.0_wp)
      type is (linear_oscillator_model)
         system%additive = .true.
      type is (additive_oscillator_model)
         system%additive = .true.
      class default
         call recognise_linear(model, options, system, error)
         return
      end select
      if (.not. system%additive) return
      ! The noise enters as dq = .. + H_k,p dW_k and dp = .. - H_k,q dW_k.
      system%a = 1
      allocate (system%to_q(model%traits%nnoise), system%to_p(model%traits%nnoise))
      do k = 1, model%traits%nnoise
         system%to_q(k) = slope(model, k, 0.0_wp)
         system%to_p(k) = -slope(model, k, 0.0_wp, in_q=.true.)
      end do
   end subroutine recognise

   !> A model may be linear, with commuting flows or with constant noise: read its fields and test them.
   subroutine recognise_linear(model, options, system, error)
      class(model_type), intent(in) :: model
      type(run_options), intent(in) :: options
      type(oscillator), intent(inout) :: system
      type(error_type), allocatable, intent(inout) :: error
      character(:), allocatable :: reason

      allocate (system%flow)
      call new_linear_flow(system%flow, model, options%t0, &
                           options%t0 + options%step*real(options%first_step + options%nstep, wp), reason)
      if (len(reason) > 0) then
         call raise(error, missing_operation, 'exact_solution', 'this model '//reason//' and has no exact '// &
                    'solution in the library: kubo, linear_oscillator, additive_oscillator and quadratic models '// &
                    'whose flows commute or whose noise is constant have; compare with a run at a much smaller '// &
                    'step on the same path (refine) instead')
      end if
      system%additive = .not. system%flow%commutes
   end subroutine recognise_linear

   !> dH_k/dp, or dH_k/dq, at (q, p) = (0, x) or (x, 0).
   real(wp) function slope(model, k, x, in_q)
      class(model_type), intent(in) :: model
      integer, intent(in) :: k
      real(wp), intent(in) :: x
      logical, intent(in), optional :: in_q
      real(wp) :: w(1, 0:model%traits%nnoise), zero(1, 1), at(1, 1), hq(1, 1), hp(1, 1)

      w = 0
      w(1, k) = 1
      zero = 0
      at = x
      call model%gradient(1, 1, model%traits%nnoise, 0.0_wp, w, zero, at, hq, hp)
      slope = hp(1, 1)
      if (present(in_q)) slope = hq(1, 1)
   end function slope

   !> The options of the run at the step of its draws, without truncation.
   pure type(run_options) function finest(options) result(fine)
      type(run_options), intent(in) :: options
      integer(i8) :: parts

      fine = options
      fine%truncation = 0
      if (options%refine <= 0 .or. options%refine > max_refine) return  ! values out of range are refused later
      ! The run's step is made of 2^refine steps of the generator, and all counts of steps are multiplied by as many.
      parts = 2_i8**options%refine
      fine%refine = 0
      fine%step = options%step/real(parts, wp)
      fine%nstep = options%nstep*parts
      fine%first_step = options%first_step*parts
      ! save_every may exceed the steps of the run, and its multiple must not overflow.
      fine%save_every = min(options%save_every, max(options%nstep, 1_i8))*parts
   end function finest

   !> Check shapes: (npath, ndof, ntime) for q and p, where ntime counts t0; initial states of one path or of all.
   subroutine check_shapes(ndof, options, q0, p0, q, p, error)
      integer, intent(in) :: ndof
      type(run_options), intent(in) :: options
      real(wp), intent(in) :: q0(:, :), p0(:, :), q(:, :, :), p(:, :, :)
      type(error_type), allocatable, intent(inout) :: error
      integer(i8) :: ntime

      ntime = saved_count(options)
      if (size(q, 1, i8) /= options%npath .or. size(q, 2) /= ndof .or. size(q, 3, i8) /= ntime .or. &
          any(shape(p, i8) /= shape(q, i8))) then
         call raise(error, wrong_shape, 'exact_solution', 'q and p have no room for the '// &
                    'solution: needed is ('//to_text(options%npath)//','//to_text(ndof)//','//to_text(ntime)// &
                    ') for each')
      else if (.not. (one_or_all(q0) .and. one_or_all(p0))) then
         call raise(error, wrong_shape, 'exact_solution', 'the initial q is ('// &
                    to_text(size(q0, 1))//','//to_text(size(q0, 2))// &
                    '), the initial p ('//to_text(size(p0, 1))//','//to_text(size(p0, 2))// &
                    '); needed are, of degrees of freedom, '//to_text(ndof)//' and '// &
                    to_text(options%npath)//' paths or one for all')
      end if

   contains

      !> Whether all degrees of freedom are given, once or for every path.
      logical function one_or_all(x)
         real(wp), intent(in) :: x(:, :)

         one_or_all = size(x, 2) == ndof .and. (size(x, 1) == 1 .or. size(x, 1, i8) == options%npath)
      end function one_or_all

   end subroutine check_shapes

   !> Allocate a block of lanes and a pair of steps; H_k and K_k stay zero unless drawn.
   subroutine new_block(work, noise, ndof, nnoise, options)
      type(exact_block), intent(out) :: work
      class(noise_type), intent(in) :: noise
      integer, intent(in) :: ndof, nnoise
      type(run_options), intent(in) :: options
      integer :: nlane

      nlane = lanes_for(ndof, options%npath)
      work%nlane = nlane
      call new_step_store(work%store, nlane, nnoise, 2, options%step, noise%asked)
      work%request%nlane = nlane
      allocate (work%request%path(nlane), work%shape(nlane, nnoise, 0:1), work%stt_area(nlane, nnoise, 0:1))
      allocate (work%q0(nlane, ndof), work%p0(nlane, ndof), work%q(nlane, ndof), work%p(nlane, ndof))
      allocate (work%sum_w(nlane, nnoise), work%low(nlane, nnoise))
      allocate (work%xi1(nlane), work%xi2(nlane), work%c(nlane), work%s(nlane))
      work%shape = 0
      work%stt_area = 0
   end subroutine new_block

   !> Load the initial states of the block that begins at work%first.
   subroutine begin_block(work, options, q0, p0)
      type(exact_block), intent(inout) :: work
      type(run_options), intent(in) :: options
      real(wp), intent(in) :: q0(:, :), p0(:, :)
      integer(i8) :: row
      integer :: lane

      ! Lanes beyond the last path repeat it: they are computed but not saved.
      work%nreal = int(min(int(work%nlane, i8), options%npath - work%first))
      work%request%nreal = work%nreal
      call path_of_lane(work%nlane, options%first_path + work%first, work%nreal, work%request%path)
      work%request%path = noise_path(options, work%request%path)
      do lane = 1, work%nlane
         row = work%first + min(lane, work%nreal)
         work%q0(lane, :) = q0(min(row, size(q0, 1, i8)), :)
         work%p0(lane, :) = p0(min(row, size(p0, 1, i8)), :)
      end do
      work%q = work%q0
      work%p = work%p0
      work%sum_w = 0
      ! sum_w + low is W(t): low holds the rounding errors of the sum.
      work%low = 0
   end subroutine begin_block

   !> Step n: add dW to W(t) (compensated), or apply the recursion Y + (F - I) Y + u. In this form rounding errors
   !> of the radius do not accumulate; with F Y they would.
   subroutine advance(work, noise, system, options, n)
      type(exact_block), intent(inout) :: work
      class(noise_type), intent(in) :: noise
      type(oscillator), intent(in) :: system
      type(run_options), intent(in) :: options
      integer(i8), intent(in) :: n
      integer(i8) :: from(work%nlane)
      real(wp) :: versine, sine
      integer :: half, k

      half = int(mod(n, 2_i8))
      if (.not. system%additive) then
         do k = 1, size(work%sum_w, 2)
            ! W_k(t_{n+1}) = W_k(t_n) + dW_k
            ! A plain sum of many increments would lose digits, and the Kubo oscillator would have a wrong angle late in
            ! a run.
            call add_compensated(work%nlane, work%store%w(:, k, half), work%sum_w(:, k), work%low(:, k))
         end do
         return
      end if
      if (allocated(system%steps)) then
         call system%steps%take(work%nlane, size(work%q, 2), noise%nnoise, options%seed, work%request%path, n, &
                                work%store%w(:, 1:, half), work%shape(:, :, half), work%stt_area(:, :, half), &
                                work%q, work%p)
         return
      end if
      ! The versine 1 - cos h is computed without cancellation.
      versine = 2*sin(0.5_wp*options%step)**2
      sine = sin(options%step)
      !   Y <- Y + (F - I) Y,   F - I = (-versine, sin h; -sin h, -versine)
      call turn(work%nlane, versine, sine, work%q(:, 1), work%p(:, 1))
      do k = 1, size(system%to_q)
         ! A noise of strength zero adds nothing and needs no draws.
         if (abs(system%to_q(k)) <= 0 .and. abs(system%to_p(k)) <= 0) cycle
         ! Draw (C_k, S_k) given dW_k, H_k and K_k, from two normals that no run draws.
         from = work%request%path
         if (noise%common(k)) from = 0
         call oscillator_draws(work%nlane, options%seed, from, n, k, work%xi1, work%xi2)
         call oscillator_integrals(work%nlane, options%step, work%store%w(:, k, half), work%shape(:, k, half), &
                                   work%stt_area(:, k, half), work%xi1, work%xi2, work%c, work%s)
         !   u = to_q (C; -S) + to_p (S; C)
         work%q(:, 1) = work%q(:, 1) + (system%to_q(k)*work%c + system%to_p(k)*work%s)
         work%p(:, 1) = work%p(:, 1) + (system%to_p(k)*work%c - system%to_q(k)*work%s)
      end do
   end subroutine advance

   !> Compute the Kubo oscillator, or a quadratic model, after the time t, from the initial state and W(t).
   subroutine rotate(work, system, t)
      type(exact_block), intent(inout) :: work
      type(oscillator), intent(in) :: system
      real(wp), intent(in) :: t
      real(wp) :: theta, z(2*size(work%q, 2)), w(size(work%sum_w, 2))
      integer :: lane, n

      ! z(t) = exp(t A_0 + sum_k W_k(t) A_k) z_0, plus the effect of linear terms
      if (allocated(system%flow)) then
         n = size(work%q, 2)
         do lane = 1, work%nreal
            z(:n) = work%q0(lane, :)
            z(n + 1:) = work%p0(lane, :)
            w = work%sum_w(lane, :) + work%low(lane, :)
            call system%flow%solve(t, w, z)
            work%q(lane, :) = z(:n)
            work%p(lane, :) = z(n + 1:)
         end do
         return
      end if
      do lane = 1, work%nlane
         !   theta = a t + sigma W(t)
         theta = system%a*t + system%sigma*(work%sum_w(lane, 1) + work%low(lane, 1))
         work%q(lane, 1) = work%q0(lane, 1)*cos(theta) + work%p0(lane, 1)*sin(theta)
         work%p(lane, 1) = work%p0(lane, 1)*cos(theta) - work%q0(lane, 1)*sin(theta)
      end do
   end subroutine rotate

   !> Copy the states of the real lanes to their paths, at the saved time isave.
   subroutine save_point(work, isave, q, p)
      type(exact_block), intent(in) :: work
      integer, intent(in) :: isave
      real(wp), intent(inout) :: q(:, :, :), p(:, :, :)
      integer :: lane

      do lane = 1, work%nreal
         q(work%first + lane, :, isave) = work%q(lane, :)
         p(work%first + lane, :, isave) = work%p(lane, :)
      end do
   end subroutine save_point

   !> Y = Y + (F - I) Y
   pure subroutine turn(nlane, versine, sine, q, p)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: versine, sine        !! 1 - cos h, sin h
      real(wp), intent(inout) :: q(nlane), p(nlane)
      real(wp) :: dq, dp
      integer :: lane

      do lane = 1, nlane
         dq = sine*p(lane) - versine*q(lane)
         dp = -sine*q(lane) - versine*p(lane)
         q(lane) = q(lane) + dq
         p(lane) = p(lane) + dp
      end do
   end subroutine turn

   !> Kahan's summation: x + low is the accurate sum.
   pure subroutine add_compensated(nlane, d, x, low)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: d(nlane)
      real(wp), intent(inout) :: x(nlane), low(nlane)
      real(wp) :: y, s
      integer :: lane

      do lane = 1, nlane
         y = d(lane) + low(lane)
         s = x(lane) + y
         low(lane) = y - (s - x(lane))
         x(lane) = s
      end do
   end subroutine add_compensated

end module symsde_diagnose_exact
