! SPDX-License-Identifier: BSD-3-Clause
!> Whole steps of oscillators whose one-step Hamiltonian is quadratic, separable and has one degree of freedom:
!>
!>    Hhat = (a q^2 + c p^2)/2 + b q + e p,     a = r h + A dW_i,  c = r h + C dW_k,  b = B dW_j,  e = E dW_l
!>
!>    symplectic Euler   p' = p - (a q + b),  q' = q + (c p' + e)                           [WHSB] (89)-(90)
!>    its adjoint        q' = q + (c p + e),  p' = p - (a q' + b)                           [WHSB] (91)-(92)
!>    Stormer-Verlet     half a kick, a drift, half a kick
!>    midpoint           dq = (v - c f/2)/(1 + a c/4), dp = -(f + a v/2)/(1 + a c/4), f = a q + b, v = c p + e
!>
!> ([WHSB] (71)-(72) solved). A group of steps keeps the states of the lanes in registers; a path that is alone goes
!> through all of its steps at once.
module symsde_model_oscillator_flow
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: steps_record
   implicit none
   private
   public :: oscillator_terms, oscillator_flow, oscillator_has_flow

   !> The angular velocity r; strengths of the noises, and which they are, 0 where the strength is zero.
   type :: oscillator_terms
      real(wp) :: rate = 1
      real(wp) :: a = 0, b = 0, c = 0, e = 0
      integer :: noise_a = 0, noise_b = 0, noise_c = 0, noise_e = 0
   end type oscillator_terms

   enum, bind(c)
      enumerator :: euler = 1, adjoint = 2, verlet = 3, midpoint = 4, additive_euler = 5, additive_adjoint = 6
   end enum

   integer, parameter :: group = 8  !! steps of one pass over the lanes

contains

   !> Whether these steps are offered here.
   pure logical function oscillator_has_flow(scheme) result(has_flow)
      character(*), intent(in) :: scheme

      has_flow = index_of(scheme) > 0
   end function oscillator_has_flow

   pure integer function index_of(scheme)
      character(*), intent(in) :: scheme

      select case (scheme)
      case ('symplectic_euler')
         index_of = euler
      case ('symplectic_euler_adjoint')
         index_of = adjoint
      case ('stormer_verlet')
         index_of = verlet
      case ('midpoint')
         index_of = midpoint
      case default
         index_of = 0
      end select
   end function index_of

   !> The contract of model_type%flow, for one degree of freedom.
   subroutine oscillator_flow(terms, scheme, steps, q, p, qn, pn, counters)
      type(oscillator_terms), intent(in) :: terms
      character(*), intent(in) :: scheme
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: q(steps%nlane), p(steps%nlane)
      real(wp), intent(out) :: qn(steps%nlane, steps%nstep/steps%every), pn(steps%nlane, steps%nstep/steps%every)
      type(counters_type), intent(inout) :: counters
      real(wp), contiguous, pointer :: w(:, :, :)
      integer :: which, out, n, m

      w => steps%w  ! contiguous, as gfortran 12 does not see of a component
      m = merge(1, steps%nlane, steps%nreal == 1)  ! a path that is alone is lane 1
      which = index_of(scheme)
      if (terms%noise_a == 0 .and. terms%noise_c == 0) then
         if (which == euler) which = additive_euler
         if (which == adjoint) which = additive_adjoint
      end if
      do out = 1, steps%nstep/steps%every
         if (out == 1) then
            qn(:m, out) = q(:m)
            pn(:m, out) = p(:m)
         else
            qn(:m, out) = qn(:m, out - 1)
            pn(:m, out) = pn(:m, out - 1)
         end if
         call advance(terms, which, steps%nreal == 1, steps%nlane, steps%nnoise, steps%every, terms%rate*steps%h, &
                      w(:, :, (out - 1)*steps%every + 1:out*steps%every), qn(:, out), pn(:, out))
      end do
      n = steps%nstep*steps%nreal
      if (which == midpoint) then
         counters%iterations = counters%iterations + n
         counters%solves = counters%solves + n
      else
         counters%gradients = counters%gradients + n*merge(3, 2, which == verlet)
      end if
   end subroutine oscillator_flow

   !> Steps in place, in groups as long as there are enough; those of a path that is alone at once, in lane 1.
   pure subroutine advance(terms, which, alone, nlane, nnoise, nstep, h, w, q, p)
      type(oscillator_terms), intent(in) :: terms
      integer, intent(in) :: which, nlane, nnoise, nstep
      logical, intent(in) :: alone
      real(wp), intent(in) :: h, w(nlane, 0:nnoise, nstep)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      integer :: first, n

      first = 1
      do while (first <= nstep)
         n = merge(group, 1, nstep - first + 1 >= group)
         if (alone) n = nstep
         associate (t => terms)
            select case (which)
            case (euler)
               call euler_pass(h, t%a, t%b, t%c, t%e, t%noise_a, t%noise_b, t%noise_c, t%noise_e, alone, nlane, &
                               nnoise, n, w(:, :, first:), q, p)
            case (adjoint)  ! the scheme itself with (q, p) -> (p, -q)
               call euler_pass(-h, -t%c, -t%e, -t%a, -t%b, t%noise_c, t%noise_e, t%noise_a, t%noise_b, alone, nlane, &
                               nnoise, n, w(:, :, first:), p, q)
            case (additive_euler)
               call additive_pass(h, t%b, t%e, t%noise_b, t%noise_e, alone, nlane, nnoise, n, w(:, :, first:), q, p)
            case (additive_adjoint)
               call additive_pass(-h, -t%e, -t%b, t%noise_e, t%noise_b, alone, nlane, nnoise, n, w(:, :, first:), p, q)
            case (verlet)
               call verlet_pass(t, alone, nlane, nnoise, n, h, w(:, :, first:), q, p)
            case default
               call midpoint_pass(t, alone, nlane, nnoise, n, h, w(:, :, first:), q, p)
            end select
         end associate
         first = first + n
      end do
   end subroutine advance

   ! ---- kernels: nstep is 1 or group, or any number for lane 1 alone ----------------------------------

   !> VEC Force at x, then velocity at y.
   pure subroutine euler_pass(h, ca, cb, cc, ce, i, j, k, l, alone, nlane, nnoise, nstep, w, q, p)
      real(wp), intent(in) :: h, ca, cb, cc, ce   !! strengths of the noises i, j, k, l
      integer, intent(in) :: i, j, k, l
      logical, intent(in) :: alone
      integer, intent(in) :: nlane, nnoise, nstep
      real(wp), intent(in) :: w(nlane, 0:nnoise, nstep)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      real(wp) :: x, y
      integer :: lane, step

      if (alone) then
         x = q(1)
         y = p(1)
         !GCC$ novector  ! each step waits for the one before it
         do step = 1, nstep
            call kick_and_drift(h + ca*w(1, i, step), cb*w(1, j, step), h + cc*w(1, k, step), ce*w(1, l, step), x, y)
         end do
         q(1) = x
         p(1) = y
      else if (nstep == group) then
         do lane = 1, nlane
            x = q(lane)
            y = p(lane)
            !GCC$ unroll 8
            do step = 1, group
               call kick_and_drift(h + ca*w(lane, i, step), cb*w(lane, j, step), h + cc*w(lane, k, step), &
                                   ce*w(lane, l, step), x, y)
            end do
            q(lane) = x
            p(lane) = y
         end do
      else
         do lane = 1, nlane
            x = q(lane)
            y = p(lane)
            call kick_and_drift(h + ca*w(lane, i, 1), cb*w(lane, j, 1), h + cc*w(lane, k, 1), ce*w(lane, l, 1), x, y)
            q(lane) = x
            p(lane) = y
         end do
      end if
   end subroutine euler_pass

   !> VEC The same where a = c = h.
   pure subroutine additive_pass(h, cb, ce, j, l, alone, nlane, nnoise, nstep, w, q, p)
      real(wp), intent(in) :: h, cb, ce   !! strengths of the noises j, l
      integer, intent(in) :: j, l
      logical, intent(in) :: alone
      integer, intent(in) :: nlane, nnoise, nstep
      real(wp), intent(in) :: w(nlane, 0:nnoise, nstep)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      real(wp) :: x, y
      integer :: lane, step

      if (alone) then
         x = q(1)
         y = p(1)
         !GCC$ novector  ! each step waits for the one before it
         do step = 1, nstep
            call kick_and_drift(h, cb*w(1, j, step), h, ce*w(1, l, step), x, y)
         end do
         q(1) = x
         p(1) = y
      else if (nstep == group) then
         do lane = 1, nlane
            x = q(lane)
            y = p(lane)
            !GCC$ unroll 8
            do step = 1, group
               call kick_and_drift(h, cb*w(lane, j, step), h, ce*w(lane, l, step), x, y)
            end do
            q(lane) = x
            p(lane) = y
         end do
      else
         do lane = 1, nlane
            x = q(lane)
            y = p(lane)
            call kick_and_drift(h, cb*w(lane, j, 1), h, ce*w(lane, l, 1), x, y)
            q(lane) = x
            p(lane) = y
         end do
      end if
   end subroutine additive_pass

   !> VEC Half a kick, a drift, half a kick.
   pure subroutine verlet_pass(terms, alone, nlane, nnoise, nstep, h, w, q, p)
      type(oscillator_terms), intent(in) :: terms
      logical, intent(in) :: alone
      integer, intent(in) :: nlane, nnoise, nstep
      real(wp), intent(in) :: h, w(nlane, 0:nnoise, nstep)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      real(wp) :: x, y, ca, cb, cc, ce
      integer :: lane, step, i, j, k, l

      ca = terms%a
      cb = terms%b
      cc = terms%c
      ce = terms%e
      i = terms%noise_a
      j = terms%noise_b
      k = terms%noise_c
      l = terms%noise_e
      if (alone) then
         x = q(1)
         y = p(1)
         !GCC$ novector  ! each step waits for the one before it
         do step = 1, nstep
            call verlet_step(h + ca*w(1, i, step), cb*w(1, j, step), h + cc*w(1, k, step), ce*w(1, l, step), x, y)
         end do
         q(1) = x
         p(1) = y
      else if (nstep == group) then
         do lane = 1, nlane
            x = q(lane)
            y = p(lane)
            !GCC$ unroll 8
            do step = 1, group
               call verlet_step(h + ca*w(lane, i, step), cb*w(lane, j, step), h + cc*w(lane, k, step), &
                                ce*w(lane, l, step), x, y)
            end do
            q(lane) = x
            p(lane) = y
         end do
      else
         do lane = 1, nlane
            x = q(lane)
            y = p(lane)
            call verlet_step(h + ca*w(lane, i, 1), cb*w(lane, j, 1), h + cc*w(lane, k, 1), ce*w(lane, l, 1), x, y)
            q(lane) = x
            p(lane) = y
         end do
      end if
   end subroutine verlet_pass

   !> VEC The linear equations solved.
   pure subroutine midpoint_pass(terms, alone, nlane, nnoise, nstep, h, w, q, p)
      type(oscillator_terms), intent(in) :: terms
      logical, intent(in) :: alone
      integer, intent(in) :: nlane, nnoise, nstep
      real(wp), intent(in) :: h, w(nlane, 0:nnoise, nstep)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      real(wp) :: x, y, ca, cb, cc, ce
      integer :: lane, step, i, j, k, l

      ca = terms%a
      cb = terms%b
      cc = terms%c
      ce = terms%e
      i = terms%noise_a
      j = terms%noise_b
      k = terms%noise_c
      l = terms%noise_e
      if (alone) then
         x = q(1)
         y = p(1)
         !GCC$ novector  ! each step waits for the one before it
         do step = 1, nstep
            call midpoint_step(h + ca*w(1, i, step), cb*w(1, j, step), h + cc*w(1, k, step), ce*w(1, l, step), x, y)
         end do
         q(1) = x
         p(1) = y
      else if (nstep == group) then
         do lane = 1, nlane
            x = q(lane)
            y = p(lane)
            !GCC$ unroll 8
            do step = 1, group
               call midpoint_step(h + ca*w(lane, i, step), cb*w(lane, j, step), h + cc*w(lane, k, step), &
                                  ce*w(lane, l, step), x, y)
            end do
            q(lane) = x
            p(lane) = y
         end do
      else
         do lane = 1, nlane
            x = q(lane)
            y = p(lane)
            call midpoint_step(h + ca*w(lane, i, 1), cb*w(lane, j, 1), h + cc*w(lane, k, 1), ce*w(lane, l, 1), x, y)
            q(lane) = x
            p(lane) = y
         end do
      end if
   end subroutine midpoint_pass

   pure subroutine kick_and_drift(a, b, c, e, x, y)
      real(wp), intent(in) :: a, b, c, e
      real(wp), intent(inout) :: x, y

      y = y - (a*x + b)
      x = x + (c*y + e)
   end subroutine kick_and_drift

   pure subroutine verlet_step(a, b, c, e, x, y)
      real(wp), intent(in) :: a, b, c, e
      real(wp), intent(inout) :: x, y

      y = y - 0.5_wp*(a*x + b)
      x = x + (c*y + e)
      y = y - 0.5_wp*(a*x + b)
   end subroutine verlet_step

   pure subroutine midpoint_step(a, b, c, e, x, y)
      real(wp), intent(in) :: a, b, c, e
      real(wp), intent(inout) :: x, y
      real(wp) :: inverse, force, velocity

      inverse = 1/(1 + 0.25_wp*a*c)
      force = a*x + b
      velocity = c*y + e
      x = x + (velocity - 0.5_wp*c*force)*inverse
      y = y - (force + 0.5_wp*a*velocity)*inverse
   end subroutine midpoint_step

end module symsde_model_oscillator_flow
