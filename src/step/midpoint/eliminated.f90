! SPDX-License-Identifier: BSD-3-Clause
!> The implicit midpoint rule without momenta for blocks of paths,
!>
!>    V + Hhat_q(base + (h/4) V) = 0,   base = q_n + (h p_n + g)/2,   dp = V,   dq = h (p_n + V/2) + g
!>
!> The derivation is in the body, eliminated.inc. This file chooses the part that solves the equation of V, and the
!> lanes of a block that are taken together.
!>
!> Matrices and products take all lanes of a block at once. A chain whose model gives its rows is taken strip by strip,
!> strip_lanes lanes through the whole step, since a strip of a long chain fits in the cache and a block does not. If
!> rows are eliminated, states are advanced directly (`move`) instead of by increments, while (q, p) of these lanes are
!> in cache.
!>
!> Order of a strip's step: its weights are copied (slice_lanes), V is found (solve_for_v), and then either its
!> increments (finish_increments) or its new states (move_together). Remaining lanes of a block that do not fill a strip
!> are filled up with copies (fill_up).
module symsde_step_midpoint_eliminated
   use symsde_base_damping, only: damping_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_lanes, only: lane_unit, slice_lanes
   use symsde_base_status, only: nonfinite
   use symsde_base_traits, only: strip_lanes
   use symsde_model_abstract, only: model_type
   use symsde_model_kernels, only: kernel_offers, offers_of, differences_alone
   use symsde_scheme_decays, only: tableau_decays, new_decays
   use symsde_scheme_scheme, only: correction_none
   use symsde_solve_newton, only: newton_options
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_implicit_newton_krylov, only: does_without_matrices
   use symsde_step_midpoint_dense, only: dense_midpoint
   use symsde_step_midpoint_equation, only: midpoint_equation, midpoint_part
   use symsde_step_midpoint_krylov, only: krylov_midpoint
   use symsde_step_midpoint_tridiagonal, only: tridiagonal_midpoint
   use symsde_step_midpoint_update, only: add_in_place, add_decayed_in_place
   use symsde_step_stepper, only: stepper_type, stepper_task, few_of
   implicit none
   private
   public :: midpoint_stepper, midpoint_fits, new_midpoint_stepper, midpoint_serves, choose_way
   public :: by_matrix, by_rows, by_products

   integer, parameter :: by_matrix = 1, by_rows = 2, by_products = 3  !! ways of solving
   integer, parameter :: unit = lane_unit    !! lanes of a vector
   integer(i8), parameter :: copy_rests = 1  !! status of copies that fill up a strip: any code but 0

   !> The stepper: the equation of the lanes that are taken together, the part that solves it, and arrays for a strip if
   !> a block is taken strip by strip.
   type, extends(stepper_type) :: midpoint_stepper
      private
      class(midpoint_part), allocatable :: part
      type(midpoint_equation) :: eq            !! equation of the lanes that step together
      logical :: has_shift = .false.           !! whether additive noise moves the positions: g /= 0
      logical :: damped = .false.
      type(tableau_decays) :: decays           !! factors of momenta: one without damping, and `loss` zero
      real(wp), allocatable :: extent(:)       !! the largest |q| and |p| in a lane, if states are moved (eq%nlane)
      real(wp), allocatable :: shift(:, :)     !! g (eq%nlane, ndof)
      real(wp), allocatable :: w(:, :)         !! w of these lanes, if not all step together (eq%nlane, 0:nnoise)
      real(wp), allocatable, dimension(:, :) :: q, p, dq, dp  !! copies of some lanes (eq%nlane, ndof)
   contains
      procedure :: make
      procedure :: increment
      procedure :: move
   end type midpoint_stepper

