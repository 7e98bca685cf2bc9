! SPDX-License-Identifier: BSD-3-Clause
!> In which order an explicit tableau evaluates its stages, and the sums of slopes that it makes.
!>
!> Q_i waits for the Hhat_p of the stages with a_ij /= 0, P_i for the Hhat_q of those with abar_ij /= 0. Stages that ask
!> for the same slope at the same place share it: theirs is the sum of their coefficients.
module symsde_step_explicit_plan
   use symsde_base_kinds, only: wp
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: explicit_plan, evaluation, slope_sum, new_explicit_plan, add_slopes

   integer, parameter :: narrow = 4  !! numbers that are summed one by one

   !> One evaluation: of Hhat_q, of Hhat_p, or of both, at one stage.
   type :: evaluation
      integer :: stage = 0
      logical :: force = .false.     !! Hhat_q is wanted
      logical :: velocity = .false.  !! Hhat_p is wanted
      logical :: q_moves = .false.   !! the point where it is evaluated is not that where the step began
      logical :: p_moves = .false.
   end type evaluation

   !> Slopes times coefficients that are not zero; the slopes of others are never read.
   type :: slope_sum
      integer, allocatable :: stage(:)
      real(wp), allocatable :: c(:)
   end type slope_sum

   type :: explicit_plan
      integer :: nstage = 0
      real(wp), allocatable :: c(:)                !! nodes (nstage)
      type(slope_sum), allocatable :: to_q(:)      !! of Hhat_p, from q to Q_i (nstage)
      type(slope_sum), allocatable :: to_p(:)      !! of Hhat_q, from p to P_i (nstage)
      type(slope_sum) :: dq, dp                    !! of Hhat_p, of Hhat_q
      type(evaluation), allocatable :: order(:)
   end type explicit_plan

