! SPDX-License-Identifier: BSD-3-Clause
!> The abstract stepper that takes several steps of a block in one pass, the state in registers between them.
!>
!> For equations so simple that moving the state through memory, adding increments and calling a stepper once
!> a step would take longer than solving them. A group of steps gives the bits of the steps one by one
!> (tests/verification/test_fused.pf), so that a run can be saved, stopped and resumed anywhere.
module symsde_step_fused
   use symsde_base_kinds, only: wp
   use symsde_step_stepper, only: stepper_type
   implicit none
   private
   public :: fused_stepper_type

   integer, parameter, public :: group = 8  !! steps of one pass

   type, extends(stepper_type), abstract :: fused_stepper_type
      logical :: takes_all_alone = .false.   !! pass takes any multiple of group where a block holds one path
      real(wp), allocatable, private :: x(:, :), y(:, :)  !! between two groups (nlane, ndof)
   contains
      procedure :: several
      procedure(pass_interface), deferred :: pass
      procedure(count_interface), deferred :: count_steps
   end type fused_stepper_type

   abstract interface
      !> One step, or a group of them, from (q, p) to (qn, pn), in all lanes.
      subroutine pass_interface(self, nstep, w, q, p, qn, pn)
         import :: fused_stepper_type, wp
         class(fused_stepper_type), intent(inout) :: self
         integer, intent(in) :: nstep  !! 1 or group; any multiple of it if takes_all_alone
         real(wp), intent(in) :: w(self%ham%nlane, 0:self%ham%nnoise, nstep)      !! h, dW_1 .. dW_m of each step
         real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof)
         real(wp), intent(in) :: p(self%ham%nlane, self%ham%ndof)
         real(wp), intent(out) :: qn(self%ham%nlane, self%ham%ndof)
         real(wp), intent(out) :: pn(self%ham%nlane, self%ham%ndof)
      end subroutine pass_interface

      !> Account for nstep steps that were taken.
      subroutine count_interface(self, nstep)
         import :: fused_stepper_type
         class(fused_stepper_type), intent(inout) :: self
         integer, intent(in) :: nstep
      end subroutine count_interface
   end interface

contains

   !> One step, or a multiple of group, from (q, p) to (qn, pn): from group to group to and fro between (qn, pn)
   !> and the work arrays, so that the last one ends where it should.
   subroutine several(self, nstep, w, q, p, qn, pn)
      class(fused_stepper_type), intent(inout) :: self
      integer, intent(in) :: nstep
      real(wp), intent(in) :: w(self%ham%nlane, 0:self%ham%nnoise, nstep)
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: qn(self%ham%nlane, self%ham%ndof), pn(self%ham%nlane, self%ham%ndof)
      real(wp), allocatable :: x(:, :), y(:, :)
      integer :: first

      if (nstep <= group .or. (self%takes_all_alone .and. self%ham%nreal == 1)) then
         call self%pass(nstep, w, q, p, qn, pn)
         return
      end if
      call move_alloc(self%x, x)
      call move_alloc(self%y, y)
      if (.not. allocated(x)) allocate (x, y, mold=q)
      if (mod(nstep/group, 2) == 1) then
         call self%pass(group, w, q, p, qn, pn)
         first = group + 1
      else
         call self%pass(group, w, q, p, x, y)
         call self%pass(group, w(1, 0, group + 1), x, y, qn, pn)
         first = 2*group + 1
      end if
      do first = first, nstep, 2*group
         call self%pass(group, w(1, 0, first), qn, pn, x, y)
         call self%pass(group, w(1, 0, first + group), x, y, qn, pn)
      end do
      call move_alloc(x, self%x)
      call move_alloc(y, self%y)
   end subroutine several

end module symsde_step_fused
