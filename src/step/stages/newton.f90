! SPDX-License-Identifier: BSD-3-Clause
!> Stiff steps: Newton's iteration for a group of stages where the momenta are eliminated.
!>
!> Unknown are the displacements Z_i = Q_i - q_n, because the slopes would lose digits where h omega > 1:
!>
!>    Z_i - d_i + h sum_k B_ik Hhat_q(q_n + Z_k) = 0        d_i: what Z_i has of p_n and of earlier groups
!>
!> with the matrix delta_ik I + h B_ik Hhat_qq(q_n + Z_k). From Z = 0 on, its iterates are those of the
!> general stepper from slopes zero, to rounding, so that both find the same root; the general one's test for
!> the end takes an iteration or some more. Unknowns are ordered by degree of freedom, then stage: a Hessian with
!> b bands beside the diagonal gives a matrix with (b + 1) s - 1, for s stages; many in a dense one are found by
!> products, without matrices. The slopes follow from h B G = Z - d.
!>
!> Private to its family.
module symsde_step_stages_newton
   use symsde_base_kinds, only: wp, i8
   use symsde_base_traits, only: model_traits, dense
   use symsde_solve_blocks, only: max_lane_unknowns
   use symsde_solve_newton, only: newton_type, newton_options, new_newton
   use symsde_step_implicit_newton_krylov, only: newton_krylov, new_newton_krylov, hessian_product, pays_by_products
   use symsde_step_stages_equations, only: stage_equations
   use symsde_step_stages_groups, only: stage_group
   implicit none
   private
   public :: stage_newton, new_stage_newton, is_eliminated

   type :: stage_newton
      private
      type(newton_type) :: newton
      type(newton_krylov), allocatable :: products  !! where no matrix is formed
      integer :: nmember = 0, band = dense      !! stages, bands of the Hessian
      real(wp), allocatable :: z(:, :, :)       !! displacements (nlane, nmember, ndof)
      real(wp), allocatable :: d(:, :, :)       !! what they have of known slopes (nlane, ndof, nmember)
      real(wp), allocatable :: k(:, :, :)       !! Hessian of a stage, dense or its upper bands
      real(wp), allocatable :: r(:, :)          !! residual (nlane, nmember ndof)
      real(wp), allocatable :: still(:, :)      !! zero (nlane, ndof)
   contains
      procedure :: solve
   end type stage_newton

