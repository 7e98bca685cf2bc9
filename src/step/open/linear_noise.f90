! SPDX-License-Identifier: BSD-3-Clause
!> The exact noise of linear damped drifts between kicks, for constant noises in position: with unequal rates, a matrix
!> of friction, or a rotation. Kicks with the weights of the closed system give the state x = (q, p)
!>
!>    P (dW, a, K) = sum_i exp((1 - c_i) h M) (0, -g) w_i,     g_k = H_k,q,  M the matrix of the drift
!>
!> instead of xi = int exp(u M) (0, -g) dW. At the end of the step the state moves by (L - P) (dW, a, K), where L gives
!> xi its law (noise/linear_law). This has mean zero and the size h^(5/2), or h^(7/2) where kicks follow K, so that
!> orders stay; and it does not depend on the state, so that steps shrink volume as the drift does. Verlet with dZ has
!> the kick dW in the middle and the shift (h a, -h Gamma a) of the state, in units of -g.
!>
!> Degrees of freedom that the drift or noises tie to each other are a part with matrices of its own, q/h and p being
!> its components: each is alone where rates, or frequencies, differ and every noise touches one. A part of too many
!> keeps the weights of the closed system, and so does a part whose law has more dimensions than its noises have
!> normals.
module symsde_step_open_linear_noise
   use symsde_base_damping, only: damping_type, noise_law2, noise_law3, noise_path, noise_polynomial
   use symsde_base_functionals, only: path_dz, path_stt_area
   use symsde_base_kinds, only: wp
   use symsde_base_matrices, only: multiply, exponential_less_one
   use symsde_base_record, only: step_record
   use symsde_base_supports, only: noise_colours, sort_noises
   use symsde_base_traits, only: model_traits
   use symsde_base_vectors, only: add_times
   use symsde_model_abstract, only: model_type
   use symsde_model_probe_noise_time, only: noise_changes_in_time
   use symsde_noise_linear_law, only: integrate_noise, give_linear_law
   use symsde_scheme_kicks, only: kicks_type, flow_free, flow_rotation
   use symsde_scheme_scheme, only: scheme_type, correction_none, splitting_form, frame_shift
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian, new_one_step_hamiltonian
   use symsde_step_open_linear_flow, only: damped_field
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: linear_noise, new_linear_noise, has_linear_law, gives_linear_law

   integer, parameter :: largest = 64   !! degrees of freedom, and noises, of a part
   integer, parameter :: most = 4096    !! degrees of freedom with a mass that is not diagonal

   !> Degrees of freedom that are tied to each other.
   type :: tied_part
      integer, allocatable :: dof(:), noise(:)
      real(wp), allocatable :: field(:, :)     !! M, rows of q before those of p (2 ndof, 2 ndof)
      real(wp), allocatable :: push(:, :)      !! -H_k,q (ndof, nnoise)
      real(wp), allocatable :: rest(:, :, :)   !! L - P of q and p, by dW, a and K (2 ndof, nnoise, 3)
   end type tied_part

   type :: linear_noise
      private
      type(damping_type) :: damping
      type(kicks_type) :: kicks
      logical :: shifts = .false.              !! Verlet with dZ
      integer :: known = 2                     !! functionals of the law: dW and a, or K, too
      real(wp), allocatable :: omega(:)        !! frequencies of a rotation (ndof)
      real(wp), allocatable :: field(:, :)     !! M, where drifts are flows of a quadratic part (2 ndof, 2 ndof)
      logical :: looked = .false.              !! whether parts are known
      real(wp) :: h = 0                        !! step for which `rest` is known
      type(tied_part), allocatable :: part(:)
      real(wp), allocatable :: a(:)            !! dZ/h - dW/2 of a noise (nlane)
   contains
      procedure :: add => add_rest
      procedure, private :: look, prepare
   end type linear_noise

