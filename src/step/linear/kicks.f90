! SPDX-License-Identifier: BSD-3-Clause
!> Drifts and kicks of a splitting scheme (scheme/kicks) with noise in position, H = p.M^-1 p/2 + U(q), and their
!> transposed maps in the reverse order:
!>
!>    x <- x + tau_i M^-1 y           c <- c + tau_i M^-1 u
!>    y <- y - f_i(x)                 u <- u - f_i,x c,          f_i = grad(b_i h U + sum_k w_ik H_k)
!>
!> (where momenta decay by one rate, x <- x + phi_i M^-1 y, y <- E_i y and c <- E_i c + phi_i M^-1 u with
!> E_i = exp(-gamma tau_i), phi_i = (1 - E_i)/gamma)
!>
!> for i = 1 .. s, and a last drift. The points x_i of the kicks are found again from the state before the step. Weights
!> are those of the forward step (step/splitting/coefficients), with dZ and K of the path.
!>
!> Products of gradients in kicks (step/splitting/products.inc) are Hess F M^-1 G_q, with F = G = V, or with noises F
!> and sums G of noises. Their derivative along v holds third derivatives of F:
!>
!>    f_i,x v = Hess F_i v + sum factor (F'''(M^-1 G_q, v) + Hess F M^-1 Hess G v)
!>
!> The sum over all products is the derivative of a gradient, hence symmetric, and serves covectors as well.
!>
!> Private to its family.
module symsde_step_linear_kicks
   use symsde_base_damping, only: noise_law3, noise_path
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_model_abstract, only: model_type
   use symsde_noise_decay_law, only: decay_integral
   use symsde_scheme_kicks, only: flow_free
   use symsde_scheme_scheme, only: correction_none, splitting_form
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_linear_linear_step, only: linear_step
   use symsde_step_splitting_coefficients, only: kick_weights, new_kick_weights
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: kicks_step, new_kicks_step, why_no_kicks

   type, extends(linear_step) :: kicks_step
      private
      type(kick_weights) :: weights
      real(wp), allocatable :: tau(:)        !! drifts before each kick and behind the last, as parts of the step
      real(wp) :: rate = 0                   !! gamma
      logical :: by_h = .false.              !! the mass is the identity
      real(wp), allocatable :: w(:, :)       !! weights of a drift: tau and zero (nlane, 0:nnoise)
      real(wp), allocatable :: x(:, :, :)    !! points of the kicks (nlane, ndof, nkick)
      logical :: bends = .false.             !! third derivatives of the wide model do not vanish
      real(wp), allocatable, dimension(:, :) :: of_f, of_g       !! weights of F and G (nlane, 0:nnoise)
      real(wp), allocatable, dimension(:, :) :: y                !! momenta within the step (nlane, ndof)
      real(wp), allocatable, dimension(:, :) :: vq, vp, uq, up   !! vectors and products (nlane, nwide)
      real(wp), allocatable, dimension(:, :) :: g, still, rq, rp !! M^-1 G_q, zero, terms of products (nlane, nwide)
   contains
      procedure :: back
      procedure :: forth
   end type kicks_step

contains

   !> Why a splitting scheme has no linearised step here; empty if it has.
   subroutine why_no_kicks(task, wide, why)
      type(stepper_task), intent(in) :: task
      class(model_type), intent(in) :: wide
      character(:), allocatable, intent(out) :: why
      type(kick_weights) :: weights

      why = ''
      if (task%scheme%form /= splitting_form) return
      if (task%scheme%kicks%flow /= flow_free) then
         why = 'has rotations or midpoint steps between its kicks'
      else if (task%damping%acts() .and. task%scheme%kicks%rational) then
         why = 'multiplies momenta by rational functions of rates'
      else if (task%damping%acts() .and. any(task%damping_noise == [noise_law3, noise_path])) then
         why = 'takes damping_noise "law", "law2" or "polynomial" for derivatives'
      else if (task%damping%acts() .and. (task%scheme%kicks%is_word() .or. .not. task%damping%is_scalar())) then
         why = 'has momenta that decay by several rates, or at kicks'
      else if (allocated(task%model%traits%quadratic_part)) then
         why = 'has drifts that couple positions and momenta'
      else if (.not. (wide%traits%separable .and. wide%traits%position_noise)) then
         why = 'has drifts that a parameter of the kinetic energy changes'
      else
         call new_kick_weights(weights, task%scheme%kicks, task%model%traits, task%damping, task%damping_noise, 8)
         if (any(weights%has_products) .and. .not. (wide%traits%has_third_derivative .or. wide%traits%quadratic)) &
            why = 'adds products of gradients to its kicks, and model '//wide%name//' has no third derivatives'
      end if
   end subroutine why_no_kicks

   !> Make the linearised step for blocks of nlane lanes.
   subroutine new_kicks_step(self, task, wide, nlane)
      type(kicks_step), intent(out) :: self
      type(stepper_task), intent(in) :: task
      class(model_type), intent(in), target :: wide
      integer, intent(in) :: nlane
      integer :: i, n

      n = task%model%traits%ndof
      self%nlane = nlane
      self%ndof = n
      self%nwide = wide%traits%ndof
      self%by_h = task%model%traits%identity_mass
      if (task%damping%acts()) self%rate = task%damping%rate(1)
      call new_kick_weights(self%weights, task%scheme%kicks, task%model%traits, task%damping, task%damping_noise, nlane)
      associate (c => task%scheme%kicks%c)
         allocate (self%tau(size(c) + 1))
         self%tau(1) = c(1)
         do i = 2, size(c)
            self%tau(i) = c(i) - c(i - 1)
         end do
         self%tau(size(c) + 1) = 1 - c(size(c))
         allocate (self%x(nlane, n, size(c)))
      end associate
      call new_one_step_hamiltonian(self%ham, wide, nlane, correction_none, 0.0_wp)
      allocate (self%w(nlane, 0:wide%traits%nnoise), source=0.0_wp)
      allocate (self%y(nlane, n))
      allocate (self%vq(nlane, self%nwide), self%vp(nlane, self%nwide), source=0.0_wp)
      allocate (self%uq(nlane, self%nwide), self%up(nlane, self%nwide))
      if (.not. any(self%weights%has_products)) return
      self%bends = .not. wide%traits%quadratic
      allocate (self%of_f(nlane, 0:wide%traits%nnoise), self%of_g(nlane, 0:wide%traits%nnoise), source=0.0_wp)
      allocate (self%g(nlane, self%nwide), self%still(nlane, self%nwide), source=0.0_wp)
      allocate (self%rq(nlane, self%nwide), self%rp(nlane, self%nwide))
   end subroutine new_kicks_step

   subroutine back(self, step, q0, p0, q1, p1, u, c, status)
      class(kicks_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q0(self%nlane, self%ndof), p0(self%nlane, self%ndof)
      real(wp), intent(in) :: q1(self%nlane, self%ndof), p1(self%nlane, self%ndof)
      real(wp), intent(inout) :: u(self%nlane, self%nrow), c(self%nlane, self%ndof)
      integer(i8), intent(inout) :: status(self%nlane)
      integer :: i, last

      call find_points(self, step, q0, p0)
      last = size(self%tau)
      call fade(self, step, last, c)
      call drift(self, step, last, u(:, :self%ndof), c)
      do i = last - 1, 1, -1
         self%vq(:, :self%ndof) = c
         self%vq(:, self%ndof + 1:) = 0
         call product_at(self, step, i)
         u = u - self%uq
         call fade(self, step, i, c)
         call drift(self, step, i, u(:, :self%ndof), c)
      end do
   end subroutine back

   subroutine forth(self, step, q0, p0, q1, p1, m, vq, vp, status)
      class(kicks_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q0(self%nlane, self%ndof), p0(self%nlane, self%ndof)
      real(wp), intent(in) :: q1(self%nlane, self%ndof), p1(self%nlane, self%ndof)
      integer, intent(in) :: m
      real(wp), intent(inout) :: vq(self%nlane, self%nrow, m), vp(self%nlane, self%ndof, m)
      integer(i8), intent(inout) :: status(self%nlane)
      integer :: i, j

      call find_points(self, step, q0, p0)
      do j = 1, m
         do i = 1, size(self%tau)
            call drift(self, step, i, vp(:, :, j), vq(:, :self%ndof, j))
            call fade(self, step, i, vp(:, :, j))
            if (i == size(self%tau)) exit
            self%vq = vq(:, :, j)
            call product_at(self, step, i)
            vp(:, :, j) = vp(:, :, j) - self%uq(:, :self%ndof)
         end do
      end do
   end subroutine forth

   !> The points of the kicks.
   subroutine find_points(self, step, q0, p0)
      type(kicks_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q0(self%nlane, self%ndof), p0(self%nlane, self%ndof)
      integer :: i

      call self%weights%weigh(self%nlane, step)
      self%y = p0
      do i = 1, size(self%tau) - 1
         if (i == 1) self%x(:, :, i) = q0
         if (i > 1) self%x(:, :, i) = self%x(:, :, i - 1)
         call drift(self, step, i, self%y, self%x(:, :, i))
         call fade(self, step, i, self%y)
         self%q(:, :self%ndof) = self%x(:, :, i)
         call self%ham%bare_gradient(self%nlane, time_of(self, step, i), self%weights%w(:, :, i), self%q, self%p, &
                                     hq=self%uq)
         call add_products(self, step, i, along=.false.)
         self%y = self%y - self%uq(:, :self%ndof)
      end do
   end subroutine find_points

   !> The second derivative of kick i times vq.
   subroutine product_at(self, step, i)
      type(kicks_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      integer, intent(in) :: i

      self%q(:, :self%ndof) = self%x(:, :, i)
      self%vp = 0
      call self%ham%bare_product(self%nlane, self%nlane, time_of(self, step, i), self%weights%w(:, :, i), self%q, &
                                 self%p, self%vq, self%vp, self%uq, self%up)
      call add_products(self, step, i, along=.true.)
   end subroutine product_at

   !> uq = uq + the products of gradients in kick i, or their derivative along vq: the product of V, and one for each
   !> colour of noises that do not meet.
   subroutine add_products(self, step, i, along)
      type(kicks_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      integer, intent(in) :: i
      logical, intent(in) :: along
      real(wp) :: t
      integer :: colour, l

      t = time_of(self, step, i)
      associate (weights => self%weights, kicks => self%weights%kicks, colours => self%weights%colours, h => step%h)
         if (abs(kicks%kappa(i)) > 0) then
            self%of_f = weights%v
            self%of_g = weights%v
            call add_product(self, t, 2*kicks%kappa(i)*h, along)
         end if
         do colour = 1, merge(colours%n, 0, weights%multiplies(i))
            self%of_f = 0
            do l = colours%from(colour) + 1, colours%from(colour + 1)
               self%of_f(:, colours%noise(l)) = 1
            end do
            self%of_g = (weights%c*h*abs(h))*self%of_f
            do l = 1, merge(self%ham%nnoise, 0, kicks%samples)
               self%of_g(:, l) = 0
               if (weights%at(l, colour) > 0) self%of_g(:, l) = weights%d(:, weights%at(l, colour))
            end do
            call add_product(self, t, kicks%share(i), along)
         end do
      end associate
   end subroutine add_products

   !> uq = uq + factor Hess F M^-1 G_q, or its derivative along vq, in rows of positions and of parameters.
   subroutine add_product(self, t, factor, along)
      type(kicks_step), intent(inout) :: self
      real(wp), intent(in) :: t, factor
      logical, intent(in) :: along
      integer :: n

      n = self%ndof
      call self%ham%bare_gradient(self%nlane, t, self%of_g, self%q, self%p, hq=self%rq)
      self%g = 0
      call add_by_mass(self, t, 1.0_wp, self%rq(:, :n), self%g(:, :n))
      if (along) then
         if (self%bends) then
            call self%ham%bare_third(self%nlane, t, self%of_f, self%q, self%p, self%g, self%still, self%vq, &
                                     self%still, self%rq, self%rp)
            self%uq = self%uq + factor*self%rq
         end if
         call self%ham%bare_product(self%nlane, self%nlane, t, self%of_g, self%q, self%p, self%vq, self%still, &
                                    self%rq, self%rp)
         self%g = 0
         call add_by_mass(self, t, 1.0_wp, self%rq(:, :n), self%g(:, :n))
      end if
      call self%ham%bare_product(self%nlane, self%nlane, t, self%of_f, self%q, self%p, self%g, self%still, &
                                 self%rq, self%rp)
      self%uq = self%uq + factor*self%rq
   end subroutine add_product

   !> to <- to + phi M^-1 v over drift i: of points by momenta, of tangent vectors, and of covectors by those of q.
   subroutine drift(self, step, i, v, to)
      type(kicks_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      integer, intent(in) :: i
      real(wp), intent(in) :: v(:, :)             !! (nlane, ndof)
      real(wp), intent(inout) :: to(:, :)         !! (nlane, ndof)
      real(wp) :: tau

      tau = self%tau(i)*step%h
      if (abs(tau) > 0) call add_by_mass(self, step%t, tau*decay_integral(1.0_wp, self%rate*tau), v, to)
   end subroutine drift

   !> x <- exp(-gamma tau) x: momenta over drift i, their tangent vectors and covectors.
   pure subroutine fade(self, step, i, x)
      type(kicks_step), intent(in) :: self
      type(step_record), intent(in) :: step
      integer, intent(in) :: i
      real(wp), intent(inout) :: x(:, :)          !! (nlane, ndof)

      if (abs(self%rate) > 0) x = exp(-self%rate*(self%tau(i)*step%h))*x
   end subroutine fade

   !> to <- to + factor M^-1 v
   subroutine add_by_mass(self, t, factor, v, to)
      type(kicks_step), intent(inout) :: self
      real(wp), intent(in) :: t, factor
      real(wp), intent(in) :: v(:, :)             !! (nlane, ndof)
      real(wp), intent(inout) :: to(:, :)         !! (nlane, ndof)

      if (self%by_h) then
         to = to + factor*v
      else  ! M^-1 v is H_p at the momentum v, since M is constant
         self%w(:, 0) = factor
         self%p(:, :self%ndof) = v
         call self%ham%bare_gradient(self%nlane, t, self%w, self%q, self%p, hp=self%up)
         self%p = 0
         to = to + self%up(:, :self%ndof)
      end if
   end subroutine add_by_mass

   pure real(wp) function time_of(self, step, i)
      type(kicks_step), intent(in) :: self
      type(step_record), intent(in) :: step
      integer, intent(in) :: i   !! kick

      time_of = step%t + self%weights%kicks%c(i)*step%h
   end function time_of

end module symsde_step_linear_kicks
