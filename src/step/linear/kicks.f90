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
!> for i = 1 .. s, and a last drift. Exact flows of a quadratic part D of H, rotations and midpoint steps take the place
!> of drifts (linear/legs); the kicks are then those of H - D at p = 0, whose gradients and Hessians have S_qq and its
!> derivatives by parameters taken off, or of the noises alone. The points x_i of the kicks are found again from the
!> state before the step. Weights are those of the forward step (step/splitting/coefficients), with dZ and K of the
!> path.
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
   use symsde_base_status, only: error_type
   use symsde_model_abstract, only: model_type
   use symsde_noise_decay_law, only: decay_integral
   use symsde_scheme_kicks, only: flow_rotation, flow_midpoint
   use symsde_scheme_scheme, only: correction_none, frame_rotation, splitting_form
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_linear_flow_slopes, only: probe_slopes
   use symsde_step_linear_legs, only: leg_flow, find_linear, linear_legs, new_linear_legs, midpoint_legs, &
                                      new_midpoint_legs
   use symsde_step_linear_linear_step, only: linear_step, keep_parameters
   use symsde_step_open_linear_flow, only: damped_field
   use symsde_step_open_linear_noise, only: has_linear_law
   use symsde_step_splitting_coefficients, only: kick_weights, new_kick_weights
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: kicks_step, new_kicks_step, why_no_kicks, steps_by_kicks

   integer, parameter :: most_rows = 256   !! of the matrix of a linear flow

   type, extends(linear_step) :: kicks_step
      private
      type(kick_weights) :: weights
      class(leg_flow), allocatable :: legs   !! flows between kicks that are no free drifts
      real(wp), allocatable :: second(:, :)  !! S of the linear flows (2 ndof, 2 ndof)
      real(wp), allocatable :: slopes(:, :, :)   !! its derivatives by parameters (2 ndof, 2 ndof, nparameter)
      real(wp), allocatable :: tau(:)        !! drifts before each kick and behind the last, as parts of the step
      real(wp) :: rate = 0                   !! gamma
      logical :: by_h = .false.              !! the mass is the identity
      real(wp), allocatable :: w(:, :)       !! weights of a drift: tau and zero (nlane, 0:nnoise)
      real(wp), allocatable :: x(:, :, :)    !! points of the kicks (nlane, ndof, nkick)
      logical :: bends = .false.             !! third derivatives of the wide model do not vanish
      real(wp), allocatable, dimension(:, :) :: of_f, of_g       !! weights of F and G (nlane, 0:nnoise)
      real(wp), allocatable, dimension(:, :) :: at, y            !! the state within the step (nlane, ndof)
      real(wp), allocatable, dimension(:, :) :: vq, vp, uq, up   !! vectors and products (nlane, nwide)
      real(wp), allocatable, dimension(:, :) :: g, still, rq, rp !! M^-1 G_q, zero, terms of products (nlane, nwide)
   contains
      procedure :: back
      procedure :: forth
      procedure :: check
      procedure :: set_parameters
   end type kicks_step

