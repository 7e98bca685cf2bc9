! SPDX-License-Identifier: BSD-3-Clause
!> Stiff stages of a path by itself: Newton's iteration of step/stages/newton with dense matrices, by its operations in
!> their order. A matrix that is not trusted is left to that, and so is what does not converge.
module symsde_step_stages_lone_newton
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: model_traits
   use symsde_model_abstract, only: model_type
   use symsde_solve_blocks, only: pivot_floor
   use symsde_solve_elimination, only: solve_lanes, solve_lone
   use symsde_solve_stagnation, only: stopping_test, quadratic, done_at_once, verdict_of, correct_lanes
   use symsde_step_stages_newton, only: is_eliminated
   use symsde_step_stages_groups, only: stage_group
   implicit none
   private
   public :: lone_stage_newton, new_lone_stage_newton, fits_lone_newton

   type :: lone_stage_newton
      private
      type(stopping_test) :: test = quadratic
      integer :: max_iter = 0
      real(wp), allocatable :: z(:, :), d(:, :), r(:, :)  !! as in step/stages/newton (nmember, n)
      real(wp), allocatable :: a(:, :, :, :)              !! matrix (nmember, n, nmember, n)
      real(wp), allocatable :: q(:), f(:), k(:, :)        !! point, gradient and Hessian of a stage
   contains
      procedure :: solve
   end type lone_stage_newton

contains

   !> Whether a group is solved by dense matrices whose derivatives are exact, and that are eliminated.
   pure logical function fits_lone_newton(traits, group)
      type(model_traits), intent(in) :: traits
      type(stage_group), intent(in) :: group

      fits_lone_newton = (traits%has_hessian .or. traits%has_hessian_vector) .and. &
                         is_eliminated(traits, group%nmember) .and. traits%ndof*group%nmember > 1
   end function fits_lone_newton

   pure subroutine new_lone_stage_newton(self, traits, group, max_iter)
      type(lone_stage_newton), intent(out) :: self
      type(model_traits), intent(in) :: traits
      type(stage_group), intent(in) :: group
      integer, intent(in) :: max_iter

      if (traits%one_solve(.false.)) self%test = done_at_once
      self%max_iter = max_iter
      associate (n => traits%ndof, s => group%nmember)
         allocate (self%z(s, n), self%d(s, n), self%r(s, n), self%a(s, n, s, n), self%q(n), self%f(n), self%k(n, n))
      end associate
   end subroutine new_lone_stage_newton

   !> The slopes of a group; no iterations where they are not found.
   subroutine solve(self, model, group, n, m, h, times, w, q, p, known, f, iterations)
      class(lone_stage_newton), intent(inout) :: self
      class(model_type), intent(in) :: model
      type(stage_group), intent(in) :: group
      integer, intent(in) :: n, m                       !! degrees of freedom, noises
      real(wp), intent(in) :: h, times(group%nmember), w(0:m), q(n), p(n)
      real(wp), intent(in) :: known(n, group%nmember)   !! Q_i where the slopes of the group are zero
      real(wp), intent(out) :: f(n, group%nmember)      !! Hhat_q of its stages
      integer, intent(out) :: iterations
      real(wp) :: last, smallest(1), step(1), size(1)
      integer :: i

      associate (s => group%nmember)
         do i = 1, n
            self%z(:, i) = 0
            self%d(:, i) = known(i, :) - q(i)
         end do
         last = 0
         do iterations = 1, self%max_iter
            call linearise(self, model, n, s, m, h, group%b, times, w, q, p, self%z, self%r, self%a)
            if (n*s > 2) then
               call solve_lone(n*s, self%a, self%r, smallest(1))
            else
               call solve_lanes(1, n*s, self%a, self%r, smallest)
            end if
            if (.not. smallest(1) > pivot_floor) exit
            call correct_lanes(1, n*s, self%r, [0.0_wp], self%z, step, size)
            if (.not. step(1) + size(1) <= huge(h)) exit
            last = verdict_of(self%test, step(1), size(1), last)
            if (last >= 0) cycle
            call find_slopes(self, model, group, n, m, h, times, w, q, p, f)
            return
         end do
      end associate
      iterations = 0
   end subroutine solve

   !> Residual and matrix.
   subroutine linearise(self, model, n, s, m, h, b, times, w, q, p, z, r, a)
      type(lone_stage_newton), intent(inout) :: self
      class(model_type), intent(in) :: model
      integer, intent(in) :: n, s, m
      real(wp), intent(in) :: h, b(s, s), times(s), w(0:m), q(n), p(n), z(s, n)
      real(wp), intent(out) :: r(s, n), a(s, n, s, n)
      integer :: stage, i

      !GCC$ novector  ! what has just been written number by number
      do i = 1, n
         r(:, i) = z(:, i) - self%d(:, i)
      end do
      do stage = 1, s
         !GCC$ novector
         do i = 1, n
            self%q(i) = q(i) + z(stage, i)
         end do
         associate (x => self%q, f => self%f, k => self%k, time => times(stage))
            if (n == 2) then
               call model%pair(m, time, w, x(1), x(2), f(1), f(2), k(1, 1), k(2, 1), k(1, 2), k(2, 2))
            else
               call model%gradient_hessian(1, n, m, time, w, x, p, hq=f, hqq=k)
            end if
         end associate
         call add_stage(n, s, stage, h, b(1, stage), self%f, self%k, r, a)
      end do
   end subroutine linearise

   !> What a stage adds to all rows.
   pure subroutine add_stage(n, s, stage, h, b, f, k, r, a)
      integer, intent(in) :: n, s, stage
      real(wp), intent(in) :: h, b(s), f(n), k(n, n)
      real(wp), intent(inout) :: r(s, n), a(s, n, s, n)
      real(wp) :: hb
      integer :: row, i, j

      do row = 1, s
         hb = h*b(row)
         do j = 1, n
            r(row, j) = r(row, j) + hb*f(j)
            !GCC$ novector  ! few numbers
            do i = 1, n
               a(row, i, stage, j) = (hb*k(i, j))  ! in parentheses: not contracted with what follows
            end do
         end do
      end do
      do j = 1, n
         a(stage, j, stage, j) = a(stage, j, stage, j) + 1
      end do
   end subroutine add_stage

   !> h B G = z - d, or by one more evaluation.
   subroutine find_slopes(self, model, group, n, m, h, times, w, q, p, f)
      type(lone_stage_newton), intent(inout) :: self
      class(model_type), intent(in) :: model
      type(stage_group), intent(in) :: group
      integer, intent(in) :: n, m
      real(wp), intent(in) :: h, times(group%nmember), w(0:m), q(n), p(n)
      real(wp), intent(out) :: f(n, group%nmember)
      real(wp) :: sum
      integer :: stage, i, k

      do stage = 1, group%nmember
         if (.not. allocated(group%inverse)) then
            self%q = q + self%z(stage, :)
            call model%gradient(1, n, m, times(stage), w, self%q, p, hq=f(1, stage))
            cycle
         end if
         do i = 1, n
            sum = 0
            !GCC$ novector  ! sums in order, contracted as in lanes
            do k = 1, group%nmember
               sum = sum - group%inverse(stage, k)/h*(self%z(k, i) - self%d(k, i))
            end do
            f(i, stage) = sum
         end do
      end do
   end subroutine find_slopes

end module symsde_step_stages_lone_newton
