! SPDX-License-Identifier: BSD-3-Clause
!> Paths that are taken through their steps one by one, by scalars.
!>
!> A block of few paths pays for full vectors, and for passes over them that tell lanes apart. Where a stepper offers a
!> lone one, the block runner takes every path through several steps by itself instead. The results have the same
!> bits: a lone stepper does the operations of the stepper that offers it in their order, for the usual case alone. A
!> step that is not usual (stiff, not converging soon, not finite) is left to that stepper, which knows what to do.
module symsde_step_lone
   use symsde_base_counters, only: counters_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: steps_record
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: lone_stepper

   type, abstract :: lone_stepper
      class(model_type), pointer :: model => null()  !! whose lanes have the same bits whatever their number
      integer :: n = 0, m = 0                        !! degrees of freedom, noises
      type(counters_type) :: counters                !! of the steps that were taken
      integer, private :: rest = 0, resting = 0      !! steps left to others after an unusual one; of them, to come
   contains
      procedure(take_interface), deferred :: take
      procedure :: walk_lanes
      procedure :: walk
      procedure :: note_rest
      procedure :: is_rested
   end type lone_stepper

   integer, parameter :: longest_rest = 64

   abstract interface
      !> One step of one path; where it is not taken nothing is defined, and nothing is counted.
      subroutine take_interface(self, t, h, w, q, p, dq, dp, taken)
         import :: lone_stepper, wp
         class(lone_stepper), intent(inout) :: self
         real(wp), intent(in) :: t, h             !! when the step begins; the step with its sign
         real(wp), intent(in) :: w(0:self%m)      !! h, dW_1 .. dW_m
         real(wp), intent(in) :: q(self%n), p(self%n)
         real(wp), intent(out) :: dq(self%n), dp(self%n)
         logical, intent(out) :: taken
      end subroutine take_interface
   end interface

contains

   !> All real lanes through the same steps, as far as all of them come; those with a status stay where they are.
   subroutine walk_lanes(self, steps, t0, first, status, q, p, qn, pn, ntaken)
      class(lone_stepper), intent(inout) :: self
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: t0             !! when step 0 of the run begins
      integer(i8), intent(in) :: first       !! absolute step of the first of them
      integer(i8), intent(in) :: status(steps%nlane)
      real(wp), intent(in) :: q(steps%nlane, self%n), p(steps%nlane, self%n)
      real(wp), intent(inout) :: qn(steps%nlane, self%n, steps%nstep/steps%every)
      real(wp), intent(inout) :: pn(steps%nlane, self%n, steps%nstep/steps%every)
      integer, intent(out) :: ntaken  !! all, or those before the first that some lane does not take
      type(counters_type) :: counters
      integer :: lane, k, n

      counters = self%counters
      ntaken = steps%nstep
      do lane = 1, steps%nreal
         if (status(lane) == 0) then
            call self%walk(steps, t0, first, lane, q, p, qn, pn, n)
            ntaken = min(ntaken, n)
         else
            do k = 1, size(qn, 3)
               qn(lane, :, k) = q(lane, :)
               pn(lane, :, k) = p(lane, :)
            end do
         end if
      end do
      if (ntaken < steps%nstep) self%counters = counters
   end subroutine walk_lanes

   !> After an unusual step the next ones are left to others, too: more and more, while they are.
   subroutine note_rest(self, usual)
      class(lone_stepper), intent(inout) :: self
      logical, intent(in) :: usual

      self%rest = merge(0, min(2*self%rest + 1, longest_rest), usual)
      self%resting = max(self%rest - 1, 0)
   end subroutine note_rest

   !> Whether the next step is tried again.
   subroutine is_rested(self, rested)
      class(lone_stepper), intent(inout) :: self
      logical, intent(out) :: rested

      rested = self%resting == 0
      self%resting = max(self%resting - 1, 0)
   end subroutine is_rested

   !> Steps of one lane from (q, p), with the states after every steps%every-th, as far as they are usual.
   subroutine walk(self, steps, t0, first, lane, q, p, qn, pn, ntaken)
      class(lone_stepper), intent(inout) :: self
      type(steps_record), intent(in) :: steps
      real(wp), intent(in) :: t0             !! when step 0 of the run begins
      integer(i8), intent(in) :: first       !! absolute step of the first of them
      integer, intent(in) :: lane
      real(wp), intent(in) :: q(steps%nlane, self%n), p(steps%nlane, self%n)
      real(wp), intent(inout) :: qn(steps%nlane, self%n, steps%nstep/steps%every)
      real(wp), intent(inout) :: pn(steps%nlane, self%n, steps%nstep/steps%every)
      integer, intent(out) :: ntaken  !! all, or those before the first that is not
      real(wp), dimension(self%n) :: x, y, dx, dy
      real(wp) :: w(0:self%m), sound
      integer :: i, k
      logical :: taken

      x = q(lane, :)
      y = p(lane, :)
      do ntaken = 0, steps%nstep - 1
         k = ntaken + 1
         !GCC$ novector  ! few numbers
         do i = 0, self%m
            w(i) = steps%w(lane, i, k)
         end do
         ! increments come through memory, as those of blocks do: no operation of theirs is fused with the sum
         call self%take(t0 + real(first + ntaken, wp)*steps%h, steps%h, w, x, y, dx, dy, taken)
         if (.not. taken) return
         sound = 0
         !GCC$ novector  ! few numbers
         do i = 1, self%n
            x(i) = x(i) + dx(i)
            y(i) = y(i) + dy(i)
            sound = sound + (0*x(i) + 0*y(i))  ! NaN where one is not finite
         end do
         if (.not. abs(sound) <= 0) return
         if (mod(k, steps%every) /= 0) cycle
         !GCC$ novector  ! few numbers
         do i = 1, self%n
            qn(lane, i, k/steps%every) = x(i)
            pn(lane, i, k/steps%every) = y(i)
         end do
      end do
   end subroutine walk

end module symsde_step_lone