contains

   !> Whether a scheme has drifts and kicks: those of an exact rotation after all noise, too.
   pure logical function steps_by_kicks(task)
      type(stepper_task), intent(in) :: task

      steps_by_kicks = task%scheme%form == splitting_form .or. task%scheme%frame == frame_rotation
   end function steps_by_kicks

   !> Why a splitting scheme has no linearised step here; empty if it has.
   subroutine why_no_kicks(task, wide, why)
      type(stepper_task), intent(in) :: task
      class(model_type), intent(in) :: wide
      character(:), allocatable, intent(out) :: why
      type(kick_weights) :: weights
      real(wp), allocatable :: second(:, :), slopes(:, :, :)
      logical :: by_parameters, is_free
      integer :: nrow

      why = ''
      if (.not. steps_by_kicks(task)) return
      by_parameters = wide%traits%ndof > task%model%traits%ndof
      call find_linear(task, wide%traits, second, slopes)
      nrow = 0
      if (allocated(second)) nrow = size(second, 1)
      is_free = task%scheme%kicks%flow /= flow_midpoint .and. nrow == 0
      if (task%damping%acts() .and. task%scheme%kicks%rational) then
         why = 'multiplies momenta by rational functions of rates'
      else if (task%damping%acts() .and. any(task%damping_noise == [noise_law3, noise_path])) then
         why = 'takes damping_noise "law", "law2" or "polynomial" for derivatives'
      else if (task%damping%acts() .and. (task%scheme%kicks%is_word() .or. &
                                          (is_free .and. .not. task%damping%is_scalar()))) then
         why = 'has momenta that decay by several rates, or at kicks'
      else if (by_parameters .and. .not. is_free .and. &
               has_linear_law(task%scheme, task%model%traits, task%damping, task%damping_noise)) then
         why = 'adds the exact noise of damped flows, which changes with parameters: '// &
               'damping_noise="polynomial" adds none'
      else if (nrow > 0 .and. task%model%traits%kicks_of_actions) then
         why = 'has kicks that turn planes (q, p) by functions of the actions'
      else if (nrow > most_rows) then
         why = 'has linear flows of more than 128 degrees of freedom'
      else if (nrow > 0 .and. by_parameters .and. .not. allocated(slopes)) then
         why = 'has linear flows, whose derivatives by these parameters are not known: formulas give them where '// &
               'S is smooth'
      else if (.not. wide%traits%position_noise .or. (is_free .and. .not. wide%traits%separable)) then
         why = 'has drifts that a parameter of the kinetic energy changes'
      else
         call new_kick_weights(weights, task%scheme%kicks, task%model%traits, task%damping, task%damping_noise, 8)
         if (.not. any(weights%has_products)) return
         if (.not. (wide%traits%has_third_derivative .or. wide%traits%quadratic)) then
            why = 'adds products of gradients to its kicks, and model '//wide%name//' has no third derivatives'
         else if (changes_mass()) then
            why = 'adds products of gradients to its kicks, over masses that a parameter changes'
         end if
      end if

   contains

      !> Whether M^-1 in products depends on a parameter.
      logical function changes_mass()
         integer :: n

         n = task%model%traits%ndof
         changes_mass = .not. is_free .and. nrow == 0 .and. .not. wide%traits%separable
         if (allocated(slopes)) changes_mass = any(abs(slopes(n + 1:, n + 1:, :)) > 0)
      end function changes_mass

   end subroutine why_no_kicks

   !> Make the linearised step for blocks of nlane lanes.
   subroutine new_kicks_step(self, task, model, wide, nlane, midpoint)
      type(kicks_step), intent(out) :: self
      type(stepper_task), intent(in) :: task
      class(model_type), intent(in), target :: model   !! the path's model, or a view that knows the lanes' paths
      class(model_type), intent(in), target :: wide
      integer, intent(in) :: nlane
      class(linear_step), allocatable, intent(inout), optional :: midpoint !! linearised midpoint step between kicks
      type(linear_legs), allocatable :: linear
      type(midpoint_legs), allocatable :: by_midpoint
      integer :: i, n

      n = task%model%traits%ndof
      self%nlane = nlane
      self%ndof = n
      self%nwide = wide%traits%ndof
      self%by_h = task%model%traits%identity_mass
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
      call find_linear(task, wide%traits, self%second, self%slopes)
      if (present(midpoint)) then
         allocate (by_midpoint)
         call new_midpoint_legs(by_midpoint, task, model, nlane, midpoint)
         call move_alloc(by_midpoint, self%legs)
      else if (allocated(self%second)) then
         allocate (linear)
         call new_linear_legs(linear, nlane, size(self%tau), damped_field(self%second, task%damping), self%slopes)
         call move_alloc(linear, self%legs)
         self%by_h = task%scheme%kicks%flow == flow_rotation
      else if (task%damping%acts()) then
         self%rate = task%damping%rate(1)
      end if
      call new_one_step_hamiltonian(self%ham, wide, nlane, correction_none, 0.0_wp)
      allocate (self%w(nlane, 0:wide%traits%nnoise), source=0.0_wp)
      allocate (self%at(nlane, n), self%y(nlane, n))
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

      call find_points(self, step, q0, p0, status)
      last = size(self%tau)
      do i = last, 1, -1
         if (i < last) then
            self%vq(:, :self%ndof) = c
            self%vq(:, self%ndof + 1:) = 0
            call product_at(self, step, i)
            u = u - self%uq
         end if
         if (.not. allocated(self%legs)) then
            call fade(self, step, i, c)
            call drift(self, step, i, u(:, :self%ndof), c)
         else if (abs(self%tau(i)) > 0) then
            call self%legs%back(i, u, c, status)
         end if
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

      call find_points(self, step, q0, p0, status)
      do i = 1, size(self%tau)
         if (allocated(self%legs) .and. abs(self%tau(i)) > 0) call self%legs%forth(i, vq, vp, status)
         do j = 1, m
            if (.not. allocated(self%legs)) then
               call drift(self, step, i, vp(:, :, j), vq(:, :self%ndof, j))
               call fade(self, step, i, vp(:, :, j))
            end if
            if (i == size(self%tau)) cycle
            self%vq = vq(:, :, j)
            call product_at(self, step, i)
            vp(:, :, j) = vp(:, :, j) - self%uq(:, :self%ndof)
         end do
      end do
   end subroutine forth

   !> Test how flows between kicks change with parameters, unless a program derived it.
   subroutine check(self, theta, t, h, error)
      class(kicks_step), intent(inout) :: self
      real(wp), intent(in) :: theta(:)
      real(wp), intent(in) :: t, h
      type(error_type), allocatable, intent(inout) :: error

      if (allocated(error) .or. .not. allocated(self%slopes) .or. self%ham%model%passed%is_kept()) return
      call probe_slopes(self%ham%model, self%second, self%slopes, theta(:self%nwide - self%ndof), t, error)
   end subroutine check

   !> Parameters of this step, and of midpoint steps in it.
   subroutine set_parameters(self, theta)
      class(kicks_step), intent(inout) :: self
      real(wp), intent(in) :: theta(:, :)   !! (nlane, nparameter)

      call keep_parameters(self, theta)
      if (.not. allocated(self%legs)) return
      select type (legs => self%legs)
      type is (midpoint_legs)
         call legs%step%set_parameters(theta)
      end select
   end subroutine set_parameters

   !> The points of the kicks, up to the last flow, before whose state flows are known.
   subroutine find_points(self, step, q0, p0, status)
      type(kicks_step), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q0(self%nlane, self%ndof), p0(self%nlane, self%ndof)
      integer(i8), intent(inout) :: status(self%nlane)
      real(wp) :: reached
      integer :: i

      call self%weights%weigh(self%nlane, step)
      self%y = p0
      self%at = q0
      reached = 0
      do i = 1, size(self%tau)
         if (.not. allocated(self%legs)) then
            if (i == size(self%tau)) exit
            call drift(self, step, i, self%y, self%at)
            call fade(self, step, i, self%y)
         else if (abs(self%tau(i)) > 0) then
            call self%legs%move(i, step%t + reached*step%h, step%h, self%tau(i)*step%h, self%at, self%y, &
                                status)
         end if
         if (i == size(self%tau)) exit
         reached = self%weights%kicks%c(i)
         self%x(:, :, i) = self%at
         self%q(:, :self%ndof) = self%at
         call self%ham%bare_gradient(self%nlane, time_of(self, step, i), self%weights%w(:, :, i), self%q, self%p, &
                                     hq=self%uq)
         call take_off(self, self%weights%w(:, 0, i), self%uq)
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
      call take_off(self, self%weights%w(:, 0, i), self%uq, along=self%vq)
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
      call take_off(self, self%of_g(:, 0), self%rq)
      self%g = 0
      call add_by_mass(self, t, 1.0_wp, self%rq(:, :n), self%g(:, :n))
      if (along) then
         if (self%bends) then
            call self%ham%bare_third(self%nlane, t, self%of_f, self%q, self%p, self%g, self%still, self%vq, &
                                     self%still, self%rq, self%rp)
            call take_off(self, self%of_f(:, 0), self%rq, along=self%vq, first=self%g)
            self%uq = self%uq + factor*self%rq
         end if
         call self%ham%bare_product(self%nlane, self%nlane, t, self%of_g, self%q, self%p, self%vq, self%still, &
                                    self%rq, self%rp)
         call take_off(self, self%of_g(:, 0), self%rq, along=self%vq)
         self%g = 0
         call add_by_mass(self, t, 1.0_wp, self%rq(:, :n), self%g(:, :n))
      end if
      call self%ham%bare_product(self%nlane, self%nlane, t, self%of_f, self%q, self%p, self%g, self%still, &
                                 self%rq, self%rp)
      call take_off(self, self%of_f(:, 0), self%rq, along=self%g)
      self%uq = self%uq + factor*self%rq
   end subroutine add_product

   !> Take what q.S_qq q/2 with these weights has off the gradient at self%q, off products with the Hessian along v, or
   !> off third derivatives along a and v, in rows of positions and of parameters theta_k:
   !>
   !>    S_qq q      S_qq v + sum_k S_k q v_k,  q.S_k v      sum_k S_k a v_k,  a.S_k v        S_k = dS_qq/dtheta_k
   subroutine take_off(self, weight, r, along, first)
      type(kicks_step), intent(in) :: self
      real(wp), intent(in) :: weight(self%nlane)
      real(wp), intent(inout) :: r(self%nlane, self%nwide)
      real(wp), intent(in), optional :: along(self%nlane, self%nwide)   !! v
      real(wp), intent(in), optional :: first(self%nlane, self%nwide)   !! a, without parameters
      integer :: i, j, k

      if (.not. allocated(self%second)) return
      associate (n => self%ndof, s => self%second)
         do i = 1, n
            do j = 1, n
               if (abs(s(i, j)) > 0 .and. .not. present(along)) &
                  r(:, i) = r(:, i) - weight*s(i, j)*self%q(:, j)
               if (abs(s(i, j)) > 0 .and. present(along) .and. .not. present(first)) &
                  r(:, i) = r(:, i) - weight*s(i, j)*along(:, j)
               do k = 1, merge(size(self%slopes, 3), 0, present(along))
                  if (.not. abs(self%slopes(i, j, k)) > 0) cycle
                  if (present(first)) then
                     call add_slope(weight*self%slopes(i, j, k), first(:, j))
                  else
                     call add_slope(weight*self%slopes(i, j, k), self%q(:, j))
                  end if
               end do
            end do
         end do
      end associate

   contains

      !> An entry (i, j) of S_k beside the first vector.
      subroutine add_slope(entry, of_first)
         real(wp), intent(in) :: entry(self%nlane), of_first(self%nlane)

         r(:, i) = r(:, i) - entry*of_first*along(:, self%ndof + k)
         r(:, self%ndof + k) = r(:, self%ndof + k) - entry*of_first*along(:, i)
      end subroutine add_slope

   end subroutine take_off

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
      integer :: i, j

      if (self%by_h) then
         to = to + factor*v
      else if (allocated(self%second)) then
         associate (n => self%ndof)
            do i = 1, n
               do j = 1, n
                  if (abs(self%second(n + i, n + j)) > 0) to(:, i) = to(:, i) + factor*self%second(n + i, n + j)*v(:, j)
               end do
            end do
         end associate
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
