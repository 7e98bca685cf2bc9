! SPDX-License-Identifier: BSD-3-Clause
!>    L_h(q_n,q_{n+1}) = ext sum_i alpha_i [P_i . q_d'(c_i) - h H(P_i,q_d(c_i))] - sum_i beta_i sum_k dW_k H_k
!>
!> The catalogue of schemes by name. Schemes from a quadrature (c_i, alpha_i) and a degree s of q_d are built by this
!> discrete Lagrangian (scheme/discrete_lagrangian), so their coefficients are not written down:
!>
!>    midpoint, gauss2, gauss3, gauss4         s nodes of Gauss
!>    symplectic_euler and its adjoint         s = 1, the left and the right rectangle
!>    stormer_verlet = lobatto2, lobatto3, ..  s nodes of Lobatto: IIIA for q, IIIB for p; `swapped` the other way
!>    PsNrQu                                   degree s, r >= s nodes, quadrature of order u
!>    lambda:x                                 s = 1, one node x
!>
!> Other schemes are tableaux (heun, dirk:c), kicks and drifts (scheme/splitting, scheme/words), a tableau with a
!> modified Hamiltonian (scheme/expansion) or with a step around it (scheme/additive), and Euler-Maruyama.
module symsde_scheme_catalogue
   use symsde_base_contracts, only: contracts_are_executed
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, unknown_name, invalid_argument
   use symsde_base_text, only: name_length, nearest_name
   use symsde_scheme_additive, only: additive_scheme
   use symsde_scheme_contract, only: require_scheme
   use symsde_scheme_expansion, only: expand_scheme
   use symsde_scheme_measured, only: add_measurements
   use symsde_scheme_orders, only: set_order, evidence_claimed, additive_noise, commutative_noise, commuting_flows, &
                                   weak_order
   use symsde_scheme_scheme, only: scheme_type, ito_form
   use symsde_scheme_quadrature, only: get_quadrature
   use symsde_scheme_splitting, only: splitting_scheme
   use symsde_scheme_discrete_lagrangian, only: scheme_from_quadrature
   use symsde_scheme_tableau, only: scheme_from_tableau
   use symsde_scheme_words, only: word_scheme
   implicit none
   private
   public :: get_scheme, scheme_names, scheme_families

   ! The names that get_scheme knows, and compares unknown names with. A family with a parameter ends in a colon.
   integer, parameter :: nplain = 44  !! names without a parameter; the families follow
   character(len=name_length), parameter :: all_names(nplain + 3) = [character(len=name_length) :: & !&
      'midpoint', 'symplectic_euler', 'symplectic_euler_adjoint', 'stormer_verlet', & !&
      'gauss2', 'gauss3', 'gauss4', 'lobatto2', 'lobatto2_swapped', 'lobatto3', & !&
      'lobatto3_swapped', 'lobatto4', 'lobatto4_swapped', 'P1N2Q2Lob', 'P1N2Q2Otr', 'P1N2Q4Gau', & !&
      'P1N3Q4Lob', 'P2N2Q2Lob', 'P2N2Q2Otr', 'P2N3Q4Lob', 'P2N3Q6Gau', 'P2N4Q6Lob', & !&
      'gauss2_strong32', 'gauss2_strong32_areas', 'gauss2_weak2', 'gauss2_weak2_areas', & !&
      'midpoint_areas', 'midpoint_weak1', 'verlet_dz', 'averaged_shift_midpoint', 'drift_preserving', & !&
      'exact_rotation', & !&
      'gauss_dkdkd', 'verlet_kdk', 'chin4a', 'gauss_dkdkd_strong2', 'verlet_kdk_strong2', 'chin4a_strong2', & !&
      'gauss_dkdkd_rotation', 'gauss_dkdkd_midpoint', 'verlet_kdk_midpoint', 'verlet_dkd_weak2', & !&
      'heun', 'euler_maruyama', 'dirk:', 'lambda:', 'word:'] !&

contains

   !> Names that get_scheme knows without a parameter.
   pure function scheme_names() result(names)
      character(len=name_length) :: names(nplain)

      names = all_names(:nplain)
   end function scheme_names

   !> Names that take a parameter after the colon: dirk:c with 0 < c < 1 is a midpoint step of
   !> length c h followed by one of length (1-c) h; lambda:x with 0 <= x <= 1 is the one-sided
   !> family; word:BAOAB is a splitting written in letters (scheme/words).
   pure function scheme_families() result(names)
      character(len=name_length) :: names(size(all_names) - nplain)

      names = all_names(nplain + 1:)
   end function scheme_families

   !> The scheme of a name: one of scheme_names(), a family with its parameter ('dirk:0.25',
   !> 'lambda:0.3', 'word:BAOAB'), or PsNrQu with Gau, Lob or Otr: degree s, r nodes, quadrature of order u
   !> (Gauss, Lobatto, open trapezoid; Holm and Tyranowski 2018).
   !> Errors: unknown_name, with the nearest name; invalid_argument for a parameter that is not
   !> allowed.
   subroutine get_scheme(scheme, name, error)
      type(scheme_type), intent(out) :: scheme
      character(*), intent(in) :: name
      type(error_type), allocatable, intent(inout) :: error
      logical :: known

      if (allocated(error)) return
      select case (name)
      case ('midpoint')
         call from_rule(scheme, name, 'gauss1', 1, '[WHSB] (71)-(72); Milstein, Repin, Tretyakov 2002', &
                        error)
      case ('symplectic_euler')
         call from_rule(scheme, name, 'rectangle_left', 1, '[WHSB] (89)-(90)', error)
      case ('symplectic_euler_adjoint')
         call from_rule(scheme, name, 'rectangle_right', 1, '[WHSB] (91)-(92)', error)
      case ('gauss2', 'gauss3', 'gauss4')
         call from_rule(scheme, name, name, degree_of(name), 'Gauss; Ma, Ding, Ding 2012', error)
      case ('stormer_verlet')
         call from_rule(scheme, name, 'lobatto2', 2, &
                        'Lobatto IIIA-IIIB 2; Ma, Ding 2015; Holm, Tyranowski 2018', error)
      case ('lobatto2', 'lobatto3', 'lobatto4')
         call from_rule(scheme, name, name, degree_of(name), &
                        'Lobatto IIIA-IIIB; Ma, Ding 2015', error)
      case ('lobatto2_swapped', 'lobatto3_swapped', 'lobatto4_swapped')
         call from_rule(scheme, name, name(:8), degree_of(name), &
                        'Lobatto IIIB-IIIA; Ma, Ding 2015', error)
         call swap(scheme)
      case ('heun', 'euler_maruyama')
         call contrast(scheme, name, error)
      case ('gauss2_strong32', 'gauss2_strong32_areas', 'gauss2_weak2', 'gauss2_weak2_areas', 'midpoint_areas', &
            'midpoint_weak1')
         call expanded(scheme, name, error)
      case ('verlet_dz', 'averaged_shift_midpoint', 'drift_preserving', 'exact_rotation')
         call additive_scheme(scheme, name, error)
      case default
         ! Try names of kicks first and names with a parameter last: the latter give the message of unknown names.
         call splitting_scheme(scheme, name, known, error)
         if (.not. known) call word_scheme(scheme, name, known, error)
         if (.not. known) call parametrised(scheme, name, error)
      end select
      if (allocated(error)) return
      call add_measurements(scheme%order, scheme%damped_order, name)
      if (contracts_are_executed) call require_scheme(scheme, 'scheme, catalogue')
   end subroutine get_scheme

   !> A scheme from a named quadrature.
   subroutine from_rule(scheme, name, rule, degree, reference, error)
      type(scheme_type), intent(out) :: scheme
      character(*), intent(in) :: name, rule
      integer, intent(in) :: degree
      character(*), intent(in) :: reference
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable :: nodes(:), weights(:)

      ! Take the reference from the literature, in place of the default of scheme_from_quadrature.
      call get_quadrature(rule, nodes, weights, error)
      if (allocated(error)) return
      call scheme_from_quadrature(scheme, degree, nodes, weights, name, error)
      scheme%reference = reference
   end subroutine from_rule

   !> Gauss schemes of one or two stages under a modified Hamiltonian or with discrete increments.
   subroutine expanded(scheme, name, error)
      type(scheme_type), intent(out) :: scheme
      character(*), intent(in) :: name
      type(error_type), allocatable, intent(inout) :: error

      ! Terms that the solver leaves out must be smaller than the added brackets: brackets for strong order 3/2 and
      ! weak order 2 go on gauss2, areas alone and two-point increments on midpoint.
      if (index(name, 'gauss2') == 1) then
         call from_rule(scheme, name, 'gauss2', 2, '', error)
      else
         call from_rule(scheme, name, 'gauss1', 1, '', error)
      end if
      if (.not. allocated(error)) call expand_scheme(scheme, name)
   end subroutine expanded

   !> Number of stages in names such as gauss3 and lobatto3_swapped.
   pure integer function degree_of(name)
      character(*), intent(in) :: name

      ! The digit's place in the list of digits is its value.
      degree_of = index('12345678', name(scan(name, '12345678'):scan(name, '12345678')))
   end function degree_of

   !> Exchange the coefficients of Q and P: the polynomial then interpolates the momenta.
   pure subroutine swap(scheme)
      type(scheme_type), intent(inout) :: scheme
      real(wp) :: keep(scheme%nstage, scheme%nstage)

      ! For symplectic tableaux the conjugate of abar is a: the swapped tableau is symplectic, too.
      keep = scheme%a
      scheme%a = scheme%abar
      scheme%abar = keep
      keep = scheme%b
      scheme%b = scheme%bbar
      scheme%bbar = keep
      ! The polynomial of degree s no longer interpolates q; degree 0 says that q has none.
      scheme%degree = 0
   end subroutine swap

   !> Schemes that are not symplectic, for comparison: Heun's method, consistent with Stratonovich, and
   !> Euler-Maruyama, which steps the Ito form.
   subroutine contrast(scheme, name, error)
      type(scheme_type), intent(out) :: scheme
      character(*), intent(in) :: name
      type(error_type), allocatable, intent(inout) :: error
      real(wp), parameter :: one(1) = 1, none(1, 1) = 0, half(2) = 0.5_wp
      real(wp), parameter :: heun(2, 2) = reshape([0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp], [2, 2])
      integer :: i

      ! Heun's second stage is x_n + h f(x_n) and its weights are 1/2: beta^T b e = 1/2, hence Stratonovich.
      ! Euler-Maruyama has a = 0 and one weight 1.
      if (name == 'heun') then
         call scheme_from_tableau(scheme, heun, heun, half, name, .true., error)
         scheme%reference = 'Heun; Kloeden, Platen 1992; not symplectic'
      else
         ! The tableau a = 0 takes forces at (q_n, p_n). The stepper of the Ito form converts the drift.
         call scheme_from_tableau(scheme, none, none, one, name, .true., error)
         scheme%form = ito_form
         scheme%reference = 'Euler-Maruyama for the Ito form; Kloeden, Platen 1992; not symplectic'
         ! The strong order is 1 for additive noise, where the Ito and the Stratonovich equations agree, and 1/2 for all
         ! other noise.
         call set_order(scheme%order(additive_noise), 1.0_wp, evidence_claimed)
         do i = commutative_noise, commuting_flows
            call set_order(scheme%order(i), 0.5_wp, evidence_claimed)
         end do
         call set_order(scheme%order(weak_order), 1.0_wp, evidence_claimed)
         scheme%sharp = .true.
      end if
   end subroutine contrast

   !> Schemes whose names contain parameters.
   subroutine parametrised(scheme, name, error)
      type(scheme_type), intent(out) :: scheme
      character(*), intent(in) :: name
      type(error_type), allocatable, intent(inout) :: error
      character(len=name_length) :: names(size(all_names))
      real(wp) :: x, nodes(1)
      real(wp), parameter :: one(1) = 1
      logical :: known

      call galerkin(scheme, name, known, error)
      if (known) return
      if (index(name, 'dirk:') == 1) then
         call read_parameter(name, 'dirk:', x, error)
         ! With c = 0 or 1 one of the two midpoint steps would have length zero, and so its weight would be zero.
         if (x <= 0 .or. x >= 1) call refuse_parameter(name, '0 < c < 1, as in dirk:0.25', error)
         if (.not. allocated(error)) call dirk(scheme, name, x, error)
      else if (index(name, 'lambda:') == 1) then
         call read_parameter(name, 'lambda:', x, error)
         if (x < 0 .or. x > 1) call refuse_parameter(name, '0 <= x <= 1, as in lambda:0.3', error)
         if (allocated(error)) return
         ! The one node x gives Q = (1 - x) q_n + x q_{n+1}, P = x p_n + (1 - x) p_{n+1}. x = 1/2 is the midpoint
         ! rule, 0 and 1 are the Euler pair; schemes with x /= 1/2 need the drift correction with the factor 1/2 - x.
         nodes = x
         call scheme_from_quadrature(scheme, 1, nodes, one, name, error)
         scheme%reference = 'one-sided family, [WHSB] (71)-(72), (89)-(92)'
      else
         names = all_names
         ! The nearest name shows a misprint, which the whole list would hide.
         call raise(error, unknown_name, 'get_scheme', "there is no scheme '"//trim(name)// &
                    "'; the nearest is "//trim(nearest_name(name, names))//'; scheme_names() lists all')
      end if
   end subroutine parametrised

   !> Two midpoint steps of lengths c h and (1-c) h, with the same fractions of the increments.
   subroutine dirk(scheme, name, c, error)
      type(scheme_type), intent(out) :: scheme
      character(*), intent(in) :: name
      real(wp), intent(in) :: c
      type(error_type), allocatable, intent(inout) :: error
      real(wp) :: a(2, 2), weights(2)

      !       c/2    0
      !       c      (1-c)/2        weights c, 1 - c;  abar = a, as of each midpoint step
      a(:, 1) = c
      a(1, 1) = 0.5_wp*c
      a(1, 2) = 0
      a(2, 2) = 0.5_wp*(1 - c)
      weights(1) = c
      weights(2) = 1 - c
      call scheme_from_tableau(scheme, a, a, weights, name, .false., error)
      scheme%reference = 'diagonally implicit; Ma, Ding, Ding 2012'
   end subroutine dirk

   !> Names PsNrQuRul: P degree, N nodes, Q order of the quadrature rule.
   subroutine galerkin(scheme, name, known, error)
      type(scheme_type), intent(out) :: scheme
      character(*), intent(in) :: name
      logical, intent(out) :: known
      type(error_type), allocatable, intent(inout) :: error
      character(len=name_length) :: rule
      integer :: s, r, u

      known = .false.
      ! Digit 2 is the degree s, digit 4 the number of nodes r, digit 6 the order u that the rule must have.
      if (len_trim(name) /= 9) return
      ! A digit outside its list gives zero, which is no degree, number of nodes or order.
      s = index('1234', name(2:2))
      r = index('1234', name(4:4))
      u = index('12345678', name(6:6))
      select case (name(7:9))
      case ('Gau')
         rule = 'gauss'//name(4:4)
         ! Gauss's rules have order 2 r, Lobatto's 2 r - 2, and the open trapezoid order 2.
         known = u == 2*r
      case ('Lob')
         rule = 'lobatto'//name(4:4)
         known = r > 1 .and. u == 2*r - 2
      case ('Otr')
         rule = 'open_trapezoid'
         known = r == 2 .and. u == 2
      case default  ! there is no rule of this name
      end select
      ! r < s would leave control points undetermined.
      known = known .and. min(s, r, u) > 0 .and. s <= r
      known = known .and. name(1:1)//name(3:3)//name(5:5) == 'PNQ'
      if (.not. known) return
      call from_rule(scheme, name, trim(rule), s, 'Galerkin; Holm, Tyranowski 2018', error)
   end subroutine galerkin

   !> The number after the colon.
   subroutine read_parameter(name, family, x, error)
      character(*), intent(in) :: name, family
      real(wp), intent(out) :: x
      type(error_type), allocatable, intent(inout) :: error
      character(len=40) :: text
      integer :: iostat

      x = 0.5_wp
      ! Accept digits, signs, points and exponents alone: a Fortran read would accept NaN and infinities, too.
      text = name(len(family) + 1:)
      iostat = merge(1, 0, text == '' .or. verify(trim(text), '0123456789.+-eE') > 0)
      if (iostat == 0) read (text, '(f40.0)', iostat=iostat) x
      if (iostat == 0) return
      call raise(error, invalid_argument, 'get_scheme', "'"//trim(name)// &
                 "' has no number after the colon; write for example "//family//'0.25')
   end subroutine read_parameter

   !> Raise the error of a parameter outside its range; `allowed` says the range.
   subroutine refuse_parameter(name, allowed, error)
      character(*), intent(in) :: name, allowed
      type(error_type), allocatable, intent(inout) :: error

      call raise(error, invalid_argument, 'get_scheme', &
                 "the parameter of '"//trim(name)//"' must satisfy "//allowed)
   end subroutine refuse_parameter

end module symsde_scheme_catalogue
