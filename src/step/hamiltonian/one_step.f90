! SPDX-License-Identifier: BSD-3-Clause
!> The random Hamiltonian of one step, composed of model, increments and correction.
!>
!>    Hhat(q,p) = h H + sum_k dW_k H_k  (+ correction),   weights w = (h, dW_1, .., dW_m)
!>
!> In the step the increments are frozen, so Hhat is a Hamiltonian like any other, and any symplectic scheme applied to
!> it is symplectic path by path. The weights contain h and dW: for a tableau the step has length one,
!> Q_i = q_n + sum_j a_ij Hhat_p(P_j,Q_j), and drift and noise are evaluated at the time t of the stage.
!>
!> One-sided schemes (lambda /= 1/2) need a correction to solve the Stratonovich equation (docs/method/noise.md):
!>
!> mean         (1/2-lambda) |h| sum_k H_{k,p}.H_{k,q}, where |h| replaces dW_k^2
!> increments   (1/2-lambda) F_p.F_q,  F = sum_k dW_k H_k
!>
!> Its gradient needs Hessian-vector products only: grad(F_p.F_q) = Hess F (F_p; F_q), q-part first. Its
!> Hessian is (D F_p)^T D F_q + (D F_q)^T D F_p and a part with third derivatives. The part with third derivatives is
!> left out: it vanishes for quadratic F, and Newton's iteration finds the same root without it. Leaving out the whole
!> Hessian of the correction would lose paths: on the Kubo oscillator such an iteration diverges if |sigma dW| > sqrt 2.
!>
!> Forces F and f_k of a model (model/forces) are subtracted from Hhat_q: every scheme uses -Hhat_q + Fhat in place of
!> -Hhat_q, where Fhat = h F + sum_k dW_k f_k, as the discrete Lagrange-d'Alembert principle requires. With A = F_p and
!> B = -F_q + f of the noise alone, the correction of forced systems is (1/2-lambda) (A_q A - A_p B) in q and
!> (1/2-lambda) (B_q A - B_p B) in p (docs/forces.md). In the Hessian Hhat_qq - Fhat_q replaces Hhat_qq; Fhat_p
!> is stored in drag, and Newton's matrices subtract it from Hhat_qp in the rows of momenta alone.
!>
!> Schemes beyond strong order one add the brackets of step/hamiltonian/brackets. Every evaluation has this order: one
!> call of the model sums over its Hamiltonians, then the correction is added, then the brackets.
!>
!> Steppers whose equations have neither correction nor brackets use the bare Hhat = sum_j w_j H_j: for any number of
!> lanes at once, and any of its derivatives. So all evaluations of Hhat are in this module, and so are the terms added
!> to it; only code that needs single H_j calls the model directly (tests/house/check_rooms.py has a list).
module symsde_step_hamiltonian_one_step
   use symsde_base_contracts, only: contracts_are_executed
   use symsde_base_kinds, only: wp
   use symsde_base_counters, only: counters_type
   use symsde_base_lane_paths, only: narrow_lanes => narrow, widen_lanes => widen
   use symsde_base_record, only: step_record
   use symsde_model_abstract, only: model_type, difference_default
   use symsde_model_contract, only: require_traits, require_question
   use symsde_model_kernels, only: kernel_model, kernel_offers, kernels_of, offers_of
   use symsde_model_algebra, only: algebra_work, new_algebra_work, correction_gradient
   use symsde_scheme_scheme, only: bracket_terms, correction_none, correction_mean
   use symsde_step_hamiltonian_mass, only: constant_mass, new_constant_mass
   use symsde_step_hamiltonian_brackets, only: modified_hamiltonian, new_modified_hamiltonian, active_brackets
   implicit none
   private
   public :: one_step_hamiltonian, new_one_step_hamiltonian

   !> The model, terms added to its Hamiltonians, and work arrays for one evaluation. There is one object per stepper,
   !> since it counts the calls of the model and has work arrays; all threads share the model itself.
   type :: one_step_hamiltonian
      class(model_type), pointer :: model => null()
      class(kernel_model), pointer :: fast => null()  !! the model as a kernel_model, if it has kernels
      type(kernel_offers) :: offers                   !! which kernels the model has
      logical :: exact_products = .false.             !! products by a Hessian, too, never by differences beside it
      integer :: nlane = 0, ndof = 0, nnoise = 0
      integer :: nreal = 0                    !! real paths of the block, for the counters
      integer :: correction = correction_none
      real(wp) :: coefficient = 0             !! 1/2 - lambda
      logical :: mass_alone = .false.         !! H = p.p/2 + U(q), noise in position: Hhat_p = h p without correction
      logical :: forced = .false.             !! whether the model has forces
      real(wp), allocatable :: drag(:, :, :)  !! Fhat_p where forces act (nlane, ndof, ndof), or its bands
      type(constant_mass), allocatable :: mass  !! H = p.M^-1 p/2 + U(q), noise in position: Hhat_p = h M^-1 p
      type(counters_type) :: counters
      class(modified_hamiltonian), allocatable :: modified !! brackets of schemes beyond order one
      real(wp), allocatable, private :: v(:, :)       !! weights of the noise alone (nlane, 0:nnoise)
      real(wp), allocatable, private :: factor(:)     !! factor of the product of gradients (nlane)
      type(algebra_work), private :: work
      real(wp), allocatable, private :: uq(:, :), up(:, :)  !! gradient of the product (nlane, ndof)
      real(wp), allocatable, private :: fqq(:, :, :), fqp(:, :, :), fpp(:, :, :)  !! (nlane, ndof, ndof)
   contains
      procedure :: gradient
      procedure :: velocity
      procedure :: gradient_hessian
      procedure :: bare_gradient
      procedure :: bare_gradient_hessian
      procedure :: bare_bands
      procedure :: bare_force_stiffness
      procedure :: bare_pair
      procedure :: bare_product
      procedure :: bare_third
      procedure :: take_force
      procedure, private :: narrow_to_part, narrow_to_lanes
      generic :: narrow => narrow_to_part, narrow_to_lanes
      procedure :: widen
   end type one_step_hamiltonian

