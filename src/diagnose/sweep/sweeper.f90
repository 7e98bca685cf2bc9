! SPDX-License-Identifier: BSD-3-Clause
!> The observer that keeps every step of its block, and after the last one takes covectors back through all of them, or
!> tangent vectors forward.
!>
!> Steps are taken forward by the stepper of the run, with its bits. States, increments and functionals are kept, n + 1
!> states and n steps of a block, and the weights of the two steps that were shown last. At the end of the piece the
!> covectors come from the later piece of the same paths, or are zero; at each saved time the derivatives of f by the
!> state are added.
!>
!> Tangent vectors v <- F_z v + F_theta dtheta grow like exp(lambda t). For Lyapunov exponents they are made orthonormal
!> every few steps, v = Q R, and the logarithms of the diagonal of R are summed.
!>
!> Private to its family.
module symsde_diagnose_sweep_sweeper
   use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
   use symsde_base_functionals, only: functional_set
   use symsde_base_kinds, only: wp, i4, i8
   use symsde_base_lanes, only: padded
   use symsde_base_record, only: step_record, steps_record, step_store, new_step_store
   use symsde_base_status, only: stopped
   use symsde_diagnose_sweep_path_function, only: path_function
   use symsde_ensemble_observe_observer, only: observer_type
   use symsde_model_abstract, only: model_type
   use symsde_step_block_state, only: lane_state
   use symsde_step_linear_choice, only: new_linear_step
   use symsde_step_linear_linear_step, only: linear_step
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: sweep_plan, sweep_observer, numbers_of_step, rest, end_if_stopped

   integer, parameter :: rest = 64   !! no part of a step is left over at multiples of so many steps after a saved time,
                                     !! wherever pieces end: a path has the same bits in any pieces

   !> Data that all threads read, and results, in which each thread writes the rows of its paths.
   type :: sweep_plan
      type(stepper_task), pointer :: task => null()
      class(model_type), pointer :: model => null(), wide => null()
      class(path_function), pointer :: f => null()    !! function f, called here if the piece is the whole run
      integer :: nrate = 0                            !! rates of damping that derivatives are by: none, or all
      logical :: by_position = .false.                !! steps are linearised without the momenta of the path
      type(functional_set) :: asked
      real(wp) :: t0 = 0, h = 0                       !! time of step 0 of the run, and the step [time]
      integer(i8) :: first_path = 0
      integer(i8) :: origin = 0                       !! first step of the run
      integer(i8) :: first = 0                        !! first step of this piece
      integer :: nstep = 0                            !! steps of this piece
      integer(i8) :: total = 0                        !! steps of the run
      integer(i8) :: every = 1                        !! steps between saved times of the run
      real(wp), pointer :: theta(:, :) => null()                      !! parameters (npath or 1, nparameter)
      real(wp), pointer, dimension(:, :, :) :: fq => null(), fp => null() !! df/dq, df/dp unless f is called
                                                                      !! (npath, ndof, 0:nsave)
      real(wp), pointer :: u(:, :) => null(), c(:, :) => null()       !! covectors (npath, nwide), (npath, ndof)
      real(wp), pointer :: value(:) => null()                         !! f (npath)
      integer(i4), pointer, contiguous :: status(:) => null()                     !! (npath)
      integer(i8), pointer, contiguous :: failed_step(:) => null()                !! (npath)
      ! members for tangent vectors, which are taken forward if v is given
      real(wp), pointer :: v(:, :, :) => null()       !! dq, then dp; the last columns belong to parameters
                                                      !! (npath, 2 ndof, nvector)
      integer(i8) :: turn = 0                         !! steps between two decompositions v = Q R; 0 = none
      real(wp), pointer :: logs(:, :) => null()       !! sums of log R_ii (npath, nvector)
      real(wp), pointer, dimension(:, :) :: last_q => null(), last_p => null()  !! last state (npath, ndof)
   end type sweep_plan

   type, extends(observer_type) :: sweep_observer
      type(sweep_plan), pointer :: plan => null()
      class(model_type), pointer, private :: view => null()   !! the model, or a view that knows the paths of a block
      class(linear_step), allocatable, private :: step
      type(step_store), private :: store
      real(wp), allocatable, private :: dw(:, :, :)              !! increments (nlane, nnoise, 0:nstep - 1)
      real(wp), allocatable, private :: q(:, :, :), p(:, :, :)   !! states (nlane, ndof, 0:nstep)
      real(wp), allocatable, private :: u(:, :), c(:, :)
      integer, private :: nlane = 0, nreal = 0
      integer(i8), private :: offset = 0                      !! paths of the run before this block
   contains
      procedure :: begin_block
      procedure :: observe
      procedure :: observe_several
      procedure :: end_block
      procedure :: keeps_steps
      procedure :: keep_steps
      procedure :: see
      procedure :: numbers
      procedure :: failure_code
   end type sweep_observer

