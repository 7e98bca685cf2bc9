! SPDX-License-Identifier: BSD-3-Clause
!> Newton's iteration for the slopes of all stages of one degree of freedom, in a block of lanes.
!>
!>    F_i = Hhat_p(Q_i,P_i),  G_i = -Hhat_q(Q_i,P_i),  Q_i = q_n + sum_j a_ij F_j,  P_i = p_n + sum_j abar_ij G_j
!>
!> Where Hhat_qp = 0 the F are eliminated and the G remain, as many as there are stages:
!>
!>    (I + diag(Hqq) a diag(Hpp) abar) dG = r_G - diag(Hqq) a r_F,   dF = r_F + diag(Hpp) abar dG
!>
!> Then it begins as step/midpoint/one_dof does, with F = Hhat_p(p), G = 0, or from zero. Else the first guess is one
!> Newton correction from (q_n, p_n), with a single evaluation in the middle of the step for all stages.
!>
!> Two stages are solved in closed form (step/one_dof/two_stages), more by elimination across lanes.
!>
!> Private to its family.
module symsde_step_one_dof_newton
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_scheme_scheme, only: scheme_type
   use symsde_solve_blocks, only: block_solver, new_block_solver
   use symsde_solve_newton, only: newton_type, newton_options, new_newton
   use symsde_solve_stagnation, only: correct_lanes, restart_lanes
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   use symsde_step_hamiltonian_brackets_one_dof, only: single_brackets, new_single_brackets
   use symsde_step_stages_slope_sums, only: add_slopes
   use symsde_step_one_dof_two_stages, only: stage_point, correct_separable, solve_lanes
   implicit none
   private
   public :: one_dof_newton, new_one_dof_newton

   type :: one_dof_newton
      type(newton_type) :: newton
      integer :: nlane = 0, s = 0                  !! lanes, stages
      logical :: separable = .false.               !! Hhat_qp = 0, and the F are eliminated
      real(wp), allocatable :: a(:, :), abar(:, :), c(:)  !! (s, s), (s)
      real(wp), allocatable :: x(:, :)             !! slopes F_1 .. F_s, G_1 .. G_s (nlane, 2 s)
      logical, private :: flies = .false.          !! this step begins with the velocity
      real(wp), allocatable, private :: first(:)   !! size of the first correction (nlane)
      type(single_brackets), allocatable, private :: brackets      !! where some are added
      real(wp), allocatable, private :: d(:, :)                    !! their correction (nlane, 2 s)
      real(wp), allocatable, dimension(:), private :: qs, ps       !! one stage (nlane)
      real(wp), allocatable, dimension(:, :), private :: hq, hp, hqq, hqp, hpp  !! all stages (nlane, s)
      real(wp), allocatable, private :: matrix(:, :, :)            !! more than two stages (nlane, n, n): s or 2 s
      type(block_solver), private :: solver
      logical, allocatable, private :: active(:)
      integer(i8), allocatable, private :: verdict(:)
   contains
      procedure :: begin
      procedure :: resume
      procedure :: iterate
   end type one_dof_newton

