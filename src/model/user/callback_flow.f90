! SPDX-License-Identifier: BSD-3-Clause
!> Whole steps of a user's model: C functions, one for each map (model_type%flow states their contract).
!>
!> Private to its family.
module symsde_model_user_callback_flow
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_procpointer, c_funptr, c_int, c_int64_t
   use, intrinsic :: iso_c_binding, only: c_loc, c_null_ptr, c_ptr
   use symsde_base_functionals, only: nfunctional
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_maps, only: step_map, same_map
   use symsde_base_record, only: steps_record
   implicit none
   private
   public :: user_flows

   !> Place of the decays of damped steps, functionals[5] of symsde_flow in symsde.h: it stays there if functionals are
   !> added, which follow it, since functions of users were compiled with it.
   integer, parameter :: place_of_decays = 6
   integer, parameter :: place_of_turns = 8   !! behind all functionals: flows of a quadratic part

   type :: flow_slot
      type(step_map) :: map
      procedure(flow_callback), pointer, nopass :: take => null()
   end type flow_slot

   !> The functions of a model for whole steps.
   type :: user_flows
      private
      type(flow_slot), allocatable :: slots(:)
   contains
      procedure :: set
      procedure :: place_of
      procedure :: take
   end type user_flows

   abstract interface
      !> Whole steps of a user's model by one map, see model_type%flow.
      function flow_callback(nlane, ndof, nham, nstep, every, max_iter, t, h, w, functionals, q, p, qn, pn, status, &
                             user) bind(c) result(code)
         import :: c_int, c_int64_t, c_double, c_ptr, nfunctional
         integer(c_int), value :: nlane, ndof, nham
         integer(c_int), value :: nstep, every             !! steps, and steps between states to return
         integer(c_int), value :: max_iter                 !! bound on iterations of a solver in a step
         real(c_double), value :: t, h !! time at which the first step begins; the step with its sign
         real(c_double), intent(in) :: w(nlane, nham, nstep)
         !> Each (nlane, columns, nstep), or NULL; decays of damped steps at place_of_decays, else NULL; and
         !> flows of a quadratic part at place_of_turns.
         type(c_ptr), intent(in) :: functionals(nfunctional + 3)
         real(c_double), intent(in) :: q(nlane, ndof), p(nlane, ndof)
         real(c_double), intent(out) :: qn(nlane, ndof, nstep/every), pn(nlane, ndof, nstep/every)
         integer(c_int64_t), intent(inout) :: status(nlane)  !! 0, or a status of the lane
         type(c_ptr), value :: user
         integer(c_int) :: code  !! 0 = ok
      end function flow_callback
   end interface

contains

   !> Set the function of a map; c_null_funptr removes it.
   subroutine set(self, map, function)
      class(user_flows), intent(inout) :: self
      type(step_map), intent(in) :: map
      type(c_funptr), intent(in) :: function
      type(flow_slot), allocatable :: slots(:)
      integer :: i, n, known

      known = 0
      if (allocated(self%slots)) known = size(self%slots)
      allocate (slots(known + 1))
      n = 0
      do i = 1, known
         if (same_map(self%slots(i)%map, map)) cycle
         n = n + 1
         slots(n) = self%slots(i)
      end do
      if (c_associated(function)) then
         n = n + 1
         slots(n)%map = map
         call c_f_procpointer(function, slots(n)%take)
      end if
      self%slots = slots(:n)
   end subroutine set

   !> Index of a map's function; 0 = none.
   pure integer function place_of(self, map)
      class(user_flows), intent(in) :: self
      type(step_map), intent(in) :: map
      integer :: i

      place_of = 0
      if (.not. allocated(self%slots)) return
      do i = 1, size(self%slots)
         if (same_map(self%slots(i)%map, map)) place_of = i
      end do
   end function place_of

   !> Take the steps of a map that has a function, in all lanes: padding of a block costs less than copies without it.
   subroutine take(self, map, steps, ndof, user, q, p, qn, pn, status, code)
      class(user_flows), intent(in) :: self
      type(step_map), intent(in) :: map
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: ndof
      type(c_ptr), intent(in) :: user
      real(wp), intent(in) :: q(steps%nlane, ndof), p(steps%nlane, ndof)
      real(wp), intent(out) :: qn(steps%nlane, ndof, steps%nstep/steps%every)
      real(wp), intent(out) :: pn(steps%nlane, ndof, steps%nstep/steps%every)
      integer(i8), intent(inout) :: status(steps%nlane)
      integer(i4), intent(out) :: code
      real(wp), contiguous, pointer :: w(:, :, :), x(:, :, :), turns(:)
      real(wp), target :: decays(20)
      type(c_ptr) :: functionals(nfunctional + 3)
      integer :: f

      functionals = c_null_ptr
      do f = 1, nfunctional
         x => steps%of(f)%x  ! contiguous, which gfortran 12 does not recognise for a component
         if (.not. associated(x)) cycle
         if (size(x) > 0) functionals(merge(f, f + 1, f < place_of_decays)) = c_loc(x)
      end do
      associate (d => steps%decays, n => steps%decays%nkick)
         decays(1) = d%z
         decays(2:n + 1) = d%beta(:n)
         decays(n + 2:2*n + 1) = d%gamma(:n)
         decays(2*n + 2:3*n + 1) = d%eta(:n)
         decays(11:15) = d%lost
         decays(16:) = d%left
      end associate
      if (map%damped) functionals(place_of_decays) = c_loc(decays)
      turns => steps%turns
      if (associated(turns)) functionals(place_of_turns) = c_loc(turns)
      w => steps%w
      associate (s => steps)
         code = self%slots(self%place_of(map))%take(s%nlane, ndof, s%nnoise + 1, s%nstep, s%every, s%max_iter, s%t, &
                                                    s%h, w, functionals, q, p, qn, pn, status, user)
      end associate
   end subroutine take

end module symsde_model_user_callback_flow
