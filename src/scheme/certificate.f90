! SPDX-License-Identifier: BSD-3-Clause
!>    symplecticity   max_ij |alpha_i abar_ij + alpha_j a_ji - alpha_i alpha_j|, and three with beta, b, bbar
!>    adjointness     max_ij |a_ij + a_i'j' - alpha_j|, .. ,  i' = r + 1 - i
!>    consistency     beta^T b e = beta^T bbar e = 1/2
!>
!> The certificate of a scheme: properties proved by its coefficients, claims beyond these, and measurements.
!>
!>    line of the text       rests on
!>    symplectic             the residual of a tableau; the form of other data; a claim if a frame adds to the step
!>    consistency            beta^T b e and beta^T bbar e
!>    symmetric              the distance from the adjoint, and the end of the step at which a frame acts
!>    quadratic invariants   a - abar and b - bbar, if symplectic
!>    strong .., weak        scheme/orders: derived or claimed, and measured
!>    damped, ..             scheme/damped: the factor by which a step shrinks the form, or volume
!>    explicit, cost         scheme/dependency: cycles among the stage values
!>    needs                  the traits that a model must declare (scheme/needs)
!>
!> Residuals are computed here from the coefficients. Structure is derived if the stepper executes these coefficients,
!> and claimed if a special stepper does more; orders state their evidence for each class of noise (scheme/orders).
module symsde_scheme_certificate
   use symsde_base_functionals, only: functional_set, name_functionals
   use symsde_base_kinds, only: wp
   use symsde_base_laws, only: law_gaussian, law_text
   use symsde_base_text, only: counted, to_text
   use symsde_scheme_scheme, only: scheme_type, bracket_terms, tableau_form, galerkin_form, ito_form, &
                                   splitting_form, symplecticity_residual, model_needs, frame_none, frame_shift, &
                                   frame_rotation
   use symsde_scheme_damped, only: tell_damping, one_rate, unequal_rates, friction_matrix, varying_rates
   use symsde_scheme_kicks, only: flow_midpoint
   use symsde_scheme_orders, only: order_type, norder, order_names, weak_order, additive_noise, evidence_claimed, &
                                   evidence_derived, evidence_text
   use symsde_scheme_properties, only: symmetry_residual, quadratic_residual, stratonovich_sum, &
                                       conjugate_stratonovich_sum, coefficient_tolerance
   use symsde_scheme_dependency, only: is_explicit, implicit_unknowns
   implicit none
   private
   public :: certificate_type, certificate, certificate_text
   public :: never_explicit, explicit_if_separable, always_explicit

   enum, bind(c)
      ! Models for which a step solves no equations.
      enumerator :: never_explicit = 0
      enumerator :: explicit_if_separable = 1  !! every H_j = T_j(p) + U_j(q), and no correction active
      enumerator :: always_explicit = 2
   end enum

   type :: certificate_type
      character(:), allocatable :: name, reference
      integer :: form = tableau_form
      integer :: nstage = 0
      integer :: degree = 0
      integer :: implicit_drifts = 0            !! number of midpoint steps between kicks
      type(functional_set) :: asks              !! functionals of the path that a step needs beside dW
      type(bracket_terms) :: brackets           !! added to the one-step Hamiltonian
      integer :: law = law_gaussian             !! law of the increments (base/laws)
      integer :: frame = frame_none             !! frame around the tableau's step
      type(model_needs) :: needs                !! conditions on the model
      character(:), allocatable :: damped_by_rate     !! what steps keep with one rate of damping, or a refusal
      character(:), allocatable :: damped_by_rates    !! the same with unequal rates
      character(:), allocatable :: damped_by_matrix   !! the same with a matrix of friction
      character(:), allocatable :: damped_by_function !! the same with rates that are functions of position and time
      real(wp) :: damped_order(2) = 0           !! measured strong orders with one rate (scheme_type)
      character(:), allocatable :: remark       !! more facts on the scheme
      logical :: symplectic = .false.
      real(wp) :: symplecticity_residual = 0    !! largest residual of the four conditions
      real(wp) :: stratonovich_sum = 0          !! beta^T b e; 1/2 = consistent with Stratonovich
      real(wp) :: correction_coefficient = 0    !! 1/2 - beta^T b e
      logical :: correction_needed = .false.    !! unless H_{k,p} . H_{k,q} is constant for every noise
      logical :: correction_exists = .false.    !! a Hamiltonian restores the Stratonovich equation
      logical :: symmetric = .false.
      real(wp) :: symmetry_residual = 0         !! distance from the adjoint
      logical :: keeps_quadratic = .false.
      real(wp) :: quadratic_residual = 0        !! largest |a - abar|, |b - bbar|
      logical :: keeps_bilinear = .false.       !! invariants q^T D p
      integer :: structure = evidence_derived   !! evidence of the structure: derived or claimed
      type(order_type) :: order(norder)         !! orders by class of noise, corrected where needed
      integer :: order_noise_free = 0
      integer :: explicit_for = never_explicit  !! models for which the scheme is explicit: one of three enumerators
      integer :: gradients_per_step = 0         !! gradients of a step; if implicit, of each iteration of the solver
      integer :: unknowns = 0                   !! coupled unknowns for each degree of freedom; any Hamiltonian
      integer :: unknowns_if_separable = 0
   end type certificate_type

