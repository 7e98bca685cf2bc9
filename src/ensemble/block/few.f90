! SPDX-License-Identifier: BSD-3-Clause
!> The paths of a block of few, which go through their steps one by one: what takes them, and what drives them. Each has
!> a store of its own, where the weights of a step stand side by side and are not copied. Where the model takes whole
!> steps, a path that is alone has such a store, too.
module symsde_ensemble_block_few
   use symsde_base_functionals, only: nfunctional
   use symsde_base_interrupt, only: interrupt_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: steps_record, step_store, step_request, new_step_store
   use symsde_ensemble_block_prefetch, only: pairs_ahead, pairs_of, states_ahead
   use symsde_ensemble_options, only: run_options
   use symsde_model_abstract, only: model_type
   use symsde_noise_source, only: noise_type
   use symsde_step_lone, only: lone_stepper, most_lone
   use symsde_step_block_state, only: lane_state
   use symsde_step_stepper, only: stepper_type
   use symsde_step_flow_model_flow, only: model_flow_stepper
   implicit none
   private
   public :: few_paths, has_few, most_alone, lone_numbers

   type :: few_paths
      class(lone_stepper), allocatable :: stepper
      integer :: most = 0                   !! paths of a block of few
      integer :: npair = 0                  !! pairs of steps that fit
      integer :: nout = 1                   !! states after them that fit
      type(step_store), allocatable :: own(:)   !! what drives each path
      type(steps_record), private :: steps  !! which are taken, without what drives them
      real(wp), allocatable, dimension(:, :, :) :: qn, pn  !! these states, side by side (path, ndof, nout)
   contains
      procedure :: equip
      procedure :: takes
      procedure :: flow
      procedure :: walk
      procedure :: fill
      procedure :: bring
   end type few_paths

