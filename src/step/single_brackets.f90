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
   use symsde_model_abstract, only: model_type
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
   subroutine evaluate(self, parts, t, step, q, p, hq, hp, hqq, hqp, hpp, counters, nreal)
      class(single_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(inout) :: parts
      real(wp), intent(in) :: t
      type(step_record), intent(in) :: step
      real(wp), intent(in), dimension(self%nlane) :: q, p
      real(wp), intent(inout), dimension(self%nlane) :: hq, hp, hqq, hqp, hpp
      type(counters_type), intent(inout) :: counters
      integer, intent(in) :: nreal
      integer :: asked, gradients

      if (parts%simple) then
         call self%position%evaluate(parts, t, step, self%c, self%rate, q, p, hq, hp, hqq, hqp, hpp, gradients, asked)
         counters%gradients = counters%gradients + nreal*(gradients - asked)
      else
         call add_up(self, parts, t, step, q, p, hq, hp, hqq, hqp, hpp, asked)
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

   !> Any model: sum_j w_j H_j, {sum_k c_k H_k, H} and sum_l {H_l, sum_{k<l} A_kl H_k}.
   subroutine add_up(self, parts, t, step, q, p, hq, hp, hqq, hqp, hpp, asked)
      class(single_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      real(wp), intent(in) :: t
      type(step_record), intent(in) :: step
      real(wp), intent(in), dimension(self%nlane) :: q, p
      real(wp), intent(inout), dimension(self%nlane) :: hq, hp, hqq, hqp, hpp
      integer, intent(out) :: asked
      integer :: j, k, l

      hq = 0
      hp = 0
      hqq = 0
      hqp = 0
      hpp = 0
      asked = 0
      associate (n => self%nlane, m => self%nnoise, noisy => parts%noisy, f => self%f)
         do j = 0, m
            if (j > 0) then
               if (.not. noisy(j)) cycle
            end if
            associate (d => self%of(j))
               call parts%model%gradient_hessian(n, 1, m, t, self%unit(:, :, j), q, p, d%q, d%p, d%qq, d%qp, d%pp)
               call add_multiple(n, step%w(:, j), d%q, d%p, d%qq, d%qp, d%pp, hq, hp, hqq, hqp, hpp)
               if (self%thirds) call parts%model%third_derivative(n, 1, m, t, self%unit(:, :, j), q, p, self%one, &
                                                                  self%one, self%one, self%one, d%qqq, d%ppp)
            end associate
            asked = asked + 1
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

   !> VEC Additive noise: c [H(x+bv) + H(x-bv) - 2H(x)], whose gradients are the columns 1 and 2 of (gq, gp), and
   !> (eq, ep).
   pure subroutine add_second_difference(nlane, c, eq, ep, gq, gp, hq, hp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: c, eq(nlane), ep(nlane), gq(nlane, 6), gp(nlane, 6)
      real(wp), intent(inout), dimension(nlane) :: hq, hp
      integer :: lane

      do lane = 1, nlane
         hq(lane) = hq(lane) + c*((gq(lane, 1) + gq(lane, 2)) - 2*eq(lane))
         hp(lane) = hp(lane) + c*((gp(lane, 1) + gp(lane, 2)) - 2*ep(lane))
      end do
   end subroutine add_second_difference

   !> VEC The same, and what the points share by the fields: that of H_k, by its Hessian (qq, qp, pp), and that of H, to
   !> which (yq, yp) is added; with c2 times the mixed difference of H_k at x -+ a u - b v and x -+ a u + b v, whose
   !> gradients are the columns 3 and 4, 5 and 6.
   pure subroutine add_differences(nlane, a, b, c, c2, eq, ep, gq, gp, qq, qp, pp, hq, hp, yq, yp)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: a, b, c, c2, eq(nlane), ep(nlane), gq(nlane, 6), gp(nlane, 6)
      real(wp), intent(in), dimension(nlane) :: qq, qp, pp
      real(wp), intent(inout), dimension(nlane) :: hq, hp, yq, yp
      real(wp) :: rq, rp, before, behind
      integer :: lane

      do lane = 1, nlane
         before = gq(lane, 4) - gq(lane, 3)
         behind = gq(lane, 6) - gq(lane, 5)
         rq = b*(c*(gq(lane, 2) - gq(lane, 1)) - c2*(before + behind))
         hq(lane) = hq(lane) + (c*((gq(lane, 1) + gq(lane, 2)) - 2*eq(lane)) - c2*(behind - before))
         yq(lane) = yq(lane) - a*c2*((gq(lane, 5) - gq(lane, 3)) + (gq(lane, 6) - gq(lane, 4)))
         before = gp(lane, 4) - gp(lane, 3)
         behind = gp(lane, 6) - gp(lane, 5)
         rp = b*(c*(gp(lane, 2) - gp(lane, 1)) - c2*(before + behind))
         hp(lane) = hp(lane) + (c*((gp(lane, 1) + gp(lane, 2)) - 2*ep(lane)) - c2*(behind - before))
         yp(lane) = yp(lane) - a*c2*((gp(lane, 5) - gp(lane, 3)) + (gp(lane, 6) - gp(lane, 4)))
         hq(lane) = hq(lane) + (qp(lane)*rq - qq(lane)*rp)
         hp(lane) = hp(lane) + (pp(lane)*rq - qp(lane)*rp)
      end do
   end subroutine add_differences

   !> VEC Add (D field)^T r = Hessian (-r_p, r_q).
   pure subroutine add_transposed(nlane, qq, qp, pp, rq, rp, hq, hp)
      integer, intent(in) :: nlane
      real(wp), intent(in), dimension(nlane) :: qq, qp, pp, rq, rp
      real(wp), intent(inout), dimension(nlane) :: hq, hp
      integer :: lane

      do lane = 1, nlane
         hq(lane) = hq(lane) + (qp(lane)*rq(lane) - qq(lane)*rp(lane))
         hp(lane) = hp(lane) + (pp(lane)*rq(lane) - qp(lane)*rp(lane))
      end do
   end subroutine add_transposed

end module symsde_step_single_brackets
