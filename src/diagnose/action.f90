! SPDX-License-Identifier: BSD-3-Clause
!>    S = sum_n Lbar_h(p_n, q_n, p_{n+1}, q_{n+1})                                              (46)
!>    dLbar_h(n-1)/dq_n + dLbar_h(n)/dq_n = 0,   dLbar_h(n-1)/dp_n + dLbar_h(n)/dp_n = 0        (47)-(48)
!>    p_n = -dLbar_h/dq_n,  0 = dLbar_h/dp_n,   p_{n+1} = dLbar_h/dq_{n+1},  0 = dLbar_h/dp_{n+1}
!>
!> The discrete action along given paths, its gradient, and tests of computed paths: the discrete Euler-Lagrange
!> equations and the Legendre transforms (53)-(54), (57)-(58) of [WHSB]. Lbar_h is the discrete Lagrangian of
!> diagnose/lagrangian.
!>
!> Paths are (q_n, p_n), n = 0 .. nstep, at t_n = t0 + (first_step + n) step, with the increments
!> that drove them: a run with save_every = 1. Paths need not be solutions: action and gradient are functions of
!> arbitrary paths. Of the options step, t0, first_step, correction and max_iter are used. Values are NaN for paths that
!> hold NaN or whose internal stages cannot be solved.
module symsde_diagnose_action
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use symsde_base_contracts, only: contracts_are_executed
   use symsde_base_kinds, only: wp, i8
   use symsde_base_memory, only: require_memory
   use symsde_base_status, only: error_type, raise, wrong_shape, missing_operation
   use symsde_diagnose_contract, only: require_increments
   use symsde_diagnose_lagrangian, only: discrete_lagrangian, lagrangian_gradient, new_discrete_lagrangian, &
                                         lanes_of_diagnosis, lagrangian_numbers
   use symsde_ensemble_monitor, only: monitor_type, stop_if_wanted
   use symsde_ensemble_options, only: run_options, check_options
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type, correction_none
   use symsde_solve_lapack, only: blas_single_thread, blas_restore_threads
   implicit none
   private
   public :: discrete_action, action_gradient, euler_lagrange_residual

   !> Data of one step of one block: its two states, its increments, and the derivatives of its Lagrangian.
   type :: step_block
      integer :: nlane = 0, nreal = 0
      real(wp) :: h = 0
      real(wp), allocatable :: w(:, :)                    !! (nlane, 0:nnoise)
      real(wp), allocatable, dimension(:, :) :: q0, p0, q1, p1  !! (nlane, ndof)
      type(lagrangian_gradient) :: d
      real(wp), allocatable :: action(:)                  !! (nlane)
      integer(i8), allocatable :: status(:)               !! (nlane)
   end type step_block

