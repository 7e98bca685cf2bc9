! SPDX-License-Identifier: BSD-3-Clause
!> The equations for a stationary discrete action [WHSB] (46) between two given positions. All internal momenta and
!> velocities are unknowns.
!>
!>    S = sum_m [ p_{m+1}.(q_{m+1} - q_m)
!>                + sum_i alpha_i ((P_i - p_{m+1}).V_i - Hhat(P_i, q_m + sum_j a_ij V_j)) ]
!>
!> over the steps m = 0 .. N-1, with q_0 and q_N given. Derivatives of S, in the order of the unknowns of a step:
!>
!>    V_j       alpha_j (P_j - p_{m+1}) - sum_i alpha_i a_ij Hhat_q(P_i,Q_i)
!>    P_i       alpha_i (V_i - Hhat_p(P_i,Q_i))
!>    p_{m+1}   q_{m+1} - q_m - sum_i alpha_i V_i
!>    q_{m+1}   p_{m+1} - p_{m+2} - sum_i alpha_i Hhat_q(P_i,Q_i) of step m+1          (47), (55)-(56)
!>
!> With Hhat_qq, Hhat_qp, Hhat_pp at (P_i, Q_i) and Q_i = q_m + sum_j a_ij V_j the second derivatives are
!>
!>    V_j V_k   -sum_i alpha_i a_ij a_ik Hhat_qq         V_j P_i   alpha_i delta_ij - alpha_i a_ij Hhat_qp
!>    P_i P_i   -alpha_i Hhat_pp                         V_j p_{m+1}   -alpha_j
!>    q_m: as V_j with 1 in place of a_ij                p_{m+1} q_{m+1}   1,     p_{m+1} q_m   -1
!>
!> Nothing is divided by a second derivative of Hhat, so steps with a singular second derivative do no harm. The matrix
!> is the symmetric banded Hessian of S. Only a, alpha and c of the scheme enter (diagnose/lagrangian).
module symsde_diagnose_action_system
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, out_of_memory
   use symsde_base_text, only: to_text
   use symsde_diagnose_lagrangian, only: discrete_lagrangian
   implicit none
   private
   public :: action_system, new_action_system

   !> The system for a block of paths; the unknowns of a path are contiguous: V_1, P_1, .., V_r, P_r, p_{m+1}, q_{m+1}.
   type :: action_system
      type(discrete_lagrangian) :: lagrangian
      integer :: nlane = 0, ndof = 0, nstep = 0
      integer :: length = 0          !! unknowns of a step, 2 ndof (r+1)
      integer :: nunknown = 0        !! unknowns of a path, nstep*length - ndof, as q_N is given
      integer :: width = 0           !! sub- and superdiagonals of the matrix
      real(wp) :: t0 = 0, h = 0      !! time of step 0, step [time]
      real(wp), allocatable :: w(:, :, :)             !! weights h, dW_1 .. dW_m (nlane, 0:nnoise, nstep)
      real(wp), allocatable :: q_start(:, :), q_end(:, :)  !! (nlane, ndof)
      real(wp), allocatable :: x(:, :)                !! unknowns (nunknown, nlane)
      real(wp), allocatable :: r(:, :)                !! derivatives of S (nunknown, nlane)
      real(wp), allocatable :: band(:, :)             !! matrix of one path (3 width+1, nunknown)
      real(wp), allocatable, private :: v(:, :)       !! weights of one stage (nlane, 0:nnoise)
      real(wp), allocatable, private, dimension(:, :) :: qs, ps, hq, hp  !! vectors of one stage (nlane, ndof)
      real(wp), allocatable, private, dimension(:, :, :, :, :) :: hqq, hqp, hpp
      !! Hessians of all stages (nlane, ndof, ndof, r, nstep)
   contains
      procedure :: differentiate
      procedure :: fill_matrix
      procedure :: first_momentum
      procedure :: position
      procedure :: stage_at
      procedure :: momentum_at
   end type action_system

