! SPDX-License-Identifier: BSD-3-Clause
!> Linear damping of momenta, a part of an open system:
!>
!>    dp_i = -H_{q_i} dt - gamma_i p_i dt - sum_k H_{k,q_i} o dW_k,   dq = H_p dt + sum_k H_{k,p} o dW_k
!>
!> It is the force F = -gamma p in [WHSB] (9)-(17). With one rate for all degrees of freedom (scalar damping) the flow
!> over a time h multiplies dp ^ dq by exp(-gamma h): it is conformally symplectic. Friction on velocities,
!>
!>    dp = -H_q dt - Gamma M^-1 p dt - ..,                Gamma = Gamma^T
!>
!> with a matrix Gamma and H = p.M^-1 p/2 + U(q), shrinks volume alone, by exp(-h tr Gamma M^-1). Rates may be functions
!> gamma_i(q, t), too (base/rates): then the factor depends on the path, and on time alone where gamma(t) does.
module symsde_base_damping
   use symsde_base_kinds, only: wp
   use symsde_base_rates, only: rate_type
   use symsde_base_status, only: error_type, raise, incompatible, invalid_argument
   use symsde_base_text, only: to_text
   use symsde_base_traits, only: model_traits
   implicit none
   private
   public :: damping_type, new_damping, decay_less_one
   public :: door_of_gain
   public :: noise_of_scheme, noise_law2, noise_law3, noise_path, noise_polynomial

   interface new_damping
      module procedure new_rates, new_friction, new_varying
   end interface new_damping

   character(*), parameter :: door_of_gain = &
                              'allow gain where damping is set (allow_gain=True in Python, allow_gain = true in TOML)'
   integer, parameter :: largest_friction = 512   !! degrees of freedom up to which a matrix is taken

   !> How kicks between decaying drifts get the noise of free motion (noise/decay_law).
   enum, bind(c)
      enumerator :: noise_of_scheme = 0    !! law2, or law3 where kicks follow K
      enumerator :: noise_law2 = 1         !! noise with the law of free motion, from dW and dZ
      enumerator :: noise_law3 = 2         !! noise with this law, from dW, dZ and K
      enumerator :: noise_path = 3         !! noise of free motion along the path, merged as dZ is
      enumerator :: noise_polynomial = 4   !! weights without damping: moments hold to the order of the scheme
   end enum

   !> The damping of a model: rates, as numbers or functions, or friction; a closed system has none of these.
   type :: damping_type
      real(wp), allocatable :: rate(:)         !! gamma_i [1/time] (ndof)
      real(wp), allocatable :: friction(:, :)  !! Gamma [mass/time] (ndof, ndof)
      class(rate_type), pointer :: varying => null()  !! gamma_i(q, t); this object outlives the model
      logical :: gain = .false.                !! whether gamma_i(q, t) may be negative
   contains
      procedure :: acts
      procedure :: is_constant
      procedure :: shrinks_alike
      procedure :: is_scalar
      procedure :: describe
      procedure :: refuse
   end type damping_type

