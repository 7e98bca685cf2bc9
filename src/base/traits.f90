! SPDX-License-Identifier: BSD-3-Clause
!> The declarations of a model about its Hamiltonians, by which a step may skip work. They are in base, because models
!> set them and the factory of steppers reads them.
module symsde_base_traits
   use symsde_base_bonds, only: bond_list, find_bonds, find_bond_supports
   use symsde_base_kinds, only: wp, i8
   use symsde_base_supports, only: noise_supports, noise_pairs, find_pairs
   implicit none
   private
   public :: model_traits, force_traits, dense, strip_lanes

   integer, parameter :: dense = -1  !! bandwidth of a Hessian without declared bands

   !> Lanes that are processed along a chain together, row after row. The number is a constant, so that values carried
   !> from row to row stay in registers: two AVX-512 vectors, one of which divides while the other waits.
   integer, parameter :: strip_lanes = 16

   !> Which forces act beside the Hamiltonians (model/forces). By default none does.
   type :: force_traits
      logical :: drift = .false.                !! F acts
      logical :: noise = .false.                !! some f_k does
      logical :: drift_in_position = .true.     !! F depends on (q, t) alone
      logical :: noise_in_position = .true.     !! every f_k does
      logical :: has_derivative = .false.       !! derivatives by q and p are analytic
      integer :: bandwidth = dense              !! b: no component i depends on q_j or p_j with |i-j| > b
   contains
      procedure :: act
      procedure :: in_position
   end type force_traits

   !> The traits speak of Hamiltonians alone, but for `forces`.
   !> H_0 = H is the drift Hamiltonian, H_1 .. H_m are the Hamiltonians of the noises.
   type :: model_traits
      integer :: ndof = 1                  !! degrees of freedom: q and p have ndof components each
      integer :: nnoise = 0                !! m, the number of noises
      logical :: separable = .false.       !! every H_j(q,p) = T_j(p) + U_j(q)
      logical :: additive = .false.        !! every H_k, k >= 1, is linear in (q,p)
      logical :: position_noise = .false.  !! every H_k, k >= 1, depends on q alone
      logical :: quadratic = .false.       !! every H_j is a polynomial of degree two at most
      logical :: identity_mass = .false.   !! H = p.p/2 + U(q)
      logical :: constant_mass = .false.   !! H = p.M^-1 p/2 + U(q), M constant; identity_mass is stronger
      logical, allocatable :: silent(:)    !! noises whose H_k vanishes: nothing is drawn for them (nnoise)
      logical :: diagonal_mass = .false.   !! the constant M is diagonal
      type(noise_supports) :: touches = noise_supports() !! degrees of freedom that each noise touches
      integer :: bandwidth = dense         !! b: every Hessian block vanishes for |i-j| > b
      logical :: has_value = .false.       !! the Hamiltonians themselves can be evaluated
      logical :: has_gradient = .true.     !! gradients can be evaluated, or flows of two parts are all that is given
      !> The exact flows of D and of sum_j w_j K_j are given, H = D + K_0, K_k = H_k, {K_i, K_j} = 0 for all i, j >= 0.
      logical :: has_parts = .false.
      logical :: has_hessian = .false.     !! Hessians are analytic, not differences of gradients
      logical :: has_hessian_vector = .false.  !! Hessian-vector products are analytic
      logical :: has_third_derivative = .false.  !! third derivatives are analytic (third_derivative)
      logical :: any_lanes = .false.       !! a lane has the same bits whatever the number of lanes
      logical :: autonomous = .false.      !! no H_j depends on time
      logical :: by_path = .false.         !! parameters go by path: nothing that is found for one lane holds for others
      integer(i8) :: npath = 0             !! paths that there are parameters for; 0 = any number
      real(wp) :: max_frequency = 0        !! declared bound of the frequencies of H; 0 = not declared
      real(wp) :: noise_lipschitz = 0      !! declared Lipschitz constant of sum_k |grad H_k|; 0 = not declared
      !> omega_i of the stiff linear part, H = p.p/2 + sum_i omega_i^2 q_i^2/2 + V(q) (ndof). A choice, not a claim: V
      !> is the remainder, so it is not probed. Not allocated = not declared.
      real(wp), allocatable :: rotation(:)
      !> S = (S_qq, S_qp; S_pq, S_pp) of a quadratic part D = z.S z/2 of H = D(q,p) + V(q), z = (q, p), whose flow is
      !> known exactly (2 ndof, 2 ndof). The probe tests H_p = S_pq q + S_pp p; S_qq is a choice, as V is the remainder.
      !> Kicks stand between flows of D then. Not allocated = not declared.
      real(wp), allocatable :: quadratic_part(:, :)
      !> H - D and every H_k are functions of the actions (q_i^2 + p_i^2)/2, in place of functions of q: kicks turn the
      !> planes (q_i, p_i) then.
      logical :: kicks_of_actions = .false.
      !> Noise of phases: every H_k is linear in the actions, sum_i s_i (q_i^2 + p_i^2)/2 with s_i numbers or functions
      !> of time.
      logical :: phase_noise = .false.
      !> Of a model whose further positions are parameters theta_k: dS/dtheta_k of the quadratic part, and derivatives
      !> of omega_i^2 of the stiff linear part, of the model without them (2 ndof, 2 ndof, k), (ndof, k).
      real(wp), allocatable :: quadratic_slopes(:, :, :), rotation_slopes(:, :)
      type(force_traits) :: forces = force_traits()
   contains
      procedure :: correction_vanishes
      procedure :: noise_is_constant
      procedure :: reach
      procedure :: has_constant_mass
      procedure :: has_diagonal_mass
      procedure :: are_apart
      procedure :: tied_supports
      procedure :: find_meetings
      procedure :: eliminates_momenta
      procedure :: divides_by_mass
      procedure :: one_solve
      procedure :: is_slow
      procedure :: splits
   end type model_traits

