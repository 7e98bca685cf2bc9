! SPDX-License-Identifier: BSD-3-Clause
!> The handle of a model: create, read traits, probe, delete.
module symsde_capi_model
   use, intrinsic :: iso_c_binding, only: &
      c_associated, c_double, c_f_pointer, c_funptr, c_int, c_int64_t, c_loc, c_null_ptr, c_ptr, c_size_t, &
      c_sizeof
   use symsde_base_kinds, only: wp, i8
   use symsde_base_memory, only: require_reserve
   use symsde_base_status, only: error_type, raise, status_ok, null_handle, out_of_memory, &
                                 invalid_argument, unknown_name, callback_failed
   use symsde_base_text, only: name_length, to_text
   use symsde_base_traits, only: model_traits
   use symsde_capi_arrays, only: view
   use symsde_capi_error, only: finish, require, check_sizes, take_struct, give_struct
   use symsde_capi_probe, only: probe_at, take_traits_at
   use symsde_capi_traits, only: c_traits, from_traits, to_traits
   use symsde_capi_text, only: read_text, put_text, lines
   use symsde_model_abstract, only: model_type
   use symsde_model_user_callback, only: callback_model, new_callback_model
   use symsde_model_user_callback_force, only: callback_force
   use symsde_model_user_callback_rates, only: callback_rates
   use symsde_model_views_thermostat, only: thermostat_model
   use symsde_model_catalogue_by_name, only: get_model, model_names, tabulate
   use symsde_model_catalogue_by_path, only: get_model_by_path
   implicit none
   private
   public :: model_handle, find_model, use_model, copy_model, begin_handle, new_handle
   public :: symsde_model_names, symsde_model_parameters, symsde_model_get, symsde_model_get_by_path
   public :: symsde_model_new, symsde_model_delete, symsde_model_traits, symsde_model_probe
   public :: symsde_model_set_probed_traits

   integer(i8), parameter :: tag_of_model = int(z'6D6F64656C', i8)  !! 'model'; cleared when the handle is deleted

   !> The object behind a symsde_model.
   type :: model_handle
      integer(i8) :: tag = tag_of_model
      class(model_type), allocatable :: model
      type(callback_force), pointer :: forces => null()   !! the model's forces; owned
      type(callback_rates), pointer :: rates => null()    !! the model's rates of damping; owned
   end type model_handle

