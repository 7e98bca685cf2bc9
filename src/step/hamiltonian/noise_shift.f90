! SPDX-License-Identifier: BSD-3-Clause
!> Shifts along the fields of additive noises, for a block of paths or for one:
!>
!>    x + sum_k v_k B_k,   v_k = a dW_k + b dZ_k/h,   B_k = (H_k,p, -H_k,q)
!>
!> Additive noise moves every path by sum_k B_k dW_k, at any position. Schemes that remove the noise from the equation
!> shift by this, by half of it, by its mean over the step, sum_k B_k dZ_k/h, or by a difference of such shifts, and
!> step without noise in between.
!>
!> Two calls make a shift: `weigh` forms the weights v_k, `add` evaluates the gradient of sum_k v_k H_k, which is sum_k
!> v_k (H_k,q, H_k,p), and adds it with q and p exchanged and one sign changed. B may depend on time but not on the
!> point, so any point serves. The coefficients a and b are zero, one or one half, of either sign, which multiply
!> without rounding, so that all implementations have the same bits.
module symsde_step_hamiltonian_noise_shift
   use symsde_base_functionals, only: path_dz
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: step_record
   use symsde_base_vectors, only: add_times, scale
   use symsde_model_abstract, only: model_type
   use symsde_step_hamiltonian_one_step, only: one_step_hamiltonian
   implicit none
   private
   public :: noise_shift, new_noise_shift

   type :: noise_shift
      private
      integer :: nlane = 0, n = 0, m = 0    !! lanes, degrees of freedom, noises
      real(wp), allocatable :: v(:, :)      !! weights, v_0 = 0 (nlane, 0:m)
      real(wp), allocatable, dimension(:, :) :: hq, hp  !! (nlane, n)
   contains
      procedure :: weigh
      procedure :: add
   end type noise_shift

contains

   !> Make shifts for blocks of nlane lanes of a model. The weight of H stays zero, since the drift does not enter a
   !> shift.
   pure subroutine new_noise_shift(self, model, nlane)
      type(noise_shift), intent(out) :: self
      class(model_type), intent(in) :: model
      integer, intent(in) :: nlane

      self%nlane = nlane
      self%n = model%traits%ndof
      self%m = model%traits%nnoise
      ! v_0 = 0 is set once: weigh writes only the columns 1 .. m.
      allocate (self%v(nlane, 0:self%m), source=0.0_wp)
      allocate (self%hq(nlane, self%n), self%hp(nlane, self%n))
   end subroutine new_noise_shift

   !> Compute the weights v_k = a dW_k + b dZ_k/h of the following shifts. If no noise has an effect there is no dZ.
   subroutine weigh(self, a, b, step)
      class(noise_shift), intent(inout) :: self
      real(wp), intent(in) :: a, b
      type(step_record), intent(in) :: step

      real(wp), pointer, contiguous :: w(:, :), dz(:, :)  ! names that gfortran 12 knows to be contiguous

      if (self%m == 0) return
      w => step%w
      if (abs(b) > 0 .and. associated(step%of(path_dz)%x)) then
         dz => step%of(path_dz)%x
         call weigh_both(self%nlane*self%m, a, b, step%h, w(:, 1:), dz, self%v(:, 1:))
      else
         call scale(self%nlane*self%m, a, w(:, 1:), self%v(:, 1:))
      end if
   end subroutine weigh

   !> Add the shift to (q, p), with B at time t, or subtract it if sign = -1: sign sum_k v_k H_k,p is added to q, and
   !> sign sum_k v_k H_k,q is subtracted from p. Noise in position does not move q. One call of the model gives both.
   subroutine add(self, ham, t, sign, q, p)
      class(noise_shift), intent(inout) :: self
      type(one_step_hamiltonian), intent(inout) :: ham   !! model and counters
      real(wp), intent(in) :: t, sign
      real(wp), intent(inout) :: q(self%nlane, self%n), p(self%nlane, self%n)

      if (self%m == 0) return
      if (ham%model%traits%position_noise) then
         call ham%model%gradient(self%nlane, self%n, self%m, t, self%v, q, p, hq=self%hq)
      else
         call ham%model%gradient(self%nlane, self%n, self%m, t, self%v, q, p, self%hq, self%hp)
         call add_times(self%nlane*self%n, sign, self%hp, q)
      end if
      call add_times(self%nlane*self%n, -sign, self%hq, p)
      ham%counters%gradients = ham%counters%gradients + ham%nreal
   end subroutine add

   !> VEC v = a dW + b dZ/h
   pure subroutine weigh_both(n, a, b, h, dw, dz, v)
      integer, intent(in) :: n
      real(wp), intent(in) :: a, b, h, dw(n), dz(n)
      real(wp), intent(out) :: v(n)
      integer :: i

      do i = 1, n
         v(i) = a*dw(i) + b*(dz(i)/h)
      end do
   end subroutine weigh_both

end module symsde_step_hamiltonian_noise_shift
