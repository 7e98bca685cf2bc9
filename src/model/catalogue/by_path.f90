! SPDX-License-Identifier: BSD-3-Clause
!> Built-in models whose parameters differ from path to path.
!>
!> Most parameters are factors of Hamiltonians, so that such a model is one with the parameters one, whose Hamiltonians
!> have factors (views/weighed). Of the synchrotron H = p^2/2 - omega^2 cos q = p^2/2 - cos q + (omega^2 - 1) H_2, since
!> H_2 = -cos q for sigma2 = 1. Parameters that enter in other ways must be the same for all paths.
module symsde_model_catalogue_by_path
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: is_finite_lane
   use symsde_base_memory, only: require_memory
   use symsde_base_status, only: error_type, raise, incompatible, invalid_argument, wrong_shape
   use symsde_base_text, only: name_length, to_text
   use symsde_model_abstract, only: model_type
   use symsde_model_catalogue_by_name, only: get_model, tabulate
   use symsde_model_views_weighed, only: weighed_model, new_weighed
   implicit none
   private
   public :: get_model_by_path

   ! What a parameter is: the number of the Hamiltonian of which it is the factor, or one of these.
   integer, parameter :: same_for_all = -1, of_every_noise = -2, of_cosine = -3

contains

   !> Make a built-in model with a row of parameters for each path: path first_path + i - 1 of a run has row i, so a run
   !> has as many paths as there are rows. One row is for all paths. Parameters that are not given keep their defaults.
   !> Refuses what get_model refuses, numbers that are not finite (invalid_argument), and a parameter that differs by
   !> path but is no factor (incompatible): alpha of henon_heiles, n and beta of fpu_chain, omega, epsilon, nu and alpha
   !> of driven_pendulum.
   subroutine get_model_by_path(model, name, keys, values, error)
      class(model_type), allocatable, intent(out) :: model
      character(*), intent(in) :: name          !! a name of model_names()
      character(*), intent(in) :: keys(:)       !! names of parameters, some of parameter_names(name), in any order
      real(wp), intent(in) :: values(:, :)      !! a row for each path, a column for each key
      type(error_type), allocatable, intent(inout) :: error
      class(model_type), allocatable :: inner
      character(len=name_length), allocatable :: names(:)
      real(wp), allocatable :: one(:), factors(:, :), column(:)
      integer, allocatable :: kinds(:)
      integer(i8) :: nrow
      integer :: i, k, onto

      if (allocated(error)) return
      nrow = size(values, 1, i8)
      if (nrow < 1 .or. size(values, 2) /= size(keys)) then
         call raise(error, wrong_shape, 'get_model_by_path', 'values have '//to_text(nrow)//' rows and '// &
                    to_text(size(values, 2))//' columns for '//to_text(size(keys))//' names of parameters; give a '// &
                    'row for each path and a column for each name')
         return
      end if
      call get_model(inner, name, keys, values(1, :), error)
      if (allocated(error)) return
      call require_memory(nrow*(inner%traits%nnoise + 3.0_wp), 'a model with parameters by path', 'give fewer rows', &
                          'get_model_by_path', error)
      if (allocated(error)) return
      call tabulate(name, names, one)
      call find_kinds(name, kinds)
      allocate (factors(nrow, 0:inner%traits%nnoise + 1))
      factors = 1
      factors(:, inner%traits%nnoise + 1) = 0
      onto = 0
      allocate (column(nrow))
      do k = 1, size(names)
         i = findloc(keys == names(k), .true., dim=1)
         if (i > 0) call require_moderate(trim(names(k)), values(:, i), kinds(k) == of_cosine)
         if (allocated(error)) return
         if (kinds(k) == same_for_all) then
            if (i == 0) cycle
            one(k) = values(1, i)
            if (any(abs(values(:, i) - one(k)) > 0)) &
               call raise(error, incompatible, 'get_model_by_path', 'parameter '//trim(names(k))//' of model '''// &
                          trim(name)//''' is no factor of a Hamiltonian; give the same number for all paths')
            cycle
         end if
         column = one(k)
         if (i > 0) column = values(:, i)
         call put(kinds(k), column)
         one(k) = 1
      end do
      call get_model(inner, name, names, one, error)
      if (allocated(error)) return
      allocate (weighed_model :: model)
      select type (model)
      type is (weighed_model)
         call new_weighed(model, inner, factors, onto, all(kinds /= 0 .and. kinds /= of_cosine))
      end select

   contains

      !> Refuse a column of values (invalid_argument) with one that is not finite, or whose square is not.
      subroutine require_moderate(key, x, square)
         character(*), intent(in) :: key
         real(wp), intent(in) :: x(:)
         logical, intent(in) :: square
         integer(i8) :: row

         do row = 1, nrow
            if (is_finite_lane(x(row))) then
               if (.not. square) cycle
               if (is_finite_lane(x(row)**2)) cycle
            end if
            call raise(error, invalid_argument, 'get_model_by_path', 'parameter '//key//' of model '''//trim(name)// &
                       ''' is '//to_text(x(row))//' in row '//to_text(row)//'; give finite numbers of moderate size')
            return
         end do
      end subroutine require_moderate

      !> Write factors of a kind.
      subroutine put(kind, x)
         integer, intent(in) :: kind
         real(wp), intent(in) :: x(:)
         integer :: j

         select case (kind)
         case (of_every_noise)
            do j = 1, inner%traits%nnoise
               factors(:, j) = x
            end do
         case (of_cosine)
            onto = 2
            factors(:, inner%traits%nnoise + 1) = x**2 - 1
         case default
            factors(:, kind) = x
         end select
      end subroutine put

   end subroutine get_model_by_path

   !> What the parameters of a model are, in the order of their names.
   pure subroutine find_kinds(name, kinds)
      character(*), intent(in) :: name
      integer, allocatable, intent(out) :: kinds(:)

      select case (name)
      case ('kubo'); kinds = [0, 1]
      case ('linear_oscillator', 'pendulum'); kinds = [1]
      case ('synchrotron'); kinds = [of_cosine, 1, 2]
      case ('additive_oscillator', 'noncommutative_oscillator'); kinds = [1, 2]
      case ('driven_pendulum'); kinds = [same_for_all, same_for_all, same_for_all, 1, 2, same_for_all]
      case ('henon_heiles'); kinds = [same_for_all, 1, 2]
      case default; kinds = [same_for_all, same_for_all, of_every_noise]
      end select
   end subroutine find_kinds

end module symsde_model_catalogue_by_path
