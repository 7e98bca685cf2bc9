! SPDX-License-Identifier: BSD-3-Clause
!> The random Hamiltonian of one step with its brackets (step/hamiltonian/brackets), for one degree of freedom.
!>
!> Given all derivatives of every H_j at a point, brackets are sums of products: derivatives of order r of {F,G} consist
!> of those up to order r + 1 of F and G. So one evaluation calls the model for the derivatives of each H_j once, up to
!> the third if it has them, and nested brackets are brackets of brackets:
!>
!>    {F,G}   = F_q G_p - F_p G_q
!>    {F,G}_q = F_qq G_p + F_q G_qp - F_qp G_q - F_p G_qq
!>    {F,G}_p = F_qp G_p + F_q G_pp - F_pp G_q - F_p G_qp
!>
!> An evaluation adds up, in this order, the gradients and Hessians of
!>
!>    h H;   for every noise l: dW_l H_l, c_l {H_l,H}, A_kl {H_l,H_k} for k < l;   for every k: (h|h|/12) {{F,H_k},H_k}
!>
!> with c_l = h dW_l/2 - dZ_l and F = H, or H + sum_l (dW_l/h) H_l if brackets are crossed. If every H_j = e_j p^2/2 +
!> U_j(q), only few of these terms remain (step/one_dof/brackets_kinetic). For models without third derivatives nested
!> brackets are computed by differences (step/hamiltonian/brackets).
!>
!> In the Hessian of {F,G} the first part comes from second derivatives of F and G, the rest from third derivatives:
!>
!>    {F,G}_qq = 2 (F_qq G_qp - F_qp G_qq)  +  F_qqq G_p + F_q G_qqp - F_qqp G_q - F_p G_qqq
!>    {F,G}_qp = F_qq G_pp - F_pp G_qq      +  F_qqp G_p + F_q G_qpp - F_qpp G_q - F_p G_qqp
!>    {F,G}_pp = 2 (F_qp G_pp - F_pp G_qp)  +  F_qpp G_p + F_q G_ppp - F_ppp G_q - F_p G_qpp
!>
!> The gradient is exact. The Hessian lacks derivatives that the model does not have, and fourth derivatives except for
!> an angle: Newton's iteration finds the same root, only more slowly, depending on the size of the missing terms.
!>
!> Private to its family.
module symsde_step_one_dof_brackets
   use symsde_base_counters, only: counters_type
   use symsde_base_functionals, only: area_index, path_areas, path_dz
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: step_record
   use symsde_base_vectors, only: add_times_each
   use symsde_model_abstract, only: model_type
   use symsde_step_hamiltonian_brackets_exact, only: has_exact_bracket
   use symsde_step_hamiltonian_brackets, only: modified_hamiltonian, single_weights
   use symsde_step_one_dof_brackets_kinetic, only: kinetic_brackets, new_kinetic_brackets, are_kinetic, &
                                                   q_, p_, qq, qp, pp, nplace
   implicit none
   private
   public :: single_brackets, new_single_brackets, q_, p_, qq, qp, pp, nplace

   !> Columns of further derivatives. A separable Hamiltonian has two third derivatives, qqq and ppp. A bracket of two
   !> separable Hamiltonians has these too, but they need fourth derivatives and are left out; its other two, qqp and
   !> qpp, use their columns.
   integer, parameter :: qqq = 6, ppp = 7, qqp = 6, qpp = 7, all = ppp

   !> Data of one evaluation. The derivatives of H_j are in d(:, :, j), in the order of the columns; d(:, :, 0) is H
   !> until nested brackets replace it by F.
   type :: single_brackets
      private
      integer :: nlane = 0, nnoise = 0
      logical, public :: exact = .false.            !! whether the Hessian is the derivative of the gradient
      logical :: thirds = .false.                   !! whether all third derivatives are evaluated: H_j are separable
      logical :: along = .false. !! for H_j that are not separable: whether brackets need third derivatives along fields
      integer :: top = nplace                       !! number of known derivatives of H_j
      logical :: nested = .false.                   !! whether nested brackets are brackets of brackets
      logical :: partly = .false.                   !! whether step/hamiltonian/brackets computes a part
      integer, public :: asked = 0                  !! gradients and Hessians of the model per evaluation
      real(wp) :: times(0:2) = 0                    !! times of the middle of the step, and of its stages
      real(wp), allocatable, public :: c(:, :)      !! h dW_k/2 - dZ_k; c_0 = 0 (nlane, 0:nnoise)
      real(wp), allocatable, public :: rate(:, :)   !! c/h (nlane, 0:nnoise)
      type(kinetic_brackets), allocatable, public :: kinetic
      real(wp), allocatable :: unit(:, :, :)        !! weight one for each H_j (nlane, 0:nnoise, 0:nnoise)
      real(wp), allocatable :: d(:, :, :)           !! derivatives of H_j (nlane, all, 0:nnoise)
      real(wp), allocatable, dimension(:, :) :: b, bb  !! derivatives of {F,G} and of {{F,G},G} (nlane, all)
      real(wp), allocatable :: whole(:, :)          !! weights of F (nlane, 0:nnoise)
      real(wp), allocatable :: factor(:), v(:, :), g(:, :)  !! (nlane), (nlane, 2)
      real(wp), allocatable :: one(:)               !! ones (max(nlane, nnoise + 1))
      real(wp), allocatable :: x(:), y(:), beside(:, :)  !! one lane: q, p and d, H_j as lane j (0:nnoise), (.., all)
   contains
      procedure :: begin
      procedure :: evaluate
   end type single_brackets

