! SPDX-License-Identifier: BSD-3-Clause
!> Whole steps of the oscillators of model/flows/oscillator whose momenta are damped by one rate (base/record), Hhat =
!> (a q^2 + c p^2)/2 + b q + e p. The decay of a momentum is always the sum p + (exp(-z) - 1) p, never the product
!> exp(-z) p:
!>
!>    Euler pair   p + (exp(-c z) - 1) p, the step of the closed oscillator, p + (exp(-(1 - c) z) - 1) p; or corrected
!>    Verlet       half a kick, the drift by (1 + exp(-z))/2 p, p + (exp(-z) - 1) p, half a kick
!>    Lobatto      half a drift, p + (exp(-z) - 1) p, a kick by (1 + exp(-z))/2 of the force, half a drift
!>    midpoint     q' = q + n12 p + (m11 q + g1),  p' = p + m22 p + (n21 q + g2)
!>    gauss2       the same with other numbers
!>
!> The six numbers of the midpoint rule, with D = 1 + a c/4,
!>
!>    m11 = -a c/(2 D),   n12 = exp(-z/2) c/D,   g1 = (e - b c/2)/D
!>    n21 = -exp(-z/2) a/D,   m22 = exp(-z) (1 + m11) - 1,   g2 = -exp(-z/2) (b + a e/2)/D
!>
!> follow from the closed form of its step, taken between two decays. They depend on the weights alone: from one step to
!> the next only two products depend on each other, and no division.
!>
!> Two stages of Gauss have slopes G = -(1 + x B)^{-1} ((a q + b) 1 + x p d + a e c), x = a c, where B is the product of
!> the coefficients of positions and of momenta, d has the decays of p_n at the stages, and
!>
!>    q' = q + c ((1 + mean) p + v.G) + e,   p' = exp(-z) p + w.G
!>
!> The factor of c p in q' is also the factor of -a q in p', since the scheme is symmetric. A row times (1 + x B)^{-1}
!> times a column is a polynomial of degree one in x over det (1 + x B).
!>
!> Each scheme brings one step of one lane, `take`, to the loops of oscillator_steps.inc. No sum has two products of
!> which the compiler might contract either: one of the two is added to zero first.
module symsde_model_flows_damped_oscillator
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp
   use symsde_base_lanes, only: lane_unit
   use symsde_base_maps, only: step_map, euler_map, euler_adjoint_map, verlet_map, verlet_swapped_map, midpoint_map, &
                               gauss2_map
   use symsde_base_record, only: steps_record
   use symsde_model_flows_oscillator, only: oscillator_terms, count_oscillator_steps
   implicit none
   private
   public :: damped_oscillator_flow, damped_oscillator_has_flow

   !> Changes of a momentum relative to it, exp(-z) - 1, by the decays before a step, after it, and over the whole step.
   type :: losses
      real(wp) :: before = 0, after = 0, all = 0
   end type losses

   real(wp), parameter :: skew = sqrt(3.0_wp)/6
   real(wp), parameter :: gauss_c(2) = [0.5_wp - skew, 0.5_wp + skew]
   real(wp), parameter :: gauss_a(2, 2) = reshape([0.25_wp, 0.25_wp + skew, 0.25_wp - skew, 0.25_wp], [2, 2])

   !> The polynomials of two stages of Gauss in x, after their division by the determinant 1 + x trace + x^2 det.
   type :: gauss_terms
      real(wp) :: all = 0                      !! exp(-z) - 1
      real(wp) :: trace = 0, det = 0
      real(wp), dimension(2) :: v1 = 0, vc = 0, w1 = 0, wd = 0, wc = 0   !! rows v and w with columns 1, d and c
   end type gauss_terms

   !> One step of two stages of Gauss, where the weights of b and e are still to be multiplied.
   type :: gauss_step
      real(wp) :: part, m11, m22   !! the factor of c p and -a q, and of q and p
      real(wp) :: cv1, evc, awc    !! the factors of -b in g1, of -e beside one in g1, and of -e in g2
   end type gauss_step

