! SPDX-License-Identifier: BSD-3-Clause
!> Any partitioned tableau, implicit or not, by its stage equations. With F_i = Hhat_p and G_i = -Hhat_q at (Q_i, P_i),
!> and decays of damped momenta (scheme/decays),
!>
!>    Q_i = q + sum_j a_ij F_j        P_i = e_i p + sum_j abar_ij e_ij G_j
!>    q'  = q + sum_j alpha_j F_j     p'  = E p + sum_j alpha_j d_j G_j
!>
!> the covectors m_j of F_j, n_j of G_j, and (x_j, y_j) of (Q_j, P_j) satisfy
!>
!>    m_j = alpha_j u + sum_i a_ij x_i            x_j = Hhat_qp m_j - Hhat_qq n_j
!>    n_j = alpha_j d_j c + sum_i abar_ij e_ij y_i    y_j = Hhat_pp m_j - Hhat_pq n_j
!>
!> one linear system for all x_j, y_j, whose matrix is the transpose of Newton's; then u <- u + sum x_j,
!> c <- E c + sum e_j y_j, and u_theta <- u_theta + sum_j (Hhat_{theta p} m_j - Hhat_{theta q} n_j). If noise and drift
!> have different coefficients, each part has slopes of its own, as in the general stepper, and x_j, y_j are their sums.
!>
!> Tangent vectors take Newton's own matrix: with X_i = dQ_i, Y_i = dP_i,
!>
!>    X_i = dq + sum_j a_ij f_j,           f_j = Hhat_pq X_j + Hhat_pp Y_j + Hhat_{p theta} dtheta
!>    Y_i = e_i dp + sum_j abar_ij e_ij g_j,   g_j = -(Hhat_qq X_j + Hhat_qp Y_j + Hhat_{q theta} dtheta)
!>
!> The point of a single stage follows from the increments of the step, unless damping is so strong that p' holds few
!> digits of G; otherwise, and with several stages, they are found again by the general stepper.
!>
!> Private to its family.
module symsde_step_linear_tableau
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_model_abstract, only: model_type
   use symsde_scheme_decays, only: tableau_decays, new_decays
   use symsde_scheme_scheme, only: correction_none
   use symsde_solve_blocks, only: block_solver, new_block_solver
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_linear_linear_step, only: linear_step
   use symsde_step_oracle_general, only: general_stepper, new_general_stepper
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: tableau_step, new_tableau_step

   type, extends(linear_step) :: tableau_step
      private
      integer :: nstage = 0, npart = 1       !! one part, or two: drift and noise
      real(wp), allocatable :: c(:)          !! nodes (nstage)
      real(wp), allocatable :: a(:, :, :), abar(:, :, :), alpha(:, :)  !! (.., npart)
      type(tableau_decays) :: decays
      class(general_stepper), allocatable :: stages  !! finds slopes; its model is the path's own
      type(block_solver) :: solver
      real(wp), allocatable :: w(:, :, :)    !! weights of each part (nlane, 0:nnoise, npart)
      real(wp), allocatable :: slope(:, :, :, :)  !! F and G (nlane, 2 ndof, nstage, npart)
      real(wp), allocatable, dimension(:, :, :, :, :) :: hqq, hqp, hpp   !! (nlane, nwide, nwide, nstage, npart)
      real(wp), allocatable :: hpq(:, :, :, :, :)   !! Hhat_qp - Fhat_p^T (nlane, ndof, ndof, nstage, npart)
      real(wp), allocatable :: matrix(:, :, :), x(:, :)   !! system: (nlane, m, m), (nlane, m), m = 2 ndof nstage
      real(wp), allocatable :: transposed(:, :, :)   !! the matrix for tangent vectors (nlane, m, m)
      real(wp), allocatable, dimension(:, :) :: dq, dp, mq, mp   !! (nlane, ndof)
      real(wp), allocatable :: by_rate(:, :, :)  !! of P_i and p', by their decays (nlane, nstage + 1, ndof)
   contains
      procedure :: back
      procedure :: forth
   end type tableau_step

