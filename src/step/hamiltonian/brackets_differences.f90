! SPDX-License-Identifier: BSD-3-Clause
!> The nested brackets of step/hamiltonian/brackets for models without third derivatives. With u, v the fields of F/h
!> and H_k, (H_p, -H_q) and (H_k,p, -H_k,q), and H for F/h, {{H,H_k},H_k} = H''[v,v] - H_k''[u,v] is replaced by
!>
!>    [H(x+bv) + H(x-bv) - 2H(x)]/b^2
!>    - [H_k(x+au+bv) + H_k(x-au-bv) - H_k(x+au-bv) - H_k(x-au+bv)]/(4ab),   a = r |h|, b = r sqrt|h|
!>
!> differences over r times the step's own displacements by drift and by noise. This expression differs from the bracket
!> by O(h), below the orders in question, and rounding is divided by b^2 but multiplied by h^2. It is a function of x,
!> whose exact gradient is added, so that a symplectic scheme remains symplectic.
!>
!> Private to its family.
module symsde_step_hamiltonian_brackets_differences
   use symsde_base_kinds, only: wp
   use symsde_model_abstract, only: model_type
   use symsde_step_hamiltonian_brackets_exact, only: exact_bracket, new_exact_bracket
   implicit none
   private
   public :: difference_bracket, new_difference_bracket

   real(wp), parameter :: reach = 0.5_wp  !! r: differences reach over this part of the step's displacements

   !> The fields u, v, the products and the counters come from exact_bracket; (xq, xp) is a displaced point, (sq, sp)
   !> the sum of all parts.
   type, extends(exact_bracket) :: difference_bracket
      real(wp), allocatable :: nested(:, :)       !! weights of F/h (nlane, 0:nnoise)
      real(wp), allocatable :: g(:, :)            !! weights of a sum (nlane, 0:nnoise)
      real(wp), allocatable, dimension(:, :) :: sq, sp, xp  !! (nlane, ndof)
   contains
      procedure :: add_shifts
      procedure :: add_differences
      procedure :: add_sum
   end type difference_bracket

