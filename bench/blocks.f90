! SPDX-License-Identifier: BSD-3-Clause
!> The building blocks of a step, each alone, in blocks of 256 lanes, and what the machine can do.
!>
!> bench_blocks [REPEATS]. Lines: block NAME and ns of processor time per word, number, lane or element (median,
!> least, largest); machine NAME and GB/s or Gflop/s (the same).
program bench_blocks
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_record, only: step_request, step_store, new_step_store
   use symsde_base_sincos, only: sincos_lanes
   use symsde_base_status, only: error_type
   use symsde_model_abstract, only: model_type
   use symsde_model_catalogue_by_name, only: get_model, model_names
   use symsde_noise_brownian, only: brownian_noise, new_brownian_noise
   use symsde_noise_normal, only: normal_stream, normal_pair_lanes, scaled_normal_steps
   use symsde_noise_philox, only: philox_two_lanes, philox_tile
   use symsde_solve_newton, only: newton_type, newton_options, new_newton
   use bench_support, only: seconds => processor_seconds, print_times, integer_argument, stop_on
   implicit none
   integer(i4), parameter :: nlane = 256
   integer(i8), parameter :: ncall = 4000
   integer(i8) :: path(nlane), repeats
   real(wp) :: x(nlane), y(nlane), z(nlane)
   integer(i4) :: lane

   repeats = integer_argument(1, 7_i8)
   path = [(int(lane, i8), lane=0, nlane - 1)]
   x = [(0.01_wp*lane, lane=1, nlane)]
   call time_block('philox_word', 8.0_wp)
   call time_block('box_muller_normal', 2.0_wp)
   call time_block('normal', 8.0_wp)
   call time_block('sincos', 1.0_wp)
   call time_increments()
   call time_newton()
   call time_gradients()
   call time_triad()
   call time_fma()

