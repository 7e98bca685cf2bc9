! SPDX-License-Identifier: BSD-3-Clause
!> Linearised flows between kicks that are no free drifts (step/splitting/drift, step/splitting/midpoint_drift).
!>
!> Exact flows of a quadratic part D = z.S z/2, or of declared frequencies, with decays of momenta: z' = A z with
!> A = J S - gamma, over the time tau, once for all steps of one size,
!>
!>    z <- R z          R = exp(tau A)       R_k = d exp(tau A)/d theta_k, with A_k = J S_k
!>    lambda <- R^T lambda                   g_k <- g_k + lambda.R_k z,  lambda from behind the flow, z from before it
!>    v <- R v + sum_k R_k z dtheta_k        the Frechet derivative R_k is a block of exp(tau (A, A_k; 0, A))
!>
!> Midpoint steps of H, with decays of momenta over half of the time before and after them: the linearised midpoint step
!> of the same model and parameters, whose weights are tau and no increments.
!>
!> Private to its family.
module symsde_step_linear_legs
   use symsde_base_damping, only: damping_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_matrices, only: exponential_less_one
   use symsde_base_record, only: step_record
   use symsde_base_vectors, only: add_times
   use symsde_step_linear_linear_step, only: linear_step
   use symsde_step_oracle_general, only: general_stepper, new_general_stepper
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: leg_flow, linear_legs, new_linear_legs, midpoint_legs, new_midpoint_legs

   !> The flows of a step, which keep the states before them, as `move` passes.
   type, abstract :: leg_flow
      real(wp), allocatable, dimension(:, :, :) :: q0, p0   !! (nlane, ndof, nleg)
   contains
      procedure(move_interface), deferred :: move
      procedure(back_interface), deferred :: back
      procedure(forth_interface), deferred :: forth
   end type leg_flow

   abstract interface
      !> Move (q, p) over the time tau from the time t on.
      subroutine move_interface(self, leg, t, tau, q, p, status)
         import :: leg_flow, wp, i8
         class(leg_flow), intent(inout), target :: self
         integer, intent(in) :: leg
         real(wp), intent(in) :: t, tau
         real(wp), intent(inout) :: q(:, :), p(:, :)      !! (nlane, ndof)
         integer(i8), intent(inout) :: status(:)          !! (nlane)
      end subroutine move_interface

      !> Take covectors from behind the flow to before it.
      subroutine back_interface(self, leg, u, c, status)
         import :: leg_flow, wp, i8
         class(leg_flow), intent(inout), target :: self
         integer, intent(in) :: leg
         real(wp), intent(inout) :: u(:, :), c(:, :)      !! (nlane, nrow), (nlane, ndof)
         integer(i8), intent(inout) :: status(:)
      end subroutine back_interface

      !> Take tangent vectors from before the flow to behind it.
      subroutine forth_interface(self, leg, vq, vp, status)
         import :: leg_flow, wp, i8
         class(leg_flow), intent(inout), target :: self
         integer, intent(in) :: leg
         real(wp), intent(inout) :: vq(:, :, :), vp(:, :, :)   !! (nlane, nrow, m), (nlane, ndof, m)
         integer(i8), intent(inout) :: status(:)
      end subroutine forth_interface
   end interface

   type, extends(leg_flow) :: linear_legs
      private
      integer :: ndof = 0, nparameter = 0
      real(wp), allocatable :: field(:, :)          !! A (2 ndof, 2 ndof)
      real(wp), allocatable :: slopes(:, :, :)      !! A_k (2 ndof, 2 ndof, nparameter)
      real(wp), allocatable :: duration(:)          !! tau of each leg, whose matrices follow (nleg)
      real(wp), allocatable :: change(:, :, :)      !! R - 1 (2 ndof, 2 ndof, nleg)
      real(wp), allocatable :: by(:, :, :, :)       !! R_k (2 ndof, 2 ndof, nparameter, nleg)
      real(wp), allocatable :: x(:, :), y(:, :)     !! vectors before and behind a flow (nlane, 2 ndof)
   contains
      procedure :: move => move_linearly
      procedure :: back => back_linearly
      procedure :: forth => forth_linearly
   end type linear_legs

   type, extends(leg_flow) :: midpoint_legs
      private
      class(linear_step), allocatable, public :: step    !! linearised midpoint step
      type(general_stepper) :: mover
      real(wp), allocatable :: rate(:)                   !! gamma (ndof); not allocated without damping
      real(wp), allocatable :: w(:, :)                   !! tau, and zero for noises (nlane, 0:nnoise)
      real(wp), allocatable, dimension(:, :, :) :: q1, p1   !! states behind each midpoint step (nlane, ndof, nleg)
      real(wp), allocatable, dimension(:, :) :: dq, dp   !! (nlane, ndof)
      real(wp), allocatable, dimension(:) :: t, tau      !! of each leg (nleg)
   contains
      procedure :: move => move_by_midpoint
      procedure :: back => back_by_midpoint
      procedure :: forth => forth_by_midpoint
      procedure, private :: show
   end type midpoint_legs

