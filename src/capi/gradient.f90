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

   !> The arguments of both functions.
   type :: sweep_arguments
      class(model_type), pointer :: model => null(), wide => null()
      class(model_type), allocatable :: own, own_wide
      type(scheme_type), pointer :: scheme => null()
      type(run_options) :: options
      type(run_input) :: from
      type(initial_state) :: start
      real(wp), pointer, contiguous :: theta(:, :) => null()         !! (nrow, nparameter)
      real(wp) :: nothing(1, 0) = 0
      integer(i4), pointer, contiguous :: codes(:) => null()         !! (npath)
      integer(i8), pointer, contiguous :: failed_step(:) => null()   !! (npath)
   end type sweep_arguments

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
      type(sweep_arguments), target :: a
      type(run_report) :: outcome
      type(callback_function) :: function_of_path
      real(wp), pointer, contiguous :: values(:), u(:, :), c(:, :)
      integer(i4), target :: failure
      integer(i8) :: n
      integer :: code

      call read_arguments(a, 'symsde_path_gradient', model, wide, scheme, options, input, nparameter, nrow, &
                          parameters, codes, failed_step, report, refusal)
      call require_function(f, 'f', refusal)
      call require(value, 'value', refusal)
      call require(by_q, 'by_q', refusal)
      call require(by_p, 'by_p', refusal)
      n = 0
      if (.not. allocated(refusal)) then
         n = a%model%traits%ndof
         call check_sizes(n + nparameter, a%options%npath, 1_i8, 'by_q', refusal)
         call check_sizes(saved_count(a%options), n, 1_i8, 'the saved states', refusal)
      end if
      failure = 0
      if (.not. allocated(refusal)) then
         call view(value, a%options%npath, values)
         call view(by_q, a%options%npath, n + nparameter, u)
         call view(by_p, a%options%npath, n, c)
         call c_f_procpointer(f, function_of_path%on_path)
         function_of_path%user = user
         function_of_path%failure => failure
         call path_gradient(a%model, a%wide, a%scheme, a%options, a%start, a%theta, function_of_path, values, u, c, &
                            a%codes, a%failed_step, outcome, refusal, a%from%dw, a%from%monitor)
      end if
      code = failure
      if (code == 0 .and. associated(a%model)) code = a%model%failure_code()
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
      type(sweep_arguments), target :: a
      type(run_report) :: outcome
      real(wp), pointer, contiguous :: vectors(:, :, :), sums(:, :), q(:, :), p(:, :)
      integer(i8) :: n
      integer :: code

      call read_arguments(a, 'symsde_path_tangent', model, wide, scheme, options, input, nparameter, nrow, parameters, &
                          codes, failed_step, report, refusal)
      call require(v, 'v', refusal)
      call require(logs, 'logs', refusal)
      call require(last_q, 'last_q', refusal)
      call require(last_p, 'last_p', refusal)
      if (nvector < max(1, nparameter)) &
         call raise(refusal, invalid_argument, 'symsde_path_tangent', 'nvector = '//to_text(nvector)// &
                    ' is too small: give at least one vector, and one for each parameter')
      if (turn < 0) call raise(refusal, invalid_argument, 'symsde_path_tangent', 'turn = '//to_text(turn)// &
                               ' is negative: give a number of steps, or 0 for tangent maps')
      n = 0
      if (.not. allocated(refusal)) then
         n = a%model%traits%ndof
         call check_sizes(int(nvector, i8), 2*n, a%options%npath, 'v', refusal)
      end if
      if (.not. allocated(refusal)) then
         call view(v, a%options%npath, 2*n, int(nvector, i8), vectors)
         call view(logs, a%options%npath, int(nvector, i8), sums)
         call view(last_q, a%options%npath, n, q)
         call view(last_p, a%options%npath, n, p)
         call path_tangent(a%model, a%wide, a%scheme, a%options, a%start, a%theta, turn, vectors, sums, q, p, a%codes, &
                           a%failed_step, outcome, refusal, a%from%dw, a%from%monitor)
      end if
      code = 0
      if (associated(a%model)) code = a%model%failure_code()
      status = end_run(refusal, code, outcome, report, error)
   end function symsde_path_tangent

   !> Check and convert the arguments of both functions.
   subroutine read_arguments(a, place, model, wide, scheme, options, input, nparameter, nrow, parameters, codes, &
                             failed_step, report, refusal)
      type(sweep_arguments), intent(inout), target :: a
      character(*), intent(in) :: place
      type(c_ptr), intent(in) :: model, wide, scheme, options, input, parameters, codes, failed_step, report
      integer(c_int), intent(in) :: nparameter
      integer(c_int64_t), intent(in) :: nrow
      type(error_type), allocatable, intent(inout) :: refusal

      call use_model(model, a%own, a%model, refusal)
      call use_model(wide, a%own_wide, a%wide, refusal)
      call find_scheme(scheme, a%scheme, refusal)
      call read_options(options, a%options, refusal)
      call check_report(report, refusal)
      call require(codes, 'codes', refusal)
      call require(failed_step, 'failed_step', refusal)
      if (nparameter < 0) call raise(refusal, invalid_argument, place, 'nparameter = '//to_text(nparameter)// &
                                     ' is negative: give the number of parameters, or 0')
      if (nparameter > 0) call require(parameters, 'parameters', refusal)
      if (allocated(refusal)) return
      call read_input(input, a%model%traits%ndof, a%options%npath, a%from, refusal)
      call check_sizes(int(nparameter, i8), nrow, 1_i8, 'parameters', refusal)
      if (allocated(refusal)) return
      call begin_at(a%start, a%from)
      call view(codes, a%options%npath, a%codes)
      call view(failed_step, a%options%npath, a%failed_step)
      a%theta => a%nothing
      if (nparameter > 0) call view(parameters, nrow, int(nparameter, i8), a%theta)
   end subroutine read_arguments

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
