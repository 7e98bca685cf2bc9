! SPDX-License-Identifier: BSD-3-Clause
!>    additive        H_k linear in (q, p)          identity_mass   H = p.p/2 + U(t,q)
!>    position_noise  H_k(t,q)                      constant_mass   H = p.M^-1 p/2 + U(t,q)
!>    parts           flows of D and of sum_j w_j K_j,  H = D + K_0, K_k = H_k, {K_i, K_j} = 0
!>
!> Compare the needs of a scheme with the traits that a model declares.
module symsde_scheme_needs
   use symsde_base_traits, only: model_traits
   use symsde_scheme_scheme, only: scheme_type
   implicit none
   private
   public :: find_missing, find_beside, by_parts

contains

   !> The first need that the traits do not meet, in words; not allocated if all are met. Without noise every need
   !> concerning noise is met.
   pure subroutine find_missing(scheme, traits, missing)
      type(scheme_type), intent(in) :: scheme
      type(model_traits), intent(in) :: traits
      character(:), allocatable, intent(out) :: missing
      logical :: noisy, will_do, splits, turns
      character(*), parameter :: no_square = 'kicks by functions of q, of which brackets {K_i, {K_j, D}} with a '// &
                                 'quadratic part D are such functions again: for functions K of '// &
                                 'the actions (q_i^2 + p_i^2)/2 they are none'
      character(*), parameter :: no_bond = 'noises that are linear in the actions (q_i^2 + p_i^2)/2 (trait '// &
                                 'phase_noise), of which brackets {K_i, {K_j, D}} are bonds of the '// &
                                 'quadratic part D: with others strong order 3/2 stays'

      noisy = traits%nnoise > 0
      associate (needs => scheme%needs)
         if (by_parts(scheme, traits)) return
         if (.not. traits%has_gradient) then
            if (needs%parts_will_do .and. traits%has_parts) then
               missing = 'a system without forces, where flows of two parts of H (drift, kick) are all that is '// &
                         'given: forces do not commute with kicks'
            else if (needs%quadratic_will_do) then
               missing = 'brackets {K_i, {K_j, D}} of kicks and drift, for which it takes second derivatives D_pp '// &
                         'by the momenta: two flows (drift, kick) do not tell them'
            else
               missing = 'gradients of the Hamiltonians, and there are but flows of two parts of H (drift, kick)'
            end if
            return
         end if
         ! Galerkin schemes with more nodes than the degree accept noise in position, or additive noise on q as well if
         ! drift and noise have equal weights: then all nodes get the same velocity from the noise.
         will_do = .false.
         if (needs%additive_will_do) will_do = traits%additive .and. scheme%noise_coefficients_equal()
         turns = traits%kicks_of_actions .and. &
                 (needs%actions_will_do .or. (needs%phases_will_do .and. (traits%phase_noise .or. .not. noisy)))
         splits = needs%quadratic_will_do .and. allocated(traits%quadratic_part) .and. &
                  (turns .or. .not. traits%kicks_of_actions)
         if (needs%additive .and. noisy .and. .not. traits%additive) then
            missing = 'additive noise (trait additive)'
         else if (needs%quadratic_will_do .and. traits%kicks_of_actions .and. .not. turns) then
            missing = no_square
            if (needs%phases_will_do) missing = no_bond
         else if (needs%position_noise .and. noisy .and. .not. (traits%position_noise .or. will_do .or. turns)) then
            missing = 'noise that depends on q alone (trait position_noise)'
            if (needs%additive_will_do) &
               missing = missing//', or additive noise where drift and noise share their weights'
         else if (needs%position_noise .and. .not. traits%forces%noise_in_position) then
            missing = 'forces f_k of noises that depend on q and t alone'
            ! The needs below are of H itself, and hold without noise, too.
         else if (needs%identity_mass .and. .not. traits%identity_mass) then
            missing = 'H = p.p/2 + U(q) (trait identity_mass)'
         else if (needs%constant_mass .and. .not. (traits%has_constant_mass() .or. splits)) then
            missing = 'H = p.M^-1 p/2 + U(q) with a constant mass M (trait constant_mass, or identity_mass)'
            if (needs%quadratic_will_do) missing = missing//', or H = D(q,p) + U(q) with a quadratic D (split)'
         else if (needs%rotation .and. .not. allocated(traits%rotation)) then
            missing = 'the frequencies of the linear part of H (trait rotation)'
         end if
         if (allocated(missing) .and. allocated(needs%why)) missing = missing//', because '//needs%why
      end associate
   end subroutine find_missing

   !> What a model of two flows alone must get for the scheme, in words: a gradient, and the traits that it needs.
   pure subroutine find_beside(scheme, traits, beside)
      type(scheme_type), intent(in) :: scheme
      type(model_traits), intent(in) :: traits
      character(:), allocatable, intent(out) :: beside

      beside = 'a gradient, too'
      associate (needs => scheme%needs)
         if (traits%nnoise > 0 .and. needs%additive) then
            beside = beside//', and the trait additive'
         else if (traits%nnoise > 0 .and. needs%position_noise) then
            beside = beside//', and the trait position_noise'
         end if
         if (needs%identity_mass) then
            beside = beside//', and identity_mass'
         else if (needs%quadratic_will_do) then
            beside = beside//', and one of identity_mass, constant_mass and split'
         else if (needs%constant_mass) then
            beside = beside//', and identity_mass or constant_mass'
         end if
         if (needs%rotation) beside = beside//', and rotation'
      end associate
   end subroutine find_beside

   !> Whether flows of two parts of H, which the model gives, serve the scheme. Forces do not commute with kicks.
   pure logical function by_parts(scheme, traits)
      type(scheme_type), intent(in) :: scheme
      type(model_traits), intent(in) :: traits

      by_parts = scheme%needs%parts_will_do .and. traits%has_parts .and. .not. traits%forces%act()
   end function by_parts

end module symsde_scheme_needs
