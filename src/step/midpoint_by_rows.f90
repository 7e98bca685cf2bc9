! SPDX-License-Identifier: BSD-3-Clause
!> The eliminated midpoint for chains: the matrix I + (h/4) Hhat_qq is symmetric and tridiagonal.
!>
!> Lanes are eliminated in strips whose number the compiler knows, so that what a row hands to the next one
!> stays in registers. Where the model gives its rows (chain_rows), a strip takes the whole step alone, in arrays
!> that stay in the nearest caches, 640 bytes a row, and the rows are eliminated a panel at a time, as they come:
!> neither force nor matrix is ever stored as a whole. Other models are asked for the bands of all lanes of a
!> block at once, which their calls are better shared by, and are then eliminated in the same strips.
module symsde_step_midpoint_by_rows
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: status_ok
   use symsde_base_traits, only: strip_lanes
   use symsde_model_abstract, only: model_type
   use symsde_solve_lapack, only: solve_banded_lane_lapack
   use symsde_solve_newton, only: newton_options, new_newton
   use symsde_solve_tridiagonal, only: eliminate_down_strip, correct_up_strip, before_first_row, nabove
   use symsde_step_midpoint_equation, only: midpoint_equation, midpoint_part, position, add_unknown
   use symsde_step_one_step_hamiltonian, only: one_step_hamiltonian
   implicit none
   private
   public :: midpoint_by_rows, new_midpoint_by_rows

   integer, parameter :: panel = 16  !! rows asked of the model at once

   type, extends(midpoint_part) :: midpoint_by_rows
      private
      logical :: gives_rows = .false.
      integer :: nrow = 0                             !! rows evaluated at once: a panel, or all
      real(wp), allocatable :: q(:, :)                !! Q of these and of the rows before and behind (nlane, nrow+2)
      real(wp), allocatable :: hq(:, :), hqq(:, :, :) !! force and stiffness (nlane, nrow), (nlane, 0:1, nrow)
      real(wp), allocatable :: rows(:, :, :, :)       !! eliminated (strip_lanes, 2, ndof, nstrip)
      real(wp), allocatable :: above(:, :, :)         !! of the row before (strip_lanes, nabove, nstrip)
   contains
      procedure :: iterate
   end type midpoint_by_rows

