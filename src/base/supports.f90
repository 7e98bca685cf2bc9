! SPDX-License-Identifier: BSD-3-Clause
!> The degrees of freedom that noises touch, and sets of noises that do not meet.
!>
!> Noise k touches i if H_k depends on q_i or p_i. Two noises meet if both touch one degree of freedom, or if the mass
!> ties one of the first to one of the second: of noises in position that do not meet H_k,q . M^-1 H_l,q = 0, so that
!>
!>    sum_kl D_kl Hess H_k M^-1 H_l,q = Hess F(1) M^-1 F_q(D_kk),   F(x) = sum_k x_k H_k
!>
!> by one gradient and one product for any number of noises. Noises that meet are sorted into colours: noises of one
!> colour do not meet.
module symsde_base_supports
   implicit none
   private
   public :: noise_supports, noise_colours, sort_noises

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

contains

   !> Whether supports are declared; else every noise may touch everything.
   pure logical function are_given(self)
      class(noise_supports), intent(in) :: self

      are_given = allocated(self%from)
   end function are_given

   !> Sort noises into colours: each takes the first colour without a noise that touches one of its degrees of freedom.
   !> Where supports are not declared, or the mass may tie everything to everything, every noise has its own colour, in
   !> the order of noises.
   pure subroutine sort_noises(supports, noises, ndof, tied, colours)
      type(noise_supports), intent(in) :: supports
      integer, intent(in) :: noises(:)      !! noises to sort, in rising order
      integer, intent(in) :: ndof
      logical, intent(in) :: tied           !! the mass is not known to be diagonal
      type(noise_colours), intent(out) :: colours
      integer :: colour(size(noises)), last(ndof)
      integer :: c, i, k

      if (tied .or. .not. supports%are_given()) then
         colour = [(i, i=1, size(noises))]
      else
         colour = 0
         c = 0
         ! last(i): the newest colour of a noise that touches i. Colours are filled one after the other.
         last = 0
         do while (any(colour == 0))
            c = c + 1
            do k = 1, size(noises)
               if (colour(k) > 0) cycle
               associate (dof => supports%dof(supports%from(noises(k)) + 1:supports%from(noises(k) + 1)))
                  if (any(last(dof) == c)) cycle
                  last(dof) = c
               end associate
               colour(k) = c
            end do
         end do
      end if
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

end module symsde_base_supports
