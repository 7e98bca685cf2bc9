! SPDX-License-Identifier: BSD-3-Clause
!> In which order an explicit tableau evaluates its stages, and the sums of slopes that it makes.
!>
!>    Q_i = q_n + sum_j a_ij v_j,   P_i = p_n - sum_j abar_ij f_j,   v_j = Hhat_p(Q_j, P_j),   f_j = Hhat_q(Q_j, P_j)
!>    dq  = sum_j alpha_j v_j,      dp = -sum_j alpha_j f_j
!>
!> Q_i waits for the v_j with a_ij /= 0, P_i for the f_j with abar_ij /= 0; v_i itself waits for P_i, and for Q_i unless
!> Hamiltonians are separable, and f_i the other way round. So an evaluation may come when those it waits for are there.
!> First, stages that ask for the same slope at the same place and time are joined (new_explicit_plan): the first of
!> them gets the sum of their coefficients. Then each slope that some sum reads is put into the order as soon as it can
!> be evaluated (find_order), and each sum is written down as a list of stages and coefficients (find_sums).
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
      logical :: force = .false.     !! Hhat_q is wanted
      logical :: velocity = .false.  !! Hhat_p is wanted
      logical :: q_moves = .false.   !! Q_i is read, and is not q_n; p_moves says the same of P_i and p_n
      logical :: p_moves = .false.
   end type evaluation

   !> Which of the two kinds of sums is meant: sums of Hhat_p lead from q to Q_i, sums of Hhat_q from p to P_i.
   integer, parameter :: to_q = 1, to_p = 2

   !> The plan of a scheme. Sums are of slopes times coefficients that are not zero; the slopes of others are never
   !> read. Sum i leads to stage i, sum 0 is the increment of the step. Both kinds stand in one array: a type for
   !> each, as two components, was not freed as a whole by gfortran 12.
   type :: evaluation_order
      integer :: nstage = 0
      real(wp), allocatable :: c(:)               !! nodes (nstage)
      integer, allocatable :: many(:, :)          !! how many slopes each sum has (0:nstage, 2)
      integer, allocatable :: stage(:, :, :)      !! the stages of these slopes (nstage, 0:nstage, 2)
      real(wp), allocatable :: weight(:, :, :)    !! their coefficients (nstage, 0:nstage, 2)
      type(evaluation), allocatable :: order(:)
   end type evaluation_order

contains

   !> Find the order of evaluation of a tableau whose drift and noise share coefficients. If stages wait for each
   !> other, there is none, and self%order is not allocated.
   subroutine new_explicit_plan(self, scheme, separable, still_force, still_velocity)
      type(evaluation_order), intent(out) :: self
      type(scheme_type), intent(in) :: scheme
      logical, intent(in) :: separable                    !! H_j = T_j(p) + U_j(q)
      logical, intent(in) :: still_force, still_velocity  !! known not to depend on time
      real(wp), dimension(scheme%nstage, scheme%nstage) :: a, abar  ! a_ij, -abar_ij, with stages joined
      real(wp), dimension(scheme%nstage) :: alpha, minus_alpha
      integer :: i, j

      ! Signs go into the coefficients: both kinds of sums are added then.
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
      ! Joined stages have columns of zeros, so their slopes are read by no sum and are not evaluated.
      call find_order(scheme%nstage, a, abar, alpha, minus_alpha, separable, self%order)
   end subroutine new_explicit_plan

   !> Let the slope of stage j serve stage i, too: column i of the coefficients is added to column j and becomes zero,
   !> so that slope i is never read.
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

   !> Find the order of all evaluations whose slopes are read; not allocated if there is none. Each pass over the
   !> stages takes the stages that are ready, until a pass finds none. Force and velocity of a stage that are ready
   !> together are one evaluation, since models share work between them.
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
            ! Every slope in the sum of Q_i, or of P_i, is there already.
            q_ready = all(has_velocity .or. abs(a(i, :)) <= 0)
            p_ready = all(has_force .or. abs(abar(i, :)) <= 0)
            ! Evaluate at this stage what has its arguments and is not evaluated yet.
            next%stage = i
            next%force = q_ready .and. (separable .or. p_ready) .and. .not. has_force(i)
            next%velocity = p_ready .and. (separable .or. q_ready) .and. .not. has_velocity(i)
            if (.not. (next%force .or. next%velocity)) cycle
            ! Separable models read Q for the force and P for the velocity alone: the other one need not be placed.
            next%q_moves = (next%force .or. .not. separable) .and. any(abs(a(i, :)) > 0)
            next%p_moves = (next%velocity .or. .not. separable) .and. any(abs(abar(i, :)) > 0)
            has_force(i) = has_force(i) .or. next%force
            has_velocity(i) = has_velocity(i) .or. next%velocity
            n = n + 1
            order(n) = next
            moved = .true.
         end do
         ! A pass without an evaluation: all are there, or the rest wait for each other.
         if (.not. moved) exit
      end do
      ! Slopes still missing wait for each other: the scheme is not explicit for such a model.
      if (all(has_force) .and. all(has_velocity)) found = order(:n)
   end subroutine find_order

   !> VEC total = start + sum k of a kind (to_q or to_p), without start sum k alone, of at least one slope. Slopes are
   !> (n, nstage), n being all numbers of a block or of a path. Products are added in the order of the stages.
   pure subroutine add_slopes(n, plan, kind, k, slope, total, start)
      integer, intent(in) :: n, kind, k
      type(evaluation_order), intent(in) :: plan
      real(wp), intent(in) :: slope(n, plan%nstage)
      real(wp), intent(inout) :: total(n)
      real(wp), intent(in), optional :: start(n)
      integer :: i, j

      associate (stage => plan%stage(:, k, kind), c => plan%weight(:, k, kind))
         ! With a start, add the first product to it; without, the first product begins the sum.
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