contains

   !> Room for nlane lanes, a multiple of strip_lanes; strip_lanes where the model gives its rows.
   subroutine new_midpoint_by_rows(self, model, nlane, options)
      type(midpoint_by_rows), intent(out) :: self
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane
      type(newton_options), intent(in) :: options
      integer :: nstrip

      associate (t => model%traits, n => model%traits%ndof)
         self%gives_rows = t%has_chain_rows
         self%nrow = merge(min(panel, n), n, t%has_chain_rows)
         associate (exact => t%has_chain_rows .or. t%has_hessian_vector)
            call new_newton(self%newton, nlane, n, options, t%quadratic .and. exact, -1, -1, judge_only=.true., &
                            exact=exact)
         end associate
         nstrip = nlane/strip_lanes
         allocate (self%q(nlane, self%nrow + 2), self%hq(nlane, self%nrow), self%hqq(nlane, 0:1, self%nrow))
         allocate (self%rows(strip_lanes, 2, n, nstrip), self%above(strip_lanes, nabove, nstrip))
      end associate
   end subroutine new_midpoint_by_rows

   subroutine iterate(self, ham, eq, w, status)
      class(midpoint_by_rows), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(inout) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
      integer(i8), intent(inout) :: status(eq%nlane)
      integer :: strip, lane
      logical :: suspect

      suspect = .false.
      associate (newton => self%newton, n => eq%n, above => self%above, c => ham%counters)
         call eliminate(self, ham%model, eq, w)
         c%gradients = c%gradients + eq%nreal
         c%hessians = c%hessians + eq%nreal
         do strip = 1, size(above, 3)
            lane = (strip - 1)*strip_lanes + 1
            if (eq%starts(newton)) call note_steepness(above(1, 5, strip), eq%steep, eq%steepness(lane))
            suspect = suspect .or. has_suspects(above(1, 4, strip), newton%last(lane))
         end do
         if (suspect) call solve_suspects(self, ham, eq, w, status)
         do strip = 1, size(above, 3)
            call correct_up_strip(eq%nlane, (strip - 1)*strip_lanes, n, self%rows(1, 1, 1, strip), newton%last, &
                                  eq%x, newton%step, newton%size)
         end do
         call newton%judge(status, c)
      end associate
   end subroutine iterate

   !> Residual and matrix, some rows at a time, eliminated as they come.
   subroutine eliminate(self, model, eq, w)
      type(midpoint_by_rows), intent(inout) :: self
      class(model_type), intent(in) :: model
      type(midpoint_equation), intent(in) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
      integer :: first, last, strip

      do strip = 1, size(self%above, 3)
         self%above(:, :, strip) = before_first_row
      end do
      do first = 1, eq%n, self%nrow
         last = min(first + self%nrow - 1, eq%n)
         if (eq%starts(self%newton)) then
            call evaluate(model, self%gives_rows, eq, w, first, last, eq%base(1, first - 1), self%hq, self%hqq)
         else
            call place(eq, first, last, self%q)
            call evaluate(model, self%gives_rows, eq, w, first, last, self%q, self%hq, self%hqq)
         end if
         call eq%weigh(first, last, self%hq)
         do strip = 1, size(self%above, 3)
            call eliminate_down_strip(eq%nlane, (strip - 1)*strip_lanes, last - first + 1, 0.25_wp*eq%h, &
                                      eq%x(1, first), self%hq, self%hqq, self%above(1, 1, strip), &
                                      self%rows(1, 1, first, strip))
         end do
      end do
   end subroutine eliminate

   !> Q in rows first-1 .. last+1
   pure subroutine place(eq, first, last, q)
      type(midpoint_equation), intent(in) :: eq
      integer, intent(in) :: first, last
      real(wp), intent(inout) :: q(eq%nlane, first - 1:last + 1)
      integer :: low, high

      low = max(first - 1, 1)
      high = min(last + 1, eq%n)
      call position((high - low + 1)*eq%nlane, eq%c, eq%base(1, low), eq%x(1, low), q(1, low))
      if (first == 1) q(:, 0) = 0
      if (last == eq%n) q(:, eq%n + 1) = 0
   end subroutine place

   !> Force and stiffness in rows first .. last; behind the last row of all there is none.
   subroutine evaluate(model, gives_rows, eq, w, first, last, q, hq, hqq)
      class(model_type), intent(in) :: model
      logical, intent(in) :: gives_rows
      type(midpoint_equation), intent(in) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
      integer, intent(in) :: first, last
      real(wp), intent(in) :: q(eq%nlane, first - 1:last + 1)
      real(wp), intent(inout) :: hq(eq%nlane, first:last), hqq(eq%nlane, 0:1, first:last)

      if (gives_rows) then
         call model%chain_rows(eq%n, eq%m, first, last, eq%t, w, q, hq, hqq)
      else
         call model%force_stiffness(eq%nlane, eq%n, eq%m, 1, eq%t, w, q(:, 1:eq%n), eq%still, hq, hqq)
      end if
      if (last == eq%n) hqq(:, 1, last) = 0
   end subroutine evaluate

   !> Running lanes whose pivots are not trusted are solved by LAPACK from their matrix, computed once more:
   !> their right-hand sides become the solution and their factors those of the identity.
   subroutine solve_suspects(self, ham, eq, w, status)
      type(midpoint_by_rows), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(midpoint_equation), intent(in) :: eq
      real(wp), intent(in) :: w(eq%nlane, 0:eq%m)
      integer(i8), intent(inout) :: status(eq%nlane)
      real(wp), allocatable :: q(:, :), r(:, :), hqq(:, :, :), bands(:, :, :)
      integer(i4) :: info
      integer :: lane, strip, i

      associate (nlane => eq%nlane, n => eq%n, c => 0.25_wp*eq%h, newton => self%newton)
         allocate (q(nlane, 0:n + 1), r(nlane, n), hqq(nlane, 0:1, n), bands(nlane, -1:1, n))
         call place(eq, 1, n, q)
         call evaluate(ham%model, self%gives_rows, eq, w, 1, n, q, r, hqq)
         call eq%weigh(1, n, r)
         call add_unknown(nlane*n, eq%x, r)
         bands(:, 0, :) = 1 + c*hqq(:, 0, :)
         bands(:, 1, :) = c*hqq(:, 1, :)
         bands(:, -1, 2:) = bands(:, 1, :n - 1)
         bands(:, -1, 1) = 0
         do lane = 1, nlane
            strip = 1 + (lane - 1)/strip_lanes
            i = lane - (strip - 1)*strip_lanes
            if (self%above(i, 4, strip) > 0 .or. .not. newton%last(lane) >= 0) cycle
            call solve_banded_lane_lapack(nlane, n, 1, 1, lane, bands, r, info)
            ham%counters%lapack_solves = ham%counters%lapack_solves + 1
            self%rows(i, 1, :, strip) = 0
            self%rows(i, 2, :, strip) = r(lane, :)
            if (info == status_ok) cycle
            self%rows(i, 2, :, strip) = 0
            call newton%fail(lane, int(info, i8), status, ham%counters)
         end do
      end associate
   end subroutine solve_suspects

   ! ---- kernels ----------------------------------------------------------------------------------

   !> The steepness of a strip, from the largest diagonal entries of its matrices.
   pure subroutine note_steepness(largest, steep, steepness)
      real(wp), intent(in) :: largest(strip_lanes)
      logical, intent(inout) :: steep
      real(wp), intent(out) :: steepness(strip_lanes)

      steepness = largest - 1
      steep = steep .or. any(steepness > 1)
   end subroutine note_steepness

   !> Whether some running lane of a strip is not trusted.
   pure logical function has_suspects(trusted, last)
      real(wp), intent(in) :: trusted(strip_lanes), last(strip_lanes)

      has_suspects = any(trusted <= 0 .and. last >= 0)
   end function has_suspects

end module symsde_step_midpoint_by_rows
