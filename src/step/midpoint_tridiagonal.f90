! SPDX-License-Identifier: BSD-3-Clause
!> Implicit midpoint, momenta eliminated, for chains: forces between nearest neighbours only.
!>
!> The equations of symsde_step_midpoint, V + Hhat_q(Q) = 0 with Q = q_n + (h p_n + g)/2 + h V/4, whose
!> Newton matrix I + (h/4) Hhat_qq is symmetric and tridiagonal. Residual, matrix and elimination
!> downwards take one pass over the rows, solution, correction and the next position another; nothing is
!> copied. A third of the time of symsde_step_midpoint on a chain of 64, and its twin: they agree to a few
!> ulps (tests/verification/test_steppers.pf). Models that give their rows one after another go by strips of
!> lanes (symsde_step_midpoint_strip), which takes less still and agrees as well.
module symsde_step_midpoint_tridiagonal
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: status_ok
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: correction_none
   use symsde_solve_lapack, only: solve_banded_lane_lapack
   use symsde_solve_newton, only: newton_type, newton_options, new_newton
   use symsde_solve_tridiagonal, only: eliminate_down_lanes, correct_up_lanes
   use symsde_step_midpoint, only: fits_midpoint_stepper
   use symsde_step_midpoint_strip, only: midpoint_strip, new_midpoint_strip, fits_midpoint_strip
   use symsde_step_one_step_hamiltonian, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type
   implicit none
   private
   public :: midpoint_tridiagonal_stepper, new_midpoint_tridiagonal_stepper, fits_midpoint_tridiagonal

   type, extends(stepper_type) :: midpoint_tridiagonal_stepper
      private
      type(midpoint_strip), allocatable :: strip  !! by strips, where the model gives rows; else what follows
      type(newton_type) :: newton
      logical :: has_shift = .false.           !! additive noise moves the positions: g /= 0
      real(wp), allocatable :: base(:, :)      !! q_n + (h p_n + g)/2 (nlane, ndof)
      real(wp), allocatable :: qs(:, :)        !! Q (nlane, ndof)
      real(wp), allocatable :: hq(:, :)        !! Hhat_q, right-hand side, correction (nlane, ndof)
      real(wp), allocatable :: hqq(:, :, :)    !! bands of Hhat_qq, factors (nlane, 0:1, ndof)
      real(wp), allocatable :: trusted(:)      !! 1, or 0 where the pivots are not trusted (nlane)
      real(wp), allocatable :: carried(:)      !! work of the elimination (nlane)
      real(wp), allocatable :: shift(:, :), zero(:, :)  !! g, and p = 0 where it is read (nlane, ndof)
   contains
      procedure :: increment
   end type midpoint_tridiagonal_stepper