contains

   !> Whether a run has a block of few paths, which are up to `most`: the last one, if any.
   pure logical function has_few(npath, nlane, most)
      integer(i8), intent(in) :: npath
      integer, intent(in) :: nlane, most

      has_few = mod(npath - 1, int(nlane, i8)) < most
   end function has_few

   !> Paths up to which those of a block are taken one by one, by a lone stepper where there is one.
   pure integer function most_alone(stepper, lone)
      class(stepper_type), intent(in) :: stepper
      class(lone_stepper), allocatable, intent(in) :: lone

      most_alone = 0
      if (allocated(lone)) most_alone = lone%most
      select type (stepper)
      class is (model_flow_stepper)
         most_alone = 1
      end select
   end function most_alone

   !> Numbers that the stores of such a block hold, with so many columns a step beside h.
   pure real(wp) function lone_numbers(npath, nlane, ncolumn)
      integer(i8), intent(in) :: npath
      integer, intent(in) :: nlane, ncolumn

      lone_numbers = 0
      if (has_few(npath, nlane, most_lone)) lone_numbers = 2.0_wp*most_lone*pairs_ahead(1, ncolumn)*(ncolumn + 1)
   end function lone_numbers

   !> A stepper for paths of a model, and room for steps as those of the store of a block.
   subroutine equip(self, stepper, model, ndof, like, options)
      class(few_paths), intent(inout) :: self
      class(lone_stepper), allocatable, intent(inout) :: stepper  !! taken over; none: the model takes whole steps
      class(model_type), intent(in), target :: model
      integer, intent(in) :: ndof
      type(step_store), intent(in) :: like
      type(run_options), intent(in) :: options
      integer :: i, npath

      self%most = 1
      if (allocated(stepper)) then
         self%most = stepper%most
         call move_alloc(stepper, self%stepper)
         call self%stepper%lead(model)
         if (options%compensated) allocate (self%stepper%low(ndof, 2, self%most))
      end if
      self%steps%nlane = like%nlane
      self%steps%h = like%h
      self%npair = pairs_of(options%nstep, pairs_ahead(1, like%asked%columns(like%nnoise)))
      npath = int(min(options%npath, int(min(self%most, like%nlane), i8)))
      self%nout = int(min(int(states_ahead(npath, ndof), i8), max(1_i8, options%nstep/options%save_every)))
      allocate (self%qn(npath, ndof, self%nout), self%pn(npath, ndof, self%nout), self%own(npath))
      do i = 1, npath
         call new_step_store(self%own(i), 1, like%nnoise, 2*self%npair, like%h, like%asked)
      end do
   end subroutine equip

   !> Whether the paths of a block, so many, are taken here. Lanes past them are not moved: observers that look at them
   !> find a state of the last path.
   pure logical function takes(self, nreal)
      class(few_paths), intent(in) :: self
      integer, intent(in) :: nreal

      takes = self%npair > 0 .and. nreal <= self%most
   end function takes

   !> Whole steps of the one path of a block, which is lane 1: nout states, each after `every` more steps, in self%qn
   !> and self%pn, side by side, if it does not fail on the way.
   subroutine flow(self, stepper, place, t, nout, every, state, qn, pn, status, taken)
      class(few_paths), intent(inout) :: self
      class(model_flow_stepper), intent(inout) :: stepper
      integer, intent(in) :: place           !! where in the store the first step stands
      real(wp), intent(in) :: t              !! when it begins
      integer, intent(in) :: nout, every
      type(lane_state), intent(in) :: state
      real(wp), intent(inout) :: qn(:, :, :), pn(:, :, :)       !! the first state where it fails (nlane, ndof, ..)
      integer(i8), intent(inout) :: status(1)
      logical, intent(out) :: taken                             !! it did not
      real(wp), dimension(1, state%ndof) :: q1, p1

      call self%own(1)%show_several(place, nout*every, t, self%steps)
      self%steps%every = every
      self%steps%nreal = 1
      self%steps%max_iter = stepper%max_iter
      q1(1, :) = state%q(1, :)
      p1(1, :) = state%p(1, :)
      call stepper%flow(self%steps, q1, p1, self%qn, self%pn, status)
      taken = state%is_sound_alone(nout, status, self%qn, self%pn)
      if (taken) return
      qn(1, :, 1) = self%qn(1, :, 1)
      pn(1, :, 1) = self%pn(1, :, 1)
   end subroutine flow

   !> Up to nout states, each after `every` more steps, in self%qn and self%pn: as many as all paths come to by usual
   !> steps, but one of fewer steps where they do not come to the first. None are left to the stepper of the block.
   subroutine walk(self, place, nreal, t0, first, state, nout, every)
      class(few_paths), intent(inout) :: self
      integer, intent(in) :: place           !! where in the stores the first step stands
      integer, intent(in) :: nreal
      real(wp), intent(in) :: t0             !! when step 0 of the run begins
      integer(i8), intent(in) :: first       !! absolute step of the first of them
      type(lane_state), intent(inout) :: state  !! its low parts are moved on, if there are any
      integer, intent(inout) :: nout, every  !! in: those that are wanted; nout = 0: none
      integer :: ntaken, attempt
      logical :: compensated

      compensated = allocated(state%q_low)
      do attempt = 1, 2
         if (compensated) then
            self%stepper%low(:, 1, :nreal) = transpose(state%q_low(:nreal, :))
            self%stepper%low(:, 2, :nreal) = transpose(state%p_low(:nreal, :))
         end if
         self%steps%nstep = nout*every
         self%steps%every = every
         self%steps%nreal = nreal
         call self%stepper%walk_lanes(self%steps, self%own, place, t0, first, state%status, state%q, state%p, &
                                      self%qn, self%pn, ntaken)
         if (ntaken == 0 .or. ntaken == nout*every) exit
         if (ntaken < every) every = ntaken
         nout = ntaken/every  ! those that all paths can take, once more
      end do
      call self%stepper%note_rest(ntaken > 0)
      if (ntaken == 0) nout = 0
      if (.not. compensated .or. nout == 0) return
      state%q_low(:nreal, :) = transpose(self%stepper%low(:, 1, :nreal))
      state%p_low(:nreal, :) = transpose(self%stepper%low(:, 2, :nreal))
   end subroutine walk

   !> The pairs of steps of a request, for each of its real paths.
   subroutine fill(self, noise, request, drawn, interrupt)
      class(few_paths), intent(inout) :: self
      class(noise_type), intent(in) :: noise
      type(step_request), intent(in) :: request
      integer(i8), intent(out) :: drawn   !! normals drawn for one path
      class(interrupt_type), intent(inout), optional :: interrupt
      type(step_request) :: one
      integer :: lane

      one = step_request(1, 1, request%path(:1), request%pair, request%npair)
      do lane = 1, request%nreal
         one%path = request%path(lane:lane)
         call noise%fill(one, self%own(lane), drawn, interrupt)
      end do
   end subroutine fill

   !> Step i, from 0 on, as the first one of the store of the block, whose further lanes repeat the last path.
   subroutine bring(self, i, nreal, store)
      class(few_paths), intent(in) :: self
      integer, intent(in) :: i, nreal
      type(step_store), intent(inout) :: store
      integer :: lane, f

      do lane = 1, store%nlane
         associate (own => self%own(min(lane, nreal)))
            store%w(lane, :, 0) = own%w(1, :, i)
            do f = 1, nfunctional
               if (store%asked%has(f)) store%of(f)%x(lane, :, 0) = own%of(f)%x(1, :, i)
            end do
         end associate
      end do
   end subroutine bring

end module symsde_ensemble_block_few
