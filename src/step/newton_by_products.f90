! SPDX-License-Identifier: BSD-3-Clause
!> Newton's corrections for many degrees of freedom and dense Hessians: no matrix is ever formed.
!>
!> The matrices are those of an implicit midpoint step, with c = h/4 and c = 1/2,
!>
!>    momenta eliminated    I + c Hhat_qq
!>    in general            I + c (-Hhat_pq, -Hhat_pp; Hhat_qq, Hhat_qp)      unknowns (dq, dp)
!>
!> Corrections come from GMRES with Hessian-vector products, of the model or, where it has none,
!> differences of two gradients. The matrices are close to I unless h is large against the frequencies, so
!> that a handful of products does. The first solve is a loose one; the later ones go as far as Newton's
!> convergence does (Eisenstat & Walker, SIAM J. Sci. Comput. 17 (1996) 16), never below rounding. The
!> iteration ends as everywhere. A lane that GMRES cannot solve gets its matrix after all, by products
!> with the unit vectors, and is solved by LAPACK: counted as such.
module symsde_step_newton_by_products
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_lanes, only: lane_unit
   use symsde_base_status, only: status_ok, nonfinite, not_converged
   use symsde_base_traits, only: model_traits, dense
   use symsde_model_abstract, only: difference_along, default_step
   use symsde_solve_blocks, only: max_lane_unknowns
   use symsde_solve_krylov, only: krylov_type, new_krylov
   use symsde_solve_lapack, only: solve_dense_lapack
   use symsde_solve_newton, only: newton_type, newton_options
   use symsde_solve_stagnation, only: correct_lanes
   use symsde_step_one_step_hamiltonian, only: one_step_hamiltonian
   implicit none
   private
   public :: newton_by_products, new_newton_by_products, pays_by_products, does_without_matrices
   public :: iterates_first, is_free
   public :: hessian_product, set_goals  ! for matrices of other forms

   !> Unknowns of a lane from which no matrix is the faster way. With analytic second derivatives: where
   !> elimination across lanes ends. Without them a matrix costs two gradients for each unknown.
   integer, parameter :: least_analytic = max_lane_unknowns + 1, least_differenced = 8

   !> Unknowns q and p of a lane up to which Newton's iteration is as fast as a dozen of sweeps.
   integer, parameter :: small = 4

   real(wp), parameter :: loose = 1.0e-4_wp                      !! first solve, relative to its right-hand side
   real(wp), parameter :: rounding = 0.25_wp*epsilon(1.0_wp)     !! no solve goes further, relative to the unknowns

   type :: newton_by_products
      type(krylov_type) :: krylov
      integer, private :: nlane = 0, n = 0, m = 0          !! lanes, degrees of freedom, noises
      logical, private :: eliminated = .false.
      real(wp), allocatable, private :: uq(:, :), up(:, :) !! a product (nlane, ndof)
      real(wp), allocatable, private :: zero(:, :)         !! no momentum (nlane, ndof)
      real(wp), allocatable, private :: before(:), goal(:) !! sizes of the last residual, and to be reached (nlane)
   contains
      procedure :: correct
   end type newton_by_products

