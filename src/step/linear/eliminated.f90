! SPDX-License-Identifier: BSD-3-Clause
!> Tableaux, implicit or not, where H = p.p/2 + U(q) and noise is in position: momenta of stages are eliminated. With
!> G_l = -Hhat_q(Q_l), and E, e_i, .. the decays of damped momenta (scheme/decays), a step is
!>
!>    Q_i = q + k_i p + sum_l K_il G_l        k_i = h sum_j a_ij e_j     K_il = h sum_j a_ij abar_jl e_jl
!>    q'  = q + k p   + sum_l B_l G_l         k   = h sum_j alpha_j e_j  B_l  = h sum_j alpha_j abar_jl e_jl
!>    p'  = E p + sum_l A_l G_l               A_l = alpha_l d_l
!>
!> The covectors n_l of G_l and x_l of Q_l satisfy
!>
!>    n_l = A_l c + B_l u + sum_i K_il x_i,   x_l = -Hhat_qq n_l
!>
!> a linear system for all x_l; then c <- E c + k u + sum k_i x_i, u <- u + sum x_l, u_theta <- u_theta - sum_l
!> Hhat_{theta q} n_l. Coefficients depend on the rate gamma of their degree of freedom, and its covector is
!> g_gamma <- g_gamma + E' c p + (k' u + sum k_i' x_i) p + sum_l (A_l' c + B_l' u + sum_i K_il' x_i) G_l.
!>
!> Tangent vectors take the transposed matrix: X_i + sum_l K_il Hhat_qq X_l = dq + k_i dp - sum_l K_il Hhat_{q theta}
!> dtheta.
!>
!> If noise and drift have different coefficients, each part has its own A, B and K; the drift has k and k_i.
!>
!> One or two stages follow from the increments of the step; more are found again by the general stepper. Where
!> (B_1 k_1 - K_11 k) is zero, as for the midpoint rule, the stage follows from the positions alone.
!>
!> Private to its family.
module symsde_step_linear_eliminated
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_model_abstract, only: model_type
   use symsde_scheme_decays, only: tableau_decays, new_decays
   use symsde_scheme_scheme, only: correction_none
   use symsde_solve_blocks, only: block_solver, new_block_solver
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian, new_one_step_hamiltonian
   use symsde_step_linear_linear_step, only: linear_step
   use symsde_step_oracle_general, only: general_stepper, new_general_stepper
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: eliminated_step, eliminated_fits, new_eliminated_step

   !> How stages are found again.
   integer, parameter :: by_ends = 1, by_one = 2, by_two = 3, by_stepper = 4
   real(wp), parameter :: small = 1e-3_wp   !! below which factors lose digits

   !> Coefficients of a step, or their derivatives by the rate of each degree of freedom.
   type :: step_coefficients
      real(wp), allocatable :: stage_p(:, :)      !! k_i (nstage, ndof)
      real(wp), allocatable :: stage(:, :, :, :)  !! K_il, by l, .., i (nstage, npart, ndof, nstage)
      real(wp), allocatable :: last_p(:)          !! k (ndof)
      real(wp), allocatable :: last(:, :, :)      !! B_l (nstage, npart, ndof)
      real(wp), allocatable :: momentum(:, :, :)  !! A_l (nstage, npart, ndof)
      real(wp), allocatable :: loss(:)            !! E - 1 (ndof)
   end type step_coefficients

   type, extends(linear_step) :: eliminated_step
      private
      integer :: nstage = 0, npart = 1            !! one part, or two: drift and noise
      integer :: way = by_stepper                 !! how stages are found again
      real(wp) :: h = 0                           !! step of the coefficients
      real(wp), allocatable :: c(:)               !! nodes (nstage)
      real(wp), allocatable :: a(:, :), abar(:, :, :), alpha(:, :)   !! a is the drift's (.., npart)
      type(tableau_decays) :: decays
      type(step_coefficients) :: of, by_rate
      type(one_step_hamiltonian) :: own           !! Hamiltonian of the path's model
      class(general_stepper), allocatable :: stages
      type(block_solver) :: solver
      real(wp), allocatable :: w(:, :, :)         !! weights of each part (nlane, 0:nnoise, npart)
      real(wp), allocatable :: at(:, :, :)        !! Q_l (nlane, ndof, nstage)
      real(wp), allocatable :: slope(:, :, :, :)  !! G_l (nlane, ndof, nstage, npart)
      real(wp), allocatable :: hqq(:, :, :, :, :)   !! (nlane, ndof, ndof, nstage, npart)
      real(wp), allocatable :: matrix(:, :, :), transposed(:, :, :)        !! (nlane, m, m), m = ndof nstage
      real(wp), allocatable :: x(:, :)                                     !! (nlane, m)
      real(wp), allocatable, dimension(:, :) :: dq, dp, still              !! (nlane, ndof)
      real(wp), allocatable, dimension(:, :) :: vq, zero, uq, up           !! vectors and products (nlane, nwide)
   contains
      procedure :: back
      procedure :: forth
   end type eliminated_step

