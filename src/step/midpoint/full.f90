! SPDX-License-Identifier: BSD-3-Clause
!> Implicit midpoint for any model: q and p are both unknown.
!>
!>    q_{n+1} = q_n + Hhat_p(Q,P),  p_{n+1} = p_n - Hhat_q(Q,P),  (Q,P) the mean of both ends   [WHSB] (71)-(72)
!>
!> Unknowns are the increments (F,G) = (dq,dp), interleaved degree by degree so that banded Hessians
!> make a banded matrix. Many of them in a dense one are found without matrices, by products: there the unknowns are
!> all of F and then all of G. Where matrices or products cost more than a dozen gradients, lanes whose step is mild
!> are iterated before (step/midpoint/full_fixed_point), and Newton begins anew in the others.
module symsde_step_midpoint_full
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_traits, only: dense
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: bracket_terms, correction_none
   use symsde_solve_newton, only: newton_type, newton_options, new_newton
   use symsde_step_lone, only: lone_stepper, few_of
   use symsde_step_midpoint_lone_full, only: lone_midpoint_full
   use symsde_step_midpoint_full_fixed_point, only: midpoint_fixed_point, new_midpoint_fixed_point
   use symsde_step_implicit_newton_krylov, only: newton_krylov, new_newton_krylov, hessian_product, &
                                                 does_without_matrices, iterates_first
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: midpoint_full_stepper, midpoint_full_fits, new_midpoint_full_stepper

   type, extends(stepper_type) :: midpoint_full_stepper
      private
      type(newton_type) :: newton
      type(newton_krylov), allocatable :: products  !! where no matrices are formed
      type(midpoint_fixed_point), allocatable :: sweeps       !! where mild steps need neither
      integer(i8), allocatable :: left(:)                !! 0 in lanes that these leave, then their status (nlane)
      integer :: band = dense
      real(wp), allocatable :: x(:, :)             !! F_1, G_1, F_2, G_2, ..; by products F, then G (nlane, 2 ndof)
      real(wp), allocatable :: r(:, :)             !! residual in that order, by products (nlane, 2 ndof)
      real(wp), allocatable :: qs(:, :), ps(:, :)  !! (Q, P) (nlane, ndof)
      real(wp), allocatable :: hq(:, :), hp(:, :)
      real(wp), allocatable :: hqq(:, :, :), hqp(:, :, :), hpp(:, :, :)
   contains
      procedure :: make
      procedure :: increment
      procedure :: offer_lone
   end type midpoint_full_stepper

