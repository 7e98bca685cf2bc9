! SPDX-License-Identifier: BSD-3-Clause
!> Forces that act beside the Hamiltonians of a model, [WHSB] (9)-(17) with r = q:
!>
!>    dq = H_p dt + sum_k H_{k,p} o dW_k,   dp = (-H_q + F) dt + sum_k (-H_{k,q} + f_k) o dW_k
!>
!> F(q,p,t) does the work F.dq, as friction and drag do, and f_k(q,p,t) is a force that multiplies a noise. Like
!> Hamiltonians they are asked for as one weighted sum, of F_0 = F and F_k = f_k. With the weights of a step it is what
!> the discrete Lagrange-d'Alembert principle adds to -Hhat_q (docs/forces.md), Fhat = h F + sum_k dW_k f_k.
!>
!> A force of one's own extends force_type, as a model extends model_type: it says in `traits` what acts, and gives
!> `find`. Each lane must be computed from its own numbers alone; several threads ask at once.
module symsde_model_forces
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: force_traits
   implicit none
   private
   public :: force_type, force_difference

   !> Step of a central difference, relative to the larger of the state and one.
   real(wp), parameter :: reach = epsilon(1.0_wp)**(1.0_wp/3)

   !> Immutable once constructed, as a model is.
   type, abstract :: force_type
      type(force_traits) :: traits
   contains
      procedure(find_interface), deferred :: find
      procedure :: derivative => differences
      procedure, non_overridable :: differences
      procedure :: along
      procedure :: bands
   end type force_type

   abstract interface
      !> Fhat = sum_j w_j F_j.
      subroutine find_interface(self, nlane, ndof, nnoise, t, w, q, p, f, code)
         import :: force_type, wp
         class(force_type), intent(in) :: self
         integer, intent(in) :: nlane, ndof, nnoise
         real(wp), intent(in) :: t                          !! time [time]
         real(wp), intent(in) :: w(nlane, 0:nnoise)         !! weights of F, f_1 .. f_m
         real(wp), intent(in) :: q(nlane, ndof), p(nlane, ndof)
         real(wp), intent(out) :: f(nlane, ndof)
         integer, intent(out) :: code                       !! 0, or why the force is refused, which ends the run
      end subroutine find_interface
   end interface

contains

   !> Derivatives of Fhat, fq(:, i, j) = dFhat_i/dq_j and fp(:, i, j) = dFhat_i/dp_j. Default: central differences.
   subroutine differences(self, nlane, ndof, nnoise, t, w, q, p, fq, fp, code)
      class(force_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: fq(nlane, ndof, ndof), fp(nlane, ndof, ndof)
      integer, intent(out) :: code
      real(wp), allocatable :: v(:, :), zero(:, :)
      integer :: j

      allocate (v(nlane, ndof), zero(nlane, ndof), source=0.0_wp)
      do j = 1, ndof
         v(:, j) = 1
         call force_difference(self, nlane, ndof, nnoise, t, w, q, p, v, zero, fq(:, :, j), code)
         if (code == 0) call force_difference(self, nlane, ndof, nnoise, t, w, q, p, zero, v, fp(:, :, j), code)
         if (code /= 0) exit
         v(:, j) = 0
      end do
      if (code /= 0) fq = 0
      if (code /= 0) fp = 0
   end subroutine differences

   !> The derivative of Fhat along (vq, vp).
   subroutine along(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, u, code)
      class(force_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: vq(nlane, ndof), vp(nlane, ndof)
      real(wp), intent(out) :: u(nlane, ndof)
      integer, intent(out) :: code
      real(wp), allocatable :: fq(:, :, :), fp(:, :, :)
      integer :: i, j

      if (.not. self%traits%has_derivative) then
         call force_difference(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, u, code)
         return
      end if
      allocate (fq(nlane, ndof, ndof), fp(nlane, ndof, ndof))
      call self%derivative(nlane, ndof, nnoise, t, w, q, p, fq, fp, code)
      ! One product at a time: of two in a sum the compiler may contract either one.
      u = 0
      do j = 1, ndof
         do i = 1, ndof
            u(:, i) = u(:, i) + fq(:, i, j)*vq(:, j)
            u(:, i) = u(:, i) + fp(:, i, j)*vp(:, j)
         end do
      end do
   end subroutine along

   !> The bands -b .. b of both derivatives, fq(:, d, i) = dFhat_i/dq_{i+d} and fp likewise, where no component depends
   !> on q_j or p_j further away: central differences by every (2b+1)-th coordinate at once.
   subroutine bands(self, nlane, ndof, nnoise, b, t, w, q, p, fq, fp, code)
      class(force_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise, b
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: fq(nlane, -b:b, ndof), fp(nlane, -b:b, ndof)
      integer, intent(out) :: code
      real(wp), allocatable, dimension(:, :) :: v, zero, u
      integer :: first, i, j

      allocate (v(nlane, ndof), zero(nlane, ndof), u(nlane, ndof), source=0.0_wp)
      fq = 0
      fp = 0
      do first = 1, min(2*b + 1, ndof)
         v(:, first::2*b + 1) = 1
         call force_difference(self, nlane, ndof, nnoise, t, w, q, p, v, zero, u, code)
         if (code /= 0) return
         do j = first, ndof, 2*b + 1
            do i = max(1, j - b), min(ndof, j + b)
               fq(:, j - i, i) = u(:, i)
            end do
         end do
         if (.not. self%traits%in_position()) then
            call force_difference(self, nlane, ndof, nnoise, t, w, q, p, zero, v, u, code)
            if (code /= 0) return
            do j = first, ndof, 2*b + 1
               do i = max(1, j - b), min(ndof, j + b)
                  fp(:, j - i, i) = u(:, i)
               end do
            end do
         end if
         v(:, first::2*b + 1) = 0
      end do
   end subroutine bands

   !> Central difference along (vq, vp): no component moves further than `reach` times the larger of it and one.
   subroutine force_difference(self, nlane, ndof, nnoise, t, w, q, p, vq, vp, u, code)
      class(force_type), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(in) :: vq(nlane, ndof), vp(nlane, ndof)
      real(wp), intent(out) :: u(nlane, ndof)
      integer, intent(out) :: code
      real(wp), allocatable :: qe(:, :), pe(:, :), lower(:, :)
      real(wp) :: e(nlane)
      integer :: i

      allocate (qe(nlane, ndof), pe(nlane, ndof), lower(nlane, ndof))
      e = 0
      do i = 1, ndof
         e = max(e, abs(vq(:, i))/max(1.0_wp, abs(q(:, i))), abs(vp(:, i))/max(1.0_wp, abs(p(:, i))))
      end do
      e = reach/(e + merge(0.0_wp, 1.0_wp, e > 0))  ! a sum: of two divisors the compiler may try both
      do i = 1, ndof
         qe(:, i) = q(:, i) - e*vq(:, i)
         pe(:, i) = p(:, i) - e*vp(:, i)
      end do
      call self%find(nlane, ndof, nnoise, t, w, qe, pe, lower, code)
      if (code /= 0) then
         u = 0
         return
      end if
      do i = 1, ndof
         qe(:, i) = q(:, i) + e*vq(:, i)
         pe(:, i) = p(:, i) + e*vp(:, i)
      end do
      call self%find(nlane, ndof, nnoise, t, w, qe, pe, u, code)
      do i = 1, ndof
         u(:, i) = (u(:, i) - lower(:, i))/(2*e)
      end do
   end subroutine force_difference

end module symsde_model_forces
