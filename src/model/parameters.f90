! SPDX-License-Identifier: BSD-3-Clause
!> Checks of parameters and declared traits, shared by the constructors of models.
module symsde_model_parameters
   use symsde_base_kinds, only: wp
   use symsde_base_lanes, only: is_finite_lane
   use symsde_base_status, only: error_type, raise, invalid_argument, wrong_shape, too_large
   use symsde_base_text, only: to_text
   use symsde_base_traits, only: model_traits, dense
   implicit none
   private
   public :: require_finite, is_zero, check_traits, largest_system

   integer, parameter :: largest_system = 2**20  !! most noises that the generator can number

contains

   !> Refuse a parameter that is NaN or infinite (invalid_argument).
   subroutine require_finite(place, name, x, error)
      character(*), intent(in) :: place  !! name of the calling constructor
      character(*), intent(in) :: name   !! name of the parameter
      real(wp), intent(in) :: x          !! value of the parameter
      type(error_type), allocatable, intent(inout) :: error

      if (is_finite_lane(x)) return
      call raise(error, invalid_argument, place, 'parameter '//name//' is '//to_text(x)// &
                 '; give a finite number of moderate size')
   end subroutine require_finite

   !> Whether a parameter is exactly zero, of either sign, so that its term vanishes.
   elemental logical function is_zero(x)
      real(wp), intent(in) :: x

      is_zero = abs(x) <= 0
   end function is_zero

   !> Refuse traits that no model can have: sizes (invalid_argument, too_large), a list of silent noises, of what
   !> noises touch or of frequencies of the wrong length (wrong_shape), degrees of freedom that do not exist, bounds
   !> and frequencies below zero or not finite (invalid_argument), matrices that are not symmetric (invalid_argument).
   subroutine check_traits(place, name, traits, error)
      character(*), intent(in) :: place            !! name of the calling procedure
      character(*), intent(in) :: name             !! name of the model
      type(model_traits), intent(in) :: traits     !! traits as declared
      type(error_type), allocatable, intent(inout) :: error
      character(:), allocatable :: model

      model = 'model '''//name//''' declares '
      if (traits%ndof < 1) &
         call raise(error, invalid_argument, place, model//to_text(traits%ndof)// &
                    ' degrees of freedom; give ndof >= 1')
      if (traits%nnoise < 0) &
         call raise(error, invalid_argument, place, model//to_text(traits%nnoise)// &
                    ' noises; give nnoise >= 0')
      if (max(traits%ndof, traits%nnoise) > largest_system) &
         call raise(error, too_large, place, model//to_text(traits%ndof)// &
                    ' degrees of freedom and '//to_text(traits%nnoise)//' noises; give at most '// &
                    to_text(largest_system)//' of each')
      if (traits%bandwidth < dense) &
         call raise(error, invalid_argument, place, model//'bandwidth '// &
                    to_text(traits%bandwidth)//'; give bandwidth >= 0, or '// &
                    to_text(dense)//' for a dense Hessian')
      if (traits%bandwidth >= max(traits%ndof, 1)) &
         call raise(error, invalid_argument, place, model//'bandwidth '//to_text(traits%bandwidth)//' for '// &
                    to_text(traits%ndof)//' degrees of freedom; give 0 to '//to_text(traits%ndof - 1)//', or '// &
                    to_text(dense)//' for a dense Hessian')
      if (allocated(traits%silent)) then
         if (size(traits%silent) /= traits%nnoise) &
            call raise(error, wrong_shape, place, model//to_text(size(traits%silent))// &
                       ' silent flags for '//to_text(traits%nnoise)//' noises; give one for each')
      end if
      if (traits%touches%are_given()) call check_supports(place, model, traits, error)
      call check_bound(place, model//'max_frequency', traits%max_frequency, error)
      call check_bound(place, model//'noise_lipschitz', traits%noise_lipschitz, error)
      if (allocated(traits%rotation)) call check_rotation(place, model, traits, error)
      if (allocated(traits%quadratic_part)) call check_quadratic(place, model, traits, error)
      call check_slopes(place, model, traits, error)
      if (traits%phase_noise .and. .not. traits%kicks_of_actions) &
         call raise(error, invalid_argument, place, model//'noises that are linear in the actions (phase_noise) '// &
                    'without kicks by functions of these; declare kicks_of_actions, too')
      if (traits%kicks_of_actions .and. .not. allocated(traits%quadratic_part)) &
         call raise(error, invalid_argument, place, model//'kicks by functions of the actions without a quadratic '// &
                    'part of H; give the matrix of its second derivatives, which may be zero')
   end subroutine check_traits

   !> Refuse a quadratic part that is no symmetric matrix of finite numbers.
   subroutine check_quadratic(place, model, traits, error)
      character(*), intent(in) :: place, model
      type(model_traits), intent(in) :: traits
      type(error_type), allocatable, intent(inout) :: error

      associate (s => traits%quadratic_part)
         if (any(shape(s) /= 2*traits%ndof)) then
            call raise(error, wrong_shape, place, model//'a quadratic part of '//to_text(size(s, 1))//' rows for '// &
                       to_text(traits%ndof)//' degrees of freedom; give second derivatives by q and then by p, '// &
                       to_text(2*traits%ndof)//' rows')
            return
         end if
      end associate
      call require_symmetric(place, model//'a quadratic part', traits%quadratic_part, error)
   end subroutine check_quadratic

   !> Refuse derivatives of flows by parameters that are not those of symmetric matrices, or not finite; a model whose
   !> positions end with k parameters has k of them.
   subroutine check_slopes(place, model, traits, error)
      character(*), intent(in) :: place, model
      type(model_traits), intent(in) :: traits
      type(error_type), allocatable, intent(inout) :: error
      integer :: k

      if (allocated(traits%quadratic_slopes)) then
         if (2*size(traits%quadratic_slopes, 3) + size(traits%quadratic_slopes, 1) /= 2*traits%ndof .or. &
             size(traits%quadratic_slopes, 1) /= size(traits%quadratic_slopes, 2)) &
            call refuse_shape('quadratic_slopes', 'matrices of 2 (ndof - k) rows')
         do k = 1, size(traits%quadratic_slopes, 3)
            if (allocated(error)) return
            call require_symmetric(place, model//'a derivative of a quadratic part by parameter '//to_text(k), &
                                   traits%quadratic_slopes(:, :, k), error)
         end do
      end if
      if (allocated(traits%rotation_slopes)) then
         if (sum(shape(traits%rotation_slopes)) /= traits%ndof) call refuse_shape('rotation_slopes', 'ndof - k numbers')
         if (.not. all(is_finite_lane(traits%rotation_slopes))) &
            call raise(error, invalid_argument, place, model//'a derivative of the square of a frequency that is '// &
                       'not finite; give numbers')
      end if

   contains

      subroutine refuse_shape(name, wanted)
         character(*), intent(in) :: name, wanted

         call raise(error, wrong_shape, place, model//to_text(traits%ndof)//' positions, and '//name// &
                    ' for other numbers of positions or parameters; give '//wanted//' for each of k parameters')
      end subroutine refuse_shape

   end subroutine check_slopes

   !> Refuse a matrix that is not symmetric, or has entries that are not finite.
   subroutine require_symmetric(place, what, s, error)
      character(*), intent(in) :: place, what  !! what it is, behind the name of its model
      real(wp), intent(in) :: s(:, :)
      type(error_type), allocatable, intent(inout) :: error
      integer :: i, j

      if (allocated(error)) return
      do j = 1, size(s, 2)
         do i = 1, j
            if (.not. (is_finite_lane(s(i, j)) .and. is_finite_lane(s(j, i)))) then
               call raise(error, invalid_argument, place, what//' with an entry ('//to_text(i)//','//to_text(j)// &
                          ') that is not finite; give numbers')
            else if (abs(s(i, j) - s(j, i)) > 8*epsilon(1.0_wp)*max(abs(s(i, j)), abs(s(j, i)))) then
               call raise(error, invalid_argument, place, what//' that is not symmetric: ('//to_text(i)//','// &
                          to_text(j)//') = '//to_text(s(i, j))//', ('//to_text(j)//','//to_text(i)//') = '// &
                          to_text(s(j, i))//'; give second derivatives')
            end if
         end do
      end do
   end subroutine require_symmetric

   !> Refuse supports of noises (touches) that are no lists of degrees of freedom (wrong_shape, invalid_argument).
   subroutine check_supports(place, model, traits, error)
      character(*), intent(in) :: place, model
      type(model_traits), intent(in) :: traits
      type(error_type), allocatable, intent(inout) :: error
      integer :: k

      associate (from => traits%touches%from, dof => traits%touches%dof)
         if (size(from) /= traits%nnoise + 1) then
            call raise(error, wrong_shape, place, model//'degrees of freedom that '//to_text(size(from) - 1)// &
                       ' noises touch, and has '//to_text(traits%nnoise)//' noises; give a list for each (touches)')
            return
         end if
         do k = 1, size(from) - 1
            if (from(k) >= 0 .and. from(k) <= from(k + 1) .and. from(k + 1) <= size(dof)) cycle
            call raise(error, invalid_argument, place, model//'degrees of freedom that noise '//to_text(k)// &
                       ' touches from place '//to_text(from(k))//' to '//to_text(from(k + 1))//' of a list of '// &
                       to_text(size(dof))//'; give rising places (touches)')
            return
         end do
         do k = 1, size(dof)
            if (dof(k) >= 1 .and. dof(k) <= traits%ndof) cycle
            call raise(error, invalid_argument, place, model//'a noise that touches degree of freedom '// &
                       to_text(dof(k))//'; give numbers from 1 to '//to_text(traits%ndof)//' (touches)')
            return
         end do
      end associate
   end subroutine check_supports

   subroutine check_rotation(place, model, traits, error)
      character(*), intent(in) :: place, model
      type(model_traits), intent(in) :: traits
      type(error_type), allocatable, intent(inout) :: error
      integer :: i

      if (size(traits%rotation) /= traits%ndof) &
         call raise(error, wrong_shape, place, model//to_text(size(traits%rotation))// &
                    ' frequencies (rotation) for '//to_text(traits%ndof)// &
                    ' degrees of freedom; give one for each')
      do i = 1, size(traits%rotation)
         if (traits%rotation(i) >= 0 .and. is_finite_lane(traits%rotation(i))) cycle
         call raise(error, invalid_argument, place, model//'rotation('//to_text(i)//') = '// &
                    to_text(traits%rotation(i))//'; give finite frequencies >= 0')
      end do
   end subroutine check_rotation

   subroutine check_bound(place, what, bound, error)
      character(*), intent(in) :: place, what
      real(wp), intent(in) :: bound
      type(error_type), allocatable, intent(inout) :: error

      if (bound >= 0 .and. is_finite_lane(bound)) return
      call raise(error, invalid_argument, place, what//' = '//to_text(bound)// &
                 '; give a bound >= 0, or 0 for none')
   end subroutine check_bound

end module symsde_model_parameters