contains

   !> Make the transposed step of a task in tableau form for blocks of nlane lanes. The model of the path is `model`, or
   !> a view of it that knows the paths of the lanes.
   subroutine new_tableau_step(self, task, model, wide, nlane)
      type(tableau_step), intent(out) :: self
      type(stepper_task), intent(in) :: task
      class(model_type), intent(in), target :: model, wide
      integer, intent(in) :: nlane
      integer :: n, s, m, np

      n = model%traits%ndof
      s = task%scheme%nstage
      m = 2*n*s
      self%nlane = nlane
      self%ndof = n
      self%nwide = wide%traits%ndof
      self%nstage = s
      self%npart = merge(1, 2, task%scheme%noise_coefficients_equal() .or. model%traits%nnoise == 0)
      np = self%npart
      self%c = task%scheme%c
      allocate (self%a(s, s, np), self%abar(s, s, np), self%alpha(s, np))
      self%a(:, :, 1) = task%scheme%a
      self%abar(:, :, 1) = task%scheme%abar
      self%alpha(:, 1) = task%scheme%alpha
      if (np == 2) then
         self%a(:, :, 2) = task%scheme%b
         self%abar(:, :, 2) = task%scheme%bbar
         self%alpha(:, 2) = task%scheme%beta
      end if
      call new_decays(self%decays, task%damping, task%scheme%c, n)
      call new_one_step_hamiltonian(self%ham, wide, nlane, correction_none, 0.0_wp)
      if (s > 1 .or. np > 1 .or. task%damping%acts()) then
         allocate (self%stages)
         call new_general_stepper(self%stages, model, task%scheme, correction_none, nlane, task%newton, task%damping)
      end if
      call new_block_solver(self%solver, nlane, m, -1, 0)
      allocate (self%w(nlane, 0:wide%traits%nnoise, np), source=0.0_wp)
      allocate (self%slope(nlane, 2*n, s, np))
      associate (k => self%nwide)
         allocate (self%hqq(nlane, k, k, s, np), self%hqp(nlane, k, k, s, np), self%hpp(nlane, k, k, s, np))
         allocate (self%hpq(nlane, n, n, s, np))
      end associate
      allocate (self%matrix(nlane, m, m), self%x(nlane, m))
      allocate (self%dq(nlane, n), self%dp(nlane, n), self%mq(nlane, n), self%mp(nlane, n))
   end subroutine new_tableau_step

   subroutine back(self, step, q0, p0, q1, p1, u, c, status)
      class(tableau_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q0(self%nlane, self%ndof), p0(self%nlane, self%ndof)
      real(wp), intent(in) :: q1(self%nlane, self%ndof), p1(self%nlane, self%ndof)
      real(wp), intent(inout) :: u(self%nlane, self%nrow), c(self%nlane, self%ndof)
      integer(i8), intent(inout) :: status(self%nlane)
      logical :: active(self%nlane)
      integer :: j, k, l, part

      call linearise(self, step, q0, p0, q1, p1, status)
      if (self%nrow > self%nwide) call find_changes(self, step%h, p0)
      call set_up(self)
      call load_covectors(self, u, c)
      active = status == 0
      call self%solver%solve(self%matrix, self%x, active, status)
      ! the rows of the parameters, with u and c from behind the step
      do j = 1, self%nstage
         do part = 1, self%npart
            call slope_covectors(self, j, part, u, c)
            do l = 1, self%ndof
               do k = self%ndof + 1, self%nwide
                  u(:, k) = u(:, k) + self%hqp(:, k, l, j, part)*self%mq(:, l) - &
                            self%hqq(:, l, k, j, part)*self%mp(:, l)
               end do
            end do
         end do
      end do
      if (self%nrow > self%nwide) call add_rates(self, u, c)
      associate (n => self%ndof)
         do l = 1, n
            c(:, l) = (1 + self%decays%loss(l))*c(:, l)
            do j = 1, self%nstage
               u(:, l) = u(:, l) + self%x(:, 2*n*(j - 1) + l)
               c(:, l) = c(:, l) + self%decays%begin(j, l)*self%x(:, 2*n*(j - 1) + n + l)
            end do
         end do
      end associate
   end subroutine back

   !> Derivatives of the momenta of stages, and of the step's last, by the rates in their decays, with F and G as they
   !> are.
   subroutine find_changes(self, h, p0)
      type(tableau_step), intent(inout) :: self
      real(wp), intent(in) :: h
      real(wp), intent(in) :: p0(self%nlane, self%ndof)
      real(wp) :: a
      integer :: i, j, k, part

      if (.not. allocated(self%by_rate)) allocate (self%by_rate(self%nlane, self%nstage + 1, self%ndof))
      associate (x => self%by_rate, e => self%decays, c => self%c, s => self%nstage)
         do k = 1, self%ndof
            x(:, s + 1, k) = -h*(1 + e%loss(k))*p0(:, k)
            do i = 1, s
               x(:, i, k) = -c(i)*h*e%begin(i, k)*p0(:, k)
            end do
            do part = 1, self%npart
               do j = 1, s
                  do i = 1, s + 1
                     if (i <= s) then
                        a = -(c(i) - c(j))*h*e%between(i, j, k)*self%abar(i, j, part)
                     else
                        a = -(1 - c(j))*h*e%finish(j, k)*self%alpha(j, part)
                     end if
                     x(:, i, k) = x(:, i, k) + a*self%slope(:, self%ndof + k, j, part)
                  end do
               end do
            end do
         end do
      end associate
   end subroutine find_changes

   !> The covectors of the rates, from c behind the step and those of the stages' momenta.
   subroutine add_rates(self, u, c)
      type(tableau_step), intent(inout) :: self
      real(wp), intent(inout) :: u(self%nlane, self%nrow)
      real(wp), intent(in) :: c(self%nlane, self%ndof)
      integer :: j, k, row

      do k = 1, self%ndof
         row = self%nwide + k
         u(:, row) = u(:, row) + c(:, k)*self%by_rate(:, self%nstage + 1, k)
         do j = 1, self%nstage
            u(:, row) = u(:, row) + self%x(:, 2*self%ndof*(j - 1) + self%ndof + k)*self%by_rate(:, j, k)
         end do
      end do
   end subroutine add_rates

   !> Hessians at all stages, of every part.
   subroutine linearise(self, step, q0, p0, q1, p1, status)
      type(tableau_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q0(self%nlane, self%ndof), p0(self%nlane, self%ndof)
      real(wp), intent(in) :: q1(self%nlane, self%ndof), p1(self%nlane, self%ndof)
      integer(i8), intent(inout) :: status(self%nlane)
      integer :: j, k, l, part

      call self%decays%set_step(step%h)
      self%w(:, :, 1) = step%w
      if (self%npart == 2) then
         self%w(:, 1:, 1) = 0
         self%w(:, 1:, 2) = step%w(:, 1:)
      end if
      call find_slopes(self, step, q0, p0, q1, p1, status)
      do j = 1, self%nstage
         call load_stage(self, j, q0, p0)
         do part = 1, self%npart
            ! of forces Fhat_q is subtracted from Hhat_qq, whose first index is then that of the force
            call self%ham%gradient_hessian(step%t + self%c(j)*step%h, self%w(:, :, part), self%q, self%p, &
                                           hqq=self%hqq(:, :, :, j, part), hqp=self%hqp(:, :, :, j, part), &
                                           hpp=self%hpp(:, :, :, j, part))
            do k = 1, self%ndof
               do l = 1, self%ndof
                  self%hpq(:, l, k, j, part) = self%hqp(:, l, k, j, part)
                  if (self%ham%forced) self%hpq(:, l, k, j, part) = self%hpq(:, l, k, j, part) - self%ham%drag(:, l, k)
               end do
            end do
         end do
      end do
   end subroutine linearise

   subroutine forth(self, step, q0, p0, q1, p1, m, vq, vp, status)
      class(tableau_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q0(self%nlane, self%ndof), p0(self%nlane, self%ndof)
      real(wp), intent(in) :: q1(self%nlane, self%ndof), p1(self%nlane, self%ndof)
      integer, intent(in) :: m
      real(wp), intent(inout) :: vq(self%nlane, self%nrow, m), vp(self%nlane, self%ndof, m)
      integer(i8), intent(inout) :: status(self%nlane)
      logical :: active(self%nlane)
      integer :: j, column, part, at

      call linearise(self, step, q0, p0, q1, p1, status)
      if (self%nrow > self%nwide) call find_changes(self, step%h, p0)
      call set_up(self)
      if (.not. allocated(self%transposed)) allocate (self%transposed, mold=self%matrix)
      do j = 1, size(self%matrix, 2)
         self%transposed(:, :, j) = self%matrix(:, j, :)
      end do
      associate (n => self%ndof, decays => self%decays)
         do column = 1, m
            call load_tangents(self, vq(:, :, column), vp(:, :, column))
            active = status == 0
            call self%solver%solve(self%transposed, self%x, active, status)
            do j = 1, n
               vp(:, j, column) = (1 + decays%loss(j))*vp(:, j, column)
               if (self%nrow > self%nwide) vp(:, j, column) = vp(:, j, column) + vq(:, self%nwide + j, column)* &
                                                              self%by_rate(:, self%nstage + 1, j)
            end do
            ! Slopes of all stages; the sums of stages contain dq from before the step.
            do part = 1, self%npart
               do j = 1, self%nstage
                  call slope_tangents(self, j, part, vq(:, :, column))
                  do at = 1, n
                     self%slope(:, at, j, part) = self%mq(:, at)
                     self%slope(:, n + at, j, part) = self%mp(:, at)
                  end do
               end do
            end do
            do part = 1, self%npart
               do j = 1, self%nstage
                  do at = 1, n
                     vq(:, at, column) = vq(:, at, column) + self%alpha(j, part)*self%slope(:, at, j, part)
                     vp(:, at, column) = vp(:, at, column) + self%alpha(j, part)*decays%finish(j, at) &
                                         *self%slope(:, n + at, j, part)
                  end do
               end do
            end do
         end do
      end associate
   end subroutine forth

   !> Right-hand sides of X_i, Y_i: dq and e_i dp, with the parameters' part of the slopes.
   subroutine load_tangents(self, vq, vp)
      type(tableau_step), intent(inout) :: self
      real(wp), intent(in) :: vq(self%nlane, self%nrow), vp(self%nlane, self%ndof)
      integer :: i, j, k, l, part, at

      associate (n => self%ndof)
         do i = 1, self%nstage
            at = 2*n*(i - 1)
            do k = 1, n
               self%x(:, at + k) = vq(:, k)
               self%x(:, at + n + k) = self%decays%begin(i, k)*vp(:, k)
               if (self%nrow > self%nwide) self%x(:, at + n + k) = self%x(:, at + n + k) + &
                                                                   vq(:, self%nwide + k)*self%by_rate(:, i, k)
               do part = 1, self%npart
                  do j = 1, self%nstage
                     do l = n + 1, self%nwide
                        self%x(:, at + k) = self%x(:, at + k) + self%a(i, j, part)*self%hqp(:, l, k, j, part)*vq(:, l)
                        self%x(:, at + n + k) = self%x(:, at + n + k) - self%abar(i, j, part)* &
                                                self%decays%between(i, j, k)*self%hqq(:, k, l, j, part)*vq(:, l)
                     end do
                  end do
               end do
            end do
         end do
      end associate
   end subroutine load_tangents

   !> f_j and g_j of stage j, in mq and mp, from the solution X, Y.
   subroutine slope_tangents(self, j, part, vq)
      type(tableau_step), intent(inout) :: self
      integer, intent(in) :: j, part
      real(wp), intent(in) :: vq(self%nlane, self%nrow)
      integer :: k, l, at

      associate (n => self%ndof)
         at = 2*n*(j - 1)
         do k = 1, n
            self%mq(:, k) = 0
            self%mp(:, k) = 0
            do l = 1, n
               self%mq(:, k) = self%mq(:, k) + self%hqp(:, l, k, j, part)*self%x(:, at + l) + &
                               self%hpp(:, k, l, j, part)*self%x(:, at + n + l)
               self%mp(:, k) = self%mp(:, k) - self%hqq(:, k, l, j, part)*self%x(:, at + l) - &
                               self%hpq(:, k, l, j, part)*self%x(:, at + n + l)
            end do
            do l = n + 1, self%nwide
               self%mq(:, k) = self%mq(:, k) + self%hqp(:, l, k, j, part)*vq(:, l)
               self%mp(:, k) = self%mp(:, k) - self%hqq(:, k, l, j, part)*vq(:, l)
            end do
         end do
      end associate
   end subroutine slope_tangents

   !> F_j and G_j of all stages: from the increments if there is one slope of each and p' holds most of its digits, else
   !> by the general stepper.
   subroutine find_slopes(self, step, q0, p0, q1, p1, status)
      type(tableau_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q0(self%nlane, self%ndof), p0(self%nlane, self%ndof)
      real(wp), intent(in) :: q1(self%nlane, self%ndof), p1(self%nlane, self%ndof)
      integer(i8), intent(inout) :: status(self%nlane)
      real(wp), parameter :: small = 1e-3_wp
      integer :: j, l, part, at

      associate (n => self%ndof, slope => self%slope)
         if (self%nstage == 1 .and. self%npart == 1 .and. all(self%decays%finish > small)) then
            do l = 1, n
               slope(:, l, 1, 1) = (q1(:, l) - q0(:, l))/self%alpha(1, 1)
               slope(:, n + l, 1, 1) = (p1(:, l) - p0(:, l) - self%decays%loss(l)*p0(:, l))/ &
                                       (self%alpha(1, 1)*self%decays%finish(1, l))
            end do
            return
         end if
         call self%stages%increment(step, q0, p0, self%dq, self%dp, status)
         do part = 1, self%npart
            do j = 1, self%nstage
               at = 2*n*((part - 1)*self%nstage + j - 1)
               slope(:, :, j, part) = self%stages%x(:, at + 1:at + 2*n)
            end do
         end do
      end associate
   end subroutine find_slopes

   !> The point of stage i.
   subroutine load_stage(self, i, q0, p0)
      type(tableau_step), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: q0(self%nlane, self%ndof), p0(self%nlane, self%ndof)
      integer :: j, k, part

      associate (n => self%ndof)
         do k = 1, n
            self%q(:, k) = q0(:, k)
            self%p(:, k) = self%decays%begin(i, k)*p0(:, k)
            do part = 1, self%npart
               do j = 1, self%nstage
                  self%q(:, k) = self%q(:, k) + self%a(i, j, part)*self%slope(:, k, j, part)
                  self%p(:, k) = self%p(:, k) + self%abar(i, j, part)*self%decays%between(i, j, k) &
                                 *self%slope(:, n + k, j, part)
               end do
            end do
         end do
      end associate
   end subroutine load_stage

   !> Matrix of the system for x_j, y_j.
   subroutine set_up(self)
      type(tableau_step), intent(inout) :: self
      real(wp) :: am, an
      integer :: i, j, k, l, n, part, row, column

      n = self%ndof
      self%matrix = 0
      do row = 1, size(self%x, 2)
         self%matrix(:, row, row) = 1
      end do
      do part = 1, self%npart
         do j = 1, self%nstage
            row = 2*n*(j - 1)
            do l = 1, n
               do i = 1, self%nstage
                  column = 2*n*(i - 1)
                  am = self%a(i, j, part)
                  an = self%abar(i, j, part)*self%decays%between(i, j, l)
                  do k = 1, n
                     associate (qq => self%hqq(:, l, k, j, part), qp => self%hqp(:, k, l, j, part), &
                                pq => self%hpq(:, l, k, j, part), pp => self%hpp(:, k, l, j, part), &
                                a => self%matrix)
                        a(:, row + k, column + l) = a(:, row + k, column + l) - am*qp
                        a(:, row + k, column + n + l) = a(:, row + k, column + n + l) + an*qq
                        a(:, row + n + k, column + l) = a(:, row + n + k, column + l) - am*pp
                        a(:, row + n + k, column + n + l) = a(:, row + n + k, column + n + l) + an*pq
                     end associate
                  end do
               end do
            end do
         end do
      end do
   end subroutine set_up

   !> Right-hand sides of x_j, y_j.
   subroutine load_covectors(self, u, c)
      type(tableau_step), intent(inout) :: self
      real(wp), intent(in) :: u(self%nlane, self%nrow), c(self%nlane, self%ndof)
      real(wp) :: am, an
      integer :: j, k, l, n, part, row

      n = self%ndof
      self%x = 0
      do part = 1, self%npart
         do j = 1, self%nstage
            row = 2*n*(j - 1)
            am = self%alpha(j, part)
            do l = 1, n
               an = am*self%decays%finish(j, l)
               do k = 1, n
                  associate (qq => self%hqq(:, l, k, j, part), qp => self%hqp(:, k, l, j, part), &
                             pq => self%hpq(:, l, k, j, part), pp => self%hpp(:, k, l, j, part))
                     self%x(:, row + k) = self%x(:, row + k) + am*qp*u(:, l) - an*qq*c(:, l)
                     self%x(:, row + n + k) = self%x(:, row + n + k) + am*pp*u(:, l) - an*pq*c(:, l)
                  end associate
               end do
            end do
         end do
      end do
   end subroutine load_covectors

   !> The covectors m_j and n_j of the slopes of stage j, in mq and mp.
   subroutine slope_covectors(self, j, part, u, c)
      type(tableau_step), intent(inout) :: self
      integer, intent(in) :: j, part
      real(wp), intent(in) :: u(self%nlane, self%nrow), c(self%nlane, self%ndof)
      integer :: i, l, at

      associate (n => self%ndof)
         do l = 1, n
            self%mq(:, l) = self%alpha(j, part)*u(:, l)
            self%mp(:, l) = self%alpha(j, part)*self%decays%finish(j, l)*c(:, l)
            do i = 1, self%nstage
               at = 2*n*(i - 1)
               self%mq(:, l) = self%mq(:, l) + self%a(i, j, part)*self%x(:, at + l)
               self%mp(:, l) = self%mp(:, l) + self%abar(i, j, part)*self%decays%between(i, j, l)*self%x(:, at + n + l)
            end do
         end do
      end associate
   end subroutine slope_covectors

end module symsde_step_linear_tableau