contains

   !> Whether this stepper executes the task: where step/midpoint/eliminated and step/stages/stepper do not eliminate
   !> momenta.
   logical function midpoint_full_fits(task) result(fits)
      type(stepper_task), intent(in) :: task

      fits = task%is_plain() .and. task%scheme%is_midpoint()
      associate (t => task%model%traits)
         if (task%newton%is_free()) &
            fits = fits .and. .not. (t%eliminates_momenta() .or. (t%ndof > 1 .and. t%divides_by_mass()))
      end associate
   end function midpoint_full_fits

   subroutine make(self, task)
      class(midpoint_full_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      call new_midpoint_full_stepper(self, task%model, task%nlane, task%newton)
      self%one_solve = self%newton%affine
      if (allocated(self%products)) self%left_out = 'matrices: products with the Hessian take their place'
      associate (t => task%model%traits)
         if (.not. iterates_first(t, task%newton)) return
         allocate (self%sweeps, self%left(task%nlane))
         call new_midpoint_fixed_point(self%sweeps, task%nlane, t%ndof, t%nnoise)
      end associate
   end subroutine make

   !> A midpoint stepper for blocks of nlane lanes.
   subroutine new_midpoint_full_stepper(self, model, nlane, options, without_matrices, brackets)
      type(midpoint_full_stepper), intent(out) :: self
      class(model_type), intent(in), target :: model
      integer, intent(in) :: nlane
      type(newton_options), intent(in) :: options
      logical, intent(in), optional :: without_matrices  !! whether to do without; by the model, if absent
      type(bracket_terms), intent(in), optional :: brackets  !! to add to the one-step Hamiltonian
      integer :: n, b, width
      logical :: matrices

      n = model%traits%ndof
      b = model%traits%bandwidth
      if (4*b + 3 >= 2*n) b = dense
      self%name = 'midpoint'
      self%most_single = 2
      self%band = b
      call new_one_step_hamiltonian(self%ham, model, nlane, correction_none, 0.0_wp, brackets)
      matrices = .not. does_without_matrices(model%traits, 2*n, options)
      if (present(without_matrices)) matrices = .not. without_matrices
      allocate (self%x(nlane, 2*n), self%qs(nlane, n), self%ps(nlane, n), self%hq(nlane, n), self%hp(nlane, n))
      if (.not. matrices) then
         self%name = 'midpoint, matrix-free'
         allocate (self%products)
         call new_newton(self%newton, nlane, 2*n, options, .false., dense, dense, judge_only=.true.)
         call new_newton_krylov(self%products, nlane, n, 2*n)
         allocate (self%r(nlane, 2*n))
         return
      end if
      width = merge(dense, 2*b + 1, b == dense)
      call new_newton(self%newton, nlane, 2*n, options, model%traits%one_solve(b /= dense), width, width, &
                      exact=.not. allocated(self%ham%modified) .and. &
                      (model%traits%has_hessian_vector .or. (model%traits%has_hessian .and. b == dense)))
      if (b == dense) then
         allocate (self%hqq(nlane, n, n), self%hqp(nlane, n, n), self%hpp(nlane, n, n))
      else
         allocate (self%hqq(nlane, -b:b, n), self%hqp(nlane, -b:b, n), self%hpp(nlane, -b:b, n))
      end if
   end subroutine new_midpoint_full_stepper

   !> Paths one by one: iterated where blocks are, solved where the matrix is dense and has exact entries.
   subroutine offer_lone(self, lone)
      class(midpoint_full_stepper), intent(in) :: self
      class(lone_stepper), allocatable, intent(out) :: lone
      type(lone_midpoint_full), allocatable :: made

      associate (newton => self%newton, t => self%ham%model%traits)
         if (allocated(self%ham%modified) .or. .not. newton%options%is_free()) return
         allocate (made)
         made%most = few_of(t%ndof, 4, 6)  ! five take 0.9 to 1.2 of the time
         made%iterates = allocated(self%sweeps)
         made%solves = allocated(self%hqq) .and. self%band == dense .and. t%has_hessian .and. t%ndof > 1
         made%test = newton%test
         made%max_iter = newton%options%max_iter
         if (made%iterates .or. made%solves) call move_alloc(made, lone)
      end associate
   end subroutine offer_lone

   subroutine increment(self, step, q, p, dq, dp, status)
      class(midpoint_full_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      real(wp), pointer, contiguous :: w(:, :)  ! a name that gfortran 12 knows to be contiguous
      real(wp) :: tm

      tm = step%t + 0.5_wp*step%h
      if (allocated(self%sweeps)) then
         w => step%w
         call self%sweeps%attempt(self%ham, tm, w, q, p, dq, dp, status, self%left)
         if (.not. any(self%left == 0)) return
         call solve(self, tm, step, q, p, dq, dp, self%left)
         status = merge(self%left, status, self%left > 0)
      else
         dq = 0
         dp = 0
         call solve(self, tm, step, q, p, dq, dp, status)
      end if
   end subroutine increment

   !> Increments of the lanes without a status by Newton's iteration.
   subroutine solve(self, tm, step, q, p, dq, dp, status)
      class(midpoint_full_stepper), intent(inout) :: self
      real(wp), intent(in) :: tm
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(inout) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      integer :: i

      self%x = 0
      call self%newton%start(status)
      if (allocated(self%products)) then
         call solve_by_products(self, tm, step, q, p, dq, dp, status)
         return
      end if
      associate (nlane => self%ham%nlane, n => self%ham%ndof, newton => self%newton)
         do while (newton%running)
            call midpoint_of(nlane, n, q, p, self%x, self%qs, self%ps)
            call linearise(self, tm, step)
            call newton%update(self%x, status, self%ham%counters)
         end do
         do i = 1, n
            dq(:, i) = merge(self%x(:, 2*i - 1), dq(:, i), status == 0)
            dp(:, i) = merge(self%x(:, 2*i), dp(:, i), status == 0)
         end do
      end associate
   end subroutine solve

   !> The same without matrices.
   subroutine solve_by_products(self, tm, step, q, p, dq, dp, status)
      type(midpoint_full_stepper), intent(inout) :: self
      real(wp), intent(in) :: tm
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(inout) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      integer :: i

      associate (n => self%ham%ndof, x => self%x, r => self%r)
         do while (self%newton%running)
            self%qs = q + 0.5_wp*x(:, :n)
            self%ps = p + 0.5_wp*x(:, n + 1:)
            call self%ham%gradient(tm, step%w, self%qs, self%ps, self%hq, self%hp, step)
            r(:, :n) = x(:, :n) - self%hp
            r(:, n + 1:) = x(:, n + 1:) + self%hq
            call self%products%begin(self%newton, r)
            do while (self%products%wanted > 0)
               call multiply(self, tm, step%w, self%products%krylov%k, self%products%krylov%v)
               call self%products%take()
            end do
            call self%products%finish(self%newton, x, status, self%ham%counters)
         end do
         do i = 1, n
            dq(:, i) = merge(x(:, i), dq(:, i), status == 0)
            dp(:, i) = merge(x(:, n + i), dp(:, i), status == 0)
         end do
      end associate
   end subroutine solve_by_products

   !> Vector k+1 = I + (-Hhat_pq, -Hhat_pp; Hhat_qq, Hhat_qp)/2 times vector k.
   subroutine multiply(self, tm, w, k, v)
      type(midpoint_full_stepper), intent(inout) :: self
      real(wp), intent(in) :: tm, w(self%ham%nlane, 0:self%ham%nnoise)
      integer, intent(in) :: k
      real(wp), intent(inout) :: v(:, :, :)  !! (nlane, 2 ndof, vectors)

      associate (n => self%ham%ndof, products => self%products)
         call hessian_product(self%ham, self%ham%nlane, n, products%wanted, tm, w, self%qs, self%ps, v(:, :n, k), &
                              v(:, n + 1:, k), products%uq, products%up)
         v(:, :n, k + 1) = v(:, :n, k) - 0.5_wp*products%up
         v(:, n + 1:, k + 1) = v(:, n + 1:, k) + 0.5_wp*products%uq
      end associate
   end subroutine multiply

   !> Residuals F - Hhat_p, G + Hhat_q and their matrix.
   subroutine linearise(self, tm, step)
      type(midpoint_full_stepper), intent(inout) :: self
      real(wp), intent(in) :: tm
      type(step_record), intent(in) :: step

      associate (nlane => self%ham%nlane, n => self%ham%ndof, newton => self%newton)
         if (newton%options%fixed_point > 0) then
            call self%ham%gradient(tm, step%w, self%qs, self%ps, self%hq, self%hp, step)
         else if (self%band == dense) then
            call self%ham%gradient_hessian(tm, step%w, self%qs, self%ps, self%hq, self%hp, &
                                           self%hqq, self%hqp, self%hpp, step)
            call matrix_dense(nlane, n, self%hqq, self%hqp, self%hpp, newton%a)
         else
            call self%ham%gradient(tm, step%w, self%qs, self%ps, self%hq, self%hp, step)
            call self%ham%model%hessian_banded(nlane, n, self%ham%nnoise, self%band, tm, step%w, self%qs, self%ps, &
                                               self%hqq, self%hqp, self%hpp)
            self%ham%counters%hessians = self%ham%counters%hessians + self%ham%nreal
            call matrix_banded(nlane, n, self%band, self%hqq, self%hqp, self%hpp, newton%bands)
         end if
         call residual(nlane, n, self%x, self%hq, self%hp, newton%r)
      end associate
   end subroutine linearise

   ! ---- kernels ----------------------------------------------------------------------------------

   pure subroutine midpoint_of(nlane, n, q, p, x, qs, ps)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: q(nlane, n), p(nlane, n), x(nlane, 2, n)
      real(wp), intent(out) :: qs(nlane, n), ps(nlane, n)
      integer :: lane, i

      do i = 1, n
         do lane = 1, nlane
            qs(lane, i) = q(lane, i) + 0.5_wp*x(lane, 1, i)
            ps(lane, i) = p(lane, i) + 0.5_wp*x(lane, 2, i)
         end do
      end do
   end subroutine midpoint_of

   pure subroutine residual(nlane, n, x, hq, hp, r)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: x(nlane, 2, n), hq(nlane, n), hp(nlane, n)
      real(wp), intent(out) :: r(nlane, 2, n)
      integer :: lane, i

      do i = 1, n
         do lane = 1, nlane
            r(lane, 1, i) = x(lane, 1, i) - hp(lane, i)
            r(lane, 2, i) = x(lane, 2, i) + hq(lane, i)
         end do
      end do
   end subroutine residual

   pure subroutine matrix_dense(nlane, n, hqq, hqp, hpp, a)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: hqq(nlane, n, n), hqp(nlane, n, n), hpp(nlane, n, n)
      real(wp), intent(out) :: a(nlane, 2, n, 2, n)
      real(wp) :: one
      integer :: lane, i, j

      do j = 1, n
         do i = 1, n
            one = merge(1.0_wp, 0.0_wp, i == j)
            do lane = 1, nlane
               a(lane, 1, i, 1, j) = one - 0.5_wp*hqp(lane, j, i)
               a(lane, 1, i, 2, j) = -0.5_wp*hpp(lane, i, j)
               a(lane, 2, i, 1, j) = 0.5_wp*hqq(lane, i, j)
               a(lane, 2, i, 2, j) = one + 0.5_wp*hqp(lane, i, j)
            end do
         end do
      end do
   end subroutine matrix_dense

   !> Row 2i-1 or 2i, column 2j-1 or 2j: diagonal offsets 2(j-i)-1 .. 2(j-i)+1.
   pure subroutine matrix_banded(nlane, n, b, hqq, hqp, hpp, bands)
      integer, intent(in) :: nlane, n, b
      real(wp), intent(in) :: hqq(nlane, -b:b, n), hqp(nlane, -b:b, n), hpp(nlane, -b:b, n)
      real(wp), intent(out) :: bands(nlane, -2*b - 1:2*b + 1, 2, n)
      real(wp) :: one
      integer :: i, d

      bands = 0
      do i = 1, n
         do d = max(-b, 1 - i), min(b, n - i)
            one = merge(1.0_wp, 0.0_wp, d == 0)
            bands(:, 2*d, 1, i) = one - 0.5_wp*hqp(:, -d, i + d)
            bands(:, 2*d + 1, 1, i) = -0.5_wp*hpp(:, d, i)
            bands(:, 2*d - 1, 2, i) = 0.5_wp*hqq(:, d, i)
            bands(:, 2*d, 2, i) = one + 0.5_wp*hqp(:, d, i)
         end do
      end do
   end subroutine matrix_banded

end module symsde_step_midpoint_full
