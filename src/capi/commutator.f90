! SPDX-License-Identifier: BSD-3-Clause
!> Test whether the noises of a model commute, by brackets at sample points.
module symsde_capi_commutator
   use, intrinsic :: iso_c_binding, only: c_double, c_f_pointer, c_funptr, c_int, c_int32_t, c_int64_t, c_null_ptr, &
                                                                             c_ptr, c_size_t
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type, raise, invalid_argument, callback_failed
   use symsde_base_text, only: to_text
   use symsde_capi_arrays, only: view
   use symsde_capi_error, only: finish, require
   use symsde_capi_model, only: use_model
   use symsde_capi_monitor, only: callback_monitor, new_callback_monitor
   use symsde_capi_text, only: put_text
   use symsde_diagnose_commutator, only: commutator, commutator_type
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: symsde_commutator

contains

   !> Compute the largest relative gradients of the brackets over the points, whether the noises commute, and a sentence
   !> about the result.
   function symsde_commutator(model, t, npoint, q, p, gradients, commute, text, size, progress, user, error) &
      result(status) bind(c, name='symsde_commutator')
      type(c_ptr), intent(in), value :: model
      real(c_double), intent(in), value :: t
      integer(c_int64_t), intent(in), value :: npoint
      type(c_ptr), intent(in), value :: q, p, gradients, commute, text, user, error
      integer(c_size_t), intent(in), value :: size
      type(c_funptr), intent(in), value :: progress
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(commutator_type) :: found
      class(model_type), pointer :: m
      class(model_type), allocatable, target :: own
      real(wp), pointer, contiguous :: qs(:, :), ps(:, :), largest(:)
      integer(c_int32_t), pointer :: flags(:)
      type(callback_monitor) :: monitor
      integer :: code

      code = 0
      call use_model(model, own, m, refusal)
      call require(q, 'q', refusal)
      call require(p, 'p', refusal)
      call require(gradients, 'gradients', refusal)
      call require(commute, 'commute', refusal)
      if (npoint < 1 .or. npoint > huge(0)) &
         call raise(refusal, invalid_argument, 'symsde_commutator', 'npoint = '//to_text(npoint)// &
                    ' is out of range: give 1 to '//to_text(huge(0)))
      if (.not. allocated(refusal)) then
         call view(q, npoint, int(m%traits%ndof, i8), qs)
         call view(p, npoint, int(m%traits%ndof, i8), ps)
         call view(gradients, 2_i8, largest)
         call c_f_pointer(commute, flags, [2])
         call new_callback_monitor(monitor, progress, user)
         call commutator(m, t, qs, ps, found, refusal, monitor)
         code = m%failure_code()
      end if
      if (.not. allocated(refusal) .and. code == 0) then
         largest(1) = found%noise
         largest(2) = found%drift
         flags(1) = merge(1_c_int32_t, 0_c_int32_t, found%commutative)
         flags(2) = merge(1_c_int32_t, 0_c_int32_t, found%flows_commute)
         call put_text(found%text, text, size, c_null_ptr)
      end if
      if (code == 0) then
         status = finish(refusal, error)
      else
         status = finish(refusal, error, callback_failed, 'a callback returned '//to_text(code)// &
                         ' at one of the points: nothing is known of the brackets')
      end if
   end function symsde_commutator

end module symsde_capi_commutator
