! SPDX-License-Identifier: BSD-3-Clause
!> Implicit schemes of two stages (Gauss 2 above all) for one degree of freedom: four unknowns a lane in
!> closed form, few passes.
!>
!>    F_i = Hhat_p(Q_i,P_i),  G_i = -Hhat_q(Q_i,P_i),  Q_i = q_n + sum_j a_ij F_j,  P_i = p_n + sum_j abar_ij G_j
!>
!> Newton's matrix of four rows is solved in closed form (step/two_stage_slopes). The first guess
!> is one Newton correction from (q_n, p_n), with a single evaluation in the middle of the step for both
!> stages. Agrees with the general stepper to a few ulps (tests/verification/test_beyond_one.pf).
module symsde_step_two_stage_single
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type, tableau_form, correction_none
   use symsde_solve_newton, only: newton_type, newton_options, new_newton
   use symsde_solve_stagnation, only: correct_lanes
   use symsde_step_lone, only: lone_stepper
   use symsde_step_lone_two_stages, only: lone_two_stages
   use symsde_step_one_step_hamiltonian, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task
   use symsde_step_two_stage_slopes, only: stage_point, add_stages, solve_separable, solve_lanes
   implicit none
   private
   public :: two_stage_single_stepper, new_two_stage_single_stepper, fits_two_stage_single

   type, extends(stepper_type) :: two_stage_single_stepper
      private
      type(newton_type) :: newton
      logical :: separable = .false.
      real(wp) :: a(2, 2) = 0, abar(2, 2) = 0, alpha(2) = 0, c(2) = 0
      real(wp), allocatable :: x(:, :)             !! slopes F_1, F_2, G_1, G_2 (nlane, 4)
      real(wp), allocatable :: qs(:, :), ps(:, :)  !! one stage (nlane, 1)
      real(wp), allocatable :: hq(:, :, :), hp(:, :, :)           !! both stages (nlane, 1, 2)
      real(wp), allocatable :: hqq(:, :, :, :), hqp(:, :, :, :), hpp(:, :, :, :)  !! (nlane, 1, 1, 2)
   contains
      procedure :: fits
      procedure :: make
      procedure :: increment
      procedure :: offer_lone
   end type two_stage_single_stepper

