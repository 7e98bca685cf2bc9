! SPDX-License-Identifier: BSD-3-Clause
!> Linear damping of momenta, a part of an open system:
!>
!>    dp_i = -H_{q_i} dt - gamma_i p_i dt - sum_k H_{k,q_i} o dW_k,   dq = H_p dt + sum_k H_{k,p} o dW_k
!>
!> It is the force F = -gamma p in [WHSB] (9)-(17). With one rate for all degrees of freedom (scalar damping) the flow
!> over a time h multiplies dp ^ dq by exp(-gamma h): it is conformally symplectic.
module symsde_base_damping
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, incompatible, invalid_argument
   use symsde_base_text, only: to_text
   use symsde_base_traits, only: model_traits
   implicit none
   private
   public :: damping_type, new_damping, decay_less_one

   !> The damping rates of a model; not allocated for a closed system.
   type :: damping_type
      real(wp), allocatable :: rate(:)   !! gamma_i [1/time] (ndof)
   contains
      procedure :: acts
      procedure :: is_scalar
      procedure :: describe
      procedure :: refuse
   end type damping_type

contains

   !> The damping of these rates: one for all degrees of freedom, or one for each. With all rates zero the system is
   !> closed. A negative rate adds energy, and is refused unless allowed. Refused rates leave the damping unchanged.
   subroutine new_damping(self, rate, ndof, error, allow_gain)
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
                    'momenta grow: give rates of zero or more, or allow gain')
      else
         if (allocated(self%rate)) deallocate (self%rate)
         if (all(abs(rate) <= 0)) return
         allocate (self%rate(ndof))
         do i = 1, ndof
            self%rate(i) = rate(min(i, size(rate)))
         end do
      end if
   end subroutine new_damping

   !> Describe the damping, and what it means for velocities. Without damping the text is empty.
   subroutine describe(self, traits, text)
      class(damping_type), intent(in) :: self
      type(model_traits), intent(in) :: traits
      character(:), allocatable, intent(out) :: text

      text = ''
      if (.not. self%acts()) return
      if (self%is_scalar()) then
         text = 'dp = .. - '//to_text(self%rate(1))//' p dt, so that dp^dq shrinks by one factor'
      else
         text = 'dp_i = .. - gamma_i p_i dt, gamma_i = '//to_text(minval(self%rate))//' to '//to_text(maxval(self%rate))
      end if
      if (traits%identity_mass) return
      if (traits%constant_mass) then
         text = text//'; on velocities the friction is rate times mass'
      else
         text = text//'; of momenta, which is not friction on velocities'
      end if
   end subroutine describe

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

      acts = allocated(self%rate)
   end function acts

   !> Whether all degrees of freedom have the same rate.
   pure logical function is_scalar(self)
      class(damping_type), intent(in) :: self

      is_scalar = .true.
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
