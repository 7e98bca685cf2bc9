! SPDX-License-Identifier: BSD-3-Clause
!> The order in which an explicit tableau evaluates its stages, and its sums of slopes.
!>
!>    Q_i = q_n + sum_j a_ij v_j,   P_i = p_n - sum_j abar_ij f_j,   v_j = Hhat_p(Q_j, P_j),   f_j = Hhat_q(Q_j, P_j)
!>    dq  = sum_j alpha_j v_j,      dp = -sum_j alpha_j f_j
!>
!> Q_i needs the v_j with a_ij /= 0, P_i the f_j with abar_ij /= 0; v_i needs P_i, and Q_i unless Hamiltonians are
!> separable, and f_i correspondingly. So an evaluation is possible once the slopes it needs are known. First, stages
!> that need the same slope at the same point and time are joined (new_explicit_plan): the first of them gets the sum of
!> their coefficients. Then each slope that some sum reads is put into the order as soon as it can be evaluated
!> (find_order), and each sum is stored as a list of stages and coefficients (find_sums).
!>
!> Private to its family.
module symsde_step_explicit_evaluation_order
   use symsde_base_kinds, only: wp
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: evaluation_order, new_explicit_plan, add_slopes, to_q, to_p

   !> One evaluation: of Hhat_q, of Hhat_p, or of both, at one stage.
   type :: evaluation
      integer :: stage = 0
      logical :: force = .false.     !! whether Hhat_q is evaluated
      logical :: velocity = .false.  !! whether Hhat_p is evaluated
      logical :: q_moves = .false.   !! whether Q_i is read and is not q_n; p_moves likewise for P_i and p_n
      logical :: p_moves = .false.
   end type evaluation

   !> The two kinds of sums: sums of Hhat_p lead from q to Q_i, sums of Hhat_q from p to P_i.
   integer, parameter :: to_q = 1, to_p = 2

   !> The plan of a scheme. Sums contain slopes with nonzero coefficients; other slopes are never read. Sum i leads to
   !> stage i, sum 0 is the increment of the step. Both kinds are in one array: with a component for each kind, gfortran
   !> 12 did not free everything.
   type :: evaluation_order
      integer :: nstage = 0
      real(wp), allocatable :: c(:)               !! nodes (nstage)
      integer, allocatable :: many(:, :)          !! number of slopes in each sum (0:nstage, 2)
      integer, allocatable :: stage(:, :, :)      !! the stages of these slopes (nstage, 0:nstage, 2)
      real(wp), allocatable :: weight(:, :, :)    !! coefficients of the slopes (nstage, 0:nstage, 2)
      type(evaluation), allocatable :: order(:)
   end type evaluation_order

