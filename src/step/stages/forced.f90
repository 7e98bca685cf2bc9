! SPDX-License-Identifier: BSD-3-Clause
!> Implicit stages of many unknowns under forces, for any tableau: the equations of step/oracle/general, solved without
!> its dense matrix.
!>
!>    F_i = Hhat_p(Q_i, P_i),   G_i = -Hhat_q(Q_i, P_i) + Fhat(Q_i, P_i)
!>
!> Sweeps through the stages come first, each with the newest slopes of the others: they need no derivatives, and
!> contract where h times the frequencies and the rates of the forces are small. Lanes that do not contract are solved
!> by Newton's iteration from zero. Where Hessians and forces have bands, the unknowns are sorted by degrees of freedom,
!> all slopes of the first one before those of the second, so that the matrix has bands, too: with s slopes for each
!> degree of freedom and b bands on either side of a block, s (b + 1) - 1 of them on either side. Else the matrix is
!> that of the general stepper, and sweeps are given up later.
!>
!> The special steppers of Hamiltonians eliminate momenta and have symmetric matrices, which forces have not.
module symsde_step_stages_forced
   use symsde_base_kinds, only: wp, i8
   use symsde_base_record, only: step_record
   use symsde_base_traits, only: dense
   use symsde_model_abstract, only: model_type
   use symsde_scheme_scheme, only: correction_none, scheme_type
   use symsde_solve_blocks, only: max_lane_unknowns
   use symsde_solve_fixed_point, only: take, judge_sweep, most_sweeps, done
   use symsde_step_oracle_general, only: general_stepper, new_general_stepper, split_weights, stage_point, &
                                         linearise_all, look_back, first
   use symsde_step_stepper, only: stepper_task
   implicit none
   private
   public :: forced_stages_stepper, forced_stages_fit

   !> Contractions from which Newton's iteration is tried, with bands and with dense matrices. Its matrices take several
   !> calls of the forces, often functions of a user.
   real(wp), parameter :: banded_rate = 0.4_wp, dense_rate = 0.8_wp

   type, extends(general_stepper) :: forced_stages_stepper
      integer :: band = dense                      !! b; dense: the matrix is that of the general stepper
      integer :: nslope = 0                        !! slopes of each degree of freedom
      real(wp) :: slow = banded_rate               !! contraction of sweeps that are given up
      real(wp), allocatable :: y(:, :)             !! unknowns by degrees of freedom (nlane, nslope ndof)
      real(wp), allocatable :: last(:)             !! size of the last change of a sweep, or a verdict (nlane)
      integer(i8), allocatable :: left(:)          !! 0 in lanes left to Newton, afterwards their status (nlane)
   contains
      procedure :: make
      procedure :: increment
   end type forced_stages_stepper

