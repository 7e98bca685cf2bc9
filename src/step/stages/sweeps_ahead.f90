! SPDX-License-Identifier: BSD-3-Clause
!> Steps of a single path for which a sweep is cheap: of one angle, whose force follows from four terms, or of a model
!> with its own sweeps. The first sweeps, as many as the step before needed, are taken at once, which mostly is enough;
!> only then is each of them judged, in order; sweeps after the one that ends the iteration are discarded. If none ends
!> it, further sweeps follow one by one. The operations and their order are those of step/stages/equations, for momenta
!> that are eliminated by an identity mass and noise in position:
!>
!> Q_i = q_n + h r_i p_n - h sum_k B_ik F_k,   F_i <- Hhat_q(Q_i)          k = i, i+1, .. cyclically
!> dq  = h p_n - h sum_k v_k F_k,   dp = -sum_k alpha_k F_k
!>
!> with the decays of step/stages/groups for a damped model.
!>
!> All numbers are in arrays of four stages, padded with zeros, so that loops of a known length stay in registers. A
!> step that these sweeps do not finish is left to step/stages/stepper, which starts it again.
!>
!> Compared with this file, the body with one lane and sweeps one by one takes 1.5 to 2 times as long for two degrees of
!> freedom whose model has its own sweeps, with forces as scalars, and 1.0 to 1.3 times for an angle whose terms the
!> body computes once for each stage.
!>
!> F is kept after every sweep (f), since it is not known yet which sweep is the last. base_i = q_n + h r_i p_n is
!> computed once per step. Coefficients include h and their sign.
!>
!> Private to its family.
module symsde_step_stages_sweeps_ahead
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_sincos, only: sincos_one
   use symsde_model_abstract, only: model_type
   use symsde_model_kernels, only: kernel_model, kernel_offers, angle_terms, offers_of
   use symsde_solve_fixed_point_single_path, only: judge_ahead, done
   use symsde_step_hamiltonian_noise_shift, only: noise_shift
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   use symsde_step_stages_groups, only: stage_plan
   implicit none
   private
   public :: sweeps_ahead, new_sweeps_ahead

   integer, parameter :: most = 24    !! most sweeps of a group: enough for stiff_rate of solve/fixed_point
   integer, parameter :: nstage = 4   !! most stages of a scheme

   !> A group of stages, whose numbers are consecutive, and the predicted number of its sweeps.
   type :: group_slot
      integer :: i1 = 1, i2 = 1       !! first and last stage of the group
      logical :: explicit = .false.
      integer :: ahead = 1            !! number of sweeps in the step before
   end type group_slot

   !> The plan of the scheme, its coefficients for the current h in arrays of four stages, and the F of every sweep.
   type :: sweeps_ahead
      private
      type(stage_plan) :: plan
      logical :: angles = .false.               !! whether the force is that of an angle
      type(group_slot) :: slot(nstage)          !! a slot for each group
      real(wp) :: h = 0                         !! the step for which the coefficients were computed
      real(wp) :: all = 0                       !! factor of p_n in dq: h sum_j alpha_j, with decays
      real(wp), dimension(nstage) :: c = 0, r = 0, v = 0, alpha = 0
      real(wp) :: b(nstage, nstage, 2) = 0      !! -h B_ik in the first sweep, and in later ones
      type(angle_terms) :: terms(nstage)
      real(wp) :: times(nstage) = 0, base(nstage, 2) = 0
      real(wp) :: f(nstage, 2, 0:most*nstage) = 0  !! F after every sweep, sweeps of all groups in order (.., ndof, ..)
   contains
      procedure :: take
   end type sweeps_ahead