contains

   !> Whether to do without matrices: they would be dense, and large or made of differences.
   pure logical function pays_by_products(traits, unknowns)
      type(model_traits), intent(in) :: traits
      integer, intent(in) :: unknowns  !! of a lane
      logical :: full

      full = traits%bandwidth == dense .or. 2*traits%bandwidth + 1 >= traits%ndof
      pays_by_products = full .and. unknowns >= merge(least_analytic, least_differenced, &
                                                      traits%has_hessian .or. traits%has_hessian_vector)
   end function pays_by_products

   !> Whether Newton's iteration of a midpoint does: damping and given numbers of iterations are those of matrices.
   pure logical function does_without_matrices(traits, unknowns, options)
      type(model_traits), intent(in) :: traits
      integer, intent(in) :: unknowns
      type(newton_options), intent(in) :: options

      does_without_matrices = pays_by_products(traits, unknowns) .and. is_free(options)
   end function does_without_matrices

   !> Whether a midpoint of unknown q and p is iterated before Newton's matrices or products are asked for: they are
   !> many, or made of differences, and more than one solve.
   pure logical function iterates_first(traits, options)
      type(model_traits), intent(in) :: traits
      type(newton_options), intent(in) :: options

      associate (unknowns => 2*traits%ndof)
         iterates_first = is_free(options) .and. traits%ndof > 1 .and. &
                          (pays_by_products(traits, unknowns) .or. traits%differences_alone() .or. &
                           (unknowns > small .and. .not. traits%quadratic))
      end associate
   end function iterates_first

   !> Whether neither damping nor a number of iterations is asked for.
   pure logical function is_free(options)
      type(newton_options), intent(in) :: options

      is_free = options%fixed_point <= 0 .and. .not. options%damped
   end function is_free

   !> Room for nlane lanes.
   subroutine new_newton_by_products(self, nlane, traits, eliminated)
      type(newton_by_products), intent(out) :: self
      integer, intent(in) :: nlane
      type(model_traits), intent(in) :: traits
      logical, intent(in) :: eliminated  !! the momenta are: ndof unknowns instead of 2 ndof

      associate (n => traits%ndof)
         self%nlane = nlane
         self%n = n
         self%m = traits%nnoise
         self%eliminated = eliminated
         call new_krylov(self%krylov, nlane, merge(n, 2*n, eliminated))
         allocate (self%uq(nlane, n), self%up(nlane, n), self%before(nlane), self%goal(nlane))
         allocate (self%zero(nlane, n), source=0.0_wp)
      end associate
   end subroutine new_newton_by_products

   !> Correct the unknowns x of the running lanes for the residual r, with the matrix at (q, p), and judge them.
   subroutine correct(self, ham, c, t, w, q, p, r, newton, x, status)
      class(newton_by_products), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham  !! model and counters
      real(wp), intent(in) :: c, t, w(self%nlane, 0:self%m), q(self%nlane, self%n), p(self%nlane, self%n)
      real(wp), intent(in) :: r(self%nlane, self%krylov%n)
      type(newton_type), intent(inout) :: newton
      real(wp), intent(inout) :: x(self%nlane, self%krylov%n)
      integer(i8), intent(inout) :: status(self%nlane)

      associate (krylov => self%krylov)
         call krylov%start(r, newton%last)
         call set_goals(self%nlane, newton%iteration, krylov%norm, newton%size, self%before, self%goal)
         call krylov%seek(self%goal)
         do while (krylov%running)
            call multiply(self, ham, c, t, w, q, p)
            call krylov%advance()
         end do
         if (any(krylov%unsolved)) call solve_unsolved(self, ham, c, t, w, q, p, r, newton, status)
         call correct_lanes(self%nlane, krylov%n, krylov%x, newton%last, x, newton%step, newton%size)
      end associate
      call newton%judge(status, ham%counters)
   end subroutine correct

   !> The next vector times the matrix.
   subroutine multiply(self, ham, c, t, w, q, p)
      type(newton_by_products), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      real(wp), intent(in) :: c, t, w(self%nlane, 0:self%m), q(self%nlane, self%n), p(self%nlane, self%n)

      associate (krylov => self%krylov, v => self%krylov%v, k => self%krylov%k, n => self%n, nlane => self%nlane)
         if (self%eliminated) then
            call hessian_product(ham, nlane, n, krylov%nrunning, t, w, q, p, v(:, :, k), self%zero, self%uq, self%up)
            v(:, :, k + 1) = v(:, :, k) + c*self%uq
         else
            call hessian_product(ham, nlane, n, krylov%nrunning, t, w, q, p, v(:, :n, k), v(:, n + 1:, k), &
                                 self%uq, self%up)
            v(:, :n, k + 1) = v(:, :n, k) - c*self%up
            v(:, n + 1:, k + 1) = v(:, n + 1:, k) + c*self%uq
         end if
      end associate
   end subroutine multiply

   !> Hessian of Hhat at (q, p) times (vq, vp). A model with a Hessian and no product would form the one for
   !> the other: then too a difference of gradients is cheaper.
   subroutine hessian_product(ham, nlane, n, wanted, t, w, q, p, vq, vp, uq, up)
      type(one_step_hamiltonian), intent(inout) :: ham
      integer, intent(in) :: nlane, n, wanted   !! lanes, degrees of freedom, lanes that count
      real(wp), intent(in) :: t, w(nlane, 0:ham%nnoise), q(nlane, n), p(nlane, n), vq(nlane, n), vp(nlane, n)
      real(wp), intent(out) :: uq(nlane, n), up(nlane, n)
      real(wp) :: step(nlane)
      integer :: i

      associate (model => ham%model, m => ham%nnoise, counters => ham%counters)
         if (model%traits%has_hessian_vector) then
            call model%hessian_vector(nlane, n, m, t, w, q, p, vq, vp, uq, up)
            counters%hessian_vectors = counters%hessian_vectors + wanted
         else
            step = 1
            do i = 1, n
               step = max(step, abs(q(:, i)), abs(p(:, i)))
            end do
            step = default_step*step
            call difference_along(model, nlane, n, m, step, t, w, q, p, vq, vp, uq, up)
            counters%gradients = counters%gradients + 2*wanted
         end if
      end associate
   end subroutine hessian_product

   !> The lanes that GMRES has not solved, by matrix, one by one; those that cannot be solved fail.
   subroutine solve_unsolved(self, ham, c, t, w, q, p, r, newton, status)
      type(newton_by_products), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      real(wp), intent(in) :: c, t, w(self%nlane, 0:self%m), q(self%nlane, self%n), p(self%nlane, self%n)
      real(wp), intent(in) :: r(self%nlane, self%krylov%n)
      type(newton_type), intent(inout) :: newton
      integer(i8), intent(inout) :: status(self%nlane)
      real(wp), allocatable :: matrix(:, :), x(:)
      integer(i4) :: info
      integer :: lane, memory

      associate (krylov => self%krylov, counters => ham%counters)
         do lane = 1, self%nlane
            if (.not. krylov%unsolved(lane)) cycle
            info = nonfinite
            memory = 0
            if (.not. allocated(matrix)) allocate (matrix(krylov%n, krylov%n), stat=memory)
            if (memory /= 0) then
               info = not_converged  ! the matrix finds no memory
            else if (krylov%norm(lane) <= huge(1.0_wp)) then
               call form_matrix(self, ham, c, t, w(lane, :), q(lane, :), p(lane, :), matrix)
               x = r(lane, :)
               call solve_dense_lapack(krylov%n, matrix, x, info)
               counters%lapack_solves = counters%lapack_solves + 1
            end if
            if (info == status_ok) then
               krylov%x(lane, :) = x
            else
               call newton%fail(lane, int(info, i8), status, counters)
            end if
         end do
      end associate
   end subroutine solve_unsolved

   !> The matrix of one lane, eight columns at a time: the lanes of the model are used for its columns.
   subroutine form_matrix(self, ham, c, t, w, q, p, matrix)
      type(newton_by_products), intent(in) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      real(wp), intent(in) :: c, t, w(0:self%m), q(self%n), p(self%n)
      real(wp), intent(out) :: matrix(self%krylov%n, self%krylov%n)
      real(wp), allocatable, dimension(:, :) :: w8, q8, p8, vq, vp, uq, up
      integer :: first, last, l, n

      n = self%n
      w8 = spread(w, 1, lane_unit)
      q8 = spread(q, 1, lane_unit)
      p8 = spread(p, 1, lane_unit)
      allocate (vq, vp, uq, up, mold=q8)
      do first = 1, self%krylov%n, lane_unit
         last = min(first + lane_unit - 1, self%krylov%n)
         vq = 0
         vp = 0
         do l = first, last
            if (l <= n) vq(l - first + 1, l) = 1
            if (l > n) vp(l - first + 1, l - n) = 1
         end do
         call hessian_product(ham, lane_unit, n, last - first + 1, t, w8, q8, p8, vq, vp, uq, up)
         do l = first, last
            associate (i => l - first + 1)
               if (self%eliminated) then
                  matrix(:, l) = vq(i, :) + c*uq(i, :)
               else
                  matrix(:n, l) = vq(i, :) - c*up(i, :)
                  matrix(n + 1:, l) = vp(i, :) + c*uq(i, :)
               end if
            end associate
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

end module symsde_step_newton_by_products
