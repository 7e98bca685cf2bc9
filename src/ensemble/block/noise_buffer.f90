! SPDX-License-Identifier: BSD-3-Clause
!> The inputs of the steps of a block: increments dW_k and functionals of the path (dZ, areas), drawn several pairs of
!> steps ahead, and shown to the stepper as many steps at a time as it takes.
!>
!> A source is asked for pairs of steps, since the words of one draw give the normals of both. Every draw is numbered by
!> path and step: how far ahead a block draws, and where it began, changes nothing.
!>
!> The store holds the pairs request%pair .. request%pair + nahead - 1, that is the steps
!>
!>    2 request%pair  ..  2 (request%pair + nahead) - 1,
!>
!> counted from the beginning of the run. The runner requests a step (draw), asks how many are available from it on
!> (left), and shows them to the stepper as pointers into the store (show).
module symsde_ensemble_block_noise_buffer
   use symsde_base_functionals, only: functional_set
   use symsde_base_interrupt, only: interrupt_type
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: steps_record, step_store, step_request, describe_step_store
   use symsde_ensemble_block_ahead, only: pairs_ahead, pairs_of
   use symsde_noise_source, only: noise_type
   implicit none
   private
   public :: noise_buffer, new_noise_buffer

   !> The noise of one block: its paths, and the increments and functionals drawn for them.
   type :: noise_buffer
      class(noise_type), pointer :: noise => null()
      type(step_request) :: request        !! paths of the block, and the pairs of steps in the store
      type(step_store) :: store            !! increments and functionals; allocated by the first draw
      integer(i8) :: normals_of_pair = 0   !! normals drawn for one path in a pair of steps
      integer, private :: nahead = 0, npair = 1       !! number of pairs in the store, and its capacity
   contains
      procedure :: begin
      procedure :: draw
      procedure :: left
      procedure :: show
   end type noise_buffer

contains

   !> Make a buffer for blocks of nlane lanes, with nnoise noises, nstep steps a run, and the functionals `asked`
   !> beside increments. The first draw allocates the store, in the thread that uses it.
   subroutine new_noise_buffer(self, nlane, nnoise, nstep, h, asked)
      type(noise_buffer), intent(inout) :: self
      integer, intent(in) :: nlane, nnoise
      integer(i8), intent(in) :: nstep
      real(wp), intent(in) :: h                      !! step with its sign [time]
      type(functional_set), intent(in) :: asked

      self%npair = pairs_of(nstep, pairs_ahead(nlane, asked%columns(nnoise)))
      call describe_step_store(self%store, nlane, nnoise, 2*self%npair, h, asked)
      self%request%nlane = nlane
      allocate (self%request%path(nlane))
   end subroutine new_noise_buffer

   !> Begin a block of these paths, the first nreal of them real. Draws of an earlier block are dropped; nothing is
   !> drawn yet.
   subroutine begin(self, nreal, path)
      class(noise_buffer), intent(inout) :: self
      integer, intent(in) :: nreal
      integer(i8), intent(in) :: path(self%request%nlane)

      self%nahead = 0
      self%request%nreal = nreal
      self%request%path = path
   end subroutine begin

   !> Make sure that the store holds `step`. If it does not, draw its pair and the pairs that follow. They begin
   !> with an even pair, since a draw of the generator serves two. Pairs past the end of the run are not drawn. If
   !> the interrupt is raised, the store counts as empty.
   subroutine draw(self, step, nstep, interrupt)
      class(noise_buffer), intent(inout) :: self
      integer(i8), intent(in) :: step, nstep       !! absolute step, from 0; the step at which the run ends
      class(interrupt_type), intent(inout), optional :: interrupt
      integer(i8) :: pair, drawn

      pair = step/2
      if (self%nahead > 0 .and. pair < self%request%pair + self%nahead) return
      ! Begin with an even pair; where only one pair fits, with the pair of `step`.
      self%request%pair = pair - mod(pair, min(2_i8, int(self%npair, i8)))
      ! The last pair of the run may be half used.
      self%nahead = int(min(int(self%npair, i8), (nstep - 1)/2 - self%request%pair + 1))
      self%request%npair = self%nahead
      drawn = 0
      call self%store%make_room()
      ! Without noises only the weight h drives a step, which the store has from the beginning.
      if (self%noise%nnoise > 0) call self%noise%fill(self%request, self%store, drawn, interrupt)
      if (present(interrupt)) then
         if (interrupt%wanted) then
            self%nahead = 0
            return  ! an interrupted draw has no count for a pair
         end if
      end if
      self%normals_of_pair = drawn/self%nahead
   end subroutine draw

   !> Number of steps in the store from this step on.
   pure integer(i8) function left(self, step)
      class(noise_buffer), intent(in) :: self
      integer(i8), intent(in) :: step

      left = 2*(self%request%pair + self%nahead) - step
   end function left

   !> Point `steps` to nstep steps of the store, beginning with `step` at time t. Nothing is copied.
   subroutine show(self, step, nstep, t, steps)
      class(noise_buffer), intent(in) :: self
      integer(i8), intent(in) :: step
      integer, intent(in) :: nstep
      real(wp), intent(in) :: t
      type(steps_record), intent(inout) :: steps

      call self%store%show_several(int(step - 2*self%request%pair), nstep, t, steps)
      steps%first = step
   end subroutine show

end module symsde_ensemble_block_noise_buffer
