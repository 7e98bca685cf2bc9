! SPDX-License-Identifier: BSD-3-Clause
!> A model in a heat bath: friction on every momentum, and an additive noise that compensates the friction,
!>
!>    dp_i = .. - gamma_i p_i dt + sigma_i dW_{m+i},     H_{m+i} = -sigma_i q_i,     sigma_i^2 = 2 gamma_i m_i/beta_i
!>
!> after the m noises of the model. For H = p.M^-1 p/2 + U(q) with a diagonal constant mass and one beta the density
!> exp(-beta H) is stationary if the model has no other noise: friction and noise of each momentum preserve its Gaussian
!> law, and H moves along the density. Several beta describe baths of several temperatures, which have no such law.
!>
!> The noises take one multiplication for each degree of freedom, in the gradient with respect to q and in the rows of
!> chains; second derivatives are those of the model. Degrees of freedom without friction have silent noises.
module symsde_model_views_thermostat
   use symsde_base_damping, only: new_damping
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lane_paths, only: lane_paths
   use symsde_base_lanes, only: lane_unit
   use symsde_base_status, only: error_type, raise, incompatible, invalid_argument
   use symsde_base_text, only: to_text
   use symsde_base_traits, only: strip_lanes
   use symsde_model_abstract, only: model_type
   use symsde_model_diagonal_mass, only: find_diagonal_mass
   use symsde_model_kernels, only: kernel_model, kernels_of, offers_of, kernel_offers
   use symsde_model_views_view, only: view_model
   implicit none
   private
   public :: thermostat_model, new_thermostat

   !> A view of the model without the bath.
   type, extends(view_model) :: thermostat_model
      real(wp), allocatable :: sigma(:)                    !! sigma_i (ndof)
   contains
      procedure :: gradient
      procedure :: value => value_in_bath
      procedure :: gradient_hessian
      procedure :: force_stiffness
      procedure :: chain_rows
      procedure :: pair
      procedure :: squares
      procedure :: for_paths
      procedure :: copy_bath
      final :: release
   end type thermostat_model

