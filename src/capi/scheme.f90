! SPDX-License-Identifier: BSD-3-Clause
!> The handle of a scheme: create from the catalogue, a quadrature or a tableau; describe, delete.
module symsde_capi_scheme
   use, intrinsic :: iso_c_binding, only: &
      c_associated, c_f_pointer, c_int, c_loc, c_null_ptr, c_ptr, &
      c_size_t, c_sizeof
   use symsde_base_kinds, only: wp, i8
   use symsde_base_memory, only: require_reserve
   use symsde_base_status, only: error_type, raise, status_ok, null_handle, out_of_memory, wrong_shape
   use symsde_base_text, only: name_length, to_text
   use symsde_capi_arrays, only: view
   use symsde_capi_certificate, only: describe_scheme, c_scheme_info, fill_info
   use symsde_capi_error, only: finish, require, init_struct, take_struct, give_struct
   use symsde_capi_text, only: read_text, put_text, lines
   use symsde_scheme_catalogue, only: get_scheme, scheme_names
   use symsde_scheme_discrete_lagrangian, only: scheme_from_quadrature
   use symsde_scheme_scheme, only: scheme_type
   use symsde_scheme_tableau, only: scheme_from_tableau
   implicit none
   private
   public :: find_scheme, begin_handle, new_handle, check_stages
   public :: symsde_scheme_info_init, symsde_scheme_names, symsde_scheme_get, symsde_scheme_from_quadrature
   public :: symsde_scheme_from_tableau, symsde_scheme_delete, symsde_scheme_get_info
   public :: symsde_scheme_certificate

   integer(i8), parameter :: tag_of_scheme = int(z'736368656D65', i8)  !! 'scheme'; cleared when the handle is deleted
   integer, parameter :: most_stages = 1000 !! largest number of stages of a user's tableau or quadrature

   !> The object behind a symsde_scheme.
   type :: scheme_handle
      integer(i8) :: tag = tag_of_scheme
      type(scheme_type) :: scheme
   end type scheme_handle