contains

   !> Allocate for these steps; not allocated if they do not serve the model and the scheme: they need at most four
   !> stages, with consecutive numbers in each group.
   subroutine new_sweeps_ahead(self, model, plan)
      type(sweeps_ahead), allocatable, intent(out) :: self
      class(model_type), intent(in) :: model
      type(stage_plan), intent(in) :: plan
      type(kernel_offers) :: offers
      integer :: g

      offers = offers_of(model)
      if (.not. (offers%angle .or. (model%traits%ndof <= 2 .and. offers%sweeps))) return
      if (plan%nstage > nstage .or. .not. plan%in_order()) return
      allocate (self)
      self%plan = plan
      self%angles = offers%angle
      do g = 1, plan%ngroup
         associate (group => plan%group(g))
            self%slot(g) = group_slot(group%stage(1), group%stage(group%nmember), group%explicit)
         end associate
      end do
   end subroutine new_sweeps_ahead

   !> Compute the coefficients for steps of size h; those of missing stages are zero.
   subroutine find_coefficients(self, h)
      type(sweeps_ahead), intent(inout) :: self
      real(wp), intent(in) :: h

      ! The coefficients of step/stages/equations with kappa = h; rows and columns of missing stages stay zero.
      self%h = h
      call self%plan%set_step(h)
      associate (plan => self%plan, s => self%plan%nstage)
         self%all = h*plan%reach
         self%c(:s) = plan%c
         self%r(:s) = h*plan%r
         self%v(:s) = -h*plan%v
         self%alpha(:s) = -plan%weight
         self%b(:s, :s, 1) = -h*plan%first_b
         self%b(:s, :s, 2) = -h*plan%b
      end associate
   end subroutine find_coefficients

   !> One step from (q, p): increments (dq, dp), or taken = .false., and then dq and dp are undefined and nothing is
   !> counted. Brackets that are a shift of p_n (step/stages/equations) are applied before the sweeps.
   subroutine take(self, ham, shift, step, too_stiff, q, p, dq, dp, taken)
      class(sweeps_ahead), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(noise_shift), allocatable, intent(inout) :: shift  !! shift of p_n, see step/stages/equations
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: too_stiff   !! contraction above which a step is given up
      real(wp), intent(in) :: q(ham%ndof), p(ham%ndof)
      real(wp), intent(out) :: dq(ham%ndof), dp(ham%ndof)
      logical, intent(out) :: taken
      real(wp), pointer, contiguous :: w(:, :)  ! a name that gfortran 12 recognises as contiguous
      real(wp) :: x(2), y(2)
      integer(i8) :: gradients

      ! Steps of one size share their coefficients.
      if (abs(step%h - self%h) > 0) call find_coefficients(self, step%h)
      w => step%w
      associate (n => ham%ndof)
         if (.not. allocated(shift)) then
            call move(self, ham, n, self%plan%nstage, step%t, w, too_stiff, q, p, dq, dp, taken)
            return
         end if
         ! The shift is along noise in position: y becomes the shifted p_n, and x stays q_n.
         x(:n) = q
         y(:n) = p
         call shift%weigh(-0.5_wp, 1.0_wp, step)
         gradients = ham%counters%gradients
         call shift%add(ham, step%t, 1.0_wp, x, y)
         call move(self, ham, n, self%plan%nstage, step%t, w, too_stiff, q, y, dq, dp, taken)
         if (.not. taken) ham%counters%gradients = gradients
      end associate
   end subroutine take

   !> The step from (q, p), where p are the shifted momenta that move positions: groups one after the other, then the
   !> increments from the F after the last sweep. `before` counts the sweeps of all groups so far, so f(:, :, before) is
   !> the newest F of all stages.
   subroutine move(self, ham, n, s, t, w, too_stiff, q, p, dq, dp, taken)
      type(sweeps_ahead), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      integer, intent(in) :: n, s
      real(wp), intent(in) :: t, w(0:ham%nnoise), too_stiff, q(n), p(n)
      real(wp), intent(out) :: dq(n), dp(n)
      logical, intent(out) :: taken
      real(wp) :: moved, kicked
      integer :: i, k, g, nsweep, before, evaluations

      ! Times and known parts of Q_i, once for all sweeps.
      do i = 1, s
         self%times(i) = t + self%c(i)*self%h
      end do
      do k = 1, n
         !GCC$ novector  ! few numbers
         do i = 1, s
            self%base(i, k) = q(k) + self%r(i)*p(k)
         end do
      end do
      ! Slopes of later groups are zero, since f(:, :, 0) is zero, until their own sweeps.
      before = 0
      evaluations = 0
      do g = 1, self%plan%ngroup
         call sweep(self, ham%fast, s, g, w, p, too_stiff, before, nsweep)
         taken = nsweep > 0
         if (.not. taken) return
         before = before + nsweep
         ! A sweep takes one force for each stage of the group; discarded sweeps are not counted.
         evaluations = evaluations + nsweep*(self%slot(g)%i2 - self%slot(g)%i1 + 1)
      end do
      do k = 1, n
         moved = (self%all*p(k))  ! parentheses prevent contraction with the line below
         kicked = 0
         if (self%plan%damped) kicked = (self%plan%loss*p(k))
         !GCC$ novector  ! sums in order, contracted as in lanes
         do i = 1, s
            moved = moved + self%v(i)*self%f(i, k, before)
            kicked = kicked + self%alpha(i)*self%f(i, k, before)
         end do
         dq(k) = moved
         dp(k) = kicked
      end do
      ham%counters%gradients = ham%counters%gradients + evaluations
      ham%counters%iterations = ham%counters%iterations + before
   end subroutine move

   !> The slopes of group g, after `before` sweeps of other groups: first as many sweeps as in the step before (ahead),
   !> then one by one. nsweep is the number of sweeps that the group took, and the number taken ahead in the next step;
   !> 0 means that the step is given up.
   subroutine sweep(self, model, s, g, w, p, too_stiff, before, nsweep)
      type(sweeps_ahead), intent(inout) :: self
      class(kernel_model), intent(in) :: model
      integer, intent(in) :: s, g, before
      real(wp), intent(in) :: w(0:model%traits%nnoise), p(model%traits%ndof), too_stiff
      integer, intent(out) :: nsweep   !! the sweep that ended the iteration; 0: none did
      real(wp) :: change(most), extent(most), last
      integer :: first, i

      ! `last` is the size of the last change, or a negative outcome, as in solve/fixed_point.
      last = 0
      first = 1
      associate (slot => self%slot(g), ahead => self%slot(g)%ahead, m => model%traits%nnoise)
         ! The terms of Hhat at the time of each stage are used by all of its sweeps.
         if (self%angles) then
            do i = slot%i1, slot%i2
               call model%angle(m, self%times(i), w, self%terms(i))
            end do
         end if
         ! Take the sweeps first .. ahead and judge them; while the group is still running, take one more sweep at a
         ! time.
         do while (last >= 0 .and. ahead <= most)
            if (self%angles) then
               call sweep_angle(slot%i1, slot%i2, first, ahead, self%terms, self%base, self%b, &
                                self%f(1, 1, before), change, extent)
            else
               call model%sweeps(m, s, slot%i1, slot%i2, first, ahead, self%times, w, p, self%base, self%b, most, &
                                 self%f(1, 1, before), change, extent)
            end if
            call judge_ahead(first, ahead, too_stiff, too_stiff, most, change, extent, last, nsweep)
            first = ahead + 1
            ! A stage that does not depend on itself is done after its first sweep.
            if (last >= 0 .and. slot%explicit) then
               nsweep = 1
               last = done
            else if (last >= 0) then
               ahead = first
            end if
         end do
         ! The number of sweeps is the prediction for the next step.
         ahead = min(nsweep, most)
      end associate
      if (abs(last - done) > 0) nsweep = 0
   end subroutine sweep

   !> Sweeps first .. last of an angle over the stages i1 .. i2 of a group: x = base_i + sum_m b_im F_m, cyclically from
   !> stage i on, and F_i = a sin x + (b cos x + (c x + d)). change and extent are the largest change and the largest F
   !> of each sweep. Models with their own sweeps have the same interface. Sums have four stages for any scheme, since
   !> the contraction of a loop by gcc must not depend on their number.
   subroutine sweep_angle(i1, i2, first, last, terms, base, b, f, change, extent)
      integer, value :: i1, i2, first, last
      type(angle_terms), intent(in) :: terms(nstage)
      real(wp), intent(in) :: base(nstage), b(nstage, nstage, 2)
      real(wp), intent(inout) :: f(nstage, 2, 0:most)
      real(wp), intent(inout), dimension(most) :: change, extent
      real(wp) :: x, sine, cosine, force, moved, size, now(nstage)
      integer :: i, k, m, at

      ! F after the sweep before, of all stages.
      now = f(:, 1, first - 1)
      do k = first, last
         ! b(:, :, 1) is for the first sweep, in which not all slopes are known.
         at = min(k, 2)
         moved = 0
         size = 0
         !GCC$ unroll 4
         do i = 1, nstage
            ! Stages of other groups keep their F in this sweep.
            if (i >= i1 .and. i <= i2) then
               x = base(i)
               !GCC$ unroll 4
               !GCC$ novector  ! sums in order, contracted as in lanes
               do m = i - 1, i + nstage - 2
                  x = x + b(modulo(m, nstage) + 1, i, at)*now(modulo(m, nstage) + 1)
               end do
               sine = sincos_one(x, cosine)
               force = terms(i)%a*sine + (terms(i)%b*cosine + (terms(i)%c*x + terms(i)%d))
               moved = max(moved, abs(force - now(i)))
               size = max(size, abs(force))
               now(i) = force
            end if
            f(i, 1, k) = now(i)
         end do
         ! The largest over all stages of the group, for judge_ahead.
         change(k) = moved
         extent(k) = size
      end do
   end subroutine sweep_angle

end module symsde_step_stages_sweeps_ahead
