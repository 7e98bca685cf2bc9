! SPDX-License-Identifier: BSD-3-Clause
!> The source of noise of a run: Brownian motion, or increments that the user gives, which are refused where the run
!> cannot use them.
!>
!>    given: rows (n - first_step) 2^refine + 1 .. of step n, columns dW, then dZ, K and E, each once for every noise,
!>           of one path or of all
!>
!> A scheme may ask for another law and for functionals of the path, which a given path has to determine. Truncation is
!> a bound on increments of either source.
module symsde_ensemble_run_noise
   use symsde_base_area_rule, only: area_rule, areas_in_law
   use symsde_base_functionals, only: functional_set, name_functionals, path_areas, path_dz, path_stt_area, path_decay
   use symsde_base_kinds, only: wp, i8
   use symsde_base_laws, only: law_gaussian
   use symsde_base_status, only: error_type, raise, wrong_shape, invalid_argument, incompatible
   use symsde_base_text, only: to_text
   use symsde_ensemble_options, only: run_options
   use symsde_ensemble_run_areas, only: choose_areas, check_area_counters
   use symsde_model_abstract, only: model_type
   use symsde_noise_brownian, only: brownian_noise, new_brownian_noise
   use symsde_noise_given, only: given_increments
   use symsde_noise_prescribed, only: prescribed_noise, new_prescribed_noise
   use symsde_noise_source, only: noise_type
   use symsde_noise_truncation, only: truncation_bound, lost_variance
   use symsde_scheme_scheme, only: scheme_type
   use symsde_step_open_kick_law, only: needed_functionals
   implicit none
   private
   public :: new_noise, refuse_not_finite

