! SPDX-License-Identifier: BSD-3-Clause
!> The probe of the whole steps that a user's model defines: near the initial state they must agree with the library's
!> steps.
!>
!> Starts are displaced from the initial state by a hundredth of one. In units of atoms that is no small displacement:
!> where paths leave from there, q and p are displaced by a hundredth of the size that they reach from the initial state
!> itself, if this is far below one. Gaps are relative to these units.
!>
!> Four steps of eight paths are compared with those of the oracle, to about the square root of rounding, and with
!> themselves, bit for bit, requested one by one, two by two and all at once. If the model fails in a lane, which a run
!> would then rescue, nothing is compared.
!>
!> Equations of a stiff step may have several roots, and the two sides may have found different ones. So if the results
!> are far apart, the comparison is repeated with shorter steps, which have fewer roots, and in which a fault would
!> still show. So it is where rounding explains the gap, as at angles so large that their last digits move the force:
!> where the oracle's own steps, from states a few units of rounding away, are not much closer. Like every probe this
!> one can refute, not prove.
module symsde_step_flow_probe
   use symsde_base_functionals, only: nfunctional
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lanes, only: lane_unit
   use symsde_base_record, only: step_record, steps_record, step_store, new_step_store
   use symsde_base_sincos, only: sine_of
   use symsde_base_status, only: error_type, raise, false_trait
   use symsde_base_text, only: to_text
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: scheme_type
   use symsde_step_stepper, only: stepper_type
   use symsde_step_flow_model_flow, only: model_flow_stepper
   implicit none
   private
   public :: probe_flow, probe_lanes

   integer, parameter :: probe_lanes = lane_unit, nlane = probe_lanes, nstep = 4
   real(wp), parameter :: tolerance = 1e-8_wp  !! relative to the size of a state: iterations may stop early
   real(wp), parameter :: apart = 1e-3_wp      !! relative gap of two roots, or of a fault that shows at an eighth of it
   integer, parameter :: most_shorter = 2      !! how many times the step is divided by eight
   real(wp), parameter :: moved = 1 + 4*epsilon(1.0_wp)  !! factor of states a few units of rounding away
   real(wp), parameter :: closer = 1e-2_wp     !! part of a gap that rounding does not explain, at most
   real(wp), parameter :: small = 1e-3_wp      !! size of q or p below which it is the unit, and not one

   !> A start, and the units of q and p near it.
   type :: place
      real(wp), allocatable :: q(:), p(:)
      real(wp) :: of_q, of_p
   end type place

