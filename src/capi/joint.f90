! SPDX-License-Identifier: BSD-3-Clause
!> Optional functions of a user's model: gradient and Hessian together, third derivatives, rows of a chain, products
!> of its noises, covectors over several steps, whole steps of schemes, parameters by path, a quadratic part of H, how
!> it changes with parameters, and kicks by actions; and declarations that its functions accept NULL or any number of
!> lanes.
module symsde_capi_joint
   use, intrinsic :: iso_c_binding, only: c_associated, c_funptr, c_int, c_int64_t, c_ptr
   use symsde_base_damping, only: damping_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_maps, only: step_map
   use symsde_base_status, only: error_type, raise, incompatible, invalid_argument
   use symsde_base_text, only: to_text
   use symsde_base_traits, only: model_traits
   use symsde_capi_arrays, only: view
   use symsde_capi_error, only: finish, require, check_sizes
   use symsde_capi_model, only: begin_handle, find_model, new_handle
   use symsde_capi_text, only: read_text
   use symsde_model_abstract, only: model_type
   use symsde_model_forces, only: force_type
   use symsde_model_parameters, only: check_traits
   use symsde_model_user_callback, only: callback_model
   use symsde_scheme_catalogue, only: get_scheme
   use symsde_scheme_scheme, only: scheme_type
   use symsde_step_flow_scheme_map, only: map_of
   implicit none
   private
   public :: symsde_model_set_gradient_hessian, symsde_model_accept_null, symsde_model_set_flow
   public :: symsde_model_accept_any_lanes, symsde_model_set_derived
   public :: symsde_model_set_chain_rows, symsde_model_set_third_derivative, symsde_model_set_squares
   public :: symsde_model_set_pull
   public :: symsde_model_set_parameters, symsde_model_with_user, symsde_model_set_quadratic_part, &
             symsde_model_set_flow_slopes, symsde_model_set_action_kicks
   public :: find_callback_model

