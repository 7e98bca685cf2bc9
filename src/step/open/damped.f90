! SPDX-License-Identifier: BSD-3-Clause
!> The step of a scheme with one stage for a damped model: a stepper that contains another stepper.
!>
!> With one node c the tableau with decays (scheme/decays) is exactly the scheme's own step between two decays of the
!> momenta, z_i = gamma_i h:
!>
!>    p* = exp(-c z) p_n,   (q_{n+1}, p**) = step of the closed system from (q_n, p*),   p_{n+1} = exp(-(1 - c) z) p**
!>
!> so that every stepper of the closed system can be used. In increments, with p** = p* + dp*:
!>
!>    dp = (exp(-z) - 1) p_n + exp(-(1 - c) z) dp*
!>
!> The inner stepper is made for the task without damping. With one rate the correction of one-sided schemes and
!> brackets are multiplied like Hhat, and need no change.
module symsde_step_open_damped
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record, steps_record
   use symsde_scheme_decays, only: tableau_decays, new_decays
   use symsde_scheme_scheme, only: tableau_form, frame_none
   use symsde_step_stepper, only: stepper_type, stepper_task
   implicit none
   private
   public :: damped_stepper, damped_fits

   type, extends(stepper_type) :: damped_stepper
      class(stepper_type), allocatable :: inner  !! stepper of the closed system
      type(tableau_decays), private :: decays
      real(wp) :: node = 0                       !! c, the part of the step before the inner one
      real(wp), allocatable :: start(:, :)       !! p* (nlane, ndof)
   contains
      procedure :: make
      procedure :: increment
      procedure :: prefetch
      procedure :: tally
   end type damped_stepper

contains

   !> Whether the step of the closed system can be used for a damped model: a tableau of one stage, or any tableau if
   !> damping is by a matrix or by functions.
   pure logical function damped_fits(task)
      type(stepper_task), intent(in) :: task

      damped_fits = task%scheme%form == tableau_form .and. task%scheme%frame == frame_none .and. &
                    (task%scheme%nstage == 1 .or. .not. allocated(task%damping%rate))
   end function damped_fits

   !> Copy the name and the properties of the inner stepper, which has been made.
   subroutine make(self, task)
      class(damped_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task

      self%name = self%inner%name//', damped'
      self%explicit = self%inner%explicit
      self%one_solve = self%inner%one_solve
      self%most_single = self%inner%most_single
      if (allocated(self%inner%left_out)) self%left_out = self%inner%left_out
      self%ham = self%inner%ham
      call new_decays(self%decays, task%damping, task%scheme%c, self%ham%ndof)
      self%node = 0.5_wp
      if (task%scheme%nstage == 1) self%node = task%scheme%c(1)
      allocate (self%start(self%ham%nlane, self%ham%ndof))
   end subroutine make

   !> The inner step between two decays. Parentheses leave only the first product to be contracted, in one lane as in
   !> many.
   subroutine increment(self, step, q, p, dq, dp, status)
      class(damped_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      integer :: i

      call self%decays%set_step(step%h)
      self%inner%ham%nreal = self%ham%nreal
      do i = 1, self%ham%ndof
         self%start(:, i) = self%decays%begin(1, i)*p(:, i)
      end do
      call self%inner%increment(step, q, self%start, dq, dp, status)
      do i = 1, self%ham%ndof
         dp(:, i) = self%decays%loss(i)*p(:, i) + (self%decays%finish(1, i)*dp(:, i))
      end do
   end subroutine increment

   !> Let the inner stepper compute ahead.
   subroutine prefetch(self, steps)
      class(damped_stepper), intent(inout), target :: self
      type(steps_record), intent(in) :: steps

      call self%inner%prefetch(steps)
   end subroutine prefetch

   !> Add the counts of the inner stepper.
   subroutine tally(self, total)
      class(damped_stepper), intent(in) :: self
      type(counters_type), intent(inout) :: total

      call self%inner%tally(total)
   end subroutine tally

end module symsde_step_open_damped