contains

   !> The model of a handle; refuses NULL, deleted and foreign handles (null_handle).
   subroutine find_model(handle, model, error)
      type(c_ptr), intent(in) :: handle
      class(model_type), pointer, intent(out) :: model
      type(error_type), allocatable, intent(inout) :: error
      type(model_handle), pointer :: holder

      nullify (model)
      if (allocated(error)) return
      if (c_associated(handle)) then
         call c_f_pointer(handle, holder)
         if (holder%tag == tag_of_model) then
            model => holder%model
            return
         end if
      end if
      call raise(error, null_handle, 'find_model', 'model is NULL, deleted or not a model: '// &
                 'make one with symsde_model_get or symsde_model_new')
   end subroutine find_model

   !> The model of a handle for one call that evaluates it. A model of callbacks is copied into own, because it keeps a
   !> record of failure: threads that share a handle must each see their own failures only.
   subroutine use_model(handle, own, model, error)
      type(c_ptr), intent(in) :: handle
      class(model_type), allocatable, intent(inout), target :: own  !! must live as long as model is used
      class(model_type), pointer, intent(out) :: model
      type(error_type), allocatable, intent(inout) :: error

      call require_reserve('a call', 'use_model', error)
      call find_model(handle, model, error)
      if (.not. associated(model)) return
      select type (shared => model)
      type is (callback_model)
         call copy_model(shared, own)
         model => own
      type is (thermostat_model)
         call copy_model(shared, own)
         model => own
      end select
   end subroutine use_model

   !> A copy of a model. A model of callbacks, or a bath around it, owns a record of failure, which allocate(source=)
   !> would share with the copy.
   recursive subroutine copy_model(from, to)
      class(model_type), intent(in) :: from
      class(model_type), allocatable, intent(out) :: to

      select type (from)
      type is (callback_model)
         allocate (callback_model :: to)
         select type (to)
         type is (callback_model)
            to = from
         end select
      type is (thermostat_model)
         allocate (thermostat_model :: to)
         select type (to)
         type is (thermostat_model)
            call to%copy_bath(from)
            call copy_model(from%inner, to%inner)
         end select
      class default
         allocate (to, source=from)
      end select
   end subroutine copy_model

   !> Names of the built-in models, one per line.
   function symsde_model_names(buffer, size, needed) result(status) bind(c, name='symsde_model_names')
      type(c_ptr), intent(in), value :: buffer, needed
      integer(c_size_t), intent(in), value :: size
      integer(c_int) :: status
      character(len=name_length), allocatable :: names(:)

      allocate (names(0))
      names = model_names()
      call put_text(lines(names), buffer, size, needed)
      status = status_ok
   end function symsde_model_names

   !> The parameters of a built-in model as lines 'key = default'.
   function symsde_model_parameters(name, buffer, size, needed, error) result(status) &
      bind(c, name='symsde_model_parameters')
      type(c_ptr), intent(in), value :: name, buffer, needed, error
      integer(c_size_t), intent(in), value :: size
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      character(:), allocatable :: text, parameters
      class(model_type), allocatable :: model
      character(len=1) :: no_keys(0)
      real(wp) :: no_values(0)

      call read_text(name, 'name', text, refusal)
      call get_model(model, text, no_keys, no_values, refusal)  ! refuses unknown names
      if (.not. allocated(refusal)) then
         call parameter_lines(text, parameters)
         call put_text(parameters, buffer, size, needed)
      end if
      status = finish(refusal, error)
   end function symsde_model_parameters

   !> Create a built-in model; parameters that are not given keep their defaults.
   function symsde_model_get(name, nparameter, keys, values, model, error) result(status) &
      bind(c, name='symsde_model_get')
      type(c_ptr), intent(in), value :: name, keys, values, model, error
      integer(c_int), intent(in), value :: nparameter
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      character(:), allocatable :: text
      character(len=name_length), allocatable :: names(:)
      real(wp), pointer, contiguous :: numbers(:)
      real(wp), target :: none(0)
      class(model_type), allocatable :: made

      call begin_handle(model, 'model', refusal)
      call read_text(name, 'name', text, refusal)
      call read_keys(nparameter, keys, names, refusal)
      if (nparameter > 0) call require(values, 'values', refusal)
      numbers => none
      if (nparameter > 0 .and. c_associated(values)) call view(values, int(nparameter, i8), numbers)
      if (.not. allocated(refusal)) call get_model(made, text, names, numbers, refusal)
      call new_handle(made, model, refusal)
      status = finish(refusal, error)
   end function symsde_model_get

   !> Create a built-in model whose parameters differ from path to path: values[nparameter][nrow], row i for path
   !> first_path + i of a run, or one row for all paths.
   function symsde_model_get_by_path(name, nparameter, keys, nrow, values, model, error) result(status) &
      bind(c, name='symsde_model_get_by_path')
      type(c_ptr), intent(in), value :: name, keys, values, model, error
      integer(c_int), intent(in), value :: nparameter
      integer(c_int64_t), intent(in), value :: nrow
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      character(:), allocatable :: text
      character(len=name_length), allocatable :: names(:)
      real(wp), pointer, contiguous :: given(:, :)
      class(model_type), allocatable :: made

      call begin_handle(model, 'model', refusal)
      call read_text(name, 'name', text, refusal)
      call read_keys(nparameter, keys, names, refusal)
      if (nparameter == 0 .or. nrow < 1) &
         call raise(refusal, invalid_argument, 'symsde_model_get_by_path', 'nparameter = '//to_text(nparameter)// &
                    ', nrow = '//to_text(nrow)//': name one parameter at least, and give a row for each path, or '// &
                    'one for all; symsde_model_get makes models without rows')
      call require(values, 'values', refusal)
      call check_sizes(int(nparameter, i8), nrow, 1_i8, 'values', refusal)
      if (.not. allocated(refusal)) then
         call view(values, nrow, int(nparameter, i8), given)
         call get_model_by_path(made, text, names, given, refusal)
      end if
      call new_handle(made, model, refusal)
      status = finish(refusal, error)
   end function symsde_model_get_by_path

   !> Create a model from the user's functions.
   function symsde_model_new(name, traits, gradient, value, hessian, hessian_vector, user, model, error) &
      result(status) bind(c, name='symsde_model_new')
      type(c_ptr), intent(in), value :: name, traits, user, model, error
      type(c_funptr), intent(in), value :: gradient, value, hessian, hessian_vector
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      character(:), allocatable :: text
      type(c_traits), target :: given
      class(model_type), allocatable :: made

      call begin_handle(model, 'model', refusal)
      call read_text(name, 'name', text, refusal)
      given = from_traits(model_traits())
      call take_struct(traits, 'traits', c_loc(given), c_sizeof(given), refusal)
      if (.not. allocated(refusal)) then
         allocate (callback_model :: made)
         select type (made)
         type is (callback_model)
            call new_callback_model(made, text, to_traits(given), gradient, value, hessian, hessian_vector, &
                                    user, refusal)
         end select
      end if
      call new_handle(made, model, refusal)
      status = finish(refusal, error)
   end function symsde_model_new

   !> Delete a model and set its handle to NULL; NULL is accepted.
   function symsde_model_delete(model) result(status) bind(c, name='symsde_model_delete')
      type(c_ptr), intent(in), value :: model
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(c_ptr), pointer :: handle
      type(model_handle), pointer :: holder
      class(model_type), pointer :: known

      if (c_associated(model)) then
         call c_f_pointer(model, handle)
         if (c_associated(handle)) call find_model(handle, known, refusal)
         if (c_associated(handle) .and. .not. allocated(refusal)) then
            call c_f_pointer(handle, holder)
            holder%tag = 0
            if (associated(holder%forces)) deallocate (holder%forces)
            if (associated(holder%rates)) deallocate (holder%rates)
            deallocate (holder)
            handle = c_null_ptr
         end if
      end if
      status = finish(refusal, c_null_ptr)
   end function symsde_model_delete

   !> The traits of a model.
   function symsde_model_traits(model, traits, error) result(status) bind(c, name='symsde_model_traits')
      type(c_ptr), intent(in), value :: model, traits, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: known
      type(c_traits), target :: given
      integer(c_size_t) :: struct_size

      call find_model(model, known, refusal)
      given = from_traits(model_traits())
      call take_struct(traits, 'traits', c_loc(given), c_sizeof(given), refusal)
      if (.not. allocated(refusal)) then
         struct_size = given%struct_size
         given = from_traits(known%traits)
         given%struct_size = struct_size
         call give_struct(c_loc(given), traits)
      end if
      status = finish(refusal, error)
   end function symsde_model_traits

   !> Check declared traits and Hessians at three points around a state.
   function symsde_model_probe(model, t, q0, p0, error) result(status) bind(c, name='symsde_model_probe')
      type(c_ptr), intent(in), value :: model, q0, p0, error
      real(c_double), intent(in), value :: t
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: known
      class(model_type), allocatable, target :: own
      real(wp), pointer, contiguous :: q(:), p(:)
      integer :: code

      code = 0
      call use_model(model, own, known, refusal)
      call require(q0, 'q0', refusal)
      call require(p0, 'p0', refusal)
      if (.not. allocated(refusal)) then
         call view(q0, int(known%traits%ndof, i8), q)
         call view(p0, int(known%traits%ndof, i8), p)
         call probe_at(known, known%traits%ndof, t, q, p, code, refusal)
      end if
      if (code == 0) then
         status = finish(refusal, error)
      else
         status = finish(refusal, error, callback_failed, &
                         'a callback returned '//to_text(code)//' at the initial state')
      end if
   end function symsde_model_probe

   !> Declare of a model all that its gradient does not refute at three points around a state.
   function symsde_model_set_probed_traits(model, t, q0, p0, error) result(status) &
      bind(c, name='symsde_model_set_probed_traits')
      type(c_ptr), intent(in), value :: model, q0, p0, error
      real(c_double), intent(in), value :: t
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: known
      real(wp), pointer, contiguous :: q(:), p(:)

      call find_model(model, known, refusal)
      call require(q0, 'q0', refusal)
      call require(p0, 'p0', refusal)
      if (.not. allocated(refusal)) then
         call view(q0, int(known%traits%ndof, i8), q)
         call view(p0, int(known%traits%ndof, i8), p)
         call take_traits_at(known, known%traits%ndof, t, q, p, refusal)
      end if
      status = finish(refusal, error)
   end function symsde_model_set_probed_traits

   !> Check the address where a new handle will be stored, and store NULL until the model exists.
   subroutine begin_handle(handle, what, error)
      type(c_ptr), intent(in) :: handle   !! symsde_model *
      character(*), intent(in) :: what
      type(error_type), allocatable, intent(inout) :: error
      type(c_ptr), pointer :: made

      call require(handle, what, error)
      call require_reserve('a model', 'begin_handle', error)
      if (allocated(error)) return
      call c_f_pointer(handle, made)
      made = c_null_ptr
   end subroutine begin_handle

   !> Store a handle of the model, unless an error was raised.
   subroutine new_handle(model, handle, error)
      class(model_type), allocatable, intent(inout) :: model  !! moved into the handle
      type(c_ptr), intent(in) :: handle                       !! symsde_model *
      type(error_type), allocatable, intent(inout) :: error
      type(model_handle), pointer :: holder
      type(c_ptr), pointer :: made
      integer :: info

      if (allocated(error)) return
      allocate (holder, stat=info)
      if (info /= 0) then
         call raise(error, out_of_memory, 'new_handle', 'no memory for a model')
         return
      end if
      call move_alloc(model, holder%model)
      call c_f_pointer(handle, made)
      made = c_loc(holder)
   end subroutine new_handle

   !> The keys of parameters as Fortran text.
   subroutine read_keys(n, keys, names, error)
      integer, intent(in) :: n
      type(c_ptr), intent(in) :: keys                      !! n strings
      character(len=name_length), allocatable, intent(out) :: names(:)
      type(error_type), allocatable, intent(inout) :: error
      character(:), allocatable :: text
      type(c_ptr), pointer :: strings(:)
      integer :: i, extent(1)

      if (n < 0) call raise(error, invalid_argument, 'read_keys', 'nparameter = '//to_text(n)// &
                            ' is negative: give the number of keys')
      if (n > 0) call require(keys, 'keys', error)
      if (n <= 0 .or. allocated(error)) then
         allocate (names(0))
         return
      end if
      extent(1) = n
      call c_f_pointer(keys, strings, extent)
      allocate (names(n))
      do i = 1, n
         call read_text(strings(i), 'key '//to_text(i), text, error)
         names(i) = text(:min(len(text), name_length))
         if (len(text) > name_length) call raise(error, unknown_name, 'read_keys', "there is no parameter '"// &
                                                 text//"': no name is that long")
      end do
   end subroutine read_keys

   !> Lines 'key = default' of a known model; defaults have all their digits.
   subroutine parameter_lines(name, text)
      character(*), intent(in) :: name
      character(:), allocatable, intent(out) :: text
      character(len=name_length), allocatable :: keys(:)
      real(wp), allocatable :: defaults(:)
      character(len=32) :: digits
      integer :: i

      call tabulate(name, keys, defaults)
      text = ''
      do i = 1, size(keys)
         write (digits, '(g0.17)') defaults(i)
         text = text//trim(keys(i))//' = '//trim(adjustl(digits))//new_line('a')
      end do
   end subroutine parameter_lines

end module symsde_capi_model