contains

   !> Whether this stepper executes the task: a tableau of more unknowns than are solved across lanes.
   logical function forced_stages_fit(task) result(fits)
      type(stepper_task), intent(in) :: task

      fits = associated(task%model%forces) .and. task%is_plain() .and. .not. task%general .and. task%newton%is_free()
      if (fits) fits = slopes_of(task%model, task%scheme)*task%model%traits%ndof > max_lane_unknowns
   end function forced_stages_fit

   !> Slopes of each degree of freedom: F and G of every stage, and of drift and noise where these differ.
   pure integer function slopes_of(model, scheme)
      class(model_type), intent(in) :: model
      type(scheme_type), intent(in) :: scheme

      slopes_of = 2*scheme%nstage*merge(1, 2, scheme%noise_coefficients_equal() .or. model%traits%nnoise == 0)
   end function slopes_of

   !> Make the equations of the general stepper, with bands where there are some.
   subroutine make(self, task)
      class(forced_stages_stepper), intent(inout) :: self
      type(stepper_task), intent(in) :: task
      integer :: side, band, nslope

      band = task%model%traits%reach()
      nslope = slopes_of(task%model, task%scheme)
      side = nslope*(band + 1) - 1
      if (2*side + 1 >= nslope*task%model%traits%ndof) band = dense
      if (band == dense) side = -1
      call new_general_stepper(self, task%model, task%scheme, correction_none, task%nlane, task%newton, task%damping, &
                               diagonals=side)
      self%band = band
      self%nslope = nslope
      self%name = 'stages, forced'
      if (task%damping%acts()) self%name = 'stages, forced, damped'
      if (band == dense) self%slow = dense_rate
      allocate (self%last(task%nlane), self%left(task%nlane))
      if (band /= dense) allocate (self%y(task%nlane, nslope*task%model%traits%ndof))
   end subroutine make

   !> dq and dp, by sweeps, and by Newton's iteration in lanes that these leave.
   subroutine increment(self, step, q, p, dq, dp, status)
      class(forced_stages_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), intent(out) :: dq(self%ham%nlane, self%ham%ndof), dp(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      integer :: i

      call split_weights(self, step%w)
      call self%decays%set_step(step%h)
      call sweep(self, step, q, p, status)
      self%left = merge(0_i8, -1_i8, status == 0 .and. .not. abs(self%last - done) <= 0)
      if (any(self%left == 0)) then
         do i = 1, size(self%x, 2)
            self%x(:, i) = merge(0.0_wp, self%x(:, i), self%left == 0)
         end do
         if (self%band == dense) then
            call self%solve_stages(step, q, p, self%left)
         else
            call solve_banded(self, step, q, p, self%left)
         end if
         status = merge(self%left, status, self%left > 0)
      end if
      call self%add_up(p, dq, dp)
   end subroutine increment

   !> Sweeps from slopes of zero, until each lane is done or given up.
   subroutine sweep(self, step, q, p, status)
      class(forced_stages_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(in) :: status(self%ham%nlane)
      real(wp), dimension(self%ham%nlane) :: change, extent  ! largest change and slope of a sweep
      integer :: i, part, number, nrunning

      self%x = 0
      self%last = merge(0.0_wp, done, status == 0)
      nrunning = count(status == 0)
      associate (nlane => self%ham%nlane, n => self%ham%ndof, f => self%newton%r)
         do number = 1, most_sweeps
            if (nrunning == 0) exit
            change = 0
            extent = 0
            do i = 1, self%nstage
               call stage_point(self, i, q, p)
               do part = 1, self%npart
                  associate (at => first(self, i, part))
                     call self%ham%gradient(step%t + self%c(i)*step%h, self%v(:, :, part), self%qs, self%ps, &
                                            hq=f(:, at + n:at + 2*n - 1), hp=f(:, at:at + n - 1))
                     call take(nlane, n, 1.0_wp, f(1, at), self%last, self%x(1, at), change, extent)
                     call take(nlane, n, -1.0_wp, f(1, at + n), self%last, self%x(1, at + n), change, extent)
                  end associate
               end do
            end do
            self%ham%counters%iterations = self%ham%counters%iterations + nrunning
            call judge_sweep(nlane, number, self%slow, self%slow, change, extent, self%last, nrunning)
         end do
      end associate
   end subroutine sweep

   !> Newton's iteration with a banded matrix, from slopes of zero in lanes without a status.
   subroutine solve_banded(self, step, q, p, status)
      class(forced_stages_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      integer(i8), intent(inout) :: status(self%ham%nlane)
      real(wp), allocatable :: r(:, :), near(:)

      call sort(self, self%x, self%y)
      call self%newton%start(status)
      do while (self%newton%running)
         ! without a dense matrix this is the residual, in the order of x
         call linearise_all(self, step, q, p)
         r = self%newton%r
         if (.not. allocated(near)) near = max(maxval(abs(r), dim=2), maxval(abs(self%x), dim=2))
         call sort(self, r, self%newton%r)
         call fill_bands(self, step, q, p)
         call self%newton%update(self%y, status, self%ham%counters)
         call sort_back(self, self%y, self%x)
      end do
      if (allocated(near)) call look_back(self, step, q, p, near, status)
   end subroutine solve_banded

   !> The matrix of all stages and parts in the order of y, by rows; the blocks are those of step/oracle/general.
   subroutine fill_bands(self, step, q, p)
      class(forced_stages_stepper), intent(inout) :: self
      type(step_record), intent(in) :: step
      real(wp), intent(in) :: q(self%ham%nlane, self%ham%ndof), p(self%ham%nlane, self%ham%ndof)
      real(wp), allocatable, dimension(:, :, :) :: hqq, hqp, hpp, drag  ! (nlane, -b:b, ndof)
      real(wp) :: a, abar
      integer :: i, j, k, d, part, other, row, to

      associate (nlane => self%ham%nlane, n => self%ham%ndof, b => self%band, m => self%newton%bands, &
                 nslope => self%nslope, ham => self%ham)
         allocate (hqq(nlane, -b:b, n), hqp(nlane, -b:b, n), hpp(nlane, -b:b, n), drag(nlane, -b:b, n))
         m = 0
         do i = 1, self%nstage
            call stage_point(self, i, q, p)
            do part = 1, self%npart
               call ham%bare_bands(nlane, b, step%t + self%c(i)*step%h, self%v(:, :, part), self%qs, self%ps, hqq, &
                                   hqp, hpp, drag)
               ham%counters%hessians = ham%counters%hessians + ham%nreal
               do other = 1, self%npart
                  do j = 1, self%nstage
                     a = self%a(i, j, other)
                     do k = 1, n
                        row = place(self, i, part, k)
                        do d = max(-b, 1 - k), min(b, n - k)
                           to = place(self, j, other, k + d) - row
                           abar = self%abar(i, j, other)*self%decays%between(i, j, k + d)
                           m(:, to, row) = -a*hqp(:, -d, k + d)
                           m(:, to + 1, row) = -abar*hpp(:, d, k)
                           m(:, to - 1, row + 1) = a*hqq(:, d, k)
                           m(:, to, row + 1) = abar*(hqp(:, d, k) - drag(:, d, k))
                        end do
                     end do
                  end do
               end do
            end do
         end do
         m(:, 0, :) = m(:, 0, :) + 1
      end associate
   end subroutine fill_bands

   !> The place in y of F of stage i and a part, of degree of freedom k; G follows it.
   pure integer function place(self, i, part, k)
      class(forced_stages_stepper), intent(in) :: self
      integer, intent(in) :: i, part, k

      place = (k - 1)*self%nslope + 2*((part - 1)*self%nstage + i - 1) + 1
   end function place

   !> From the order of x to that of y.
   pure subroutine sort(self, x, y)
      class(forced_stages_stepper), intent(in) :: self
      real(wp), intent(in) :: x(self%ham%nlane, self%newton%n)
      real(wp), intent(out) :: y(self%ham%nlane, self%newton%n)
      integer :: i, k, part, at, to

      do part = 1, self%npart
         do i = 1, self%nstage
            at = first(self, i, part)
            do k = 1, self%ham%ndof
               to = place(self, i, part, k)
               y(:, to) = x(:, at + k - 1)
               y(:, to + 1) = x(:, at + self%ham%ndof + k - 1)
            end do
         end do
      end do
   end subroutine sort

   !> From the order of y to that of x.
   pure subroutine sort_back(self, y, x)
      class(forced_stages_stepper), intent(in) :: self
      real(wp), intent(in) :: y(self%ham%nlane, self%newton%n)
      real(wp), intent(out) :: x(self%ham%nlane, self%newton%n)
      integer :: i, k, part, at, from

      do part = 1, self%npart
         do i = 1, self%nstage
            at = first(self, i, part)
            do k = 1, self%ham%ndof
               from = place(self, i, part, k)
               x(:, at + k - 1) = y(:, from)
               x(:, at + self%ham%ndof + k - 1) = y(:, from + 1)
            end do
         end do
      end do
   end subroutine sort_back

end module symsde_step_stages_forced
