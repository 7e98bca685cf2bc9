! SPDX-License-Identifier: BSD-3-Clause
!> Streaming observers by their kinds: an observer from its request, and room for its results.
module symsde_ensemble_observe_observers
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type, raise, invalid_argument, too_large
   use symsde_base_text, only: to_text
   use symsde_ensemble_observe_autocorrelation, only: autocorrelation_observer, new_autocorrelation_observer
   use symsde_ensemble_observe_covariance, only: covariance_observer, new_covariance_observer
   use symsde_ensemble_observe_extremes, only: extremes_observer, new_extremes_observer
   use symsde_ensemble_observe_histogram, only: histogram_observer, new_histogram_observer
   use symsde_ensemble_observe_mean_values, only: mean_values_observer, new_mean_values_observer
   use symsde_ensemble_observe_passage, only: passage_observer, new_passage_observer
   use symsde_ensemble_observe_paths, only: paths_observer, new_paths_observer
   use symsde_ensemble_options, only: run_options, saved_count
   use symsde_ensemble_observe_streaming, only: streaming_observer, observer_request, observed_type, observed_run
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: observe_histogram, observe_quantiles, observe_covariance, observe_autocorrelation, observe_extremes, &
             observe_passage, observe_paths, observe_means
   public :: new_observer, new_observed_run, new_observed, clear_observed, ngroup, of_group_means

   integer, parameter :: observe_histogram = 1       !! histogram of one value, bins of one width
   integer, parameter :: observe_quantiles = 2       !! quantiles of one value, bins of one relative width
   integer, parameter :: observe_covariance = 3      !! covariances of some values
   integer, parameter :: observe_autocorrelation = 4 !! autocorrelation of one value along time
   integer, parameter :: observe_extremes = 5        !! extremes of one value until each saved time
   integer, parameter :: observe_passage = 6         !! passages out of an interval
   integer, parameter :: observe_paths = 7           !! some values of chosen paths
   integer, parameter :: observe_means = 8           !! means of some values
   integer, parameter :: one_value(5) = [observe_histogram, observe_quantiles, observe_autocorrelation, &
                                         observe_extremes, observe_passage]