contains

   !> The damping of these rates: one for all degrees of freedom, or one for each. With all rates zero the system is
   !> closed. A negative rate adds energy, and is refused unless allowed. Refused rates leave the damping unchanged.
   subroutine new_rates(self, rate, ndof, error, allow_gain)
      type(damping_type), intent(inout) :: self
      real(wp), intent(in) :: rate(:)   !! [1/time] (1 or ndof)
      integer, intent(in) :: ndof
      type(error_type), allocatable, intent(inout) :: error
      logical, intent(in), optional :: allow_gain
      logical :: gain
      integer :: i

      if (allocated(error)) return
      gain = .false.
      if (present(allow_gain)) gain = allow_gain
      if (size(rate) /= 1 .and. size(rate) /= ndof) then
         call raise(error, invalid_argument, 'new_damping', 'there are '//to_text(size(rate))// &
                    ' rates of damping for '//to_text(ndof)//' degrees of freedom: give one rate, or one for each')
      else if (.not. all(abs(rate) <= huge(rate))) then
         call raise(error, invalid_argument, 'new_damping', 'a rate of damping is not finite: give numbers [1/time]')
      else if (any(rate < 0) .and. .not. gain) then
         call raise(error, invalid_argument, 'new_damping', 'a rate of damping is negative, which would make '// &
                    'momenta grow: give rates of zero or more, or '//door_of_gain)
      else
         call take_back(self)
         if (all(abs(rate) <= 0)) return
         allocate (self%rate(ndof))
         do i = 1, ndof
            self%rate(i) = rate(min(i, size(rate)))
         end do
      end if
   end subroutine new_rates

   !> The friction of a symmetric matrix on velocities. It must not feed energy in, x.Gamma x >= 0, unless gain is
   !> allowed. A matrix of zeros is no friction. A refused matrix leaves the damping unchanged.
   subroutine new_friction(self, friction, ndof, error, allow_gain)
      type(damping_type), intent(inout) :: self
      real(wp), intent(in) :: friction(:, :)   !! Gamma [mass/time] (ndof, ndof)
      integer, intent(in) :: ndof
      type(error_type), allocatable, intent(inout) :: error
      logical, intent(in), optional :: allow_gain
      logical :: gain
      real(wp) :: largest
      integer :: i, j

      if (allocated(error)) return
      gain = .false.
      if (present(allow_gain)) gain = allow_gain
      if (any(shape(friction) /= ndof)) then
         call raise(error, invalid_argument, 'new_damping', 'a matrix of friction is ('//to_text(size(friction, 1))// &
                    ','//to_text(size(friction, 2))//'): give a row and a column for each of '//to_text(ndof)// &
                    ' degrees of freedom')
      else if (ndof > largest_friction) then
         call raise(error, invalid_argument, 'new_damping', 'a matrix of friction for '//to_text(ndof)// &
                    ' degrees of freedom is too large, it may have '//to_text(largest_friction)//' rows: give rates')
      end if
      if (allocated(error)) return
      largest = 0
      do j = 1, ndof
         do i = 1, ndof
            if (.not. abs(friction(i, j)) <= huge(largest)) then
               call raise(error, invalid_argument, 'new_damping', 'a matrix of friction is not finite: give '// &
                          'numbers [mass/time]')
               return
            end if
            largest = max(largest, abs(friction(i, j)))
         end do
      end do
      do j = 1, ndof
         do i = 1, j - 1
            if (abs(friction(i, j) - friction(j, i)) <= 8*epsilon(largest)*largest) cycle
            call raise(error, invalid_argument, 'new_damping', 'a matrix of friction is not symmetric, rows '// &
                       to_text(i)//' and '//to_text(j)//' have '//to_text(friction(i, j))//' and '// &
                       to_text(friction(j, i))//' for each other: give a symmetric one')
            return
         end do
      end do
      if (.not. gain .and. .not. loses(friction, largest)) then
         call raise(error, invalid_argument, 'new_damping', 'a matrix of friction has a negative eigenvalue, which '// &
                    'would make momenta grow: give one without, or '//door_of_gain)
         return
      end if
      call take_back(self)
      if (.not. largest > 0) return
      allocate (self%friction(ndof, ndof))
      do j = 1, ndof
         do i = 1, ndof
            self%friction(i, j) = 0.5_wp*(friction(i, j) + friction(j, i))
         end do
      end do
   end subroutine new_friction

   !> Damping by rates that are functions of position and time. A negative rate at a state fails the path there, unless
   !> gain is allowed. A null pointer makes the system closed.
   subroutine new_varying(self, varying, allow_gain)
      type(damping_type), intent(inout) :: self
      class(rate_type), intent(in), pointer :: varying
      logical, intent(in), optional :: allow_gain

      call take_back(self)
      self%varying => varying
      if (present(allow_gain)) self%gain = allow_gain
   end subroutine new_varying

   !> Make the system closed.
   subroutine take_back(self)
      type(damping_type), intent(inout) :: self

      nullify (self%varying)
      self%gain = .false.
      if (allocated(self%rate)) deallocate (self%rate)
      if (allocated(self%friction)) deallocate (self%friction)
   end subroutine take_back

   !> Whether x.Gamma x >= 0 for all x, to rounding: elimination with the largest diagonal element as pivot meets no
   !> negative one, and when no positive pivot is left, the remaining matrix is zero.
   logical function loses(friction, largest)
      real(wp), intent(in) :: friction(:, :)
      real(wp), intent(in) :: largest             !! largest of the elements
      real(wp), dimension(size(friction, 1), size(friction, 1)) :: a
      logical :: done(size(friction, 1))
      real(wp) :: rounding, pivot
      integer :: i, j, k, n, at

      n = size(friction, 1)
      a = friction
      done = .false.
      rounding = 16*n*epsilon(largest)*largest
      do k = 1, n
         at = 0
         do i = 1, n
            if (done(i)) cycle
            if (at == 0) at = i
            if (a(i, i) > a(at, at)) at = i
         end do
         pivot = a(at, at)
         if (.not. pivot > rounding) exit
         done(at) = .true.
         do j = 1, n
            if (done(j)) cycle
            do i = 1, n
               if (.not. done(i)) a(i, j) = a(i, j) - a(i, at)*(a(at, j)/pivot)
            end do
         end do
      end do
      loses = .true.
      do j = 1, n
         do i = 1, n
            if (.not. (done(i) .or. done(j))) loses = loses .and. abs(a(i, j)) <= rounding
         end do
      end do
   end function loses

   !> Describe the damping, what steps keep, and what it means for velocities. Without damping the text is empty.
   subroutine describe(self, traits, symplectic, text)
      class(damping_type), intent(in) :: self
      type(model_traits), intent(in) :: traits
      logical, intent(in) :: symplectic   !! whether the scheme is symplectic for closed systems
      character(:), allocatable, intent(out) :: text
      logical :: keeps

      text = ''
      if (.not. self%acts()) return
      keeps = symplectic .and. .not. traits%forces%act()
      if (allocated(self%friction)) then
         text = 'dp = .. - Gamma M^-1 p dt, friction on velocities by a matrix'
         if (keeps) text = text//', which '//change_of_volume(self)//' volume alone by one factor'
         return
      else if (associated(self%varying)) then
         call describe_varying(self%varying, traits%ndof, keeps, change_of_volume(self), text)
      else if (self%is_scalar()) then
         text = 'dp = .. '//merge('+', '-', self%rate(1) < 0)//' '//to_text(abs(self%rate(1)))//' p dt'
         if (keeps) text = text//', so that dp^dq '//trim(merge('grows  ', 'shrinks', self%rate(1) < 0))// &
                           ' by one factor'
      else
         text = 'dp_i = .. - gamma_i p_i dt, gamma_i = '//to_text(minval(self%rate))//' to '//to_text(maxval(self%rate))
         if (keeps) text = text//', which '//change_of_volume(self)//' volume alone by one factor'
      end if
      if (.not. (symplectic .or. traits%forces%act())) text = text//', of which the scheme keeps no factor'
      if (traits%identity_mass) return
      if (traits%constant_mass) then
         text = text//'; on velocities the friction is rate times mass'
      else
         text = text//'; of momenta, which is not friction on velocities'
      end if
   end subroutine describe

   !> The word for what damping does to volume: it shrinks, or, where energy may be fed in, it changes.
   character(7) function change_of_volume(damping) result(verb)
      type(damping_type), intent(in) :: damping
      logical :: gains

      gains = damping%gain
      if (allocated(damping%rate)) gains = any(damping%rate < 0)
      if (allocated(damping%friction)) gains = .not. loses(damping%friction, maxval(abs(damping%friction)))
      verb = merge('changes', 'shrinks', gains)
   end function change_of_volume

   !> Describe rates that are functions, and the factor by which a step shrinks.
   subroutine describe_varying(varying, ndof, keeps, verb, text)
      class(rate_type), intent(in) :: varying
      integer, intent(in) :: ndof
      logical, intent(in) :: keeps        !! whether steps keep a factor
      character(*), intent(in) :: verb    !! shrinks or changes
      character(:), allocatable, intent(out) :: text
      character(:), allocatable :: of

      of = 'gamma'
      if (.not. varying%one) of = 'gamma_i'
      if (varying%of_position .and. varying%of_time) then
         of = of//'(q, t)'
      else if (varying%of_position) then
         of = of//'(q)'
      else
         of = of//'(t)'
      end if
      text = 'dp = .. - '//of//' p dt'
      if (.not. varying%one) text = 'dp_i = .. - '//of//' p_i dt'
      if (.not. keeps) return
      if (.not. varying%of_position .and. varying%one) then
         text = text//', so that dp^dq '//verb//' by one factor of each step'
      else if (ndof == 1) then
         text = text//', so that dp^dq '//verb//' by a factor that depends on the path'
      else if (varying%of_position) then
         text = text//', which '//verb//' volume alone, by a factor that depends on the path'
      else
         text = text//', which '//verb//' volume alone by one factor of each step'
      end if
   end subroutine describe_varying

   !> Refuse a damped model for a result that only closed systems have.
   subroutine refuse(self, model, place, what, error)
      class(damping_type), intent(in) :: self
      character(*), intent(in) :: model   !! name of the model
      character(*), intent(in) :: place   !! the procedure
      character(*), intent(in) :: what    !! the result that only closed systems have
      type(error_type), allocatable, intent(inout) :: error

      if (self%acts() .and. .not. allocated(error)) &
         call raise(error, incompatible, place, 'model '//model//' is damped, and '//what//' is that of a closed '// &
                    'system: use the model without damping')
   end subroutine refuse

   !> Whether any momentum is damped.
   pure logical function acts(self)
      class(damping_type), intent(in) :: self

      acts = allocated(self%rate) .or. .not. self%is_constant() .or. allocated(self%friction)
   end function acts

   !> Whether the rates or the matrix, if there are any, are numbers and not functions.
   pure logical function is_constant(self)
      class(damping_type), intent(in) :: self

      is_constant = .not. associated(self%varying)
   end function is_constant

   !> Whether a step of any state shrinks dp ^ dq by one factor: the same rate for all momenta, anywhere.
   pure logical function shrinks_alike(self)
      class(damping_type), intent(in) :: self

      shrinks_alike = self%is_scalar()
      if (associated(self%varying)) shrinks_alike = self%varying%one .and. .not. self%varying%of_position
   end function shrinks_alike

   !> Whether all degrees of freedom have the same constant rate. A matrix does not count as a rate.
   pure logical function is_scalar(self)
      class(damping_type), intent(in) :: self

      is_scalar = self%is_constant() .and. .not. allocated(self%friction)
      if (allocated(self%rate)) is_scalar = all(abs(self%rate - self%rate(1)) <= 0)
   end function is_scalar

   !> exp(-z) - 1, for small z without cancellation as -2 exp(-z/2) sinh(z/2), for large z without overflow.
   elemental real(wp) function decay_less_one(z)
      real(wp), intent(in) :: z

      if (abs(z) < 1) then
         decay_less_one = -2*exp(-0.5_wp*z)*sinh(0.5_wp*z)
      else
         decay_less_one = exp(-z) - 1
      end if
   end function decay_less_one

end module symsde_base_damping