contains

   !> Make the noise source of a run: prescribed increments if given, else Brownian motion. A scheme may need
   !> increments of another law and functionals of the path; without a scheme, increments are Gaussian. The numbers of
   !> given increments are for refuse_not_finite.
   subroutine new_noise(noise, model, options, lost, error, dw, scheme)
      class(noise_type), allocatable, intent(out) :: noise
      class(model_type), intent(in) :: model
      type(run_options), intent(in) :: options
      real(wp), intent(out) :: lost  !! variance of a normal that truncation loses
      type(error_type), allocatable, intent(inout) :: error
      type(given_increments), intent(in), optional :: dw
      type(scheme_type), intent(in), optional :: scheme
      type(given_increments) :: given
      type(prescribed_noise) :: prescribed
      type(brownian_noise) :: brownian
      logical, allocatable :: silent(:)
      real(wp) :: cut
      type(area_rule) :: areas
      type(functional_set) :: asked
      integer :: law

      lost = 0
      law = law_gaussian
      if (present(scheme)) then
         law = scheme%law
         asked = needed_functionals(scheme, model%traits, model%damping, options%damping_noise)
         call choose_areas(model, scheme, options, asked, areas, error)
      end if
      if (present(dw)) given = dw
      if (given%exist()) then
         if (.not. allocated(error)) call check_increments(options, model%traits%nnoise, given%extent, error)
         if (.not. allocated(error)) &
            call check_given(model, scheme, options, asked, areas, int(given%extent(2)), error)
         if (allocated(error)) return
         call new_prescribed_noise(prescribed, given, options%first_path, options%first_step, options%refine, &
                                   options%step, model%traits%nnoise)
         allocate (noise, source=prescribed)
      else
         if (.not. allocated(error) .and. asked%has(path_areas)) &
            call check_area_counters(model%traits%nnoise, law, options, areas, error)
         if (allocated(error)) return
         allocate (silent(model%traits%nnoise), source=.false.)
         if (allocated(model%traits%silent)) silent = model%traits%silent
         call new_brownian_noise(brownian, model%traits%nnoise, options%seed, options%step, options%refine, &
                                 silent, error, law)
         if (allocated(error)) return
         allocate (noise, source=brownian)
      end if
      noise%asked = asked
      noise%areas = areas
      call share_noises(noise, options, error)
      if (allocated(error)) return
      if (.not. abs(options%truncation) <= 0) then
         call truncation_bound(options%step, options%truncation, options%truncation_time, cut, error)
         noise%bound = cut*sqrt(abs(options%step))
         lost = lost_variance(cut)
      end if
   end subroutine new_noise

   !> Mark the noises that all paths share, as the user chooses, and refuse (invalid_argument) numbers that no noise
   !> has.
   subroutine share_noises(noise, options, error)
      class(noise_type), intent(inout) :: noise
      type(run_options), intent(in) :: options
      type(error_type), allocatable, intent(inout) :: error
      integer :: i, k

      if (.not. allocated(options%common_noise)) return
      do i = 1, size(options%common_noise)
         k = options%common_noise(i)
         if (k < 1 .or. k > noise%nnoise) then
            call raise(error, invalid_argument, 'run_ensemble', 'common_noise holds '//to_text(k)//', and the '// &
                       'model has '//to_text(noise%nnoise)//' noises, counted from 1: give numbers of these')
            return
         end if
         noise%common(k) = .true.
      end do
   end subroutine share_noises

   !> Refuse (incompatible) prescribed increments that lack functionals of the scheme. Functionals come from finer rows
   !> or from columns of their own; columns that the scheme does not use are refused, too. Areas in law are also
   !> refused, since the given path determines its areas.
   subroutine check_given(model, scheme, options, asked, areas, ncolumn, error)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in), optional :: scheme
      type(run_options), intent(in) :: options
      type(functional_set), intent(in) :: asked
      type(area_rule), intent(in) :: areas
      integer, intent(in) :: ncolumn
      type(error_type), allocatable, intent(inout) :: error
      type(functional_set) :: missing, idle
      character(:), allocatable :: functionals, reader
      integer :: m

      m = model%traits%nnoise
      reader = 'what reads them'
      if (present(scheme)) reader = 'scheme '//scheme%name
      idle%has(path_dz) = ncolumn > m .and. .not. asked%has(path_dz)
      idle%has(path_stt_area) = ncolumn > 2*m .and. .not. asked%has(path_stt_area)
      idle%has(path_decay) = ncolumn > 3*m .and. .not. asked%has(path_decay)
      missing = asked
      missing%has(path_decay) = .false.  ! without E, D follows from dW, dZ and K
      missing%has(path_dz) = asked%has(path_dz) .and. ncolumn <= m
      missing%has(path_stt_area) = asked%has(path_stt_area) .and. ncolumn <= 2*m
      if (.not. idle%is_empty()) then
         call name_functionals(idle, functionals)
         call raise(error, incompatible, 'run_ensemble', 'the prescribed increments have '//to_text(ncolumn)// &
                    ' columns for '//to_text(m)//' noises, among them '//functionals//', and '//reader// &
                    ' takes none for model '//model%name//': leave these columns out')
      else if (asked%has(path_areas) .and. areas%kind == areas_in_law) then
         call raise(error, incompatible, 'run_ensemble', 'prescribed increments are the path, and its areas '// &
                    'follow from them: leave the choice of areas in law out')
      else if (options%refine < 1 .and. .not. missing%is_empty()) then
         call name_functionals(missing, functionals)
         call raise(error, incompatible, 'run_ensemble', reader//' needs '//functionals//' for model '// &
                    model%name//', which one prescribed increment a step does not determine: give finer rows, '// &
                    '2^refine a step with refine >= 1, dZ and K as more columns (all dW, all dZ, all K), or a '// &
                    'scheme that needs increments only, such as midpoint')
      end if
   end subroutine check_given

   !> Refuse (wrong_shape) prescribed increments unless they have one row for every step or finer step; one column for
   !> every noise, as many for dZ, for K, and for E; and one path or all paths. With refine < 0 prescribed increments
   !> are refused (incompatible).
   subroutine check_increments(options, nnoise, extent, error)
      type(run_options), intent(in) :: options
      integer, intent(in) :: nnoise
      integer(i8), intent(in) :: extent(3)
      type(error_type), allocatable, intent(inout) :: error
      integer(i8) :: rows

      if (options%refine < 0) then
         call raise(error, incompatible, 'run_ensemble', 'refine = '//to_text(options%refine)// &
                    ' needs draws of its own and cannot refine prescribed increments: give refine >= 0')
         return
      end if
      rows = options%nstep*2_i8**options%refine
      if (extent(3) /= rows .or. .not. any(extent(2) == nnoise*[1, 2, 3, 4]) .or. &
          (extent(1) /= 1 .and. extent(1) /= options%npath)) then
         call raise(error, wrong_shape, 'run_ensemble', 'the prescribed increments have '//to_text(extent(3))// &
                    ' rows, '//to_text(extent(2))//' noises and '//to_text(extent(1))//' paths; needed are '// &
                    to_text(rows)//' rows (steps*2^refine), '//to_text(nnoise)//' noises and '// &
                    to_text(options%npath)//' paths or one for all; columns beyond the noises are as many of dZ, '// &
                    'of K, and of E')
      end if
   end subroutine check_increments

   !> Refuse (invalid_argument) given increments that hold numbers that are not finite.
   subroutine refuse_not_finite(dw, options, error)
      type(given_increments), intent(in) :: dw
      type(run_options), intent(in) :: options
      type(error_type), allocatable, intent(inout) :: error
      integer(i8) :: at(3)
      character(:), allocatable :: path

      if (allocated(error) .or. .not. dw%exist()) return
      if (dw%are_finite()) return
      at = dw%first_not_finite()
      path = 'all paths'
      if (dw%extent(1) > 1) path = 'path '//to_text(options%first_path + at(1) - 1)
      call raise(error, invalid_argument, 'run_ensemble', 'the prescribed increments hold values that are not '// &
                 'finite, the first one in step '//to_text(options%first_step + (at(3) - 1)/2_i8**options%refine)// &
                 ' of '//path//' (column '//to_text(at(2))//', counted from 1): give finite numbers only')
   end subroutine refuse_not_finite

end module symsde_ensemble_run_noise
