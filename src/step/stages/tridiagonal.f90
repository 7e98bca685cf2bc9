! SPDX-License-Identifier: BSD-3-Clause
!> Newton's iteration for a group of stages of a chain, whose momenta are eliminated and whose Hessian is tridiagonal.
!>
!> Unknown are the slopes of a strip of lanes, where the group has a nonsingular matrix B:
!>
!>    G_m + Hhat_q(base_m + h sum_k B_mk G_k) = 0       base_m: q_n and what Q_m has of p_n and of known slopes
!>
!> The correction of Q solves (B^{-1}/h (x) I + Hhat_qq) d = G + Hhat_q, where what is beside the diagonal blocks is
!> diagonal, and that of G is B^{-1} d/h (solve/block_tridiagonal; one stage alone: solve/tridiagonal). Force and
!> stiffness of a panel of sites are eliminated as they come, as in step/midpoint/tridiagonal.
!>
!> Where B_mk = e_m f_k is singular, the sum z = sum_k f_k G_k alone is unknown, by the equations of one stage:
!>
!>    z + sum_m f_m Hhat_q(base_m + h e_m z) = 0,       with the matrix I + h sum_m f_m e_m Hhat_qq(Q_m)
!>
!> and the slopes follow from one more evaluation.
!>
!> Mild lanes begin with the slopes that fixed-point iteration has found, linear equations with zero, stiff lanes with
!> the slopes of Q = q_n: from there on the iterates are those of the general stepper from slopes zero. A lane that
!> fails here, or whose pivots say that its matrix might not be eliminated in this order, is left to the caller, who
!> has another way.
!>
!> Private to its family.
module symsde_step_stages_tridiagonal
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: singular
   use symsde_base_traits, only: model_traits, strip_lanes
   use symsde_solve_block_tridiagonal, only: eliminate_down_blocks, correct_up_blocks, site_above, new_site_above
   use symsde_solve_newton, only: newton_type, newton_options, new_newton
   use symsde_solve_tridiagonal, only: upper_rows, eliminate_down_strip, eliminate_up_strip, meet_strip, &
                                       correct_strip, before_first_row, nfront
   use symsde_step_stages_equations, only: stage_equations
   use symsde_step_stages_fixed_point, only: slow, stiff
   use symsde_step_stages_groups, only: stage_group
   implicit none
   private
   public :: tridiagonal_stages, new_tridiagonal_stages, fits_tridiagonal_stages, solves_at_once

   integer, parameter :: panel = 16          !! sites asked of the model at once
   integer, parameter :: most_stages = 3     !! of a group
   integer, parameter :: most_iterations = 30

   integer, parameter :: fewest_rows = 4  !! chains that are shorter are taken as dense systems

   type :: tridiagonal_stages
      private
      type(newton_type) :: newton
      integer(i8), allocatable :: status(:)     !! (newton%nlane)
      integer :: s = 0, n = 0                   !! unknowns of a site, sites
      integer :: nstage = 0                     !! stages: as many as unknowns, or more where they are summed
      integer :: nlane = 0, nstrip = 0          !! lanes of the part, strips that hold them
      logical :: gives_rows = .false.
      integer :: nrow = 0                       !! sites of a panel
      logical :: sums = .false.                 !! sum_k f_k G_k is unknown
      real(wp) :: h_one = 0                     !! what one unknown's stiffness is multiplied by
      real(wp), allocatable :: c(:, :)          !! B^{-1}/h, or what takes a displacement to z (s, nstage)
      real(wp), allocatable :: hb(:, :)         !! h B, or h e, of a stage in a column (s, nstage)
      real(wp), allocatable :: w(:, :, :)       !! weights (strip_lanes, 0:m, nstrip)
      real(wp), allocatable :: base(:, :, :, :) !! sites 0 and n+1 are zero (strip_lanes, 0:n+1, nstage, nstrip)
      real(wp), allocatable :: g(:, :, :, :)    !! slopes, or z (strip_lanes, s, n, nstrip)
      real(wp), allocatable :: q(:, :)          !! Q of a panel and its neighbours (strip_lanes, nrow+3)
      real(wp), allocatable :: f(:, :, :)       !! force, of one stage from 0 (strip_lanes, nrow, nstage)
      real(wp), allocatable :: k(:, :, :, :)    !! stiffness, from there too (strip_lanes, 0:1, nrow, nstage)
      real(wp), allocatable :: force(:, :, :), stiffness(:, :, :, :)  !! of all lanes, where the model gives no rows
      real(wp), allocatable :: factor(:, :, :, :), rhs(:, :, :)  !! (strip_lanes, s, s, n), (strip_lanes, s, n)
      type(site_above) :: above                 !! several stages
      real(wp) :: fronts(strip_lanes, nfront, 2) = 0  !! of one unknown a site
   contains
      procedure :: solve
   end type tridiagonal_stages

