! SPDX-License-Identifier: BSD-3-Clause
!> Kernels: fast operations of a model, each for the inner loop of one kind of stepper.
!>
!> Kernels are optional. A model that extends kernel_model declares in `offers` which kernels it has. A stepper looks
!> for them once, when it is made (kernels_of, offers_of), and works without missing ones. The results of a kernel have
!> the same bits as those of the model's general operations in one lane; whole steps agree to rounding.
module symsde_model_kernels
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_maps, only: step_map
   use symsde_base_record, only: steps_record
   use symsde_base_traits, only: strip_lanes
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: kernel_model, kernel_offers, angle_terms
   public :: kernels_of, offers_of, differences_alone, has_exact_stiffness

   !> Terms of a model with one degree of freedom whose force contains the sine and the cosine of its angle:
   !>
   !>    sum_j w_j H_j = e p^2/2 + f p - a cos q + b sin q + c q^2/2 + d q        f = 0 for an angle
   type :: angle_terms
      real(wp) :: a = 0, b = 0, c = 0, d = 0, e = 0, f = 0
   end type angle_terms

   !> The kernels of a model. Whole steps are declared for each map (has_flow).
   type :: kernel_offers
      logical :: rows = .false.         !! chain_rows: force and stiffness of a strip of lanes, row by row
      logical :: rows_of_one = .false.  !! force_stiffness with b = 1 has the bits of chain_rows for one lane
      logical :: pair = .false.         !! pair: two degrees of freedom of a path, without arrays
      logical :: sweeps = .false.       !! sweeps: over stages of a path with one or two degrees of freedom
      logical :: angle = .false.        !! angle: all derivatives of an angle follow from its terms
      logical :: linear = .false.       !! angle: one degree of freedom, quadratic, terms without sine
      logical :: squares = .false.      !! squares: products of gradients and Hessians of all noises
      logical :: pull = .false.         !! pull: covectors over several steps of kicks and drifts
   end type kernel_offers

   type, abstract, extends(model_type) :: kernel_model
      type(kernel_offers) :: offers
   contains
      procedure :: chain_rows => chain_rows_missing
      procedure :: sweeps => sweeps_missing
      procedure :: pair => pair_missing
      procedure :: angle => angle_missing
      procedure :: squares => squares_missing
      procedure :: pull => pull_missing
      procedure :: has_flow => has_no_flow
      procedure :: steps_by_parts => has_no_flow
      procedure :: drift => drift_missing
      procedure :: kick => kick_missing
      procedure :: flow => no_flow
   end type kernel_model

