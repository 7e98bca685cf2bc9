! SPDX-License-Identifier: BSD-3-Clause
!> The equations of implicit stages in a few lanes: points, slopes and increments.
!>
!> The slopes of stage i are G_i = -Hhat_q(Q_i,P_i), and what Hhat_p is beyond the momenta of p.p/2,
!>
!>    C_i = Hhat_p(Q_i,P_i) - kappa P_i        kappa = h where H = p.p/2 + U(q), else 0
!>
!> with the points, in the words of step/stages/groups,
!>
!>    Q_i = q_n + r_i kappa p_n + sum_j a_ij C_j + kappa sum_k B_ik G_k
!>    P_i = p_n + sum_k abar_ik G_k
!>    dq  = kappa p_n + sum_j alpha_j C_j + kappa sum_k v_k G_k,   dp = sum_k alpha_k G_k
!>
!> With a constant mass M that is not the identity kappa = h as well, and kappa p_n and kappa sum_k B_ik G_k stand for
!> M^-1 times these.
!>
!> For noise in position C vanishes, for additive noise it is known beforehand, so that the G alone are
!> unknown (`eliminated`). The bracket {H_k,H} of additive noise in position that does not change in time moves all
!> velocities alike: it is a shift of p_n, by sum_k (dW_k/2 - dZ_k/h) H_k,q, in the equations of Q_i and dq.
!> Other brackets of schemes beyond order one make C small; elsewhere it is all of Hhat_p.
!>
!> Private to its family.
module symsde_step_stages_equations
   use symsde_base_functionals, only: functional_set, nfunctional, path_dz, path_areas
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: step_record, step_store, new_step_store
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type, correction_none
   use symsde_step_hamiltonian_mass, only: constant_mass, new_constant_mass
   use symsde_step_hamiltonian_noise_shift, only: noise_shift, new_noise_shift
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian, new_one_step_hamiltonian
   use symsde_step_stages_slope_sums, only: add_slopes
   use symsde_step_stages_groups, only: stage_plan, stage_group, new_stage_plan
   implicit none
   private
   public :: stage_equations, new_stage_equations

   type :: stage_equations
      type(stage_plan) :: plan
      type(one_step_hamiltonian) :: ham
      logical :: eliminated = .false.           !! the G alone are unknown
      logical :: has_c = .false.                !! C does not vanish
      logical, private :: identity_mass = .false.
      type(constant_mass), allocatable :: mass  !! where momenta are eliminated by one that is not the identity
      real(wp) :: kappa = 0                     !! of this step
      type(step_record) :: step                 !! what drives it, in the store
      type(step_store) :: store                 !! its first step
      type(noise_shift), allocatable :: shift   !! of p_n, where brackets are no more than that
      real(wp), allocatable :: q(:, :), p(:, :) !! where the step begins (nlane, ndof)
      real(wp), allocatable :: base(:, :, :)    !! what Q_i has of known slopes (nlane, ndof, nstage)
      real(wp), allocatable :: g(:, :, :), c(:, :, :)    !! slopes (nlane, ndof, nstage)
      real(wp), allocatable :: qs(:, :), ps(:, :)        !! the point that was placed last (nlane, ndof)
      real(wp), allocatable :: hq(:, :), hp(:, :)        !! Hhat_q and C there (nlane, ndof)
      real(wp), allocatable, private :: velocity(:, :)   !! M^-1 p, and below (nlane, ndof)
      real(wp), allocatable, private :: moved(:, :)      !! what M^-1 is still to be applied to (nlane, ndof)
      real(wp), allocatable, private :: nothing(:, :)    !! zero (nlane, ndof)
      real(wp), allocatable, dimension(:) :: last, change, extent  !! of an iteration (nlane)
   contains
      procedure :: begin
      procedure :: place
      procedure :: place_known
      procedure :: evaluate
      procedure :: add_up
      procedure :: time_of
      procedure :: moves_with_p
   end type stage_equations