contains

   include 'eliminated.inc'
   include '../../solve/all_lanes.inc'

   !> Whether this stepper executes the task: the plain midpoint rule without brackets or correction, for H = p.p/2 +
   !> U(q) with noise in position or additive.
   logical function midpoint_fits(task) result(fits)
      type(stepper_task), intent(in) :: task

      fits = task%is_plain() .and. task%scheme%is_midpoint() .and. midpoint_serves(task%model, task%newton)
   end function midpoint_fits

   !> Whether momenta are eliminated and the remaining equations are solved by matrices or rows. Models solved by
   !> products are left to step/stages/stepper, which iterates first.
   pure logical function midpoint_serves(model, options)
      class(model_type), intent(in) :: model
      type(newton_options), intent(in) :: options

      midpoint_serves = model%traits%eliminates_momenta() .and. choose_way(model, options) /= by_products
   end function midpoint_serves

   !> How to solve the systems (I + (h/4) K) d = r of a model: by rows if K is tridiagonal, by products if it is dense
   !> and large, else by matrices. Rows need second derivatives of the model: if these are differences of gradients,
   !> step/midpoint/dense sweeps before it forms any. Shortened corrections and a given number of iterations need
   !> matrices.
   pure integer function choose_way(model, options) result(way)
      class(model_type), intent(in) :: model
      type(newton_options), intent(in) :: options

      way = by_matrix
      if (.not. options%is_free()) return
      associate (t => model%traits)
         ! Two unknowns have a matrix in closed form, so rows pay from three unknowns on.
         if (t%bandwidth == 1 .and. t%ndof > 2 .and. .not. differences_alone(model)) then
            way = by_rows
         else if (does_without_matrices(t, t%ndof, options)) then
            way = by_products
         end if
      end associate
   end function choose_way

   !> Allocate copies of the states and weights of a strip, if states are moved or the last strip of a block is not
   !> full. Done in the first step, as for the arrays of the equation.
   subroutine make_room_of_strips(self)
      type(midpoint_stepper), intent(inout) :: self

      associate (nlane => self%ham%nlane, together => self%eq%nlane, n => self%eq%n)
         if (self%moves) allocate (self%extent(together))
         if (self%moves .or. modulo(nlane, together) /= 0) &
            allocate (self%q(together, n), self%p(together, n), self%dq(together, n), self%dp(together, n))
         if (together /= nlane) allocate (self%w(together, 0:self%eq%m))
      end associate
   end subroutine make_room_of_strips

   !> Increments of all lanes, strip by strip if strips are taken together. eq%nreal is the number of real paths in a
   !> strip, for the counters.
   subroutine increment(self, step, q, p, dq, dp, status)
      class(midpoint_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      integer :: before

      if (.not. allocated(self%eq%x)) call make_room_of_strips(self)
      call begin(self, step)
      associate (nlane => self%ham%nlane, together => self%eq%nlane)
         if (together == nlane) then
            ! Matrices and products: one group of lanes, the block itself.
            self%eq%nreal = self%ham%nreal
            call step_together(self, nlane, 0, step%w, q, p, dq, dp, status)
            return
         end if
         ! Whole strips first. Weights of a strip are copied, since the model reads them as one array; states are read
         ! in place.
         do before = 0, nlane - together, together
            self%eq%nreal = max(0, min(together, self%ham%nreal - before))
            call slice_lanes(nlane, self%ham%nnoise + 1, before, together, step%w, self%w)
            call self%ham%narrow(before + 1, together)
            call step_together(self, nlane, before, self%w, q, p, dq, dp, status(before + 1))
            call self%ham%widen()
         end do
         ! After the loop `before` is the number of lanes in whole strips.
         if (before < nlane) call fill_up(self, before, step%w, q, p, dq, dp, status)
      end associate
   end subroutine increment

   !> Update (q, p) strip by strip, in cache: the sums that the caller would form from increments are formed here, with
   !> the same bits (step/midpoint/update). Only blocks of whole strips move states, so that no lanes remain behind the
   !> last strip.
   subroutine move(self, step, q, p, status)
      class(midpoint_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(inout) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      integer :: before

      if (.not. allocated(self%eq%x)) call make_room_of_strips(self)
      call begin(self, step)
      associate (nlane => self%ham%nlane, together => self%eq%nlane)
         do before = 0, nlane - together, together
            self%eq%nreal = max(0, min(together, self%ham%nreal - before))
            if (together == nlane) then
               ! The only strip is the block itself, whose weights need no copy.
               call move_together(self, nlane, before, step%w, q, p, status)
            else
               call slice_lanes(nlane, self%ham%nnoise + 1, before, together, step%w, self%w)
               call self%ham%narrow(before + 1, together)
               call move_together(self, nlane, before, self%w, q, p, status(before + 1))
               call self%ham%widen()
            end if
         end do
      end associate
   end subroutine move

   !> Take the last lanes of a block, too few for a strip. The strip is filled up with copies of the last lane, which
   !> get a status so that every iteration skips them.
   subroutine fill_up(self, before, w, q, p, dq, dp, status)
      class(midpoint_stepper), intent(inout) :: self
      integer, intent(in) :: before   !! number of lanes done before
      real(wp), intent(in) :: w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(inout) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      integer(i8) :: lane_status(self%eq%nlane)
      integer :: lane, last

      associate (left => self%ham%nlane - before, together => self%eq%nlane)
         do lane = 1, together
            last = before + min(lane, left)
            self%w(lane, :) = w(last, :)
            self%q(lane, :) = q(last, :)
            self%p(lane, :) = p(last, :)
         end do
         ! Lanes of the block keep their status; the copies have the status copy_rests, so that they are neither solved
         ! nor counted.
         lane_status = copy_rests
         lane_status(:left) = status(before + 1:)
         self%eq%nreal = max(0, min(left, self%ham%nreal - before))
         call self%ham%narrow(before + 1, together)
         call step_together(self, together, 0, self%w, self%q, self%p, self%dq, self%dp, lane_status)
         call self%ham%widen()
         dq(before + 1:, :) = self%dq(:left, :)
         dp(before + 1:, :) = self%dp(:left, :)
         status(before + 1:) = lane_status(:left)
      end associate
   end subroutine fill_up

   !> One step of a strip: (q, p) of lanes without a status become the new state. A lane whose new state is not
   !> finite gets a status and keeps the old state.
   subroutine move_together(self, nlane, before, w, q, p, status)
      class(midpoint_stepper), intent(inout) :: self
      integer, intent(in) :: nlane, before
      real(wp), intent(in) :: w(self%eq%nlane, 0:self%eq%m)
      real(wp), intent(inout) :: q(nlane, self%eq%n), p(nlane, self%eq%n)
      integer(i8), intent(inout) :: status(self%eq%nlane)
      real(wp) :: gain  !! the largest factor of a momentum, one or more
      integer :: i

      call solve_for_v(self, nlane, before, w, q, p, status)
      gain = 1
      if (self%damped) gain = max(gain, maxval(self%decays%begin), maxval(self%decays%finish), maxval(self%decays%loss))
      associate (eq => self%eq, n => self%eq%n, together => self%eq%nlane, first => before + 1, &
                 last => before + self%eq%nlane)
         ! |q + h (p + V/2)| and |p + V| are at most (extent + |V|) (1 + |h|), with extent the largest of |q| and |p|.
         ! If this bound is near overflow, or a lane needs dq as its unknown, increments of the whole strip are formed
         ! in copies, and their sums tested. Conditions are negated, so that NaN leads to this test, too. base and x are
         ! free afterwards and receive the new states.
         if (eq%noncontracting .or. &
             .not. maxval(self%extent + self%part%newton%size)*(1 + abs(eq%h))*gain <= 0.1_wp*huge(eq%h)) then
            ! Copy the old states, since (q, p) of the block are overwritten below, lane by lane.
            self%q = q(first:last, :)
            self%p = p(first:last, :)
            call finish_increments(self, together, 0, w, self%q, self%p, self%dq, self%dp, status)
            eq%base(:, 1:n) = self%q + self%dq
            eq%x = self%p + self%dp
            where (status == 0 .and. .not. (all(abs(eq%base(:, 1:n)) <= huge(q), 2) .and. &
                                            all(abs(eq%x) <= huge(p), 2))) status = nonfinite
            do i = 1, n
               q(first:last, i) = merge(eq%base(:, i), q(first:last, i), status == 0)
               p(first:last, i) = merge(eq%x(:, i), p(first:last, i), status == 0)
            end do
         else if (self%damped) then
            call add_decayed_in_place(nlane, n, before, together, eq%h, self%decays%begin, self%decays%loss, &
                                      self%decays%finish, eq%x, status, q, p)
         else
            call add_in_place(nlane, n, before, together, eq%h, eq%x, status, q, p)
         end if
      end associate
   end subroutine move_together

end module symsde_step_midpoint_eliminated
