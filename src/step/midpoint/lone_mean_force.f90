! SPDX-License-Identifier: BSD-3-Clause
!> The step of step/midpoint/mean_force for a path by itself: two unknowns by Newton's iteration, in numbers; more by
!> the iteration of step/midpoint/dense. What takes long is left to step/midpoint/mean_force.
module symsde_step_midpoint_lone_mean_force
   use symsde_base_kinds, only: wp
   use symsde_solve_stagnation, only: stopping_test, verdict_of
   use symsde_step_lone, only: lone_stepper
   use symsde_step_midpoint_equation, only: correction_of, position
   use symsde_step_hamiltonian_noise_shift, only: noise_shift
   use symsde_solve_fixed_point, only: take_alone, sweep_verdict, most_sweeps, stiff_rate, done
   implicit none
   private
   public :: lone_mean_force

   type, extends(lone_stepper) :: lone_mean_force
      logical :: iterates = .false.   !! without matrices
      real(wp) :: too_stiff = stiff_rate  !! contraction from which a step is not mild
      type(stopping_test) :: test
      integer :: max_iter = 0
      real(wp), allocatable :: node(:), weight(:)  !! s_j, w_j
      type(noise_shift) :: shift                   !! of one lane
      real(wp), allocatable, private :: v(:)       !! weights h, 0 (0:m)
      real(wp), allocatable, dimension(:), private :: start, kick, psi, at, hq, f, still  !! (n)
   contains
      procedure :: take
   end type lone_mean_force

contains

   subroutine take(self, t, h, w, q, p, dq, dp, taken)
      class(lone_mean_force), intent(inout) :: self
      real(wp), intent(in) :: t, h, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: dq(self%n), dp(self%n)
      logical, intent(out) :: taken
      integer :: i

      if (.not. allocated(self%v)) call make_room(self)
      self%start = q
      self%kick = 0
      call self%shift%weigh(1.0_wp, 0.0_wp, self%step)
      call self%shift%add(self%model, t + 0.5_wp*h, 1.0_wp, self%start, self%kick)
      self%v(0) = h
      if (self%iterates) then
         call iterate(self, t + 0.5_wp*h, h, p, dp, taken)
      else
         call solve_two(self, t + 0.5_wp*h, h, q, p, dp, taken)
      end if
      if (taken) self%counters%gradients = self%counters%gradients + self%shift%asked
      self%shift%asked = 0
      if (.not. taken) return  ! there are no increments to compute with
      !GCC$ novector  ! few numbers
      do i = 1, self%n
         dq(i) = h*(p(i) + dp(i))
         dp(i) = 2*dp(i) - self%kick(i)
      end do
   end subroutine take

   subroutine make_room(self)
      type(lone_mean_force), intent(inout) :: self

      associate (n => self%n)
         allocate (self%v(0:self%m), self%still(n), source=0.0_wp)
         allocate (self%start(n), self%kick(n), self%psi(n), self%at(n), self%hq(n), self%f(n))
      end associate
   end subroutine make_room

   !> X + f(p + X) = 0 by Newton's iteration from X = 0.
   subroutine solve_two(self, t, h, q, p, x, taken)
      type(lone_mean_force), intent(inout) :: self
      real(wp), intent(in) :: t, h, q(2), p(2)
      real(wp), intent(out) :: x(2)
      logical, intent(out) :: taken
      real(wp) :: f1, f2, k11, k21, k12, k22, x1, x2, d1, d2, last, change, extent
      integer :: iteration

      x1 = 0
      x2 = 0
      last = 0
      taken = .false.
      do iteration = 1, self%max_iter
         call find_mean(self, t, h, q, p(1) + x1, p(2) + x2, f1, f2, k11, k21, k12, k22)
         call correction_of(0.25_wp*h, f1, f2, k11, k21, k12, k22, x1, x2, d1, d2)
         x1 = x1 - d1
         x2 = x2 - d2
         change = max(abs(d1), abs(d2)) + 0*(d1 + d2)  ! NaN stays
         extent = max(abs(x1), abs(x2))
         if (.not. change + extent <= huge(h)) return
         last = verdict_of(self%test, change, extent, last)
         taken = last < 0
         if (taken) exit
      end do
      if (.not. taken) return
      x(1) = x1
      x(2) = x2
      associate (c => self%counters, evaluations => iteration*size(self%node))
         c%gradients = c%gradients + evaluations
         c%hessians = c%hessians + evaluations
         c%iterations = c%iterations + iteration
         c%solves = c%solves + iteration
      end associate
   end subroutine solve_two

   !> f and K of two unknowns.
   subroutine find_mean(self, t, h, q, psi1, psi2, f1, f2, k11, k21, k12, k22)
      type(lone_mean_force), intent(in) :: self
      real(wp), intent(in) :: t, h, q(2)
      real(wp), value :: psi1, psi2
      real(wp), intent(out) :: f1, f2, k11, k21, k12, k22
      real(wp) :: g1, g2, l11, l21, l12, l22, c, share
      integer :: j

      f1 = -self%kick(1)
      f2 = -self%kick(2)
      k11 = 0
      k21 = 0
      k12 = 0
      k22 = 0
      do j = 1, size(self%node)
         c = self%node(j)*h
         call self%model%pair(self%m, t, self%v, q(1) + c*psi1, q(2) + c*psi2, g1, g2, l11, l21, l12, l22)
         f1 = f1 + 0.5_wp*self%weight(j)*g1
         f2 = f2 + 0.5_wp*self%weight(j)*g2
         share = 2*self%weight(j)*self%node(j)
         k11 = k11 + share*l11
         k21 = k21 + share*l21
         k12 = k12 + share*l12
         k22 = k22 + share*l22
      end do
   end subroutine find_mean

   !> X = -f(p + X), again and again.
   subroutine iterate(self, t, h, p, x, taken)
      type(lone_mean_force), intent(inout) :: self
      real(wp), intent(in) :: t, h, p(self%n)
      real(wp), intent(out) :: x(self%n)
      logical, intent(out) :: taken
      real(wp) :: change, extent, last
      integer :: i, j, sweep

      last = 0
      sweep = 0
      x = 0
      associate (n => self%n, f => self%f, hq => self%hq)
         do while (last >= 0 .and. sweep < most_sweeps)
            sweep = sweep + 1
            do i = 1, n
               self%psi(i) = p(i) + x(i)
               f(i) = -self%kick(i)
            end do
            do j = 1, size(self%node)
               call position(n, self%node(j)*h, self%start, self%psi, self%at)
               call self%model%gradient(1, n, self%m, t, self%v, self%at, self%still, hq=hq)
               do i = 1, n
                  f(i) = f(i) + 0.5_wp*self%weight(j)*hq(i)
               end do
            end do
            change = 0
            extent = 0
            call take_alone(n, .false., f, x, change, extent)
            last = sweep_verdict(sweep, self%too_stiff, self%too_stiff, change, extent, last)
         end do
      end associate
      taken = abs(last - done) <= 0
      if (.not. taken) return
      self%counters%gradients = self%counters%gradients + sweep*size(self%node)
      self%counters%iterations = self%counters%iterations + sweep
   end subroutine iterate

end module symsde_step_midpoint_lone_mean_force