contains

   !> Numbers that are kept for each step and lane.
   pure integer function numbers_of_step(plan)
      type(sweep_plan), intent(in) :: plan

      associate (t => plan%model%traits)
         numbers_of_step = merge(t%ndof, 2*t%ndof, plan%by_position) + plan%asked%columns(t%nnoise)
      end associate
   end function numbers_of_step

   subroutine begin_block(self, first, nreal, nlane)
      class(sweep_observer), intent(inout) :: self
      integer(i8), intent(in) :: first
      integer, intent(in) :: nreal, nlane

      associate (plan => self%plan, n => self%plan%model%traits%ndof)
         self%offset = first - plan%first_path
         self%nreal = nreal
         if (.not. allocated(self%q)) then
            self%nlane = padded(nlane)
            allocate (self%q(self%nlane, n, 0:plan%nstep), self%p(self%nlane, n, 0:plan%nstep))
            allocate (self%u(self%nlane, n + size(plan%theta, 2)), self%c(self%nlane, n))
            associate (m => plan%model%traits%nnoise)
               allocate (self%dw(self%nlane, m, 0:plan%nstep - 1))
               call new_step_store(self%store, self%nlane, m, max(2, plan%nstep), plan%h, plan%asked, ring=2)
            end associate
            if (.not. associated(self%view)) self%view => plan%model
            call new_linear_step(self%step, plan%task, self%view, plan%wide, plan%nrate, plan%h, self%nlane)
         end if
      end associate
   end subroutine begin_block

   !> Use this view of the model for its paths.
   subroutine see(self, model)
      class(sweep_observer), intent(inout) :: self
      class(model_type), intent(in), target :: model

      self%view => model
   end subroutine see

   logical function keeps_steps(self)
      class(sweep_observer), intent(in) :: self

      keeps_steps = .true.
   end function keeps_steps

   !> Keep increments and functionals.
   subroutine keep_steps(self, steps, ntaken)
      class(sweep_observer), intent(inout) :: self
      type(steps_record), intent(in) :: steps
      integer, intent(in) :: ntaken
      integer :: i, at, f

      do i = 1, ntaken
         at = int(steps%first - self%plan%first) + i - 1
         call copy_lanes(steps%nlane, self%nlane, steps%nnoise, steps%w(:, 1:, i), self%dw(:, :, at))
         do f = 1, size(steps%of)
            if (.not. self%store%asked%has(f)) cycle
            call copy_lanes(steps%nlane, self%nlane, size(steps%of(f)%x, 2), steps%of(f)%x(:, :, i), &
                            self%store%of(f)%x(:, :, at))
         end do
      end do
   end subroutine keep_steps

   !> Copy columns; lanes beyond the given ones repeat the last.
   pure subroutine copy_lanes(nlane, nto, ncolumn, x, to)
      integer, intent(in) :: nlane, nto, ncolumn
      real(wp), intent(in) :: x(nlane, ncolumn)
      real(wp), intent(out) :: to(nto, ncolumn)
      integer :: k

      do k = 1, ncolumn
         to(:nlane, k) = x(:, k)
         to(nlane + 1:, k) = x(nlane, k)
      end do
   end subroutine copy_lanes

   !> Show step i of the piece; the record is valid until the next but one is shown.
   subroutine show_step(self, i, step)
      type(sweep_observer), intent(inout), target :: self
      integer, intent(in) :: i                !! 0 .. nstep-1
      type(step_record), intent(inout) :: step

      call self%store%show(i, self%plan%t0 + real(self%plan%first + i, wp)*self%plan%h, step)
      step%w(:, 1:) = self%dw(:, :, i)
   end subroutine show_step

   subroutine observe(self, isave, t, state)
      class(sweep_observer), intent(inout) :: self
      integer(i8), intent(in) :: isave
      real(wp), intent(in) :: t
      type(lane_state), intent(inout) :: state

      call copy_lanes(state%nlane, self%nlane, state%ndof, state%q, self%q(:, :, isave))
      if (momenta_are_kept(self%plan, isave)) &
         call copy_lanes(state%nlane, self%nlane, state%ndof, state%p, self%p(:, :, isave))
      if (isave == self%plan%nstep) call go_through(self, state)
   end subroutine observe

   subroutine observe_several(self, isave, nsave, t, nlane, q, p, state)
      class(sweep_observer), intent(inout) :: self
      integer(i8), intent(in) :: isave
      integer, intent(inout) :: nsave
      integer, intent(in) :: nlane
      real(wp), intent(in) :: t(nsave)
      type(lane_state), intent(inout) :: state
      real(wp), intent(in) :: q(nlane, state%ndof, nsave), p(nlane, state%ndof, nsave)
      integer :: k

      do k = 1, nsave
         call copy_lanes(nlane, self%nlane, state%ndof, q(:, :, k), self%q(:, :, isave + k - 1))
         if (momenta_are_kept(self%plan, isave + k - 1)) &
            call copy_lanes(nlane, self%nlane, state%ndof, p(:, :, k), self%p(:, :, isave + k - 1))
      end do
      call state%take_first(nlane, q(1, 1, nsave), p(1, 1, nsave))
      if (isave + nsave - 1 == self%plan%nstep) call go_through(self, state)
   end subroutine observe_several

   !> Whether the momenta behind this step of the piece are read: by the linearised steps, or by f at a saved time.
   pure logical function momenta_are_kept(plan, isave)
      type(sweep_plan), intent(in) :: plan
      integer(i8), intent(in) :: isave

      momenta_are_kept = .not. plan%by_position .or. (associated(plan%f) .and. mod(isave, plan%every) == 0)
   end function momenta_are_kept

   !> After all steps of a block: give the linearised step the parameters of the lanes, and go through the steps.
   subroutine go_through(self, state)
      type(sweep_observer), intent(inout) :: self
      type(lane_state), intent(in) :: state
      real(wp) :: theta(self%nlane, size(self%plan%theta, 2))
      integer(i8) :: status(self%nlane)
      integer :: i, lane

      associate (plan => self%plan)
         status(:state%nlane) = state%status
         status(state%nlane + 1:) = state%status(state%nlane)
         do i = 1, size(theta, 2)
            do lane = 1, self%nlane
               theta(lane, i) = plan%theta(min(self%offset + min(lane, self%nreal), size(plan%theta, 1, i8)), i)
            end do
         end do
         call self%step%set_parameters(theta)
         if (associated(plan%v)) then
            call go_forth(self, status)
         else
            call go_back(self, theta, status)
         end if
         do lane = 1, self%nreal
            plan%status(self%offset + lane) = int(status(lane), i4)
         end do
      end associate
   end subroutine go_through

   !> Take the tangent vectors of the block from the beginning of the piece to its end. Columns beyond 2 ndof are
   !> derivatives by parameters; for Lyapunov exponents there are none.
   subroutine go_forth(self, status)
      type(sweep_observer), intent(inout) :: self
      integer(i8), intent(inout) :: status(self%nlane)
      type(step_record) :: step
      real(wp), allocatable :: vq(:, :, :), vp(:, :, :), logs(:, :)
      integer(i8) :: n
      integer :: j, k, m

      associate (plan => self%plan, ndof => self%plan%model%traits%ndof, &
                 nrow => self%plan%model%traits%ndof + size(self%plan%theta, 2), &
                 a => self%offset + 1, b => self%offset + self%nreal)
         m = size(plan%v, 3)
         allocate (vq(self%nlane, nrow, m), vp(self%nlane, ndof, m), logs(self%nlane, m), source=0.0_wp)
         vq(:self%nreal, :ndof, :) = plan%v(a:b, :ndof, :)
         vp(:self%nreal, :, :) = plan%v(a:b, ndof + 1:, :)
         logs(:self%nreal, :) = plan%logs(a:b, :)   ! goes on with the sum from the beginning of the run
         do j = 1, nrow - ndof
            vq(:, ndof + j, m - (nrow - ndof) + j) = 1
         end do
         do k = 1, plan%nstep
            call show_step(self, k - 1, step)
            call self%step%forth(step, self%q(:, :, k - 1), self%p(:, :, k - 1), self%q(:, :, k), self%p(:, :, k), m, &
                                 vq, vp, status)
            if (plan%turn == 0) cycle
            n = plan%first - plan%origin + k
            if (mod(n, plan%turn) == 0 .or. n == plan%total) call decompose(self%nlane, ndof, nrow, m, vq, vp, logs)
         end do
         plan%v(a:b, :ndof, :) = vq(:self%nreal, :ndof, :)
         plan%v(a:b, ndof + 1:, :) = vp(:self%nreal, :, :)
         plan%logs(a:b, :) = logs(:self%nreal, :)
      end associate
   end subroutine go_forth

   !> v = Q R by Gram and Schmidt, twice for each vector: v becomes Q, and log R_ii is added to logs. A vector that
   !> vanishes has the logarithm -infinity, and its lane is NaN from there on.
   pure subroutine decompose(nlane, ndof, nwide, m, vq, vp, logs)
      integer, intent(in) :: nlane, ndof, nwide, m
      real(wp), intent(inout) :: vq(nlane, nwide, m), vp(nlane, ndof, m), logs(nlane, m)
      real(wp) :: r(nlane)
      integer :: i, j, k, again

      do j = 1, m
         do again = 1, 2
            do i = 1, j - 1
               r = 0
               do k = 1, ndof
                  r = r + vq(:, k, i)*vq(:, k, j) + vp(:, k, i)*vp(:, k, j)
               end do
               do k = 1, ndof
                  vq(:, k, j) = vq(:, k, j) - r*vq(:, k, i)
                  vp(:, k, j) = vp(:, k, j) - r*vp(:, k, i)
               end do
            end do
         end do
         r = 0
         do k = 1, ndof
            r = r + vq(:, k, j)**2 + vp(:, k, j)**2
         end do
         r = sqrt(r)
         !GCC$ novector  ! the last bits of a vector logarithm depend on the width of registers
         do k = 1, nlane
            logs(k, j) = logs(k, j) + log(r(k))
         end do
         do k = 1, ndof
            vq(:, k, j) = vq(:, k, j)/r
            vp(:, k, j) = vp(:, k, j)/r
         end do
      end do
   end subroutine decompose

   !> Take the covectors of the block from the end of the piece to its beginning.
   subroutine go_back(self, theta, status)
      type(sweep_observer), intent(inout) :: self
      real(wp), intent(in) :: theta(:, :)                 !! (nlane, nparameter)
      integer(i8), intent(inout) :: status(self%nlane)
      type(step_record) :: step
      integer(i8) :: n
      real(wp), allocatable :: fq(:, :, :), fp(:, :, :)   !! (nreal, ndof, saved times of the piece)
      logical :: taken
      integer :: k, low   !! the last state to which steps are taken back at once

      associate (plan => self%plan, offset => self%offset, nreal => self%nreal)
         self%u = 0
         self%c = 0
         if (associated(plan%f)) then
            call ask_f(self, theta, fq, fp)
         else
            self%u(:nreal, :) = plan%u(offset + 1:offset + nreal, :)
            self%c(:nreal, :) = plan%c(offset + 1:offset + nreal, :)
         end if
         k = plan%nstep
         do
            n = plan%first - plan%origin + k   ! steps from the beginning of the run
            if (k < plan%nstep .and. rests(n)) &
               call self%step%settle(self%q(:, :, k), self%p(:, :, k), self%u, self%c)
            if (mod(n, plan%every) == 0 .and. (k > 0 .or. n == 0)) then
               if (allocated(fq)) then
                  call add_seeds(fq(:, :, n/plan%every), fp(:, :, n/plan%every), 0_i8)
               else
                  call add_seeds(plan%fq(:, :, n/plan%every), plan%fp(:, :, n/plan%every), offset)
               end if
            end if
            if (k == 0) exit
            taken = .false.
            if (k == plan%nstep .or. rests(n)) then
               low = k - 1
               do while (low > 0 .and. .not. rests(plan%first - plan%origin + low))
                  low = low - 1
               end do
               call self%step%take_back(low, k, plan%nstep, plan%t0 + real(plan%first + low, wp)*plan%h, plan%h, &
                                        self%dw, self%q, self%u, self%c, taken)
            end if
            if (taken) then
               k = low
            else
               call show_step(self, k - 1, step)
               call self%step%back(step, self%q(:, :, k - 1), self%p(:, :, k - 1), self%q(:, :, k), self%p(:, :, k), &
                                   self%u, self%c, status)
               k = k - 1
            end if
         end do
         plan%u(offset + 1:offset + nreal, :) = self%u(:nreal, :)
         plan%c(offset + 1:offset + nreal, :) = self%c(:nreal, :)
      end associate

   contains

      !> Whether no part of a step is left over at this step of the run.
      pure logical function rests(at)
         integer(i8), intent(in) :: at

         rests = mod(mod(at, self%plan%every), int(rest, i8)) == 0
      end function rests

      !> Add df/dq and df/dp of one saved time.
      subroutine add_seeds(rows_q, rows_p, before)
         real(wp), intent(in) :: rows_q(:, :), rows_p(:, :)   !! rows of this block are before + 1 ..
         integer(i8), intent(in) :: before
         integer :: j, l

         do j = 1, size(rows_q, 2)
            do l = 1, self%nreal
               self%u(l, j) = self%u(l, j) + rows_q(before + l, j)
               self%c(l, j) = self%c(l, j) + rows_p(before + l, j)
            end do
         end do
      end subroutine add_seeds

   end subroutine go_back

   !> Values of f, and its derivatives by the saved states and by parameters, for a piece that is the whole run.
   subroutine ask_f(self, theta, fq, fp)
      type(sweep_observer), intent(inout) :: self
      real(wp), intent(in) :: theta(:, :)                         !! (nlane, nparameter)
      real(wp), allocatable, intent(out) :: fq(:, :, :), fp(:, :, :)  !! (nreal, ndof, 0:nsave)
      real(wp), allocatable :: q(:, :, :), p(:, :, :), t(:), ftheta(:, :)
      integer :: nsave, k, at

      associate (plan => self%plan, n => self%plan%model%traits%ndof, nreal => self%nreal, offset => self%offset)
         nsave = int(plan%nstep/plan%every)
         allocate (q(nreal, n, 0:nsave), p(nreal, n, 0:nsave), t(0:nsave), ftheta(nreal, size(theta, 2)))
         allocate (fq(nreal, n, 0:nsave), fp(nreal, n, 0:nsave))
         do k = 0, nsave
            at = int(k*plan%every)
            t(k) = plan%t0 + real(plan%first + at, wp)*plan%h
            q(:, :, k) = self%q(:nreal, :, at)
            p(:, :, k) = self%p(:nreal, :, at)
         end do
         call plan%f%find(plan%first_path + offset, nreal, n, nsave + 1, size(theta, 2), t, q, p, &
                          plan%value(offset + 1:offset + nreal), fq, fp, ftheta)
         self%u(:nreal, n + 1:) = ftheta
      end associate
   end subroutine ask_f

   subroutine end_block(self, state)
      class(sweep_observer), intent(inout) :: self
      type(lane_state), intent(in) :: state
      integer :: lane

      associate (plan => self%plan)
         do lane = 1, self%nreal
            associate (path => self%offset + lane)
               if (state%status(lane) /= 0) plan%status(path) = int(state%status(lane), i4)
               plan%failed_step(path) = state%failed_step(lane)
               if (plan%status(path) /= 0) call forget(plan, path)
               if (.not. associated(plan%v)) cycle
               plan%last_q(path, :) = state%q(lane, :)
               plan%last_p(path, :) = state%p(lane, :)
            end associate
         end do
      end associate
   end subroutine end_block

   !> NaN in the results of a path.
   subroutine forget(plan, path)
      type(sweep_plan), intent(inout) :: plan
      integer(i8), intent(in) :: path
      real(wp) :: nan

      nan = ieee_value(1.0_wp, ieee_quiet_nan)
      if (associated(plan%v)) then
         plan%v(path, :, :) = nan
         plan%logs(path, :) = nan
      else
         plan%value(path) = nan
         plan%u(path, :) = nan
         plan%c(path, :) = nan
      end if
   end subroutine forget

   !> End a run that was stopped in a piece: no path has results, and paths that are ok are stopped, too. A further
   !> piece would resume them.
   subroutine end_if_stopped(plan, next, nstopped)
      type(sweep_plan), intent(inout) :: plan
      integer(i8), intent(in) :: next             !! step behind the piece
      integer(i8), intent(inout) :: nstopped      !! number of stopped paths
      integer(i8) :: path

      if (.not. any(plan%status == stopped)) return
      do path = 1, size(plan%status)
         call forget(plan, path)
         if (plan%status(path) /= 0) cycle
         plan%status(path) = stopped
         plan%failed_step(path) = next
      end do
      nstopped = count(plan%status == stopped)
   end subroutine end_if_stopped

   real(wp) function numbers(self, npath, nthread)
      class(sweep_observer), intent(in) :: self
      integer(i8), intent(in) :: npath
      integer, intent(in) :: nthread
      real(wp) :: lanes

      lanes = min(256.0_wp, real(npath, wp) + 7)
      numbers = nthread*lanes*(real(self%plan%nstep, wp) + 1)*numbers_of_step(self%plan)
   end function numbers

   integer function failure_code(self) result(code)
      class(sweep_observer), intent(in) :: self

      code = 0
      if (associated(self%plan%f)) code = self%plan%f%failure_code()
   end function failure_code

end module symsde_diagnose_sweep_sweeper