contains

   !> A kernel of the generator or of sine and cosine; `items` of them a lane and call.
   subroutine time_block(name, items)
      character(*), intent(in) :: name
      real(wp), intent(in) :: items
      real(wp) :: times(repeats), start, w(nlane, 0:1, 0:7)
      integer(i8) :: repeat, call, words(philox_tile, 4, 0:1)
      logical :: tails

      call philox_two_lanes(nlane, 1_i8, path, 0_i8, 0_i8, 1, 0, 0, words)
      do repeat = 1, repeats
         start = seconds()
         do call = 1, ncall
            select case (name)
            case ('philox_word')
               call philox_two_lanes(nlane, 1_i8, path, 0_i8, call, 1, 0, 0, words)
            case ('box_muller_normal')
               call normal_pair_lanes(nlane, words(1, 1, 0), words(1, 2, 0), 1.0_wp, y, z, tails)
            case ('normal')
               call scaled_normal_steps(nlane, normal_stream(1_i8, 1), path, 4*call, 4, 1, w)
            case default  ! sincos
               call sincos_lanes(nlane, x, y, z)
            end select
         end do
         times(repeat) = (seconds() - start)*1e9_wp/(ncall*nlane*items)
      end do
      call print_times('block', name, times)
   end subroutine time_block

   !> The library's source of noise: eight increments a lane and call.
   subroutine time_increments()
      type(brownian_noise) :: noise
      type(error_type), allocatable :: error
      type(step_store) :: store
      type(step_request) :: request
      real(wp) :: times(repeats), start
      integer(i8) :: repeat, call, drawn

      call new_brownian_noise(noise, 1, 1_i8, 0.02_wp, 0, [.false.], error)
      call stop_on(error)
      call new_step_store(store, nlane, 1, 8, 0.02_wp, noise%asked)
      request = step_request(nlane, nlane, path, 0_i8, 4)
      do repeat = 1, repeats
         start = seconds()
         do call = 1, ncall
            request%pair = 4*call
            call noise%fill(request, store, drawn)
         end do
         times(repeat) = (seconds() - start)*1e9_wp/(ncall*nlane*8)
      end do
      call print_times('block', 'increment', times)
   end subroutine time_increments

   !> One Newton iteration for one unknown, without the evaluation of its equation.
   subroutine time_newton()
      type(newton_type) :: newton
      type(counters_type) :: counters
      real(wp) :: times(repeats), start
      integer(i8) :: repeat, call, status(nlane)

      call new_newton(newton, nlane, 1, newton_options(), .false., -1, -1)
      newton%r = 0.25_wp
      newton%a = 0.5_wp
      status = 0
      do repeat = 1, repeats
         start = seconds()
         do call = 1, ncall
            y = x
            call newton%start(status)
            call newton%update_scalar(1.0_wp, 0.005_wp, y, status, counters)
         end do
         times(repeat) = (seconds() - start)*1e9_wp/(ncall*nlane)
      end do
      call print_times('block', 'newton_iteration_of_one_unknown', times)
   end subroutine time_newton

   !> The gradient of every built-in model with its default parameters, ns per path.
   subroutine time_gradients()
      integer :: i

      associate (names => model_names())
         do i = 1, size(names)
            call time_gradient(trim(names(i)))
         end do
      end associate
   end subroutine time_gradients

   subroutine time_gradient(name)
      character(*), intent(in) :: name
      class(model_type), allocatable :: model
      type(error_type), allocatable :: error
      real(wp), allocatable :: q(:, :), p(:, :), hq(:, :), hp(:, :), w(:, :)
      real(wp) :: times(repeats), start
      integer(i8) :: repeat, call, calls

      call get_model(model, name, [character(1) ::], [real(wp) ::], error)
      call stop_on(error)
      associate (n => model%traits%ndof, m => model%traits%nnoise)
         allocate (q(nlane, n), p(nlane, n), hq(nlane, n), hp(nlane, n), source=0.1_wp)
         allocate (w(nlane, 0:m), source=0.01_wp)
         calls = max(1_i8, ncall/n)
         do repeat = 1, repeats
            start = seconds()
            do call = 1, calls
               call model%gradient(nlane, n, m, 0.0_wp, w, q, p, hq, hp)
            end do
            times(repeat) = (seconds() - start)*1e9_wp/(calls*nlane)
         end do
      end associate
      call print_times('block', 'gradient_of_'//name, times)
   end subroutine time_gradient

   !> a = b + s c over arrays far larger than the caches: 24 bytes an element are counted.
   subroutine time_triad()
      integer(i8), parameter :: n = 2_i8**23
      real(wp), allocatable :: a(:), b(:), c(:)
      real(wp) :: rates(repeats), start
      integer(i8) :: repeat

      allocate (a(n), source=0.0_wp)
      allocate (b(n), c(n), source=1.0_wp)
      do repeat = 1, repeats
         start = seconds()
         a = b + real(repeat, wp)*c
         rates(repeat) = 24e-9_wp*n/(seconds() - start)
      end do
      if (a(n) < 0) print '(a)', 'never'
      call print_times('machine', 'triad_GB_per_second', rates)
   end subroutine time_triad

   !> Multiply and add in registers: 64 independent chains, two operations each.
   subroutine time_fma()
      integer(i8), parameter :: n = 2000000
      real(wp) :: a(64), rates(repeats), start, factor, term
      integer(i8) :: repeat, i
      integer :: k

      factor = 1 - 1e-9_wp*repeats
      term = 1e-9_wp*repeats
      a = 1
      do repeat = 1, repeats
         start = seconds()
         do i = 1, n
            do k = 1, 64
               a(k) = a(k)*factor + term
            end do
         end do
         rates(repeat) = 128e-9_wp*n/(seconds() - start)
      end do
      if (sum(a) < 0) print '(a)', 'never'
      call print_times('machine', 'multiply_add_Gflop_per_second', rates)
   end subroutine time_fma

end program bench_blocks
