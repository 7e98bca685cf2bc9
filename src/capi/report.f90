! SPDX-License-Identifier: BSD-3-Clause
!> struct symsde_report, and the sentence for the outcome of a run.
module symsde_capi_report
   use, intrinsic :: iso_c_binding, only: &
      c_associated, c_char, c_double, c_f_pointer, c_int, c_int32_t, c_int64_t, c_loc, &
      c_ptr, c_size_t, c_sizeof
   use symsde_base_status, only: error_type, status_ok, status_text, callback_failed, stopped, paths_failed
   use symsde_base_text, only: counted, to_text
   use symsde_capi_error, only: finish, init_struct, take_struct, give_struct
   use symsde_capi_text, only: put_chars
   use symsde_ensemble_run_report, only: run_report
   implicit none
   private
   public :: check_report, give_report, end_run, symsde_report_init

   !> struct symsde_report
   type, bind(c) :: c_report
      integer(c_size_t) :: struct_size
      integer(c_int32_t) :: status
      integer(c_int32_t) :: correction
      integer(c_int64_t) :: path_steps, normals, gradients, hessians, hessian_vectors, iterations, solves, lapack_solves
      integer(c_int64_t) :: failures, damped, continued
      integer(c_int64_t) :: failed, stopped
      integer(c_int32_t) :: threads, lanes
      real(c_double) :: lost_variance
      real(c_double) :: seconds_setup, seconds_run
      character(kind=c_char) :: stepper(64)
      character(kind=c_char) :: left_out(512)
      character(kind=c_char) :: warnings(2048)
      character(kind=c_char) :: functionals(32)
      integer(c_int64_t) :: pivoted_solves
      character(kind=c_char) :: lapack(128)
      integer(c_int64_t) :: grown
      character(kind=c_char) :: damping(192)
   end type c_report

contains

   !> An empty report.
   function symsde_report_init(report) result(status) bind(c, name='symsde_report_init')
      type(c_ptr), intent(in), value :: report
      integer(c_int) :: status
      type(c_report), target :: blank
      type(run_report) :: none

      call fill_report(none, blank)
      status = init_struct(report, 'report', c_loc(blank), c_sizeof(blank))
   end function symsde_report_init

   !> Refuse, before the run, a struct that cannot be filled; NULL means that no report is wanted.
   subroutine check_report(given, error)
      type(c_ptr), intent(in) :: given   !! symsde_report
      type(error_type), allocatable, intent(inout) :: error
      type(c_report), target :: copy

      if (c_associated(given)) call take_struct(given, 'report', c_loc(copy), c_sizeof(copy), error)
   end subroutine check_report

   !> The status of a run: the refusal, or its outcome with the report filled in.
   function end_run(refusal, code, report, given, error) result(status)
      type(error_type), allocatable, intent(in) :: refusal
      integer, intent(in) :: code              !! return value of a failed callback
      type(run_report), intent(in) :: report
      type(c_ptr), intent(in) :: given         !! symsde_report, may be NULL
      type(c_ptr), intent(in) :: error         !! symsde_error, may be NULL
      integer(c_int) :: status
      character(:), allocatable :: sentence

      if (allocated(refusal)) then
         status = finish(refusal, error)
      else
         call give_report(report, given)
         call outcome_sentence(report, code, sentence)
         status = finish(refusal, error, report%status, sentence)
      end if
   end function end_run

   !> Fill the caller's report.
   subroutine give_report(report, given)
      type(run_report), intent(in) :: report
      type(c_ptr), intent(in) :: given        !! symsde_report, checked by check_report; may be NULL
      type(c_report), target :: copy
      type(c_report), pointer :: filled

      if (.not. c_associated(given)) return
      call c_f_pointer(given, filled)
      copy%struct_size = filled%struct_size
      call fill_report(report, copy)
      call give_struct(c_loc(copy), given)
   end subroutine give_report

   !> Fill all members but struct_size.
   subroutine fill_report(r, c)
      type(run_report), intent(in) :: r
      type(c_report), intent(inout) :: c

      c%status = r%status
      c%correction = r%correction
      c%path_steps = r%counters%steps
      c%normals = r%counters%normals
      c%gradients = r%counters%gradients
      c%hessians = r%counters%hessians
      c%hessian_vectors = r%counters%hessian_vectors
      c%iterations = r%counters%iterations
      c%solves = r%counters%solves
      c%lapack_solves = r%counters%lapack_solves
      c%pivoted_solves = r%counters%pivoted_solves
      c%failures = r%counters%failures
      c%damped = r%counters%damped
      c%continued = r%counters%continued
      c%failed = r%nfailed
      c%stopped = r%nstopped
      c%threads = r%nthread
      c%lanes = r%nlane
      c%lost_variance = r%lost_variance
      c%seconds_setup = r%seconds_setup
      c%seconds_run = r%seconds_run
      call put(r%stepper, c%stepper)
      call put(r%left_out, c%left_out)
      call put(r%warnings, c%warnings)
      c%grown = r%ngrown
      call put(r%functionals, c%functionals)
      call put(r%lapack, c%lapack)
      call put(r%damping, c%damping)

   contains

      pure subroutine put(text, chars)
         character(:), allocatable, intent(in) :: text
         character(kind=c_char), intent(out) :: chars(:)

         if (allocated(text)) then
            call put_chars(text, chars)
         else
            call put_chars('', chars)
         end if
      end subroutine put

   end subroutine fill_report

   !> Write what the outcome of a run means, and where the cause may be found.
   pure subroutine outcome_sentence(report, code, text)
      type(run_report), intent(in) :: report
      integer, intent(in) :: code              !! return value of a failed callback
      character(:), allocatable, intent(out) :: text

      select case (report%status)
      case (status_ok)
         text = ''
      case (callback_failed)
         text = 'a callback returned '//to_text(code)//' and the run was aborted: results are NaN from there on'
      case (stopped)
         text = 'the run was stopped on request: '//counted(to_text(report%nstopped), 'path')// &
                ' did not reach the end, their values are NaN from there on'
      case (paths_failed)
         text = counted(to_text(report%nfailed), 'path')//' failed, their values are NaN from there on: '// &
                'see the status and the failed step of each, and try a smaller step'
      case default
         text = status_text(report%status)
      end select
   end subroutine outcome_sentence

end module symsde_capi_report
