! SPDX-License-Identifier: BSD-3-Clause
!> Diagnostics: symplecticity, discrete action, Euler-Lagrange residuals, exact solutions.
module symsde_capi_diagnose
   use, intrinsic :: iso_c_binding, only: c_associated, c_int, c_int64_t, c_ptr
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type, raise, invalid_argument, callback_failed
   use symsde_base_text, only: to_text
   use symsde_capi_arrays, only: view
   use symsde_capi_error, only: finish, require, check_sizes
   use symsde_capi_input, only: run_input, read_input
   use symsde_capi_model, only: use_model
   use symsde_capi_monitor, only: callback_monitor
   use symsde_capi_options, only: read_options
   use symsde_capi_scheme, only: find_scheme
   use symsde_diagnose_action, only: discrete_action, euler_lagrange_residual
   use symsde_diagnose_exact, only: exact_solution
   use symsde_diagnose_symplecticity, only: symplecticity_defect
   use symsde_ensemble_options, only: run_options, saved_count
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: read_run
   public :: symsde_symplecticity, symsde_discrete_action, symsde_euler_lagrange_residual, symsde_exact_solution

   integer, parameter :: of_action = 1, of_residual = 2

contains

   !> Compute defect[npoint] of one step.
   function symsde_symplecticity(model, scheme, options, npoint, q, p, dw, defect, error) result(status) &
      bind(c, name='symsde_symplecticity')
      type(c_ptr), intent(in), value :: model, scheme, options, q, p, dw, defect, error
      integer(c_int64_t), intent(in), value :: npoint
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: m
      class(model_type), allocatable, target :: own
      type(scheme_type), pointer :: s
      type(run_options) :: o
      type(callback_monitor) :: monitor
      real(wp), pointer, contiguous :: qs(:, :), ps(:, :), dws(:, :, :), defects(:)
      integer(i8) :: n

      call read_run(model, scheme, options, own, m, s, o, refusal, monitor)
      if (npoint < 1 .or. npoint > huge(0)) &
         call raise(refusal, invalid_argument, 'symsde_symplecticity', 'npoint = '//to_text(npoint)// &
                    ' is out of range: give 1 to '//to_text(huge(0)))
      call require_arrays(m, q, p, dw, defect, 'defect', refusal)
      if (.not. allocated(refusal)) then
         n = m%traits%ndof
         call view(q, npoint, n, qs)
         call view(p, npoint, n, ps)
         call view_increments(dw, q, npoint, m%traits%nnoise, 1_i8, dws)
         call view(defect, npoint, defects)
         call symplecticity_defect(m, s, o, qs, ps, dws(:, :, 1), defects, refusal, monitor=monitor)
      end if
      status = end_diagnosis(refusal, m, error)
   end function symsde_symplecticity

   !> Compute action[steps][paths].
   function symsde_discrete_action(model, scheme, options, q, p, dw, action, error) result(status) &
      bind(c, name='symsde_discrete_action')
      type(c_ptr), intent(in), value :: model, scheme, options, q, p, dw, action, error
      integer(c_int) :: status

      status = diagnose_paths(of_action, model, scheme, options, q, p, dw, action, error)
   end function symsde_discrete_action

   !> Compute residual[4][paths].
   function symsde_euler_lagrange_residual(model, scheme, options, q, p, dw, residual, error) result(status) &
      bind(c, name='symsde_euler_lagrange_residual')
      type(c_ptr), intent(in), value :: model, scheme, options, q, p, dw, residual, error
      integer(c_int) :: status

      status = diagnose_paths(of_residual, model, scheme, options, q, p, dw, residual, error)
   end function symsde_euler_lagrange_residual

   !> Compute q, p [ntime][ndof][paths] of the exact solution.
   function symsde_exact_solution(model, scheme, options, input, q, p, error) result(status) &
      bind(c, name='symsde_exact_solution')
      type(c_ptr), intent(in), value :: model, scheme, options, input, q, p, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: m
      class(model_type), allocatable, target :: own
      type(scheme_type), pointer :: s
      type(run_options) :: o
      type(run_input) :: from
      type(callback_monitor) :: monitor
      real(wp), pointer, contiguous :: qs(:, :, :), ps(:, :, :), dw(:, :, :)
      real(wp), allocatable, target :: ordered(:, :, :)
      integer(i8) :: n, ntime

      call read_run(model, scheme, options, own, m, s, o, refusal, monitor)
      call require(q, 'q', refusal)
      call require(p, 'p', refusal)
      if (.not. allocated(refusal)) then
         n = m%traits%ndof
         ntime = saved_count(o)
         call check_sizes(ntime, n, o%npath, 'q', refusal)
         call read_input(input, m%traits%ndof, o%npath, from, refusal)
      end if
      if (.not. allocated(refusal)) then
         call view(q, o%npath, n, ntime, qs)
         call view(p, o%npath, n, ntime, ps)
         nullify (dw)
         if (from%dw%exist()) then
            call from%dw%in_order(ordered)
            dw => ordered
         end if
         call exact_solution(m, o, from%q0, from%p0, qs, ps, refusal, dw, s, monitor)
      end if
      status = end_diagnosis(refusal, m, error)
   end function symsde_exact_solution

   !> Diagnose all paths of a run with save_every = 1 and its increments; action and residual call this.
   function diagnose_paths(what, model, scheme, options, q, p, dw, output, error) result(status)
      integer, intent(in) :: what
      type(c_ptr), intent(in) :: model, scheme, options, q, p, dw, output, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: m
      class(model_type), allocatable, target :: own
      type(scheme_type), pointer :: s
      type(run_options) :: o
      type(callback_monitor) :: monitor
      real(wp), pointer, contiguous :: qs(:, :, :), ps(:, :, :), dws(:, :, :), to(:, :)
      integer(i8) :: n

      call read_run(model, scheme, options, own, m, s, o, refusal, monitor)
      call require_arrays(m, q, p, dw, output, 'the output', refusal)
      if (.not. allocated(refusal)) then
         n = m%traits%ndof
         call check_sizes(o%nstep + 1, max(n, int(m%traits%nnoise, i8)), o%npath, 'q', refusal)
      end if
      if (.not. allocated(refusal)) then
         call view(q, o%npath, n, o%nstep + 1, qs)
         call view(p, o%npath, n, o%nstep + 1, ps)
         call view_increments(dw, q, o%npath, m%traits%nnoise, o%nstep, dws)
         call view(output, o%npath, merge(o%nstep, 4_i8, what == of_action), to)
         if (what == of_action) call discrete_action(m, s, o, qs, ps, dws, to, refusal, monitor)
         if (what == of_residual) call euler_lagrange_residual(m, s, o, qs, ps, dws, to, refusal, monitor)
      end if
      status = end_diagnosis(refusal, m, error)
   end function diagnose_paths

   !> Read model, scheme and options of a diagnosis, and clear the record of failed callbacks.
   subroutine read_run(model, scheme, options, own, m, s, o, error, monitor)
      type(c_ptr), intent(in) :: model, scheme, options
      class(model_type), allocatable, intent(inout), target :: own   !! memory for the model, see use_model
      class(model_type), pointer, intent(out) :: m
      type(scheme_type), pointer, intent(out) :: s
      type(run_options), intent(out) :: o
      type(error_type), allocatable, intent(inout) :: error
      type(callback_monitor), intent(out), optional :: monitor   !! monitor of the options

      call use_model(model, own, m, error)
      call find_scheme(scheme, s, error)
      call read_options(options, o, error, monitor)
   end subroutine read_run

   !> Check the arrays of a diagnosis; without noise dw may be NULL.
   subroutine require_arrays(model, q, p, dw, output, what, error)
      class(model_type), pointer, intent(in) :: model
      type(c_ptr), intent(in) :: q, p, dw, output
      character(*), intent(in) :: what   !! name of the output
      type(error_type), allocatable, intent(inout) :: error

      call require(q, 'q', error)
      call require(p, 'p', error)
      if (associated(model)) then
         if (model%traits%nnoise > 0) call require(dw, 'dw', error)
      end if
      call require(output, what, error)
   end subroutine require_arrays

   !> View the caller's increments. Without noise there are none, and the array of extent zero gets the address of q.
   subroutine view_increments(dw, q, npath, nnoise, nstep, increments)
      type(c_ptr), intent(in) :: dw, q
      integer(i8), intent(in) :: npath, nstep
      integer, intent(in) :: nnoise
      real(wp), pointer, contiguous, intent(out) :: increments(:, :, :)  !! (npath, nnoise, nstep)

      if (c_associated(dw)) then
         call view(dw, npath, int(nnoise, i8), nstep, increments)
      else
         call view(q, npath, int(nnoise, i8), nstep, increments)
      end if
   end subroutine view_increments

   !> The status of a diagnosis: the failure of a callback, which may be the cause of a refusal, else the refusal.
   function end_diagnosis(refusal, model, error) result(status)
      type(error_type), allocatable, intent(in) :: refusal
      class(model_type), pointer, intent(in) :: model
      type(c_ptr), intent(in) :: error
      integer(c_int) :: status
      type(error_type), allocatable :: none
      integer :: code

      code = 0
      if (associated(model)) code = model%failure_code()
      if (code == 0) then
         status = finish(refusal, error)
      else
         status = finish(none, error, callback_failed, 'a callback returned '//to_text(code)// &
                         ' during the diagnosis: its result is not valid')
      end if
   end function end_diagnosis

end module symsde_capi_diagnose
