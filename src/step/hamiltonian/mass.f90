! SPDX-License-Identifier: BSD-3-Clause
!> The velocity of a constant mass that is not the identity,
!>
!>    H = p.M^-1 p/2 + U(q),   noise in position:      Hhat_p = h M^-1 p,   dq = h M^-1 p
!>
!> Where M is diagonal its numbers are found once, from the model: what a user's function computes beside them, the
!> force, is not computed again for every velocity. Otherwise the model is asked, by H_p with the weight of H alone.
!> The model declares that the mass is constant, but not that it is diagonal: this is found by trying eight momenta.
module symsde_step_hamiltonian_mass
   use symsde_base_kinds, only: wp
   use symsde_base_vectors, only: add_vectors => add
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: constant_mass, new_constant_mass

   integer, parameter :: nmomentum = 8  !! momenta at which velocities are compared

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

   !> Look whether every velocity is a number times its momentum, at a place where some path is. That is so where
   !> numbers found for one momentum are those of seven others, to rounding. The place itself does not matter: the
   !> numbers are the same for all paths, blocks and threads. One momentum after the other: a view of the real lanes of
   !> a block (model/views/real_lanes) does not look at more than there are paths.
   subroutine look(self, model, nlane, t, q)
      class(constant_mass), intent(inout) :: self
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane
      real(wp), intent(in) :: t, q(nlane, size(self%inverse))
      real(wp), dimension(1, size(self%inverse)) :: x, p, v
      integer :: i, j, lane

      ! The first lane at a finite position is asked for: iterates of others may be anywhere.
      do lane = 1, nlane
         if (all(abs(q(lane, :)) <= huge(t))) exit
      end do
      if (lane > nlane) return  ! no path has a finite place: look again next time
      ! Whatever comes out is not asked for again: the answer is the same for all paths.
      self%known = .true.
      self%diagonal = .true.
      x(1, :) = q(lane, :)
      p = 1  ! at unit momenta the velocities are the numbers 1/m_i, if M is diagonal
      do j = 1, nmomentum
         ! The first momentum is e = (1, .., 1), for which v_i is the i-th number if M is diagonal. Then p_i is
         ! different from row to row, and M is diagonal if v_i is p_i times that number to 4 eps, seven times.
         call model%gradient(1, size(self%inverse), model%traits%nnoise, t, self%unit(1, :), x, p, hp=v)
         if (j == 1) self%inverse = v(1, :)
         do i = 1, size(self%inverse)
            self%diagonal = self%diagonal .and. abs(self%inverse(i)) <= huge(t) .and. &
                            abs(v(1, i) - self%inverse(i)*p(1, i)) <= 4*epsilon(t)*abs(v(1, i))
            p(1, i) = 1.5_wp + sin(1.7_wp*i*(j + 1) + (j + 1))  ! different for all masses
         end do
      end do
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
