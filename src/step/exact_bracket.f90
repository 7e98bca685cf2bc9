! SPDX-License-Identifier: BSD-3-Clause
!> The nested brackets of step/modified_hamiltonian as they are, for models that offer third derivatives, or whose
!> third derivatives vanish. With u, v the fields of H (or F/h) and H_k
!>
!>    {{H,H_k},H_k} = H''[v,v] - H_k''[u,v]
!>    gradient      = H'''[v,v] - H_k'''[u,v] + (Dv)^T (2 H''v - H_k''u) - (Du)^T H_k''v
!>
!> with (Dv)^T r = H_k'' (-r_p, r_q). Where noise is additive v is constant, and H'''[v,v] is all.
module symsde_step_exact_bracket
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: model_traits
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: exact_bracket, new_exact_bracket, has_exact_bracket

   type :: exact_bracket
      private
      integer :: nlane = 0, ndof = 0, nnoise = 0
      real(wp), allocatable :: w(:, :)    !! weights of one Hamiltonian (nlane, 0:nnoise)
      real(wp), allocatable, dimension(:, :) :: uq, up, vq, vp, rq, rp, yq, yp, gq, gp  !! (nlane, ndof)
   contains
      procedure :: add
   end type exact_bracket

contains

   !> Whether a model with these traits needs no difference quotients.
   pure logical function has_exact_bracket(traits) result(has)
      type(model_traits), intent(in) :: traits

      has = traits%has_third_derivative .or. traits%quadratic
   end function has_exact_bracket

   !> Room for blocks of nlane lanes.
   pure subroutine new_exact_bracket(self, nlane, ndof, nnoise)
      type(exact_bracket), intent(out) :: self
      integer, intent(in) :: nlane, ndof, nnoise

      self%nlane = nlane
      self%ndof = ndof
      self%nnoise = nnoise
      allocate (self%w(nlane, 0:nnoise))
      allocate (self%uq(nlane, ndof), self%up(nlane, ndof), self%vq(nlane, ndof), self%vp(nlane, ndof))
      allocate (self%rq(nlane, ndof), self%rp(nlane, ndof), self%yq(nlane, ndof), self%yp(nlane, ndof))
      allocate (self%gq(nlane, ndof), self%gp(nlane, ndof))
   end subroutine new_exact_bracket

   !> Add the gradient of (h|h|/12) sum_k {{H,H_k},H_k}, H with these weights.
   subroutine add(self, model, noisy, weights, t, h, q, p, hq, hp, counters, nreal)
      class(exact_bracket), intent(inout) :: self
      class(model_type), intent(in) :: model
      logical, intent(in) :: noisy(self%nnoise)
      real(wp), intent(in) :: weights(self%nlane, 0:self%nnoise)
      real(wp), intent(in) :: t, h
      real(wp), intent(in) :: q(self%nlane, self%ndof), p(self%nlane, self%ndof)
      real(wp), intent(inout) :: hq(self%nlane, self%ndof), hp(self%nlane, self%ndof)
      type(counters_type), intent(inout) :: counters
      integer, intent(in) :: nreal
      real(wp) :: c
      logical :: additive
      integer :: k, asked

      c = h*abs(h)/12
      additive = model%traits%additive
      asked = count(noisy)
      self%yq = 0
      self%yp = 0
      if (.not. additive) call take_field(self, model, t, weights, q, p, self%uq, self%up)
      do k = 1, self%nnoise
         if (.not. noisy(k)) cycle
         self%w = 0
         self%w(:, k) = 1
         call take_field(self, model, t, self%w, q, p, self%vq, self%vp)
         call add_third(self, model, t, weights, c, self%vq, self%vp, q, p, hq, hp)
         if (additive) cycle
         call add_third(self, model, t, self%w, -c, self%uq, self%up, q, p, hq, hp)
         self%rq = 0
         self%rp = 0
         call add_product(self, model, t, weights, 2*c, self%vq, self%vp, q, p, self%rq, self%rp)
         call add_product(self, model, t, self%w, -c, self%uq, self%up, q, p, self%rq, self%rp)
         call add_product(self, model, t, self%w, -c, self%vq, self%vp, q, p, self%yq, self%yp)
         call add_transposed(self, model, t, self%w, self%rq, self%rp, q, p, hq, hp)
      end do
      counters%gradients = counters%gradients + nreal*asked
      if (additive) return
      call add_transposed(self, model, t, weights, self%yq, self%yp, q, p, hq, hp)
      counters%gradients = counters%gradients + nreal
      counters%hessian_vectors = counters%hessian_vectors + nreal*(1 + 4*asked)
   end subroutine add

   !> v = the Hamiltonian field (S_p, -S_q), S the sum with weights w.
   subroutine take_field(self, model, t, w, q, p, vq, vp)
      type(exact_bracket), intent(inout) :: self
      class(model_type), intent(in) :: model
      real(wp), intent(in) :: t, w(self%nlane, 0:self%nnoise)
      real(wp), intent(in), dimension(self%nlane, self%ndof) :: q, p
      real(wp), intent(out), dimension(self%nlane, self%ndof) :: vq, vp

      call model%gradient(self%nlane, self%ndof, self%nnoise, t, w, q, p, vp, vq)
      vp = -vp
   end subroutine take_field

   !> Add c S'''[a,v].
   subroutine add_third(self, model, t, w, c, aq, ap, q, p, hq, hp)
      type(exact_bracket), intent(inout) :: self
      class(model_type), intent(in) :: model
      real(wp), intent(in) :: t, c, w(self%nlane, 0:self%nnoise)
      real(wp), intent(in), dimension(self%nlane, self%ndof) :: aq, ap, q, p
      real(wp), intent(inout), dimension(self%nlane, self%ndof) :: hq, hp

      if (model%traits%quadratic) return
      call model%third_derivative(self%nlane, self%ndof, self%nnoise, t, w, q, p, aq, ap, self%vq, self%vp, &
                                  self%gq, self%gp)
      hq = hq + c*self%gq
      hp = hp + c*self%gp
   end subroutine add_third

   !> Add c S'' a.
   subroutine add_product(self, model, t, w, c, aq, ap, q, p, hq, hp)
      type(exact_bracket), intent(inout) :: self
      class(model_type), intent(in) :: model
      real(wp), intent(in) :: t, c, w(self%nlane, 0:self%nnoise)
      real(wp), intent(in), dimension(self%nlane, self%ndof) :: aq, ap, q, p
      real(wp), intent(inout), dimension(self%nlane, self%ndof) :: hq, hp

      call model%hessian_vector(self%nlane, self%ndof, self%nnoise, t, w, q, p, aq, ap, self%gq, self%gp)
      hq = hq + c*self%gq
      hp = hp + c*self%gp
   end subroutine add_product

   !> Add (D field of S)^T r.
   subroutine add_transposed(self, model, t, w, rq, rp, q, p, hq, hp)
      type(exact_bracket), intent(inout) :: self
      class(model_type), intent(in) :: model
      real(wp), intent(in) :: t, w(self%nlane, 0:self%nnoise)
      real(wp), intent(in), dimension(self%nlane, self%ndof) :: rq, rp, q, p
      real(wp), intent(inout), dimension(self%nlane, self%ndof) :: hq, hp
      real(wp) :: turned(self%nlane, self%ndof)

      turned = -rp
      call add_product(self, model, t, w, 1.0_wp, turned, rq, q, p, hq, hp)
   end subroutine add_transposed

end module symsde_step_exact_bracket