contains

   !> The scheme of a handle; refuses NULL, deleted and foreign handles (null_handle).
   subroutine find_scheme(handle, scheme, error)
      type(c_ptr), intent(in) :: handle
      type(scheme_type), pointer, intent(out) :: scheme
      type(error_type), allocatable, intent(inout) :: error
      type(scheme_handle), pointer :: holder

      nullify (scheme)
      if (allocated(error)) return
      if (c_associated(handle)) then
         call c_f_pointer(handle, holder)
         if (holder%tag == tag_of_scheme) then
            scheme => holder%scheme
            return
         end if
      end if
      call raise(error, null_handle, 'find_scheme', 'scheme is NULL, deleted or not a scheme: '// &
                 'make one with symsde_scheme_get')
   end subroutine find_scheme

   !> Information about no scheme.
   function symsde_scheme_info_init(info) result(status) bind(c, name='symsde_scheme_info_init')
      type(c_ptr), intent(in), value :: info
      integer(c_int) :: status
      type(c_scheme_info), target :: blank

      status = init_struct(info, 'info', c_loc(blank), c_sizeof(blank))
   end function symsde_scheme_info_init

   !> Names of the catalogue, one a line.
   function symsde_scheme_names(buffer, size, needed) result(status) bind(c, name='symsde_scheme_names')
      type(c_ptr), intent(in), value :: buffer, needed
      integer(c_size_t), intent(in), value :: size
      integer(c_int) :: status
      character(len=name_length), allocatable :: names(:)

      allocate (names(0))
      names = scheme_names()
      call put_text(lines(names), buffer, size, needed)
      status = status_ok
   end function symsde_scheme_names

   !> Create a scheme of the catalogue.
   function symsde_scheme_get(name, scheme, error) result(status) bind(c, name='symsde_scheme_get')
      type(c_ptr), intent(in), value :: name, scheme, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      character(:), allocatable :: text
      type(scheme_type) :: made

      call begin_handle(scheme, refusal)
      call read_text(name, 'name', text, refusal)
      if (.not. allocated(refusal)) call get_scheme(made, text, refusal)
      call new_handle(made, scheme, refusal)
      status = finish(refusal, error)
   end function symsde_scheme_get

   !> Create the scheme of a quadrature of the action.
   function symsde_scheme_from_quadrature(nnode, nodes, weights, noise_weights, degree, name, scheme, error) &
      result(status) bind(c, name='symsde_scheme_from_quadrature')
      integer(c_int), intent(in), value :: nnode, degree
      type(c_ptr), intent(in), value :: nodes, weights, noise_weights, name, scheme, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      character(:), allocatable :: text
      type(scheme_type) :: made
      real(wp), pointer, contiguous :: c(:), alpha(:), beta(:)
      integer(i8) :: n

      call begin_handle(scheme, refusal)
      call read_text(name, 'name', text, refusal)
      call check_stages(nnode, 'nnode', refusal)
      call require(nodes, 'nodes', refusal)
      call require(weights, 'weights', refusal)
      if (.not. allocated(refusal)) then
         n = nnode
         call view(nodes, n, c)
         call view(weights, n, alpha)
         nullify (beta)
         if (c_associated(noise_weights)) call view(noise_weights, n, beta)
         ! a null pointer counts as an absent argument
         call scheme_from_quadrature(made, int(degree), c, alpha, text, refusal, beta)
      end if
      call new_handle(made, scheme, refusal)
      status = finish(refusal, error)
   end function symsde_scheme_from_quadrature

   !> Create a scheme from a tableau of the user.
   function symsde_scheme_from_tableau(nstage, a, abar, alpha, b, bbar, beta, name, allow_nonsymplectic, scheme, &
                                       error) result(status) bind(c, name='symsde_scheme_from_tableau')
      integer(c_int), intent(in), value :: nstage, allow_nonsymplectic
      type(c_ptr), intent(in), value :: a, abar, alpha, b, bbar, beta, name, scheme, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      character(:), allocatable :: text
      type(scheme_type) :: made
      real(wp), pointer, contiguous :: weights(:), noise_weights(:)
      real(wp), allocatable :: drift(:, :), drift_bar(:, :), noise(:, :), noise_bar(:, :)
      integer(i8) :: n

      call begin_handle(scheme, refusal)
      call read_text(name, 'name', text, refusal)
      call check_stages(nstage, 'nstage', refusal)
      call require(a, 'a', refusal)
      call require(abar, 'abar', refusal)
      call require(alpha, 'alpha', refusal)
      if (.not. allocated(refusal)) then
         n = nstage
         call read_rows(a, n, drift)
         call read_rows(abar, n, drift_bar)
         call read_rows(b, n, noise)
         call read_rows(bbar, n, noise_bar)
         call view(alpha, n, weights)
         nullify (noise_weights)
         if (c_associated(beta)) call view(beta, n, noise_weights)
         ! arrays that were not given are not allocated or null, and so count as absent arguments
         call scheme_from_tableau(made, drift, drift_bar, weights, text, allow_nonsymplectic /= 0, refusal, &
                                  noise, noise_bar, noise_weights)
      end if
      call new_handle(made, scheme, refusal)
      status = finish(refusal, error)
   end function symsde_scheme_from_tableau

   !> Read a square matrix of the caller, row by row; the result is not allocated if NULL was given.
   subroutine read_rows(given, n, matrix)
      type(c_ptr), intent(in) :: given
      integer(i8), intent(in) :: n
      real(wp), allocatable, intent(out) :: matrix(:, :)
      real(wp), pointer, contiguous :: rows(:, :)

      if (.not. c_associated(given)) return
      call view(given, n, n, rows)
      matrix = transpose(rows)
   end subroutine read_rows

   !> Delete a scheme and set its handle to NULL; NULL is accepted.
   function symsde_scheme_delete(scheme) result(status) bind(c, name='symsde_scheme_delete')
      type(c_ptr), intent(in), value :: scheme
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(c_ptr), pointer :: handle
      type(scheme_handle), pointer :: holder
      type(scheme_type), pointer :: known

      if (c_associated(scheme)) then
         call c_f_pointer(scheme, handle)
         if (c_associated(handle)) call find_scheme(handle, known, refusal)
         if (c_associated(handle) .and. .not. allocated(refusal)) then
            call c_f_pointer(handle, holder)
            holder%tag = 0
            deallocate (holder)
            handle = c_null_ptr
         end if
      end if
      status = finish(refusal, c_null_ptr)
   end function symsde_scheme_delete

   !> Write the certificate of a scheme into a struct.
   function symsde_scheme_get_info(scheme, info, error) result(status) bind(c, name='symsde_scheme_get_info')
      type(c_ptr), intent(in), value :: scheme, info, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(scheme_type), pointer :: known
      type(c_scheme_info), target :: given

      call find_scheme(scheme, known, refusal)
      call take_struct(info, 'scheme_info', c_loc(given), c_sizeof(given), refusal)
      if (.not. allocated(refusal)) then
         call fill_info(known, given)
         call give_struct(c_loc(given), info)
      end if
      status = finish(refusal, error)
   end function symsde_scheme_get_info

   !> Write the derived, claimed and measured properties of a scheme as readable lines.
   function symsde_scheme_certificate(scheme, buffer, size, needed, error) result(status) &
      bind(c, name='symsde_scheme_certificate')
      type(c_ptr), intent(in), value :: scheme, buffer, needed, error
      integer(c_size_t), intent(in), value :: size
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(scheme_type), pointer :: known
      character(:), allocatable :: text

      call find_scheme(scheme, known, refusal)
      if (.not. allocated(refusal)) then
         call describe_scheme(known, text)
         call put_text(text, buffer, size, needed)
      end if
      status = finish(refusal, error)
   end function symsde_scheme_certificate

   !> Check the address where a new handle will be stored, and store NULL until the scheme exists.
   subroutine begin_handle(handle, error)
      type(c_ptr), intent(in) :: handle   !! symsde_scheme *
      type(error_type), allocatable, intent(inout) :: error
      type(c_ptr), pointer :: made

      call require(handle, 'scheme', error)
      call require_reserve('a scheme', 'begin_handle', error)
      if (allocated(error)) return
      call c_f_pointer(handle, made)
      made = c_null_ptr
   end subroutine begin_handle

   !> Store a handle of the scheme, unless an error was raised.
   subroutine new_handle(scheme, handle, error)
      type(scheme_type), intent(in) :: scheme
      type(c_ptr), intent(in) :: handle          !! symsde_scheme *
      type(error_type), allocatable, intent(inout) :: error
      type(scheme_handle), pointer :: holder
      type(c_ptr), pointer :: made
      integer :: info

      if (allocated(error)) return
      allocate (holder, stat=info)
      if (info /= 0) then
         call raise(error, out_of_memory, 'new_handle', 'no memory for a scheme')
         return
      end if
      holder%scheme = scheme
      call c_f_pointer(handle, made)
      made = c_loc(holder)
   end subroutine new_handle

   subroutine check_stages(n, what, error)
      integer, intent(in) :: n
      character(*), intent(in) :: what
      type(error_type), allocatable, intent(inout) :: error

      if (n < 1 .or. n > most_stages) &
         call raise(error, wrong_shape, 'check_stages', what//' = '//to_text(n)//' is out of range: give 1 to '// &
                    to_text(most_stages))
   end subroutine check_stages

end module symsde_capi_scheme