contains

   !> Whether this file has damped steps by a map for these noises.
   pure logical function damped_oscillator_has_flow(terms, map) result(has_flow)
      type(oscillator_terms), intent(in) :: terms
      type(step_map), intent(in) :: map

      if (map%corrected) then
         has_flow = any(map%equation == [euler_map, euler_adjoint_map]) .and. &
                    terms%noise_b == 0 .and. terms%noise_e == 0
      else
         has_flow = any(map%equation == [euler_map, euler_adjoint_map, verlet_map, verlet_swapped_map, midpoint_map, &
                                         gauss2_map])
      end if
   end function damped_oscillator_has_flow

   !> Take steps by the contract of model_type%flow, of a map that damped_oscillator_has_flow knows.
   subroutine damped_oscillator_flow(terms, map, steps, q, p, qn, pn, counters)
      type(oscillator_terms), intent(in) :: terms
      type(step_map), intent(in) :: map
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: q(steps%nlane), p(steps%nlane)
      real(wp), intent(out), dimension(steps%nlane, steps%nstep/steps%every) :: qn, pn
      type(counters_type), intent(inout) :: counters
      real(wp), contiguous, pointer :: w(:, :, :)
      type(losses) :: lost
      type(gauss_terms) :: of
      logical :: one_form, additive

      call count_oscillator_steps(map, steps%nstep*steps%nreal, counters)
      w => steps%w  ! a pointer that gfortran 12 knows to be contiguous, unlike the component
      lost = losses(steps%decays%before, steps%decays%after, steps%decays%lost(3))
      associate (t => terms, h => terms%rate*steps%h)
         one_form = t%noise_a == t%noise_c .and. abs(t%a - t%c) <= 0 .and. t%noise_b == 0 .and. t%noise_e == 0
         additive = t%noise_a == 0 .and. t%noise_c == 0
         select case (map%equation)
         case (midpoint_map)
            if (one_form) call turns(lost, t, steps, h, w, q, p, qn, pn)
            if (.not. one_form) call midpoint(lost, t, steps, h, w, q, p, qn, pn)
         case (gauss2_map)
            of = gauss_of(steps%decays%lost, steps%decays%left)
            if (t%noise_b == 0 .and. t%noise_e == 0) then
               call gauss_turns(of, t, steps, h, w, q, p, qn, pn)
            else if (additive) then
               call additive_gauss(gauss_step_of(of, h, h), t, steps, h, w, q, p, qn, pn)
            else
               call gauss(of, t, steps, h, w, q, p, qn, pn)
            end if
         case (euler_map)
            if (map%corrected) then
               call corrected_euler(lost, t, steps, h, w, q, p, qn, pn)
            else if (additive) then
               call additive_euler(lost, t, steps, h, w, q, p, qn, pn)
            else
               call euler(lost, t, steps, h, w, q, p, qn, pn)
            end if
         case (euler_adjoint_map)
            if (map%corrected) call corrected_adjoint(lost, t, steps, h, w, q, p, qn, pn)
            if (.not. map%corrected) call adjoint(lost, t, steps, h, w, q, p, qn, pn)
         case (verlet_map)
            call verlet(lost, t, steps, h, w, q, p, qn, pn)
         case default  ! verlet_swapped_map
            call swapped(lost, t, steps, h, w, q, p, qn, pn)
         end select
      end associate
   end subroutine damped_oscillator_flow

   !> VEC The midpoint rule.
   pure subroutine midpoint(lost, t, steps, h, w, q, p, qn, pn)
      type(losses), intent(in) :: lost
      include 'oscillator_steps.inc'

   contains

      pure subroutine take(wa, wb, wc, we, x, y)
         real(wp), value :: wa, wb, wc, we
         real(wp), intent(inout) :: x, y
         real(wp) :: a, b, c, e, inverse, m11, g1, g2, moved

         a = h + t%a*wa
         c = h + t%c*wc
         b = 0 + t%b*wb
         e = 0 + t%e*we
         inverse = 1/(1 + 0.25_wp*(a*c))
         m11 = -0.5_wp*((a*c)*inverse)
         g1 = 0 + (e - 0.5_wp*(c*b))*inverse
         g2 = 0 - (1 + lost%after)*((b + 0.5_wp*(a*e))*inverse)
         moved = (x + ((1 + lost%before)*(c*inverse))*y) + (m11*x + g1)
         y = (y + (lost%all + (1 + lost%all)*m11)*y) + (g2 - ((1 + lost%after)*(a*inverse))*x)
         x = moved
      end subroutine take

   end subroutine midpoint

   !> VEC The midpoint rule where a = c and b = e = 0.
   pure subroutine turns(lost, t, steps, h, w, q, p, qn, pn)
      type(losses), intent(in) :: lost
      include 'oscillator_steps.inc'

   contains

      pure subroutine take(wa, wb, wc, we, x, y)
         real(wp), value :: wa, wb, wc, we  !! of a, b, c, e: here wc is wa, and wb and we have strength zero
         real(wp), intent(inout) :: x, y
         real(wp) :: a, factor, m11, moved

         a = h + t%a*wa
         factor = a/(1 + (0.5_wp*a)*(0.5_wp*a))
         m11 = (-0.5_wp*a)*factor
         moved = (x + ((1 + lost%before)*factor)*y) + m11*x
         y = (y + (lost%all + (1 + lost%all)*m11)*y) - ((1 + lost%after)*factor)*x
         x = moved
      end subroutine take

   end subroutine turns

   !> The numbers of two stages of Gauss from the decays of a step (base/record).
   pure type(gauss_terms) function gauss_of(lost, left) result(g)
      real(wp), intent(in) :: lost(5), left(5)
      real(wp), parameter :: ones(2) = 1
      real(wp) :: decaying(2, 2), b(2, 2), d(2), v(2), w(2), with_loss(2)
      integer :: j

      ! Between both nodes momenta decay by left(2), and grow by its inverse on the way back.
      decaying = gauss_a
      decaying(2, 1) = gauss_a(2, 1)*left(2)
      decaying(1, 2) = gauss_a(1, 2)/left(2)
      d = left([1, 5])
      b = matmul(gauss_a, decaying)
      g%all = lost(3)
      g%trace = b(1, 1) + b(2, 2)
      g%det = b(1, 1)*b(2, 2) - b(1, 2)*b(2, 1)
      do j = 1, 2
         v(j) = 0.5_wp*(decaying(1, j) + decaying(2, j))
         w(j) = 0.5_wp*d(3 - j)
         with_loss(j) = gauss_a(j, 1)*d(1) + (gauss_a(j, 2)*d(2))
      end do
      call divide(v, ones, g%v1)
      call divide(v, gauss_c, g%vc)
      call divide(w, ones, g%w1)
      call divide(w, with_loss, g%wd)
      call divide(w, gauss_c, g%wc)

   contains

      !> The coefficients of row.(1 + x B)^{-1} column det (1 + x B), a polynomial in x.
      pure subroutine divide(row, column, terms)
         real(wp), intent(in) :: row(2), column(2)
         real(wp), intent(out) :: terms(2)
         integer :: i

         terms(1) = row(1)*column(1) + (row(2)*column(2))
         terms(2) = g%trace*terms(1)
         do i = 1, 2
            terms(2) = terms(2) - row(i)*(b(i, 1)*column(1) + (b(i, 2)*column(2)))
         end do
      end subroutine divide

   end function gauss_of

   !> VEC Two stages of Gauss.
   pure subroutine gauss(of, t, steps, h, w, q, p, qn, pn)
      type(gauss_terms), intent(in) :: of
      include 'oscillator_steps.inc'

   contains

      pure subroutine take(wa, wb, wc, we, x, y)
         real(wp), value :: wa, wb, wc, we
         real(wp), intent(inout) :: x, y
         real(wp) :: a, c

         a = h + t%a*wa
         c = h + t%c*wc
         call take_gauss(gauss_step_of(of, a, c), a, c, 0 + t%b*wb, 0 + t%e*we, x, y)
      end subroutine take

   end subroutine gauss

   !> VEC Two stages of Gauss where a = c = h: all noise is in b and e, and the steps differ by these alone.
   pure subroutine additive_gauss(s, t, steps, h, w, q, p, qn, pn)
      type(gauss_step), intent(in) :: s
      include 'oscillator_steps.inc'

   contains

      pure subroutine take(wa, wb, wc, we, x, y)
         real(wp), value :: wa, wb, wc, we  !! the strengths of the first and the third are zero
         real(wp), intent(inout) :: x, y

         call take_gauss(s, h, h, 0 + t%b*wb, 0 + t%e*we, x, y)
      end subroutine take

   end subroutine additive_gauss

   !> The factors of a step with the weights a and c.
   pure type(gauss_step) function gauss_step_of(of, a, c) result(s)
      type(gauss_terms), intent(in) :: of
      real(wp), intent(in) :: a, c
      real(wp) :: both, inverse, v1

      both = a*c
      inverse = 1/(1 + both*(of%trace + both*of%det))
      s%part = (of%w1(1) + both*of%w1(2))*inverse
      v1 = (of%v1(1) + both*of%v1(2))*inverse
      s%m11 = 0 - both*v1
      s%m22 = of%all - both*((of%wd(1) + both*of%wd(2))*inverse)
      s%cv1 = c*v1
      s%evc = both*((of%vc(1) + both*of%vc(2))*inverse)
      s%awc = a*((of%wc(1) + both*of%wc(2))*inverse)
   end function gauss_step_of

   !> Take a step with these factors.
   pure subroutine take_gauss(s, a, c, b, e, x, y)
      type(gauss_step), intent(in) :: s
      real(wp), intent(in) :: a, c, b, e
      real(wp), intent(inout) :: x, y
      real(wp) :: g1, g2, moved

      g1 = e - e*s%evc
      g1 = g1 - b*s%cv1
      g2 = 0 - s%part*b
      g2 = g2 - e*s%awc
      moved = (x + (c*s%part)*y) + (s%m11*x + g1)
      y = (y + s%m22*y) + (g2 - (a*s%part)*x)
      x = moved
   end subroutine take_gauss

   !> VEC Two stages of Gauss where b = e = 0.
   pure subroutine gauss_turns(of, t, steps, h, w, q, p, qn, pn)
      type(gauss_terms), intent(in) :: of
      include 'oscillator_steps.inc'

   contains

      pure subroutine take(wa, wb, wc, we, x, y)
         real(wp), value :: wa, wb, wc, we  !! the strengths of the second and the last are zero
         real(wp), intent(inout) :: x, y
         real(wp) :: a, c, both, inverse, part, rest, moved

         a = h + t%a*wa
         c = h + t%c*wc
         both = a*c
         inverse = 1/(1 + both*(of%trace + both*of%det))
         part = (of%w1(1) + both*of%w1(2))*inverse
         rest = both*inverse
         moved = (x + (c*part)*y) - (rest*(of%v1(1) + both*of%v1(2)))*x
         y = (y + (of%all - rest*(of%wd(1) + both*of%wd(2)))*y) - (a*part)*x
         x = moved
      end subroutine take

   end subroutine gauss_turns

   !> VEC Symplectic Euler.
   pure subroutine euler(lost, t, steps, h, w, q, p, qn, pn)
      type(losses), intent(in) :: lost
      include 'oscillator_steps.inc'

   contains

      pure subroutine take(wa, wb, wc, we, x, y)
         real(wp), value :: wa, wb, wc, we
         real(wp), intent(inout) :: x, y

         y = y + lost%before*y
         y = y - ((h + t%a*wa)*x + t%b*wb)
         x = x + ((h + t%c*wc)*y + t%e*we)
         y = y + lost%after*y
      end subroutine take

   end subroutine euler

   !> VEC Symplectic Euler where a = c = h: momenta decay after its step, whose node is 0.
   pure subroutine additive_euler(lost, t, steps, h, w, q, p, qn, pn)
      type(losses), intent(in) :: lost
      include 'oscillator_steps.inc'

   contains

      pure subroutine take(wa, wb, wc, we, x, y)
         real(wp), value :: wa, wb, wc, we  !! the strengths of the first and the third are zero
         real(wp), intent(inout) :: x, y

         y = y - (h*x + t%b*wb)
         x = x + (h*y + t%e*we)
         y = y + lost%after*y
      end subroutine take

   end subroutine additive_euler

   !> VEC The adjoint of symplectic Euler.
   pure subroutine adjoint(lost, t, steps, h, w, q, p, qn, pn)
      type(losses), intent(in) :: lost
      include 'oscillator_steps.inc'

   contains

      pure subroutine take(wa, wb, wc, we, x, y)
         real(wp), value :: wa, wb, wc, we
         real(wp), intent(inout) :: x, y

         y = y + lost%before*y
         x = x + ((h + t%c*wc)*y + t%e*we)
         y = y - ((h + t%a*wa)*x + t%b*wb)
         y = y + lost%after*y
      end subroutine take

   end subroutine adjoint

   !> VEC Corrected symplectic Euler, with d = a c/2 of the noises; these occur in a and c alone.
   pure subroutine corrected_euler(lost, t, steps, h, w, q, p, qn, pn)
      type(losses), intent(in) :: lost
      include 'oscillator_steps.inc'

   contains

      pure subroutine take(wa, wb, wc, we, x, y)
         real(wp), value :: wa, wb, wc, we  !! weights of a, b, c, e: b and e are zero here
         real(wp), intent(inout) :: x, y
         real(wp) :: a, c, d

         a = t%a*wa
         c = t%c*wc
         d = 0.5_wp*(a*c)
         y = y + lost%before*y
         y = (y - (h + a)*x)*(1/(1 + d))
         x = (x + d*x) + (h + c)*y
         y = y + lost%after*y
      end subroutine take

   end subroutine corrected_euler

   !> VEC Its adjoint: q' = (q + c p)/(1 + d), p' = (1 + d) p - a q'.
   pure subroutine corrected_adjoint(lost, t, steps, h, w, q, p, qn, pn)
      type(losses), intent(in) :: lost
      include 'oscillator_steps.inc'

   contains

      pure subroutine take(wa, wb, wc, we, x, y)
         real(wp), value :: wa, wb, wc, we  !! the second and the last have strength zero
         real(wp), intent(inout) :: x, y
         real(wp) :: a, c, d

         a = t%a*wa
         c = t%c*wc
         d = 0.5_wp*(a*c)
         y = y + lost%before*y
         x = (x + (h + c)*y)*(1/(1 + d))
         y = (y + d*y) - (h + a)*x
         y = y + lost%after*y
      end subroutine take

   end subroutine corrected_adjoint

   !> VEC Stormer-Verlet.
   pure subroutine verlet(lost, t, steps, h, w, q, p, qn, pn)
      type(losses), intent(in) :: lost
      include 'oscillator_steps.inc'

   contains

      pure subroutine take(wa, wb, wc, we, x, y)
         real(wp), value :: wa, wb, wc, we
         real(wp), intent(inout) :: x, y
         real(wp) :: a

         a = h + t%a*wa
         y = y - 0.5_wp*(a*x + t%b*wb)
         x = x + (((1 + 0.5_wp*lost%all)*(h + t%c*wc))*y + t%e*we)
         y = y + lost%all*y
         y = y - 0.5_wp*(a*x + t%b*wb)
      end subroutine take

   end subroutine verlet

   !> VEC The other Lobatto pair of two stages: half a drift, a kick, half a drift.
   pure subroutine swapped(lost, t, steps, h, w, q, p, qn, pn)
      type(losses), intent(in) :: lost
      include 'oscillator_steps.inc'

   contains

      pure subroutine take(wa, wb, wc, we, x, y)
         real(wp), value :: wa, wb, wc, we
         real(wp), intent(inout) :: x, y
         real(wp) :: c

         c = h + t%c*wc
         x = x + 0.5_wp*(c*y + t%e*we)
         y = y + lost%all*y
         y = y - (1 + 0.5_wp*lost%all)*((h + t%a*wa)*x + t%b*wb)
         x = x + 0.5_wp*(c*y + t%e*we)
      end subroutine take

   end subroutine swapped

end module symsde_model_flows_damped_oscillator
