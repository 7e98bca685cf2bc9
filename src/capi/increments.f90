! SPDX-License-Identifier: BSD-3-Clause
!> The increments that drive a run, drawn from the noise source of the run.
module symsde_capi_increments
   use, intrinsic :: iso_c_binding, only: c_associated, c_int, c_ptr
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: default_nlane
   use symsde_base_memory, only: require_memory
   use symsde_base_status, only: error_type
   use symsde_base_text, only: to_text
   use symsde_capi_arrays, only: view
   use symsde_capi_error, only: finish, require, check_sizes
   use symsde_capi_model, only: find_model
   use symsde_capi_monitor, only: callback_monitor
   use symsde_capi_options, only: read_options
   use symsde_capi_scheme, only: find_scheme
   use symsde_ensemble_run_noise, only: new_noise
   use symsde_ensemble_run_increments, only: collect_increments
   use symsde_ensemble_options, only: run_options
   use symsde_ensemble_run_memory, only: noise_numbers
   use symsde_model_abstract, only: model_type
   use symsde_noise_source, only: noise_type
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: symsde_increments

contains

   !> Compute dw[steps][nnoise][paths].
   function symsde_increments(model, scheme, options, dw, error) result(status) bind(c, name='symsde_increments')
      type(c_ptr), intent(in), value :: model, scheme, options, dw, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: m
      type(scheme_type), pointer :: s
      class(noise_type), allocatable :: noise
      type(run_options) :: o
      type(callback_monitor) :: monitor
      real(wp), pointer, contiguous :: to(:, :, :)
      real(wp) :: lost

      call find_model(model, m, refusal)
      nullify (s)
      if (c_associated(scheme)) call find_scheme(scheme, s, refusal)
      call read_options(options, o, refusal, monitor)
      if (.not. allocated(refusal)) call check_sizes(o%nstep, int(m%traits%nnoise, i8), o%npath, 'dw', refusal)
      if (.not. allocated(refusal)) then
         if (associated(s)) then
            call new_noise(noise, m, o, lost, refusal, scheme=s)
         else
            call new_noise(noise, m, o, lost, refusal)
         end if
      end if
      if (.not. allocated(refusal)) &
         call require_memory(noise_numbers(noise%nnoise, noise%asked, default_nlane), &
                             'drawing the increments of '//to_text(noise%nnoise)//' noises', 'give fewer noises', &
                             'symsde_increments', refusal)
      if (.not. allocated(refusal)) then
         if (noise%nnoise > 0 .and. o%nstep > 0) call require(dw, 'dw', refusal)
         if (noise%nnoise > 0 .and. o%nstep > 0 .and. .not. allocated(refusal)) then
            call view(dw, o%npath, int(noise%nnoise, i8), o%nstep, to)
            call collect_increments(noise, o, to, refusal, monitor)
         end if
      end if
      status = finish(refusal, error)
   end function symsde_increments

end module symsde_capi_increments
