! SPDX-License-Identifier: BSD-3-Clause
!> The linearised map of one step and its transpose: exact, along the path that a stepper has taken.
!>
!>    z_{n+1} = F(z_n; theta),   lambda_n = F_z^T lambda_{n+1},   g_theta <- g_theta + F_theta^T lambda_{n+1}
!>                               v_{n+1} = F_z v_n + F_theta dtheta
!>
!> with lambda = (u, c) the covectors of q and p: u = dJ/dq, c = dJ/dp of a functional J of the path behind the step.
!>
!> Parameters are positions that do not move. The wide model has the positions (q, theta), the momenta (p, pi) and the
!> same Hamiltonians H_j(q, p; theta), which do not depend on pi: theta stays, and (q, p) move as before. So the
!> covector of theta is dJ/dtheta, and one product of the wide model's Hessian gives the derivatives by states and by
!> parameters together. Rows ndof + 1 .. of u belong to the parameters, rows behind nwide to the rates of damping.
!>
!> `back` gets the states; steps backward would lose digits like exp(lambda t).
module symsde_step_linear_linear_step
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_status, only: error_type
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   implicit none
   private
   public :: linear_step, keep_parameters

   type, abstract :: linear_step
      integer :: nlane = 0, ndof = 0       !! lanes, a multiple of 8; degrees of freedom of the path
      integer :: nwide = 0                 !! degrees of freedom of the wide model: ndof and the parameters
      integer :: nrow = 0                  !! rows of u: nwide, and ndof more for the rates of damping, if wanted
      logical :: by_position = .false.     !! momenta of the path are not read
      type(one_step_hamiltonian) :: ham    !! Hamiltonian of the wide model
      real(wp), allocatable :: q(:, :), p(:, :)   !! a state of the wide model (nlane, nwide)
   contains
      procedure(back_interface), deferred :: back
      procedure(forth_interface), deferred :: forth
      procedure :: take_back => take_none_back
      procedure :: check => nothing_to_check
      procedure :: settle => nothing_left
      procedure :: set_parameters => keep_parameters
      procedure :: load
   end type linear_step

   abstract interface
      !> Take covectors from behind the step, from (q0, p0) to (q1, p1), to before it. A part of the step may be left
      !> for the step before, whose end is at the same point: `settle` does this part. Lanes whose status is not 0,
      !> or becomes so here, have no covectors.
      subroutine back_interface(self, step, q0, p0, q1, p1, u, c, status)
         import :: linear_step, step_record, wp, i8
         class(linear_step), intent(inout) :: self
         type(step_record), intent(in) :: step
         real(wp), intent(in) :: q0(self%nlane, self%ndof), p0(self%nlane, self%ndof)
         real(wp), intent(in) :: q1(self%nlane, self%ndof), p1(self%nlane, self%ndof)
         real(wp), intent(inout) :: u(self%nlane, self%nrow), c(self%nlane, self%ndof)
         integer(i8), intent(inout) :: status(self%nlane)
      end subroutine back_interface

      !> Take m tangent vectors (dq, dtheta), dp from before the step to behind it; dtheta stays.
      subroutine forth_interface(self, step, q0, p0, q1, p1, m, vq, vp, status)
         import :: linear_step, step_record, wp, i8
         class(linear_step), intent(inout) :: self
         type(step_record), intent(in) :: step
         real(wp), intent(in) :: q0(self%nlane, self%ndof), p0(self%nlane, self%ndof)
         real(wp), intent(in) :: q1(self%nlane, self%ndof), p1(self%nlane, self%ndof)
         integer, intent(in) :: m
         real(wp), intent(inout) :: vq(self%nlane, self%nrow, m), vp(self%nlane, self%ndof, m)
         integer(i8), intent(inout) :: status(self%nlane)
      end subroutine forth_interface
   end interface

contains

   !> Take covectors from state `high` back to state `low` at once, nothing left over; this default takes no step.
   subroutine take_none_back(self, low, high, nstep, t, h, dw, q, u, c, taken)
      class(linear_step), intent(inout) :: self
      integer, intent(in) :: low, high, nstep                        !! states, of 0 .. nstep
      real(wp), intent(in) :: t, h                                   !! time of state low, and the step
      real(wp), intent(in) :: dw(self%nlane, self%ham%nnoise, 0:nstep - 1)
      real(wp), intent(in) :: q(self%nlane, self%ndof, 0:nstep)
      real(wp), intent(inout) :: u(self%nlane, self%nrow), c(self%nlane, self%ndof)
      logical, intent(out) :: taken

      taken = .false.
   end subroutine take_none_back

   !> Test functions of the wide model that are used beside its Hessian, for these parameters; this default uses none.
   subroutine nothing_to_check(self, theta, t, h, error)
      class(linear_step), intent(inout) :: self
      real(wp), intent(in) :: theta(:)   !! (nrow - ndof)
      real(wp), intent(in) :: t, h
      type(error_type), allocatable, intent(inout) :: error
   end subroutine nothing_to_check

   !> Complete the last step taken backward, which began at (q0, p0). This default has nothing left.
   subroutine nothing_left(self, q0, p0, u, c)
      class(linear_step), intent(inout) :: self
      real(wp), intent(in) :: q0(self%nlane, self%ndof), p0(self%nlane, self%ndof)
      real(wp), intent(inout) :: u(self%nlane, self%nrow), c(self%nlane, self%ndof)
   end subroutine nothing_left

   !> Allocate the state of the wide model, and set its parameters, for all later steps.
   subroutine keep_parameters(self, theta)
      class(linear_step), intent(inout) :: self
      real(wp), intent(in) :: theta(:, :)   !! (nlane, nrow - ndof); values of rates are not read

      if (.not. allocated(self%q)) &
         allocate (self%q(self%nlane, self%nwide), self%p(self%nlane, self%nwide), source=0.0_wp)
      self%q(:, self%ndof + 1:) = theta(:, :self%nwide - self%ndof)
   end subroutine keep_parameters

   !> Load a state of the path.
   subroutine load(self, q, p)
      class(linear_step), intent(inout) :: self
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)
      integer :: i

      do i = 1, self%ndof
         self%q(:, i) = q(:, i)
         if (.not. self%by_position) self%p(:, i) = p(:, i)
      end do
   end subroutine load

end module symsde_step_linear_linear_step
