! SPDX-License-Identifier: BSD-3-Clause
!> The path between two positions that makes the discrete action stationary.
module symsde_capi_boundary_value
   use, intrinsic :: iso_c_binding, only: c_associated, c_int, c_ptr
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: error_type, status_ok, callback_failed, paths_failed
   use symsde_base_text, only: to_text
   use symsde_capi_arrays, only: view
   use symsde_capi_diagnose, only: read_run
   use symsde_capi_error, only: finish, require, check_sizes
   use symsde_capi_monitor, only: callback_monitor
   use symsde_diagnose_boundary_value, only: stationary_path
   use symsde_ensemble_options, only: run_options
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: symsde_stationary_path

contains

   !> Shapes: q, p[steps+1][ndof][paths] and status[paths].
   function symsde_stationary_path(model, scheme, options, q_start, q_end, dw, guess_q, guess_p, q, p, path_status, &
                                   error) result(status) bind(c, name='symsde_stationary_path')
      type(c_ptr), intent(in), value :: model, scheme, options, q_start, q_end, dw, guess_q, guess_p
      type(c_ptr), intent(in), value :: q, p, path_status, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: m
      class(model_type), allocatable, target :: own
      type(scheme_type), pointer :: s
      type(run_options) :: o
      type(callback_monitor) :: monitor
      real(wp), pointer, contiguous :: from(:, :), to(:, :), given(:, :, :), qs(:, :, :), ps(:, :, :)
      real(wp), pointer, contiguous :: gq(:, :, :), gp(:, :, :)
      integer(i4), pointer, contiguous :: codes(:)
      integer(i8) :: n, ntime, rows

      call read_run(model, scheme, options, own, m, s, o, refusal, monitor)
      call require(q_start, 'q_start', refusal)
      call require(q_end, 'q_end', refusal)
      call require(q, 'q', refusal)
      call require(p, 'p', refusal)
      call require(path_status, 'path_status', refusal)
      if (.not. allocated(refusal)) then
         n = m%traits%ndof
         ntime = o%nstep + 1
         call check_sizes(ntime, n, o%npath, 'q', refusal)
         rows = o%nstep*2_i8**max(0, min(o%refine, 30))
         call check_sizes(rows, int(m%traits%nnoise, i8), o%npath, 'dw', refusal)
      end if
      nullify (given, gq, gp)
      if (.not. allocated(refusal)) then
         call view(q_start, o%npath, n, from)
         call view(q_end, o%npath, n, to)
         call view(q, o%npath, n, ntime, qs)
         call view(p, o%npath, n, ntime, ps)
         call view(path_status, o%npath, codes)
         if (c_associated(dw)) &
            call view(dw, o%npath, int(m%traits%nnoise, i8), rows, given)
         if (c_associated(guess_q)) call view(guess_q, o%npath, n, ntime, gq)
         if (c_associated(guess_p)) call view(guess_p, o%npath, n, ntime, gp)
         ! a null pointer counts as an absent argument
         call stationary_path(m, s, o, from, to, qs, ps, codes, refusal, given, gq, gp, monitor=monitor)
      end if
      if (allocated(refusal)) then
         status = finish(refusal, error)
      else
         status = outcome(m%failure_code(), codes, error)
      end if
   end function symsde_stationary_path

   !> The status of the call: code if a callback failed, else whether some paths failed.
   function outcome(code, codes, error) result(status)
      integer, intent(in) :: code
      integer(i4), intent(in) :: codes(:)
      type(c_ptr), intent(in) :: error
      integer(c_int) :: status
      type(error_type), allocatable :: none

      if (code /= 0) then
         status = finish(none, error, callback_failed, 'a callback returned '//to_text(code)// &
                         ' during the search: its result is not valid')
      else if (any(codes /= status_ok)) then
         status = finish(none, error, paths_failed, to_text(count(codes /= status_ok))//' of '// &
                         to_text(size(codes))//' paths were not found: see their status (singular: the end '// &
                         'points are conjugate)')
      else
         status = finish(none, error)
      end if
   end function outcome

end module symsde_capi_boundary_value
