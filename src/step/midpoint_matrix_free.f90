! SPDX-License-Identifier: BSD-3-Clause
!> Implicit midpoint for many degrees of freedom and dense Hessians: no matrix is ever formed.
!>
!> The equations are those of step/midpoint where the momenta can be eliminated, with the unknown V = dp,
!> or dq in stiff lanes, and those of step/midpoint_full elsewhere, with the unknowns (dq, dp):
!>
!>    V + Hhat_q(q_n + (h p_n + g)/2 + h V/4) = 0            I + (h/4) Hhat_qq
!>    dq - (h p_n + g) + (h/2) Hhat_q(q_n + dq/2) = 0        I + (h/4) Hhat_qq
!>    dq - Hhat_p(Q,P) = 0,  dp + Hhat_q(Q,P) = 0            I + (1/2) (-Hhat_pq, -Hhat_pp; Hhat_qq, Hhat_qp)
!>
!> Newton's corrections come from GMRES with Hessian-vector products, of the model or, where it has none,
!> differences of two gradients. The matrices are close to I unless h is large against the frequencies, so
!> that a handful of products does. The first solve is a loose one; the later ones go as far as Newton's
!> convergence does (Eisenstat & Walker, SIAM J. Sci. Comput. 17 (1996) 16), never below rounding. The
!> iteration ends as everywhere. A lane that GMRES cannot solve gets its matrix after all, by products
!> with the unit vectors, and is solved by LAPACK: counted as such.
module symsde_step_midpoint_matrix_free
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_lanes, only: lane_unit
   use symsde_base_status, only: status_ok, nonfinite
   use symsde_base_traits, only: dense
   use symsde_model_abstract, only: model_type, difference_along, default_step
   use symsde_scheme_scheme, only: correction_none
   use symsde_solve_blocks, only: max_lane_unknowns
   use symsde_solve_krylov, only: krylov_type, new_krylov
   use symsde_solve_lapack, only: solve_dense_lapack
   use symsde_solve_newton, only: newton_type, newton_options, new_newton
   use symsde_solve_stagnation, only: correct_lanes
   use symsde_step_midpoint, only: fits_midpoint_stepper
   use symsde_step_one_step_hamiltonian, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type
   implicit none
   private
   public :: midpoint_matrix_free_stepper, new_midpoint_matrix_free_stepper, fits_midpoint_matrix_free

   !> Unknowns of a lane from which no matrix is the faster way. With analytic second derivatives: where
   !> elimination across lanes ends. Without them a matrix costs two gradients for each unknown.
   integer, parameter :: least_analytic = max_lane_unknowns + 1, least_differenced = 8

   integer, parameter :: for_dp = 1, for_dq = 2, for_both = 3  !! the unknowns, as above

   real(wp), parameter :: loose = 1.0e-4_wp                      !! first solve, relative to its right-hand side
   real(wp), parameter :: rounding = 0.25_wp*epsilon(1.0_wp)     !! no solve goes further, relative to the unknowns
   real(wp), parameter :: stiff = 2                              !! (h omega)^2/4 > 1

   type, extends(stepper_type) :: midpoint_matrix_free_stepper
      private
      type(newton_type) :: newton
      type(krylov_type) :: krylov
      logical :: eliminated = .false.
      real(wp), allocatable :: x(:, :), r(:, :)      !! unknowns and residual (nlane, ndof or 2 ndof)
      real(wp), allocatable :: qs(:, :), ps(:, :)    !! (Q, P) (nlane, ndof)
      real(wp), allocatable :: drift(:, :)           !! h p_n + g (nlane, ndof)
      real(wp), allocatable :: uq(:, :), up(:, :)    !! a product (nlane, ndof)
      real(wp), allocatable :: zero(:, :)            !! no momentum (nlane, ndof)
      real(wp), allocatable :: before(:), goal(:)    !! sizes of the last residual, and to be reached (nlane)
      integer(i8), allocatable :: rests(:)           !! 0 in the lanes that are stiff and ok (nlane)
   contains
      procedure :: increment
   end type midpoint_matrix_free_stepper