contains

   !> Whether this stepper serves a model with these options.
   pure logical function fits_midpoint_tridiagonal(model, options)
      class(model_type), intent(in) :: model
      type(newton_options), intent(in) :: options

      fits_midpoint_tridiagonal = fits_midpoint_stepper(model) .and. model%traits%bandwidth == 1 .and. &
                                  model%traits%ndof > 3 .and. options%fixed_point == 0
   end function fits_midpoint_tridiagonal

   !> A midpoint stepper for blocks of nlane lanes; requires fits_midpoint_tridiagonal(model, options).
   subroutine new_midpoint_tridiagonal_stepper(self, model, nlane, options)
      type(midpoint_tridiagonal_stepper), intent(out) :: self
      class(model_type), intent(in), target :: model
      integer, intent(in) :: nlane
      type(newton_options), intent(in) :: options
      integer :: n

      n = model%traits%ndof
      self%name = 'midpoint, momenta eliminated, tridiagonal'
      self%has_shift = .not. (model%traits%position_noise .or. model%traits%nnoise == 0)
      call new_one_step_hamiltonian(self%ham, model, nlane, correction_none, 0.0_wp)
      if (fits_midpoint_strip(model)) then
         allocate (self%strip)
         call new_midpoint_strip(self%strip, model, nlane, options)
         return
      end if
      call new_newton(self%newton, nlane, n, options, model%traits%quadratic, -1, -1, judge_only=.true.)
      allocate (self%base(nlane, n), self%qs(nlane, n), self%hq(nlane, n), self%hqq(nlane, 0:1, n))
      allocate (self%trusted(nlane), self%carried(nlane))
      if (.not. self%has_shift) return
      allocate (self%shift(nlane, n), self%zero(nlane, n))
      self%zero = 0
   end subroutine new_midpoint_tridiagonal_stepper

   subroutine increment(self, t, w, q, p, dq, dp, status)
      class(midpoint_tridiagonal_stepper), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      real(wp) :: h, tm

      if (allocated(self%strip)) then
         call self%strip%increment(self%ham, t, w, q, p, dq, dp, status)
         return
      end if
      associate (nlane => self%ham%nlane, n => self%ham%ndof, newton => self%newton)
         h = w(1, 0)
         tm = t + 0.5_wp*h
         call free_flight(nlane*n, h, p, q, self%base, dp)
         if (self%has_shift) then
            call self%ham%gradient(tm, w, q, self%zero, hp=self%shift)
            call add_shift(nlane*n, self%shift, self%base)
         end if
         call newton%start(status)
         do while (newton%running)
            if (newton%iteration == 0) then
               call self%ham%force_stiffness(1, tm, w, self%base, p, self%hq, self%hqq)
            else
               call self%ham%force_stiffness(1, tm, w, self%qs, p, self%hq, self%hqq)
            end if
            call eliminate_down_lanes(nlane, n, 0.25_wp*h, dp, self%hq, self%hqq, self%carried, self%trusted)
            if (any(self%trusted <= 0 .and. newton%last >= 0)) call solve_suspects(self, h, tm, w, p, dp, status)
            call correct_up_lanes(nlane, n, 0.25_wp*h, self%hqq, newton%last, self%base, self%hq, dp, self%qs, &
                                  newton%step, newton%size)
            call newton%judge(status, self%ham%counters)
         end do
         call position_increment(nlane*n, h, p, dp, dq)
         if (self%has_shift) dq = dq + self%shift
      end associate
   end subroutine increment

   !> Running lanes whose pivots are not trusted are solved by LAPACK from their matrix, computed once more:
   !> their right-hand sides become the solution and their factors those of the identity.
   subroutine solve_suspects(self, h, tm, w, p, v, status)
      type(midpoint_tridiagonal_stepper), intent(inout) :: self
      real(wp), intent(in) :: h, tm, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: p(self%ham%nlane, self%ham%ndof), v(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      real(wp), allocatable :: hq(:, :), hqq(:, :, :), bands(:, :, :)
      integer(i4) :: info
      integer :: lane

      associate (nlane => self%ham%nlane, n => self%ham%ndof, counters => self%ham%counters, &
                 last => self%newton%last)
         if (self%newton%iteration == 0) self%qs = self%base
         allocate (hq(nlane, n), hqq(nlane, 0:1, n), bands(nlane, -1:1, n))
         call self%ham%model%force_stiffness(nlane, n, self%ham%nnoise, 1, tm, w, self%qs, p, hq, hqq)
         bands(:, 0, :) = 1 + 0.25_wp*h*hqq(:, 0, :)
         bands(:, 1, :) = 0.25_wp*h*hqq(:, 1, :)
         bands(:, -1, 2:) = bands(:, 1, :n - 1)
         bands(:, -1, 1) = 0
         hq = v + hq
         do lane = 1, nlane
            if (self%trusted(lane) > 0 .or. .not. last(lane) >= 0) cycle
            call solve_banded_lane_lapack(nlane, n, 1, 1, lane, bands, hq, info)
            counters%lapack_solves = counters%lapack_solves + 1
            self%hqq(lane, 1, :) = 0
            self%hq(lane, :) = hq(lane, :)
            if (info == status_ok) cycle
            self%hq(lane, :) = 0
            call self%newton%fail(lane, int(info, i8), status, counters)
         end do
      end associate
   end subroutine solve_suspects

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC base = q + h p/2, V = 0
   pure subroutine free_flight(n, h, p, q, base, v)
      integer, intent(in) :: n
      real(wp), intent(in) :: h, p(n), q(n)
      real(wp), intent(out) :: base(n), v(n)
      integer :: i

      do i = 1, n
         base(i) = q(i) + 0.5_wp*(h*p(i))
         v(i) = 0
      end do
   end subroutine free_flight

   !> VEC base = base + g/2
   pure subroutine add_shift(n, g, base)
      integer, intent(in) :: n
      real(wp), intent(in) :: g(n)
      real(wp), intent(inout) :: base(n)
      integer :: i

      do i = 1, n
         base(i) = base(i) + 0.5_wp*g(i)
      end do
   end subroutine add_shift

   !> VEC dq = h (p + dp/2)
   pure subroutine position_increment(n, h, p, dp, dq)
      integer, intent(in) :: n
      real(wp), intent(in) :: h, p(n), dp(n)
      real(wp), intent(out) :: dq(n)
      integer :: i

      do i = 1, n
         dq(i) = h*p(i) + 0.5_wp*h*dp(i)
      end do
   end subroutine position_increment

end module symsde_step_midpoint_tridiagonal
