! SPDX-License-Identifier: BSD-3-Clause
!> The velocity of a constant mass that is not the identity,
!>
!>    H = p.M^-1 p/2 + U(q),   noise in position:      Hhat_p = h M^-1 p,   dq = h M^-1 p
!>
!> If M is diagonal its numbers are found once, from the model, so that a user's function need not compute the force
!> again for every velocity. Otherwise the model is called for H_p with the weight of H alone. The model declares that
!> the mass is constant, but not that it is diagonal: model/diagonal_mass tests this.
module symsde_step_hamiltonian_mass
   use symsde_base_kinds, only: wp
   use symsde_base_vectors, only: add_vectors => add
   use symsde_model_abstract, only: model_type
   use symsde_model_diagonal_mass, only: find_diagonal_mass
   implicit none
   private
   public :: constant_mass, new_constant_mass

   !> The mass as far as it is known, and work arrays for a call of the model. The first finite position decides whether
   !> M is diagonal. `asked` is the cost of a velocity: one gradient, or none once M is known to be diagonal.
   type :: constant_mass
      logical :: diagonal = .false.
      integer :: asked = 0                                !! gradients that a velocity costs
      real(wp), allocatable :: inverse(:)                 !! the diagonal of M^-1 (ndof)
      logical :: known = .false.                          !! whether it was tested; read before `look`, which allocates
      real(wp), allocatable :: unit(:, :)                 !! weight one for H alone (nlane, 0:nnoise)
      real(wp), allocatable, private :: hp(:, :)          !! H_p (nlane, ndof)
   contains
      procedure :: look
      procedure :: drift
      procedure :: add
   end type constant_mass

contains

   !> Allocate for blocks of nlane lanes. The model is not called yet: it need only be defined at positions of paths,
   !> and none is known here.
   subroutine new_constant_mass(self, nlane, ndof, nnoise)
      type(constant_mass), intent(out) :: self
      integer, intent(in) :: nlane, ndof, nnoise

      allocate (self%inverse(ndof), source=0.0_wp)
      allocate (self%unit(nlane, 0:nnoise), source=0.0_wp)
      self%unit(:, 0) = 1
      self%asked = 1
   end subroutine new_constant_mass

   !> Test whether M is diagonal, at a position of some path. The position does not matter: the numbers are the same for
   !> all paths, blocks and threads.
   subroutine look(self, model, nlane, t, q)
      class(constant_mass), intent(inout) :: self
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane
      real(wp), intent(in) :: t, q(nlane, size(self%inverse))
      real(wp) :: x(1, size(self%inverse))
      integer :: lane

      ! If masses differ from path to path, no numbers are kept: the model is called for every velocity.
      self%known = model%traits%by_path
      if (self%known) return
      ! Use the first lane at a finite position: iterates of other lanes may be anywhere.
      do lane = 1, nlane
         if (all(abs(q(lane, :)) <= huge(t))) exit
      end do
      if (lane > nlane) return  ! no path has a finite position: test again later
      ! The result is final, since it is the same for all paths.
      self%known = .true.
      x(1, :) = q(lane, :)
      call find_diagonal_mass(model, t, x, self%inverse, self%diagonal)
      ! A mass that is not diagonal continues to cost a gradient for each velocity.
      if (self%diagonal) self%asked = 0
   end subroutine look

   !> dq = h M^-1 p (nlane, ndof), with h = w(:, 0), or the velocity itself, with `unit` passed as w. Noise is in
   !> position, so its weights do not affect H_p and are passed on unchanged. The position q is that of the path, though
   !> velocities do not depend on it.
   subroutine drift(self, model, nlane, t, w, q, p, dq)
      class(constant_mass), intent(inout) :: self
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane
      real(wp), intent(in) :: t, w(nlane, 0:model%traits%nnoise)
      real(wp), intent(in) :: q(nlane, size(self%inverse)), p(nlane, size(self%inverse))
      real(wp), intent(out) :: dq(nlane, size(self%inverse))
      integer :: i

      ! The first drift tests the mass; callers need not call `look`.
      if (.not. self%known) call self%look(model, nlane, t, q)
      if (.not. self%diagonal) then
         call model%gradient(nlane, size(self%inverse), model%traits%nnoise, t, w, q, p, hp=dq)
         return
      end if
      do i = 1, size(self%inverse)
         ! Multiply the step by the number first: h/m_i is the factor of every momentum in a drift.
         dq(:, i) = (w(:, 0)*self%inverse(i))*p(:, i)
      end do
   end subroutine drift

   !> total = start + M^-1 p (nlane, ndof), in one pass if M is diagonal. Stages compute their positions by this, with
   !> sums of forces instead of p.
   subroutine add(self, model, nlane, t, q, p, start, total)
      class(constant_mass), intent(inout) :: self
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane
      real(wp), intent(in) :: t, q(nlane, size(self%inverse)), p(nlane, size(self%inverse))
      real(wp), intent(in) :: start(nlane, size(self%inverse))
      real(wp), intent(out) :: total(nlane, size(self%inverse))
      integer :: i

      ! One call of the model and one sum if M is not diagonal; otherwise one pass.
      if (.not. self%diagonal) then
         if (.not. allocated(self%hp)) allocate (self%hp, mold=start)
         call self%drift(model, nlane, t, self%unit, q, p, self%hp)
         call add_vectors(size(start), self%hp, start, total)
      else
         do i = 1, size(self%inverse)
            total(:, i) = start(:, i) + self%inverse(i)*p(:, i)
         end do
      end if
   end subroutine add

end module symsde_step_hamiltonian_mass
