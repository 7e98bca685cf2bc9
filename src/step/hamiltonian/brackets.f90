! SPDX-License-Identifier: BSD-3-Clause
!> Terms added to the random Hamiltonian of one step for orders beyond one (docs/method/beyond-order-one.md):
!>
!>    sum_k (h dW_k/2 - dZ_k) {H_k,H}  +  sum_{k<l} A_kl {H_l,H_k}  +  (|h|/12) sum_k {{F,H_k},H_k}
!>
!> with {F,G} = F_q.G_p - F_p.G_q, and with F = h H, or F = h H + sum_l dW_l H_l if the brackets are crossed. They are
!> terms of the logarithm of the flow over the step, which is a Hamiltonian. The first and the last term give strong
!> order 3/2 if noises commute, the middle term strong order 1 if they do not, and the last term alone weak order 2 with
!> three-point increments. A part is added only if the scheme needs it and the model's traits do not prove it without
!> effect. Every part is a Hamiltonian whose exact gradient is used, so a symplectic scheme remains symplectic.
!>
!> Single brackets need gradients and Hessian-vector products, grad {F,G} = Hess F (G_p,-G_q) - Hess G (F_p,-F_q).
!> The nested bracket would need third derivatives, and is replaced by differences
!> (step/hamiltonian/brackets_differences). None is needed for noise that depends on position alone with
!> H = p.M^-1 p/2 + U(q) and a diagonal M, where the brackets are F_q . M^-1 p and H_k,q . M^-1 H_k,q; nor for models
!> that offer third derivatives, or have none (step/hamiltonian/brackets_exact).
!>
!> H may depend on time. If noises do, the brackets become those of the phase space with time, {H_k,H} + H_{k,t}: with
!> the ends t_0 and t_1 of the step
!>
!>    sum_k (dW_k/2 - dZ_k/h) [H_k(t_1) - H_k(t_0)]  -  (|h|/12) sum_k {H_k(t_1),H_k(t_0)}
!>
!> where the first sum belongs to the single bracket. The second belongs to the nested one; it vanishes for noise in
!> position and has no gradient for additive noise.
!>
!> An evaluation adds up the gradients of all parts in (sq, sp), single brackets first, then areas, nested brackets and
!> noises that change, and adds the sum to the caller's arrays at the end, since either of these may be absent.
module symsde_step_hamiltonian_brackets
   use symsde_base_counters, only: counters_type
   use symsde_base_functionals, only: functionals, functional_set, area_index, path_dz, path_areas
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: step_record
   use symsde_base_traits, only: model_traits
   use symsde_model_abstract, only: model_type
   use symsde_model_probe_noise_time, only: noise_changes_in_time
   use symsde_model_kernels, only: kernel_model, kernel_offers, kernels_of, offers_of
   use symsde_model_algebra, only: algebra_work, new_algebra_work, bracket_gradient
   use symsde_scheme_scheme, only: bracket_terms
   use symsde_step_hamiltonian_brackets_differences, only: difference_bracket, new_difference_bracket
   use symsde_step_hamiltonian_brackets_exact, only: has_exact_bracket
   use symsde_step_hamiltonian_mass, only: constant_mass, new_constant_mass
   use symsde_step_hamiltonian_noise_rows, only: new_noise_rows
   implicit none
   private
   public :: modified_hamiltonian, new_modified_hamiltonian, active_brackets, single_weights

   !> The added parts, with work arrays for one evaluation; here (bq, bp) is the gradient of one bracket.
   type, extends(difference_bracket) :: modified_hamiltonian
      type(bracket_terms) :: active               !! parts that have an effect on this model
      logical :: simple = .false.        !! position noise, H = p.p/2 + U(q)
      logical, private :: heavy = .false.                 !! the same with a diagonal mass, the same for all paths
      type(constant_mass), private :: mass                !! that mass
      logical :: time_dependent = .false.                 !! some noise changes in time, in a way that has an effect
      !> The model, if it gives squares of all noises at one pass, and several meet or it has one degree of freedom
      class(kernel_model), pointer :: squares => null()
      logical, private :: together = .false.      !! single and nested brackets of `simple` by the same calls
      logical, private :: begun = .false.         !! whether callers call `begin` before the evaluations of a step
      logical, private :: turning = .false.       !! {H_k(t_1),H_k(t_0)} has an effect
      real(wp), allocatable, private :: c(:, :)            !! weights of the single bracket, c_0 = 0 (nlane, 0:nnoise)
      real(wp), allocatable, dimension(:, :), private :: bq, bp  !! (nlane, ndof)
      type(algebra_work), private :: work
   contains
      procedure :: begin
      procedure :: add_gradient
      procedure :: find_beside
   end type modified_hamiltonian

