! SPDX-License-Identifier: BSD-3-Clause
!>    H = sum_i p_i^2/2 + sum_{i=0}^{n} (r_i^2/2 + beta r_i^4/4),   r_i = q_{i+1} - q_i,  q_0 = q_{n+1} = 0
!>    H_k = -sigma q_k,   k = 1 .. n
!>
!> Whole steps of this chain by kicks at the nodes c_i of a step, with drifts between them: the Euler pair, Verlet, and
!> schemes of kicks from scheme/splitting. With f_i = r_i + beta r_i^3 kick i and the drift behind it are
!>
!>    p_k <- p_k + b_i h (f_k - f_{k-1}) + sigma w_ik - 2 kappa_i h (V_qq V_q)_k,   q <- q + (c_{i+1} - c_i) h p
!>    w_ik = beta_i dW_k + gamma_i (dZ_k/h - dW_k/2) + eta_i K_k,   V = h H + sum_k (dW_k - 12 K_k) H_k
!>
!> A strip of few lanes stays near through all steps of a call: forces of all springs are found in one pass over the
!> strip, and a kick and the drift behind it are another one. Where a step begins and ends by a kick, the last kick and
!> the first one of the next step are at one place: both take the same forces, one after the other, with the bits that
!> they have alone. Noise is weighed for one kick at a time.
!>
!> If the model is damped, momenta decay in every drift as base/record describes.
module symsde_model_flows_fpu_chain
   use symsde_base_counters, only: counters_type
   use symsde_base_damping, only: decay_less_one
   use symsde_base_functionals, only: path_dz, path_stt_area
   use symsde_base_kinds, only: wp
   use symsde_base_maps, only: step_map, euler_map, euler_adjoint_map, verlet_map, kick_drift_kick_map, two_kicks_map, &
                               force_gradient_map
   use symsde_base_record, only: steps_record
   implicit none
   private
   public :: fpu_chain_flow, fpu_chain_has_flow

   integer, parameter :: strip = 8         !! lanes that take all of their steps together
   integer, parameter :: most_sites = 512  !! longest chain of which a strip stays near

   !> Kicks of a scheme, and drifts behind them.
   type :: kick_plan
      integer :: nkick = 0
      integer :: ngradient = 0            !! gradients that are counted in a step: velocities of tableaux count, too
      logical :: joins = .false.          !! the last kick and the first one of the next step are at one place
      real(wp), dimension(3) :: c = 0, b = 0, beta = 0, gamma = 0, eta = 0
      real(wp) :: kappa = 0               !! of the second kick
      ! The remaining numbers follow from the steps of a call.
      integer :: nfunctional = 0          !! drawn: 1, dZ; 2, dZ and K
      real(wp) :: by(3, 3) = 0            !! sigma w_ik = by(1, i) dW_k + by(2, i) dZ_k + by(3, i) K_k
      real(wp) :: inner(3) = 0            !! the same in V
      real(wp) :: reach(0:3) = 0          !! drifts before the first kick and behind each one
      real(wp) :: loss(0:3) = 0           !! change of momenta in these drifts, relative to them
      logical :: loses_first = .false.    !! whether momenta decay before the drift that is before the first kick
   end type kick_plan

