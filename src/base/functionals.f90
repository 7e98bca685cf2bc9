! SPDX-License-Identifier: BSD-3-Clause
!> The functionals of the path over a step that a scheme may need in addition to the increments dW_k:
!>
!>    path_dz      dZ_k = int_t^{t+h} (W_k(s) - W_k(t)) ds                          one per noise  [time^(3/2)]
!>    path_areas   A_kl = 1/2 int (W_k o dW_l - W_l o dW_k), k < l, at area_index   one per pair   [time]
!>    path_stt_area    K_k = int (s^2 - s + 1/6) dW_k /2, s = time in the step over h   one per noise  [time^(1/2)]
!>    path_magnus  J_kl = int W_k (dW_l - W_l) ds, symmetrised, k <= l, pair_index  one per pair   [time^2]
!>                 (in a set with the pairs that meet: one for each of these, in their order)
!>    path_decay   D_k = int phi(t + h - s) dW_k(s), phi(u) = (1 - exp(-gamma u))/gamma one per noise  [time^(3/2)]
!>
!> (K is the space-time-time Levy area, J the second Magnus term of kicks between drifts; both also need dZ. D is dZ for
!> momenta that decay by the rate gamma. It also needs dZ and K. Users know it as E = int exp(-gamma (t + h - s)) dW,
!> which is dW - gamma D.)
!>
!> Their names and numbers of columns are here, in base, because schemes, sources and steppers all use them;
!> noise/functionals draws and merges them. A new functional needs a name and a count here, a law in
!> noise/functionals, a scheme that declares it and a stepper that uses it.
module symsde_base_functionals
   use symsde_base_kinds, only: wp
   use symsde_base_supports, only: noise_pairs
   use symsde_base_traits, only: model_traits
   implicit none
   private
   public :: functional_set, functionals, functional_count, area_index, pair_index, name_functionals

   enum, bind(c)
      enumerator :: path_dz = 1
      enumerator :: path_areas = 2
      enumerator :: path_stt_area = 3
      enumerator :: path_magnus = 4
      enumerator :: path_decay = 5
   end enum
   public :: path_dz, path_areas, path_stt_area, path_magnus, path_decay

   integer, parameter, public :: nfunctional = 5

   character(len=*), parameter :: names(nfunctional) = [character(len=5) :: 'dZ', 'areas', 'K', 'J', 'E']

   !> A set of functionals.
   type :: functional_set
      logical :: has(nfunctional) = .false.
      real(wp) :: rate = 0   !! gamma of path_decay [1/time]
      type(noise_pairs) :: meeting     !! pairs k <= l that J is asked for; not allocated = all
   contains
      procedure :: count_of
      procedure :: next_pair
      procedure :: is_empty
      procedure :: columns
      procedure :: needed_for
   end type functional_set

contains

   !> Make the set of the functionals in a list, such as [path_dz, path_areas].
   pure type(functional_set) function functionals(list)
      integer, intent(in) :: list(:)

      functionals%has(list) = .true.
   end function functionals

   pure logical function is_empty(self)
      class(functional_set), intent(in) :: self

      is_empty = .not. any(self%has)
   end function is_empty

   !> Number of values for a path in a step: its increments and these functionals.
   pure integer function columns(self, nnoise)
      class(functional_set), intent(in) :: self
      integer, intent(in) :: nnoise      !! m
      integer :: f

      columns = nnoise
      do f = 1, nfunctional
         if (self%has(f)) columns = columns + self%count_of(f, nnoise)
      end do
   end function columns

   !> Number of values of a functional of this set for m noises.
   pure integer function count_of(self, functional, nnoise) result(n)
      class(functional_set), intent(in) :: self
      integer, intent(in) :: functional  !! path_dz, ..
      integer, intent(in) :: nnoise      !! m

      n = functional_count(functional, nnoise)
      if (functional == path_magnus .and. allocated(self%meeting%k)) n = size(self%meeting%k)
   end function count_of

   !> Pair kl of those that J is asked for, from pair kl - 1, which is (0, 0) before the first.
   pure subroutine next_pair(self, kl, k, l)
      class(functional_set), intent(in) :: self
      integer, intent(in) :: kl
      integer, intent(inout) :: k, l

      if (allocated(self%meeting%k)) then
         k = self%meeting%k(kl)
         l = self%meeting%l(kl)
      else if (k < l) then
         k = k + 1
      else
         k = 1
         l = l + 1
      end if
   end subroutine next_pair

   !> The functionals that have an effect for a model with these traits. Areas multiply brackets {H_l,H_k}, which
   !> are constant for additive noise and vanish for noise in position, and between noises that touch no degree of
   !> freedom together; J multiplies H_k,q . H_l,q, constant for additive noise without forces and zero for noises that
   !> do not meet; a silent noise has no functionals.
   pure type(functional_set) function needed_for(self, traits)
      class(functional_set), intent(in) :: self
      type(model_traits), intent(in) :: traits
      integer :: nactive

      nactive = traits%nnoise
      if (allocated(traits%silent)) nactive = count(.not. traits%silent)
      needed_for%rate = self%rate
      needed_for%has = self%has .and. nactive > 0
      needed_for%has(path_areas) = self%has(path_areas) .and. nactive > 1 .and. &
                                   .not. (traits%additive .or. traits%position_noise .or. traits%are_apart())
      needed_for%has(path_magnus) = needed_for%has(path_magnus) .and. .not. traits%noise_is_constant()
      if (needed_for%has(path_magnus)) call traits%find_meetings(needed_for%meeting)
   end function needed_for

   !> Number of values of a functional for m noises.
   pure integer function functional_count(functional, nnoise)
      integer, intent(in) :: functional  !! path_dz, ..
      integer, intent(in) :: nnoise      !! m

      select case (functional)
      case (path_areas); functional_count = nnoise*(nnoise - 1)/2
      case (path_magnus); functional_count = nnoise*(nnoise + 1)/2
      case default; functional_count = nnoise
      end select
   end function functional_count

   !> Column of the area of noises k < l: (1,2), (1,3), (2,3), (1,4), ..
   pure integer function area_index(k, l)
      integer, intent(in) :: k, l  !! 1 <= k < l

      area_index = (l - 1)*(l - 2)/2 + k
   end function area_index

   !> Column of the pair of noises k <= l: (1,1), (1,2), (2,2), (1,3), ..
   pure integer function pair_index(k, l)
      integer, intent(in) :: k, l  !! 1 <= k <= l

      pair_index = l*(l - 1)/2 + k
   end function pair_index

   !> The set in words, such as "dZ and areas".
   pure subroutine name_functionals(set, text)
      type(functional_set), intent(in) :: set
      character(:), allocatable, intent(out) :: text
      integer :: i

      text = ''
      do i = 1, nfunctional
         if (.not. set%has(i)) cycle
         if (len(text) > 0) text = text//' and '
         text = text//trim(names(i))
      end do
   end subroutine name_functionals

end module symsde_base_functionals