contains

   !> Give a model of symsde_model_new one more function; NULL removes it. Refuses built-in models (incompatible).
   function symsde_model_set_gradient_hessian(model, joint, error) result(status) &
      bind(c, name='symsde_model_set_gradient_hessian')
      type(c_ptr), intent(in), value :: model, error
      type(c_funptr), intent(in), value :: joint
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(callback_model), pointer :: known

      call find_callback_model(model, known, 'symsde_model_set_gradient_hessian', refusal)
      if (.not. allocated(refusal)) call known%set_gradient_hessian(joint)
      status = finish(refusal, error)
   end function symsde_model_set_gradient_hessian

   !> Give a chain of symsde_model_new the rows of its force and stiffness; NULL removes them. Refuses
   !> (incompatible) built-in models and models that do not declare a chain.
   function symsde_model_set_chain_rows(model, chain_rows, error) result(status) &
      bind(c, name='symsde_model_set_chain_rows')
      type(c_ptr), intent(in), value :: model, error
      type(c_funptr), intent(in), value :: chain_rows
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(callback_model), pointer :: known

      call find_callback_model(model, known, 'symsde_model_set_chain_rows', refusal)
      if (.not. allocated(refusal)) call known%set_chain_rows(chain_rows, refusal)
      status = finish(refusal, error)
   end function symsde_model_set_chain_rows

   !> Give a model of symsde_model_new third derivatives; NULL removes them. Refuses built-in models (incompatible).
   function symsde_model_set_third_derivative(model, third, error) result(status) &
      bind(c, name='symsde_model_set_third_derivative')
      type(c_ptr), intent(in), value :: model, error
      type(c_funptr), intent(in), value :: third
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(callback_model), pointer :: known

      call find_callback_model(model, known, 'symsde_model_set_third_derivative', refusal)
      if (.not. allocated(refusal)) call known%set_third_derivative(third)
      status = finish(refusal, error)
   end function symsde_model_set_third_derivative

   !> Give a model of symsde_model_new products of gradients and Hessians of all noises; NULL removes them. Refuses
   !> (incompatible) built-in models and models that do not declare noise in position and the mass one.
   function symsde_model_set_squares(model, squares, error) result(status) bind(c, name='symsde_model_set_squares')
      type(c_ptr), intent(in), value :: model, error
      type(c_funptr), intent(in), value :: squares
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(callback_model), pointer :: known

      call find_callback_model(model, known, 'symsde_model_set_squares', refusal)
      if (.not. allocated(refusal)) call known%set_squares(squares, refusal)
      status = finish(refusal, error)
   end function symsde_model_set_squares

   !> Give a model of symsde_model_new covectors over several steps; NULL removes them. Refuses built-in models
   !> (incompatible).
   function symsde_model_set_pull(model, pull, error) result(status) bind(c, name='symsde_model_set_pull')
      type(c_ptr), intent(in), value :: model, error
      type(c_funptr), intent(in), value :: pull
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(callback_model), pointer :: known

      call find_callback_model(model, known, 'symsde_model_set_pull', refusal)
      if (.not. allocated(refusal)) call known%set_pull(pull)
      status = finish(refusal, error)
   end function symsde_model_set_pull

   !> From now on pass NULL for outputs that are not wanted. Refuses built-in models (incompatible).
   function symsde_model_accept_null(model, error) result(status) bind(c, name='symsde_model_accept_null')
      type(c_ptr), intent(in), value :: model, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(callback_model), pointer :: known

      call find_callback_model(model, known, 'symsde_model_accept_null', refusal)
      if (.not. allocated(refusal)) call known%accept_null()
      status = finish(refusal, error)
   end function symsde_model_accept_null

   !> Give a model of symsde_model_new whole steps of a scheme; NULL removes them. Refuses built-in models
   !> (incompatible) and unknown names of schemes (unknown_name).
   function symsde_model_set_flow(model, scheme, flow, error) result(status) bind(c, name='symsde_model_set_flow')
      type(c_ptr), intent(in), value :: model, scheme, error
      type(c_funptr), intent(in), value :: flow
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(callback_model), pointer :: known
      type(step_map) :: map
      character(:), allocatable :: text

      call find_callback_model(model, known, 'symsde_model_set_flow', refusal)
      call read_text(scheme, 'scheme', text, refusal)
      if (.not. allocated(refusal)) call read_map(text, map, refusal)
      if (.not. allocated(refusal)) call known%set_flow(map, flow)
      status = finish(refusal, error)
   end function symsde_model_set_flow

   !> Find the map of a scheme from its name, which may end with a suffix for damped momenta, and that of the Euler pair
   !> before it with one for the corrected variant.
   subroutine read_map(text, map, error)
      character(*), intent(in) :: text
      type(step_map), intent(out) :: map
      type(error_type), allocatable, intent(inout) :: error
      character(*), parameter :: ending = ', corrected', loss = ', damped'
      type(scheme_type) :: meant
      integer :: n
      logical :: corrected, damped

      n = len(text)
      call take_off(loss, damped)
      call take_off(ending, corrected)
      call get_scheme(meant, text(:n), error)
      if (allocated(error)) return
      call map_of(meant, map)
      map%corrected = corrected
      map%damped = damped
      if (corrected .and. .not. meant%is_euler_pair()) &
         call raise(error, invalid_argument, 'symsde_model_set_flow', "scheme '"//text//"': whole steps are "// &
                    "corrected of symplectic_euler and symplectic_euler_adjoint alone; leave out '"//ending//"'")

   contains

      !> Whether the first n characters end with a suffix, which is taken off.
      subroutine take_off(suffix, there)
         character(*), intent(in) :: suffix
         logical, intent(out) :: there

         there = n > len(suffix)
         if (there) there = text(n - len(suffix) + 1:n) == suffix
         if (there) n = n - len(suffix)
      end subroutine take_off

   end subroutine read_map

   !> From now on pass the real lanes only, without padding. Refuses built-in models (incompatible).
   function symsde_model_accept_any_lanes(model, error) result(status) bind(c, name='symsde_model_accept_any_lanes')
      type(c_ptr), intent(in), value :: model, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(callback_model), pointer :: known

      call find_callback_model(model, known, 'symsde_model_accept_any_lanes', refusal)
      if (.not. allocated(refusal)) known%traits%any_lanes = .true.
      status = finish(refusal, error)
   end function symsde_model_accept_any_lanes

   !> From now on do not repeat probes that the model has passed. Refuses built-in models (incompatible).
   function symsde_model_set_derived(model, error) result(status) bind(c, name='symsde_model_set_derived')
      type(c_ptr), intent(in), value :: model, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(callback_model), pointer :: known

      call find_callback_model(model, known, 'symsde_model_set_derived', refusal)
      if (.not. allocated(refusal)) call known%passed%keep()
      status = finish(refusal, error)
   end function symsde_model_set_derived

   !> Parameters by path: values[nparameter][nrow], row i for path first_path + i of a run, or one row for all paths;
   !> nparameter = 0 removes them. Refuses built-in models (incompatible).
   function symsde_model_set_parameters(model, nparameter, nrow, values, error) result(status) &
      bind(c, name='symsde_model_set_parameters')
      type(c_ptr), intent(in), value :: model, values, error
      integer(c_int), intent(in), value :: nparameter
      integer(c_int64_t), intent(in), value :: nrow
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(callback_model), pointer :: known
      real(wp), pointer, contiguous :: given(:, :)
      real(wp), target :: none(0, 0)

      call find_callback_model(model, known, 'symsde_model_set_parameters', refusal)
      if (nparameter < 0 .or. (nparameter > 0 .and. nrow < 1)) &
         call raise(refusal, invalid_argument, 'symsde_model_set_parameters', 'nparameter = '//to_text(nparameter)// &
                    ', nrow = '//to_text(nrow)//': give the number of parameters, 0 for none, and a row for each path')
      given => none
      if (nparameter > 0) then
         call require(values, 'values', refusal)
         call check_sizes(int(nparameter, i8), nrow, 1_i8, 'values', refusal)
         if (.not. allocated(refusal)) call view(values, nrow, int(nparameter, i8), given)
      end if
      if (.not. allocated(refusal)) call known%set_parameters(given, refusal)
      status = finish(refusal, error)
   end function symsde_model_set_parameters

   !> Declare the quadratic part D = z.S z/2 of H of a model of symsde_model_new, by S (2 ndof, 2 ndof); NULL takes it
   !> back. Refuses built-in models (incompatible), and matrices that are not symmetric.
   function symsde_model_set_quadratic_part(model, second, error) result(status) &
      bind(c, name='symsde_model_set_quadratic_part')
      type(c_ptr), intent(in), value :: model, second, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(callback_model), pointer :: known
      real(wp), pointer, contiguous :: given(:, :)
      type(model_traits) :: traits

      call find_callback_model(model, known, 'symsde_model_set_quadratic_part', refusal)
      if (.not. allocated(refusal)) then
         traits = known%traits
         if (allocated(traits%quadratic_part)) deallocate (traits%quadratic_part)
         if (c_associated(second)) then
            call known%require_gradient('symsde_model_set_quadratic_part', 'a declared quadratic part', refusal)
            call view(second, 2_i8*traits%ndof, 2_i8*traits%ndof, given)
            traits%quadratic_part = given
            call check_traits('symsde_model_set_quadratic_part', known%name, traits, refusal)
         end if
      end if
      if (.not. allocated(refusal)) known%traits = traits
      status = finish(refusal, error)
   end function symsde_model_set_quadratic_part

   !> Tell a model whose further positions are parameters how the linear flows between kicks of the model of ndof
   !> degrees of freedom change with them: derivatives of S (2 ndof, 2 ndof) of the quadratic part, and of the squares
   !> of the frequencies (ndof), for each parameter; NULL where there is no such flow. Refuses built-in models
   !> (incompatible), and matrices that are not symmetric (invalid_argument). Runs compare S_pq and S_pp with the
   !> Hessian of the model.
   function symsde_model_set_flow_slopes(wide, ndof, second, squares, error) result(status) &
      bind(c, name='symsde_model_set_flow_slopes')
      type(c_ptr), intent(in), value :: wide, second, squares, error
      integer(c_int), intent(in), value :: ndof
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(callback_model), pointer :: known
      real(wp), pointer, contiguous :: given(:, :)
      type(model_traits) :: traits
      integer :: i, k

      k = 0
      call find_callback_model(wide, known, 'symsde_model_set_flow_slopes', refusal)
      if (.not. allocated(refusal)) then
         k = known%traits%ndof - ndof
         if (ndof < 1 .or. k < 1) call raise(refusal, invalid_argument, 'symsde_model_set_flow_slopes', 'ndof = '// &
                                             to_text(ndof)//' of '//to_text(known%traits%ndof)// &
                                             ' positions: give the degrees of freedom of the model without parameters')
      end if
      if (.not. allocated(refusal)) then
         traits = known%traits
         if (allocated(traits%quadratic_slopes)) deallocate (traits%quadratic_slopes)
         if (allocated(traits%rotation_slopes)) deallocate (traits%rotation_slopes)
         associate (n => 2_i8*ndof)
            if (c_associated(second)) then
               call view(second, n, n*k, given)
               allocate (traits%quadratic_slopes(n, n, k))
               do i = 1, k
                  traits%quadratic_slopes(:, :, i) = given(:, n*(i - 1) + 1:n*i)
               end do
            end if
            if (c_associated(squares)) then
               call view(squares, int(ndof, i8), int(k, i8), given)
               traits%rotation_slopes = given
            end if
         end associate
         call check_traits('symsde_model_set_flow_slopes', known%name, traits, refusal)
      end if
      if (.not. allocated(refusal)) known%traits = traits
      status = finish(refusal, error)
   end function symsde_model_set_flow_slopes

   !> Declare that what a quadratic part leaves of H, and every noise, are functions of the actions. Refuses built-in
   !> models (incompatible), and models without a quadratic part (invalid_argument).
   function symsde_model_set_action_kicks(model, on, error) result(status) bind(c, name='symsde_model_set_action_kicks')
      type(c_ptr), intent(in), value :: model, error
      integer(c_int), intent(in), value :: on   !! 0 takes it back, 2 says that noises are linear in the actions
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(callback_model), pointer :: known
      type(model_traits) :: traits

      call find_callback_model(model, known, 'symsde_model_set_action_kicks', refusal)
      if (.not. allocated(refusal)) then
         traits = known%traits
         traits%kicks_of_actions = on /= 0
         traits%phase_noise = on == 2
         call check_traits('symsde_model_set_action_kicks', known%name, traits, refusal)
      end if
      if (.not. allocated(refusal)) then
         known%traits = traits
         call known%passed%forget()
      end if
      status = finish(refusal, error)
   end function symsde_model_set_action_kicks

   !> A copy of a model of symsde_model_new whose functions get another user pointer, and whose stiff linear part
   !> has other frequencies [ndof], unless rotation is NULL. Refuses built-in models
   !> (incompatible).
   function symsde_model_with_user(model, user, rotation, made, error) result(status) &
      bind(c, name='symsde_model_with_user')
      type(c_ptr), intent(in), value :: model, user, rotation, made, error
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      type(callback_model), pointer :: known
      real(wp), pointer, contiguous :: frequencies(:)
      class(model_type), allocatable :: other
      class(force_type), pointer :: no_forces

      call begin_handle(made, 'made', refusal)
      call find_callback_model(model, known, 'symsde_model_with_user', refusal)
      if (.not. allocated(refusal)) then
         allocate (callback_model :: other)
         select type (other)
         type is (callback_model)
            other = known
            ! forces and rates that are functions belong to the handle of the model
            nullify (no_forces)
            if (associated(other%forces)) call other%set_forces(no_forces)
            if (.not. other%damping%is_constant()) other%damping = damping_type()
            call other%set_user(user)
            if (c_associated(rotation)) then
               call view(rotation, int(other%traits%ndof, i8), frequencies)
               other%traits%rotation = frequencies
            end if
         end select
      end if
      call new_handle(other, made, refusal)
      status = finish(refusal, error)
   end function symsde_model_with_user

   !> Find the user's model of a handle; built-in models are refused.
   subroutine find_callback_model(handle, model, place, error)
      type(c_ptr), intent(in) :: handle
      type(callback_model), pointer, intent(out) :: model
      character(*), intent(in) :: place
      type(error_type), allocatable, intent(inout) :: error
      class(model_type), pointer :: known

      nullify (model)
      call find_model(handle, known, error)
      if (allocated(error)) return
      select type (known)
      type is (callback_model)
         model => known
      class default
         call raise(error, incompatible, place, "model '"//known%name//"' is built in and has all it needs: give "// &
                    'functions to models of symsde_model_new')
      end select
   end subroutine find_callback_model

end module symsde_capi_joint
