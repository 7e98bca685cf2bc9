! SPDX-License-Identifier: BSD-3-Clause
!> The brackets of step/single_brackets where noise is in position and H = p^2/2 + U(q):
!>
!>    sum_k c_k H_k' p + (h|h|/12) sum_k H_k'^2 + sum_k (c_k/h) [H_k(t_1) - H_k(t_0)]
!>
!> A model that gives the derivatives of all H_j in q by one call is asked once for each point, and Newton's matrix is
!> exact. Others are asked for H_j one by one, and the matrix goes without H_k''' and without the last sum.
module symsde_step_position_brackets
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: step_record
   use symsde_base_sincos, only: sincos_one
   use symsde_model_abstract, only: angle_terms
   use symsde_step_angle_derivatives, only: angle_derivatives
   use symsde_step_modified_hamiltonian, only: modified_hamiltonian
   implicit none
   private
   public :: position_brackets, new_position_brackets

   type :: position_brackets
      private
      integer :: nlane = 0, nnoise = 0, ntime = 1
      real(wp), allocatable :: u(:, :, :, :)  !! where one call gives all derivatives (nlane, 3, 0:nnoise, ntime)
      real(wp), allocatable :: unit(:, :, :)  !! elsewhere: weights of H_j alone (nlane, 0:nnoise, 0:nnoise)
      real(wp), allocatable, dimension(:) :: dq, dqq, eq  !! .. and derivatives (nlane)
   contains
      procedure :: evaluate
      procedure :: at_once
   end type position_brackets

contains

   !> For the brackets and lanes of `parts`.
   subroutine new_position_brackets(self, parts)
      type(position_brackets), intent(out) :: self
      type(modified_hamiltonian), intent(in) :: parts
      integer :: j

      self%nlane = parts%nlane
      self%nnoise = parts%nnoise
      if (parts%time_dependent) self%ntime = 3
      associate (n => parts%nlane, m => parts%nnoise)
         if (parts%model%traits%has_position_derivatives) then
            allocate (self%u(n, 3, 0:m, self%ntime))
            return
         end if
         allocate (self%unit(n, 0:m, 0:m), source=0.0_wp)
         do j = 0, m
            self%unit(:, j, j) = 1
         end do
         allocate (self%dq(n), self%dqq(n), self%eq(n))
      end associate
   end subroutine new_position_brackets

   !> Gradient and Hessian of all at (q, p), c_k = h dW_k/2 - dZ_k.
   subroutine evaluate(self, parts, t, step, c, rate, q, p, hq, hp, hqq, hqp, hpp, gradients, hessians, &
                       terms)
      class(position_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      real(wp), intent(in) :: t
      type(step_record), intent(in) :: step
      real(wp), intent(in), dimension(self%nlane, 0:self%nnoise) :: c, rate  !! c/h, where noise changes in time
      real(wp), intent(in), dimension(self%nlane) :: q, p
      real(wp), intent(inout), dimension(self%nlane) :: hq, hp, hqq, hqp, hpp
      integer, intent(out) :: gradients, hessians  !! that were asked for
      type(angle_terms), intent(in), optional :: terms(0:self%nnoise, 3)  !! of one lane, see step/single_brackets
      real(wp) :: nested

      nested = merge(step%h*abs(step%h)/6, 0.0_wp, parts%active%nested)
      if (allocated(self%u)) then
         if (present(terms)) then
            call derive(self, terms, q(1))
         else
            call ask_at_once(self, parts, [t, step%t, step%t + step%h], q)
         end if
         call add_up_at_once(self, parts, nested, step, c, rate, p, hq, hp, hqq, hqp, hpp)
      else
         call add_up(self, parts, nested, t, step, c, q, p, hq, hp, hqq, hqp, hpp)
         if (parts%time_dependent) call add_motion(self, parts, step, rate, q, p, hq)
      end if
      hessians = 1 + count(parts%noisy)
      gradients = hessians
      if (parts%time_dependent) gradients = gradients + 2
   end subroutine evaluate

   !> Whether one call gives all derivatives.
   pure logical function at_once(self)
      class(position_brackets), intent(in) :: self

      at_once = allocated(self%u)
   end function at_once

   subroutine ask_at_once(self, parts, times, q)
      type(position_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      real(wp), intent(in) :: times(3), q(self%nlane)

      call parts%model%position_derivatives(self%nlane, self%nnoise, self%ntime, times(:self%ntime), q, self%u)
   end subroutine ask_at_once

   !> The same from the terms of an angle.
   subroutine derive(self, terms, q)
      type(position_brackets), intent(inout) :: self
      type(angle_terms), intent(in) :: terms(0:self%nnoise, 3)
      real(wp), intent(in) :: q
      real(wp) :: sine, cosine
      integer :: i, j

      sine = sincos_one(q, cosine)
      do i = 1, self%ntime
         do j = 0, self%nnoise
            call angle_derivatives(terms(j, i), q, sine, cosine, self%u(1, 1, j, i), self%u(1, 2, j, i), &
                                   self%u(1, 3, j, i))
         end do
      end do
   end subroutine derive

   !> With all derivatives by one call.
   subroutine add_up_at_once(self, parts, nested, step, c, rate, p, hq, hp, hqq, hqp, hpp)
      type(position_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      real(wp), intent(in) :: nested
      type(step_record), intent(in) :: step
      real(wp), intent(in), dimension(self%nlane, 0:self%nnoise) :: c, rate
      real(wp), intent(in) :: p(self%nlane)
      real(wp), intent(inout), dimension(self%nlane) :: hq, hp, hqq, hqp, hpp
      integer :: k

      real(wp), pointer, contiguous :: w(:, :)  ! a name that gfortran 12 knows to be contiguous

      w => step%w
      associate (n => self%nlane, u => self%u)
         if (n == 1) then
            call add_up_alone(self%nnoise, self%ntime, parts%noisy, nested, w, c, rate, p(1), u, hq(1), hp(1), hqq(1), &
                              hqp(1), hpp(1))
            return
         end if
         call begin_sum(n, w(:, 0), p, u(:, 1, 0, 1), u(:, 2, 0, 1), hq, hp, hqq, hqp, hpp)
         do k = 1, self%nnoise
            if (.not. parts%noisy(k)) cycle
            call add_whole_noise(n, nested, w(:, k), c(:, k), p, u(:, 1, k, 1), u(:, 2, k, 1), u(:, 3, k, 1), &
                                 hq, hp, hqq, hqp)
            if (self%ntime == 1) cycle
            call add_change(n, rate(:, k), u(:, 1, k, 2), u(:, 1, k, 3), hq)
            call add_change(n, rate(:, k), u(:, 2, k, 2), u(:, 2, k, 3), hqq)
         end do
      end associate
   end subroutine add_up_at_once

   !> The same of one lane, in numbers.
   pure subroutine add_up_alone(m, ntime, noisy, nested, w, c, rate, p, u, hq, hp, hqq, hqp, hpp)
      integer, intent(in) :: m, ntime
      logical, intent(in) :: noisy(m)
      real(wp), intent(in) :: nested, w(0:m), c(0:m), rate(0:m), p, u(3, 0:m, ntime)
      real(wp), intent(out) :: hq, hp, hqq, hqp, hpp
      integer :: k

      call begin_one(w(0), p, u(1, 0, 1), u(2, 0, 1), hq, hp, hqq, hqp, hpp)
      do k = 1, m
         if (.not. noisy(k)) cycle
         call add_one(nested, w(k), c(k), p, u(1, k, 1), u(2, k, 1), u(3, k, 1), hq, hp, hqq, hqp)
         if (ntime == 1) cycle
         hq = hq + rate(k)*(u(1, k, 3) - u(1, k, 2))
         hqq = hqq + rate(k)*(u(2, k, 3) - u(2, k, 2))
      end do
   end subroutine add_up_alone

   !> With one call for each H_j.
   subroutine add_up(self, parts, nested, t, step, c, q, p, hq, hp, hqq, hqp, hpp)
      type(position_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      real(wp), intent(in) :: nested, t
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: c(self%nlane, 0:self%nnoise)
      real(wp), intent(in), dimension(self%nlane) :: q, p
      real(wp), intent(inout), dimension(self%nlane) :: hq, hp, hqq, hqp, hpp
      integer :: k

      associate (model => parts%model, n => self%nlane, m => self%nnoise)
         call model%gradient_hessian(n, 1, m, t, step%w, q, p, hq, hp, hqq=hqq, hpp=hpp)
         hqp = 0
         do k = 1, m
            if (.not. parts%noisy(k)) cycle
            call model%gradient_hessian(n, 1, m, t, self%unit(:, :, k), q, p, hq=self%dq, hqq=self%dqq)
            call add_noise(n, nested, c(:, k), p, self%dq, self%dqq, hq, hp, hqq, hqp)
         end do
      end associate
   end subroutine add_up

   !> Noise that changes in time: sum_k (c_k/h) [H_k(t_1) - H_k(t_0)].
   subroutine add_motion(self, parts, step, rate, q, p, hq)
      type(position_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: rate(self%nlane, 0:self%nnoise)
      real(wp), intent(in), dimension(self%nlane) :: q, p
      real(wp), intent(inout) :: hq(self%nlane)

      call parts%model%gradient(self%nlane, 1, self%nnoise, step%t + step%h, rate, q, p, hq=self%dq)
      call parts%model%gradient(self%nlane, 1, self%nnoise, step%t, rate, q, p, hq=self%eq)
      hq = hq + (self%dq - self%eq)
   end subroutine add_motion

   ! ---- kernels ----------------------------------------------------------------------------------

   !> VEC w H.
   pure subroutine begin_sum(nlane, w, p, u1, u2, hq, hp, hqq, hqp, hpp)
      integer, intent(in) :: nlane
      real(wp), intent(in), dimension(nlane) :: w, p, u1, u2
      real(wp), intent(out), dimension(nlane) :: hq, hp, hqq, hqp, hpp
      integer :: lane

      do lane = 1, nlane
         call begin_one(w(lane), p(lane), u1(lane), u2(lane), hq(lane), hp(lane), hqq(lane), hqp(lane), hpp(lane))
      end do
   end subroutine begin_sum

   !> The same of one lane. Here and below every product is added to a sum, from zero on: of a sum of two products
   !> either one may be fused, in lanes and alone not the same.
   pure subroutine begin_one(w, p, u1, u2, hq, hp, hqq, hqp, hpp)
      real(wp), intent(in) :: w, p, u1, u2
      real(wp), intent(out) :: hq, hp, hqq, hqp, hpp

      hq = 0 + w*u1
      hp = 0 + w*p
      hqq = 0 + w*u2
      hqp = 0
      hpp = w
   end subroutine begin_one

   !> VEC A noise and its brackets, from the three derivatives of its Hamiltonian.
   pure subroutine add_whole_noise(nlane, nested, w, c, p, u1, u2, u3, hq, hp, hqq, hqp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: nested  !! factor of the nested bracket
      real(wp), intent(in), dimension(nlane) :: w, c, p, u1, u2, u3
      real(wp), intent(inout), dimension(nlane) :: hq, hp, hqq, hqp
      integer :: lane

      do lane = 1, nlane
         call add_one(nested, w(lane), c(lane), p(lane), u1(lane), u2(lane), u3(lane), hq(lane), hp(lane), hqq(lane), &
                      hqp(lane))
      end do
   end subroutine add_whole_noise

   !> The same of one lane.
   pure subroutine add_one(nested, w, c, p, u1, u2, u3, hq, hp, hqq, hqp)
      real(wp), intent(in) :: nested, w, c, p, u1, u2, u3
      real(wp), intent(inout) :: hq, hp, hqq, hqp
      real(wp) :: push

      push = 0 + c*p
      push = push + nested*u1
      hq = hq + w*u1
      hq = hq + push*u2
      hp = hp + c*u1
      hqq = hqq + w*u2
      hqq = hqq + nested*u2*u2
      hqq = hqq + push*u3
      hqp = hqp + c*u2
   end subroutine add_one

   !> VEC The brackets alone, and without the third derivative.
   pure subroutine add_noise(nlane, nested, c, p, u1, u2, hq, hp, hqq, hqp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: nested
      real(wp), intent(in), dimension(nlane) :: c, p, u1, u2
      real(wp), intent(inout), dimension(nlane) :: hq, hp, hqq, hqp
      integer :: lane

      do lane = 1, nlane
         hp(lane) = hp(lane) + c(lane)*u1(lane)
         hq(lane) = hq(lane) + (c(lane)*p(lane) + nested*u1(lane))*u2(lane)
         hqq(lane) = hqq(lane) + nested*u2(lane)*u2(lane)
         hqp(lane) = hqp(lane) + c(lane)*u2(lane)
      end do
   end subroutine add_noise

   !> VEC
   pure subroutine add_change(nlane, rate, before, after, total)
      integer, intent(in) :: nlane
      real(wp), intent(in), dimension(nlane) :: rate, before, after
      real(wp), intent(inout) :: total(nlane)
      integer :: lane

      do lane = 1, nlane
         total(lane) = total(lane) + rate(lane)*(after(lane) - before(lane))
      end do
   end subroutine add_change

end module symsde_step_position_brackets
