! SPDX-License-Identifier: BSD-3-Clause
!>    kubo                       H = a (p^2 + q^2)/2             H_1 = sigma (p^2 + q^2)/2
!>    linear_oscillator          H = (p^2 + q^2)/2               H_1 = -sigma q
!>    synchrotron                H = p^2/2 - omega^2 cos q       H_1 = sigma1 sin q,  H_2 = -sigma2 cos q
!>    additive_oscillator        H = (p^2 + q^2)/2               H_1 = sigma p,  H_2 = -gamma q
!>    pendulum                   H = p^2/2 - cos q               H_1 = sigma (p^2 + q^2)/2
!>    driven_pendulum            H = p^2/2 - omega^2 (1 + epsilon cos nu t) cos q,  noises -s(t) q, -s(t) cos q
!>    noncommutative_oscillator  H = (p^2 + q^2)/2               H_1 = s1 p^2/2,  H_2 = s2 q^2/2
!>    henon_heiles               H = (p.p + q.q)/2 + alpha (q_1^2 q_2 - q_2^3/3),   H_k = sigmak q_k
!>    fpu_chain                  H = sum p_i^2/2 + sum (r_i^2/2 + beta r_i^4/4),    H_k = -sigma q_k
!>
!> The built-in models by name, with their parameters by key. kubo, linear_oscillator, synchrotron and
!> additive_oscillator are the examples of [WHSB]; the remaining models add noise that does not commute, multiplicative
!> noise in a nonlinear system, dependence on time, and several or many degrees of freedom.
!>
!> Names and defaults of parameters are in the file of each model. A new model must be added to the imports and to
!> all_names, is_built_in, tabulate, allocate_model and construct.
module symsde_model_catalogue_by_name
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, invalid_argument, unknown_name, wrong_shape
   use symsde_base_text, only: name_length, nearest_name, nearest_names, to_text
   use symsde_model_abstract, only: model_type
   use symsde_model_catalogue_additive_oscillator, only: additive_oscillator_model, new_additive_oscillator, &
                                                         additive_oscillator_names, additive_oscillator_defaults
   use symsde_model_catalogue_driven_pendulum, only: driven_pendulum_model, new_driven_pendulum, &
                                                     driven_pendulum_names, driven_pendulum_defaults
   use symsde_model_catalogue_fpu_chain, only: fpu_chain_model, new_fpu_chain, fpu_chain_names, fpu_chain_defaults
   use symsde_model_catalogue_henon_heiles, only: henon_heiles_model, new_henon_heiles, henon_heiles_names, &
                                                  henon_heiles_defaults
   use symsde_model_catalogue_kubo, only: kubo_model, new_kubo, kubo_names, kubo_defaults
   use symsde_model_catalogue_linear_oscillator, only: linear_oscillator_model, new_linear_oscillator, &
                                                       linear_oscillator_names, linear_oscillator_defaults
   use symsde_model_catalogue_noncommutative_oscillator, only: noncommutative_oscillator_model, &
                                                               new_noncommutative_oscillator, &
                                                               noncommutative_oscillator_names, &
                                                               noncommutative_oscillator_defaults
   use symsde_model_catalogue_pendulum, only: pendulum_model, new_pendulum, pendulum_names, pendulum_defaults
   use symsde_model_catalogue_synchrotron, only: synchrotron_model, new_synchrotron, synchrotron_names, &
                                                 synchrotron_defaults
   use symsde_model_views_thermostat, only: thermostat_model
   implicit none
   private
   public :: model_names, parameter_names, parameter_defaults, tabulate, get_model, is_built_in

   ! Models are listed in this order, which users see.
   character(len=name_length), parameter :: all_names(9) = [character(len=name_length) :: &
                                                            'kubo', 'linear_oscillator', 'synchrotron', &
                                                            'additive_oscillator', 'pendulum', 'driven_pendulum', &
                                                            'noncommutative_oscillator', 'henon_heiles', &
                                                            'fpu_chain']

