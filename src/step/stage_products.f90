! SPDX-License-Identifier: BSD-3-Clause
!> Newton's corrections of several implicit stages without matrices, for many degrees of freedom and dense
!> Hessians: as in step/newton_by_products, with the matrix delta_ik I + h B_ik Hhat_qq(Q_k), of which a
!> product takes one Hessian-vector product a stage.
module symsde_step_stage_products
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_status, only: status_ok, nonfinite, not_converged
   use symsde_solve_krylov, only: krylov_type, new_krylov
   use symsde_solve_lapack, only: solve_dense_lapack
   use symsde_solve_newton, only: newton_type
   use symsde_solve_stagnation, only: correct_lanes
   use symsde_step_newton_by_products, only: hessian_product, set_goals
   use symsde_step_stage_equations, only: stage_equations
   use symsde_step_stage_plan, only: stage_group
   implicit none
   private
   public :: stage_products, new_stage_products

   type :: stage_products
      private
      type(krylov_type) :: krylov
      real(wp), allocatable :: q(:, :), v(:, :), zero(:, :), u(:, :), up(:, :)  !! (nlane, ndof)
      real(wp), allocatable :: before(:), goal(:)  !! sizes of the last residual, and to be reached (nlane)
   contains
      procedure :: correct
   end type stage_products

contains

   !> Room for nlane lanes, n degrees of freedom and so many stages.
   subroutine new_stage_products(self, nlane, n, nmember)
      type(stage_products), intent(out) :: self
      integer, intent(in) :: nlane, n, nmember

      call new_krylov(self%krylov, nlane, n*nmember)
      allocate (self%q(nlane, n), self%v(nlane, n), self%u(nlane, n), self%up(nlane, n))
      allocate (self%before(nlane), self%goal(nlane))
      allocate (self%zero(nlane, n), source=0.0_wp)
   end subroutine new_stage_products

   !> Correct the displacements z of the running lanes for the residual r, and judge them.
   subroutine correct(self, equations, group, r, newton, z, status)
      class(stage_products), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      real(wp), intent(in) :: r(equations%ham%nlane, self%krylov%n)
      type(newton_type), intent(inout) :: newton
      real(wp), intent(inout) :: z(equations%ham%nlane, group%nmember, equations%ham%ndof)
      integer(i8), intent(inout) :: status(equations%ham%nlane)

      associate (krylov => self%krylov, nlane => equations%ham%nlane)
         call krylov%start(r, newton%last)
         call set_goals(nlane, newton%iteration, krylov%norm, newton%size, self%before, self%goal)
         call krylov%seek(self%goal)
         do while (krylov%running)
            call multiply(self, equations, group, z, krylov%k)
            call krylov%advance()
         end do
         if (any(krylov%unsolved)) call solve_unsolved(self, equations, group, r, newton, z, status)
         call correct_lanes(nlane, krylov%n, krylov%x, newton%last, z, newton%step, newton%size)
      end associate
      call newton%judge(status, equations%ham%counters)
   end subroutine correct

   !> Vector k+1 = the matrix times vector k.
   subroutine multiply(self, equations, group, z, k)
      type(stage_products), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      real(wp), intent(in) :: z(equations%ham%nlane, group%nmember, equations%ham%ndof)
      integer, intent(in) :: k
      integer :: m, row

      associate (e => equations, s => group%nmember, v => self%krylov%v)
         v(:, :, k + 1) = v(:, :, k)
         do m = 1, s
            self%q = e%q + z(:, m, :)
            self%v = v(:, m::s, k)
            call hessian_product(e%ham, e%ham%nlane, e%ham%ndof, self%krylov%nrunning, e%time_of(group%stage(m)), &
                                 e%store%w(:, :, 0), self%q, e%p, self%v, self%zero, self%u, self%up)
            do row = 1, s
               v(:, row::s, k + 1) = v(:, row::s, k + 1) + e%step%h*group%b(row, m)*self%u
            end do
         end do
      end associate
   end subroutine multiply

   !> The lanes that GMRES has not solved, by their matrices, from products with the unit vectors, and LAPACK;
   !> those that cannot be solved fail.
   subroutine solve_unsolved(self, equations, group, r, newton, z, status)
      type(stage_products), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      real(wp), intent(in) :: r(equations%ham%nlane, self%krylov%n)
      type(newton_type), intent(inout) :: newton
      real(wp), intent(in) :: z(equations%ham%nlane, group%nmember, equations%ham%ndof)
      integer(i8), intent(inout) :: status(equations%ham%nlane)
      real(wp), allocatable :: matrices(:, :, :), matrix(:, :), x(:)
      integer(i4) :: info
      integer :: lane, j, memory

      associate (krylov => self%krylov, v => self%krylov%v)
         allocate (matrices(equations%ham%nlane, krylov%n, krylov%n), matrix(krylov%n, krylov%n), x(krylov%n), &
                   stat=memory)
         if (memory /= 0) then
            do lane = 1, equations%ham%nlane
               if (krylov%unsolved(lane)) &
                  call newton%fail(lane, int(not_converged, i8), status, equations%ham%counters)
            end do
            return
         end if
         do j = 1, krylov%n
            v(:, :, 1) = 0
            v(:, j, 1) = 1
            call multiply(self, equations, group, z, 1)
            matrices(:, :, j) = v(:, :, 2)
         end do
         do lane = 1, equations%ham%nlane
            if (.not. krylov%unsolved(lane)) cycle
            info = nonfinite
            if (krylov%norm(lane) <= huge(1.0_wp)) then
               matrix = matrices(lane, :, :)
               x = r(lane, :)
               call solve_dense_lapack(krylov%n, matrix, x, info)
               equations%ham%counters%lapack_solves = equations%ham%counters%lapack_solves + 1
            end if
            if (info == status_ok) then
               krylov%x(lane, :) = x
            else
               call newton%fail(lane, int(info, i8), status, equations%ham%counters)
            end if
         end do
      end associate
   end subroutine solve_unsolved

end module symsde_step_stage_products
