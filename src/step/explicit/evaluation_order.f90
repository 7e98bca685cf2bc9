! SPDX-License-Identifier: BSD-3-Clause
!> In which order an explicit tableau evaluates its stages, and the sums of slopes that it makes.
!>
!> Q_i waits for the Hhat_p of the stages with a_ij /= 0, P_i for the Hhat_q of those with abar_ij /= 0. Stages that ask
!> for the same slope at the same place share it: theirs is the sum of their coefficients.
!>
!> Private to its family.
module symsde_step_explicit_evaluation_order
   use symsde_base_kinds, only: wp
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: evaluation_order, new_explicit_plan, add_slopes, to_q, to_p

   integer, parameter :: narrow = 4  !! numbers that are summed one by one

   !> One evaluation: of Hhat_q, of Hhat_p, or of both, at one stage.
   type :: evaluation
      integer :: stage = 0
      logical :: force = .false.     !! Hhat_q is wanted
      logical :: velocity = .false.  !! Hhat_p is wanted
      logical :: q_moves = .false.   !! the point where it is evaluated is not that where the step began
      logical :: p_moves = .false.
   end type evaluation

   !> Which sums: of Hhat_p, from q to Q_i; of Hhat_q, from p to P_i.
   integer, parameter :: to_q = 1, to_p = 2

   !> Sums are of slopes times coefficients that are not zero; the slopes of others are never read. Sum i leads to stage
   !> i, sum 0 is the increment of the step. Both kinds stand in one array: a type for each, as two components, was not
   !> freed as a whole by gfortran 12.
   type :: evaluation_order
      integer :: nstage = 0
      real(wp), allocatable :: c(:)               !! nodes (nstage)
      integer, allocatable :: many(:, :)          !! slopes of a sum (0:nstage, 2)
      integer, allocatable :: stage(:, :, :)      !! whose they are (nstage, 0:nstage, 2)
      real(wp), allocatable :: weight(:, :, :)    !! their coefficients (nstage, 0:nstage, 2)
      type(evaluation), allocatable :: order(:)
   end type evaluation_order

contains

   subroutine new_explicit_plan(self, scheme, separable, still_force, still_velocity)
      type(evaluation_order), intent(out) :: self
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
      associate (s => scheme%nstage)
         allocate (self%many(0:s, 2), self%stage(s, 0:s, 2), self%weight(s, 0:s, 2))
         call find_sums(s, a, alpha, self%many(:, to_q), self%stage(:, :, to_q), self%weight(:, :, to_q))
         call find_sums(s, abar, minus_alpha, self%many(:, to_p), self%stage(:, :, to_p), self%weight(:, :, to_p))
      end associate
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

   pure subroutine find_sums(nstage, a, alpha, many, stage, weight)
      integer, intent(in) :: nstage
      real(wp), intent(in) :: a(nstage, nstage), alpha(nstage)
      integer, intent(out) :: many(0:nstage), stage(nstage, 0:nstage)
      real(wp), intent(out) :: weight(nstage, 0:nstage)
      real(wp) :: c(nstage)
      integer :: i, j

      many = 0
      stage = 0
      weight = 0
      do i = 0, nstage
         c = alpha
         if (i > 0) c = a(i, :)
         do j = 1, nstage
            if (abs(c(j)) <= 0) cycle
            many(i) = many(i) + 1
            stage(many(i), i) = j
            weight(many(i), i) = c(j)
         end do
      end do
   end subroutine find_sums

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

   !> total = start + sum k of a kind, without start sum k alone, of at least one slope.
   pure subroutine add_slopes(n, plan, kind, k, slope, total, start)
      integer, intent(in) :: n, kind, k
      type(evaluation_order), intent(in) :: plan
      real(wp), intent(in) :: slope(n, plan%nstage)
      real(wp), intent(inout) :: total(n)
      real(wp), intent(in), optional :: start(n)

      associate (many => plan%many(k, kind))
         if (n <= narrow) then
            call add_few(n, plan%nstage, many, plan%stage(1, k, kind), plan%weight(1, k, kind), slope, total, start)
         else
            call add_many(n, plan%nstage, many, plan%stage(1, k, kind), plan%weight(1, k, kind), slope, total, start)
         end if
      end associate
   end subroutine add_slopes

   !> VEC total = start + sum_j c_j slope_j
   pure subroutine add_many(n, nstage, many, stage, c, slope, total, start)
      integer, intent(in) :: n, nstage, many, stage(many)
      real(wp), intent(in) :: c(many), slope(n, nstage)
      real(wp), intent(inout) :: total(n)
      real(wp), intent(in), optional :: start(n)
      integer :: i, j

      if (present(start)) then
         do i = 1, n
            total(i) = start(i) + c(1)*slope(i, stage(1))
         end do
      else
         do i = 1, n
            total(i) = c(1)*slope(i, stage(1))
         end do
      end if
      do j = 2, many
         do i = 1, n
            total(i) = total(i) + c(j)*slope(i, stage(j))
         end do
      end do
   end subroutine add_many

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

end module symsde_step_explicit_evaluation_order
