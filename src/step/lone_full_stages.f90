! SPDX-License-Identifier: BSD-3-Clause
!> Implicit stages for a path by itself, where the momenta stay unknown and the step is mild: the fixed-point iteration
!> of step/stage_iteration, with the sums of step/stage_equations. What does not converge by it is left to step/stages.
module symsde_step_lone_full_stages
   use symsde_base_kinds, only: wp
   use symsde_step_lone, only: lone_stepper
   use symsde_step_slopes, only: add_slopes, slope_sum, find_sum, add_sum, take_slopes
   use symsde_step_stage_iteration, only: sweep_verdict, most_sweeps, done
   use symsde_step_stage_plan, only: stage_plan, stage_group
   implicit none
   private
   public :: lone_full_stages

   !> What a point of a stage is put together from.
   type :: point_sums
      type(slope_sum) :: b, a, abar
   end type point_sums

   type, extends(lone_stepper) :: lone_full_stages
      type(stage_plan) :: plan
      real(wp) :: too_stiff = 0          !! contraction from which a step is left
      logical :: identity_mass = .false.
      type(point_sums), allocatable, private :: sums(:, :)  !! of the first sweep, and of the others (nstage, 2)
      real(wp), private :: h = 0                            !! for which they are
      !> What Q_i has without slopes; G_i and -C_i (n, nstage).
      real(wp), allocatable, dimension(:, :), private :: base, g, c
      real(wp), allocatable, dimension(:), private :: x, y, f, v, start  !! (n)
   contains
      procedure :: take
   end type lone_full_stages

contains

   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(lone_full_stages), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      real(wp) :: kappa
      integer :: i, k, sweeps, evaluations

      if (.not. allocated(self%g)) call make_room(self)
      kappa = merge(h, 0.0_wp, self%identity_mass)
      if (abs(h - self%h) > 0) call find_sums(self, h, kappa)
      sweeps = 0
      evaluations = 0
      taken = .true.
      associate (plan => self%plan, n => self%n, s => self%plan%nstage, start => self%start)
         do i = 1, s
            call add_slopes(n, 1, kappa, plan%r(i:i), p, q, self%base(:, i))
         end do
         do k = 1, plan%ngroup
            call iterate(self, plan%group(k), t, h, kappa, w, p, sweeps, evaluations, taken)
            if (.not. taken) return
         end do
         start = kappa*sum(plan%alpha)*p
         call add_slopes(n, s, kappa, plan%v, self%g, start, self%x)
         call add_slopes(n, s, -1.0_wp, plan%alpha, self%c, self%x, dq)
         start = 0
         call add_slopes(n, s, 1.0_wp, plan%alpha, self%g, start, dp)
      end associate
      self%counters%gradients = self%counters%gradients + evaluations
      self%counters%iterations = self%counters%iterations + sweeps
   end subroutine take

   subroutine make_room(self)
      type(lone_full_stages), intent(inout) :: self

      associate (n => self%n, s => self%plan%nstage)
         allocate (self%base(n, s), self%g(n, s), self%c(n, s), self%sums(s, 2))
         allocate (self%x(n), self%y(n), self%f(n), self%v(n), self%start(n))
      end associate
   end subroutine make_room

   subroutine find_sums(self, h, kappa)
      type(lone_full_stages), intent(inout) :: self
      real(wp), intent(in) :: h, kappa
      integer :: i

      self%h = h
      associate (plan => self%plan, s => self%plan%nstage)
         do i = 1, s
            call find(self%sums(i, 1), plan%first_b(:, i), plan%first_a(:, i), plan%first_abar(:, i))
            call find(self%sums(i, 2), plan%b(:, i), plan%a(:, i), plan%abar(:, i))
         end do
      end associate

   contains

      subroutine find(sums, b, a, abar)
         type(point_sums), intent(out) :: sums
         real(wp), intent(in), dimension(self%plan%nstage) :: b, a, abar

         if (self%identity_mass) call find_sum(self%plan%nstage, kappa, b, sums%b)
         call find_sum(self%plan%nstage, -1.0_wp, a, sums%a)
         call find_sum(self%plan%nstage, 1.0_wp, abar, sums%abar)
      end subroutine find

   end subroutine find_sums

   !> The slopes of a group.
   subroutine iterate(self, group, t, h, kappa, w, p, sweeps, evaluations, taken)
      type(lone_full_stages), intent(inout) :: self
      type(stage_group), intent(in) :: group
      real(wp), intent(in) :: t, h, kappa, w(0:self%m), p(self%n)
      integer, intent(inout) :: sweeps, evaluations
      logical, intent(out) :: taken
      real(wp) :: change, extent, last
      integer :: sweep, k, i

      last = 0
      sweep = 0
      do while (last >= 0 .and. sweep < most_sweeps)
         sweep = sweep + 1
         change = 0
         extent = 0
         do k = 1, group%nmember
            i = group%stage(k)
            if (sweep == 1) then
               call place(self, i, self%sums(i, 1), kappa, self%plan%first_b(:, i), self%plan%first_a(:, i), &
                          self%plan%first_abar(:, i), p)
            else
               call place(self, i, self%sums(i, 2), kappa, self%plan%b(:, i), self%plan%a(:, i), &
                          self%plan%abar(:, i), p)
            end if
            associate (n => self%n, f => self%f, v => self%v)
               call self%model%gradient(1, n, self%m, t + self%plan%c(i)*h, w, self%x, self%y, hq=f, hp=v)
               if (self%identity_mass) v = v - kappa*self%y
               call take_slopes(n, sweep == 1, f, self%g(:, i), change, extent)
               call take_slopes(n, sweep == 1, v, self%c(:, i), change, extent)
            end associate
         end do
         if (group%explicit) exit
         last = sweep_verdict(sweep, self%too_stiff, self%too_stiff, change, extent, last)
      end do
      sweeps = sweeps + sweep
      evaluations = evaluations + sweep*group%nmember
      taken = abs(last - done) <= 0 .or. group%explicit
   end subroutine iterate

   !> (Q_i, P_i) in x and y.
   subroutine place(self, i, sums, kappa, b, a, abar, p)
      type(lone_full_stages), intent(inout) :: self
      integer, intent(in) :: i
      type(point_sums), intent(in) :: sums
      real(wp), intent(in) :: kappa, p(self%n)
      real(wp), intent(in), dimension(self%plan%nstage) :: b, a, abar  !! coefficients of the sums

      associate (n => self%n, s => self%plan%nstage)
         if (self%identity_mass) then
            call add(n, s, sums%b, kappa, b, self%g, self%base(:, i), self%y)
            call add(n, s, sums%a, -1.0_wp, a, self%c, self%y, self%x)
         else
            call add(n, s, sums%a, -1.0_wp, a, self%c, self%base(:, i), self%x)
         end if
         call add(n, s, sums%abar, 1.0_wp, abar, self%g, p, self%y)
      end associate
   end subroutine place

   !> start + factor sum_j coefficient_j slope_j
   pure subroutine add(n, nstage, found, factor, coefficient, slope, start, total)
      integer, intent(in) :: n, nstage
      type(slope_sum), intent(in) :: found
      real(wp), intent(in) :: factor, coefficient(nstage), slope(n, nstage), start(n)
      real(wp), intent(out) :: total(n)

      if (found%m <= 3) then
         call add_sum(n, nstage, found, slope, start, total)
      else
         call add_slopes(n, nstage, factor, coefficient, slope, start, total)
      end if
   end subroutine add

end module symsde_step_lone_full_stages
