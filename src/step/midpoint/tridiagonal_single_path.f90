! SPDX-License-Identifier: BSD-3-Clause
!> The eliminated midpoint of a chain for a single path: (I + (h/4) K) d = x + f, x <- x - d, as in
!> step/midpoint/tridiagonal. K = Hhat_qq is tridiagonal and symmetric: the diagonal and one band are stored.
!>
!> In strips of lanes each row waits for the row before; here the rows of both ends are eliminated in turn (solve_lane),
!> in half the time, because one front continues while the other waits for its pivot.
!>
!> Force and stiffness of all rows are evaluated at once and kept, which takes little memory for one path. So the few
!> systems whose pivots are not trusted are solved with exchanges of rows without a second evaluation.
!>
!> Private to its family.
module symsde_step_midpoint_tridiagonal_single_path
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: status_ok
   use symsde_base_vectors, only: add_times
   use symsde_model_abstract, only: model_type
   use symsde_model_kernels, only: has_exact_stiffness
   use symsde_solve_one_system, only: solve_banded_lane
   use symsde_solve_newton, only: newton_options, new_newton
   use symsde_solve_newton_single_path, only: start, judge
   use symsde_solve_tridiagonal, only: solve_lane
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   use symsde_step_midpoint_equation, only: midpoint_equation, midpoint_part, position
   implicit none
   private
   public :: tridiagonal_midpoint

   type, extends(midpoint_part) :: tridiagonal_midpoint
      private
      real(wp), allocatable, dimension(:) :: q, f, before, factor, rhs  !! Q, f, x before its correction, work (n)
      real(wp), allocatable :: k(:, :)                                  !! Hhat_qq, row 0 is not read (0:1, 0:n)
   contains
      procedure :: make
      procedure :: solve
   end type tridiagonal_midpoint

contains

   !> Make the part for one lane and a chain of ndof rows.
   subroutine make(self, model, nlane, options)
      class(tridiagonal_midpoint), intent(inout) :: self
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane
      type(newton_options), intent(in) :: options

      associate (t => model%traits, n => model%traits%ndof, &
                 exact => has_exact_stiffness(model))
         call new_newton(self%newton, 1, n, options, t%quadratic .and. exact, -1, -1, judge_only=.true., exact=exact)
         allocate (self%q(n), self%f(n), self%before(n), self%factor(n), self%rhs(n), self%k(0:1, 0:n))
      end associate
   end subroutine make

   !> Find x of the path, from V = 0 or from the dq of V. An iteration is one call of the model, one elimination
   !> that also corrects x, and one test.
   subroutine solve(self, ham, eq, w, status)
      class(tridiagonal_midpoint), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(inout) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
      integer(i8), intent(inout) :: status(eq%nlane)
      real(wp) :: trusted, largest

      associate (n => eq%n, c => 0.25_wp*eq%h, newton => self%newton)
         ! The iteration for V starts from zero. The iteration for dq starts from the dq of V, with base = q_n and c =
         ! 1/2.
         if (.not. eq%for_dq) eq%x = 0
         call start(newton, status)
         do while (newton%running)
            ! In the first iteration for V the factor of x is zero, so that the point is base.
            call position(n, merge(0.0_wp, eq%c, eq%starts(newton)), eq%base(1, 1), eq%x, self%q)
            call ham%bare_force_stiffness(1, 1, eq%t, w, self%q, eq%still, self%f, self%k(0, 1))
            call eq%weigh(1, n, self%f)
            self%before = eq%x(1, :)
            call solve_lane(n, c, self%f, self%k, self%factor, self%rhs, eq%x, trusted, largest, newton%step(1), &
                            newton%size(1))
            ! `largest` is the largest diagonal entry of I + (h/4) K, as for strips.
            if (eq%starts(newton)) then
               eq%rate = largest - 1
               eq%noncontracting = largest - 1 > 1
            end if
            ! If a pivot is not trusted, undo the correction and solve with exchanges of rows.
            if (trusted <= 0) call solve_suspect(self, ham, eq, status)
            ham%counters%gradients = ham%counters%gradients + 1
            ham%counters%hessians = ham%counters%hessians + 1
            call judge(newton, status, ham%counters)
         end do
      end associate
   end subroutine solve

   !> Solve (I + c K) d = x + f with exchanges of rows, if pivots are not trusted: x before its correction was kept, and
   !> the correction of solve_lane is replaced.
   subroutine solve_suspect(self, ham, eq, status)
      type(tridiagonal_midpoint), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(inout) :: eq
      integer(i8), intent(inout) :: status(1)
      real(wp) :: bands(1, -1:1, eq%n), r(1, eq%n)
      integer(i4) :: info

      associate (n => eq%n, c => 0.25_wp*eq%h, newton => self%newton)
         r(1, :) = self%f
         call add_times(n, 1.0_wp, self%before, r)
         ! bands(1, d, i) is entry (i, i+d) of I + c K; K is symmetric, so the lower band is the upper one, shifted by a
         ! row.
         bands(1, 0, :) = 1 + c*self%k(0, 1:)
         bands(1, 1, :) = c*self%k(1, 1:)
         bands(1, -1, 2:) = bands(1, 1, :n - 1)
         bands(1, -1, 1) = 0
         call solve_banded_lane(1, n, 1, 1, 1, bands, r, info)
         ham%counters%pivoted_solves = ham%counters%pivoted_solves + 1
         if (info /= status_ok) then
            ! The path has failed and keeps its x.
            r = 0
            call newton%fail(1, int(info, i8), status, ham%counters)
         end if
         eq%x(1, :) = self%before - r(1, :)
         newton%step(1) = maxval(abs(r)) + 0*sum(r)  ! NaN stays NaN
         newton%size(1) = maxval(abs(eq%x))
      end associate
   end subroutine solve_suspect

end module symsde_step_midpoint_tridiagonal_single_path