contains

   !> A solver for one group of stages.
   subroutine new_stage_newton(self, equations, group, options)
      type(stage_newton), intent(out) :: self
      type(stage_equations), intent(in) :: equations
      type(stage_group), intent(in) :: group
      type(newton_options), intent(in) :: options
      integer :: width

      associate (n => equations%ham%ndof, nlane => equations%ham%nlane, t => equations%ham%model%traits)
         self%nmember = group%nmember
         self%band = bands_of(t, self%nmember)
         width = (self%band + 1)*self%nmember - 1
         allocate (self%z(nlane, self%nmember, n), self%d(nlane, n, self%nmember))
         if (pays_by_products(t, n*self%nmember)) then
            allocate (self%products, self%r(nlane, n*self%nmember))
            allocate (self%still(nlane, n), source=0.0_wp)
            call new_newton_krylov(self%products, nlane, n, n*self%nmember)
            call new_newton(self%newton, nlane, n*self%nmember, options, .false., dense, dense, judge_only=.true.)
            return
         end if
         call new_newton(self%newton, nlane, n*self%nmember, options, t%one_solve(self%band /= dense), width, width, &
                         exact=t%has_hessian_vector .or. (t%has_hessian .and. self%band == dense))
         if (self%band == dense) then
            allocate (self%k(nlane, n, n))
         else
            allocate (self%k(nlane, 0:self%band, n))
         end if
      end associate
   end subroutine new_stage_newton

   !> Bands of the Hessian; dense where those of the matrix would be all of it.
   pure integer function bands_of(traits, nmember) result(band)
      type(model_traits), intent(in) :: traits
      integer, intent(in) :: nmember

      band = traits%bandwidth
      if (2*(band + 1)*nmember - 1 >= traits%ndof*nmember) band = dense
   end function bands_of

   !> Whether matrices of a group are dense, and so small that they are eliminated.
   pure logical function is_eliminated(traits, nmember)
      type(model_traits), intent(in) :: traits
      integer, intent(in) :: nmember

      is_eliminated = bands_of(traits, nmember) == dense .and. traits%ndof*nmember <= max_lane_unknowns .and. &
                      .not. pays_by_products(traits, traits%ndof*nmember)
   end function is_eliminated

   !> The slopes of the group's stages, in lanes whose outcome is 0; others rest. A lane that fails gets its code.
   subroutine solve(self, equations, group, outcome)
      class(stage_newton), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      integer(i8), intent(inout) :: outcome(equations%ham%nlane)

      self%z = 0
      call find_known(self, equations, group)
      call self%newton%start(outcome)
      do while (self%newton%running)
         if (allocated(self%products)) then
            call linearise(self, equations, group, self%r)
            call self%products%begin(self%newton, self%r)
            do while (self%products%wanted > 0)
               call multiply(self, equations, group)
               call self%products%take()
            end do
            call self%products%finish(self%newton, self%z, outcome, equations%ham%counters)
         else
            call linearise(self, equations, group, self%newton%r)
            call correct(self, equations, outcome)
         end if
      end do
      call find_slopes(self, equations, group, outcome)
   end subroutine solve

   !> d: base - q_n and the slopes of earlier groups.
   subroutine find_known(self, equations, group)
      type(stage_newton), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      integer :: m

      do m = 1, self%nmember
         call equations%place_known(group, m)
         self%d(:, :, m) = equations%qs - equations%q
      end do
   end subroutine find_known

   !> Vector l+1 = delta_ik I + h B_ik Hhat_qq(Q_k) times vector l: one product with a Hessian for every stage.
   subroutine multiply(self, equations, group)
      type(stage_newton), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      integer :: m, row

      associate (e => equations, s => self%nmember, v => self%products%krylov%v, l => self%products%krylov%k, &
                 u => self%products%uq)
         v(:, :, l + 1) = v(:, :, l)
         do m = 1, s
            e%qs = e%q + self%z(:, m, :)
            call hessian_product(e%ham, e%ham%nlane, e%ham%ndof, self%products%wanted, e%time_of(group%stage(m)), &
                                 e%store%w(:, :, 0), e%qs, e%p, v(:, m::s, l), self%still, u, self%products%up)
            do row = 1, s
               v(:, row::s, l + 1) = v(:, row::s, l + 1) + e%step%h*group%b(row, m)*u
            end do
         end do
      end associate
   end subroutine multiply

   !> Residual and, where one is formed, matrix.
   subroutine linearise(self, equations, group, r)
      type(stage_newton), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      real(wp), intent(inout) :: r(equations%ham%nlane, self%newton%n)
      integer :: m

      if (allocated(self%newton%a)) self%newton%a = 0
      if (allocated(self%newton%bands)) self%newton%bands = 0
      do m = 1, self%nmember
         r(:, m::self%nmember) = self%z(:, m, :) - self%d(:, :, m)
      end do
      do m = 1, self%nmember
         call add_stage(self, equations, group, m, r)
      end do
   end subroutine linearise

   !> What gradient and Hessian at stage m add to all rows.
   subroutine add_stage(self, equations, group, m, r)
      type(stage_newton), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      integer, intent(in) :: m
      real(wp), intent(inout) :: r(equations%ham%nlane, self%newton%n)
      real(wp) :: hb
      integer :: row

      associate (e => equations, ham => equations%ham, s => self%nmember, n => equations%ham%ndof)
         e%qs = e%q + self%z(:, m, :)
         if (allocated(self%products)) then
            call e%evaluate(group%stage(m))
         else if (self%band == dense) then
            call ham%model%gradient_hessian(ham%nlane, n, ham%nnoise, e%time_of(group%stage(m)), &
                                            e%store%w(:, :, 0), e%qs, e%p, hq=e%hq, hqq=self%k)
         else
            call ham%model%force_stiffness(ham%nlane, n, ham%nnoise, self%band, e%time_of(group%stage(m)), &
                                           e%store%w(:, :, 0), e%qs, e%p, e%hq, self%k)
         end if
         do row = 1, s
            hb = e%step%h*group%b(row, m)
            r(:, row::s) = r(:, row::s) + hb*e%hq
            if (allocated(self%newton%a)) call add_dense(ham%nlane, n, s, row, m, hb, self%k, self%newton%a)
            if (allocated(self%newton%bands)) &
               call add_banded(ham%nlane, n, s, self%band, row, m, hb, self%k, self%newton%bands)
         end do
         if (allocated(self%products)) return
         ham%counters%gradients = ham%counters%gradients + ham%nreal
         ham%counters%hessians = ham%counters%hessians + ham%nreal
      end associate
   end subroutine add_stage

   !> Newton's correction. One unknown: z + r = 0 with the derivative 1 + a.
   subroutine correct(self, equations, outcome)
      type(stage_newton), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      integer(i8), intent(inout) :: outcome(equations%ham%nlane)

      if (self%newton%n > 1) then
         call self%newton%update(self%z, outcome, equations%ham%counters)
      else
         self%newton%r = self%newton%r - self%z(:, :, 1)
         self%newton%a = self%newton%a - 1
         call self%newton%update_scalar(1.0_wp, 1.0_wp, self%z, outcome, equations%ham%counters)
      end if
   end subroutine correct

   !> h B G = Z - d in lanes that Newton's iteration has solved; by one more evaluation where B is singular.
   subroutine find_slopes(self, equations, group, outcome)
      type(stage_newton), intent(inout) :: self
      type(stage_equations), intent(inout) :: equations
      type(stage_group), intent(in) :: group
      integer(i8), intent(in) :: outcome(equations%ham%nlane)
      integer :: m, k, i

      associate (e => equations)
         do m = 1, self%nmember
            if (allocated(group%inverse)) then
               e%hq = 0
               do k = 1, self%nmember
                  e%hq = e%hq - group%inverse(m, k)/e%step%h*(self%z(:, k, :) - self%d(:, :, k))
               end do
            else
               e%qs = e%q + self%z(:, m, :)
               call e%evaluate(group%stage(m))
            end if
            do i = 1, e%ham%ndof
               e%g(:, i, group%stage(m)) = merge(-e%hq(:, i), e%g(:, i, group%stage(m)), outcome == 0)
            end do
         end do
      end associate
   end subroutine find_slopes

   ! ---- kernels ----------------------------------------------------------------------------------

   !> Entries (row, column) of every pair of degrees of freedom.
   pure subroutine add_dense(nlane, n, s, row, column, hb, k, a)
      integer, intent(in) :: nlane, n, s, row, column
      real(wp), intent(in) :: hb, k(nlane, n, n)
      real(wp), intent(inout) :: a(nlane, s, n, s, n)
      integer :: i, j

      do j = 1, n
         do i = 1, n
            a(:, row, i, column, j) = hb*k(:, i, j)
         end do
         if (row == column) a(:, row, j, column, j) = a(:, row, j, column, j) + 1
      end do
   end subroutine add_dense

   !> The same from the upper bands k(lane, d, i) = K(i, i+d) of a symmetric matrix, into bands of rows.
   pure subroutine add_banded(nlane, n, s, b, row, column, hb, k, bands)
      integer, intent(in) :: nlane, n, s, b, row, column
      real(wp), intent(in) :: hb, k(nlane, 0:b, n)
      real(wp), intent(inout) :: bands(nlane, -(b + 1)*s + 1:(b + 1)*s - 1, s, n)
      integer :: i, d

      do i = 1, n
         do d = max(-b, 1 - i), min(b, n - i)
            if (d < 0) then
               bands(:, d*s + column - row, row, i) = hb*k(:, -d, i + d)
            else
               bands(:, d*s + column - row, row, i) = hb*k(:, d, i)
            end if
         end do
         if (row == column) bands(:, 0, row, i) = bands(:, 0, row, i) + 1
      end do
   end subroutine add_banded

end module symsde_step_stages_newton
