! SPDX-License-Identifier: BSD-3-Clause
!> Schemes for one kind of noise alone, additive or depending on position: a tableau, the frame around its step, and the
!> conditions on the model (docs/method/beyond-order-one.md).
!>
!>    verlet_dz                 position Verlet with dZ: strong 2, explicit, symplectic
!>    averaged_shift_midpoint   midpoint around the mean of the path with dZ: strong 3/2, symplectic
!>    drift_preserving          averaged forces: E H grows exactly as it must for every h; not symplectic
!>    exact_rotation            Verlet around the exact flow of a declared linear part: symplectic, explicit
module symsde_scheme_additive
   use symsde_base_functionals, only: functionals, path_dz
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type
   use symsde_scheme_kicks, only: new_kicks, flow_rotation
   use symsde_scheme_orders, only: order_type, set_order, evidence_claimed, additive_noise, commutative_noise, &
                                   weak_order
   use symsde_scheme_quadrature, only: get_quadrature
   use symsde_scheme_scheme, only: scheme_type, model_needs, frame_shift, frame_mean_path, frame_rotation
   use symsde_scheme_tableau, only: scheme_from_tableau
   implicit none
   private
   public :: additive_scheme

contains

   !> Get one of these four schemes by name.
   subroutine additive_scheme(scheme, name, error)
      type(scheme_type), intent(out) :: scheme
      character(*), intent(in) :: name
      type(error_type), allocatable, intent(inout) :: error
      real(wp), parameter :: half(1, 1) = 0.5_wp, one(1) = 1, halves(2) = 0.5_wp, middle(2) = 0.5_wp
      real(wp), parameter :: a(2, 2) = reshape([0.5_wp, 0.5_wp, 0.0_wp, 0.0_wp], [2, 2])
      real(wp), parameter :: abar(2, 2) = reshape([0.0_wp, 0.5_wp, 0.0_wp, 0.5_wp], [2, 2])
      real(wp), parameter :: ends(2) = [0.0_wp, 1.0_wp]
      ! Both have weights 1/2: a is Lobatto IIIB of two stages and abar is IIIA. (a, abar) is position Verlet
      ! (drift-kick-drift), (abar, a) is velocity Verlet (kick-drift-kick).
      character(*), parameter :: plain = 'gauss2_strong32 for strong order 3/2, or midpoint'

      select case (name)
      case ('verlet_dz')
         call scheme_from_tableau(scheme, a, abar, halves, name, .false., error, c=middle)
         ! With dp = .. + gamma dW the frame adds gamma (dZ - h dW/2) to q after the step; this raises the order
         ! from 1.
         call claim(scheme, 2.0_wp, 2.0_wp)
         scheme%frame = frame_shift
         scheme%symmetric = .false.  ! the shift by dZ comes last
         scheme%needs = model_needs(additive=.true., position_noise=.true., identity_mass=.true., instead=plain)
         scheme%asks = functionals([path_dz])
         scheme%reference = 'position Verlet with dZ; Milstein, Repin, Tretyakov 2002 (additive noise)'
      case ('averaged_shift_midpoint')
         call scheme_from_tableau(scheme, half, half, one, name, .false., error)
         call claim(scheme, 1.5_wp, 1.5_wp)
         ! The step is a midpoint rule of z = x - B (W - W_n), B = J grad H_k constant, under a Hamiltonian that has B
         ! dZ/h, the mean of the path over the step, and (h/12) sum_k B_k^T H'' B_k, from the variance h/6 of the path
         ! around that mean.
         scheme%frame = frame_mean_path
         scheme%needs = model_needs(additive=.true., instead=plain)
         scheme%asks = functionals([path_dz])
         scheme%reference = 'midpoint of x - B (W - W_n) under a modified Hamiltonian; docs/method/beyond-order-one.md'
      case ('exact_rotation')
         ! with frequencies zero the rotation is a drift at constant p: the tableau of Verlet
         call scheme_from_tableau(scheme, abar, a, halves, name, .false., error, c=ends)
         call claim(scheme, 1.0_wp, 1.0_wp)
         scheme%frame = frame_rotation
         ! The noise is one kick at the start, beta = (1, 0); half of the nonlinear force acts at either end of the
         ! step.
         call new_kicks(scheme%kicks, ends, halves, flow=flow_rotation)
         scheme%kicks%beta = [1, 0]
         scheme%symmetric = .false.  ! the noise comes first
         scheme%needs = model_needs(position_noise=.true., identity_mass=.true., rotation=.true., &
                                    instead='stormer_verlet, or midpoint where it is stiff')
         scheme%remark = 'where U is that part and the noise additive, E H is exact for every h'
         call set_order(scheme%order(commutative_noise), 1.0_wp, evidence_claimed)  ! noises in position commute
         scheme%reference = 'trigonometric; Cohen 2012'
      case default
         call averaged_forces(scheme, name, error)
         call claim(scheme, 1.0_wp, 1.0_wp)
         scheme%needs = model_needs(additive=.true., position_noise=.true., identity_mass=.true., instead=plain)
         scheme%remark = 'E H is exact for polynomials U up to degree eight'
         scheme%reference = 'Chen, Cohen, D''Ambrosio, Lang 2020; not symplectic'
      end select
   end subroutine additive_scheme

   !> Orders hold for the kind of noise that the scheme is made for; with other noise the scheme is refused.
   pure subroutine claim(scheme, strong, weak)
      type(scheme_type), intent(inout) :: scheme
      real(wp), intent(in) :: strong, weak

      scheme%structure = evidence_claimed  ! structure of the tableau alone; the stepper adds the frame
      scheme%order = order_type()
      call set_order(scheme%order(additive_noise), strong, evidence_claimed)
      call set_order(scheme%order(weak_order), weak, evidence_claimed)
      scheme%sharp = .false.
   end subroutine claim

   !> Psi = p_n + g - (h/2) sum_j w_j V'(q_n + c_j h Psi), q_{n+1} = q_n + h Psi, p_{n+1} = p_n + g - h sum_j
   !> w_j V', with the kick g of the noise, as a tableau: a_ij = c_i w_j, abar_ij = w_j/2, bbar_ij = w_j.
   !> Gauss' four nodes make the mean of V' exact for polynomials V up to degree eight.
   subroutine averaged_forces(scheme, name, error)
      type(scheme_type), intent(out) :: scheme
      character(*), intent(in) :: name
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable :: nodes(:), weights(:), a(:, :), abar(:, :), bbar(:, :)
      integer :: i, n

      call get_quadrature('gauss4', nodes, weights, error)
      if (allocated(error)) return
      n = size(nodes)
      allocate (a(n, n), abar(n, n), bbar(n, n))
      do i = 1, n
         ! a_ij = c_i w_j has equal columns up to w: all stages lie on the straight line q_n + c_i h Psi.
         a(i, :) = nodes(i)*weights
         abar(i, :) = 0.5_wp*weights
         bbar(i, :) = weights
      end do
      call scheme_from_tableau(scheme, a, abar, weights, name, .true., error, b=a, bbar=bbar, c=nodes)
   end subroutine averaged_forces

end module symsde_scheme_additive
