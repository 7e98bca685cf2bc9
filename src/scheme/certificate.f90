! SPDX-License-Identifier: BSD-3-Clause
!> The certificate of a scheme: what its coefficients prove, measured, not declared.
module symsde_scheme_certificate
   use symsde_base_kinds, only: wp
   use symsde_base_laws, only: law_gaussian, law_text
   use symsde_base_text, only: to_text
   use symsde_scheme_scheme, only: scheme_type, tableau_form, galerkin_form, ito_form, &
                                   symplecticity_residual, expansion_none, expansion_dz, uses_dz, uses_areas, &
                                   uses_nested_bracket, special_none, special_verlet_dz, special_drift_preserving, &
                                   special_exact_rotation
   use symsde_scheme_properties, only: symmetry_residual, quadratic_residual, stratonovich_sum, &
                                       conjugate_stratonovich_sum, coefficient_tolerance
   use symsde_scheme_dependency, only: is_explicit, implicit_unknowns
   implicit none
   private
   public :: certificate_type, certificate, certificate_text
   public :: never_explicit, explicit_if_separable, always_explicit

   enum, bind(c)
      enumerator :: never_explicit = 0
      enumerator :: explicit_if_separable = 1  !! every H_j = T_j(p) + U_j(q), and no correction active
      enumerator :: always_explicit = 2
   end enum

   type :: certificate_type
      character(:), allocatable :: name, reference
      integer :: form = tableau_form
      integer :: nstage = 0
      integer :: degree = 0
      integer :: expansion = expansion_none     !! brackets added to the one-step Hamiltonian
      integer :: law = law_gaussian             !! law of the increments (base/laws)
      integer :: special = special_none         !! some noise alone, by a stepper of its own
      logical :: symplectic = .false.
      real(wp) :: symplecticity_residual = 0    !! largest residual of the four conditions
      real(wp) :: stratonovich_sum = 0          !! beta^T b e; 1/2 = consistent with Stratonovich
      real(wp) :: correction_coefficient = 0    !! 1/2 - beta^T b e
      logical :: correction_needed = .false.    !! unless H_{k,p} . H_{k,q} is constant for every noise
      logical :: correction_exists = .false.    !! a Hamiltonian makes up for what is missing
      logical :: symmetric = .false.
      real(wp) :: symmetry_residual = 0         !! distance from the adjoint
      logical :: keeps_quadratic = .false.
      real(wp) :: quadratic_residual = 0        !! largest |a - abar|, |b - bbar|
      real(wp) :: order_additive = 0            !! strong; corrected where needed
      real(wp) :: order_commutative = 0
      real(wp) :: order_general = 0
      real(wp) :: order_commuting = 0
      real(wp) :: order_weak = 0
      integer :: order_noise_free = 0
      integer :: explicit_for = never_explicit  !! one of the three enumerators
      integer :: gradients_per_step = 0         !! for each iteration of the solver where implicit
      integer :: unknowns = 0                   !! to solve for, each degree of freedom; any Hamiltonian
      integer :: unknowns_if_separable = 0
   end type certificate_type