contains

   !> An iteration for the lanes of this Hamiltonian.
   subroutine new_one_dof_newton(self, ham, scheme, options)
      type(one_dof_newton), intent(out) :: self
      type(one_step_hamiltonian), intent(in) :: ham
      type(scheme_type), intent(in) :: scheme
      type(newton_options), intent(in) :: options
      logical :: bare, whole
      integer :: n

      bare = .not. allocated(ham%modified)
      whole = bare  ! Newton's matrix
      if (.not. bare) then
         allocate (self%brackets)
         call new_single_brackets(self%brackets, ham%modified)
         whole = self%brackets%exact
      end if
      self%nlane = ham%nlane
      self%s = scheme%nstage
      self%a = scheme%a
      self%abar = scheme%abar
      self%c = scheme%c
      associate (nlane => ham%nlane, s => scheme%nstage, traits => ham%model%traits)
         call new_newton(self%newton, nlane, 2*s, options, traits%one_solve(.false.) .and. bare, -1, -1, &
                         judge_only=.true., exact=traits%has_hessian .and. whole)
         ! where one solve must do, the elimination of the F would lose digits at h omega = 1000
         self%separable = traits%separable .and. bare .and. .not. self%newton%affine
         allocate (self%x(nlane, 2*s), self%d(nlane, 2*s), self%qs(nlane), self%ps(nlane), self%first(nlane))
         allocate (self%hq(nlane, s), self%hp(nlane, s), self%hqq(nlane, s), self%hpp(nlane, s))
         if (.not. self%separable) allocate (self%hqp(nlane, s))
         if (s == 2) return
         n = merge(s, 2*s, self%separable)
         allocate (self%matrix(nlane, n, n), self%active(nlane), self%verdict(nlane))
         call new_block_solver(self%solver, nlane, n, -1, -1)
      end associate
   end subroutine new_one_dof_newton

   !> Begin a step: the first guess. It is not judged: a gradient that vanishes here need not vanish at the stages.
   !> As one order of the step more is right of the velocity's, it needs no evaluation of the force.
   subroutine begin(self, ham, step, q, p, status)
      class(one_dof_newton), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%nlane), p(self%nlane)
      integer(i8), intent(inout) :: status(self%nlane)
      integer :: i

      self%x = 0
      call self%newton%start(status)
      if (allocated(self%brackets)) call self%brackets%begin(ham%modified, step)
      if (self%newton%affine) return
      self%flies = self%separable .and. ham%model%traits%is_slow(step%h)
      if (self%flies) then
         call ham%velocity(step%t + self%c(1)*step%h, step%w, q, p, self%qs)
         do i = 1, self%s
            self%x(:, i) = self%qs
         end do
      end if
      if (self%separable) return
      call evaluate(self, ham, 1, step%t + 0.5_wp*step%h, step, q, p)
      call correct(self, [(1, i=1, self%s)], status, ham%counters)
   end subroutine begin

   !> Begin where another block has come in these lanes; those with a status rest.
   subroutine resume(self, ham, from, lanes, step, status)
      class(one_dof_newton), intent(inout) :: self
      type(one_step_hamiltonian), intent(in) :: ham
      type(one_dof_newton), intent(in) :: from
      integer, intent(in) :: lanes(self%nlane)
      type(step_record), intent(in) :: step
      integer(i8), intent(inout) :: status(self%nlane)

      self%x = from%x(lanes, :)
      call self%newton%start(status)
      if (allocated(self%brackets)) call self%brackets%begin(ham%modified, step)
      self%newton%last = merge(from%newton%last(lanes), self%newton%last, status == 0)
      self%newton%iteration = from%newton%iteration
      self%first = from%first(lanes)
      self%flies = from%flies
   end subroutine resume

   !> One correction of the slopes, and the test of every lane.
   subroutine iterate(self, ham, step, q, p, status)
      class(one_dof_newton), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%nlane), p(self%nlane)
      integer(i8), intent(inout) :: status(self%nlane)
      integer :: i

      do i = 1, self%s
         if (self%s == 2) then
            call stage_point(self%nlane, i, self%a, self%abar, q, p, self%x, self%qs, self%ps)
         else
            call add_slopes(self%nlane, self%s, 1, self%a(i, :), self%x, q, self%qs)
            call add_slopes(self%nlane, self%s, 1, self%abar(i, :), self%x(:, self%s + 1:), p, self%ps)
         end if
         call evaluate(self, ham, i, step%t + self%c(i)*step%h, step, self%qs, self%ps)
      end do
      call correct(self, [(i, i=1, self%s)], status, ham%counters)
      call self%newton%judge(status, ham%counters)
      if (.not. self%flies) return
      associate (n => self%newton)
         if (n%iteration == 1) self%first = n%last
         if (n%iteration == 2 .and. n%running) &
            call restart_lanes(self%nlane, 2*self%s, self%first, n%size, self%hqq(:, 1), self%hpp(:, 1), n%last, self%x)
      end associate
   end subroutine iterate

   !> Gradient and Hessian of stage i.
   subroutine evaluate(self, ham, i, t, step, q, p)
      type(one_dof_newton), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      integer, intent(in) :: i
      real(wp), intent(in) :: t
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%nlane), p(self%nlane)

      if (self%separable) then
         call ham%gradient_hessian(t, step%w, q, p, self%hq(:, i), self%hp(:, i), hqq=self%hqq(:, i), &
                                   hpp=self%hpp(:, i))
      else if (allocated(self%brackets)) then
         call self%brackets%evaluate(ham%modified, t, step, q, p, self%hq(:, i), self%hp(:, i), self%hqq(:, i), &
                                     self%hqp(:, i), self%hpp(:, i), ham%counters, ham%nreal)
      else
         call ham%gradient_hessian(t, step%w, q, p, self%hq(:, i), self%hp(:, i), self%hqq(:, i), &
                                   self%hqp(:, i), self%hpp(:, i))
      end if
   end subroutine evaluate

   !> One correction of the slopes, with the gradient and Hessian that stand in column at(i) for stage i.
   subroutine correct(self, at, status, counters)
      type(one_dof_newton), intent(inout) :: self
      integer, intent(in) :: at(self%s)
      integer(i8), intent(inout) :: status(self%nlane)
      type(counters_type), intent(inout) :: counters

      associate (n => self%newton, i => at(1), j => at(2))
         if (self%s == 2 .and. self%separable) then
            call correct_separable(self%nlane, self%a, self%abar, self%hq(:, i), self%hq(:, j), self%hp(:, i), &
                                   self%hp(:, j), self%hqq(:, i), self%hqq(:, j), self%hpp(:, i), self%hpp(:, j), &
                                   n%last, self%x, n%step, n%size)
            return
         else if (self%s == 2) then
            call solve_lanes(self%nlane, self%a, self%abar, self%hq(:, i), self%hq(:, j), self%hp(:, i), &
                             self%hp(:, j), self%hqq(:, i), self%hqq(:, j), self%hqp(:, i), self%hqp(:, j), &
                             self%hpp(:, i), self%hpp(:, j), self%x, self%d)
         else
            call eliminate(self, at, status, counters)
         end if
         call correct_lanes(self%nlane, 2*self%s, self%d, n%last, self%x, n%step, n%size)
      end associate
   end subroutine correct

   !> The correction d of more than two stages; a lane whose matrix is singular fails.
   subroutine eliminate(self, at, status, counters)
      type(one_dof_newton), intent(inout) :: self
      integer, intent(in) :: at(self%s)
      integer(i8), intent(inout) :: status(self%nlane)
      type(counters_type), intent(inout) :: counters
      integer(i8) :: before
      integer :: lane, first

      if (self%separable) then
         first = self%s + 1  ! of the unknowns
         call linearise(self%nlane, self%s, at, self%a, self%abar, self%hq, self%hp, self%hqq, self%hpp, self%x, &
                        self%d, self%d(:, first:), self%matrix)
      else
         first = 1
         call linearise_all(self%nlane, self%s, at, self%a, self%abar, self%hq, self%hp, self%hqq, self%hqp, self%hpp, &
                            self%x, self%d, self%matrix)
      end if
      self%active = self%newton%last >= 0
      self%verdict = 0
      before = self%solver%lapack_solves
      call self%solver%solve(self%matrix, self%d(:, first:), self%active, self%verdict)
      counters%lapack_solves = counters%lapack_solves + self%solver%lapack_solves - before
      if (self%separable) &
         call add_velocities(self%nlane, self%s, at, self%abar, self%hpp, self%d(:, first:), self%d)
      if (all(self%verdict == 0)) return
      do lane = 1, self%nlane
         if (self%active(lane) .and. self%verdict(lane) /= 0) &
            call self%newton%fail(lane, self%verdict(lane), status, counters)
      end do
   end subroutine eliminate

   ! ---- kernels ----------------------------------------------------------------------------------

   !> r_F, r_G - diag(Hqq) a r_F, and I + diag(Hqq) a diag(Hpp) abar.
   pure subroutine linearise(nlane, s, at, a, abar, hq, hp, hqq, hpp, x, rf, rg, matrix)
      integer, intent(in) :: nlane, s, at(s)
      real(wp), intent(in) :: a(s, s), abar(s, s)
      real(wp), intent(in), dimension(nlane, s) :: hq, hp, hqq, hpp
      real(wp), intent(in) :: x(nlane, 2*s)
      real(wp), intent(out), dimension(nlane, s) :: rf, rg
      real(wp), intent(out) :: matrix(nlane, s, s)
      integer :: i, j, k

      do i = 1, s
         rf(:, i) = x(:, i) - hp(:, at(i))
      end do
      do i = 1, s
         rg(:, i) = 0
         matrix(:, i, :) = 0
         do k = 1, s
            if (abs(a(i, k)) <= 0) cycle
            rg(:, i) = rg(:, i) - a(i, k)*rf(:, k)
            do j = 1, s
               if (abs(abar(k, j)) > 0) matrix(:, i, j) = matrix(:, i, j) + a(i, k)*abar(k, j)*hpp(:, at(k))
            end do
         end do
         rg(:, i) = x(:, s + i) + hq(:, at(i)) + hqq(:, at(i))*rg(:, i)
         do j = 1, s
            matrix(:, i, j) = merge(1.0_wp, 0.0_wp, i == j) + hqq(:, at(i))*matrix(:, i, j)
         end do
      end do
   end subroutine linearise

   !> r_F, r_G, and the whole matrix.
   pure subroutine linearise_all(nlane, s, at, a, abar, hq, hp, hqq, hqp, hpp, x, r, matrix)
      integer, intent(in) :: nlane, s, at(s)
      real(wp), intent(in) :: a(s, s), abar(s, s)
      real(wp), intent(in), dimension(nlane, s) :: hq, hp, hqq, hqp, hpp
      real(wp), intent(in) :: x(nlane, 2*s)
      real(wp), intent(out) :: r(nlane, 2*s), matrix(nlane, 2*s, 2*s)
      real(wp) :: unit
      integer :: i, k

      do i = 1, s
         r(:, i) = x(:, i) - hp(:, at(i))
         r(:, s + i) = x(:, s + i) + hq(:, at(i))
         do k = 1, s
            unit = merge(1.0_wp, 0.0_wp, i == k)
            matrix(:, i, k) = unit - a(i, k)*hqp(:, at(i))
            matrix(:, i, s + k) = -(abar(i, k)*hpp(:, at(i)))
            matrix(:, s + i, k) = a(i, k)*hqq(:, at(i))
            matrix(:, s + i, s + k) = unit + abar(i, k)*hqp(:, at(i))
         end do
      end do
   end subroutine linearise_all

   !> dF = r_F + diag(Hpp) abar dG
   pure subroutine add_velocities(nlane, s, at, abar, hpp, dg, df)
      integer, intent(in) :: nlane, s, at(s)
      real(wp), intent(in) :: abar(s, s), hpp(nlane, s), dg(nlane, s)
      real(wp), intent(inout) :: df(nlane, s)
      integer :: i, j

      do j = 1, s
         do i = 1, s
            if (abs(abar(i, j)) > 0) df(:, i) = df(:, i) + abar(i, j)*hpp(:, at(i))*dg(:, j)
         end do
      end do
   end subroutine add_velocities

end module symsde_step_one_dof_newton
