! SPDX-License-Identifier: BSD-3-Clause
!> The noise of kicks between drifts that decay, for a model that is damped by one rate. Kicks give the noise of free
!> motion (noise/decay_law) if the first kick takes d_k more and the last kick d_k less,
!>
!>    d_k = (D_k/h - sum_i phi_i w_ik)/(phi_1 - phi_n),   phi_i = phi((1 - c_i) h)/h
!>
!> so that sum_i w_ik = dW_k and sum_i h phi_i w_ik = D_k. In law D_k is linear in dW, a and K, and beta, gamma and eta
!> of these two kicks change with gamma h. Along the path D_k is a functional, with the factor delta. Polynomial weights
!> do not change.
!>
!> Verlet with dZ (step/explicit/verlet_dz) has one kick dW_k in the middle and a shift of q by D_k - phi(h/2) dW_k.
module symsde_step_open_kick_law
   use symsde_base_damping, only: damping_type, noise_of_scheme, noise_law3, noise_path, noise_polynomial
   use symsde_base_functionals, only: functional_set, path_dz, path_stt_area, path_decay
   use symsde_base_kinds, only: wp
   use symsde_base_traits, only: model_traits
   use symsde_noise_decay_law, only: decay_law2, decay_law3, decay_integral
   use symsde_scheme_kicks, only: kicks_type, flow_free
   use symsde_scheme_scheme, only: scheme_type, splitting_form, frame_shift
   use symsde_step_open_linear_noise, only: has_linear_law
   implicit none
   private
   public :: give_law, has_law, can_choose, needed_functionals, free_motion

contains

   !> Whether steps of a scheme give the noise of free motion with decay: one rate damps, drifts between kicks are free,
   !> and the noise follows dZ.
   pure logical function has_law(scheme, damping, noise)
      type(scheme_type), intent(in) :: scheme
      type(damping_type), intent(in) :: damping
      integer, intent(in) :: noise   !! an enumerator of base/damping

      has_law = damping%acts() .and. damping%is_scalar() .and. noise /= noise_polynomial .and. can_choose(scheme)
   end function has_law

   !> Whether a scheme can give the noise of free motion.
   pure logical function can_choose(scheme)
      type(scheme_type), intent(in) :: scheme

      can_choose = scheme%asks%has(path_dz) .and. (scheme%frame == frame_shift .or. &
                                                   (scheme%form == splitting_form .and. scheme%kicks%flow == flow_free))
   end function can_choose

   !> The functionals of the path that a step of this scheme needs for a model with these traits and this damping.
   pure type(functional_set) function needed_functionals(scheme, traits, damping, noise) result(needed)
      type(scheme_type), intent(in) :: scheme
      type(model_traits), intent(in) :: traits
      type(damping_type), intent(in) :: damping
      integer, intent(in) :: noise   !! an enumerator of base/damping
      type(functional_set) :: asked

      asked = scheme%asks
      if (noise /= noise_of_scheme .and. has_law(scheme, damping, noise)) then
         asked%has(path_stt_area) = asked%has(path_stt_area) .or. noise == noise_law3 .or. noise == noise_path
         asked%has(path_decay) = noise == noise_path
         if (noise == noise_path) asked%rate = damping%rate(1)
      else if (noise == noise_law3 .and. has_linear_law(scheme, traits, damping, noise)) then
         asked%has(path_stt_area) = .true.
      end if
      needed = asked%needed_for(traits)
   end function needed_functionals

   !> Kicks whose noise is that of free motion with decay, z = gamma h.
   pure subroutine give_law(kicks, closed, z, noise)
      type(kicks_type), intent(inout) :: kicks
      type(kicks_type), intent(in) :: closed
      real(wp), intent(in) :: z
      integer, intent(in) :: noise   !! an enumerator of base/damping
      real(wp) :: d(4), phi(size(closed%c))
      integer :: last

      last = size(closed%c)
      phi = decay_integral(1 - closed%c, z)
      d = free_motion(z, noise, closed%uses_k())
      d(1) = d(1) - sum(phi*closed%beta)
      d(2) = d(2) - sum(phi*closed%gamma)
      d(3) = d(3) - sum(phi*closed%eta)
      d = d/(phi(1) - phi(last))
      kicks%beta(1) = closed%beta(1) + d(1)
      kicks%gamma(1) = closed%gamma(1) + d(2)
      kicks%eta(1) = closed%eta(1) + d(3)
      kicks%delta(1) = d(4)
      kicks%beta(last) = closed%beta(last) - d(1)
      kicks%gamma(last) = closed%gamma(last) - d(2)
      kicks%eta(last) = closed%eta(last) - d(3)
      kicks%delta(last) = -d(4)
   end subroutine give_law

   !> Coefficients of dW, a and K in D/h, and of the path's own D/h.
   pure function free_motion(z, noise, follows_k) result(d)
      real(wp), intent(in) :: z            !! gamma h
      integer, intent(in) :: noise         !! an enumerator of base/damping
      logical, intent(in) :: follows_k     !! whether the scheme draws K, too
      real(wp) :: d(4)

      d = 0
      if (noise == noise_path) then
         d(4) = 1
      else if (noise == noise_law3 .or. (noise == noise_of_scheme .and. follows_k)) then
         d(:3) = decay_law3(z)
      else
         d(:3) = decay_law2(z)
      end if
   end function free_motion

end module symsde_step_open_kick_law
