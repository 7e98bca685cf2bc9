! SPDX-License-Identifier: BSD-3-Clause
!> Helpers of the suites: models and schemes by name, single steps, Gauss-Hermite nodes, fitted slopes.
!>
!> A scene that cannot be set up ends the program: the mistake is in the suite, so no test should report it.
module scenes
   use drive, only: fill_steps
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type
   use symsde_ensemble_block_single_path, only: new_single_path
   use symsde_model_abstract, only: model_type
   use symsde_model_catalogue_by_name, only: get_model, parameter_names
   use symsde_noise_brownian, only: brownian_noise, new_brownian_noise
   use symsde_scheme_catalogue, only: get_scheme
   use symsde_scheme_scheme, only: scheme_type
   use symsde_step_factory, only: stepper_options, new_stepper
   use symsde_step_task, only: resolve_task
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: model_of, make_model, scheme_of, stepper_of, single_path_of, require, draw_weights, hermite_nodes, slope_of
   public :: make_both, hash_of

contains

   !> A built-in model with all its parameters, in the order of its table.
   function model_of(name, values) result(model)
      character(*), intent(in) :: name
      real(wp), intent(in) :: values(:)
      class(model_type), allocatable :: model
      type(error_type), allocatable :: error

      call get_model(model, name, parameter_names(name), values, error)
      call require(error)
   end function model_of

   !> `model_of` as a subroutine: with gfortran 12, assigning a polymorphic function result to a variable that holds a
   !> model of another size corrupts memory.
   subroutine make_model(model, name, values)
      class(model_type), allocatable, intent(out) :: model
      character(*), intent(in) :: name
      real(wp), intent(in) :: values(:)
      type(error_type), allocatable :: error

      call get_model(model, name, parameter_names(name), values, error)
      call require(error)
   end subroutine make_model

   !> A model with its default parameters, and a scheme.
   subroutine make_both(name, model, scheme_name, scheme)
      character(*), intent(in) :: name, scheme_name
      class(model_type), allocatable, intent(out) :: model
      type(scheme_type), intent(out) :: scheme
      type(error_type), allocatable :: error
      character(len=8) :: no_keys(0)
      real(wp) :: no_values(0)

      call get_model(model, trim(name), no_keys, no_values, error)
      call require(error)
      scheme = scheme_of(trim(scheme_name))
   end subroutine make_both

   function scheme_of(name) result(scheme)
      character(*), intent(in) :: name
      type(scheme_type) :: scheme
      type(error_type), allocatable :: error

      call get_scheme(scheme, name, error)
      call require(error)
   end function scheme_of

   !> The stepper that the factory chooses for model, scheme and options.
   subroutine stepper_of(stepper, model, scheme, options, nlane)
      class(stepper_type), allocatable, intent(out) :: stepper
      class(model_type), intent(in), target :: model
      character(*), intent(in) :: scheme
      type(stepper_options), intent(in) :: options
      integer, intent(in) :: nlane
      type(error_type), allocatable :: error

      call new_stepper(stepper, model, scheme_of(scheme), options, nlane, error)
      call require(error)
   end subroutine stepper_of

   !> End the program if setting up a scene has failed.
   subroutine require(error)
      type(error_type), allocatable, intent(in) :: error

      if (allocated(error)) error stop error%message
   end subroutine require

   !> Weights (h, dW_1 .. dW_m) of the steps 0 .. nstep-1 (nstep even) of paths 0 .. nlane-1.
   subroutine draw_weights(nlane, nnoise, nstep, h, seed, w)
      integer, intent(in) :: nlane, nnoise, nstep
      real(wp), intent(in) :: h
      integer(i8), intent(in) :: seed
      real(wp), allocatable, intent(out) :: w(:, :, :)  ! (nlane, 0:nnoise, 0:nstep-1)
      type(brownian_noise) :: noise
      type(error_type), allocatable :: error
      integer(i8) :: path(nlane), drawn, pair
      logical :: silent(nnoise)

      path = [(pair, pair=0, nlane - 1)]
      silent = .false.
      drawn = 0
      allocate (w(nlane, 0:nnoise, 0:nstep - 1), source=h)
      call new_brownian_noise(noise, nnoise, seed, h, 0, silent, error)
      call require(error)
      if (nnoise == 0) return
      do pair = 0, nstep/2 - 1
         call fill_steps(noise, path, pair, w(:, :, 2*pair:2*pair + 1), drawn)
      end do
   end subroutine draw_weights

   !> Nodes and weights of n points that integrate against the standard normal density, by Newton's
   !> method on the orthonormal Hermite polynomials.
   subroutine hermite_nodes(x, weight)
      real(wp), intent(out) :: x(:), weight(:)
      real(wp) :: z, value, slope
      integer :: n, i, k

      n = size(x)
      z = 2.5_wp*sqrt(n + 1.0_wp)  ! starts above the largest zero; deflation finds the zeros from right to left
      do i = 1, n
         do k = 1, 500
            call hermite(n, z, value, slope)
            value = value/(slope - value*sum(1/(z - x(:i - 1))))
            z = z - value
            if (abs(value) <= 4*epsilon(z)*max(1.0_wp, abs(z))) exit
         end do
         call hermite(n, z, value, slope)
         x(i) = z
         weight(i) = n/slope**2
         z = z - 1e-3_wp
      end do
      weight = weight/sum(weight)
   end subroutine hermite_nodes

   !> The orthonormal Hermite polynomial of degree n, and its derivative: sqrt(n) times the polynomial of degree n - 1.
   pure subroutine hermite(n, z, value, slope)
      integer, intent(in) :: n
      real(wp), intent(in) :: z
      real(wp), intent(out) :: value, slope
      real(wp) :: before, next
      integer :: k

      before = 0
      value = 1
      do k = 1, n
         next = (z*value - sqrt(real(k - 1, wp))*before)/sqrt(real(k, wp))
         before = value
         value = next
      end do
      slope = sqrt(real(n, wp))*before
   end subroutine hermite

   !> Slope of the least-squares line through (log x, log y).
   pure real(wp) function slope_of(x, y)
      real(wp), intent(in) :: x(:), y(:)
      real(wp) :: lx(size(x)), ly(size(x))

      lx = log(x) - sum(log(x))/size(x)
      ly = log(y) - sum(log(y))/size(x)
      slope_of = sum(lx*ly)/sum(lx**2)
   end function slope_of

   !> Rotate-and-xor hash of the bits of an array.
   pure integer(i8) function hash_of(x)
      real(wp), intent(in) :: x(:)
      integer :: i

      hash_of = size(x)
      do i = 1, size(x)
         hash_of = ieor(ishftc(hash_of, 7), transfer(x(i), hash_of))
      end do
   end function hash_of

   !> The stepper for a single path of this model, returning increments; not allocated if there is none. The caller
   !> keeps the task, to which the stepper points.
   subroutine single_path_of(single, task, model, scheme)
      class(stepper_type), allocatable, intent(out) :: single
      type(stepper_task), intent(inout), target :: task
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in), target :: scheme
      type(error_type), allocatable :: error

      call resolve_task(task, model, scheme, stepper_options(as_increments=.true.), error)
      call require(error)
      call new_single_path(single, task, model, 1_i8, error)
      call require(error)
   end subroutine single_path_of

end module scenes
