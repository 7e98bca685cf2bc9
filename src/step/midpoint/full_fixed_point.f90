! SPDX-License-Identifier: BSD-3-Clause
!> Mild steps of the midpoint rule for any model: both increments by fixed-point iteration, without matrices,
!>
!>    dq = Hhat_p(q + dq/2, p + dp/2),  dp = -Hhat_q(q + dq/2, p + dp/2)
!>
!> from none, by the test of step/stages/fixed_point. Lanes are taken in parts that stay in cache.
!>
!> Private to its family.
module symsde_step_midpoint_full_fixed_point
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lane_unit
   use symsde_step_midpoint_equation, only: position
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   use symsde_solve_fixed_point, only: take, judge_sweep, most_sweeps, stiff_rate, done
   implicit none
   private
   public :: midpoint_fixed_point, new_midpoint_fixed_point

   integer, parameter :: cached_values = 1024  !! of one array of a part

   type :: midpoint_fixed_point
      integer :: width = 0                               !! lanes of a part
      integer, private :: n = 0, m = 0
      real(wp), allocatable, dimension(:, :), private :: w                     !! (width, 0:nnoise)
      real(wp), allocatable, dimension(:, :), private :: q, p, x, y, f, v, dq, dp  !! (width, ndof)
      real(wp), allocatable, dimension(:), private :: last, change, extent     !! (width)
   contains
      procedure :: attempt
   end type midpoint_fixed_point

contains

   !> Room for parts of nlane lanes.
   subroutine new_midpoint_fixed_point(self, nlane, ndof, nnoise)
      type(midpoint_fixed_point), intent(out) :: self
      integer, intent(in) :: nlane, ndof, nnoise

      self%n = ndof
      self%m = nnoise
      self%width = nlane
      do while (mod(nlane, self%width) /= 0 .or. (self%width*ndof > cached_values .and. self%width > lane_unit))
         self%width = self%width - lane_unit
      end do
      associate (width => self%width)
         allocate (self%w(width, 0:nnoise), self%last(width), self%change(width), self%extent(width))
         allocate (self%q(width, ndof), self%p(width, ndof), self%x(width, ndof), self%y(width, ndof))
         allocate (self%f(width, ndof), self%v(width, ndof), self%dq(width, ndof), self%dp(width, ndof))
      end associate
   end subroutine new_midpoint_fixed_point

   !> Increments of the lanes without a status where sweeps converge fast; in the others left = 0, else -1.
   subroutine attempt(self, ham, t, w, q, p, dq, dp, status, left)
      class(midpoint_fixed_point), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham   !! model and counters
      real(wp), intent(in) :: t
      real(wp), intent(in) :: w(ham%nlane, 0:self%m), q(ham%nlane, self%n), p(ham%nlane, self%n)
      real(wp), intent(out) :: dq(ham%nlane, self%n), dp(ham%nlane, self%n)
      integer(i8), intent(in) :: status(ham%nlane)
      integer(i8), intent(out) :: left(ham%nlane)
      integer :: before

      do before = 0, ham%nlane - self%width, self%width
         associate (last => before + self%width, width => self%width)
            self%w = w(before + 1:last, :)
            self%q = q(before + 1:last, :)
            self%p = p(before + 1:last, :)
            call sweep_part(self, ham, t, max(0, min(width, ham%nreal - before)), status(before + 1:last))
            dq(before + 1:last, :) = self%dq
            dp(before + 1:last, :) = self%dp
            left(before + 1:last) = merge(0_i8, -1_i8, status(before + 1:last) == 0 .and. &
                                          .not. abs(self%last - done) <= 0)
         end associate
      end do
   end subroutine attempt

   !> Sweeps until every lane of a part is done or has been given up; what becomes of it stands in last.
   subroutine sweep_part(self, ham, t, nreal, status)
      type(midpoint_fixed_point), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      real(wp), intent(in) :: t
      integer, intent(in) :: nreal
      integer(i8), intent(in) :: status(self%width)
      integer :: sweep, nrunning

      self%last = merge(0.0_wp, done, status == 0)
      nrunning = count(status == 0)
      self%dq = 0
      self%dp = 0
      associate (nlane => self%width, n => self%n, counters => ham%counters, last => self%last)
         do sweep = 1, most_sweeps
            if (nrunning == 0) exit
            call position(nlane*n, 0.5_wp, self%q, self%dq, self%x)
            call position(nlane*n, 0.5_wp, self%p, self%dp, self%y)
            call ham%model%gradient(nlane, n, self%m, t, self%w, self%x, self%y, hq=self%f, hp=self%v)
            self%change = 0
            self%extent = 0
            call take(nlane, n, -1.0_wp, self%f, last, self%dp, self%change, self%extent)
            call take(nlane, n, 1.0_wp, self%v, last, self%dq, self%change, self%extent)
            counters%gradients = counters%gradients + nreal
            counters%iterations = counters%iterations + nrunning
            call judge_sweep(nlane, sweep, stiff_rate, stiff_rate, self%change, self%extent, last, nrunning)
         end do
      end associate
   end subroutine sweep_part

end module symsde_step_midpoint_full_fixed_point