contains

   !> Equations for nlane lanes.
   subroutine new_stage_equations(self, model, scheme, nlane)
      type(stage_equations), intent(out) :: self
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      integer, intent(in) :: nlane
      type(functional_set) :: asked
      integer :: n, s

      n = model%traits%ndof
      s = scheme%nstage
      call new_one_step_hamiltonian(self%ham, model, nlane, correction_none, 0.0_wp, scheme%brackets)
      associate (t => model%traits)
         self%identity_mass = t%identity_mass
         self%eliminated = t%eliminates_momenta()
         if (allocated(self%ham%modified)) &
            self%eliminated = self%eliminated .and. t%additive .and. t%position_noise .and. &
                              .not. self%ham%modified%time_dependent
         if (t%divides_by_mass() .and. .not. allocated(self%ham%modified)) then
            self%eliminated = .true.
            allocate (self%mass)
            call new_constant_mass(self%mass, nlane, n, t%nnoise)
            allocate (self%velocity(nlane, n), self%moved(nlane, n))
            allocate (self%nothing(nlane, n), source=0.0_wp)
         end if
         self%has_c = .not. (self%eliminated .and. (t%position_noise .or. t%nnoise == 0))
         if (self%eliminated .and. allocated(self%ham%modified)) then
            allocate (self%shift)
            call new_noise_shift(self%shift, model, nlane)
         end if
      end associate
      call new_stage_plan(self%plan, scheme, self%eliminated)
      if (allocated(self%ham%modified)) then
         asked%has(path_dz) = self%ham%modified%active%single
         asked%has(path_areas) = self%ham%modified%active%areas
      end if
      call new_step_store(self%store, nlane, model%traits%nnoise, 2, 0.0_wp, asked)
      allocate (self%q(nlane, n), self%p(nlane, n))
      allocate (self%base(nlane, n, s), self%g(nlane, n, s), self%qs(nlane, n), self%hq(nlane, n))
      allocate (self%last(nlane), self%change(nlane), self%extent(nlane))
      if (.not. self%has_c) return
      allocate (self%c(nlane, n, s), self%ps(nlane, n), self%hp(nlane, n))
   end subroutine new_stage_equations

   !> Take the lanes from `first` on into a step.
   subroutine begin(self, first, step, q, p)
      class(stage_equations), intent(inout), target :: self
      integer, intent(in) :: first
      type(step_record), intent(in) :: step
      real(wp), contiguous, intent(in) :: q(:, :), p(:, :)  !! of all lanes (.., ndof)
      real(wp), pointer, contiguous :: w(:, :), x(:, :)  ! names that gfortran 12 knows to be contiguous
      integer :: i, f

      w => step%w
      associate (all => size(q, 1), nlane => self%ham%nlane)
         call take_lanes(all, self%ham%ndof, first, nlane, q, self%q)
         call take_lanes(all, self%ham%ndof, first, nlane, p, self%p)
         call take_lanes(all, self%ham%nnoise + 1, first, nlane, w, self%store%w)
         do f = 1, nfunctional
            if (.not. allocated(self%store%of(f)%x)) cycle
            x => step%of(f)%x
            call take_lanes(all, size(x, 2), first, nlane, x, self%store%of(f)%x)
         end do
      end associate
      self%store%h = step%h
      call self%store%show(0, step%t, self%step)
      self%kappa = merge(step%h, 0.0_wp, self%moves_with_p())
      if (allocated(self%mass)) call find_velocity(self)
      if (allocated(self%shift)) call shift_momenta(self)
      associate (s => self%plan%nstage, size => size(self%q), plan => self%plan)
         if (self%eliminated .and. self%has_c) then
            self%ps = 0
            do i = 1, s
               call self%ham%gradient(self%time_of(i), self%store%w(:, :, 0), self%q, self%ps, hp=self%c(:, :, i), &
                                      step=self%step)
            end do
         end if
         do i = 1, s
            if (allocated(self%mass)) then
               call add_slopes(size, 1, 1, self%kappa, plan%r(i:i), self%velocity, self%q, self%base(:, :, i))
               cycle
            end if
            call add_slopes(size, 1, 1, self%kappa, plan%r(i:i), self%p, self%q, self%base(:, :, i))
            if (.not. (self%eliminated .and. self%has_c)) cycle
            call add_slopes(size, s, 1, 1.0_wp, plan%a(:, i), self%c, self%base(:, :, i), self%qs)
            self%base(:, :, i) = self%qs
         end do
      end associate
   end subroutine begin

   !> The momenta that the positions move with.
   subroutine shift_momenta(self)
      class(stage_equations), intent(inout) :: self

      associate (shift => self%shift, counters => self%ham%counters)
         call shift%weigh(-0.5_wp, 1.0_wp, self%step)
         call shift%add(self%ham%model, self%step%t, 1.0_wp, self%q, self%p)
         counters%gradients = counters%gradients + shift%asked*self%ham%nreal
         shift%asked = 0
      end associate
   end subroutine shift_momenta

   !> M^-1 p where the step begins.
   subroutine find_velocity(self)
      class(stage_equations), intent(inout) :: self

      associate (nlane => self%ham%nlane, counters => self%ham%counters)
         call self%mass%velocity(self%ham%model, nlane, self%step%t, self%q, self%p, self%velocity)
         counters%gradients = counters%gradients + self%mass%asked*self%ham%nreal
      end associate
   end subroutine find_velocity

   !> start + kappa M^-1 sum_k coefficient_k G_k
   subroutine add_by_mass(self, first, coefficient, start, total)
      class(stage_equations), intent(inout) :: self
      integer, intent(in) :: first  !! see add_slopes
      real(wp), intent(in) :: coefficient(self%plan%nstage), start(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: total(self%ham%nlane, self%ham%ndof)

      associate (nlane => self%ham%nlane, counters => self%ham%counters)
         call add_slopes(size(start), self%plan%nstage, first, self%kappa, coefficient, self%g, self%nothing, &
                         self%moved)
         call self%mass%add(self%ham%model, nlane, self%step%t, self%q, self%moved, start, total)
         counters%gradients = counters%gradients + self%mass%asked*self%ham%nreal
      end associate
   end subroutine add_by_mass

   !> t_i = t_n + c_i h
   pure real(wp) function time_of(self, i) result(t)
      class(stage_equations), intent(in) :: self
      integer, intent(in) :: i

      t = self%step%t + self%plan%c(i)*self%step%h
   end function time_of

   !> Whether kappa is the step, not zero.
   pure logical function moves_with_p(self)
      class(stage_equations), intent(in) :: self

      moves_with_p = self%identity_mass .or. allocated(self%mass)
   end function moves_with_p

   !> Put (Q_i, P_i) where the slopes are weighed by these coefficients.
   subroutine place(self, i, b, a, abar)
      class(stage_equations), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in), dimension(self%plan%nstage) :: b, a, abar

      associate (s => self%plan%nstage, size => size(self%q))
         if (allocated(self%mass)) then
            call add_by_mass(self, i, b, self%base(:, :, i), self%qs)
            return
         else if (self%eliminated) then
            call add_slopes(size, s, i, self%kappa, b, self%g, self%base(:, :, i), self%qs)
            return
         end if
         call add_slopes(size, s, i, self%kappa, b, self%g, self%base(:, :, i), self%ps)
         call add_slopes(size, s, i, 1.0_wp, a, self%c, self%ps, self%qs)
         call add_slopes(size, s, i, 1.0_wp, abar, self%g, self%p, self%ps)
      end associate
   end subroutine place

   !> Put Q of a group's member where the slopes of the group are zero; momenta are eliminated.
   subroutine place_known(self, group, member)
      class(stage_equations), intent(inout) :: self
      type(stage_group), intent(in) :: group
      integer, intent(in) :: member

      associate (row => group%earlier(:, member))
         call self%place(group%stage(member), row, row, row)
      end associate
   end subroutine place_known

   !> Hhat_q and C at the point that was placed for stage i. No bracket adds to Hhat_q where momenta are eliminated.
   subroutine evaluate(self, i)
      class(stage_equations), intent(inout) :: self
      integer, intent(in) :: i

      if (self%eliminated) then
         call self%ham%model%gradient(self%ham%nlane, self%ham%ndof, self%ham%nnoise, self%time_of(i), &
                                      self%store%w(:, :, 0), self%qs, self%p, hq=self%hq)
         self%ham%counters%gradients = self%ham%counters%gradients + self%ham%nreal
         return
      end if
      call self%ham%gradient(self%time_of(i), self%store%w(:, :, 0), self%qs, self%ps, hq=self%hq, hp=self%hp, &
                             step=self%step)
      if (self%identity_mass) self%hp = self%hp - self%kappa*self%ps
   end subroutine evaluate

   !> Increments from the slopes.
   subroutine add_up(self, dq, dp)
      class(stage_equations), intent(inout) :: self
      real(wp), intent(out), dimension(self%ham%nlane, self%ham%ndof) :: dq, dp

      associate (s => self%plan%nstage, size => size(self%q), plan => self%plan)
         if (allocated(self%mass)) then
            self%qs = self%kappa*sum(plan%alpha)*self%velocity
            call add_by_mass(self, 1, plan%v, self%qs, dq)
         else
            self%qs = self%kappa*sum(plan%alpha)*self%p
            call add_slopes(size, s, 1, self%kappa, plan%v, self%g, self%qs, dq)
         end if
         if (self%has_c) then
            call add_slopes(size, s, 1, 1.0_wp, plan%alpha, self%c, dq, self%qs)
            dq = self%qs
         end if
         self%qs = 0
         call add_slopes(size, s, 1, 1.0_wp, plan%alpha, self%g, self%qs, dp)
      end associate
   end subroutine add_up

   !> Some lanes of an array.
   pure subroutine take_lanes(nlane, n, first, wanted, x, y)
      integer, intent(in) :: nlane, n, first, wanted
      real(wp), intent(in) :: x(nlane, n)
      real(wp), intent(out) :: y(wanted, n)
      integer :: i

      do i = 1, n
         y(:, i) = x(first:first + wanted - 1, i)
      end do
   end subroutine take_lanes

end module symsde_step_stages_equations
