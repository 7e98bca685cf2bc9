! SPDX-License-Identifier: BSD-3-Clause
!> The first nonzero code that a user's functions returned. Models are intent(in) in a run, and several threads call
!> them, so the code is behind a pointer. A view of a model shares the record of the model.
!>
!> Private to its family.
module symsde_model_user_failures
   use symsde_base_kinds, only: i4
   implicit none
   private
   public :: failure_record

   type :: failure_record
      private
      integer(i4), pointer :: code => null()
      logical :: is_shared = .false.  !! code belongs to another model, which lives longer
   contains
      procedure :: begin
      procedure :: see
      procedure :: note
      procedure :: first
      procedure :: clear
      procedure :: release
   end type failure_record

contains

   !> A record without a failure.
   subroutine begin(self)
      class(failure_record), intent(inout) :: self

      if (.not. associated(self%code)) allocate (self%code)
      call self%clear()
   end subroutine begin

   !> Share the record of another model.
   subroutine see(self, other)
      class(failure_record), intent(inout) :: self
      type(failure_record), intent(in) :: other

      self%code => other%code
      self%is_shared = .true.
   end subroutine see

   !> Keep the first nonzero code. If two threads fail at the same moment, either code may be kept.
   subroutine note(self, code)
      class(failure_record), intent(in) :: self
      integer(i4), intent(in) :: code

      if (self%first() /= 0) return
      !$omp atomic write
      self%code = code
   end subroutine note

   !> The first code since the last `clear`; 0 = none.
   integer function first(self)
      class(failure_record), intent(in) :: self

      first = 0
      if (.not. associated(self%code)) return
      !$omp atomic read
      first = self%code
   end function first

   !> Forget a failure.
   subroutine clear(self)
      class(failure_record), intent(in) :: self

      if (.not. associated(self%code)) return
      !$omp atomic write
      self%code = 0
   end subroutine clear

   subroutine release(self)
      class(failure_record), intent(inout) :: self

      if (associated(self%code) .and. .not. self%is_shared) deallocate (self%code)
      nullify (self%code)
   end subroutine release

end module symsde_model_user_failures
