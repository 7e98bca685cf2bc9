! SPDX-License-Identifier: BSD-3-Clause
!> Linearised flows between kicks that are no free drifts (step/splitting/drift, step/splitting/midpoint_drift).
!>
!> Exact flows of a quadratic part D = z.S z/2, or of declared frequencies, with decays of momenta: z' = A z with
!> A = J S - gamma, over the time tau, matrices once for all steps of one size,
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
   use symsde_base_kinds, only: wp, i8
   use symsde_base_matrices, only: exponential_less_one
   use symsde_base_record, only: step_record
   use symsde_base_traits, only: model_traits
   use symsde_base_vectors, only: add_times
   use symsde_model_abstract, only: model_type
   use symsde_scheme_kicks, only: flow_rotation
   use symsde_step_linear_linear_step, only: linear_step
   use symsde_step_open_linear_flow, only: linear_flow, new_linear_flow, hamiltonian_field
   use symsde_step_splitting_midpoint_drift, only: midpoint_flow, new_midpoint_flow
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: leg_flow, find_linear, linear_legs, new_linear_legs, midpoint_legs, new_midpoint_legs

   real(wp), parameter :: negligible = scale(1.0_wp, -64)  !! entries of R_k, as part of the largest of one unit

   !> The flows of a step, which keep the states before them, as `move` passes.
   type, abstract :: leg_flow
      real(wp), allocatable, dimension(:, :, :) :: q0, p0   !! (nlane, ndof, nleg)
   contains
      procedure(move_interface), deferred :: move
      procedure(back_interface), deferred :: back
      procedure(forth_interface), deferred :: forth
   end type leg_flow

   abstract interface
      !> Move (q, p) over the time tau from the time t on, in a step of length h.
      subroutine move_interface(self, leg, t, h, tau, q, p, status)
         import :: leg_flow, wp, i8
         class(leg_flow), intent(inout), target :: self
         integer, intent(in) :: leg
         real(wp), intent(in) :: t, h, tau
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
      type(linear_flow) :: flow, transposed         !! of A and of its transpose
      real(wp), allocatable :: field(:, :)          !! A (2 ndof, 2 ndof)
      real(wp), allocatable :: slopes(:, :, :)      !! A_k (2 ndof, 2 ndof, nparameter)
      real(wp), allocatable :: tau(:)               !! of each leg (nleg)
      real(wp), allocatable :: by(:, :, :, :)       !! R_k (2 ndof, 2 ndof, nparameter, nleg)
      real(wp), allocatable :: z(:, :), r(:, :)     !! a state, and R_k z (nlane, 2 ndof)
   contains
      procedure :: move => move_linearly
      procedure :: back => back_linearly
      procedure :: forth => forth_linearly
   end type linear_legs

   type, extends(leg_flow) :: midpoint_legs
      private
      type(midpoint_flow) :: flow                        !! that of the run
      class(linear_step), allocatable, public :: step    !! linearised midpoint step
      real(wp), allocatable :: rate(:)                   !! gamma (ndof); not allocated without damping
      real(wp), allocatable :: w(:, :)                   !! tau, and zero for noises (nlane, 0:nnoise)
      real(wp), allocatable, dimension(:, :, :) :: q1, p1   !! states behind each midpoint step (nlane, ndof, nleg)
      real(wp), allocatable, dimension(:) :: t, tau      !! of each leg (nleg)
   contains
      procedure :: move => move_by_midpoint
      procedure :: back => back_by_midpoint
      procedure :: forth => forth_by_midpoint
      procedure, private :: show
   end type midpoint_legs

