! SPDX-License-Identifier: BSD-3-Clause
!> Newton's corrections for many degrees of freedom and dense Hessians, without forming a matrix.
!>
!> The caller multiplies by the matrix, which depends on the scheme:
!>
!> call products%begin(newton, r)      A x = r in the running lanes
!> do while (products%wanted > 0)      number of lanes that need a product
!>    ... krylov%v(:, :, krylov%k + 1) = A krylov%v(:, :, krylov%k) ...
!>    call products%take()
!> end do
!> call products%finish(newton, x, status, counters)
!>
!> A d = r is solved up to |r - A d| <= eta_k |r_k|, where r_k is the residual of Newton's iteration k, norms are
!> Euclidean, and |x| is the largest unknown:
!>
!>    eta_0 = 10^-4,   eta_k = min(10^-4, (|r_k|/|r_{k-1}|)^2),   and for k > 0 never below eps |x|/4
!>
!> (Eisenstat & Walker, SIAM J. Sci. Comput. 17 (1996) 16): the first solve is loose, and later ones follow the
!> convergence of Newton's iteration.
!>
!> Corrections come from GMRES (solve/krylov) with Hessian-vector products of the model or, if it has none, differences
!> of two gradients. The matrices are close to I unless h is large compared with the inverse frequencies, so that a few
!> products suffice. The iteration ends like all others, by solve/stagnation.
!>
!> GMRES and not conjugate gradients, since A is symmetric only if the momenta are eliminated, and the vectors are too
!> few for savings to matter.
!>
!> For lanes that GMRES cannot solve within its bound of products the matrices are formed after all, by products with
!> the unit vectors, and eliminated with exchanges of rows; these are counted. Such lanes are rare, and forming a matrix
!> takes longer than solving it, so that LAPACK is never used, however large the matrices. The protocol above is the
!> same: the caller computes products as before.
module symsde_step_implicit_newton_krylov
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: status_ok, nonfinite, not_converged
   use symsde_base_traits, only: model_traits, dense
   use symsde_model_abstract, only: model_type
   use symsde_model_kernels, only: differences_alone
   use symsde_solve_blocks, only: max_lane_unknowns
   use symsde_solve_krylov, only: krylov_type, new_krylov
   use symsde_solve_one_system, only: solve_dense_alone
   use symsde_solve_newton, only: newton_type, newton_options
   use symsde_solve_stagnation, only: correct_lanes
   implicit none
   private
   public :: newton_krylov, new_newton_krylov, pays_by_products, does_without_matrices
   public :: iterates_first

   !> Unknowns of a lane from which iterating without matrices is faster. With analytic second derivatives: where
   !> elimination across lanes ends. Without them a matrix costs two gradients for each unknown.
   integer, parameter :: least_analytic = max_lane_unknowns + 1, least_differenced = 8

   !> Unknowns q and p of a lane up to which Newton's iteration is as fast as a dozen sweeps.
   integer, parameter :: small = 4

   real(wp), parameter :: loose = 1.0e-4_wp                      !! first solve, relative to its right-hand side
   real(wp), parameter :: rounding = 0.25_wp*epsilon(1.0_wp)     !! smallest goal of a solve, relative to the unknowns

   integer(i8), parameter :: most_numbers = 2_i8**18  !! most numbers of matrices formed at once, if more than one

   !> Data of a Newton iteration by products, besides newton_type. Matrices are allocated only while they are used.
   type :: newton_krylov
      type(krylov_type) :: krylov
      integer :: wanted = 0                             !! lanes that need a product
      real(wp), allocatable :: uq(:, :), up(:, :)       !! work array for a product of the Hessian (nlane, ndof)
      real(wp), allocatable, private :: before(:), goal(:)  !! norm of the last residual, norm to be reached (nlane)
      real(wp), allocatable, private :: right(:, :)     !! right-hand side r of A d = r (nlane, unknowns)
      integer(i4), allocatable, private :: outcome(:)   !! outcome of lanes that need their matrix (nlane)
      integer, allocatable, private :: lanes(:)         !! lanes whose matrices are being formed, a few at once
      real(wp), allocatable, private :: matrices(:, :, :)  !! (unknowns, unknowns, few)
      integer, private :: column = 0                    !! current column of these matrices
      integer, private :: nsolved = 0                   !! systems solved by their matrices
   contains
      procedure :: begin
      procedure :: take
      procedure :: finish
   end type newton_krylov