contains

   !> Whether to do without matrices: they would be dense, and large or made of differences.
   pure logical function fits_midpoint_matrix_free(model, options)
      class(model_type), intent(in) :: model
      type(newton_options), intent(in) :: options

      integer :: unknowns, least
      logical :: full

      fits_midpoint_matrix_free = .false.
      if (options%fixed_point > 0 .or. options%damped) return
      associate (t => model%traits)
         full = t%bandwidth == dense .or. 2*t%bandwidth + 1 >= t%ndof
         unknowns = merge(t%ndof, 2*t%ndof, fits_midpoint_stepper(model))
         least = merge(least_analytic, least_differenced, t%has_hessian .or. t%has_hessian_vector)
         fits_midpoint_matrix_free = full .and. unknowns >= least
      end associate
   end function fits_midpoint_matrix_free

   !> A midpoint stepper for blocks of nlane lanes and two degrees of freedom or more.
   subroutine new_midpoint_matrix_free_stepper(self, model, nlane, options)
      type(midpoint_matrix_free_stepper), intent(out) :: self
      class(model_type), intent(in), target :: model
      integer, intent(in) :: nlane
      type(newton_options), intent(in) :: options
      integer :: n, nx

      n = model%traits%ndof
      self%eliminated = fits_midpoint_stepper(model)
      nx = merge(n, 2*n, self%eliminated)
      self%name = 'midpoint, matrix-free'
      if (self%eliminated) self%name = 'midpoint, momenta eliminated, matrix-free'
      call new_one_step_hamiltonian(self%ham, model, nlane, correction_none, 0.0_wp)
      call new_newton(self%newton, nlane, nx, options, .false., dense, dense, judge_only=.true.)
      call new_krylov(self%krylov, nlane, nx)
      allocate (self%x(nlane, nx), self%r(nlane, nx), self%qs(nlane, n), self%ps(nlane, n))
      allocate (self%drift(nlane, n), self%uq(nlane, n), self%up(nlane, n))
      allocate (self%zero(nlane, n), source=0.0_wp)
      allocate (self%before(nlane), self%goal(nlane), self%rests(nlane))
   end subroutine new_midpoint_matrix_free_stepper

   subroutine increment(self, t, w, q, p, dq, dp, status)
      class(midpoint_matrix_free_stepper), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      real(wp) :: h

      h = w(1, 0)
      associate (n => self%ham%ndof)
         self%x = 0
         if (self%eliminated) then
            call find_drift(self, t + 0.5_wp*h, w, p)
            call solve(self, for_dp, t, w, q, p, status)
            dp = self%x
            dq = self%drift + 0.5_wp*h*dp
            if (any(self%rests == 0)) call solve_stiff(self, t, w, q, p, dq, dp, status)
         else
            call solve(self, for_both, t, w, q, p, status)
            dq = self%x(:, :n)
            dp = self%x(:, n + 1:)
         end if
      end associate
   end subroutine increment

   !> drift = h p + g, g the constant part of Hhat_p from additive noise.
   subroutine find_drift(self, tm, w, p)
      type(midpoint_matrix_free_stepper), intent(inout) :: self
      real(wp), intent(in) :: tm, w(self%ham%nlane, 0:self%ham%nnoise), p(self%ham%nlane, self%ham%ndof)

      self%drift = w(1, 0)*p
      if (self%ham%model%traits%position_noise .or. self%ham%nnoise == 0) return
      call self%ham%gradient(tm, w, self%zero, self%zero, hp=self%up)
      self%drift = self%drift + self%up
   end subroutine find_drift

   !> Newton for dq in the stiff lanes, from what V gave.
   subroutine solve_stiff(self, t, w, q, p, dq, dp, status)
      type(midpoint_matrix_free_stepper), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(inout) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      integer(i8) :: fate(self%ham%nlane)
      integer :: i

      fate = merge(self%rests, -1_i8, status == 0)
      self%x = dq
      call solve(self, for_dq, t, w, q, p, fate)
      do i = 1, self%ham%ndof
         dq(:, i) = merge(self%x(:, i), dq(:, i), fate == 0)
         dp(:, i) = merge(2*(dq(:, i) - self%drift(:, i))/w(1, 0), dp(:, i), fate == 0)
      end do
      where (fate > 0) status = fate
   end subroutine solve_stiff

   !> Newton for the unknowns, from those in x on.
   subroutine solve(self, unknowns, t, w, q, p, status)
      type(midpoint_matrix_free_stepper), intent(inout) :: self
      integer, intent(in) :: unknowns
      real(wp), intent(in) :: t, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      real(wp) :: tm

      tm = t + 0.5_wp*w(1, 0)
      associate (newton => self%newton, krylov => self%krylov, nlane => self%ham%nlane)
         call newton%start(status)
         do while (newton%running)
            call find_residual(self, unknowns, tm, w, q, p)
            call krylov%start(self%r, newton%last)
            call set_goals(nlane, newton%iteration, krylov%norm, newton%size, self%before, self%goal)
            call krylov%seek(self%goal)
            do while (krylov%running)
               call multiply(self, tm, w)
               call krylov%advance()
            end do
            if (any(krylov%unsolved)) call solve_unsolved(self, tm, w, status)
            if (newton%iteration == 0 .and. unknowns == for_dp) &
               self%rests = merge(0_i8, -1_i8, krylov%largest > stiff)
            call correct_lanes(nlane, krylov%n, krylov%x, newton%last, self%x, newton%step, newton%size)
            call newton%judge(status, self%ham%counters)
         end do
      end associate
   end subroutine solve

   !> Point and residual of the unknowns x.
   subroutine find_residual(self, unknowns, tm, w, q, p)
      type(midpoint_matrix_free_stepper), intent(inout) :: self
      integer, intent(in) :: unknowns
      real(wp), intent(in) :: tm, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp) :: h

      h = w(1, 0)
      associate (n => self%ham%ndof, x => self%x, r => self%r)
         select case (unknowns)
         case (for_dp)
            self%qs = q + 0.5_wp*self%drift + 0.25_wp*h*x
            call self%ham%gradient(tm, w, self%qs, p, hq=r)
            r = x + r
         case (for_dq)
            self%qs = q + 0.5_wp*x
            call self%ham%gradient(tm, w, self%qs, p, hq=r)
            r = x + (0.5_wp*h*r - self%drift)
         case default
            self%qs = q + 0.5_wp*x(:, :n)
            self%ps = p + 0.5_wp*x(:, n + 1:)
            call self%ham%gradient(tm, w, self%qs, self%ps, hq=r(:, n + 1:), hp=r(:, :n))
            r(:, :n) = x(:, :n) - r(:, :n)
            r(:, n + 1:) = x(:, n + 1:) + r(:, n + 1:)
         end select
         if (self%eliminated) self%ps = p
      end associate
   end subroutine find_residual

   !> The next vector times the matrix at (Q, P).
   subroutine multiply(self, tm, w)
      type(midpoint_matrix_free_stepper), intent(inout) :: self
      real(wp), intent(in) :: tm, w(self%ham%nlane, 0:self%ham%nnoise)
      integer :: nproduct

      nproduct = self%krylov%nrunning
      associate (v => self%krylov%v, k => self%krylov%k, n => self%ham%ndof, nlane => self%ham%nlane)
         if (self%eliminated) then
            call product(self, nlane, nproduct, tm, w, self%qs, self%ps, v(:, :, k), self%zero, self%uq, self%up)
            v(:, :, k + 1) = v(:, :, k) + 0.25_wp*w(1, 0)*self%uq
         else
            call product(self, nlane, nproduct, tm, w, self%qs, self%ps, v(:, :n, k), v(:, n + 1:, k), &
                         self%uq, self%up)
            v(:, :n, k + 1) = v(:, :n, k) - 0.5_wp*self%up
            v(:, n + 1:, k + 1) = v(:, n + 1:, k) + 0.5_wp*self%uq
         end if
      end associate
   end subroutine multiply

   !> Hessian of Hhat at (q, p) times (vq, vp). A model with a Hessian and no product would form the one for
   !> the other: then too a difference of gradients is cheaper.
   subroutine product(self, nlane, nproduct, t, w, q, p, vq, vp, uq, up)
      type(midpoint_matrix_free_stepper), intent(inout) :: self
      integer, intent(in) :: nlane, nproduct   !! lanes, and how many of them count
      real(wp), intent(in) :: t, w(nlane, 0:self%ham%nnoise)
      real(wp), intent(in) :: q(nlane, self%ham%ndof), p(nlane, self%ham%ndof)
      real(wp), intent(in) :: vq(nlane, self%ham%ndof), vp(nlane, self%ham%ndof)
      real(wp), intent(out) :: uq(nlane, self%ham%ndof), up(nlane, self%ham%ndof)
      real(wp) :: step(nlane)
      integer :: i

      associate (model => self%ham%model, n => self%ham%ndof, m => self%ham%nnoise, c => self%ham%counters)
         if (model%traits%has_hessian_vector) then
            call model%hessian_vector(nlane, n, m, t, w, q, p, vq, vp, uq, up)
            c%hessian_vectors = c%hessian_vectors + nproduct
         else
            step = 1
            do i = 1, n
               step = max(step, abs(q(:, i)), abs(p(:, i)))
            end do
            step = default_step*step
            call difference_along(model, nlane, n, m, step, t, w, q, p, vq, vp, uq, up)
            c%gradients = c%gradients + 2*nproduct
         end if
      end associate
   end subroutine product

   !> The lanes that GMRES has not solved, by matrix, one by one; those that cannot be solved fail.
   subroutine solve_unsolved(self, tm, w, status)
      type(midpoint_matrix_free_stepper), intent(inout) :: self
      real(wp), intent(in) :: tm, w(self%ham%nlane, 0:self%ham%nnoise)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      real(wp), allocatable :: matrix(:, :), x(:)
      integer(i4) :: info
      integer :: lane

      associate (krylov => self%krylov, counters => self%ham%counters)
         do lane = 1, self%ham%nlane
            if (.not. krylov%unsolved(lane)) cycle
            info = nonfinite
            if (krylov%norm(lane) <= huge(1.0_wp)) then
               if (.not. allocated(matrix)) allocate (matrix(krylov%n, krylov%n))
               call form_matrix(self, lane, tm, w, matrix)
               x = self%r(lane, :)
               call solve_dense_lapack(krylov%n, matrix, x, info)
               counters%lapack_solves = counters%lapack_solves + 1
            end if
            if (info == status_ok) then
               krylov%x(lane, :) = x
            else
               call self%newton%fail(lane, int(info, i8), status, counters)
            end if
         end do
      end associate
   end subroutine solve_unsolved

   !> The matrix of one lane, eight columns at a time: the lanes of the model are used for its columns.
   subroutine form_matrix(self, lane, tm, w, matrix)
      type(midpoint_matrix_free_stepper), intent(inout) :: self
      integer, intent(in) :: lane
      real(wp), intent(in) :: tm, w(self%ham%nlane, 0:self%ham%nnoise)
      real(wp), intent(out) :: matrix(self%krylov%n, self%krylov%n)
      real(wp), allocatable, dimension(:, :) :: w8, q, p, vq, vp, uq, up
      integer :: first, l, n

      n = self%ham%ndof
      w8 = spread(w(lane, :), 1, lane_unit)
      q = spread(self%qs(lane, :), 1, lane_unit)
      p = spread(self%ps(lane, :), 1, lane_unit)
      allocate (vq, vp, uq, up, mold=q)
      do first = 1, self%krylov%n, lane_unit
         vq = 0
         vp = 0
         do l = 1, min(lane_unit, self%krylov%n - first + 1)
            if (first + l - 1 <= n) vq(l, first + l - 1) = 1
            if (first + l - 1 > n) vp(l, first + l - 1 - n) = 1
         end do
         call product(self, lane_unit, min(lane_unit, self%krylov%n - first + 1), tm, w8, q, p, vq, vp, uq, up)
         do l = 1, min(lane_unit, self%krylov%n - first + 1)
            if (self%eliminated) then
               matrix(:, first + l - 1) = vq(l, :) + 0.25_wp*w(lane, 0)*uq(l, :)
            else
               matrix(:n, first + l - 1) = vq(l, :) - 0.5_wp*up(l, :)
               matrix(n + 1:, first + l - 1) = vp(l, :) + 0.5_wp*uq(l, :)
            end if
         end do
      end do
   end subroutine form_matrix

   ! ---- kernels ----------------------------------------------------------------------------------

   !> Sizes of the residual that GMRES is to reach: as far as Newton's convergence went squared, and not below
   !> rounding of the unknowns.
   pure subroutine set_goals(nlane, iteration, norm, size, before, goal)
      integer, intent(in) :: nlane, iteration  !! lanes, iterations done
      real(wp), intent(in) :: norm(nlane), size(nlane)
      real(wp), intent(inout) :: before(nlane)
      real(wp), intent(out) :: goal(nlane)
      integer :: lane

      do lane = 1, nlane
         if (iteration == 0) then
            goal(lane) = loose*norm(lane)
         else
            goal(lane) = max(rounding*size(lane), min(loose, (norm(lane)/before(lane))**2)*norm(lane))
         end if
         before(lane) = norm(lane)
      end do
   end subroutine set_goals

end module symsde_step_midpoint_matrix_free
