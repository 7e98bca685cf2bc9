! SPDX-License-Identifier: BSD-3-Clause
!> Forces that are C functions (symsde_force and symsde_force_derivative in symsde.h): one for F, one for the f_k.
!>
!> Each function writes its part of Fhat = h F + sum_k dW_k f_k, with the weights of the lanes. Outputs are set to NaN
!> before every call, so that lanes which a function does not write fail. A nonzero return value ends the run, like that
!> of any function of a model.
module symsde_model_user_callback_force
   use, intrinsic :: iso_c_binding, only: c_associated, c_f_procpointer, c_funptr, c_null_ptr, c_ptr
   use symsde_base_kinds, only: wp
   use symsde_model_forces, only: force_type
   use symsde_model_user_callback_functions, only: force_callback, force_derivative_callback
   use symsde_model_user_outputs, only: spoil
   implicit none
   private
   public :: callback_force

   !> The functions of F, or of the f_k.
   type :: part_type
      procedure(force_callback), pointer, nopass :: on_force => null()
      procedure(force_derivative_callback), pointer, nopass :: on_derivative => null()
      logical :: in_position = .false.
      type(c_ptr) :: user = c_null_ptr   !! passed to both unchanged
   end type part_type

   type, extends(force_type) :: callback_force
      private
      type(part_type) :: part(2)   !! F, and the noises
   contains
      procedure :: set
      procedure :: find
      procedure :: derivative
   end type callback_force

contains

   !> Set the function of F (part 1) or of the f_k (part 2); c_null_funptr removes it.
   subroutine set(self, part, force, derivative, in_position, user)
      class(callback_force), intent(inout) :: self
      integer, intent(in) :: part
      type(c_funptr), intent(in) :: force        !! a force_callback, or c_null_funptr
      type(c_funptr), intent(in) :: derivative   !! a force_derivative_callback, or c_null_funptr
      logical, intent(in) :: in_position         !! whether the force depends on (q, t) alone
      type(c_ptr), intent(in) :: user
      integer :: i

      self%part(part) = part_type(in_position=in_position, user=user)
      if (c_associated(force)) call c_f_procpointer(force, self%part(part)%on_force)
      if (c_associated(force) .and. c_associated(derivative)) &
         call c_f_procpointer(derivative, self%part(part)%on_derivative)
      associate (drift => self%part(1), noise => self%part(2))
         self%traits%drift = associated(drift%on_force)
         self%traits%noise = associated(noise%on_force)
         self%traits%drift_in_position = drift%in_position .or. .not. self%traits%drift
         self%traits%noise_in_position = noise%in_position .or. .not. self%traits%noise
      end associate
      self%traits%has_derivative = self%traits%act()
      do i = 1, 2
         if (associated(self%part(i)%on_force) .and. .not. associated(self%part(i)%on_derivative)) &
            self%traits%has_derivative = .false.
      end do
   end subroutine set

   !> Fhat: the sum of both parts.
   subroutine find(self, nlane, ndof, nnoise, t, w, q, p, f, code)
      class(callback_force), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: f(nlane, ndof)
      integer, intent(out) :: code
      real(wp), allocatable :: more(:, :)

      code = 0
      f = 0
      associate (drift => self%part(1), noise => self%part(2))
         if (associated(drift%on_force)) then
            call spoil(nlane*ndof, f)
            code = drift%on_force(nlane, ndof, nnoise + 1, t, w, q, p, f, drift%user)
         end if
         if (associated(noise%on_force) .and. code == 0) then
            allocate (more(nlane, ndof))
            call spoil(nlane*ndof, more)
            code = noise%on_force(nlane, ndof, nnoise + 1, t, w, q, p, more, noise%user)
            f = f + more
         end if
      end associate
      if (code /= 0) call spoil(nlane*ndof, f)
   end subroutine find

   !> Derivatives of Fhat, the sum of both parts; by differences for a part without a function for derivatives.
   subroutine derivative(self, nlane, ndof, nnoise, t, w, q, p, fq, fp, code)
      class(callback_force), intent(in) :: self
      integer, intent(in) :: nlane, ndof, nnoise
      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)
      real(wp), intent(out) :: fq(nlane, ndof, ndof), fp(nlane, ndof, ndof)
      integer, intent(out) :: code
      real(wp), allocatable :: more_q(:, :, :), more_p(:, :, :)
      integer :: i

      if (.not. self%traits%has_derivative) then
         call self%differences(nlane, ndof, nnoise, t, w, q, p, fq, fp, code)
         return
      end if
      code = 0
      fq = 0
      fp = 0
      allocate (more_q(nlane, ndof, ndof), more_p(nlane, ndof, ndof))
      do i = 1, 2
         if (.not. associated(self%part(i)%on_derivative)) cycle
         call spoil(nlane*ndof**2, more_q, more_p)
         code = self%part(i)%on_derivative(nlane, ndof, nnoise + 1, t, w, q, p, more_q, more_p, self%part(i)%user)
         fq = fq + more_q
         fp = fp + more_p
         if (code /= 0) exit
      end do
      if (code /= 0) call spoil(nlane*ndof**2, fq, fp)
   end subroutine derivative

end module symsde_model_user_callback_force
