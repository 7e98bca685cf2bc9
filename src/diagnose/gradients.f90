! SPDX-License-Identifier: BSD-3-Clause
!> Gradients and tangent maps of paths: what users call of diagnose/sweep.
!>
!> Parameters are positions that do not move. A wide model has the positions (q, theta), the momenta (p, pi) and the
!> same Hamiltonians, which do not depend on pi (step/linear/linear_step): of it, Hessians alone are asked for. Without
!> parameters there is no need of one.
module symsde_diagnose_gradients
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: error_type, raise, wrong_shape
   use symsde_diagnose_sweep_gradient, only: path_gradient
   use symsde_diagnose_sweep_path_function, only: path_function
   use symsde_diagnose_sweep_tangent, only: path_tangent
   use symsde_ensemble_block_initial_state, only: initial_state
   use symsde_ensemble_monitor, only: monitor_type
   use symsde_ensemble_options, only: run_options, check_options
   use symsde_ensemble_run_report, only: run_report
   use symsde_ensemble_run_simulate, only: begin_at
   use symsde_model_abstract, only: model_type
   use symsde_noise_given, only: given_increments, increments_of
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: gradients_type, tangents_type, path_gradients, path_tangents

   !> f of each path and its derivatives; NaN where the path failed. Means over paths are the gradient of E f.
   type :: gradients_type
      real(wp), allocatable :: value(:)                !! (npath)
      real(wp), allocatable :: by_q(:, :), by_p(:, :)  !! by the initial state (npath, ndof)
      real(wp), allocatable :: by_parameter(:, :)      !! (npath, nparameter)
      integer(i4), allocatable :: status(:)            !! 0 = ok (npath)
      integer(i8), allocatable :: failed_step(:)       !! -1 = none (npath)
      type(run_report) :: report
   end type gradients_type

   !> The end (q, p) of each path, and its derivatives by the beginning and by parameters.
   type :: tangents_type
      real(wp), allocatable :: q(:, :), p(:, :)        !! (npath, ndof)
      real(wp), allocatable :: matrix(:, :, :)         !! d(q_i or p_i)/d(q0_j or p0_j) (npath, 2 ndof, 2 ndof)
      real(wp), allocatable :: by_parameter(:, :, :)   !! (npath, 2 ndof, nparameter)
      integer(i4), allocatable :: status(:)            !! 0 = ok (npath)
      integer(i8), allocatable :: failed_step(:)       !! -1 = none (npath)
      type(run_report) :: report
   end type tangents_type

contains

   !> Differentiate f of each path by the initial state and by parameters, with the exact transposed derivative of every
   !> step. f is shown the states at saved times, options%save_every steps apart. Errors: those of simulate, parameters
   !> without a wide model or of another number than its further positions, and models or schemes without exact
   !> derivatives, which say why.
   subroutine path_gradients(model, scheme, options, q0, p0, f, result, error, wide, parameters, dw, monitor)
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in), target :: scheme
      type(run_options), intent(in) :: options
      real(wp), intent(in), target :: q0(:), p0(:)  !! initial state of all paths (ndof), or (npath*ndof) path first
      class(path_function), intent(in), target :: f
      type(gradients_type), intent(out), target :: result
      type(error_type), allocatable, intent(inout) :: error
      class(model_type), intent(in), target, optional :: wide        !! positions (q, parameters)
      real(wp), intent(in), optional :: parameters(:)                !! values that all paths have (nparameter)
      real(wp), intent(in), target, contiguous, optional :: dw(:, :, :)  !! increments (npath or 1, nnoise, rows)
      class(monitor_type), intent(inout), optional, target :: monitor
      class(model_type), pointer :: wider
      real(wp), allocatable :: theta(:, :), u(:, :)
      type(initial_state) :: from
      type(given_increments) :: given
      integer :: n

      call begin(model, options, q0, p0, from, wider, theta, error, wide, parameters)
      if (allocated(error)) return
      if (present(dw)) given = increments_of(dw)
      n = model%traits%ndof
      associate (npath => options%npath)
         allocate (result%value(npath), result%by_p(npath, n), result%status(npath), result%failed_step(npath))
         allocate (u(npath, n + size(theta, 2)))
      end associate
      call path_gradient(model, wider, scheme, options, from, theta, f, result%value, u, result%by_p, result%status, &
                         result%failed_step, result%report, error, given, monitor)
      result%by_q = u(:, :n)
      result%by_parameter = u(:, n + 1:)
   end subroutine path_gradients

   !> The tangent map of each path: the product of the exact derivatives of all steps. Errors: as path_gradients.
   subroutine path_tangents(model, scheme, options, q0, p0, result, error, wide, parameters, dw, monitor)
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in), target :: scheme
      type(run_options), intent(in) :: options
      real(wp), intent(in), target :: q0(:), p0(:)  !! initial state of all paths (ndof), or (npath*ndof) path first
      type(tangents_type), intent(out), target :: result
      type(error_type), allocatable, intent(inout) :: error
      class(model_type), intent(in), target, optional :: wide        !! positions (q, parameters)
      real(wp), intent(in), optional :: parameters(:)                !! values that all paths have (nparameter)
      real(wp), intent(in), target, contiguous, optional :: dw(:, :, :)  !! increments (npath or 1, nnoise, rows)
      class(monitor_type), intent(inout), optional, target :: monitor
      class(model_type), pointer :: wider
      real(wp), allocatable :: theta(:, :), v(:, :, :), logs(:, :)
      type(initial_state) :: from
      type(given_increments) :: given
      integer :: i, n

      call begin(model, options, q0, p0, from, wider, theta, error, wide, parameters)
      if (allocated(error)) return
      if (present(dw)) given = increments_of(dw)
      n = model%traits%ndof
      associate (npath => options%npath, m => 2*n + size(theta, 2))
         allocate (result%q(npath, n), result%p(npath, n), result%status(npath), result%failed_step(npath))
         allocate (v(npath, 2*n, m), logs(npath, m))
      end associate
      v = 0
      do i = 1, 2*n
         v(:, i, i) = 1
      end do
      call path_tangent(model, wider, scheme, options, from, theta, 0_i8, v, logs, result%q, result%p, result%status, &
                        result%failed_step, result%report, error, given, monitor)
      result%matrix = v(:, :, :2*n)
      result%by_parameter = v(:, :, 2*n + 1:)
   end subroutine path_tangents

   !> The initial state, the wide model and the values of its parameters.
   subroutine begin(model, options, q0, p0, from, wider, theta, error, wide, parameters)
      class(model_type), intent(in), target :: model
      type(run_options), intent(in) :: options
      real(wp), intent(in), target :: q0(:), p0(:)
      type(initial_state), intent(out) :: from
      class(model_type), pointer, intent(out) :: wider
      real(wp), allocatable, intent(out) :: theta(:, :)   !! (1, nparameter)
      type(error_type), allocatable, intent(inout) :: error
      class(model_type), intent(in), target, optional :: wide
      real(wp), intent(in), optional :: parameters(:)

      wider => model
      if (allocated(error)) return
      call check_options(options, error)
      if (allocated(error)) return
      if (present(wide) .neqv. present(parameters)) then
         call raise(error, wrong_shape, 'path_gradients', 'parameters are the further positions of a wide '// &
                    'model: give both, or none of the two')
         return
      end if
      if (present(wide)) then
         wider => wide
         allocate (theta(1, size(parameters)))
         theta(1, :) = parameters
      else
         allocate (theta(1, 0))
      end if
      call begin_at(from, model%traits%ndof, q0, p0)
   end subroutine begin

end module symsde_diagnose_gradients
