! SPDX-License-Identifier: BSD-3-Clause
!> The random Hamiltonian of one step with its brackets (step/modified_hamiltonian), for one degree of freedom.
!>
!> With the gradients and Hessians of H and of every H_k at a point, all brackets there are a few products; what is
!> left to ask the model for is what differences need at other points, and noises at the ends of the step. So one
!> evaluation costs 1 + m of the model where noise is in position and H = p^2/2 + U(q), and otherwise six more for each
!> noise, two of them where it is additive; with third derivatives one for each H_j at the point itself, and with those
!> that vanish none.
!>
!> The gradient is exact. The Hessian is without third derivatives, and by differences without most of the nested
!> bracket: Newton's iteration finds the same root, and more slowly by the factor that these have in the equations.
module symsde_step_single_brackets
   use symsde_base_counters, only: counters_type
   use symsde_base_functionals, only: area_index, path_areas, path_dz
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: step_record
   use symsde_base_sincos, only: sincos_one
   use symsde_model_abstract, only: model_type, angle_terms
   use symsde_step_angle_derivatives, only: angle_derivatives
   use symsde_step_bracket_differences, only: add_second_difference, add_differences, add_transposed
   use symsde_step_exact_bracket, only: add_second_derivatives, add_third_derivatives, has_exact_bracket
   use symsde_step_modified_hamiltonian, only: modified_hamiltonian, reach
   use symsde_step_position_brackets, only: position_brackets, new_position_brackets
   implicit none
   private
   public :: single_brackets, new_single_brackets

   !> Gradient and Hessian of a Hamiltonian in every lane.
   type :: derivatives
      real(wp), allocatable, dimension(:) :: q, p, qq, qp, pp
      real(wp), allocatable, dimension(:) :: qqq, ppp  !! of separable Hamiltonians, where they are known
   end type derivatives

   type :: single_brackets
      private
      integer :: nlane = 0, nnoise = 0
      logical, public :: takes_terms = .false.      !! terms of an angle are all that one lane asks for
      logical :: thirds = .false.                   !! all third derivatives that there are: qqq and ppp
      !> Weights of H_j alone, and at -1 of F/h, of which the nested brackets are (nlane, 0:nnoise, -1:nnoise).
      real(wp), allocatable :: unit(:, :, :)
      real(wp), allocatable :: c(:, :)              !! h dW_k/2 - dZ_k; c_0 = 0 (nlane, 0:nnoise)
      real(wp), allocatable :: rate(:, :)           !! c/h (nlane, 0:nnoise)
      type(position_brackets) :: position           !! noise in position
      type(derivatives), allocatable :: of(:)       !! H_j (0:nnoise)
      type(derivatives) :: f                        !! of a sum
      real(wp), allocatable, dimension(:) :: uq, up, vq, vp, yq, yp, xq, xp  !! (nlane)
      real(wp), allocatable :: one(:)
      real(wp), allocatable, dimension(:, :) :: gq, gp  !! gradients at six points (nlane, 6)
   contains
      procedure :: begin
      procedure :: evaluate
   end type single_brackets

