! SPDX-License-Identifier: BSD-3-Clause
!> struct symsde_traits and its two conversions.
module symsde_capi_traits
   use, intrinsic :: iso_c_binding, only: &
      c_associated, c_double, c_f_pointer, c_int, c_int32_t, c_loc, c_null_ptr, c_ptr, c_size_t, c_sizeof
   use symsde_base_kinds, only: wp, i8
   use symsde_base_traits, only: model_traits
   use symsde_capi_arrays, only: view
   use symsde_capi_error, only: init_struct
   use symsde_model_parameters, only: largest_system
   implicit none
   private
   public :: c_traits, from_traits, to_traits, symsde_traits_init

   !> struct symsde_traits
   type, bind(c) :: c_traits
      integer(c_size_t) :: struct_size
      integer(c_int32_t) :: ndof, nnoise
      integer(c_int32_t) :: separable, additive, position_noise, quadratic, identity_mass
      integer(c_int32_t) :: bandwidth
      integer(c_int32_t) :: has_value, has_hessian, has_hessian_vector
      real(c_double) :: max_frequency
      real(c_double) :: noise_lipschitz
      type(c_ptr) :: rotation
      type(c_ptr) :: silent
      integer(c_int32_t) :: constant_mass, diagonal_mass
      type(c_ptr) :: touches_from, touches
      integer(c_int32_t) :: has_gradient, has_parts
   end type c_traits

contains

   !> The traits of an undeclared model: one degree of freedom, no noise, dense Hessian.
   function symsde_traits_init(traits) result(status) bind(c, name='symsde_traits_init')
      type(c_ptr), intent(in), value :: traits
      integer(c_int) :: status
      type(c_traits), target :: blank

      blank = from_traits(model_traits())
      status = init_struct(traits, 'traits', c_loc(blank), c_sizeof(blank))
   end function symsde_traits_init

   !> Convert traits to the C struct, with all members filled; its rotation, silent and touches point into the traits.
   function from_traits(traits) result(filled)
      type(model_traits), intent(in), target :: traits
      type(c_traits) :: filled

      filled%struct_size = c_sizeof(filled)
      filled%ndof = traits%ndof
      filled%nnoise = traits%nnoise
      filled%separable = merge(1, 0, traits%separable)
      filled%additive = merge(1, 0, traits%additive)
      filled%position_noise = merge(1, 0, traits%position_noise)
      filled%quadratic = merge(1, 0, traits%quadratic)
      filled%identity_mass = merge(1, 0, traits%identity_mass)
      filled%constant_mass = merge(1, 0, traits%constant_mass)
      filled%diagonal_mass = merge(1, 0, traits%diagonal_mass)
      filled%bandwidth = traits%bandwidth
      filled%has_value = merge(1, 0, traits%has_value)
      filled%has_gradient = merge(1, 0, traits%has_gradient)
      filled%has_parts = merge(1, 0, traits%has_parts)
      filled%has_hessian = merge(1, 0, traits%has_hessian)
      filled%has_hessian_vector = merge(1, 0, traits%has_hessian_vector)
      filled%max_frequency = traits%max_frequency
      filled%noise_lipschitz = traits%noise_lipschitz
      filled%rotation = c_null_ptr
      if (allocated(traits%rotation)) filled%rotation = c_loc(traits%rotation)
      filled%silent = c_null_ptr
      if (allocated(traits%silent)) filled%silent = c_loc(traits%silent)  ! four bytes each, 0 or 1
      filled%touches_from = c_null_ptr
      filled%touches = c_null_ptr
      if (.not. traits%touches%are_given()) return
      filled%touches_from = c_loc(traits%touches%from)
      if (size(traits%touches%dof) > 0) filled%touches = c_loc(traits%touches%dof)
   end function from_traits

   !> Convert the user's declarations; the model itself sets has_value and the other has_... traits. If the number of
   !> degrees of freedom or noises is refused, frequencies and silent noises are not read.
   function to_traits(given) result(traits)
      type(c_traits), intent(in) :: given
      type(model_traits) :: traits
      real(wp), pointer, contiguous :: rotation(:)
      integer(c_int32_t), pointer :: silent(:)
      integer :: extent(1)

      traits%ndof = given%ndof
      traits%nnoise = given%nnoise
      traits%separable = given%separable /= 0
      traits%additive = given%additive /= 0
      traits%position_noise = given%position_noise /= 0
      traits%quadratic = given%quadratic /= 0
      traits%identity_mass = given%identity_mass /= 0
      traits%constant_mass = given%constant_mass /= 0
      traits%diagonal_mass = given%diagonal_mass /= 0
      traits%bandwidth = given%bandwidth
      traits%max_frequency = given%max_frequency
      traits%noise_lipschitz = given%noise_lipschitz
      if (c_associated(given%rotation) .and. given%ndof >= 1 .and. given%ndof <= largest_system) then
         call view(given%rotation, int(given%ndof, i8), rotation)
         traits%rotation = rotation
      end if
      if (c_associated(given%silent) .and. given%nnoise >= 1 .and. given%nnoise <= largest_system) then
         extent = given%nnoise
         call c_f_pointer(given%silent, silent, extent)
         if (any(silent /= 0)) traits%silent = silent /= 0
      end if
      if (c_associated(given%touches_from) .and. given%nnoise >= 1 .and. given%nnoise <= largest_system) &
         call read_supports(given, traits)
   end function to_traits

   !> The degrees of freedom that noises touch. If the places do not rise, only the places are kept, and are refused
   !> with the traits.
   subroutine read_supports(given, traits)
      type(c_traits), intent(in) :: given
      type(model_traits), intent(inout) :: traits
      integer(c_int32_t), pointer :: from(:), dof(:)
      integer :: extent(1), m

      m = given%nnoise
      extent = m + 1
      call c_f_pointer(given%touches_from, from, extent)
      traits%touches%from = from
      allocate (traits%touches%dof(0))
      extent = from(m + 1)
      if (from(1) /= 0 .or. any(from(2:) < from(:m)) .or. extent(1) < 1 .or. .not. c_associated(given%touches)) return
      call c_f_pointer(given%touches, dof, extent)
      traits%touches%dof = dof
   end subroutine read_supports

end module symsde_capi_traits
