! SPDX-License-Identifier: BSD-3-Clause
!>    M = d(q_{n+1}, p_{n+1})/d(q_n, p_n) = I + D,      defect = max_ij |M^T J M - J| = max_ij |D^T J + J D + D^T J D|
!>    f'(x) ~ (1/e) sum_k w_k f(x + k e),  k = -4 .. 4,      w_k = -w_{-k} = 4/5, -1/5, 4/105, -1/280
!>
!> The distance of one step from symplectic: its tangent map M with frozen increments, J = (0, I; -I, 0), and M^T J M -
!> J.
!>
!> D^T J + J D + D^T J D equals M^T J M - J, but J is subtracted analytically: its terms, and so their rounding errors,
!> have the size of the step, while rounding of M^T J M - J would have size one. All points of a stencil have the same
!> increments, since the paper's theorem is about the map along a given path.
!>
!> A defect above rounding has one of three causes: the scheme is not symplectic; its solver stopped early; or Hessians
!> in its correction or brackets are differences of gradients, whose error is not the gradient of a function.
!>
!> M comes from central differences of eighth order of the stepper's own map, so that the tested code is the code of a
!> run. Increments are differenced, not states, and the spacing is a power of two, so that the rounding of the states
!> cancels. With spacing e = 1/32 the remaining errors are the truncation e^8/630 = 1.4e-15 times the ninth derivatives
!> of the increments, and the rounding of the increments divided by e. Measured over the symplectic tableaux of the
!> catalogue, states of order one, steps of 0.1, increments up to two deviations: at most 7e-15 on kubo, synchrotron,
!> pendulum, noncommutative_oscillator and henon_heiles, 1.1e-14 on the oscillators with additive noise, 1.6e-14 on
!> fpu_chain. heun has 3e-4 to 8e-3 there, and 2.5e-5 on the oscillators with additive noise.
module symsde_diagnose_symplecticity
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use symsde_base_contracts, only: contracts_are_executed
   use symsde_base_functionals, only: path_dz, path_areas
   use symsde_base_kinds, only: wp, i8
   use symsde_base_memory, only: require_memory
   use symsde_base_record, only: step_record, step_store, new_step_store
   use symsde_base_status, only: error_type, raise, wrong_shape, invalid_argument
   use symsde_base_text, only: to_text
   use symsde_diagnose_contract, only: require_given
   use symsde_diagnose_lagrangian, only: lanes_of_diagnosis
   use symsde_ensemble_monitor, only: monitor_type, stop_if_wanted
   use symsde_ensemble_options, only: run_options, check_options, steppers_of
   use symsde_model_abstract, only: model_type
   use symsde_base_damping, only: decay_less_one
   use symsde_scheme_scheme, only: scheme_type
   use symsde_solve_lapack, only: blas_single_thread, blas_restore_threads
   use symsde_step_open_varying, only: loss_of_step
   use symsde_step_factory, only: make_stepper
   use symsde_step_task, only: resolve_task
   use symsde_step_memory, only: step_memory, find_step_memory
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: symplecticity_defect, tangent_map

   integer, parameter :: nstencil = 8
   ! The stencil of eighth order: four points on either side, none at the centre.
   real(wp), parameter :: offset(nstencil) = [-4.0_wp, -3.0_wp, -2.0_wp, -1.0_wp, &
                                              1.0_wp, 2.0_wp, 3.0_wp, 4.0_wp]
   real(wp), parameter :: weight(nstencil) = [1/280.0_wp, -4/105.0_wp, 0.2_wp, -0.8_wp, &
                                              0.8_wp, -0.2_wp, 4/105.0_wp, -1/280.0_wp]
   ! The spacing balances e^8 times a ninth derivative against the rounding of increments over e.
   real(wp), parameter :: default_spacing = 1/32.0_wp
   real(wp), parameter :: longest_state = 1024  !! size from which spacings grow, in lengths of the forces

   !> The given steps, one at each point: initial states and increments.
   type :: given_steps
      real(wp), pointer, dimension(:, :) :: q => null(), p => null()       !! (npoint, ndof)
      real(wp), pointer :: dw(:, :) => null()                              !! (npoint, nnoise)
      real(wp), pointer, dimension(:, :) :: dz => null(), areas => null()  !! may be null, see symplecticity_defect
   end type given_steps

