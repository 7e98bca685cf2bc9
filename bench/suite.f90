! SPDX-License-Identifier: BSD-3-Clause
!> Scenes of the library beside hand-fused programs of the same scheme, generator and arithmetic.
!>
!> bench_suite [REPEATS [SCALE [SCENE [LANES]]]]: both run in turn, REPEATS times; SCALE percent of the
!> usual steps; one scene instead of all; LANES a block in the library instead of its own choice.
!> One thread, processor time, so that other work on the machine disturbs little.
!> Lines: scene NAME, then ns per path-step of the library (median, least, largest), of the limit
!> program (the same), the median of the ratios, and the largest difference of the final states.
program bench_suite
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_ensemble_run_simulate, only: paths_type
   use bench_limit_additive_euler, only: limit_additive_euler
   use bench_limit_fpu_chain, only: limit_fpu_chain
   use bench_limit_gauss2, only: limit_gauss2
   use bench_limit_kubo, only: limit_kubo
   use bench_limit_single_path, only: limit_single_path
   use bench_limit_single_path_synchrotron, only: limit_single_path_synchrotron
   use bench_limit_synchrotron, only: limit_synchrotron
   use bench_limit_synchrotron_fused, only: limit_synchrotron_fused
   use bench_support, only: median, scene_type, new_scene, run_paths, integer_argument
   implicit none
   integer(i8) :: npath
   integer(i4), parameter :: nsite = 64
   real(wp), parameter :: h = 0.02_wp
   integer(i8) :: repeats, scale

   repeats = integer_argument(1, 7_i8)
   scale = integer_argument(2, 100_i8)
   npath = 2048
   call compare('kubo_midpoint', 60000_i8)
   call compare('synchrotron_midpoint', 8000_i8)
   call compare('synchrotron_midpoint_fused', 8000_i8)
   call compare('additive_euler', 30000_i8)
   call compare('synchrotron_gauss2', 3000_i8)
   call compare('fpu64_midpoint', 200_i8)
   npath = 1
   call compare('kubo_single_path', 4000000_i8)
   call compare('synchrotron_single_path', 1000000_i8)

contains

   !> Time both in turn and print the line of a scene.
   subroutine compare(name, usual)
      character(*), intent(in) :: name
      integer(i8), intent(in) :: usual  !! steps
      type(scene_type) :: scene
      type(paths_type) :: run
      real(wp), allocatable :: q(:), p(:)
      real(wp) :: ours(repeats), limit(repeats), start, end, unit, difference
      integer(i8) :: nstep, repeat
      character(len=64) :: only

      call get_command_argument(3, only)
      if (only /= '' .and. only /= name) return
      call choose(name, scene)
      scene%options%nlane = int(integer_argument(4, 0_i8))
      nstep = max(8_i8, usual*scale/800*8)
      unit = 1e9_wp/(real(npath, wp)*real(nstep, wp))
      allocate (q(npath*size(scene%q0)), p(npath*size(scene%q0)))
      call run_paths(scene, npath, 2_i8, 0_i8, run)
      do repeat = 1, repeats
         call cpu_time(start)
         call run_paths(scene, npath, nstep, 0_i8, run)
         call cpu_time(end)
         ours(repeat) = unit*(end - start)
         call cpu_time(start)
         call run_limit(name, nstep, scene%q0, q, p)
         call cpu_time(end)
         limit(repeat) = unit*(end - start)
      end do
      difference = largest_difference(name, run%last_q, q)
      print '(a, 1x, a, 8(1x, es12.5))', 'scene', name, median(ours), minval(ours), maxval(ours), &
         median(limit), minval(limit), maxval(limit), median(ours/limit), difference
   end subroutine compare

   !> The scene of a name, in the library.
   subroutine choose(name, scene)
      character(*), intent(in) :: name
      type(scene_type), intent(out) :: scene
      real(wp), parameter :: pi = acos(-1.0_wp)
      integer :: i

      select case (name)
      case ('kubo_midpoint', 'kubo_single_path')
         call new_scene(scene, 'kubo', ['a    ', 'sigma'], [1.0_wp, 0.3_wp], 'midpoint', h)
      case ('synchrotron_midpoint', 'synchrotron_midpoint_fused', 'synchrotron_single_path')
         call new_scene(scene, 'synchrotron', ['omega '], [2.0_wp], 'midpoint', h)
      case ('synchrotron_gauss2')
         call new_scene(scene, 'synchrotron', ['omega '], [2.0_wp], 'gauss2', h)
      case ('additive_euler')
         call new_scene(scene, 'additive_oscillator', ['sigma', 'gamma'], [1.0_wp, 1.0_wp], &
                        'symplectic_euler', h)
      case default  ! fpu64_midpoint
         call new_scene(scene, 'fpu_chain', ['n    ', 'beta ', 'sigma'], &
                        [real(nsite, wp), 1.0_wp, 0.1_wp], 'midpoint', h)
         scene%q0 = [(sin(i*pi/(nsite + 1)), i=1, nsite)]
      end select
   end subroutine choose

   !> The hand-fused program of a name.
   subroutine run_limit(name, nstep, q0, q, p)
      character(*), intent(in) :: name
      integer(i8), intent(in) :: nstep
      real(wp), intent(in) :: q0(:)
      real(wp), intent(out) :: q(:), p(:)

      select case (name)
      case ('kubo_midpoint')
         call limit_kubo(npath, nstep, 1_i8, h, 1.0_wp, 0.3_wp, q, p)
      case ('kubo_single_path')
         call limit_single_path(nstep, h, 1.0_wp, 0.3_wp, q(1), p(1))
      case ('synchrotron_single_path')
         call limit_single_path_synchrotron(nstep, h, 2.0_wp, 0.2_wp, 0.1_wp, q(1), p(1))
      case ('synchrotron_midpoint')
         call limit_synchrotron(npath, nstep, 1_i8, h, 2.0_wp, 0.2_wp, 0.1_wp, q, p)
      case ('synchrotron_midpoint_fused')
         call limit_synchrotron_fused(npath, nstep, 1_i8, h, 2.0_wp, 0.2_wp, 0.1_wp, q, p)
      case ('synchrotron_gauss2')
         call limit_gauss2(npath, nstep, 1_i8, h, 2.0_wp, 0.2_wp, 0.1_wp, q, p)
      case ('additive_euler')
         call limit_additive_euler(npath, nstep, 1_i8, h, 1.0_wp, 1.0_wp, q, p)
      case default  ! fpu64_midpoint
         call limit_fpu_chain(npath, nstep, nsite, 1_i8, h, 1.0_wp, 0.1_wp, q0, q, p)
      end select
   end subroutine run_limit

   !> Largest difference of the final positions; the limit programs keep them block by block.
   pure real(wp) function largest_difference(name, ours, limit)
      character(*), intent(in) :: name
      real(wp), intent(in) :: ours(:, :), limit(:)
      integer, parameter :: nlane = 32
      integer :: block, n, first, last

      if (name /= 'fpu64_midpoint') then
         largest_difference = maxval(abs(ours(:, 1) - limit))
         return
      end if
      n = size(ours, 2)
      largest_difference = 0
      do block = 1, size(ours, 1)/nlane
         first = (block - 1)*nlane + 1
         last = block*nlane
         associate (theirs => reshape(limit((first - 1)*n + 1:last*n), [nlane, n]))
            largest_difference = max(largest_difference, maxval(abs(ours(first:last, :) - theirs)))
         end associate
      end do
   end function largest_difference

end program bench_suite