contains

   !> Put a model into a bath. The model is moved into the bath, and stays unchanged if something is refused: sizes and
   !> numbers, a model that is damped already, or a mass that is not diagonal and constant, for which the noise
   !> strengths are not defined.
   subroutine new_thermostat(self, inner, gamma, beta, error)
      type(thermostat_model), intent(out) :: self
      class(model_type), allocatable, intent(inout) :: inner
      real(wp), intent(in) :: gamma(:)   !! rates of the momenta [1/time] (1 or ndof)
      real(wp), intent(in) :: beta(:)    !! inverse temperatures [1/energy] (1 or ndof)
      type(error_type), allocatable, intent(inout) :: error
      real(wp) :: mass(inner%traits%ndof)
      integer :: i

      if (allocated(error)) return
      if (size(beta) /= 1 .and. size(beta) /= inner%traits%ndof) then
         call refuse(invalid_argument, 'there are '//to_text(size(beta))//' values of beta for '// &
                     to_text(inner%traits%ndof)//' degrees of freedom: give one, or one for each')
      else if (.not. all(beta > 0 .and. beta <= huge(beta))) then
         call refuse(invalid_argument, 'a value of beta is not a finite number above zero: give 1/kT, in units of '// &
                     '1/energy')
      else if (inner%damping%acts()) then
         call refuse(incompatible, 'model '//inner%name//' is damped already: give the model without damping, the '// &
                     'bath brings its own')
      end if
      call new_damping(self%damping, gamma, inner%traits%ndof, error)
      if (.not. (allocated(error) .or. self%damping%acts())) &
         call refuse(invalid_argument, 'no rate gamma is above zero: a bath without friction exchanges no energy')
      call find_mass(inner, mass, error)
      if (allocated(error)) return
      self%sigma = mass
      do i = 1, size(mass)
         self%sigma(i) = sqrt(2*self%damping%rate(i)*mass(i)/beta(min(i, size(beta))))
      end do
      call dress(self, inner)
      call move_alloc(inner, self%inner)

   contains

      subroutine refuse(code, why)
         integer, intent(in) :: code
         character(*), intent(in) :: why

         call raise(error, code, 'new_thermostat', why)
      end subroutine refuse

   end subroutine new_thermostat

   !> Find the masses of a model, at a place where few functions are singular.
   subroutine find_mass(model, mass, error)
      class(model_type), intent(in) :: model
      real(wp), intent(out) :: mass(model%traits%ndof)
      type(error_type), allocatable, intent(inout) :: error
      real(wp) :: x(1, model%traits%ndof), inverse(model%traits%ndof)
      logical :: diagonal
      integer :: i

      mass = 1
      if (allocated(error) .or. model%traits%identity_mass) return
      diagonal = .false.
      ! A quadratic T(p) that does not change in time has a constant mass, too; linear terms are found below.
      if (model%traits%constant_mass .or. (model%traits%separable .and. model%traits%quadratic .and. &
                                           model%traits%autonomous)) then
         do i = 1, size(mass)
            x(1, i) = 0.31_wp + mod(0.618_wp*i, 1.0_wp)
         end do
         call find_diagonal_mass(model, 0.0_wp, x, inverse, diagonal)
      end if
      if (diagonal) diagonal = all(inverse > 0)
      if (.not. diagonal) then
         call raise(error, incompatible, 'new_thermostat', 'model '//model%name//' does not declare a kinetic '// &
                    'energy sum_i p_i^2/(2 m_i) with constants m_i above zero, which a bath of friction on p and '// &
                    'noise -sigma q needs: choose coordinates in which it has one, and declare identity_mass or '// &
                    'constant_mass')
         return
      end if
      mass = 1/inverse
      if (model%traits%npath == 0) return
      if (.not. has_one_mass(model, x)) &
         call raise(error, incompatible, 'new_thermostat', 'masses of model '//model%name//' differ from path to '// &
                    'path, and the noise of a bath belongs to one mass for all paths: make a bath for each mass')
   end subroutine find_mass

   !> Whether a model whose parameters go by path has the same velocities H_p on all paths, at a momentum whose
   !> components all differ.
   logical function has_one_mass(model, x) result(same)
      class(model_type), intent(in) :: model
      real(wp), intent(in) :: x(1, model%traits%ndof)
      real(wp) :: w(lane_unit, 0:model%traits%nnoise)
      real(wp), dimension(lane_unit, model%traits%ndof) :: q, p, v, first
      type(lane_paths), pointer :: paths
      class(model_type), pointer :: view
      integer(i8) :: row
      integer :: i

      same = .true.
      allocate (paths)
      call model%for_paths(paths, view)
      if (associated(view)) then
         w = 0
         w(:, 0) = 1
         do i = 1, size(p, 2)
            q(:, i) = x(1, i)
            p(:, i) = 1.5_wp + sin(1.7_wp*i)
         end do
         do row = 0, model%traits%npath - 1, lane_unit
            call paths%begin([(min(row + i, model%traits%npath - 1), i=0, lane_unit - 1)], 0_i8, 1_i8)
            call view%gradient(lane_unit, size(p, 2), model%traits%nnoise, 0.0_wp, w, q, p, hp=v)
            if (row == 0) first = spread(v(1, :), 1, lane_unit)
            same = same .and. all(abs(v - first) <= 0)
         end do
         deallocate (view)
      end if
      deallocate (paths)
   end function has_one_mass

   !> Set traits and kernels of a model with its bath.
   subroutine dress(self, inner)
      class(thermostat_model), intent(inout) :: self
      class(model_type), intent(in) :: inner
      type(kernel_offers) :: offers
      logical, allocatable :: silent(:)
      logical :: quiet
      integer :: i

      self%name = inner%name
      self%traits = inner%traits
      self%traits%has_parts = .false.
      if (inner%traits%kicks_of_actions) then  ! as the noises of the bath are none
         self%traits%kicks_of_actions = .false.
         self%traits%phase_noise = .false.
         deallocate (self%traits%quadratic_part)
      end if
      self%forces => inner%forces
      associate (n => inner%traits%ndof, m => inner%traits%nnoise)
         ! H_k = 0 is linear too, and depends on q alone.
         quiet = m == 0
         if (allocated(inner%traits%silent)) quiet = all(inner%traits%silent)
         self%traits%nnoise = m + n
         self%traits%additive = inner%traits%additive .or. quiet
         self%traits%position_noise = inner%traits%position_noise .or. quiet
         allocate (silent(m + n), source=.false.)
         if (allocated(inner%traits%silent)) silent(:m) = inner%traits%silent
         silent(m + 1:) = self%sigma <= 0
         call move_alloc(silent, self%traits%silent)
         ! Noise m + i touches degree of freedom i alone, and silent noises touch none.
         associate (touches => self%traits%touches)
            if (quiet) then
               touches%from = [(0, i=1, m), (i, i=0, n)]
               touches%dof = [(i, i=1, n)]
            else if (touches%are_given()) then
               touches%from = [inner%traits%touches%from, (inner%traits%touches%from(m + 1) + i, i=1, n)]
               touches%dof = [inner%traits%touches%dof, (i, i=1, n)]
            end if
         end associate
      end associate
      offers = offers_of(inner)
      self%offers%rows = offers%rows
      self%offers%rows_of_one = offers%rows_of_one
      self%offers%pair = offers%pair
      self%offers%squares = offers%squares
   end subroutine dress

   !> Copy everything but the inner model, for callers that copy the model themselves: it may own records that copies
   !> must not share.
   subroutine copy_bath(self, from)
      class(thermostat_model), intent(inout) :: self
      type(thermostat_model), intent(in) :: from

      self%name = from%name
      self%traits = from%traits
      self%forces => from%forces
      self%offers = from%offers
      self%damping = from%damping
      self%sigma = from%sigma
   end subroutine copy_bath

   !> A view with a view of the inner model that depends on the paths of its lanes, if the inner model does.
   subroutine for_paths(self, paths, view)
      class(thermostat_model), intent(in), target :: self
      type(lane_paths), pointer, intent(in) :: paths
      class(model_type), pointer, intent(out) :: view
      type(thermostat_model), pointer :: around
      class(model_type), pointer :: inner

      nullify (view)
      call self%inner%for_paths(paths, inner)
      if (.not. associated(inner)) return
      allocate (around)
      allocate (around%sigma, source=self%sigma)
      around%damping = self%damping
      call dress(around, inner)
      around%traits = self%traits
      around%forces => self%forces
      around%view => inner
      around%paths => paths
      view => around
   end subroutine for_paths

   !> Deallocate the view of the inner model, which `for_paths` made.
   subroutine release(self)
      type(thermostat_model), intent(inout) :: self

      if (associated(self%view)) deallocate (self%view)
   end subroutine release

   !> Gradient of sum_j w_j H_j: with respect to q that of the model minus sigma_i w_{m+i}.
   subroutine gradient(self, nlane, ndof, nnoise, t, w, q, p, hq, hp)
      class(thermostat_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      class(model_type), pointer :: model

      model => self%inside()
      call model%gradient(nlane, ndof, nnoise - ndof, t, w, q, p, hq, hp)
      if (present(hq)) call subtract_noise(nlane, ndof, self%sigma, w(1, nnoise - ndof + 1), hq)
   end subroutine gradient

   subroutine value_in_bath(self, nlane, ndof, nnoise, t, w, q, p, value)
      class(thermostat_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: value(nlane)
      class(model_type), pointer :: model
      integer :: i

      model => self%inside()
      call model%value(nlane, ndof, nnoise - ndof, t, w, q, p, value)
      do i = 1, ndof
         value = value - (self%sigma(i)*w(:, nnoise - ndof + i))*q(:, i)
      end do
   end subroutine value_in_bath

   subroutine gradient_hessian(self, nlane, ndof, nnoise, t, w, q, p, hq, hp, hqq, hqp, hpp)
      class(thermostat_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out), optional :: hq(nlane, ndof), hp(nlane, ndof)
      real(wp), intent(out), optional :: hqq(nlane, ndof, ndof), hqp(nlane, ndof, ndof)
      real(wp), intent(out), optional :: hpp(nlane, ndof, ndof)
      class(model_type), pointer :: model

      model => self%inside()
      call model%gradient_hessian(nlane, ndof, nnoise - ndof, t, w, q, p, hq, hp, hqq, hqp, hpp)
      if (present(hq)) call subtract_noise(nlane, ndof, self%sigma, w(1, nnoise - ndof + 1), hq)
   end subroutine gradient_hessian

   subroutine force_stiffness(self, nlane, ndof, nnoise, b, t, w, q, p, hq, hqq)
      class(thermostat_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      integer, intent(in) :: b
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: hq(nlane, ndof), hqq(nlane, 0:b, ndof)
      class(model_type), pointer :: model

      model => self%inside()
      call model%force_stiffness(nlane, ndof, nnoise - ndof, b, t, w, q, p, hq, hqq)
      call subtract_noise(nlane, ndof, self%sigma, w(1, nnoise - ndof + 1), hq)
   end subroutine force_stiffness

   subroutine chain_rows(self, ndof, nnoise, first, last, t, w, q, hq, hqq)
      class(thermostat_model), intent(in) :: self
      integer, intent(in) :: ndof, nnoise, first, last
      real(wp), intent(in) :: t, w(strip_lanes, 0:nnoise)
      real(wp), intent(in) :: q(strip_lanes, first - 1:last + 1)
      real(wp), intent(out) :: hq(strip_lanes, first:last), hqq(strip_lanes, 0:1, first:last)
      class(kernel_model), pointer :: kernels

      kernels => kernels_of(self%inside())
      call kernels%chain_rows(ndof, nnoise - ndof, first, last, t, w, q, hq, hqq)
      call subtract_noise(strip_lanes, last - first + 1, self%sigma(first:last), w(1, nnoise - ndof + first), hq)
   end subroutine chain_rows

   subroutine pair(self, nnoise, t, w, q1, q2, f1, f2, k11, k21, k12, k22)
      class(thermostat_model), intent(in) :: self
      integer, intent(in) :: nnoise
      real(wp), intent(in) :: t, w(0:nnoise)
      real(wp), value :: q1, q2
      real(wp), intent(out) :: f1, f2, k11, k21, k12, k22
      class(kernel_model), pointer :: kernels

      kernels => kernels_of(self%inside())
      call kernels%pair(nnoise - 2, t, w, q1, q2, f1, f2, k11, k21, k12, k22)
      f1 = f1 - self%sigma(1)*w(nnoise - 1)
      f2 = f2 - self%sigma(2)*w(nnoise)
   end subroutine pair

   !> Noises of the bath are linear: they add no products, and their forces to the sums.
   subroutine squares(self, nlane, ndof, nnoise, t, q, g, w, c, s)
      class(thermostat_model), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, q(nlane, ndof)
      real(wp), intent(out) :: g(nlane, ndof)
      real(wp), intent(in), dimension(nlane, 0:nnoise), optional :: w, c
      real(wp), intent(out), optional :: s(nlane, 6)
      class(kernel_model), pointer :: kernels

      kernels => kernels_of(self%inside())
      call kernels%squares(nlane, ndof, nnoise - ndof, t, q, g, w, c, s)
      if (.not. present(s)) return
      s(:, 1) = s(:, 1) - self%sigma(1)*w(:, nnoise)
      s(:, 3) = s(:, 3) - self%sigma(1)*c(:, nnoise)
   end subroutine squares

   !> VEC f_i <- f_i - sigma_i w_i, the gradient of the noises, for n degrees of freedom. The caller passes w from the
   !> column of the first noise on.
   pure subroutine subtract_noise(nlane, n, sigma, w, f)
      integer, intent(in) :: nlane, n
      real(wp), intent(in) :: sigma(n), w(nlane, n)
      real(wp), intent(inout) :: f(nlane, n)
      integer :: i, lane

      do i = 1, n
         do lane = 1, nlane
            f(lane, i) = f(lane, i) - sigma(i)*w(lane, i)
         end do
      end do
   end subroutine subtract_noise

end module symsde_model_views_thermostat