contains

   !> Data of a run that observers need. nvalue counts q, p, the energy if the model has one, and observables.
   subroutine new_observed_run(run, model, options, nlane, nobservable)
      type(observed_run), intent(out) :: run
      class(model_type), intent(in), target :: model
      type(run_options), intent(in) :: options
      integer, intent(in) :: nlane, nobservable
      integer :: k

      run%ndof = model%traits%ndof
      run%nvalue = 2*run%ndof + merge(1, 0, model%traits%has_value) + nobservable
      run%nlane = nlane
      run%ntime = int(saved_count(options))
      run%first_path = options%first_path
      run%npath = options%npath
      run%first_step = options%first_step
      run%save_every = options%save_every
      run%seed = options%seed
      run%step = options%step
      run%nnoise = model%traits%nnoise
      allocate (run%common(run%nnoise), source=.false.)
      if (allocated(options%common_noise)) run%common = [(any(options%common_noise == k), k=1, run%nnoise)]
      run%position_noise = model%traits%position_noise
      run%has_value = model%traits%has_value
      run%has_gradient = model%traits%has_gradient
      run%model => model
   end subroutine new_observed_run

   !> An observer from its request.
   subroutine new_observer(observer, request, run, error)
      class(streaming_observer), allocatable, intent(out) :: observer
      type(observer_request), intent(in) :: request
      type(observed_run), intent(in) :: run
      type(error_type), allocatable, intent(inout) :: error

      call check_request(request, run, error)
      if (allocated(error)) return
      select case (request%kind)
      case (observe_histogram, observe_quantiles)
         allocate (histogram_observer :: observer)
      case (observe_covariance)
         allocate (covariance_observer :: observer)
      case (observe_autocorrelation)
         allocate (autocorrelation_observer :: observer)
      case (observe_extremes)
         allocate (extremes_observer :: observer)
      case (observe_passage)
         allocate (passage_observer :: observer)
      case (observe_means)
         allocate (mean_values_observer :: observer)
      case default
         allocate (paths_observer :: observer)
      end select
      select type (observer)
      type is (histogram_observer)
         call new_histogram_observer(observer, request, run%ntime, request%kind == observe_quantiles, error)
      type is (covariance_observer)
         call new_covariance_observer(observer, request, run%ntime)
      type is (autocorrelation_observer)
         call new_autocorrelation_observer(observer, request, run%ntime, error)
      type is (extremes_observer)
         call new_extremes_observer(observer, run%ntime)
      type is (mean_values_observer)
         call new_mean_values_observer(observer, request, run%ntime)
      type is (passage_observer)
         call new_passage_observer(observer, request, run, error)
      type is (paths_observer)
         call new_paths_observer(observer, request, run, error)
      end select
      observer%request = request
      observer%run = run
      if (ngroup(request)*(real(observer%ncount, wp) + real(observer%nsum(), wp)) > 2.0_wp**31) &
         call raise(error, too_large, 'new_observer', 'an observer would keep '//to_text(observer%ncount)// &
                    ' integers and '//to_text(observer%nsum())//' numbers for each of '// &
                    to_text(ngroup(request))//' groups: save less often (save_every), or ask for fewer bins, '// &
                    'values, paths or groups')
   end subroutine new_observer

   !> Whether a request asks for means of groups.
   elemental logical function of_group_means(request)
      type(observer_request), intent(in) :: request

      of_group_means = request%kind == observe_means .and. request%ngroup > 0
   end function of_group_means

   !> Number of statistics that a request asks for.
   pure integer function ngroup(request)
      type(observer_request), intent(in) :: request

      ngroup = max(1, request%ngroup)
   end function ngroup

   !> Refuse unknown kinds, and values that the run does not have.
   subroutine check_request(request, run, error)
      type(observer_request), intent(in) :: request
      type(observed_run), intent(in) :: run
      type(error_type), allocatable, intent(inout) :: error
      integer :: n

      n = 0
      if (allocated(request%values)) n = size(request%values)
      if (request%kind < observe_histogram .or. request%kind > observe_means) then
         call refuse('kind '//to_text(request%kind)//' of an observer does not exist: give 1 to '// &
                     to_text(observe_means))
      else if (n == 0 .or. (n > 1 .and. any(request%kind == one_value))) then
         call refuse('an observer of kind '//to_text(request%kind)//' is given '//to_text(n)//' values: give '// &
                     trim(merge('one         ', 'at least one', any(request%kind == one_value))))
      else if (any(request%values < 1 .or. request%values > run%nvalue)) then
         call refuse('an observer looks at values '//to_text(minval(request%values))//' to '// &
                     to_text(maxval(request%values))//', and there are '//to_text(run%nvalue)// &
                     ' (q, p, the energy where there is one, observables): give numbers of these')
      else if (allocated(request%shares)) then
         if (.not. all(request%shares >= 0 .and. request%shares <= 1)) &
            call refuse('shares of quantiles from '//to_text(minval(request%shares))//' to '// &
                        to_text(maxval(request%shares))//': give numbers between 0 and 1')
      end if

   contains

      subroutine refuse(message)
         character(*), intent(in) :: message

         call raise(error, invalid_argument, 'new_observer', message)
      end subroutine refuse

   end subroutine check_request

   !> Allocate the results of a request, and return the number of values in its answer.
   subroutine new_observed(observed, nanswer, request, run, error)
      type(observed_type), intent(out) :: observed
      integer(i8), intent(out) :: nanswer
      type(observer_request), intent(in) :: request
      type(observed_run), intent(in) :: run
      type(error_type), allocatable, intent(inout) :: error
      class(streaming_observer), allocatable :: observer

      nanswer = 0
      call new_observer(observer, request, run, error)
      if (allocated(error)) return
      nanswer = ngroup(request)*observer%nanswer()
      call clear_observed(observed, observer)
   end subroutine new_observed

   !> Results of an observer that has seen no path.
   subroutine clear_observed(observed, observer)
      type(observed_type), intent(out) :: observed
      class(streaming_observer), intent(in) :: observer
      integer(i8) :: m, n
      integer :: k

      observed%request = observer%request
      observed%of = observer%run
      m = observer%ncount
      n = observer%nsum()
      allocate (observed%counts(ngroup(observed%request)*m), observed%sums(ngroup(observed%request)*n))
      observed%sums = 0
      do k = 0, ngroup(observed%request) - 1
         call observer%clear(observed%counts(k*m + 1:(k + 1)*m), observed%sums(k*n + 1:k*n + observer%nsingle))
      end do
      nullify (observed%request%labels)
      nullify (observed%of%model, observed%of%observables)  ! results may outlive the model and the observables
   end subroutine clear_observed

end module symsde_ensemble_observe_observers