contains

   subroutine new_explicit_plan(self, scheme, separable, still_force, still_velocity)
      type(explicit_plan), intent(out) :: self
      type(scheme_type), intent(in) :: scheme
      logical, intent(in) :: separable                    !! H_j = T_j(p) + U_j(q)
      logical, intent(in) :: still_force, still_velocity  !! known not to depend on time
      real(wp), dimension(scheme%nstage, scheme%nstage) :: a, abar  ! a_ij of Hhat_p, -abar_ij of Hhat_q, without twins
      real(wp), dimension(scheme%nstage) :: alpha, minus_alpha
      integer :: i, j

      self%nstage = scheme%nstage
      self%c = scheme%c
      a = scheme%a
      abar = -scheme%abar
      alpha = scheme%alpha
      minus_alpha = -scheme%alpha
      do i = 2, scheme%nstage
         do j = 1, i - 1
            associate (same_q => all(abs(scheme%a(i, :) - scheme%a(j, :)) <= 0), &
                       same_p => all(abs(scheme%abar(i, :) - scheme%abar(j, :)) <= 0), &
                       same_time => abs(scheme%c(i) - scheme%c(j)) <= 0)
               if (same_p .and. (same_q .or. separable) .and. (same_time .or. still_velocity)) &
                  call join(j, i, a, alpha)
               if (same_q .and. (same_p .or. separable) .and. (same_time .or. still_force)) &
                  call join(j, i, abar, minus_alpha)
            end associate
         end do
      end do
      allocate (self%to_q(scheme%nstage), self%to_p(scheme%nstage))
      do i = 1, scheme%nstage
         call find_sum(a(i, :), self%to_q(i))
         call find_sum(abar(i, :), self%to_p(i))
      end do
      call find_sum(alpha, self%dq)
      call find_sum(minus_alpha, self%dp)
      call find_order(scheme%nstage, a, abar, alpha, minus_alpha, separable, self%order)
   end subroutine new_explicit_plan

   !> The slope of stage j serves stage i, too.
   pure subroutine join(j, i, a, alpha)
      integer, intent(in) :: j, i
      real(wp), intent(inout) :: a(:, :), alpha(:)

      a(:, j) = a(:, j) + a(:, i)
      a(:, i) = 0
      alpha(j) = alpha(j) + alpha(i)
      alpha(i) = 0
   end subroutine join

   pure subroutine find_sum(c, found)
      real(wp), intent(in) :: c(:)
      type(slope_sum), intent(out) :: found
      integer :: j

      found%stage = pack([(j, j=1, size(c))], abs(c) > 0)
      found%c = c(found%stage)
   end subroutine find_sum

   !> The order of the evaluations whose slopes are read; not allocated where there is none.
   pure subroutine find_order(nstage, a, abar, alpha, minus_alpha, separable, found)
      integer, intent(in) :: nstage
      real(wp), dimension(nstage, nstage), intent(in) :: a, abar
      real(wp), intent(in) :: alpha(nstage), minus_alpha(nstage)
      logical, intent(in) :: separable
      type(evaluation), allocatable, intent(out) :: found(:)
      type(evaluation) :: next, order(2*nstage)
      logical :: has_force(nstage), has_velocity(nstage), q_ready, p_ready, moved
      integer :: i, n

      has_velocity = [(all(abs(a(:, i)) <= 0) .and. abs(alpha(i)) <= 0, i=1, nstage)]
      has_force = [(all(abs(abar(:, i)) <= 0) .and. abs(minus_alpha(i)) <= 0, i=1, nstage)]
      n = 0
      do
         moved = .false.
         do i = 1, nstage
            q_ready = all(has_velocity .or. abs(a(i, :)) <= 0)
            p_ready = all(has_force .or. abs(abar(i, :)) <= 0)
            next%stage = i
            next%force = q_ready .and. (separable .or. p_ready) .and. .not. has_force(i)
            next%velocity = p_ready .and. (separable .or. q_ready) .and. .not. has_velocity(i)
            if (.not. (next%force .or. next%velocity)) cycle
            next%q_moves = (next%force .or. .not. separable) .and. any(abs(a(i, :)) > 0)
            next%p_moves = (next%velocity .or. .not. separable) .and. any(abs(abar(i, :)) > 0)
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

   !> VEC total = start + sum_j c_j slope_j, without start the sum alone, of at least one slope.
   pure subroutine add_slopes(n, nstage, of, slope, total, start)
      integer, intent(in) :: n, nstage
      type(slope_sum), intent(in) :: of
      real(wp), intent(in) :: slope(n, nstage)
      real(wp), intent(inout) :: total(n)
      real(wp), intent(in), optional :: start(n)
      integer :: i, j

      if (n <= narrow) then
         call add_few(n, nstage, size(of%c), of%stage, of%c, slope, total, start)
         return
      end if
      if (present(start)) then
         do i = 1, n
            total(i) = start(i) + of%c(1)*slope(i, of%stage(1))
         end do
      else
         do i = 1, n
            total(i) = of%c(1)*slope(i, of%stage(1))
         end do
      end if
      do j = 2, size(of%c)
         do i = 1, n
            total(i) = total(i) + of%c(j)*slope(i, of%stage(j))
         end do
      end do
   end subroutine add_slopes

   !> The same of few numbers, which have just been written one by one: a vector of them would wait until they are in
   !> memory. Parentheses keep the first product of a sum from being contracted with the next.
   pure subroutine add_few(n, nstage, many, stage, c, slope, total, start)
      integer, intent(in) :: n, nstage, many, stage(many)
      real(wp), intent(in) :: c(many), slope(n, nstage)
      real(wp), intent(inout) :: total(n)
      real(wp), intent(in), optional :: start(n)
      real(wp) :: x
      integer :: i, j, first

      first = merge(1, 2, present(start))
      !GCC$ novector
      do i = 1, n
         if (present(start)) then
            x = start(i)
         else
            x = (c(1)*slope(i, stage(1)))
         end if
         !GCC$ novector
         do j = first, many
            x = x + c(j)*slope(i, stage(j))
         end do
         total(i) = x
      end do
   end subroutine add_few

end module symsde_step_explicit_plan