contains

   !> action(path, n) = Lbar_h(p_{n-1}, q_{n-1}, p_n, q_n), the n-th term of (46) [action]. Errors:
   !> missing_operation for models without values; incompatible for schemes without a discrete Lagrangian;
   !> wrong_shape; errors of check_options; stopped, by the monitor.
   subroutine discrete_action(model, scheme, options, q, p, dw, action, error, monitor)
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      real(wp), intent(in) :: q(:, :, :), p(:, :, :)   !! paths (npath, ndof, nstep+1)
      real(wp), intent(in) :: dw(:, :, :)              !! increments (npath, nnoise, nstep)
      real(wp), intent(out) :: action(:, :)            !! (npath, nstep)
      type(error_type), allocatable, intent(inout) :: error
      class(monitor_type), intent(inout), optional :: monitor
      type(discrete_lagrangian) :: lagrangian
      type(step_block) :: work
      integer :: first, n, lane

      if (allocated(error)) return
      ! The gradient of the model is not enough: the action needs the values of H and H_k.
      if (.not. model%traits%has_value) then
         call raise(error, missing_operation, 'discrete_action', 'the model has gradients '// &
                    'only, and the action needs the values of its Hamiltonians: give the '// &
                    'model its value')
         return
      end if
      call prepare(lagrangian, work, model, scheme, options, q, p, dw, error)
      if (lagrangian%ham%correction /= correction_none) &
         call model%refuse_forces('discrete_action', 'the action of a corrected scheme', error)
      if (.not. fits2(action, size(q, 1), size(dw, 3))) call refuse_shape('action', error)
      if (allocated(error)) return
      call blas_single_thread()
      ! Blocks of paths are the outer loop and steps the inner one, so that a block's arrays are allocated once.
      blocks: do first = 1, size(q, 1), work%nlane
         work%status = 0
         do n = 1, size(dw, 3)
            call ask_monitor(work, first, n, dw, 'discrete_action', error, monitor)
            if (allocated(error)) exit blocks
            call load_step(work, first, n, q, p, dw)
            !   Lbar_h(p_{n-1}, q_{n-1}, p_n, q_n) of all lanes
            call lagrangian%value(time_of(options, n), work%w, work%q0, work%p0, work%q1, work%p1, &
                                  work%action, work%status)
            do lane = 1, work%nreal
               ! A lane whose stages could not be solved once keeps its status, and its action is NaN from then on.
               action(first + lane - 1, n) = nan_unless(work%status(lane) == 0, work%action(lane))
            end do
         end do
      end do blocks
      call blas_restore_threads()
   end subroutine discrete_action

   !> Gradient of the sum (46) with respect to the interior states: the left sides of (47) and (48),
   !> gradient_q(path, :, n) = dS/dq_n, gradient_p(path, :, n) = dS/dp_n, n = 1 .. nstep-1.
   !> Errors as discrete_action, but values are not needed.
   subroutine action_gradient(model, scheme, options, q, p, dw, gradient_q, gradient_p, error, monitor)
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      real(wp), intent(in) :: q(:, :, :), p(:, :, :)   !! paths (npath, ndof, nstep+1)
      real(wp), intent(in) :: dw(:, :, :)              !! increments (npath, nnoise, nstep)
      real(wp), intent(out) :: gradient_q(:, :, :)     !! (npath, ndof, nstep-1)
      real(wp), intent(out) :: gradient_p(:, :, :)     !! (npath, ndof, nstep-1)
      type(error_type), allocatable, intent(inout) :: error
      class(monitor_type), intent(inout), optional :: monitor
      type(discrete_lagrangian) :: lagrangian
      type(step_block) :: work
      integer :: first, n

      if (allocated(error)) return
      call prepare(lagrangian, work, model, scheme, options, q, p, dw, error)
      ! A path of nstep steps has nstep - 1 interior states.
      associate (n => max(size(dw, 3) - 1, 0))
         if (.not. fits3(gradient_q, size(q, 1), size(q, 2), n) .or. &
             .not. fits3(gradient_p, size(q, 1), size(q, 2), n)) &
            call refuse_shape('gradient_q or gradient_p', error)
      end associate
      if (allocated(error)) return
      call blas_single_thread()
      blocks: do first = 1, size(q, 1), work%nlane
         work%status = 0
         do n = 1, size(dw, 3)
            call ask_monitor(work, first, n, dw, 'action_gradient', error, monitor)
            if (allocated(error)) exit blocks
            call load_step(work, first, n, q, p, dw)
            call differentiate(lagrangian, work, options, n)
            ! Each Lbar_h depends on two states: its derivatives are added to the gradient at both.
            call add_ends(work, first, n - 1, gradient_q, gradient_p)
         end do
      end do blocks
      call blas_restore_threads()
   end subroutine action_gradient

   !> Add the left derivatives of a step to the gradient at its first state, and set the gradient at its last state to
   !> the right derivatives. The ends of the path are given and have no gradient.
   subroutine add_ends(work, first, left, gradient_q, gradient_p)
      type(step_block), intent(in) :: work
      integer, intent(in) :: first   !! first path of the block
      integer, intent(in) :: left    !! first state of the step, from 0
      real(wp), intent(inout) :: gradient_q(:, :, :), gradient_p(:, :, :)
      integer :: lane, path, i
      real(wp) :: unit

      do i = 1, size(gradient_q, 2)
         do lane = 1, work%nreal
            path = first + lane - 1
            ! unit is 1, or NaN for failed lanes, so that products with it become NaN.
            unit = nan_unless(work%status(lane) == 0, 1.0_wp)
            ! State `left` holds the right derivatives of the step before; add the left derivatives of this step.
            if (left > 0) then
               gradient_q(path, i, left) = gradient_q(path, i, left) + unit*work%d%left_q(lane, i)
               gradient_p(path, i, left) = gradient_p(path, i, left) + unit*work%d%left_p(lane, i)
            end if
            ! The last state is an end of the path.
            if (left >= size(gradient_q, 3)) cycle
            gradient_q(path, i, left + 1) = unit*work%d%right_q(lane, i)
            gradient_p(path, i, left + 1) = unit*work%d%right_p(lane, i)
         end do
      end do
   end subroutine add_ends

   !> Largest residual over steps and degrees of freedom:
   !>
   !>    residual(:, 1)   |dLbar_h(n-1)/dq_n + dLbar_h(n)/dq_n|                         (47)
   !>    residual(:, 2)   |dLbar_h(n-1)/dp_n + dLbar_h(n)/dp_n|                         (48)
   !>    residual(:, 3)   |p_n + dLbar_h/dq_n|, |dLbar_h/dp_n|                    (53)-(54), (59)
   !>    residual(:, 4)   |p_{n+1} - dLbar_h/dq_{n+1}|, |dLbar_h/dp_{n+1}|        (57)-(58), (59)
   !>
   !> Residuals 1 and 2 test whether the path is stationary, residuals 3 and 4 whether the scheme produced it. With
   !> several stages dLbar_h/dq_{n+1} is p_{n+1} itself, so that residual 4 tests the equation of q_{n+1}, sum_i alpha_i
   !> V_i = q_{n+1} - q_n; residual 3 tests the equation of p_n, and reveals a wrong abar. A wrong increment, a step of
   !> another length or a solver that stopped early shows in both.
   !>
   !> Residuals are absolute numbers: round-off is at most 7e-16 times the size of the states (measured: 5000 steps of
   !> 0.02, six models, seven schemes). Residuals 1 and 2 are zero for a single step. Errors as discrete_action, but
   !> values are not needed.
   subroutine euler_lagrange_residual(model, scheme, options, q, p, dw, residual, error, monitor)
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      real(wp), intent(in) :: q(:, :, :), p(:, :, :)   !! paths (npath, ndof, nstep+1)
      real(wp), intent(in) :: dw(:, :, :)              !! increments (npath, nnoise, nstep)
      real(wp), intent(out) :: residual(:, :)          !! (npath, 4)
      type(error_type), allocatable, intent(inout) :: error
      class(monitor_type), intent(inout), optional :: monitor
      type(discrete_lagrangian) :: lagrangian
      type(step_block) :: work
      real(wp), allocatable :: largest(:, :), before_q(:, :), before_p(:, :), zero(:, :)
      integer :: first, n, lane

      if (allocated(error)) return
      call prepare(lagrangian, work, model, scheme, options, q, p, dw, error)
      if (.not. fits2(residual, size(q, 1), 4)) call refuse_shape('residual', error)
      if (allocated(error)) return
      allocate (largest(work%nlane, 4), zero(work%nlane, size(q, 2)))
      zero = 0
      call blas_single_thread()
      blocks: do first = 1, size(q, 1), work%nlane
         work%status = 0
         largest = 0
         do n = 1, size(dw, 3)
            call ask_monitor(work, first, n, dw, 'euler_lagrange_residual', error, monitor)
            if (allocated(error)) exit blocks
            ! Keep the right derivatives of the step before: in (47) and (48) the left derivatives of this step are
            ! added to them.
            before_q = work%d%right_q
            before_p = work%d%right_p
            call load_step(work, first, n, q, p, dw)
            call differentiate(lagrangian, work, options, n)
            if (n > 1) then
               ! Equations (47) and (48) begin with the second step.
               call enlarge(before_q, work%d%left_q, largest(:, 1))
               call enlarge(before_p, work%d%left_p, largest(:, 2))
            end if
            !   p_n + dLbar_h/dq_n  and  dLbar_h/dp_n
            call enlarge(work%p0, work%d%left_q, largest(:, 3))
            call enlarge(zero, work%d%left_p, largest(:, 3))
            !   p_{n+1} - dLbar_h/dq_{n+1}  and  dLbar_h/dp_{n+1}
            work%p1 = -work%p1
            call enlarge(work%p1, work%d%right_q, largest(:, 4))
            call enlarge(zero, work%d%right_p, largest(:, 4))
         end do
         do n = 1, 4
            do lane = 1, work%nreal
               residual(first + lane - 1, n) = nan_unless(work%status(lane) == 0, largest(lane, n))
            end do
         end do
      end do blocks
      call blas_restore_threads()
   end subroutine euler_lagrange_residual

   !> Check the arguments, set up the Lagrangian and allocate one block.
   subroutine prepare(lagrangian, work, model, scheme, options, q, p, dw, error)
      type(discrete_lagrangian), intent(out) :: lagrangian
      type(step_block), intent(out) :: work
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      type(run_options), intent(in) :: options
      real(wp), intent(in) :: q(:, :, :), p(:, :, :), dw(:, :, :)
      type(error_type), allocatable, intent(inout) :: error
      integer :: nlane, n

      call check_options(options, error)
      n = model%traits%ndof
      if (.not. fits3(q, size(q, 1), n, size(dw, 3) + 1)) call refuse_shape('q', error)
      if (.not. fits3(p, size(q, 1), n, size(dw, 3) + 1)) call refuse_shape('p', error)
      if (.not. fits3(dw, size(q, 1), model%traits%nnoise, size(dw, 3))) &
         call refuse_shape('dw', error)
      if (allocated(error)) return
      if (contracts_are_executed) call require_increments(dw, 'diagnose, action')
      ! Check memory before allocating, since the refusal then names what to make smaller.
      nlane = lanes_of_diagnosis(model, scheme, size(q, 1, i8))
      call require_memory(lagrangian_numbers(model, scheme, nlane), 'the discrete Lagrangian of model '//model%name// &
                          ' under scheme '//scheme%name, 'give a smaller system or a scheme of one stage', &
                          'discrete_action', error)
      call new_discrete_lagrangian(lagrangian, model, scheme, options, nlane, error)
      if (allocated(error)) return
      work%nlane = nlane
      work%h = options%step
      allocate (work%w(nlane, 0:model%traits%nnoise), work%action(nlane), work%status(nlane))
      allocate (work%q0(nlane, n), work%p0(nlane, n), work%q1(nlane, n), work%p1(nlane, n))
      ! Start with zero derivatives: the first step reads them like those of a preceding step, but does not use them.
      allocate (work%d%left_q(nlane, n), work%d%left_p(nlane, n), work%d%right_q(nlane, n), &
                work%d%right_p(nlane, n), source=0.0_wp)
   end subroutine prepare

   !> Call the monitor before step n (from 1) of the block of paths that begins at `first` (from 1).
   subroutine ask_monitor(work, first, n, dw, place, error, monitor)
      type(step_block), intent(in) :: work
      integer, intent(in) :: first, n
      real(wp), intent(in) :: dw(:, :, :)
      character(*), intent(in) :: place
      type(error_type), allocatable, intent(inout) :: error
      class(monitor_type), intent(inout), optional :: monitor
      integer(i8) :: nstep, nblock

      nstep = size(dw, 3)
      ! Count progress in steps of blocks; finished blocks count with all their steps.
      nblock = (size(dw, 1) + work%nlane - 1)/work%nlane
      call stop_if_wanted(monitor, (first - 1)/work%nlane*nstep + n - 1, nblock*nstep, place, error)
   end subroutine ask_monitor

   !> largest = max(largest, |x + y|) in every lane, NaN where x + y is not finite.
   pure subroutine enlarge(x, y, largest)
      real(wp), intent(in) :: x(:, :), y(:, :)
      real(wp), intent(inout) :: largest(:)
      real(wp) :: size_now
      integer :: lane, i

      do i = 1, size(x, 2)
         do lane = 1, size(x, 1)
            size_now = abs(x(lane, i) + y(lane, i))
            ! A lane that holds NaN keeps NaN.
            if (size_now <= largest(lane) .or. .not. largest(lane) <= huge(largest)) cycle
            largest(lane) = nan_unless(size_now <= huge(size_now), size_now)
         end do
      end do
   end subroutine enlarge

   !> Whether an array has these extents.
   pure logical function fits2(x, n1, n2)
      real(wp), intent(in) :: x(:, :)
      integer, intent(in) :: n1, n2

      fits2 = size(x, 1) == n1 .and. size(x, 2) == n2
   end function fits2

   !> Whether an array of three dimensions has these extents.
   pure logical function fits3(x, n1, n2, n3)
      real(wp), intent(in) :: x(:, :, :)
      integer, intent(in) :: n1, n2, n3

      fits3 = size(x, 1) == n1 .and. size(x, 2) == n2 .and. size(x, 3) == n3
   end function fits3

   !> One message for all arrays: it lists every shape that is wanted.
   subroutine refuse_shape(what, error)
      character(*), intent(in) :: what
      type(error_type), allocatable, intent(inout) :: error

      call raise(error, wrong_shape, 'discrete_action', what//' has the wrong shape: with '// &
                 'nstep the last extent of dw, needed are q and p (npath,ndof,nstep+1), dw '// &
                 '(npath,nnoise,nstep), action (npath,nstep), residual (npath,4), gradients '// &
                 '(npath,ndof,nstep-1)')
   end subroutine refuse_shape

   !> Load the increments of step n (counted from 1) and the states before and after the step, for the paths from
   !> `first` on. Lanes beyond the last path repeat the last path.
   subroutine load_step(work, first, n, q, p, dw)
      type(step_block), intent(inout) :: work
      integer, intent(in) :: first, n
      real(wp), intent(in) :: q(:, :, :), p(:, :, :), dw(:, :, :)
      integer :: lane, path

      work%nreal = min(work%nlane, size(q, 1) - first + 1)
      ! The weights of H and H_1 .. H_m in Hhat are h and dW_1 .. dW_m.
      work%w(:, 0) = work%h
      do lane = 1, work%nlane
         path = first + min(lane, work%nreal) - 1
         work%w(lane, 1:) = dw(path, :, n)
         work%q0(lane, :) = q(path, :, n)
         work%p0(lane, :) = p(path, :, n)
         work%q1(lane, :) = q(path, :, n + 1)
         work%p1(lane, :) = p(path, :, n + 1)
      end do
   end subroutine load_step

   !> The four derivatives of Lbar_h of step n, stored in work%d.
   subroutine differentiate(lagrangian, work, options, n)
      type(discrete_lagrangian), intent(inout) :: lagrangian
      type(step_block), intent(inout) :: work
      type(run_options), intent(in) :: options
      integer, intent(in) :: n

      call lagrangian%gradient(time_of(options, n), work%w, work%q0, work%p0, work%q1, work%p1, work%d, &
                               work%status)
   end subroutine differentiate

   !> Time at the beginning of step n (from 1) of the paths.
   pure real(wp) function time_of(options, n)
      type(run_options), intent(in) :: options
      integer, intent(in) :: n

      time_of = options%t0 + real(options%first_step + n - 1, wp)*options%step
   end function time_of

   !> x, or NaN if something failed: any number would be mistaken for a result.
   elemental real(wp) function nan_unless(ok, x)
      logical, intent(in) :: ok
      real(wp), intent(in) :: x

      nan_unless = x
      if (.not. ok) nan_unless = ieee_value(x, ieee_quiet_nan)
   end function nan_unless

end module symsde_diagnose_action
