! SPDX-License-Identifier: BSD-3-Clause
!> Paths that are taken through their steps one by one, by scalars.
!>
!> A block of few paths pays for full vectors, and for passes over them that tell lanes apart. Where a stepper offers a
!> scalar one, every path is taken through its steps by itself instead (ensemble/block/single_path). The results have
!> the same bits: a scalar stepper does the operations of the stepper that offers it in their order, for the usual case
!> alone. A step that is not usual (stiff, not converging soon, not finite) is left to that stepper, which knows what to
!> do.
module symsde_step_scalar_path
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp
   use symsde_base_record, only: step_record, steps_record
   use symsde_base_sincos, only: sincos_one
   use symsde_model_abstract, only: model_type, angle_terms
   implicit none
   private
   public :: scalar_path, most_single, few_of

   integer, parameter :: most_single = 12         !! paths of a run that any stepper takes one by one
   integer, parameter :: wide = 32                !! degrees of freedom of a wide system

   type, abstract :: scalar_path
      class(model_type), pointer :: model => null()  !! whose lanes have the same bits whatever their number
      integer :: n = 0, m = 0                        !! degrees of freedom, noises
      integer :: most = 2                            !! paths up to which those of a run go one by one
      logical :: mass_alone = .false.                !! Hhat_p = h p, for those that are told
      type(counters_type) :: counters                !! of the steps that were taken
      logical :: wants_record = .false.              !! more than weights drives a step: it stands in the record
      type(step_record) :: step                      !! without its time
      logical :: takes_all = .false.                 !! no step is left to others
      integer :: now = 0                             !! which of the steps that were foreseen is taken
   contains
      procedure(take_interface), deferred :: take
      procedure :: lead
      procedure :: foresee
      procedure :: find_terms
      procedure :: force_at
      procedure :: velocity_at
   end type scalar_path

   abstract interface
      !> One step of one path; where it is not taken nothing is defined, and nothing is counted.
      subroutine take_interface(self, t, h, w, q, p, dq, dp, taken)
         import :: scalar_path, wp
         class(scalar_path), intent(inout) :: self
         real(wp), intent(in) :: t, h             !! when the step begins; the step with its sign
         real(wp), intent(in) :: w(0:self%m)      !! h, dW_1 .. dW_m
         real(wp), intent(in) :: q(self%n), p(self%n)
         real(wp), intent(out) :: dq(self%n), dp(self%n)
         logical, intent(out) :: taken
      end subroutine take_interface
   end interface

contains

   !> Paths up to which those of a block are faster one by one: as many as were measured for narrow systems, and more
   !> of wide ones, where a block takes its passes through memory.
   pure integer function few_of(n, narrow, broad)
      integer, intent(in) :: n              !! degrees of freedom
      integer, intent(in) :: narrow, broad  !! paths of a narrow system, of a wide one

      few_of = merge(broad, narrow, n >= wide)
   end function few_of

   !> The model of the paths to come.
   subroutine lead(self, model)
      class(scalar_path), intent(inout) :: self
      class(model_type), intent(in), target :: model

      self%model => model
      self%n = model%traits%ndof
      self%m = model%traits%nnoise
   end subroutine lead

   !> What steps of a path have in common, for those that prepare several at once.
   subroutine foresee(self, steps)
      class(scalar_path), intent(inout) :: self
      type(steps_record), intent(in) :: steps  !! of one lane
   end subroutine foresee

   !> What a model with angle terms has at a time; of others nothing is asked.
   subroutine find_terms(self, t, w, terms)
      class(scalar_path), intent(in) :: self
      real(wp), intent(in) :: t, w(0:self%m)
      type(angle_terms), intent(out) :: terms

      if (self%model%traits%has_angle_terms) call self%model%angle(self%m, t, w, terms)
   end subroutine find_terms

   !> Hhat_q of one degree of freedom with the terms of that time, its slope, and Hhat_p with its own: numbers that
   !> come and go in registers, since a path by itself waits for one after the other.
   real(wp) function force_at(self, terms, t, w, q, p, slope, hp, hpp)
      class(scalar_path), intent(in) :: self
      type(angle_terms), intent(in) :: terms
      real(wp), intent(in) :: t, w(0:self%m)
      real(wp), value :: q, p
      real(wp), intent(out) :: slope
      real(wp), intent(out), optional :: hp, hpp  !! both or none
      real(wp), dimension(1) :: x, y, gq, gp, gqq, gpp
      real(wp) :: sine, cosine

      if (self%model%traits%has_angle_terms) then
         sine = sincos_one(q, cosine)
         force_at = terms%a*sine + (terms%b*cosine + (terms%c*q + terms%d))
         slope = terms%a*cosine + (terms%c - terms%b*sine)
         if (.not. present(hp)) return
         hp = terms%e*p
         hpp = terms%e
      else
         x = q
         y = p
         if (present(hp)) then
            call self%model%gradient_hessian(1, 1, self%m, t, w, x, y, gq, gp, hqq=gqq, hpp=gpp)
            hp = gp(1)
            hpp = gpp(1)
         else
            call self%model%gradient_hessian(1, 1, self%m, t, w, x, y, hq=gq, hqq=gqq)
         end if
         force_at = gq(1)
         slope = gqq(1)
      end if
   end function force_at

   !> Hhat_p of one degree of freedom, where the Hamiltonians are separable.
   real(wp) function velocity_at(self, terms, t, w, q, p)
      class(scalar_path), intent(in) :: self
      type(angle_terms), intent(in) :: terms
      real(wp), intent(in) :: t, w(0:self%m)
      real(wp), value :: q, p
      real(wp) :: x(1), y(1), hp(1)

      if (self%model%traits%has_angle_terms) then
         velocity_at = terms%e*p
      else if (self%mass_alone) then
         velocity_at = w(0)*p
      else
         x = q
         y = p
         call self%model%gradient(1, 1, self%m, t, w, x, y, hp=hp)
         velocity_at = hp(1)
      end if
   end function velocity_at

end module symsde_step_scalar_path
