! SPDX-License-Identifier: BSD-3-Clause
!> In which order an explicit tableau evaluates its stages, and the sums of slopes that it makes.
!>
!> Q_i waits for the Hhat_p of the stages with a_ij /= 0, P_i for the Hhat_q of those with abar_ij /= 0.
module symsde_step_explicit_plan
   use symsde_base_kinds, only: wp
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: explicit_plan, evaluation, new_explicit_plan, add_slopes, sum_slopes

   !> One evaluation: of Hhat_q, of Hhat_p, or of both, at one stage.
   type :: evaluation
      integer :: stage = 0
      logical :: force = .false.     !! Hhat_q is wanted
      logical :: velocity = .false.  !! Hhat_p is wanted
      logical :: q_moves = .false.   !! the point where it is evaluated is not that where the step began
      logical :: p_moves = .false.
   end type evaluation

   type :: explicit_plan
      integer :: nstage = 0
      real(wp), allocatable :: c(:), alpha(:), minus_alpha(:)  !! (nstage)
      real(wp), allocatable :: to_q(:, :)         !! a_ij of stage i in column i (nstage, nstage)
      real(wp), allocatable :: to_p(:, :)         !! -abar_ij of stage i in column i (nstage, nstage)
      type(evaluation), allocatable :: order(:)
   end type explicit_plan

contains

   subroutine new_explicit_plan(self, scheme, separable)
      type(explicit_plan), intent(out) :: self
      type(scheme_type), intent(in) :: scheme
      logical, intent(in) :: separable  !! H_j = T_j(p) + U_j(q)

      self%nstage = scheme%nstage
      self%c = scheme%c
      self%to_q = transpose(scheme%a)
      self%to_p = -transpose(scheme%abar)
      self%alpha = scheme%alpha
      self%minus_alpha = -scheme%alpha
      call find_order(scheme, separable, self%order)
   end subroutine new_explicit_plan

   !> The order of evaluations; not allocated where there is none.
   pure subroutine find_order(scheme, separable, found)
      type(scheme_type), intent(in) :: scheme
      logical, intent(in) :: separable
      type(evaluation), allocatable, intent(out) :: found(:)
      type(evaluation) :: next, order(2*scheme%nstage)
      logical :: has_force(scheme%nstage), has_velocity(scheme%nstage), q_ready, p_ready, moved
      integer :: i, n

      has_force = .false.
      has_velocity = .false.
      n = 0
      do
         moved = .false.
         do i = 1, scheme%nstage
            q_ready = all(has_velocity .or. abs(scheme%a(i, :)) <= 0)
            p_ready = all(has_force .or. abs(scheme%abar(i, :)) <= 0)
            next%stage = i
            next%force = q_ready .and. (separable .or. p_ready) .and. .not. has_force(i)
            next%velocity = p_ready .and. (separable .or. q_ready) .and. .not. has_velocity(i)
            if (.not. (next%force .or. next%velocity)) cycle
            next%q_moves = (next%force .or. .not. separable) .and. any(abs(scheme%a(i, :)) > 0)
            next%p_moves = (next%velocity .or. .not. separable) .and. any(abs(scheme%abar(i, :)) > 0)
            has_force(i) = has_force(i) .or. next%force
            has_velocity(i) = has_velocity(i) .or. next%velocity
            n = n + 1
            order(n) = next
            moved = .true.
         end do
         if (.not. moved) exit
      end do
      if (all(has_force) .and. all(has_velocity)) found = order(:n)
   end subroutine find_order

   !> VEC total = start + sum_j coefficient_j slope_j; slopes with coefficient zero are never read, so those
   !> that have not been evaluated yet do no harm. At least one coefficient is not zero.
   pure subroutine add_slopes(n, nstage, coefficient, slope, start, total)
      integer, intent(in) :: n, nstage
      real(wp), intent(in) :: coefficient(nstage), slope(n, nstage), start(n)
      real(wp), intent(inout) :: total(n)
      integer :: i, j, first

      first = findloc(abs(coefficient) > 0, .true., 1)
      do i = 1, n
         total(i) = start(i) + coefficient(first)*slope(i, first)
      end do
      do j = first + 1, nstage
         if (abs(coefficient(j)) <= 0) cycle
         do i = 1, n
            total(i) = total(i) + coefficient(j)*slope(i, j)
         end do
      end do
   end subroutine add_slopes

   !> VEC total = sum_j coefficient_j slope_j
   pure subroutine sum_slopes(n, nstage, coefficient, slope, total)
      integer, intent(in) :: n, nstage
      real(wp), intent(in) :: coefficient(nstage), slope(n, nstage)
      real(wp), intent(out) :: total(n)
      integer :: i, j

      do i = 1, n
         total(i) = coefficient(1)*slope(i, 1)
      end do
      do j = 2, nstage
         do i = 1, n
            total(i) = total(i) + coefficient(j)*slope(i, j)
         end do
      end do
   end subroutine sum_slopes

end module symsde_step_explicit_plan