contains

   !> The model as a model with kernels; null if it has none.
   function kernels_of(model) result(kernels)
      class(model_type), intent(in), target :: model
      class(kernel_model), pointer :: kernels

      nullify (kernels)
      select type (model)
      class is (kernel_model)
         kernels => model
      end select
   end function kernels_of

   !> The kernels that a model has.
   pure function offers_of(model) result(offers)
      class(model_type), intent(in) :: model
      type(kernel_offers) :: offers

      if (associated(model%forces)) return  ! kernels know Hamiltonians alone
      select type (model)
      class is (kernel_model)
         offers = model%offers
      end select
   end function offers_of

   !> Whether all second derivatives are differences of gradients, so that a matrix takes many gradients.
   pure logical function differences_alone(model)
      class(model_type), intent(in) :: model
      type(kernel_offers) :: offers

      offers = offers_of(model)
      differences_alone = .not. (model%traits%has_hessian .or. model%traits%has_hessian_vector .or. offers%rows)
   end function differences_alone

   !> Whether the model itself has products with the stiffness, or its rows, so that matrices are exact to rounding.
   pure logical function has_exact_stiffness(model)
      class(model_type), intent(in) :: model
      type(kernel_offers) :: offers

      offers = offers_of(model)
      has_exact_stiffness = offers%rows .or. model%traits%has_hessian_vector
   end function has_exact_stiffness

   !> Rows first..last of the result of force_stiffness with b = 1, in a strip of lanes, for Hamiltonians p.p/2 + U(q)
   !> with noise in position or additive; the stiffness is the derivative of the force to rounding.
   subroutine chain_rows_missing(self, ndof, nnoise, first, last, t, w, q, hq, hqq)
      class(kernel_model), intent(in) :: self
      integer, intent(in) :: ndof, nnoise, first, last
      real(wp), intent(in) :: t, w(strip_lanes, 0:nnoise)
      real(wp), intent(in) :: q(strip_lanes, first - 1:last + 1)  !! rows 0 and ndof + 1 are zero
      real(wp), intent(out) :: hq(strip_lanes, first:last), hqq(strip_lanes, 0:1, first:last)

      hq = ieee_value(1.0_wp, ieee_quiet_nan)
      hqq = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine chain_rows_missing

   !> Sweeps over stages i1 .. i2 of a path with one or two degrees of freedom and noise in position. The positions of
   !> its stages are
   !>
   !>    base_i + sum_j b_ji f_j      summed cyclically from j = i on, with separate b for the first sweep,
   !>
   !> and each new f_i = Hhat_q is used immediately. There are up to four stages. Sweeps are so cheap that some may be
   !> wasted.
   subroutine sweeps_missing(self, nnoise, nstage, i1, i2, first, last, t, w, p, base, b, most, f, change, extent)
      class(kernel_model), intent(in) :: self
      integer, intent(in) :: nnoise, nstage, i1, i2, first, last, most
      real(wp), intent(in) :: t(nstage), w(0:nnoise), p(self%traits%ndof), base(4, 2), b(4, 4, 2)
      real(wp), intent(inout) :: f(4, 2, 0:most)  !! forces of all stages after each sweep; before `first` given
      !> For each sweep. The change is NaN if a force is NaN; a sweep may miss a NaN in its change, but then the
      !> positions and the forces of the next sweep are NaN.
      real(wp), intent(inout), dimension(most) :: change, extent

      f(:, :, first:last) = ieee_value(1.0_wp, ieee_quiet_nan)
      change(first:last) = ieee_value(1.0_wp, ieee_quiet_nan)
      extent(first:last) = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine sweeps_missing

   !> Hhat_q and Hhat_qq of one path of two degrees of freedom, with noise in position or additive: scalars without
   !> arrays, with the same bits as gradient_hessian.
   subroutine pair_missing(self, nnoise, t, w, q1, q2, f1, f2, k11, k21, k12, k22)
      class(kernel_model), intent(in) :: self
      integer, intent(in) :: nnoise
      real(wp), intent(in) :: t, w(0:nnoise)
      real(wp), value :: q1, q2
      real(wp), intent(out) :: f1, f2, k11, k21, k12, k22

      f1 = ieee_value(1.0_wp, ieee_quiet_nan)
      f2 = f1
      k11 = f1
      k21 = f1
      k12 = f1
      k22 = f1
   end subroutine pair_missing

   !> For a single path, the terms of sum_j w_j H_j if this is the Hamiltonian of an angle, or quadratic: requested once
   !> for each time; force and slope at many angles then follow without calling the model. Noises that move positions do
   !> not depend on time. The bits are those of gradient_hessian,
   !>
   !>    Hhat_q = a sin q + (b cos q + (c q + d)),  Hhat_qq = a cos q + (c - b sin q),  Hhat_p = e p + f,
   !>
   !> where vanishing terms do not change the sum, and no sum has two products that could be contracted.
   subroutine angle_missing(self, nnoise, t, w, terms)
      class(kernel_model), intent(in) :: self
      integer, intent(in) :: nnoise
      real(wp), intent(in) :: t, w(0:nnoise)
      type(angle_terms), intent(out) :: terms

      terms%a = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine angle_missing

   !> For noises H_k(t,q) and the mass one, the gradient in q of (1/2) sum_k H_k,q . H_k,q,
   !>
   !>    g = sum_k (Hess H_k) H_k,q
   !>
   !> at one pass over all noises: a gradient and a product for each noise that meets others would take a time
   !> proportional to the square of their number, since each of them evaluates all noises. Where w, c and s are present
   !> there is one degree of freedom, and the same pass gives derivatives of two sums, S = sum_j w_j H_j and C = sum_j
   !> c_j H_j with c_0 = 0:
   !>
   !>    s = (S', S'', C', C'', C''', g')
   subroutine squares_missing(self, nlane, ndof, nnoise, t, q, g, w, c, s)
      class(kernel_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, q(nlane, ndof)
      real(wp), intent(out) :: g(nlane, ndof)
      real(wp), intent(in), dimension(nlane, 0:nnoise), optional :: w, c
      real(wp), intent(out), optional :: s(nlane, 6)

      g = ieee_value(1.0_wp, ieee_quiet_nan)
      if (present(s)) s = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine squares_missing

   !> Covectors u of all positions and c of the first nmoving momenta, taken back over nstep steps of kicks and drifts
   !> of H = p.p/2 + U(q), noise in position; positions behind the first nmoving are parameters, which stay. At each
   !> state s = nstep .. 0, at the time t + s h,
   !>
   !>    u <- u - S_qq c     S = (a + b) h H + sum_k (a dW_k(s-1) + b dW_k(s)) H_k,     a = part(2), b = part(1),
   !>
   !> with a = 0 at s = 0, b = 0 at s = nstep; then, but at s = 0, c <- c + h u of the first nmoving positions.
   subroutine pull_missing(self, nlane, ndof, nnoise, nmoving, nstep, t, h, part, dw, q, theta, u, c)
      class(kernel_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise, nmoving, nstep
      real(wp), intent(in) :: t, h, part(2), dw(nlane, nnoise, nstep)
      real(wp), intent(in) :: q(nlane, nmoving, 0:nstep), theta(nlane, ndof - nmoving)
      real(wp), intent(inout) :: u(nlane, ndof), c(nlane, nmoving)

      u = ieee_value(1.0_wp, ieee_quiet_nan)
      c = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine pull_missing

   !> The exact flow of a part D of H, from the time t to t + tau; called only with the trait has_parts.
   subroutine drift_missing(self, nlane, ndof, t, tau, q, p, qn, pn)
      class(kernel_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof
      real(wp), intent(in) :: t, tau, q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: qn(nlane, ndof), pn(nlane, ndof)

      qn = ieee_value(1.0_wp, ieee_quiet_nan)
      pn = qn
   end subroutine drift_missing

   !> The exact flow, over one unit of time, of sum_j w_j K_j at the time t, K_0 = H - D and K_k = H_k, all of which
   !> commute; called only with the trait has_parts.
   subroutine kick_missing(self, nlane, ndof, nnoise, t, w, q, p, qn, pn)
      class(kernel_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: qn(nlane, ndof), pn(nlane, ndof)

      qn = ieee_value(1.0_wp, ieee_quiet_nan)
      pn = qn
   end subroutine kick_missing

   !> Whether `flow` can take steps by this map; and whether it makes them of `drift` and `kick` (steps_by_parts).
   pure logical function has_no_flow(self, map) result(has_flow)
      class(kernel_model), intent(in) :: self
      type(step_map), intent(in) :: map

      has_flow = .false.
   end function has_no_flow

   !> Steps by a map for which has_flow is true, taken by the model as a whole: from (q, p) to the states after every
   !> steps%every-th step. The result of a lane must depend on its own numbers alone, and have the same bits whether
   !> steps are requested one by one or many at once. A lane that fails gets a code of base/status, or a state that is
   !> not finite and stays so; the library then requests the steps one by one, finds the one that failed, and tries to
   !> solve it. Lanes with a status are not used any more.
   subroutine no_flow(self, map, steps, ndof, q, p, qn, pn, status, counters)
      class(kernel_model), intent(in) :: self
      type(step_map), intent(in) :: map
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: ndof
      real(wp), intent(in) :: q(steps%nlane, ndof), p(steps%nlane, ndof)
      real(wp), intent(out) :: qn(steps%nlane, ndof, steps%nstep/steps%every)
      real(wp), intent(out) :: pn(steps%nlane, ndof, steps%nstep/steps%every)
      integer(i8), intent(inout) :: status(steps%nlane)
      type(counters_type), intent(inout) :: counters  !! counts of the real lanes, if the model counts

      qn = ieee_value(1.0_wp, ieee_quiet_nan)
      pn = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine no_flow

end module symsde_model_kernels
