! SPDX-License-Identifier: BSD-3-Clause
!> The exact nested brackets of step/hamiltonian/brackets, for models that offer third derivatives, or whose third
!> derivatives vanish; and the fields and products that brackets consist of. With u, v the fields of H (or F/h) and H_k
!>
!>    {{H,H_k},H_k} = H''[v,v] - H_k''[u,v]
!>    gradient      = H'''[v,v] - H_k'''[u,v] + (Dv)^T (2 H''v - H_k''u) - (Du)^T H_k''v
!>
!> with (Dv)^T r = H_k'' (-r_p, r_q). If noise is additive, v is constant, and only H'''[v,v] remains.
!>
!> The first line holds because a bracket with H_k is the derivative along v: {H,H_k} = H'[v], and along v again
!> H''[v,v] + H'[Dv v]. With v = J H_k' the last term is H' J H_k'' v = -(J H') H_k'' v = -H_k''[u,v].
!>
!> The gradient is computed colour by colour, H_k being the sum of noises that have no bracket with each other: first
!> the third derivatives along the fields, then r = 2 H''v - H_k''u, to which (Dv)^T is applied immediately. (Du)^T is
!> applied to the sum over all colours, y = -sum_k H_k''v: one product at the end.
module symsde_step_hamiltonian_brackets_exact
   use symsde_base_kinds, only: wp
   use symsde_base_supports, only: noise_colours, noise_supports, sort_noises
   use symsde_base_traits, only: model_traits
   use symsde_base_vectors, only: add_times
   use symsde_model_abstract, only: model_type
   use symsde_step_hamiltonian_noise_rows, only: noise_rows
   implicit none
   private
   public :: exact_bracket, new_exact_bracket, has_exact_bracket

   !> The model, and work arrays for fields and products: (uq, up) = u, (vq, vp) = v, r and y as above, (gq, gp) the
   !> last result of the model, xq one half of an argument with the opposite sign.
   type :: exact_bracket
      class(model_type), pointer :: model => null()
      integer :: nlane = 0, ndof = 0, nnoise = 0
      logical, allocatable :: noisy(:)    !! noises that are not silent (nnoise)
      type(noise_colours) :: colours      !! the same in colours, whose noises have no brackets with each other
      integer :: ngradient = 0, nproduct = 0  !! calls of the model per path since the last count
      real(wp), allocatable :: f(:, :)    !! weights of one noise or of a colour (nlane, 0:nnoise)
      integer :: shown = 0                !! the colour in f; 0 = none
      type(noise_rows) :: rows            !! brackets of noises in position of a chain
      real(wp), allocatable :: still(:, :)  !! zeros (nlane, ndof)
      real(wp), allocatable :: own(:, :)    !! the weight of the noise of a colour that touches (nlane, ndof)
      real(wp), allocatable :: inverse(:)   !! the diagonal of M^-1, where noises in position have one (ndof)
      real(wp), allocatable, dimension(:, :) :: uq, up, vq, vp, rq, rp, yq, yp, gq, gp, xq  !! (nlane, ndof)
   contains
      procedure :: sort
      procedure :: add_exact
      procedure :: add_position_brackets
      procedure :: spread
      procedure :: divide
      procedure :: add_product
      procedure :: add_transposed
      procedure :: field_of_colour
      procedure :: show_colour
      procedure :: show_noise
      procedure :: field_of_sum
   end type exact_bracket

contains

   !> Whether a model with these traits needs no difference quotients: it has third derivatives, or they vanish.
   pure logical function has_exact_bracket(traits) result(has)
      type(model_traits), intent(in) :: traits

      has = traits%has_third_derivative .or. traits%quadratic
   end function has_exact_bracket

   !> Allocate for blocks of nlane lanes.
   subroutine new_exact_bracket(self, model, nlane)
      class(exact_bracket), intent(inout) :: self
      class(model_type), intent(in), target :: model
      integer, intent(in) :: nlane

      self%model => model
      self%nlane = nlane
      self%ndof = model%traits%ndof
      self%nnoise = model%traits%nnoise
      allocate (self%noisy(self%nnoise), source=.true.)
      if (allocated(model%traits%silent)) self%noisy = .not. model%traits%silent
      allocate (self%f(nlane, 0:self%nnoise), source=0.0_wp)
      associate (n => self%ndof)
         allocate (self%still(nlane, n), self%own(nlane, n), source=0.0_wp)
         allocate (self%uq(nlane, n), self%up(nlane, n), self%vq(nlane, n), self%vp(nlane, n), self%xq(nlane, n))
         allocate (self%rq(nlane, n), self%rp(nlane, n), self%yq(nlane, n), self%yp(nlane, n))
         allocate (self%gq(nlane, n), self%gp(nlane, n))
      end associate
   end subroutine new_exact_bracket

   !> Sort the noises into colours so that sum_k {{S,H_k},H_k} = sum_C {{S,F},F}, F being the sum of the noises of a
   !> colour C: {H_k,H_l} = 0 and {{S,H_k},H_l} = S''[v_k,v_l] = 0 for its noises k /= l. Noises in position are tied by
   !> the mass alone, others by every second derivative of H and of other noises, which bands tell.
   subroutine sort(self)
      class(exact_bracket), intent(inout) :: self
      type(noise_supports) :: supports
      integer :: reach, k

      reach = 0
      associate (t => self%model%traits)
         if (t%position_noise .and. t%has_diagonal_mass()) then
            supports = t%touches
         else if (t%bandwidth >= 0) then
            supports = t%touches
            reach = t%bandwidth
         end if
         call sort_noises(supports, pack([(k, k=1, self%nnoise)], self%noisy), self%nnoise, self%ndof, .false., &
                          reach, self%colours)
      end associate
   end subroutine sort

   !> Add the gradient of (h|h|/12) sum_k {{S,H_k},H_k} to (hq, hp), where S = sum_j weights_j H_j replaces H: the drift
   !> alone, or the whole step over h if brackets are crossed.
   subroutine add_exact(self, weights, t, h, q, p, hq, hp)
      class(exact_bracket), intent(inout) :: self
      real(wp), intent(in) :: weights(self%nlane, 0:self%nnoise)
      real(wp), intent(in) :: t, h
      real(wp), intent(in), dimension(self%nlane, self%ndof) :: q, p
      real(wp), intent(inout), dimension(self%nlane, self%ndof) :: hq, hp
      real(wp) :: c
      logical :: additive
      integer :: k

      ! The sum over noises of the gradient in the header, times c: add third derivatives immediately, collect the
      ! arguments of (Dv)^T in r, and the arguments of (Du)^T for all noises in y.
      c = h*abs(h)/12
      additive = self%model%traits%additive
      self%yq = 0
      self%yp = 0
      if (.not. additive) call self%field_of_sum(t, weights, q, p, self%uq, self%up)
      do k = 1, self%colours%n
         call self%field_of_colour(t, k, q, p)
         call add_third(self, t, weights, c, self%vq, self%vp, q, p, hq, hp)
         if (additive) cycle
         ! the following terms have H_k'' and H_k''', which are zero for additive noise
         call add_third(self, t, self%f, -c, self%uq, self%up, q, p, hq, hp)
         ! r = 2 c S''v - c H_k''u, and y = y - c H_k''v, each by one Hessian-vector product.
         self%rq = 0
         self%rp = 0
         call self%add_product(t, weights, 2*c, self%vq, self%vp, q, p, self%rq, self%rp)
         call self%add_product(t, self%f, -c, self%uq, self%up, q, p, self%rq, self%rp)
         call self%add_product(t, self%f, -c, self%vq, self%vp, q, p, self%yq, self%yp)
         call self%add_transposed(t, self%f, self%rq, self%rp, q, p, hq, hp)
      end do
      if (.not. additive) call self%add_transposed(t, weights, self%yq, self%yp, q, p, hq, hp)
   end subroutine add_exact

   !> The gradient of single and nested brackets of noises in position with H = p.p/2 + U(q), sum_k c_k H_k,q.p +
   !> (e/2) H_k,q.H_k,q with e = h|h|/6: its q part is added to hq, its p part is hp. No two noises of a colour touch
   !> one degree of freedom, so that each degree of freedom i has one c_i in a colour: with F the sum of these noises
   !>
   !>    (Hess F (c_i p_i + e F_i), c_i F_i)      is summed over colours,
   !>
   !> by one gradient and one product for each, or by its rows (step/hamiltonian/noise_rows).
   subroutine add_position_brackets(self, c, is_spread, t, h, q, p, hq, hp)
      class(exact_bracket), intent(inout) :: self
      real(wp), intent(in) :: c(self%nlane, 0:self%nnoise)
      logical, intent(in) :: is_spread   !! whether `spread` has been called for the only colour
      real(wp), intent(in) :: t, h
      real(wp), intent(in), dimension(self%nlane, self%ndof) :: q, p
      real(wp), intent(inout), dimension(self%nlane, self%ndof) :: hq
      real(wp), intent(out), dimension(self%nlane, self%ndof) :: hp
      integer :: colour

      if (self%colours%n == 0) hp = 0
      do colour = 1, self%colours%n
         if (.not. is_spread) call self%spread(colour, c)
         call self%show_colour(colour)
         if (colour == 1) then
            call add_colour(self, colour, t, h*abs(h)/6, q, p, hq, hp)
         else
            call add_colour(self, colour, t, h*abs(h)/6, q, p, hq, self%rp)
            hp = hp + self%rp
         end if
      end do
      self%ngradient = self%ngradient + self%colours%n
      self%nproduct = self%nproduct + self%colours%n
   end subroutine add_position_brackets

   !> The part of the shown colour: Hess F (c_i p_i + e F_i) is added to hq, and hp = c_i F_i.
   subroutine add_colour(self, colour, t, e, q, p, hq, hp)
      class(exact_bracket), intent(inout) :: self
      integer, intent(in) :: colour
      real(wp), intent(in) :: t, e
      real(wp), intent(in), dimension(self%nlane, self%ndof) :: q, p
      real(wp), intent(inout), dimension(self%nlane, self%ndof) :: hq, hp

      associate (n => self%nlane, d => self%ndof, m => self%nnoise)
         if (associated(self%rows%model)) then
            call self%rows%choose(colour, self%f)
            call self%rows%add(n, t, e, self%own, q, p, hq, hp)
            return
         end if
         call self%model%gradient(n, d, m, t, self%f, q, p, hq=self%vq)
         call weigh(n*d, e, self%own, p, self%vq, self%rq, hp)
         if (allocated(self%inverse)) then
            call self%divide(self%rq)
            call self%divide(hp)
         end if
         call self%model%hessian_vector(n, d, m, t, self%f, q, p, self%rq, self%still, self%gq, self%gp)
         call add_times(n*d, 1.0_wp, self%gq, hq)
      end associate
   end subroutine add_colour

   !> M^-1 x in place of x.
   subroutine divide(self, x)
      class(exact_bracket), intent(in) :: self
      real(wp), intent(inout) :: x(self%nlane, self%ndof)
      integer :: i

      do i = 1, self%ndof
         x(:, i) = self%inverse(i)*x(:, i)
      end do
   end subroutine divide

   !> own = c_i of the degrees of freedom that noises of a colour touch, and zero in all others.
   subroutine spread(self, colour, c)
      class(exact_bracket), intent(inout) :: self
      integer, intent(in) :: colour
      real(wp), intent(in) :: c(self%nlane, 0:self%nnoise)
      integer :: i, j

      self%own = 0
      associate (touches => self%model%traits%touches, colours => self%colours)
         do i = colours%from(colour) + 1, colours%from(colour + 1)
            associate (k => colours%noise(i))
               if (touches%are_given()) then
                  do j = touches%from(k) + 1, touches%from(k + 1)
                     self%own(:, touches%dof(j)) = c(:, k)
                  end do
               else
                  do j = 1, self%ndof
                     self%own(:, j) = c(:, k)
                  end do
               end if
            end associate
         end do
      end associate
   end subroutine spread

   !> VEC r = c p + e v and s = c v. Parentheses allow only the first product to be contracted.
   pure subroutine weigh(n, e, c, p, v, r, s)
      integer, intent(in) :: n
      real(wp), intent(in) :: e, c(n), p(n), v(n)
      real(wp), intent(out) :: r(n), s(n)
      integer :: i

      do i = 1, n
         r(i) = c(i)*p(i) + (e*v(i))
         s(i) = c(i)*v(i)
      end do
   end subroutine weigh

   !> Add c S'''[a,v], where S is the sum with weights w, a is a field of the caller, and v the field of the current
   !> noise.
   subroutine add_third(self, t, w, c, aq, ap, q, p, hq, hp)
      type(exact_bracket), intent(inout) :: self
      real(wp), intent(in) :: t, c, w(self%nlane, 0:self%nnoise)
      real(wp), intent(in), dimension(self%nlane, self%ndof) :: aq, ap, q, p
      real(wp), intent(inout), dimension(self%nlane, self%ndof) :: hq, hp

      ! Third derivatives of a quadratic sum vanish, and the model need not offer them.
      if (self%model%traits%quadratic) return
      call self%model%third_derivative(self%nlane, self%ndof, self%nnoise, t, w, q, p, aq, ap, self%vq, self%vp, &
                                       self%gq, self%gp)
      hq = hq + c*self%gq
      hp = hp + c*self%gp
   end subroutine add_third

   !> Add c S'' a, one Hessian-vector product of the sum S with weights w. count_up adds nproduct and ngradient to the
   !> caller's counters.
   subroutine add_product(self, t, w, c, aq, ap, q, p, hq, hp)
      class(exact_bracket), intent(inout) :: self
      real(wp), intent(in) :: t, c, w(self%nlane, 0:self%nnoise)
      real(wp), intent(in), dimension(self%nlane, self%ndof) :: aq, ap, q, p
      real(wp), intent(inout), dimension(self%nlane, self%ndof) :: hq, hp

      call self%model%hessian_vector(self%nlane, self%ndof, self%nnoise, t, w, q, p, aq, ap, self%gq, self%gp)
      self%nproduct = self%nproduct + 1
      hq = hq + c*self%gq
      hp = hp + c*self%gp
   end subroutine add_product

   !> Add (Ds)^T r = S'' J^T r = S'' (-r_p, r_q) with s = J S' the field of S.
   subroutine add_transposed(self, t, w, rq, rp, q, p, hq, hp)
      class(exact_bracket), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%nlane, 0:self%nnoise)
      real(wp), intent(in), dimension(self%nlane, self%ndof) :: rq, rp, q, p
      real(wp), intent(inout), dimension(self%nlane, self%ndof) :: hq, hp

      self%xq = -rp
      call self%add_product(t, w, 1.0_wp, self%xq, rq, q, p, hq, hp)
   end subroutine add_transposed

   !> v = the Hamiltonian field (F_p, -F_q) of the sum F of the noises of a colour; its weights stay in f.
   subroutine field_of_colour(self, t, colour, q, p)
      class(exact_bracket), intent(inout) :: self
      integer, intent(in) :: colour
      real(wp), intent(in) :: t
      real(wp), intent(in), dimension(self%nlane, self%ndof) :: q, p

      call self%show_colour(colour)
      call self%field_of_sum(t, self%f, q, p, self%vq, self%vp)
   end subroutine field_of_colour

   !> f = the weights of the sum of the noises of a colour.
   subroutine show_colour(self, colour)
      class(exact_bracket), intent(inout) :: self
      integer, intent(in) :: colour
      integer :: i

      if (colour == self%shown) return
      self%f = 0
      do i = self%colours%from(colour) + 1, self%colours%from(colour + 1)
         self%f(:, self%colours%noise(i)) = 1
      end do
      self%shown = colour
   end subroutine show_colour

   !> f = the weights of one noise.
   subroutine show_noise(self, k)
      class(exact_bracket), intent(inout) :: self
      integer, intent(in) :: k

      self%f = 0
      self%f(:, k) = 1
      self%shown = 0
   end subroutine show_noise

   !> (vq, vp) = (S_p, -S_q), the field of the sum S with weights w. The model writes S_q into vp and S_p into vq.
   subroutine field_of_sum(self, t, w, q, p, vq, vp)
      class(exact_bracket), intent(inout) :: self
      real(wp), intent(in) :: t, w(self%nlane, 0:self%nnoise)
      real(wp), intent(in), dimension(self%nlane, self%ndof) :: q, p
      real(wp), intent(out), dimension(self%nlane, self%ndof) :: vq, vp

      call self%model%gradient(self%nlane, self%ndof, self%nnoise, t, w, q, p, vp, vq)
      self%ngradient = self%ngradient + 1
      vp = -vp
   end subroutine field_of_sum

end module symsde_step_hamiltonian_brackets_exact
