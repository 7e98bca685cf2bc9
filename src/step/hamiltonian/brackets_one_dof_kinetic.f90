! SPDX-License-Identifier: BSD-3-Clause
!> The brackets of step/hamiltonian/brackets_one_dof where every H_j = e_j p^2/2 + U_j(q): of an angle, and of noise in
!> position with H = p^2/2 + U(q). Brackets of these are polynomials of p. With y_k = e_0 U_k - e_k U_0,
!>
!>    {H_k,H} = p y_k',   {{H,H_k},H_k} = y_k' U_k' - e_k p^2 y_k'',
!>
!> and what noises that change in time add is sum_k (c_k/h) [H_k(t_1) - H_k(t_0)] where they are in position.
!>
!> An angle's derivatives of every order follow from one sine and one cosine, and Newton's matrix is exact. Others are
!> asked for two of U_j, which give the gradient, and the matrix goes without more.
module symsde_step_hamiltonian_brackets_one_dof_kinetic
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: step_record
   use symsde_base_sincos, only: sincos_lanes, sincos_one
   use symsde_model_abstract, only: model_type, angle_terms
   use symsde_step_hamiltonian_brackets_exact, only: has_exact_bracket
   use symsde_step_hamiltonian_brackets, only: modified_hamiltonian
   implicit none
   private
   public :: kinetic_brackets, new_kinetic_brackets, are_kinetic, find_angle_of_one

   type :: kinetic_brackets
      private
      integer :: nlane = 0, nnoise = 0
      integer :: ntime = 1                         !! 3: at the ends of the step, too, where noises change in time
      logical :: angle = .false.
      type(angle_terms), allocatable :: ends(:, :) !! terms of H_k there (nnoise, 2:3)
      real(wp), allocatable :: u(:, :, :, :)       !! U_j' .. U_j'''' (nlane, 4, 0:nnoise, ntime)
      real(wp), allocatable :: e(:)                !! e_j (0:nnoise)
      real(wp), allocatable :: y(:, :)             !! y_k' .. y_k'''' (nlane, 4)
      real(wp), allocatable :: one(:, :, :)        !! weights of H_j alone (nlane, 0:nnoise, 0:nnoise)
      real(wp), allocatable :: sine(:), cosine(:)  !! (nlane)
      real(wp), allocatable :: beside(:, :)        !! one lane, all H_j: U_j', U_j'', q, p (0:nnoise, 4)
   contains
      procedure :: begin
      procedure :: evaluate
   end type kinetic_brackets

