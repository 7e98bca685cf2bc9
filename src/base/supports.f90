! SPDX-License-Identifier: BSD-3-Clause
!> The degrees of freedom that noises touch, and sets of noises that do not meet.
!>
!> Noise k touches i if H_k depends on q_i or p_i. Two noises meet if both touch one degree of freedom, or if the mass
!> ties one of the first to one of the second: of noises in position that do not meet H_k,q . M^-1 H_l,q = 0, so that
!>
!>    sum_kl D_kl Hess H_k M^-1 H_l,q = Hess F(1) M^-1 F_q(D_kk),   F(x) = sum_k x_k H_k
!>
!> by one gradient and one product for any number of noises. Noises that meet are sorted into colours. Those of one
!> colour do not meet: enough where D is diagonal. Where it is not, none of one colour meets a noise that another one of
!> it meets, so that each l has one k(l) at most in a colour C, and the sum over k in C and all l is
!> Hess F(1_C) M^-1 F_q(D_{k(l) l}).
module symsde_base_supports
   implicit none
   private
   public :: noise_supports, noise_colours, noise_pairs, sort_noises, find_pairs, all_pairs, find_noises_at

   integer, parameter :: most_listed = 2**22  !! pairs above which all are taken

   type :: noise_supports
      integer, allocatable :: from(:)  !! noise k touches dof(from(k) + 1) .. dof(from(k+1)) (nnoise + 1)
      integer, allocatable :: dof(:)   !! degrees of freedom, from 1
   contains
      procedure :: are_given
   end type noise_supports

   type :: noise_colours
      integer :: n = 0                 !! number of colours
      integer, allocatable :: from(:)  !! colour c has noise(from(c) + 1) .. noise(from(c+1)) (n + 1)
      integer, allocatable :: noise(:) !! noises by colour, without noises that are left out
   end type noise_colours

   !> Pairs of noises k <= l.
   type :: noise_pairs
      integer, allocatable :: k(:), l(:)
   end type noise_pairs

contains

   !> Whether supports are declared; else every noise may touch everything.
   pure logical function are_given(self)
      class(noise_supports), intent(in) :: self

      are_given = allocated(self%from)
   end function are_given

   !> The pairs of noises k <= l that meet, since both touch a degree of freedom, ordered by l and then by k. Without
   !> supports, or if there are too many to list, pairs stay not allocated, which means all.
   pure subroutine find_pairs(supports, nnoise, ndof, pairs)
      type(noise_supports), intent(in) :: supports
      integer, intent(in) :: nnoise, ndof
      type(noise_pairs), intent(out) :: pairs
      type(noise_supports) :: at
      logical :: meets(nnoise)
      integer :: pass, i, k, l, n

      if (.not. supports%are_given()) return
      call find_noises_at(supports, nnoise, ndof, at)
      ! The first pass counts.
      do pass = 1, 2
         n = 0
         do l = 1, nnoise
            meets(:l) = .false.
            meets(l) = .true.
            do i = supports%from(l) + 1, supports%from(l + 1)
               associate (dof => supports%dof(i))
                  meets(at%dof(at%from(dof) + 1:at%from(dof + 1))) = .true.
               end associate
            end do
            do k = 1, l
               if (.not. meets(k)) cycle
               n = n + 1
               if (pass == 1) cycle
               pairs%k(n) = k
               pairs%l(n) = l
            end do
            if (n > most_listed) return
         end do
         if (pass == 1) allocate (pairs%k(n), pairs%l(n))
      end do
   end subroutine find_pairs

   !> All pairs of noises k <= l.
   pure subroutine all_pairs(nnoise, pairs)
      integer, intent(in) :: nnoise
      type(noise_pairs), intent(out) :: pairs
      integer :: k, l

      pairs%k = [((k, k=1, l), l=1, nnoise)]
      pairs%l = [((l, k=1, l), l=1, nnoise)]
   end subroutine all_pairs

   !> The noises that touch each degree of freedom, as lists with the parts of noises and degrees of freedom exchanged.
   pure subroutine find_noises_at(supports, nnoise, ndof, at)
      type(noise_supports), intent(in) :: supports
      integer, intent(in) :: nnoise, ndof
      type(noise_supports), intent(out) :: at
      integer :: next(ndof), i, k

      allocate (at%from(ndof + 1), source=0)
      allocate (at%dof(size(supports%dof)))
      do i = 1, size(supports%dof)
         at%from(supports%dof(i) + 1) = at%from(supports%dof(i) + 1) + 1
      end do
      do i = 1, ndof
         at%from(i + 1) = at%from(i) + at%from(i + 1)
      end do
      next = at%from(:ndof)
      do k = 1, nnoise
         do i = supports%from(k) + 1, supports%from(k + 1)
            associate (dof => supports%dof(i))
               next(dof) = next(dof) + 1
               at%dof(next(dof)) = k
            end associate
         end do
      end do
   end subroutine find_noises_at

   !> Sort noises into colours: each takes the first colour of whose noises it meets none or, if `far`, of whose noises
   !> none meets a noise that it meets. Noises also meet if degrees of freedom i and j that they touch have |i - j| <=
   !> reach. Without supports every noise has its own colour, in the order of noises.
   pure subroutine sort_noises(supports, noises, nnoise, ndof, far, reach, colours)
      type(noise_supports), intent(in) :: supports
      integer, intent(in) :: noises(:)      !! those that are sorted, in rising order
      integer, intent(in) :: nnoise, ndof
      logical, intent(in) :: far
      integer, intent(in) :: reach          !! >= 0
      type(noise_colours), intent(out) :: colours
      type(noise_supports) :: at
      integer :: colour(size(noises)), last(ndof)
      integer :: c, i, k

      if (.not. supports%are_given()) then
         colours%n = size(noises)
         colours%from = [(i, i=0, size(noises))]
         colours%noise = noises
         return
      end if
      if (far) call find_noises_at(supports, nnoise, ndof, at)
      colour = 0
      c = 0
      ! last(i): the newest colour that i excludes. Colours are filled one after the other.
      last = 0
      do while (any(colour == 0))
         c = c + 1
         do k = 1, size(noises)
            if (colour(k) > 0) cycle
            associate (dof => supports%dof(supports%from(noises(k)) + 1:supports%from(noises(k) + 1)))
               if (any(last(dof) == c)) cycle
               do i = 1, size(dof)
                  last(max(dof(i) - reach, 1):min(dof(i) + reach, ndof)) = c
               end do
               if (far) call exclude_around(supports, at, dof, c, last)
            end associate
            colour(k) = c
         end do
      end do
      colours%n = maxval([0, colour])
      allocate (colours%from(colours%n + 1), colours%noise(size(noises)))
      colours%from(1) = 0
      do c = 1, colours%n
         associate (before => colours%from(c), members => pack(noises, colour == c))
            colours%noise(before + 1:before + size(members)) = members
            colours%from(c + 1) = before + size(members)
         end associate
      end do
   end subroutine sort_noises

   !> Let all degrees of freedom of noises that touch one of `dof` exclude colour c.
   pure subroutine exclude_around(supports, at, dof, c, last)
      type(noise_supports), intent(in) :: supports, at
      integer, intent(in) :: dof(:), c
      integer, intent(inout) :: last(:)
      integer :: i, j

      do i = 1, size(dof)
         do j = at%from(dof(i)) + 1, at%from(dof(i) + 1)
            associate (k => at%dof(j))
               last(supports%dof(supports%from(k) + 1:supports%from(k + 1))) = c
            end associate
         end do
      end do
   end subroutine exclude_around

end module symsde_base_supports