contains

   !> The certificate of a scheme of any origin.
   pure function certificate(scheme) result(c)
      type(scheme_type), intent(in) :: scheme
      type(certificate_type) :: c

      c%name = scheme%name
      c%reference = scheme%reference
      c%form = scheme%form
      c%nstage = scheme%nstage
      c%degree = scheme%degree
      c%expansion = scheme%expansion
      c%law = scheme%law
      c%special = scheme%special
      if (scheme%form == tableau_form) c%symplecticity_residual = symplecticity_residual(scheme)
      c%symplectic = scheme%form /= ito_form .and. c%symplecticity_residual < coefficient_tolerance
      c%symmetry_residual = symmetry_residual(scheme)
      c%symmetric = c%symmetry_residual < coefficient_tolerance .and. &
                    scheme%special /= special_verlet_dz .and. scheme%special /= special_exact_rotation
      c%quadratic_residual = quadratic_residual(scheme)
      c%keeps_quadratic = c%symplectic .and. c%quadratic_residual < coefficient_tolerance
      call judge_consistency(c, scheme)
      c%order_additive = scheme%order_additive
      c%order_commutative = scheme%order_commutative
      c%order_general = scheme%order_general
      c%order_commuting = scheme%order_commuting
      c%order_weak = scheme%order_weak
      c%order_noise_free = scheme%order_noise_free
      if (is_explicit(scheme, .true.)) c%explicit_for = explicit_if_separable
      if (is_explicit(scheme, .false.)) c%explicit_for = always_explicit
      c%gradients_per_step = scheme%nstage
      c%unknowns = implicit_unknowns(scheme, .false.)
      c%unknowns_if_separable = implicit_unknowns(scheme, .true.)
   end function certificate

   !> Which equation the scheme approximates. beta^T b e and beta^T bbar e must be 1/2; a correction
   !> Hamiltonian moves them by opposite amounts, so it helps only where their sum is one.
   pure subroutine judge_consistency(c, scheme)
      type(certificate_type), intent(inout) :: c
      type(scheme_type), intent(in) :: scheme
      real(wp) :: conjugate

      c%stratonovich_sum = stratonovich_sum(scheme)
      if (scheme%form == ito_form .or. scheme%special /= special_none) return
      conjugate = conjugate_stratonovich_sum(scheme)
      c%correction_coefficient = scheme%correction_coefficient()
      c%correction_needed = max(abs(c%stratonovich_sum - 0.5_wp), abs(conjugate - 0.5_wp)) &
                            > coefficient_tolerance
      c%correction_exists = c%correction_needed .and. &
                            abs(c%stratonovich_sum + conjugate - 1) < coefficient_tolerance
   end subroutine judge_consistency

   !> The certificate as readable lines, separated by new-line characters.
   pure function certificate_text(c) result(text)
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: text

      text = line('scheme', c%name//' ('//form_text(c)//')')// &
             line('reference', c%reference)// &
             line('symplectic', symplectic_text(c))// &
             line('consistency', consistency_text(c))// &
             line('symmetric', symmetric_text(c))// &
             line('quadratic invariants', quadratic_text(c))// &
             line('strong order', 'additive noise '//order_text(c%order_additive)// &
                  ', commutative '//order_text(c%order_commutative)//', general '//order_text(c%order_general)// &
                  ', commuting flows '//order_text(c%order_commuting))// &
             line('weak order', weak_text(c))// &
             expansion_lines(c)// &
             line('order without noise', to_text(c%order_noise_free))// &
             line('explicit', explicit_text(c))// &
             line('cost per step', cost_text(c))
      if (c%form == galerkin_form) &
         text = text//line('needs', 'H_pp not singular, every H_k,p constant: '// &
                           'nodes that see different velocities of the noise tear their momenta apart')
      if (c%special /= special_none) text = text//line('needs', needs_text(c))
   end function certificate_text

   !> Weak order two takes the noises to commute.
   pure function weak_text(c) result(text)
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: text

      text = order_text(c%order_weak)
      if (uses_nested_bracket(c%expansion)) text = text//' for commutative noises, 1.0 for the others'
   end function weak_text

   !> What is added to the Hamiltonian of a step, and what is asked of the noise; nothing for plain schemes.
   pure function expansion_lines(c) result(text)
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: text

      text = ''
      if (c%expansion == expansion_dz) then
         text = line('increments', 'dZ beside dW')
      else if (c%expansion /= expansion_none) then
         if (uses_dz(c%expansion)) text = text//', {H_k,H} with dZ'
         if (uses_areas(c%expansion)) text = text//', {H_l,H_k} with areas'
         if (uses_nested_bracket(c%expansion)) text = text//', {{H,H_k},H_k} by differences of values'
         text = line('brackets added', text(3:)//'; without an analytic Hessian symplectic to the error of '// &
                     'its differences')
      end if
      if (c%law /= law_gaussian) &
         text = text//line('increments', law_text(c%law)//': for expectations, not path by path')
   end function expansion_lines

   !> What a model must be for the schemes that are made for some noise alone.
   pure function needs_text(c) result(text)
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: text

      if (c%special == special_exact_rotation) then
         text = 'noise that depends on q alone, H = p.p/2 + U(q), frequencies of its linear part (trait rotation)'// &
                '; where U is that part and the noise additive, E H is exact for every h'
         return
      end if
      text = 'additive noise'
      if (c%expansion /= expansion_dz .or. c%explicit_for /= never_explicit) &
         text = text//' in p alone, H = p.p/2 + U(q)'
      if (c%special == special_drift_preserving) &
         text = text//'; E H is exact for polynomials U up to degree eight'
   end function needs_text

   pure function line(what, value) result(text)
      character(*), intent(in) :: what, value
      character(:), allocatable :: text
      character(len=22) :: label

      label = what
      text = label//value//new_line('a')
   end function line

   pure function yes_no(truth) result(text)
      logical, intent(in) :: truth
      character(:), allocatable :: text

      text = trim(merge('yes', 'no ', truth))
   end function yes_no

   !> Zero says that the scheme does not converge to the Stratonovich equation.
   pure function order_text(order) result(text)
      real(wp), intent(in) :: order
      character(:), allocatable :: text

      character(len=8) :: digits

      text = 'none'
      write (digits, '(f8.1)') order
      if (order > 0) text = trim(adjustl(digits))
   end function order_text

   pure function form_text(c) result(text)
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: text

      select case (c%form)
      case (tableau_form); text = 'tableau, '//to_text(c%nstage)//' stages'
      case (galerkin_form)
         text = 'Galerkin, degree '//to_text(c%degree)//', '//to_text(c%nstage)//' nodes'
      case default; text = 'Ito form, '//to_text(c%nstage)//' stages'
      end select
   end function form_text

   pure function symplectic_text(c) result(text)
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: text

      if (c%form == galerkin_form) then
         text = 'yes, as a discrete Lagrangian'
      else if (c%form == ito_form) then
         text = 'no, it steps the Ito form'
      else
         text = yes_no(c%symplectic)//', residual of the conditions '// &
                to_text(c%symplecticity_residual)
      end if
      if (c%symplectic .and. c%correction_needed) &
         text = text//'; corrected, and without an analytic Hessian, to the error of its differences'
   end function symplectic_text

   pure function symmetric_text(c) result(text)
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: text

      text = yes_no(c%symmetric)//', distance from the adjoint '//to_text(c%symmetry_residual)
      if (c%special == special_verlet_dz) text = 'without noise only, its shift by dZ comes last'
      if (c%special == special_exact_rotation) text = 'without noise only, its noise comes first'
   end function symmetric_text

   pure function consistency_text(c) result(text)
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: text

      if (c%form == ito_form) then
         text = 'Ito form, the drift is converted'
      else if (.not. c%correction_needed) then
         text = 'Stratonovich, no correction'
      else if (c%correction_exists) then
         text = 'beta^T b e = '//to_text(c%stratonovich_sum)// &
                ': Stratonovich only with the correction of coefficient '// &
                to_text(c%correction_coefficient)// &
                ', unless H_k,p . H_k,q is constant for every noise'
      else
         text = 'beta^T b e = '//to_text(c%stratonovich_sum)// &
                ': not the Stratonovich equation, and no correction exists'
      end if
   end function consistency_text

   pure function quadratic_text(c) result(text)
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: text

      text = 'not preserved'
      if (c%keeps_quadratic) text = 'preserved exactly'
   end function quadratic_text

   pure function explicit_text(c) result(text)
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: text

      select case (c%explicit_for)
      case (always_explicit); text = 'for every model'
      case (explicit_if_separable); text = 'for separable models'
      case default; text = 'never'
      end select
      if (c%explicit_for /= never_explicit .and. c%correction_exists) &
         text = text//', without correction'
   end function explicit_text

   pure function cost_text(c) result(text)
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: text

      text = to_text(c%gradients_per_step)//' gradients'
      if (c%explicit_for /= always_explicit) &
         text = text//' for each iteration of '//to_text(c%unknowns)//' unknowns per degree of freedom ('// &
                to_text(c%unknowns_if_separable)//' where separable)'
   end function cost_text

end module symsde_scheme_certificate