contains

   !> Find the order of evaluation of a tableau whose drift and noise share coefficients. If stages depend on each other
   !> cyclically, there is none, and self%order is not allocated.
   subroutine new_explicit_plan(self, scheme, separable, still_force, still_velocity)
      type(evaluation_order), intent(out) :: self
      type(scheme_type), intent(in) :: scheme
      logical, intent(in) :: separable                    !! H_j = T_j(p) + U_j(q)
      logical, intent(in) :: still_force, still_velocity  !! Hhat_q, Hhat_p do not depend on time
      real(wp), dimension(scheme%nstage, scheme%nstage) :: a, abar  ! a_ij, -abar_ij, with stages joined
      real(wp), dimension(scheme%nstage) :: alpha, minus_alpha
      integer :: i, j

      ! Signs are part of the coefficients, so that both kinds of sums are added.
      self%nstage = scheme%nstage
      self%c = scheme%c
      a = scheme%a
      abar = -scheme%abar
      alpha = scheme%alpha
      minus_alpha = -scheme%alpha
      ! Stages i and j have the same Q if their rows of a agree, and the same P if their rows of abar agree.
      ! Compare rows of the scheme: joining moves coefficients between columns without changing the sums.
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
      ! Joined stages have zero columns, so no sum reads their slopes, and they are not evaluated.
      call find_order(scheme%nstage, a, abar, alpha, minus_alpha, separable, self%order)
   end subroutine new_explicit_plan

   !> Use the slope of stage j for stage i too: column i of the coefficients is added to column j and becomes zero, so
   !> that slope i is never read.
   pure subroutine join(j, i, a, alpha)
      integer, intent(in) :: j, i
      real(wp), intent(inout) :: a(:, :), alpha(:)

      a(:, j) = a(:, j) + a(:, i)
      a(:, i) = 0
      alpha(j) = alpha(j) + alpha(i)
      alpha(i) = 0
   end subroutine join

   !> Write the sums as lists: many(i) slopes in sum i, of the stages stage(:, i) in rising order, with the
   !> coefficients weight(:, i). Row i of a leads to stage i, alpha (i = 0) to the increment.
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
         ! Sum 0 has the weights, sum i the row of stage i.
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

   !> Find the order of all evaluations whose slopes are read; not allocated if there is none. Each pass over the stages
   !> takes those that are ready, until a pass finds none. Force and velocity of a stage that are ready at the same time
   !> are one evaluation, since models share work between them.
   pure subroutine find_order(nstage, a, abar, alpha, minus_alpha, separable, found)
      integer, intent(in) :: nstage
      real(wp), dimension(nstage, nstage), intent(in) :: a, abar
      real(wp), intent(in) :: alpha(nstage), minus_alpha(nstage)
      logical, intent(in) :: separable
      type(evaluation), allocatable, intent(out) :: found(:)
      type(evaluation) :: next, order(2*nstage)
      logical :: has_force(nstage), has_velocity(nstage), q_ready, p_ready, moved
      integer :: i, n

      ! A slope that no sum reads counts as known.
      has_velocity = [(all(abs(a(:, i)) <= 0) .and. abs(alpha(i)) <= 0, i=1, nstage)]
      has_force = [(all(abs(abar(:, i)) <= 0) .and. abs(minus_alpha(i)) <= 0, i=1, nstage)]
      n = 0
      do
         moved = .false.
         do i = 1, nstage
            ! Whether every slope in the sum of Q_i, or of P_i, is known.
            q_ready = all(has_velocity .or. abs(a(i, :)) <= 0)
            p_ready = all(has_force .or. abs(abar(i, :)) <= 0)
            ! Evaluate at this stage whatever has its arguments and is not evaluated yet.
            next%stage = i
            next%force = q_ready .and. (separable .or. p_ready) .and. .not. has_force(i)
            next%velocity = p_ready .and. (separable .or. q_ready) .and. .not. has_velocity(i)
            if (.not. (next%force .or. next%velocity)) cycle
            ! For the force separable models read only Q, for the velocity only P: the other argument is not computed.
            next%q_moves = (next%force .or. .not. separable) .and. any(abs(a(i, :)) > 0)
            next%p_moves = (next%velocity .or. .not. separable) .and. any(abs(abar(i, :)) > 0)
            has_force(i) = has_force(i) .or. next%force
            has_velocity(i) = has_velocity(i) .or. next%velocity
            n = n + 1
            order(n) = next
            moved = .true.
         end do
         ! A pass without an evaluation: all slopes are known, or the remaining ones depend on each other.
         if (.not. moved) exit
      end do
      ! Slopes still missing depend on each other: the scheme is not explicit for such a model.
      if (all(has_force) .and. all(has_velocity)) found = order(:n)
   end subroutine find_order

   !> VEC total = start + sum k of a kind (to_q or to_p), or sum k alone if there is no start; the sum has at least one
   !> slope. Slopes are (n, nstage), where n is all numbers of a block or of a path. Products are added in the order of
   !> the stages.
   pure subroutine add_slopes(n, plan, kind, k, slope, total, start)
      integer, intent(in) :: n, kind, k
      type(evaluation_order), intent(in) :: plan
      real(wp), intent(in) :: slope(n, plan%nstage)
      real(wp), intent(inout) :: total(n)
      real(wp), intent(in), optional :: start(n)
      integer :: i, j

      associate (stage => plan%stage(:, k, kind), c => plan%weight(:, k, kind))
         ! If there is a start, add the first product to it; otherwise the first product begins the sum.
         if (present(start)) then
            do i = 1, n
               total(i) = start(i) + c(1)*slope(i, stage(1))
            end do
         else
            do i = 1, n
               total(i) = c(1)*slope(i, stage(1))
            end do
         end if
         do j = 2, plan%many(k, kind)
            do i = 1, n
               total(i) = total(i) + c(j)*slope(i, stage(j))
            end do
         end do
      end associate
   end subroutine add_slopes

end module symsde_step_explicit_evaluation_order
