! SPDX-License-Identifier: BSD-3-Clause
!> Explicit steps of a single path with one degree of freedom whose model gives terms: tableau.inc with one lane and one
!> number. The model is called for its terms only, once per step, or once per stage if it depends on time:
!>
!>    Hhat_q = a sin q + (b cos q + (c q + d)),   Hhat_p = e p + f
!>
!> with a .. f of the sum h H + sum_k dW_k H_k at the time of the stage (model_type%angle). If the model is quadratic, a
!> = b = 0 and no sine is computed.
!>
!> Earlier code with scalars written out by hand took as long, except for Heun's step of an oscillator: 22 ns instead of
!> 29 ns, since here the slopes of the stages go through memory.
!>
!> The arrays have constant bounds, so that the compiler keeps their numbers in registers: a step takes half the time of
!> one with gradients and allocated arrays. The order of additions is that of the model's own gradients, so that a path
!> has the bits of a lane of a block.
module symsde_step_explicit_angle_steps_single_path
   use symsde_base_sincos, only: sincos_one
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_traits, only: model_traits
   use symsde_model_kernels, only: angle_terms, kernel_offers, offers_of
   use symsde_base_vectors, only: scale
   use symsde_scheme_decays, only: tableau_decays, new_decays
   use symsde_scheme_scheme, only: scheme_type, correction_none, ito_form
   use symsde_step_explicit_evaluation_order, only: evaluation_order, new_explicit_plan, add_slopes, to_q, &
                                                    to_p
   use symsde_step_hamiltonian_one_step, only: new_one_step_hamiltonian
   use symsde_step_stepper, only: stepper_type, stepper_task, few_of
   implicit none
   private
   public :: explicit_stepper, angle_steps_fit

   !> The slopes f and v of a stage, a point (x, y), and the terms of the model, all with constant bounds: (nlane, ndof)
   !> is (1, 1).
   type :: room_type
      real(wp), dimension(1, 1) :: f, v, x, y
      type(angle_terms) :: terms                   !! a .. f of Hhat in the current stage
      type(angle_terms), allocatable :: noises(:)  !! terms of each H_k (nnoise)
      real(wp) :: sine = 0, cosine = 0             !! sine and cosine of q at the last force
   contains
      procedure :: make => make_room
   end type room_type

   include 'tableau.inc'
   include 'tableau_decays.inc'

   !> Whether this stepper executes the task: a single path whose model is completely given by terms.
   logical function angle_steps_fit(task) result(fits)
      type(stepper_task), intent(in) :: task
      type(kernel_offers) :: offers

      offers = offers_of(task%model)
      fits = task%nlane == 1 .and. (offers%angle .or. offers%linear)
   end function angle_steps_fit

   !> One lane: a constant, which the compiler folds into the bounds of loops.
   pure integer function lanes(self)
      type(explicit_stepper), intent(in) :: self

      lanes = 1
   end function lanes

   !> One degree of freedom: a constant, which the compiler folds into the bounds of loops.
   pure integer function degrees(self)
      type(explicit_stepper), intent(in) :: self

      degrees = 1
   end function degrees

   !> Nothing to allocate: the arrays have constant bounds.
   subroutine make_room(self, nlane, ndof)
      class(room_type), intent(inout) :: self
      integer, intent(in) :: nlane, ndof
   end subroutine make_room

   !> Find the terms a .. f of Hhat at the time of stage i. If the model does not depend on time, the terms of the
   !> first stage serve all stages, since w is the same.
   subroutine begin_stage(self, i, t, w)
      type(explicit_stepper), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: t, w(0:self%ham%nnoise)

      ! The first evaluation of a step has i = 1, whichever stage it belongs to.
      if (i > 1 .and. self%ham%model%traits%autonomous) return
      call self%ham%fast%angle(self%ham%nnoise, t, w, self%room%terms)
   end subroutine begin_stage

   !> Hhat_q(q). Sine and cosine are kept: the Ito drift reads them again at the same point.
   subroutine find_force(self, t, w, q, p, hq)
      type(explicit_stepper), intent(inout) :: self
      real(wp), intent(in) :: t, w(0:self%ham%nnoise), q(1, 1), p(1, 1)
      real(wp), intent(out) :: hq(1, 1)

      associate (terms => self%room%terms, sine => self%room%sine, cosine => self%room%cosine)
         ! Add in the order in which the gradient of a model with an angle adds. Without an angle a = b = 0.
         if (self%ham%offers%angle) then
            sine = sincos_one(q(1, 1), cosine)
            hq = terms%a*sine + (terms%b*cosine + (terms%c*q + terms%d))
         else
            hq = terms%c*q + terms%d
         end if
      end associate
      self%ham%counters%gradients = self%ham%counters%gradients + 1
   end subroutine find_force

   !> Hhat_p(p), from the terms of the current stage.
   subroutine find_velocity(self, t, w, q, p, hp)
      type(explicit_stepper), intent(inout) :: self
      real(wp), intent(in) :: t, w(0:self%ham%nnoise), q(1, 1), p(1, 1)
      real(wp), intent(out) :: hp(1, 1)

      hp = self%room%terms%e*p + self%room%terms%f
      self%ham%counters%gradients = self%ham%counters%gradients + 1
   end subroutine find_velocity

   !> Both slopes at (q, p), f = Hhat_q and v = Hhat_p, counted as one gradient like a call of the model.
   subroutine find_both(self, t, w, q, p, hq, hp)
      type(explicit_stepper), intent(inout) :: self
      real(wp), intent(in) :: t, w(0:self%ham%nnoise), q(1, 1), p(1, 1)
      real(wp), intent(out) :: hq(1, 1), hp(1, 1)

      ! find_force counts the gradient.
      call find_force(self, t, w, q, p, hq)
      hp = self%room%terms%e*p + self%room%terms%f
   end subroutine find_both

   !> u = Hess H_k (H_k,p, -H_k,q) = (H_k,qq H_k,p, -H_k,pp H_k,q), from the terms of each H_k. The terms are computed
   !> once: only noises in position may depend on time, and these have no Ito drift. Sine and cosine are taken from the
   !> last force, at the same place.
   subroutine find_noise_product(self, k, t, q, p)
      type(explicit_stepper), intent(inout) :: self
      integer, intent(in) :: k
      real(wp), intent(in) :: t, q(1, 1), p(1, 1)
      integer :: j

      ! Find the terms of each H_k once, with weight one for H_k alone.
      if (.not. allocated(self%room%noises)) then
         allocate (self%room%noises(self%ham%nnoise))
         do j = 1, self%ham%nnoise
            self%e(:, j) = 1
            call self%ham%fast%angle(self%ham%nnoise, t, self%e(1, :), self%room%noises(j))
            self%e(:, j) = 0
         end do
      end if
      associate (of => self%room%noises(k), sine => self%room%sine, cosine => self%room%cosine, c => self%ham%counters)
         ! H_k,qq H_k,p, and -H_k,pp H_k,q with H_k,pp = e.
         self%uq = (of%a*cosine + (of%c - of%b*sine))*(of%e*p + of%f)
         self%up = -of%e*(of%a*sine + (of%b*cosine + (of%c*q + of%d)))
         c%gradients = c%gradients + 1
         c%hessians = c%hessians + 1
      end associate
   end subroutine find_noise_product

end module symsde_step_explicit_angle_steps_single_path