contains

   !> Allocate for blocks of nlane lanes; F/h is H.
   subroutine new_difference_bracket(self, model, nlane)
      class(difference_bracket), intent(inout) :: self
      class(model_type), intent(in), target :: model
      integer, intent(in) :: nlane

      call new_exact_bracket(self, model, nlane)
      associate (n => self%ndof, m => self%nnoise)
         allocate (self%g(nlane, 0:m), self%nested(nlane, 0:m), source=0.0_wp)
         self%nested(:, 0) = 1
         allocate (self%sq(nlane, n), self%sp(nlane, n), self%xp(nlane, n))
      end associate
   end subroutine new_difference_bracket

   !> Additive noise: the fields v are constant, so {{H,H_k},H_k} = H''[v,v], and a second difference of H along v
   !> suffices: c sum_k [H(x+bv) + H(x-bv) - 2 H(x)] with c = (h|h|/12)/b^2.
   subroutine add_shifts(self, t, h, q, p)
      class(difference_bracket), intent(inout) :: self
      real(wp), intent(in) :: t, h
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)
      real(wp) :: b, c
      integer :: k

      ! A displacement b v is about r times that of the noise in a step: v is as large as the field, and dW as sqrt|h|.
      b = reach*sqrt(abs(h))
      c = h/(12*reach**2)
      self%g = 0
      self%g(:, 0) = 1
      call self%add_sum(t, q, p, 0.0_wp, 0.0_wp, -2*c*self%colours%n) ! the middle terms of all differences together
      do k = 1, self%colours%n
         call self%field_of_colour(t, k, q, p)
         call self%add_sum(t, q, p, 0.0_wp, b, c)
         call self%add_sum(t, q, p, 0.0_wp, -b, c)
      end do
   end subroutine add_shifts

   !> The general case, with H and u of F/h. With G(e,f) = grad H_k at x + e u + f v, and correspondingly g(f) of H at x
   !> + f v, the sum is
   !>
   !>    c [g(b) + g(-b) - 2 g(0)] + (Dv)^T c b [g(b) - g(-b)]                     c = (h|h|/12)/b^2
   !>    - c' sum_{s,r=+-1} s r [1 + s a (Du)^T + r b (Dv)^T] G(s a, r b)          c' = (h|h|/12)/(4ab)
   !>
   !> where (Dv)^T y = Hess H_k (-y_p, y_q). The terms with Du and Dv occur since the points depend on q and p: with
   !> them the sum is the gradient of a function; without them it would be none, and the step not symplectic. The
   !> arguments of (Dv)^T are collected in (rq, rp), those of (Du)^T in (yq, yp): one Hessian-vector product for every
   !> noise, and one for H at the end.
   subroutine add_differences(self, t, h, q, p)
      class(difference_bracket), intent(inout) :: self
      real(wp), intent(in) :: t, h
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)
      real(wp) :: a, b, c, c2
      integer :: k

      ! Displacements a along u are r times that by drift, displacements b along v r times that by noise.
      a = reach*abs(h)
      b = reach*sqrt(abs(h))
      c = h/(12*reach**2)
      c2 = h*abs(h)/(48*a*b)
      call self%field_of_sum(t, self%nested, q, p, self%uq, self%up)
      self%yq = 0
      self%yp = 0
      do k = 1, self%colours%n
         call self%field_of_colour(t, k, q, p)
         self%rq = 0
         self%rp = 0
         call second_difference(self, t, b, c, q, p)
         call mixed_difference(self, t, a, b, c2, q, p)
         ! (Dv)^T is linear, so its arguments from both differences are collected first.
         call self%add_transposed(t, self%f, self%rq, self%rp, q, p, self%sq, self%sp)
      end do
      call self%add_transposed(t, self%nested, self%yq, self%yp, q, p, self%sq, self%sp)
      ! -2c sum_k grad H, from the field of H
      self%sq = self%sq + (2*c*self%colours%n)*self%up
      self%sp = self%sp - (2*c*self%colours%n)*self%uq
   end subroutine add_differences

   !> Add c [g(b) + g(-b)] to (sq, sp), and store c b [g(b) - g(-b)], for the field of H_k, in (rq, rp).
   subroutine second_difference(self, t, b, c, q, p)
      class(difference_bracket), intent(inout) :: self
      real(wp), intent(in) :: t, b, c
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)
      integer :: sign

      ! g is the gradient of F/h, with separate weights.
      self%g = self%nested
      do sign = -1, 1, 2
         call self%add_sum(t, q, p, 0.0_wp, sign*b, c)
         self%rq = self%rq + (sign*c*b)*self%gq
         self%rp = self%rp + (sign*c*b)*self%gp
      end do
   end subroutine second_difference

   !> Add the four gradients of H_k, -c s r G(s a, r b); add the terms of the fields, -c r a G for Du and -c s b G
   !> for Dv, to (yq, yp) and (rq, rp).
   subroutine mixed_difference(self, t, a, b, c, q, p)
      class(difference_bracket), intent(inout) :: self
      real(wp), intent(in) :: t, a, b, c
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)
      integer :: s, r

      ! G is the gradient of H_k alone, at the four corners of x + s a u + r b v.
      self%g = self%f
      do r = -1, 1, 2
         do s = -1, 1, 2
            call self%add_sum(t, q, p, s*a, r*b, -s*r*c)
            self%yq = self%yq - (r*a*c)*self%gq
            self%yp = self%yp - (r*a*c)*self%gp
            self%rq = self%rq - (s*b*c)*self%gq
            self%rp = self%rp - (s*b*c)*self%gp
         end do
      end do
   end subroutine mixed_difference

   !> (gq, gp) = gradient of the sum with weights g at x + e u + f v; c times it is added to (sq, sp). If e or f is
   !> zero, the field is not read, since it may be undefined.
   subroutine add_sum(self, t, q, p, e, f, c)
      class(difference_bracket), intent(inout) :: self
      real(wp), intent(in) :: t, e, f, c
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)

      ! The points are formed in copies, since the caller needs the same x for further points.
      self%xq = q
      self%xp = p
      if (abs(e) > 0) then
         self%xq = self%xq + e*self%uq
         self%xp = self%xp + e*self%up
      end if
      if (abs(f) > 0) then
         self%xq = self%xq + f*self%vq
         self%xp = self%xp + f*self%vp
      end if
      call self%model%gradient(self%nlane, self%ndof, self%nnoise, t, self%g, self%xq, self%xp, self%gq, self%gp)
      self%ngradient = self%ngradient + 1
      self%sq = self%sq + c*self%gq
      self%sp = self%sp + c*self%gp
   end subroutine add_sum

end module symsde_step_hamiltonian_brackets_differences