contains

   !> Whether the Hamiltonians of this model are known to be of this form, and no more is wanted of them.
   pure logical function are_kinetic(parts)
      type(modified_hamiltonian), intent(in) :: parts

      associate (traits => parts%model%traits)
         are_kinetic = traits%has_angle_terms .and. .not. (parts%time_dependent .or. parts%active%areas) .and. &
                       (has_exact_bracket(traits) .or. .not. parts%active%nested)
         are_kinetic = are_kinetic .or. parts%simple
      end associate
   end function are_kinetic

   !> For the brackets and lanes of `parts`.
   subroutine new_kinetic_brackets(self, parts)
      type(kinetic_brackets), intent(out) :: self
      type(modified_hamiltonian), intent(in) :: parts
      integer :: j

      self%nlane = parts%nlane
      self%nnoise = parts%nnoise
      self%angle = parts%model%traits%has_angle_terms
      if (parts%time_dependent) self%ntime = 3
      associate (n => parts%nlane, m => parts%nnoise)
         allocate (self%u(n, 4, 0:m, self%ntime), self%e(0:m), self%y(n, 4), source=0.0_wp)
         self%e(0) = 1
         allocate (self%one(n, 0:m, 0:m), source=0.0_wp)
         do j = 0, m
            self%one(:, j, j) = 1
         end do
         allocate (self%sine(n), self%cosine(n), self%ends(m, 2:3), self%beside(0:m, 4))
      end associate
   end subroutine new_kinetic_brackets

   !> Begin a step: an angle's terms at its ends.
   subroutine begin(self, model, step)
      class(kinetic_brackets), intent(inout) :: self
      class(model_type), intent(in) :: model
      type(step_record), intent(in) :: step
      integer :: k

      if (.not. self%angle .or. self%ntime == 1) return
      do k = 1, self%nnoise
         call model%angle(self%nnoise, step%t, self%one(1, :, k), self%ends(k, 2))
         call model%angle(self%nnoise, step%t + step%h, self%one(1, :, k), self%ends(k, 3))
      end do
   end subroutine begin

   !> Gradient and Hessian of all at (q, p).
   subroutine evaluate(self, parts, t, step, c, rate, q, p, hq, hp, hqq, hqp, hpp)
      class(kinetic_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      real(wp), intent(in) :: t
      type(step_record), intent(in) :: step
      real(wp), intent(in), dimension(self%nlane, 0:self%nnoise) :: c, rate  !! see step/hamiltonian/brackets_one_dof
      real(wp), intent(in), dimension(self%nlane) :: q, p
      real(wp), intent(out), dimension(self%nlane) :: hq, hp, hqq, hqp, hpp
      real(wp) :: nested
      real(wp), pointer, contiguous :: w(:, :)  ! a name that gfortran 12 knows to be contiguous

      w => step%w
      if (.not. self%angle) then
         call ask(self, parts, [t, step%t, step%t + step%h], q, p)
      else
         call derive(self, parts, t, q)
      end if
      nested = merge(step%h*abs(step%h)/12, 0.0_wp, parts%active%nested)
      call combine(self%nlane, self%nnoise, parts%noisy, nested, w, c, self%e, self%u, p, self%y, &
                   hq, hp, hqq, hqp, hpp)
      if (self%ntime == 3) call add_motion(self, parts%noisy, rate, hq, hqq)
   end subroutine evaluate

   !> U_j' and U_j'' from the model, H_j by H_j; for one lane all at once, H_j as lane j.
   subroutine ask(self, parts, times, q, p)
      type(kinetic_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      real(wp), intent(in) :: times(3)
      real(wp), intent(in), dimension(self%nlane) :: q, p
      integer :: i, j

      associate (n => self%nlane, m => self%nnoise, u => self%u, model => parts%model)
         do i = 1, self%ntime
            if (n == 1) then
               self%beside(:, 3) = q(1)
               self%beside(:, 4) = p(1)
               call model%gradient_hessian(m + 1, 1, m, times(i), self%one, self%beside(:, 3), self%beside(:, 4), &
                                           hq=self%beside(:, 1), hqq=self%beside(:, 2))
               u(1, 1, :, i) = self%beside(:, 1)
               u(1, 2, :, i) = self%beside(:, 2)
               cycle
            end if
            do j = merge(0, 1, i == 1), m
               if (j > 0) then
                  if (.not. parts%noisy(j)) cycle
               end if
               call model%gradient_hessian(n, 1, m, times(i), self%one(:, :, j), q, p, hq=u(:, 1, j, i), &
                                           hqq=u(:, 2, j, i))
            end do
         end do
      end associate
   end subroutine ask

   !> All derivatives of an angle.
   subroutine derive(self, parts, t, q)
      type(kinetic_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      real(wp), intent(in) :: t, q(self%nlane)
      type(angle_terms) :: terms
      integer :: i, j

      call sincos_lanes(self%nlane, q, self%sine, self%cosine)
      do j = 0, self%nnoise
         call parts%model%angle(self%nnoise, t, self%one(1, :, j), terms)
         self%e(j) = terms%e
         call derivatives_of(self%nlane, terms, q, self%sine, self%cosine, self%u(:, :, j, 1))
      end do
      do i = 2, self%ntime
         do j = 1, self%nnoise
            call derivatives_of(self%nlane, self%ends(j, i), q, self%sine, self%cosine, self%u(:, :, j, i))
         end do
      end do
   end subroutine derive

   !> Noise that changes in time.
   subroutine add_motion(self, noisy, rate, hq, hqq)
      type(kinetic_brackets), intent(in) :: self
      logical, intent(in) :: noisy(self%nnoise)
      real(wp), intent(in) :: rate(self%nlane, 0:self%nnoise)
      real(wp), intent(inout), dimension(self%nlane) :: hq, hqq
      integer :: k

      do k = 1, self%nnoise
         if (noisy(k)) call add_change(self%nlane, rate(:, k), self%u(:, :, k, 2), self%u(:, :, k, 3), hq, hqq)
      end do
   end subroutine add_motion

   !> sum_j w_j H_j, {sum_k c_k H_k, H} and nested sum_k {{H,H_k},H_k}.
   pure subroutine combine(nlane, m, noisy, nested, w, c, e, u, p, y, hq, hp, hqq, hqp, hpp)
      integer, intent(in) :: nlane, m
      logical, intent(in) :: noisy(m)
      real(wp), intent(in), dimension(nlane, 0:m) :: w, c
      real(wp), intent(in) :: nested, e(0:m), u(nlane, 4, 0:m), p(nlane)
      real(wp), intent(out) :: y(nlane, 4)  !! room
      real(wp), intent(out), dimension(nlane) :: hq, hp, hqq, hqp, hpp
      integer :: k

      hq = 0
      hp = 0
      hqq = 0
      hqp = 0
      hpp = 0
      call add_multiple(nlane, w, e(0), u, p, hq, hp, hqq, hpp)
      do k = 1, m
         if (.not. noisy(k)) cycle
         if (abs(e(k)) > 0) then
            call add_multiple(nlane, w(:, k), e(k), u(:, :, k), p, hq, hp, hqq, hpp)
            call find_y(nlane, e(0), u, e(k), u(:, :, k), y)
            call add_bracket(nlane, c(:, k), y, p, hq, hp, hqq, hqp)
            call add_nested(nlane, nested, e(k), u(:, :, k), y, p, hq, hp, hqq, hqp, hpp)
         else
            call add_still(nlane, nested, w(:, k), c(:, k), e(0), u(:, :, k), p, hq, hp, hqq, hqp)
         end if
      end do
   end subroutine combine

   !> All of one lane of an angle, by numbers.
   subroutine find_angle_of_one(m, noisy, nested, w, c, rate, terms, ends, q, p, &
                                gq, gp, gqq, gqp, gpp)
      integer, intent(in) :: m
      logical, intent(in) :: noisy(m)
      real(wp), intent(in) :: nested, w(0:m), c(0:m), rate(0:m), q, p
      type(angle_terms), intent(in) :: terms(0:m)         !! of every H_j
      type(angle_terms), intent(in), optional :: ends(m, 2)  !! of noises that change in time
      real(wp), intent(out) :: gq, gp, gqq, gqp, gpp
      real(wp) :: hq, hp, hqq, hqp, hpp                   ! sums in registers
      real(wp) :: sine, cosine, g1, g2, g3, g4, u1, u2, u3, u4, v1, v2, v3, v4, y1, y2, y3, y4
      integer :: k

      sine = sincos_one(q, cosine)
      call derive_one(terms(0), q, sine, cosine, g1, g2, g3, g4)
      hq = 0 + w(0)*g1
      hqq = 0 + w(0)*g2
      hpp = 0 + w(0)*terms(0)%e
      hp = 0 + hpp*p
      hqp = 0
      do k = 1, m
         if (.not. noisy(k)) cycle
         call derive_one(terms(k), q, sine, cosine, u1, u2, u3, u4)
         if (abs(terms(k)%e) > 0) then
            call add_one(w(k), terms(k)%e, u1, u2, p, hq, hp, hqq, hpp)
            y1 = difference(terms(0)%e, u1, terms(k)%e, g1)
            y2 = difference(terms(0)%e, u2, terms(k)%e, g2)
            y3 = difference(terms(0)%e, u3, terms(k)%e, g3)
            y4 = difference(terms(0)%e, u4, terms(k)%e, g4)
            call add_one_bracket(c(k), y1, y2, y3, p, hq, hp, hqq, hqp)
            call add_one_nested(nested, terms(k)%e, u1, u2, u3, y1, y2, y3, y4, p, hq, hp, hqq, hqp, hpp)
         else
            call add_one_still(nested, w(k), c(k), terms(0)%e, u1, u2, u3, p, hq, hp, hqq, hqp)
         end if
      end do
      if (present(ends)) then
         do k = 1, m
            if (.not. noisy(k)) cycle
            call derive_one(ends(k, 1), q, sine, cosine, u1, u2, u3, u4)
            call derive_one(ends(k, 2), q, sine, cosine, v1, v2, v3, v4)
            hq = hq + rate(k)*(v1 - u1)
            hqq = hqq + rate(k)*(v2 - u2)
         end do
      end if
      gq = hq
      gp = hp
      gqq = hqq
      gqp = hqp
      gpp = hpp
   end subroutine find_angle_of_one

   ! ---- kernels: every product is added to a sum, from zero on; of a sum of two either one may be fused, in lanes and
   !      alone not the same ------------------------------------------------------------------------------------------

   !> U' .. U'''' of an angle with these terms.
   pure subroutine derive_one(terms, q, sine, cosine, u1, u2, u3, u4)
      type(angle_terms), intent(in) :: terms
      real(wp), intent(in) :: q, sine, cosine
      real(wp), intent(out) :: u1, u2, u3, u4
      real(wp) :: turn, wave

      turn = 0 + terms%a*sine
      turn = turn + terms%b*cosine
      wave = 0 + terms%a*cosine
      wave = wave - terms%b*sine
      u1 = turn + (terms%c*q + terms%d)
      u2 = wave + terms%c
      u3 = -turn
      u4 = -wave
   end subroutine derive_one

   !> VEC
   pure subroutine derivatives_of(nlane, terms, q, sine, cosine, u)
      integer, intent(in) :: nlane
      type(angle_terms), intent(in) :: terms
      real(wp), intent(in), dimension(nlane) :: q, sine, cosine
      real(wp), intent(out) :: u(nlane, 4)
      integer :: lane

      do lane = 1, nlane
         call derive_one(terms, q(lane), sine(lane), cosine(lane), u(lane, 1), u(lane, 2), u(lane, 3), &
                         u(lane, 4))
      end do
   end subroutine derivatives_of

   !> Add w (e p^2/2 + U).
   pure subroutine add_one(w, e, u1, u2, p, hq, hp, hqq, hpp)
      real(wp), intent(in) :: w, e, u1, u2, p
      real(wp), intent(inout) :: hq, hp, hqq, hpp

      hq = hq + w*u1
      hqq = hqq + w*u2
      hp = hp + w*e*p
      hpp = hpp + w*e
   end subroutine add_one

   !> VEC
   pure subroutine add_multiple(nlane, w, e, u, p, hq, hp, hqq, hpp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: w(nlane), e, u(nlane, 4), p(nlane)
      real(wp), intent(inout), dimension(nlane) :: hq, hp, hqq, hpp
      integer :: lane

      do lane = 1, nlane
         call add_one(w(lane), e, u(lane, 1), u(lane, 2), p(lane), hq(lane), hp(lane), hqq(lane), hpp(lane))
      end do
   end subroutine add_multiple

   !> A noise in position and its brackets.
   pure subroutine add_one_still(nested, w, c, e0, u1, u2, u3, p, hq, hp, hqq, hqp)
      real(wp), intent(in) :: nested, w, c, e0, u1, u2, u3, p
      real(wp), intent(inout) :: hq, hp, hqq, hqp
      real(wp) :: push, square, moved

      moved = c*e0
      square = 2*nested*e0
      push = 0 + moved*p
      push = push + square*u1
      hq = hq + w*u1
      hq = hq + push*u2
      hp = hp + moved*u1
      hqq = hqq + w*u2
      hqq = hqq + square*u2*u2
      hqq = hqq + push*u3
      hqp = hqp + moved*u2
   end subroutine add_one_still

   !> VEC
   pure subroutine add_still(nlane, nested, w, c, e0, u, p, hq, hp, hqq, hqp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: nested, w(nlane), c(nlane), e0, u(nlane, 4), p(nlane)
      real(wp), intent(inout), dimension(nlane) :: hq, hp, hqq, hqp
      integer :: lane

      do lane = 1, nlane
         call add_one_still(nested, w(lane), c(lane), e0, u(lane, 1), u(lane, 2), u(lane, 3), p(lane), &
                            hq(lane), hp(lane), hqq(lane), hqp(lane))
      end do
   end subroutine add_still

   !> a b - c d
   pure real(wp) function difference(a, b, c, d)
      real(wp), intent(in) :: a, b, c, d

      difference = 0 + a*b
      difference = difference - c*d
   end function difference

   !> VEC The derivatives of y_k.
   pure subroutine find_y(nlane, e0, u0, e, u, y)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: e0, u0(nlane, 4), e, u(nlane, 4)
      real(wp), intent(out) :: y(nlane, 4)
      integer :: i, lane

      do i = 1, 4
         do lane = 1, nlane
            y(lane, i) = difference(e0, u(lane, i), e, u0(lane, i))
         end do
      end do
   end subroutine find_y

   !> Add c {H_k,H} = c p y'.
   pure subroutine add_one_bracket(c, y1, y2, y3, p, hq, hp, hqq, hqp)
      real(wp), intent(in) :: c, y1, y2, y3, p
      real(wp), intent(inout) :: hq, hp, hqq, hqp

      hp = hp + c*y1
      hq = hq + c*p*y2
      hqp = hqp + c*y2
      hqq = hqq + c*p*y3
   end subroutine add_one_bracket

   !> VEC
   pure subroutine add_bracket(nlane, c, y, p, hq, hp, hqq, hqp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: c(nlane), y(nlane, 4), p(nlane)
      real(wp), intent(inout), dimension(nlane) :: hq, hp, hqq, hqp
      integer :: lane

      do lane = 1, nlane
         call add_one_bracket(c(lane), y(lane, 1), y(lane, 2), y(lane, 3), p(lane), hq(lane), hp(lane), hqq(lane), &
                              hqp(lane))
      end do
   end subroutine add_bracket

   !> Add c {{H,H_k},H_k} = c (y' U' - e p^2 y'').
   pure subroutine add_one_nested(c, e, u1, u2, u3, y1, y2, y3, y4, p, hq, hp, hqq, hqp, hpp)
      real(wp), intent(in) :: c, e, u1, u2, u3, y1, y2, y3, y4, p
      real(wp), intent(inout) :: hq, hp, hqq, hqp, hpp
      real(wp) :: ce, cep

      ce = c*e
      cep = ce*p
      hq = hq + c*y2*u1
      hq = hq + c*y1*u2
      hq = hq - cep*p*y3
      hp = hp - 2*cep*y2
      hqq = hqq + c*y3*u1
      hqq = hqq + 2*c*y2*u2
      hqq = hqq + c*y1*u3
      hqq = hqq - cep*p*y4
      hqp = hqp - 2*cep*y3
      hpp = hpp - 2*ce*y2
   end subroutine add_one_nested

   !> VEC
   pure subroutine add_nested(nlane, c, e, u, y, p, hq, hp, hqq, hqp, hpp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: c, e, u(nlane, 4), y(nlane, 4), p(nlane)
      real(wp), intent(inout), dimension(nlane) :: hq, hp, hqq, hqp, hpp
      integer :: lane

      do lane = 1, nlane
         call add_one_nested(c, e, u(lane, 1), u(lane, 2), u(lane, 3), y(lane, 1), y(lane, 2), y(lane, 3), y(lane, 4), &
                             p(lane), hq(lane), hp(lane), hqq(lane), hqp(lane), hpp(lane))
      end do
   end subroutine add_nested

   !> VEC Add w (G - F).
   pure subroutine add_change(nlane, w, f, g, hq, hqq)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: w(nlane), f(nlane, 4), g(nlane, 4)
      real(wp), intent(inout), dimension(nlane) :: hq, hqq
      integer :: lane

      do lane = 1, nlane
         hq(lane) = hq(lane) + w(lane)*(g(lane, 1) - f(lane, 1))
         hqq(lane) = hqq(lane) + w(lane)*(g(lane, 2) - f(lane, 2))
      end do
   end subroutine add_change

end module symsde_step_hamiltonian_brackets_one_dof_kinetic
