! SPDX-License-Identifier: BSD-3-Clause
!> The iterations of symsde_step_midpoint_tridiagonal for models that give force and stiffness by rows.
!>
!> A strip of lanes is taken through a whole step before the next one, in arrays of its own that stay in the
!> nearest caches: 640 bytes a row of the chain. The rows come from the model a panel at a time and are
!> eliminated at once, so neither force nor matrix is ever stored as a whole. At the end of a block the last
!> lane fills the strip; its copies rest. The arrays begin at multiples of 64 bytes, the width of an AVX-512
!> vector: across cache lines everything takes a quarter longer.
module symsde_step_midpoint_strip
   use, intrinsic :: iso_c_binding, only: c_intptr_t, c_loc
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: status_ok
   use symsde_base_traits, only: strip_lanes
   use symsde_model_abstract, only: model_type
   use symsde_solve_lapack, only: solve_banded_lane_lapack
   use symsde_solve_newton, only: newton_type, newton_options, new_newton
   use symsde_solve_tridiagonal, only: eliminate_down_strip, correct_up_strip
   use symsde_step_one_step_hamiltonian, only: one_step_hamiltonian
   implicit none
   private
   public :: midpoint_strip, new_midpoint_strip, fits_midpoint_strip

   integer, parameter :: panel = 16            !! rows asked of the model at once
   integer(i8), parameter :: padding_rests = 1 !! status of the copies that fill a strip: any but status_ok
   integer, parameter :: bytes = 8, alignment = 64

   type :: midpoint_strip
      private
      type(newton_type) :: newton
      real(wp), allocatable :: store(:)        !! the arrays of one_strip, one after the other
      real(wp), allocatable :: w(:, :)         !! of fill_strip, where it is needed (strip_lanes, 0:nnoise)
      real(wp), allocatable :: q(:, :), p(:, :), dq(:, :), dp(:, :)  !! the same (strip_lanes, ndof)
   contains
      procedure :: increment
   end type midpoint_strip