contains

   !> Refuse whole steps that are not the scheme's (false_trait). `decided` is true if something was compared.
   subroutine probe_flow(whole, oracle, model, scheme, t, h, q0, p0, error, decided)
      type(model_flow_stepper), intent(inout) :: whole
      class(stepper_type), allocatable, intent(inout) :: oracle  !! like `whole`; may be unallocated
      class(model_type), intent(in), target :: model
      type(scheme_type), intent(in) :: scheme
      real(wp), intent(in) :: t, h, q0(:), p0(:)
      type(error_type), allocatable, intent(inout) :: error
      logical, intent(out) :: decided
      type(step_store) :: store
      type(place) :: start
      real(wp), dimension(nlane, size(q0), nstep) :: q, p, q1, p1
      real(wp) :: gap, shorter
      integer :: k
      logical :: comparable, rounded

      decided = .false.
      call draw(store, model, scheme, h)
      start = place(q0, p0, 1.0_wp, 1.0_wp)
      call take_near(whole, store, t, start, q, p, comparable)
      if (.not. comparable) return
      call take(whole, store, t, start, 1, q1, p1, comparable)
      if (.not. (same(q, q1) .and. same(p, p1))) call refuse('one by one')
      call take(whole, store, t, start, 2, q1, p1, comparable)
      if (.not. (same(q, q1) .and. same(p, p1))) call refuse('two by two')
      if (allocated(error) .or. .not. allocated(oracle)) return
      call take_plain(oracle, store, t, start, 1.0_wp, q1, p1, comparable)
      if (.not. comparable) return
      gap = gap_of(q1, q, start%of_q) + gap_of(p1, p, start%of_p)
      rounded = is_rounding(q1, p1)
      shorter = h
      do k = 1, most_shorter
         if (.not. (gap > apart .or. rounded)) exit
         shorter = shorter/8
         call compare_shorter(shorter)
         if (.not. (comparable .and. gap > tolerance)) return  ! the roots differ, or comparison was impossible
      end do
      if (rounded) return
      decided = .true.
      if (gap <= tolerance) return
      call tell(q1, q, start%of_q, 'q')
      call tell(p1, p, start%of_p, 'p')

   contains

      !> Refuse steps whose bits depend on how many are requested at a time.
      subroutine refuse(how)
         character(*), intent(in) :: how

         if (allocated(error)) return
         call raise(error, false_trait, 'probe_flow', 'the whole steps of scheme '//scheme%name//" that model '"// &
                    model%name//"' defines have other bits "//how//' than all at once: let each step depend on the '// &
                    'state before it and on its own increments alone')
      end subroutine refuse

      !> Find the gap at a shorter step, in separate arrays: the message gives the states of the run's step.
      subroutine compare_shorter(h)
         real(wp), intent(in) :: h
         real(wp), dimension(nlane, size(q0), nstep) :: x, y, x1, y1

         call draw(store, model, scheme, h)
         call take(whole, store, t, start, nstep, x, y, comparable)
         if (comparable) call take_plain(oracle, store, t, start, 1.0_wp, x1, y1, comparable)
         if (.not. comparable) return
         gap = gap_of(x1, x, start%of_q) + gap_of(y1, y, start%of_p)
         rounded = is_rounding(x1, y1)
      end subroutine compare_shorter

      !> Whether a gap beyond the tolerance is one of rounding, by the oracle's states and those from states nearby.
      logical function is_rounding(x, y)
         real(wp), intent(in) :: x(:, :, :), y(:, :, :)
         real(wp), dimension(nlane, size(q0), nstep) :: x1, y1
         logical :: solved

         is_rounding = .false.
         if (.not. gap > tolerance) return
         call take_plain(oracle, store, t, start, moved, x1, y1, solved)
         if (solved) is_rounding = gap_of(x, x1, start%of_q) + gap_of(y, y1, start%of_p) > closer*gap
      end function is_rounding

      !> Refuse the component that differs most from the library's, if one is beyond the tolerance; NaN counts as beyond
      !> it.
      subroutine tell(right, given, unit, what)
         real(wp), intent(in) :: right(:, :, :), given(:, :, :), unit
         character(*), intent(in) :: what
         integer :: at(3)

         if (allocated(error)) return
         if (all(abs(given - right) <= tolerance*(unit + maxval(abs(right))))) return
         at = maxloc(abs(given - right), mask=.not. abs(given - right) <= tolerance*(unit + maxval(abs(right))))
         if (any(at == 0)) at = 1
         call raise(error, false_trait, 'probe_flow', 'the whole steps of scheme '//scheme%name//" that model '"// &
                    model%name//"' defines are not those of the library: near the initial state they give "//what// &
                    '_'//to_text(at(2))//' = '//to_text(given(at(1), at(2), at(3)))//' after '//to_text(at(3))// &
                    ' steps, and not '//to_text(right(at(1), at(2), at(3)))//': mend them, or leave them out')
      end subroutine tell

   end subroutine probe_flow

   !> Fill the store with increments of the size in a run, and with functionals of similar size. They need not have any
   !> law, since both sides get the same numbers.
   subroutine draw(store, model, scheme, h)
      type(step_store), intent(out) :: store
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme
      real(wp), intent(in) :: h
      integer :: i, k, s, f

      call new_step_store(store, nlane, model%traits%nnoise, nstep, h, scheme%asks%needed_for(model%traits))
      do s = 0, nstep - 1
         do k = 1, model%traits%nnoise
            store%w(:, k, s) = sqrt(abs(h))*[(sine_of(1.0_wp + i + 3*k + 11*s), i=1, nlane)]
         end do
         do f = 1, nfunctional
            if (.not. store%asked%has(f)) cycle
            do k = 1, size(store%of(f)%x, 2)
               store%of(f)%x(:, k, s) = 0.1_wp*abs(h)**1.5_wp*[(sine_of(2.0_wp + i + 5*k + 13*s), i=1, nlane)]
            end do
         end do
      end do
   end subroutine draw

   !> Compute the states after each step by the model's flow, all at once, from a start whose units are found: one, if
   !> paths from there stay near it.
   subroutine take_near(stepper, store, t, start, q, p, comparable)
      type(model_flow_stepper), intent(inout) :: stepper
      type(step_store), intent(in) :: store
      real(wp), intent(in) :: t
      type(place), intent(inout) :: start
      real(wp), intent(out) :: q(:, :, :), p(:, :, :)
      logical, intent(out) :: comparable

      call take(stepper, store, t, start, nstep, q, p, comparable)
      if (comparable .and. stays(q, start%q) .and. stays(p, start%p)) return
      call take(stepper, store, t, place(start%q, start%p, 0.0_wp, 0.0_wp), nstep, q, p, comparable)
      start%of_q = unit_of(q, start%q, comparable)
      start%of_p = unit_of(p, start%p, comparable)
      call take(stepper, store, t, start, nstep, q, p, comparable)
   end subroutine take_near

   !> Compute the states after each step by the model's flow, n steps per call. They are not comparable if it fails in a
   !> lane.
   subroutine take(stepper, store, t, start, n, q, p, comparable)
      type(model_flow_stepper), intent(inout) :: stepper
      type(step_store), intent(in), target :: store
      type(place), intent(in) :: start
      real(wp), intent(in) :: t
      integer, intent(in) :: n
      real(wp), intent(out) :: q(:, :, :), p(:, :, :)
      logical, intent(out) :: comparable
      type(steps_record) :: steps
      real(wp), dimension(nlane, size(start%q)) :: x, y
      real(wp), dimension(nlane, size(start%q), n) :: xn, yn
      integer(i8) :: status(nlane)
      integer :: first

      call begin(start, x, y)
      status = 0
      steps%every = 1
      steps%nreal = nlane
      steps%max_iter = stepper%max_iter
      do first = 1, nstep, n
         call store%show_several(first - 1, n, t + (first - 1)*store%h, steps)
         call stepper%flow(steps, x, y, xn, yn, status)
         q(:, :, first:first + n - 1) = xn
         p(:, :, first:first + n - 1) = yn
         x = xn(:, :, n)
         y = yn(:, :, n)
      end do
      comparable = all(status == 0)
   end subroutine take

   !> Compute the same states by the oracle, from initial states times a factor. They are not comparable if it finds no
   !> solution.
   subroutine take_plain(stepper, store, t, start, factor, q, p, comparable)
      class(stepper_type), intent(inout) :: stepper
      type(step_store), intent(in), target :: store
      type(place), intent(in) :: start
      real(wp), intent(in) :: t, factor
      real(wp), intent(out) :: q(:, :, :), p(:, :, :)
      logical, intent(out) :: comparable
      type(step_record) :: step
      real(wp), dimension(nlane, size(start%q)) :: x, y, dx, dy
      integer(i8) :: status(nlane)
      integer :: s

      call begin(start, x, y)
      x = factor*x
      y = factor*y
      status = 0
      do s = 1, nstep
         call store%show(s - 1, t + (s - 1)*store%h, step)
         call stepper%increment(step, x, y, dx, dy, status)
         x = x + dx
         y = y + dy
         q(:, :, s) = x
         p(:, :, s) = y
      end do
      comparable = all(status == 0) .and. all(abs(q) <= huge(q)) .and. all(abs(p) <= huge(p))
   end subroutine take_plain

   !> Eight states near the initial state.
   pure subroutine begin(start, x, y)
      type(place), intent(in) :: start
      real(wp), intent(out) :: x(:, :), y(:, :)
      integer :: i, lane

      do i = 1, size(start%q)
         do lane = 1, nlane
            x(lane, i) = start%q(i) + 0.01_wp*start%of_q*sine_of(real(lane + 3*i, wp))
            y(lane, i) = start%p(i) + 0.01_wp*start%of_p*sine_of(real(lane + 5*i + 2, wp))
         end do
      end do
   end subroutine begin

   !> Whether states stay as near to the start as the probe assumes.
   pure logical function stays(x, start)
      real(wp), intent(in) :: x(:, :, :), start(:)

      stays = all(abs(x) <= 10*(1 + maxval(abs(start))))
   end function stays

   !> The unit of states: one, or their largest size, which the start has, too, where it is known and far below one.
   pure real(wp) function unit_of(x, start, known)
      real(wp), intent(in) :: x(:, :, :), start(:)
      logical, intent(in) :: known

      unit_of = 1
      if (.not. (known .and. all(abs(x) < small) .and. all(abs(start) < small))) return
      unit_of = max(maxval(abs(x)), maxval(abs(start)))
      if (.not. unit_of > 0) unit_of = 1
   end function unit_of

   !> The largest distance between two sets of states, relative to the largest number of the right ones plus one unit;
   !> NaN if one of the states holds NaN, which maxval ignores with some compilers.
   pure real(wp) function gap_of(right, given, unit)
      real(wp), intent(in) :: right(:, :, :), given(:, :, :), unit

      gap_of = maxval(abs(given - right))/(unit + maxval(abs(right))) + 0*sum(given - right)
   end function gap_of

   !> Whether two sets of states have the same bits.
   pure logical function same(a, b)
      real(wp), intent(in) :: a(:, :, :), b(:, :, :)

      same = all(transfer(a, 1_i8, size(a)) == transfer(b, 1_i8, size(b)))
   end function same

end module symsde_step_flow_probe