contains

   !> Whether the model has this form, for all values of parameters, without forces, and steps of length h lose no more
   !> than three digits by damping: K_il holds products of decays, some of which grow.
   logical function eliminated_fits(task, wide, h)
      type(stepper_task), intent(in) :: task
      class(model_type), intent(in) :: wide
      real(wp), intent(in) :: h

      eliminated_fits = .false.
      if (allocated(task%damping%rate)) then
         if (any(abs(task%damping%rate*h) > -log(small))) return
      end if
      associate (t => task%model%traits)
         eliminated_fits = task%is_plain() .and. t%identity_mass .and. (t%position_noise .or. t%nnoise == 0) .and. &
                           t%has_hessian .and. wide%traits%separable .and. &
                           .not. (t%forces%act() .or. wide%traits%forces%act())
      end associate
   end function eliminated_fits

   !> Make the linearised step for steps of length h and blocks of nlane lanes. The model of the path is `model`, or a
   !> view of it that knows the paths of the lanes.
   subroutine new_eliminated_step(self, task, model, wide, h, nlane)
      type(eliminated_step), intent(out) :: self
      type(stepper_task), intent(in) :: task
      class(model_type), intent(in), target :: model, wide
      real(wp), intent(in) :: h
      integer, intent(in) :: nlane
      integer :: n, s, np

      n = model%traits%ndof
      s = task%scheme%nstage
      self%nlane = nlane
      self%ndof = n
      self%nwide = wide%traits%ndof
      self%nstage = s
      self%npart = merge(1, 2, task%scheme%noise_coefficients_equal() .or. model%traits%nnoise == 0)
      np = self%npart
      self%c = task%scheme%c
      self%a = task%scheme%a
      allocate (self%abar(s, s, np), self%alpha(s, np))
      self%abar(:, :, 1) = task%scheme%abar
      self%alpha(:, 1) = task%scheme%alpha
      if (np == 2) then
         self%abar(:, :, 2) = task%scheme%bbar
         self%alpha(:, 2) = task%scheme%beta
      end if
      call new_decays(self%decays, task%damping, task%scheme%c, n)
      call make_room(self%of)
      call make_room(self%by_rate)
      call new_one_step_hamiltonian(self%ham, wide, nlane, correction_none, 0.0_wp)
      call new_one_step_hamiltonian(self%own, model, nlane, correction_none, 0.0_wp)
      call new_block_solver(self%solver, nlane, n*s, -1, 0)
      allocate (self%w(nlane, 0:wide%traits%nnoise, np), source=0.0_wp)
      allocate (self%at(nlane, n, s), self%slope(nlane, n, s, np), self%hqq(nlane, n, n, s, np))
      allocate (self%matrix(nlane, n*s, n*s), self%x(nlane, n*s))
      allocate (self%dq(nlane, n), self%dp(nlane, n), self%uq(nlane, self%nwide), self%up(nlane, self%nwide))
      allocate (self%still(nlane, n), self%vq(nlane, self%nwide), self%zero(nlane, self%nwide), source=0.0_wp)
      call set_step(self, h)
      self%way = way_of(self)
      self%by_position = self%way == by_ends
      if (self%way == by_stepper) then
         allocate (self%stages)
         call new_general_stepper(self%stages, model, task%scheme, correction_none, nlane, task%newton, task%damping)
      end if

   contains

      subroutine make_room(x)
         type(step_coefficients), intent(inout) :: x

         allocate (x%stage_p(s, n), x%stage(s, np, n, s), x%last_p(n), x%last(s, np, n), x%momentum(s, np, n), &
                   x%loss(n))
      end subroutine make_room

   end subroutine new_eliminated_step

   !> How stages are found again.
   pure integer function way_of(self) result(way)
      type(eliminated_step), intent(in) :: self

      way = by_stepper
      if (self%npart > 1) return
      associate (x => self%of)
         if (self%nstage == 1) then
            way = by_one
            if (all(abs(x%last(1, 1, :)) > small*abs(self%h)) .and. all(abs(x%loss) <= 0) .and. &
                all(abs(x%stage_p(1, :)*x%last(1, 1, :) - x%stage(1, 1, :, 1)*x%last_p) <= 0)) way = by_ends
         else if (self%nstage == 2) then
            if (all(abs(x%momentum(1, 1, :)*x%last(2, 1, :) - x%momentum(2, 1, :)*x%last(1, 1, :)) > &
                    small*abs(self%h))) way = by_two
         end if
      end associate
   end function way_of

   !> Compute coefficients for steps of length h, with its sign, and their derivatives by the rates.
   subroutine set_step(self, h)
      type(eliminated_step), intent(inout) :: self
      real(wp), intent(in) :: h
      real(wp), dimension(self%nstage, self%ndof) :: begin, finish
      real(wp) :: between(self%nstage, self%nstage, self%ndof)
      integer :: j, l

      if (abs(h - self%h) <= 0) return
      self%h = h
      call self%decays%set_step(h)
      associate (e => self%decays, c => self%c)
         call combine(self, h, e%begin, e%between, e%finish, self%of)
         self%of%loss = e%loss
         do j = 1, self%nstage
            begin(j, :) = -c(j)*h*e%begin(j, :)
            finish(j, :) = -(1 - c(j))*h*e%finish(j, :)
            do l = 1, self%nstage
               between(j, l, :) = -(c(j) - c(l))*h*e%between(j, l, :)
            end do
         end do
         call combine(self, h, begin, between, finish, self%by_rate)
         self%by_rate%loss = -h*(1 + e%loss)
      end associate
   end subroutine set_step

   !> Coefficients of given decays, in which they are linear.
   pure subroutine combine(self, h, begin, between, finish, x)
      type(eliminated_step), intent(in) :: self
      real(wp), intent(in) :: h
      real(wp), intent(in) :: begin(self%nstage, self%ndof), between(self%nstage, self%nstage, self%ndof)
      real(wp), intent(in) :: finish(self%nstage, self%ndof)
      type(step_coefficients), intent(inout) :: x
      integer :: i, k, l, part

      do k = 1, self%ndof
         x%last_p(k) = h*sum(self%alpha(:, 1)*begin(:, k))
         do i = 1, self%nstage
            x%stage_p(i, k) = h*sum(self%a(i, :)*begin(:, k))
         end do
         do part = 1, self%npart
            do l = 1, self%nstage
               x%momentum(l, part, k) = self%alpha(l, part)*finish(l, k)
               x%last(l, part, k) = h*sum(self%alpha(:, 1)*self%abar(:, l, part)*between(:, l, k))
               do i = 1, self%nstage
                  x%stage(l, part, k, i) = h*sum(self%a(i, :)*self%abar(:, l, part)*between(:, l, k))
               end do
            end do
         end do
      end do
   end subroutine combine

   subroutine back(self, step, q0, p0, q1, p1, u, c, status)
      class(eliminated_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q0(self%nlane, self%ndof), p0(self%nlane, self%ndof)
      real(wp), intent(in) :: q1(self%nlane, self%ndof), p1(self%nlane, self%ndof)
      real(wp), intent(inout) :: u(self%nlane, self%nrow), c(self%nlane, self%ndof)
      integer(i8), intent(inout) :: status(self%nlane)
      logical :: active(self%nlane)
      integer :: i, k, l, part, row, lane

      call linearise(self, step, q0, p0, q1, p1, status)
      call set_up(self)
      call load_covectors(self, u, c)
      active = status == 0
      call self%solver%solve(self%matrix, self%x, active, status)
      if (self%nwide > self%ndof) then
         do part = 1, self%npart
            do l = 1, self%nstage
               do k = 1, self%ndof
                  call find_covector(self, self%of, l, part, k, u(:, k), c(:, k), self%vq(:, k))
               end do
               call product_at(self, step, l, part)
               do k = self%ndof + 1, self%nwide
                  do lane = 1, self%nlane
                     u(lane, k) = u(lane, k) - self%uq(lane, k)
                  end do
               end do
            end do
         end do
      end if
      if (self%nrow > self%nwide) call add_rates(self, p0, u, c)
      do k = 1, self%ndof
         do lane = 1, self%nlane
            c(lane, k) = (1 + self%of%loss(k))*c(lane, k) + self%of%last_p(k)*u(lane, k)
         end do
         do i = 1, self%nstage
            row = self%ndof*(i - 1) + k
            do lane = 1, self%nlane
               c(lane, k) = c(lane, k) + self%of%stage_p(i, k)*self%x(lane, row)
               u(lane, k) = u(lane, k) + self%x(lane, row)
            end do
         end do
      end do
   end subroutine back

   !> n_l of one part and degree of freedom, or its derivative by the rate.
   pure subroutine find_covector(self, x, l, part, k, u, c, n)
      type(eliminated_step), intent(in) :: self
      type(step_coefficients), intent(in) :: x
      integer, intent(in) :: l, part, k
      real(wp), intent(in) :: u(self%nlane), c(self%nlane)
      real(wp), intent(out) :: n(self%nlane)
      integer :: i, lane

      do lane = 1, self%nlane
         n(lane) = x%momentum(l, part, k)*c(lane) + x%last(l, part, k)*u(lane)
      end do
      do i = 1, self%nstage
         do lane = 1, self%nlane
            n(lane) = n(lane) + x%stage(l, part, k, i)*self%x(lane, self%ndof*(i - 1) + k)
         end do
      end do
   end subroutine find_covector

   !> The covectors of the rates, with u and c from behind the step.
   subroutine add_rates(self, p0, u, c)
      type(eliminated_step), intent(inout) :: self
      real(wp), intent(in) :: p0(self%nlane, self%ndof), c(self%nlane, self%ndof)
      real(wp), intent(inout) :: u(self%nlane, self%nrow)
      real(wp) :: n(self%nlane)
      integer :: i, k, l, part

      associate (x => self%by_rate)
         do k = 1, self%ndof
            associate (g => u(:, self%nwide + k))
               n = x%loss(k)*c(:, k) + x%last_p(k)*u(:, k)
               do i = 1, self%nstage
                  n = n + x%stage_p(i, k)*self%x(:, self%ndof*(i - 1) + k)
               end do
               g = g + n*p0(:, k)
               do part = 1, self%npart
                  do l = 1, self%nstage
                     call find_covector(self, x, l, part, k, u(:, k), c(:, k), n)
                     g = g + n*self%slope(:, k, l, part)
                  end do
               end do
            end associate
         end do
      end associate
   end subroutine add_rates

   subroutine forth(self, step, q0, p0, q1, p1, m, vq, vp, status)
      class(eliminated_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q0(self%nlane, self%ndof), p0(self%nlane, self%ndof)
      real(wp), intent(in) :: q1(self%nlane, self%ndof), p1(self%nlane, self%ndof)
      integer, intent(in) :: m
      real(wp), intent(inout) :: vq(self%nlane, self%nrow, m), vp(self%nlane, self%ndof, m)
      integer(i8), intent(inout) :: status(self%nlane)
      logical :: active(self%nlane)
      integer :: j, k, l, part, row, column

      call linearise(self, step, q0, p0, q1, p1, status)
      call set_up(self)
      if (.not. allocated(self%transposed)) allocate (self%transposed, mold=self%matrix)
      do j = 1, size(self%matrix, 2)
         self%transposed(:, :, j) = self%matrix(:, j, :)
      end do
      do column = 1, m
         do k = 1, self%ndof
            do l = 1, self%nstage
               row = self%ndof*(l - 1) + k
               self%x(:, row) = vq(:, k, column) + self%of%stage_p(l, k)*vp(:, k, column)
               if (self%nrow > self%nwide) self%x(:, row) = self%x(:, row) + vq(:, self%nwide + k, column)* &
                                                            change(self, self%by_rate%stage_p(l, k), &
                                                                   self%by_rate%stage(:, :, k, l), p0(:, k), k)
            end do
         end do
         self%vq(:, self%ndof + 1:) = vq(:, self%ndof + 1:self%nwide, column)
         if (self%nwide > self%ndof) then
            self%vq(:, :self%ndof) = 0
            do part = 1, self%npart
               do l = 1, self%nstage
                  call product_at(self, step, l, part)
                  do k = 1, self%ndof
                     do j = 1, self%nstage
                        row = self%ndof*(j - 1) + k
                        self%x(:, row) = self%x(:, row) - self%of%stage(l, part, k, j)*self%uq(:, k)
                     end do
                  end do
               end do
            end do
         end if
         active = status == 0
         call self%solver%solve(self%transposed, self%x, active, status)
         do k = 1, self%ndof
            vq(:, k, column) = vq(:, k, column) + self%of%last_p(k)*vp(:, k, column)
            vp(:, k, column) = (1 + self%of%loss(k))*vp(:, k, column)
            if (self%nrow == self%nwide) cycle
            associate (rate => vq(:, self%nwide + k, column), x => self%by_rate)
               vq(:, k, column) = vq(:, k, column) + rate*change(self, x%last_p(k), x%last(:, :, k), p0(:, k), k)
               vp(:, k, column) = vp(:, k, column) + rate*change(self, x%loss(k), x%momentum(:, :, k), p0(:, k), k)
            end associate
         end do
         do part = 1, self%npart
            do l = 1, self%nstage
               self%vq(:, :self%ndof) = self%x(:, self%ndof*(l - 1) + 1:self%ndof*l)
               call product_at(self, step, l, part)
               do k = 1, self%ndof
                  vq(:, k, column) = vq(:, k, column) - self%of%last(l, part, k)*self%uq(:, k)
                  vp(:, k, column) = vp(:, k, column) - self%of%momentum(l, part, k)*self%uq(:, k)
               end do
            end do
         end do
      end do
   end subroutine forth

   !> The change of a sum of momenta and forces with the rate.
   pure function change(self, of_p, of_slope, p, k) result(x)
      class(eliminated_step), intent(in) :: self
      real(wp), intent(in) :: of_p, of_slope(self%nstage, self%npart), p(self%nlane)
      integer, intent(in) :: k
      real(wp) :: x(self%nlane)
      integer :: l, part

      x = of_p*p
      do part = 1, self%npart
         do l = 1, self%nstage
            x = x + of_slope(l, part)*self%slope(:, k, l, part)
         end do
      end do
   end function change

   !> Points and Hessians of all stages, of every part.
   subroutine linearise(self, step, q0, p0, q1, p1, status)
      type(eliminated_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in), dimension(self%nlane, self%ndof) :: q0, p0, q1, p1
      integer(i8), intent(inout) :: status(self%nlane)
      integer :: j, part

      call set_step(self, step%h)
      self%w(:, :, 1) = step%w
      if (self%npart == 2) then
         self%w(:, 1:, 1) = 0
         self%w(:, 1:, 2) = step%w(:, 1:)
      end if
      call find_points(self, step, q0, p0, q1, p1, status)
      do part = 1, self%npart
         do j = 1, self%nstage
            call self%own%bare_gradient_hessian(self%nlane, step%t + self%c(j)*step%h, self%w(:, :, part), &
                                                self%at(:, :, j), self%still, hqq=self%hqq(:, :, :, j, part))
         end do
      end do
   end subroutine linearise

   !> Q_l, and G_l unless the stage follows from the positions.
   subroutine find_points(self, step, q0, p0, q1, p1, status)
      type(eliminated_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in), dimension(self%nlane, self%ndof) :: q0, p0, q1, p1
      integer(i8), intent(inout) :: status(self%nlane)
      real(wp) :: a, b, det, of_p, of_q
      integer :: i, k, l, part, lane

      associate (x => self%of, g => self%slope, n => self%ndof)
         if (self%by_position) then
            do k = 1, n
               a = x%stage(1, 1, k, 1)/x%last(1, 1, k)
               do lane = 1, self%nlane
                  self%at(lane, k, 1) = q0(lane, k) + a*(q1(lane, k) - q0(lane, k))
               end do
            end do
            return
         end if
         select case (self%way)
         case (by_ends, by_one)
            do k = 1, n
               do lane = 1, self%nlane
                  g(lane, k, 1, 1) = (p1(lane, k) - p0(lane, k) - x%loss(k)*p0(lane, k))/x%momentum(1, 1, k)
               end do
            end do
         case (by_two)
            do k = 1, n
               associate (a1 => x%momentum(1, 1, k), a2 => x%momentum(2, 1, k), b1 => x%last(1, 1, k), &
                          b2 => x%last(2, 1, k))
                  det = a1*b2 - a2*b1
                  do lane = 1, self%nlane
                     of_p = p1(lane, k) - p0(lane, k) - x%loss(k)*p0(lane, k)
                     of_q = q1(lane, k) - q0(lane, k) - x%last_p(k)*p0(lane, k)
                     g(lane, k, 1, 1) = (b2/det)*of_p - (a2/det)*of_q
                     g(lane, k, 2, 1) = (a1/det)*of_q - (b1/det)*of_p
                  end do
               end associate
            end do
         case default
            call self%stages%increment(step, q0, p0, self%dq, self%dp, status)
            do part = 1, self%npart
               do l = 1, self%nstage
                  i = 2*n*((part - 1)*self%nstage + l - 1) + n
                  g(:, :, l, part) = self%stages%x(:, i + 1:i + n)
               end do
            end do
         end select
         do i = 1, self%nstage
            do k = 1, n
               b = x%stage_p(i, k)
               do lane = 1, self%nlane
                  self%at(lane, k, i) = q0(lane, k) + b*p0(lane, k)
               end do
               do part = 1, self%npart
                  do l = 1, self%nstage
                     b = x%stage(l, part, k, i)
                     do lane = 1, self%nlane
                        self%at(lane, k, i) = self%at(lane, k, i) + b*g(lane, k, l, part)
                     end do
                  end do
               end do
            end do
         end do
      end associate
   end subroutine find_points

   !> The second derivative of one part at stage l times vq, by the wide model.
   subroutine product_at(self, step, l, part)
      type(eliminated_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      integer, intent(in) :: l, part
      integer :: k

      do k = 1, self%ndof
         self%q(:, k) = self%at(:, k, l)
      end do
      call self%ham%bare_product(self%nlane, self%nlane, step%t + self%c(l)*step%h, self%w(:, :, part), self%q, &
                                 self%p, self%vq, self%zero, self%uq, self%up)
   end subroutine product_at

   !> Matrix of the system for x_l.
   subroutine set_up(self)
      type(eliminated_step), intent(inout) :: self
      real(wp) :: b
      integer :: i, k, l, j, part, row, column, lane

      self%matrix = 0
      do row = 1, size(self%x, 2)
         self%matrix(:, row, row) = 1
      end do
      do part = 1, self%npart
         do i = 1, self%nstage
            do k = 1, self%ndof
               column = self%ndof*(i - 1) + k
               do l = 1, self%nstage
                  b = self%of%stage(l, part, k, i)
                  if (.not. abs(b) > 0) cycle
                  do j = 1, self%ndof
                     row = self%ndof*(l - 1) + j
                     do lane = 1, self%nlane
                        self%matrix(lane, row, column) = self%matrix(lane, row, column) + &
                                                         b*self%hqq(lane, j, k, l, part)
                     end do
                  end do
               end do
            end do
         end do
      end do
   end subroutine set_up

   !> Right-hand sides of x_l.
   subroutine load_covectors(self, u, c)
      type(eliminated_step), intent(inout) :: self
      real(wp), intent(in) :: u(self%nlane, self%nrow), c(self%nlane, self%ndof)
      real(wp) :: n(self%nlane)
      integer :: j, k, l, part, row, lane

      self%x = 0
      do part = 1, self%npart
         do l = 1, self%nstage
            do k = 1, self%ndof
               do lane = 1, self%nlane
                  n(lane) = self%of%momentum(l, part, k)*c(lane, k) + self%of%last(l, part, k)*u(lane, k)
               end do
               do j = 1, self%ndof
                  row = self%ndof*(l - 1) + j
                  do lane = 1, self%nlane
                     self%x(lane, row) = self%x(lane, row) - self%hqq(lane, j, k, l, part)*n(lane)
                  end do
               end do
            end do
         end do
      end do
   end subroutine load_covectors

end module symsde_step_linear_eliminated