contains

   !> Whether a model for which the momenta can be eliminated and whose matrix is tridiagonal goes by strips.
   pure logical function fits_midpoint_strip(model)
      class(model_type), intent(in) :: model

      fits_midpoint_strip = model%traits%has_chain_rows .and. &
                            (model%traits%position_noise .or. model%traits%nnoise == 0)
   end function fits_midpoint_strip

   !> Room for one strip of a block of nlane lanes; requires fits_midpoint_strip(model).
   subroutine new_midpoint_strip(self, model, nlane, options)
      type(midpoint_strip), intent(out) :: self
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane
      type(newton_options), intent(in) :: options

      associate (n => model%traits%ndof, m => model%traits%nnoise)
         call new_newton(self%newton, strip_lanes, n, options, model%traits%quadratic, -1, -1, judge_only=.true., &
                         exact=.true.)
         allocate (self%store(strip_lanes*((n + 2) + 3*n + (m + 1) + (panel + 2) + 3*panel) + alignment/bytes))
         if (modulo(nlane, strip_lanes) == 0) return
         allocate (self%w(strip_lanes, 0:m), self%q(strip_lanes, n), self%p(strip_lanes, n))
         allocate (self%dq(strip_lanes, n), self%dp(strip_lanes, n))
      end associate
   end subroutine new_midpoint_strip

   !> The step of symsde_step_stepper, strip by strip.
   subroutine increment(self, ham, t, w, q, p, dq, dp, status)
      class(midpoint_strip), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      real(wp), intent(in) :: t, w(ham%nlane, 0:ham%nnoise), q(ham%nlane, ham%ndof), p(ham%nlane, ham%ndof)
      real(wp), intent(out) :: dq(ham%nlane, ham%ndof), dp(ham%nlane, ham%ndof)
      integer(i8), intent(inout) :: status(ham%nlane)
      integer :: before, width

      associate (nlane => ham%nlane, n => ham%ndof, m => ham%nnoise)
         width = modulo(nlane, strip_lanes)
         do before = 0, nlane - width - 1, strip_lanes
            call place_arrays(self%newton, size(self%store), self%store, ham, nlane, n, m, before, strip_lanes, &
                              t, w, q, p, dq, dp, status)
         end do
         if (width > 0) call fill_strip(self%newton, self%store, ham, nlane, n, m, width, t, w, q, p, dq, dp, status, &
                                        self%w, self%q, self%p, self%dq, self%dp)
      end associate
   end subroutine increment

   !> The last lanes of a block that do not fill a strip: the very last one fills it, in copies that rest.
   subroutine fill_strip(newton, store, ham, nlane, n, m, width, t, w, q, p, dq, dp, status, wf, qf, pf, dqf, dpf)
      type(newton_type), intent(inout) :: newton
      real(wp), intent(inout), contiguous :: store(:)
      type(one_step_hamiltonian), intent(inout) :: ham
      integer, intent(in) :: nlane, n, m, width
      real(wp), intent(in) :: t, w(nlane, 0:m), q(nlane, n), p(nlane, n)
      real(wp), intent(inout) :: dq(nlane, n), dp(nlane, n)
      integer(i8), intent(inout) :: status(nlane)
      real(wp), intent(inout) :: wf(strip_lanes, 0:m), qf(strip_lanes, n), pf(strip_lanes, n)  !! the strip's own
      real(wp), intent(inout) :: dqf(strip_lanes, n), dpf(strip_lanes, n)
      integer(i8) :: full_status(strip_lanes)
      integer :: i, before

      before = nlane - width
      full_status = padding_rests
      full_status(:width) = status(before + 1:)
      do i = 0, m
         wf(:width, i) = w(before + 1:, i)
         wf(width + 1:, i) = w(nlane, i)
      end do
      do i = 1, n
         qf(:width, i) = q(before + 1:, i)
         qf(width + 1:, i) = q(nlane, i)
         pf(:width, i) = p(before + 1:, i)
         pf(width + 1:, i) = p(nlane, i)
      end do
      call place_arrays(newton, size(store), store, ham, strip_lanes, n, m, 0, &
                        max(0, min(width, ham%nreal - before)), t, wf, qf, pf, dqf, dpf, full_status)
      dq(before + 1:, :) = dqf(:width, :)
      dp(before + 1:, :) = dpf(:width, :)
      status(before + 1:) = full_status(:width)
   end subroutine fill_strip

   !> One step of a strip, in arrays that begin at multiples of the alignment.
   subroutine place_arrays(newton, nstore, x, ham, nlane, n, m, before, width, t, w, q, p, dq, dp, status)
      type(newton_type), intent(inout) :: newton
      integer, intent(in) :: nstore
      real(wp), intent(inout), target :: x(nstore)
      type(one_step_hamiltonian), intent(inout) :: ham
      integer, intent(in) :: nlane, n, m
      integer, intent(in) :: before  !! lanes of the block before the strip
      integer, intent(in) :: width   !! lanes of the strip that are not copies
      real(wp), intent(in) :: t, w(nlane, 0:m), q(nlane, n), p(nlane, n)
      real(wp), intent(inout) :: dq(nlane, n), dp(nlane, n)
      integer(i8), intent(inout) :: status(nlane)
      integer :: at(8)

      at(1) = 1 + int(modulo(-transfer(c_loc(x), 0_c_intptr_t), int(alignment, c_intptr_t)))/bytes
      at(2) = at(1) + strip_lanes*(n + 2)
      at(3) = at(2) + strip_lanes*n
      at(4) = at(3) + strip_lanes*n
      at(5) = at(4) + strip_lanes*n
      at(6) = at(5) + strip_lanes*(m + 1)
      at(7) = at(6) + strip_lanes*(panel + 2)
      at(8) = at(7) + strip_lanes*panel
      call one_strip(newton, ham, nlane, n, m, before, max(0, min(width, ham%nreal - before)), t, w, q, p, &
                     dq, dp, status(before + 1), x(at(1)), x(at(2)), x(at(3)), x(at(4)), x(at(5)), &
                     x(at(6)), x(at(7)), x(at(8)))
   end subroutine place_arrays

   !> One step of lanes before+1 .. before+strip_lanes of a block.
   subroutine one_strip(newton, ham, nlane, n, m, before, nreal, t, w, q, p, dq, dp, status, &
                        base, v, factor, rhs, ws, qs, hq, hqq)
      type(newton_type), intent(inout) :: newton
      type(one_step_hamiltonian), intent(inout) :: ham
      integer, intent(in) :: nlane, n, m, before
      integer, intent(in) :: nreal                           !! real paths of the strip
      real(wp), intent(in) :: t, w(nlane, 0:m), q(nlane, n), p(nlane, n)
      real(wp), intent(inout) :: dq(nlane, n), dp(nlane, n)
      integer(i8), intent(inout) :: status(strip_lanes)
      real(wp), intent(inout) :: base(strip_lanes, 0:n + 1)  !! q_n + h p_n/2; rows 0 and n + 1 are zero
      real(wp), intent(inout) :: v(strip_lanes, n)           !! V
      real(wp), intent(inout) :: factor(strip_lanes, n), rhs(strip_lanes, n)
      real(wp), intent(inout) :: ws(strip_lanes, 0:m)        !! w of the strip
      real(wp), intent(inout) :: qs(strip_lanes, panel + 2)  !! Q of a panel and of the rows before and behind it
      real(wp), intent(inout) :: hq(strip_lanes, panel), hqq(strip_lanes, 0:1, panel)
      real(wp) :: trusted(strip_lanes), h, tm

      h = w(1, 0)
      tm = t + 0.5_wp*h
      call take(nlane, m + 1, before, w, ws)
      call free_flight(nlane, n, before, h, q, p, base, v)
      call newton%start(status)
      do while (newton%running)
         call eliminate(ham%model, n, m, h, tm, newton%iteration == 0, ws, base, v, factor, rhs, qs, hq, hqq, trusted)
         ham%counters%gradients = ham%counters%gradients + nreal
         ham%counters%hessians = ham%counters%hessians + nreal
         if (any(trusted <= 0 .and. newton%last >= 0)) &
            call solve_suspects(newton, ham, n, m, h, tm, ws, base, v, trusted, factor, rhs, status)
         call correct_up_strip(n, factor, rhs, newton%last, v, newton%step, newton%size)
         call newton%judge(status, ham%counters)
      end do
      call give(nlane, n, before, h, p, v, dq, dp)
   end subroutine one_strip

   !> Residual V + Hhat_q(Q) and matrix I + (h/4) Hhat_qq(Q), a panel at a time, eliminated as they come.
   subroutine eliminate(model, n, m, h, tm, first_time, w, base, v, factor, rhs, qs, hq, hqq, trusted)
      class(model_type), intent(in) :: model
      integer, intent(in) :: n, m
      real(wp), intent(in) :: h, tm
      logical, intent(in) :: first_time  !! V = 0, so Q is base
      real(wp), intent(in) :: w(strip_lanes, 0:m), base(strip_lanes, 0:n + 1), v(strip_lanes, n)
      real(wp), intent(out) :: factor(strip_lanes, n), rhs(strip_lanes, n)
      real(wp), intent(inout) :: qs(strip_lanes, panel + 2), hq(strip_lanes, panel), hqq(strip_lanes, 0:1, panel)
      real(wp), intent(out) :: trusted(strip_lanes)
      real(wp) :: above(strip_lanes, 4)
      integer :: first, last

      above(:, 1:3) = 0
      above(:, 4) = 1
      do first = 1, n, panel
         last = min(first + panel - 1, n)
         if (first_time) then
            call model%chain_rows(n, m, first, last, tm, w, base(1, first - 1), hq, hqq)
         else
            call position(n, first, last, 0.25_wp*h, base, v, qs)
            call model%chain_rows(n, m, first, last, tm, w, qs, hq, hqq)
         end if
         if (last == n) hqq(:, 1, last - first + 1) = 0
         call eliminate_down_strip(last - first + 1, 0.25_wp*h, v(1, first), hq, hqq, above, &
                                   factor(1, first), rhs(1, first))
      end do
      trusted = above(:, 4)
   end subroutine eliminate

   !> Running lanes whose pivots are not trusted are solved by LAPACK from their matrix, computed once more:
   !> their right-hand sides become the solution and their factors those of the identity.
   subroutine solve_suspects(newton, ham, n, m, h, tm, w, base, v, trusted, factor, rhs, status)
      type(newton_type), intent(inout) :: newton
      type(one_step_hamiltonian), intent(inout) :: ham
      integer, intent(in) :: n, m
      real(wp), intent(in) :: h, tm, w(strip_lanes, 0:m), base(strip_lanes, 0:n + 1), v(strip_lanes, n)
      real(wp), intent(in) :: trusted(strip_lanes)
      real(wp), intent(inout) :: factor(strip_lanes, n), rhs(strip_lanes, n)
      integer(i8), intent(inout) :: status(strip_lanes)
      real(wp), allocatable :: qs(:, :), hq(:, :), hqq(:, :, :), bands(:, :, :)
      integer(i4) :: info
      integer :: lane

      allocate (qs(strip_lanes, 0:n + 1), hq(strip_lanes, n), hqq(strip_lanes, 0:1, n), bands(strip_lanes, -1:1, n))
      call position(n, 1, n, 0.25_wp*h, base, v, qs)
      call ham%model%chain_rows(n, m, 1, n, tm, w, qs, hq, hqq)
      bands(:, 0, :) = 1 + 0.25_wp*h*hqq(:, 0, :)
      bands(:, 1, :) = 0.25_wp*h*hqq(:, 1, :)
      bands(:, -1, 2:) = bands(:, 1, :n - 1)
      bands(:, -1, 1) = 0
      hq = v + hq
      do lane = 1, strip_lanes
         if (trusted(lane) > 0 .or. .not. newton%last(lane) >= 0) cycle
         call solve_banded_lane_lapack(strip_lanes, n, 1, 1, lane, bands, hq, info)
         ham%counters%lapack_solves = ham%counters%lapack_solves + 1
         factor(lane, :) = 0
         rhs(lane, :) = hq(lane, :)
         if (info == status_ok) cycle
         rhs(lane, :) = 0
         call newton%fail(lane, int(info, i8), status, ham%counters)
      end do
   end subroutine solve_suspects

   ! ---- kernels: strip_lanes is so small that the compiler writes the loops over lanes out ------------

   !> VEC Rows of lanes before+1 .. before+strip_lanes of a block.
   pure subroutine take(nlane, nrow, before, x, y)
      integer, intent(in) :: nlane, nrow, before
      real(wp), intent(in) :: x(nlane, nrow)
      real(wp), intent(out) :: y(strip_lanes, nrow)
      integer :: i, lane

      do i = 1, nrow
         !GCC$ unroll 16
         do lane = 1, strip_lanes
            y(lane, i) = x(before + lane, i)
         end do
      end do
   end subroutine take

   !> VEC base = q + h p/2 of the same lanes, V = 0
   pure subroutine free_flight(nlane, n, before, h, q, p, base, v)
      integer, intent(in) :: nlane, n, before
      real(wp), intent(in) :: h, q(nlane, n), p(nlane, n)
      real(wp), intent(out) :: base(strip_lanes, 0:n + 1), v(strip_lanes, n)
      integer :: i, lane

      base(:, 0) = 0
      do i = 1, n
         !GCC$ unroll 16
         do lane = 1, strip_lanes
            base(lane, i) = q(before + lane, i) + 0.5_wp*(h*p(before + lane, i))
            v(lane, i) = 0
         end do
      end do
      base(:, n + 1) = 0
   end subroutine free_flight

   !> VEC Q = base + c V in rows first-1 .. last+1
   pure subroutine position(n, first, last, c, base, v, qs)
      integer, intent(in) :: n, first, last
      real(wp), intent(in) :: c, base(strip_lanes, 0:n + 1), v(strip_lanes, n)
      real(wp), intent(out) :: qs(strip_lanes, first - 1:last + 1)
      integer :: i, lane

      if (first == 1) qs(:, 0) = 0
      do i = max(first - 1, 1), min(last + 1, n)
         !GCC$ unroll 16
         do lane = 1, strip_lanes
            qs(lane, i) = base(lane, i) + c*v(lane, i)
         end do
      end do
      if (last == n) qs(:, n + 1) = 0
   end subroutine position

   !> VEC dp = V and dq = h (p + V/2) of the same lanes
   pure subroutine give(nlane, n, before, h, p, v, dq, dp)
      integer, intent(in) :: nlane, n, before
      real(wp), intent(in) :: h, p(nlane, n), v(strip_lanes, n)
      real(wp), intent(inout) :: dq(nlane, n), dp(nlane, n)
      integer :: i, lane

      do i = 1, n
         !GCC$ unroll 16
         do lane = 1, strip_lanes
            dp(before + lane, i) = v(lane, i)
            dq(before + lane, i) = h*p(before + lane, i) + 0.5_wp*h*v(lane, i)
         end do
      end do
   end subroutine give

end module symsde_step_midpoint_strip