contains

   !> Flows of a field A with the derivatives J S_k of A by parameters.
   subroutine new_linear_legs(self, nlane, nleg, field, slopes)
      type(linear_legs), intent(out) :: self
      integer, intent(in) :: nlane, nleg
      real(wp), intent(in) :: field(:, :)        !! A (2 ndof, 2 ndof)
      real(wp), intent(in) :: slopes(:, :, :)    !! S_k (2 ndof, 2 ndof, nparameter)
      integer :: n

      n = size(field, 1)/2
      self%ndof = n
      self%nparameter = size(slopes, 3)
      self%field = field
      allocate (self%slopes(2*n, 2*n, self%nparameter))
      self%slopes(:n, :, :) = slopes(n + 1:, :, :)
      self%slopes(n + 1:, :, :) = -slopes(:n, :, :)
      allocate (self%duration(nleg), self%change(2*n, 2*n, nleg), self%by(2*n, 2*n, self%nparameter, nleg), &
                source=0.0_wp)
      allocate (self%x(nlane, 2*n), self%y(nlane, 2*n), self%q0(nlane, n, nleg), self%p0(nlane, n, nleg))
   end subroutine new_linear_legs

   !> The matrices of a leg.
   subroutine set_leg(self, leg, tau)
      type(linear_legs), intent(inout) :: self
      integer, intent(in) :: leg
      real(wp), intent(in) :: tau
      real(wp), allocatable :: both(:, :), found(:, :)
      integer :: k, n

      n = 2*self%ndof
      self%duration(leg) = tau
      call exponential_less_one(n, self%field, tau, self%change(:, :, leg))
      do k = 1, self%nparameter
         if (.not. maxval(abs(self%slopes(:, :, k))) > 0) cycle
         if (.not. allocated(both)) allocate (both(2*n, 2*n), found(2*n, 2*n), source=0.0_wp)
         both(:n, :n) = self%field
         both(n + 1:, n + 1:) = self%field
         both(:n, n + 1:) = self%slopes(:, :, k)
         call exponential_less_one(2*n, both, tau, found)
         self%by(:, :, k, leg) = found(:n, n + 1:)
      end do
   end subroutine set_leg

   subroutine move_linearly(self, leg, t, tau, q, p, status)
      class(linear_legs), intent(inout), target :: self
      integer, intent(in) :: leg
      real(wp), intent(in) :: t, tau
      real(wp), intent(inout) :: q(:, :), p(:, :)
      integer(i8), intent(inout) :: status(:)

      if (abs(tau - self%duration(leg)) > 0) call set_leg(self, leg, tau)
      self%q0(:, :, leg) = q
      self%p0(:, :, leg) = p
      self%x(:, :self%ndof) = q
      self%x(:, self%ndof + 1:) = p
      self%y = self%x
      call add_rows(size(q, 1), 2*self%ndof, self%change(:, :, leg), self%x, self%y)
      q = self%y(:, :self%ndof)
      p = self%y(:, self%ndof + 1:)
   end subroutine move_linearly

   subroutine back_linearly(self, leg, u, c, status)
      class(linear_legs), intent(inout), target :: self
      integer, intent(in) :: leg
      real(wp), intent(inout) :: u(:, :), c(:, :)
      integer(i8), intent(inout) :: status(:)
      integer :: i, k, n

      n = self%ndof
      self%x(:, :n) = self%q0(:, :, leg)
      self%x(:, n + 1:) = self%p0(:, :, leg)
      do k = 1, self%nparameter
         self%y = 0
         call add_rows(size(c, 1), 2*n, self%by(:, :, k, leg), self%x, self%y)
         do i = 1, n
            u(:, n + k) = u(:, n + k) + (u(:, i)*self%y(:, i) + (c(:, i)*self%y(:, n + i)))
         end do
      end do
      self%x(:, :n) = u(:, :n)
      self%x(:, n + 1:) = c
      self%y = self%x
      call add_columns(size(c, 1), 2*n, self%change(:, :, leg), self%x, self%y)
      u(:, :n) = self%y(:, :n)
      c = self%y(:, n + 1:)
   end subroutine back_linearly

   subroutine forth_linearly(self, leg, vq, vp, status)
      class(linear_legs), intent(inout), target :: self
      integer, intent(in) :: leg
      real(wp), intent(inout) :: vq(:, :, :), vp(:, :, :)
      integer(i8), intent(inout) :: status(:)
      integer :: j, k, n

      n = self%ndof
      do j = 1, size(vq, 3)
         self%x(:, :n) = vq(:, :n, j)
         self%x(:, n + 1:) = vp(:, :, j)
         self%y = self%x
         call add_rows(size(vq, 1), 2*n, self%change(:, :, leg), self%x, self%y)
         do k = 1, self%nparameter
            self%x(:, :n) = self%q0(:, :, leg)*spread(vq(:, n + k, j), 2, n)
            self%x(:, n + 1:) = self%p0(:, :, leg)*spread(vq(:, n + k, j), 2, n)
            call add_rows(size(vq, 1), 2*n, self%by(:, :, k, leg), self%x, self%y)
         end do
         vq(:, :n, j) = self%y(:, :n)
         vp(:, :, j) = self%y(:, n + 1:)
      end do
   end subroutine forth_linearly

   !> Midpoint steps of a task of kicks between them; step: the linearised midpoint step of its model.
   subroutine new_midpoint_legs(self, task, whole, nlane, step)
      type(midpoint_legs), intent(out) :: self
      type(stepper_task), intent(in) :: task           !! the same task with the scheme midpoint, without damping
      type(stepper_task), intent(in) :: whole          !! the task with the scheme of kicks
      integer, intent(in) :: nlane
      class(linear_step), allocatable, intent(inout) :: step
      integer :: n, nleg

      n = task%model%traits%ndof
      nleg = size(whole%scheme%kicks%c) + 1
      call move_alloc(step, self%step)
      call new_general_stepper(self%mover, task%model, task%scheme, task%correction, nlane, task%newton, damping_type())
      if (whole%damping%acts()) self%rate = whole%damping%rate
      allocate (self%w(nlane, 0:task%model%traits%nnoise), source=0.0_wp)
      allocate (self%q0(nlane, n, nleg), self%p0(nlane, n, nleg), self%q1(nlane, n, nleg), self%p1(nlane, n, nleg))
      allocate (self%dq(nlane, n), self%dp(nlane, n), self%t(nleg), self%tau(nleg), source=0.0_wp)
   end subroutine new_midpoint_legs

   subroutine move_by_midpoint(self, leg, t, tau, q, p, status)
      class(midpoint_legs), intent(inout), target :: self
      integer, intent(in) :: leg
      real(wp), intent(in) :: t, tau
      real(wp), intent(inout) :: q(:, :), p(:, :)
      integer(i8), intent(inout) :: status(:)
      type(step_record) :: step

      self%t(leg) = t
      self%tau(leg) = tau
      call fade(self, leg, p)
      self%q0(:, :, leg) = q
      self%p0(:, :, leg) = p
      call self%show(leg, step)
      call self%mover%increment(step, self%q0(:, :, leg), self%p0(:, :, leg), self%dq, self%dp, status)
      q = q + self%dq
      p = p + self%dp
      self%q1(:, :, leg) = q
      self%p1(:, :, leg) = p
      call fade(self, leg, p)
   end subroutine move_by_midpoint

   subroutine back_by_midpoint(self, leg, u, c, status)
      class(midpoint_legs), intent(inout), target :: self
      integer, intent(in) :: leg
      real(wp), intent(inout) :: u(:, :), c(:, :)
      integer(i8), intent(inout) :: status(:)
      type(step_record) :: step

      call self%show(leg, step)
      call fade(self, leg, c)
      call self%step%back(step, self%q0(:, :, leg), self%p0(:, :, leg), self%q1(:, :, leg), self%p1(:, :, leg), u, c, &
                          status)
      call fade(self, leg, c)
   end subroutine back_by_midpoint

   subroutine forth_by_midpoint(self, leg, vq, vp, status)
      class(midpoint_legs), intent(inout), target :: self
      integer, intent(in) :: leg
      real(wp), intent(inout) :: vq(:, :, :), vp(:, :, :)
      integer(i8), intent(inout) :: status(:)
      type(step_record) :: step
      integer :: j

      call self%show(leg, step)
      do j = 1, size(vp, 3)
         call fade(self, leg, vp(:, :, j))
      end do
      call self%step%forth(step, self%q0(:, :, leg), self%p0(:, :, leg), self%q1(:, :, leg), self%p1(:, :, leg), &
                           size(vp, 3), vq, vp, status)
      do j = 1, size(vp, 3)
         call fade(self, leg, vp(:, :, j))
      end do
   end subroutine forth_by_midpoint

   !> The midpoint step of a leg.
   subroutine show(self, leg, step)
      class(midpoint_legs), intent(inout), target :: self
      integer, intent(in) :: leg
      type(step_record), intent(inout) :: step

      self%w(:, 0) = self%tau(leg)
      step%t = self%t(leg)
      step%h = self%tau(leg)
      step%w(1:, 0:) => self%w
   end subroutine show

   !> x <- exp(-gamma tau/2) x: momenta before and behind a midpoint step, their tangent vectors and covectors.
   pure subroutine fade(self, leg, x)
      type(midpoint_legs), intent(in) :: self
      integer, intent(in) :: leg
      real(wp), intent(inout) :: x(:, :)   !! (nlane, ndof)
      integer :: i

      if (.not. allocated(self%rate)) return
      do i = 1, size(x, 2)
         x(:, i) = exp(-0.5_wp*self%rate(i)*self%tau(leg))*x(:, i)
      end do
   end subroutine fade

   !> y_i <- y_i + sum_j a_ij x_j
   pure subroutine add_rows(nlane, n, a, x, y)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: a(n, n), x(nlane, n)
      real(wp), intent(inout) :: y(nlane, n)
      integer :: i, j

      do i = 1, n
         do j = 1, n
            if (abs(a(i, j)) > 0) call add_times(nlane, a(i, j), x(:, j), y(:, i))
         end do
      end do
   end subroutine add_rows

   !> y_j <- y_j + sum_i a_ij x_i
   pure subroutine add_columns(nlane, n, a, x, y)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: a(n, n), x(nlane, n)
      real(wp), intent(inout) :: y(nlane, n)
      integer :: i, j

      do j = 1, n
         do i = 1, n
            if (abs(a(i, j)) > 0) call add_times(nlane, a(i, j), x(:, i), y(:, j))
         end do
      end do
   end subroutine add_columns

end module symsde_step_linear_legs
