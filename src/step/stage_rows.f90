! SPDX-License-Identifier: BSD-3-Clause
!> Newton's iteration for a group of stages of a chain, whose momenta are eliminated and whose Hessian is tridiagonal.
!>
!> Unknown are the slopes of a strip of lanes, where the group has a nonsingular matrix B:
!>
!>    G_m + Hhat_q(base_m + h sum_k B_mk G_k) = 0       base_m: q_n and what Q_m has of p_n and of known slopes
!>
!> The correction of Q solves (B^{-1}/h (x) I + Hhat_qq) d = G + Hhat_q, where what is beside the diagonal blocks is
!> diagonal, and that of G is B^{-1} d/h (solve/block_tridiagonal; one stage alone: solve/tridiagonal). Force and
!> stiffness of a panel of sites are eliminated as they come, as in step/midpoint_by_rows.
!>
!> Mild lanes begin with the slopes that fixed-point iteration has found, linear equations with zero, stiff lanes with
!> the slopes of Q = q_n: from there on the iterates are those of the general stepper from slopes zero. A lane that
!> fails here, or whose pivots say that its matrix might not be eliminated in this order, is left to the caller, who
!> has another way.
module symsde_step_stage_rows
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: singular
   use symsde_base_traits, only: model_traits, strip_lanes
   use symsde_solve_block_tridiagonal, only: eliminate_down_blocks, correct_up_blocks, site_above, new_site_above
   use symsde_solve_newton, only: newton_type, newton_options, new_newton
   use symsde_solve_tridiagonal, only: eliminate_down_strip, correct_up_strip, before_first_row, nabove
   use symsde_step_stage_equations, only: stage_equations
   use symsde_step_stage_iteration, only: slow, stiff
   use symsde_step_stage_plan, only: stage_group
   implicit none
   private
   public :: stage_rows, new_stage_rows, fits_stage_rows, solves_at_once

   integer, parameter :: panel = 16          !! sites asked of the model at once
   integer, parameter :: most_stages = 3     !! of a group
   integer, parameter :: most_iterations = 30

   integer, parameter :: fewest_rows = 4  !! chains that are shorter are taken as dense systems

   type :: stage_rows
      private
      type(newton_type) :: newton
      integer(i8), allocatable :: status(:)     !! (newton%nlane)
      integer :: s = 0, n = 0                   !! stages, sites
      integer :: nlane = 0, nstrip = 0          !! lanes of the part, strips that hold them
      logical :: gives_rows = .false.
      integer :: nrow = 0                       !! sites of a panel
      real(wp), allocatable :: c(:, :), hb(:, :)  !! B^{-1}/h; h B, of a stage in a column (s, s)
      real(wp), allocatable :: w(:, :, :)       !! weights (strip_lanes, 0:m, nstrip)
      real(wp), allocatable :: base(:, :, :, :) !! sites 0 and n+1 are zero (strip_lanes, 0:n+1, s, nstrip)
      real(wp), allocatable :: g(:, :, :, :)    !! slopes (strip_lanes, s, n, nstrip)
      real(wp), allocatable :: q(:, :)          !! Q of a panel and its neighbours (strip_lanes, nrow+2)
      real(wp), allocatable :: f(:, :, :)       !! force (strip_lanes, nrow, s)
      real(wp), allocatable :: k(:, :, :, :)    !! stiffness (strip_lanes, 0:1, nrow, s)
      real(wp), allocatable :: force(:, :, :), stiffness(:, :, :, :)  !! of all lanes, where the model gives no rows
      real(wp), allocatable :: factor(:, :, :, :), rhs(:, :, :)  !! (strip_lanes, s, s, n), (strip_lanes, s, n)
      type(site_above) :: above                 !! several stages
      real(wp) :: above_one(strip_lanes, nabove) = 0
   contains
      procedure :: solve
   end type stage_rows

