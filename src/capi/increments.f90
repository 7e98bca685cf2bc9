! SPDX-License-Identifier: BSD-3-Clause
!> The increments that drive a run, asked of the same noise source that drives it.
module symsde_capi_increments
   use, intrinsic :: iso_c_binding, only: c_int, c_ptr
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: default_nlane, path_of_lane
   use symsde_base_status, only: error_type
   use symsde_capi_arrays, only: view
   use symsde_capi_error, only: finish, require, check_sizes
   use symsde_capi_model, only: find_model
   use symsde_capi_options, only: read_options
   use symsde_ensemble_driver, only: new_noise
   use symsde_ensemble_options, only: run_options
   use symsde_model_abstract, only: model_type
   use symsde_noise_source, only: noise_type
   implicit none
   private
   public :: symsde_increments

contains

   !> dw[steps][nnoise][paths].
   function symsde_increments(model, options, dw, error) result(status) bind(c, name='symsde_increments')
      type(c_ptr), intent(in), value :: model, options, dw, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: m
      class(noise_type), allocatable :: noise
      type(run_options) :: o
      real(wp), pointer, contiguous :: to(:, :, :)
      real(wp) :: lost
      integer(i8) :: first

      call find_model(model, m, refusal)
      call read_options(options, o, refusal)
      if (.not. allocated(refusal)) call check_sizes(o%nstep, int(m%traits%nnoise, i8), o%npath, 'dw', refusal)
      if (.not. allocated(refusal)) call new_noise(noise, m, o, lost, refusal)
      if (.not. allocated(refusal)) then
         if (noise%nnoise > 0 .and. o%nstep > 0) call require(dw, 'dw', refusal)
         if (noise%nnoise > 0 .and. o%nstep > 0 .and. .not. allocated(refusal)) then
            call view(dw, o%npath, int(noise%nnoise, i8), o%nstep, to)
            do first = 0, o%npath - 1, default_nlane
               call fill_block(noise, o, first, to)
            end do
         end if
      end if
      status = finish(refusal, error)
   end function symsde_increments

   !> The paths of one block; the source makes the steps 2j and 2j+1 together, of which a run may begin
   !> with the second or end with the first.
   subroutine fill_block(noise, options, first, dw)
      class(noise_type), intent(in) :: noise
      type(run_options), intent(in) :: options
      integer(i8), intent(in) :: first                    !! paths before the block
      real(wp), intent(inout), contiguous :: dw(:, :, :)  !! (npath, nnoise, nstep)
      real(wp) :: w(default_nlane, 0:noise%nnoise, 0:1)
      integer(i8) :: path(default_nlane), pair, n, drawn
      integer :: half, k, nreal

      nreal = int(min(int(default_nlane, i8), options%npath - first))
      call path_of_lane(default_nlane, options%first_path + first, nreal, path)
      w = 0
      drawn = 0
      do pair = options%first_step/2, (options%first_step + options%nstep - 1)/2
         call noise%fill(default_nlane, path, pair, w, drawn)
         do half = 0, 1
            n = 2*pair + half - options%first_step + 1
            if (n < 1 .or. n > options%nstep) cycle
            do k = 1, noise%nnoise
               dw(first + 1:first + nreal, k, n) = w(:nreal, k, half)
            end do
         end do
      end do
   end subroutine fill_block

end module symsde_capi_increments