contains

   !> Whether this way serves a group of stages; momenta must be eliminated.
   pure logical function fits_tridiagonal_stages(traits, group)
      type(model_traits), intent(in) :: traits
      type(stage_group), intent(in) :: group

      fits_tridiagonal_stages = traits%bandwidth == 1 .and. traits%ndof >= fewest_rows .and. &
                                group%nmember <= most_stages .and. (allocated(group%inverse) .or. allocated(group%e))
   end function fits_tridiagonal_stages

   !> Whether the equations are linear and their matrix exact: one solve from slopes zero finds the root.
   pure logical function solves_at_once(traits)
      type(model_traits), intent(in) :: traits

      solves_at_once = traits%quadratic .and. (traits%has_chain_rows .or. traits%has_hessian_vector)
   end function solves_at_once

   !> A solver for one group of stages.
   subroutine new_tridiagonal_stages(self, equations, group, options)
      type(tridiagonal_stages), intent(out) :: self
      type(stage_equations), intent(in) :: equations
      type(stage_group), intent(in) :: group
      type(newton_options), intent(in) :: options
      type(newton_options) :: bounded

      bounded = options
      bounded%max_iter = min(options%max_iter, most_iterations)
      associate (t => equations%ham%model%traits, n => equations%ham%ndof, m => equations%ham%nnoise, &
                 s => self%s, r => self%nstage)
         self%sums = allocated(group%e)
         self%nstage = group%nmember
         self%s = merge(1, self%nstage, self%sums)
         self%n = n
         self%nlane = equations%ham%nlane
         self%nstrip = (self%nlane + strip_lanes - 1)/strip_lanes
         self%gives_rows = t%has_chain_rows
         self%nrow = merge(min(panel, n), n, self%gives_rows)
         call new_newton(self%newton, self%nstrip*strip_lanes, n*s, bounded, solves_at_once(t), -1, -1, &
                         judge_only=.true., exact=t%has_chain_rows .or. t%has_hessian_vector)
         allocate (self%status(self%newton%nlane))
         allocate (self%c(s, r), self%hb(s, r))
         allocate (self%w(strip_lanes, 0:m, self%nstrip), source=0.0_wp)
         allocate (self%base(strip_lanes, 0:n + 1, r, self%nstrip), source=0.0_wp)
         allocate (self%g(strip_lanes, s, n, self%nstrip), source=0.0_wp)
         allocate (self%q(strip_lanes, self%nrow + 3), source=0.0_wp)
         allocate (self%f(strip_lanes, merge(0, 1, s == 1):self%nrow, r), source=0.0_wp)
         allocate (self%k(strip_lanes, 0:1, merge(0, 1, s == 1):self%nrow, r), source=0.0_wp)
         allocate (self%factor(strip_lanes, s, s, n), self%rhs(strip_lanes, s, n))
         call new_site_above(self%above, s)
         if (self%gives_rows) return
         allocate (self%force(self%nlane, n, r), self%stiffness(self%nlane, 0:1, n, r))
      end associate
   end subroutine new_tridiagonal_stages

   !> The slopes of the group's stages in lanes where they are wanted. Lanes that are not solved stay wanted.
   subroutine solve(self, equations, group, outcome, wanted)
      class(tridiagonal_stages), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      integer(i8), intent(in) :: outcome(self%nlane)   !! where the iteration before has left it
      logical, intent(inout) :: wanted(self%nlane)
      integer(i8) :: failures
      integer :: strip

      self%status = -1
      self%status(:self%nlane) = merge(0_i8, -1_i8, wanted)
      call find_coefficients(self, group, equations%step%h)
      call take_lanes(self, equations, group, outcome)
      failures = equations%ham%counters%failures
      call self%newton%start(self%status)
      do while (self%newton%running)
         if (.not. self%gives_rows) call evaluate_lanes(self, equations, group)
         do strip = 1, self%nstrip
            call correct_one(self, equations, group, strip)
         end do
         associate (c => equations%ham%counters)
            c%gradients = c%gradients + self%nstage*self%newton%nrunning
            c%hessians = c%hessians + self%nstage*self%newton%nrunning
            call self%newton%judge(self%status, c)
         end associate
      end do
      equations%ham%counters%failures = failures  ! the other way counts what fails
      wanted = wanted .and. self%status(:self%nlane) /= 0
      call give_slopes(self, equations, group)
   end subroutine solve

   !> What goes with the matrix of the group and this step.
   pure subroutine find_coefficients(self, group, h)
      type(tridiagonal_stages), intent(inout) :: self
      type(stage_group), intent(in) :: group
      real(wp), intent(in) :: h
      integer :: m

      if (self%sums) then
         m = maxloc(abs(group%e), 1)
         self%c = 0
         self%c(1, m) = 1/(h*group%e(m))
         self%hb(1, :) = h*group%e
         self%h_one = h
      else
         self%c = group%inverse/h
         self%hb = h*transpose(group%b)
         self%h_one = h*group%b(1, 1)
      end if
   end subroutine find_coefficients

   !> Weights, bases and first slopes of all strips. Lanes that fill up the last one stay zero, and rest.
   subroutine take_lanes(self, equations, group, outcome)
      type(tridiagonal_stages), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      integer(i8), intent(in) :: outcome(self%nlane)
      integer :: m, u, strip, i, before, until
      real(wp) :: by

      do m = 1, self%nstage
         u = merge(1, m, self%sums)
         by = 1
         if (self%sums) by = group%f(m)
         call equations%place_known(group, m)
         do strip = 1, self%nstrip
            call find_strip(self, strip, before, until)
            if (u == m) self%g(:, u, :, strip) = 0
            do i = 1, self%n
               self%base(:until, i, m, strip) = equations%qs(before + 1:before + until, i)
               associate (g => equations%g(before + 1:before + until, i, group%stage(m)))
                  self%g(:until, u, i, strip) = self%g(:until, u, i, strip) + &
                                                merge(by*g, 0.0_wp, outcome(before + 1:before + until) == slow)
               end associate
            end do
            self%w(:until, :, strip) = equations%store%w(before + 1:before + until, :, 0)
         end do
      end do
      if (.not. any(outcome == stiff)) return
      do strip = 1, self%nstrip
         call find_strip(self, strip, before, until)
         call stand_still(self, equations, strip, before, until, outcome(before + 1:before + until))
      end do
   end subroutine take_lanes

   !> The slopes of Q = q_n in stiff lanes.
   subroutine stand_still(self, equations, strip, before, until, outcome)
      type(tridiagonal_stages), intent(inout) :: self
      type(stage_equations), intent(in) :: equations
      integer, intent(in) :: strip, before, until
      integer(i8), intent(in) :: outcome(until)
      real(wp) :: g(strip_lanes)
      integer :: i, m, k

      do i = 1, self%n
         do m = 1, self%s
            g = 0
            do k = 1, self%nstage
               g(:until) = g(:until) + self%c(m, k)* &
                           (equations%q(before + 1:before + until, i) - self%base(:until, i, k, strip))
            end do
            self%g(:until, m, i, strip) = merge(g(:until), self%g(:until, m, i, strip), outcome == stiff)
         end do
      end do
   end subroutine stand_still

   !> The lanes before a strip, and how many it has.
   pure subroutine find_strip(self, strip, before, until)
      type(tridiagonal_stages), intent(in) :: self
      integer, intent(in) :: strip
      integer, intent(out) :: before, until

      before = (strip - 1)*strip_lanes
      until = min(strip_lanes, self%nlane - before)
   end subroutine find_strip

   !> Force and stiffness of all lanes, from a model that is better called for many at once.
   subroutine evaluate_lanes(self, equations, group)
      type(tridiagonal_stages), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      integer :: m, strip, before, until

      associate (e => equations, ham => equations%ham)
         do m = 1, self%nstage
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
   subroutine correct_one(self, equations, group, strip)
      type(tridiagonal_stages), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      integer, intent(in) :: strip
      real(wp) :: trusted(strip_lanes), meeting(strip_lanes, 2)
      integer :: first, last, before, lane

      before = (strip - 1)*strip_lanes
      associate (newton => self%newton, s => self%s, n => self%n, g => self%g(:, :, :, strip))
         if (.not. any(newton%last(before + 1:before + strip_lanes) >= 0)) return
         if (s > 1) then
            call self%above%start()
            do first = 1, n, self%nrow
               last = min(first + self%nrow - 1, n)
               call linearise(self, equations, group, strip, first, last, 1)
               call eliminate_down_blocks(s, n, first, last, self%nrow, self%c, g, self%f, self%k, self%above, &
                                          self%factor, self%rhs)
            end do
            trusted = self%above%trusted
         else
            call eliminate_fronts(self, equations, group, strip)
            call meet_strip(self%fronts(1, 1, 1), self%fronts(1, 1, 2), meeting, trusted)
         end if
         do lane = 1, strip_lanes
            if (trusted(lane) <= 0 .and. newton%last(before + lane) >= 0) &
               call newton%fail(before + lane, int(singular, i8), self%status, equations%ham%counters)
         end do
         if (s > 1) then
            call correct_up_blocks(s, n, self%c, self%factor, self%rhs, newton%last(before + 1), g, &
                                   newton%step(before + 1), newton%size(before + 1))
         else
            call correct_strip(n, meeting, self%factor, self%rhs, newton%last(before + 1), g, &
                               newton%step(before + 1), newton%size(before + 1))
         end if
      end associate
   end subroutine correct_one

   !> One unknown a site: the rows of a strip, from both ends.
   subroutine eliminate_fronts(self, equations, group, strip)
      type(tridiagonal_stages), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      integer, intent(in) :: strip
      integer :: first, h

      h = upper_rows(self%n)
      self%fronts = spread(before_first_row, 3, 2)
      associate (n => self%n, nrow => self%nrow)
         do first = 1, h, nrow
            call linearise(self, equations, group, strip, first, min(first + nrow - 1, h), 1)
            call eliminate_down_strip(min(nrow, h - first + 1), self%h_one, self%g(1, 1, first, strip), &
                                      self%f(1, 1, 1), self%k(1, 0, 0, 1), self%fronts(1, 1, 1), &
                                      self%factor(1, 1, 1, first), self%rhs(1, 1, first))
         end do
         do first = h + 1 + nrow*((n - h + nrow - 1)/nrow - 1), h + 1, -nrow
            call linearise(self, equations, group, strip, first - 1, min(first + nrow - 1, n), 0)
            call eliminate_up_strip(min(nrow, n - first + 1), self%h_one, self%g(1, 1, first, strip), &
                                    self%f(1, 1, 1), self%k(1, 0, 0, 1), self%fronts(1, 1, 2), &
                                    self%factor(1, 1, 1, first), self%rhs(1, 1, first))
         end do
      end associate
   end subroutine eliminate_fronts

   !> Force and stiffness of a strip in sites first .. last, from row `at` of the panel on.
   subroutine linearise(self, equations, group, strip, first, last, at)
      type(tridiagonal_stages), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      integer, intent(in) :: strip, first, last, at
      integer :: m, i, low, high, before, until

      do m = 1, self%nstage
         if (self%gives_rows) then
            low = max(first - 1, 1)
            high = min(last + 1, self%n)
            self%q(:, 1) = 0
            call place(self%s, high - low + 1, self%hb(:, m), self%base(1, low, m, strip), self%g(1, 1, low, strip), &
                       self%q(1, low - first + 2))
            if (last == self%n) self%q(:, last - first + 3) = 0
            call equations%ham%model%chain_rows(self%n, equations%ham%nnoise, first, last, &
                                                equations%time_of(group%stage(m)), self%w(1, 0, strip), &
                                                self%q, self%f(1, at, m), self%k(1, 0, at, m))
         else
            call find_strip(self, strip, before, until)
            do i = first, last
               self%f(:until, i - first + at, m) = self%force(before + 1:before + until, i, m)
               self%k(:until, :, i - first + at, m) = self%stiffness(before + 1:before + until, :, i, m)
            end do
         end if
         if (last == self%n) self%k(:, 1, last - first + at, m) = 0
      end do
      if (.not. self%sums) return
      call sum_up(size(self%f(:, :, 1)), self%nstage, group%f, self%f)
      call sum_up(size(self%k(:, :, :, 1)), self%nstage, group%f*group%e, self%k)
   end subroutine linearise

   !> Slopes back to the lanes that are solved.
   subroutine give_slopes(self, equations, group)
      type(tridiagonal_stages), intent(in) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      integer :: strip, m, i, before, until

      if (self%sums) then
         call find_slopes(self, equations, group)
         return
      end if
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

   !> The same where their sum was unknown.
   subroutine find_slopes(self, equations, group)
      type(tridiagonal_stages), intent(in) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      integer :: strip, m, i, before, until

      associate (e => equations)
         do m = 1, self%nstage
            do strip = 1, self%nstrip
               call find_strip(self, strip, before, until)
               do i = 1, self%n
                  e%qs(before + 1:before + until, i) = self%base(:until, i, m, strip) + &
                                                       self%hb(1, m)*self%g(:until, 1, i, strip)
               end do
            end do
            call e%evaluate(group%stage(m))
            do i = 1, self%n
               e%g(:, i, group%stage(m)) = merge(-e%hq(:, i), e%g(:, i, group%stage(m)), self%status(:self%nlane) == 0)
            end do
         end do
      end associate
   end subroutine find_slopes

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC The first column becomes the weighed sum of all.
   pure subroutine sum_up(n, nstage, by, x)
      integer, intent(in) :: n, nstage
      real(wp), intent(in) :: by(nstage)
      real(wp), intent(inout) :: x(n, nstage)
      integer :: i, m

      do i = 1, n
         x(i, 1) = by(1)*x(i, 1)
      end do
      do m = 2, nstage
         do i = 1, n
            x(i, 1) = x(i, 1) + by(m)*x(i, m)
         end do
      end do
   end subroutine sum_up

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

end module symsde_step_stages_tridiagonal