contains

   !> defect(point) = max_ij |(M^T J M - c J)_ij| of the step from (q, p) at time options%t0 with the
   !> given increments, c = 1; which is zero for the schemes of [WHSB], by Theorem 3.2. NaN where the step was not
   !> solved. For a model damped by one rate, c = exp(-gamma h) (base/damping), or exp(-int gamma dt) for gamma(t);
   !> unequal rates conserve no such form, and rates that depend on q no factor: both are refused. Of the options step,
   !> t0, correction, general, max_iter and fixed_point are used. dZ and areas are used by the schemes that need them;
   !> they must have the shapes given. Errors: wrong_shape, invalid_argument, those of check_options and new_stepper;
   !> stopped, by the monitor.
   subroutine symplecticity_defect(model, scheme, options, q, p, dw, defect, error, spacing, dz, areas, monitor)
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      real(wp), intent(in), target :: q(:, :), p(:, :)       !! states (npoint, ndof)
      real(wp), intent(in), target :: dw(:, :)               !! increments of the step (npoint, nnoise)
      real(wp), intent(out) :: defect(:)             !! (npoint)
      type(error_type), allocatable, intent(inout) :: error
      real(wp), intent(in), optional :: spacing      !! spacing of the differences, default 1/32
      real(wp), intent(in), target, optional :: dz(:, :)     !! dZ of the step, default 0 (npoint, nnoise)
      real(wp), intent(in), target, optional :: areas(:, :)  !! Levy areas, default 0 (npoint, nnoise(nnoise-1)/2)
      class(monitor_type), intent(inout), optional :: monitor
      type(given_steps) :: steps
      real(wp), allocatable :: d(:, :, :)
      real(wp) :: loss   !! c - 1, where c is the factor of J
      integer :: i

      call model%refuse_paths('symplecticity_defect', 'the tangent map of a step by differences', error)
      if (allocated(error)) return
      loss = 0
      if (.not. model%damping%shrinks_alike()) then
         call model%damping%refuse(model%name, 'symplecticity_defect', &
                                   'a form that a step keeps up to one factor', error)
         return
      else if (.not. model%damping%is_constant()) then
         loss = loss_of_step(model%damping, model%traits%ndof, options%t0, options%step)
      else if (model%damping%acts()) then
         loss = decay_less_one(model%damping%rate(1)*options%step)
      end if
      steps%q => q
      steps%p => p
      steps%dw => dw
      if (present(dz)) steps%dz => dz
      if (present(areas)) steps%areas => areas
      if (size(defect) /= size(q, 1)) then
         call raise(error, wrong_shape, 'symplecticity_defect', 'defect has room for '// &
                    to_text(size(defect))//' points; '//to_text(size(q, 1))//' states were given')
         return
      end if
      ! D gives the defect here, and M = I + D in tangent_map.
      call differentiate(model, scheme, options, steps, d, error, spacing, monitor)
      if (allocated(error)) return
      ! At a point that was not solved D is NaN, and so is the defect.
      do i = 1, size(defect)
         defect(i) = defect_of(model%traits%ndof, d(:, :, i), loss)
      end do
   end subroutine symplecticity_defect

   !> The tangent map M(point, i, j) = d x_i(t_{n+1}) / d x_j(t_n), x = (q_1 .. q_n, p_1 .. p_n),
   !> of the same step. Errors as symplecticity_defect.
   subroutine tangent_map(model, scheme, options, q, p, dw, m, error, spacing, dz, areas)
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      real(wp), intent(in), target :: q(:, :), p(:, :)       !! states (npoint, ndof)
      real(wp), intent(in), target :: dw(:, :)               !! increments of the step (npoint, nnoise)
      real(wp), intent(out) :: m(:, :, :)            !! (npoint, 2 ndof, 2 ndof)
      type(error_type), allocatable, intent(inout) :: error
      real(wp), intent(in), optional :: spacing      !! spacing of the differences, default 1/32
      real(wp), intent(in), target, optional :: dz(:, :)     !! dZ of the step, default 0 (npoint, nnoise)
      real(wp), intent(in), target, optional :: areas(:, :)  !! Levy areas, default 0 (npoint, nnoise(nnoise-1)/2)
      type(given_steps) :: steps
      real(wp), allocatable :: d(:, :, :)
      integer :: i, j, n

      call model%refuse_paths('tangent_map', 'the tangent map of a step by differences', error)
      if (allocated(error)) return
      steps%q => q
      steps%p => p
      steps%dw => dw
      if (present(dz)) steps%dz => dz
      if (present(areas)) steps%areas => areas
      n = 2*model%traits%ndof
      if (size(m, 1) /= size(q, 1) .or. size(m, 2) /= n .or. size(m, 3) /= n) then
         call raise(error, wrong_shape, 'tangent_map', 'the tangent map is ('// &
                    to_text(size(m, 1))//','//to_text(size(m, 2))//','//to_text(size(m, 3))// &
                    '); it must be ('//to_text(size(q, 1))//','//to_text(n)//','//to_text(n)//')')
         return
      end if
      call differentiate(model, scheme, options, steps, d, error, spacing)
      if (allocated(error)) return
      do j = 1, n
         do i = 1, n
            m(:, i, j) = d(i, j, :)
         end do
         ! The differences are of the increments, D = M - I.
         m(:, j, j) = m(:, j, j) + 1
      end do
   end subroutine tangent_map

   !> d(:, :, point) = M - I: derivatives of the increments (dq, dp) with respect to (q, p). All points of all stencils
   !> are lanes: the point varies slowest, then the variable that is moved, then its offset.
   subroutine differentiate(model, scheme, options, steps, d, error, spacing, monitor)
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      type(given_steps), intent(in) :: steps
      real(wp), allocatable, intent(out) :: d(:, :, :)  !! (2 ndof, 2 ndof, npoint)
      type(error_type), allocatable, intent(inout) :: error
      real(wp), intent(in), optional :: spacing
      class(monitor_type), intent(inout), optional :: monitor
      class(stepper_type), allocatable :: stepper
      type(stepper_task), target :: task
      type(step_memory) :: memory
      type(step_store), target :: store
      type(step_record) :: step
      real(wp), allocatable :: qs(:, :), ps(:, :), dq(:, :), dp(:, :)
      integer(i8), allocatable :: status(:)
      integer(i8) :: first, total
      real(wp) :: base
      integer :: n, npoint, nlane, nreal

      n = model%traits%ndof
      base = default_spacing
      if (present(spacing)) base = spacing
      call check(model, options, steps%q, steps%p, steps%dw, base, error)
      if (allocated(error)) return
      if (contracts_are_executed) &
         call require_given(size(steps%q, 1), model%traits%nnoise, steps%dw, steps%dz, steps%areas)
      ! The stepper is built as for a run, with solver, correction and bounds of the options.
      npoint = size(steps%q, 1)
      ! Each of the 2 ndof variables is moved to eight places, at every point.
      total = int(npoint, i8)*2*n*nstencil
      nlane = lanes_of_diagnosis(model, scheme, total)
      call resolve_task(task, model, scheme, steppers_of(options), error)
      if (allocated(error)) return
      call find_step_memory(task, memory)
      ! Count D of all points, states and increments of a block, and the stepper.
      call require_memory(4.0_wp*npoint*real(n, wp)**2 + nlane*(8.0_wp*n + 2*model%traits%nnoise) &
                          + memory%numbers(nlane), &
                          'the tangent map of '//to_text(2*n)//' variables at '//to_text(npoint)// &
                          ' points under scheme '//scheme%name, &
                          'give fewer points, a smaller system or a scheme of one stage', 'symplecticity_defect', error)
      if (allocated(error)) return
      call make_stepper(stepper, task, model, nlane, error)
      if (allocated(error)) return
      allocate (d(2*n, 2*n, npoint), source=0.0_wp)
      call new_step_store(store, nlane, model%traits%nnoise, 2, options%step, scheme%asks)
      ! The record points into the store; every block overwrites the weights there.
      call store%show(0, options%t0, step)
      allocate (status(nlane))
      allocate (qs(nlane, n), ps(nlane, n), dq(nlane, n), dp(nlane, n))
      call blas_single_thread()
      do first = 0, total - 1, nlane
         call stop_if_wanted(monitor, first, total, 'symplecticity_defect', error)
         if (allocated(error)) exit
         ! Each block loads the states of its stencil points and their increments, and dZ and areas if the scheme needs
         ! them, and takes one step.
         nreal = int(min(int(nlane, i8), total - first))
         call spread_points(steps, first, nreal, base, qs, ps, store%w(:, 1:, 0))
         ! Functionals that are not given stay zero, as the store initialised them.
         if (associated(steps%dz) .and. associated(step%of(path_dz)%x)) &
            call spread_integrals(first, nreal, n, steps%dz, step%of(path_dz)%x)
         if (associated(steps%areas) .and. associated(step%of(path_areas)%x)) &
            call spread_integrals(first, nreal, n, steps%areas, step%of(path_areas)%x)
         status = 0
         ! The stepper is the one that a run would use, with its solver and its stopping rule.
         call stepper%increment(step, qs, ps, dq, dp, status)
         call collect(steps, first, nreal, base, dq, dp, status, d)
      end do
      call blas_restore_threads()
   end subroutine differentiate

   !> Load the lanes first .. first+nreal-1 of all; lanes beyond them repeat the last.
   subroutine spread_points(steps, first, nreal, base, qs, ps, noise)
      type(given_steps), intent(in) :: steps
      integer(i8), intent(in) :: first
      integer, intent(in) :: nreal
      real(wp), intent(in) :: base
      real(wp), intent(out) :: qs(:, :), ps(:, :), noise(:, :)
      integer :: lane, point, variable, k, n

      n = size(steps%q, 2)
      do lane = 1, size(qs, 1)
         call locate(first + min(lane, nreal) - 1, n, point, variable, k)
         ! All points of a stencil have the same increments: M is the map along one path.
         qs(lane, :) = steps%q(point, :)
         ps(lane, :) = steps%p(point, :)
         noise(lane, :) = steps%dw(point, :)
         if (variable <= n) then
            qs(lane, variable) = qs(lane, variable) + offset(k)*length(base, steps%q(point, variable))
         else
            ps(lane, variable - n) = ps(lane, variable - n) &
                                     + offset(k)*length(base, steps%p(point, variable - n))
         end if
      end do
   end subroutine spread_points

   !> Copy dZ or areas of each lane's point.
   subroutine spread_integrals(first, nreal, n, given, lanes)
      integer(i8), intent(in) :: first
      integer, intent(in) :: nreal, n           !! real lanes, degrees of freedom
      real(wp), intent(in) :: given(:, :)       !! (npoint, :)
      real(wp), intent(out) :: lanes(:, :)      !! (nlane, :)
      integer :: lane, point, variable, k

      do lane = 1, size(lanes, 1)
         call locate(first + min(lane, nreal) - 1, n, point, variable, k)
         lanes(lane, :) = given(point, :)
      end do
   end subroutine spread_integrals

   !> Add the contributions of the real lanes to the differences.
   subroutine collect(steps, first, nreal, base, dq, dp, status, d)
      type(given_steps), intent(in) :: steps
      integer(i8), intent(in) :: first
      integer, intent(in) :: nreal
      real(wp), intent(in) :: base, dq(:, :), dp(:, :)
      integer(i8), intent(in) :: status(:)
      real(wp), intent(inout) :: d(:, :, :)
      real(wp) :: factor
      integer :: lane, point, variable, k, n

      n = size(steps%q, 2)
      do lane = 1, nreal
         call locate(first + lane - 1, n, point, variable, k)
         if (variable <= n) then
            ! Division by a power of two is exact: the only errors are those of the increments.
            factor = weight(k)/length(base, steps%q(point, variable))
         else
            factor = weight(k)/length(base, steps%p(point, variable - n))
         end if
         ! One point that was not solved makes the whole tangent map NaN at its state.
         if (status(lane) /= 0) factor = ieee_value(factor, ieee_quiet_nan)
         ! Column `variable` of D is the sum over the eight offsets; dq is in its upper half, dp in its lower half.
         d(:n, variable, point) = d(:n, variable, point) + factor*dq(lane, :)
         d(n + 1:, variable, point) = d(n + 1:, variable, point) + factor*dp(lane, :)
      end do
   end subroutine collect

   !> Find point, variable and offset of a lane from its number (from 0).
   pure subroutine locate(number, n, point, variable, k)
      integer(i8), intent(in) :: number
      integer, intent(in) :: n
      integer, intent(out) :: point, variable, k  !! each counted from 1

      !   number = ((point - 1) 2 ndof + variable - 1) 8 + k - 1
      k = int(mod(number, int(nstencil, i8))) + 1
      variable = int(mod(number/nstencil, 2_i8*n)) + 1
      point = int(number/(2_i8*n*nstencil)) + 1
   end subroutine locate

   !> Spacing of the differences at x: the base for ordinary states, in proportion to x beyond 1024;
   !> always a power of two, so that x plus a multiple of it is exact or nearly so.
   elemental real(wp) function length(base, x)
      real(wp), intent(in) :: base, x

      ! exponent(y) - 1 is floor(log_2 y): the power of two at or below the spacing.
      length = scale(1.0_wp, exponent(base*max(1.0_wp, abs(x)/longest_state)) - 1)
   end function length

   !> max_ij |D^T J + J D + D^T J D|_ij with M = I + D: no cancellation against J.
   pure real(wp) function defect_of(n, d, loss) result(defect)
      integer, intent(in) :: n
      real(wp), intent(in) :: d(2*n, 2*n)
      real(wp), intent(in) :: loss    !! c - 1, where c is the factor of J
      real(wp) :: entry
      integer :: i, j

      ! The matrix is antisymmetric; all its entries are computed, which takes little time compared with the steps.
      defect = 0
      do j = 1, 2*n
         do i = 1, 2*n
            !   (J D)_ij + (D^T J)_ij + (D^T J D)_ij,   (D^T J)_ij = -(J D)_ji
            entry = with_unit(n, i, d(:, j)) - with_unit(n, j, d(:, i)) &
                    + dot_product(d(:n, i), d(n + 1:, j)) - dot_product(d(n + 1:, i), d(:n, j))
            ! J has 1 where a position meets its momentum, and -1 in the transposed place.
            if (j == i + n) entry = entry - loss
            if (i == j + n) entry = entry + loss
            if (.not. abs(entry) <= huge(entry)) entry = ieee_value(entry, ieee_quiet_nan)
            ! A comparison with NaN is false: .not. accepts NaN, and the next line then ends the search.
            if (.not. abs(entry) <= defect) defect = abs(entry)
            if (.not. defect <= huge(defect)) return
         end do
      end do
   end function defect_of

   !> e_i^T J v
   pure real(wp) function with_unit(n, i, v)
      integer, intent(in) :: n, i
      real(wp), intent(in) :: v(2*n)

      if (i <= n) then
         with_unit = v(n + i)
      else
         with_unit = -v(i - n)
      end if
   end function with_unit

   !> Check shapes, spacing and options.
   subroutine check(model, options, q, p, dw, base, error)
      class(model_type), intent(in) :: model
      type(run_options), intent(in) :: options
      real(wp), intent(in) :: q(:, :), p(:, :), dw(:, :), base
      type(error_type), allocatable, intent(inout) :: error

      call check_options(options, error)
      if (allocated(error)) return
      if (any(shape(q) /= shape(p)) .or. size(q, 2) /= model%traits%ndof .or. &
          size(dw, 1) /= size(q, 1) .or. size(dw, 2) /= model%traits%nnoise) then
         call raise(error, wrong_shape, 'symplecticity_defect', 'q is ('//to_text(size(q, 1))// &
                    ','//to_text(size(q, 2))//'), p ('//to_text(size(p, 1))//','// &
                    to_text(size(p, 2))//') and dw ('//to_text(size(dw, 1))//','// &
                    to_text(size(dw, 2))//'); needed are q and p (npoint,'// &
                    to_text(model%traits%ndof)//') and dw (npoint,'// &
                    to_text(model%traits%nnoise)//')')
         ! The offsets reach four spacings, which must be normal numbers.
      else if (.not. (base >= tiny(base)*16 .and. base <= 1024)) then
         call raise(error, invalid_argument, 'symplecticity_defect', 'spacing = '//to_text(base)// &
                    ' is out of range: give a positive number small against the length over '// &
                    'which the forces vary (1/32 by default)')
      end if
   end subroutine check

end module symsde_diagnose_symplecticity
