! SPDX-License-Identifier: BSD-3-Clause
!> The contract of noise sources (noise/source), at both ends of `fill`.
!>
!> Required: source, request and store agree in lanes and noises; every lane has a path, and padding has that of the
!> last real lane; the store has room for the steps. Promised, unless an interrupt is wanted: increments and functionals
!> of these steps are finite, padding repeats them, and the first weight is h.
module symsde_noise_contract
   use symsde_base_contracts, only: require, require_finite, require_padded
   use symsde_base_functionals, only: nfunctional
   use symsde_base_interrupt, only: interrupt_type
   use symsde_base_record, only: step_request, step_store
   use symsde_noise_source, only: noise_type
   implicit none
   private
   public :: require_request, require_filled

   character(*), parameter :: place = 'noise, fill'

contains

   !> Requirements of a source on its arguments.
   subroutine require_request(noise, request, store)
      class(noise_type), intent(in) :: noise
      type(step_request), intent(in) :: request
      type(step_store), intent(in) :: store

      call require(request%nlane == store%nlane .and. noise%nnoise == store%nnoise, place, &
                   'request, source and store have the same lanes and noises')
      call require(request%nreal >= 1 .and. request%nreal <= request%nlane, place, 'real lanes are 1 to nlane')
      call require(size(request%path) == request%nlane, place, 'every lane has a path')
      call require(all(request%path(request%nreal:) == request%path(request%nreal)), place, &
                   'paths of padding repeat that of the last real lane')
      call require(all(request%path >= 0), place, 'paths are counted from 0')
      call require(request%pair >= 0 .and. request%npair >= 1 .and. 2*request%npair <= store%capacity, place, &
                   'pairs are counted from 0 and fit into the store')
   end subroutine require_request

   !> Promises of a source to its callers, for the steps first .. last of the store.
   subroutine require_filled(noise, request, store, first, last, interrupt)
      class(noise_type), intent(in) :: noise
      type(step_request), intent(in) :: request
      type(step_store), intent(in) :: store
      integer, intent(in) :: first, last
      class(interrupt_type), intent(in), optional :: interrupt
      integer :: i, f, n

      if (present(interrupt)) then
         if (interrupt%wanted) return
      end if
      do i = first, last
         call require(.not. any(abs(store%w(:, 0, i) - store%h) > 0), place, 'the first weight of a step is h')
         call require_finite(size(store%w(:, :, i)), store%w(:, :, i), place, 'weights')
         call require_padded(request%nlane, request%nreal, noise%nnoise + 1, store%w(:, :, i), place, 'weights')
         do f = 1, nfunctional
            if (.not. noise%asked%has(f)) cycle
            n = size(store%of(f)%x, 2)
            call require_finite(n*request%nlane, store%of(f)%x(:, :, i), place, 'functionals')
            call require_padded(request%nlane, request%nreal, n, store%of(f)%x(:, :, i), place, 'functionals')
         end do
      end do
   end subroutine require_filled

end module symsde_noise_contract
