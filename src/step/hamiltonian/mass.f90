! SPDX-License-Identifier: BSD-3-Clause
!> The velocity of a constant mass that is not the identity,
!>
!>    H = p.M^-1 p/2 + U(q),   noise in position:      Hhat_p = h M^-1 p,   dq = h M^-1 p
!>
!> Where M is diagonal its numbers are found once, from the model: what a user's function computes beside them, the
!> force, is not computed again for every velocity. Otherwise the model is asked, by H_p with the weight of H alone.
!> The model declares that the mass is constant, but not that it is diagonal: model/diagonal_mass finds that out.
module symsde_step_hamiltonian_mass
   use symsde_base_kinds, only: wp
   use symsde_base_vectors, only: add_vectors => add
   use symsde_model_abstract, only: model_type
   use symsde_model_diagonal_mass, only: find_diagonal_mass
   implicit none
   private
   public :: constant_mass, new_constant_mass

   !> Knowledge of M, and room for a call of the model. The first finite position settles whether M is diagonal.
   !> `asked` is the cost of a velocity: one gradient, or none once M is known to be diagonal.
   type :: constant_mass
      logical :: diagonal = .false.
      integer :: asked = 0                                !! gradients that a velocity costs
      real(wp), allocatable :: inverse(:)                 !! the diagonal of M^-1 (ndof)
      logical :: known = .false.                          !! it was looked at; asked before `look`, which makes arrays
      real(wp), allocatable :: unit(:, :)                 !! the weight of H alone (nlane, 0:nnoise)
      real(wp), allocatable, private :: hp(:, :)          !! H_p (nlane, ndof)
   contains
      procedure :: look
      procedure :: drift
      procedure :: add
   end type constant_mass

contains

   !> Make room for blocks of nlane lanes. The model is not called yet: it must answer where a path is, and no path
   !> is known here.
   subroutine new_constant_mass(self, nlane, ndof, nnoise)
      type(constant_mass), intent(out) :: self
      integer, intent(in) :: nlane, ndof, nnoise

      allocate (self%inverse(ndof), source=0.0_wp)
      allocate (self%unit(nlane, 0:nnoise), source=0.0_wp)
      self%unit(:, 0) = 1
      self%asked = 1
   end subroutine new_constant_mass

   !> Look whether M is diagonal, at a place where some path is. The place itself does not matter: the numbers are the
   !> same for all paths, blocks and threads.
   subroutine look(self, model, nlane, t, q)
      class(constant_mass), intent(inout) :: self
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane
      real(wp), intent(in) :: t, q(nlane, size(self%inverse))
      real(wp) :: x(1, size(self%inverse))
      integer :: lane

      ! The first lane at a finite position is asked for: iterates of others may be anywhere.
      do lane = 1, nlane
         if (all(abs(q(lane, :)) <= huge(t))) exit
      end do
      if (lane > nlane) return  ! no path has a finite place: look again next time
      ! Whatever comes out is not asked for again: the answer is the same for all paths.
      self%known = .true.
      x(1, :) = q(lane, :)
      call find_diagonal_mass(model, t, x, self%inverse, self%diagonal)
      ! A mass that is not diagonal goes on costing a gradient for each velocity.
      if (self%diagonal) self%asked = 0
   end subroutine look

   !> dq = h M^-1 p (nlane, ndof), with h = w(:, 0), or the velocity itself, with `unit` in the place of w. Noise is in
   !> position, so its weights do not matter to H_p: they are handed to the model as they are. The position q is where
   !> the path is, though velocities do not depend on it.
   subroutine drift(self, model, nlane, t, w, q, p, dq)
      class(constant_mass), intent(inout) :: self
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane
      real(wp), intent(in) :: t, w(nlane, 0:model%traits%nnoise)
      real(wp), intent(in) :: q(nlane, size(self%inverse)), p(nlane, size(self%inverse))
      real(wp), intent(out) :: dq(nlane, size(self%inverse))
      integer :: i

      ! The first drift finds out; no caller need have looked before.
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

   !> total = start + M^-1 p (nlane, ndof), in one pass where M is diagonal. Stages move their positions by this, with
   !> sums of forces in the place of p.
   subroutine add(self, model, nlane, t, q, p, start, total)
      class(constant_mass), intent(inout) :: self
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane
      real(wp), intent(in) :: t, q(nlane, size(self%inverse)), p(nlane, size(self%inverse))
      real(wp), intent(in) :: start(nlane, size(self%inverse))
      real(wp), intent(out) :: total(nlane, size(self%inverse))
      integer :: i

      ! One call of the model and one sum where M is not diagonal; else one pass.
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
