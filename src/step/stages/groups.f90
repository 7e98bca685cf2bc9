! SPDX-License-Identifier: BSD-3-Clause
!> The order in which the stages of a tableau are solved, and their coefficients.
!>
!> If H = p.p/2 + U(q), the momenta of the stages P_j = p_n + sum_k abar_jk G_k are eliminated from Q_i = q_n + sum_j
!> a_ij (h P_j + g_j):
!>
!>    Q_i = q_n + r_i h p_n + sum_j a_ij g_j + h sum_k B_ik G_k      r_i = sum_j a_ij,  B = a abar
!>    dq  =       h p_n + sum_j alpha_j g_j  + h sum_k v_k G_k       v = alpha abar
!>
!> with G_k = -Hhat_q(Q_k, P_k), and g_j = Hhat_p - h P_j at stage j. So stage i depends on stage k if B_ik is
!> not zero (without elimination: if a_ik or abar_ik is not). Stages that depend on each other are a group, and groups
!> are solved one after the other: the two stages of gauss2 are one group; of the three of lobatto3 only the second is
!> implicit; a composition is a sequence of its parts.
!>
!> In a group the first sweep has no slopes to start from. Stage after stage, an unknown slope is replaced by that of
!> the member before, so its coefficient is added to that member's; before the first member the coefficient is dropped.
!> The results are first_b, first_a and first_abar; gauss2, for example, begins with
!>
!>    Q_1 = q_n + r_1 h p_n,   Q_2 = q_n + r_2 h p_n + h (B_21 + B_22) G_1
!>
!> Newton's iteration needs the inverse of a group's B, to compute slopes from displacements. If B is singular it may
!> have rank one, B_ik = e_i f_k: then the sum of the f_k G_k is the only unknown (step/stages/tridiagonal).
!>
!> If a model is damped by one rate, momenta decay between the stages (scheme/decays). With d_i = exp(-c_i z) and
!> abar_ik times exp(-(c_i - c_k) z) the equations keep their form, with numbers that depend on the size of the step:
!>
!>    P_i = d_i p_n + sum_k abar_ik G_k        r_i = sum_j a_ij d_j,   dq = h (sum_j alpha_j d_j) p_n + ..
!>    dp  = (exp(-z) - 1) p_n + sum_k alpha_k exp(-(1 - c_k) z) G_k
!>
!> Private to its family.
module symsde_step_stages_groups
   use symsde_base_damping, only: damping_type
   use symsde_base_kinds, only: wp
   use symsde_scheme_decays, only: tableau_decays, new_decays
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: stage_plan, stage_group, new_stage_plan

   !> Stages that depend on each other.
   type :: stage_group
      integer :: nmember = 0
      integer, allocatable :: stage(:)         !! numbers of the stages (nmember)
      logical :: explicit = .false.            !! whether it is one stage that does not depend on itself
      real(wp), allocatable :: b(:, :)         !! B of these stages (nmember, nmember)
      real(wp), allocatable :: earlier(:, :)   !! B_ik, stages k of other groups (nstage, nmember)
      real(wp), allocatable :: inverse(:, :)   !! inverse of b; not allocated if b is singular
      real(wp), allocatable :: e(:), f(:)      !! b_ik = e_i f_k if b is singular and of rank one (nmember)
      logical :: of_rank_one = .false.         !! whether b has rank one without decays
   end type stage_group

   !> The coefficients of a stage or an increment are a column, contiguous in memory: sums over slopes read them one
   !> after the other.
   type :: stage_plan
      integer :: nstage = 0, ngroup = 0
      real(wp), allocatable :: c(:), alpha(:)          !! nodes and weights (nstage)
      real(wp), allocatable :: a(:, :), abar(:, :)     !! a_ij and abar_ij of stage i in column i (nstage, nstage)
      real(wp), allocatable :: r(:), v(:)              !! r_i and v_k of the equations above (nstage)
      real(wp), allocatable :: b(:, :)                 !! B_ik of stage i in column i (nstage, nstage)
      real(wp), allocatable :: weight(:)               !! weights of G_k in dp (nstage)
      real(wp), allocatable :: begin(:)                !! factor d_i of p_n in P_i (nstage)
      real(wp) :: reach = 0                            !! sum_j alpha_j d_j, factor of h p_n in dq
      logical :: damped = .false.
      real(wp) :: loss = 0                             !! exp(-z) - 1, factor of p_n in dp
      type(tableau_decays), private :: decays
      real(wp), allocatable, private :: closed(:, :)   !! abar without decays, stage i in column i (nstage, nstage)
      !> The coefficients for the first sweep of an iteration: an unknown slope of the group is replaced by the slope of
      !> the member before, or by zero (nstage, nstage).
      real(wp), allocatable, dimension(:, :) :: first_b, first_a, first_abar
      type(stage_group), allocatable :: group(:)       !! (ngroup)
   contains
      procedure :: in_order
      procedure :: set_step
   end type stage_plan

