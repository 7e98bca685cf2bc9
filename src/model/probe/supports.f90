! SPDX-License-Identifier: BSD-3-Clause
!>    sum_{k in S} w_k H_k depends on q_i or p_i  =>  some k in S touches i
!>
!> The probe of what noises touch (touches). Few noises are tested one by one. Of many noises sums over fixed halves S
!> of them are tested, and over the other halves: a noise that touches more than it says is found unless a noise that
!> touches the same degree of freedom is in the same half, every time.
!>
!> Private to its family.
module symsde_model_probe_supports
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, false_trait
   use symsde_base_text, only: to_text
   use symsde_model_probe_points, only: probe_points, nlane, finding, generic, worst
   implicit none
   private
   public :: probe_supports

   integer, parameter :: most_alone = 32  !! noises up to which each is tested
   integer, parameter :: nhalf = 16       !! halves of more noises, each with its other half

contains

   !> Refuse supports that a gradient refutes (false_trait).
   subroutine probe_supports(points, tolerance, error)
      type(probe_points), intent(inout) :: points
      real(wp), intent(in) :: tolerance  !! part of the gradient that counts as rounding
      type(error_type), allocatable, intent(inout) :: error
      integer :: k, half

      if (points%nnoise <= most_alone) then
         do k = 1, points%nnoise
            points%w = 0
            points%w(:, k) = 1
            call probe_sum(points, 'H_'//to_text(k), tolerance, error)
         end do
         return
      end if
      do half = 1, 2*nhalf
         points%w = 0
         do k = 1, points%nnoise
            ! The sign of an irregular number decides which half has noise k; an odd half and the next one together have
            ! all noises.
            if ((generic(k, 11 + (half + 1)/2) > 0) .eqv. mod(half, 2) == 0) points%w(:, k) = generic(k + 1, 1)
         end do
         call probe_sum(points, 'a sum of noises', tolerance, error)
      end do
   end subroutine probe_supports

   !> Test that the gradient of the sum vanishes in all degrees of freedom that none of its noises touches.
   subroutine probe_sum(points, name, tolerance, error)
      type(probe_points), intent(in) :: points
      character(*), intent(in) :: name
      real(wp), intent(in) :: tolerance
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable :: hq(:, :), hp(:, :)
      real(wp) :: scale(nlane), x
      logical, allocatable :: touched(:)
      type(finding) :: bad
      integer :: k

      if (allocated(error)) return
      call points%gradient(hq, hp, scale)
      allocate (touched(points%ndof), source=.false.)
      do k = 1, points%nnoise
         if (.not. abs(points%w(1, k)) > 0) cycle
         associate (touches => points%model%traits%touches)
            touched(touches%dof(touches%from(k) + 1:touches%from(k + 1))) = .true.
         end associate
      end do
      do k = 1, points%ndof
         if (.not. touched(k)) cycle
         hq(:, k) = 0
         hp(:, k) = 0
      end do
      call worst(hq, hp, scale, tolerance, bad)
      if (bad%lane == 0) return
      x = merge(hq(bad%lane, bad%i), hp(bad%lane, bad%i), bad%half == 1)
      call raise(error, false_trait, 'probe_model', 'model '''//points%model%name//''' declares which degrees of '// &
                 'freedom noises touch (touches), but the derivative of '//name//' by '// &
                 merge('q_', 'p_', bad%half == 1)//to_text(bad%i)//', which it does not touch, is '//to_text(x)// &
                 ' at '//points%place(bad%lane, bad%i, bad%i)//'; add the number to the list of the noise, or '// &
                 'declare none')
   end subroutine probe_sum

end module symsde_model_probe_supports