contains

   !> The brackets that have an effect on a model with these traits; brackets without an effect of their functionals are
   !> dropped. The nested bracket of a noise that is linear in q is constant if H = p.p/2 + U(q).
   pure type(bracket_terms) function active_brackets(brackets, traits) result(active)
      type(bracket_terms), intent(in) :: brackets   !! brackets of the scheme
      type(model_traits), intent(in) :: traits
      type(functional_set) :: needed

      ! Single brackets have an effect if some noise has one. Areas multiply brackets of two noises, which are
      ! constant for additive noise and vanish for noise in position (base/functionals).
      needed = functionals([path_dz, path_areas])
      needed = needed%needed_for(traits)
      active%single = brackets%single .and. needed%has(path_dz)
      active%areas = brackets%areas .and. needed%has(path_areas)
      active%nested = brackets%nested .and. traits%nnoise > 0 .and. &
                      .not. (traits%additive .and. traits%position_noise .and. traits%identity_mass)
      ! Crossed brackets differ from {{H,H_k},H_k} by brackets of noises alone, which vanish if areas have no effect.
      active%crossed = brackets%crossed .and. active%areas
   end function active_brackets

   !> The parts that have an effect on this model, for blocks of nlane lanes. If a part depends on it, the model is
   !> called at many times to find out whether noises change in time.
   subroutine new_modified_hamiltonian(self, model, brackets, nlane)
      type(modified_hamiltonian), intent(out) :: self
      class(model_type), intent(in), target :: model
      type(bracket_terms), intent(in) :: brackets   !! the scheme's brackets
      integer, intent(in) :: nlane
      type(kernel_offers) :: offers

      call new_difference_bracket(self, model, nlane)
      self%active = active_brackets(brackets, model%traits)
      call self%sort()
      self%simple = model%traits%position_noise .and. model%traits%identity_mass
      self%heavy = model%traits%position_noise .and. model%traits%has_diagonal_mass() .and. .not. self%simple &
                   .and. .not. model%traits%by_path
      if (self%heavy) call new_constant_mass(self%mass, nlane, self%ndof, self%nnoise)
      offers = offers_of(model)
      if (self%simple .and. offers%squares .and. (self%colours%n > 1 .or. self%ndof == 1)) &
         self%squares => kernels_of(model)
      self%together = (self%simple .or. self%heavy) .and. self%active%single .and. self%active%nested .and. &
                      .not. associated(self%squares)
      if (self%together .and. self%simple) call new_noise_rows(self%rows, model, nlane)
      self%turning = self%active%nested .and. .not. (model%traits%position_noise .or. model%traits%additive)
      ! The single bracket has a term for every noise that changes in time. The bracket {H_k(t_1),H_k(t_0)} is zero
      ! for noise in position, and has no gradient for additive noise.
      if (self%active%single .or. self%turning) self%time_dependent = noise_changes_in_time(model)
      associate (n => self%ndof, m => self%nnoise)
         allocate (self%c(nlane, 0:m), source=0.0_wp)
         allocate (self%bq(nlane, n), self%bp(nlane, n))
         call new_algebra_work(self%work, nlane, n, m)
      end associate
   end subroutine new_modified_hamiltonian

   !> Add the gradient of all active parts to hq and hp; or, with `rest`, only parts that derivatives at one point do
   !> not give: nested brackets by differences, and noises that change in time. step/one_dof/brackets then computes all
   !> other parts from the derivatives at the point.
   subroutine add_gradient(self, t, step, q, p, hq, hp, counters, nreal, rest)
      class(modified_hamiltonian), intent(inout) :: self
      real(wp), intent(in) :: t                                 !! time of H and H_k [time]
      type(step_record), intent(in) :: step                     !! includes the functionals of active brackets
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)
      real(wp), intent(inout), optional :: hq(self%nlane, self%ndof), hp(self%nlane, self%ndof)
      type(counters_type), intent(inout) :: counters
      integer, intent(in) :: nreal                              !! real paths of the block
      logical, intent(in), optional :: rest                     !! add only the rest
      logical :: whole, direct

      if (self%heavy) call find_mass(self, t, q)
      whole = .true.
      if (present(rest)) whole = .not. rest
      ! The single brackets of `simple` write into sp, and by themselves into sq, unless they have no part in q.
      direct = (self%simple .or. self%heavy) .and. whole .and. self%active%single
      if (.not. direct .or. self%together .or. self%model%traits%additive) self%sq = 0
      if (.not. direct) self%sp = 0
      ! The weights c_k of single brackets come first: add_motion computes its weights from them.
      if (.not. self%begun) call find_weights(self, step)
      if (whole .and. self%together) then
         call self%add_position_brackets(self%c, self%colours%n == 1, t, step%h, q, p, self%sq, self%sp)
      else if (whole .and. self%active%single) then
         call add_single(self, t, q, p)
      end if
      if (whole .and. self%active%areas) call add_areas(self, t, step, q, p)
      if (self%active%nested .and. .not. (whole .and. self%together) .and. &
          (whole .or. .not. has_exact_bracket(self%model%traits))) call add_nested(self, t, step, q, p)
      if (self%time_dependent) call add_motion(self, step, q, p)
      if (present(hq)) hq = hq + self%sq
      if (present(hp)) hp = hp + self%sp
      call count_up(self, counters, nreal)
   end subroutine add_gradient

   !> Find the weights of the step that the next evaluations belong to. Callers that never call this have them found at
   !> every evaluation.
   subroutine begin(self, step)
      class(modified_hamiltonian), intent(inout) :: self
      type(step_record), intent(in) :: step

      self%begun = .true.
      call find_weights(self, step)
   end subroutine begin

   !> Add the gradient of all active parts in q to hq, and store that in p in hp.
   subroutine find_beside(self, t, step, q, p, hq, hp, counters, nreal)
      class(modified_hamiltonian), intent(inout) :: self
      real(wp), intent(in) :: t
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)
      real(wp), intent(inout) :: hq(self%nlane, self%ndof)
      real(wp), intent(out) :: hp(self%nlane, self%ndof)
      type(counters_type), intent(inout) :: counters
      integer, intent(in) :: nreal

      if (.not. self%together .or. self%time_dependent) then
         hp = 0
         call self%add_gradient(t, step, q, p, hq, hp, counters, nreal)
         return
      end if
      if (self%heavy) call find_mass(self, t, q)
      if (.not. self%begun) call find_weights(self, step)
      call self%add_position_brackets(self%c, self%colours%n == 1, t, step%h, q, p, hq, hp)
      call count_up(self, counters, nreal)
   end subroutine find_beside

   !> Find the mass at the first position that is finite.
   subroutine find_mass(self, t, q)
      type(modified_hamiltonian), intent(inout) :: self
      real(wp), intent(in) :: t, q(self%nlane, self%ndof)

      if (self%mass%known) return
      call self%mass%look(self%model, self%nlane, t, q)
      self%inverse = self%mass%inverse
   end subroutine find_mass

   !> Count the calls of the model since the last count, for nreal paths; padding does not count.
   subroutine count_up(self, counters, nreal)
      type(modified_hamiltonian), intent(inout) :: self
      type(counters_type), intent(inout) :: counters
      integer, intent(in) :: nreal

      counters%gradients = counters%gradients + self%ngradient*nreal
      counters%hessian_vectors = counters%hessian_vectors + self%nproduct*nreal
      self%ngradient = 0
      self%nproduct = 0
   end subroutine count_up

   !> Add the nested brackets, in the cheapest form that the traits allow: squares of H_k,q, third derivatives, second
   !> differences along constant fields, or the general differences. If crossed, F/h = H + sum_l (dW_l/h) H_l.
   subroutine add_nested(self, t, step, q, p)
      type(modified_hamiltonian), intent(inout) :: self
      real(wp), intent(in) :: t
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)

      if (self%active%crossed) self%nested(:, 1:) = step%w(:, 1:)/step%h
      if (self%simple .or. self%heavy) then
         call add_squares(self, t, step%h, q, p)
      else if (has_exact_bracket(self%model%traits)) then
         call self%add_exact(self%nested, t, step%h, q, p, self%sq, self%sp)
      else if (self%model%traits%additive) then
         call self%add_shifts(t, step%h, q, p)
      else
         call self%add_differences(t, step%h, q, p)
      end if
   end subroutine add_nested

   !> The weights c_k = h dW_k/2 - dZ_k of the single brackets (nlane, 1:nnoise), zero if these are not active. dZ_k is
   !> the integral of W_k - W_k(t_n) over the step, so c_k/h is the mean of a straight line to dW_k minus the mean of
   !> the path.
   subroutine find_weights(self, step)
      class(modified_hamiltonian), intent(inout) :: self
      type(step_record), intent(in) :: step

      if (self%active%single) call single_weights(self%nlane, self%nnoise, step%h, step%w, step%of(path_dz)%x, self%c)
      if (self%together .and. self%colours%n == 1) call self%spread(1, self%c)
   end subroutine find_weights

   !> VEC c_k = h dW_k/2 - dZ_k of every noise; c_0 stays zero.
   pure subroutine single_weights(nlane, nnoise, h, w, z, c)
      integer, intent(in) :: nlane, nnoise
      real(wp), intent(in) :: h, w(nlane, 0:nnoise), z(nlane, nnoise)
      real(wp), intent(inout) :: c(nlane, 0:nnoise)
      integer :: k, lane

      do k = 1, nnoise
         do lane = 1, nlane
            c(lane, k) = 0.5_wp*h*w(lane, k) - z(lane, k)
         end do
      end do
   end subroutine single_weights

   !> {F,H} with F = sum_k (h dW_k/2 - dZ_k) H_k. For F(q) and H = p.M^-1 p/2 + U(q) it is F_q . M^-1 p.
   subroutine add_single(self, t, q, p)
      type(modified_hamiltonian), intent(inout) :: self
      real(wp), intent(in) :: t
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)

      associate (n => self%nlane, d => self%ndof, m => self%nnoise)
         if (self%simple .or. self%heavy) then  ! the gradient is (F_qq M^-1 p, M^-1 F_q); F_qq = 0 for additive noise
            call self%model%gradient(n, d, m, t, self%c, q, p, hq=self%sp)
            self%ngradient = self%ngradient + 1
            if (self%heavy) call self%divide(self%sp)
            if (self%model%traits%additive) return
            self%nproduct = self%nproduct + 1
            if (self%simple) then
               call self%model%hessian_vector(n, d, m, t, self%c, q, p, p, self%still, self%sq, self%gp)
               return
            end if
            self%rq = p
            call self%divide(self%rq)
            call self%model%hessian_vector(n, d, m, t, self%c, q, p, self%rq, self%still, self%sq, self%gp)
         else
            ! G = H: weight one for the drift, without h, which c_k contains.
            self%g = 0
            self%g(:, 0) = 1
            call add_bracket(self, t, self%c, q, p)
         end if
      end associate
   end subroutine add_single

   !> Add the gradient of sum_k (c_k/h) [H_k(t_1) - H_k(t_0)], with c_k = h dW_k/2 - dZ_k as for the single bracket,
   !> and of -(|h|/12) sum_k {H_k(t_1),H_k(t_0)}.
   subroutine add_motion(self, step, q, p)
      type(modified_hamiltonian), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)
      real(wp) :: t1, c
      integer :: k

      ! Both ends of the step instead of derivatives in time, which models do not offer.
      t1 = step%t + step%h
      if (self%active%single) then
         ! The difference of two gradients at the same point: add_sum adds the first and subtracts the second.
         self%g = self%c/step%h
         call self%add_sum(t1, q, p, 0.0_wp, 0.0_wp, 1.0_wp)
         call self%add_sum(step%t, q, p, 0.0_wp, 0.0_wp, -1.0_wp)
      end if
      if (.not. self%turning) return
      ! c grad {F,G} with F = H_k(t_1), G = H_k(t_0): Hess F (G_p, -G_q) - Hess G (F_p, -F_q).
      c = -abs(step%h)/12
      do k = 1, self%colours%n
         call self%field_of_colour(step%t, k, q, p)
         call self%add_product(t1, self%f, c, self%vq, self%vp, q, p, self%sq, self%sp)
         call self%field_of_colour(t1, k, q, p)
         call self%add_product(step%t, self%f, -c, self%vq, self%vp, q, p, self%sq, self%sp)
      end do
   end subroutine add_motion

   !> Add the gradient of sum_{k<l} A_kl {H_l,H_k} as sum_l {H_l, sum_{k<l} A_kl H_k}: m - 1 brackets of weighted sums
   !> instead of m (m-1)/2 brackets, since one call of a model sums over its Hamiltonians.
   subroutine add_areas(self, t, step, q, p)
      type(modified_hamiltonian), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: t, q(self%nlane, self%ndof), p(self%nlane, self%ndof)
      integer :: k, l

      do l = 2, self%nnoise  ! F = H_l, G = sum_{k<l} A_kl H_k
         if (.not. self%noisy(l)) cycle
         call self%show_noise(l)
         self%g = 0
         do k = 1, l - 1
            if (self%noisy(k)) self%g(:, k) = step%of(path_areas)%x(:, area_index(k, l))
         end do
         call add_bracket(self, t, self%f, q, p)
      end do
   end subroutine add_areas

   !> Add the gradient of {F,G} for the sums F and G with the weights f and self%g.
   subroutine add_bracket(self, t, f, q, p)
      type(modified_hamiltonian), intent(inout) :: self
      real(wp), intent(in) :: f(self%nlane, 0:self%nnoise)
      real(wp), intent(in) :: t, q(self%nlane, self%ndof), p(self%nlane, self%ndof)

      call bracket_gradient(self%work, self%model, t, f, self%g, q, p, self%bq, self%bp)
      self%ngradient = self%ngradient + 2
      self%nproduct = self%nproduct + 2
      self%sq = self%sq + self%bq
      self%sp = self%sp + self%bp
   end subroutine add_bracket

   !> Position noise: add the gradient of (h|h|/12) sum_k H_k,q . M^-1 H_k,q, which is (h|h|/6) H_k,qq M^-1 H_k,q.
   !> Crossed brackets have the same gradient, since noises in position commute.
   subroutine add_squares(self, t, h, q, p)
      type(modified_hamiltonian), intent(inout) :: self
      real(wp), intent(in) :: t, h
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)
      real(wp) :: c
      integer :: k

      ! The gradient of H_k,q . M^-1 H_k,q is 2 H_k,qq M^-1 H_k,q: one gradient, and its product with the Hessian.
      c = h*abs(h)/6
      if (associated(self%squares)) then
         call self%squares%squares(self%nlane, self%ndof, self%nnoise, t, q, self%gq)
         self%ngradient = self%ngradient + 1
         self%nproduct = self%nproduct + 1
         self%sq = self%sq + c*self%gq
         return
      end if
      do k = 1, self%colours%n
         call self%show_colour(k)
         associate (n => self%nlane, d => self%ndof, m => self%nnoise)
            call self%model%gradient(n, d, m, t, self%f, q, p, hq=self%vq)
            if (self%heavy) call self%divide(self%vq)
            call self%model%hessian_vector(n, d, m, t, self%f, q, p, self%vq, self%still, self%gq, self%gp)
         end associate
         self%ngradient = self%ngradient + 1
         self%nproduct = self%nproduct + 1
         self%sq = self%sq + c*self%gq
      end do
   end subroutine add_squares

end module symsde_step_hamiltonian_brackets
