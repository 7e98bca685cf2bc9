! SPDX-License-Identifier: BSD-3-Clause
!> symsde_path_gradient: derivatives of a function of the path by the exact discrete adjoint. symsde_path_tangent:
!> tangent vectors and Lyapunov exponents.
module symsde_capi_gradient
   use, intrinsic :: iso_c_binding, only: c_double, c_f_procpointer, c_funptr, c_int, c_int64_t, c_ptr
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: error_type, raise, invalid_argument
   use symsde_base_text, only: to_text
   use symsde_capi_arrays, only: view
   use symsde_capi_error, only: require, require_function, check_sizes
   use symsde_capi_input, only: run_input, read_input, begin_at
   use symsde_capi_model, only: use_model
   use symsde_capi_options, only: read_options
   use symsde_capi_report, only: check_report, end_run
   use symsde_capi_scheme, only: find_scheme
   use symsde_diagnose_sweep_gradient, only: path_gradient
   use symsde_diagnose_sweep_path_function, only: path_function
   use symsde_diagnose_sweep_tangent, only: path_tangent
   use symsde_ensemble_block_initial_state, only: initial_state
   use symsde_ensemble_options, only: run_options, saved_count
   use symsde_ensemble_run_report, only: run_report
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: symsde_path_gradient, symsde_path_tangent

   !> A C function of the path. All threads share the object as intent(in); the record of failure is a pointer.
   type, extends(path_function) :: callback_function
      private
      procedure(path_callback), pointer, nopass :: on_path => null()
      type(c_ptr) :: user
      integer(i4), pointer :: failure => null()   !! first nonzero return value
   contains
      procedure :: find
      procedure :: failure_code
   end type callback_function

   abstract interface
      !> symsde_path_function
      function path_callback(first, nlane, ndof, ntime, nparameter, t, q, p, value, fq, fp, ftheta, user) bind(c) &
         result(code)
         import :: c_int, c_int64_t, c_double, c_ptr
         integer(c_int64_t), value :: first
         integer(c_int), value :: nlane, ndof, ntime, nparameter
         real(c_double), intent(in) :: t(ntime), q(nlane, ndof, ntime), p(nlane, ndof, ntime)
         real(c_double), intent(out) :: value(nlane)
         real(c_double), intent(inout) :: fq(nlane, ndof, ntime), fp(nlane, ndof, ntime), ftheta(nlane, *)
         type(c_ptr), value :: user
         integer(c_int) :: code
      end function path_callback
   end interface

