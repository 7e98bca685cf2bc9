! SPDX-License-Identifier: BSD-3-Clause
!> The probe of a model for C. The C function symsde_model_probe must not be compiled where a Fortran module of the
!> same name is in use, so it has a module of its own.
module symsde_capi_probe
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, invalid_argument
   use symsde_base_traits, only: model_traits
   use symsde_model_abstract, only: model_type
   use symsde_model_probe_traits, only: probe_model, find_traits
   implicit none
   private
   public :: probe_at, take_traits_at

contains

   !> Probe around a state. The probe skips points that a callback refuses. If the callback refuses the state
   !> itself, code is the callback's return value.
   subroutine probe_at(model, ndof, t, q, p, code, error)
      class(model_type), intent(in) :: model
      integer, intent(in) :: ndof
      real(wp), intent(in) :: t, q(ndof), p(ndof)
      integer, intent(out) :: code
      type(error_type), allocatable, intent(inout) :: error
      real(wp) :: hq(1, ndof), hp(1, ndof), w(1, 0:model%traits%nnoise), own_q(1, ndof), own_p(1, ndof)

      w = 1
      own_q(1, :) = q  ! copies, since a gradient may write into its inputs
      own_p(1, :) = p
      call model%clear_failure()
      call model%gradient(1, ndof, model%traits%nnoise, t, w, own_q, own_p, hq, hp)
      code = model%failure_code()
      if (code == 0) call probe_model(model, t, q, p, error)
   end subroutine probe_at

   !> Let a model declare every trait that its gradient does not refute around a state.
   subroutine take_traits_at(model, ndof, t, q, p, error)
      class(model_type), intent(inout) :: model
      integer, intent(in) :: ndof
      real(wp), intent(in) :: t, q(ndof), p(ndof)
      type(error_type), allocatable, intent(inout) :: error
      type(model_traits) :: found
      logical :: decided

      call model%require_gradient('symsde_model_set_probed_traits', 'a probe of traits', error)
      if (allocated(error)) return
      call find_traits(model, t, q, p, found, decided)
      if (.not. decided) then
         call raise(error, invalid_argument, 'symsde_model_set_probed_traits', 'the gradient of model '//model%name// &
                    ' is not finite at the points where its traits would be probed: declare its traits, or give '// &
                    'another state')
      else
         model%traits = found
         call model%passed%forget()
      end if
   end subroutine take_traits_at

end module symsde_capi_probe
