! SPDX-License-Identifier: BSD-3-Clause
!> Where the paths of a run begin: the caller's arrays, as one argument for all threads.
!>
!> Low parts are there to resume compensated runs, statuses to go on with paths of which some failed or were stopped;
!> null where not given. An absent array is not handed to a parallel region: gfortran computes the extents of such an
!> argument from what happens to lie in memory.
module symsde_ensemble_initial_state
   use symsde_base_kinds, only: wp, i4, i8
   implicit none
   private
   public :: initial_state, new_initial_state

   type :: initial_state
      real(wp), pointer :: q(:, :) => null(), p(:, :) => null()          !! (npath or 1, ndof)
      real(wp), pointer :: q_low(:, :) => null(), p_low(:, :) => null()  !! (npath or 1, ndof), or null
      integer(i4), pointer :: status(:) => null()       !! 0, or a code of base/status (npath), or null
      integer(i8), pointer :: failed_step(:) => null()  !! where it failed or was stopped, -1 = it did not (npath)
      logical :: resumed = .false.    !! the rest of a drive that was stopped: paths that are ok are done
   end type initial_state

contains

   !> Point to the caller's arrays, which must be targets there.
   subroutine new_initial_state(self, q, p, q_low, p_low)
      type(initial_state), intent(out) :: self
      real(wp), intent(in), target :: q(:, :), p(:, :)                     !! (npath or 1, ndof)
      real(wp), intent(in), target, optional :: q_low(:, :), p_low(:, :)   !! (npath or 1, ndof)

      self%q => q
      self%p => p
      if (present(q_low)) self%q_low => q_low
      if (present(p_low)) self%p_low => p_low
   end subroutine new_initial_state

end module symsde_ensemble_initial_state