contains

   !> Whether steps of a scheme give the noise of a linear drift its law by this module, as far as traits tell.
   pure logical function has_linear_law(scheme, traits, damping, noise)
      type(scheme_type), intent(in) :: scheme
      type(model_traits), intent(in) :: traits
      type(damping_type), intent(in) :: damping
      integer, intent(in) :: noise   !! an enumerator of base/damping
      logical :: kicks, rotates

      kicks = scheme%form == splitting_form .and. .not. scheme%kicks%is_word()
      rotates = kicks .and. scheme%kicks%flow == flow_rotation
      if (kicks .and. scheme%kicks%flow == flow_free) rotates = allocated(traits%quadratic_part)
      has_linear_law = damping%acts() .and. damping%is_constant() .and. traits%noise_is_constant() .and. &
                       .not. traits%by_path .and. &
                       scheme%asks%has(path_dz) .and. noise /= noise_path .and. noise /= noise_polynomial .and. &
                       (rotates .or. .not. damping%is_scalar()) .and. &
                       (scheme%frame == frame_shift .or. rotates .or. (kicks .and. scheme%kicks%flow == flow_free))
   end function has_linear_law

   !> Whether steps of length h from this position give all noise of a model its law.
   logical function gives_linear_law(model, scheme, noise, t, h, nlane, q) result(gives)
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in), target :: scheme
      integer, intent(in) :: noise   !! an enumerator of base/damping
      integer, intent(in) :: nlane
      real(wp), intent(in) :: t, h, q(nlane, model%traits%ndof)
      type(linear_noise), allocatable :: rest
      type(one_step_hamiltonian) :: ham
      type(stepper_task) :: task
      integer :: l

      task%model => model
      task%scheme => scheme
      task%damping = model%damping
      task%damping_noise = noise
      task%nlane = nlane
      call new_linear_noise(rest, task)
      gives = allocated(rest)
      if (.not. gives) return
      call new_one_step_hamiltonian(ham, model, nlane, correction_none, 0.0_wp)
      call rest%look(ham, t, q)
      gives = allocated(rest%part)
      if (.not. gives) return
      call rest%prepare(h)
      do l = 1, size(rest%part)
         gives = gives .and. allocated(rest%part(l)%rest)
      end do
   end function gives_linear_law

   !> The noise for the steps of a task; not allocated where the law is not this module's, or the noise changes in time.
   subroutine new_linear_noise(self, task)
      type(linear_noise), allocatable, intent(out) :: self
      type(stepper_task), intent(in) :: task

      associate (scheme => task%scheme, traits => task%model%traits, noise => task%damping_noise)
         if (.not. has_linear_law(scheme, traits, task%damping, noise)) return
         if (noise_changes_in_time(task%model)) return
         allocate (self)
         self%damping = task%damping
         if (scheme%asks%has(path_stt_area)) self%known = 3
         if (noise == noise_law2) self%known = 2
         if (noise == noise_law3) self%known = 3
         allocate (self%a(task%nlane), source=0.0_wp)
         self%shifts = scheme%frame == frame_shift
         if (.not. self%shifts) then
            self%kicks = scheme%kicks
            if (scheme%kicks%flow == flow_rotation) then
               self%omega = traits%rotation
            else if (allocated(traits%quadratic_part)) then
               self%field = damped_field(traits%quadratic_part, task%damping)
            end if
         else
            self%kicks%c = [0.5_wp]
            self%kicks%beta = [1.0_wp]
            self%kicks%gamma = [0.0_wp]
            self%kicks%eta = [0.0_wp]
         end if
      end associate
   end subroutine new_linear_noise

   !> Add the rest of the noise of a step to its increments.
   subroutine add_rest(self, ham, step, q, dq, dp)
      class(linear_noise), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(ham%nlane, ham%ndof)       !! state at the beginning of the step
      real(wp), intent(inout) :: dq(ham%nlane, ham%ndof), dp(ham%nlane, ham%ndof)
      integer :: i, k, l, n

      if (.not. associated(step%of(path_dz)%x)) return  ! no noise has an effect
      if (.not. self%looked) call self%look(ham, step%t, q)
      if (.not. allocated(self%part)) return
      if (abs(step%h - self%h) > 0) call self%prepare(step%h)
      do l = 1, size(self%part)
         associate (part => self%part(l))
            if (.not. allocated(part%rest)) cycle
            n = size(part%dof)
            do k = 1, size(part%noise)
               associate (w => step%w(:, part%noise(k)), z => step%of(path_dz)%x(:, part%noise(k)))
                  self%a = z/step%h - 0.5_wp*w
                  do i = 1, n
                     call add_times(ham%nlane, part%rest(i, k, 1), w, dq(:, part%dof(i)))
                     call add_times(ham%nlane, part%rest(i, k, 2), self%a, dq(:, part%dof(i)))
                     call add_times(ham%nlane, part%rest(n + i, k, 1), w, dp(:, part%dof(i)))
                     call add_times(ham%nlane, part%rest(n + i, k, 2), self%a, dp(:, part%dof(i)))
                  end do
               end associate
               if (.not. associated(step%of(path_stt_area)%x)) cycle
               associate (kk => step%of(path_stt_area)%x(:, part%noise(k)))
                  do i = 1, n
                     call add_times(ham%nlane, part%rest(i, k, 3), kk, dq(:, part%dof(i)))
                     call add_times(ham%nlane, part%rest(n + i, k, 3), kk, dp(:, part%dof(i)))
                  end do
               end associate
            end do
         end associate
      end do
   end subroutine add_rest

   !> Find the parts at the position of some path; without a finite position the next call tries again. Models of too
   !> many masses that are not diagonal have no parts.
   subroutine look(self, ham, t, q)
      class(linear_noise), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham
      real(wp), intent(in) :: t, q(ham%nlane, ham%ndof)
      real(wp), dimension(1, ham%ndof) :: x, p, v, g
      real(wp), allocatable :: mass(:, :)      !! M^-1, (ndof, ndof), or its diagonal (ndof, 1)
      real(wp), allocatable :: push(:)         !! elements of -H_k,q that are not zero
      integer, allocatable :: of_noise(:), of_dof(:)
      integer, allocatable :: acting(:)        !! noises that are not silent
      integer, allocatable :: touched(:)       !! degrees of freedom that a noise may push
      type(noise_colours) :: colours
      real(wp) :: w(1, 0:ham%nnoise)
      integer :: root(ham%ndof), c, i, j, k, l, lane, count

      do lane = 1, ham%nlane
         if (all(abs(q(lane, :)) <= huge(t))) exit
      end do
      if (lane > ham%nlane) return
      self%looked = .true.
      associate (traits => ham%model%traits, n => ham%ndof)
         if (.not. (allocated(self%field) .or. traits%has_diagonal_mass() .or. n <= most)) return
         x(1, :) = q(lane, :)
         w = 0
         w(1, 0) = 1
         p = 1
         if (traits%identity_mass .or. allocated(self%field)) then
            allocate (mass(n, 1), source=1.0_wp)
         else if (traits%has_diagonal_mass()) then
            allocate (mass(n, 1))
            call ham%bare_gradient(1, t, w, x, p, hp=v)
            mass(:, 1) = v(1, :)
         else
            allocate (mass(n, n))
            do j = 1, n
               p = 0
               p(1, j) = 1
               call ham%bare_gradient(1, t, w, x, p, hp=v)
               mass(:, j) = v(1, :)
            end do
         end if
         ! Noises and what they push: those of one colour touch no degree of freedom together, so that one gradient has
         ! the pushes of all. Each of a part has the first degree of freedom of the part as its root.
         root = [(i, i=1, n)]
         p = 0
         w = 0
         count = 0
         allocate (push(n), of_noise(n), of_dof(n))
         touched = [(i, i=1, n)]
         acting = [(k, k=1, ham%nnoise)]
         if (allocated(traits%silent)) acting = pack(acting, .not. traits%silent)
         call sort_noises(traits%touches, acting, ham%nnoise, n, .false., 0, colours)
         do c = 1, colours%n
            associate (members => colours%noise(colours%from(c) + 1:colours%from(c + 1)))
               w(1, members) = 1
               call ham%bare_gradient(1, t, w, x, p, hq=g)
               w(1, members) = 0
               do k = 1, size(members)
                  if (traits%touches%are_given()) touched = traits%touches%dof(traits%touches%from(members(k)) + 1: &
                                                                               traits%touches%from(members(k) + 1))
                  j = 0
                  do l = 1, size(touched)
                     i = touched(l)
                     if (abs(g(1, i)) <= 0) cycle
                     if (count == size(push)) call lengthen(push, of_noise, of_dof)
                     count = count + 1
                     push(count) = -g(1, i)
                     of_noise(count) = members(k)
                     of_dof(count) = i
                     if (j > 0) call tie(root, i, j)
                     j = i
                  end do
               end do
            end associate
         end do
         if (size(mass, 2) > 1) call tie_all(root, mass)
         if (allocated(self%damping%friction)) call tie_all(root, self%damping%friction)
         if (allocated(self%field)) then
            call tie_all(root, self%field(:n, :n))
            call tie_all(root, self%field(:n, n + 1:))
            call tie_all(root, self%field(n + 1:, :n))
            call tie_all(root, self%field(n + 1:, n + 1:))
         end if
         do i = 1, n
            root(i) = root_of(root, i)
         end do
         call make_parts(self, root, mass, push(:count), of_noise(:count), of_dof(:count))
      end associate
   end subroutine look

   !> The parts that noises push, by the roots of degrees of freedom.
   subroutine make_parts(self, root, mass, push, of_noise, of_dof)
      type(linear_noise), intent(inout) :: self
      integer, intent(in) :: root(:)               !! (ndof)
      real(wp), intent(in) :: mass(:, :), push(:)
      integer, intent(in) :: of_noise(:), of_dof(:)
      integer :: number(size(root)), at(size(root)), ndof(size(root)), nnoise(size(root))
      integer :: i, j, k, l, before

      ! Number the parts by their noises, and count both.
      number = 0
      ndof = 0
      nnoise = 0
      l = 0
      before = 0
      do i = 1, size(push)
         associate (r => root(of_dof(i)))
            if (number(r) == 0) then
               l = l + 1
               number(r) = l
            end if
            if (of_noise(i) /= before) nnoise(number(r)) = nnoise(number(r)) + 1
            before = of_noise(i)
         end associate
      end do
      do i = 1, size(root)
         number(i) = number(root(i))
         if (number(i) > 0) ndof(number(i)) = ndof(number(i)) + 1
         if (number(i) > 0) at(i) = ndof(number(i))
      end do
      allocate (self%part(l))
      do l = 1, size(self%part)
         if (max(ndof(l), nnoise(l)) > largest) cycle
         associate (part => self%part(l), n => ndof(l), m => nnoise(l))
            allocate (part%noise(m))
            allocate (part%push(n, m), source=0.0_wp)
            allocate (part%dof(n))
         end associate
      end do
      do i = 1, size(root)
         l = number(i)
         if (l == 0) cycle
         if (allocated(self%part(l)%dof)) self%part(l)%dof(at(i)) = i
      end do
      do l = 1, size(self%part)
         associate (part => self%part(l))
            if (allocated(part%dof)) call find_field(self, ndof(l), part%dof, mass, part%field)
         end associate
      end do
      nnoise = 0
      before = 0
      do i = 1, size(push)
         l = number(of_dof(i))
         if (of_noise(i) /= before) nnoise(l) = nnoise(l) + 1
         before = of_noise(i)
         j = at(of_dof(i))
         k = nnoise(l)
         if (.not. allocated(self%part(l)%noise)) cycle
         self%part(l)%noise(k) = of_noise(i)
         self%part(l)%push(j, k) = push(i)
      end do
   end subroutine make_parts

   !> M of a part.
   subroutine find_field(self, n, dof, mass, field)
      type(linear_noise), intent(in) :: self
      integer, intent(in) :: n, dof(n)
      real(wp), intent(in) :: mass(:, :)            !! M^-1 of all, or its diagonal
      real(wp), allocatable, intent(out) :: field(:, :)
      real(wp) :: inverse(n, n), friction(n, n), loss(n, n)
      integer :: i, place(2*n)

      if (allocated(self%field)) then
         place(:n) = dof
         place(n + 1:) = dof + size(self%field, 1)/2
         field = self%field(place, place)
         return
      end if
      allocate (field(2*n, 2*n), source=0.0_wp)
      inverse = 0
      loss = 0
      do i = 1, n
         if (size(mass, 2) == 1) inverse(i, i) = mass(dof(i), 1)
         if (size(mass, 2) > 1) inverse(:, i) = mass(dof, dof(i))
         if (allocated(self%omega)) field(n + i, i) = -self%omega(dof(i))**2
         if (allocated(self%damping%rate)) loss(i, i) = self%damping%rate(dof(i))
      end do
      if (allocated(self%damping%friction)) then
         friction = self%damping%friction(dof, dof)
         call multiply(n, n, friction, inverse, loss)
      end if
      field(:n, n + 1:) = inverse
      field(n + 1:, n + 1:) = -loss
   end subroutine find_field

   !> L - P of every part for steps of length h.
   subroutine prepare(self, h)
      class(linear_noise), intent(inout) :: self
      real(wp), intent(in) :: h   !! with its sign [time]
      integer :: l

      self%h = h
      do l = 1, size(self%part)
         if (allocated(self%part(l)%noise)) &
            call find_rest(self, size(self%part(l)%dof), size(self%part(l)%noise), h, self%part(l))
      end do
   end subroutine prepare

   !> L - P of a part.
   subroutine find_rest(self, n, m, h, part)
      type(linear_noise), intent(in) :: self
      integer, intent(in) :: n, m                 !! degrees of freedom and noises of the part
      real(wp), intent(in) :: h
      type(tied_part), intent(inout) :: part
      real(wp), dimension(2*n, 2*n) :: a, flow, c
      real(wp), dimension(2*n, m, 3) :: means, law
      real(wp) :: b(2*n, m), moved(2*n, m), weight
      logical :: exact
      integer :: i, r

      if (allocated(part%rest)) deallocate (part%rest)
      ! M of (q/h, p), for the time h
      a = h*part%field
      a(:n, n + 1:) = part%field(:n, n + 1:)
      a(n + 1:, :n) = h**2*part%field(n + 1:, :n)
      b = 0
      b(n + 1:, :) = part%push
      call integrate_noise(2*n, m, a, b, flow, c, means)
      call give_linear_law(2*n, m, self%known, c, means, law, exact)
      if (.not. exact) return
      do i = 1, size(self%kicks%c)
         call exponential_less_one(2*n, a, 1 - self%kicks%c(i), flow)
         call multiply(2*n, m, flow, b, moved)
         moved = b + moved
         do r = 1, 3
            weight = self%kicks%beta(i)
            if (r == 2) weight = self%kicks%gamma(i)
            if (r == 3) weight = self%kicks%eta(i)
            law(:, :, r) = law(:, :, r) - weight*moved
         end do
      end do
      if (self%shifts) then
         call multiply(2*n, m, a, b, moved)
         law(:n, :, 2) = law(:n, :, 2) - part%push
         law(n + 1:, :, 2) = law(n + 1:, :, 2) - moved(n + 1:, :)
      end if
      law(:n, :, :) = h*law(:n, :, :)
      if (all(abs(law) <= huge(h))) part%rest = law
   end subroutine find_rest

   !> Room for twice as many elements.
   subroutine lengthen(push, of_noise, of_dof)
      real(wp), allocatable, intent(inout) :: push(:)
      integer, allocatable, intent(inout) :: of_noise(:), of_dof(:)

      push = [push, push]
      of_noise = [of_noise, of_noise]
      of_dof = [of_dof, of_dof]
   end subroutine lengthen

   !> Tie what a matrix couples.
   pure subroutine tie_all(root, a)
      integer, intent(inout) :: root(:)
      real(wp), intent(in) :: a(:, :)
      integer :: i, j

      do j = 1, size(a, 2)
         do i = 1, size(a, 1)
            if (i /= j .and. abs(a(i, j)) > 0) call tie(root, i, j)
         end do
      end do
   end subroutine tie_all

   !> Tie i and j to each other: the smaller root becomes that of both.
   pure subroutine tie(root, i, j)
      integer, intent(inout) :: root(:)
      integer, intent(in) :: i, j
      integer :: one, two

      one = root_of(root, i)
      two = root_of(root, j)
      root(max(one, two)) = min(one, two)
      root(i) = min(one, two)
      root(j) = min(one, two)
   end subroutine tie

   !> The root of i.
   pure integer function root_of(root, i)
      integer, intent(in) :: root(:), i

      root_of = i
      do while (root(root_of) /= root_of)
         root_of = root(root_of)
      end do
   end function root_of

end module symsde_step_open_linear_noise
