! SPDX-License-Identifier: BSD-3-Clause
!>    number = 1 + low + 2^31 high,    low <- 48271 low + x,   high <- 69621 high + x   (mod 2^31 - 1)
!>
!> over all numbers x that a probe depends on: it identifies probes that a model has passed, if its functions are
!> derived from formulas by a program and never change.
!>
!> Such a model is probed once for each size of its state and time, not by every run: a probe costs hundreds of
!> gradients, and finds nothing new. Its points are displaced by the size of the state, so that a state of another
!> binary order is another probe; generated code, too, has other branches for large arguments. Functions written by hand
!> are probed by every run, since the data behind `user` may have changed.
!>
!> Several threads may read and enter numbers at once: numbers are read and written whole, and an overwritten number
!> only means that a probe is repeated.
module symsde_base_probe_record
   use symsde_base_kinds, only: wp, i8
   use symsde_base_traits, only: model_traits
   implicit none
   private
   public :: probe_record, probe_number

   integer, parameter :: most = 32              !! number of probes remembered
   integer(i8), parameter :: prime = 2147483647_i8

   !> Probes that a model and its copies have passed; every call of the library works on a copy.
   type :: common_record
      integer(i8) :: passed(most) = 0  !! numbers, 0 = none
      integer(i8) :: entered = 0       !! number of entries so far
      integer :: owners = 1
   end type common_record

   type :: probe_record
      private
      type(common_record), pointer :: common => null()  !! null: no probes are remembered
   contains
      procedure :: keep
      procedure :: is_kept
      procedure :: knows
      procedure :: enter
      procedure :: forget
      procedure :: share
      procedure :: release
   end type probe_record

contains

   !> Begin to remember passed probes; the list is empty.
   subroutine keep(self)
      class(probe_record), intent(inout) :: self

      call self%release()
      ! The record is new, so copies made before do not share it.
      allocate (self%common)
   end subroutine keep

   !> Whether passed probes are remembered: the functions are derived from formulas.
   pure logical function is_kept(self)
      class(probe_record), intent(in) :: self

      is_kept = associated(self%common)
   end function is_kept

   !> Forget all passed probes, since the model has changed; copies keep theirs.
   subroutine forget(self)
      class(probe_record), intent(inout) :: self

      if (associated(self%common)) call self%keep()
   end subroutine forget

   !> Whether this probe was passed.
   logical function knows(self, number)
      class(probe_record), intent(in) :: self
      integer(i8), intent(in) :: number
      integer(i8) :: one
      integer :: i

      ! Without a record no probe counts as passed: every run probes.
      knows = .false.
      if (.not. associated(self%common)) return
      do i = 1, most
         !$omp atomic read
         one = self%common%passed(i)
         knows = knows .or. one == number
      end do
   end function knows

   !> Remember that a probe was passed; in a full record its number replaces the oldest.
   subroutine enter(self, number)
      class(probe_record), intent(in) :: self  ! intent(in), since a run has its model as intent(in)
      integer(i8), intent(in) :: number
      integer(i8) :: before

      if (.not. associated(self%common)) return
      !$omp atomic capture
      before = self%common%entered
      self%common%entered = self%common%entered + 1
      !$omp end atomic
      !$omp atomic write
      self%common%passed(1 + int(modulo(before, int(most, i8)))) = number
   end subroutine enter

   !> Share the record of another model, of which this one becomes a copy: a probe passed by either counts for both.
   subroutine share(self, other)
      class(probe_record), intent(inout) :: self
      type(probe_record), intent(in) :: other

      ! A model that is copied onto itself must keep its record.
      if (associated(self%common, other%common)) return
      call self%release()
      if (.not. associated(other%common)) return
      self%common => other%common
      !$omp atomic update
      self%common%owners = self%common%owners + 1
   end subroutine share

   !> Leave the record. The last owner frees it.
   subroutine release(self)
      class(probe_record), intent(inout) :: self
      integer :: left

      if (.not. associated(self%common)) return
      !$omp atomic capture
      self%common%owners = self%common%owners - 1
      left = self%common%owners
      !$omp end atomic
      ! The count is decreased and read in one operation, so that only one thread sees zero.
      if (left == 0) deallocate (self%common)
      nullify (self%common)
   end subroutine release

   !> The number of a probe, made from all that it depends on: the label of the probe (or of the stepper that takes
   !> whole steps, and the step), the declared traits, and the binary orders of the state and of time. It is never
   !> 0, which stands for no probe.
   integer(i8) function probe_number(what, traits, t, q, p, step) result(number)
      character(*), intent(in) :: what
      type(model_traits), intent(in) :: traits
      real(wp), intent(in) :: t, q(:), p(:), step
      integer(i8) :: low, high
      integer :: i, j

      low = 1
      high = 1
      ! Enter the label by its letters.
      do i = 1, len(what)
         call take(iachar(what(i:i)))
      end do
      ! The state and time enter by their binary orders: points are displaced by as much.
      call take(exponent(max(1.0_wp, maxval(abs(q)), maxval(abs(p)))))
      call take(exponent(max(1.0_wp, abs(t))))
      ! Enter the order of magnitude and the sign of the step, for steppers that take whole steps.
      call take(exponent(step))
      call take(merge(1, 0, step < 0))
      ! All declarations that some probe tests enter, so that another declaration gives another number.
      call take(traits%ndof)
      call take(traits%nnoise)
      call take(traits%bandwidth)
      call take_flag(traits%separable)
      call take_flag(traits%additive)
      call take_flag(traits%position_noise)
      call take_flag(traits%quadratic)
      call take_flag(traits%identity_mass)
      call take_flag(traits%constant_mass)
      call take_flag(traits%diagonal_mass)
      call take_flag(traits%has_value)
      call take_flag(traits%has_hessian)
      call take_flag(traits%has_hessian_vector)
      call take_flag(traits%has_third_derivative)
      call take_flag(traits%forces%drift)
      call take_flag(traits%forces%noise)
      call take_flag(traits%forces%drift_in_position)
      call take_flag(traits%forces%noise_in_position)
      call take_flag(traits%forces%has_derivative)
      if (allocated(traits%silent)) then
         do i = 1, size(traits%silent)
            call take_flag(traits%silent(i))
         end do
      end if
      if (traits%touches%are_given()) then
         do i = 1, size(traits%touches%from)
            call take(traits%touches%from(i))
         end do
         do i = 1, size(traits%touches%dof)
            call take(traits%touches%dof(i))
         end do
      end if
      call take(merge(1, 0, traits%kicks_of_actions) + merge(2, 0, traits%phase_noise))
      if (allocated(traits%quadratic_part)) then
         do i = 1, size(traits%quadratic_part, 2)
            do j = 1, size(traits%quadratic_part, 1)
               call take(exponent(traits%quadratic_part(j, i)))
               call take(int(fraction(traits%quadratic_part(j, i))*2.0_wp**30))
            end do
         end do
      end if
      ! Both halves are below 2^31, so that the sum cannot overflow.
      number = 1 + low + ishft(high, 31)

   contains

      !> Mix one more number into both halves: two multiplicative generators with the same prime modulus.
      subroutine take(x)
         integer, intent(in) :: x

         low = modulo(low*48271_i8 + x, prime)
         high = modulo(high*69621_i8 + x, prime)
      end subroutine take

      !> The same function for a flag instead of a number.
      subroutine take_flag(flag)
         logical, intent(in) :: flag

         call take(merge(1, 0, flag))
      end subroutine take_flag

   end function probe_number

end module symsde_base_probe_record