contains

   !> Integrate all paths, and find f and its derivatives by the initial state and by parameters for each path.
   function symsde_path_gradient(model, wide, scheme, options, input, nparameter, nrow, parameters, f, user, value, &
                                 by_q, by_p, codes, failed_step, report, error) result(status) &
      bind(c, name='symsde_path_gradient')
      type(c_ptr), intent(in), value :: model, wide, scheme, options, input
      integer(c_int), intent(in), value :: nparameter
      integer(c_int64_t), intent(in), value :: nrow     !! values of each parameter: paths, or 1
      type(c_ptr), intent(in), value :: parameters      !! [nparameter][nrow]
      type(c_funptr), intent(in), value :: f
      type(c_ptr), intent(in), value :: user, value, by_q, by_p, codes, failed_step, report, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: m, w
      class(model_type), allocatable, target :: own, own_wide
      type(scheme_type), pointer :: s
      type(run_options) :: o
      type(run_input) :: from
      type(initial_state) :: start
      type(run_report) :: outcome
      type(callback_function) :: function_of_path
      real(wp), pointer, contiguous :: theta(:, :), values(:), u(:, :), c(:, :)
      real(wp), target :: nothing(1, 0)
      integer(i4), pointer, contiguous :: stati(:)
      integer(i4), target :: failure
      integer(i8), pointer, contiguous :: steps(:)
      integer(i8) :: n
      integer :: code

      call use_model(model, own, m, refusal)
      call use_model(wide, own_wide, w, refusal)
      call find_scheme(scheme, s, refusal)
      call read_options(options, o, refusal)
      call check_report(report, refusal)
      call require_function(f, 'f', refusal)
      call require(value, 'value', refusal)
      call require(by_q, 'by_q', refusal)
      call require(by_p, 'by_p', refusal)
      call require(codes, 'codes', refusal)
      call require(failed_step, 'failed_step', refusal)
      if (nparameter < 0) call raise(refusal, invalid_argument, 'symsde_path_gradient', 'nparameter = '// &
                                     to_text(nparameter)//' is negative: give the number of parameters, or 0')
      if (nparameter > 0) call require(parameters, 'parameters', refusal)
      if (.not. allocated(refusal)) then
         call read_input(input, m%traits%ndof, o%npath, from, refusal)
         call check_sizes(int(m%traits%ndof, i8) + nparameter, o%npath, 1_i8, 'by_q', refusal)
         call check_sizes(saved_count(o), int(m%traits%ndof, i8), 1_i8, 'the saved states', refusal)
         call check_sizes(int(nparameter, i8), nrow, 1_i8, 'parameters', refusal)
      end if
      failure = 0
      if (.not. allocated(refusal)) then
         n = m%traits%ndof
         theta => nothing
         if (nparameter > 0) call view(parameters, nrow, int(nparameter, i8), theta)
         call view(value, o%npath, values)
         call view(by_q, o%npath, n + nparameter, u)
         call view(by_p, o%npath, n, c)
         call view(codes, o%npath, stati)
         call view(failed_step, o%npath, steps)
         call c_f_procpointer(f, function_of_path%on_path)
         function_of_path%user = user
         function_of_path%failure => failure
         call begin_at(start, from)
         call path_gradient(m, w, s, o, start, theta, function_of_path, values, u, c, stati, steps, outcome, refusal, &
                            from%dw, from%monitor)
      end if
      code = failure
      if (code == 0 .and. associated(m)) code = m%failure_code()
      status = end_run(refusal, code, outcome, report, error)
   end function symsde_path_gradient

   !> Take tangent vectors through all steps of each path.
   function symsde_path_tangent(model, wide, scheme, options, input, nparameter, nrow, parameters, nvector, turn, v, &
                                logs, last_q, last_p, codes, failed_step, report, error) result(status) &
      bind(c, name='symsde_path_tangent')
      type(c_ptr), intent(in), value :: model, wide, scheme, options, input
      integer(c_int), intent(in), value :: nparameter
      integer(c_int64_t), intent(in), value :: nrow     !! values of each parameter: paths, or 1
      type(c_ptr), intent(in), value :: parameters      !! [nparameter][nrow]
      integer(c_int), intent(in), value :: nvector
      integer(c_int64_t), intent(in), value :: turn
      type(c_ptr), intent(in), value :: v, logs, last_q, last_p, codes, failed_step, report, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: m, w
      class(model_type), allocatable, target :: own, own_wide
      type(scheme_type), pointer :: s
      type(run_options) :: o
      type(run_input) :: from
      type(initial_state) :: start
      type(run_report) :: outcome
      real(wp), pointer, contiguous :: theta(:, :), vectors(:, :, :), sums(:, :), q(:, :), p(:, :)
      real(wp), target :: nothing(1, 0)
      integer(i4), pointer, contiguous :: stati(:)
      integer(i8), pointer, contiguous :: steps(:)
      integer(i8) :: n
      integer :: code

      call use_model(model, own, m, refusal)
      call use_model(wide, own_wide, w, refusal)
      call find_scheme(scheme, s, refusal)
      call read_options(options, o, refusal)
      call check_report(report, refusal)
      call require(v, 'v', refusal)
      call require(logs, 'logs', refusal)
      call require(last_q, 'last_q', refusal)
      call require(last_p, 'last_p', refusal)
      call require(codes, 'codes', refusal)
      call require(failed_step, 'failed_step', refusal)
      if (nparameter < 0) call raise(refusal, invalid_argument, 'symsde_path_tangent', 'nparameter = '// &
                                     to_text(nparameter)//' is negative: give the number of parameters, or 0')
      if (nvector < max(1, nparameter)) &
         call raise(refusal, invalid_argument, 'symsde_path_tangent', 'nvector = '//to_text(nvector)// &
                    ' is too small: give at least one vector, and one for each parameter')
      if (turn < 0) call raise(refusal, invalid_argument, 'symsde_path_tangent', 'turn = '//to_text(turn)// &
                               ' is negative: give a number of steps, or 0 for tangent maps')
      if (nparameter > 0) call require(parameters, 'parameters', refusal)
      if (.not. allocated(refusal)) then
         call read_input(input, m%traits%ndof, o%npath, from, refusal)
         call check_sizes(int(nvector, i8), 2_i8*m%traits%ndof, o%npath, 'v', refusal)
         call check_sizes(int(nparameter, i8), nrow, 1_i8, 'parameters', refusal)
      end if
      if (.not. allocated(refusal)) then
         n = m%traits%ndof
         theta => nothing
         if (nparameter > 0) call view(parameters, nrow, int(nparameter, i8), theta)
         call view(v, o%npath, 2*n, int(nvector, i8), vectors)
         call view(logs, o%npath, int(nvector, i8), sums)
         call view(last_q, o%npath, n, q)
         call view(last_p, o%npath, n, p)
         call view(codes, o%npath, stati)
         call view(failed_step, o%npath, steps)
         call begin_at(start, from)
         call path_tangent(m, w, s, o, start, theta, turn, vectors, sums, q, p, stati, steps, outcome, refusal, &
                           from%dw, from%monitor)
      end if
      code = 0
      if (associated(m)) code = m%failure_code()
      status = end_run(refusal, code, outcome, report, error)
   end function symsde_path_tangent

   !> Call the function until it has failed once; derivatives that it does not write are zero, and so are the
   !> derivatives of failed calls, whose values are NaN.
   subroutine find(self, first, nlane, ndof, ntime, nparameter, t, q, p, value, fq, fp, ftheta)
      class(callback_function), intent(in) :: self
      integer(i8), intent(in) :: first
      integer, intent(in) :: nlane, ndof, ntime, nparameter
      real(wp), intent(in) :: t(ntime), q(nlane, ndof, ntime), p(nlane, ndof, ntime)
      real(wp), intent(out) :: value(nlane)
      real(wp), intent(out) :: fq(nlane, ndof, ntime), fp(nlane, ndof, ntime), ftheta(nlane, nparameter)
      integer(c_int) :: code

      value = ieee_value(1.0_wp, ieee_quiet_nan)
      fq = 0
      fp = 0
      ftheta = 0
      if (self%failure_code() /= 0) return
      code = self%on_path(first, nlane, ndof, ntime, nparameter, t, q, p, value, fq, fp, ftheta, self%user)
      if (code == 0) return
      !$omp atomic write
      self%failure = code
   end subroutine find

   !> The nonzero code that the function returned when it failed; 0 = it has not failed.
   integer function failure_code(self) result(code)
      class(callback_function), intent(in) :: self

      !$omp atomic read
      code = self%failure
   end function failure_code

end module symsde_capi_gradient
