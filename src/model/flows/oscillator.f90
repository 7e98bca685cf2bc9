! SPDX-License-Identifier: BSD-3-Clause
!> Whole steps of oscillators whose one-step Hamiltonian is quadratic, separable and has one degree of freedom:
!>
!>    Hhat = (a q^2 + c p^2)/2 + b q + e p,     a = r h + A dW_i,  c = r h + C dW_k,  b = B dW_j,  e = E dW_l
!>
!>    symplectic Euler   p' = p - (a q + b),  q' = q + (c p' + e)                           [WHSB] (89)-(90)
!>    its adjoint        q' = q + (c p + e),  p' = p - (a q' + b)                           [WHSB] (91)-(92)
!>    corrected          with d q p added to Hhat: p' = (p - (a q + b))/(1 + d),  q' = q + (c p' + e) + d q, where
!>                       d = A dW_i C dW_k/2; its adjoint takes (q, p) -> (p, -q), and -d becomes d
!>    Stormer-Verlet     half a kick, a drift, half a kick; the other Lobatto pair takes (q, p) -> (p, -q)
!>    midpoint           dq = (v - c f/2)/(1 + a c/4), dp = -(f + a v/2)/(1 + a c/4), f = a q + b, v = c p + e
!>    Gauss              dq = 2 o (u v - o c f)/(u^2 + o^2 a c), dp = -2 o (u f + o a v)/(u^2 + o^2 a c)
!>
!> ([WHSB] (71)-(72) solved.) Where Z is the matrix of the linear equations, a scheme of Gauss adds (N/D - 1) (q, p)
!> of Pade's quotient for exp(Z), with D = u - o Z, N = u + o Z, and Z^2 = -a c: whatever is rounded in u and o leaves
!> a rotation one. For Lobatto's schemes see model/flows/oscillator_quotients. A group of steps keeps the states of
!> the lanes in registers; a path that is alone goes through all of its steps at once.
module symsde_model_flows_oscillator
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: steps_record
   use symsde_model_abstract, only: corrected
   use symsde_model_flows_oscillator_quotients, only: oscillator_terms, step_quotients, has_quotients, quotients_of, &
                                                      quotient_pass, quotient_alone
   implicit none
   private
   public :: oscillator_terms, oscillator_flow, oscillator_has_flow

   enum, bind(c)
      enumerator :: euler = 1, adjoint = 2, verlet = 3, swapped_verlet = 4, additive_euler = 5, additive_adjoint = 6
      enumerator :: midpoint = 7, gauss2 = 8, gauss3 = 9, gauss4 = 10, quotients = 11  ! from midpoint on by one solve
      enumerator :: corrected_euler = 12, corrected_adjoint = 13
   end enum

   !> The coefficients of the polynomials u and o in a c, from the first power on: u begins with 1, o with 1/2.
   type :: pade_terms
      real(wp) :: u(2) = 0, o = 0
   end type pade_terms

   type(pade_terms), parameter :: &
      pade(midpoint:gauss4) = [pade_terms(), pade_terms(u=[-1/12.0_wp, 0.0_wp]), &
                               pade_terms(u=[-1/10.0_wp, 0.0_wp], o=-1/120.0_wp), &
                               pade_terms(u=[-3/28.0_wp, 1/1680.0_wp], o=-1/84.0_wp)]

   !> Steps of one pass over the lanes; `short` is for steps of more operations than gcc would unroll eight times.
   integer, parameter :: group = 8, short = 4

contains

   !> Whether this file has steps of a scheme for these noises: corrected ones where noise is in a and c alone, those
   !> with brackets where all brackets vanish.
   pure logical function oscillator_has_flow(terms, scheme) result(has_flow)
      type(oscillator_terms), intent(in) :: terms
      character(*), intent(in) :: scheme

      has_flow = index_of(scheme) > 0
      if (index_of(scheme) >= corrected_euler) has_flow = terms%noise_b == 0 .and. terms%noise_e == 0
      if (index_of(scheme) == gauss2 .and. scheme /= 'gauss2') has_flow = is_of_one_form(terms)  ! its brackets
   end function oscillator_has_flow

   !> Whether every H_j is a multiple of p^2 + q^2, so that all brackets vanish.
   pure logical function is_of_one_form(terms)
      type(oscillator_terms), intent(in) :: terms

      is_of_one_form = terms%noise_a == terms%noise_c .and. abs(terms%a - terms%c) <= 0 .and. &
                       terms%noise_b == 0 .and. terms%noise_e == 0
   end function is_of_one_form

   !> Which steps a name means; 0 for names that are not known. Schemes with brackets are those of gauss2, since they
   !> are taken where the brackets vanish.
   pure integer function index_of(scheme)
      character(*), intent(in) :: scheme

      select case (scheme)
      case ('symplectic_euler')
         index_of = euler
      case ('symplectic_euler_adjoint')
         index_of = adjoint
      case ('stormer_verlet')
         index_of = verlet
      case ('lobatto2_swapped')
         index_of = swapped_verlet
      case ('midpoint')
         index_of = midpoint
      case ('gauss2', 'gauss2_strong32', 'gauss2_strong32_areas', 'gauss2_weak2', 'gauss2_weak2_areas')
         index_of = gauss2  ! where brackets vanish
      case ('gauss3')
         index_of = gauss3
      case ('gauss4')
         index_of = gauss4
      case ('symplectic_euler'//corrected)
         index_of = corrected_euler
      case ('symplectic_euler_adjoint'//corrected)
         index_of = corrected_adjoint
      case default
         index_of = merge(quotients, 0, has_quotients(scheme))
      end select
   end function index_of

   !> Take steps by the contract of model_type%flow, for one degree of freedom. Adjoint schemes are their partners on
   !> the oscillator that is turned, and are asked so.
   subroutine oscillator_flow(terms, scheme, steps, q, p, qn, pn, counters)
      type(oscillator_terms), intent(in) :: terms
      character(*), intent(in) :: scheme
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: q(steps%nlane), p(steps%nlane)
      real(wp), intent(out) :: qn(steps%nlane, steps%nstep/steps%every), pn(steps%nlane, steps%nstep/steps%every)
      type(counters_type), intent(inout) :: counters
      real(wp), contiguous, pointer :: w(:, :, :)
      type(step_quotients) :: by
      integer :: which, out, n

      w => steps%w  ! contiguous, as gfortran 12 does not see of a component
      which = index_of(scheme)
      if (which == quotients) by = quotients_of(scheme)
      if (steps%nreal == 1 .and. which == corrected_euler) then
         call corrected_alone(terms, steps, terms%rate*steps%h, w, q(1), p(1), qn, pn)
      else if (steps%nreal == 1 .and. which == corrected_adjoint) then
         call corrected_alone(turned(terms), steps, -terms%rate*steps%h, w, p(1), q(1), pn, qn)
      else if (steps%nreal == 1 .and. which == quotients) then
         call quotient_alone(by, terms, steps, w, q(1), p(1), qn, pn)
      else if (steps%nreal == 1) then
         call advance_alone(terms, which, steps, w, q(1), p(1), qn, pn)
      else
         if (terms%noise_a == 0 .and. terms%noise_c == 0) then
            if (which == euler) which = additive_euler
            if (which == adjoint) which = additive_adjoint
         end if
         do out = 1, steps%nstep/steps%every
            if (out == 1) then
               qn(:, out) = q
               pn(:, out) = p
            else
               qn(:, out) = qn(:, out - 1)
               pn(:, out) = pn(:, out - 1)
            end if
            call advance(terms, which, by, steps, w(:, :, (out - 1)*steps%every + 1:out*steps%every), qn(:, out), &
                         pn(:, out))
         end do
      end if
      n = steps%nstep*steps%nreal
      if (which >= midpoint) then
         counters%iterations = counters%iterations + n
         counters%solves = counters%solves + n
      else
         counters%gradients = counters%gradients + n*merge(3, 2, which == verlet .or. which == swapped_verlet)
      end if
   end subroutine oscillator_flow

   !> The oscillator with (q, p) -> (p, -q), on which a scheme is the adjoint of what it is here; its steps have the
   !> other sign.
   pure type(oscillator_terms) function turned(t)
      type(oscillator_terms), intent(in) :: t

      turned = oscillator_terms(rate=t%rate, a=-t%c, b=-t%e, c=-t%a, e=-t%b, noise_a=t%noise_c, noise_b=t%noise_e, &
                                noise_c=t%noise_a, noise_e=t%noise_b)
   end function turned

   !> Take `every` steps of a block in place, in groups as long as there are enough.
   pure subroutine advance(terms, which, by, steps, w, q, p)
      type(oscillator_terms), intent(in) :: terms
      type(step_quotients), intent(in) :: by   !! of the schemes that have them
      integer, intent(in) :: which
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: w(steps%nlane, 0:steps%nnoise, steps%every)
      real(wp), intent(inout) :: q(steps%nlane), p(steps%nlane)
      real(wp) :: h
      integer :: first, n

      h = terms%rate*steps%h
      first = 1
      do while (first <= steps%every)
         n = merge(short, group, which >= midpoint)
         if (steps%every - first + 1 < n) n = 1
         associate (t => terms, nlane => steps%nlane, m => steps%nnoise)
            select case (which)
            case (euler)
               call euler_pass(t, nlane, m, n, h, w(:, :, first:), q, p)
            case (adjoint)
               call euler_pass(turned(t), nlane, m, n, -h, w(:, :, first:), p, q)
            case (additive_euler)
               call additive_pass(t, nlane, m, n, h, w(:, :, first:), q, p)
            case (additive_adjoint)
               call additive_pass(turned(t), nlane, m, n, -h, w(:, :, first:), p, q)
            case (corrected_euler)
               call corrected_pass(t, nlane, m, n, h, w(:, :, first:), q, p)
            case (corrected_adjoint)
               call corrected_pass(turned(t), nlane, m, n, -h, w(:, :, first:), p, q)
            case (verlet)
               call verlet_pass(t, nlane, m, n, h, w(:, :, first:), q, p)
            case (swapped_verlet)
               call verlet_pass(turned(t), nlane, m, n, -h, w(:, :, first:), p, q)
            case (quotients)
               call quotient_pass(by, t, nlane, m, n, h, w(:, :, first:), q, p)
            case default
               call gauss_pass(t, pade(which), nlane, m, n, h, w(:, :, first:), q, p)
            end select
         end associate
         first = first + n
      end do
   end subroutine advance

   !> Take the steps of a path that is alone, in lane 1: each waits for the one before it.
   pure subroutine advance_alone(terms, which, steps, w, q, p, qn, pn)
      type(oscillator_terms), intent(in) :: terms
      integer, intent(in) :: which
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: w(steps%nlane, 0:steps%nnoise, steps%nstep), q, p
      real(wp), intent(inout) :: qn(steps%nlane, steps%nstep/steps%every), pn(steps%nlane, steps%nstep/steps%every)
      type(pade_terms) :: by
      real(wp) :: x, y, a, c, h
      integer :: step, out

      h = terms%rate*steps%h
      x = q
      y = p
      by = pade(max(which, midpoint))
      do out = 1, steps%nstep/steps%every
         do step = (out - 1)*steps%every + 1, out*steps%every
            associate (b => terms%b, e => terms%e, wb => w(1, terms%noise_b, step), we => w(1, terms%noise_e, step))
               a = h + terms%a*w(1, terms%noise_a, step)
               c = h + terms%c*w(1, terms%noise_c, step)
               select case (which)
               case (euler)
                  call kick_and_drift(a, b, wb, c, e, we, x, y)
               case (adjoint)
                  call kick_and_drift(-c, -e, we, -a, -b, wb, y, x)
               case (verlet)
                  call verlet_step(a, b, wb, c, e, we, x, y)
               case (swapped_verlet)
                  call verlet_step(-c, -e, we, -a, -b, wb, y, x)
               case default
                  call gauss_step(by, a, c, a*x + b*wb, c*y + e*we, x, y)
               end select
            end associate
         end do
         qn(1, out) = x
         pn(1, out) = y
      end do
   end subroutine advance_alone

   !> Take the steps of the corrected scheme for a path that is alone, in lane 1.
   pure subroutine corrected_alone(terms, steps, h, w, q, p, qn, pn)
      type(oscillator_terms), intent(in) :: terms
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: h, w(steps%nlane, 0:steps%nnoise, steps%nstep), q, p
      real(wp), intent(inout) :: qn(steps%nlane, steps%nstep/steps%every), pn(steps%nlane, steps%nstep/steps%every)
      real(wp) :: x, y
      integer :: step, out

      x = q
      y = p
      do out = 1, steps%nstep/steps%every
         do step = (out - 1)*steps%every + 1, out*steps%every
            call corrected_step(h, terms%a*w(1, terms%noise_a, step), terms%c*w(1, terms%noise_c, step), x, y)
         end do
         qn(1, out) = x
         pn(1, out) = y
      end do
   end subroutine corrected_alone

   ! ---- kernels: nstep is 1 or a group ----------------------------------

   !> VEC Symplectic Euler: the force at x, then the velocity at the new y.
   pure subroutine euler_pass(t, nlane, nnoise, nstep, h, w, q, p)
      type(oscillator_terms), intent(in) :: t
      integer, intent(in) :: nlane, nnoise, nstep
      real(wp), intent(in) :: h, w(nlane, 0:nnoise, nstep)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      real(wp) :: x, y
      integer :: lane, step

      if (nstep == group) then
         do lane = 1, nlane
            x = q(lane)
            y = p(lane)
            !GCC$ unroll 8
            do step = 1, group
               call kick_and_drift(h + t%a*w(lane, t%noise_a, step), t%b, w(lane, t%noise_b, step), &
                                   h + t%c*w(lane, t%noise_c, step), t%e, w(lane, t%noise_e, step), x, y)
            end do
            q(lane) = x
            p(lane) = y
         end do
      else
         do lane = 1, nlane
            x = q(lane)
            y = p(lane)
            call kick_and_drift(h + t%a*w(lane, t%noise_a, 1), t%b, w(lane, t%noise_b, 1), &
                                h + t%c*w(lane, t%noise_c, 1), t%e, w(lane, t%noise_e, 1), x, y)
            q(lane) = x
            p(lane) = y
         end do
      end if
   end subroutine euler_pass

   !> VEC The corrected scheme, where noises are in a and c alone.
   pure subroutine corrected_pass(t, nlane, nnoise, nstep, h, w, q, p)
      type(oscillator_terms), intent(in) :: t
      integer, intent(in) :: nlane, nnoise, nstep
      real(wp), intent(in) :: h, w(nlane, 0:nnoise, nstep)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      real(wp) :: x, y
      integer :: lane, step

      if (nstep == short) then
         do lane = 1, nlane
            x = q(lane)
            y = p(lane)
            !GCC$ unroll 4
            do step = 1, short
               call corrected_step(h, t%a*w(lane, t%noise_a, step), t%c*w(lane, t%noise_c, step), x, y)
            end do
            q(lane) = x
            p(lane) = y
         end do
      else
         do lane = 1, nlane
            x = q(lane)
            y = p(lane)
            call corrected_step(h, t%a*w(lane, t%noise_a, 1), t%c*w(lane, t%noise_c, 1), x, y)
            q(lane) = x
            p(lane) = y
         end do
      end if
   end subroutine corrected_pass

   !> VEC Symplectic Euler where a = c = h: noise is in b and e alone.
   pure subroutine additive_pass(t, nlane, nnoise, nstep, h, w, q, p)
      type(oscillator_terms), intent(in) :: t
      integer, intent(in) :: nlane, nnoise, nstep
      real(wp), intent(in) :: h, w(nlane, 0:nnoise, nstep)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      real(wp) :: x, y
      integer :: lane, step

      if (nstep == group) then
         do lane = 1, nlane
            x = q(lane)
            y = p(lane)
            !GCC$ unroll 8
            do step = 1, group
               call kick_and_drift(h, t%b, w(lane, t%noise_b, step), h, t%e, w(lane, t%noise_e, step), x, y)
            end do
            q(lane) = x
            p(lane) = y
         end do
      else
         do lane = 1, nlane
            x = q(lane)
            y = p(lane)
            call kick_and_drift(h, t%b, w(lane, t%noise_b, 1), h, t%e, w(lane, t%noise_e, 1), x, y)
            q(lane) = x
            p(lane) = y
         end do
      end if
   end subroutine additive_pass

   !> VEC Stormer-Verlet: half a kick, a drift, half a kick.
   pure subroutine verlet_pass(t, nlane, nnoise, nstep, h, w, q, p)
      type(oscillator_terms), intent(in) :: t
      integer, intent(in) :: nlane, nnoise, nstep
      real(wp), intent(in) :: h, w(nlane, 0:nnoise, nstep)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      real(wp) :: x, y
      integer :: lane, step

      if (nstep == group) then
         do lane = 1, nlane
            x = q(lane)
            y = p(lane)
            !GCC$ unroll 8
            do step = 1, group
               call verlet_step(h + t%a*w(lane, t%noise_a, step), t%b, w(lane, t%noise_b, step), &
                                h + t%c*w(lane, t%noise_c, step), t%e, w(lane, t%noise_e, step), x, y)
            end do
            q(lane) = x
            p(lane) = y
         end do
      else
         do lane = 1, nlane
            x = q(lane)
            y = p(lane)
            call verlet_step(h + t%a*w(lane, t%noise_a, 1), t%b, w(lane, t%noise_b, 1), &
                             h + t%c*w(lane, t%noise_c, 1), t%e, w(lane, t%noise_e, 1), x, y)
            q(lane) = x
            p(lane) = y
         end do
      end if
   end subroutine verlet_pass

   !> VEC The midpoint rule and schemes of Gauss, whose linear equations are solved: `numbers` says which.
   pure subroutine gauss_pass(t, numbers, nlane, nnoise, nstep, h, w, q, p)
      type(oscillator_terms), intent(in) :: t
      type(pade_terms), intent(in) :: numbers
      integer, intent(in) :: nlane, nnoise, nstep
      real(wp), intent(in) :: h, w(nlane, 0:nnoise, nstep)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      type(pade_terms) :: by  ! a copy stays in registers
      real(wp) :: x, y, a, c
      integer :: lane, step

      by = numbers
      if (nstep == short) then
         do lane = 1, nlane
            x = q(lane)
            y = p(lane)
            !GCC$ unroll 4
            do step = 1, short
               a = h + t%a*w(lane, t%noise_a, step)
               c = h + t%c*w(lane, t%noise_c, step)
               call gauss_step(by, a, c, a*x + t%b*w(lane, t%noise_b, step), c*y + t%e*w(lane, t%noise_e, step), x, y)
            end do
            q(lane) = x
            p(lane) = y
         end do
      else
         do lane = 1, nlane
            x = q(lane)
            y = p(lane)
            a = h + t%a*w(lane, t%noise_a, 1)
            c = h + t%c*w(lane, t%noise_c, 1)
            call gauss_step(by, a, c, a*x + t%b*w(lane, t%noise_b, 1), c*y + t%e*w(lane, t%noise_e, 1), x, y)
            q(lane) = x
            p(lane) = y
         end do
      end if
   end subroutine gauss_pass

   ! In the steps of one lane products of noise stand behind those with x and y, which are then the ones that are
   ! contracted, wherever a step is inlined.

   !> y <- y - (a x + b), x <- x + (c y + e), with b = cb wb and e = ce we.
   pure subroutine kick_and_drift(a, cb, wb, c, ce, we, x, y)
      real(wp), intent(in) :: a, cb, wb, c, ce, we
      real(wp), intent(inout) :: x, y

      y = y - (a*x + cb*wb)
      x = x + (c*y + ce*we)
   end subroutine kick_and_drift

   !> The corrected step, with d = a c/2 of the noises.
   pure subroutine corrected_step(h, a, c, x, y)
      real(wp), intent(in) :: h, a, c  !! the last two: of the noises alone
      real(wp), intent(inout) :: x, y
      real(wp) :: d

      d = 0.5_wp*(a*c)
      y = (y - (h + a)*x)*(1/(1 + d))
      x = x + ((h + c)*y + d*x)
   end subroutine corrected_step

   !> Half a kick, a drift, half a kick.
   pure subroutine verlet_step(a, cb, wb, c, ce, we, x, y)
      real(wp), intent(in) :: a, cb, wb, c, ce, we
      real(wp), intent(inout) :: x, y

      y = y - 0.5_wp*(a*x + cb*wb)
      x = x + (c*y + ce*we)
      y = y - 0.5_wp*(a*x + cb*wb)
   end subroutine verlet_step

   !> The step of Gauss by u and o; force and velocity are f = a q + b and v = c p + e where it begins.
   pure subroutine gauss_step(by, a, c, force, velocity, x, y)
      type(pade_terms), intent(in) :: by
      real(wp), intent(in) :: a, c, force, velocity
      real(wp), intent(inout) :: x, y
      real(wp) :: z, u, o, factor

      z = a*c
      u = 1 + z*(by%u(1) + z*by%u(2))
      o = 0.5_wp + z*by%o
      factor = 2*o/(u*u + z*(o*o))
      x = x + (u*velocity - (o*c)*force)*factor
      y = y - (u*force + (o*a)*velocity)*factor
   end subroutine gauss_step

end module symsde_model_flows_oscillator
