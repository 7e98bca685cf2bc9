! SPDX-License-Identifier: BSD-3-Clause
!>    Phi*_{h,dW} = (Phi_{-h,-dW})^-1,      Phi^m_{gamma_m (h,dW)} o .. o Phi^1_{gamma_1 (h,dW)},   sum_k gamma_k = 1
!>
!> New schemes from old ones: the adjoint, compositions of fractions of a step, the triple jump.
!>
!> All results are tableaux, so the general stepper executes them and certificates are computed. The parts of a
!> composition share the increments in proportion to their fractions of the step. The drift correction keeps its sign
!> for negative steps, so the adjoint's coefficient is computed from its own beta^T b e and has the opposite sign (the
!> adjoint of the one-sided scheme lambda is that of 1 - lambda).
module symsde_scheme_composition
   use symsde_base_contracts, only: contracts_are_executed
   use symsde_base_kinds, only: wp
   use symsde_base_lanes, only: is_finite_lane
   use symsde_base_laws, only: law_gaussian, law_text
   use symsde_base_status, only: error_type, raise, invalid_argument, incompatible, wrong_shape
   use symsde_base_text, only: to_text
   use symsde_scheme_contract, only: require_scheme
   use symsde_scheme_scheme, only: scheme_type, tableau_form, galerkin_form, ito_form, splitting_form, frame_none
   use symsde_scheme_properties, only: declare_properties, tableau_order
   implicit none
   private
   public :: adjoint_scheme, composed_scheme, symmetric_composition, triple_jump

   real(wp), parameter :: tolerance = 64*epsilon(1.0_wp)

