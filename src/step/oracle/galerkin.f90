! SPDX-License-Identifier: BSD-3-Clause
!> The Galerkin stepper: polynomials of degree s, r quadrature nodes, momenta free at every node.
!>
!>    L_h(q_n,q_{n+1}) = ext sum_i [alpha_i P_i . q_d'(c_i) - S_i(P_i,q_d(c_i))],  q_d = sum_mu q^mu l_mu
!>
!> with the weighted sum S_i = alpha_i h H + beta_i sum_k dW_k H_k at the time t_n + c_i h. Here l_mu, mu = 0..s, is
!> the basis of the polynomials, with q^0 = q_n and q^s = q_{n+1}, and the extremum is taken over the inner q^mu and
!> over all P_i. Stationarity and the Legendre transform at the left end give (r+s) n equations:
!>
!>    alpha_i q_d'(c_i) - S_{i,p}(P_i,Q_i) = 0                                     i = 1..r
!>    sum_i [alpha_i P_i l_mu'(c_i) - S_{i,q} l_mu(c_i)] + delta_{mu 0} p_n = 0    mu = 0..s-1
!>
!> Unknowns are D^mu = q^mu - q_n (mu = 1..s) and E_i = P_i - p_n, increments instead of states, so that their rounding
!> is relative to the step. Then dq = D^s and, since the basis adds up to one, dp = -sum_i S_{i,q}: the sum of the
!> momentum equations over mu = 0..s-1 and of p_{n+1} = dL_h/dq_{n+1}.
!>
!> With Q_i = q_n + sum_nu l_nu(c_i) D^nu the rows of node i in Newton's matrix are
!>
!>                D^nu                                        E_i
!>    mu      - l_mu(c_i) l_nu(c_i) S_qq (sum over i)     alpha_i l_mu'(c_i) I - l_mu(c_i) S_qp
!>    node i    alpha_i l_nu'(c_i) I - l_nu(c_i) S_pq     - S_pp
!>
!> This matrix is not near the identity: it is solved with exchanges of rows, as elimination without them would fail. If
!> r > s it needs a nonsingular S_pp.
!>
!> This is the oracle of Galerkin schemes, which are executed as tableaus if the mass is constant
!> (scheme/galerkin_tableau).
module symsde_step_oracle_galerkin
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_scheme_scheme, only: correction_none
   use symsde_solve_newton, only: newton_type, new_newton
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: galerkin_stepper

   !> Unknowns are ordered D^1 .. D^s, E_1 .. E_r, ndof columns each.
   type, extends(stepper_type) :: galerkin_stepper
      private
      type(newton_type) :: newton
      integer :: s = 0, r = 0
      real(wp), allocatable :: c(:), alpha(:), beta(:)      !! (r)
      real(wp), allocatable :: basis(:, :), slope(:, :)     !! l_mu(c_i), l_mu'(c_i) (r, 0:s)
      real(wp), allocatable :: moment(:)                    !! sum_i alpha_i l_mu'(c_i) + delta_{mu 0} (0:s-1)
      real(wp), allocatable :: x(:, :)                      !! unknowns (nlane, (r+s) ndof)
      real(wp), allocatable :: v(:, :, :)                   !! weights at each node (nlane, 0:nnoise, r)
      real(wp), allocatable :: qs(:, :), ps(:, :), sq(:, :), sp(:, :)  !! vectors of one node (nlane, ndof)
      real(wp), allocatable :: sqq(:, :, :), sqp(:, :, :), spp(:, :, :)
   contains
      procedure :: make
      procedure :: increment
   end type galerkin_stepper

contains

   !> Make the stepper from the degree s, the r nodes and weights, and the values and slopes of the basis at the
   !> nodes.
   subroutine make(self, task)
      class(galerkin_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task
      integer :: mu

      self%name = 'Galerkin'
      self%most_single = 2
      associate (scheme => task%scheme)
         self%s = scheme%degree
         self%r = scheme%nstage
         self%c = scheme%c
         self%alpha = scheme%alpha
         self%beta = scheme%beta
         allocate (self%basis(self%r, 0:self%s), source=scheme%basis)
         allocate (self%slope(self%r, 0:self%s), source=scheme%slope)
      end associate
      allocate (self%moment(0:self%s - 1))
      ! sum_i alpha_i l_mu'(c_i) p_n is the contribution of p_n to the momentum equations, as P_i = p_n + E_i. If the
      ! quadrature integrates l_mu' exactly, it is -delta_{mu 0} p_n and cancels against the last term of the equations:
      ! then the moments are set to zero, since p_n would multiply their rounding.
      do mu = 0, self%s - 1
         self%moment(mu) = dot_product(self%alpha, self%slope(:, mu)) + merge(1, 0, mu == 0)
      end do
      where (abs(self%moment) < 16*epsilon(1.0_wp)) self%moment = 0  ! exact for every consistent quadrature
      associate (t => task%model%traits, n => task%model%traits%ndof, nlane => task%nlane, both => self%r + self%s)
         call new_one_step_hamiltonian(self%ham, task%model, nlane, correction_none, 0.0_wp)
         call new_newton(self%newton, nlane, both*n, task%newton, t%one_solve(.false.), -1, -1)
         allocate (self%x(nlane, both*n), self%v(nlane, 0:t%nnoise, self%r))
         allocate (self%qs(nlane, n), self%ps(nlane, n), self%sq(nlane, n), self%sp(nlane, n))
         allocate (self%sqq(nlane, n, n), self%sqp(nlane, n, n), self%spp(nlane, n, n))
      end associate
      self%one_solve = self%newton%affine
   end subroutine make

   !> dq = D^s and dp = -sum_i S_{i,q} from the solution, which Newton's iteration finds from D = E = 0. The nodes are
   !> evaluated once more for dp, at the last iterate.
   subroutine increment(self, step, q, p, dq, dp, status)
      class(galerkin_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      integer :: i, n

      n = self%ham%ndof
      ! Weights alpha_i h and beta_i dW_k of each node: with them the one-step Hamiltonian is S_i.
      do i = 1, self%r
         self%v(:, 0, i) = self%alpha(i)*step%w(:, 0)
         self%v(:, 1:, i) = self%beta(i)*step%w(:, 1:)
      end do
      self%x = 0
      call self%newton%start(status)
      do while (self%newton%running)
         call linearise(self, step%t, step%h, q, p)
         call self%newton%update(self%x, status, self%ham%counters)
      end do
      ! dq = D^s, and every node adds its force to dp.
      dq = self%x(:, (self%s - 1)*n + 1:self%s*n)
      dp = 0
      do i = 1, self%r
         call node_point(self, i, q, p)
         call self%ham%gradient(step%t + self%c(i)*step%h, self%v(:, :, i), self%qs, self%ps, hq=self%sq)
         dp = dp - self%sq
      end do
   end subroutine increment

   !> First column, or row, of unknown k: D^mu is k = mu, E_i is k = s + i.
   pure integer function column(self, k)
      type(galerkin_stepper), intent(in) :: self
      integer, intent(in) :: k

      column = (k - 1)*self%ham%ndof + 1
   end function column

   !> Q_i = q_n + sum_mu l_mu(c_i) D^mu and P_i = p_n + E_i, in qs and ps.
   subroutine node_point(self, i, q, p)
      type(galerkin_stepper), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      integer :: mu, at, n

      n = self%ham%ndof
      self%qs = q
      do mu = 1, self%s
         at = column(self, mu)
         self%qs = self%qs + self%basis(i, mu)*self%x(:, at:at + n - 1)
      end do
      at = column(self, self%s + i)
      self%ps = p + self%x(:, at:at + n - 1)
   end subroutine node_point

   !> Residuals and matrix. Rows: the momentum equations mu = 0..s-1 first, then the velocities of the nodes. Each node
   !> adds its own part to both. A given number of fixed-point iterations needs no matrix, only the gradient.
   subroutine linearise(self, t, h, q, p)
      type(galerkin_stepper), intent(inout) :: self
      real(wp), intent(in) :: t, h
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      integer :: i, mu, n, row

      n = self%ham%ndof
      do mu = 0, self%s - 1
         ! Begin the momentum equations with the terms that do not depend on the unknowns.
         row = mu*n + 1
         ! In exact arithmetic this term of p_n is zero for every consistent quadrature.
         self%newton%r(:, row:row + n - 1) = self%moment(mu)*p
      end do
      if (allocated(self%newton%a)) self%newton%a = 0
      do i = 1, self%r
         call node_point(self, i, q, p)
         if (allocated(self%newton%a)) then
            call self%ham%gradient_hessian(t + self%c(i)*h, self%v(:, :, i), self%qs, self%ps, &
                                           self%sq, self%sp, self%sqq, self%sqp, self%spp)
            call add_matrix(self, i)
         else
            call self%ham%gradient(t + self%c(i)*h, self%v(:, :, i), self%qs, self%ps, self%sq, self%sp)
         end if
         call add_residual(self, i)
      end do
   end subroutine linearise

   !> Add the terms of node i to the residuals: alpha_i l_mu'(c_i) E_i - l_mu(c_i) S_q to the momentum equations;
   !> and its own equation, sum_mu alpha_i l_mu'(c_i) D^mu - S_p.
   subroutine add_residual(self, i)
      type(galerkin_stepper), intent(inout) :: self
      integer, intent(in) :: i
      integer :: mu, n, row, at

      n = self%ham%ndof
      associate (r => self%newton%r, x => self%x)
         at = column(self, self%s + i)
         do mu = 0, self%s - 1
            row = mu*n + 1
            r(:, row:row + n - 1) = r(:, row:row + n - 1) + self%alpha(i)*self%slope(i, mu)*x(:, at:at + n - 1) &
                                    - self%basis(i, mu)*self%sq
         end do
         row = at
         r(:, row:row + n - 1) = -self%sp
         do mu = 1, self%s
            at = column(self, mu)
            r(:, row:row + n - 1) = r(:, row:row + n - 1) + self%alpha(i)*self%slope(i, mu)*x(:, at:at + n - 1)
         end do
      end associate
   end subroutine add_residual

   !> Add the terms of node i to the matrix, by the blocks in the header. Columns D^nu of the momentum equations sum
   !> over all nodes; other columns belong to this node alone and are set. sqp(:, l, k) is entry (k, l) of S_pq.
   subroutine add_matrix(self, i)
      type(galerkin_stepper), intent(inout) :: self
      integer, intent(in) :: i
      integer :: mu, nu, n, k, l, row, col, own
      real(wp) :: one

      n = self%ham%ndof
      own = (self%s + i - 1)*n
      associate (m => self%newton%a)
         do l = 1, n
            do k = 1, n
               ! entry (k, l) of alpha_i I
               one = merge(self%alpha(i), 0.0_wp, k == l)
               do mu = 0, self%s - 1
                  row = mu*n + k
                  do nu = 1, self%s
                     col = column(self, nu) + l - 1
                     m(:, row, col) = m(:, row, col) - self%basis(i, mu)*self%basis(i, nu)*self%sqq(:, k, l)
                  end do
                  col = column(self, self%s + i) + l - 1
                  m(:, row, col) = one*self%slope(i, mu) - self%basis(i, mu)*self%sqp(:, k, l)
                  if (self%ham%forced) m(:, row, col) = m(:, row, col) + self%basis(i, mu)*self%ham%drag(:, k, l)
               end do
               do nu = 1, self%s
                  col = column(self, nu) + l - 1
                  m(:, own + k, col) = one*self%slope(i, nu) - self%basis(i, nu)*self%sqp(:, l, k)
               end do
               m(:, own + k, column(self, self%s + i) + l - 1) = -self%spp(:, k, l)
            end do
         end do
      end associate
   end subroutine add_matrix

end module symsde_step_oracle_galerkin
