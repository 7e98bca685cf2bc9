! SPDX-License-Identifier: BSD-3-Clause
!>    drift = max_n |I(q_n, p_n)/I(q_0, p_0) - 1|,      I = p.p + q.q  or  I = H(t, q, p)
!>
!> Invariants along saved paths: their values and their drift. dI = {I,H} dt + sum_k {I,H_k} o dW_k vanishes for I = p.p
!> + q.q on Kubo's oscillator, and for I = H if every {H,H_k} vanishes.
module symsde_diagnose_invariants
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use symsde_base_kinds, only: wp
   use symsde_base_status, only: error_type, raise, missing_operation, wrong_shape
   use symsde_base_text, only: to_text
   use symsde_model_abstract, only: model_type
   implicit none
   private
   public :: invariant_drift, quadratic_invariant, energy

contains

   !> drift(path) = max over the times of |I/I_0 - 1|. NaN for paths that failed or that begin with I_0 = 0.
   pure function invariant_drift(values) result(drift)
      real(wp), intent(in) :: values(:, :)    !! I along the paths (npath, ntime)
      real(wp) :: drift(size(values, 1))
      real(wp) :: change
      integer :: path, n

      drift = 0
      do path = 1, size(values, 1)
         do n = 1, size(values, 2)
            change = abs(values(path, n)/values(path, 1) - 1)
            ! A NaN change is not skipped here: it ends the search along the path, and is the result.
            if (change <= drift(path)) cycle
            drift(path) = change
            if (change <= huge(change)) cycle
            drift(path) = ieee_value(change, ieee_quiet_nan)
            exit
         end do
      end do
   end function invariant_drift

   !> values(path, n) = p.p + q.q, the invariant of the Kubo oscillator [WHSB] (35)-(36), an example of (24).
   pure function quadratic_invariant(q, p) result(values)
      real(wp), intent(in) :: q(:, :, :), p(:, :, :)   !! saved paths (npath, ndof, ntime)
      real(wp) :: values(size(q, 1), size(q, 3))

      values = sum(p**2 + q**2, dim=2)
   end function quadratic_invariant

   !> values(path, n) = H(q, p) at the saved times. Errors: missing_operation if the model has no value; wrong_shape.
   subroutine energy(model, t, q, p, values, error)
      class(model_type), intent(in) :: model
      real(wp), intent(in) :: t(:)                     !! saved times (ntime)
      real(wp), intent(in) :: q(:, :, :), p(:, :, :)   !! saved paths (npath, ndof, ntime)
      real(wp), intent(out) :: values(:, :)            !! (npath, ntime)
      type(error_type), allocatable, intent(inout) :: error
      real(wp), allocatable :: w(:, :), qn(:, :), pn(:, :), value(:)
      integer :: n

      call model%refuse_paths('energy', 'the energy', error)
      if (allocated(error)) return
      if (.not. model%traits%has_value) then
         call raise(error, missing_operation, 'energy', 'the model has gradients only: give it '// &
                    'the value of its Hamiltonians to see its energy')
         return
      else if (size(q, 1) /= size(values, 1) .or. size(q, 2) /= model%traits%ndof .or. &
               size(q, 3) /= size(t) .or. size(values, 2) /= size(t) .or. &
               any(shape(p) /= shape(q))) then
         call raise(error, wrong_shape, 'energy', 'q, p and values do not belong together: '// &
                    'needed are q and p (npath,'//to_text(model%traits%ndof)//','// &
                    to_text(size(t))//') and values (npath,'//to_text(size(t))//')')
         return
      end if
      allocate (w(size(q, 1), 0:model%traits%nnoise), source=0.0_wp)
      ! The weights choose H alone among H, H_1 .. H_m; all paths are lanes of one call.
      w(:, 0) = 1
      allocate (value(size(q, 1)))
      associate (npath => size(q, 1), ndof => size(q, 2), nnoise => model%traits%nnoise)
         ! H may depend on time: each saved time is a call of its own.
         do n = 1, size(t)
            qn = q(:, :, n)
            pn = p(:, :, n)
            call model%value(npath, ndof, nnoise, t(n), w, qn, pn, value)
            values(:, n) = value
         end do
      end associate
   end subroutine energy

end module symsde_diagnose_invariants
