! SPDX-License-Identifier: BSD-3-Clause
!> The certificate of a scheme: what its coefficients prove, measured, not declared.
module symsde_scheme_certificate
   use symsde_base_functionals, only: functional_set, name_functionals
   use symsde_base_kinds, only: wp
   use symsde_base_laws, only: law_gaussian, law_text
   use symsde_base_text, only: to_text
   use symsde_scheme_scheme, only: scheme_type, bracket_terms, tableau_form, galerkin_form, ito_form, &
                                   symplecticity_residual, model_needs, frame_none, frame_shift, &
                                   frame_rotation
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
      type(functional_set) :: asks              !! functionals of the path that a step needs beside dW
      type(bracket_terms) :: brackets           !! added to the one-step Hamiltonian
      integer :: law = law_gaussian             !! law of the increments (base/laws)
      integer :: frame = frame_none             !! what surrounds the step of the tableau
      type(model_needs) :: needs                !! of a model
      character(:), allocatable :: remark       !! what else is known of the scheme
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
      c%asks = scheme%asks
      c%brackets = scheme%brackets
      c%law = scheme%law
      c%frame = scheme%frame
      c%needs = scheme%needs
      if (allocated(scheme%remark)) c%remark = scheme%remark
      if (scheme%form == tableau_form) c%symplecticity_residual = symplecticity_residual(scheme)
      c%symplectic = scheme%form /= ito_form .and. c%symplecticity_residual < coefficient_tolerance
      c%symmetry_residual = symmetry_residual(scheme)
      c%symmetric = c%symmetry_residual < coefficient_tolerance .and. &
                    scheme%frame /= frame_shift .and. scheme%frame /= frame_rotation
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
      if (scheme%form == ito_form .or. scheme%frame /= frame_none .or. scheme%needs%additive) return
      conjugate = conjugate_stratonovich_sum(scheme)
      c%correction_coefficient = scheme%correction_coefficient()
      c%correction_needed = max(abs(c%stratonovich_sum - 0.5_wp), abs(conjugate - 0.5_wp)) &
                            > coefficient_tolerance
      c%correction_exists = c%correction_needed .and. &
                            abs(c%stratonovich_sum + conjugate - 1) < coefficient_tolerance
   end subroutine judge_consistency

   pure character(len=8) function padded_order(order)
      real(wp), intent(in) :: order

      padded_order = 'none'
      if (.not. order > 0) return
      write (padded_order, '(f8.1)') order
      padded_order = adjustl(padded_order)
   end function padded_order

   !> Zero says that the scheme does not converge to the Stratonovich equation.
   pure function order_text(order) result(text)
      real(wp), intent(in) :: order
      character(len=len_trim(padded_order(order))) :: text

      text = padded_order(order)
   end function order_text

   pure function yes_no(truth) result(text)
      logical, intent(in) :: truth
      character(len=merge(3, 2, truth)) :: text

      text = merge('yes', 'no ', truth)
   end function yes_no

   !> One line more: what is told, and its value.
   pure subroutine add(text, what, value)
      character(:), allocatable, intent(inout) :: text
      character(*), intent(in) :: what, value
      character(len=22) :: label

      label = what
      text = text//label//value//new_line('a')
   end subroutine add

   pure subroutine add_form(text, c)
      character(:), allocatable, intent(inout) :: text
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: form

      select case (c%form)
      case (tableau_form); form = 'tableau, '
      case (galerkin_form); form = 'Galerkin, degree '//to_text(c%degree)//', '
      case default; form = 'Ito form, '
      end select
      form = form//to_text(c%nstage)//trim(merge(' nodes ', ' stages', c%form == galerkin_form))
      call add(text, 'scheme', c%name//' ('//form//')')
   end subroutine add_form

   pure subroutine add_symplecticity(text, c)
      character(:), allocatable, intent(inout) :: text
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: value

      if (c%form == galerkin_form) then
         value = 'yes, as a discrete Lagrangian'
      else if (c%form == ito_form) then
         value = 'no, it steps the Ito form'
      else
         value = yes_no(c%symplectic)//', residual of the conditions '//to_text(c%symplecticity_residual)
      end if
      if (c%symplectic .and. c%correction_needed) &
         value = value//'; corrected, and without an analytic Hessian, to the error of its differences'
      call add(text, 'symplectic', value)
   end subroutine add_symplecticity

   pure subroutine add_consistency(text, c)
      character(:), allocatable, intent(inout) :: text
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: value

      if (c%form == ito_form) then
         value = 'Ito form, the drift is converted'
      else if (.not. c%correction_needed) then
         value = 'Stratonovich, no correction'
      else if (c%correction_exists) then
         value = 'beta^T b e = '//to_text(c%stratonovich_sum)// &
                 ': Stratonovich only with the correction of coefficient '//to_text(c%correction_coefficient)// &
                 ', unless H_k,p . H_k,q is constant for every noise'
      else
         value = 'beta^T b e = '//to_text(c%stratonovich_sum)// &
                 ': not the Stratonovich equation, and no correction exists'
      end if
      call add(text, 'consistency', value)
   end subroutine add_consistency

   pure subroutine add_symmetry(text, c)
      character(:), allocatable, intent(inout) :: text
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: value

      value = yes_no(c%symmetric)//', distance from the adjoint '//to_text(c%symmetry_residual)
      if (c%frame == frame_shift) value = 'without noise only, its shift by dZ comes last'
      if (c%frame == frame_rotation) value = 'without noise only, its noise comes first'
      call add(text, 'symmetric', value)
   end subroutine add_symmetry

   !> Weak order two takes the noises to commute.
   pure subroutine add_orders(text, c)
      character(:), allocatable, intent(inout) :: text
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: weak

      call add(text, 'strong order', 'additive noise '//order_text(c%order_additive)// &
               ', commutative '//order_text(c%order_commutative)//', general '//order_text(c%order_general)// &
               ', commuting flows '//order_text(c%order_commuting))
      weak = order_text(c%order_weak)
      if (c%brackets%nested) weak = weak//' for commutative noises, 1.0 for the others'
      call add(text, 'weak order', weak)
   end subroutine add_orders

   !> What is added to the Hamiltonian of a step, and what is asked of the noise; nothing for plain schemes.
   pure subroutine add_expansion(text, c)
      character(:), allocatable, intent(inout) :: text
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: brackets, asked

      if (.not. c%brackets%are_added() .and. .not. c%asks%is_empty()) then
         call name_functionals(c%asks, asked)
         call add(text, 'increments', asked//' beside dW')
      else if (c%brackets%are_added()) then
         brackets = ''
         if (c%brackets%single) brackets = brackets//', {H_k,H} with dZ'
         if (c%brackets%areas) brackets = brackets//', {H_l,H_k} with areas'
         if (c%brackets%nested) brackets = brackets//', {{H,H_k},H_k} by differences of values'
         call add(text, 'brackets added', brackets(3:)//'; without an analytic Hessian symplectic to the error '// &
                  'of its differences')
      end if
      if (c%law /= law_gaussian) &
         call add(text, 'increments', law_text(c%law)//': for expectations, not path by path')
   end subroutine add_expansion

   pure subroutine add_explicit(text, c)
      character(:), allocatable, intent(inout) :: text
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: value

      select case (c%explicit_for)
      case (always_explicit); value = 'for every model'
      case (explicit_if_separable); value = 'for separable models'
      case default; value = 'never'
      end select
      if (c%explicit_for /= never_explicit .and. c%correction_exists) value = value//', without correction'
      call add(text, 'explicit', value)
   end subroutine add_explicit

   pure subroutine add_cost(text, c)
      character(:), allocatable, intent(inout) :: text
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: value

      value = to_text(c%gradients_per_step)//' gradients'
      if (c%explicit_for /= always_explicit) &
         value = value//' for each iteration of '//to_text(c%unknowns)//' unknowns per degree of freedom ('// &
                 to_text(c%unknowns_if_separable)//' where separable)'
      call add(text, 'cost per step', value)
   end subroutine add_cost

   !> What a model must be, for the schemes that not every model can have.
   pure subroutine add_needs(text, c)
      character(:), allocatable, intent(inout) :: text
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: value

      if (c%form == galerkin_form) &
         call add(text, 'needs', 'H_pp not singular, every H_k,p constant: '// &
                  'nodes that see different velocities of the noise tear their momenta apart')
      associate (needs => c%needs)
         if (needs%additive) then
            value = 'additive noise'
            if (needs%position_noise) value = value//' in p alone'
         else if (needs%position_noise .and. .not. needs%additive_will_do) then
            value = 'noise that depends on q alone'
         else
            return
         end if
         if (needs%identity_mass) value = value//', H = p.p/2 + U(q)'
         if (needs%rotation) value = value//', frequencies of its linear part (trait rotation)'
      end associate
      if (allocated(c%remark)) value = value//'; '//c%remark
      call add(text, 'needs', value)
   end subroutine add_needs

   pure subroutine write_certificate(c, text)
      type(certificate_type), intent(in) :: c
      character(:), allocatable, intent(out) :: text

      text = ''
      call add_form(text, c)
      call add(text, 'reference', c%reference)
      call add_symplecticity(text, c)
      call add_consistency(text, c)
      call add_symmetry(text, c)
      call add(text, 'quadratic invariants', trim(merge('preserved exactly', 'not preserved    ', c%keeps_quadratic)))
      call add_orders(text, c)
      call add_expansion(text, c)
      call add(text, 'order without noise', to_text(c%order_noise_free))
      call add_explicit(text, c)
      call add_cost(text, c)
      call add_needs(text, c)
   end subroutine write_certificate

   pure integer function text_length(c)
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: lines

      call write_certificate(c, lines)
      text_length = len(lines)
   end function text_length

   !> The certificate as readable lines, each ended by a new-line character.
   pure function certificate_text(c) result(text)
      type(certificate_type), intent(in) :: c
      character(len=text_length(c)) :: text
      character(:), allocatable :: lines

      call write_certificate(c, lines)
      text = lines
   end function certificate_text

end module symsde_scheme_certificate