contains

   !> Whether no known frequency makes the step h long.
   pure logical function is_slow(self, h)
      class(model_traits), intent(in) :: self
      real(wp), intent(in) :: h

      is_slow = abs(h)*self%max_frequency <= 1
   end function is_slow

   !> Whether any force acts.
   pure logical function act(self)
      class(force_traits), intent(in) :: self

      act = self%drift .or. self%noise
   end function act

   !> Whether all forces depend on (q, t) alone.
   pure logical function in_position(self)
      class(force_traits), intent(in) :: self

      in_position = (self%drift_in_position .or. .not. self%drift) .and. (self%noise_in_position .or. .not. self%noise)
   end function in_position

   !> Whether velocities depend on p alone and forces on q alone.
   pure logical function splits(self)
      class(model_traits), intent(in) :: self

      splits = self%separable .and. self%forces%in_position()
   end function splits

   !> Whether H_{k,p} . H_{k,q} is constant for every noise, so that one-sided schemes need no correction. With forces
   !> f_k the products of derivatives vanish where no noise moves positions or depends on p.
   pure function correction_vanishes(self) result(vanishes)
      class(model_traits), intent(in) :: self
      logical :: vanishes

      vanishes = self%nnoise == 0 .or. self%additive .or. self%position_noise
      if (self%forces%noise) vanishes = self%position_noise .and. self%forces%noise_in_position
   end function correction_vanishes

   !> Whether the field of every noise is known to be constant, so that products of its derivatives vanish: H_k is
   !> linear, and no force goes with a noise.
   pure logical function noise_is_constant(self)
      class(model_traits), intent(in) :: self

      noise_is_constant = self%additive .and. .not. self%forces%noise
   end function noise_is_constant

   !> Bandwidth of the derivative of the whole field, with its forces.
   pure integer function reach(self)
      class(model_traits), intent(in) :: self

      reach = self%bandwidth
      if (.not. self%forces%act()) return
      reach = merge(dense, max(reach, self%forces%bandwidth), min(reach, self%forces%bandwidth) < 0)
   end function reach

   !> Whether H = p.M^-1 p/2 + U(q) with a constant M is declared, by constant_mass or identity_mass.
   pure logical function has_constant_mass(self)
      class(model_traits), intent(in) :: self

      has_constant_mass = self%identity_mass .or. self%constant_mass
   end function has_constant_mass

   !> Whether H = sum_i p_i^2/(2 m_i) + U(q) is declared.
   pure logical function has_diagonal_mass(self)
      class(model_traits), intent(in) :: self

      has_diagonal_mass = self%identity_mass .or. (self%constant_mass .and. self%diagonal_mass)
   end function has_diagonal_mass

   !> What noises in position touch, or not given where the mass may tie every degree of freedom to every other one.
   pure type(noise_supports) function tied_supports(self)
      class(model_traits), intent(in) :: self

      logical :: apart

      apart = self%has_diagonal_mass()
      if (allocated(self%quadratic_part)) apart = diagonal_velocity(self%ndof, self%quadratic_part)
      if (apart .and. .not. self%forces%noise) tied_supports = self%touches
   end function tied_supports

   !> Whether D_pp is diagonal.
   pure logical function diagonal_velocity(ndof, s)
      integer, intent(in) :: ndof
      real(wp), intent(in) :: s(2*ndof, 2*ndof)
      integer :: i, j

      diagonal_velocity = .true.
      do j = 1, ndof
         do i = 1, ndof
            if (i /= j .and. abs(s(ndof + i, ndof + j)) > 0) diagonal_velocity = .false.
         end do
      end do
   end function diagonal_velocity

   !> The pairs of noises k <= l for which {H_k, {H_l, H}} may not vanish: in position H_k,q . M^-1 H_l,q, of phases
   !> where both touch a bond of the quadratic part. Not allocated = all.
   pure subroutine find_meetings(self, pairs)
      class(model_traits), intent(in) :: self
      type(noise_pairs), intent(out) :: pairs
      type(bond_list) :: bonds
      type(noise_supports) :: at_bonds

      if (.not. (self%kicks_of_actions .and. allocated(self%quadratic_part))) then
         call find_pairs(self%tied_supports(), self%nnoise, self%ndof, pairs)
         return
      end if
      call find_bonds(self%ndof, self%quadratic_part, bonds)
      call find_bond_supports(self%touches, self%nnoise, self%ndof, bonds, at_bonds)
      call find_pairs(at_bonds, self%nnoise, bonds%n, pairs)
   end subroutine find_meetings

   !> Whether no degree of freedom is touched by two noises that are not silent.
   pure logical function are_apart(self)
      class(model_traits), intent(in) :: self
      logical, allocatable :: touched(:)
      integer :: k

      are_apart = self%touches%are_given() .and. .not. self%forces%noise
      if (.not. are_apart) return
      allocate (touched(self%ndof), source=.false.)
      do k = 1, self%nnoise
         if (allocated(self%silent)) then
            if (self%silent(k)) cycle
         end if
         associate (dof => self%touches%dof(self%touches%from(k) + 1:self%touches%from(k + 1)))
            if (any(touched(dof))) are_apart = .false.
            touched(dof) = .true.
         end associate
      end do
   end function are_apart

   !> Whether H = p.p/2 + U(q) with noise in position or additive: momenta can be eliminated from implicit equations,
   !> whose matrices are symmetric then. Forces are not among them.
   pure logical function eliminates_momenta(self)
      class(model_traits), intent(in) :: self

      eliminates_momenta = self%identity_mass .and. self%correction_vanishes() .and. .not. self%forces%act()
   end function eliminates_momenta

   !> Whether Hhat_p = h M^-1 p with a constant M that is not declared the identity: no noise acts on positions.
   pure logical function divides_by_mass(self)
      class(model_traits), intent(in) :: self

      divides_by_mass = self%constant_mass .and. .not. self%identity_mass .and. &
                        (self%position_noise .or. self%nnoise == 0)
   end function divides_by_mass

   !> Whether one linear solve finds the root of a step: quadratic Hamiltonians with exact Hessians. Differences leave
   !> errors of 1e-11 in a Hessian, which a second iteration removes.
   pure function one_solve(self, banded)
      class(model_traits), intent(in) :: self
      logical, intent(in) :: banded  !! the Hessian is computed by its bands
      logical :: one_solve

      one_solve = self%quadratic .and. .not. self%forces%act() .and. &
                  (self%has_hessian_vector .or. (self%has_hessian .and. .not. banded))
   end function one_solve

end module symsde_base_traits
