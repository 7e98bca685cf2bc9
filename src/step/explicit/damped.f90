! SPDX-License-Identifier: BSD-3-Clause
!> Explicit steps by a tableau of several stages for a damped model: coefficients with decays (scheme/decays):
!>
!>    Q_i     = q_n + sum_j a_ij v_j                                      q_{n+1} = q_n + sum_j alpha_j v_j
!>    P_i     = exp(-c_i z) p_n - sum_j abar_ij exp(-(c_i - c_j) z) f_j
!>    p_{n+1} = exp(-z) p_n - sum_j alpha_j exp(-(1 - c_j) z) f_j
!>
!> with v_j = Hhat_p and f_j = Hhat_q at (Q_j, P_j), in the order of evaluation of the closed tableau. Stages with the
!> same momentum in the closed system have different momenta here, since these have decayed for different times. Blocks
!> and single paths take the same steps: a single path is a block of one lane.
module symsde_step_explicit_damped
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_vectors, only: add_times, copy, scale
   use symsde_scheme_decays, only: tableau_decays, new_decays
   use symsde_scheme_scheme, only: correction_none
   use symsde_step_explicit_evaluation_order, only: evaluation_order, new_explicit_plan, to_q, to_p
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task, few_of
   implicit none
   private
   public :: damped_explicit_stepper

   type, extends(stepper_type) :: damped_explicit_stepper
      private
      type(evaluation_order) :: plan
      type(tableau_decays) :: decays
      real(wp), allocatable :: f(:, :, :), v(:, :, :)  !! slopes of each stage (nlane, ndof, nstage)
      real(wp), allocatable :: qs(:, :), ps(:, :)      !! point of one stage (nlane, ndof)
   contains
      procedure :: make
      procedure :: increment
   end type damped_explicit_stepper

contains

   !> Use the plan of the closed tableau, without shared slopes, and the decay factors of its nodes.
   subroutine make(self, task)
      class(damped_explicit_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      self%name = 'explicit, damped'
      self%explicit = .true.
      associate (scheme => task%scheme, n => task%model%traits%ndof, nlane => task%nlane)
         call new_one_step_hamiltonian(self%ham, task%model, nlane, correction_none, 0.0_wp)
         call new_explicit_plan(self%plan, scheme, task%model%traits%splits(), .false., .false.)
         call new_decays(self%decays, task%damping, scheme%c, n)
         self%most_single = few_of(n, merge(3, 2, n > 1), 6)
         allocate (self%f(nlane, n, scheme%nstage), self%v(nlane, n, scheme%nstage))
         allocate (self%qs(nlane, n), self%ps(nlane, n))
      end associate
   end subroutine make

   !> One step of every lane. The status does not change, because no equation is solved that could fail.
   subroutine increment(self, step, q, p, dq, dp, status)
      class(damped_explicit_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      integer :: i, k, d

      call self%decays%set_step(step%h)
      associate (plan => self%plan, decays => self%decays, nlane => self%ham%nlane)
         do k = 1, size(plan%order)
            i = plan%order(k)%stage
            do d = 1, self%ham%ndof
               call copy(nlane, q(:, d), self%qs(1, d))
               call scale(nlane, decays%begin(i, d), p(:, d), self%ps(1, d))
               call add_slopes_of(self, i, d, decays%between(i, :, d), self%qs(:, d), self%ps(:, d))
            end do
            call evaluate(self, step, i, plan%order(k)%force, plan%order(k)%velocity)
         end do
         do d = 1, self%ham%ndof
            dq(:, d) = 0
            call scale(nlane, decays%loss(d), p(:, d), dp(1, d))
            call add_slopes_of(self, 0, d, decays%finish(:, d), dq(:, d), dp(:, d))
         end do
      end associate
   end subroutine increment

   !> Evaluate the slopes of stage i that are wanted: Hhat_q if `force`, Hhat_p if `velocity`.
   subroutine evaluate(self, step, i, force, velocity)
      class(damped_explicit_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      integer, intent(in) :: i
      logical, intent(in) :: force, velocity

      associate (t => step%t + self%decays%node(i)*step%h, w => step%w, qs => self%qs, ps => self%ps)
         if (force .and. velocity) then
            call self%ham%gradient(t, w, qs, ps, hq=self%f(:, :, i), hp=self%v(:, :, i))
         else if (force) then
            call self%ham%gradient(t, w, qs, ps, hq=self%f(:, :, i))
         else
            call self%ham%gradient(t, w, qs, ps, hp=self%v(:, :, i))
         end if
      end associate
   end subroutine evaluate

   !> Add sum i of the plan for degree of freedom d to x and y: terms with Hhat_q are multiplied by the factors of their
   !> stages.
   subroutine add_slopes_of(self, i, d, factors, x, y)
      class(damped_explicit_stepper), intent(in) :: self
      integer, intent(in) :: i, d
      real(wp), intent(in) :: factors(:)                    !! (nstage)
      real(wp), intent(inout) :: x(self%ham%nlane), y(self%ham%nlane)
      integer :: k, j

      associate (plan => self%plan, nlane => self%ham%nlane)
         do k = 1, plan%many(i, to_q)
            call add_times(nlane, plan%weight(k, i, to_q), self%v(:, d, plan%stage(k, i, to_q)), x)
         end do
         do k = 1, plan%many(i, to_p)
            j = plan%stage(k, i, to_p)
            call add_times(nlane, plan%weight(k, i, to_p)*factors(j), self%f(:, d, j), y)
         end do
      end associate
   end subroutine add_slopes_of

end module symsde_step_explicit_damped