contains

   !> Make Hhat of a model for blocks of nlane lanes. Only arrays that the scheme needs are allocated; brackets that
   !> have no effect on this model are dropped here, once.
   subroutine new_one_step_hamiltonian(self, model, nlane, correction, coefficient, brackets)
      type(one_step_hamiltonian), intent(out) :: self
      class(model_type), intent(in), target :: model
      integer, intent(in) :: nlane
      integer, intent(in) :: correction      !! correction_none, correction_mean or correction_increments
      real(wp), intent(in) :: coefficient    !! 1/2 - lambda
      type(bracket_terms), intent(in), optional :: brackets  !! brackets of scheme_type to add; none if absent
      type(bracket_terms) :: active

      if (contracts_are_executed) call require_traits(model%traits)
      self%model => model
      self%fast => kernels_of(model)
      self%offers = offers_of(model)
      self%nlane = nlane
      self%ndof = model%traits%ndof
      self%nnoise = model%traits%nnoise
      self%nreal = nlane
      self%correction = correction
      self%coefficient = coefficient
      self%forced = associated(model%forces)
      associate (t => model%traits)
         ! Find out whether Hhat_p needs no call of the model: h p for the identity, and h M^-1 p once a diagonal M is
         ! known.
         self%mass_alone = t%identity_mass .and. (t%position_noise .or. t%nnoise == 0)
         if (t%divides_by_mass() .and. .not. self%offers%angle) then
            allocate (self%mass)
            call new_constant_mass(self%mass, nlane, t%ndof, t%nnoise)
         end if
      end associate
      if (present(brackets)) active = active_brackets(brackets, model%traits)
      if (active%are_added()) then
         allocate (self%modified)
         call new_modified_hamiltonian(self%modified, model, active, nlane)
      end if
      ! The following arrays are for the correction, which most steps do not have.
      if (correction == correction_none) return
      allocate (self%v(nlane, 0:self%nnoise), self%factor(nlane))
      call new_algebra_work(self%work, nlane, self%ndof, self%nnoise)
      allocate (self%uq(nlane, self%ndof), self%up(nlane, self%ndof))
   end subroutine new_one_step_hamiltonian

   !> From here on calls have n of the previous lanes, from lane `first` on; lanes beyond the last repeat it. Code that
   !> evaluates a part of a block must call this or narrow_to_lanes, since models may differ from path to path.
   subroutine narrow_to_part(self, first, n)
      class(one_step_hamiltonian), intent(in) :: self
      integer, intent(in) :: first, n

      call narrow_lanes(self%model%paths, first, n)
   end subroutine narrow_to_part

   !> Later calls of the model have only these lanes of the present ones.
   subroutine narrow_to_lanes(self, lanes)
      class(one_step_hamiltonian), intent(in) :: self
      integer, intent(in) :: lanes(:)

      call narrow_lanes(self%model%paths, lanes)
   end subroutine narrow_to_lanes

   !> End the last `narrow`.
   subroutine widen(self)
      class(one_step_hamiltonian), intent(in) :: self

      call widen_lanes(self%model%paths)
   end subroutine widen

   !> Gradient of Hhat at (q, p), each (nlane, ndof), with the weights w of every lane; an absent output is not
   !> computed. If brackets are added, the step must be given: its functionals are their coefficients.
   subroutine gradient(self, t, w, q, p, hq, hp, step)
      class(one_step_hamiltonian), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%nlane, 0:self%nnoise)
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)
      real(wp), intent(out), optional :: hq(self%nlane, self%ndof), hp(self%nlane, self%ndof)
      type(step_record), intent(in), optional :: step

      ! a user's function computes the force along with H_p: if the mass is known, H_p is computed without it
      if (allocated(self%mass) .and. present(hp) .and. .not. present(hq)) then
         call self%mass%drift(self%model, self%nlane, t, w, q, p, hp)
      else if (self%mass_alone .and. present(hp) .and. .not. present(hq)) then
         call find_velocity(self%nlane, self%ndof, w, p, hp)
      else
         call self%bare_gradient(self%nlane, t, w, q, p, hq, hp)
      end if
      ! One gradient is counted for every real path, however Hhat_p was computed, so that reports do not depend on short
      ! cuts.
      self%counters%gradients = self%counters%gradients + self%nreal
      if (self%correction /= correction_none) call add_correction(self, t, w, q, p, hq, hp)
      ! Brackets come last; they call the model themselves, and count their calls.
      if (allocated(self%modified)) call self%modified%add_gradient(t, step, q, p, hq, hp, self%counters, self%nreal)
   end subroutine gradient

   ! ---- Hhat without correction and brackets, for n lanes; callers count the calls, unless a comment says otherwise

   !> The gradient of bare Hhat, each (n, ndof); an absent output is not computed.
   subroutine bare_gradient(self, n, t, w, q, p, hq, hp)
      class(one_step_hamiltonian), intent(in) :: self
      integer, intent(in) :: n
      real(wp), intent(in) :: t, w(n, 0:self%nnoise), q(n, self%ndof), p(n, self%ndof)
      real(wp), intent(out), optional :: hq(n, self%ndof), hp(n, self%ndof)

      if (contracts_are_executed) call require_question(self%model%traits, n, self%ndof, self%nnoise, t, w)
      call self%model%gradient(n, self%ndof, self%nnoise, t, w, q, p, hq, hp)
      if (self%forced .and. present(hq)) call take_force(self, n, t, w, q, p, hq)
   end subroutine bare_gradient

   !> Subtract Fhat from Hhat_q, where forces act.
   subroutine take_force(self, n, t, w, q, p, hq)
      class(one_step_hamiltonian), intent(in) :: self
      integer, intent(in) :: n
      real(wp), intent(in) :: t, w(n, 0:self%nnoise), q(n, self%ndof), p(n, self%ndof)
      real(wp), intent(inout) :: hq(n, self%ndof)
      real(wp), allocatable :: f(:, :)

      allocate (f(n, self%ndof))
      call self%model%force(n, self%ndof, self%nnoise, t, w, q, p, f)
      hq = hq - f
   end subroutine take_force

   !> The gradient of bare Hhat, and the Hessian of its Hamiltonians alone, without forces.
   subroutine bare_gradient_hessian(self, n, t, w, q, p, hq, hp, hqq, hqp, hpp)
      class(one_step_hamiltonian), intent(in) :: self
      integer, intent(in) :: n
      real(wp), intent(in) :: t, w(n, 0:self%nnoise), q(n, self%ndof), p(n, self%ndof)
      real(wp), intent(out), optional :: hq(n, self%ndof), hp(n, self%ndof)
      real(wp), intent(out), optional :: hqq(n, self%ndof, self%ndof), hqp(n, self%ndof, self%ndof)
      real(wp), intent(out), optional :: hpp(n, self%ndof, self%ndof)

      if (contracts_are_executed) call require_question(self%model%traits, n, self%ndof, self%nnoise, t, w)
      call self%model%gradient_hessian(n, self%ndof, self%nnoise, t, w, q, p, hq, hp, hqq, hqp, hpp)
      if (self%forced .and. present(hq)) call take_force(self, n, t, w, q, p, hq)
   end subroutine bare_gradient_hessian

   !> Bands -b .. b of the Hessian of bare Hhat; of forces Fhat_q is subtracted from Hhat_qq, and drag is Fhat_p.
   subroutine bare_bands(self, n, b, t, w, q, p, hqq, hqp, hpp, drag)
      class(one_step_hamiltonian), intent(in) :: self
      integer, intent(in) :: n, b
      real(wp), intent(in) :: t, w(n, 0:self%nnoise), q(n, self%ndof), p(n, self%ndof)
      real(wp), intent(out), optional :: hqq(n, -b:b, self%ndof), hqp(n, -b:b, self%ndof), hpp(n, -b:b, self%ndof)
      real(wp), intent(out), optional :: drag(n, -b:b, self%ndof)  !! where forces act, present

      if (contracts_are_executed) call require_question(self%model%traits, n, self%ndof, self%nnoise, t, w)
      call self%model%hessian_banded(n, self%ndof, self%nnoise, b, t, w, q, p, hqq, hqp, hpp)
      if (present(drag)) call differentiate_bands(self, n, b, t, w, q, p, hqq, drag)
   end subroutine bare_bands

   !> The part of forces in bare_bands.
   subroutine differentiate_bands(self, n, b, t, w, q, p, hqq, drag)
      type(one_step_hamiltonian), intent(in) :: self
      integer, intent(in) :: n, b
      real(wp), intent(in) :: t, w(n, 0:self%nnoise), q(n, self%ndof), p(n, self%ndof)
      real(wp), intent(inout), optional :: hqq(n, -b:b, self%ndof)
      real(wp), intent(out) :: drag(n, -b:b, self%ndof)
      real(wp), allocatable :: fq(:, :, :)

      allocate (fq(n, -b:b, self%ndof))
      call self%model%force_bands(n, self%ndof, self%nnoise, b, t, w, q, p, fq, drag)
      if (present(hqq)) hqq = hqq - fq
   end subroutine differentiate_bands

   !> Hhat_q, and the bands 0 .. b of Hhat_qq.
   subroutine bare_force_stiffness(self, n, b, t, w, q, p, hq, hqq)
      class(one_step_hamiltonian), intent(in) :: self
      integer, intent(in) :: n, b
      real(wp), intent(in) :: t, w(n, 0:self%nnoise), q(n, self%ndof), p(n, self%ndof)
      real(wp), intent(out) :: hq(n, self%ndof), hqq(n, 0:b, self%ndof)

      if (contracts_are_executed) call require_question(self%model%traits, n, self%ndof, self%nnoise, t, w)
      call self%model%force_stiffness(n, self%ndof, self%nnoise, b, t, w, q, p, hq, hqq)
   end subroutine bare_force_stiffness

   !> Hhat_q and Hhat_qq of one path of two degrees of freedom, as scalars: by the kernel of the model, or by arrays.
   subroutine bare_pair(self, t, w, q1, q2, f1, f2, k11, k21, k12, k22)
      class(one_step_hamiltonian), intent(in) :: self
      real(wp), intent(in) :: t, w(0:self%nnoise)
      real(wp), value :: q1, q2
      real(wp), intent(out) :: f1, f2, k11, k21, k12, k22
      real(wp), dimension(2) :: q, still, f
      real(wp) :: k(2, 2)

      if (self%offers%pair) then
         call self%fast%pair(self%nnoise, t, w, q1, q2, f1, f2, k11, k21, k12, k22)
         return
      end if
      q(1) = q1
      q(2) = q2
      still = 0
      call self%bare_gradient_hessian(1, t, w, q, still, hq=f, hqq=k)
      f1 = f(1)
      f2 = f(2)
      k11 = k(1, 1)
      k21 = k(2, 1)
      k12 = k(1, 2)
      k22 = k(2, 2)
   end subroutine bare_pair

   !> The Hessian of bare Hhat times (vq, vp), counted for `wanted` lanes. A model with a Hessian but no product would
   !> compute the whole Hessian: then a difference of gradients is cheaper, unless products must be exact.
   subroutine bare_product(self, n, wanted, t, w, q, p, vq, vp, uq, up)
      class(one_step_hamiltonian), intent(inout) :: self
      integer, intent(in) :: n, wanted
      real(wp), intent(in) :: t, w(n, 0:self%nnoise), q(n, self%ndof), p(n, self%ndof)
      real(wp), intent(in) :: vq(n, self%ndof), vp(n, self%ndof)
      real(wp), intent(out) :: uq(n, self%ndof), up(n, self%ndof)
      real(wp), allocatable :: u(:, :)

      if (contracts_are_executed) call require_question(self%model%traits, n, self%ndof, self%nnoise, t, w)
      if (self%model%traits%has_hessian_vector .or. self%exact_products) then
         call self%model%hessian_vector(n, self%ndof, self%nnoise, t, w, q, p, vq, vp, uq, up)
         self%counters%hessian_vectors = self%counters%hessian_vectors + wanted
      else
         call difference_default(self%model, n, self%ndof, self%nnoise, t, w, q, p, vq, vp, uq, up)
         self%counters%gradients = self%counters%gradients + 2*wanted
      end if
      if (.not. self%forced) return
      allocate (u(n, self%ndof))
      call self%model%force_along(n, self%ndof, self%nnoise, t, w, q, p, vq, vp, u)
      uq = uq - u
   end subroutine bare_product

   !> The gradient of a^T Hess Hhat b, with bare Hhat: its third derivatives along two vectors.
   subroutine bare_third(self, n, t, w, q, p, aq, ap, bq, bp, uq, up)
      class(one_step_hamiltonian), intent(in) :: self
      integer, intent(in) :: n
      real(wp), intent(in) :: t, w(n, 0:self%nnoise), q(n, self%ndof), p(n, self%ndof)
      real(wp), intent(in), dimension(n, self%ndof) :: aq, ap, bq, bp
      real(wp), intent(out) :: uq(n, self%ndof), up(n, self%ndof)

      if (contracts_are_executed) call require_question(self%model%traits, n, self%ndof, self%nnoise, t, w)
      call self%model%third_derivative(n, self%ndof, self%nnoise, t, w, q, p, aq, ap, bq, bp, uq, up)
   end subroutine bare_third

   !> Hhat_p of separable Hamiltonians, where it depends on p alone; without correction and brackets. Iterations start
   !> with F = Hhat_p(p_n).
   subroutine velocity(self, t, w, q, p, hp)
      class(one_step_hamiltonian), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%nlane, 0:self%nnoise)
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)
      real(wp), intent(out) :: hp(self%nlane, self%ndof)

      if (self%mass_alone) then
         call find_velocity(self%nlane, self%ndof, w, p, hp)
      else
         call self%bare_gradient(self%nlane, t, w, q, p, hp=hp)
      end if
      self%counters%gradients = self%counters%gradients + self%nreal
   end subroutine velocity

   !> VEC Hhat_p = h p for H = p.p/2 + U(q) with noise in position. The first column of the weights is h.
   pure subroutine find_velocity(nlane, ndof, w, p, hp)
      integer, intent(in) :: nlane, ndof
      real(wp), intent(in) :: w(nlane), p(nlane, ndof)
      real(wp), intent(out) :: hp(nlane, ndof)
      integer :: i, lane

      do i = 1, ndof
         do lane = 1, nlane
            hp(lane, i) = w(lane)*p(lane, i)
         end do
      end do
   end subroutine find_velocity

   !> Gradient of Hhat with correction and brackets; Hessian without brackets and third derivatives. The gradient
   !> determines the residual and must be exact, the Hessian only determines Newton's matrix: Newton converges to the
   !> same root, linearly if the missing parts matter. An absent output is not computed; hqp(:, i, j) is H_{q_i p_j}.
   subroutine gradient_hessian(self, t, w, q, p, hq, hp, hqq, hqp, hpp, step)
      class(one_step_hamiltonian), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%nlane, 0:self%nnoise)
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)
      real(wp), intent(out), optional :: hq(self%nlane, self%ndof), hp(self%nlane, self%ndof)
      real(wp), intent(out), optional :: hqq(self%nlane, self%ndof, self%ndof)
      real(wp), intent(out), optional :: hqp(self%nlane, self%ndof, self%ndof)
      real(wp), intent(out), optional :: hpp(self%nlane, self%ndof, self%ndof)
      type(step_record), intent(in), optional :: step

      call self%bare_gradient_hessian(self%nlane, t, w, q, p, hq, hp, hqq, hqp, hpp)
      if (self%forced .and. (present(hqq) .or. present(hqp))) call differentiate_force(self, t, w, q, p, hqq)
      ! A call for gradient and Hessian counts as one of each.
      self%counters%gradients = self%counters%gradients + self%nreal
      self%counters%hessians = self%counters%hessians + self%nreal
      if (self%correction /= correction_none) then
         call add_correction(self, t, w, q, p, hq, hp)
         call add_correction_hessian(self, t, w, q, p, hqq, hqp, hpp)
      end if
      if (allocated(self%modified)) &
         call self%modified%add_gradient(t, step, q, p, hq, hp, self%counters, self%nreal)
   end subroutine gradient_hessian

   !> Subtract Fhat_q from Hhat_qq, and store Fhat_p in drag.
   subroutine differentiate_force(self, t, w, q, p, hqq)
      type(one_step_hamiltonian), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%nlane, 0:self%nnoise)
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)
      real(wp), intent(inout), optional :: hqq(self%nlane, self%ndof, self%ndof)
      real(wp), allocatable :: fq(:, :, :)

      associate (nlane => self%nlane, n => self%ndof)
         if (.not. allocated(self%drag)) allocate (self%drag(nlane, n, n))
         allocate (fq(nlane, n, n))
         call self%model%force_derivative(nlane, n, self%nnoise, t, w, q, p, fq, self%drag)
         if (present(hqq)) hqq = hqq - fq
      end associate
   end subroutine differentiate_force

   !> Add the gradient of the correction to the wanted outputs: factor grad(F_p.F_q) for every term, one term in the
   !> increments form, and one per noise in the mean form. A term takes one gradient and one Hessian-vector product.
   subroutine add_correction(self, t, w, q, p, hq, hp)
      type(one_step_hamiltonian), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%nlane, 0:self%nnoise)
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)
      real(wp), intent(inout), optional :: hq(self%nlane, self%ndof), hp(self%nlane, self%ndof)
      integer :: i, k

      do k = 1, nterm(self)  ! each term is a product F_p.F_q with its own F
         call choose_term(self, k, w)
         call correction_gradient(self%work, self%model, t, self%v, q, p, self%uq, self%up)
         self%counters%gradients = self%counters%gradients + self%nreal
         self%counters%hessian_vectors = self%counters%hessian_vectors + self%nreal
         ! The factor differs between lanes, since h is one of the weights.
         do i = 1, self%ndof
            if (present(hq)) hq(:, i) = hq(:, i) + self%factor*self%uq(:, i)
            if (present(hp)) hp(:, i) = hp(:, i) + self%factor*self%up(:, i)
         end do
      end do
   end subroutine add_correction

   !> Add the Hessian of the correction, without third derivatives, to the wanted blocks. All blocks of the Hessian of F
   !> are evaluated, since each block of the result depends on several of them.
   subroutine add_correction_hessian(self, t, w, q, p, hqq, hqp, hpp)
      type(one_step_hamiltonian), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%nlane, 0:self%nnoise)
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)
      real(wp), intent(inout), optional :: hqq(self%nlane, self%ndof, self%ndof)
      real(wp), intent(inout), optional :: hqp(self%nlane, self%ndof, self%ndof)
      real(wp), intent(inout), optional :: hpp(self%nlane, self%ndof, self%ndof)
      integer :: k

      associate (nlane => self%nlane, n => self%ndof)
         ! n^2 numbers per lane: not allocated for steppers that need no matrix
         if (.not. allocated(self%fqq)) &
            allocate (self%fqq(nlane, n, n), self%fqp(nlane, n, n), self%fpp(nlane, n, n))
         do k = 1, nterm(self)
            call choose_term(self, k, w)
            call self%model%hessian(nlane, n, self%nnoise, t, self%v, q, p, self%fqq, self%fqp, self%fpp)
            self%counters%hessians = self%counters%hessians + self%nreal
            call add_blocks(nlane, n, self%factor, self%fqq, self%fqp, self%fpp, hqq, hqp, hpp)
         end do
      end associate
   end subroutine add_correction_hessian

   !> Number of terms factor*F_p.F_q in the correction.
   pure integer function nterm(self)
      type(one_step_hamiltonian), intent(in) :: self

      nterm = merge(self%nnoise, 1, self%correction == correction_mean)
   end function nterm

   !> F = sum_j v_j H_j of term k, and the factor of F_p.F_q: H_k and (1/2-lambda) |h| in the mean form, sum_k dW_k H_k
   !> and 1/2-lambda in the increments form.
   subroutine choose_term(self, k, w)
      type(one_step_hamiltonian), intent(inout) :: self
      integer, intent(in) :: k
      real(wp), intent(in) :: w(self%nlane, 0:self%nnoise)

      ! The weight of H stays zero: the correction depends on the noises only.
      self%v = 0
      if (self%correction == correction_mean) then
         self%v(:, k) = 1
         self%factor = self%coefficient*abs(w(:, 0))
      else
         self%v(:, 1:) = w(:, 1:)
         self%factor = self%coefficient
      end if
   end subroutine choose_term

   !> Add factor*((D F_p)^T D F_q + (D F_q)^T D F_p), with D F_p = (F_pq, F_pp) and D F_q = (F_qq, F_qp). By blocks
   !>
   !>    qq  F_qp F_qq + F_qq F_pq       qp  F_qp F_qp + F_qq F_pp       pp  F_pp F_qp + F_pq F_pp
   !>
   !> where F_qp(i,l) is the derivative with respect to q_i and p_l, and F_pq its transpose.
   pure subroutine add_blocks(nlane, ndof, factor, fqq, fqp, fpp, hqq, hqp, hpp)
      integer, intent(in) :: nlane, ndof
      real(wp), intent(in) :: factor(nlane), fqq(nlane, ndof, ndof), fqp(nlane, ndof, ndof)
      real(wp), intent(in) :: fpp(nlane, ndof, ndof)
      real(wp), intent(inout), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof)
      real(wp), intent(inout), optional :: hpp(nlane, ndof, ndof)
      integer :: i, j, l

      ! Entry (i, j) of a block is a sum over l of products of entries, for all lanes at once.
      do j = 1, ndof
         do i = 1, ndof
            do l = 1, ndof
               if (present(hqq)) hqq(:, i, j) = hqq(:, i, j) + factor* &
                                                (fqp(:, i, l)*fqq(:, l, j) + fqq(:, i, l)*fqp(:, j, l))
               if (present(hqp)) hqp(:, i, j) = hqp(:, i, j) + factor* &
                                                (fqp(:, i, l)*fqp(:, l, j) + fqq(:, i, l)*fpp(:, l, j))
               if (present(hpp)) hpp(:, i, j) = hpp(:, i, j) + factor* &
                                                (fpp(:, i, l)*fqp(:, l, j) + fqp(:, l, i)*fpp(:, l, j))
            end do
         end do
      end do
   end subroutine add_blocks

end module symsde_step_hamiltonian_one_step