contains

   !> Allocate for the brackets and lanes of `parts`, and decide which derivatives are needed: third ones only if nested
   !> brackets are active and the model has them. Kinetic brackets have separate arrays.
   subroutine new_single_brackets(self, parts)
      type(single_brackets), intent(out) :: self
      type(modified_hamiltonian), intent(in) :: parts
      integer :: j

      self%nlane = parts%nlane
      self%nnoise = parts%nnoise
      associate (n => parts%nlane, m => parts%nnoise, traits => parts%model%traits)
         allocate (self%c(n, 0:m), self%rate(n, 0:m), source=0.0_wp)
         self%nested = parts%active%nested .and. has_exact_bracket(traits)
         ! parts by differences, or at other times: derivatives at this point are not sufficient
         self%partly = parts%time_dependent .or. (parts%active%nested .and. .not. self%nested)
         self%exact = traits%quadratic .and. .not. self%partly
         ! H once, and every noise that is not silent once.
         self%asked = 1 + count(parts%noisy)
         if (are_kinetic(parts)) then
            if (parts%time_dependent) self%asked = 1 + 3*count(parts%noisy)  ! also H_k at both ends of the step
            allocate (self%kinetic)
            call new_kinetic_brackets(self%kinetic, parts)
            ! Sums and squares together; two more sums where noises change in time.
            if (self%kinetic%by_sums) self%asked = merge(3, 1, parts%time_dependent)
            self%exact = self%exact .or. self%kinetic%angle .or. self%kinetic%by_sums
            return
         end if
         ! A separable H_j has two third derivatives, which are computed one by one. Any other H_j has four; the
         ! brackets need them along two fields.
         self%thirds = self%nested .and. .not. traits%quadratic .and. traits%separable
         self%along = self%nested .and. .not. traits%quadratic .and. .not. traits%separable
         if (self%thirds) self%top = all
         allocate (self%unit(n, 0:m, 0:m), self%d(n, all, 0:m), self%b(n, all), self%bb(n, all), &
                   self%factor(n), self%v(n, 2), self%g(n, 2), self%whole(n, 0:m), self%beside(0:m, all), source=0.0_wp)
         allocate (self%one(max(n, m + 1)), source=1.0_wp)
         allocate (self%x(0:m), self%y(0:m))
         self%whole(:, 0) = 1
         do j = 0, m
            self%unit(:, j, j) = 1
         end do
      end associate
   end subroutine new_single_brackets

   !> Begin a step: the times of its evaluations, and the weights c of single brackets, which all evaluations share.
   subroutine begin(self, parts, step, c)
      class(single_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: c(2)  !! times of the stages, in units of h

      ! H and noises are evaluated at the time of the stage, or in the middle of the step for the guess shared by all
      ! stages.
      self%times(0) = step%t + 0.5_wp*step%h
      self%times(1) = step%t + c(1)*step%h
      self%times(2) = step%t + c(2)*step%h
      ! The times, and the terms of an angle at these times.
      if (allocated(self%kinetic)) call self%kinetic%begin(step, self%times)
      if (.not. parts%active%single) return
      call single_weights(self%nlane, self%nnoise, step%h, step%w, step%of(path_dz)%x, self%c)
      ! dW_k/2 - dZ_k/h, the weights of H_k(t_1) - H_k(t_0)
      if (parts%time_dependent) self%rate = self%c/step%h
   end subroutine begin

   !> Gradient and Hessian h(:, q_), .., h(:, pp) of the sum at (q, p), in stage i; for i = 0 in the middle of the step.
   !> Kinetic brackets have a separate implementation (step/one_dof/brackets_kinetic).
   subroutine evaluate(self, parts, i, step, q, p, h, counters, nreal)
      class(single_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(inout) :: parts
      integer, intent(in) :: i
      type(step_record), intent(in) :: step
      real(wp), intent(in), dimension(self%nlane) :: q, p
      real(wp), intent(inout) :: h(self%nlane, nplace)
      type(counters_type), intent(inout) :: counters
      integer, intent(in) :: nreal

      associate (t => self%times(i))
         ! The order is that of the header: derivatives of all H_j first, then single brackets and areas, then nested
         ! brackets, which overwrite d(:, :, 0), and last parts from other points and times.
         call ask(self, parts, t, q, p)
         if (self%thirds) counters%hessian_vectors = counters%hessian_vectors + nreal*self%asked
         call add_up(self, parts, step, h)
         if (self%nested) call add_nested(self, parts, t, step, q, p, h)
         if (self%partly) call parts%add_gradient(t, step, q, p, h(:, q_), h(:, p_), counters, nreal, rest=.true.)
      end associate
      counters%gradients = counters%gradients + nreal*self%asked
      counters%hessians = counters%hessians + nreal*self%asked
   end subroutine evaluate

   !> Evaluate the derivatives of every H_j by the model, one H_j after the other, with weight one for H_j alone. For
   !> one lane a single call is enough: it has m + 1 lanes at the same point, and lane j has the weights of H_j.
   subroutine ask(self, parts, t, q, p)
      type(single_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      real(wp), intent(in) :: t
      real(wp), intent(in), dimension(self%nlane) :: q, p
      integer :: j

      associate (n => self%nlane, m => self%nnoise, model => parts%model)
         if (n == 1) then
            ! With one lane `unit` is the identity of m + 1 rows, and serves as the weights of m + 1 lanes.
            self%x = q(1)
            self%y = p(1)
            call ask_lanes(model, self%thirds, m + 1, t, self%unit, self%x, self%y, self%one, self%beside)
            do j = 0, m
               self%d(1, :, j) = self%beside(j, :)
            end do
            return
         end if
         ! The first slices of `unit` and d belong to H.
         call ask_lanes(model, self%thirds, n, t, self%unit, q, p, self%one, self%d)
         do j = 1, m
            ! For a silent noise d keeps its initial zeros; so do the third derivatives of additive noise.
            if (parts%noisy(j)) &
               call ask_lanes(model, self%thirds .and. .not. model%traits%additive, n, t, self%unit(:, :, j), q, p, &
                              self%one, self%d(:, :, j))
         end do
      end associate
   end subroutine ask

   !> The derivatives of sums with weights w in n lanes. H'''[(1,1),(1,1)] of a separable H is (H_qqq, H_ppp).
   subroutine ask_lanes(model, thirds, n, t, w, q, p, one, d)
      class(model_type), intent(in) :: model
      logical, intent(in) :: thirds
      integer, intent(in) :: n
      real(wp), intent(in) :: t, w(n, 0:model%traits%nnoise)
      real(wp), intent(in), dimension(n) :: q, p, one
      real(wp), intent(inout) :: d(n, all)

      associate (m => model%traits%nnoise)
         ! Each derivative has its column in d, so the model writes directly into it.
         call model%gradient_hessian(n, 1, m, t, w, q, p, d(:, q_), d(:, p_), d(:, qq), d(:, qp), d(:, pp))
         if (thirds) call model%third_derivative(n, 1, m, t, w, q, p, one, one, one, one, d(:, qqq), d(:, ppp))
      end associate
   end subroutine ask_lanes

   !> h = gradient and Hessian of sum_j w_j H_j, sum_l c_l {H_l,H} and sum_{k<l} A_kl {H_l,H_k}.
   subroutine add_up(self, parts, step, h)
      type(single_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      type(step_record), intent(in) :: step
      real(wp), intent(out) :: h(self%nlane, nplace)
      integer :: k, l

      associate (n => self%nlane, noisy => parts%noisy, d => self%d, b => self%b)
         h = 0
         call add_times_each(n, nplace, step%w(:, 0), d, h)
         ! The model could sum h H + sum_l dW_l H_l in one call, but brackets need every H_j separately.
         do l = 1, self%nnoise
            if (.not. noisy(l)) cycle
            call add_times_each(n, nplace, step%w(:, l), d(:, :, l), h)
            if (parts%active%single) then
               call find_bracket(n, self%thirds, d(:, :, l), d, b)
               call add_times_each(n, nplace, self%c(:, l), b, h)
            end if
            ! Areas belong to pairs k < l, whose derivatives are both in d, so a bracket for each pair needs no call of
            ! the model.
            if (.not. parts%active%areas) cycle
            do k = 1, l - 1
               if (.not. noisy(k)) cycle
               call find_bracket(n, self%thirds, d(:, :, l), d(:, :, k), b)
               call add_times_each(n, nplace, step%of(path_areas)%x(:, area_index(k, l)), b, h)
            end do
         end do
      end associate
   end subroutine add_up

   !> Add (h|h|/12) sum_k {{F,H_k},H_k}. From here on d(:, :, 0) belongs to F: to H, or, if brackets are crossed, to the
   !> whole step divided by h. Additive noises have a constant field v, and only F'''[v,v] remains; other noises use the
   !> bracket b = {F,H_k} and the bracket bb = {b,H_k}. Second derivatives of b contain third derivatives of F and H_k:
   !> for separable Hamiltonians these are added to b, for others to the gradient of bb, along the fields.
   subroutine add_nested(self, parts, t, step, q, p, h)
      type(single_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: t
      real(wp), intent(in), dimension(self%nlane) :: q, p
      real(wp), intent(inout) :: h(self%nlane, nplace)
      integer :: k

      associate (n => self%nlane, noisy => parts%noisy, d => self%d, b => self%b, bb => self%bb)
         ! F = H + sum_l (dW_l/h) H_l: add the derivatives of the noises to the derivatives of H.
         if (parts%active%crossed) then
            do k = 1, self%nnoise
               self%whole(:, k) = step%w(:, k)/step%h
               if (noisy(k)) call add_times_each(n, self%top, self%whole(:, k), d(:, :, k), d)
            end do
         end if
         ! The bracket is even in H_k and odd in H, hence h|h|: |h| replaces the square of an increment.
         self%factor = step%h*abs(step%h)/12
         do k = 1, self%nnoise
            if (.not. noisy(k)) cycle
            if (parts%model%traits%additive) then
               ! v is constant, and the gradient of {{F,H_k},H_k} = F''[v,v] has only third derivatives.
               bb = 0
               if (self%thirds) call find_along_constant(n, d, d(:, :, k), bb)
            else
               ! b = {F,H_k} with two of its third derivatives if F and H_k are separable, then bb = {b,H_k}.
               call find_bracket(n, self%thirds, d, d(:, :, k), b)
               call find_bracket(n, .false., b, d(:, :, k), bb)
               if (self%thirds) call add_mixed_thirds(n, b, d(:, :, k), bb)
            end if
            if (self%along) call add_along(self, parts, t, k, q, p, bb)
            call add_times_each(n, nplace, self%factor, bb, h)
         end do
      end associate
   end subroutine add_nested

   !> Add the terms of third derivatives in the gradient of {{F,H_k},H_k}: F'''[v,v] - H_k'''[u,v], where u is the field
   !> of F, v the field of H_k. They take two calls of the model for every noise, at this time and point.
   subroutine add_along(self, parts, t, k, q, p, bb)
      type(single_brackets), intent(inout) :: self
      type(modified_hamiltonian), intent(in) :: parts
      real(wp), intent(in) :: t
      integer, intent(in) :: k
      real(wp), intent(in), dimension(self%nlane) :: q, p
      real(wp), intent(inout) :: bb(self%nlane, all)

      associate (n => self%nlane, m => self%nnoise, d => self%d, model => parts%model, v => self%v, g => self%g)
         ! Fields from known derivatives: v = (H_k,p, -H_k,q), and u = (F_p, -F_q).
         v(:, 1) = d(:, p_, k)
         v(:, 2) = -d(:, q_, k)
         call model%third_derivative(n, 1, m, t, self%whole, q, p, v(:, 1), v(:, 2), v(:, 1), v(:, 2), g(:, 1), g(:, 2))
         bb(:, :p_) = bb(:, :p_) + g
         ! Additive noise has no third derivatives.
         if (model%traits%additive) return
         call model%third_derivative(n, 1, m, t, self%unit(:, :, k), q, p, d(:, p_, 0), -d(:, q_, 0), v(:, 1), &
                                     v(:, 2), g(:, 1), g(:, 2))
         bb(:, :p_) = bb(:, :p_) - g
      end associate
   end subroutine add_along

   ! ---- kernels: products are added one after another, since of a sum of two either may be fused -------------------

   !> VEC Gradient of {F,G} = F_q G_p - F_p G_q, and the first part of its Hessian, from second derivatives (see the
   !> header). F may itself be a bracket, of which only derivatives up to the second are read. With `thirds` F and G are
   !> separable, so F_qp = 0 and F_qqp = F_qpp = 0: the part of the Hessian from third derivatives is added, and third
   !> derivatives of {F,G} itself are computed: {F,G}_qqp = F_qqq G_pp - F_pp G_qqq and {F,G}_qpp = F_qq G_ppp - F_ppp
   !> G_qq.
   pure subroutine find_bracket(nlane, thirds, f, g, b)
      integer, intent(in) :: nlane
      logical, intent(in) :: thirds
      real(wp), intent(in), dimension(nlane, all) :: f, g
      real(wp), intent(inout) :: b(nlane, all)
      integer :: l

      do l = 1, nlane
         b(l, q_) = difference(f(l, qq), g(l, p_), f(l, q_), g(l, qp), f(l, qp), g(l, q_), f(l, p_), g(l, qq))
         b(l, p_) = difference(f(l, qp), g(l, p_), f(l, q_), g(l, pp), f(l, pp), g(l, q_), f(l, p_), g(l, qp))
         b(l, qq) = 2*difference_of_two(f(l, qq), g(l, qp), f(l, qp), g(l, qq))
         b(l, qp) = difference_of_two(f(l, qq), g(l, pp), f(l, pp), g(l, qq))
         b(l, pp) = 2*difference_of_two(f(l, qp), g(l, pp), f(l, pp), g(l, qp))
      end do
      if (.not. thirds) return
      do l = 1, nlane
         b(l, qq) = b(l, qq) + difference_of_two(f(l, qqq), g(l, p_), f(l, p_), g(l, qqq))
         b(l, pp) = b(l, pp) + difference_of_two(f(l, q_), g(l, ppp), f(l, ppp), g(l, q_))
         b(l, qqp) = difference_of_two(f(l, qqq), g(l, pp), f(l, pp), g(l, qqq))
         b(l, qpp) = difference_of_two(f(l, qq), g(l, ppp), f(l, ppp), g(l, qq))
      end do
   end subroutine find_bracket

   !> VEC Add the terms of third derivatives in the Hessian of {B,G}, where B is a bracket of separable Hamiltonians
   !> and G is separable: B has qqp and qpp (B_qqq and B_ppp would need fourth derivatives), and G has qqq and ppp.
   pure subroutine add_mixed_thirds(nlane, b, g, bb)
      integer, intent(in) :: nlane
      real(wp), intent(in), dimension(nlane, all) :: b, g
      real(wp), intent(inout) :: bb(nlane, all)
      integer :: l

      do l = 1, nlane
         bb(l, qq) = bb(l, qq) - b(l, qqp)*g(l, q_)
         bb(l, qq) = bb(l, qq) - b(l, p_)*g(l, qqq)
         bb(l, qp) = bb(l, qp) + difference_of_two(b(l, qqp), g(l, p_), b(l, qpp), g(l, q_))
         bb(l, pp) = bb(l, pp) + b(l, qpp)*g(l, p_)
         bb(l, pp) = bb(l, pp) + b(l, q_)*g(l, ppp)
      end do
   end subroutine add_mixed_thirds

   !> VEC The gradient of {{F,G},G} = F''[v,v] if F is separable and the field v = (G_p, -G_q) of G is constant.
   pure subroutine find_along_constant(nlane, f, g, bb)
      integer, intent(in) :: nlane
      real(wp), intent(in), dimension(nlane, all) :: f, g
      real(wp), intent(inout) :: bb(nlane, all)
      integer :: l

      do l = 1, nlane
         ! The second derivatives of F''[v,v] are fourth derivatives of F, and are left out.
         bb(l, q_) = f(l, qqq)*g(l, p_)*g(l, p_)
         bb(l, p_) = f(l, ppp)*g(l, q_)*g(l, q_)
      end do
   end subroutine find_along_constant

   !> a b + c d - e f - g h, summed from left to right, one product in each statement.
   pure real(wp) function difference(a, b, c, d, e, f, g, h) result(r)
      real(wp), intent(in) :: a, b, c, d, e, f, g, h

      r = 0 + a*b
      r = r + c*d
      r = r - e*f
      r = r - g*h
   end function difference

   !> a b - c d, one product in each statement.
   pure real(wp) function difference_of_two(a, b, c, d) result(r)
      real(wp), intent(in) :: a, b, c, d

      r = 0 + a*b
      r = r - c*d
   end function difference_of_two

end module symsde_step_one_dof_brackets