contains

   !> Names of the built-in models.
   pure function model_names() result(names)
      character(len=name_length) :: names(size(all_names))

      names = all_names
   end function model_names

   !> Whether a model is of a built-in type and not of an extension: tests probe the declarations of built-in models, so
   !> that runs need not. A heat bath around a built-in model counts as built-in, too, since its declarations are
   !> derived from the model's.
   pure recursive function is_built_in(model) result(built_in)
      class(model_type), intent(in) :: model
      logical :: built_in

      ! `type is` holds for exactly this type: an extension of a model may have other functions, and is probed.
      built_in = .true.
      select type (model)
      type is (kubo_model)
      type is (linear_oscillator_model)
      type is (synchrotron_model)
      type is (additive_oscillator_model)
      type is (pendulum_model)
      type is (driven_pendulum_model)
      type is (noncommutative_oscillator_model)
      type is (henon_heiles_model)
      type is (fpu_chain_model)
      type is (thermostat_model)
         built_in = is_built_in(model%inner)
      class default
         built_in = .false.
      end select
   end function is_built_in

   !> Names of a model's parameters; empty for an unknown model.
   pure function parameter_names(name) result(names)
      character(*), intent(in) :: name  !! name of the model
      character(len=name_length), allocatable :: names(:)
      real(wp), allocatable :: defaults(:)

      call tabulate(name, names, defaults)
   end function parameter_names

   !> Defaults of a model's parameters, in the order of their names; empty for an unknown model.
   pure function parameter_defaults(name) result(defaults)
      character(*), intent(in) :: name  !! name of the model
      character(len=name_length), allocatable :: names(:)
      real(wp), allocatable :: defaults(:)

      call tabulate(name, names, defaults)
   end function parameter_defaults

   !> Make a built-in model. Parameters that are not given keep their defaults. Refuses an unknown model or key with the
   !> nearest name or names (unknown_name), a key given twice, a value that the model refuses (invalid_argument),
   !> different numbers of keys and values (wrong_shape).
   subroutine get_model(model, name, keys, values, error)
      class(model_type), allocatable, intent(out) :: model
      character(*), intent(in) :: name      !! a name of model_names()
      character(*), intent(in) :: keys(:)   !! some of parameter_names(name), in any order
      real(wp), intent(in) :: values(:)     !! a value for each key
      type(error_type), allocatable, intent(inout) :: error
      character(len=name_length), allocatable :: names(:), known(:)
      real(wp), allocatable :: parameters(:)

      if (allocated(error)) return
      ! The table of defaults becomes the list of parameters, in which given values replace some.
      call tabulate(name, names, parameters)
      ! An unknown name has no parameters, while every model has at least one.
      if (size(names) == 0) then
         known = model_names()
         call raise(error, unknown_name, 'get_model', 'there is no model '''//trim(name)// &
                    '''; the nearest is '//trim(nearest_name(name, known))//'; model_names() lists all')
      end if
      ! Each of these procedures does nothing if an error is raised already.
      call set_parameters(name, names, keys, values, parameters, error)
      if (allocated(error)) return
      ! Allocate the type first: a constructor needs a variable of its own type.
      call allocate_model(model, name)
      call construct(model, parameters, error)
      ! A model that refused its parameters must not be used.
      if (allocated(error)) deallocate (model)
   end subroutine get_model

   !> Names and defaults of the parameters of a model, from its own file.
   pure subroutine tabulate(name, names, defaults)
      character(*), intent(in) :: name
      character(len=name_length), allocatable, intent(out) :: names(:)
      real(wp), allocatable, intent(out) :: defaults(:)

      select case (name)
      case ('kubo')
         ! The file of each model lists its parameters in the order of the constructor's arguments.
         names = kubo_names
         defaults = kubo_defaults
      case ('linear_oscillator')
         names = linear_oscillator_names
         defaults = linear_oscillator_defaults
      case ('synchrotron')
         names = synchrotron_names
         defaults = synchrotron_defaults
      case ('additive_oscillator')
         names = additive_oscillator_names
         defaults = additive_oscillator_defaults
      case ('pendulum')
         names = pendulum_names
         defaults = pendulum_defaults
      case ('driven_pendulum')
         names = driven_pendulum_names
         defaults = driven_pendulum_defaults
      case ('noncommutative_oscillator')
         names = noncommutative_oscillator_names
         defaults = noncommutative_oscillator_defaults
      case ('henon_heiles')
         names = henon_heiles_names
         defaults = henon_heiles_defaults
      case ('fpu_chain')
         names = fpu_chain_names
         defaults = fpu_chain_defaults
      case default
         ! Unknown names give empty lists.
         allocate (names(0), defaults(0))
      end select
   end subroutine tabulate

   !> Replace defaults by the given values.
   subroutine set_parameters(name, names, keys, values, parameters, error)
      character(*), intent(in) :: name, names(:), keys(:)
      real(wp), intent(in) :: values(:)
      real(wp), intent(inout) :: parameters(:)
      type(error_type), allocatable, intent(inout) :: error
      logical :: given(size(names))
      integer :: i, k

      if (allocated(error)) return
      if (size(keys) /= size(values)) then
         call raise(error, wrong_shape, 'get_model', to_text(size(keys))// &
                    ' parameter names and '//to_text(size(values))// &
                    ' values; give one value for each name')
         return
      end if
      ! A key that is given twice is refused: taking the later value would hide a misprint.
      given = .false.
      do i = 1, size(keys)
         ! Texts of different lengths are compared as if padded by blanks.
         k = findloc(names == keys(i), .true., dim=1)
         ! The message names the nearest parameters of the model.
         if (k == 0) then
            call raise(error, unknown_name, 'get_model', 'model '''//trim(name)// &
                       ''' has no parameter '''//trim(keys(i))//'''; it has '// &
                       nearest_names(keys(i), names))
            return
         else if (given(k)) then
            call raise(error, invalid_argument, 'get_model', 'parameter '//trim(keys(i))// &
                       ' of model '''//trim(name)//''' is given twice; give it once')
            return
         end if
         given(k) = .true.
         ! The model's constructor checks range and finiteness.
         parameters(k) = values(i)
      end do
   end subroutine set_parameters

   !> Allocate an empty model of the type for this name.
   subroutine allocate_model(model, name)
      class(model_type), allocatable, intent(out) :: model
      character(*), intent(in) :: name

      select case (name)
      case ('kubo'); allocate (kubo_model :: model)
      case ('linear_oscillator'); allocate (linear_oscillator_model :: model)
      case ('synchrotron'); allocate (synchrotron_model :: model)
      case ('additive_oscillator'); allocate (additive_oscillator_model :: model)
      case ('pendulum'); allocate (pendulum_model :: model)
      case ('driven_pendulum'); allocate (driven_pendulum_model :: model)
      case ('noncommutative_oscillator'); allocate (noncommutative_oscillator_model :: model)
      case ('henon_heiles'); allocate (henon_heiles_model :: model)
      case ('fpu_chain'); allocate (fpu_chain_model :: model)
      case default  ! unknown model: stays unallocated
      end select
   end subroutine allocate_model

   !> Construct the model from all its parameters, in the order of its table of names: for kubo x = (a, sigma), for
   !> synchrotron x = (omega, sigma1, sigma2).
   subroutine construct(model, x, error)
      class(model_type), intent(inout) :: model
      real(wp), intent(in) :: x(:)  !! parameters
      type(error_type), allocatable, intent(inout) :: error
      integer :: n

      select type (model)
      type is (kubo_model)
         call new_kubo(model, x(1), x(2), error)
      type is (linear_oscillator_model)
         call new_linear_oscillator(model, x(1), error)
      type is (synchrotron_model)
         call new_synchrotron(model, x(1), x(2), x(3), error)
      type is (additive_oscillator_model)
         call new_additive_oscillator(model, x(1), x(2), error)
      type is (pendulum_model)
         call new_pendulum(model, x(1), error)
      type is (driven_pendulum_model)
         call new_driven_pendulum(model, x(1), x(2), x(3), x(4), x(5), x(6), error)
      type is (noncommutative_oscillator_model)
         call new_noncommutative_oscillator(model, x(1), x(2), error)
      type is (henon_heiles_model)
         call new_henon_heiles(model, x(1), x(2), x(3), error)
      type is (fpu_chain_model)
         ! The number of masses is given as a real number; a fraction of a mass is refused.
         call whole_number('n', x(1), n, error)
         call new_fpu_chain(model, n, x(2), x(3), error)
      end select
   end subroutine construct

   !> A parameter that counts something, given as a real number.
   subroutine whole_number(key, x, n, error)
      character(*), intent(in) :: key
      real(wp), intent(in) :: x
      integer, intent(out) :: n
      type(error_type), allocatable, intent(inout) :: error

      n = 0
      ! For NaN, infinities and numbers beyond the integers n stays zero, and the next line refuses them.
      if (abs(x) <= huge(n)) n = nint(x)
      if (.not. abs(x - n) <= 0) &
         call raise(error, invalid_argument, 'get_model', 'parameter '//key//' is '//to_text(x)// &
                    '; give a whole number')
   end subroutine whole_number

end module symsde_model_catalogue_by_name
