! SPDX-License-Identifier: BSD-3-Clause
!> Schemes as maps that models know (base/maps). The Euler pair, Verlet and midpoint are identified by their
!> coefficients, since users can make them in many ways: from a quadrature, as a tableau, or under another name. Other
!> schemes are identified by the name of the catalogue, and the caller compares their coefficients (is_of_catalogue).
!>
!> Private to its family, except map_of.
module symsde_step_flow_scheme_map
   use symsde_base_kinds, only: wp
   use symsde_base_maps, only: step_map, other_map, euler_map, euler_adjoint_map, verlet_map, verlet_swapped_map, &
                               midpoint_map, gauss2_map, gauss3_map, gauss4_map, lobatto3_map, lobatto3_swapped_map, &
                               lobatto4_map, lobatto4_swapped_map, gauss2_brackets_map, drift_kick_drift_map, &
                               kick_drift_kick_map, two_kicks_map, two_kicks_rotation_map, force_gradient_map
   use symsde_base_status, only: error_type
   use symsde_scheme_catalogue, only: get_scheme
   use symsde_scheme_scheme, only: scheme_type, tableau_form, frame_none
   implicit none
   private
   public :: map_of, named_map, known_map, is_of_catalogue

contains

   !> The map of a scheme.
   subroutine map_of(scheme, map)
      type(scheme_type), intent(in) :: scheme
      type(step_map), intent(out) :: map

      map = known_map(scheme, scheme%brackets%are_added())
      if (map%equation == other_map) map = named_map(scheme%name)
   end subroutine map_of

   !> The map of one of the four: the Euler pair, Verlet, midpoint. No equation for other schemes, nor if brackets are
   !> added to the Hamiltonian or a frame surrounds the tableau.
   pure type(step_map) function known_map(scheme, has_brackets) result(map)
      type(scheme_type), intent(in) :: scheme
      logical, intent(in) :: has_brackets

      map = step_map()
      if (scheme%form /= tableau_form .or. scheme%frame /= frame_none .or. has_brackets) return
      if (scheme%is_midpoint()) then
         map = named_map('midpoint')
      else if (scheme%is_euler_pair()) then
         if (scheme%a(1, 1) > 0.5_wp) map = named_map('symplectic_euler_adjoint')
         if (.not. scheme%a(1, 1) > 0.5_wp) map = named_map('symplectic_euler')
      else if (is_verlet(scheme)) then
         map = named_map('stormer_verlet')
      end if
   end function known_map

   !> The map of a scheme of the catalogue. Schemes that differ in brackets, or in squares of gradients of the H_k, have
   !> the same map: it applies to models where these vanish.
   pure type(step_map) function named_map(name) result(map)
      character(*), intent(in) :: name

      map%label = name
      select case (name)
      case ('symplectic_euler'); map%equation = euler_map
      case ('symplectic_euler_adjoint'); map%equation = euler_adjoint_map
      case ('stormer_verlet'); map%equation = verlet_map
      case ('lobatto2_swapped'); map%equation = verlet_swapped_map
      case ('midpoint'); map%equation = midpoint_map
      case ('gauss2'); map%equation = gauss2_map
      case ('gauss3'); map%equation = gauss3_map
      case ('gauss4'); map%equation = gauss4_map
      case ('lobatto3'); map%equation = lobatto3_map
      case ('lobatto3_swapped'); map%equation = lobatto3_swapped_map
      case ('lobatto4'); map%equation = lobatto4_map
      case ('lobatto4_swapped'); map%equation = lobatto4_swapped_map
      case ('gauss2_strong32', 'gauss2_strong32_areas', 'gauss2_weak2', 'gauss2_weak2_areas')
         map%equation = gauss2_brackets_map
      case ('verlet_dkd_weak2'); map%equation = drift_kick_drift_map
      case ('verlet_kdk', 'verlet_kdk_strong2'); map%equation = kick_drift_kick_map
      case ('gauss_dkdkd', 'gauss_dkdkd_strong2')
         map%equation = two_kicks_map
         map%products = name /= 'gauss_dkdkd'
      case ('gauss_dkdkd_rotation'); map%equation = two_kicks_rotation_map
      case ('chin4a', 'chin4a_strong2'); map%equation = force_gradient_map
      case default; map%equation = other_map
      end select
   end function named_map

   !> Whether a scheme is the catalogue's scheme of this name, since users may give any name. Coefficients must be equal
   !> in every bit, nodes c up to rounding, because users' nodes are sums of a.
   logical function is_of_catalogue(scheme, name)
      type(scheme_type), intent(in) :: scheme
      character(*), intent(in) :: name
      type(scheme_type) :: known
      type(error_type), allocatable :: error

      is_of_catalogue = .false.
      call get_scheme(known, name, error)
      if (allocated(error)) return
      if (known%form /= scheme%form .or. known%frame /= scheme%frame .or. known%nstage /= scheme%nstage) return
      if (known%law /= scheme%law) return
      associate (a => known%brackets, b => scheme%brackets)
         if (any([a%single, a%areas, a%nested, a%crossed] .neqv. [b%single, b%areas, b%nested, b%crossed])) return
      end associate
      is_of_catalogue = .true.
      if (.not. known%has_tableau()) return
      is_of_catalogue = all(abs(known%a - scheme%a) <= 0) .and. all(abs(known%abar - scheme%abar) <= 0) .and. &
                        all(abs(known%b - scheme%b) <= 0) .and. all(abs(known%bbar - scheme%bbar) <= 0) .and. &
                        all(abs(known%alpha - scheme%alpha) <= 0) .and. all(abs(known%beta - scheme%beta) <= 0) .and. &
                        all(abs(known%c - scheme%c) <= 8*epsilon(1.0_wp))  ! users' nodes are sums of a
   end function is_of_catalogue

   !> Whether the scheme is half a kick, a drift, and half a kick: a = (0, 0; 1/2, 1/2), abar = (1/2, 0; 1/2, 0),
   !> alpha = (1/2, 1/2), c = (0, 1), the tableau of Lobatto IIIA-IIIB of two stages (Stormer-Verlet).
   pure logical function is_verlet(scheme)
      type(scheme_type), intent(in) :: scheme
      real(wp), parameter :: a(2, 2) = reshape([0.0_wp, 0.5_wp, 0.0_wp, 0.5_wp], [2, 2])

      is_verlet = .false.
      if (scheme%nstage /= 2 .or. .not. scheme%noise_coefficients_equal()) return
      is_verlet = all(abs(scheme%a - a) <= 0) .and. all(abs(scheme%abar(:, 1) - 0.5_wp) <= 0) .and. &
                  all(abs(scheme%abar(:, 2)) <= 0) .and. all(abs(scheme%alpha - 0.5_wp) <= 0) .and. &
                  all(abs(scheme%c - [0, 1]) <= 0)
   end function is_verlet

end module symsde_step_flow_scheme_map