contains

   !> Whether this file has steps by a map of a chain of n masses.
   pure logical function fpu_chain_has_flow(map, n) result(has_flow)
      type(step_map), intent(in) :: map
      integer, intent(in) :: n
      type(kick_plan) :: plan

      plan = plan_of(map%equation)
      has_flow = plan%nkick > 0 .and. n <= most_sites .and. .not. map%corrected
   end function fpu_chain_has_flow

   !> The kicks of a map, none of an unknown one.
   pure type(kick_plan) function plan_of(equation) result(plan)
      integer, intent(in) :: equation
      real(wp), parameter :: gauss = 0.5_wp*(1 - sqrt(1/3.0_wp)), sixth = 1/6.0_wp, root = sqrt(3.0_wp)
      real(wp), parameter, dimension(3) :: halves = [0.5_wp, 0.5_wp, 0.0_wp], ends = [0, 1, 0]

      select case (equation)
      case (euler_map, euler_adjoint_map)
         plan = kick_plan(nkick=1, ngradient=2, b=[1, 0, 0], beta=[1, 0, 0])
         if (equation == euler_adjoint_map) plan%c(1) = 1
      case (verlet_map)
         plan = kick_plan(nkick=2, ngradient=3, joins=.true., c=ends, b=halves, beta=halves)
      case (kick_drift_kick_map)
         plan = kick_plan(nkick=2, ngradient=2, joins=.true., c=ends, b=halves, beta=halves, gamma=[1, -1, 0])
      case (two_kicks_map)
         plan = kick_plan(nkick=2, ngradient=2, c=[gauss, 1 - gauss, 0.0_wp], b=halves, beta=halves, &
                          gamma=[root, -root, 0.0_wp])
      case (force_gradient_map)
         plan = kick_plan(nkick=3, ngradient=4, joins=.true., c=[0.0_wp, 0.5_wp, 1.0_wp], &
                          b=[sixth, 4*sixth, sixth], beta=[sixth, 4*sixth, sixth], gamma=[1, 0, -1], &
                          eta=[4, -8, 4], kappa=-1/72.0_wp)
      case default
         plan = kick_plan()
      end select
   end function plan_of

   !> Take steps by the contract of model_type%flow. Silent noises have no functionals.
   subroutine fpu_chain_flow(map, beta, sigma, steps, n, q, p, qn, pn, counters)
      type(step_map), intent(in) :: map
      real(wp), intent(in) :: beta, sigma
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: n
      real(wp), intent(in) :: q(steps%nlane, n), p(steps%nlane, n)
      real(wp), intent(out) :: qn(steps%nlane, n, steps%nstep/steps%every), pn(steps%nlane, n, steps%nstep/steps%every)
      type(counters_type), intent(inout) :: counters
      real(wp), contiguous, pointer, dimension(:, :, :) :: w, dz, k
      real(wp), dimension(min(strip, steps%nlane)*(n + 2)) :: x, f, g, s, y, v, u  !! room of a strip
      type(kick_plan) :: plan
      integer :: first

      plan = plan_of(map%equation)
      call complete(plan, map, sigma, steps)
      w => steps%w  ! contiguous, which gfortran 12 does not recognise for a component
      dz => w       ! placeholders, if no functional is drawn
      k => w
      if (associated(steps%of(path_dz)%x)) dz => steps%of(path_dz)%x
      if (associated(steps%of(path_stt_area)%x)) k => steps%of(path_stt_area)%x
      if (steps%nlane == 1) then
         call pass(plan, beta, steps, 1, 1, n, w, dz, k, q, p, qn, pn, x, f, g, s, y, v, u)
      else
         do first = 1, steps%nlane, strip
            call pass(plan, beta, steps, strip, first, n, w, dz, k, q, p, qn, pn, x, f, g, s, y, v, u)
         end do
      end if
      counters%gradients = counters%gradients + plan%ngradient*steps%nstep*steps%nreal
      if (abs(plan%kappa) > 0) counters%hessian_vectors = counters%hessian_vectors + steps%nstep*steps%nreal
   end subroutine fpu_chain_flow

   !> Drifts, losses and weights of noise in the steps of a call.
   subroutine complete(plan, map, sigma, steps)
      type(kick_plan), intent(inout) :: plan
      type(step_map), intent(in) :: map
      real(wp), intent(in) :: sigma
      type(steps_record), intent(in) :: steps
      real(wp) :: leg(0:3)

      associate (d => steps%decays, h => steps%h, m => plan%nkick)
         leg = 0
         leg(0) = plan%c(1)
         leg(1:m - 1) = plan%c(2:m) - plan%c(1:m - 1)
         leg(m) = 1 - plan%c(m)
         plan%reach = leg*h
         if (map%damped) then
            plan%loss = decay_less_one(leg*d%z)
            if (map%equation == verlet_map) then
               plan%reach = plan%reach*(1 + 0.5_wp*plan%loss)
            else if (m == 1) then
               plan%loss(0) = d%before
               plan%loss(1) = d%after
            else
               plan%reach = -h*plan%loss/d%z
               plan%beta = d%beta
               plan%gamma = d%gamma
               plan%eta = d%eta
            end if
            plan%loses_first = m == 1
         end if
         if (any(abs(plan%gamma) > 0) .and. associated(steps%of(path_dz)%x)) plan%nfunctional = 1
         if (any(abs(plan%eta) > 0) .and. associated(steps%of(path_stt_area)%x)) plan%nfunctional = 2
         plan%by(1, :) = sigma*(plan%beta - 0.5_wp*plan%gamma)
         plan%by(2, :) = sigma*plan%gamma/h
         plan%by(3, :) = sigma*plan%eta
         plan%inner(1) = sigma
         plan%inner(3) = -12*sigma
      end associate
   end subroutine complete

   !> All steps of the lanes first .. first + l - 1; l is strip or 1.
   subroutine pass(plan, beta, steps, l, first, n, w, dz, k, q, p, qn, pn, x, f, g, s, y, v, u)
      type(kick_plan), intent(in) :: plan
      real(wp), intent(in) :: beta
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: l, first, n
      real(wp), intent(in) :: w(steps%nlane, 0:n, steps%nstep)
      real(wp), intent(in), dimension(steps%nlane, n, steps%nstep) :: dz, k
      real(wp), intent(in), dimension(steps%nlane, n) :: q, p
      real(wp), intent(inout), dimension(steps%nlane, n, steps%nstep/steps%every) :: qn, pn
      real(wp), intent(out) :: x(l, 0:n + 1)                   !! positions, with the ends at rest
      real(wp), intent(out) :: f(l, 0:n), g(l, 0:n + 1)        !! forces of springs; V_q, zero at the ends
      real(wp), intent(out) :: s(l, 0:n)                       !! stiffness of springs
      real(wp), intent(out) :: y(l, n)                         !! momenta
      real(wp), intent(out) :: v(l*n), u(l*n)                  !! noises of a kick and of the next one at its place
      real(wp) :: b(3)
      integer :: step, i, next, rows
      logical :: joined, kicked

      rows = merge(1, n, l == steps%nlane)  ! of increments: rows of all lanes are adjacent, and make one
      b = plan%b*steps%h
      x(:, 0) = 0
      x(:, n + 1) = 0
      x(:, 1:n) = q(first:first + l - 1, :)
      y = p(first:first + l - 1, :)
      g(:, 0) = 0
      g(:, n + 1) = 0
      joined = .false.
      do step = 1, steps%nstep
         kicked = joined
         if (plan%c(1) > 0) then
            if (plan%loses_first) call lose(l*n, plan%loss(0), y)
            call drift(l*n, plan%reach(0), y, x(1, 1))
            if (.not. plan%loses_first .and. abs(plan%loss(0)) > 0) call lose(l*n, plan%loss(0), y)
         end if
         do i = 1, plan%nkick
            if (i == 1 .and. kicked) cycle
            joined = plan%joins .and. i == plan%nkick .and. mod(step, steps%every) /= 0
            next = merge(1, i, joined)
            call find_forces(l, l*n, beta, x, f)
            if (i == 2 .and. abs(plan%kappa) > 0) then
               call blend_rows(l, n, steps%nlane, plan%nfunctional, plan%inner, w(first, 1, step), dz(first, 1, step), &
                               k(first, 1, step), g(1, 1))
               call kick_by_gradient(l, l*n, beta, steps%h, 2*plan%kappa*steps%h**2, x, f, s, g, y)
            end if
            associate (reach => plan%reach(next), by => plan%by(1, :))
               if (plan%nfunctional > 0) then
                  call weigh(i, step, v)
                  if (joined) call weigh(1, step + 1, u)
                  if (joined) then
                     call kicks_and_drift(l, l*n, 1, l*n, b(i), b(1), reach, f, 1.0_wp, v, 1.0_wp, u, y, x(1, 1))
                  else
                     call kick_and_drift(l, l*n, 1, l*n, b(i), reach, f, 1.0_wp, v, y, x(1, 1))
                  end if
               else if (joined) then
                  call kicks_and_drift(l, l*n/rows, rows, steps%nlane*n/rows, b(i), b(1), reach, f, by(i), &
                                       w(first, 1, step), by(1), w(first, 1, step + 1), y, x(1, 1))
               else
                  call kick_and_drift(l, l*n/rows, rows, steps%nlane*n/rows, b(i), reach, f, by(i), w(first, 1, step), &
                                      y, x(1, 1))
               end if
            end associate
            if (abs(plan%loss(next)) > 0) call lose(l*n, plan%loss(next), y)
         end do
         if (mod(step, steps%every) == 0) then
            qn(first:first + l - 1, :, step/steps%every) = x(:, 1:n)
            pn(first:first + l - 1, :, step/steps%every) = y
         end if
      end do

   contains

      !> The noise of kick i of a step: sums of increments and functionals.
      subroutine weigh(i, step, v)
         integer, intent(in) :: i, step
         real(wp), intent(out) :: v(l*n)

         call blend_rows(l, n, steps%nlane, plan%nfunctional, plan%by(:, i), w(first, 1, step), dz(first, 1, step), &
                         k(first, 1, step), v)
      end subroutine weigh

   end subroutine pass

   !> VEC Forces f(r) = r + beta r^3 of the springs; x and f have l numbers in a row, and x a row more at both ends.
   pure subroutine find_forces(l, m, beta, x, f)
      integer, intent(in) :: l, m           !! numbers in a row, in all rows
      real(wp), intent(in) :: beta, x(1 - l:m + l)
      real(wp), intent(out) :: f(1 - l:m)
      real(wp) :: r
      integer :: j

      do j = 1 - l, m
         r = x(j + l) - x(j)
         f(j) = r*(1 + beta*r**2)
      end do
   end subroutine find_forces

   !> Sums of weighted increments and functionals, in the lanes of a strip, or in a single lane, whose rows are adjacent
   !> in memory.
   pure subroutine blend_rows(l, n, nlane, nfunctional, c, w, dz, k, v)
      integer, intent(in) :: l, n, nlane, nfunctional
      real(wp), intent(in) :: c(3)
      real(wp), intent(in), dimension((n - 1)*nlane + l) :: w, dz, k  !! rows of nlane numbers
      real(wp), intent(out) :: v(l, n)
      integer :: row, at

      if (l == 1) then
         call blend(n, nfunctional, c(1), c(2), c(3), w, dz, k, v)
      else
         do row = 1, n
            at = (row - 1)*nlane + 1
            call blend(l, nfunctional, c(1), c(2), c(3), w(at), dz(at), k(at), v(1, row))
         end do
      end if
   end subroutine blend_rows

   !> VEC v = a w + b dz + c k, of those that are drawn.
   pure subroutine blend(m, nfunctional, a, b, c, w, dz, k, v)
      integer, intent(in) :: m, nfunctional
      real(wp), intent(in) :: a, b, c
      real(wp), intent(in), dimension(m) :: w, dz, k
      real(wp), intent(out) :: v(m)
      integer :: j

      select case (nfunctional)
      case (0)
         do j = 1, m
            v(j) = a*w(j)
         end do
      case (1)
         do j = 1, m
            v(j) = a*w(j) + (b*dz(j))
         end do
      case default
         do j = 1, m
            v(j) = c*k(j) + (a*w(j) + (b*dz(j)))
         end do
      end select
   end subroutine blend

   !> VEC y = y - (b U_q - a v), and then x = x + reach y. Rows of y are adjacent in memory; those of v may be a row of
   !> all lanes apart, of which a strip is taken: then n > 1.
   pure subroutine kick_and_drift(l, m, n, apart, b, reach, f, a, v, y, x)
      integer, intent(in) :: l, m, n, apart   !! lanes of x, numbers in a row, rows
      real(wp), intent(in) :: b, reach, f(1 - l:m*n), a, v((n - 1)*apart + m)
      real(wp), intent(inout) :: y(m*n), x(m*n)
      integer :: i, j, at

      if (n == 1) then
         do j = 1, m
            call kick(b, f(j - l) - f(j), a, v(j), y(j))
            x(j) = x(j) + reach*y(j)
         end do
      else
         do i = 1, n
            !GCC$ unroll 8
            do j = 1, strip
               at = (i - 1)*strip + j
               call kick(b, f(at - l) - f(at), a, v((i - 1)*apart + j), y(at))
               x(at) = x(at) + reach*y(at)
            end do
         end do
      end if
   end subroutine kick_and_drift

   !> VEC The same with two kicks, one after the other.
   pure subroutine kicks_and_drift(l, m, n, apart, b1, b2, reach, f, a1, v1, a2, v2, y, x)
      integer, intent(in) :: l, m, n, apart
      real(wp), intent(in) :: b1, b2, reach, f(1 - l:m*n), a1, a2
      real(wp), intent(in), dimension((n - 1)*apart + m) :: v1, v2
      real(wp), intent(inout) :: y(m*n), x(m*n)
      integer :: i, j, at

      if (n == 1) then
         do j = 1, m
            call kick(b1, f(j - l) - f(j), a1, v1(j), y(j))
            call kick(b2, f(j - l) - f(j), a2, v2(j), y(j))
            x(j) = x(j) + reach*y(j)
         end do
      else
         do i = 1, n
            !GCC$ unroll 8
            do j = 1, strip
               at = (i - 1)*strip + j
               call kick(b1, f(at - l) - f(at), a1, v1((i - 1)*apart + j), y(at))
               call kick(b2, f(at - l) - f(at), a2, v2((i - 1)*apart + j), y(at))
               x(at) = x(at) + reach*y(at)
            end do
         end do
      end if
   end subroutine kicks_and_drift

   !> y = y - (b slope - a v)
   pure subroutine kick(b, slope, a, v, y)
      real(wp), intent(in) :: b, slope, a, v
      real(wp), intent(inout) :: y

      y = y - (b*slope - (a*v))
   end subroutine kick

   !> VEC y = y - factor U_qq V_q with V_q = h U_q - g; g is zero behind both ends. On return it is V_q.
   pure subroutine kick_by_gradient(l, m, beta, h, factor, x, f, s, g, y)
      integer, intent(in) :: l, m
      real(wp), intent(in) :: beta, h, factor, x(1 - l:m + l), f(1 - l:m)
      real(wp), intent(out) :: s(1 - l:m)
      real(wp), intent(inout) :: g(1 - l:m + l), y(m)
      integer :: j

      do j = 1 - l, m
         s(j) = 1 + 3*beta*(x(j + l) - x(j))**2
      end do
      do j = 1, m
         g(j) = h*(f(j - l) - f(j)) - g(j)
      end do
      do j = 1, m
         y(j) = y(j) - factor*(s(j - l)*(g(j) - g(j - l)) - (s(j)*(g(j + l) - g(j))))
      end do
   end subroutine kick_by_gradient

   !> VEC x = x + reach y.
   pure subroutine drift(m, reach, y, x)
      integer, intent(in) :: m
      real(wp), intent(in) :: reach, y(m)
      real(wp), intent(inout) :: x(m)
      integer :: j

      do j = 1, m
         x(j) = x(j) + reach*y(j)
      end do
   end subroutine drift

   !> VEC y = y + loss y.
   pure subroutine lose(m, loss, y)
      integer, intent(in) :: m
      real(wp), intent(in) :: loss
      real(wp), intent(inout) :: y(m)
      integer :: j

      do j = 1, m
         y(j) = y(j) + loss*y(j)
      end do
   end subroutine lose

end module symsde_model_flows_fpu_chain