contains

   !> Whether to solve without matrices: if they would be dense, and large or made of differences. A matrix whose 2 b +
   !> 1 bands are at least as many as its columns counts as dense.
   pure logical function pays_by_products(traits, unknowns)
      type(model_traits), intent(in) :: traits
      integer, intent(in) :: unknowns  !! unknowns of a lane
      logical :: full

      full = traits%bandwidth == dense .or. 2*traits%bandwidth + 1 >= traits%ndof
      pays_by_products = full .and. unknowns >= merge(least_analytic, least_differenced, &
                                                      traits%has_hessian .or. traits%has_hessian_vector)
   end function pays_by_products

   !> Whether Newton's iteration of a midpoint is solved without matrices; shortened corrections and a given number of
   !> iterations need
   !> matrices.
   pure logical function does_without_matrices(traits, unknowns, options)
      type(model_traits), intent(in) :: traits
      integer, intent(in) :: unknowns
      type(newton_options), intent(in) :: options

      does_without_matrices = pays_by_products(traits, unknowns) .and. options%is_free()
   end function does_without_matrices

   !> Whether a midpoint with unknown q and p is iterated before Newton's method uses matrices or products: if these are
   !> large, or made of differences, and more than one solve is needed.
   pure logical function iterates_first(model, options)
      class(model_type), intent(in) :: model
      type(newton_options), intent(in) :: options

      associate (traits => model%traits, unknowns => 2*model%traits%ndof)
         iterates_first = options%is_free() .and. traits%ndof > 1 .and. &
                          (pays_by_products(traits, unknowns) .or. differences_alone(model) .or. &
                           (unknowns > small .and. .not. traits%quadratic))
      end associate
   end function iterates_first

   !> Allocate for nlane lanes of this many unknowns: ndof if the momenta are eliminated, else twice as many, or the
   !> number of the stages' unknowns.
   subroutine new_newton_krylov(self, nlane, ndof, unknowns)
      type(newton_krylov), intent(out) :: self
      integer, intent(in) :: nlane, ndof, unknowns

      call new_krylov(self%krylov, nlane, unknowns)
      allocate (self%uq(nlane, ndof), self%up(nlane, ndof), self%before(nlane), self%goal(nlane))
      allocate (self%right(nlane, unknowns), self%outcome(nlane))
   end subroutine new_newton_krylov

   !> Begin to solve A d = r in the running lanes for the residual r, which is kept for lanes that need their matrix.
   !> Afterwards `wanted` is the number of lanes that need a product.
   subroutine begin(self, newton, r)
      class(newton_krylov), intent(inout) :: self
      type(newton_type), intent(in) :: newton
      real(wp), intent(in) :: r(self%krylov%nlane, self%krylov%n)

      self%right = r
      associate (krylov => self%krylov)
         call krylov%start(r, newton%last)
         call set_goals(krylov%nlane, newton%iteration, krylov%norm, newton%size, self%before, self%goal)
         call krylov%seek(self%goal)
         self%wanted = krylov%nrunning
         if (.not. krylov%running) call begin_matrices(self)
      end associate
   end subroutine begin

   !> Use the product A v_k that the caller has written to v_{k+1}: as the next vector of GMRES, or a column of the
   !> matrices. Once GMRES is done, begin the matrices of the lanes it has not solved.
   subroutine take(self)
      class(newton_krylov), intent(inout) :: self

      if (allocated(self%matrices)) then
         call take_column(self)
         return
      end if
      call self%krylov%advance()
      self%wanted = self%krylov%nrunning
      if (.not. self%krylov%running) call begin_matrices(self)
   end subroutine take

   !> Correct x <- x - d in the running lanes, and judge them. Lanes that neither GMRES nor their matrices could solve
   !> have failed before.
   subroutine finish(self, newton, x, status, counters)
      class(newton_krylov), intent(inout) :: self
      type(newton_type), intent(inout) :: newton
      real(wp), intent(inout) :: x(self%krylov%nlane, self%krylov%n)
      integer(i8), intent(inout) :: status(self%krylov%nlane)
      type(counters_type), intent(inout) :: counters

      associate (krylov => self%krylov)
         if (any(krylov%unsolved)) call settle_unsolved(self, newton, status, counters)
         call correct_lanes(krylov%nlane, krylov%n, krylov%x, newton%last, x, newton%step, newton%size)
         call newton%judge(status, counters)
      end associate
   end subroutine finish

   !> Begin with the matrices of the lanes that GMRES has not solved. A lane whose residual is not finite has
   !> failed, and needs no matrix.
   subroutine begin_matrices(self)
      type(newton_krylov), intent(inout) :: self

      self%nsolved = 0
      associate (krylov => self%krylov)
         self%outcome = merge(not_converged, nonfinite, krylov%norm <= huge(1.0_wp))
         self%lanes = [integer ::]
         if (any(krylov%unsolved)) call form_more(self, 1)
      end associate
   end subroutine begin_matrices

   !> Request the columns of the matrices of some unsolved lanes, from `lane` on: as many lanes as fit into
   !> most_numbers, at least one. Matrices of all lanes together would take too much memory for many degrees of freedom.
   !> If no memory is left, the lanes keep the outcome not_converged.
   subroutine form_more(self, lane)
      type(newton_krylov), intent(inout) :: self
      integer, intent(in) :: lane
      integer :: i, few, memory

      memory = 0
      associate (krylov => self%krylov)
         ! most_numbers bounds the number of lanes; n^2 may exceed the default integers.
         few = int(max(1_i8, most_numbers/int(krylov%n, i8)**2))
         self%lanes = pack([(i, i=lane, krylov%nlane)], &
                           krylov%unsolved(lane:) .and. self%outcome(lane:) == not_converged)
         self%lanes = self%lanes(:min(few, size(self%lanes)))
         self%wanted = size(self%lanes)
         if (allocated(self%matrices)) deallocate (self%matrices)
         if (self%wanted > 0) allocate (self%matrices(krylov%n, krylov%n, self%wanted), stat=memory)
      end associate
      ! Without memory no column is requested, and settle_unsolved makes the lanes fail.
      if (memory /= 0) self%wanted = 0
      self%column = 0
      if (self%wanted > 0) call ask_column(self)
   end subroutine form_more

   !> Request the next column: the product with a unit vector, in all lanes at once.
   subroutine ask_column(self)
      type(newton_krylov), intent(inout) :: self

      self%column = self%column + 1
      self%krylov%k = 1
      self%krylov%v(:, :, 1) = 0
      self%krylov%v(:, self%column, 1) = 1
   end subroutine ask_column

   !> Use the product as a column of the matrices. After the last column solve them, and continue with the next lanes.
   subroutine take_column(self)
      type(newton_krylov), intent(inout) :: self
      integer :: i

      do i = 1, size(self%lanes)
         self%matrices(:, self%column, i) = self%krylov%v(self%lanes(i), :, 2)
      end do
      if (self%column < self%krylov%n) then
         call ask_column(self)
      else
         call solve_lanes(self)
         call form_more(self, self%lanes(size(self%lanes)) + 1)
      end if
   end subroutine take_column

   !> Solve A d = r of these lanes with exchanges of rows, one by one; the solution replaces that of GMRES.
   subroutine solve_lanes(self)
      type(newton_krylov), intent(inout) :: self
      real(wp) :: x(self%krylov%n)
      integer :: i

      do i = 1, size(self%lanes)
         associate (lane => self%lanes(i))
            x = self%right(lane, :)
            call solve_dense_alone(size(x), self%matrices(:, :, i), x, self%outcome(lane))
            if (self%outcome(lane) == status_ok) self%krylov%x(lane, :) = x
         end associate
      end do
      self%nsolved = self%nsolved + size(self%lanes)
   end subroutine solve_lanes

   !> Mark lanes as failed whose matrices are singular or found no memory, or whose residual is not finite, and count
   !> the systems solved by their matrices.
   subroutine settle_unsolved(self, newton, status, counters)
      type(newton_krylov), intent(inout) :: self
      type(newton_type), intent(inout) :: newton
      integer(i8), intent(inout) :: status(self%krylov%nlane)
      type(counters_type), intent(inout) :: counters
      integer :: lane

      do lane = 1, self%krylov%nlane
         if (self%krylov%unsolved(lane) .and. self%outcome(lane) /= status_ok) &
            call newton%fail(lane, int(self%outcome(lane), i8), status, counters)
      end do
      counters%pivoted_solves = counters%pivoted_solves + self%nsolved
   end subroutine settle_unsolved

   ! ---- kernels ----------------------------------------------------------------------------------

   !> goal = eta_k |r_k|, the residual that GMRES must reach in every lane, by the rule in the header. `norm` is |r_k|,
   !> `before` is |r_{k-1}| and is replaced, and `size` is the size of the unknowns.
   pure subroutine set_goals(nlane, iteration, norm, size, before, goal)
      integer, intent(in) :: nlane, iteration  !! number of lanes, iterations done
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

end module symsde_step_implicit_newton_krylov
