! SPDX-License-Identifier: BSD-3-Clause
!> The abstract observable: a user's values, computed lane by lane from (q, p); and a probe that finds observables that
!> mix lanes.
module symsde_ensemble_observe_observables
   use symsde_base_kinds, only: wp
   use symsde_base_lanes, only: lane_unit
   use symsde_base_status, only: error_type, raise, false_trait
   use symsde_base_text, only: to_text
   implicit none
   private
   public :: observables_type

   type, abstract :: observables_type
      integer :: nvalue = 0      !! how many values
      integer :: most_lanes = 0  !! > 0: independent of t, and may be called with so many lanes of several saved times
   contains
      procedure(evaluate_interface), deferred :: evaluate
      procedure :: failure_code => never_failed
      procedure :: probe
   end type observables_type

   abstract interface
      !> All values at one time, or at the first of several; each lane from its own numbers alone.
      subroutine evaluate_interface(self, nlane, ndof, t, q, p, values)
         import :: observables_type, wp
         class(observables_type), intent(in) :: self
         integer, intent(in) :: nlane, ndof
         real(wp), intent(in) :: t, q(nlane, ndof), p(nlane, ndof)
         real(wp), intent(out) :: values(nlane, self%nvalue)
      end subroutine evaluate_interface
   end interface

contains

   !> The nonzero return code of a user callback that refused, which aborts the run; 0 if none has.
   integer function never_failed(self) result(code)
      class(observables_type), intent(in) :: self

      code = 0
   end function never_failed

   !> Refuse (false_trait) observables that mix paths: two states near the state of one path are evaluated in a mixed
   !> order that no shift repeats, and each in a block of copies of itself; the values must be the same.
   subroutine probe(self, t, q0, p0, error)
      class(observables_type), intent(in) :: self
      real(wp), intent(in) :: t, q0(:), p0(:)
      type(error_type), allocatable, intent(inout) :: error
      integer, parameter :: nlane = lane_unit, state_of(nlane) = [1, 2, 2, 1, 2, 1, 1, 2], of_one(nlane) = 1
      real(wp), parameter :: vanishing = 1.0e-6_wp  !! differences below this fraction of the values are rounding
      real(wp), allocatable :: among(:, :), alike(:, :)  !! values (nlane, nvalue)
      real(wp) :: scale
      integer :: state, lane, i

      if (allocated(error) .or. self%nvalue == 0) return
      allocate (among(nlane, self%nvalue), alike(nlane, self%nvalue))
      call ask(state_of, among)
      do state = 1, 2
         call ask(state*of_one, alike)
         if (self%failure_code() /= 0) return  ! the run reports the failure
         do i = 1, self%nvalue
            scale = maxval(abs(among(:, i)), mask=abs(among(:, i)) <= huge(1.0_wp))
            do lane = 1, nlane
               if (state_of(lane) /= state .or. are_same(among(lane, i), alike(lane, i), scale)) cycle
               call raise(error, false_trait, 'moments', 'observable '//to_text(i)//' mixes paths: it is '// &
                          to_text(among(lane, i))//' for a path among different ones, and '//to_text(alike(lane, i))// &
                          ' among copies of it, at q_1 = '//to_text(near(q0(1), state))// &
                          ', p_1 = '//to_text(near(p0(1), state))//'; compute each value from the state of its own '// &
                          'path, and never sum over paths')
               return
            end do
         end do
      end do

   contains

      subroutine ask(states, values)
         integer, intent(in) :: states(nlane)
         real(wp), intent(out) :: values(nlane, self%nvalue)
         real(wp), dimension(nlane, size(q0)) :: q, p
         integer :: lane, i

         do i = 1, size(q0)
            do lane = 1, nlane
               q(lane, i) = near(q0(i), states(lane))
               p(lane, i) = near(p0(i), states(lane))
            end do
         end do
         call self%evaluate(nlane, size(q0), t, q, p, values)
      end subroutine ask

      pure real(wp) function near(x, state)
         real(wp), intent(in) :: x
         integer, intent(in) :: state

         near = x + merge(0.01_wp, -0.005_wp, state == 1)*max(1.0_wp, abs(x))
      end function near

      !> Whether a and b are equal up to rounding. An infinite or NaN value equals any value.
      pure logical function are_same(a, b, scale)
         real(wp), intent(in) :: a, b, scale

         are_same = abs(a - b) <= vanishing*scale .or. .not. (abs(a) <= huge(a) .or. abs(b) <= huge(b))
      end function are_same

   end subroutine probe

end module symsde_ensemble_observe_observables
