! SPDX-License-Identifier: BSD-3-Clause
!> Schemes from schemes: adjoint, symmetric composition, triple jump, fractions of a step.
module symsde_capi_composition
   use, intrinsic :: iso_c_binding, only: c_associated, c_int, c_ptr
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type
   use symsde_capi_arrays, only: view
   use symsde_capi_error, only: finish, require
   use symsde_capi_scheme, only: find_scheme, begin_handle, new_handle, check_stages
   use symsde_capi_text, only: read_text
   use symsde_scheme_composition, only: adjoint_scheme, composed_scheme, symmetric_composition, triple_jump
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: symsde_scheme_adjoint, symsde_scheme_symmetric_composition, symsde_scheme_triple_jump
   public :: symsde_scheme_compose

   integer, parameter :: of_adjoint = 1, of_symmetric = 2, of_jump = 3

contains

   !> The adjoint of a scheme: the inverse map of a step back in time.
   function symsde_scheme_adjoint(base, name, scheme, error) result(status) bind(c, name='symsde_scheme_adjoint')
      type(c_ptr), intent(in), value :: base, name, scheme, error
      integer(c_int) :: status

      status = derive(of_adjoint, base, name, scheme, error)
   end function symsde_scheme_adjoint

   !> Half a step of the scheme, then half a step of its adjoint.
   function symsde_scheme_symmetric_composition(base, name, scheme, error) result(status) &
      bind(c, name='symsde_scheme_symmetric_composition')
      type(c_ptr), intent(in), value :: base, name, scheme, error
      integer(c_int) :: status

      status = derive(of_symmetric, base, name, scheme, error)
   end function symsde_scheme_symmetric_composition

   !> The triple jump of a symmetric scheme: three steps, the second one back in time.
   function symsde_scheme_triple_jump(base, name, scheme, error) result(status) &
      bind(c, name='symsde_scheme_triple_jump')
      type(c_ptr), intent(in), value :: base, name, scheme, error
      integer(c_int) :: status

      status = derive(of_jump, base, name, scheme, error)
   end function symsde_scheme_triple_jump

   !> Derive a scheme from another one, named by the caller or by default; all three derivations call this.
   function derive(what, base, name, scheme, error) result(status)
      integer, intent(in) :: what
      type(c_ptr), intent(in) :: base, name, scheme, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(scheme_type), pointer :: known
      type(scheme_type) :: made
      character(:), allocatable :: text

      call begin_handle(scheme, refusal)
      call find_scheme(base, known, refusal)
      if (c_associated(name)) call read_text(name, 'name', text, refusal)
      if (.not. allocated(refusal)) then
         select case (what)
         case (of_adjoint); call adjoint_scheme(made, known, refusal, text)
         case (of_symmetric); call symmetric_composition(made, known, refusal, text)
         case default; call triple_jump(made, known, refusal, text)
         end select
      end if
      call new_handle(made, scheme, refusal)
      status = finish(refusal, error)
   end function derive

   !> Compose several schemes: their steps one after the other, each over its fraction of the step.
   function symsde_scheme_compose(npart, parts, fractions, name, scheme, error) result(status) &
      bind(c, name='symsde_scheme_compose')
      integer(c_int), intent(in), value :: npart
      type(c_ptr), intent(in), value :: parts, fractions, name, scheme, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(scheme_type), pointer :: known
      type(scheme_type), allocatable :: chain(:)
      type(scheme_type) :: made
      type(c_ptr), pointer :: handles(:)
      real(wp), pointer, contiguous :: gamma(:)
      character(:), allocatable :: text
      integer :: i, extent(1)

      call begin_handle(scheme, refusal)
      call read_text(name, 'name', text, refusal)
      call check_stages(npart, 'npart', refusal)
      call require(parts, 'parts', refusal)
      call require(fractions, 'fractions', refusal)
      if (.not. allocated(refusal)) then
         extent(1) = npart
         call handles_at(parts, extent, handles)
         call view(fractions, int(npart, i8), gamma)
         allocate (chain(npart))
         do i = 1, npart
            call find_scheme(handles(i), known, refusal)
            if (associated(known)) chain(i) = known
         end do
         if (.not. allocated(refusal)) call composed_scheme(made, chain, gamma, text, refusal)
      end if
      call new_handle(made, scheme, refusal)
      status = finish(refusal, error)
   end function symsde_scheme_compose

   !> View the caller's array of handles.
   subroutine handles_at(address, extent, handles)
      use, intrinsic :: iso_c_binding, only: c_f_pointer
      type(c_ptr), intent(in) :: address
      integer, intent(in) :: extent(1)
      type(c_ptr), pointer, intent(out) :: handles(:)

      call c_f_pointer(address, handles, extent)
   end subroutine handles_at

end module symsde_capi_composition
