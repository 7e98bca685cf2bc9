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
   use symsde_base_record, only: step_record, steps_record, step_store
   use symsde_base_sincos, only: sincos_one
   use symsde_model_abstract, only: model_type, angle_terms
   implicit none
   private
   public :: lone_stepper, most_lone, few_of

   integer, parameter :: most_lone = 12           !! paths that any lone stepper takes of a block
   integer, parameter :: narrow = 4, wide = 32    !! degrees of freedom of a narrow system, of a wide one

   type, abstract :: lone_stepper
      class(model_type), pointer :: model => null()  !! whose lanes have the same bits whatever their number
      integer :: n = 0, m = 0                        !! degrees of freedom, noises
      integer :: most = 2                            !! paths up to which those of a block go one by one
      integer :: npath = 1                           !! paths of this block
      logical :: mass_alone = .false.                !! Hhat_p = h p, for those that are told
      type(counters_type) :: counters                !! of the steps that were taken
      logical :: wants_record = .false.              !! more than weights drives a step: it stands in the record
      type(step_record) :: step                      !! without its time
      real(wp), allocatable :: low(:, :, :)          !! low parts of q and p, if compensated (n, 2, lane)
      integer, private :: rest = 0, resting = 0      !! steps left to others after an unusual one; of them, to come
   contains
      procedure(take_interface), deferred :: take
      procedure :: lead
      procedure :: foresee
      procedure :: show
      procedure :: collect
      procedure :: find_terms
      procedure :: force_at
      procedure :: velocity_at
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

   !> Paths up to which those of a block are faster one by one: as many as were measured for narrow systems, and more
   !> of wide ones, where a block takes its passes through memory.
   pure integer function few_of(n, narrow, broad)
      integer, intent(in) :: n              !! degrees of freedom
      integer, intent(in) :: narrow, broad  !! paths of a narrow system, of a wide one

      few_of = merge(broad, narrow, n >= wide)
   end function few_of

   !> The model of the paths to come.
   subroutine lead(self, model)
      class(lone_stepper), intent(inout) :: self
      class(model_type), intent(in), target :: model

      self%model => model
      self%n = model%traits%ndof
      self%m = model%traits%nnoise
   end subroutine lead

   !> What is counted elsewhere, to self%counters.
   subroutine collect(self)
      class(lone_stepper), intent(inout) :: self
   end subroutine collect

   !> What steps of a path have in common, for those that prepare several at once.
   subroutine foresee(self, own, place, nstep)
      class(lone_stepper), intent(inout) :: self
      type(step_store), intent(in) :: own
      integer, intent(in) :: place  !! where in it the first of them stands
      integer, intent(in) :: nstep
   end subroutine foresee

   !> The step at a place, before it is taken.
   subroutine show(self, own, i)
      class(lone_stepper), intent(inout) :: self
      type(step_store), intent(in), target :: own
      integer, intent(in) :: i  !! where it stands

      call own%show(i, self%step%t, self%step)
   end subroutine show

   !> What a model with angle terms has at a time; of others nothing is asked.
   subroutine find_terms(self, t, w, terms)
      class(lone_stepper), intent(in) :: self
      real(wp), intent(in) :: t, w(0:self%m)
      type(angle_terms), intent(out) :: terms

      if (self%model%traits%has_angle_terms) call self%model%angle(self%m, t, w, terms)
   end subroutine find_terms

   !> Hhat_q of one degree of freedom with the terms of that time, its slope, and Hhat_p with its own: numbers that
   !> come and go in registers, since a path by itself waits for one after the other.
   real(wp) function force_at(self, terms, t, w, q, p, slope, hp, hpp)
      class(lone_stepper), intent(in) :: self
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
      class(lone_stepper), intent(in) :: self
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

   !> All real lanes through the same steps, as far as all of them come; those with a status stay where they are.
   subroutine walk_lanes(self, steps, own, place, t0, first, status, q, p, qn, pn, ntaken)
      class(lone_stepper), intent(inout) :: self
      type(steps_record), intent(in) :: steps  !! which they are, without their weights
      type(step_store), intent(in), target :: own(:)   !! the weights of each lane by itself
      integer, intent(in) :: place           !! where in these stores the first of them stands
      real(wp), intent(in) :: t0             !! when step 0 of the run begins
      integer(i8), intent(in) :: first       !! absolute step of the first of them
      integer(i8), intent(in) :: status(steps%nlane)
      real(wp), intent(in) :: q(steps%nlane, self%n), p(steps%nlane, self%n)
      real(wp), intent(inout) :: qn(steps%nreal, self%n, steps%nstep/steps%every)
      real(wp), intent(inout) :: pn(steps%nreal, self%n, steps%nstep/steps%every)
      integer, intent(out) :: ntaken  !! all, or those before the first that some lane does not take
      type(counters_type) :: counters
      integer :: lane, k, n

      counters = self%counters
      self%npath = steps%nreal
      ntaken = steps%nstep
      do lane = 1, steps%nreal
         if (status(lane) == 0) then
            call self%walk(steps, own(lane), place, t0, first, lane, q, p, qn, pn, n)
            ntaken = min(ntaken, n)
         else
            do k = 1, size(qn, 3)
               qn(lane, :, k) = q(lane, :)
               pn(lane, :, k) = p(lane, :)
            end do
         end if
      end do
      call self%collect()
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
   subroutine walk(self, steps, own, place, t0, first, lane, q, p, qn, pn, ntaken)
      class(lone_stepper), intent(inout) :: self
      type(steps_record), intent(in) :: steps
      type(step_store), intent(in), target :: own  !! the weights of the lane
      integer, intent(in) :: place           !! where in it the first of them stands
      real(wp), intent(in) :: t0             !! when step 0 of the run begins
      integer(i8), intent(in) :: first       !! absolute step of the first of them
      integer, intent(in) :: lane
      real(wp), intent(in) :: q(steps%nlane, self%n), p(steps%nlane, self%n)
      real(wp), intent(inout) :: qn(steps%nreal, self%n, steps%nstep/steps%every)
      real(wp), intent(inout) :: pn(steps%nreal, self%n, steps%nstep/steps%every)
      integer, intent(out) :: ntaken  !! all, or those before the first that is not
      real(wp) :: x(self%n, 2), dx(self%n, 2)  ! q and p, and their increments: few allocations
      integer :: i, left, out
      logical :: sound

      x(:, 1) = q(lane, :)
      x(:, 2) = p(lane, :)
      out = 0
      left = steps%every
      call self%foresee(own, place, steps%nstep)
      do ntaken = 0, steps%nstep - 1
         ! increments come through memory, as those of blocks do: no operation of theirs is fused with the sum
         if (self%wants_record) call self%show(own, place + ntaken)
         call self%take(t0 + real(first + ntaken, wp)*steps%h, steps%h, own%w(1, 0, place + ntaken), &
                        x(1, 1), x(1, 2), dx(1, 1), dx(1, 2), sound)
         if (sound .and. allocated(self%low)) then
            call advance_compensated(2*self%n, dx, x, self%low(1, 1, lane), sound)
         else if (sound) then
            call advance(2*self%n, dx, x, sound)
         end if
         if (.not. sound) return
         left = left - 1
         if (left > 0) cycle
         left = steps%every
         out = out + 1
         !GCC$ novector  ! far from each other
         do i = 1, self%n
            qn(lane, i, out) = x(i, 1)
            pn(lane, i, out) = x(i, 2)
         end do
      end do
   end subroutine walk

   !> VEC Add the increments; sound says that all is finite. Few numbers have just been written one by one: a vector of
   !> them would wait until they are in memory.
   pure subroutine advance(n, dx, x, sound)
      integer, intent(in) :: n
      real(wp), intent(in) :: dx(n)
      real(wp), intent(inout) :: x(n)
      logical, intent(out) :: sound
      integer(i8) :: nbad
      integer :: i

      if (n <= 2*narrow) then
         sound = .true.
         !GCC$ novector
         do i = 1, n
            x(i) = x(i) + dx(i)
            sound = sound .and. abs(x(i)) <= huge(x)
         end do
         return
      end if
      nbad = 0
      do i = 1, n
         x(i) = x(i) + dx(i)
         nbad = nbad + merge(0_i8, 1_i8, abs(x(i)) <= huge(x))
      end do
      sound = nbad == 0
   end subroutine advance

   !> VEC The same by Kahan's summation, as step/block/state does it.
   pure subroutine advance_compensated(n, d, x, low, sound)
      integer, intent(in) :: n
      real(wp), intent(in) :: d(n)
      real(wp), intent(inout) :: x(n), low(n)
      logical, intent(inout) :: sound
      real(wp) :: y, s
      integer(i8) :: nbad
      integer :: i

      nbad = 0
      do i = 1, n
         nbad = nbad + merge(0_i8, 1_i8, abs(x(i) + d(i)) <= huge(x))
         y = d(i) + low(i)
         s = x(i) + y
         low(i) = y - (s - x(i))
         x(i) = s
      end do
      sound = sound .and. nbad == 0
   end subroutine advance_compensated

end module symsde_step_lone