contains

   !> S of the linear flows between the kicks of a task, and its derivatives by parameters; not allocated where there
   !> are none, or are not known.
   subroutine find_linear(task, wide, second, slopes)
      type(stepper_task), intent(in) :: task
      type(model_traits), intent(in) :: wide
      real(wp), allocatable, intent(out) :: second(:, :)      !! S (2 ndof, 2 ndof)
      real(wp), allocatable, intent(out) :: slopes(:, :, :)   !! dS/dtheta_k (2 ndof, 2 ndof, nparameter)
      integer :: i, k, n

      n = task%model%traits%ndof
      k = wide%ndof - n
      if (task%scheme%kicks%flow == flow_rotation) then
         allocate (second(2*n, 2*n), source=0.0_wp)
         do i = 1, n
            second(i, i) = task%model%traits%rotation(i)**2
            second(n + i, n + i) = 1
         end do
         if (k > 0 .and. .not. allocated(wide%rotation_slopes)) return
         allocate (slopes(2*n, 2*n, k), source=0.0_wp)
         do i = 1, merge(n, 0, k > 0)
            slopes(i, i, :) = wide%rotation_slopes(i, :)
         end do
      else if (task%drifts_by_part()) then
         second = task%model%traits%quadratic_part
         if (k == 0) allocate (slopes(2*n, 2*n, 0))
         if (k > 0 .and. allocated(wide%quadratic_slopes)) slopes = wide%quadratic_slopes
      end if
   end subroutine find_linear

   !> Flows of a field A with the derivatives J S_k of A by parameters.
   subroutine new_linear_legs(self, nlane, nleg, field, slopes)
      type(linear_legs), intent(out) :: self
      integer, intent(in) :: nlane, nleg
      real(wp), intent(in) :: field(:, :)        !! A (2 ndof, 2 ndof)
      real(wp), intent(in) :: slopes(:, :, :)    !! S_k (2 ndof, 2 ndof, nparameter)
      integer :: k, n

      n = size(field, 1)
      self%field = field
      allocate (self%slopes, mold=slopes)
      do k = 1, size(slopes, 3)
         self%slopes(:, :, k) = hamiltonian_field(slopes(:, :, k))
      end do
      call new_linear_flow(self%flow, field, nleg)
      call new_linear_flow(self%transposed, transpose(field), nleg)
      allocate (self%tau(nleg), self%by(n, n, size(slopes, 3), nleg), source=0.0_wp)
      allocate (self%z(nlane, n), self%r(nlane, n), self%q0(nlane, n/2, nleg), self%p0(nlane, n/2, nleg))
   end subroutine new_linear_legs

   !> R_k of a leg over the time tau.
   subroutine set_leg(self, leg, tau)
      type(linear_legs), intent(inout) :: self
      integer, intent(in) :: leg
      real(wp), intent(in) :: tau
      real(wp), allocatable :: both(:, :), found(:, :)
      integer :: i, j, k, n

      n = size(self%field, 1)
      self%tau(leg) = tau
      do k = 1, size(self%slopes, 3)
         if (.not. any(abs(self%slopes(:, :, k)) > 0)) cycle
         if (.not. allocated(both)) allocate (both(2*n, 2*n), found(2*n, 2*n), source=0.0_wp)
         both(:n, :n) = self%field
         both(n + 1:, n + 1:) = self%field
         both(:n, n + 1:) = self%slopes(:, :, k)
         call exponential_less_one(2*n, both, tau, found)
         do j = 0, n/2, n/2
            do i = 0, n/2, n/2
               associate (x => found(i + 1:i + n/2, n + j + 1:n + j + n/2))
                  self%by(i + 1:i + n/2, j + 1:j + n/2, k, leg) = merge(x, 0.0_wp, abs(x) > negligible*maxval(abs(x)))
               end associate
            end do
         end do
      end do
   end subroutine set_leg

   subroutine move_linearly(self, leg, t, h, tau, q, p, status)
      class(linear_legs), intent(inout), target :: self
      integer, intent(in) :: leg
      real(wp), intent(in) :: t, h, tau
      real(wp), intent(inout) :: q(:, :), p(:, :)
      integer(i8), intent(inout) :: status(:)

      if (abs(tau - self%tau(leg)) > 0) call set_leg(self, leg, tau)
      self%q0(:, :, leg) = q
      self%p0(:, :, leg) = p
      call turn(self%flow, leg, tau, q, p)
   end subroutine move_linearly

   subroutine back_linearly(self, leg, u, c, status)
      class(linear_legs), intent(inout), target :: self
      integer, intent(in) :: leg
      real(wp), intent(inout) :: u(:, :), c(:, :)
      integer(i8), intent(inout) :: status(:)
      integer :: k, n

      n = size(c, 2)
      do k = 1, size(self%by, 3)
         call change_by(self, leg, k)
         u(:, n + k) = u(:, n + k) + sum(u(:, :n)*self%r(:, :n) + c*self%r(:, n + 1:), dim=2)
      end do
      call turn(self%transposed, leg, self%tau(leg), u(:, :n), c)
   end subroutine back_linearly

   subroutine forth_linearly(self, leg, vq, vp, status)
      class(linear_legs), intent(inout), target :: self
      integer, intent(in) :: leg
      real(wp), intent(inout) :: vq(:, :, :), vp(:, :, :)
      integer(i8), intent(inout) :: status(:)
      integer :: j, k, n

      n = size(vp, 2)
      do j = 1, size(vp, 3)
         call turn(self%flow, leg, self%tau(leg), vq(:, :n, j), vp(:, :, j))
      end do
      do k = 1, size(self%by, 3)
         call change_by(self, leg, k)
         do j = 1, size(vp, 3)
            vq(:, :n, j) = vq(:, :n, j) + self%r(:, :n)*spread(vq(:, n + k, j), 2, n)
            vp(:, :, j) = vp(:, :, j) + self%r(:, n + 1:)*spread(vq(:, n + k, j), 2, n)
         end do
      end do
   end subroutine forth_linearly

   !> (q, p) <- exp(tau A) (q, p) of a flow.
   subroutine turn(flow, leg, tau, q, p)
      type(linear_flow), intent(inout) :: flow
      integer, intent(in) :: leg
      real(wp), intent(in) :: tau
      real(wp), intent(inout) :: q(:, :), p(:, :)                 !! (nlane, ndof)
      real(wp), dimension(size(p, 1), size(p, 2)) :: dq, dp

      dq = 0
      dp = 0
      call flow%move(leg, tau, size(p, 1), size(p, 2), q, p, dq, dp)
      q = q + dq
      p = p + dp
   end subroutine turn

   !> r = R_k z of the state before a leg.
   subroutine change_by(self, leg, k)
      type(linear_legs), intent(inout) :: self
      integer, intent(in) :: leg, k
      integer :: i, j, n

      n = size(self%q0, 2)
      self%z(:, :n) = self%q0(:, :, leg)
      self%z(:, n + 1:) = self%p0(:, :, leg)
      self%r = 0
      do j = 1, 2*n
         do i = 1, 2*n
            if (abs(self%by(i, j, k, leg)) > 0) &
               call add_times(size(self%z, 1), self%by(i, j, k, leg), self%z(:, j), self%r(:, i))
         end do
      end do
   end subroutine change_by

   !> Midpoint steps of a task of kicks between them; step: the linearised midpoint step of its model.
   subroutine new_midpoint_legs(self, task, model, nlane, step)
      type(midpoint_legs), intent(out) :: self
      type(stepper_task), intent(in) :: task           !! the task with the scheme of kicks
      class(model_type), intent(in), target :: model   !! the path's model, or a view that knows the lanes' paths
      integer, intent(in) :: nlane
      class(linear_step), allocatable, intent(inout) :: step
      type(stepper_task) :: whole
      integer :: n, nleg

      n = model%traits%ndof
      nleg = size(task%scheme%kicks%c) + 1
      whole = task
      whole%model => model
      whole%nlane = nlane
      call new_midpoint_flow(self%flow, whole)
      call move_alloc(step, self%step)
      if (task%damping%acts()) self%rate = task%damping%rate
      allocate (self%w(nlane, 0:model%traits%nnoise), source=0.0_wp)
      allocate (self%q0(nlane, n, nleg), self%p0(nlane, n, nleg), self%q1(nlane, n, nleg), self%p1(nlane, n, nleg))
      allocate (self%t(nleg), self%tau(nleg), source=0.0_wp)
   end subroutine new_midpoint_legs

   subroutine move_by_midpoint(self, leg, t, h, tau, q, p, status)
      class(midpoint_legs), intent(inout), target :: self
      integer, intent(in) :: leg
      real(wp), intent(in) :: t, h, tau
      real(wp), intent(inout) :: q(:, :), p(:, :)
      integer(i8), intent(inout) :: status(:)
      real(wp), dimension(size(p, 1), size(p, 2)) :: dq, dp

      self%t(leg) = t
      self%tau(leg) = tau
      dq = 0
      dp = 0
      associate (flow => self%flow)
         call flow%move(leg, t, h, tau, q, p, dq, dp, status)
         self%q0(:, :, leg) = flow%x
         self%p0(:, :, leg) = flow%y
         self%q1(:, :, leg) = flow%x + flow%dx
         self%p1(:, :, leg) = flow%y + flow%dy
      end associate
      q = q + dq
      p = p + dp
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

end module symsde_step_linear_legs