contains

   !> The plan of a tableau whose drift and noise share their coefficients: r, v, B, the groups in the order in which
   !> they are solved, and the coefficients of the first sweep. Until set_step is called, they are those of a closed
   !> system.
   subroutine new_stage_plan(self, scheme, eliminated, damping)
      type(stage_plan), intent(out) :: self
      type(scheme_type), intent(in) :: scheme
      logical, intent(in) :: eliminated   !! momenta of the stages are eliminated
      type(damping_type), intent(in) :: damping  !! none, or one rate
      type(damping_type) :: one
      logical :: waits(scheme%nstage, scheme%nstage)
      integer :: i, k

      self%nstage = scheme%nstage
      self%c = scheme%c
      self%alpha = scheme%alpha
      self%a = transpose(scheme%a)
      self%abar = transpose(scheme%abar)
      self%closed = self%abar
      self%weight = self%alpha
      self%damped = damping%acts()
      ! The factors are equal for all degrees of freedom, so they are computed from the first rate.
      one = damping
      if (self%damped) one%rate = damping%rate(:1)
      call new_decays(self%decays, one, self%c, 1)
      allocate (self%r(self%nstage), self%v(self%nstage), self%b(self%nstage, self%nstage))
      allocate (self%begin(self%nstage), source=1.0_wp)
      call combine(self)
      do k = 1, self%nstage
         do i = 1, self%nstage
            ! If momenta are eliminated, only B couples stages; else P_i also depends on G_k, and Q_i on stages k with
            ! a_ik /= 0.
            waits(i, k) = abs(self%b(k, i)) > 0
            if (.not. eliminated) waits(i, k) = waits(i, k) .or. abs(self%a(k, i)) > 0 .or. abs(self%abar(k, i)) > 0
         end do
      end do
      call find_groups(self, waits)
      call find_first_sweep(self)
   end subroutine new_stage_plan

   !> Compute the coefficients of a damped model for steps of the length h, with its sign. The dependences between
   !> stages do not change: no decay is zero, so no coefficient vanishes or appears.
   subroutine set_step(self, h)
      class(stage_plan), intent(inout) :: self
      real(wp), intent(in) :: h
      type(stage_group) :: group
      logical :: members(self%nstage)
      integer :: k

      if (.not. self%damped) return
      call self%decays%set_step(h)
      self%begin = self%decays%begin(:, 1)
      self%weight = self%alpha*self%decays%finish(:, 1)
      self%loss = self%decays%loss(1)
      self%abar = self%closed*transpose(self%decays%between(:, :, 1))
      call combine(self)
      do k = 1, self%ngroup
         members = .false.
         members(self%group(k)%stage) = .true.
         call fill_group(group, self%b, members)
         group%explicit = self%group(k)%explicit
         group%of_rank_one = self%group(k)%of_rank_one
         ! The rank is the rank without decays. If rounding gives another rank, after a very large step, the solvers use
         ! neither the inverse nor e and f.
         if (group%of_rank_one .and. allocated(group%inverse)) deallocate (group%inverse)
         if (.not. group%of_rank_one .and. allocated(group%e)) deallocate (group%e, group%f)
         self%group(k) = group
      end do
      call find_first_sweep(self)
   end subroutine set_step

   !> r, v and B of a, abar and the decays of p_n. Columns hold stages, so B_ik = sum_j a_ij abar_jk.
   pure subroutine combine(self)
      type(stage_plan), intent(inout) :: self
      integer :: i, k

      self%reach = sum(self%alpha*self%begin)
      do k = 1, self%nstage
         self%r(k) = sum(self%a(:, k)*self%begin)
         self%v(k) = dot_product(self%alpha, self%abar(k, :))
         do i = 1, self%nstage
            self%b(k, i) = dot_product(self%a(:, i), self%abar(k, :))
         end do
      end do
   end subroutine combine

   !> Find the groups, each after the groups on which it depends. Stage i reaches k if it depends on k through any
   !> number of stages (the transitive closure of waits). Two stages that reach each other are mates, and each is its
   !> own mate. A group is added when all stages outside of it that its stages reach are in earlier groups.
   pure subroutine find_groups(self, waits)
      type(stage_plan), intent(inout) :: self
      logical, intent(in) :: waits(self%nstage, self%nstage)  !! whether stage i depends on stage k
      logical, dimension(self%nstage, self%nstage) :: reaches, mates
      logical :: done(self%nstage)
      integer :: first(self%nstage)  ! first stage of each group
      integer :: i, k

      reaches = waits
      ! Warshall's algorithm: after pass k all paths through stages up to k are included.
      do k = 1, self%nstage
         do i = 1, self%nstage
            if (reaches(i, k)) reaches(i, :) = reaches(i, :) .or. reaches(k, :)
         end do
      end do
      mates = reaches .and. transpose(reaches)
      done = .false.
      do while (.not. all(done))
         do i = 1, self%nstage
            if (done(i)) cycle
            mates(i, i) = .true.
            if (any(reaches(i, :) .and. .not. (mates(:, i) .or. done))) cycle
            self%ngroup = self%ngroup + 1
            first(self%ngroup) = i
            done = done .or. mates(:, i)
         end do
      end do
      allocate (self%group(self%ngroup))
      do k = 1, self%ngroup
         call fill_group(self%group(k), self%b, mates(:, first(k)))
         ! Whether a group is a single stage that does not reach itself; larger groups consist of stages that reach each
         ! other.
         self%group(k)%explicit = .not. reaches(first(k), first(k))
         self%group(k)%of_rank_one = allocated(self%group(k)%e)
      end do
   end subroutine find_groups

   !> Coefficients of the first sweep: for member m of a group, the slopes of members m and later are unknown.
   pure subroutine find_first_sweep(self)
      type(stage_plan), intent(inout) :: self
      integer :: k, m

      self%first_b = self%b
      self%first_a = self%a
      self%first_abar = self%abar
      do k = 1, self%ngroup
         associate (stage => self%group(k)%stage)
            ! The coefficients of F in Q, of C in Q, and of F in P.
            do m = 1, size(stage)
               call move_to_known(stage, m, self%first_b(:, stage(m)))
               call move_to_known(stage, m, self%first_a(:, stage(m)))
               call move_to_known(stage, m, self%first_abar(:, stage(m)))
            end do
         end associate
      end do
   end subroutine find_first_sweep

   !> Add the coefficients of members m and later to the coefficient of member m-1, whose slope is the newest known one.
   !> Before the first member no slope is known, and these coefficients are dropped.
   pure subroutine move_to_known(stage, m, coefficient)
      integer, intent(in) :: stage(:), m
      real(wp), intent(inout) :: coefficient(:)
      integer :: k

      do k = m, size(stage)
         if (m > 1) coefficient(stage(m - 1)) = coefficient(stage(m - 1)) + coefficient(stage(k))
         coefficient(stage(k)) = 0
      end do
   end subroutine move_to_known

   !> Whether the stages of every group have consecutive numbers.
   pure logical function in_order(self)
      class(stage_plan), intent(in) :: self
      integer :: k

      in_order = .true.
      do k = 1, self%ngroup
         associate (group => self%group(k))
            in_order = in_order .and. maxval(group%stage) - minval(group%stage) == group%nmember - 1
         end associate
      end do
   end function in_order

   !> Fill a group from the mask `same` of its stages and from the B of all stages, b(k, i) = B_ik: its own B, the
   !> coefficients of slopes of other groups (earlier), and the inverse of its B, or e and f if its rank is one.
   pure subroutine fill_group(group, b, same)
      type(stage_group), intent(out) :: group
      real(wp), intent(in) :: b(:, :)
      logical, intent(in) :: same(:)      !! stages of the group
      integer :: i, k, m

      m = count(same)
      group%nmember = m
      allocate (group%stage(m), group%b(m, m))
      m = 0
      do i = 1, size(same)
         if (.not. same(i)) cycle
         m = m + 1
         group%stage(m) = i
      end do
      ! Begin with the coefficients of all stages, then set those within the group to zero.
      group%earlier = b(:, group%stage)
      do k = 1, m
         do i = 1, m
            group%b(i, k) = b(group%stage(k), group%stage(i))
            group%earlier(group%stage(k), i) = 0
         end do
      end do
      call invert(m, group%b, group%inverse)
      if (.not. allocated(group%inverse)) call factorise(group)
   end subroutine fill_group

   !> b_ik = e_i f_k, if B has rank one up to rounding: e is the column of the largest entry, and f follows from
   !> the row of that entry. Nothing is allocated if b vanishes or has a higher rank.
   pure subroutine factorise(group)
      type(stage_group), intent(inout) :: group
      real(wp), dimension(group%nmember) :: e, f
      integer :: at(2), k

      at = maxloc(abs(group%b))
      e = group%b(:, at(2))
      if (.not. any(abs(e) > 0)) return
      ! The row of the largest entry gives f, scaled so that e f is that row.
      f = group%b(at(1), :)/e(at(1))
      do k = 1, group%nmember
         if (any(abs(group%b(:, k) - e*f(k)) > 8*epsilon(e)*maxval(abs(e)))) return
      end do
      group%e = e
      group%f = f
   end subroutine factorise

   !> The inverse of a small matrix by elimination of (matrix, I) with exchange of rows; not allocated if a pivot is
   !> below 1e-10 of the largest entry: the matrix then counts as singular.
   pure subroutine invert(n, matrix, inverse)
      integer, intent(in) :: n
      real(wp), intent(in) :: matrix(n, n)
      real(wp), allocatable, intent(out) :: inverse(:, :)
      real(wp) :: work(n, 2*n), row(2*n)
      integer :: i, k

      work = 0
      work(:, :n) = matrix
      do i = 1, n
         work(i, n + i) = 1
      end do
      do k = 1, n
         ! Among the remaining rows, row i has the largest entry of column k; it becomes row k.
         i = k - 1 + maxloc(abs(work(k:, k)), 1)
         if (abs(work(i, k)) <= 1e-10_wp*maxval(abs(matrix))) return
         row = work(i, :)
         work(i, :) = work(k, :)
         work(k, :) = row/row(k)
         do i = 1, n
            if (i /= k) work(i, :) = work(i, :) - work(i, k)*work(k, :)
         end do
      end do
      inverse = work(:, n + 1:)
   end subroutine invert

end module symsde_step_stages_groups