contains

   !> Allocate the system for the paths of the Lagrangian's lanes over nstep steps. Errors: out_of_memory.
   subroutine new_action_system(self, lagrangian, nstep, t0, h, error)
      type(action_system), intent(out) :: self
      type(discrete_lagrangian), intent(in) :: lagrangian
      integer, intent(in) :: nstep
      real(wp), intent(in) :: t0, h   !! time of the first step, step [time]
      type(error_type), allocatable, intent(inout) :: error
      integer :: n, r, info

      ! Take a, alpha, c, Hhat and its part at each stage from the Lagrangian.
      self%lagrangian = lagrangian
      n = lagrangian%ham%ndof
      r = lagrangian%nstage
      self%nlane = lagrangian%ham%nlane
      self%ndof = n
      self%nstep = nstep
      self%length = 2*n*(r + 1)
      self%nunknown = nstep*self%length - n
      ! The unknowns of step m are coupled with q_m, the last ndof unknowns of the step before: from q_m to p_{m+1}
      ! there are as many unknowns as in one step.
      self%width = self%length - 1
      self%t0 = t0
      self%h = h
      associate (l => self%nlane, m => lagrangian%ham%nnoise)
         allocate (self%w(l, 0:m, nstep), self%v(l, 0:m), self%q_start(l, n), self%q_end(l, n), &
                   self%qs(l, n), self%ps(l, n), self%hq(l, n), self%hp(l, n), &
                   self%x(self%nunknown, l), self%r(self%nunknown, l), &
                   self%band(3*self%width + 1, self%nunknown), self%hqq(l, n, n, r, nstep), &
                   self%hqp(l, n, n, r, nstep), self%hpp(l, n, n, r, nstep), stat=info)
      end associate
      if (info /= 0) call raise(error, out_of_memory, 'new_action_system', 'no memory for the equations of '// &
                                to_text(nstep)//' steps: give fewer steps')
   end subroutine new_action_system

   !> Position before the first component of V_i (P_i follows) of a step, from 1.
   pure integer function stage_at(self, step, i)
      class(action_system), intent(in) :: self
      integer, intent(in) :: step, i

      stage_at = (step - 1)*self%length + 2*self%ndof*(i - 1)
   end function stage_at

   !> Position before the first component of p at the end of a step; q follows.
   pure integer function momentum_at(self, step)
      class(action_system), intent(in) :: self
      integer, intent(in) :: step

      momentum_at = step*self%length - 2*self%ndof
   end function momentum_at

   !> q at the end of a step, or at the start for step 0, in one lane.
   pure function position(self, step, lane) result(q)
      class(action_system), intent(in) :: self
      integer, intent(in) :: step, lane
      real(wp) :: q(self%ndof)

      ! q_0 and q_N are given; the other positions are the last ndof unknowns of their steps.
      if (step == 0) then
         q = self%q_start(lane, :)
      else if (step == self%nstep) then
         q = self%q_end(lane, :)
      else
         q = self%x(step*self%length - self%ndof + 1:step*self%length, lane)
      end if
   end function position

   !> Derivatives of S at x, and the Hessians of all stages, for every lane.
   subroutine differentiate(self)
      class(action_system), intent(inout) :: self
      integer :: step, i, lane

      self%r = 0
      do step = 1, self%nstep
         do i = 1, self%lagrangian%nstage
            call stage_point(self, step, i)
            call weights_of(self, step, i)
            associate (lag => self%lagrangian)
               call lag%ham%gradient_hessian(self%t0 + (step - 1 + lag%c(i))*self%h, self%v, self%qs, &
                                             self%ps, self%hq, self%hp, self%hqq(:, :, :, i, step), &
                                             self%hqp(:, :, :, i, step), self%hpp(:, :, :, i, step))
            end associate
            do lane = 1, self%nlane
               call add_stage(self, step, i, lane)
            end do
         end do
         do lane = 1, self%nlane
            call add_ends(self, step, lane)
         end do
      end do
   end subroutine differentiate

   !> (Q_i, P_i) of a step in all lanes.
   subroutine stage_point(self, step, i)
      type(action_system), intent(inout) :: self
      integer, intent(in) :: step, i
      real(wp) :: q(self%ndof)
      integer :: j, lane, at

      associate (n => self%ndof)
         do lane = 1, self%nlane
            ! Q_i = q_m + sum_j a_ij V_j,   P_i is an unknown
            q = self%position(step - 1, lane)
            do j = 1, self%lagrangian%nstage
               at = self%stage_at(step, j)
               q = q + self%lagrangian%a(i, j)*self%x(at + 1:at + n, lane)
            end do
            self%qs(lane, :) = q
            at = self%stage_at(step, i) + n
            self%ps(lane, :) = self%x(at + 1:at + n, lane)
         end do
      end associate
   end subroutine stage_point

   !> The weights at a stage: all weights; or, if noise has its own stages, (h, 0, ..) or (0, dW).
   subroutine weights_of(self, step, i)
      type(action_system), intent(inout) :: self
      integer, intent(in) :: step, i

      self%v = self%w(:, :, step)
      if (all(self%lagrangian%part == 1)) return
      if (self%lagrangian%part(i) == 1) then
         self%v(:, 1:) = 0
      else
         self%v(:, 0) = 0
      end if
   end subroutine weights_of

   !> Add the terms of the gradient at stage i of a step.
   subroutine add_stage(self, step, i, lane)
      type(action_system), intent(inout) :: self
      integer, intent(in) :: step, i, lane
      integer :: j, v, p, e

      ! v, p and e are the positions before V_i, P_i and p_{m+1}; q_{m+1} follows n positions after p_{m+1}.
      associate (n => self%ndof, lag => self%lagrangian, x => self%x, r => self%r)
         v = self%stage_at(step, i)
         p = v + n
         e = self%momentum_at(step)
         r(v + 1:v + n, lane) = r(v + 1:v + n, lane) &
                                + lag%alpha(i)*(x(p + 1:p + n, lane) - x(e + 1:e + n, lane))
         !   P_i: alpha_i (V_i - Hhat_p)
         r(p + 1:p + n, lane) = lag%alpha(i)*(x(v + 1:v + n, lane) - self%hp(lane, :))
         !   p_{m+1}: -alpha_i V_i
         r(e + 1:e + n, lane) = r(e + 1:e + n, lane) - lag%alpha(i)*x(v + 1:v + n, lane)
         do j = 1, lag%nstage
            v = self%stage_at(step, j)
            r(v + 1:v + n, lane) = r(v + 1:v + n, lane) - lag%alpha(i)*lag%a(i, j)*self%hq(lane, :)
         end do
         !   q_m, which is an unknown of the step before: -alpha_i Hhat_q
         e = e - self%length + n
         if (step > 1) r(e + 1:e + n, lane) = r(e + 1:e + n, lane) - lag%alpha(i)*self%hq(lane, :)
      end associate
   end subroutine add_stage

   !> Add the terms of p_{m+1}.(q_{m+1} - q_m).
   subroutine add_ends(self, step, lane)
      type(action_system), intent(inout) :: self
      integer, intent(in) :: step, lane
      real(wp) :: from(self%ndof), to(self%ndof)
      integer :: e, last

      associate (n => self%ndof, x => self%x, r => self%r)
         e = self%momentum_at(step)
         !   p_{m+1}: q_{m+1} - q_m
         from = self%position(step - 1, lane)
         to = self%position(step, lane)
         r(e + 1:e + n, lane) = r(e + 1:e + n, lane) + (to - from)
         ! derivative by q_{m+1}: p_{m+1}, unless q_{m+1} is the given q_N
         if (step < self%nstep) &
            r(e + n + 1:e + 2*n, lane) = r(e + n + 1:e + 2*n, lane) + x(e + 1:e + n, lane)
         ! derivative by q_m: -p_{m+1}, unless q_m is the given q_0
         last = e - self%length + n
         if (step > 1) r(last + 1:last + n, lane) = r(last + 1:last + n, lane) - x(e + 1:e + n, lane)
      end associate
   end subroutine add_ends

   !> p_0 = p_1 + sum_i alpha_i Hhat_q(P_i,Q_i) of the first step (53), in all lanes.
   subroutine first_momentum(self, p)
      class(action_system), intent(inout) :: self
      real(wp), intent(out) :: p(self%nlane, self%ndof)
      integer :: i, at

      at = self%momentum_at(1)
      ! p_0 is no unknown: compute it from the solved stages. It is the momentum with which the scheme itself starts
      ! along the path.
      p = transpose(self%x(at + 1:at + self%ndof, :))
      do i = 1, self%lagrangian%nstage
         call stage_point(self, 1, i)
         call weights_of(self, 1, i)
         associate (lag => self%lagrangian)
            call lag%ham%gradient(self%t0 + lag%c(i)*self%h, self%v, self%qs, self%ps, hq=self%hq)
            p = p + lag%alpha(i)*self%hq
         end associate
      end do
   end subroutine first_momentum

   !> The Hessian of S in one lane at the last differentiated point, A(i,j) at band(2 width+1+i-j, j). Derivatives of a
   !> correction in Hhat are left out.
   subroutine fill_matrix(self, lane)
      class(action_system), intent(inout) :: self
      integer, intent(in) :: lane
      integer :: step, i, k, e

      ! Enter each pair of unknowns twice: the solver with row exchanges needs the whole band. The first `width` rows of
      ! the band receive the entries that exchanges add.
      self%band = 0
      do step = 1, self%nstep
         e = self%momentum_at(step)
         do k = 1, self%ndof
            ! The bilinear terms p_{m+1}.(q_{m+1} - q_m) and alpha_i (P_i - p_{m+1}).V_i have constant second
            ! derivatives.
            if (step < self%nstep) call add_pair(self, e + k, e + self%ndof + k, 1.0_wp)
            if (step > 1) call add_pair(self, e + k, e - self%length + self%ndof + k, -1.0_wp)
            do i = 1, self%lagrangian%nstage
               associate (v => self%stage_at(step, i), alpha => self%lagrangian%alpha(i))
                  !   V_i P_i: alpha_i,   V_i p_{m+1}: -alpha_i
                  call add_pair(self, v + k, v + self%ndof + k, alpha)
                  call add_pair(self, v + k, e + k, -alpha)
               end associate
            end do
         end do
         do i = 1, self%lagrangian%nstage
            call add_stage_hessian(self, step, i, lane)
         end do
      end do
   end subroutine fill_matrix

   !> Add -alpha_i Hess Hhat(P_i,Q_i), transformed to the unknowns by Q_i = q_m + sum_j a_ij V_j.
   subroutine add_stage_hessian(self, step, i, lane)
      type(action_system), intent(inout) :: self
      integer, intent(in) :: step, i, lane
      integer :: at(0:self%lagrangian%nstage), j, jj, k, l, p
      real(wp) :: c(0:self%lagrangian%nstage)

      associate (lag => self%lagrangian, n => self%ndof)
         at(0) = (step - 1)*self%length - n   ! q_m, with factor 1 in Q_i
         ! q_0 is no unknown and has no row in the matrix.
         c(0) = merge(1.0_wp, 0.0_wp, step > 1)
         do j = 1, lag%nstage
            at(j) = self%stage_at(step, j)
            c(j) = lag%a(i, j)
         end do
         ! Q_i is a sum of q_m and the V_j with factors c: derivatives with respect to Q_i are entered, times these
         ! factors, at q_m and all V_j. hqp(k, l) is the derivative in q_k and p_l.
         p = at(i) + n
         do l = 1, n
            do k = 1, n
               !   P_i P_i: -alpha_i Hhat_pp;   below, with c: -alpha_i c_j Hhat_qp and -alpha_i c_j c_k Hhat_qq
               call add_entry(self, p + k, p + l, -lag%alpha(i)*self%hpp(lane, k, l, i, step))
               do j = 0, lag%nstage
                  if (abs(c(j)) <= 0) cycle
                  call add_pair(self, at(j) + k, p + l, -lag%alpha(i)*c(j)*self%hqp(lane, k, l, i, step))
                  do jj = 0, lag%nstage
                     if (abs(c(jj)) <= 0) cycle
                     call add_entry(self, at(j) + k, at(jj) + l, &
                                    -lag%alpha(i)*c(j)*c(jj)*self%hqq(lane, k, l, i, step))
                  end do
               end do
            end do
         end do
      end associate
   end subroutine add_stage_hessian

   !> A(i,j) = A(i,j) + value
   pure subroutine add_entry(self, i, j, value)
      type(action_system), intent(inout) :: self
      integer, intent(in) :: i, j
      real(wp), intent(in) :: value

      self%band(2*self%width + 1 + i - j, j) = self%band(2*self%width + 1 + i - j, j) + value
   end subroutine add_entry

   !> Add a value to A(i,j) and A(j,i).
   pure subroutine add_pair(self, i, j, value)
      type(action_system), intent(inout) :: self
      integer, intent(in) :: i, j
      real(wp), intent(in) :: value

      call add_entry(self, i, j, value)
      call add_entry(self, j, i, value)
   end subroutine add_pair

end module symsde_diagnose_action_system