contains

   !> The certificate of a scheme of any origin.
   !>
   !> Invariants q^T D p belong to linear maps of q alone, under which a discrete Lagrangian does not change
   !> (Noether); a symplectic tableau keeps them also where abar is not a (Hairer, Lubich, Wanner, Geometric
   !> Numerical Integration, IV.2).
   pure function certificate(scheme) result(c)
      type(scheme_type), intent(in) :: scheme
      type(certificate_type) :: c

      ! Copy the texts of the scheme: a certificate may outlive it.
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
      ! Galerkin forms are symplectic as discrete Lagrangians, kicks as exact flows: both have no residual.
      if (scheme%form == tableau_form) c%symplecticity_residual = symplecticity_residual(scheme)
      ! Judge symplecticity by the residual, whatever the scheme declares.
      c%symplectic = scheme%form /= ito_form .and. c%symplecticity_residual < coefficient_tolerance
      c%symmetry_residual = symmetry_residual(scheme)
      ! The coefficients do not show a frame that acts at one end of the step.
      c%symmetric = c%symmetry_residual < coefficient_tolerance .and. &
                    scheme%frame /= frame_shift .and. scheme%frame /= frame_rotation
      c%quadratic_residual = quadratic_residual(scheme)
      !   symplectic and a = abar, b = bbar: p^T C q + q^T A q/2 + p^T B p/2 is kept wherever the flows keep it
      c%keeps_quadratic = c%symplectic .and. c%quadratic_residual < coefficient_tolerance
      call judge_consistency(c, scheme)
      ! A linear map of q that leaves the Lagrangian unchanged leaves the discrete one unchanged, too; Noether's
      ! theorem then keeps q^T D p.
      c%keeps_bilinear = c%symplectic
      ! Orders were set, each with its evidence, where the scheme was made.
      c%structure = scheme%structure
      c%order = scheme%order
      c%order_noise_free = scheme%order_noise_free
      ! A scheme that is explicit for any Hamiltonian is so for separable ones: the second test overrides.
      if (is_explicit(scheme, .true.)) c%explicit_for = explicit_if_separable
      if (is_explicit(scheme, .false.)) c%explicit_for = always_explicit
      if (scheme%form == splitting_form .and. scheme%kicks%flow == flow_midpoint) &
         ! Each drift between kicks is a midpoint step of H, with a solver of its own.
         c%implicit_drifts = scheme%kicks%ndrift()
      ! Each stage takes one gradient of Hhat, and each midpoint step between kicks one for every iteration.
      c%gradients_per_step = scheme%nstage + c%implicit_drifts
      c%unknowns = implicit_unknowns(scheme, .false.)
      c%unknowns_if_separable = implicit_unknowns(scheme, .true.)
      call tell_damping(scheme, c%symplectic, c%correction_exists, one_rate, c%damped_by_rate)
      call tell_damping(scheme, c%symplectic, c%correction_exists, unequal_rates, c%damped_by_rates)
      call tell_damping(scheme, c%symplectic, c%correction_exists, friction_matrix, c%damped_by_matrix)
      call tell_damping(scheme, c%symplectic, c%correction_exists, varying_rates, c%damped_by_function)
      c%damped_order = scheme%damped_order
   end function certificate

   !> Decide which equation the scheme approximates. beta^T b e and beta^T bbar e must be 1/2. A correction Hamiltonian
   !> changes both by opposite amounts, so it helps only if their sum is one.
   pure subroutine judge_consistency(c, scheme)
      type(certificate_type), intent(inout) :: c
      type(scheme_type), intent(in) :: scheme
      real(wp) :: conjugate

      c%stratonovich_sum = stratonovich_sum(scheme)
      ! The Ito form needs the sum zero; additive noise has H_k,qp = 0 and needs no correction.
      if (scheme%form == ito_form .or. scheme%frame /= frame_none .or. scheme%needs%additive) return
      !   correction (1/2 - beta^T b e) F_p.F_q:  exists where beta^T b e + beta^T bbar e = 1
      conjugate = conjugate_stratonovich_sum(scheme)
      c%correction_coefficient = scheme%correction_coefficient()
      c%correction_needed = max(abs(c%stratonovich_sum - 0.5_wp), abs(conjugate - 0.5_wp)) &
                            > coefficient_tolerance
      c%correction_exists = c%correction_needed .and. &
                            abs(c%stratonovich_sum + conjugate - 1) < coefficient_tolerance
   end subroutine judge_consistency

   !> Write an order, its evidence, and the slope with its 95 % half-width if it was measured.
   pure subroutine describe(order, text)
      type(order_type), intent(in) :: order
      character(:), allocatable, intent(out) :: text
      character(len=60) :: numbers

      text = 'none'
      if (.not. order%value > 0) return
      write (numbers, '(f8.1)') order%value
      text = trim(adjustl(numbers))//' ('//evidence_text(order%evidence)
      if (order%problem /= '') then
         write (numbers, '(f5.3, a, f5.3)') order%measured, ' +- ', order%half_width
         text = text//'; measured '//trim(numbers)//' on '//trim(order%problem)
      else
         text = text//', not measured'
      end if
      text = text//')'
   end subroutine describe

   !> 'yes' or 'no'.
   pure function yes_no(truth) result(text)
      logical, intent(in) :: truth
      character(len=merge(3, 2, truth)) :: text

      text = merge('yes', 'no ', truth)
   end function yes_no

   !> Add a line: a label and its value.
   pure subroutine add(text, what, value)
      character(:), allocatable, intent(inout) :: text
      character(*), intent(in) :: what, value
      character(len=24) :: label

      ! Labels are padded to one width, so that values are below each other.
      label = what
      text = text//label//value//new_line('a')
   end subroutine add

   !> The line of the name: form, degree, and number of stages, nodes or kicks.
   pure subroutine add_form(text, c)
      character(:), allocatable, intent(inout) :: text
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: form

      select case (c%form)
      case (tableau_form); form = 'tableau, '
      case (galerkin_form); form = 'Galerkin, degree '//to_text(c%degree)//', '
      case (splitting_form); form = 'drifts and kicks, '
      case default; form = 'Ito form, '
      end select
      select case (c%form)
      case (galerkin_form); form = form//counted(to_text(c%nstage), 'node')
      case (splitting_form); form = form//counted(to_text(c%nstage), 'kick')
      case default; form = form//counted(to_text(c%nstage), 'stage')
      end select
      call add(text, 'scheme', c%name//' ('//form//')')
   end subroutine add_form

   !> The line on symplecticity: the residual if the tableau is the whole step, else the reason why the form is
   !> symplectic. The gradient of a correction is a Hessian product of Hhat; computed by differences it is no exact
   !> gradient.
   pure subroutine add_symplecticity(text, c)
      character(:), allocatable, intent(inout) :: text
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: value

      if (c%form == galerkin_form) then
         value = 'yes, as a discrete Lagrangian'
      else if (c%form == splitting_form) then
         value = 'yes, as a composition of exact flows'
         if (c%implicit_drifts > 0) value = 'yes, as a composition of kicks, which are exact, and midpoint steps'
      else if (c%form == ito_form) then
         value = 'no, it steps the Ito form'
      else
         value = yes_no(c%symplectic)//', residual of the conditions '//to_text(c%symplecticity_residual)
         if (c%structure == evidence_claimed) &
            value = yes_no(c%symplectic)//', claimed: its own stepper executes more than the tableau'
      end if
      ! A Hessian product by differences has an error, and a corrected step is symplectic up to this error.
      if (c%symplectic .and. c%correction_needed) &
         value = value//'; corrected, and without an analytic Hessian, to the error of its differences'
      call add(text, 'symplectic', value)
   end subroutine add_symplecticity

   !> The line on the approximated equation, and on the correction F_p.F_q (1/2 - beta^T b e) if it is needed.
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

   !> The line on symmetry, with the distance from the adjoint if the tableau is the whole step.
   pure subroutine add_symmetry(text, c)
      character(:), allocatable, intent(inout) :: text
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: value

      value = yes_no(c%symmetric)
      if (c%structure /= evidence_claimed) value = value//', distance from the adjoint '//to_text(c%symmetry_residual)
      ! Without noise dZ = 0, and the rest of the step is symmetric.
      if (c%frame == frame_shift) value = 'without noise only, its shift by dZ comes last'
      if (c%frame == frame_rotation) value = 'without noise only, its noise comes first'
      if (c%structure == evidence_claimed) value = value//', claimed'
      call add(text, 'symmetric', value)
   end subroutine add_symmetry

   !> The line on invariants: all quadratic ones (a = abar), or those that are bilinear in q and p.
   pure subroutine add_invariants(text, c)
      character(:), allocatable, intent(inout) :: text
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: value

      ! Quadratic invariants include invariants of the form q^T D p.
      if (c%keeps_quadratic) then
         value = 'preserved exactly'
      else if (c%keeps_bilinear) then
         value = 'not preserved; those of the form q^T D p, as angular momentum, are'
      else
         value = 'not preserved'
      end if
      if (c%structure == evidence_claimed) value = value//', claimed'
      call add(text, 'quadratic invariants', value)
   end subroutine add_invariants

   !> First words of an order's line: the kind of convergence and the class of noise.
   pure function order_label(i) result(label)
      integer, intent(in) :: i
      character(len=23) :: label

      label = 'strong, '//order_names(i)
      if (i == weak_order) label = 'weak'
   end function order_label

   !> One line for each class of noise. Weak order two assumes commutative noises unless crossed brackets are added.
   pure subroutine add_orders(text, c)
      character(:), allocatable, intent(inout) :: text
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: value
      integer :: i

      do i = 1, norder
         call describe(c%order(i), value)
         ! Nested brackets give order 2 for commutative noises; crossed brackets, of noises with each other, for
         ! all noises.
         if (i == weak_order .and. c%brackets%nested) then
            if (c%brackets%crossed) then
               value = value//' for every noise'
            else
               value = value//' for commutative noises, 1.0 for the others'
            end if
         end if
         call add(text, order_label(i), value)
      end do
      ! The second Magnus term, which kicks at Gauss' nodes miss, holds these brackets.
      if (c%needs%parts_will_do .and. c%order(additive_noise)%value > 0) &
         call add(text, 'strong, own flows', 'as for additive noise where all {H_k, {H_l, D}}, k, l >= 1, are '// &
                  'constants, as with D quadratic in p and H_k linear in q; else as for commutative noise')
   end subroutine add_orders

   !> Lines on terms added to the Hamiltonian of a step, and on increments; none for plain schemes.
   pure subroutine add_expansion(text, c)
      character(:), allocatable, intent(inout) :: text
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: brackets, asked

      ! Lines on brackets name their functionals of the path; for other schemes that take more than dW, name them
      ! here.
      if (.not. c%brackets%are_added() .and. .not. c%asks%is_empty()) then
         call name_functionals(c%asks, asked)
         call add(text, 'increments', asked//' beside dW')
      else if (c%brackets%are_added()) then
         ! Each bracket begins with a comma, the first of which is cut off.
         brackets = ''
         if (c%brackets%single) brackets = brackets//', {H_k,H} with dZ'
         if (c%brackets%areas) brackets = brackets//', {H_l,H_k} with areas'
         if (c%brackets%crossed) then
            brackets = brackets//', {{H,H_k},H_k} and {{H_l,H_k},H_k} by differences of values'
         else if (c%brackets%nested) then
            brackets = brackets//', {{H,H_k},H_k} by differences of values'
         end if
         call add(text, 'brackets added', brackets(3:)//'; without an analytic Hessian symplectic to the error '// &
                  'of its differences')
      end if
      ! Discrete increments share the first moments of Gaussian ones, but follow no path.
      if (c%law /= law_gaussian) &
         call add(text, 'increments', law_text(c%law)//': for expectations, not path by path')
   end subroutine add_expansion

   !> Lines on damping: what steps keep, and strong orders as they were measured with one rate. If all kinds are refused
   !> for the same reason, one line says so.
   pure subroutine add_damping(text, c)
      character(:), allocatable, intent(inout) :: text
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: found
      character(len=8) :: numbers(2)

      if (c%damped_by_rate == c%damped_by_matrix .and. index(c%damped_by_rate, 'refused') == 1) then
         call add(text, 'damped', c%damped_by_rate)
         return
      end if
      call add(text, 'damped, one rate', c%damped_by_rate)
      call add(text, 'damped, unequal rates', c%damped_by_rates)
      call add(text, 'damped, matrix', c%damped_by_matrix)
      call add(text, 'damped, gamma(q, t)', c%damped_by_function)
      found = 'not measured'
      if (c%damped_order(1) > 0) then
         write (numbers, '(f8.2)') c%damped_order
         found = 'measured '//trim(adjustl(numbers(1)))//' with additive noise'
         if (c%damped_order(2) > 0) found = found//', '//trim(adjustl(numbers(2)))//' with noise in position'
         found = found//', on a chain of two with one rate'
      end if
      if (c%order(additive_noise)%value > 2) found = 'by gamma where it depends on q 2 at most; '//found
      call add(text, 'damped, strong orders', 'as without damping; '//found)
   end subroutine add_damping

   !> The line that names the models for which no equations are solved; a correction makes every scheme implicit.
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

   !> The line on cost: gradients and unknowns, for explicit schemes per step, for implicit schemes per iteration.
   pure subroutine add_cost(text, c)
      character(:), allocatable, intent(inout) :: text
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: value

      value = counted(to_text(c%gradients_per_step), 'gradient')
      if (c%implicit_drifts > 0) then
         value = counted(to_text(c%nstage), 'gradient')//'; midpoint steps: '//to_text(c%implicit_drifts)// &
                 ', of 1 gradient for each iteration of '//counted(to_text(c%unknowns), 'unknown')// &
                 ' per degree of freedom'
      else if (c%explicit_for /= always_explicit) then
         value = value//' for each iteration of '//counted(to_text(c%unknowns), 'unknown')// &
                 ' per degree of freedom ('//to_text(c%unknowns_if_separable)//' where separable)'
      end if
      call add(text, 'cost per step', value)
   end subroutine add_cost

   !> The line on conditions that a model must meet, if there are any.
   pure subroutine add_needs(text, c)
      character(:), allocatable, intent(inout) :: text
      type(certificate_type), intent(in) :: c
      character(:), allocatable :: value

      if (c%form == galerkin_form) &
         call add(text, 'needs', 'H_pp not singular, noises in position or all additive: '// &
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
         if (needs%identity_mass) then
            value = value//', H = p.p/2 + U(q)'
         else if (needs%constant_mass) then
            value = value//', H = p.M^-1 p/2 + U(q) with a constant mass'
            if (needs%quadratic_will_do) value = value//', or a declared quadratic part of H that holds all p (split)'
            if (needs%actions_will_do) then
               value = value//', or functions of the actions beside it (kicks)'
            else if (needs%phases_will_do) then
               value = value//', or functions of the actions beside it, of which noises are linear ones (kicks)'
            end if
            if (needs%parts_will_do) value = value//', or exact flows of two parts of H (drift, kick)'
         end if
         if (needs%rotation) value = value//', frequencies of its linear part (trait rotation)'
      end associate
      if (allocated(c%remark)) value = value//'; '//c%remark
      call add(text, 'needs', value)
   end subroutine add_needs

   !> Write all lines in this order: form, invariants, accuracy, cost, conditions on the model.
   pure subroutine write_certificate(c, text)
      type(certificate_type), intent(in) :: c
      character(:), allocatable, intent(out) :: text

      text = ''
      call add_form(text, c)
      call add(text, 'reference', c%reference)
      call add_symplecticity(text, c)
      call add_consistency(text, c)
      call add_symmetry(text, c)
      call add_invariants(text, c)
      call add_orders(text, c)
      call add_expansion(text, c)
      call add(text, 'order without noise', to_text(c%order_noise_free))
      call add_damping(text, c)
      call add_explicit(text, c)
      call add_cost(text, c)
      call add_needs(text, c)
   end subroutine write_certificate

   !> Length of the text, needed to declare the result of certificate_text: the lines are written twice.
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
