! SPDX-License-Identifier: BSD-3-Clause
!> What acts on the model of a handle beside its Hamiltonians: damping, friction, forces and heat baths.
module symsde_capi_open_system
   use, intrinsic :: iso_c_binding, only: c_associated, c_f_pointer, c_funptr, c_int, c_ptr
   use symsde_base_damping, only: new_damping
   use symsde_base_kinds, only: wp, i8
   use symsde_base_rates, only: rate_type
   use symsde_base_status, only: error_type, raise, invalid_argument
   use symsde_base_text, only: to_text
   use symsde_capi_arrays, only: view
   use symsde_capi_error, only: finish, require
   use symsde_capi_model, only: model_handle, find_model
   use symsde_model_abstract, only: model_type
   use symsde_model_forces, only: force_type
   use symsde_model_views_thermostat, only: thermostat_model, new_thermostat
   implicit none
   private
   public :: symsde_model_set_damping, symsde_model_set_friction, symsde_model_set_damping_function
   public :: symsde_model_thermostat
   public :: symsde_model_set_force, symsde_model_set_noise_force, symsde_model_set_force_bandwidth

   enum, bind(c)
      enumerator :: on_position = 1
      enumerator :: on_time = 2
      enumerator :: on_position_and_time = 3
   end enum

contains

   !> Damp the momenta of a model, dp_i = .. - gamma_i p_i dt: one rate [1/time], or one for each degree of freedom.
   function symsde_model_set_damping(model, nrate, rates, allow_gain, error) result(status) &
      bind(c, name='symsde_model_set_damping')
      type(c_ptr), intent(in), value :: model, rates, error
      integer(c_int), intent(in), value :: nrate
      integer(c_int), intent(in), value :: allow_gain   !! nonzero: rates may be negative
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: known
      real(wp), pointer, contiguous :: given(:)

      call find_model(model, known, refusal)
      call require(rates, 'rates', refusal)
      if (nrate < 1) call raise(refusal, invalid_argument, 'symsde_model_set_damping', 'nrate = '//to_text(nrate)// &
                                ' is no number of rates: give one rate, or one for each degree of freedom')
      if (.not. allocated(refusal)) then
         call view(rates, int(nrate, i8), given)
         call new_damping(known%damping, given, known%traits%ndof, refusal, allow_gain /= 0)
      end if
      status = finish(refusal, error)
   end function symsde_model_set_damping

   !> Damp the momenta of a model by rates that are a function, gamma_i(q, t).
   function symsde_model_set_damping_function(model, rates, nrate, depends, allow_gain, user, error) result(status) &
      bind(c, name='symsde_model_set_damping_function')
      type(c_ptr), intent(in), value :: model, user, error
      type(c_funptr), intent(in), value :: rates         !! symsde_damping, or NULL
      integer(c_int), intent(in), value :: nrate         !! 1, or one for each degree of freedom
      integer(c_int), intent(in), value :: depends       !! on_position .. on_position_and_time
      integer(c_int), intent(in), value :: allow_gain    !! nonzero: rates may be negative
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: known
      class(rate_type), pointer :: acting
      type(model_handle), pointer :: holder

      call find_model(model, known, refusal)
      if (.not. allocated(refusal) .and. c_associated(rates)) then
         if (nrate /= 1 .and. nrate /= known%traits%ndof) &
            call raise(refusal, invalid_argument, 'symsde_model_set_damping_function', 'nrate = '//to_text(nrate)// &
                       ' for '//to_text(known%traits%ndof)//' degrees of freedom: give one rate, or one for each')
         if (depends < 1 .or. depends > on_position_and_time) &
            call raise(refusal, invalid_argument, 'symsde_model_set_damping_function', 'depends = '// &
                       to_text(depends)//' is unknown: rates depend on position (1), time (2) or both (3); give '// &
                       'constant ones to symsde_model_set_damping')
      end if
      if (.not. allocated(refusal)) then
         call c_f_pointer(model, holder)
         nullify (acting)
         if (c_associated(rates)) then
            if (.not. associated(holder%rates)) allocate (holder%rates)
            call holder%rates%set(rates, nrate == 1, iand(depends, on_position) > 0, iand(depends, on_time) > 0, user)
            acting => holder%rates
         end if
         call new_damping(known%damping, acting, allow_gain /= 0)
         call known%passed%forget()
      end if
      status = finish(refusal, error)
   end function symsde_model_set_damping_function

   !> Friction on the velocities of a model, p' = .. - Gamma M^-1 p, by a symmetric matrix (ndof, ndof) [mass/time].
   function symsde_model_set_friction(model, friction, allow_gain, error) result(status) &
      bind(c, name='symsde_model_set_friction')
      type(c_ptr), intent(in), value :: model, friction, error
      integer(c_int), intent(in), value :: allow_gain   !! not zero: an eigenvalue may be negative
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: known
      real(wp), pointer, contiguous :: given(:, :)

      call find_model(model, known, refusal)
      call require(friction, 'friction', refusal)
      if (.not. allocated(refusal)) then
         call view(friction, int(known%traits%ndof, i8), int(known%traits%ndof, i8), given)
         call new_damping(known%damping, given, known%traits%ndof, refusal, allow_gain /= 0)
      end if
      status = finish(refusal, error)
   end function symsde_model_set_friction

   !> Put a model into a heat bath: damped momenta, and additive noises after its own, one for each degree of freedom.
   function symsde_model_thermostat(model, ngamma, gamma, nbeta, beta, error) result(status) &
      bind(c, name='symsde_model_thermostat')
      type(c_ptr), intent(in), value :: model, gamma, beta, error
      integer(c_int), intent(in), value :: ngamma, nbeta
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: known
      type(thermostat_model), allocatable :: bath
      type(model_handle), pointer :: holder
      real(wp), pointer, contiguous :: rates(:), betas(:)

      call find_model(model, known, refusal)
      call require(gamma, 'gamma', refusal)
      call require(beta, 'beta', refusal)
      if (min(ngamma, nbeta) < 1) call raise(refusal, invalid_argument, 'symsde_model_thermostat', 'ngamma = '// &
                                             to_text(ngamma)//', nbeta = '//to_text(nbeta)//': give one number of '// &
                                             'each, or one for each degree of freedom')
      if (.not. allocated(refusal)) then
         call view(gamma, int(ngamma, i8), rates)
         call view(beta, int(nbeta, i8), betas)
         call c_f_pointer(model, holder)
         allocate (bath)
         call new_thermostat(bath, holder%model, rates, betas, refusal)
         if (.not. allocated(refusal)) call move_alloc(bath, holder%model)
      end if
      status = finish(refusal, error)
   end function symsde_model_thermostat

   !> Let a force F act on a model, dp = (-H_q + F) dt + ..; NULL removes it.
   function symsde_model_set_force(model, force, derivative, in_position, user, error) result(status) &
      bind(c, name='symsde_model_set_force')
      type(c_ptr), intent(in), value :: model, user, error
      type(c_funptr), intent(in), value :: force, derivative
      integer(c_int), intent(in), value :: in_position   !! not zero: F depends on q and t alone
      integer(c_int) :: status

      status = set_force(model, 1, force, derivative, in_position, user, error)
   end function symsde_model_set_force

   !> Let forces f_k multiply the noises of a model, dp = .. + sum_k (-H_k,q + f_k) o dW_k; NULL removes them.
   function symsde_model_set_noise_force(model, force, derivative, in_position, user, error) result(status) &
      bind(c, name='symsde_model_set_noise_force')
      type(c_ptr), intent(in), value :: model, user, error
      type(c_funptr), intent(in), value :: force, derivative
      integer(c_int), intent(in), value :: in_position   !! not zero: all f_k depend on q and t alone
      integer(c_int) :: status

      status = set_force(model, 2, force, derivative, in_position, user, error)
   end function symsde_model_set_noise_force

   !> Declare how far the forces of a model reach: no component i depends on q_j or p_j with |i-j| > bandwidth.
   function symsde_model_set_force_bandwidth(model, bandwidth, error) result(status) &
      bind(c, name='symsde_model_set_force_bandwidth')
      type(c_ptr), intent(in), value :: model, error
      integer(c_int), intent(in), value :: bandwidth   !! -1: nothing is declared
      integer(c_int) :: status
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: known
      class(force_type), pointer :: acting
      type(model_handle), pointer :: holder

      call find_model(model, known, refusal)
      if (.not. allocated(refusal) .and. bandwidth < -1) &
         call raise(refusal, invalid_argument, 'symsde_model_set_force_bandwidth', 'bandwidth = '// &
                    to_text(int(bandwidth))//': give 0 or more, or -1 where nothing is known')
      if (.not. allocated(refusal)) then
         call c_f_pointer(model, holder)
         if (.not. associated(holder%forces)) allocate (holder%forces)
         holder%forces%traits%bandwidth = bandwidth
         nullify (acting)
         if (holder%forces%traits%act()) acting => holder%forces
         call known%set_forces(acting)
      end if
      status = finish(refusal, error)
   end function symsde_model_set_force_bandwidth

   !> Set the force F of a handle, or the forces f_k of its noises.
   integer(c_int) function set_force(model, part, force, derivative, in_position, user, error) result(status)
      type(c_ptr), intent(in) :: model, user, error
      integer, intent(in) :: part
      type(c_funptr), intent(in) :: force, derivative
      integer(c_int), intent(in) :: in_position
      type(error_type), allocatable :: refusal
      class(model_type), pointer :: known
      class(force_type), pointer :: acting
      type(model_handle), pointer :: holder

      call find_model(model, known, refusal)
      if (.not. allocated(refusal)) then
         if (part == 2 .and. known%traits%nnoise == 0 .and. c_associated(force)) &
            call raise(refusal, invalid_argument, 'symsde_model_set_noise_force', 'model '//known%name//' has no '// &
                       'noise that a force could multiply: give it noises, H_k = 0 where only the force acts')
         if (c_associated(derivative) .and. .not. c_associated(force)) &
            call raise(refusal, invalid_argument, 'set_force', 'there is a derivative without a force: give both, '// &
                       'the force alone, or NULL for both')
      end if
      if (.not. allocated(refusal)) then
         call c_f_pointer(model, holder)
         if (.not. associated(holder%forces)) allocate (holder%forces)
         call holder%forces%set(part, force, derivative, in_position /= 0, user)
         nullify (acting)
         if (holder%forces%traits%act()) acting => holder%forces
         call known%set_forces(acting)
      end if
      status = finish(refusal, error)
   end function set_force

end module symsde_capi_open_system
