! SPDX-License-Identifier: BSD-3-Clause
!> Whole steps of the oscillators of model/flows/oscillator by Lobatto's schemes of three and four stages: with force
!> f = a q + b, velocity v = c p + e and x = a c, solving the linear equations leaves quotients of polynomials in x,
!>
!>    dq = (A v - B c f)/D,   dp = -(C f + B a v)/D
!>
!> With M = I + x a abar of the tableau and 1 a column of ones, D = det M, C = D alpha M^-1 1, B = D alpha M^-1 a 1,
!> and A is C with a and abar exchanged, which leaves B as it is where a scheme is symplectic.
!>
!> Private to its family.
module symsde_model_flows_oscillator_quotients
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: steps_record
   implicit none
   private
   public :: oscillator_terms, step_quotients, has_quotients, quotients_of, quotient_pass, quotient_alone

   !> An oscillator: its angular velocity r, the strengths A, B, C, E of its noises, and which noise each of them is:
   !> 0 where the strength is zero.
   type :: oscillator_terms
      real(wp) :: rate = 1
      real(wp) :: a = 0, b = 0, c = 0, e = 0
      integer :: noise_a = 0, noise_b = 0, noise_c = 0, noise_e = 0
   end type oscillator_terms

   !> The coefficients of A, B, C and D from x on: their constants are 1, and 1/2 of B.
   type :: step_quotients
      real(wp) :: a(3) = 0, b(2) = 0, c(3) = 0, d(2) = 0
   end type step_quotients

   type(step_quotients), parameter :: &
      lobatto3 = step_quotients(a=[-1/8.0_wp, 0.0_wp, 0.0_wp], b=[-1/48.0_wp, 0.0_wp], &
                                c=[-1/8.0_wp, 1/288.0_wp, 0.0_wp], d=[1/24.0_wp, 0.0_wp]), &
      lobatto4 = step_quotients(a=[-2/15.0_wp, 1/300.0_wp, 0.0_wp], b=[-1/40.0_wp, 1/3600.0_wp], &
                                c=[-2/15.0_wp, 1/300.0_wp, -1/43200.0_wp], &
                                d=[1/30.0_wp, 1/1800.0_wp])

   integer, parameter :: short = 4  !! steps of one pass over the lanes

contains

   !> Whether this file has steps of a scheme of this name.
   pure logical function has_quotients(scheme)
      character(*), intent(in) :: scheme

      select case (scheme)
      case ('lobatto3', 'lobatto3_swapped', 'lobatto4', 'lobatto4_swapped')
         has_quotients = .true.
      case default
         has_quotients = .false.
      end select
   end function has_quotients

   !> The quotients of a scheme that has them; those of the swapped pair have A and C exchanged.
   pure type(step_quotients) function quotients_of(scheme) result(found)
      character(*), intent(in) :: scheme

      select case (scheme)
      case ('lobatto3', 'lobatto3_swapped')
         found = lobatto3
      case default
         found = lobatto4
      end select
      if (index(scheme, '_swapped') > 0) found = step_quotients(a=found%c, b=found%b, c=found%a, d=found%d)
   end function quotients_of

   !> VEC One step, or `short` of them, of every lane: a = h + A w_i, and so on for b, c and e.
   pure subroutine quotient_pass(quotients, t, nlane, nnoise, nstep, h, w, q, p)
      type(step_quotients), intent(in) :: quotients
      type(oscillator_terms), intent(in) :: t
      integer, intent(in) :: nlane, nnoise, nstep
      real(wp), intent(in) :: h, w(nlane, 0:nnoise, nstep)
      real(wp), intent(inout) :: q(nlane), p(nlane)
      type(step_quotients) :: by  ! a copy stays in registers
      real(wp) :: x, y, a, c
      integer :: lane, step

      by = quotients
      if (nstep == short) then
         do lane = 1, nlane
            x = q(lane)
            y = p(lane)
            !GCC$ unroll 4
            do step = 1, short
               a = h + t%a*w(lane, t%noise_a, step)
               c = h + t%c*w(lane, t%noise_c, step)
               call quotient_step(by, a, c, a*x + t%b*w(lane, t%noise_b, step), &
                                  c*y + t%e*w(lane, t%noise_e, step), x, y)
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
            call quotient_step(by, a, c, a*x + t%b*w(lane, t%noise_b, 1), c*y + t%e*w(lane, t%noise_e, 1), x, y)
            q(lane) = x
            p(lane) = y
         end do
      end if
   end subroutine quotient_pass

   !> Take the steps of a path that is alone, in lane 1.
   pure subroutine quotient_alone(quotients, terms, steps, w, q, p, qn, pn)
      type(step_quotients), intent(in) :: quotients
      type(oscillator_terms), intent(in) :: terms
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: w(steps%nlane, 0:steps%nnoise, steps%nstep), q, p
      real(wp), intent(inout) :: qn(steps%nlane, steps%nstep/steps%every), pn(steps%nlane, steps%nstep/steps%every)
      type(step_quotients) :: by
      real(wp) :: x, y, a, c, h
      integer :: step, out

      by = quotients
      h = terms%rate*steps%h
      x = q
      y = p
      do out = 1, steps%nstep/steps%every
         do step = (out - 1)*steps%every + 1, out*steps%every
            associate (t => terms)
               a = h + t%a*w(1, t%noise_a, step)
               c = h + t%c*w(1, t%noise_c, step)
               call quotient_step(by, a, c, a*x + t%b*w(1, t%noise_b, step), c*y + t%e*w(1, t%noise_e, step), x, y)
            end associate
         end do
         qn(1, out) = x
         pn(1, out) = y
      end do
   end subroutine quotient_alone

   !> One step by the quotients at the head, with force and velocity where it begins. One division serves all of them.
   pure subroutine quotient_step(by, a, c, force, velocity, x, y)
      type(step_quotients), intent(in) :: by
      real(wp), intent(in) :: a, c, force, velocity
      real(wp), intent(inout) :: x, y
      real(wp) :: z, inverse, both, one, other

      z = a*c
      inverse = 1/(1 + z*(by%d(1) + z*by%d(2)))
      both = (0.5_wp + z*(by%b(1) + z*by%b(2)))*inverse
      one = (1 + z*(by%a(1) + z*(by%a(2) + z*by%a(3))))*inverse
      other = (1 + z*(by%c(1) + z*(by%c(2) + z*by%c(3))))*inverse
      x = x + (one*velocity - (both*c)*force)
      y = y - (other*force + (both*a)*velocity)
   end subroutine quotient_step

end module symsde_model_flows_oscillator_quotients