contains

   !> For the brackets and lanes of `parts`.
   subroutine new_single_brackets(self, parts)
      type(single_brackets), intent(out) :: self
      type(modified_hamiltonian), intent(in) :: parts
      integer :: j

      self%nlane = parts%nlane
      self%nnoise = parts%nnoise
      if (parts%simple) call new_position_brackets(self%position, parts)
      associate (n => parts%nlane, m => parts%nnoise, traits => parts%model%traits)
         self%thirds = traits%separable .and. traits%has_third_derivative .and. .not. traits%quadratic .and. &
                       .not. parts%active%crossed
         self%takes_terms = traits%has_angle_terms .and. (self%thirds .or. self%position%at_once())
         allocate (self%one(n), source=1.0_wp)
         allocate (self%unit(n, 0:m, -1:m), self%c(n, 0:m), self%rate(n, 0:m), source=0.0_wp)
         allocate (self%of(0:m))
         self%unit(:, 0, -1) = 1
         do j = 0, m
            self%unit(:, j, j) = 1
            call new_derivatives(n, self%of(j))
         end do
         call new_derivatives(n, self%f)
         allocate (self%uq(n), self%up(n), self%vq(n), self%vp(n), self%yq(n), self%yp(n))
         allocate (self%gq(n, 6), self%gp(n, 6), self%xq(n), self%xp(n))
      end associate
   end subroutine new_single_brackets

   pure subroutine new_derivatives(n, d)
      integer, intent(in) :: n
      type(derivatives), intent(out) :: d

      allocate (d%q(n), d%p(n), d%qq(n), d%qp(n), d%pp(n), d%qqq(n), d%ppp(n), source=0.0_wp)
   end subroutine new_derivatives

   !> Begin a step: what stays the same in it.
   subroutine begin(self, parts, step)
      class(single_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      type(step_record), intent(in) :: step
      integer :: k

      if (parts%active%crossed) self%unit(:, 1:, -1) = step%w(:, 1:)/step%h
      if (.not. parts%active%single) return
      do k = 1, self%nnoise
         self%c(:, k) = 0.5_wp*step%h*step%w(:, k) - step%of(path_dz)%x(:, k)
      end do
      if (parts%time_dependent) self%rate = self%c/step%h
   end subroutine begin

   !> Gradient and Hessian of all at (q, p).
   subroutine evaluate(self, parts, t, step, q, p, hq, hp, hqq, hqp, hpp, counters, nreal, terms)
      class(single_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(inout) :: parts
      real(wp), intent(in) :: t
      type(step_record), intent(in) :: step
      real(wp), intent(in), dimension(self%nlane) :: q, p
      real(wp), intent(inout), dimension(self%nlane) :: hq, hp, hqq, hqp, hpp
      type(counters_type), intent(inout) :: counters
      integer, intent(in) :: nreal
      !> Of one lane, where it takes them: those of every H_j at t, and at both ends of a step in which noises change
      type(angle_terms), intent(in), optional :: terms(0:self%nnoise, 3)
      integer :: asked, gradients

      if (parts%simple) then
         call self%position%evaluate(parts, t, step, self%c, self%rate, q, p, hq, hp, hqq, hqp, hpp, gradients, asked, &
                                     terms)
         counters%gradients = counters%gradients + nreal*(gradients - asked)
      else
         if (present(terms)) then
            call derive(self, terms, q(1), p(1))
         else
            call ask_for_all(self, parts, t, q, p)
         end if
         asked = 1 + count(parts%noisy)
         call add_up(self, parts, step, hq, hp, hqq, hqp, hpp)
         if (parts%active%crossed) call cross(self, parts)
         if (parts%active%nested .and. has_exact_bracket(parts%model%traits)) then
            call add_exact(self, parts, t, step%h, q, p, hq, hp, hqq, hqp, hpp, counters, nreal)
         else if (parts%active%nested) then
            call add_nested(self, parts, t, step%h, q, p, hq, hp, counters, nreal)
         end if
         if (parts%time_dependent) call parts%add_motion_to(step, self%c, q, p, hq, hp, counters, nreal)
      end if
      counters%gradients = counters%gradients + nreal*asked
      counters%hessians = counters%hessians + nreal*asked
   end subroutine evaluate

   !> All derivatives at (q, p) from the terms of an angle.
   subroutine derive(self, terms, q, p)
      type(single_brackets), intent(inout) :: self
      type(angle_terms), intent(in) :: terms(0:self%nnoise)
      real(wp), intent(in) :: q, p
      real(wp) :: sine, cosine
      integer :: j

      sine = sincos_one(q, cosine)
      do j = 0, self%nnoise
         associate (d => self%of(j))
            call angle_derivatives(terms(j), q, sine, cosine, d%q(1), d%qq(1), d%qqq(1))
            d%p(1) = terms(j)%e*p
            d%pp(1) = terms(j)%e
         end associate
      end do
   end subroutine derive

   !> All derivatives at (q, p) from the model.
   subroutine ask_for_all(self, parts, t, q, p)
      type(single_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      real(wp), intent(in) :: t
      real(wp), intent(in), dimension(self%nlane) :: q, p
      integer :: j

      do j = 0, self%nnoise
         if (j > 0) then
            if (.not. parts%noisy(j)) cycle
         end if
         associate (n => self%nlane, m => self%nnoise, d => self%of(j))
            call parts%model%gradient_hessian(n, 1, m, t, self%unit(:, :, j), q, p, d%q, d%p, d%qq, d%qp, d%pp)
            if (self%thirds) call parts%model%third_derivative(n, 1, m, t, self%unit(:, :, j), q, p, self%one, &
                                                               self%one, self%one, self%one, d%qqq, d%ppp)
         end associate
      end do
   end subroutine ask_for_all

   !> Any model: sum_j w_j H_j, {sum_k c_k H_k, H} and sum_l {H_l, sum_{k<l} A_kl H_k}.
   subroutine add_up(self, parts, step, hq, hp, hqq, hqp, hpp)
      class(single_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      type(step_record), intent(in) :: step
      real(wp), intent(inout), dimension(self%nlane) :: hq, hp, hqq, hqp, hpp
      integer :: j, k, l

      hq = 0
      hp = 0
      hqq = 0
      hqp = 0
      hpp = 0
      associate (n => self%nlane, m => self%nnoise, noisy => parts%noisy, f => self%f)
         do j = 0, m
            if (j > 0) then
               if (.not. noisy(j)) cycle
            end if
            call add_multiple(n, step%w(:, j), self%of(j)%q, self%of(j)%p, self%of(j)%qq, self%of(j)%qp, &
                              self%of(j)%pp, hq, hp, hqq, hqp, hpp)
         end do
         if (parts%active%single) then
            call clear(f)
            do k = 1, m
               if (.not. noisy(k)) cycle
               call add_derivatives(n, self%c(:, k), self%of(k), f)
               if (self%thirds) call add_thirds(n, self%c(:, k), self%of(k), self%of(0), hqq, hpp)
            end do
            call add_bracket(n, f, self%of(0), hq, hp, hqq, hqp, hpp)
         end if
         if (.not. parts%active%areas) return
         do l = 2, m
            if (.not. noisy(l)) cycle
            call clear(f)
            do k = 1, l - 1
               if (noisy(k)) call add_derivatives(n, step%of(path_areas)%x(:, area_index(k, l)), self%of(k), f)
            end do
            call add_bracket(n, self%of(l), f, hq, hp, hqq, hqp, hpp)
         end do
      end associate
   end subroutine add_up

   pure subroutine clear(d)
      type(derivatives), intent(inout) :: d

      d%q = 0
      d%p = 0
      d%qq = 0
      d%qp = 0
      d%pp = 0
   end subroutine clear

   pure subroutine add_derivatives(n, w, d, total)
      integer, intent(in) :: n
      real(wp), intent(in) :: w(n)
      type(derivatives), intent(in) :: d
      type(derivatives), intent(inout) :: total

      call add_multiple(n, w, d%q, d%p, d%qq, d%qp, d%pp, total%q, total%p, total%qq, total%qp, total%pp)
   end subroutine add_derivatives

   !> To the Hessian of w {F,G} what third derivatives add.
   pure subroutine add_thirds(n, w, f, g, hqq, hpp)
      integer, intent(in) :: n
      real(wp), intent(in) :: w(n)
      type(derivatives), intent(in) :: f, g
      real(wp), intent(inout), dimension(n) :: hqq, hpp

      hqq = hqq + w*(f%qqq*g%p - f%p*g%qqq)
      hpp = hpp + w*(f%q*g%ppp - f%ppp*g%q)
   end subroutine add_thirds

   pure subroutine add_bracket(n, f, g, hq, hp, hqq, hqp, hpp)
      integer, intent(in) :: n
      type(derivatives), intent(in) :: f, g
      real(wp), intent(inout), dimension(n) :: hq, hp, hqq, hqp, hpp

      call add_products(n, f%q, f%p, f%qq, f%qp, f%pp, g%q, g%p, g%qq, g%qp, g%pp, hq, hp, hqq, hqp, hpp)
   end subroutine add_bracket

   !> VEC
   pure subroutine add_multiple(nlane, w, q, p, qq, qp, pp, hq, hp, hqq, hqp, hpp)
      integer, intent(in) :: nlane
      real(wp), intent(in), dimension(nlane) :: w, q, p, qq, qp, pp
      real(wp), intent(inout), dimension(nlane) :: hq, hp, hqq, hqp, hpp
      integer :: lane

      do lane = 1, nlane
         hq(lane) = hq(lane) + w(lane)*q(lane)
         hp(lane) = hp(lane) + w(lane)*p(lane)
         hqq(lane) = hqq(lane) + w(lane)*qq(lane)
         hqp(lane) = hqp(lane) + w(lane)*qp(lane)
         hpp(lane) = hpp(lane) + w(lane)*pp(lane)
      end do
   end subroutine add_multiple

   !> VEC Gradient of {F,G} = F_q G_p - F_p G_q, and its Hessian without third derivatives.
   pure subroutine add_products(nlane, fq, fp, fqq, fqp, fpp, gq, gp, gqq, gqp, gpp, hq, hp, hqq, hqp, hpp)
      integer, intent(in) :: nlane
      real(wp), intent(in), dimension(nlane) :: fq, fp, fqq, fqp, fpp, gq, gp, gqq, gqp, gpp
      real(wp), intent(inout), dimension(nlane) :: hq, hp, hqq, hqp, hpp
      integer :: lane

      do lane = 1, nlane
         hq(lane) = hq(lane) + ((fqq(lane)*gp(lane) - fqp(lane)*gq(lane)) + (fq(lane)*gqp(lane) - fp(lane)*gqq(lane)))
         hp(lane) = hp(lane) + ((fqp(lane)*gp(lane) - fpp(lane)*gq(lane)) + (fq(lane)*gpp(lane) - fp(lane)*gqp(lane)))
         hqq(lane) = hqq(lane) + 2*(fqq(lane)*gqp(lane) - fqp(lane)*gqq(lane))
         hqp(lane) = hqp(lane) + (fqq(lane)*gpp(lane) - fpp(lane)*gqq(lane))
         hpp(lane) = hpp(lane) + 2*(fqp(lane)*gpp(lane) - fpp(lane)*gqp(lane))
      end do
   end subroutine add_products

   !> From here on H_0 is F/h, of which the nested brackets are.
   subroutine cross(self, parts)
      class(single_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      integer :: k, lane
      real(wp) :: w

      do k = 1, self%nnoise
         if (.not. parts%noisy(k)) cycle
         associate (e => self%of(0), d => self%of(k))
            do lane = 1, self%nlane
               w = self%unit(lane, k, -1)
               e%q(lane) = e%q(lane) + w*d%q(lane)
               e%p(lane) = e%p(lane) + w*d%p(lane)
               e%qq(lane) = e%qq(lane) + w*d%qq(lane)
               e%qp(lane) = e%qp(lane) + w*d%qp(lane)
               e%pp(lane) = e%pp(lane) + w*d%pp(lane)
            end do
         end associate
      end do
   end subroutine cross

   !> (|h|/12) sum_k {{F,H_k},H_k} by third derivatives (step/exact_bracket). All else that it takes is there.
   subroutine add_exact(self, parts, t, h, q, p, hq, hp, hqq, hqp, hpp, counters, nreal)
      type(single_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      real(wp), intent(in) :: t, h
      real(wp), intent(in), dimension(self%nlane) :: q, p
      real(wp), intent(inout), dimension(self%nlane) :: hq, hp, hqq, hqp, hpp
      type(counters_type), intent(inout) :: counters
      integer, intent(in) :: nreal
      real(wp) :: c
      integer :: k, asked

      c = h*abs(h)/12
      asked = merge(1 + count(parts%noisy), 0, self%thirds)
      associate (n => self%nlane, e => self%of(0), traits => parts%model%traits)
         call field(n, e%q, e%p, self%uq, self%up)
         do k = 1, self%nnoise
            if (.not. parts%noisy(k)) cycle
            associate (d => self%of(k))
               call field(n, d%q, d%p, self%vq, self%vp)
               if (self%thirds) then
                  call add_third_derivatives(n, c, e%qqq, e%ppp, d%qqq, d%ppp, e%qq, e%pp, d%qq, d%pp, self%uq, &
                                             self%up, self%vq, self%vp, hq, hp, hqq, hqp, hpp)
               else if (.not. traits%quadratic) then
                  call add_third(self, parts%model, -1, c, t, q, p, self%vq, self%vp, hq, hp)
                  asked = asked + 1
               end if
               if (traits%additive) cycle
               if (.not. (traits%quadratic .or. self%thirds)) then
                  call add_third(self, parts%model, k, -c, t, q, p, self%uq, self%up, hq, hp)
                  asked = asked + 1
               end if
               call add_second_derivatives(n, c, e%qq, e%qp, e%pp, d%qq, d%qp, d%pp, self%uq, self%up, &
                                           self%vq, self%vp, hq, hp, hqq, hqp, hpp)
            end associate
         end do
      end associate
      counters%hessian_vectors = counters%hessian_vectors + nreal*asked
   end subroutine add_exact

   !> c times the third derivative of H_j, of F/h for j = -1, along a and v.
   subroutine add_third(self, model, j, c, t, q, p, aq, ap, hq, hp)
      type(single_brackets), intent(inout) :: self
      class(model_type), intent(in) :: model
      integer, intent(in) :: j
      real(wp), intent(in) :: c, t
      real(wp), intent(in), dimension(self%nlane) :: q, p, aq, ap
      real(wp), intent(inout), dimension(self%nlane) :: hq, hp

      call model%third_derivative(self%nlane, 1, self%nnoise, t, self%unit(:, :, j), q, p, aq, ap, self%vq, self%vp, &
                                  self%gq(:, 1), self%gp(:, 1))
      hq = hq + c*self%gq(:, 1)
      hp = hp + c*self%gp(:, 1)
   end subroutine add_third

   !> (|h|/12) sum_k {{F,H_k},H_k} by the differences of step/modified_hamiltonian: additive noise needs those of H
   !> alone.
   subroutine add_nested(self, parts, t, h, q, p, hq, hp, counters, nreal)
      class(single_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      real(wp), intent(in) :: t, h
      real(wp), intent(in), dimension(self%nlane) :: q, p
      real(wp), intent(inout), dimension(self%nlane) :: hq, hp
      type(counters_type), intent(inout) :: counters
      integer, intent(in) :: nreal
      real(wp) :: a, b, c, c2
      logical :: additive
      integer :: k, asked

      a = reach*abs(h)
      b = reach*sqrt(abs(h))
      c = h/(12*reach**2)
      c2 = h*abs(h)/(48*a*b)
      additive = parts%model%traits%additive
      self%yq = 0
      self%yp = 0
      asked = 0
      associate (n => self%nlane, e => self%of(0), yq => self%yq, yp => self%yp)
         call field(n, e%q, e%p, self%uq, self%up)
         do k = 1, self%nnoise
            if (.not. parts%noisy(k)) cycle
            associate (d => self%of(k))
               call field(n, d%q, d%p, self%vq, self%vp)
               call ask(self, parts%model, -1, t, q, p, 0.0_wp, -b, 1)
               call ask(self, parts%model, -1, t, q, p, 0.0_wp, b, 2)
               asked = asked + 2
               if (additive) then
                  call add_second_difference(n, c, e%q, e%p, self%gq, self%gp, hq, hp)
                  cycle
               end if
               call ask(self, parts%model, k, t, q, p, -a, -b, 3)
               call ask(self, parts%model, k, t, q, p, a, -b, 4)
               call ask(self, parts%model, k, t, q, p, -a, b, 5)
               call ask(self, parts%model, k, t, q, p, a, b, 6)
               asked = asked + 4
               call add_differences(n, a, b, c, c2, e%q, e%p, self%gq, self%gp, d%qq, d%qp, d%pp, hq, hp, yq, yp)
            end associate
         end do
         if (.not. additive) call add_transposed(n, e%qq, e%qp, e%pp, yq, yp, hq, hp)
      end associate
      counters%gradients = counters%gradients + nreal*asked
   end subroutine add_nested

   !> Column `at` of (gq, gp) = gradient of H_j at x + e u + f v.
   subroutine ask(self, model, j, t, q, p, e, f, at)
      type(single_brackets), intent(inout) :: self
      class(model_type), intent(in) :: model
      integer, intent(in) :: j, at
      real(wp), intent(in) :: t, e, f
      real(wp), intent(in), dimension(self%nlane) :: q, p

      call move(self%nlane, e, f, q, self%uq, self%vq, self%xq)
      call move(self%nlane, e, f, p, self%up, self%vp, self%xp)
      call model%gradient(self%nlane, 1, self%nnoise, t, self%unit(:, :, j), self%xq, self%xp, &
                          self%gq(:, at), self%gp(:, at))
   end subroutine ask

   !> VEC
   pure subroutine move(nlane, e, f, x, u, v, moved)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: e, f, x(nlane), u(nlane), v(nlane)
      real(wp), intent(out) :: moved(nlane)
      integer :: lane

      do lane = 1, nlane
         moved(lane) = x(lane) + (e*u(lane) + f*v(lane))
      end do
   end subroutine move

   !> VEC The Hamiltonian field (H_p, -H_q).
   pure subroutine field(nlane, hq, hp, vq, vp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: hq(nlane), hp(nlane)
      real(wp), intent(out) :: vq(nlane), vp(nlane)
      integer :: lane

      do lane = 1, nlane
         vq(lane) = hp(lane)
         vp(lane) = -hq(lane)
      end do
   end subroutine field

end module symsde_step_single_brackets
