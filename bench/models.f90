! SPDX-License-Identifier: BSD-3-Clause
!> Models of a user, in Fortran and in C, beside the same models of the catalogue.
!>
!> bench_models [REPEATS]: all that describe one model in turn, one thread, processor time, 4096 paths.
!> Lines: model NAME SCHEME LANGUAGE, ns per path-step (median, least, largest), and the median of the ratios to the
!> built-in model, with which positions after 100 steps must agree.
program bench_models
   use, intrinsic :: iso_c_binding, only: c_funloc, c_funptr, c_null_funptr, c_null_ptr
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type
   use symsde_base_traits, only: model_traits
   use symsde_ensemble_run_simulate, only: paths_type
   use symsde_model_user_callback, only: callback_model, new_callback_model
   use symsde_model_user_callback_functions, only: gradient_callback, hessian_callback, gradient_hessian_callback
   use bench_support, only: median, scene_type, new_scene, run_paths, integer_argument, stop_on
   use bench_user_models, only: user_oscillator, user_synchrotron, plain_synchrotron
   implicit none
   procedure(gradient_callback), bind(c, name='bench_oscillator_gradient') :: oscillator_gradient
   procedure(hessian_callback), bind(c, name='bench_oscillator_hessian') :: oscillator_hessian
   procedure(gradient_callback), bind(c, name='bench_synchrotron_gradient') :: synchrotron_gradient
   procedure(gradient_hessian_callback), bind(c, name='bench_synchrotron_both') :: synchrotron_both
   procedure(gradient_callback), bind(c, name='bench_plain_gradient') :: plain_gradient
   procedure(hessian_callback), bind(c, name='bench_plain_hessian') :: plain_hessian
   integer(i8), parameter :: npath = 4096
   real(wp), parameter :: h = 0.02_wp
   character(*), parameter :: languages(5) = &
                              [character(len=16) :: 'built-in', 'Fortran', 'C', 'Fortran_plain', 'C_plain']
   integer(i8) :: repeats

   repeats = integer_argument(1, 7_i8)
   call compare('linear_oscillator', 'symplectic_euler', 10000_i8)
   call compare('linear_oscillator', 'midpoint', 10000_i8)
   call compare('synchrotron', 'symplectic_euler', 5000_i8)
   call compare('synchrotron', 'midpoint', 2500_i8)

contains

   !> Time all languages in turn and print their lines.
   subroutine compare(name, scheme, nstep)
      character(*), intent(in) :: name, scheme
      integer(i8), intent(in) :: nstep
      type(scene_type) :: scene
      type(paths_type) :: run
      real(wp) :: times(0:repeats, size(languages)), start, end  ! the first to compare results, shorter
      real(wp), allocatable :: expected(:)
      integer(i8) :: repeat
      integer :: i

      do repeat = 0, repeats
         do i = 1, size(languages)
            if (skipped(name, languages(i))) cycle
            call choose(name, scheme, languages(i), scene)
            call cpu_time(start)
            call run_paths(scene, npath, merge(nstep, 100_i8, repeat > 0), 0_i8, run)
            call cpu_time(end)
            times(repeat, i) = (end - start)*1e9_wp/(real(npath, wp)*real(nstep, wp))
            if (repeat == 0 .and. i == 1) expected = run%last_q(:, 1)
            if (repeat == 0) call check(maxval(abs(run%last_q(:, 1) - expected)))
         end do
      end do
      do i = 1, size(languages)
         if (skipped(name, languages(i))) cycle
         print '(a, 3(1x, a), 4(1x, es12.5))', 'model', name, scheme, trim(languages(i)), median(times(1:, i)), &
            minval(times(1:, i)), maxval(times(1:, i)), median(times(1:, i)/times(1:, 1))
      end do
   end subroutine compare

   !> All languages describe the same model.
   subroutine check(difference)
      real(wp), intent(in) :: difference

      if (difference <= 1e-10_wp) return
      print '(a, es9.2)', 'a model differs from the built-in one by', difference
      error stop 2
   end subroutine check

   !> The library has something to offer where sine and cosine are taken.
   pure logical function skipped(name, language)
      character(*), intent(in) :: name, language

      skipped = index(language, '_plain') > 0 .and. name /= 'synchrotron'
   end function skipped

   !> The scene of a model in one language.
   subroutine choose(name, scheme, language, scene)
      character(*), intent(in) :: name, scheme, language
      type(scene_type), intent(out) :: scene

      call new_scene(scene, name, [character(1) ::], [real(wp) ::], scheme, h)
      if (language == 'built-in') return
      deallocate (scene%model)
      if (language == 'Fortran' .and. name == 'linear_oscillator') then
         allocate (user_oscillator :: scene%model)
      else if (language == 'Fortran') then
         allocate (user_synchrotron :: scene%model)
      else if (language == 'Fortran_plain') then
         allocate (plain_synchrotron :: scene%model)
      else
         call from_c(scene, name, language == 'C_plain')
      end if
      scene%model%name = 'own '//name
      scene%model%traits = traits_of(name)
   end subroutine choose

   !> What a user declares.
   pure function traits_of(name) result(traits)
      character(*), intent(in) :: name
      type(model_traits) :: traits
      logical :: linear

      linear = name == 'linear_oscillator'
      traits = model_traits(ndof=1, nnoise=merge(1, 2, linear), separable=.true., position_noise=.true., &
                            additive=linear, quadratic=linear, identity_mass=.true., has_hessian=.true.)
   end function traits_of

   !> A model from C functions, with help of the library or plain.
   subroutine from_c(scene, name, plain)
      type(scene_type), intent(inout) :: scene
      character(*), intent(in) :: name
      logical, intent(in) :: plain
      type(callback_model), allocatable :: model
      type(error_type), allocatable :: error
      type(c_funptr) :: gradient, hessian, both

      both = c_null_funptr
      hessian = c_null_funptr
      if (name == 'linear_oscillator') then
         gradient = c_funloc(oscillator_gradient)
         hessian = c_funloc(oscillator_hessian)
      else if (plain) then
         gradient = c_funloc(plain_gradient)
         hessian = c_funloc(plain_hessian)
      else
         gradient = c_funloc(synchrotron_gradient)
         both = c_funloc(synchrotron_both)
      end if
      allocate (model)
      call new_callback_model(model, name, traits_of(name), gradient, c_null_funptr, hessian, c_null_funptr, &
                              c_null_ptr, error)
      call stop_on(error)
      call model%set_gradient_hessian(both)
      call model%accept_null()
      call move_alloc(model, scene%model)
   end subroutine from_c

end program bench_models
