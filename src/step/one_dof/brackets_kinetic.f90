! SPDX-License-Identifier: BSD-3-Clause
!> The brackets of step/one_dof/brackets if every H_j = e_j p^2/2 + U_j(q): for an angle, and for noise in position with
!> H = p^2/2 + U(q). These brackets are polynomials of p. With y_k = e_0 U_k - e_k U_0,
!>
!>    {H_k,H} = p y_k',   {{H,H_k},H_k} = y_k' U_k' - e_k p^2 y_k'',
!>
!> and noises in position that change in time add sum_k (c_k/h) [H_k(t_1) - H_k(t_0)]. Areas and crossed brackets have
!> no effect on noises in position, and an angle with such brackets is left to the general form.
!>
!> An evaluation begins with h H, adds dW_k H_k with its single and nested bracket noise by noise, and last the changes
!> in time: the sums are in brackets_kinetic.inc.
!>
!> The brackets follow from {F,G} = F_q G_p - F_p G_q. With F = H_k and G = H the single bracket is U_k' e_0 p - e_k p
!> U_0' = p y_k'. The nested bracket {{H,H_k},H_k} has F = {H,H_k} = -p y_k' and G = H_k, so it is -p y_k'' e_k p + y_k'
!> U_k'.
!>
!> An angle's derivatives of every order follow from one sine and one cosine, and Newton's matrix is exact. For other
!> models two derivatives of U_j are evaluated, which determine the gradient, and the matrix lacks higher derivatives.
!> With the general form of step/one_dof/brackets a step of an angle takes 2.6 to 4 times as long in blocks, and 3.6 to
!> 8 times alone.
!>
!> Private to its family.
module symsde_step_one_dof_brackets_kinetic
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: step_record
   use symsde_base_sincos, only: sincos_lanes
   use symsde_model_abstract, only: model_type
   use symsde_model_kernels, only: kernel_model, kernel_offers, angle_terms, kernels_of, offers_of
   use symsde_step_hamiltonian_brackets_exact, only: has_exact_bracket
   use symsde_step_hamiltonian_brackets, only: modified_hamiltonian
   implicit none
   private
   public :: kinetic_brackets, new_kinetic_brackets, are_kinetic
   public :: q_, p_, qq, qp, pp, nplace

   !> Columns of a sum's derivatives: its gradient and its Hessian.
   integer, parameter :: q_ = 1, p_ = 2, qq = 3, qp = 4, pp = 5, nplace = 5

   !> Derivatives of the U_j and the arrays to compute them. u(:, i, j, 1) is the i-th derivative of U_j at the time
   !> of the evaluation; if noises change in time, u(:, i, k, 2) and (.., 3) belong to U_k at both ends of the step.
   type :: kinetic_brackets
      integer :: nlane = 0, nnoise = 0
      integer :: ntime = 1 !! number of times of an evaluation; 3 if noises change: its own and both ends
      logical :: angle = .false.
      logical :: by_sums = .false. !! the model gives squares and sums of all noises, which replace single noises
      class(kernel_model), pointer :: fast => null()  !! the model with kernels, which gives terms of an angle
      real(wp) :: times(0:2) = 0                   !! times of evaluations in a step: its middle, and stages
      type(angle_terms), allocatable :: terms(:, :)  !! terms of H_j at the times of a step (0:nnoise, 0:2)
      type(angle_terms), allocatable :: ends(:, :) !! terms of H_k at both ends of a step (nnoise, 2:3)
      real(wp), allocatable :: u(:, :, :, :)       !! U_j' .. U_j'''' (nlane, 4, 0:nnoise, ntime)
      real(wp), allocatable :: e(:)                !! e_j (0:nnoise)
      real(wp), allocatable :: one(:, :, :)        !! weight one for each H_j (nlane, 0:nnoise, 0:nnoise)
      real(wp), allocatable :: sine(:), cosine(:)  !! (nlane)
      real(wp), allocatable :: s(:, :), g(:, :)    !! derivatives of sums and squares (nlane, 6), (nlane, 1)
      real(wp), allocatable :: beside(:, :)        !! values for one lane, of all H_j: U_j', U_j'', q, p (0:nnoise, 4)
   contains
      procedure :: begin
      procedure :: evaluate
   end type kinetic_brackets

contains

   !> Whether the Hamiltonians of this model are known to be of this form, and no other terms of brackets are needed: an
   !> angle whose nested brackets are exact, without areas and without noises that change; or H = p^2/2 + U(q), noise in
   !> position.
   pure logical function are_kinetic(parts)
      type(modified_hamiltonian), intent(in) :: parts
      type(kernel_offers) :: offers

      offers = offers_of(parts%model)
      associate (traits => parts%model%traits)
         are_kinetic = offers%angle .and. .not. (parts%time_dependent .or. parts%active%areas) .and. &
                       (has_exact_bracket(traits) .or. .not. parts%active%nested)
         are_kinetic = are_kinetic .or. parts%simple
      end associate
   end function are_kinetic

   !> Allocate for the brackets and lanes of `parts`. Without terms of an angle e_0 = 1 and all e_k = 0 at all times:
   !> these models are H = p^2/2 + U(q) with noise in position.
   subroutine new_kinetic_brackets(self, parts)
      type(kinetic_brackets), intent(out) :: self
      type(modified_hamiltonian), intent(in) :: parts
      type(kernel_offers) :: offers
      integer :: j

      self%nlane = parts%nlane
      self%nnoise = parts%nnoise
      offers = offers_of(parts%model)
      self%angle = offers%angle
      self%fast => kernels_of(parts%model)
      self%by_sums = associated(parts%squares) .and. parts%active%nested .and. .not. self%angle
      ! H_k(t_1) - H_k(t_0) is computed in every evaluation, as it depends on q.
      if (parts%time_dependent) self%ntime = 3
      associate (n => parts%nlane, m => parts%nnoise)
         allocate (self%u(n, 4, 0:m, self%ntime), self%e(0:m), self%one(n, 0:m, 0:m), source=0.0_wp)
         ! The mass of models without terms; for an angle it comes with its terms.
         self%e(0) = 1
         do j = 0, m
            ! Weights that select H_j from the sum that a model computes.
            self%one(:, j, j) = 1
         end do
         allocate (self%sine(n), self%cosine(n), self%terms(0:m, 0:2), self%ends(m, 2:3), self%beside(0:m, 4))
         allocate (self%s(n, 6), self%g(n, 1))
      end associate
   end subroutine new_kinetic_brackets

   !> Begin a step: compute an angle's terms at the times of its evaluations, and at its ends if noises change. The e_j
   !> belong to the middle of the step.
   subroutine begin(self, step, times)
      class(kinetic_brackets), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: times(0:2)
      integer :: i, j

      self%times = times
      if (.not. self%angle) return
      ! An angle's terms depend only on time: m + 1 sets at each of three times serve all evaluations of this step.
      associate (m => self%nnoise)
         do j = 0, m
            do i = 0, 2
               call self%fast%angle(m, times(i), self%one(1, :, j), self%terms(j, i))
            end do
            self%e(j) = self%terms(j, 0)%e
            if (self%ntime == 1 .or. j == 0) cycle
            call self%fast%angle(m, step%t, self%one(1, :, j), self%ends(j, 2))
            call self%fast%angle(m, step%t + step%h, self%one(1, :, j), self%ends(j, 3))
         end do
      end associate
   end subroutine begin

   !> Gradient and Hessian h(:, q_), .., h(:, pp) of the sum at (q, p), at times(i): in stage i, or in the middle of the
   !> step for i = 0. The factor of nested brackets is h|h|/12, with h the step.
   subroutine evaluate(self, parts, i, step, c, rate, q, p, h)
      class(kinetic_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      integer, intent(in) :: i
      type(step_record), intent(in) :: step
      real(wp), intent(in), dimension(self%nlane, 0:self%nnoise) :: c, rate  !! see step/one_dof/brackets
      real(wp), intent(in), dimension(self%nlane) :: q, p
      real(wp), intent(out) :: h(self%nlane, nplace)
      real(wp) :: nested
      real(wp), pointer, contiguous :: w(:, :)  ! a name that gfortran 12 recognises as contiguous
      integer :: k

      if (self%by_sums) then
         call evaluate_sums(self, parts, i, step, c, rate, q, p, h)
         return
      end if
      w => step%w
      ! h|h| and not h^2, since |h| replaces the square of an increment, and h belongs to the drift: a step back in time
      ! changes the sign of the second factor only.
      nested = merge(step%h*abs(step%h)/12, 0.0_wp, parts%active%nested)
      ! u holds the derivatives of all U_j, four for an angle, else two.
      if (self%angle) then
         call derive(self, i, q)
      else
         call ask(self, parts, [self%times(i), step%t, step%t + step%h], q, p)
      end if
      associate (n => self%nlane, e => self%e, u => self%u)
         call start(n, w, e(0), u, p, h)
         do k = 1, self%nnoise
            if (.not. parts%noisy(k)) cycle
            ! A noise with e_k = 0 does not move positions, and half of its terms vanish.
            if (abs(e(k)) > 0) then
               call add_moving(n, nested, w(:, k), c(:, k), e([0, k]), u, u(:, :, k, 1), p, h)
            else
               call add_still(n, nested, w(:, k), c(:, k), e(0), u(:, :, k, 1), p, h)
            end if
         end do
         ! Add changes in time last, noise by noise, as for a single path.
         do k = 1, self%nnoise
            if (self%ntime == 3 .and. parts%noisy(k)) &
               call add_change(n, rate(:, k), u(:, :, k, 2), u(:, :, k, 3), h)
         end do
      end associate
   end subroutine evaluate

   !> The same from weighted sums, those with the weights w and c, and the squares of all noises in position, which the
   !> model gives at one pass.
   subroutine evaluate_sums(self, parts, i, step, c, rate, q, p, h)
      type(kinetic_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      integer, intent(in) :: i
      type(step_record), intent(in) :: step
      real(wp), intent(in), dimension(self%nlane, 0:self%nnoise) :: c, rate
      real(wp), intent(in), dimension(self%nlane) :: q, p
      real(wp), intent(out) :: h(self%nlane, nplace)
      real(wp), pointer, contiguous :: w(:, :)  ! a name that gfortran 12 recognises as contiguous

      w => step%w
      associate (n => self%nlane, m => self%nnoise, u => self%u)
         call self%fast%squares(n, 1, m, self%times(i), q, self%g, w, c, self%s)
         call add_sums(n, step%h, self%s, self%g, p, h)
         if (self%ntime < 3) return
         call derive_sum(parts%model, n, m, step%t, rate, q, p, u(:, 1, 1, 2), u(:, 2, 1, 2))
         call derive_sum(parts%model, n, m, step%t + step%h, rate, q, p, u(:, 1, 1, 3), u(:, 2, 1, 3))
         call add_change(n, self%one(:, 0, 0), u(:, :, 1, 2), u(:, :, 1, 3), h)
      end associate
   end subroutine evaluate_sums

   !> Force and stiffness of a weighted sum.
   subroutine derive_sum(model, n, m, t, w, q, p, force, stiffness)
      class(model_type), intent(in) :: model
      integer, intent(in) :: n, m
      real(wp), intent(in) :: t, w(n, 0:m), q(n), p(n)
      real(wp), intent(out) :: force(n), stiffness(n)

      call model%gradient_hessian(n, 1, m, t, w, q, p, hq=force, hqq=stiffness)
   end subroutine derive_sum

   !> U_j' = H_j,q and U_j'' = H_j,qq from the model, H_j by H_j. For one lane a single call is enough: it has m + 1
   !> lanes at the same point, and lane j has the weights of H_j. H itself is not needed at the ends of the step.
   subroutine ask(self, parts, times, q, p)
      type(kinetic_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      real(wp), intent(in) :: times(3)
      real(wp), intent(in), dimension(self%nlane) :: q, p
      integer :: i, j

      associate (n => self%nlane, m => self%nnoise, u => self%u, model => parts%model)
         do i = 1, self%ntime
            if (n == 1) then
               ! H is one of the m + 1 lanes at the ends too; its values there are not used.
               self%beside(:, 3) = q(1)
               self%beside(:, 4) = p(1)
               call model%gradient_hessian(m + 1, 1, m, times(i), self%one, self%beside(:, 3), self%beside(:, 4), &
                                           hq=self%beside(:, 1), hqq=self%beside(:, 2))
               u(1, 1, :, i) = self%beside(:, 1)
               u(1, 2, :, i) = self%beside(:, 2)
               cycle
            end if
            ! H is evaluated only at the time of the evaluation, i = 1, and the noises also at the ends of the step.
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

   !> All derivatives of an angle, at time i and, if noises change, at both ends, from the same sine and cosine. They
   !> are in u(:, 1:4, j, 1) for H_j at time i, and in u(:, 1:4, k, 2:3) for H_k at the ends.
   subroutine derive(self, i, q)
      type(kinetic_brackets), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: q(self%nlane)
      integer :: j, k

      associate (n => self%nlane, u => self%u, sine => self%sine, cosine => self%cosine)
         call sincos_lanes(n, q, sine, cosine)
         do j = 0, self%nnoise
            call derive_lanes(n, self%terms(j, i), q, sine, cosine, u(:, :, j, 1))
            ! H is not needed at the ends, and `ends` holds terms of noises only.
            do k = 2, merge(self%ntime, 1, j > 0)
               call derive_lanes(n, self%ends(j, k), q, sine, cosine, u(:, :, j, k))
            end do
         end do
      end associate
   end subroutine derive

   !> VEC h = gradient and Hessian of h p^2/2 + S + C' p + (h|h|/12) G' with s = (S', S'', C', C'', C''', g') and g =
   !> G''/2 = sum_k U_k' U_k''.
   pure subroutine add_sums(nlane, step, s, g, p, h)
      integer, intent(in) :: nlane
      real(wp), intent(in) :: step, s(lanes(nlane), 6), g(lanes(nlane)), p(lanes(nlane))
      real(wp), intent(out) :: h(lanes(nlane), nplace)
      real(wp) :: factor
      integer :: lane

      factor = step*abs(step)/6
      do lane = 1, lanes(nlane)
         h(lane, q_) = s(lane, 1) + p(lane)*s(lane, 4)
         h(lane, q_) = h(lane, q_) + factor*g(lane)
         h(lane, p_) = s(lane, 3) + step*p(lane)
         h(lane, qq) = s(lane, 2) + p(lane)*s(lane, 5)
         h(lane, qq) = h(lane, qq) + factor*s(lane, 6)
         h(lane, qp) = s(lane, 4)
         h(lane, pp) = step
      end do
   end subroutine add_sums

   include 'brackets_kinetic.inc'

   pure integer function lanes(nlane)
      integer, intent(in) :: nlane

      lanes = nlane
   end function lanes

end module symsde_step_one_dof_brackets_kinetic