contains

   logical function fits(self, task)
      class(two_stage_single_stepper), intent(in) :: self
      type(stepper_task), intent(in) :: task

      fits = task%is_tableau() .and. task%correction == correction_none
      if (fits) fits = fits_two_stage_single(task%model, task%scheme, task%newton)
   end function fits

   subroutine make(self, task)
      class(two_stage_single_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      call new_two_stage_single_stepper(self, task%model, task%scheme, task%nlane, task%newton)
      self%one_solve = self%newton%affine
   end subroutine make

   !> Two stages, drift and noise alike, one degree of freedom, solved by Newton.
   pure logical function fits_two_stage_single(model, scheme, options)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme
      type(newton_options), intent(in) :: options

      fits_two_stage_single = scheme%form == tableau_form .and. scheme%nstage == 2 .and. &
                              model%traits%ndof == 1 .and. options%fixed_point == 0
      if (fits_two_stage_single) fits_two_stage_single = scheme%noise_coefficients_equal()
   end function fits_two_stage_single

   !> A stepper for blocks of nlane lanes; requires fits_two_stage_single and no correction.
   subroutine new_two_stage_single_stepper(self, model, scheme, nlane, options)
      type(two_stage_single_stepper), intent(out) :: self
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      integer, intent(in) :: nlane
      type(newton_options), intent(in) :: options

      self%name = 'two stages, one degree of freedom'
      self%a = scheme%a
      self%abar = scheme%abar
      self%alpha = scheme%alpha
      self%c = scheme%c
      call new_one_step_hamiltonian(self%ham, model, nlane, correction_none, 0.0_wp, scheme%brackets)
      call new_newton(self%newton, nlane, 4, options, &
                      model%traits%one_solve(.false.) .and. .not. allocated(self%ham%modified), -1, -1, &
                      exact=model%traits%has_hessian .and. .not. allocated(self%ham%modified))
      allocate (self%x(nlane, 4), self%qs(nlane, 1), self%ps(nlane, 1))
      allocate (self%hq(nlane, 1, 2), self%hp(nlane, 1, 2))
      ! where one solve must do, the elimination of the F would lose digits at h omega = 1000
      self%separable = model%traits%separable .and. .not. allocated(self%ham%modified) .and. .not. self%newton%affine
      allocate (self%hqq(nlane, 1, 1, 2), self%hpp(nlane, 1, 1, 2))
      if (.not. self%separable) allocate (self%hqp(nlane, 1, 1, 2))
   end subroutine new_two_stage_single_stepper

   subroutine increment(self, step, q, p, dq, dp, status)
      class(two_stage_single_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      integer :: i

      self%x = 0
      call self%newton%start(status)
      if (.not. self%newton%affine) call predict(self, step, q, p)
      do while (self%newton%running)
         do i = 1, 2
            call stage_point(self%ham%nlane, i, self%a, self%abar, q, p, self%x, self%qs, self%ps)
            call evaluate(self, i, step%t + self%c(i)*step%h, step, self%qs, self%ps)
         end do
         call correct(self, 2)
         call self%newton%judge(status, self%ham%counters)
      end do
      call add_stages(self%ham%nlane, self%alpha, self%x, dq, dp)
   end subroutine increment

   !> Paths one by one, where the Hamiltonians are separable and have their derivatives.
   subroutine offer_lone(self, lone)
      class(two_stage_single_stepper), intent(in) :: self
      class(lone_stepper), allocatable, intent(out) :: lone
      type(lone_two_stages), allocatable :: made

      if (.not. (self%separable .and. self%ham%model%traits%has_hessian)) return
      allocate (made)
      made%a = self%a
      made%abar = self%abar
      made%alpha = self%alpha
      made%c = self%c
      made%max_iter = self%newton%options%max_iter
      call move_alloc(made, lone)
   end subroutine offer_lone

   !> The first guess. It is not judged: a gradient that vanishes here need not vanish at the stages.
   subroutine predict(self, step, q, p)
      type(two_stage_single_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, 1), p(self%ham%nlane, 1)

      call evaluate(self, 1, step%t + 0.5_wp*step%h, step, q, p)
      call correct(self, 1)
   end subroutine predict

   !> Gradient and Hessian of stage i.
   subroutine evaluate(self, i, t, step, q, p)
      type(two_stage_single_stepper), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: t
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, 1), p(self%ham%nlane, 1)

      if (self%separable) then
         call self%ham%gradient_hessian(t, step%w, q, p, self%hq(:, :, i), self%hp(:, :, i), &
                                        hqq=self%hqq(:, :, :, i), hpp=self%hpp(:, :, :, i), step=step)
      else
         call self%ham%gradient_hessian(t, step%w, q, p, self%hq(:, :, i), self%hp(:, :, i), self%hqq(:, :, :, i), &
                                        self%hqp(:, :, :, i), self%hpp(:, :, :, i), step)
      end if
   end subroutine evaluate

   !> One correction of the slopes, with the gradient and Hessian of stage 1 and those of stage `second`.
   subroutine correct(self, second)
      type(two_stage_single_stepper), intent(inout) :: self
      integer, intent(in) :: second

      associate (n => self%newton)
         if (self%separable) then
            call solve_separable(self%ham%nlane, self%a, self%abar, self%hq(:, 1, 1), self%hq(:, 1, second), &
                                 self%hp(:, 1, 1), self%hp(:, 1, second), self%hqq(:, 1, 1, 1), &
                                 self%hqq(:, 1, 1, second), self%hpp(:, 1, 1, 1), self%hpp(:, 1, 1, second), &
                                 self%x, n%r)
         else
            call solve_lanes(self%ham%nlane, self%a, self%abar, self%hq(:, 1, 1), self%hq(:, 1, second), &
                             self%hp(:, 1, 1), self%hp(:, 1, second), self%hqq(:, 1, 1, 1), &
                             self%hqq(:, 1, 1, second), self%hqp(:, 1, 1, 1), self%hqp(:, 1, 1, second), &
                             self%hpp(:, 1, 1, 1), self%hpp(:, 1, 1, second), self%x, n%r)
         end if
         call correct_lanes(self%ham%nlane, 4, n%r, n%last, self%x, n%step, n%size)
      end associate
   end subroutine correct

end module symsde_step_two_stage_single