contains

   !> Whether this way serves a group of stages; momenta must be eliminated.
   pure logical function fits_stage_rows(traits, group)
      type(model_traits), intent(in) :: traits
      type(stage_group), intent(in) :: group

      fits_stage_rows = traits%bandwidth == 1 .and. traits%ndof >= fewest_rows .and. &
                        group%nmember <= most_stages .and. allocated(group%inverse)
   end function fits_stage_rows

   !> Whether the equations are linear and their matrix exact: one solve from slopes zero finds the root.
   pure logical function solves_at_once(traits)
      type(model_traits), intent(in) :: traits

      solves_at_once = traits%quadratic .and. (traits%has_chain_rows .or. traits%has_hessian_vector)
   end function solves_at_once

   !> A solver for one group of stages.
   subroutine new_stage_rows(self, equations, group, options)
      type(stage_rows), intent(out) :: self
      type(stage_equations), intent(in) :: equations
      type(stage_group), intent(in) :: group
      type(newton_options), intent(in) :: options
      type(newton_options) :: bounded

      bounded = options
      bounded%max_iter = min(options%max_iter, most_iterations)
      associate (t => equations%ham%model%traits, n => equations%ham%ndof, m => equations%ham%nnoise, &
                 s => group%nmember)
         self%s = s
         self%n = n
         self%nlane = equations%ham%nlane
         self%nstrip = (self%nlane + strip_lanes - 1)/strip_lanes
         self%gives_rows = t%has_chain_rows
         self%nrow = merge(min(panel, n), n, self%gives_rows)
         call new_newton(self%newton, self%nstrip*strip_lanes, n*s, bounded, solves_at_once(t), -1, -1, &
                         judge_only=.true., exact=t%has_chain_rows .or. t%has_hessian_vector)
         allocate (self%status(self%newton%nlane))
         allocate (self%c(s, s), self%hb(s, s))
         allocate (self%w(strip_lanes, 0:m, self%nstrip), source=0.0_wp)
         allocate (self%base(strip_lanes, 0:n + 1, s, self%nstrip), source=0.0_wp)
         allocate (self%g(strip_lanes, s, n, self%nstrip), source=0.0_wp)
         allocate (self%q(strip_lanes, self%nrow + 2), self%f(strip_lanes, self%nrow, s), source=0.0_wp)
         allocate (self%k(strip_lanes, 0:1, self%nrow, s), source=0.0_wp)
         allocate (self%factor(strip_lanes, s, s, n), self%rhs(strip_lanes, s, n))
         call new_site_above(self%above, s)
         if (self%gives_rows) return
         allocate (self%force(self%nlane, n, s), self%stiffness(self%nlane, 0:1, n, s))
      end associate
   end subroutine new_stage_rows

   !> The slopes of the group's stages in lanes where they are wanted. Lanes that are not solved stay wanted.
   subroutine solve(self, equations, group, outcome, wanted)
      class(stage_rows), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      integer(i8), intent(in) :: outcome(self%nlane)   !! where the iteration before has left it
      logical, intent(inout) :: wanted(self%nlane)
      integer(i8) :: failures
      integer :: strip

      self%status = -1
      self%status(:self%nlane) = merge(0_i8, -1_i8, wanted)
      call take_lanes(self, equations, group, outcome)
      self%c = group%inverse/equations%step%h
      self%hb = equations%step%h*transpose(group%b)
      failures = equations%ham%counters%failures
      call self%newton%start(self%status)
      do while (self%newton%running)
         if (.not. self%gives_rows) call evaluate_lanes(self, equations, group)
         do strip = 1, self%nstrip
            call correct_strip(self, equations, group, strip)
         end do
         associate (c => equations%ham%counters)
            c%gradients = c%gradients + self%s*self%newton%nrunning
            c%hessians = c%hessians + self%s*self%newton%nrunning
            call self%newton%judge(self%status, c)
         end associate
      end do
      equations%ham%counters%failures = failures  ! the other way counts what fails
      wanted = wanted .and. self%status(:self%nlane) /= 0
      call give_slopes(self, equations, group)
   end subroutine solve

   !> Weights, bases and first slopes of all strips. Lanes that fill up the last one stay zero, and rest.
   subroutine take_lanes(self, equations, group, outcome)
      type(stage_rows), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      integer(i8), intent(in) :: outcome(self%nlane)
      integer :: m, strip, i, before, until

      do m = 1, self%s
         call equations%place_known(group, m)
         do strip = 1, self%nstrip
            call find_strip(self, strip, before, until)
            do i = 1, self%n
               self%base(:until, i, m, strip) = equations%qs(before + 1:before + until, i)
               self%g(:until, m, i, strip) = merge(equations%g(before + 1:before + until, i, group%stage(m)), 0.0_wp, &
                                                   outcome(before + 1:before + until) == slow)
            end do
            self%w(:until, :, strip) = equations%store%w(before + 1:before + until, :, 0)
         end do
      end do
      if (.not. any(outcome == stiff)) return
      do strip = 1, self%nstrip
         call find_strip(self, strip, before, until)
         call stand_still(self, equations, group, strip, before, until, outcome(before + 1:before + until))
      end do
   end subroutine take_lanes

   !> The slopes of Q = q_n in stiff lanes.
   subroutine stand_still(self, equations, group, strip, before, until, outcome)
      type(stage_rows), intent(inout) :: self
      type(stage_equations), intent(in) :: equations
      type(stage_group), intent(in) :: group
      integer, intent(in) :: strip, before, until
      integer(i8), intent(in) :: outcome(until)
      real(wp) :: g(strip_lanes)
      integer :: i, m, k

      do i = 1, self%n
         do m = 1, self%s
            g = 0
            do k = 1, self%s
               g(:until) = g(:until) + group%inverse(m, k)/equations%step%h* &
                           (equations%q(before + 1:before + until, i) - self%base(:until, i, k, strip))
            end do
            self%g(:until, m, i, strip) = merge(g(:until), self%g(:until, m, i, strip), outcome == stiff)
         end do
      end do
   end subroutine stand_still

   !> The lanes before a strip, and how many it has.
   pure subroutine find_strip(self, strip, before, until)
      type(stage_rows), intent(in) :: self
      integer, intent(in) :: strip
      integer, intent(out) :: before, until

      before = (strip - 1)*strip_lanes
      until = min(strip_lanes, self%nlane - before)
   end subroutine find_strip

   !> Force and stiffness of all lanes, from a model that is better called for many at once.
   subroutine evaluate_lanes(self, equations, group)
      type(stage_rows), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      integer :: m, strip, before, until

      associate (e => equations, ham => equations%ham)
         do m = 1, self%s
            do strip = 1, self%nstrip
               call place(self%s, self%n, self%hb(:, m), self%base(:, 1:self%n, m, strip), &
                          self%g(:, :, :, strip), self%q)
               call find_strip(self, strip, before, until)
               e%qs(before + 1:before + until, :) = self%q(:until, :self%n)
            end do
            call ham%model%force_stiffness(self%nlane, self%n, ham%nnoise, 1, e%time_of(group%stage(m)), &
                                           e%store%w(:, :, 0), e%qs, e%p, self%force(:, :, m), &
                                           self%stiffness(:, :, :, m))
         end do
      end associate
   end subroutine evaluate_lanes

   !> One correction of a strip.
   subroutine correct_strip(self, equations, group, strip)
      type(stage_rows), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      integer, intent(in) :: strip
      real(wp) :: trusted(strip_lanes)
      integer :: first, last, before, lane

      before = (strip - 1)*strip_lanes
      associate (newton => self%newton, s => self%s, n => self%n, g => self%g(:, :, :, strip), h => equations%step%h)
         if (.not. any(newton%last(before + 1:before + strip_lanes) >= 0)) return
         call self%above%start()
         self%above_one = before_first_row
         do first = 1, n, self%nrow
            last = min(first + self%nrow - 1, n)
            call linearise(self, equations, group, strip, first, last)
            if (s > 1) then
               call eliminate_down_blocks(s, n, first, last, self%nrow, self%c, g, self%f, self%k, self%above, &
                                          self%factor, self%rhs)
            else
               call eliminate_down_strip(last - first + 1, h*group%b(1, 1), .false., g(1, 1, first), self%f, self%k, &
                                         self%above_one, self%factor(1, 1, 1, first), self%rhs(1, 1, first))
            end if
         end do
         trusted = merge(self%above%trusted, self%above_one(:, 4), s > 1)
         do lane = 1, strip_lanes
            if (trusted(lane) <= 0 .and. newton%last(before + lane) >= 0) &
               call newton%fail(before + lane, int(singular, i8), self%status, equations%ham%counters)
         end do
         if (s > 1) then
            call correct_up_blocks(s, n, self%c, self%factor, self%rhs, newton%last(before + 1), g, &
                                   newton%step(before + 1), newton%size(before + 1))
         else
            call correct_up_strip(n, .false., self%factor, self%rhs, newton%last(before + 1), g, &
                                  newton%step(before + 1), newton%size(before + 1))
         end if
      end associate
   end subroutine correct_strip

   !> Force and stiffness of a strip in sites first .. last.
   subroutine linearise(self, equations, group, strip, first, last)
      type(stage_rows), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      integer, intent(in) :: strip, first, last
      integer :: m, i, low, high, before, until

      do m = 1, self%s
         if (self%gives_rows) then
            low = max(first - 1, 1)
            high = min(last + 1, self%n)
            self%q(:, 1) = 0
            call place(self%s, high - low + 1, self%hb(:, m), self%base(1, low, m, strip), self%g(1, 1, low, strip), &
                       self%q(1, low - first + 2))
            if (last == self%n) self%q(:, last - first + 3) = 0
            call equations%ham%model%chain_rows(self%n, equations%ham%nnoise, first, last, &
                                                equations%time_of(group%stage(m)), self%w(1, 0, strip), &
                                                self%q, self%f(1, 1, m), self%k(1, 0, 1, m))
         else
            call find_strip(self, strip, before, until)
            do i = first, last
               self%f(:until, i - first + 1, m) = self%force(before + 1:before + until, i, m)
               self%k(:until, :, i - first + 1, m) = self%stiffness(before + 1:before + until, :, i, m)
            end do
         end if
         if (last == self%n) self%k(:, 1, last - first + 1, m) = 0
      end do
   end subroutine linearise

   !> Slopes back to the lanes that are solved.
   subroutine give_slopes(self, equations, group)
      type(stage_rows), intent(in) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      integer :: strip, m, i, before, until

      do strip = 1, self%nstrip
         call find_strip(self, strip, before, until)
         do m = 1, self%s
            associate (g => equations%g(before + 1:before + until, :, group%stage(m)))
               do i = 1, self%n
                  g(:, i) = merge(self%g(:until, m, i, strip), g(:, i), self%status(before + 1:before + until) == 0)
               end do
            end associate
         end do
      end do
   end subroutine give_slopes

   ! ---- kernels ----------------------------------------------------------------------------------

   !> Q of some sites.
   pure subroutine place(s, n, hb, base, g, q)
      integer, intent(in) :: s, n
      real(wp), intent(in) :: hb(s), base(strip_lanes, n), g(strip_lanes, s, n)
      real(wp), intent(out) :: q(strip_lanes, n)
      integer :: i, k, lane

      do i = 1, n
         !GCC$ unroll 16
         do lane = 1, strip_lanes
            q(lane, i) = base(lane, i) + hb(1)*g(lane, 1, i)
         end do
      end do
      do k = 2, s
         do i = 1, n
            !GCC$ unroll 16
            do lane = 1, strip_lanes
               q(lane, i) = q(lane, i) + hb(k)*g(lane, k, i)
            end do
         end do
      end do
   end subroutine place

end module symsde_step_stage_rows
