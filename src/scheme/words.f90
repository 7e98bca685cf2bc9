! SPDX-License-Identifier: BSD-3-Clause
!>    A   q <- q + tau M^-1 p                                tau = h divided by the number of A
!>    B   p <- p - tau U_q                                   tau = h divided by the number of B
!>    O   p <- exp(-gamma tau) p - s sum_k x_k H_k,q         tau = h divided by the number of O
!>
!> Splittings of the Langevin equation as words, 'word:BAOAB', read from left to right: letters are flows of kinetic
!> energy, potential, and of damping with noise. x_k is the increment of the path that belongs to the O: dW_k, or for
!> two of them dW_k/2 +- sqrt(3) a_k, which are independent, of variance h/2, and sum to dW_k. With
!>
!>    s^2 = (1 - exp(-2 gamma tau))/(2 gamma tau)
!>
!> the noise of an O has its exact law, and follows the path to strong order one, without further normal numbers. A word
!> that reads the same from behind is a symmetric composition of flows that are exact, or exact in law: of weak order
!> two, and of order two without noise. Each O multiplies dp ^ dq by exp(-gamma tau); A and B keep it.
!>
!> 'gjf' is the scheme of Groenbech-Jensen and Farago (2013): half of force and noise, a drift of damped momenta, and
!> the other half at the new position,
!>
!>    P = (p - h U_q(q)/2 - W_q(q)/2)/(1 + z/2),   q' = q + h M^-1 P,   p' = (1 - z/2) P - h U_q(q')/2 - W_q(q')/2
!>
!> with z = gamma h and W = sum_k dW_k H_k. It is the tableau lobatto2 under the force F = -gamma p, by the discrete
!> principle of forces (docs/forces.md), where that is explicit. Its drift multiplies dp ^ dq by (1 - z/2)/(1 + z/2).
!>
!> As data a word is a list of kicks (scheme/kicks), one for each B and O, between free drifts: the O have a share of
!> the decay of the step, which comes before their noise.
module symsde_scheme_words
   use symsde_base_damping, only: decay_less_one
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, invalid_argument
   use symsde_scheme_kicks, only: kicks_type, new_kicks
   use symsde_scheme_orders, only: set_order, evidence_claimed, evidence_derived, additive_noise, commutative_noise, &
                                   weak_order
   use symsde_scheme_scheme, only: scheme_type
   use symsde_scheme_splitting, only: complete
   implicit none
   private
   public :: word_scheme, give_word_law, word_prefix

   character(*), parameter :: word_prefix = 'word:'
   character(*), parameter :: trapezoid = 'gjf'
   integer, parameter :: longest = 24   !! letters of a word

contains

   !> The scheme of a name 'word:..'; known is false for other names.
   subroutine word_scheme(scheme, name, known, error)
      type(scheme_type), intent(out) :: scheme
      character(*), intent(in) :: name
      logical, intent(out) :: known
      type(error_type), allocatable, intent(inout) :: error

      known = index(name, word_prefix) == 1 .or. name == trapezoid
      if (name == trapezoid) then
         call make_trapezoid(scheme)
      else if (known) then
         call read_word(scheme, name, trim(name(len(word_prefix) + 1:)), error)
      end if
   end subroutine word_scheme

   !> Kicks of dW alone at both ends, without the products that other kicks add for noises that are not linear: lobatto2
   !> has none.
   subroutine make_trapezoid(scheme)
      type(scheme_type), intent(inout) :: scheme
      type(kicks_type) :: kicks

      call new_kicks(kicks, [0.0_wp, 1.0_wp], [0.5_wp, 0.5_wp], share=[0.0_wp, 0.0_wp])
      kicks%rational = .true.
      call complete(scheme, trapezoid, kicks)
      scheme%needs%instead = 'lobatto2 with the force -gamma p'
      scheme%reference = 'Groenbech-Jensen, Farago 2013; [WHSB] (9)-(17) with Lobatto''s rule'
      scheme%order_noise_free = 2
      call set_order(scheme%order(additive_noise), 1.0_wp, evidence_derived)
      call set_order(scheme%order(commutative_noise), 1.0_wp, evidence_derived)
      call set_order(scheme%order(weak_order), 1.0_wp, evidence_derived)
   end subroutine make_trapezoid

   !> The kicks of a word, letter by letter.
   subroutine read_word(scheme, name, word, error)
      type(scheme_type), intent(inout) :: scheme
      character(*), intent(in) :: name, word
      type(error_type), allocatable, intent(inout) :: error
      type(kicks_type) :: kicks
      integer :: drifts, potentials, baths  ! how many A, B and O there are
      integer :: i, moved, kick, bath
      real(wp), allocatable, dimension(:) :: c, b, decay, gamma

      drifts = count_of('A')
      potentials = count_of('B')
      baths = count_of('O')
      if (verify(word, 'ABO') > 0 .or. min(drifts, potentials, baths) < 1 .or. baths > 2 .or. len(word) > longest) then
         call raise(error, invalid_argument, 'get_scheme', "'"//name//"' is no word of a splitting: write one or "// &
                    'more A (drift) and B (kick) and one or two O (damping with noise), as word:BAOAB, with at '// &
                    'most 24 letters')
         return
      end if
      allocate (c(potentials + baths), b(potentials + baths), decay(potentials + baths), gamma(potentials + baths), &
                source=0.0_wp)
      moved = 0
      kick = 0
      bath = 0
      do i = 1, len(word)
         if (word(i:i) == 'A') then
            moved = moved + 1
            cycle
         end if
         kick = kick + 1
         c(kick) = real(moved, wp)/drifts
         if (word(i:i) == 'B') then
            b(kick) = 1.0_wp/potentials
         else
            bath = bath + 1
            decay(kick) = 1.0_wp/baths
            if (baths == 2) gamma(kick) = merge(1, -1, bath == 1)*sqrt(3.0_wp)
         end if
      end do
      call new_kicks(kicks, c, b, gamma, decay=decay)
      call complete(scheme, name, kicks)
      scheme%reference = 'splitting of the Langevin equation; Leimkuhler, Matthews 2013'
      scheme%order_noise_free = merge(2, 1, scheme%symmetric)
      call set_order(scheme%order(additive_noise), 1.0_wp, evidence_derived)
      call set_order(scheme%order(commutative_noise), 1.0_wp, evidence_claimed)
      call set_order(scheme%order(weak_order), merge(2.0_wp, 1.0_wp, scheme%symmetric), evidence_derived)

   contains

      integer function count_of(letter)
         character(len=1), intent(in) :: letter
         integer :: j

         count_of = 0
         do j = 1, len(word)
            if (word(j:j) == letter) count_of = count_of + 1
         end do
      end function count_of

   end subroutine read_word

   !> Weights of the noise of a word where momenta decay, z = gamma h: s of each O.
   pure subroutine give_word_law(kicks, closed, z)
      type(kicks_type), intent(inout) :: kicks
      type(kicks_type), intent(in) :: closed  !! without decay
      real(wp), intent(in) :: z
      real(wp) :: s
      integer :: i

      do i = 1, size(closed%c)
         if (.not. abs(closed%decay(i)*z) > 0) cycle
         s = sqrt(-decay_less_one(2*closed%decay(i)*z)/(2*closed%decay(i)*z))
         kicks%beta(i) = s*closed%beta(i)
         kicks%gamma(i) = s*closed%gamma(i)
      end do
   end subroutine give_word_law

end module symsde_scheme_words