contains

   !> The adjoint, the inverse map of a step back in time, Phi*_{h,dW} = (Phi_{-h,-dW})^{-1}: with
   !> i' = r+1-i, alpha*_j = alpha_j', c*_i = 1 - c_i', a*_ij = alpha_j' - a_i'j', and alike for
   !> abar, b, bbar.
   !> Errors: incompatible for Euler-Maruyama, whose Ito form has no such inverse.
   subroutine adjoint_scheme(scheme, base, error, name)
      type(scheme_type), intent(out) :: scheme  !! must not be the same variable as base
      type(scheme_type), intent(in) :: base
      type(error_type), allocatable, intent(inout) :: error
      character(*), intent(in), optional :: name  !! default: the name of base with _adjoint
      integer :: r, s

      if (base%form == ito_form) call raise(error, incompatible, 'adjoint_scheme', &
                                            "'"//base%name//"' steps the Ito form, which has no adjoint; "// &
                                            'take a scheme of the Stratonovich form')
      call check_plain('adjoint_scheme', base, error)
      if (allocated(error)) return
      if (contracts_are_executed) call require_scheme(base, 'scheme, adjoint')
      scheme = base
      ! Backwards in time the last stage comes first: i' = r + 1 - i.
      r = base%nstage
      s = base%degree
      scheme%c = 1 - base%c(r:1:-1)
      scheme%alpha = base%alpha(r:1:-1)
      scheme%beta = base%beta(r:1:-1)
      if (base%form == galerkin_form) then
         ! q_d(1 - t) has the control points in reversed order, and its slope has the other sign.
         scheme%basis(:, 0:s) = base%basis(r:1:-1, s:0:-1)
         scheme%slope(:, 0:s) = -base%slope(r:1:-1, s:0:-1)
      else
         call adjoint_matrix(base%a, base%alpha, scheme%a)
         call adjoint_matrix(base%abar, base%alpha, scheme%abar)
         call adjoint_matrix(base%b, base%beta, scheme%b)
         call adjoint_matrix(base%bbar, base%beta, scheme%bbar)
      end if
      scheme%name = base%name//'_adjoint'
      if (present(name)) scheme%name = trim(name)
      scheme%reference = 'adjoint of '//base%name
      ! The adjoint has the same order.
      call declare_properties(scheme, base%order_noise_free)
      if (contracts_are_executed) call require_scheme(scheme, 'scheme, adjoint')
   end subroutine adjoint_scheme

   !> a*_ij = alpha_j' - a_i'j'; zero if only rounding is left, so that explicit stages are recognised.
   pure subroutine adjoint_matrix(a, alpha, adjoint)
      real(wp), intent(in) :: a(:, :)   !! (nstage, nstage)
      real(wp), intent(in) :: alpha(:)  !! (nstage)
      real(wp), intent(out) :: adjoint(:, :)  !! (nstage, nstage)
      integer :: i, j, r

      r = size(alpha)
      do j = 1, r
         do i = 1, r
            ! The step back begins at the end of the step: a sum from the end to stage i is the whole sum less the
            ! sum from the start to stage i.
            adjoint(i, j) = alpha(r + 1 - j) - a(r + 1 - i, r + 1 - j)
            if (abs(adjoint(i, j)) < 8*epsilon(1.0_wp)) adjoint(i, j) = 0
         end do
      end do
   end subroutine adjoint_matrix

   !> One step made of a step of each part after the other, part k with the fraction gamma_k of h
   !> and of all increments. Block tableau: gamma_k a^k on the diagonal, gamma_l alpha^l in the
   !> columns of earlier parts l < k; weights gamma_k alpha^k; times sum_{l<k} gamma_l + gamma_k
   !> c^k.
   !> Errors: wrong_shape, invalid_argument (fractions), incompatible (a part that is no tableau).
   subroutine composed_scheme(scheme, parts, fractions, name, error)
      type(scheme_type), intent(out) :: scheme
      type(scheme_type), intent(in) :: parts(:)  !! schemes in the order in which they act (npart)
      real(wp), intent(in) :: fractions(:)       !! gamma_k, their sum is one (npart)
      character(*), intent(in) :: name
      type(error_type), allocatable, intent(inout) :: error
      integer :: k, first, order, r

      call check_parts(parts, fractions, error)
      if (allocated(error)) return
      ! The stages of part k follow the stages of earlier parts, in a lower block triangle.
      r = sum(parts%nstage)
      scheme%form = tableau_form
      scheme%nstage = r
      allocate (scheme%c(r), scheme%alpha(r), scheme%beta(r), source=0.0_wp)
      allocate (scheme%a(r, r), scheme%abar(r, r), scheme%b(r, r), scheme%bbar(r, r), source=0.0_wp)
      first = 0
      do k = 1, size(parts)
         if (contracts_are_executed) call require_scheme(parts(k), 'scheme, composition')
         call append_part(scheme, parts(k), first, sum(fractions(:k - 1)), fractions(k))
         first = first + parts(k)%nstage
      end do
      scheme%name = trim(name)
      scheme%reference = 'composition of '//parts(1)%name
      do k = 2, size(parts)
         scheme%reference = scheme%reference//', '//parts(k)%name
      end do
      ! Order conditions are known up to order four. If all parts have a higher order, the whole has at least the
      ! lowest order of the parts.
      order = max(tableau_order(scheme%a, scheme%abar, scheme%alpha), minval(parts%order_noise_free))
      call declare_properties(scheme, order)
      ! A symmetric scheme has even order: an odd one that is proven is exceeded.
      if (scheme%symmetric .and. mod(order, 2) == 1) call declare_properties(scheme, order + 1)
      if (contracts_are_executed) call require_scheme(scheme, 'scheme, composition')
   end subroutine composed_scheme

   !> Write the rows and columns of one part into the block tableau.
   pure subroutine append_part(scheme, part, first, start, fraction)
      type(scheme_type), intent(inout) :: scheme
      type(scheme_type), intent(in) :: part
      integer, intent(in) :: first      !! stages of the parts before
      real(wp), intent(in) :: start     !! fraction of the step before this part
      real(wp), intent(in) :: fraction  !! fraction of this part
      integer :: last, i

      ! The part takes the fraction `fraction` of time and of all increments: scale its matrices and weights.
      last = first + part%nstage
      scheme%c(first + 1:last) = start + fraction*part%c
      scheme%alpha(first + 1:last) = fraction*part%alpha
      scheme%beta(first + 1:last) = fraction*part%beta
      scheme%a(first + 1:last, first + 1:last) = fraction*part%a
      scheme%abar(first + 1:last, first + 1:last) = fraction*part%abar
      scheme%b(first + 1:last, first + 1:last) = fraction*part%b
      scheme%bbar(first + 1:last, first + 1:last) = fraction*part%bbar
      ! A stage of a later part begins where this part has ended: with alpha, the part's whole increment, instead of a.
      do i = last + 1, scheme%nstage
         scheme%a(i, first + 1:last) = fraction*part%alpha
         scheme%abar(i, first + 1:last) = fraction*part%alpha
         scheme%b(i, first + 1:last) = fraction*part%beta
         scheme%bbar(i, first + 1:last) = fraction*part%beta
      end do
   end subroutine append_part

   !> Parts must be tableaux driven by Gaussian increments, with finite fractions that sum to one.
   subroutine check_parts(parts, fractions, error)
      type(scheme_type), intent(in) :: parts(:)
      real(wp), intent(in) :: fractions(:)
      type(error_type), allocatable, intent(inout) :: error
      integer :: k

      if (size(parts) /= size(fractions) .or. size(parts) == 0) then
         call raise(error, wrong_shape, 'composed_scheme', 'there are '//to_text(size(parts))//' parts and '// &
                    to_text(size(fractions))//' fractions; give one fraction for each part, and at least one')
      else if (.not. all(is_finite_lane(fractions))) then
         call raise(error, invalid_argument, 'composed_scheme', 'a fraction of the step is not finite; '// &
                    'give finite fractions that sum to one')
      else if (abs(sum(fractions) - 1) > tolerance) then
         call raise(error, invalid_argument, 'composed_scheme', 'the fractions of the step sum to '// &
                    to_text(sum(fractions))//'; they must sum to one')
      else
         do k = 1, size(parts)
            if (parts(k)%form /= tableau_form) &
               call raise(error, incompatible, 'composed_scheme', "'"//parts(k)%name//"' is not a tableau; "// &
                          'only tableaux are composed into one scheme')
            call check_plain('composed_scheme', parts(k), error)
            ! gamma dW of a three-point dW is not an increment of a three-point law over gamma h.
            if (parts(k)%law /= law_gaussian) &
               call raise(error, incompatible, 'composed_scheme', "'"//parts(k)%name//"' is made for "// &
                          law_text(parts(k)%law)//' increments, whose parts have another law; compose '// &
                          'midpoint or gauss2')
         end do
      end if
   end subroutine check_parts

   !> Brackets and frames belong to a whole step: dZ and areas cannot be divided in proportion to time.
   subroutine check_plain(place, base, error)
      character(*), intent(in) :: place
      type(scheme_type), intent(in) :: base
      type(error_type), allocatable, intent(inout) :: error

      if (base%brackets%are_added() .or. .not. base%asks%is_empty() .or. &
          base%frame /= frame_none .or. base%needs%additive .or. base%form == splitting_form) &
         call raise(error, incompatible, place, "'"//base%name//"' uses more of the path than its "// &
                    'increments, is made for some noise alone or is not a tableau, and has no composition; '// &
                    'take a plain scheme such as midpoint or gauss2')
   end subroutine check_plain

   !> A half step of the scheme followed by a half step of its adjoint: symmetric, of even order. For (89)-(90) of
   !> [WHSB] the result is the Stoermer-Verlet scheme. Errors: the errors of adjoint_scheme and composed_scheme.
   subroutine symmetric_composition(scheme, base, error, name)
      type(scheme_type), intent(out) :: scheme  !! not the same variable as base
      type(scheme_type), intent(in) :: base
      type(error_type), allocatable, intent(inout) :: error
      character(*), intent(in), optional :: name  !! default: the name of base with _symmetric
      type(scheme_type) :: parts(2)
      character(:), allocatable :: own_name

      own_name = base%name//'_symmetric'
      if (present(name)) own_name = name
      parts(1) = base
      ! The map is Phi*_{h/2} o Phi_{h/2}: base acts first. Both halves get dW/2, so that their drift corrections
      ! cancel.
      call adjoint_scheme(parts(2), base, error)
      if (allocated(error)) return
      call composed_scheme(scheme, parts, [0.5_wp, 0.5_wp], own_name, error)
   end subroutine symmetric_composition

   !> Fractions g, 1-2g, g with g = 1/(2 - 2^{1/(p+1)}) of a symmetric scheme of even order p: order p+2 without
   !> noise (Yoshida 1990; Suzuki 1990; Misawa 2010 for stochastic systems). Errors: incompatible for a scheme that
   !> is not symmetric; the errors of composed_scheme.
   subroutine triple_jump(scheme, base, error, name)
      type(scheme_type), intent(out) :: scheme  !! not the same variable as base
      type(scheme_type), intent(in) :: base
      type(error_type), allocatable, intent(inout) :: error
      character(*), intent(in), optional :: name  !! default: the name of base with _triple_jump
      type(scheme_type) :: parts(3)
      character(:), allocatable :: own_name
      real(wp) :: g, fractions(3)

      ! Without symmetry the next error is of degree p + 2, and the order would be p + 1.
      if (.not. base%symmetric) call raise(error, incompatible, 'triple_jump', "'"//base%name// &
                                           "' is not symmetric, and the triple jump would not raise its order; "// &
                                           'compose it with its adjoint first (symmetric_composition)')
      if (allocated(error)) return
      ! The fractions are g, 1 - 2 g, g.
      own_name = base%name//'_triple_jump'
      if (present(name)) own_name = name
      ! 2 g^(p+1) + (1 - 2 g)^(p+1) = 0 removes the leading error, of degree p + 1. The middle part goes back in time,
      ! as 1 - 2 g < 0, and back along the path: its increments have the sign of its fraction.
      g = 1/(2 - 2**(1.0_wp/(base%order_noise_free + 1)))
      fractions = g
      fractions(2) = 1 - 2*g
      parts(1) = base
      parts(2) = base
      parts(3) = base
      call composed_scheme(scheme, parts, fractions, own_name, error)
      if (allocated(error)) return
      ! composed_scheme derives orders up to four from the conditions; higher orders are known by construction.
      call declare_properties(scheme, base%order_noise_free + 2)
   end subroutine triple_jump

end module symsde_scheme_composition
